"""Where a base stands that counts the turns of its wheels: shared pieces.

The rules are those of ros2_controllers (version 6.9.0). Each kind of base has its own
way from wheels to velocities; see `controllers/`.
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
    """Mean of the last samples of several quantities."""

    # How many are kept, and those, the newest last.
    window: int
    samples: tuple[tuple[float, ...], ...] = ()

    def add(self, *values: float) -> Self:
        """Return the mean with one more sample of each quantity."""
        samples = (*self.samples, values)
        return self._replace(samples=samples[-self.window :])

    def clear(self) -> Self:
        """Return a mean of nothing."""
        return self._replace(samples=())

    def means(self, number: int) -> tuple[float, ...]:
        """Return the mean of each quantity; 0 if there is no sample.

        Args:
            number: How many quantities there are.
        """
        if not self.samples:
            return (0.0,) * number
        count = len(self.samples)
        return tuple(sum(column) / count for column in zip(*self.samples, strict=True))


def integrate_arc(pose: PlanarPose, v: float, w: float, dt: float) -> PlanarPose:
    """Return where a base stands after it went along an arc.

    Args:
        pose: Where it stood.
        v: Velocity forwards [m/s].
        w: Velocity of turning [rad/s]; not so small that v / w says nothing.
        dt: How long [s].
    """
    heading = pose.heading + w * dt
    radius = v / w
    return PlanarPose(
        pose.x + radius * (math.sin(heading) - math.sin(pose.heading)),
        pose.y - radius * (math.cos(heading) - math.cos(pose.heading)),
        heading,
    )
