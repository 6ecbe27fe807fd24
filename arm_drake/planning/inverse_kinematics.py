"""Forward and inverse kinematics of any link of a robot.

Levenberg-Marquardt on Drake's Jacobian. Joints at a limit that the step would leave are
held there (an active set). A try that comes no nearer ends early; the next one starts
from the nearest of a table of random poses, which is made once for a robot and frame.
"""

import functools
import math
import weakref
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable

from arm_drake.arrays import is_finite, is_number
from arm_drake.description.joints import joints_above, last_master
from arm_drake.description.robot import Robot
from arm_drake.errors import (
    ArmDrakeError,
    InputError,
    check_known,
    check_type,
    counted,
    quoted,
)
from arm_drake.importing import dataclass
from arm_drake.planning.groups import find_group, find_mask
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.plant.kinematics import (
    Screws,
    rotation_vector,
    rotation_vectors,
    swings,
)
from arm_drake.plant.plant import read_pose, trial_plant

# What a solution may miss the pose by [m] and [rad].
TOLERANCE = (1e-5, 1e-4)

# Random poses to start from, and how many tries there are before there is none.
_TABLE, _TRIES = 4000, 100

# Steps of a try, at most; a try ends after a few that don't improve it enough.
_STEPS, _PATIENCE, _PROGRESS = 40, 3, 0.7

# The largest change of a joint in a step [rad]; a prismatic one's is as far as the
# robot is large for each radian.
_LARGEST_STEP = 1.0

# Damping for each unit of squared error, and that which is left at the end.
_DAMPING, _LEAST_DAMPING = 0.02, 1e-9

# Solutions that differ by less are the same one [rad], [m].
_SAME = 1e-3

# The largest change of a joint between points of a line [rad], [m].
_JUMP = 0.3

# Tries that are made at once where one solution is wanted: mostly one of the first four
# leads there. Eight at once take as long as two alone.
_AT_ONCE = (1, 1, 1, 1, 8)

# Tries when all solutions are wanted, and when there can be none. The nearest starts
# lead to most: where so many lead to no new one, others aren't looked for.
_ALL_TRIES, _FAR_TRIES, _VAIN_TRIES = 100, 3, 25


@dataclass(frozen=True)
class IkSolution:
    """Joint positions that put a frame where it should be."""

    # [rad] or [m] of each movable joint of the robot, those that follow included.
    positions: Mapping[str, float]

    # How many starts it took.
    tries: int

    # What the pose is missed by [m], [rad], of what of it counts.
    position_error: float
    orientation_error: float

    # Positions of the other solutions, the nearest to the seed first; none unless all
    # were asked for.
    others: tuple[Mapping[str, float], ...] = ()


class NoSolution(ArmDrakeError, ValueError):
    """No joint positions were found that put a frame where it should be.

    Attributes:
        positions: The best positions found [rad] or [m], by joint.
        position_error: What they miss the pose by [m].
        orientation_error: What they miss it by [rad].
        at_limits: The joints that are at a limit there.
        is_out_of_reach: Whether no joint positions at all reach so far.
    """

    def __init__(
        self,
        message: str,
        *,
        positions: Mapping[str, float],
        position_error: float,
        orientation_error: float,
        at_limits: Sequence[str],
        is_out_of_reach: bool,
    ) -> None:
        """Create it with what was found instead."""
        super().__init__(message)
        self.positions = positions
        self.position_error = position_error
        self.orientation_error = orientation_error
        self.at_limits = tuple(at_limits)
        self.is_out_of_reach = is_out_of_reach


def forward_kinematics(
    robot: Robot, positions: Mapping[str, float], frame: str
) -> RigidTransform:
    """Return where a link is in the world.

    Args:
        robot: The robot; its base is at its pose, the origin by default.
        positions: Joint positions [rad] or [m] by name. Those that are left out are at
            their initial positions; joints that follow are where their masters put them
            unless they are named themselves.
        frame: Name of the link.

    Raises:
        InputError: If there is no such link or joint, or a number isn't finite.
    """
    kinematics = _kinematics_of(robot)
    kinematics.check_frame(frame)
    return kinematics.pose_of(kinematics.complete(positions), frame)


