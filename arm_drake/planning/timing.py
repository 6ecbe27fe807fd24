"""Limits of joints' motions, and times along a path within them, by Drake's Toppra.

Limits are those of the `joint_limits.yaml` beside the SRDF, else of the description.

What Toppra finds has steps in its acceleration. Where joints have limits of jerk, the
motion is averaged over a window of time: its speeds and accelerations then are means of
what they were, so they keep their limits, and its jerk is the difference of two
accelerations by the window (Biagiotti, Melchiorri: FIR filters for online trajectory
planning with time- and frequency-domain specifications, 2012). It takes longer by the
window, and leaves the path by no more than acceleration times its square by 24. So less
acceleration than is allowed may be faster, and nearer to the path: a part s of it takes
about s^-1/2 of the time, and the window s times as long, which is shortest together for
s^3/2 = time / (2 window).

Toppra's efforts are those of inertia and weight. What damping and dry friction take is
added here: of a motion in r times the speed, joints ask for A r^2 + B r + G, where A is
of inertia, B of damping, and G of weight and friction.
"""

import itertools
import math
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody.optimization import Toppra, ToppraDiscretization
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from pydrake.trajectories import PiecewisePolynomial

from arm_drake.arrays import is_number
from arm_drake.description.joints import last_master
from arm_drake.description.robot import Robot
from arm_drake.planning.groups import (
    read_moveit_files,
    read_rows,
    report_ignored,
    report_invalid,
)
from arm_drake.plant.payloads import Payload
from arm_drake.plant.plant import drake_messages, make_reduced_plant, trial_plant

# Without a limit of its speed a joint has this one [rad/s] or [m/s]; without a limit
# of its acceleration it needs so long to its full speed [s].
_SPEED, _TIME_TO_SPEED = 1.0, 1.0

_LIMITS_FILE = "joint_limits.yaml"

# What of it counts: for all joints, and for one.
_SCALING = "default_velocity_scaling_factor", "default_acceleration_scaling_factor"
_JOINTS, _LIMITED = "joint_limits", ("velocity", "acceleration", "jerk")

# Time between points of a trajectory [s].
_PERIOD = 0.02

# The same where a motion is averaged [s].
_FINE = 1e-3

# Toppra exceeds limits between its grid points by some percent.
_MARGIN, _GRID, _FINER = 0.98, 100, 300

# Part of a joint's effort beside friction that damping takes at most while
# it moves steadily; the rest accelerates it. How much slower a motion becomes at most
# for its efforts to keep their limits.
_CRUISING, _SLOWEST = 0.9, 10.0

# Grid points aren't closer than this; what is no limit for Toppra.
_SMALLEST, _UNLIMITED = 1e-6, 1e6


class MotionLimits(NamedTuple):
    """Limits of a joint's motion."""

    # [rad/s] or [m/s].
    velocity: float

    # [rad/s^2] or [m/s^2].
    acceleration: float

    # [rad/s^3] or [m/s^3]; infinite without a limit.
    jerk: float = math.inf


class _Limits(NamedTuple):
    """Limits in a robot's `joint_limits.yaml` and description."""

    joints: dict[str, MotionLimits]

    # Parts of the joints' speed and acceleration that plans use unless told otherwise.
    scaling: tuple[float, float]


_limits: "weakref.WeakKeyDictionary[Robot, _Limits]" = weakref.WeakKeyDictionary()


def motion_limits(robot: Robot) -> dict[str, MotionLimits]:
    """Return how fast each movable joint may be.

    InputError if a `joint_limits.yaml` can't be read.
    """
    return dict(_find_limits(robot).joints)


def default_scaling(robot: Robot) -> tuple[float, float]:
    """Return the parts of the joints' speed and acceleration to use, by default.

    They are MoveIt's `default_velocity_scaling_factor` and the one of acceleration.
    InputError if a `joint_limits.yaml` can't be read.
    """
    return _find_limits(robot).scaling


def _find_limits(robot: Robot) -> _Limits:
    if robot not in _limits:
        _limits[robot] = _read_limits(robot)
    return _limits[robot]


