"""Requests in task space: positions for a pose, motions to a pose, and the way home.

Names, fields and meaning are those of the nodes of the Centauri's repository, which has
`/centauri/kinematics`, `/centauri/trajectory` and `/centauri/home`. Here any robot has
them, by its own name. Plans for arms without a trajectory controller go through here,
too: position by position.
"""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, SimulationError, check_known
from arm_drake.importing import dataclass
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint, Message
from arm_drake.messages.base import to_message
from arm_drake.planning.groups import (
    PlanningGroup,
    find_controller,
    find_group,
    find_position_controller,
    find_receiver,
    find_state,
)
from arm_drake.planning.inverse_kinematics import NoSolution, solve_ik
from arm_drake.planning.orientation_constraint import OrientationConstraint
from arm_drake.planning.timing import motion_limits
from arm_drake.simulation.clients import ControllerHandle, TopicHandle
from arm_drake.simulation.mailbox import GoalHandle
from arm_drake.simulation.motion import PlanTo
from arm_drake.simulation.playback import Runner

if TYPE_CHECKING:
    from arm_drake.planning.motion_planning import Plan

# What counts of the pose: these are points.
_POINT = (True, True, True, False, False, False)

# The largest speed of the polynomial of degree 5 from 0 to 1 in the time 1.
_TOP_SPEED = 1.875

# Time between two commands [s]; a move takes no less than the second one.
_STEP, _SHORTEST, _LONGEST = 0.01, 0.01, 1e4

# How far joints may be from where a plan begins, 0.01 in MoveIt, but here it begins
# within limits, also where a joint is a little beyond; and from its end [rad], [m].
_AT_START, _AT_END = 0.03, 0.1

# A way along which the robot doesn't go too fast, though rounding says so.
_ROUNDING = 1.0 + 1e-6


@dataclass(frozen=True, eq=False)
class KinematicGoal(Message):
    """Goal point of an arm's last link, in the frame that carries the arm."""

    # [m].
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(frozen=True, eq=False)
class TrajectoryGoal(Message):
    """Goal point of an arm's last link, and the time of the way."""

    # [m].
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    # [s].
    time_range: float = 0.0


@dataclass(frozen=True, eq=False)
class SetBool(Message):
    """Boolean request (`std_srvs`)."""

    data: bool = False


Request: TypeAlias = KinematicGoal | TrajectoryGoal | SetBool


class KinematicResult(NamedTuple):
    """Joint positions for a point."""

    # [rad] or [m], in the order of the group.
    q_list: tuple[float, ...]

    # What the point is missed by [m].
    error: float

    # Tries of the search.
    iters: int

    success: bool


class SetBoolResult(NamedTuple):
    """Result of a request."""

    success: bool
    message: str


def check_plan(robot: Robot, message: PlanTo) -> str:
    """Return the controller that takes a plan, or raise InputError if there is none."""
    group = find_group(robot, message.options.get("group"))
    for state in message.to:
        if isinstance(state, str):
            find_state(group, state)
    constraint = plan_options(message).get("path_constraint")
    if constraint is not None:
        links = robot.description.links
        check_known("link", constraint.link_name, links, argument="upright")
    return find_receiver(robot, group)


def plan_options(message: PlanTo) -> dict[str, Any]:
    """Return the options of `plan` that a step of a motion gives."""
    options = dict(message.options)
    upright = options.pop("upright", None)
    if upright is not None:
        options["path_constraint"] = OrientationConstraint(*upright)
    return options


def send_planned(simulation: Runner, plan: "Plan", where: str) -> GoalHandle | None:
    """Send a plan to the controller of its group, as Simulation.send_planned."""
    manager = simulation.directory.manager(plan.robot.name)
    name = find_receiver(manager.robot, plan.group)
    if words := _find_away(simulation, plan, plan.start, _AT_START):
        raise InputError(
            f"the plan doesn't begin where the robot is: {words}; send it when the "
            "robot is there, or plan from where it is"
        )
    handle = simulation.controller(f"{manager.prefix}{name}")
    if find_controller(manager.robot, plan.group) is not None:
        return handle.send_goal(plan.trajectory, where=where)
    points = plan.trajectory.points
    times = [point.time_from_start.to_seconds() for point in points]
    rows = np.array([point.positions for point in points])
    _send_rows(simulation, handle, manager.robot, plan.group, times, rows)
    return None