def solve_ik(
    robot: Robot,
    frame: str,
    pose: RigidTransform | Sequence[float],
    *,
    seed: Mapping[str, float] | None = None,
    group: str | Collection[str] | None = None,
    tolerance: tuple[float, float] = TOLERANCE,
    mask: Sequence[bool] | None = None,
    collision_free: bool = False,
    all_solutions: bool = False,
) -> IkSolution:
    """Return joint positions that put a link at a pose, within the joints' limits.

    The same arguments give the same solution. Joints that turn without end, or more
    than once, are at the turn nearest to the seed.

    Args:
        robot: The robot; its base is at its pose, the origin by default.
        frame: Name of the link.
        pose: Where it should be in the world, as a transform or as x, y, z [m], roll,
            pitch, yaw [rad].
        seed: Positions [rad] or [m] to start from by joint, by default and for joints
            that are left out the initial ones. Those that don't carry it stay there.
        group: The joints that may move, or the name of their planning group; by default
            all that carry the link.
        tolerance: What the pose may be missed by [m] and [rad].
        mask: What of the pose counts: x, y, z in the world, and turns about the x, y
            and z axis of the link. `(1, 1, 1, 1, 1, 0)` lets the link turn about its z
            axis: what an arm of five joints can do. `(1, 1, 1, 0, 0, 0)` is a position.
            None is that with `position_only_ik` in `kinematics.yaml`, else all.
        collision_free: Whether the robot may not touch itself.
        all_solutions: Whether to look for the other solutions, too.

    Raises:
        NoSolution: If none was found.
        InputError: If an argument can't be used.
    """
    _check_flags(collision_free=collision_free, all_solutions=all_solutions)
    kinematics = _kinematics_of(robot)
    chosen = None if group is None else find_group(robot, group)
    target = _Target.of(read_pose(pose), find_mask(chosen, mask), tolerance)
    chain = kinematics.chain(frame, None if chosen is None else chosen.joints)
    q = kinematics.complete({} if seed is None else seed, "seed")
    is_free = _self_check(robot, chain, q) if collision_free else None
    tries = _ALL_TRIES if all_solutions else _TRIES
    if target.is_beyond(kinematics.place_of(q, chain.base), chain.reach):
        tries = _FAR_TRIES
    found, best = _search(chain, q, target, all_solutions, is_free, tries)
    if not found:
        raise _no_solution(robot, chain, target, best, q)
    end = found[0].end
    positions = [kinematics.named(chain.spread(q, f.end.values)) for f in found]
    return IkSolution(
        positions=positions[0],
        tries=found[0].tries,
        position_error=end.position_error,
        orientation_error=end.orientation_error,
        others=tuple(positions[1:]),
    )


def _check_flags(**flags: object) -> None:
    for name, value in flags.items():
        check_type(name, value, bool | np.bool_, "True or False")


def complete_positions(
    robot: Robot, positions: Mapping[str, float]
) -> dict[str, float]:
    """Return positions of all movable joints, the others where they are initially."""
    kinematics = _kinematics_of(robot)
    return kinematics.named(kinematics.complete(positions))


def find_reach(
    robot: Robot, frame: str, group: Collection[str]
) -> tuple[np.ndarray, float]:
    """Return a point in the world that a link turns about, and how far it gets [m].

    The point is that of the first of the group's joints which move the link, in the
    robot's initial positions.
    """
    kinematics = _kinematics_of(robot)
    chain = kinematics.chain(frame, group)
    place = kinematics.place_of(kinematics.complete({}), chain.base)
    return place, chain.reach


def pose_error(
    robot: Robot, frame: str, pose: RigidTransform, mask: Sequence[bool]
) -> Callable[[Mapping[str, float]], np.ndarray]:
    """Return what says by how much joint positions miss a pose [m], [rad].

    The numbers are those of what counts: places in the world, turns in the frame.
    """
    kinematics = _kinematics_of(robot)
    target = _Target.of(pose, mask, TOLERANCE)

    def miss(positions: Mapping[str, float]) -> np.ndarray:
        X = kinematics.pose_of(kinematics.complete(positions), frame)
        return target.miss_of(X.rotation().matrix(), X.translation())[target.rows]

    return miss