def _read_limits(robot: Robot) -> _Limits:
    """Read what is said; of several files the last one that says it counts."""
    rows: dict[str, dict[str, float]] = {}
    scaling = dict.fromkeys(_SCALING, 1.0)
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    for path, content in read_moveit_files(robot, _LIMITS_FILE):
        for name, row in read_rows(robot, path, "joint", content.get(_JOINTS), joints):
            rows[name] = _read_row(robot, path, f"joint {name!r}", row)
        for name in [name for name in scaling if name in content]:
            value = content[name]
            if is_number(value) and 0.0 < value <= 1.0:
                scaling[name] = float(value)
                continue
            what = f"expected a number above 0, at most 1, got {value!r}"
            robot.report.add(
                "warning", "invalid", what, "it is 1", where=name, file=path
            )
        ignored = [key for key in content if key not in (_JOINTS, *_SCALING)]
        report_ignored(robot, path, "", ignored)
    limits = {}
    for joint in joints.values():
        row = rows.get(joint.name, {})
        velocity = row.get("velocity") or joint.limits.velocity or _SPEED
        acceleration = row.get("acceleration", velocity / _TIME_TO_SPEED)
        jerk = row.get("jerk", math.inf)
        limits[joint.name] = MotionLimits(velocity, acceleration, jerk)
    velocity_factor, acceleration_factor = (scaling[name] for name in _SCALING)
    return _Limits(limits, (velocity_factor, acceleration_factor))


def _read_row(
    robot: Robot, file: Path, where: str, row: Mapping[str, Any]
) -> dict[str, float]:
    """Return the limits of a joint's row; what can't be used is reported."""
    limits, keys = {}, set()
    for what in _LIMITED:
        flag, most = f"has_{what}_limits", f"max_{what}"
        keys |= {flag, most}
        # As in MoveIt a limit counts unless its flag says that there is none.
        is_set: Any = row.get(flag, most in row)
        value: Any = row.get(most)
        if not isinstance(is_set, bool):
            problem = f"{flag}: expected true or false, got {is_set!r}"
            report_invalid(robot, file, where, problem)
        elif is_set and is_number(value) and 0.0 < value < math.inf:
            limits[what] = float(value)
        elif is_set:
            problem = f"{most}: expected a number above 0, got {value!r}"
            report_invalid(robot, file, where, problem)
    # Another flag that isn't set says nothing.
    ignored = [key for key in row if key not in keys and row[key] is not False]
    report_ignored(robot, file, where, ignored)
    return limits


