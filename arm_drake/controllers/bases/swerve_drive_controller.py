"""The ``swerve_drive_controller/SwerveController``, on four wheels that are steered.

Source: ros2_controllers, `swerve_drive_controller` (since rolling). A velocity is
forwards and to the left [m/s], and of turning to the left [rad/s]. Wheels are in the
order front left, front right, rear left, rear right; a step takes dt [s].
"""

import math
from typing import NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose
from arm_drake.controllers.bases.base import BaseCommand, BaseController, Velocity
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import CHAINED, Inbox
from arm_drake.description.claimed_hardware import WHEEL_PARAMETERS
from arm_drake.description.parameters import (
    check_length,
    check_not_empty,
    check_positive,
)
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS

# Parameters that name the wheels' joints, those that steer them, and with limits.
WHEELS, AXLES = WHEEL_PARAMETERS["swerve_drive_controller/SwerveController"]
_THRESHOLDS = tuple(
    name.replace("wheel_joint", "velocity_threshold") for name in WHEELS
)


@dataclass(frozen=True)
class SwerveControllerParameters:
    """Parameters of a SwerveController."""

    # Joints that drive the wheels.
    front_left_wheel_joint: str
    front_right_wheel_joint: str
    rear_left_wheel_joint: str
    rear_right_wheel_joint: str

    # Joints that steer them; a positive angle is to the left.
    front_left_axle_joint: str
    front_right_axle_joint: str
    rear_left_axle_joint: str
    rear_right_axle_joint: str

    # Distances of front and rear wheels, and of left and right ones, above 0 [m].
    wheelbase: float = 0.85
    trackwidth: float = 0.75

    # Where the base turns about, from the middle of the wheels: x, y [m].
    offset: tuple[float, ...] = (0.0, 0.0)

    # Radius of the wheels, above 0 [m].
    wheel_radius: float = 0.04

    # Without effect, as upstream.
    center_of_rotation: tuple[float, ...] = (0.0, 0.0)

    # Age from which a command counts no more, above 0 [s].
    cmd_vel_timeout: float = 10.0

    # Frames of the odometry.
    odom: str = "odom"
    base_footprint: str = "base_footprint"

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Largest velocities, above 0 [m/s]. Upstream they are divided by the radius of the
    # wheels, and limit the odometry with `open_loop` alone, not the wheels.
    front_left_velocity_threshold: float = 2.0
    front_right_velocity_threshold: float = 2.0
    rear_left_velocity_threshold: float = 2.0
    rear_right_velocity_threshold: float = 2.0

    # Diagonals of the odometry's covariances; upstream 0.01 takes the place of each.
    pose_covariance_diagonal: tuple[float, ...] = (0.0,) * 6
    twist_covariance_diagonal: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        check_not_empty(self, *WHEELS, *AXLES)
        check_positive(self, "wheelbase", "trackwidth", "wheel_radius")
        check_positive(self, "cmd_vel_timeout", *_THRESHOLDS)
        check_length(self, 2, "offset", "center_of_rotation")
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")

    @property
    def odom_frame_id(self) -> str:
        """Return the frame of the odometry."""
        return self.odom

    @property
    def base_frame_id(self) -> str:
        """Return the frame of the base."""
        return self.base_footprint


UNKNOWN: Velocity = (math.nan, math.nan, math.nan)
REST: Velocity = (0.0, 0.0, 0.0)

# Smaller velocities are rest [m/s] or [rad/s], and smaller turns are straight [rad].
_MIN_VELOCITY = 1e-6
_MIN_TURN = 1e-6

_COVARIANCE = (0.01,) * 6


@dataclass(frozen=True, eq=False)
class SwerveKinematics:
    """Measures of a base, which take its velocity to its wheels and back."""

    # Where the wheels are, from where the base turns about [m]. Shapes (4,).
    x: Array
    y: Array

    @classmethod
    def of(cls, parameters: SwerveControllerParameters) -> "SwerveKinematics":
        """Return those of a controller's parameters."""
        x, y = parameters.offset
        return cls(
            np.array([0.5, 0.5, -0.5, -0.5]) * parameters.wheelbase - x,
            np.array([0.5, -0.5, 0.5, -0.5]) * parameters.trackwidth - y,
        )

    def to_wheels(self, velocity: Velocity) -> tuple[Array, Array]:
        """Return how fast wheels run [m/s] and how they are steered [rad], shapes (4,).

        A wheel goes as the base does where it is: (vx - w y, vy + w x).
        """
        vx, vy, w = velocity
        forwards, sideways = vx - w * self.y, vy + w * self.x
        return np.hypot(forwards, sideways), np.arctan2(sideways, forwards)

    def to_base(self, speeds: Array, angles: Array) -> Velocity:
        """Return the velocity of the base that wheels have.

        It is the mean of the wheels' velocities, and their moment about where the base
        turns, by the sum of the squared distances.
        """
        vx, vy = speeds * np.cos(angles), speeds * np.sin(angles)
        moment = vy @ self.x - vx @ self.y
        w = moment / (self.x @ self.x + self.y @ self.y)
        return float(vx.mean()), float(vy.mean()), float(w)


