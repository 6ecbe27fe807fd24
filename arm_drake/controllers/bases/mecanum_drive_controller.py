"""The ``mecanum_drive_controller/MecanumDriveController``, on four wheels.

Source: ros2_controllers, `mecanum_drive_controller` (version 6.9.0). A velocity is
forwards and to the left [m/s], and of turning to the left [rad/s].
"""

import dataclasses as dc
import math
from typing import Annotated, NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import (
    MecanumKinematics,
    MecanumWheels,
    PlanarPose,
    rotate,
)
from arm_drake.controllers.bases.base import (
    REFERENCE,
    BaseCommand,
    BaseController,
    SpeedLimits,
    Velocity,
    limit_velocity,
    make_limiter,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import CHAINED, Inbox
from arm_drake.description.parameters import (
    Rule,
    check_duration,
    check_length,
    check_not_empty,
    check_positive,
)
from arm_drake.errors import ParameterError
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS, Header, Twist, Vector3
from arm_drake.messages.control import MecanumDriveControllerState

UNKNOWN: Velocity = (math.nan, math.nan, math.nan)
REST: Velocity = (0.0, 0.0, 0.0)

# Shorter steps aren't integrated [s].
_MIN_STEP = 1e-4


class MecanumOdometry(NamedTuple):
    """Estimated pose and velocity of a base."""

    pose: PlanarPose = PlanarPose()
    velocity: Velocity = REST

    def update(
        self, kinematics: MecanumKinematics, wheels: MecanumWheels, dt: float
    ) -> "MecanumOdometry":
        """Return the odometry after a step [s]; itself if the step is too short.

        The position moves with the heading at the end of the step. Velocities are not
        filtered.
        """
        if dt < _MIN_STEP:
            return self
        velocity = kinematics.to_base(wheels)
        heading = self.pose.heading + velocity[2] * dt
        vx, vy = rotate(velocity[0], velocity[1], heading)
        pose = PlanarPose(self.pose.x + vx * dt, self.pose.y + vy * dt, heading)
        return MecanumOdometry(pose, velocity)


@dataclass(frozen=True)
class BaseFrameOffset:
    """Pose of the wheels' centre in the base frame [m], [rad]."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0


@dataclass(frozen=True)
class MecanumKinematicsParameters:
    """Measures of the base."""

    base_frame_offset: BaseFrameOffset = BaseFrameOffset()

    # Radius of the wheels, above 0 [m].
    wheels_radius: float = 0.0

    # Distances of the wheels from the centre, along x plus along y [m].
    sum_of_robot_center_projection_on_X_Y_axis: float = 0.0

    def __post_init__(self) -> None:
        check_positive(self, "wheels_radius")


@dataclass(frozen=True)
class MecanumLinear:
    """Limits of the velocity forwards and sideways."""

    x: SpeedLimits = dc.field(default=SpeedLimits())
    y: SpeedLimits = dc.field(default=SpeedLimits())


@dataclass(frozen=True)
class MecanumAngular:
    """Limits of the velocity of turning."""

    z: SpeedLimits = dc.field(default=SpeedLimits())


@dataclass(frozen=True)
class MecanumDriveControllerParameters:
    """Parameters of a MecanumDriveController."""

    # Joints of the wheels.
    front_left_wheel_command_joint_name: str
    front_right_wheel_command_joint_name: str
    rear_right_wheel_command_joint_name: str
    rear_left_wheel_command_joint_name: str

    # Joints to read in their places; "" is the same.
    front_left_wheel_state_joint_name: str = ""
    front_right_wheel_state_joint_name: str = ""
    rear_right_wheel_state_joint_name: str = ""
    rear_left_wheel_state_joint_name: str = ""

    # Age from which a command counts no more [s]; 0 uses each one once.
    reference_timeout: float = 0.0

    kinematics: MecanumKinematicsParameters = dc.field(kw_only=True)

    # Frames of the odometry, and what goes before their names.
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""
    base_frame_id: str = "base_link"
    odom_frame_id: str = "odom"

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    twist_covariance_diagonal: tuple[float, ...] = (0.1,) * 6
    pose_covariance_diagonal: tuple[float, ...] = (0.1,) * 6

    linear: Annotated[MecanumLinear, Rule(since="jazzy")] = MecanumLinear()
    angular: Annotated[MecanumAngular, Rule(since="jazzy")] = MecanumAngular()

    def __post_init__(self) -> None:
        check_not_empty(
            self,
            "front_left_wheel_command_joint_name",
            "front_right_wheel_command_joint_name",
            "rear_right_wheel_command_joint_name",
            "rear_left_wheel_command_joint_name",
        )
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")
        check_duration(self, "reference_timeout")


def make_kinematics(parameters: MecanumDriveControllerParameters) -> MecanumKinematics:
    """Return the kinematics of a base."""
    kinematics = parameters.kinematics
    reach = kinematics.sum_of_robot_center_projection_on_X_Y_axis
    if not reach:
        raise ParameterError(
            "kinematics.sum_of_robot_center_projection_on_X_Y_axis must not be 0; it "
            "is half the wheelbase plus half the distance of left and right wheels [m]"
        )
    offset = kinematics.base_frame_offset
    return MecanumKinematics(
        kinematics.wheels_radius, reach, PlanarPose(offset.x, offset.y, offset.theta)
    )


_WHEELS = ("front_left", "front_right", "rear_right", "rear_left")

_NOTHING = np.full(len(_WHEELS), np.nan)


class MecanumDriveState(NamedTuple):
    """State of a MecanumDriveController between two ticks."""

    odometry: MecanumOdometry = MecanumOdometry()

    # What the last message asks for; NaN if there is nothing, or nothing any more.
    received: BaseCommand = BaseCommand(UNKNOWN)

    # Pose to be taken at the next tick.
    pose: PlanarPose | None = None

    inbox: Inbox = Inbox()

    # The last two velocities that the limits let through, the newest first.
    limited: tuple[Velocity, Velocity] = (REST, REST)

    # Velocities of the wheels [rad/s], shape (4,); NaN is none.
    command: Array = _NOTHING

    # Of the last tick: its time [ns], None before the first one, what was asked for
    # and how the wheels turned.
    time_ns: int | None = None
    requested: Velocity = UNKNOWN
    wheels: MecanumWheels = MecanumWheels(0.0, 0.0, 0.0, 0.0)


class MecanumDriveController(BaseController[MecanumDriveState]):
    """Drives the four mecanum wheels of a base by its velocity command, sideways too.

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    what all J joints of the robot measure, or more
    reference           --    TwistStamped: velocity of the base frame, until it is
                              older than ``reference_timeout``
    set_odometry        --    SetOdometry: where the base is
    command_interfaces  --    UpdateResult; command (4,): front left, front right, rear
                              right and rear left wheel [rad/s]
    odometry            --    Odometry: where the wheels say that the base is
    tf_odometry         --    TFMessage with the same, if ``enable_odom_tf``
    controller_state    --    MecanumDriveControllerState
    events              --    tuple of the latest (number, TopicRejected)
    ==================  ====  =========================================================

    Other controllers can command the references; the topic is ignored then. They hold
    for one tick, and so does a message if ``reference_timeout`` is 0. A message that
    gets too old stops the base through the limits for one tick; then, as always without
    a reference, the wheels are told to stop at once, all four, where upstream tells it
    to the first one alone. What the limits remember is then a base at rest. A message
    that isn't finite stops the wheels, too. A pose on ``set_odometry`` takes the place
    of one step of the odometry. The state is a MecanumDriveState.
    """

    topics = REFERENCE
    moves_sideways = True

    def __init__(
        self,
        parameters: MecanumDriveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        commanded = [
            getattr(parameters, f"{wheel}_wheel_command_joint_name")
            for wheel in _WHEELS
        ]
        measured = [
            getattr(parameters, f"{wheel}_wheel_state_joint_name") or joint
            for wheel, joint in zip(_WHEELS, commanded, strict=True)
        ]
        velocity = (interfaces.VELOCITY,)
        self._kinematics = make_kinematics(parameters)
        linear, angular = parameters.linear, parameters.angular
        self._limiters = [*map(make_limiter, (linear.x, linear.y, angular.z))]
        self._timeout_ns = int(parameters.reference_timeout * NANOSECONDS)
        super().__init__(
            parameters,
            params,
            MecanumDriveState(),
            outputs={"controller_state": self._describe},
            state_interfaces=interfaces.interface_names(measured, velocity),
            command_interfaces=interfaces.interface_names(commanded, velocity),
        )

    def _update(
        self, now: UpdateContext, state: MecanumDriveState
    ) -> MecanumDriveState:
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        if chained is None:
            received, requested = self._follow(now, state.received)
        else:
            received, requested = state.received, tuple(chained.tolist())
        dt = now.period_ns / NANOSECONDS
        wheels = MecanumWheels(*self._read(now.context).tolist())
        odometry = state.odometry
        if state.pose is not None:
            odometry = odometry._replace(pose=state.pose)
        elif not any(map(math.isnan, wheels)):
            odometry = odometry.update(self._kinematics, wheels, dt)
        limited, command = (REST, REST), np.zeros(len(_WHEELS))
        if all(map(math.isfinite, requested)):
            velocity = limit_velocity(self._limiters, requested, state.limited, dt)
            limited = (velocity, state.limited[0])
            command = np.array(self._kinematics.to_wheels(velocity))
        return MecanumDriveState(
            odometry=odometry,
            received=received,
            inbox=state.inbox,
            limited=limited,
            command=command,
            time_ns=now.time_ns,
            requested=requested,
            wheels=wheels,
        )

    def _follow(
        self, now: UpdateContext, received: BaseCommand
    ) -> tuple[BaseCommand, Velocity]:
        """Return the rest of a command, and its velocity in a tick.

        What is too old asks for rest, once; without a timeout it holds for one tick.
        """
        velocity, stamp_ns = received
        if math.isnan(velocity[0]):
            return received, velocity
        if not self._timeout_ns:
            return BaseCommand(UNKNOWN), velocity
        if now.time_ns - stamp_ns <= self._timeout_ns:
            return received, velocity
        return BaseCommand(UNKNOWN), REST

    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        if self._timeout_ns and age_ns > self._timeout_ns:
            fault = (
                f"it is {age_ns / NANOSECONDS:g} s old, more than reference_timeout "
                f"({self._timeout_ns / NANOSECONDS:g} s); the base stops"
            )
        elif not all(map(math.isfinite, command.velocity)):
            fault = (
                "linear.x, linear.y and angular.z must be finite, got "
                f"{', '.join(map(str, command.velocity))}; the base stops"
            )
        else:
            return command, ""
        return BaseCommand(UNKNOWN), fault

    def _deactivate(
        self, now: UpdateContext, state: MecanumDriveState
    ) -> MecanumDriveState:
        return state._replace(
            received=BaseCommand(UNKNOWN), command=_NOTHING, limited=(REST, REST)
        )

    def _describe(self, state: MecanumDriveState) -> MecanumDriveControllerState:
        """Return the topic controller_state."""
        if state.time_ns is None:
            return MecanumDriveControllerState()
        x, y, z = state.requested
        return MecanumDriveControllerState(
            Header.from_nanoseconds(state.time_ns, self._frames.odom),
            *state.wheels,
            Twist(Vector3(x, y, 0.0), Vector3(0.0, 0.0, z)),
        )