class Samples(NamedTuple):
    """A motion in time: [s], shape (k,); positions and derivatives, shape (k, n)."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


class Mover(NamedTuple):
    """Moving joints of a robot, and the payloads of its links."""

    robot: Robot
    joints: tuple[str, ...]

    # Where all joints are at first [rad] or [m].
    positions: Mapping[str, float]

    payloads: Mapping[str, Payload]

    @property
    def start(self) -> np.ndarray:
        """Start positions of the joints."""
        return np.array([self.positions[name] for name in self.joints])


def time_path(
    mover: Mover,
    path: np.ndarray,
    rounding: float,
    scaling: tuple[float, float],
    stretch: float = 1.0,
) -> tuple[Samples, bool] | None:
    """Return a motion along a path, shape (m, n), and if efforts keep their limits.

    Corners are rounded by parabolas that begin `rounding` before them. It is `stretch`
    times slower than it could be. None is returned if there are no times for the path.
    """
    robot, joints = mover.robot, mover.joints
    limits = motion_limits(robot)
    v = np.array([limits[name].velocity for name in joints])
    a = np.array([limits[name].acceleration for name in joints]) * scaling[1]
    jerk = np.array([limits[name].jerk for name in joints])
    end = path[-1:]
    path, lengths = _measure(path, v)
    if sum(lengths) < 4.0 * _SMALLEST:
        still = np.zeros((1, len(joints)))
        return Samples(np.zeros(1), end, still, still), True
    curve = _round(path, lengths, rounding)
    drives = _find_drives(mover)
    v = _steady_speeds(drives, v) * scaling[0]
    times = _parametrize(drives, curve, v, a)
    if times is None:
        return None
    samples = _sample(curve, times, _PERIOD)
    part = (samples.t[-1] / (2.0 * _window(samples, jerk))) ** (2.0 / 3.0)
    if np.isfinite(jerk).any() and part < 1.0:
        times = _parametrize(drives, curve, v, part * a) or times
        samples = _sample(curve, times, _PERIOD)
    slower = stretch * max(
        1.0,
        float(np.max(np.abs(samples.v) / v)),
        math.sqrt(float(np.max(np.abs(samples.a) / a))),
    )
    if np.all(np.isinf(jerk)):
        samples = _slow_down(samples, slower)
    else:
        samples = _average(_slow_down(_sample(curve, times, _FINE), slower), jerk)
    slower = _slower_for_efforts(drives, samples)
    keeps = bool(slower <= _SLOWEST)
    samples = _slow_down(samples, slower if keeps else 1.0)
    samples.v[[0, -1]] = 0.0
    samples.q[0], samples.q[-1] = path[0], path[-1]
    return samples, keeps


def round_corners(
    mover: Mover, path: np.ndarray, rounding: float, scaling: tuple[float, float]
) -> list[np.ndarray]:
    """Return points on each corner of a path as motions round it, shapes (k, n)."""
    limits = motion_limits(mover.robot)
    v = np.array([limits[name].velocity for name in mover.joints]) * scaling[0]
    path, lengths = _measure(path, v)
    if len(path) < 3:
        return []
    curve = _round(path, lengths, rounding)
    ends = curve.get_segment_times()[1:-1]  # Between them are lines and parabolas.
    places = [np.linspace(*each, 5) for each in zip(ends[::2], ends[1::2], strict=True)]
    return [np.array(curve.vector_values(s)).T for s in places]


def _measure(path: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """Return a path without lines that are none, and how long each takes at speeds."""
    lengths = [float(np.max(np.abs(y - x) / v)) for x, y in itertools.pairwise(path)]
    keep = [True, *(length > 1e-9 for length in lengths)]
    return path[keep], [length for length in lengths if length > 1e-9]


def _sample(
    curve: PiecewisePolynomial, times: PiecewisePolynomial, period: float
) -> Samples:
    """Return points of a motion, apart by at most a period [s]."""
    count = max(2, math.ceil(times.end_time() / period) + 1)
    t = np.linspace(0.0, times.end_time(), count)
    s, s1, s2 = (f.vector_values(t)[0] for f in _derivatives(times))
    q, q1, q2 = (f.vector_values(s).T for f in _derivatives(curve))
    v = q1 * s1[:, np.newaxis]
    return Samples(t, q, v, q2 * (s1**2)[:, np.newaxis] + q1 * s2[:, np.newaxis])


def _slow_down(samples: Samples, factor: float) -> Samples:
    t, q, v, a = samples
    return Samples(t * factor, q, v / factor, a / factor**2)


def _window(samples: Samples, jerk: np.ndarray) -> float:
    """Return the time over which a motion is averaged for its limits of jerk [s]."""
    a = samples.a
    changes = np.maximum(a.max(axis=0), 0.0) - np.minimum(a.min(axis=0), 0.0)
    # No shorter than between points: the quintics there would exceed accelerations.
    return max(float(np.max(changes / jerk)) / _MARGIN, _PERIOD)


def _average(samples: Samples, jerk: np.ndarray) -> Samples:
    """Return the means of a motion over a window of time that keep limits of jerk.

    These are the joints' [rad/s^3] or [m/s^3], shape (n,). Samples are close together.
    """
    t, q, v, _ = samples
    window = _window(samples, jerk)
    end = t[-1] + window
    at = np.linspace(0.0, end, max(2, math.ceil(end / _PERIOD) + 1))
    # The integral of cubics that have the positions and velocities, exactly.
    steps = np.diff(t)[:, np.newaxis]
    areas = steps * (q[1:] + q[:-1]) / 2 + steps**2 * (v[:-1] - v[1:]) / 12
    area = np.vstack([np.zeros_like(q[:1]), np.cumsum(areas, axis=0)])
    whole = PiecewisePolynomial.CubicHermite(t, area.T, q.T)
    position = PiecewisePolynomial.CubicHermite(t, q.T, v.T)

    def part(values: PiecewisePolynomial, x: np.ndarray) -> np.ndarray:
        return np.array(values.vector_values(np.clip(x, 0.0, t[-1]))).T

    def area_to(x: np.ndarray) -> np.ndarray:  # It stands before and after.
        before, after = np.minimum(x, 0.0), np.maximum(x - t[-1], 0.0)
        return part(whole, x) + np.outer(before, q[0]) + np.outer(after, q[-1])

    def velocity(x: np.ndarray) -> np.ndarray:
        inside = [np.interp(x, t, column, left=0.0, right=0.0) for column in v.T]
        return np.array(inside).T

    averaged = Samples(
        at,
        (area_to(at) - area_to(at - window)) / window,
        (part(position, at) - part(position, at - window)) / window,
        (velocity(at) - velocity(at - window)) / window,
    )
    # What controllers play between points may exceed what is averaged.
    beyond = float(np.max(_most_jerk(averaged) / jerk))
    return _slow_down(averaged, max(1.0, beyond / _MARGIN) ** (1.0 / 3.0))


def _most_jerk(samples: Samples) -> np.ndarray:
    """Return the largest jerk of the quintics through points, shape (n,)."""
    t, q, v, a = samples
    h = np.diff(t)[:, np.newaxis]
    change, v0, v1, a0, a1 = np.diff(q, axis=0), v[:-1], v[1:], a[:-1], a[1:]
    c3 = 10 * change - (4 * v1 + 6 * v0) * h - (1.5 * a0 - 0.5 * a1) * h**2
    c4 = -15 * change + (7 * v1 + 8 * v0) * h + (1.5 * a0 - a1) * h**2
    c5 = 6 * change - 3 * (v1 + v0) * h + 0.5 * (a1 - a0) * h**2
    # A parabola has its extremes at the ends, and where its slope is none.
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.nan_to_num(np.clip(-c4 / (5 * c5), 0.0, 1.0))
    jerks = [6 * c3 + 24 * c4 * x + 60 * c5 * x**2 for x in (0.0, 1.0, top)]
    most: np.ndarray = np.max(np.abs(jerks) / h**3, axis=(0, 1))
    return most


def deviation(path: np.ndarray, q: np.ndarray) -> float:
    """Return how far points, shape (k, n), are from lines through others, (m, n)."""
    one, line = path[:-1], np.diff(path, axis=0)
    length = np.maximum(np.sum(line**2, axis=1), 1e-18)
    farthest = 0.0
    for point in q:
        along = np.clip(np.sum((point - one) * line, axis=1) / length, 0.0, 1.0)
        away = point - one - along[:, np.newaxis] * line
        farthest = max(farthest, float(np.min(np.linalg.norm(away, axis=1))))
    return farthest


def _derivatives(curve: PiecewisePolynomial) -> list[PiecewisePolynomial]:
    return [curve, curve.derivative(1), curve.derivative(2)]


def _round(
    path: np.ndarray, lengths: Sequence[float], rounding: float
) -> PiecewisePolynomial:
    """Return a curve of lines and of parabolas at the corners."""
    u = [(y - x) / n for x, y, n in zip(path, path[1:], lengths, strict=False)]
    breaks, values, slopes = [0.0], [path[0]], [u[0]]
    at = 0.0
    for i in range(1, len(path) - 1):
        at += lengths[i - 1]
        b = min(rounding, 0.45 * lengths[i - 1], 0.45 * lengths[i])
        breaks += [at - b, at + b]
        values += [path[i] - b * u[i - 1], path[i] + b * u[i]]
        slopes += [u[i - 1], u[i]]
    breaks.append(at + lengths[-1])
    values.append(path[-1])
    slopes.append(u[-1])
    # Cubics that are given by values and slopes at their ends are these curves.
    return PiecewisePolynomial.CubicHermite(
        breaks, np.array(values).T, np.array(slopes).T
    )


class _Drives(NamedTuple):
    """Load of the drives of a group's joints, and their limits."""

    # A plant of the robot alone, with what its links hold.
    plant: MultibodyPlant

    # Positions of all joints are `rest` and `spread` times those of the group, shape
    # (m,) and (m, n).
    rest: np.ndarray
    spread: np.ndarray

    # Which of all joints these are, shape (n,).
    chosen: np.ndarray

    # Efforts [N·m] or [N], dry friction, and damping [N·m·s/rad] or [N·s/m], (n,).
    limit: np.ndarray
    friction: np.ndarray
    damping: np.ndarray

    def whole(self, q: np.ndarray) -> np.ndarray:
        """Return where all joints are, shape (k, m), for those of the group, (k, n)."""
        return self.rest + q @ self.spread.T


