"""``vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster``.

Source: ros2_controllers, `vda5050_safety_state_broadcaster` (branch ``master``).
"""

import dataclasses as dc
import math

from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.given import Given
from arm_drake.messages.sensors import VDA5050SafetyState

# Names of before, by those of now.
_OLDER = {
    "field_violation": ("fieldViolation_interfaces", "interfaces.fieldViolation"),
    "e_stop.manual": ("eStop_manual_interfaces", "interfaces.eStop.manual"),
    "e_stop.remote": ("eStop_remote_interfaces", "interfaces.eStop.remote"),
    "e_stop.autoack": ("eStop_autoack_interfaces", "interfaces.eStop.autoack"),
}


@dc.dataclass(frozen=True)
class EStopInterfaces:
    """Full names of interfaces that tell emergency stops, by how they end."""

    manual: tuple[str, ...] = ()
    remote: tuple[str, ...] = ()
    autoack: tuple[str, ...] = ()


@dc.dataclass(frozen=True)
class SafetyInterfaces:
    """Full names of the interfaces to read."""

    # Those that tell that something is in a safety field.
    field_violation: tuple[str, ...] = ()

    e_stop: EStopInterfaces = EStopInterfaces()


@dc.dataclass(frozen=True)
class Vda5050SafetyStateBroadcasterParameters:
    """Parameters of a Vda5050SafetyStateBroadcaster."""

    interfaces: SafetyInterfaces = SafetyInterfaces()

    @staticmethod
    def adapt(given: Given) -> None:
        """Take the names of before."""
        for name, older in _OLDER.items():
            for old in older:
                given.rename(old, f"interfaces.{name}")

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        if self.interfaces == SafetyInterfaces():
            raise ValueError("interfaces must name at least one, got none")


class Vda5050SafetyStateBroadcaster(TickingController[VDA5050SafetyState]):
    """Publishes whether a safety field is violated, and which emergency stop holds.

    .. pydrake_system::

        name: Vda5050SafetyStateBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - vda5050_safety_state

    ====================  ====  ====  ================================================
    port                  size  unit  meaning
    ====================  ====  ====  ================================================
    controller_manager    --    --    Cycle: when to tick
    state_interfaces      m     --    everything that is measured; it reads what the
                                      parameter ``interfaces`` lists
    command_interfaces    --    --    Tick; it commands nothing
    vda5050_safety_state  --    --    VDA5050SafetyState of the last tick
    ====================  ====  ====  ================================================

    The state is what was published last. An interface tells something unless it is 0 or
    NaN. Of several emergency stops a manual one comes first, then a remote one.
    """

    def __init__(
        self,
        parameters: Vda5050SafetyStateBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        names, stops = parameters.interfaces, parameters.interfaces.e_stop
        groups = (names.field_violation, stops.manual, stops.remote, stops.autoack)
        super().__init__(
            params, VDA5050SafetyState(), state_interfaces=tuple(sum(groups, ()))
        )
        # Of each interface: what it tells.
        kinds = ("", "manual", "remote", "autoAck")
        self._kinds = [k for k, g in zip(kinds, groups, strict=True) for _ in g]
        self._declare_topic("vda5050_safety_state", lambda message: message)

    def _update(self, now: Now, state: VDA5050SafetyState) -> VDA5050SafetyState:
        del state
        values = self._read(now.context).tolist()
        told = [
            kind
            for kind, value in zip(self._kinds, values, strict=True)
            if value and not math.isnan(value)
        ]
        stops = [kind for kind in told if kind]
        return VDA5050SafetyState(stops[0] if stops else "none", "" in told)
