"""Trajectories sampled, completed and replaced as joint_trajectory_controller does it.

The rules are those of ros2_controllers' class ``Trajectory`` (``trajectory.hpp``,
version 6.9.0), surprises included: a segment whose ends both have accelerations, but
not both velocities, gives zeros; a segment whose end lacks positions completes the
velocities of its start with 0, and who comes back to the segment before it finds them
there; a missing effort is 0.

What takes the place of a trajectory that is being followed is that of its controller:
the order of joints and what a message leaves out (`sort_to_local_joint_order`,
`fill_partial_goal`), and blending (its parameter `allow_trajectory_replacement`).

Times are integer nanoseconds, n is the number of joints; units are [rad] for a revolute
joint and [m] for a prismatic one, then per second and so on.
"""

import dataclasses as dc
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Literal, NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array, Mask
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    Duration,
    JointTrajectory,
    JointTrajectoryPoint,
    Message,
)

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
    """Start state of a trajectory; None is unknown, not all of it may be."""

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
        """Return the knots of a start state and a message.

        A start state without velocities or accelerations has zeros if the first point
        has some.
        """
        points = message.points
        n = next(len(vector) for vector in before[1:] if vector is not None)
        values = np.zeros((4, len(points) + 1, n))
        is_set = np.zeros((4, len(points) + 1), dtype=bool)
        for knot, source in enumerate((before, *points)):
            for field, name in enumerate(FIELDS):
                vector = getattr(source, name)
                if vector is not None and len(vector):
                    values[field, knot] = vector
                    is_set[field, knot] = True
        is_set[1:3, 0] |= is_set[1:3, 1:2].any(axis=1)
        return cls(values, is_set, is_set.copy())

    def deduce(self, segments: range, durations: Array) -> None:
        """Integrate, in place, the positions that are missing at the ends of segments.

        With v_0 and a_0 at the start, v_1 and a_1 at the end of a segment of length D:
        v_1 = v_0 + (a_0 + a_1) D / 2 if it is missing, q_1 = q_0 + (v_0 + v_1) D / 2.

        `durations` [s], shape (m,).
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
        entries = zip(self.values[:, knot], self.at_end[:, knot], strict=True)
        return tuple(vector if is_present else None for vector, is_present in entries)


# Numbers near the largest ones make infinite polynomials, which is no news of ours.
@np.errstate(over="ignore", invalid="ignore")
def make_polynomials(knots: Knots, durations: Array) -> list[Polynomial]:
    """Return the polynomial of every segment.

    `durations` [s], shape (m,).
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
        """Take positions, shape (n,), and the indices of the points around the time.

        What else there is is computed where it is None, from a polynomial: the powers
        of the time, shape (k,), and coefficients, shape (k, 3 n).
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


@dataclass(frozen=True, eq=False)
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

        Points are in the controller's joint order, their times increase. `now_ns` is
        the time of the first sample: the start, if the stamp is 0. The start positions
        of joints with `wraparound`, shape (n,), move by full turns to be next to the
        first point.
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

    @property
    def changes(self) -> bool:
        """Whether segments are others once a later one has been sampled."""
        return bool(self._revisited)

    def ends_with(self, sample: Sample | None) -> bool:
        """Return whether a sample is one of the end."""
        return sample is not None and sample.segment_end == len(self.times_ns)

    def sample(self, time_ns: int, cursor: int = 0, seen: int = -1) -> Sample | None:
        """Return the trajectory at a time, or None where it isn't defined.

        That is without points, before the start state's time, and where positions
        can't be known.

        The segment is searched from the point `cursor` on. If the time lies in an
        earlier one, that before point 0 excepted, the trajectory counts as finished.
        After a sample that is to advance the search, the cursor is `max(cursor,
        sample.segment_start)`. `seen` is the greatest `segment_end` so far: a segment
        that lacks positions at its end completes the point before it, which the segment
        before that is different with.
        """
        if time_ns < self.before_ns:
            return None
        segment, tau = self._find(time_ns, cursor)
        piece = self._segments[segment]
        if not isinstance(piece, Polynomial):
            return piece
        if seen > segment and self._revisited:
            piece = self._revisited[segment]
        positions, others = piece
        powers = _powers(tau, len(positions))
        position = powers.dot(positions)
        position.setflags(write=False)
        start = segment - 1 if segment else 0
        return Sample(position, start, segment, None, (powers, others))

    def since_end(self, time_ns: int) -> float:
        """Return how long the last point is past [s].

        Upstream subtracts seconds, not nanoseconds, and so decides ties by their
        rounding.
        """
        return time_ns / NANOSECONDS - self.times_ns[-1] / NANOSECONDS

    def _find(self, time_ns: int, cursor: int) -> tuple[int, float]:
        """Return the segment that a time is in, and the time since its start [s]."""
        times_ns = self.times_ns
        segment = bisect_right(times_ns, time_ns)
        if 0 < segment <= cursor:
            segment = len(times_ns)
        begin_ns = times_ns[segment - 1] if segment else self.before_ns
        return segment, (time_ns - begin_ns) / NANOSECONDS

    def point(
        self, index: int, *, is_deduced: bool = True, is_left: bool = False
    ) -> JointTrajectoryPoint:
        """Return a point, with the positions and velocities that were deduced.

        It is as it was given unless the segment before it has been sampled. That after
        it may have completed its velocities, if it `is_left`.
        """
        waypoint = self.message.points[index]
        completed = self.knots.completed() if is_left else None
        if completed is None and (not is_deduced or waypoint.positions):
            return waypoint
        vectors = (completed or self.knots).fields(index + 1)
        q, v, a, u = (() if x is None else tuple(x.tolist()) for x in vectors)
        return JointTrajectoryPoint(q, v, a, u, waypoint.time_from_start)

    def last_point(self) -> JointTrajectoryPoint:
        """Return the last point, due at once."""
        last = self.point(len(self.times_ns) - 1)
        return dc.replace(last, time_from_start=Duration())


class Positions:
    """The positions of a trajectory, time after time, to the bit those of its samples.

    They are sought from a cursor on, as `Trajectory.sample` does, where it is defined.
    """

    __slots__ = ("_cursor", "_stretch", "_trajectory")

    def __init__(self, trajectory: Trajectory, cursor: int) -> None:
        """Create it."""
        self._trajectory, self._cursor = trajectory, cursor
        # Around the last time: from when to when [ns], the coefficients of positions,
        # rows by power, or what holds all along. It is replaced as a whole.
        self._stretch: tuple[int, float, Array | None, list[float]] = 1, 0, None, []

    def at(self, time_ns: int) -> list[float]:
        """Return the positions at a time, n of them."""
        begin_ns, end_ns, rows, constant = self._stretch
        if not begin_ns <= time_ns < end_ns:
            self._stretch = self._find(time_ns)
            begin_ns, _, rows, constant = self._stretch
        if rows is None:
            return constant
        tau = (time_ns - begin_ns) / NANOSECONDS
        found: list[float] = _powers(tau, len(rows)).dot(rows).tolist()
        return found

    def at_all(self, times_ns: Sequence[int]) -> Array:
        """Return the positions at increasing times, shape (T, n), to the bit those."""
        found, start = [], 0
        while start < len(times_ns):
            first = self.at(times_ns[start])
            begin_ns, end_ns, rows, _ = self._stretch
            end = bisect_left(times_ns, end_ns, start)
            if rows is None:
                found.append(np.tile(first, (end - start, 1)))
            else:
                tau = (np.array(times_ns[start:end]) - begin_ns) / NANOSECONDS
                powers = np.array([_powers(time, len(rows)) for time in tau.tolist()])
                found.append((powers[:, None] @ rows)[:, 0])
            start = end
        return np.concatenate(found)

    def _find(self, time_ns: int) -> tuple[int, float, Array | None, list[float]]:
        trajectory, times_ns = self._trajectory, self._trajectory.times_ns
        following = bisect_right(times_ns, time_ns)
        begin_ns = times_ns[following - 1] if following else trajectory.before_ns
        end_ns = times_ns[following] if following < len(times_ns) else math.inf
        segment, _ = trajectory._find(time_ns, self._cursor)
        piece = trajectory._segments[segment]
        assert piece is not None
        if isinstance(piece, Polynomial):
            return begin_ns, end_ns, piece.positions, []
        return begin_ns, end_ns, None, piece.position.tolist()


def _powers(tau: float, size: int) -> Array:
    """Return the powers of a time below one, shape (size,)."""
    if size == 2:
        return np.array((1.0, tau))
    if size == 4:
        square = tau * tau
        return np.array((1.0, tau, square, square * tau))
    return np.asarray(tau ** np.arange(size), dtype=float)


def shortest_angular_distance(start: Array, end: Array) -> Array:
    """Return the turn in (-pi, pi] that leads from one angle to another [rad]."""
    turn = np.fmod(end - start + np.pi, 2.0 * np.pi)
    return np.where(turn <= 0.0, turn + np.pi, turn - np.pi)


def wrap_state_before(current: Array, target: Array, wraparound: Mask) -> Array:
    """Return the current positions, moved by full turns to be next to a target.

    `current`, `target` [rad], shape (n,); `wraparound` shape (n,).
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


