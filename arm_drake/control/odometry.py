"""Odometry: from wheels to velocities and poses of bases, and back to wheels.

The rules are those of ros2_controllers (version 6.9.0): `diff_drive_controller` for
differential drive, `mecanum_drive_controller` for mecanum wheels, class
``SteeringOdometry`` of `steering_controllers_library` for steered wheels, of which a
base has one or two, as it has driven ones, at both ends of its wheelbase; of two the
right one comes first. Other kinds of bases have their own way from wheels to
velocities; see `controllers/bases`.

A base goes with v forwards [m/s], with steered wheels at the middle of the driven axle,
and w of turning [rad/s] for a time dt [s]. Wheels have rates [rad/s], positions and
angles [rad].
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

from arm_drake.importing import dataclass


class PlanarPose(NamedTuple):
    """Pose of a base in the frame of its odometry."""

    # [m].
    x: float = 0.0
    y: float = 0.0

    # About z [rad].
    heading: float = 0.0


class RollingMean(NamedTuple):
    """Mean of the last samples of several quantities, from sums that go along.

    What sums lose when they are rounded stays in them, as it does upstream.
    """

    # How many are kept, and those, the newest last; and their sums.
    window: int
    samples: tuple[tuple[float, ...], ...] = ()
    sums: tuple[float, ...] = ()

    def add(self, *values: float) -> Self:
        """Return the mean with one more sample of each quantity."""
        zeros = (0.0,) * len(values)
        is_full = len(self.samples) >= self.window
        gone = self.samples[0] if is_full else zeros
        sums = tuple(
            total - old + new
            for total, old, new in zip(self.sums or zeros, gone, values, strict=True)
        )
        samples = (*self.samples, values)[-self.window :]
        return self._replace(samples=samples, sums=sums)

    def clear(self) -> Self:
        """Return a mean of nothing."""
        return self._replace(samples=(), sums=())

    def means(self, number: int) -> tuple[float, ...]:
        """Return the mean of each quantity; 0 if there is no sample."""
        if not self.samples:
            return (0.0,) * number
        return tuple(total / len(self.samples) for total in self.sums)


# A turn in one step below which an arc is computed as a line [rad].
_SMALL_TURN = 1e-6


def integrate_midpoint(pose: PlanarPose, v: float, w: float, dt: float) -> PlanarPose:
    """Return where a base stands after a step; with half its turn if that is small."""
    if abs(w * dt) >= _SMALL_TURN:
        return integrate_arc(pose, v, w, dt)
    middle = pose.heading + 0.5 * w * dt
    return PlanarPose(
        pose.x + v * dt * math.cos(middle),
        pose.y + v * dt * math.sin(middle),
        pose.heading + w * dt,
    )


def integrate_planar(
    pose: PlanarPose, velocity: tuple[float, float, float], dt: float
) -> PlanarPose:
    """Return where a base stands after a step, sideways too, as `integrate_midpoint`.

    Its point goes along the arc of a base that looks where this one goes.
    """
    vx, vy, w = velocity
    ahead = pose._replace(heading=pose.heading + math.atan2(vy, vx))
    moved = integrate_midpoint(ahead, math.hypot(vx, vy), w, dt)
    return moved._replace(heading=pose.heading + w * dt)


def integrate_arc(pose: PlanarPose, v: float, w: float, dt: float) -> PlanarPose:
    """Return where a base stands after it went along an arc."""
    heading = pose.heading + w * dt
    radius = v / w
    return PlanarPose(
        pose.x + radius * (math.sin(heading) - math.sin(pose.heading)),
        pose.y - radius * (math.cos(heading) - math.cos(pose.heading)),
        heading,
    )


# Periods [s] and changes of heading [rad] below count as none.
_TINY = 1e-6


class WheelOdometryState(NamedTuple):
    """Pose and velocity of a base, from its wheels."""

    mean: RollingMean
    pose: PlanarPose = PlanarPose()

    # Forwards [m/s] and of turning [rad/s], as it is published; of bases that go
    # sideways between them to the left [m/s].
    velocity: tuple[float, ...] = (0.0, 0.0)

    # Last positions of the wheels [rad], the left one first.
    positions: tuple[float, ...] = (0.0, 0.0)


class DiffDriveMotion(NamedTuple):
    """Motion of a base after a tick."""

    # The last two velocities that the limits let through, the newest first, forwards
    # [m/s] and of turning [rad/s].
    limited: tuple[tuple[float, ...], tuple[float, ...]]
    odometry: WheelOdometryState

    @staticmethod
    def size(num_samples: int) -> int:
        """Return the length of `numbers` with so many samples of the mean."""
        return 14 + 2 * num_samples

    def numbers(self, size: int) -> list[float]:
        """Return all that is in it as so many numbers, zeros at the end."""
        mean, *vectors = self.odometry
        count = len(mean.samples)
        sums = mean.sums or (0.0, 0.0)
        numbers = itertools.chain(*self.limited, *vectors, sums, *mean.samples)
        return [float(count), *numbers, *[0.0] * (size - self.size(count))]

    @classmethod
    def from_numbers(cls, numbers: Sequence[float], window: int) -> Self:
        """Return it again; `window` is that of the mean."""
        count, v0, w0, v1, w1, x, y, heading, *more = numbers
        k = int(count)
        pairs = zip(more[0::2], more[1::2], strict=True)
        velocity, positions, sums, *samples = itertools.islice(pairs, 3 + k)
        mean = RollingMean(window, tuple(samples), sums if k else ())
        pose = PlanarPose(x, y, heading)
        odometry = WheelOdometryState(mean, pose, velocity, positions)
        return cls(((v0, w0), (v1, w1)), odometry)


@dataclass(frozen=True)
class DiffDriveKinematics:
    """Measures of a base; left and right wheels may differ."""

    # Distance of the wheels [m].
    separation: float

    # [m].
    left_radius: float
    right_radius: float

    def wheels(self, v: float, w: float) -> tuple[float, float]:
        """Return the velocities of the left and the right wheel [rad/s]."""
        half = w * self.separation / 2.0
        return (v - half) / self.left_radius, (v + half) / self.right_radius

    def from_positions(
        self, state: WheelOdometryState, left: float, right: float, dt: float
    ) -> WheelOdometryState:
        """Return the odometry after the wheels have come to positions [rad]."""
        if abs(dt) < _TINY:
            return state
        old_left, old_right = state.positions
        state = state._replace(positions=(left, right))
        return self.from_velocities(
            state, (left - old_left) / dt, (right - old_right) / dt, dt
        )

    def from_velocities(
        self, state: WheelOdometryState, left: float, right: float, dt: float
    ) -> WheelOdometryState:
        """Return the odometry after the wheels have turned for a while [rad/s]."""
        if abs(dt) < _TINY:
            return state
        left, right = left * self.left_radius, right * self.right_radius
        v, w = (left + right) / 2.0, (right - left) / self.separation
        mean = state.mean.add(v, w)
        v_mean, w_mean = mean.means(2)
        pose = _integrate(state.pose, v, w, dt)
        return state._replace(mean=mean, pose=pose, velocity=(v_mean, w_mean))


def from_commands(
    state: WheelOdometryState, v: float, w: float, dt: float
) -> WheelOdometryState:
    """Return the odometry after a base has moved as commanded."""
    pose = state.pose
    if abs(dt) >= _TINY:
        pose = _integrate(pose, v, w, dt)
    return state._replace(pose=pose, velocity=(v, w))


def _integrate(pose: PlanarPose, v: float, w: float, dt: float) -> PlanarPose:
    if abs(w * dt) >= _TINY:
        return integrate_arc(pose, v, w, dt)
    return PlanarPose(
        pose.x + v * dt * math.cos(pose.heading),
        pose.y + v * dt * math.sin(pose.heading),
        pose.heading + w * dt,
    )


class MecanumWheels(NamedTuple):
    """A velocity of each wheel [rad/s], in the order in which they are claimed."""

    front_left: float
    front_right: float
    rear_right: float
    rear_left: float


class MecanumKinematics(NamedTuple):
    """Measures of a base, which take its velocity to its wheels and back."""

    # Radius of the wheels [m].
    radius: float

    # Distances of the wheels from their centre, along x plus along y [m].
    reach: float

    # Offset of the base frame against the wheels' centre.
    offset: PlanarPose = PlanarPose()

    def to_wheels(self, velocity: tuple[float, ...]) -> MecanumWheels:
        """Return how the wheels turn for a velocity of the base frame.

        With the velocity R(offset.heading) (vx, vy) + w (offset.y, -offset.x) of the
        wheels' centre, each wheel turns with (vx -+ vy -+ reach w) / radius.
        """
        w = velocity[2]
        vx, vy = rotate(velocity[0], velocity[1], self.offset.heading)
        vx, vy = vx + self.offset.y * w, vy - self.offset.x * w
        turn = self.reach * w
        return MecanumWheels(
            (vx - vy - turn) / self.radius,
            (vx + vy + turn) / self.radius,
            (vx - vy + turn) / self.radius,
            (vx + vy - turn) / self.radius,
        )

    def to_base(self, wheels: MecanumWheels) -> tuple[float, float, float]:
        """Return the velocity of the base frame that fits the wheels best."""
        front_left, front_right, rear_right, rear_left = wheels
        quarter = self.radius / 4.0
        vx = quarter * (front_left + rear_left + rear_right + front_right)
        vy = quarter * (-front_left + rear_left - rear_right + front_right)
        w = quarter / self.reach * (-front_left - rear_left + rear_right + front_right)
        back = -self.offset.heading
        vx, vy = rotate(vx, vy, back)
        x, y = rotate(-self.offset.x, -self.offset.y, back)
        return vx + y * w, vy - x * w, w


def rotate(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned to the left by an angle [rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


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
    """Commands of the wheels: velocities [rad/s] and angles [rad]."""

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
    """Return the wheels' commands, turned as `measured` or else as commanded."""
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
    """Estimated pose and velocity of a base; each method returns a new one."""

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
        """Take one step with the commanded velocity, taken as it is."""
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
