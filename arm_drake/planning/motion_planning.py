"""Plans: motions of a group of joints that touch nothing, timed.

A straight line between joint positions is tried first. Where it isn't free, OMPL's
RRT-Connect looks for a way and shortens it, on edges that Drake checks in large steps.
Corners are rounded, Drake's Toppra finds the times within the limits of velocity,
acceleration and effort, and what comes of it is checked again before it is handed out,
at steps that bound how far any link moves. Where that finds a collision, corners become
sharper, then the search's steps smaller.
"""

import dataclasses as dc
import importlib
import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

from arm_drake.arrays import is_finite
from arm_drake.description.robot import Robot
from arm_drake.errors import (
    InputError,
    MissingExtraError,
    check_known,
    counted,
    first_names,
    suggest,
)
from arm_drake.importing import dataclass
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint
from arm_drake.output_files import unbroken
from arm_drake.planning.collisions import CollisionModel, collision_model
from arm_drake.planning.groups import (
    PlanningGroup,
    find_controller,
    find_group,
    find_mask,
    find_state,
)
from arm_drake.planning.inverse_kinematics import (
    complete_positions,
    follow_line,
    forward_kinematics,
    pose_error,
    solve_ik,
)
from arm_drake.planning.orientation_constraint import Tilt, find_tilt
from arm_drake.planning.setting import (
    PlanningError,
    PlanOptions,
    Running,
    Setting,
    find_setting,
)
from arm_drake.planning.surroundings import PlacedShape
from arm_drake.planning.timing import (
    Mover,
    Samples,
    default_scaling,
    deviation,
    motion_limits,
    round_corners,
    time_path,
)
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.plant.payloads import Payload
from arm_drake.plant.plant import read_pose
from arm_drake.worlds.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    import arm_drake

# What draws plans; by name, as it stands above.
_PLOT, _ANIMATE = "arm_drake.visualization.plots", "arm_drake.notebook"

# A pose is a transform, or x, y, z [m], roll, pitch, yaw [rad].
Target: TypeAlias = str | Mapping[str, float] | RigidTransform | Sequence[float]

# The search's steps, in those of the last check; one after the other. What is free at
# the last check's steps comes closer than the padding between them at times: then it is
# another way that is looked for.
_COARSER = (10.0, 3.0, 1.0, 1.0, 1.0, 1.0)

# Steps at which rounded corners are looked at before a motion is timed, in those of the
# last check.
_ACROSS = 5.0

# How far from a corner a path leaves its lines, in units of the path's parameter: the
# time that a joint needs at full speed [s].
_ROUNDINGS = (0.2, 0.05, 0.01)

# The same, and how much slower it is made before limits of jerk are kept: what takes it
# off the path falls with the sixth power of that.
_WITH_JERK = ((0.2, 1.0), (0.05, 1.5), (0.01, 2.2), (0.01, 5.0))

# How far joints are off a straight line at most, where their jerk is limited [rad].
_OFF_LINE = 2e-4

# Goals of a pose that a search heads for at once.
_GOALS = 8

# Steps of a straight line [m], [rad].
_LINE_STEP, _LINE_TURN = 5e-3, 0.02

# So many shapes of a world are told of.
_MANY = 2000

# Points on which the clearance is measured, and how far it is looked for [m].
_CLEARANCE_POINTS, _FAR = 40, 0.3