# Returns the value of a joint, by its index, that a vector doesn't have; for each of
# positions, velocities, accelerations and efforts.
Missing = tuple[Callable[[int], float], ...]


class Replacement(NamedTuple):
    """A blended trajectory."""

    message: JointTrajectory

    # How many of its points are from before the new message.
    num_prefix: int


def in_joint_order(
    message: JointTrajectory, joints: tuple[str, ...], missing: Array
) -> JointTrajectory:
    """Return a trajectory of all joints in the controller's order.

    `missing` shape (n,).
    """
    if message.joint_names == joints:
        return message
    at = _places(message, joints)
    fill: Missing = (lambda k: float(missing[k]), _zero, _zero, _zero)
    points = tuple(_ordered(point, at, fill) for point in message.points)
    return JointTrajectory(message.header, joints, points)


def blend(
    message: JointTrajectory,
    old: Trajectory,
    joints: tuple[str, ...],
    missing: Array,
    *,
    cursor_ns: int,
    delay_ns: int,
    cursor: int,
    seen: int,
) -> Replacement | None:
    """Return a trajectory that goes on with the old one until the new one takes over.

    Its times count from the present place on the old trajectory. Before the handoff
    are the old points, and one at the handoff itself with all that the old trajectory
    has there. Joints that the new trajectory leaves out follow the old one to its end,
    and the others stay at the end of the new one meanwhile.

    None if that isn't possible: joints are left out, and the last point has no
    positions.

    `message` is of some of the controller's n `joints`, in any order; `missing`, shape
    (n,), has positions of what the old trajectory has none of either. The old one is
    followed at `cursor_ns`, searched from its point `cursor` on, and `seen` is the
    greatest `segment_end` of its samples so far; `delay_ns` later the new one takes
    over.
    """
    points, is_partial = message.points, len(message.joint_names) < len(joints)
    if is_partial and not points[-1].positions:
        return None
    handoff_ns = cursor_ns + delay_ns
    at = _places(message, joints)
    bridge = old.sample(handoff_ns, cursor, seen)
    prefix = _points_before(old, bridge, cursor_ns, handoff_ns, seen)
    first_ns = handoff_ns + points[0].time_from_start.to_nanoseconds()
    if bridge is not None and handoff_ns < first_ns:
        prefix.append(_at(_point_of(bridge), delay_ns))

    new = []
    for point in points:
        time_ns = handoff_ns + point.time_from_start.to_nanoseconds()
        old_sample = old.sample(time_ns, cursor, seen) if is_partial else None
        ordered = _ordered(point, at, _follow_old(old_sample, missing))
        new.append(_at(ordered, time_ns - cursor_ns))

    suffix = []
    if is_partial:
        end_ns = handoff_ns + points[-1].time_from_start.to_nanoseconds()
        stays = [i is not None for i in at]
        suffix = [
            _at(_frozen(old.point(i), stays, new[-1]), time_ns - cursor_ns)
            for i, time_ns in enumerate(old.times_ns)
            if time_ns > end_ns
        ]
    blended = JointTrajectory(joint_names=joints, points=(*prefix, *new, *suffix))
    return Replacement(blended, len(prefix))


