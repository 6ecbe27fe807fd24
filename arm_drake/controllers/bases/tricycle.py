"""A base whose front wheel drives and steers: limits, commands, odometry.

The rules are those of ros2_controllers' `tricycle_controller` (version 6.9.0). The base
has velocities v forwards [m/s] and w of turning [rad/s], amid the rear axle.
"""

import math
from typing import NamedTuple, Self

from arm_drake.control.odometry import PlanarPose, RollingMean, integrate_arc

# What is no largest value, if only the smallest is given.
_LARGEST = 1000.0

# How far the steering may be off without slowing the wheel down [rad], and how much
# slower it is if the steering is off by more than a quarter of a turn.
_FREE_DEVIATION = math.pi / 6.0
_SLOWEST = 0.01

# A turn in one step below which an arc is computed as a line [rad].
_SMALL_TURN = 1e-6


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
    """Return a range of sizes; None if both ends are NaN, which is not given."""
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
        """Return a velocity within all limits: jerk, acceleration, velocity.

        Args:
            v: Velocity that is asked for [rad/s].
            v0: Last velocity [rad/s].
            v1: Velocity before the last one [rad/s].
            dt: Time between velocities [s].
        """
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
        """Return an angle within all limits: acceleration, velocity, position.

        Args:
            p: Angle that is asked for [rad].
            p0: Last angle [rad].
            p1: Angle before the last one [rad].
            dt: Time between angles [s].
        """
        if self.acceleration is not None:
            p = _limit_second_difference(self.acceleration, p, p0, p1, dt)
        if self.velocity is not None:
            p = p0 + self.velocity.times(dt).clamp_size(p - p0)
        return p if self.position is None else self.position.clamp(p)


class TricycleCommand(NamedTuple):
    """What the front wheel is told: its velocity [rad/s] and its angle [rad]."""

    rate: float = 0.0
    angle: float = 0.0


def to_wheel_command(
    v: float, w: float, *, wheelbase: float, radius: float
) -> TricycleCommand:
    """Return what the front wheel is told for a velocity of the base.

    Args:
        v: Velocity forwards [m/s].
        w: Velocity of turning [rad/s].
        wheelbase: Distance from the front wheel to the rear axle [m].
        radius: Radius of the front wheel [m].
    """
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
    """Where a base takes itself to be, and how fast; each method returns a new one."""

    means: RollingMean
    pose: PlanarPose = PlanarPose()

    # Forwards [m/s] and of turning [rad/s].
    velocity: tuple[float, float] = (0.0, 0.0)

    def reset(self) -> Self:
        """Put the base to the origin and forget what velocities are a mean of."""
        return self._replace(pose=PlanarPose(), means=self.means.clear())

    def follow(self, v: float, w: float, dt: float) -> Self:
        """Take one step [s] with the velocity that is asked for, taken as it is."""
        return self._replace(velocity=(v, w), pose=_integrate(self.pose, v, w, dt))

    def measure(self, speed: float, angle: float, wheelbase: float, dt: float) -> Self:
        """Take one step with what the front wheel does.

        Args:
            speed: How fast it rolls [m/s].
            angle: Its steering angle [rad].
            wheelbase: Distance from the front wheel to the rear axle [m].
            dt: Period [s].
        """
        v, w = speed * math.cos(angle), speed * math.sin(angle) / wheelbase
        means = self.means.add(v, w)
        mean_v, mean_w = means.means(2)
        pose = _integrate(self.pose, v, w, dt)
        return self._replace(means=means, velocity=(mean_v, mean_w), pose=pose)


def _limit_second_difference(
    limits: Range, x: float, x0: float, x1: float, dt: float
) -> float:
    """Return x with limits of its second derivative, as upstream has them.

    Upstream's factor of two makes the limit twice what it says.
    """
    last = x0 - x1
    return x0 + last + limits.times(2.0 * dt * dt).clamp_size(x - x0 - last)


def _integrate(pose: PlanarPose, v: float, w: float, dt: float) -> PlanarPose:
    if abs(w * dt) >= _SMALL_TURN:
        return integrate_arc(pose, v, w, dt)
    middle = pose.heading + 0.5 * w * dt
    return PlanarPose(
        pose.x + v * dt * math.cos(middle),
        pose.y + v * dt * math.sin(middle),
        pose.heading + w * dt,
    )