@dataclass(frozen=True)
class Plan:
    """A motion of a group of joints that touches nothing."""

    # What a trajectory controller takes: positions, velocities and accelerations.
    trajectory: JointTrajectory

    # Joint positions of the corners [rad] or [m], shape (m, n) for n joints, before
    # these were rounded.
    path: np.ndarray

    # [s].
    duration: float

    # How near what moves comes to anything else on the way [m], at up to 80 points of
    # the trajectory. It isn't looked for beyond 0.3 m: that means 0.3 m or more.
    clearance: float

    # The group that moves.
    group: PlanningGroup

    # The trajectory controller that has the group's joints, if there is one.
    controller: str | None

    # How long it took to find, without the model of what can collide [s].
    planning_time: float

    # What was planned for: the robot, the link that poses are for, where all joints are
    # at the start [rad] or [m], and what is around it: a world, and things that stand
    # in it or are held.
    robot: Robot = dc.field(repr=False)
    frame: str = dc.field(repr=False)
    start: Mapping[str, float] = dc.field(repr=False)
    world: World = dc.field(repr=False)
    things: tuple[PlacedShape, ...] = dc.field(default=(), repr=False)

    # What should be known of it.
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the line about it, in brackets: its points would fill pages."""
        return f"<Plan of {self.describe()}>"

    def positions_at(self, index: int) -> dict[str, float]:
        """Return where all joints are at a point of the trajectory [rad] or [m]."""
        names = self.trajectory.joint_names
        q = self.trajectory.points[index].positions
        return complete_positions(
            self.robot,
            {
                **_independent(self.robot, self.start),
                **dict(zip(names, q, strict=True)),
            },
        )

    def plot(self, path: str | Path | None = None) -> "Figure":
        """Return a picture, which a notebook shows: joints over time, the link's way.

        Args:
            path: `.png`, `.svg` or `.pdf` file to write, too; None writes none.

        Raises:
            OutputError: If the picture can't be written, or its type is unknown.
        """
        draw: Callable[..., Figure] = importlib.import_module(_PLOT).draw_plan
        return draw(self, None if path is None else Path(path))

    def animate(self, *, loop: bool = True) -> "arm_drake.Recording":
        """Return a page that plays the plan in the browser, which a notebook shows.

        Args:
            loop: Whether it begins anew at its end.
        """
        module = importlib.import_module(_ANIMATE)
        record: Callable[..., arm_drake.Recording] = module.record_plan
        return record(self, loop=loop)

    def describe(self) -> str:
        """Return a line about it, for people."""
        return (
            f"group {self.group.name}: {self.duration:.2f} s, "
            f"{counted(len(self.path) - 2, 'corner')}, at least "
            f"{1e3 * self.clearance:.1f} mm from everything; "
            f"found in {self.planning_time:.2f} s"
        )

    @property
    def end(self) -> dict[str, float]:
        """Joint positions at the end [rad] or [m] by name."""
        names = self.trajectory.joint_names
        return dict(zip(names, self.trajectory.points[-1].positions, strict=True))


def plan(robot: Robot | Running, to: Target | Sequence[Target], **options: Any) -> Plan:
    """Return a motion of a group of joints to a goal that collides with nothing.

    The same arguments give the same plan, whatever the machine, unless a `time_limit`
    ends the search. A way around something needs the extra `planning`; free and
    straight lines don't.

    Args:
        robot: The robot; its base is at its pose and doesn't move. Or a simulation:
            its robot starts from where it is, at rest, and what is around it stands
            where it is now, other robots too.
        to: The name of a state of the group; joint positions [rad] or [m] by name; a
            pose of the frame in the world, as that of `solve_ik`; or a list of these,
            to be passed one after the other.
        options: The fields of `PlanOptions`.

    Raises:
        PlanningError: If the start or a goal is in collision, or no way was found.
        NoSolution: If a pose can't be reached.
        InputError: If an argument can't be used.
        MissingExtraError: If the extra is needed and isn't installed.
    """
    names = [field.name for field in dc.fields(PlanOptions)]
    for name in options:
        check_known("option", name, names, argument="plan")
    chosen = PlanOptions(**options)
    return plan_in(find_setting(robot, chosen), to, chosen)


def check_positions(
    robot: Robot | Running, positions: Mapping[str, float], **options: Any
) -> None:
    """Raise PlanningError if a robot collides or is beyond limits somewhere.

    Args:
        robot: The robot or simulation, as that of `plan`.
        positions: Positions of joints [rad] or [m]; the others are where they are.
        options: The fields of `PlanOptions`.

    Raises:
        InputError: If an argument can't be used.
    """
    chosen = PlanOptions(**{**options, "start": positions})
    problem = _pose_problem(find_setting(robot, chosen), chosen)
    problem.check_limits(problem.start, "goal")
    if not problem.model.is_free_somehow(problem.start):
        words = _describe_collisions(problem.model, problem.start)
        raise PlanningError(f"in collision: {words}")


def plan_in(
    setting: Setting, to: Target | Sequence[Target], chosen: PlanOptions
) -> Plan:
    """Return a plan, as `plan` does, also in another process."""
    return _solve(_pose_problem(setting, chosen), _list_targets(to))


def _pose_problem(setting: Setting, chosen: PlanOptions) -> "_Problem":
    """Return what is planned for, with the model of what can collide."""
    group = find_group(setting.robot, chosen.group)
    links = setting.robot.description.links
    if isinstance(chosen.frame, str) and chosen.frame not in links:
        raise InputError(f"no link {chosen.frame!r}; {suggest(chosen.frame, links)}")
    model = collision_model(
        setting.robot,
        group.joints,
        setting.world,
        padding=chosen.padding,
        positions=setting.positions,
        things=setting.things,
    )
    problem = _Problem(
        setting.robot,
        group,
        chosen.frame or group.tip,
        model,
        setting.positions,
        setting.payloads,
        setting.world,
        setting.things,
        chosen,
    )
    if chosen.path_constraint is None:
        return problem
    tilt = find_tilt(chosen.path_constraint, model, problem.start)
    return problem._replace(tilt=tilt)


def _solve(problem: "_Problem", targets: Sequence[Target]) -> Plan:
    """Return the plan that passes goals one after the other."""
    began = time.monotonic()
    problem.check_start()
    legs, x = [], problem.start
    for target in targets:
        legs.append(_plan_leg(problem, x, target))
        x = legs[-1].path[-1]
    samples = _join([leg.samples for leg in legs])
    every = max(1, len(samples.t) // _CLEARANCE_POINTS)
    return Plan(
        trajectory=_message(problem.group.joints, samples),
        path=np.vstack([legs[0].path[:1], *(leg.path[1:] for leg in legs)]),
        duration=float(samples.t[-1]),
        clearance=min(_FAR, problem.model.clearance(samples.q[::every], _FAR)),
        group=problem.group,
        controller=find_controller(problem.robot, problem.group),
        planning_time=time.monotonic() - began,
        warnings=tuple(_warnings(problem, legs)),
        robot=problem.robot,
        frame=problem.frame,
        start=problem.positions,
        world=problem.world,
        things=problem.things,
    )


def _warnings(problem: "_Problem", legs: Sequence["_Leg"]) -> Iterator[str]:
    """Yield what should be known of a plan."""
    if not problem.model.has_shapes:
        yield "nothing that moves has a collision shape: whatever is there is passed"
    if (count := problem.model.count_around) > _MANY:
        yield (
            f"{count:,} collision shapes of the world are within reach: what a plan "
            "takes grows with their number"
        )
    for link in problem.model.unpadded:
        yield f"{link!r} is always closer to the world than the padding: it has none"
    if not all(leg.keeps_effort_limits for leg in legs):
        yield "the joints' limits of effort can't be kept at the speed of the plan"


class _Leg(NamedTuple):
    """The way to one goal."""

    path: np.ndarray
    samples: Samples
    keeps_effort_limits: bool


class _Problem(NamedTuple):
    """Planning problem."""

    robot: Robot
    group: PlanningGroup
    frame: str
    model: CollisionModel
    positions: dict[str, float]
    payloads: Mapping[str, Payload]
    world: World
    things: tuple[PlacedShape, ...]
    options: PlanOptions
    tilt: Tilt | None = None

    @property
    def start(self) -> np.ndarray:
        """Start positions of the group's joints."""
        return np.array([self.positions[name] for name in self.group.joints])

    def named(self, x: np.ndarray) -> dict[str, float]:
        """Return positions of the robot's independent joints."""
        values = zip(self.group.joints, map(float, x), strict=True)
        return {**_independent(self.robot, self.positions), **dict(values)}

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and upper ends of the joints; infinite where they turn."""
        ranges = {r.name: r for r in joint_ranges(self.robot.description)}
        chosen = [ranges[name] for name in self.group.joints]
        lower = [-math.inf if r.wraps else r.lower for r in chosen]
        upper = [math.inf if r.wraps else r.upper for r in chosen]
        return np.array(lower), np.array(upper)

    @property
    def mask(self) -> Sequence[bool]:
        """Constrained axes of poses."""
        return find_mask(self.group, self.options.mask)

    @property
    def has_jerk_limits(self) -> bool:
        """Whether the jerk of any joint of the group is limited."""
        limits = motion_limits(self.robot)
        return any(math.isfinite(limits[name].jerk) for name in self.group.joints)

    def time(
        self, path: np.ndarray, is_free: Callable[[np.ndarray], bool] = lambda _: True
    ) -> Iterator[tuple[Samples, bool]]:
        """Yield motions ever nearer to a path, and whether efforts keep limits.

        Those are left out of whose corners one isn't free: its points have the shape
        (k, n).
        """
        mover = Mover(self.robot, self.group.joints, self.positions, self.payloads)
        chosen = self.options.velocity_scaling, self.options.acceleration_scaling
        by_default = default_scaling(self.robot)
        velocity, acceleration = (
            one if each is None else each
            for each, one in zip(chosen, by_default, strict=True)
        )
        slower = _WITH_JERK if self.has_jerk_limits else ((r, 1.0) for r in _ROUNDINGS)
        for rounding, stretch in slower:
            scaling = velocity, acceleration
            if not all(map(is_free, round_corners(mover, path, rounding, scaling))):
                continue
            found = time_path(mover, path, rounding, scaling, stretch)
            if found is None:
                raise PlanningError(
                    "no times were found for the path within the joints' limits"
                )
            yield found

    def check_start(self) -> None:
        """Raise PlanningError if nothing can start here."""
        model = self.model
        self.check_limits(self.start, "start")
        if not model.is_free_somehow(self.start):
            words = _describe_collisions(model, self.start)
            bodies = dict.fromkeys(self.options.attached.values())
            words += "".join(
                f"; ignore=[{name!r}] leaves it out until it is lifted"
                for name in bodies
                if repr(name) in words
            )
            raise PlanningError(f"the start is in collision: {words}")
        if self.tilt is not None and not self.tilt.is_met(self.start):
            raise PlanningError(f"the start: {self.tilt.describe(self.start)}")

    def first_fault(self, path: np.ndarray) -> int | None:
        """Return the first segment that collides or leaves the cone of a constraint."""
        found = [self.model.first_collision(path)]
        found += [] if self.tilt is None else [self.tilt.first_exit(path)]
        return min((at for at in found if at is not None), default=None)

    def describe(self, x: np.ndarray) -> list[str]:
        """Return what is wrong at values of the joints, in words."""
        words = self.model.describe(x)
        if self.tilt is not None and not self.tilt.is_met(x):
            words.append(self.tilt.describe(x))
        return words

    def is_edge_allowed(self, x: np.ndarray, y: np.ndarray, step: float) -> bool:
        """Return whether a line is free, checked at steps, and stays in the cone."""
        if not self.model.is_edge_free(x, y, step):
            return False
        return self.tilt is None or self.tilt.first_exit(np.array([x, y])) is None

    def check_limits(self, x: np.ndarray, what: str) -> None:
        """Raise PlanningError if joints are beyond their limits."""
        lower, upper = self.limits()
        for name, value, low, high in zip(
            self.group.joints, x, lower, upper, strict=True
        ):
            if not low - 1e-9 <= value <= high + 1e-9:
                raise PlanningError(
                    f"{what}: joint {name!r} is at {value:.6g}, out of its limits; "
                    f"expected {low:.6g} to {high:.6g}"
                )


def _plan_leg(problem: _Problem, start: np.ndarray, target: Target) -> _Leg:
    """Return the way to one goal."""
    if problem.options.straight:
        return _plan_line(problem, start, target)
    goals = _find_goals(problem, start, target)
    limit = problem.options.time_limit
    deadline = None if limit is None else time.monotonic() + limit
    path = np.array([start])

    def is_free(corner: np.ndarray) -> bool:
        across = _ACROSS * problem.model.fine_step
        edges = itertools.pairwise(corner)
        return all(problem.model.is_edge_free(x, y, across) for x, y in edges)

    for number, coarser in enumerate(_COARSER):
        step = coarser * problem.model.fine_step
        is_finer = number > 0 and coarser < _COARSER[number - 1]
        # What of the last way is free with finer steps, too, is kept.
        edges = [(x, [y]) for x, y in itertools.pairwise(path)]
        pieces = edges if is_finer else [(start, goals)]
        found = [
            _find_path(problem, begin, ends, step, deadline, number)
            for begin, ends in pieces
        ]
        path = np.vstack([found[0][:1], *(piece[1:] for piece in found)])
        for samples, keeps in problem.time(path, is_free):
            if problem.first_fault(samples.q) is None:
                return _Leg(path, samples, keeps)
            if problem.first_fault(path) is not None:
                break  # Sharper corners are no help.
    tilts = "" if problem.tilt is None else " or tilts more than it may"
    raise PlanningError(
        f"no plan: each of {len(_COARSER)} ways that were found comes closer than the "
        f"padding{tilts} between the search's checks; a larger padding may help"
    )


def _plan_line(problem: _Problem, start: np.ndarray, target: Target) -> _Leg:
    """Return the way to one goal on a straight line."""
    path, at = _straight_path(problem, start, target), None
    for samples, keeps in problem.time(path):
        if problem.has_jerk_limits and deviation(path, samples.q) > _OFF_LINE:
            continue
        at = problem.first_fault(samples.q)
        if at is None:
            return _Leg(path, samples, keeps)
    if at is None:
        raise PlanningError(
            "the straight line can't be kept within the joints' limits of jerk; a "
            "smaller velocity_scaling may help"
        )
    part = float(samples.t[at] / samples.t[-1])
    after = samples.q[at : at + 2]
    where = [words for x in after for words in problem.describe(x)]
    raise PlanningError(
        f"the straight line is free for {100 * part:.0f} % of its time; then "
        f"{', '.join(where[:3]) or 'links come too close'}",
        fraction=part,
    )


def _find_goals(
    problem: _Problem, start: np.ndarray, target: Target
) -> list[np.ndarray]:
    """Return joint positions of a goal that are free, the nearest first."""
    if isinstance(target, str | Mapping):
        candidates = [_find_positions(problem, start, target)]
    else:
        candidates = _find_solutions(problem, start, read_pose(target))
    allowed = [x for x in candidates if problem.tilt is None or problem.tilt.is_met(x)]
    if not allowed:
        assert problem.tilt is not None
        raise PlanningError(f"the goal: {problem.tilt.describe(candidates[0])}")
    free = [x for x in allowed if problem.model.is_free(x)]
    if not free:
        what = "the goal is" if len(allowed) == 1 else "all solutions found are"
        words = _describe_collisions(problem.model, allowed[0])
        raise PlanningError(f"{what} in collision: {words}")
    return free[:_GOALS]


def _find_positions(
    problem: _Problem, start: np.ndarray, target: str | Mapping[str, float]
) -> np.ndarray:
    """Return the joint positions of a state, or the start's with those of a mapping."""
    joints = problem.group.joints
    positions = find_state(problem.group, target) if isinstance(target, str) else target
    if not positions:
        raise InputError("to: expected the position of a joint at least, got {}")
    x = start.copy()
    for name, value in positions.items():
        if name not in joints:
            raise InputError(
                f"to: joint {name!r} is not of group {problem.group.name!r}, which "
                f"has {', '.join(joints)}"
            )
        if not is_finite(value):
            raise InputError(
                f"to: joint {name!r}: expected a finite number, got {value!r}"
            )
        x[joints.index(name)] = value
    problem.check_limits(x, "goal")
    return x


