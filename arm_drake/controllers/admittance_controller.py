"""The ``admittance_controller/AdmittanceController`` and its parameters.

Source: ros2_controllers, `admittance_controller` (version 6.9.0); the law itself is
`arm_drake.control.admittance`.
"""

import sys
from collections.abc import Collection
from operator import attrgetter
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydrake.math import RotationMatrix

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.admittance import (
    AdmittanceFrames,
    AdmittanceRule,
    AdmittanceState,
    ChainKinematics,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import (
    ALWAYS,
    CHAINED,
    INACTIVE,
    Inbox,
    TopicController,
    check_change,
)
from arm_drake.description.parameters import (
    Rule,
    check_at_least,
    check_finite,
    check_length,
    check_not_empty,
    check_unique,
    check_within,
)
from arm_drake.errors import ParameterError, suggest
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    AdmittanceControllerState,
    Float64MultiArray,
    Header,
    Int8MultiArray,
    JointState,
    JointTrajectoryPoint,
    Quaternion,
    String,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    Vector3,
    Wrench,
    WrenchStamped,
)

# Any finite number is at most this.
_LARGEST = sys.float_info.max

Interface = Literal["position", "velocity", "acceleration"]


@dataclass(frozen=True)
class Kinematics:
    """Chain of the robot that it moves, and its solver."""

    # Plugin that upstream solves with, and its package.
    plugin_name: str
    plugin_package: str

    # First and last link of the chain.
    base: str
    tip: str

    # Damping of the inverse of the Jacobian, at least 0.
    alpha: float = 0.01

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "alpha")


@dataclass(frozen=True)
class Frame:
    """A frame of the robot."""

    # Name of its link.
    id: str

    # Whether it is not of the robot; without effect.
    external: Annotated[bool, Rule(until="humble", is_harmless=True)] = False


@dataclass(frozen=True)
class InFrame:
    """Parameters that consist of a frame."""

    frame: Frame


@dataclass(frozen=True)
class FtSensor:
    """The force and torque sensor."""

    # Its name in the description.
    name: str

    frame: Frame

    # Weight of a new measurement in the filter, 1 is no filter.
    filter_coefficient: float = 0.05

    def __post_init__(self) -> None:
        check_finite(self, "filter_coefficient")


@dataclass(frozen=True)
class CoG:
    """The centre of gravity of what the sensor carries."""

    # Position in the frame [m].
    pos: tuple[float, ...]

    # Weight [N].
    force: float = 0.0

    def __post_init__(self) -> None:
        check_length(self, 3, "pos")


@dataclass(frozen=True)
class GravityCompensation:
    """Load of the sensor."""

    frame: Frame
    CoG: CoG


@dataclass(frozen=True)
class Admittance:
    """Admittance along and about x, y and z: six values each."""

    # Whether it gives way.
    selected_axes: tuple[bool, ...]

    # Mass [kg] and inertia [kg·m^2], in [1e-4, 1e6]; before rolling along and about the
    # axes of kinematics.base, then as all else those of the control frame.
    mass: tuple[float, ...]

    # Damping D of mass M and stiffness K as D / (2 sqrt(M K)).
    damping_ratio: tuple[float, ...]

    # Stiffness [N/m], [N·m/rad], in [0, 1e8].
    stiffness: tuple[float, ...]

    # Damping of the joints' own velocities, at least 0 [1/s].
    joint_damping: float = 5.0

    def __post_init__(self) -> None:
        check_length(self, 6, "selected_axes", "mass", "damping_ratio", "stiffness")
        check_within(self, 1e-4, 1e6, "mass")
        check_within(self, 0.0, 1e8, "stiffness")
        check_at_least(self, 0.0, "joint_damping")
        check_within(self, -_LARGEST, _LARGEST, "damping_ratio")


@dataclass(frozen=True)
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


# Parameters that can't change while the controller runs. Upstream lets those of the
# kinematics and the sensor's name change, without any effect.
_READ_ONLY = (
    "joints",
    "command_joints",
    "command_interfaces",
    "state_interfaces",
    "chainable_command_interfaces",
    "kinematics",
    "ft_sensor.name",
)

