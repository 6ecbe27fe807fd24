"""``forward_command_controller`` and the groups of `position_controllers` and others.

Source: ros2_controllers, `forward_command_controller`, `position_controllers`,
`velocity_controllers`, `effort_controllers` (version 6.9.0 and jazzy). Parameters only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_not_empty


@dc.dataclass(frozen=True)
class JointGroupControllerParameters:
    """Parameters of a JointGroup{Position,Velocity,Effort}Controller."""

    # Joints to command, in the order of the values; at least one.
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joints")


@dc.dataclass(frozen=True)
class ForwardCommandControllerParameters:
    """Parameters of a ForwardCommandController."""

    # Joints to command, in the order of the values; at least one.
    joints: tuple[str, ...]

    # Interface to claim on each joint.
    interface_name: str

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joints", "interface_name")


@dc.dataclass(frozen=True)
class MultiInterfaceForwardCommandControllerParameters:
    """Parameters of a MultiInterfaceForwardCommandController."""

    # Joint to command.
    joint: str

    # Interfaces to claim on it, in the order of the values; at least one.
    interface_names: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint", "interface_names")