def _find_solutions(
    problem: _Problem, start: np.ndarray, X_WG: RigidTransform
) -> list[np.ndarray]:
    """Return joint positions that put the frame at a pose, the nearest first."""
    joints, mask, tilt = problem.group.joints, problem.mask, problem.tilt
    solution = solve_ik(
        problem.robot,
        problem.frame,
        X_WG,
        seed=problem.named(start),
        group=joints,
        mask=mask,
        all_solutions=True,
    )
    found = [
        np.array([each[name] for name in joints])
        for each in (solution.positions, *solution.others)
    ]
    if tilt is None or all(mask) or any(map(tilt.is_met, found)):
        return found
    # What of the pose is free has to serve the constraint.
    miss = pose_error(problem.robot, problem.frame, X_WG, mask)

    def error(x: np.ndarray) -> np.ndarray:
        return miss(problem.named(x))

    settled = (tilt.settle(x, error, problem.limits()) for x in found)
    close = itertools.islice((x for x in settled if x is not None), _GOALS)
    return [*close] or found


def _straight_path(problem: _Problem, start: np.ndarray, target: Target) -> np.ndarray:
    """Return joint positions on a straight line to a pose."""
    if isinstance(target, str | Mapping):
        goal = _find_goals(problem, start, target)[0]
        X_WG = forward_kinematics(problem.robot, problem.named(goal), problem.frame)
    else:
        X_WG = read_pose(target)
    path, fraction = follow_line(
        problem.robot,
        problem.frame,
        X_WG,
        seed=problem.named(start),
        group=problem.group.joints,
        mask=problem.mask,
        step=(_LINE_STEP, _LINE_TURN),
    )
    if fraction < 1.0:
        raise PlanningError(
            f"{problem.frame!r} gets along {100 * fraction:.0f} % of the straight "
            "line; then no joint positions nearby continue it",
            fraction=fraction,
        )
    return path