_LINKS = (
    "kinematics.base",
    "kinematics.tip",
    "ft_sensor.frame.id",
    "control.frame.id",
    "fixed_world_frame.frame.id",
    "gravity_compensation.frame.id",
)


class AdmittanceSetup(NamedTuple):
    """Parameters of an AdmittanceController, and the rule made of them."""

    parameters: AdmittanceControllerParameters
    rule: AdmittanceRule

    @property
    def sensor(self) -> str:
        """Link of the sensor."""
        return self.parameters.ft_sensor.frame.id


def make_setup(
    parameters: AdmittanceControllerParameters, links: Collection[str], distro: str
) -> AdmittanceSetup:
    """Return what parameters set."""
    for name in _LINKS:
        link = attrgetter(name)(parameters)
        if link not in links:
            raise ParameterError(
                f"{name}: the robot has no link {link!r}; {suggest(link, links)}"
            )
    law, load = parameters.admittance, parameters.gravity_compensation
    rule = AdmittanceRule(
        selected_axes=law.selected_axes,
        mass=np.array(law.mass),
        damping_ratio=np.array(law.damping_ratio),
        stiffness=np.array(law.stiffness),
        # Source: ros2_controllers, pull request 1139 of 2026, which only master has.
        is_mass_in_control_frame=distro == "rolling",
        joint_damping=law.joint_damping,
        alpha=parameters.kinematics.alpha,
        filter_coefficient=parameters.ft_sensor.filter_coefficient,
        weight=load.CoG.force,
        center_of_gravity=np.array(load.CoG.pos),
    )
    return AdmittanceSetup(parameters, rule)


def make_kinematics(
    parameters: AdmittanceControllerParameters, params: ControllerInterfaceParams
) -> ChainKinematics:
    """Return the kinematics of the joints, seen from the base of their chain."""
    if params.make_kinematics is None:
        raise ParameterError("nothing is known of the robot's kinematics")
    for joint in parameters.joints:
        if joint not in params.joint_types:
            raise ParameterError(
                f"joints: the robot has no joint {joint!r}; "
                f"{suggest(joint, params.joint_types)}"
            )
    base, tip = parameters.kinematics.base, parameters.kinematics.tip
    kinematics = params.make_kinematics(parameters.joints, base)
    chain, joints = kinematics.joints_to(tip), set(parameters.joints)
    if not set(chain) - params.followed.keys() <= joints <= set(chain):
        raise ParameterError(
            f"joints: expected those from kinematics.base {base!r} to kinematics.tip "
            f"{tip!r}, {list(chain)}, got {list(parameters.joints)}"
        )
    frame = parameters.ft_sensor.frame.id
    if not joints & set(kinematics.joints_to(frame)):
        raise ParameterError(
            f"ft_sensor.frame.id: none of joints moves link {frame!r} against "
            f"kinematics.base {base!r}"
        )
    return kinematics


def _find_fault(point: JointTrajectoryPoint, joints: tuple[str, ...]) -> str:
    """Return why references can't be taken; empty if they can."""
    for name in ("positions", "velocities"):
        size = len(getattr(point, name))
        if size not in (0, len(joints)):
            return (
                f"{name} must have {len(joints)} elements ({', '.join(joints)}) or "
                f"none, got {size}"
            )
    return ""


def _to_array(message: WrenchStamped) -> Array:
    """Return force and torque along x, y and z, shape (6,)."""
    parts = (message.wrench.force, message.wrench.torque)
    return np.array([value for part in parts for value in (part.x, part.y, part.z)])


class AdmittanceTick(NamedTuple):
    """Data of a tick that are published."""

    time_ns: int
    setup: AdmittanceSetup
    frames: AdmittanceFrames
    control: AdmittanceState

    # Pose of the sensor's frame at the references, shape (4, 4).
    X_BR: Array