def follow_line(
    robot: Robot,
    frame: str,
    pose: RigidTransform,
    *,
    seed: Mapping[str, float],
    group: Collection[str],
    mask: Sequence[bool],
    step: tuple[float, float],
) -> tuple[np.ndarray, float]:
    """Return joint positions on a straight line from the seed, and how far they get.

    The positions have the shape (m, n), n joints as in the group; the frame turns at a
    constant rate. Points are `step` [m], [rad] apart, or closer. The line ends, at a
    fraction below 1, where no positions nearby continue it.
    """
    kinematics = _kinematics_of(robot)
    chain = kinematics.chain(frame, group)
    own = [kinematics.at[name] for name in group]
    q = kinematics.complete(seed)
    X = kinematics.pose_of(q, frame)
    R = X.rotation().matrix().T @ pose.rotation().matrix()
    turn = rotation_vector(R)
    shift = pose.translation() - X.translation()
    count = max(
        1,
        math.ceil(np.linalg.norm(shift) / step[0]),
        math.ceil(np.linalg.norm(turn) / step[1]),
    )
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
    found = [q[own]]
    for number in range(1, count + 1):
        part = number / count
        R_WF = X.rotation() @ RotationMatrix(AngleAxis(part * angle, axis))
        point = RigidTransform(R_WF, X.translation() + part * shift)
        target = _Target.of(point, mask, TOLERANCE)
        end = chain.descend_alone(q, q[chain.at], target)
        jump = float(np.max(np.abs(end.values - q[chain.at])))
        if not target.is_met(end) or jump > _JUMP:
            return np.array(found), (number - 1) / count
        q = chain.spread(q, end.values)
        found.append(q[own])
    return np.array(found), 1.0


class _End(NamedTuple):
    """Final values and errors of a try."""

    values: np.ndarray
    error: float
    position_error: float
    orientation_error: float


class _Found(NamedTuple):
    """A solution, and how many tries it took."""

    end: _End
    tries: int