def _find_path(
    problem: _Problem,
    start: np.ndarray,
    goals: Sequence[np.ndarray],
    step: float,
    deadline: float | None,
    number: int,
) -> np.ndarray:
    """Return the corners of a way to one of the goals, checked at steps."""
    for goal in goals:
        if problem.is_edge_allowed(start, goal, step):
            return np.array([start, goal])
    try:
        with unbroken():  # Else Ctrl-C is an ImportError.
            from arm_drake.planning.search import ITERATIONS, find_way
    except ImportError:
        raise MissingExtraError("a plan around something", "planning") from None
    lower, upper = problem.limits()
    should_stop = problem.options.should_stop

    def is_over() -> bool:
        late = deadline is not None and time.monotonic() > deadline
        return late or (should_stop is not None and should_stop())

    ends = np.array([start, *goals])
    lower = np.where(np.isfinite(lower), lower, ends.min(axis=0) - math.pi)
    upper = np.where(np.isfinite(upper), upper, ends.max(axis=0) + math.pi)
    way = find_way(
        problem.model,
        start,
        goals,
        (np.minimum(lower, ends.min(axis=0)), np.maximum(upper, ends.max(axis=0))),
        step=step,
        is_over=is_over,
        is_timed=deadline is not None,
        seed=1 + int(problem.options.seed) + 7919 * number,
        tilt=None if problem.tilt is None else problem.tilt.widened([start, *goals]),
    )
    if way is None and should_stop is not None and should_stop():
        raise PlanningError("no plan: the search was stopped")
    if way is None:
        ended, more = "in time", "a longer time_limit"
        if deadline is None:
            ended, more = (
                f"in {ITERATIONS} iterations",
                "a time_limit, to go on with it,",
            )
        which = "the goal" if len(goals) == 1 else f"any of {len(goals)} goals"
        raise PlanningError(
            f"no plan {ended}: RRT-Connect found no way from the start to {which}; "
            f"{more} or a smaller padding may help"
        )
    return way


