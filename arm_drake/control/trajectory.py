"""Trajectories sampled as ros2_controllers' joint_trajectory_controller does it.

The rules are those of its class ``Trajectory`` (``trajectory.hpp``, version 6.9.0),
surprises included: a segment whose ends both have accelerations, but not both
velocities, gives zeros; a segment whose end lacks positions completes the velocities
of its start with 0, also for what follows; a missing effort is 0.

Times are integer nanoseconds, n is the number of joints; units are [rad] for a revolute
joint and [m] for a prismatic one, then per second and so on.
"""

import dataclasses as dc
from bisect import bisect_right
from typing import Final, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from arm_drake.messages import NANOSECONDS, JointTrajectory, Message

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Interpolation = Literal["splines", "none"]

_FIELDS: Final = ("positions", "velocities", "accelerations", "effort")

# Polynomials in s = tau / D over a segment of length D, by what both of its ends have:
# row k times (q_0, v_0 D, a_0 D^2, q_1, v_1 D, a_1 D^2) is the coefficient of s^k.
_ZERO, _Q0, _V0 = [0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]
_CUBIC = [_Q0, _V0, [-3, -2, 0, 3, -1, 0], [2, 1, 0, -2, 1, 0], _ZERO, _ZERO]
_QUINTIC = [_Q0, _V0, [0, 0, 0.5, 0, 0, 0], [-10, -6, -1.5, 10, -4, 0.5]]
_QUINTIC += [[15, 8, 1.5, -15, 7, -1], [-6, -3, -0.5, 6, -3, 0.5]]
_LINEAR = [_Q0, [-1, 0, 0, 1, 0, 0], _ZERO, _ZERO, _ZERO, _ZERO]
# Indexed by has_velocities, has_accelerations; accelerations alone give zeros.
_POLYNOMIALS: Final = np.array([[_LINEAR, 6 * [_ZERO]], [_CUBIC, _QUINTIC]], float)


class StateBefore(NamedTuple):
    """Where a trajectory starts from; None is unknown, not all of it may be."""

    time_ns: int

    # Each of shape (n,).
    positions: Array | None
    velocities: Array | None = None
    accelerations: Array | None = None
    effort: Array | None = None


class Sample(NamedTuple):
    """A trajectory at one time; arrays are read-only, of shape (n,).

    None is what the trajectory doesn't say, possible with interpolation "none" only.
    """

    position: Array
    velocity: Array | None
    acceleration: Array | None
    effort: Array | None

    # Points around the time: (0, 0) before point 0, (i, i + 1) from point i on and
    # (last, number of points) from the last point on.
    segment_start: int
    segment_end: int


