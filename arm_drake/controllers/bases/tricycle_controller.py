"""The ``tricycle_controller/TricycleController``: a base whose front wheel does all.

Source: ros2_controllers, `tricycle_controller` (version 6.9.0). The front wheel drives
and steers. The base has velocities v forwards [m/s] and w of turning [rad/s], amid the
rear axle; a step takes dt [s].
"""

import dataclasses as dc
import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, Self

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose, RollingMean, integrate_midpoint
from arm_drake.controllers.bases.base import (
    BaseCommand,
    BaseController,
    BaseParameters,
    take_finite,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import ALWAYS, Inbox
from arm_drake.description.parameters import (
    check_not_empty,
    check_positive,
)
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS, Odometry
from arm_drake.messages.control import AckermannDrive, ResetOdometry


def _check_ranges(limits: Any, *quantities: str) -> None:
    """Raise ValueError for a limit below 0, or a smallest one above the largest."""
    for name, value in dc.asdict(limits).items():
        if value < 0.0 and not name.endswith("position"):
            raise ValueError(f"{name} must be at least 0, got {value}")
    for quantity in quantities:
        low, high = (getattr(limits, f"{end}_{quantity}") for end in ("min", "max"))
        if low > high:
            raise ValueError(
                f"min_{quantity} must be at most max_{quantity}, got {low} and {high}"
            )


@dataclass(frozen=True)
class TractionLimits:
    """Limits of the driven wheel, of either direction, at least 0; NaN is no limit."""

    # Velocity [rad/s].
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Speeding up [rad/s^2].
    max_acceleration: float = math.nan
    min_acceleration: float = math.nan

    # Slowing down [rad/s^2].
    max_deceleration: float = math.nan
    min_deceleration: float = math.nan

    # Rate of change of the acceleration [rad/s^3].
    max_jerk: float = math.nan
    min_jerk: float = math.nan

    def __post_init__(self) -> None:
        _check_ranges(self, "velocity", "acceleration", "deceleration", "jerk")


@dataclass(frozen=True)
class SteeringLimits:
    """Limits of the steered joint; NaN is no limit."""

    # Position [rad]; a smallest one that is NaN is the opposite of the largest.
    max_position: float = math.nan
    min_position: float = math.nan

    # Velocity, of either direction, at least 0 [rad/s].
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Acceleration, of either direction, at least 0 [rad/s^2].
    max_acceleration: float = math.nan
    min_acceleration: float = math.nan

    def __post_init__(self) -> None:
        _check_ranges(self, "position", "velocity", "acceleration")


@dataclass(frozen=True)
class TricycleControllerParameters(BaseParameters):
    """Parameters of a TricycleController, whose front wheel drives and steers."""

    # Joints that drive and that steer.
    traction_joint_name: str
    steering_joint_name: str

    # Distance between the front wheel and the rear axle, above 0 [m].
    wheelbase: float = 0.0

    # Radius of the driven wheel, above 0 [m].
    wheel_radius: float = 0.0

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = dc.field(default=False, kw_only=True)

    # Whether the odometry has no pose.
    odom_only_twist: bool = False

    # Age from which a command counts no more, in milliseconds: upstream's own unit.
    cmd_vel_timeout: int = 500

    # Whether the limited command is published.
    publish_ackermann_command: bool = False

    traction: TractionLimits = TractionLimits()
    steering: SteeringLimits = SteeringLimits()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_not_empty(self, "traction_joint_name", "steering_joint_name")
        check_positive(self, "wheelbase", "wheel_radius")


# What is no largest value, if only the smallest is given.
_LARGEST = 1000.0

# How far the steering may be off without slowing the wheel down [rad], and how much
# slower it is if the steering is off by more than a quarter of a turn.
_FREE_DEVIATION = math.pi / 6.0
_SLOWEST = 0.01


class Range(NamedTuple):
    """Smallest and largest size of something."""

    low: float
    high: float

    def clamp(self, value: float) -> float:
        """Return the value, or the end of the range that it is beyond."""
        return min(max(value, self.low), self.high)

    def clamp_size(self, value: float) -> float:
        """Return the value with a size within the range; 0 counts as positive."""
        return math.copysign(self.clamp(abs(value)), 1.0 if value >= 0.0 else -1.0)

    def times(self, factor: float) -> "Range":
        """Return the range with both ends multiplied."""
        return Range(self.low * factor, self.high * factor)


def make_range(low: float, high: float) -> Range | None:
    """Return a range of sizes; None if both ends are NaN, which is unset."""
    if math.isnan(low) and math.isnan(high):
        return None
    return Range(
        0.0 if math.isnan(low) else low, _LARGEST if math.isnan(high) else high
    )


def make_symmetric_range(low: float, high: float) -> Range | None:
    """Return a range; an end that is NaN is the opposite of the other one."""
    if math.isnan(low) and math.isnan(high):
        return None
    return Range(-high if math.isnan(low) else low, -low if math.isnan(high) else high)


class TractionLimiter(NamedTuple):
    """Limits of the wheel's velocity, of either direction; None is no limit."""

    # [rad/s].
    velocity: Range | None = None

    # Speeding up, and slowing down [rad/s^2]; without the first the second is off.
    acceleration: Range | None = None
    deceleration: Range | None = None

    # Rate of change of the acceleration [rad/s^3].
    jerk: Range | None = None

    def limit(self, v: float, v0: float, v1: float, dt: float) -> float:
        """Return a velocity [rad/s] within limits: jerk, acceleration, velocity."""
        if self.jerk is not None:
            v = _limit_second_difference(self.jerk, v, v0, v1, dt)
        if self.acceleration is not None:
            change = self.acceleration if abs(v) >= abs(v0) else self.deceleration
            if change is not None:
                v = v0 + change.times(dt).clamp_size(v - v0)
        return v if self.velocity is None else self.velocity.clamp_size(v)


class SteeringLimiter(NamedTuple):
    """Limits of the steering angle; None is no limit."""

    # [rad].
    position: Range | None = None

    # Of either direction [rad/s], [rad/s^2].
    velocity: Range | None = None
    acceleration: Range | None = None

    def limit(self, p: float, p0: float, p1: float, dt: float) -> float:
        """Return an angle [rad] within limits: acceleration, velocity, position."""
        if self.acceleration is not None:
            p = _limit_second_difference(self.acceleration, p, p0, p1, dt)
        if self.velocity is not None:
            p = p0 + self.velocity.times(dt).clamp_size(p - p0)
        return p if self.position is None else self.position.clamp(p)


class TricycleCommand(NamedTuple):
    """Command of the front wheel: velocity [rad/s] and angle [rad]."""

    rate: float = 0.0
    angle: float = 0.0


def to_wheel_command(
    v: float, w: float, *, wheelbase: float, radius: float
) -> TricycleCommand:
    """Return the front wheel's command; `wheelbase` and `radius` are [m]."""
    if v == 0.0 and w != 0.0:
        angle = math.copysign(math.pi / 2.0, w)
        return TricycleCommand(abs(w) * wheelbase / radius, angle)
    angle = 0.0 if v == 0.0 or w == 0.0 else math.atan(w * wheelbase / v)
    return TricycleCommand(v / (radius * math.cos(angle)), angle)


def speed_scale(deviation: float) -> float:
    """Return how much slower the wheel turns while the steering is off [rad]."""
    if deviation < _FREE_DEVIATION:
        return 1.0
    return _SLOWEST if deviation > math.pi / 2.0 else math.cos(deviation)


class TricycleOdometry(NamedTuple):
    """Estimated pose and velocity of a base; each method returns a new one."""

    means: RollingMean
    pose: PlanarPose = PlanarPose()

    # Forwards [m/s] and of turning [rad/s].
    velocity: tuple[float, float] = (0.0, 0.0)

    def reset(self) -> Self:
        """Put the base to the origin and forget what velocities are a mean of."""
        return self._replace(pose=PlanarPose(), means=self.means.clear())

    def follow(self, v: float, w: float, dt: float) -> Self:
        """Take one step [s] with the commanded velocity, taken as it is."""
        return self._replace(
            velocity=(v, w), pose=integrate_midpoint(self.pose, v, w, dt)
        )

    def measure(self, speed: float, angle: float, wheelbase: float, dt: float) -> Self:
        """Take one step with the front wheel's `speed` [m/s] at an `angle` [rad]."""
        v, w = speed * math.cos(angle), speed * math.sin(angle) / wheelbase
        means = self.means.add(v, w)
        mean_v, mean_w = means.means(2)
        pose = integrate_midpoint(self.pose, v, w, dt)
        return self._replace(means=means, velocity=(mean_v, mean_w), pose=pose)


def _limit_second_difference(
    limits: Range, x: float, x0: float, x1: float, dt: float
) -> float:
    """Return x with limits of its second derivative, as upstream has them.

    Upstream's factor of two makes the limit twice what it says.
    """
    last = x0 - x1
    return x0 + last + limits.times(2.0 * dt * dt).clamp_size(x - x0 - last)


_MILLISECONDS = NANOSECONDS // 1000


class TricycleControllerState(NamedTuple):
    """State of a TricycleController between two ticks."""

    odometry: TricycleOdometry

    # Commands, shape (2,): velocity [rad/s] and angle [rad]; NaN is none.
    command: Array

    # The velocity that is asked for; NaN is nothing.
    received: BaseCommand = BaseCommand((math.nan, math.nan))

    # The origin, if the next tick is to reset the odometry.
    pose: PlanarPose | None = None

    inbox: Inbox = Inbox()

    # The last two commands, the newest last; as upstream keeps them, see `_round`.
    previous: tuple[TricycleCommand, TricycleCommand] = (TricycleCommand(),) * 2

    # Time of the last tick [ns]; None before the first one.
    time_ns: int | None = None

    # Whether the last tick could read what it needs.
    is_ok: bool = True


class TricycleController(BaseController[TricycleControllerState]):
    """Drives and steers a base by its front wheel, and publishes its odometry.

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    positions and velocities of all J joints of the robot, or
                              more
    cmd_vel             --    TwistStamped: velocity of the base from now on; with
                              humble's ``use_stamped_vel: false`` the port is
                              ``cmd_vel_unstamped`` and takes a Twist
    reset_odometry      --    ResetOdometry: the base is at the origin now
    command_interfaces  --    UpdateResult; command (2,): velocity [rad/s], angle [rad]
    odom                --    Odometry
    tf                  --    TFMessage; there only with ``enable_odom_tf``
    cmd_ackermann       --    AckermannDrive, the limited command; there only with
                              ``publish_ackermann_command``
    events              --    tuple of the latest (number, event), the newest last; an
                              event is a TopicRejected
    ==================  ====  =========================================================

    Without a command of the last ``cmd_vel_timeout`` the base stops and the wheel goes
    straight. A command that isn't finite stops it, too; upstream would pass it on. A
    tick that can't read the joints fails. The state is a TricycleControllerState.
    """

    pose_topic = ("reset_odometry", ResetOdometry)
    takes_poses_despite = ALWAYS

    def __init__(
        self,
        parameters: TricycleControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._wheelbase, self._radius = parameters.wheelbase, parameters.wheel_radius
        self._is_open_loop = parameters.open_loop
        self._timeout_ns = parameters.cmd_vel_timeout * _MILLISECONDS
        traction, steering = parameters.traction, parameters.steering
        self._traction = TractionLimiter(*_ranges(traction, TractionLimiter._fields))
        self._steering = SteeringLimiter(*_ranges(steering, SteeringLimiter._fields))
        self._has_pose = not parameters.odom_only_twist
        names = (
            f"{parameters.traction_joint_name}/{interfaces.VELOCITY}",
            f"{parameters.steering_joint_name}/{interfaces.POSITION}",
        )
        means = RollingMean(parameters.velocity_rolling_window_size)
        outputs = {"cmd_ackermann": self._describe_command}
        super().__init__(
            parameters,
            params,
            TricycleControllerState(TricycleOdometry(means), np.full(2, np.nan)),
            is_stamped=parameters.use_stamped_vel,
            has_references=False,
            is_lyrical=True,
            outputs=outputs if parameters.publish_ackermann_command else {},
            state_interfaces=names,
            command_interfaces=names,
        )

    def _update(
        self, now: UpdateContext, state: TricycleControllerState
    ) -> TricycleControllerState:
        state = self._receive(now, state)
        v, w = state.received.velocity
        age_ns = now.time_ns - state.received.stamp_ns
        if math.isnan(v) or age_ns > self._timeout_ns:
            v = w = 0.0
        rate, angle = self._read(now.context).tolist()
        if not math.isfinite(angle) or not (self._is_open_loop or math.isfinite(rate)):
            return state._replace(is_ok=False)
        dt = now.period_ns / NANOSECONDS
        if self._is_open_loop:
            odometry = state.odometry.follow(v, w, dt)
        else:
            speed = rate * self._radius
            odometry = state.odometry.measure(speed, angle, self._wheelbase, dt)
        if state.pose is not None:
            odometry = odometry.reset()
        requested = to_wheel_command(
            v, w, wheelbase=self._wheelbase, radius=self._radius
        )
        slowed = requested.rate * speed_scale(abs(requested.angle - angle))
        second, last = state.previous
        command = TricycleCommand(
            self._traction.limit(slowed, last.rate, second.rate, dt),
            self._steering.limit(requested.angle, last.angle, second.angle, dt),
        )
        return state._replace(
            odometry=odometry,
            command=np.array(command),
            pose=None,
            previous=(last, _round(command)),
            time_ns=now.time_ns,
            is_ok=True,
        )

    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        # Any age is taken; what is too old has no effect.
        return take_finite(command)

    def _take_pose(
        self, state: TricycleControllerState, message: ResetOdometry, time_ns: int
    ) -> tuple[TricycleControllerState, str]:
        return state._replace(pose=PlanarPose()), ""

    def _deactivate(
        self, now: UpdateContext, state: TricycleControllerState
    ) -> TricycleControllerState:
        return state._replace(command=np.zeros(2))

    def _is_ok(self, state: TricycleControllerState) -> bool:
        return state.is_ok

    def _fault(self, state: TricycleControllerState) -> str:
        return f"not all of {', '.join(self.state_interfaces)} could be read"

    def _describe_odometry(self, state: TricycleControllerState) -> Odometry:
        pose = state.odometry.pose if self._has_pose else PlanarPose()
        return self._make_odometry(state, pose)

    def _describe_command(self, state: TricycleControllerState) -> AckermannDrive:
        """Return the topic cmd_ackermann."""
        rate, angle = state.previous[-1]
        return AckermannDrive(steering_angle=angle, speed=rate)


def _ranges(limits: Any, quantities: Iterable[str]) -> Iterator[Range | None]:
    """Yield the ranges of quantities; that of a position is symmetric."""
    for name in quantities:
        make = make_symmetric_range if name == "position" else make_range
        yield make(getattr(limits, f"min_{name}"), getattr(limits, f"max_{name}"))


def _round(command: TricycleCommand) -> TricycleCommand:
    """Return a command in the single precision of AckermannDrive.

    Upstream limits the next command by the last two in this form.
    """
    return TricycleCommand(*map(float, np.array(command, dtype=np.float32)))
