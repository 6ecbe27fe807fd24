"""Polynomials between the points of a trajectory, and what its points lack.

The rules are those of ros2_controllers' class ``Trajectory`` (``trajectory.hpp``,
version 6.9.0), surprises included: a segment whose ends both have accelerations, but
not both velocities, gives zeros; a segment whose end lacks positions completes the
velocities of its start with 0, and who comes back to the segment before it finds them
there; a missing effort is 0.

n is the number of joints; units are [rad] for a revolute joint and [m] for a prismatic
one, then per second and so on.
"""

from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.messages import JointTrajectory

Mask = NDArray[np.bool_]

FIELDS: Final = ("positions", "velocities", "accelerations", "effort")

# Polynomials in s = tau / D over a segment of length D, by what both of its ends have:
# row k times (q_0, v_0 D, a_0 D^2, q_1, v_1 D, a_1 D^2) is the coefficient of s^k.
_ZERO, _Q0, _V0 = [0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]
_CUBIC = [_Q0, _V0, [-3, -2, 0, 3, -1, 0], [2, 1, 0, -2, 1, 0], _ZERO, _ZERO]
_QUINTIC = [_Q0, _V0, [0, 0, 0.5, 0, 0, 0], [-10, -6, -1.5, 10, -4, 0.5]]
_QUINTIC += [[15, 8, 1.5, -15, 7, -1], [-6, -3, -0.5, 6, -3, 0.5]]
_LINEAR = [_Q0, [-1, 0, 0, 1, 0, 0], _ZERO, _ZERO, _ZERO, _ZERO]
# Indexed by has_velocities, has_accelerations; accelerations alone give zeros.
_POLYNOMIALS: Final = np.array([[_LINEAR, 6 * [_ZERO]], [_CUBIC, _QUINTIC]], float)

# Which of the six numbers each of them uses.
_IS_USED: Final = (_POLYNOMIALS != 0.0).any(axis=2)

# How many coefficients each of them has.
_SIZES: Final = ((2, 1), (4, 6))


class StateBefore(NamedTuple):
    """Where a trajectory starts from; None is unknown, not all of it may be."""

    time_ns: int

    # Each of shape (n,).
    positions: Array | None
    velocities: Array | None = None
    accelerations: Array | None = None
    effort: Array | None = None


class Polynomial(NamedTuple):
    """A segment as polynomials in the time since its start [s]; rows by power."""

    # Coefficients of the positions, shape (degree + 1, n).
    positions: Array

    # Of velocities, accelerations and efforts, side by side: (degree + 1, 3 n).
    others: Array


class Knots(NamedTuple):
    """The start state (knot 0) and the m points after it, by field and knot.

    What a knot has depends on the segment: deducing the end of a segment completes
    its start. The segment before has been sampled until then, mostly: see `completed`.
    """

    # Shape (4, m + 1, n), 0 where missing; fields in the order of `FIELDS`.
    values: Array

    # Which fields there are at the start or end of a segment, shape (4, m + 1).
    at_start: Mask
    at_end: Mask

    @classmethod
    def of(cls, before: StateBefore, message: JointTrajectory) -> Self:
        """Return the knots that are given.

        A start state without velocities or accelerations has zeros if the first point
        has some.

        Args:
            before: Start state.
            message: Points in the controller's joint order.
        """
        points = message.points
        n = next(len(vector) for vector in before[1:] if vector is not None)
        values = np.zeros((4, len(points) + 1, n))
        given = np.zeros((4, len(points) + 1), dtype=bool)
        for knot, source in enumerate((before, *points)):
            for field, name in enumerate(FIELDS):
                vector = getattr(source, name)
                if vector is not None and len(vector):
                    values[field, knot] = vector
                    given[field, knot] = True
        given[1:3, 0] |= given[1:3, 1:2].any(axis=1)
        return cls(values, given, given.copy())

    def deduce(self, segments: range, durations: Array) -> None:
        """Integrate, in place, the positions that are missing at the ends of segments.

        With v_0 and a_0 at the start, v_1 and a_1 at the end of a segment of length D:
        v_1 = v_0 + (a_0 + a_1) D / 2 if it is missing, q_1 = q_0 + (v_0 + v_1) D / 2.

        Args:
            segments: Which segments; segment i ends in knot i + 1.
            durations: Length of all segments [s], shape (m,).
        """
        q, v, a, _ = self.values
        for i in segments:
            j = i + 1
            if self.at_end[0, j] or not self.at_end[0, i]:
                continue
            if not self.at_end[1, j]:
                v[j] = v[i] + 0.5 * (a[i] + a[j]) * durations[i]
                self.at_start[2, i] = True
            q[j] = q[i] + 0.5 * (v[i] + v[j]) * durations[i]
            self.at_start[1, i] = True
            self.at_end[:2, j] = self.at_start[:2, j] = True

    def completed(self) -> Self | None:
        """Return the knots as who comes back to a segment from a later one finds them.

        None if there is no difference.
        """
        if (self.at_start[1:3, :-1] == self.at_end[1:3, :-1]).all():
            return None
        return self._replace(at_end=self.at_start | self.at_end)

    def fields(self, knot: int) -> tuple[Array | None, ...]:
        """Return positions to effort of a knot, each of shape (n,); None if missing."""
        given = zip(self.values[:, knot], self.at_end[:, knot], strict=True)
        return tuple(vector if is_given else None for vector, is_given in given)


def make_polynomials(knots: Knots, durations: Array) -> list[Polynomial]:
    """Return the polynomial of every segment.

    Args:
        knots: Start state and points, m of them.
        durations: Length of the segments [s], shape (m,).
    """
    start, end = knots.values[:, :-1], knots.values[:, 1:]
    _, has_v, has_a, _ = (knots.at_start[:, :-1] & knots.at_end[:, 1:]).astype(int)
    d = durations[:, None]
    # A segment without length is never sampled; it only mustn't divide by 0.
    r = np.divide(1.0, d, out=np.zeros_like(d), where=d > 0.0)
    scale = np.tile(d ** np.arange(3.0), 2)
    ends = np.concatenate([start[:3], end[:3]]).swapaxes(0, 1) * scale[:, :, None]
    # What isn't used may be NaN, as measured, and 0 times NaN is no 0.
    ends = np.where(_IS_USED[has_v, has_a][:, :, None], ends, 0.0)
    values = np.zeros((4, len(d), 7, ends.shape[2]))
    values[0, :, :6] = _POLYNOMIALS[has_v, has_a] @ ends
    values[0, :, :6] *= (r ** np.arange(6.0))[:, :, None]
    for i in (1, 2):
        values[i, :, :6] = values[i - 1, :, 1:] * np.arange(1.0, 7.0)[:, None]
    values[3, :, 0] = start[3]
    values[3, :, 1] = (end[3] - start[3]) * r
    positions, others = values[0], np.concatenate(values[1:], axis=2)
    has_effort = knots.at_end[3].any()
    polynomials = []
    for i, (v, a) in enumerate(zip(has_v, has_a, strict=True)):
        size = max(_SIZES[v][a], 2 if has_effort else 1)
        rows = positions[i, :size].copy(), others[i, :size].copy()
        for table in rows:
            table.setflags(write=False)
        polynomials.append(Polynomial(*rows))
    return polynomials
