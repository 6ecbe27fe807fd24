"""Trajectories sampled as ros2_controllers' joint_trajectory_controller does it.

The rules are those of its class ``Trajectory`` (``trajectory.hpp``, version 6.9.0);
those of single segments are in `trajectory_segments`.

Times are integer nanoseconds, n is the number of joints; units are [rad] for a revolute
joint and [m] for a prismatic one, then per second and so on.
"""

import dataclasses as dc
from bisect import bisect_right
from collections.abc import Mapping
from typing import Literal, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.trajectory_segments import (
    Knots,
    Mask,
    Polynomial,
    StateBefore,
    make_polynomials,
)
from arm_drake.messages import (
    NANOSECONDS,
    Duration,
    JointTrajectory,
    JointTrajectoryPoint,
    Message,
)

__all__ = [
    "Array",
    "Interpolation",
    "Mask",
    "Sample",
    "StateBefore",
    "Trajectory",
    "shortest_angular_distance",
    "wrap_state_before",
]

Interpolation = Literal["splines", "none"]

# Velocities, accelerations and efforts; None where a trajectory doesn't say.
_Others = tuple[Array | None, Array | None, Array | None]


class Sample:
    """A trajectory at one time; arrays are read-only, of shape (n,).

    What is not positions is computed when it is asked for; most of it never is.
    """

    __slots__ = ("_others", "_polynomial", "position", "segment_end", "segment_start")

    def __init__(
        self,
        position: Array,
        segment_start: int,
        segment_end: int,
        others: _Others | None,
        polynomial: tuple[Array, Array] | None = None,
    ) -> None:
        """Take what is known.

        Args:
            position: Positions, shape (n,).
            segment_start: Index of the point before the time.
            segment_end: Index of the point after it.
            others: Velocities, accelerations and efforts; None to compute them.
            polynomial: What to compute them from: the powers of the time, shape (k,),
                and coefficients, shape (k, 3 n).
        """
        self.position = position

        # Points around the time: (0, 0) before point 0, (i, i + 1) from point i on and
        # (last, number of points) from the last point on.
        self.segment_start = segment_start
        self.segment_end = segment_end
        self._others = others
        self._polynomial = polynomial

    @property
    def velocity(self) -> Array | None:
        """Velocities; None if not said, possible with interpolation "none" only."""
        return (self._others or self._compute())[0]

    @property
    def acceleration(self) -> Array | None:
        """Accelerations; None likewise."""
        return (self._others or self._compute())[1]

    @property
    def effort(self) -> Array | None:
        """Efforts; None likewise."""
        return (self._others or self._compute())[2]

    def _compute(self) -> _Others:
        assert self._polynomial is not None
        powers, coefficients = self._polynomial
        values = powers.dot(coefficients)
        values.setflags(write=False)
        velocity, acceleration, effort = values.reshape(3, -1)
        self._others = velocity, acceleration, effort
        return self._others

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


@dc.dataclass(frozen=True, eq=False)
class Trajectory(Message):
    """A trajectory with its start state, prepared for sampling by `from_message`."""

    # What the trajectory was made from.
    message: JointTrajectory

    # When the start state holds, the trajectory starts, and each point is due.
    before_ns: int
    start_ns: int
    times_ns: tuple[int, ...]

    # Start state and points.
    knots: Knots

    # Before each point and at the end: a polynomial, or what holds all the time.
    _segments: tuple[Polynomial | Sample | None, ...]

    # Segments that are others once a later one has been sampled, by index.
    _revisited: Mapping[int, Polynomial]

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
        knots = Knots.of(before, message)
        is_spline = interpolation == "splines"
        first = 0 if is_spline else max(len(points) - 1, 1)
        knots.deduce(range(first, len(points)), durations)
        knots.values.setflags(write=False)
        segments: list[Polynomial | Sample | None] = []
        revisited = {}
        if is_spline:
            known = knots.at_end[0]
            polynomials = make_polynomials(knots, durations)
            segments += (p if known[i] else None for i, p in enumerate(polynomials))
            completed = knots.completed()
            if completed is not None:
                polynomials = make_polynomials(completed, durations)
                revisited = {i: p for i, p in enumerate(polynomials) if known[i]}
        else:
            segments += (_hold(knots, i) for i in range(len(points)))
        return cls(
            message=message,
            before_ns=before.time_ns,
            start_ns=start_ns,
            times_ns=times_ns,
            knots=knots,
            _segments=(*segments, _finish(knots)),
            _revisited=revisited,
        )

    def sample(self, time_ns: int, cursor: int = 0, seen: int = -1) -> Sample | None:
        """Return the trajectory at a time, or None where it isn't defined.

        That is without points, before the start state's time, and where positions
        can't be known.

        Args:
            time_ns: When to sample.
            cursor: Point from which on the segment is searched. If the time lies in an
                earlier segment, the one before point 0 excepted, the trajectory counts
                as finished. After a sample that is to advance the search, the cursor
                is `max(cursor, sample.segment_start)`.
            seen: Greatest `segment_end` of the samples so far. A segment that lacks
                positions at its end completes the point before it, which the segment
                before that is different with.
        """
        if time_ns < self.before_ns:
            return None
        times_ns = self.times_ns
        segment = bisect_right(times_ns, time_ns)
        if 0 < segment <= cursor:
            segment = len(times_ns)
        piece = self._segments[segment]
        if not isinstance(piece, Polynomial):
            return piece
        if seen > segment and self._revisited:
            piece = self._revisited[segment]

        start = segment - 1 if segment else 0
        tau = (time_ns - (times_ns[start] if segment else self.before_ns)) / NANOSECONDS
        positions, others = piece
        size = len(positions)
        if size == 2:
            powers = np.array((1.0, tau))
        elif size == 4:
            square = tau * tau
            powers = np.array((1.0, tau, square, square * tau))
        else:
            powers = tau ** np.arange(size)
        position = powers.dot(positions)
        position.setflags(write=False)
        return Sample(position, start, segment, None, (powers, others))

    def point(
        self, index: int, *, is_deduced: bool = True, is_left: bool = False
    ) -> JointTrajectoryPoint:
        """Return a point, with the positions and velocities that were deduced.

        Args:
            index: Which point.
            is_deduced: Whether the segment before it has been sampled; else the point
                is as it was given.
            is_left: Whether the segment after it has been sampled, too, which may have
                completed its velocities.
        """
        given = self.message.points[index]
        completed = self.knots.completed() if is_left else None
        if completed is None and (not is_deduced or given.positions):
            return given
        vectors = (completed or self.knots).fields(index + 1)
        q, v, a, u = (() if x is None else tuple(x.tolist()) for x in vectors)
        return JointTrajectoryPoint(q, v, a, u, given.time_from_start)

    def last_point(self) -> JointTrajectoryPoint:
        """Return the last point, due at once."""
        last = self.point(len(self.times_ns) - 1)
        return dc.replace(last, time_from_start=Duration())


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


def _hold(knots: Knots, segment: int) -> Sample | None:
    """Return what "none" gives in a segment: the start state first, then its end."""
    q, v, a, u = knots.fields(segment + 1 if segment else 0)
    return None if q is None else Sample(q, max(segment - 1, 0), segment, (v, a, u))


def _finish(knots: Knots) -> Sample | None:
    """Return the last point, what it lacks being 0; None if there isn't one."""
    last = knots.values.shape[1] - 2
    if last < 0 or not knots.at_end[0, -1]:
        return None
    q, v, a, u = knots.values[:, -1]
    return Sample(q, last, last + 1, (v, a, u))
