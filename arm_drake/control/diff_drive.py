"""Kinematics and odometry of a base with differential drive.

The rules are those of ros2_controllers, `diff_drive_controller` (version 6.9.0). A base
goes with v forwards [m/s] and w of turning [rad/s]; dt is the time of a step [s].
"""

import dataclasses as dc
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

from arm_drake.control.odometry import PlanarPose, RollingMean, integrate_arc

# Periods [s] and changes of heading [rad] below count as none.
_TINY = 1e-6


class DiffDriveOdometryState(NamedTuple):
    """Where a base stands and how it moves."""

    mean: RollingMean
    pose: PlanarPose = PlanarPose()

    # Forwards [m/s] and of turning [rad/s], as it is published.
    velocity: tuple[float, float] = (0.0, 0.0)

    # Last positions of the left and the right wheel [rad].
    positions: tuple[float, float] = (0.0, 0.0)


class DiffDriveMotion(NamedTuple):
    """How a base moves, as a tick leaves it."""

    # The last two velocities that the limits let through, the newest first, forwards
    # [m/s] and of turning [rad/s].
    limited: tuple[tuple[float, ...], tuple[float, ...]]
    odometry: DiffDriveOdometryState

    @staticmethod
    def size(num_samples: int) -> int:
        """Return how many `numbers` there are with so many samples of the mean."""
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
        odometry = DiffDriveOdometryState(mean, pose, velocity, positions)
        return cls(((v0, w0), (v1, w1)), odometry)


@dc.dataclass(frozen=True)
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
        self, state: DiffDriveOdometryState, left: float, right: float, dt: float
    ) -> DiffDriveOdometryState:
        """Return the odometry after the wheels have come to positions [rad]."""
        if abs(dt) < _TINY:
            return state
        old_left, old_right = state.positions
        state = state._replace(positions=(left, right))
        return self.from_velocities(
            state, (left - old_left) / dt, (right - old_right) / dt, dt
        )

    def from_velocities(
        self, state: DiffDriveOdometryState, left: float, right: float, dt: float
    ) -> DiffDriveOdometryState:
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
    state: DiffDriveOdometryState, v: float, w: float, dt: float
) -> DiffDriveOdometryState:
    """Return the odometry after a base has moved as it was told to."""
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