@dc.dataclass(frozen=True, eq=False)
class Trajectory(Message):
    """A trajectory with its start state, prepared for sampling by `from_message`."""

    # What the trajectory was made from.
    message: JointTrajectory

    # When the start state holds, the trajectory starts, and each point is due.
    before_ns: int
    start_ns: int
    times_ns: tuple[int, ...]

    # Before each point and at the end: coefficients, or what holds all the time.
    _segments: tuple[Array | Sample | None, ...]
    _exponents: Array

    @classmethod
    def from_message(
        cls,
        message: JointTrajectory,
        before: StateBefore,
        *,
        now_ns: int,
        interpolation: Interpolation = "splines",
        wraparound: Mask | None = None,
    ) -> Self:
        """Return the trajectory that leads from a state through a message's points.

        A start state without velocities or accelerations has zeros if the first
        point has some. Positions that points don't give are integrated ("splines": all
        along, "none": for the last point), from the start state's positions if point 0
        is due before that, where upstream has no defined behaviour.

        Args:
            message: Points in the controller's joint order, times increasing.
            before: Start state.
            now_ns: Time of the first sample: the start, if the stamp is 0.
            interpolation: "splines", or "none" to jump from point to point.
            wraparound: Which joints turn without end, shape (n,): their start
                position moves by full turns to be next to the first point.
        """
        points = message.points
        start_ns = message.header.stamp.to_nanoseconds() or now_ns
        times_ns = tuple(start_ns + p.time_from_start.to_nanoseconds() for p in points)
        q = before.positions
        if wraparound is not None and q is not None and points and points[0].positions:
            q = wrap_state_before(q, np.array(points[0].positions), wraparound)
            before = before._replace(positions=q)
        durations = np.diff([before.time_ns, *times_ns]).clip(min=0) / NANOSECONDS
        knots = _Knots.of(before, message)
        is_spline = interpolation == "splines"
        first = 0 if is_spline else max(len(points) - 1, 1)
        knots.deduce(range(first, len(points)), durations)
        knots.values.setflags(write=False)
        table = _coefficients(knots, durations)
        table.setflags(write=False)
        known = knots.at_end[0]
        splines = (c if known[i] else None for i, c in enumerate(table))
        segments = (
            splines if is_spline else (_hold(knots, i) for i in range(len(table)))
        )
        return cls(
            message=message,
            before_ns=before.time_ns,
            start_ns=start_ns,
            times_ns=times_ns,
            _segments=(*segments, _finish(knots)),
            _exponents=np.arange(table.shape[1], dtype=float),
        )

    def sample(self, time_ns: int, cursor: int = 0) -> Sample | None:
        """Return the trajectory at a time, or None where it isn't defined.

        That is without points, before the start state's time, and where positions
        can't be known.

        Args:
            time_ns: When to sample.
            cursor: Point from which on the segment is searched. If the time lies in an
                earlier segment, the one before point 0 excepted, the trajectory counts
                as finished. After a sample that is to advance the search, the cursor
                is `max(cursor, sample.segment_start)`.
        """
        if time_ns < self.before_ns:
            return None
        segment = bisect_right(self.times_ns, time_ns)
        if 0 < segment <= cursor:
            segment = len(self.times_ns)
        coefficients = self._segments[segment]
        if not isinstance(coefficients, np.ndarray):
            return coefficients

        start = segment - 1 if segment else 0
        tau = time_ns - (self.times_ns[start] if segment else self.before_ns)
        values = (tau / NANOSECONDS) ** self._exponents @ coefficients
        values.flags.writeable = False
        q, v, a, u = values.reshape(4, -1)
        return Sample(q, v, a, u, start, segment)


def shortest_angular_distance(start: Array, end: Array) -> Array:
    """Return the turn in (-pi, pi] that leads from one angle to another [rad]."""
    turn = np.fmod(end - start + np.pi, 2.0 * np.pi)
    return np.where(turn <= 0.0, turn + np.pi, turn - np.pi)


def wrap_state_before(current: Array, target: Array, wraparound: Mask) -> Array:
    """Return the current positions, moved by full turns to be next to a target.

    Args:
        current: Joint positions [rad], shape (n,).
        target: Positions to go to [rad], shape (n,).
        wraparound: Which joints turn without end, shape (n,); the others stay.
    """
    turn = shortest_angular_distance(current, target)
    half = np.abs(np.abs(turn) - np.pi) < 1e-9
    turn = np.where(half, np.copysign(turn, np.where(target > current, 1, -1)), turn)
    return np.where(wraparound, target - turn, current)


def fill_cubic_spline_velocities(times: Array, positions: Array) -> Array | None:
    """Return the velocities that make cubic segments twice differentiable.

    They are 0 at both ends. None if there is nothing to solve: fewer than two points,
    or times that don't increase.

    Args:
        times: When the points are due [s], shape (m,).
        positions: Positions at the points, shape (m, n).
    """
    h = np.diff(times)[:, None]
    if len(times) < 2 or not (h > 0.0).all():
        return None
    velocities = np.zeros_like(positions)
    slopes = np.diff(positions, axis=0) / h**2
    right = 3.0 * (slopes[1:] + slopes[:-1])
    diagonal = 2.0 * (1.0 / h[:-1] + 1.0 / h[1:])
    # The Thomas algorithm: eliminate downwards, substitute upwards.
    for i in range(1, len(diagonal)):
        factor = 1.0 / (h[i] * diagonal[i - 1])
        diagonal[i] -= factor / h[i]
        right[i] -= factor * right[i - 1]
    for i in reversed(range(len(diagonal))):
        velocities[i + 1] = (right[i] - velocities[i + 2] / h[i + 1]) / diagonal[i]
    return velocities