def check_arrival(simulation: Runner, plan: "Plan") -> None:
    """Raise SimulationError if a robot isn't where a plan ends."""
    if words := _find_away(simulation, plan, plan.end, _AT_END):
        raise SimulationError(
            f"the plan was executed, but its end isn't reached: {words}; something may "
            "be in the way, or heavier than the robot holds"
        )


def _find_away(
    simulation: Runner, plan: "Plan", positions: Mapping[str, float], most: float
) -> str:
    """Return which joint of a plan is away from positions, in words; else nothing."""
    state = simulation.joint_states(plan.robot.name)
    measured = dict(zip(state.name, state.position, strict=True))
    for name in plan.group.joints:
        if not abs(measured[name] - positions[name]) <= most:
            where = f"is at {measured[name]:.3g}, not at {positions[name]:.3g}"
            return f"joint {name!r} {where} [rad or m]"
    return ""


def _send_rows(
    simulation: Runner,
    handle: ControllerHandle,
    robot: Robot,
    group: PlanningGroup,
    times: Sequence[float],
    rows: np.ndarray,
) -> None:
    """Send positions to a controller that takes them, in its own order, from now."""
    forward = find_position_controller(robot, group)
    assert forward is not None
    states = {row.name: row.state for row in simulation.list_controllers()}
    if (state := states[handle.name]) != "active":
        text = "it takes no plan until it is active"
        raise InputError(f"controller {handle.name!r} is {state}; {text}")
    order = [group.joints.index(name) for name in forward[1]]
    now = simulation.time
    handle.schedule_commands(
        (now + t, row[order].tolist()) for t, row in zip(times, rows, strict=True)
    )