class _Target(NamedTuple):
    """A pose, and what of it counts."""

    R: np.ndarray
    p: np.ndarray
    rows: np.ndarray  # Which of x, y, z and the turns count.
    pointing: int | None  # The one axis about which the frame may turn.
    tolerance: tuple[float, float]

    @staticmethod
    def of(
        pose: RigidTransform, mask: Sequence[bool], tolerance: tuple[float, float]
    ) -> "_Target":
        """Return it, or raise InputError for a tolerance that is none."""
        _check_tolerance(tolerance)
        free = [axis for axis in range(3) if not mask[3 + axis]]
        return _Target(
            np.array(pose.rotation().matrix()),
            np.array(pose.translation()),
            np.flatnonzero(mask),
            free[0] if len(free) == 1 else None,
            tolerance,
        )

    def is_met(self, end: _End) -> bool:
        """Return whether a try ended at the pose."""
        return (
            end.position_error <= self.tolerance[0]
            and end.orientation_error <= self.tolerance[1]
        )

    def is_beyond(self, place: np.ndarray, reach: float) -> bool:
        """Return whether it is farther from a place than a frame gets [m]."""
        away = float(np.linalg.norm(self.p - place))
        return bool(np.all(np.isin([0, 1, 2], self.rows))) and away > reach

    def miss(self, R: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the twists from poses to this one, shape (k, 6).

        [m] in the world, then [rad] in the frame; R: (k, 3, 3), p: (k, 3).
        """
        R_FT = np.swapaxes(R, 1, 2) @ self.R
        if self.pointing is None:
            turns = rotation_vectors(R_FT)
        else:
            turns = swings(R_FT[:, :, self.pointing], self.pointing)
        return np.concatenate((self.p - p, turns), axis=1)

    def miss_of(self, R: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the twist from one pose to this one, shape (6,), as `miss`."""
        if self.pointing is not None:
            return self.miss(R[np.newaxis], p[np.newaxis])[0]
        return np.concatenate((self.p - p, rotation_vector(R.T @ self.R)))


def _check_tolerance(tolerance: object) -> None:
    """Raise InputError unless it is two positive numbers."""
    values = list(tolerance) if isinstance(tolerance, Iterable) else []
    are_valid = [is_number(t) and 0.0 < t < math.inf for t in values]
    if len(values) != 2 or not all(are_valid):
        expected = "tolerance: expected two positive numbers [m] and [rad]"
        raise InputError(f"{expected}, got {values or tolerance!r}")


class _Chain:
    """The joints that carry a frame, and the way to a pose by them."""

    def __init__(
        self, kinematics: "_Kinematics", frame: str, joints: Sequence[str]
    ) -> None:
        self._kinematics = kinematics
        self.frame, self.joints = frame, list(joints)
        self._screws = kinematics.screws(frame)
        self.at = np.array([kinematics.at[name] for name in joints])
        ranges = [kinematics.ranges[name] for name in joints]
        self.lower = np.array([-math.inf if r.wraps else r.lower for r in ranges])
        self.upper = np.array([math.inf if r.wraps else r.upper for r in ranges])
        self._low = np.array([r.lower for r in ranges])
        self._high = np.array([r.upper for r in ranges])
        self.reach, self.base = kinematics.reach(frame, joints)
        # Errors are angles: lengths count as parts of the reach.
        self._length = max(self.reach if math.isfinite(self.reach) else 1.0, 1e-3)
        self._turns = np.array([r.unit == "rad" for r in ranges])
        self._step = np.where(self._turns, 1.0, self._length) * _LARGEST_STEP
        # dq = E dx: columns are the joints, and what follows them.
        self._E = kinematics.spreading[:, self.at]
        self._E_above = self._E[self._screws.at]
        self._table: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def spread(self, q: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return positions of all joints, where those of the chain have values."""
        return q + self._E @ (values - q[self.at])

    def _joints_above(self, q: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return positions of the joints above the frame, of many values (k, n)."""
        return q[self._screws.at] + (values - q[self.at]) @ self._E_above.T

    def starts(self, q: np.ndarray, target: _Target, tries: int) -> np.ndarray:
        """Return where tries start: the seed, then random poses, the nearest first."""
        seed = q[np.newaxis, self.at].clip(self.lower, self.upper)
        if tries == 1:
            return seed
        if self._table is None:
            self._table = self._make_table(q)
        values, points, turns = self._table
        rows = target.rows
        shift = ((points - target.p) / self._length)[:, rows[rows < 3]]
        distance = np.einsum("ij,ij->i", shift, shift)
        if target.pointing is not None:
            axis = turns[:, :, target.pointing] @ target.R[:, target.pointing]
            distance += 2.0 - 2.0 * axis
        elif np.any(rows >= 3):
            distance += 3.0 - np.einsum("ijk,jk->i", turns, target.R)
        nearest = np.argsort(distance, kind="stable")[: tries - 1]
        return np.vstack((seed, values[nearest]))

    def _make_table(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rng = np.random.default_rng(0)
        values = rng.uniform(self._low, self._high, (_TABLE, len(self.joints)))
        turns, points, _ = self._screws.poses(self._joints_above(q, values))
        return values, points, turns

    def descend_alone(self, q: np.ndarray, start: np.ndarray, target: _Target) -> _End:
        """Return where one ends, (n,): as `descend`, in two thirds of the time."""
        x, rows = start, target.rows
        scale = np.array([1.0 / self._length] * 3 + [1.0] * 3)[rows]
        split = int(np.searchsorted(rows, 3))
        end, patience = _End(x, math.inf, math.inf, math.inf), _PATIENCE
        for _ in range(_STEPS):
            R, p, J = self._kinematics.jacobian(self.spread(q, x), self.frame)
            twist = target.miss_of(R, p)[rows]
            e = scale * twist
            error, best = float(e @ e), end.error
            if error < best:
                end = _End(x, error, *_norms(twist, split))
            if target.is_met(end):
                break
            patience = _PATIENCE if error < _PROGRESS * best else patience - 1
            if not patience:
                break
            J = np.concatenate((J[3:], R.T @ J[:3]))[rows] @ self._E
            x = self._improve_alone(x, J * scale[:, np.newaxis], e, error)
        return end

    def _improve_alone(
        self, x: np.ndarray, J: np.ndarray, e: np.ndarray, error: float
    ) -> np.ndarray:
        """Return the values after a step, within their limits."""
        H, g = J.T @ J, J.T @ e
        H.flat[:: len(x) + 1] += _DAMPING * error + _LEAST_DAMPING
        low, high = x <= self.lower, x >= self.upper
        free, dx = np.ones(len(x), dtype=bool), np.linalg.solve(H, g)
        while (at_limit := (low & (dx < 0.0)) | (high & (dx > 0.0))).any():
            free &= ~at_limit
            dx = np.zeros(len(x))
            dx[free] = np.linalg.solve(H[np.ix_(free, free)], g[free])
        largest = max(float((np.abs(dx) / self._step).max(initial=0.0)), 1.0)
        return np.clip(x + dx / largest, self.lower, self.upper)

    def descend(self, q: np.ndarray, starts: np.ndarray, target: _Target) -> list[_End]:
        """Return where tries from starts end, shape (k, n); they don't mind others."""
        x, rows, all_rows = starts, target.rows, len(target.rows) == 6
        scale = np.array([1.0 / self._length] * 3 + [1.0] * 3)[rows]
        split = int(np.searchsorted(rows, 3))
        ends = [_End(each, math.inf, math.inf, math.inf) for each in x]
        going, patience = list(range(len(x))), [_PATIENCE] * len(x)
        for _ in range(_STEPS):
            R, p, J = self._screws.poses(self._joints_above(q, x))
            twist = target.miss(R, p)
            if not all_rows:
                twist = twist[:, rows]
            e = scale * twist
            on = []
            for k, (i, error) in enumerate(
                zip(going, (e * e).sum(axis=1).tolist(), strict=True)
            ):
                best = ends[i].error
                if error < best:
                    ends[i] = _End(x[k], error, *_norms(twist[k], split))
                if target.is_met(ends[i]):
                    continue
                patience[i] = _PATIENCE if error < _PROGRESS * best else patience[i] - 1
                if patience[i]:
                    on.append(k)
            if not on:
                break
            if len(on) < len(x):
                x, R, J, e = x[on], R[on], J[on], e[on]
                going = [going[k] for k in on]
            J[:, 3:] = R.swapaxes(1, 2) @ J[:, 3:]
            if not all_rows:
                J = J[:, rows]
            x = self._improve(x, scale[:, np.newaxis] * (J @ self._E_above), e)
        return ends

    def _improve(self, x: np.ndarray, J: np.ndarray, e: np.ndarray) -> np.ndarray:
        """Return values after a step, within their limits; tries are rows."""
        n, error = x.shape[1], (e * e).sum(axis=1)
        J_T = J.swapaxes(1, 2)
        H, g = J_T @ J, (J_T @ e[:, :, np.newaxis])[:, :, 0]
        damping = (_DAMPING * error + _LEAST_DAMPING)[:, np.newaxis]
        H.reshape(len(x), -1)[:, :: n + 1] += damping
        low, high = x <= self.lower, x >= self.upper
        dx = _solve(H, g)
        at_limit = (low & (dx < 0.0)) | (high & (dx > 0.0))
        clamped = np.zeros(x.shape, dtype=bool)
        while at_limit.any():
            clamped |= at_limit
            which = np.flatnonzero(at_limit.any(axis=1))
            # Joints that are held don't move, and others don't mind them.
            free = ~clamped[which]
            both = free[:, :, np.newaxis] & free[:, np.newaxis]
            dx[which] = _solve(np.where(both, H[which], np.eye(n)), g[which] * free)
            at_limit = (low & (dx < 0.0)) | (high & (dx > 0.0))
        largest = np.maximum((np.abs(dx) / self._step).max(axis=1), 1.0)
        return (x + dx / largest[:, np.newaxis]).clip(self.lower, self.upper)

    def unwind(self, values: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return values whose joints are at the turns nearest to the seed."""
        unwound = values.copy()
        for i, near in enumerate(q[self.at]):
            # What follows the joint may follow by another factor.
            if not self._turns[i] or np.count_nonzero(self._E[:, i]) > 1:
                continue
            turns = round((near - values[i]) / (2.0 * math.pi))
            ends = [values[i] + 2.0 * math.pi * (turns + k) for k in (-1, 0, 1)]
            fitting = [v for v in ends if self.lower[i] <= v <= self.upper[i]]
            unwound[i] = min(
                [values[i], *fitting], key=functools.partial(_distance, float(near))
            )
        return unwound

    def at_limits(self, values: np.ndarray) -> list[str]:
        """Return the joints that are at a limit."""
        span = 1e-6
        near = (values <= self.lower + span) | (values >= self.upper - span)
        return [name for name, flag in zip(self.joints, near, strict=True) if flag]


def _distance(one: float, other: float) -> float:
    return abs(one - other)


def _self_check(
    robot: Robot, chain: _Chain, q: np.ndarray
) -> Callable[[np.ndarray], bool]:
    """Return what says whether a robot doesn't touch itself."""
    from arm_drake.planning.collisions import collision_model  # It takes 40 ms.

    positions = _kinematics_of(robot).named(q)
    return collision_model(
        robot, chain.joints, "void", padding=0.0, positions=positions
    ).is_free


def _search(
    chain: _Chain,
    q: np.ndarray,
    target: _Target,
    finds_all: bool,
    is_free: Callable[[np.ndarray], bool] | None,
    most: int,
) -> tuple[list[_Found], _End]:
    """Return solutions, the nearest to q first, and the best end of a try."""
    found: list[_Found] = []
    met: list[np.ndarray] = []
    best, newest = None, 0
    ends = _descend(chain, q, target, most, finds_all)
    for tries, end in enumerate(ends, start=1):
        if best is None or end.error < best.error:
            best = end
        if target.is_met(end):
            end = end._replace(values=chain.unwind(end.values, q))
            if all(np.max(np.abs(end.values - values)) > _SAME for values in met):
                met.append(end.values)
                newest = tries
                if is_free is None or is_free(end.values):
                    found.append(_Found(end, tries))
                    if not finds_all:
                        break
        if finds_all and tries >= newest + _VAIN_TRIES and tries % _VAIN_TRIES == 0:
            break
    assert best is not None
    found.sort(key=lambda each: float(np.linalg.norm(each.end.values - q[chain.at])))
    return found, best


def _descend(
    chain: _Chain, q: np.ndarray, target: _Target, tries: int, finds_all: bool
) -> Iterator[_End]:
    """Yield where tries end; a few at first where these are likely to do."""
    starts, begun = chain.starts(q, target, 1), 0
    sizes = iter(() if finds_all else _AT_ONCE)
    while begun < tries:
        count = next(sizes, _VAIN_TRIES)
        if begun + count > len(starts):  # The seed alone doesn't need a table.
            starts = chain.starts(q, target, tries)
        if count == 1:
            yield chain.descend_alone(q, starts[begun], target)
        else:
            yield from chain.descend(q, starts[begun : begun + count], target)
        begun += count


def _norms(twist: np.ndarray, split: int) -> tuple[float, float]:
    shift, turn = twist[:split], twist[split:]
    return math.sqrt(shift @ shift), math.sqrt(turn @ turn)


def _solve(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    return np.linalg.solve(H, g[:, :, np.newaxis])[:, :, 0]


class _Kinematics:
    """A robot's reduced plant, and the names of what is in it."""

    def __init__(self, robot: Robot) -> None:
        description = robot.description
        self._description = description
        self._plant = plant = trial_plant(robot)
        self._context = plant.CreateDefaultContext()
        self.ranges = {r.name: r for r in joint_ranges(description)}
        self.at = {
            name: plant.GetJointByName(name).position_start() for name in self.ranges
        }
        joints = {joint.name: joint for joint in description.movable_joints}
        self._masters = {
            name: last_master(joint, joints) for name, joint in joints.items()
        }
        self.spreading = np.zeros((plant.num_positions(), plant.num_positions()))
        for name, (master, factor, _) in self._masters.items():
            self.spreading[self.at[name], self.at[master]] = factor
        self._initial = dict(robot.initial_positions)
        self._chains: dict[tuple[str, tuple[str, ...]], _Chain] = {}

    def check_frame(self, frame: str) -> None:
        """Raise InputError if there is no such link."""
        links = self._description.links
        check_type("frame", frame, str, "a link's name")
        check_known("link", frame, links)

    def complete(
        self, positions: Mapping[str, float], argument: str = "positions"
    ) -> np.ndarray:
        """Return the plant's positions, or raise InputError."""
        check_type(argument, positions, Mapping, "joint positions by name")
        q = np.zeros(self._plant.num_positions())
        for name, value in positions.items():
            check_known("joint", name, self.at)
            if not is_finite(value):
                problem = f"expected a finite number [rad or m], got {value!r}"
                raise InputError(f"joint {name!r}: {problem}")
        for name, (master, factor, offset) in self._masters.items():
            if name in positions:
                q[self.at[name]] = positions[name]
            else:
                value = positions.get(master, self._initial.get(master, 0.0))
                q[self.at[name]] = factor * value + offset
        return q

    def named(self, q: np.ndarray) -> dict[str, float]:
        """Return positions by joint."""
        return {name: float(q[at]) for name, at in self.at.items()}

    def pose_of(self, q: np.ndarray, frame: str) -> RigidTransform:
        """Return where a link is."""
        self._plant.SetPositions(self._context, q)
        body = self._plant.GetBodyByName(frame)
        return self._plant.EvalBodyPoseInWorld(self._context, body)

    def jacobian(
        self, q: np.ndarray, link: str
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a link's turn and place, and its Jacobian: rows of turns first."""
        plant, context = self._plant, self._context
        plant.SetPositions(context, q)
        body, world = plant.GetBodyByName(link), plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, body.body_frame(), _ORIGIN, world, world
        )
        X = plant.EvalBodyPoseInWorld(context, body)
        return X.rotation().matrix(), X.translation(), J

    def screws(self, link: str) -> Screws:
        """Return the joints that carry a link."""
        above = reversed(joints_above(self._description.joints, link))
        at = [self.at[joint.name] for joint in above if joint.name in self.at]
        return Screws(self._plant, link, at)

    def chain(self, frame: str, joints: Collection[str] | None) -> _Chain:
        """Return the chain of a link, or raise InputError."""
        self.check_frame(frame)
        above = reversed(joints_above(self._description.joints, frame))
        carriers = [j.name for j in above if j.name in self.at]
        own = list(dict.fromkeys(self._masters[name][0] for name in carriers))
        if joints is not None:
            for name in joints:
                check_known("joint", name, self.at)
            own = [name for name in own if name in joints]
        if not own:
            which = "" if joints is None else f" of {quoted(joints) or 'none'}"
            raise InputError(
                f"no joint{which} moves link {frame!r}; expected one of those that "
                f"carry it: {quoted(carriers) or 'none'}"
            )
        key = (frame, tuple(own))
        if key not in self._chains:
            self._chains[key] = _Chain(self, frame, own)
        return self._chains[key]

    def reach(self, frame: str, joints: Sequence[str]) -> tuple[float, str]:
        """Return how far a link gets from the first joint that moves it [m]."""
        length, first = 0.0, joints[0]
        for joint in joints_above(self._description.joints, frame):
            if joint.type == "prismatic":
                r = self.ranges[joint.name]
                length += max(abs(r.lower), abs(r.upper))
            if self._masters.get(joint.name, ("",))[0] in joints:
                first = joint.name
        for joint in joints_above(self._description.joints, frame):
            if joint.name == first:
                break
            length += float(np.linalg.norm(joint.origin.position))
        return length, first

    def place_of(self, q: np.ndarray, joint: str) -> np.ndarray:
        """Return where a joint is in the world [m], shape (3,)."""
        self._plant.SetPositions(self._context, q)
        frame = self._plant.GetJointByName(joint).frame_on_parent()
        return np.array(frame.CalcPoseInWorld(self._context).translation())


_ORIGIN = np.zeros(3)

_known: "weakref.WeakKeyDictionary[Robot, _Kinematics]" = weakref.WeakKeyDictionary()


def _kinematics_of(robot: Robot) -> _Kinematics:
    check_type("robot", robot, Robot, "a Robot, as load_robot returns it")
    kinematics = _known.get(robot)
    if kinematics is None:
        kinematics = _known[robot] = _Kinematics(robot)
    return kinematics


def _in_words(length: float) -> str:
    return f"{length:.3g} m" if length >= 1.0 else f"{1e3 * length:.3g} mm"


def _no_solution(
    robot: Robot, chain: _Chain, target: _Target, best: _End, q: np.ndarray
) -> NoSolution:
    kinematics = _kinematics_of(robot)
    positions = chain.spread(q, best.values)
    away = float(np.linalg.norm(target.p - kinematics.place_of(q, chain.base)))
    counts = len(target.rows)
    is_far = target.is_beyond(kinematics.place_of(q, chain.base), chain.reach)
    limits = chain.at_limits(best.values)
    message = (
        f"no joint positions put {chain.frame!r} there; the best miss it by "
        f"{_in_words(best.position_error)} and {best.orientation_error:.3g} rad"
    )
    if target.is_met(best):
        message = f"the robot touches itself wherever {chain.frame!r} is there"
    elif is_far:
        message += (
            f"; it is out of reach: {away:.3g} m from joint {chain.base!r}, and "
            f"{chain.frame!r} gets {chain.reach:.3g} m far"
        )
    elif limits:
        message += f"; at their limits are {quoted(limits)}"
    if not (is_far or target.is_met(best)) and len(chain.joints) < counts:
        message += (
            f"; {counted(len(chain.joints), 'joint')} can't reach every pose: "
            "a mask says what of it counts"
        )
    return NoSolution(
        message,
        positions=kinematics.named(positions),
        position_error=best.position_error,
        orientation_error=best.orientation_error,
        at_limits=limits,
        is_out_of_reach=is_far,
    )