def make_status(tick: AdmittanceTick) -> AdmittanceControllerState:
    """Return the message of a tick.

    Its stamps are times of the tick, and its position says where the sensor's frame is
    moved; upstream leaves the first at 0 and the second at rest.
    """
    setup, control, frames = tick.setup, tick.control, tick.frames
    rule, parameters = setup.rule, setup.parameters
    header = Header.from_nanoseconds(tick.time_ns, parameters.kinematics.base)
    moved = frames.R_BS @ tick.X_BR[:3, :3].T
    return AdmittanceControllerState(
        joint_state=JointState(
            Header.from_nanoseconds(tick.time_ns),
            parameters.joints,
            tuple(control.position.tolist()),
            tuple(control.velocity.tolist()),
            tuple(control.acceleration.tolist()),
        ),
        damping=Float64MultiArray(rule.damping.tolist()),
        mass=Float64MultiArray(rule.mass.tolist()),
        selected_axes=Int8MultiArray(tuple(map(int, rule.selected_axes))),
        stiffness=Float64MultiArray(rule.stiffness.tolist()),
        wrench_base=WrenchStamped(header, Wrench(*_vectors(control.wrench_B))),
        admittance_acceleration=TwistStamped(
            header, Twist(*_vectors(control.twist_rate))
        ),
        admittance_velocity=TwistStamped(header, Twist(*_vectors(control.twist))),
        admittance_position=TransformStamped(
            header,
            "admittance_offset",
            Transform(_vectors(frames.displacement)[0], _orientation(moved)),
        ),
        rot_base_control=_orientation(frames.R_BC),
        ref_trans_base_ft=TransformStamped(
            header,
            setup.sensor,
            Transform(
                Vector3(*tick.X_BR[:3, 3].tolist()), _orientation(tick.X_BR[:3, :3])
            ),
        ),
        ft_sensor_frame=String(setup.sensor),
    )


def _vectors(x: Array) -> tuple[Vector3, Vector3]:
    """Return the halves of a vector of six."""
    values = x.tolist()
    return Vector3(*values[:3]), Vector3(*values[3:])


def _orientation(R: Array) -> Quaternion:
    return Quaternion.from_wxyz(RotationMatrix(R).ToQuaternion().wxyz())


# What a joint is commanded, in the order of rows of commands and references.
_COMMANDS = (interfaces.POSITION, interfaces.VELOCITY, interfaces.ACCELERATION)


class AdmittanceControllerSystemState(NamedTuple):
    """State of an AdmittanceController between two ticks."""

    # What the parameters in effect set, and those that were accepted last.
    setup: AdmittanceSetup
    accepted: AdmittanceSetup

    # What is added to the measured wrench [N], [N·m], shape (6,).
    wrench: Array

    control: AdmittanceState

    # Positions, velocities and accelerations, shape (3, n) each: references, new at
    # every activation, and commands, NaN while it is inactive.
    references: Array
    command: Array

    # References that have come since the last tick, if any have; NaN where none.
    requested: Array | None = None

    inbox: Inbox = Inbox()

    # What the last tick tells, if there was one.
    last: AdmittanceTick | None = None

    # Why it can't go on; empty if it can.
    fault: str = ""


