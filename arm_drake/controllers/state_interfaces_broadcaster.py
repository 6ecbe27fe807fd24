"""``state_interfaces_broadcaster/StateInterfacesBroadcaster``.

Source: ros2_controllers, `state_interfaces_broadcaster` (version 6.9.0). Parameters
only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_not_empty


@dc.dataclass(frozen=True)
class StateInterfacesBroadcasterParameters:
    """Parameters of a StateInterfacesBroadcaster."""

    # Full names of the interfaces to publish, in order; at least one.
    interfaces: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "interfaces")
