"""Parameters of ``admittance_controller/AdmittanceController``.

Source: ros2_controllers, `admittance_controller` (version 6.9.0).
"""

import dataclasses as dc
import sys
from typing import Annotated, Literal

from arm_drake.description.parameters import Rule
from arm_drake.description.validation import (
    check_at_least,
    check_finite,
    check_length,
    check_not_empty,
    check_unique,
    check_within,
)

# Any finite number is at most this.
_LARGEST = sys.float_info.max

Interface = Literal["position", "velocity", "acceleration"]


@dc.dataclass(frozen=True)
class Kinematics:
    """Which chain of the robot it moves, by which solver."""

    # Plugin that upstream solves with, and its package.
    plugin_name: str
    plugin_package: str

    # First and last link of the chain.
    base: str
    tip: str

    # Damping of the inverse of the Jacobian, at least 0.
    alpha: float = 0.01

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_at_least(self, 0.0, "alpha")


@dc.dataclass(frozen=True)
class Frame:
    """A frame of the robot."""

    # Name of its link.
    id: str

    # Whether it is not of the robot; without effect.
    external: Annotated[bool, Rule(until="humble", is_harmless=True)] = False


@dc.dataclass(frozen=True)
class InFrame:
    """Something that is given in a frame."""

    frame: Frame


@dc.dataclass(frozen=True)
class FtSensor:
    """The force and torque sensor."""

    # Its name in the description.
    name: str

    frame: Frame

    # Weight of a new measurement in the filter, 1 is no filter.
    filter_coefficient: float = 0.05

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_finite(self, "filter_coefficient")


@dc.dataclass(frozen=True)
class CoG:
    """The centre of gravity of what the sensor carries."""

    # Position in the frame [m].
    pos: tuple[float, ...]

    # Weight [N].
    force: float = 0.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_length(self, 3, "pos")


@dc.dataclass(frozen=True)
class GravityCompensation:
    """What the sensor carries."""

    frame: Frame
    CoG: CoG


@dc.dataclass(frozen=True)
class Admittance:
    """How it gives way along and about x, y and z: six values each."""

    # Whether it gives way.
    selected_axes: tuple[bool, ...]

    # Mass [kg] and inertia [kg·m^2], in [1e-4, 1e6].
    mass: tuple[float, ...]

    # Damping D of mass M and stiffness K as D / (2 sqrt(M K)).
    damping_ratio: tuple[float, ...]

    # Stiffness [N/m], [N·m/rad], in [0, 1e8].
    stiffness: tuple[float, ...]

    # Damping of the joints' own velocities, at least 0 [1/s].
    joint_damping: float = 5.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_length(self, 6, "selected_axes", "mass", "damping_ratio", "stiffness")
        check_within(self, 1e-4, 1e6, "mass")
        check_within(self, 0.0, 1e8, "stiffness")
        check_at_least(self, 0.0, "joint_damping")
        check_within(self, -_LARGEST, _LARGEST, "damping_ratio")


@dc.dataclass(frozen=True)
class AdmittanceControllerParameters:
    """Parameters of an AdmittanceController."""

    # Joints to move.
    joints: tuple[str, ...]

    # Interfaces to claim on each joint.
    command_interfaces: tuple[Interface, ...]

    # Interfaces to read of each joint; position is one of them.
    state_interfaces: tuple[Interface, ...]

    # Interfaces of the references that other controllers may claim.
    chainable_command_interfaces: tuple[Literal["position", "velocity"], ...]

    kinematics: Kinematics
    ft_sensor: FtSensor

    # Frame in which it gives way.
    control: InFrame

    # Frame in which gravity points along -z.
    fixed_world_frame: InFrame

    gravity_compensation: GravityCompensation
    admittance: Admittance

    # Joints to command, if by other names; () is `joints`.
    command_joints: tuple[str, ...] = ()

    # Whether parameters may change while it runs.
    enable_parameter_update_without_reactivation: bool = True

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        names = ("joints", "command_interfaces", "state_interfaces")
        check_not_empty(self, *names)
        check_unique(self, *names, "chainable_command_interfaces", "command_joints")
        if "position" not in self.state_interfaces:
            raise ValueError(
                f"state_interfaces must have 'position', "
                f"got {list(self.state_interfaces)}"
            )
        if self.command_joints and len(self.command_joints) != len(self.joints):
            raise ValueError(
                f"command_joints must be empty or as many as joints, "
                f"{len(self.joints)}, got {len(self.command_joints)}: "
                f"{list(self.command_joints)}"
            )