class _Knots(NamedTuple):
    """The start state (knot 0) and the m points after it, by field and knot.

    What a knot has depends on the segment: deducing the end of a segment completes
    its start, too late for the segment before.
    """

    # Shape (4, m + 1, n), 0 where missing.
    values: Array

    # Which fields there are at the start or end of a segment, shape (4, m + 1).
    at_start: Mask
    at_end: Mask

    @classmethod
    def of(cls, before: StateBefore, message: JointTrajectory) -> Self:
        points = message.points
        n = next(len(vector) for vector in before[1:] if vector is not None)
        values = np.zeros((4, len(points) + 1, n))
        given = np.zeros((4, len(points) + 1), dtype=bool)
        for knot, source in enumerate((before, *points)):
            for field, name in enumerate(_FIELDS):
                vector = getattr(source, name)
                if vector is not None and len(vector):
                    values[field, knot] = vector
                    given[field, knot] = True
        given[1:3, 0] |= given[1:3, 1:2].any(axis=1)
        return cls(values, given, given.copy())

    def deduce(self, segments: range, durations: Array) -> None:
        """Integrate the positions that are missing at the ends of segments.

        With v_0 and a_0 at the start, v_1 and a_1 at the end of a segment of length D:
        v_1 = v_0 + (a_0 + a_1) D / 2 if it is missing, q_1 = q_0 + (v_0 + v_1) D / 2.
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


def _coefficients(knots: _Knots, durations: Array) -> Array:
    """Return a polynomial in tau [s] per segment, shape (m, degree + 1, 4 n).

    The columns are positions, velocities, accelerations and efforts.
    """
    start, end = knots.values[:, :-1], knots.values[:, 1:]
    _, has_v, has_a, _ = (knots.at_start[:, :-1] & knots.at_end[:, 1:]).astype(int)
    d = durations[:, None]
    # A segment without length is never sampled; it only mustn't divide by 0.
    r = np.divide(1.0, d, out=np.zeros_like(d), where=d > 0.0)
    scale = np.tile(d ** np.arange(3.0), 2)
    ends = np.concatenate([start[:3], end[:3]]).swapaxes(0, 1) * scale[:, :, None]
    values = np.zeros((4, len(d), 7, ends.shape[2]))
    values[0, :, :6] = _POLYNOMIALS[has_v, has_a] @ ends
    values[0, :, :6] *= (r ** np.arange(6.0))[:, :, None]
    for i in (1, 2):
        values[i, :, :6] = values[i - 1, :, 1:] * np.arange(1.0, 7.0)[:, None]
    values[3, :, 0] = start[3]
    values[3, :, 1] = (end[3] - start[3]) * r
    size = 6 if (has_v & has_a).any() else 4 if has_v.any() else 2
    return np.concatenate(values, axis=2)[:, :size]


def _hold(knots: _Knots, segment: int) -> Sample | None:
    """Return what "none" gives in a segment: the start state first, then its end."""
    knot = segment + 1 if segment else 0
    fields = zip(knots.values[:, knot], knots.at_end[:, knot], strict=True)
    q, v, a, u = (value if given else None for value, given in fields)
    return None if q is None else Sample(q, v, a, u, max(segment - 1, 0), segment)


def _finish(knots: _Knots) -> Sample | None:
    """Return the last point, what it lacks being 0; None if there isn't one."""
    last = knots.values.shape[1] - 2
    if last < 0 or not knots.at_end[0, -1]:
        return None
    q, v, a, u = knots.values[:, -1]
    return Sample(q, v, a, u, last, last + 1)