class TaskSpaceRequest(TopicHandle):
    """Request to a robot by name, as a topic is published on."""

    def __init__(self, simulation: Runner, robot: str, kind: str) -> None:
        """Create it; `Simulation.topic` does that."""
        self.name = f"/{robot}/{kind}"
        self._simulation, self._kind = simulation, kind
        self._manager = simulation.directory.manager(robot)
        self._robot = self._manager.robot
        self._group = find_group(self._robot, None)
        receiver = find_receiver(self._robot, self._group)
        self._controller = f"{self._manager.prefix}{receiver}"

    @property
    def controllers(self) -> tuple[str, ...]:
        """The controller that moves the arm."""
        return (self._controller,)

    def check(self, data: Any) -> None:
        """Raise InputError if it is no such request."""
        self._read(data)

    def publish(self, data: Any, *, where: str = "") -> None:
        """Send a request; one that can't be met is among `Simulation.rejected`.

        That is a request, or a mapping of its fields; of `home` also a bool.
        """
        message = self._read(data)
        try:
            result = self.call(message)
        except InputError as error:
            self._simulation.mailbox.reject(message, str(error), where)
            return
        if isinstance(result, KinematicResult) and not result.success:
            reason = f"the point is missed by {result.error:.3g} m, at best"
            self._simulation.mailbox.reject(message, f"{self.name}: {reason}", where)

    def call(self, data: Any) -> KinematicResult | SetBoolResult:
        """Ask for something as by `publish`, and return what the service would.

        A point that can't be reached moves nothing.
        """
        message = self._read(data)
        if isinstance(message, SetBool):
            if not message.data:
                return SetBoolResult(False, "Stay at the same configuration")
            state = find_state(self._group, "home")
            self._go(np.array([state[name] for name in self._group.joints]), None)
            return SetBoolResult(True, "Change to the home configuration")
        found = self._solve([message.x, message.y, message.z])
        if found.success:
            time = message.time_range if isinstance(message, TrajectoryGoal) else None
            self._go(np.array(found.q_list), time)
        return found

    def value(self) -> Any:
        """Raise InputError: a request has no value."""
        raise InputError(f"nobody publishes on {self.name!r}; it takes requests")

    def _read(self, data: Any) -> Request:
        kind = _KINDS[self._kind]
        if isinstance(data, kind):
            message: Any = data
        elif kind is SetBool and isinstance(data, bool):
            message = SetBool(data)
        elif isinstance(data, Mapping):
            try:
                message = to_message(data, kind, f"{self.name}")
            except ValueError as error:
                raise InputError(str(error)) from None
        else:
            names = ", ".join(field.name for field in dc.fields(kind))
            raise InputError(f"{self.name}: expected {{{names}}}, got {data!r}")
        for field in dc.fields(kind):
            value, place = getattr(message, field.name), f"{self.name}: {field.name}"
            if kind is SetBool and not isinstance(value, bool):
                raise InputError(f"{place}: expected true or false, got {value!r}")
            if not (isinstance(value, int | float) and math.isfinite(value)):
                raise InputError(f"{place}: expected a finite number, got {value!r}")
            if field.name == "time_range" and not _SHORTEST <= value <= _LONGEST:
                expected = f"expected {_SHORTEST} to {_LONGEST:g} s"
                raise InputError(f"{place}: {expected}, got {value}")
        found: Request = message
        return found

    def _positions(self) -> dict[str, float]:
        state = self._simulation.joint_states(self._robot.name)
        return dict(zip(state.name, state.position, strict=True))

    def _solve(self, point: Sequence[float]) -> KinematicResult:
        """Return joint positions near the present ones that reach a point."""
        joints = {j.name: j for j in self._robot.description.joints}
        members = self._group.joints
        own = {j.name for j in joints.values() if j.mimic is None}
        seed = {n: q for n, q in self._positions().items() if n in own}
        carrier, last = joints[members[0]].parent, joints[members[-1]].child
        X_WB = self._robot.forward_kinematics(seed, carrier)
        X_WG = RigidTransform(X_WB @ np.array(point, dtype=float))
        try:
            found = solve_ik(
                self._robot, last, X_WG, seed=seed, group=members, mask=_POINT
            )
        except NoSolution as error:
            best = tuple(float(error.positions[name]) for name in members)
            return KinematicResult(best, float(error.position_error), 0, False)
        q = tuple(float(found.positions[name]) for name in members)
        return KinematicResult(q, float(found.position_error), found.tries, True)

    def _go(self, goal: np.ndarray, time: float | None) -> None:
        """Send the arm to joint positions; in a time [s], or at once."""
        names, robot = self._group.joints, self._robot
        positions, limits = self._positions(), motion_limits(robot)
        start = np.array([positions[name] for name in names])
        top = np.array([limits[name].velocity for name in names])
        needed = float(np.max(_TOP_SPEED * np.abs(goal - start) / top))
        if time is not None and time * _ROUNDING < needed:
            raise InputError(
                f"{self.name}: time_range: expected at least {needed:.3g} s, which "
                f"the joints' limits of speed ask for; got {time:g}"
            )
        handle = self._simulation.controller(self._controller)
        if find_controller(robot, self._group) is not None:
            point = JointTrajectoryPoint(
                positions=tuple(goal.tolist()),
                velocities=(0.0,) * len(names),
                accelerations=(0.0,) * len(names),
                time_from_start=max(needed, _SHORTEST) if time is None else time,  # type: ignore[arg-type]
            )
            handle.send_trajectory(JointTrajectory(joint_names=names, points=(point,)))
            return
        if time is None:
            _send_rows(self._simulation, handle, robot, self._group, [0.0], goal[None])
            return
        t = np.append(np.arange(0.0, time, _STEP), time)
        s = t / time
        part = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rows = start + part[:, np.newaxis] * (goal - start)
        _send_rows(self._simulation, handle, robot, self._group, t.tolist(), rows)


_KINDS: Mapping[str, type[Any]] = {
    "kinematics": KinematicGoal,
    "trajectory": TrajectoryGoal,
    "home": SetBool,
}


def find_request(simulation: Runner, name: str) -> TaskSpaceRequest | None:
    """Return a robot's request of a name, None if it has none."""
    robot, _, kind = name.strip("/").rpartition("/")
    if robot not in simulation.directory.managers:
        return None
    return TaskSpaceRequest(simulation, robot, kind)
