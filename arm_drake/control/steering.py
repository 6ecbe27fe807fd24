"""Bases with steered wheels: commands of the wheels, and odometry.

The rules are those of ros2_controllers' class ``SteeringOdometry``
(`steering_controllers_library`, version 6.9.0). A base has one or two driven and one or
two steered wheels, at both ends of its wheelbase; of two the right one comes first. Its
velocity is v forwards [m/s] and w of turning [rad/s], at the middle of the driven axle.
Wheels have rates [rad/s], positions and angles [rad]; a step takes dt [s].
"""

import math
from typing import NamedTuple, Self

from arm_drake.control.odometry import PlanarPose, RollingMean, integrate_midpoint

# A steering angle below which the base goes straight on [rad].
_STRAIGHT = 1e-6

# A period below which a velocity has no meaning [s].
_SHORTEST_PERIOD = 1e-4

# How far the steering may be off without slowing the wheels down, and the most that
# counts [rad].
_FREE_DEVIATION = math.pi / 6.0
_LARGEST_DEVIATION = 1.5608


class SteeringGeometry(NamedTuple):
    """Dimensions of a base [m], and how many wheels drive and steer."""

    wheelbase: float
    wheel_radius: float
    num_driven: int = 1
    num_steered: int = 1

    # Distance between two driven and between two steered wheels.
    traction_track_width: float = 0.0
    steering_track_width: float = 0.0


class WheelCommands(NamedTuple):
    """What the wheels are told: velocities [rad/s] and angles [rad]."""

    traction: tuple[float, ...]
    steering: tuple[float, ...]


class BaseVelocity(NamedTuple):
    """Velocity of a base: forwards [m/s] and of turning [rad/s]."""

    v: float = 0.0
    w: float = 0.0


def to_steering_angle(v: float, w: float, wheelbase: float) -> float:
    """Return the angle [rad] of a steered wheel in the middle of its axle.

    Where the base is to turn on the spot it is a quarter of a turn.
    """
    return 0.0 if v == 0.0 and w == 0.0 else math.atan(_divide(w * wheelbase, v))


def to_wheel_commands(
    geometry: SteeringGeometry,
    v: float,
    w: float,
    *,
    measured: float | None,
    slows_down: bool = False,
) -> WheelCommands:
    """Return what the wheels are told, turned as `measured` or else as commanded."""
    wheelbase, radius, num_driven, num_steered, width, steering_width = geometry
    phi = to_steering_angle(v, w, wheelbase)
    rate = v / radius
    if measured is not None and slows_down:
        rate *= _speed_scale(abs(measured - phi))
    turned = phi if measured is None else measured
    is_straight = abs(turned) < _STRAIGHT
    traction: tuple[float, ...] = (rate,) * num_driven
    if num_driven == 2 and not is_straight:
        arc = wheelbase / math.tan(turned)
        traction = tuple(rate * (arc + d) / arc for d in (width / 2.0, -width / 2.0))
    steering: tuple[float, ...] = (phi,) * num_steered
    if num_steered == 2 and not is_straight:
        across = 2.0 * wheelbase * math.sin(phi)
        along = 2.0 * wheelbase * math.cos(phi)
        shift = steering_width * math.sin(phi)
        steering = tuple(math.atan2(across, along + d) for d in (shift, -shift))
    return WheelCommands(traction, steering)


def estimate_steering_angle(
    geometry: SteeringGeometry, angles: tuple[float, ...]
) -> float:
    """Return the angle that a wheel in the middle of the axle would have."""
    if len(angles) == 1:
        return angles[0]
    estimates = []
    for angle, side in zip(angles, (-0.5, 0.5), strict=True):
        rise = math.tan(angle)
        along = geometry.wheelbase + side * geometry.steering_track_width * rise
        estimates.append(math.atan(_divide(geometry.wheelbase * rise, along)))
    return 0.5 * sum(estimates)


def to_base_velocity(
    geometry: SteeringGeometry, rates: tuple[float, ...], steering: float
) -> BaseVelocity:
    """Return the velocity of the base."""
    slope = math.tan(steering)
    speeds = [rate * geometry.wheel_radius for rate in rates]
    if len(speeds) == 2 and slope != 0.0:
        arc, half = geometry.wheelbase / slope, geometry.traction_track_width / 2.0
        speeds = [
            _divide(speed * arc, arc + side)
            for speed, side in zip(speeds, (half, -half), strict=True)
        ]
    v = sum(speeds) / len(speeds)
    return BaseVelocity(v, slope * v / geometry.wheelbase)


class SteeringOdometry(NamedTuple):
    """Where a base takes itself to be, and how fast; each method returns a new one."""

    means: RollingMean
    pose: PlanarPose = PlanarPose()
    velocity: BaseVelocity = BaseVelocity()

    # Steering angle of the last measurement [rad].
    steering: float = 0.0

    # Positions of the driven wheels at the last tick [rad]; () is 0.
    positions: tuple[float, ...] = ()

    def set_pose(self, pose: PlanarPose) -> Self:
        """Put the base somewhere and forget what velocities are a mean of."""
        return self._replace(pose=pose, means=self.means.clear())

    def follow(self, v: float, w: float, dt: float) -> Self:
        """Take one step with the velocity that is asked for, taken as it is."""
        pose = integrate_midpoint(self.pose, v, w, dt)
        return self._replace(pose=pose, velocity=BaseVelocity(v, w))

    def measure_velocities(
        self,
        geometry: SteeringGeometry,
        rates: tuple[float, ...],
        angles: tuple[float, ...],
        dt: float,
    ) -> Self:
        """Take one step with what the wheels do; none if that isn't finite."""
        if not all(map(math.isfinite, (*rates, *angles))):
            return self
        steering = estimate_steering_angle(geometry, angles)
        v, w = to_base_velocity(geometry, rates, steering)
        if not math.isfinite(v * dt) or not math.isfinite(w * dt):
            return self
        moved = self._replace(
            steering=steering, pose=integrate_midpoint(self.pose, v, w, dt)
        )
        if dt < _SHORTEST_PERIOD:
            return moved
        means = self.means.add(v, w)
        return moved._replace(means=means, velocity=BaseVelocity(*means.means(2)))

    def measure_positions(
        self,
        geometry: SteeringGeometry,
        positions: tuple[float, ...],
        angles: tuple[float, ...],
        dt: float,
    ) -> Self:
        """Take one step with how far the wheels went; none if that isn't finite."""
        if not all(map(math.isfinite, (*positions, *angles))):
            return self
        old = self.positions or (0.0,) * len(positions)
        rates = tuple(
            (now - then) / dt for now, then in zip(positions, old, strict=True)
        )
        moved = self.measure_velocities(geometry, rates, angles, dt)
        return moved._replace(positions=positions)


def _speed_scale(deviation: float) -> float:
    """Return how much slower wheels turn while the steering is off [rad]."""
    if deviation < _FREE_DEVIATION:
        return 1.0
    limited = min(deviation, _LARGEST_DEVIATION)
    return math.cos(limited) / math.cos(_FREE_DEVIATION)


def _divide(a: float, b: float) -> float:
    """Return a / b as floating-point numbers have it: the sign of a zero counts."""
    if b != 0.0:
        return a / b
    if a == 0.0:
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)