def _at(point: JointTrajectoryPoint, time_ns: int) -> JointTrajectoryPoint:
    """Return a point at another time [ns]."""
    time = Duration.from_nanoseconds(time_ns)
    return JointTrajectoryPoint(
        point.positions, point.velocities, point.accelerations, point.effort, time
    )


def _points_before(
    old: Trajectory,
    bridge: Sample | None,
    cursor_ns: int,
    handoff_ns: int,
    seen: int,
) -> list[JointTrajectoryPoint]:
    """Return the points of an old trajectory up to the handoff."""
    handoff = -1 if bridge is None else bridge.segment_end
    # Points whose segment was sampled have got what they lacked.
    return [
        _at(
            old.point(i, is_deduced=i <= seen, is_left=i < seen or i + 1 == handoff),
            time_ns - cursor_ns,
        )
        for i, time_ns in enumerate(old.times_ns)
        if cursor_ns < time_ns < handoff_ns
    ]


def _places(message: JointTrajectory, joints: tuple[str, ...]) -> list[int | None]:
    """Return where each joint stands in a message; None if it doesn't."""
    at = {name: i for i, name in enumerate(message.joint_names)}
    return [at.get(joint) for joint in joints]


def _ordered(
    point: JointTrajectoryPoint, at: list[int | None], missing: Missing
) -> JointTrajectoryPoint:
    """Return a point of all joints; a vector that is empty stays so."""
    vectors = (point.positions, point.velocities, point.accelerations, point.effort)
    ordered = (
        tuple(fill(k) if i is None else vector[i] for k, i in enumerate(at))
        if vector
        else ()
        for vector, fill in zip(vectors, missing, strict=True)
    )
    q, v, a, u = ordered
    return JointTrajectoryPoint(q, v, a, u, point.time_from_start)