def _join(legs: Sequence[Samples]) -> Samples:
    """Return motions one after the other; each begins where the last one ends."""
    parts, end = [legs[0]], legs[0].t[-1]
    for leg in legs[1:]:
        parts.append(Samples(leg.t[1:] + end, leg.q[1:], leg.v[1:], leg.a[1:]))
        end += leg.t[-1]
    return Samples(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def _message(joints: Sequence[str], samples: Samples) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(
            positions=tuple(map(float, q)),
            velocities=tuple(map(float, v)),
            accelerations=tuple(map(float, a)),
            time_from_start=float(t),  # type: ignore[arg-type]
        )
        for t, q, v, a in zip(*samples, strict=True)
    ]
    return JointTrajectory(joint_names=tuple(joints), points=tuple(points))


def _list_targets(to: Any) -> list[Target]:
    """Return the goals; six numbers are a pose, not six goals."""
    if isinstance(to, str | Mapping | RigidTransform):
        return [to]
    targets = list(to) if isinstance(to, Iterable) else []
    if targets and all(isinstance(t, int | float | np.number) for t in targets):
        return [targets]
    if not targets:
        raise InputError("to: expected a state, joint positions, a pose or a list")
    return targets


def _independent(robot: Robot, positions: Mapping[str, float]) -> dict[str, float]:
    joints = robot.description.independent_joints
    return {joint.name: positions[joint.name] for joint in joints}


def _describe_collisions(model: CollisionModel, x: np.ndarray) -> str:
    """Return what collides at joint positions, in words."""
    return first_names(model.describe(x), 3) or "links come closer than the padding"
