"""Parameters of a PidController.

Source: ros2_controllers, `pid_controller` (version 6.9.0; defaults of jazzy, and by
rule those of other distros).
"""

import dataclasses as dc
from typing import Annotated

from arm_drake.control.pid_gains import PidGains, adapt_saturation
from arm_drake.description.given import Given
from arm_drake.description.parameters import Rule, per_element_of
from arm_drake.description.validation import check_not_empty, check_unique


@dc.dataclass(frozen=True)
class DofGains(PidGains):
    """PID of one degree of freedom."""

    # Errors up to this are not integrated.
    error_deadband: Annotated[float, Rule(since="jazzy")] = 1e-16

    # How much of the reference, or of its rate, is added to the output.
    feedforward_gain: float = 0.0

    # Whether errors are angles, which wrap.
    angle_wraparound: bool = False

    # Whether the integral term stays over a deactivation.
    save_i_term: bool = True

    # Whether the PID's own state is published; without effect, see controller_state.
    activate_state_publisher: bool = False

    @staticmethod
    def adapt(given: Given) -> None:
        """Take what older versions have, and `saturation`."""
        PidGains.adapt(given)
        adapt_saturation(given)


@dc.dataclass(frozen=True)
class PidControllerGains:
    """PIDs by degree of freedom."""

    dof: dict[str, DofGains] = per_element_of("dof_names")


@dc.dataclass(frozen=True)
class PidControllerParameters:
    """Parameters of a PidController."""

    # Joints, or other prefixes, to command; at least one, each once.
    dof_names: tuple[str, ...]

    # Interface to claim on each.
    command_interface: str

    # One interface of references and measurements, or two, the second its rate.
    reference_and_state_interfaces: tuple[str, ...]

    # Prefixes of references and measurements, as many, each once; () is dof_names.
    reference_and_state_dof_names: tuple[str, ...] = ()

    # Whether the first reference is what is measured at the start.
    set_current_state_as_first_setpoint: bool = True

    # Whether measurements come from a topic.
    use_external_measured_states: bool = False

    # Whether feedforward_gain acts; later it always does.
    enable_feedforward: Annotated[
        bool,
        Rule(
            kilted=True, rolling=True, until="jazzy", instead="feedforward_gain decides"
        ),
    ] = False

    gains: PidControllerGains = PidControllerGains()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(
            self, "dof_names", "command_interface", "reference_and_state_interfaces"
        )
        check_unique(self, "dof_names", "reference_and_state_dof_names")
        if len(self.reference_and_state_interfaces) > 2:
            raise ValueError(
                f"reference_and_state_interfaces must have 1 or 2 elements, "
                f"got {list(self.reference_and_state_interfaces)}"
            )
        if len(self.reference_and_state_dof_names) not in (0, len(self.dof_names)):
            raise ValueError(
                f"reference_and_state_dof_names must be as many as dof_names, "
                f"got {list(self.reference_and_state_dof_names)}"
            )
        for gains in self.gains.dof.values():
            gains.check()