def _follow_old(old_sample: Sample | None, missing: Array) -> Missing:
    """Return the values of joints that follow the old trajectory."""
    if old_sample is None:
        return (lambda k: float(missing[k]), _zero, _zero, _zero)
    vectors = (old_sample.position, old_sample.velocity, old_sample.acceleration)

    def value_of(vector: Array | None) -> Callable[[int], float]:
        return _zero if vector is None else lambda k: float(vector[k])

    return (*map(value_of, vectors), _zero)


def _point_of(sample: Sample) -> JointTrajectoryPoint:
    vectors = (sample.position, sample.velocity, sample.acceleration, sample.effort)
    q, v, a, u = (() if x is None else tuple(x.tolist()) for x in vectors)
    return JointTrajectoryPoint(q, v, a, u)


def _frozen(
    old: JointTrajectoryPoint, stays: list[bool], end: JointTrajectoryPoint
) -> JointTrajectoryPoint:
    """Return an old point where some joints stay at the end of the new trajectory."""

    def mixed(vector: tuple[float, ...], still: tuple[float, ...]) -> tuple[float, ...]:
        if not vector:
            return ()
        choices = zip(vector, stays, still, strict=True)
        return tuple(rest if stay else value for value, stay, rest in choices)

    zeros = (0.0,) * len(stays)
    return JointTrajectoryPoint(
        mixed(old.positions, end.positions),
        mixed(old.velocities, zeros),
        mixed(old.accelerations, zeros),
        mixed(old.effort, zeros),
    )


def _zero(joint: int) -> float:
    return 0.0


def scaled(duration_ns: int, factor: float) -> int:
    """Return a duration [ns] times a factor, cut to whole nanoseconds.

    The product is exact before it is cut, for upstream multiplies in more digits than
    a float has: 10 ms times 0.3 is 2 999 999 ns.
    """
    if factor == 1.0:
        return duration_ns
    numerator, denominator = factor.as_integer_ratio()
    product = duration_ns * numerator
    return product // denominator if product >= 0 else -(-product // denominator)


def positions_or(present: Array | None, measured: Array) -> Array:
    """Return commanded positions, and measured ones instead of NaN, (n,)."""
    if present is None:
        return measured
    pairs = zip(present.tolist(), measured.tolist(), strict=True)
    merged = measured.copy()
    merged[:] = [q if math.isnan(command) else command for command, q in pairs]
    return merged
