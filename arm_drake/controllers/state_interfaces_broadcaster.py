"""``state_interfaces_broadcaster/StateInterfacesBroadcaster``.

Source: ros2_controllers, `state_interfaces_broadcaster` (version 6.9.0).
"""

import dataclasses as dc
import math

from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.validation import check_not_empty
from arm_drake.errors import ParameterError
from arm_drake.messages import Header
from arm_drake.messages.sensors import Float64Values, Keys


@dc.dataclass(frozen=True)
class StateInterfacesBroadcasterParameters:
    """Parameters of a StateInterfacesBroadcaster."""

    # Full names of the interfaces to publish, in order; at least one.
    interfaces: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "interfaces")


class StateInterfacesBroadcaster(TickingController[Float64Values]):
    """Publishes the values of any state interfaces.

    .. pydrake_system::

        name: StateInterfacesBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - names
        - values

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads what the
                                    parameter ``interfaces`` lists
    command_interfaces  --    --    Tick; it commands nothing
    names               --    --    Keys: these names, always the same
    values              --    --    Float64Values of the last tick, in their order;
                                    NaN before the first one
    ==================  ====  ====  ==================================================

    The state is what was published last.
    """

    def __init__(
        self,
        parameters: StateInterfacesBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.

        Raises:
            ParameterError: If an interface holds anything but a double; upstream isn't
                activated then.
        """
        names = parameters.interfaces
        others = [name for name in names if name in params.other_types]
        if others:
            raise ParameterError(
                "interfaces: expected state interfaces of type double; "
                f"{', '.join(map(repr, others))} aren't"
            )
        nothing = Float64Values(values=(math.nan,) * len(names))
        super().__init__(params, nothing, state_interfaces=names)
        keys = Keys(keys=names)
        self._declare_topic("names", lambda _: keys)
        self._declare_topic("values", lambda message: message)

    def _update(self, now: Now, state: Float64Values) -> Float64Values:
        del state
        values = tuple(self._read(now.context).tolist())
        return Float64Values(Header.from_nanoseconds(now.time_ns), values)