class AdmittanceController(TopicController[AdmittanceControllerSystemState]):
    """Moves joints by their references, and lets an arm give way to what pushes it.

    With n = len(joints), vectors in their order:

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    m     everything that is measured; it reads
                              ``state_interfaces`` of the joints, and
                              ``force.{x,y,z}`` [N] and ``torque.{x,y,z}`` [N·m] of
                              ``<ft_sensor.name>``
    joint_references    --    JointTrajectoryPoint: positions and velocities from now on
    wrench_reference    --    WrenchStamped in the sensor's frame: what is added to the
                              measured wrench from now on
    parameters          --    AdmittanceControllerParameters to go on with
    command_interfaces  --    UpdateResult; n values of each of
                              ``command_interfaces``, one after the other
    status              --    AdmittanceControllerState
    events              --    tuple of the latest (number, event), the newest last; an
                              event is a TopicRejected or a ParametersRejected
    ==================  ====  =========================================================

    Other controllers can command the references ``<name>/<joint>/position`` and
    ``/velocity``; the topic is ignored then. The state is an
    AdmittanceControllerSystemState. At every tick::

        command = reference + what the joints give way by

    see `AdmittanceRule.step`. The spring pulls the sensor's frame from where it is
    measured to where it would be at the references. A reference that is NaN is the last
    one, at first what is measured; that of the topic is taken once, when it comes. A
    measured wrench with a NaN is none; that of the topic stays over a deactivation.
    Positions that can't be read when it is activated make its first update fail; later
    the last commands stand for them.

    Unlike upstream's, frames may be any links, not those between base and tip alone;
    joints are told apart by their names, not by their order; and
    ``fixed_world_frame`` may be turned against the base in any way.
    """

    def __init__(
        self,
        parameters: AdmittanceControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        joints, name = parameters.joints, params.controller_name
        setup = make_setup(parameters, params.links, params.distro)
        self._kinematics = make_kinematics(parameters, params)
        n = len(joints)
        self._nothing = np.full((3, n), np.nan)
        references = [
            c for c in _COMMANDS if c in parameters.chainable_command_interfaces
        ]
        sensor = parameters.ft_sensor.name
        super().__init__(
            params,
            AdmittanceControllerSystemState(
                setup,
                setup,
                np.zeros(6),
                AdmittanceState.initial(n),
                self._nothing,
                self._nothing,
            ),
            state_interfaces=(
                *interfaces.interface_names(joints, parameters.state_interfaces),
                *(f"{sensor}/{part}" for part in interfaces.FORCES),
            ),
            command_interfaces=interfaces.interface_names(
                parameters.command_joints or joints, parameters.command_interfaces
            ),
            reference_interfaces=tuple(
                f"{name}/{reference}"
                for reference in interfaces.interface_names(joints, references)
            ),
        )
        self._commanded = [_COMMANDS.index(c) for c in parameters.command_interfaces]
        self._referred = [_COMMANDS.index(c) for c in references]
        self._measured_rows = [_COMMANDS.index(c) for c in parameters.state_interfaces]
        self._subscribe("joint_references", JointTrajectoryPoint, self._take_point)
        self._subscribe(
            "wrench_reference", WrenchStamped, self._take_wrench, despite=ALWAYS
        )
        self._subscribe_parameters(self._take_parameters)
        self._declare_topic("status", self._describe)
        self._declare_events()

    def _update(
        self, now: UpdateContext, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        if state.fault:
            return state
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        requested = state.requested
        if chained is not None:
            requested = self._nothing.copy()
            requested[self._referred] = chained.reshape(len(self._referred), -1)
        references = state.references
        if requested is not None:
            references = np.where(np.isfinite(requested), requested, references)
        measured, wrench = self._measure(now)
        q = measured[0] if np.isfinite(measured[0]).all() else state.command[0]
        setup, period = state.setup, now.period_ns / NANOSECONDS
        frames, X_BR = self._find_frames(setup, q, references[0])
        control = setup.rule.step(state.control, frames, wrench + state.wrench, period)
        moved = (control.position, control.velocity, control.acceleration)
        command = references + np.array(moved)
        fault = ""
        if not np.isfinite(command).all():
            fault = (
                "it gives way beyond all bounds; mass is too small, or stiffness or "
                f"damping_ratio too large, for a period of {period:g} s"
            )
        last = AdmittanceTick(now.time_ns, setup, frames, control, X_BR)
        return state._replace(
            control=control,
            references=references,
            command=command,
            requested=None,
            last=last,
            fault=fault,
        )

    def _take_point(
        self,
        state: AdmittanceControllerSystemState,
        message: JointTrajectoryPoint,
        time_ns: int,
    ) -> tuple[AdmittanceControllerSystemState, str]:
        """Return the state with references."""
        fault = _find_fault(message, state.setup.parameters.joints)
        if fault:
            return state, fault
        requested = self._nothing if state.requested is None else state.requested
        requested = requested.copy()
        if message.positions:
            requested[0] = message.positions
        if message.velocities:
            requested[1] = message.velocities
        return state._replace(requested=requested), ""

    def _take_wrench(
        self,
        state: AdmittanceControllerSystemState,
        message: WrenchStamped,
        time_ns: int,
    ) -> tuple[AdmittanceControllerSystemState, str]:
        """Return the state with what is added to measured wrenches."""
        frame, sensor = message.header.frame_id, state.setup.sensor
        if frame not in ("", sensor):
            return state, (
                f"header.frame_id must be {sensor!r}, the sensor's, got {frame!r}"
            )
        wrench = _to_array(message)
        if not np.isfinite(wrench).all():
            return state, "wrench must be finite"
        return state._replace(wrench=wrench), ""

    def _take_parameters(
        self, state: AdmittanceControllerSystemState, new: object, obstacle: str
    ) -> AdmittanceControllerSystemState:
        """Return the state with parameters, in effect now or after the activation."""
        parameters = check_change(state.accepted.parameters, new, _READ_ONLY)
        accepted = make_setup(parameters, self.params.links, self.params.distro)
        present = state.setup.parameters
        takes_changes = present.enable_parameter_update_without_reactivation
        setup = accepted if takes_changes or obstacle == INACTIVE else state.setup
        return state._replace(setup=setup, accepted=accepted)

    def _measure(self, now: UpdateContext) -> tuple[Array, Array]:
        """Return the joints' state, shape (3, n), NaN where unknown, and the wrench."""
        values, measured = self._read(now.context), self._nothing.copy()
        measured[self._measured_rows] = values[:-6].reshape(
            len(self._measured_rows), -1
        )
        wrench = values[-6:]
        return measured, wrench if np.isfinite(wrench).all() else np.zeros(6)

    def _find_frames(
        self, setup: AdmittanceSetup, q: Array, q_ref: Array
    ) -> tuple[AdmittanceFrames, Array]:
        """Return how frames stand, and the sensor's at the references."""
        kinematics, sensor = self._kinematics, setup.sensor
        X_BR = kinematics.pose(q_ref, sensor)
        X_BS = kinematics.pose(q, sensor)
        control = setup.parameters.control.frame.id
        center = setup.parameters.gravity_compensation.frame.id
        world = setup.parameters.fixed_world_frame.frame.id
        links = dict.fromkeys((control, center, world))
        R = {link: kinematics.pose(q, link)[:3, :3] for link in links}
        turn = RotationMatrix(X_BS[:3, :3] @ X_BR[:3, :3].T).ToAngleAxis()
        moved = X_BS[:3, 3] - X_BR[:3, 3]
        frames = AdmittanceFrames(
            R_BS=X_BS[:3, :3],
            R_BC=R[control],
            R_BG=R[center],
            R_BW=R[world],
            displacement=np.append(moved, turn.angle() * turn.axis()),
            jacobian=kinematics.jacobian(q, sensor),
        )
        return frames, X_BR

    def _activate(
        self, now: UpdateContext, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        state = self._receive_parameters(now, state, INACTIVE)
        measured, _ = self._measure(now)
        joints = state.setup.parameters.joints
        unread = [
            j for j, q in zip(joints, measured[0], strict=True) if not np.isfinite(q)
        ]
        fault = f"the position of joint {unread[0]!r} isn't known" if unread else ""
        # As upstream, it goes on with the velocity that it starts with.
        references = np.where(np.isfinite(measured), measured, 0.0)
        return state._replace(references=references, fault=fault)

    def _deactivate(
        self, now: UpdateContext, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        return state._replace(
            setup=state.accepted,
            control=AdmittanceState.initial(self._nothing.shape[1]),
            command=self._nothing,
        )

    def _command(self, state: AdmittanceControllerSystemState) -> Array:
        return state.command[self._commanded].ravel()

    def _is_ok(self, state: AdmittanceControllerSystemState) -> bool:
        return not state.fault

    def _fault(self, state: AdmittanceControllerSystemState) -> str:
        return state.fault

    def _describe(
        self, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerState:
        """Return the topic status."""
        if state.last is None:
            return AdmittanceControllerState()
        return make_status(state.last)