def _find_drives(mover: Mover) -> _Drives:
    robot, group = mover.robot, mover.joints
    plant = trial_plant(robot)
    if any(payload.mass for payload in mover.payloads.values()):
        plant = make_reduced_plant(
            robot.description, robot.pose, 1e-3, payloads=mover.payloads
        )
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    rest, friction, damping = np.zeros((3, plant.num_positions()))
    spread = np.zeros((plant.num_positions(), len(group)))
    for name, joint in joints.items():
        at = plant.GetJointByName(name).position_start()
        rest[at] = mover.positions[name]
        friction[at], damping[at] = joint.friction, joint.damping
        master, factor, _ = last_master(joint, joints)
        if master in group:
            spread[at, group.index(master)] = factor
    efforts = [joints[name].limits.effort for name in group]
    return _Drives(
        plant,
        rest - spread @ mover.start,
        spread,
        np.array([plant.GetJointByName(name).position_start() for name in group]),
        np.array([min(effort or _UNLIMITED, _UNLIMITED) for effort in efforts]),
        friction @ np.abs(spread),
        damping @ spread**2,
    )


def _steady_speeds(drives: _Drives, v: np.ndarray) -> np.ndarray:
    """Return speeds, shape (n,), at which damping leaves effort to accelerate.

    They are at most `v`, and not below a part of it. What weight takes differs from
    place to place: `_slower_for_efforts` counts with it.
    """
    left = drives.limit - drives.friction
    counts = (drives.damping > 0.0) & (left > 0.0)
    speeds = v.copy()
    speeds[counts] = _CRUISING * left[counts] / drives.damping[counts]
    steady: np.ndarray = np.clip(speeds, v / _SLOWEST, v)
    return steady