class SwerveOdometry(NamedTuple):
    """Estimated pose and velocity of a base."""

    pose: PlanarPose = PlanarPose()
    velocity: Velocity = REST

    def move(self, velocity: Velocity, dt: float) -> "SwerveOdometry":
        """Return the odometry after a step with a velocity."""
        vx, vy, w = velocity
        x, y, heading = self.pose
        turn = w * dt
        if abs(turn) < _MIN_TURN:
            middle = heading + turn / 2.0
            along, across = dt * math.cos(middle), dt * math.sin(middle)
        else:
            along = (math.sin(heading + turn) - math.sin(heading)) / w
            across = (math.cos(heading) - math.cos(heading + turn)) / w
        pose = PlanarPose(
            x + vx * along - vy * across,
            y + vx * across + vy * along,
            math.remainder(heading + turn, math.tau),
        )
        return SwerveOdometry(pose, velocity)


class SwerveState(NamedTuple):
    """State of a SwerveController between two ticks."""

    odometry: SwerveOdometry

    # Velocities of the wheels [rad/s], then angles of the axles [rad], shape (8,); NaN
    # is none.
    command: Array

    # How the wheels are steered when the base rests [rad], shape (4,); None before the
    # first tick of an activation.
    steering: tuple[float, ...] | None = None

    # The last command; None before.
    received: BaseCommand | None = None

    # What is asked for; NaN if there is nothing.
    reference: Velocity = UNKNOWN

    # No topic sets it.
    pose: PlanarPose | None = None

    inbox: Inbox = Inbox()

    # Time of the last update of the odometry [ns]; None before the first one.
    time_ns: int | None = None


class SwerveController(BaseController[SwerveState]):
    """Drives four wheels and steers each by the base's velocity command, sideways too.

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    what all J joints of the robot measure, or more
    cmd_vel             --    TwistStamped: velocity of the base until it is older than
                              ``cmd_vel_timeout``
    command_interfaces  --    UpdateResult; command (8,): wheels [rad/s], axles [rad]
    odom                --    Odometry: where the wheels, or with ``open_loop`` the
                              commands, say that the base is
    tf                  --    TFMessage with the same, if ``enable_odom_tf``
    events              --    tuple of the latest (number, TopicRejected)
    ==================  ====  =========================================================

    A wheel that is commanded the velocity v of its place runs at abs(v)/wheel_radius,
    never backwards, and is steered to the direction of v. At rest it stays as it was
    steered last, and from an activation on as it is found. Other controllers can
    command the references; the topic is ignored then. Of a command that isn't finite
    nothing counts: the references stay. A deactivation steers the wheels to 0. The
    state is a SwerveState.
    """

    moves_sideways = True
    pose_topic = None

    def __init__(
        self,
        parameters: SwerveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._parameters = parameters
        self._kinematics = SwerveKinematics.of(parameters)
        self._timeout_ns = int(parameters.cmd_vel_timeout * NANOSECONDS)
        thresholds = [getattr(parameters, name) for name in _THRESHOLDS]
        self._limits = np.array(thresholds) / parameters.wheel_radius
        wheels = tuple(getattr(parameters, name) for name in WHEELS)
        axles = tuple(getattr(parameters, name) for name in AXLES)
        names = (
            *interfaces.interface_names(wheels, (interfaces.VELOCITY,)),
            *interfaces.interface_names(axles, (interfaces.POSITION,)),
        )
        super().__init__(
            parameters,
            params,
            SwerveState(SwerveOdometry(), np.full(8, np.nan)),
            covariances=(_COVARIANCE, _COVARIANCE),
            state_interfaces=names,
            command_interfaces=names,
        )

    def _update(self, now: UpdateContext, state: SwerveState) -> SwerveState:
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        measured = self._read(now.context)
        steering = state.steering or tuple(measured[4:].tolist())
        reference = self._follow(now, state) if chained is None else chained.tolist()
        state = state._replace(reference=tuple(reference), steering=steering)
        if not all(map(math.isfinite, state.reference)):
            return state._replace(command=np.full(8, np.nan))
        speeds, angles = self._kinematics.to_wheels(state.reference)
        if all(abs(v) < _MIN_VELOCITY for v in state.reference):
            steered = np.array(steering)
        else:
            steered = angles
        radius = self._parameters.wheel_radius
        if self._parameters.open_loop:
            moved = np.minimum(speeds, self._limits), angles
        else:
            moved = measured[:4] * radius, measured[4:]
        velocity = self._kinematics.to_base(*moved)
        return state._replace(
            command=np.concatenate([speeds / radius, steered]),
            steering=tuple(steered.tolist()),
            odometry=state.odometry.move(velocity, now.period_ns / NANOSECONDS),
            time_ns=now.time_ns,
        )

    def _follow(self, now: UpdateContext, state: SwerveState) -> Velocity:
        """Return the velocity of the last command, or rest if that is too old."""
        if state.received is None:
            return REST
        velocity, stamp_ns = state.received
        return REST if now.time_ns - stamp_ns > self._timeout_ns else velocity

    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        if all(map(math.isfinite, command.velocity)):
            return command, ""
        return None, (
            "linear.x, linear.y and angular.z must be finite, got "
            f"{', '.join(map(str, command.velocity))}; the last reference goes on"
        )

    def _deactivate(self, now: UpdateContext, state: SwerveState) -> SwerveState:
        return state._replace(command=np.zeros(8), steering=None)
