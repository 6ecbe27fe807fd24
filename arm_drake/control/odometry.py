"""Planar poses, arcs and rolling means: shared pieces of odometry.

The rules are those of ros2_controllers (version 6.9.0). Each kind of base has its own
way from wheels to velocities; see `controllers/bases`. A base goes with v forwards
[m/s] and w of turning [rad/s] for a time dt [s].
"""

import math
from typing import NamedTuple, Self


class PlanarPose(NamedTuple):
    """Where a base stands in the frame of its odometry."""

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


def integrate_arc(pose: PlanarPose, v: float, w: float, dt: float) -> PlanarPose:
    """Return where a base stands after it went along an arc."""
    heading = pose.heading + w * dt
    radius = v / w
    return PlanarPose(
        pose.x + radius * (math.sin(heading) - math.sin(pose.heading)),
        pose.y - radius * (math.cos(heading) - math.cos(pose.heading)),
        heading,
    )