def _slower_for_efforts(drives: _Drives, samples: Samples) -> float:
    """Return how much slower a motion has to be for efforts to keep their limits.

    It is at least 1, and infinite if they don't even where it hardly moves.
    """
    plant, context = drives.plant, drives.plant.CreateDefaultContext()
    nothing = MultibodyForces(plant)
    moving, steady = np.empty((2, *samples.q.shape))
    whole = (samples.v @ drives.spread.T, samples.a @ drives.spread.T)
    for i, (q, v, a) in enumerate(zip(drives.whole(samples.q), *whole, strict=True)):
        plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
        moving[i] = plant.CalcInverseDynamics(context, a, nothing) @ drives.spread
        steady[i] = -plant.CalcGravityGeneralizedForces(context) @ drives.spread
    steady += drives.friction * np.sign(samples.v)
    fastest = 1.0
    for side in (1.0, -1.0):
        A, B = side * moving, side * drives.damping * samples.v
        left = drives.limit - side * steady
        if np.any(left <= 0.0):
            return math.inf
        # The smallest root above 0 of A r^2 + B r = left, if there is one.
        square = B**2 + 4.0 * A * left
        below = B + np.sqrt(np.maximum(square, 0.0))
        binds = (square >= 0.0) & (below > 0.0)
        fastest = min(fastest, np.min(2.0 * left[binds] / below[binds], initial=1.0))
    return 1.0 / fastest


def _parametrize(
    drives: _Drives, curve: PiecewisePolynomial, v: np.ndarray, a: np.ndarray
) -> PiecewisePolynomial | None:
    """Return the curve's parameter by time; efforts keep limits if they can."""
    plant, whole = drives.plant, _of_all_joints(drives, curve)
    most_v, most_a, most_u = np.full((3, plant.num_positions()), _UNLIMITED)
    most_v[drives.chosen], most_a[drives.chosen] = v, _MARGIN * a
    # What is weaker than its friction isn't looked at here.
    left = np.maximum(drives.limit - drives.friction, 0.0)
    most_u[drives.chosen] = np.where(left > 0.0, left, _UNLIMITED)
    # Interpolation is exact at more points, collocation rarely fails. Where it does, as
    # near a sharp turn of a straight line's joints, other points or less acceleration
    # help.
    exact, robust = (
        ToppraDiscretization.kInterpolation,
        ToppraDiscretization.kCollocation,
    )
    ways = ((exact, _GRID), (robust, _GRID), (robust, _FINER))
    with drake_messages():  # It says so when it fails.
        for keeps, part, (way, count) in itertools.product(
            (True, False), (1.0, 0.5), ways
        ):
            toppra = Toppra(whole, plant, _grid(curve, count))
            toppra.AddJointVelocityLimit(-most_v, most_v)
            toppra.AddJointAccelerationLimit(-part * most_a, part * most_a, way)
            if keeps:
                toppra.AddJointTorqueLimit(-most_u, most_u, way)
            try:
                times = toppra.SolvePathParameterization()
            except (RuntimeError, SystemExit):  # Drake's own checks.
                continue
            if times is not None:
                return times
    return None


def _grid(curve: PiecewisePolynomial, count: int) -> np.ndarray:
    """Return a curve's breaks, and so many places along it, not too close."""
    breaks = np.array(curve.get_segment_times())
    count = min(count, 2 + int(breaks[-1] / (2.0 * _SMALLEST)))
    even = np.linspace(breaks[0], breaks[-1], count)
    grid = np.unique(np.concatenate([breaks, even]))
    grid = grid[np.append(np.diff(grid) > _SMALLEST, True)]
    grid[0] = breaks[0]
    return grid


def _of_all_joints(drives: _Drives, curve: PiecewisePolynomial) -> Any:
    """Return the curve with the joints that follow, and those that stay."""
    breaks = curve.get_segment_times()
    values = np.array([curve.value(s)[:, 0] for s in breaks])
    slopes = np.array([curve.EvalDerivative(s, 1)[:, 0] for s in breaks])
    return PiecewisePolynomial.CubicHermite(
        breaks, drives.whole(values).T, (slopes @ drives.spread.T).T
    )
