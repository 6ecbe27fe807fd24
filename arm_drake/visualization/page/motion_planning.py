"""The panel's part for planned motions: RViz's MotionPlanning.

A goal is a named state, or what the sliders of a pose say; a ghost stands where it is,
red where it collides or can't be. A plan is played by a second ghost before the robot
executes it.
"""

import dataclasses as dc
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from pydrake.geometry import Rgba
from pydrake.math import RigidTransform

from arm_drake.arrays import is_finite
from arm_drake.description.joints import last_master, links_on
from arm_drake.description.robot import Robot
from arm_drake.errors import ArmDrakeError, InputError, check_known
from arm_drake.planning.groups import PlanningGroup, find_state, planning_groups
from arm_drake.planning.orientation_constraint import OrientationConstraint
from arm_drake.plant.plant import pose_of, transform_of
from arm_drake.simulation.mailbox import GoalHandle
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.ghost import Ghost
from arm_drake.visualization.link_drawings import draw_triad
from arm_drake.visualization.page.parts import Drawn, Viewer
from arm_drake.visualization.page.scene import Scene, WidgetEvent
from arm_drake.visualization.page.widgets import (
    Button,
    Buttons,
    Choice,
    Section,
    Slider,
    Text,
    Toggle,
    Widget,
)

if TYPE_CHECKING:
    from arm_drake.planning.motion_planning import Plan

GOAL_COLOR, WRONG_COLOR, PLAN_COLOR = (1.0, 0.55, 0.0), (0.9, 0.0, 0.0), (0.1, 0.7, 0.2)

TRIAD_PATH, TRAIL_PATH = "/drake/goal", "/drake/plan"

# What is chosen where a goal has no name.
_POSE = "as the sliders say"

# The pose's numbers: name, unit.
_NUMBERS = (
    ("x", "m"),
    ("y", "m"),
    ("z", "m"),
    ("roll", "rad"),
    ("pitch", "rad"),
    ("yaw", "rad"),
)

# How much further than the link gets the sliders go, and a triad's part of it.
_ROOM, _TRIAD = 1.1, 0.12

# How often a search looks for a click [s].
_LOOK_PERIOD = 0.05

_TRAIL_WIDTH = 4.0

# A goal that can't be for longer than this is looked for no further [s].
_TIME_LIMIT = 5.0

# How far the frame may tilt where it is kept upright [rad].
_UPRIGHT = 0.1


class PlanningHost(Protocol):
    """Host of a planning panel: a viewed robot, or the robots of a simulation."""

    @property
    def robots(self) -> Mapping[str, Robot]:
        """The robots by name."""

    def positions(self, robot: str) -> Mapping[str, float]:
        """Return where a robot's joints are [rad] or [m]."""

    def base_pose(self, robot: str) -> RigidTransform | None:
        """Return where a base is that isn't where the robot is loaded."""

    def make_ghost(
        self, robot: str, name: str, color: tuple[float, float, float]
    ) -> Ghost:
        """Return a transparent copy of a robot."""

    def planned(self, robot: str) -> tuple[Any, dict[str, Any]]:
        """Return what `plan` plans for, and what it is to know of the present."""

    def execute(self, plan: "Plan") -> str:
        """Begin to move along a plan, and say so."""

    def stop(self) -> str:
        """End what `execute` began, and say so."""

    def progress(self) -> str:
        """Return the result of `execute`, if it is new."""


class _Playing(NamedTuple):
    """A plan that a ghost plays."""

    plan: "Plan"

    # When it began by the wall clock [s].
    since: float

    def now(self) -> tuple[dict[str, float], bool]:
        """Return where joints are by now [rad] or [m], and whether that is the end."""
        last = len(self.plan.trajectory.points) - 1
        passed = time.monotonic() - self.since
        is_over = passed >= self.plan.duration
        index = last if is_over else round(passed / self.plan.duration * last)
        return self.plan.positions_at(index), is_over


@dc.dataclass
class _Goal:
    """Goal of the group."""

    # Positions [rad] or [m] of the independent joints.
    positions: dict[str, float]

    # x, y, z [m], roll, pitch, yaw [rad] of the frame in the world.
    pose: list[float]

    # What is wrong with it, in words.
    problem: str = ""

    name: str = _POSE

    @property
    def X_WF(self) -> RigidTransform:
        """The pose as a transform."""
        return transform_of(self.pose)


class MotionPlanning:
    """Goals, plans and their execution, as a part of a page's panel.

    Ids of its widgets are ``plan:<widget>``. All runs in the page's thread; while a way
    is searched, the page is looked at for "stop", and other clicks wait.
    """

    def __init__(self, scene: Scene, host: PlanningHost) -> None:
        """Create it; nothing is drawn before there is a goal."""
        self._scene, self._host = scene, host
        self._groups: dict[str, tuple[str, PlanningGroup]] = {}
        self._trouble = ""
        robots = host.robots
        for name, robot in robots.items():
            try:
                found = planning_groups(robot)
            except ArmDrakeError as error:
                self._trouble = str(error)
                continue
            prefix = f"{name}/" if len(robots) > 1 else ""
            self._groups |= {f"{prefix}{key}": (name, g) for key, g in found.items()}
        self._label = next(iter(self._groups), "")
        self._frame = self._group.tip if self._groups else ""
        self._scaling = {"velocity_scaling": 1.0, "acceleration_scaling": 1.0}
        self._is_straight = self._is_upright = False
        self._is_position_only = bool(self._groups) and self._group.is_position_only
        self._goal: _Goal | None = None
        self._is_stale = False
        self._ghosts: dict[tuple[str, str], Ghost] = {}
        # The plan that would be executed.
        self.plan: Plan | None = None
        self._playing: _Playing | None = None
        self._waiting: list[WidgetEvent] = []
        # What came of the last click, in words.
        self.status = "choose a goal"

    @property
    def goal(self) -> Mapping[str, float] | None:
        """Goal positions of the joints [rad] or [m], None without a goal."""
        return None if self._goal is None else self._goal.positions

    @property
    def problem(self) -> str:
        """Problem of the goal, in words."""
        return "" if self._goal is None else self._goal.problem

    @property
    def is_playing(self) -> bool:
        """Whether a ghost plays the plan."""
        return self._playing is not None

    @property
    def _group(self) -> PlanningGroup:
        return self._groups[self._label][1]

    @property
    def _name(self) -> str:
        return self._groups[self._label][0]

    @property
    def _robot(self) -> Robot:
        return self._host.robots[self._name]

    def set_group(self, label: str) -> None:
        """Plan for another group; the goal is where it is now."""
        check_known("planning group", label, self._groups)
        self.clear()
        self._label, self._frame = label, self._group.tip
        self._is_position_only = self._group.is_position_only
        self.set_goal_here()

    def set_frame(self, frame: str) -> None:
        """Let the pose be that of another link; the goal stays."""
        check_known("link", frame, self._frames(), argument="frame")
        self._frame = frame
        self._take(self._begin().positions, _POSE)

    def set_goal_here(self) -> None:
        """Put the goal where the robot is."""
        self._take(self._own(self._host.positions(self._name)), _POSE)

    def set_goal_state(self, name: str) -> None:
        """Put the goal where the group's state of a name is."""
        state = find_state(self._group, name)
        self._take({**self._begin().positions, **state}, name)

    def set_goal_pose(self, **numbers: float) -> None:
        """Put the frame somewhere: some of x, y, z [m], roll, pitch, yaw [rad].

        The ghost moves at the next `refresh`.
        """
        goal = self._begin()
        for index, (name, _) in enumerate(_NUMBERS):
            value = numbers.pop(name, goal.pose[index])
            if not is_finite(value):
                raise InputError(f"{name}: expected a finite number, got {value!r}")
            goal.pose[index] = float(value)
        if numbers:
            raise InputError(f"pose: no {next(iter(numbers))!r}")
        goal.name, self._is_stale = _POSE, True
        self._forget_plan()

    def refresh(self) -> None:
        """Put the ghost where the pose's inverse kinematics is, if that has changed."""
        goal = self._goal
        if goal is None or not self._is_stale:
            return
        from arm_drake.planning.inverse_kinematics import NoSolution, solve_ik

        self._is_stale = False
        turns = not self._is_position_only
        try:
            found = solve_ik(
                self._robot,
                self._frame,
                self._shift().inverse() @ goal.X_WF,
                seed=goal.positions,
                group=self._group.joints,
                mask=(True, True, True, turns, turns, turns),
            )
        except NoSolution as error:
            goal.positions = self._own(error.positions)
            goal.problem = str(error)
        except InputError as error:
            goal.problem = str(error)
        else:
            goal.positions = self._own(found.positions)
            goal.problem = self._collisions(goal.positions)
        self._show(goal)

    def make_plan(self) -> None:
        """Look for a way from where the robot is to the goal, and play it."""
        from arm_drake.planning import motion_planning

        self.refresh()
        goal = self._begin()
        self._forget_plan()
        self._say("planning …")
        joints = self._group.joints
        planned, present = self._host.planned(self._name)
        options = {
            **present,
            **self._scaling,
            "group": self._group.name,
            "frame": self._frame,
            "straight": self._is_straight,
            "time_limit": _TIME_LIMIT,
            "should_stop": self._make_stop(),
        }
        if self._is_upright:
            constraint = OrientationConstraint(self._frame, _UPRIGHT)
            options["path_constraint"] = constraint
        target = {name: goal.positions[name] for name in joints}
        try:
            if goal.problem:
                raise InputError(goal.problem)
            self.plan = motion_planning.plan(planned, target, **options)
        except ArmDrakeError as error:
            self._say(f"no plan: {error}")
            return
        self._say(self.plan.describe())
        self.play()

    def play(self) -> None:
        """Let a ghost go along the plan, which leaves a trail."""
        if self.plan is not None:
            self._playing = _Playing(self.plan, time.monotonic())
            self._draw_trail(self.plan)

    def execute(self) -> None:
        """Let the robot move along the plan."""
        if self.plan is None:
            raise InputError("there is no plan to execute: plan first")
        plan, self.plan = self.plan, None
        self._end_playing()
        self._say(self._host.execute(plan))

    def stop(self) -> None:
        """End what moves: the robot, and the ghost."""
        self._end_playing()
        self._say(self._host.stop())

    def clear(self) -> None:
        """Forget goal and plan; nothing of them is drawn any more."""
        self._forget_plan()
        self._goal, self._is_stale = None, False
        for ghost in self._ghosts.values():
            ghost.hide()
        self._scene.meshcat.Delete(TRIAD_PATH)
        self._say("choose a goal")

    def tick(self) -> None:
        """Draw what moves by itself; call it for each picture."""
        self.refresh()
        outcome = self._host.progress()
        if outcome:
            self._say(outcome)
            self._scene.meshcat.Delete(TRAIL_PATH)
        if self._playing is None:
            return
        positions, is_over = self._playing.now()
        name = self._playing.plan.robot.name
        if is_over:
            self._end_playing(keeps_trail=True)
        else:
            ghost = self._ghost(name, "plan", PLAN_COLOR)
            ghost.show(positions, base_pose=self._host.base_pose(name))

    def section(self) -> Section:
        """Return its part of the panel; without widgets if nothing can be planned."""
        if not self._groups:
            lines = (Text("plan:status", "status", self._trouble),)
            return Section("Motion planning", lines if self._trouble else (), False)
        buttons = (
            Button("plan:plan", "plan", "a way to the goal; a ghost plays it"),
            Button("plan:execute", "execute", "let the robot do it"),
            Button("plan:stop", "stop", "what moves, and the search"),
            Button("plan:play", "play again", "the ghost"),
            Button("plan:clear", "clear", "goal and plan"),
        )
        widgets: list[Widget] = [
            Choice("plan:group", "group", tuple(self._groups), self._label),
            Choice("plan:state", "goal", self._states(), self._state()),
            Buttons((Button("plan:here", "goal here", "where the robot is"),)),
            Choice("plan:frame", "pose of", self._frames(), self._frame),
            *self._sliders(),
            Toggle("plan:position_only", "its turn is free", self._is_position_only),
            Toggle("plan:straight", "on a straight line", self._is_straight),
            Toggle("plan:upright", "kept upright (0.1 rad)", self._is_upright),
            *(
                Slider(f"plan:{key}", key.replace("_", " "), 0.01, 1.0, value)
                for key, value in self._scaling.items()
            ),
            Buttons(buttons),
            Text("plan:status", "status", self.status, can_copy=True),
        ]
        return Section("Motion planning", tuple(widgets), is_open=False)

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return what changes by itself in the panel, by widget."""
        return {"plan:status": {"value": self.status}} if self._groups else {}

    def _values(self) -> dict[str, dict[str, Any]]:
        """Return the present values of all widgets."""
        fields = ("options", "lower", "upper", "value")
        return {
            widget.id: {f: getattr(widget, f) for f in fields if hasattr(widget, f)}
            for widget in self.section().widgets
            if not isinstance(widget, Buttons)
        }

    def handle(self, event_id: str, value: object) -> bool:
        """Do what was clicked, and return whether it was one of its widgets."""
        kind, _, what = event_id.partition(":")
        if kind != "plan" or not self._groups:
            return False
        if what == "plan":
            self.make_plan()
        elif what == "here":
            self.set_goal_here()
        elif what in ("execute", "stop", "play", "clear"):
            getattr(self, what)()
        elif what == "group":
            self.set_group(str(value))
        elif what == "frame":
            self.set_frame(str(value))
        elif what == "state":
            self.set_goal_here() if value == _POSE else self.set_goal_state(str(value))
        elif what in dict(_NUMBERS):
            self.set_goal_pose(**{what: value})  # type: ignore[arg-type]
        elif what == "position_only":
            self._is_position_only, self._is_stale = bool(value), True
        elif what == "straight":
            self._is_straight = bool(value)
        elif what == "upright":
            self._is_upright = bool(value)
        elif what in self._scaling:
            self._set_scaling(what, value)
        self._scene.patch(self._values())
        return True

    def waiting_events(self) -> list[WidgetEvent]:
        """Return what was clicked during a search, once."""
        events, self._waiting = self._waiting, []
        return events

    def _set_scaling(self, what: str, value: object) -> None:
        if not (isinstance(value, int | float) and 0.0 < value <= 1.0):
            raise InputError(f"{what}: expected a number above 0, at most 1: {value!r}")
        self._scaling[what] = float(value)

    def _make_stop(self) -> Callable[[], bool]:
        """Return what says whether "stop" was clicked; other clicks are kept."""
        looked, is_stopped = time.monotonic(), False

        def should_stop() -> bool:
            nonlocal looked, is_stopped
            now = time.monotonic()
            if now - looked > _LOOK_PERIOD:
                looked = now
                events = self._scene.events(0.0)
                is_stopped |= any(e.id in ("plan:stop", "end") for e in events)
                self._waiting += [e for e in events if e.id != "plan:stop"]
            return is_stopped

        return should_stop

    def _begin(self) -> _Goal:
        """Return the goal; where there was none, it is where the robot is."""
        if self._goal is None:
            positions = self._own(self._host.positions(self._name))
            self._goal = _Goal(positions, self._pose_at(positions))
        return self._goal

    def _take(self, positions: dict[str, float], name: str) -> None:
        """Let joint positions be the goal."""
        self._forget_plan()
        problem = self._collisions(positions)
        self._goal = _Goal(positions, self._pose_at(positions), problem, name)
        self._is_stale = False
        self._show(self._goal)

    def _own(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return positions of independent joints."""
        joints = self._robot.description.independent_joints
        return {joint.name: float(positions[joint.name]) for joint in joints}

    def _shift(self) -> RigidTransform:
        """Return how far the base is from where the robot is loaded."""
        X_WB = self._host.base_pose(self._name)
        if X_WB is None:
            return RigidTransform()
        return X_WB @ transform_of(self._robot.pose).inverse()

    def _where(self, positions: Mapping[str, float]) -> RigidTransform:
        """Return where the frame is in the world."""
        from arm_drake.planning.inverse_kinematics import forward_kinematics

        return self._shift() @ forward_kinematics(self._robot, positions, self._frame)

    def _pose_at(self, positions: Mapping[str, float]) -> list[float]:
        return list(pose_of(self._where(positions)))

    def _collisions(self, positions: Mapping[str, float]) -> str:
        """Return what collides where joints are somewhere, in words."""
        from arm_drake.planning.motion_planning import check_positions

        planned, present = self._host.planned(self._name)
        try:
            check_positions(planned, positions, group=self._group.name, **present)
        except ArmDrakeError as error:
            return str(error)
        return ""

    def _show(self, goal: _Goal) -> None:
        """Draw the goal, and say what is wrong with it."""
        ghost = self._ghost(self._name, "goal", GOAL_COLOR)
        ghost.show(goal.positions, base_pose=self._host.base_pose(self._name))
        ghost.set_color(WRONG_COLOR if goal.problem else GOAL_COLOR)
        length = _TRIAD * self._reach()[1]
        draw_triad(self._scene.meshcat, TRIAD_PATH, length)
        self._scene.meshcat.SetTransform(TRIAD_PATH, goal.X_WF)
        self._say(goal.problem or "the goal is free")
        self._scene.patch(self._values())

    def _ghost(self, robot: str, name: str, color: tuple[float, float, float]) -> Ghost:
        if (robot, name) not in self._ghosts:
            made = self._host.make_ghost(robot, f"{robot} {name}", color)
            self._ghosts[robot, name] = made
        return self._ghosts[robot, name]

    def _draw_trail(self, plan: "Plan") -> None:
        """Draw the way of the frame along a plan."""
        count = len(plan.trajectory.points)
        points = [self._where(plan.positions_at(index)) for index in range(count)]
        line = np.array([X.translation() for X in points]).T
        if line.shape[1] > 1:
            line = np.asfortranarray(line)
            self._scene.meshcat.SetLine(
                TRAIL_PATH, line, _TRAIL_WIDTH, Rgba(*PLAN_COLOR)
            )

    def _end_playing(self, *, keeps_trail: bool = False) -> None:
        self._playing = None
        for (_, name), ghost in self._ghosts.items():
            if name == "plan":
                ghost.hide()
        if not keeps_trail:
            self._scene.meshcat.Delete(TRAIL_PATH)

    def _forget_plan(self) -> None:
        self.plan = None
        self._end_playing()

    def _say(self, text: str) -> None:
        self.status = text
        self._scene.patch({"plan:status": {"value": text}})

    def _states(self) -> tuple[str, ...]:
        return (_POSE, *self._group.states)

    def _state(self) -> str:
        return _POSE if self._goal is None else self._goal.name

    def _frames(self) -> tuple[str, ...]:
        """Return the links that the group's joints carry, its tip the first."""
        description = self._robot.description
        joints = {joint.name: joint for joint in description.movable_joints}
        own = set(self._group.joints)
        driven = (j for j in joints.values() if last_master(j, joints)[0] in own)
        moved = set().union(*(links_on(description.joints, j.child) for j in driven))
        tip = self._group.tip
        return (tip, *(n for n in description.links if n in moved and n != tip))

    def _reach(self) -> tuple[Sequence[float], float]:
        """Return what the frame turns about, and how far from it it gets [m]."""
        from arm_drake.planning.inverse_kinematics import find_reach

        center, reach = find_reach(self._robot, self._frame, self._group.joints)
        return list(map(float, self._shift() @ center)), reach

    def _sliders(self) -> list[Slider]:
        """Return the sliders of the pose."""
        center, reach = self._reach()
        pose = self._goal.pose if self._goal is not None else [*center, 0.0, 0.0, 0.0]
        sliders = []
        for index, (name, unit) in enumerate(_NUMBERS):
            middle, room = (
                (center[index], _ROOM * reach) if index < 3 else (0.0, math.pi)
            )
            value = pose[index]
            lower, upper = min(middle - room, value), max(middle + room, value)
            sliders.append(Slider(f"plan:{name}", name, lower, upper, value, unit))
        return sliders


class ViewedRobot:
    """A robot without physics, as one that is planned for."""

    def __init__(self, viewer: Viewer) -> None:
        """Create it."""
        self._viewer = viewer
        self._moving: _Playing | None = None

    @property
    def robots(self) -> Mapping[str, Robot]:
        """The robot by its name."""
        return {self._viewer.robot.name: self._viewer.robot}

    @property
    def is_moving(self) -> bool:
        """Whether it moves along a plan."""
        return self._moving is not None

    def positions(self, robot: str) -> Mapping[str, float]:
        """Return where the joints are [rad] or [m]."""
        return self._viewer.positions

    def base_pose(self, robot: str) -> None:
        """Return nothing: the base is where the robot is loaded."""

    def make_ghost(
        self, robot: str, name: str, color: tuple[float, float, float]
    ) -> Ghost:
        """Return a transparent copy of the robot."""
        return self._viewer.make_ghost(name, color)

    def planned(self, robot: str) -> tuple[Robot, dict[str, Any]]:
        """Return the robot, and where plans start."""
        loaded, now = self._viewer.robot, self._viewer.positions
        own = loaded.description.independent_joints
        return loaded, {"start": {joint.name: now[joint.name] for joint in own}}

    def execute(self, plan: "Plan") -> str:
        """Begin to move the robot along a plan, as fast as it says."""
        self._moving = _Playing(plan, time.monotonic())
        return "moving"

    def stop(self) -> str:
        """Let the robot stay where it is."""
        self._moving = None
        return "stopped"

    def progress(self) -> str:
        """Move the robot; at the end say so."""
        if self._moving is None:
            return ""
        positions, is_over = self._moving.now()
        joints = self._viewer.robot.description.independent_joints
        own = {joint.name for joint in joints}
        self._viewer.set_positions({n: q for n, q in positions.items() if n in own})
        if is_over:
            self._moving = None
        return "there" if is_over else ""


class SimulatedRobots:
    """The robots of a simulation, as those that are planned for."""

    def __init__(self, live: Drawn) -> None:
        """Create it."""
        self._live = live
        self._goal: GoalHandle | None = None

        # The robot that is sent positions, and no goal.
        self._moving = ""

    @property
    def robots(self) -> Mapping[str, Robot]:
        """The robots by name."""
        return self._live.simulation.robots

    def positions(self, robot: str) -> Mapping[str, float]:
        """Return where the joints of a robot are [rad] or [m]."""
        state = self._live.simulation.joint_states(robot)
        return dict(zip(state.name, state.position, strict=True))

    def base_pose(self, robot: str) -> RigidTransform | None:
        """Return where a base is that can move."""
        loaded = self.robots[robot]
        if not loaded.has_free_base:
            return None
        return self._live.simulation.link_poses(robot)[loaded.description.base]

    def make_ghost(
        self, robot: str, name: str, color: tuple[float, float, float]
    ) -> Ghost:
        """Return a transparent copy of a robot."""
        return self._live.views.make_ghost(robot, name, color)

    def planned(self, robot: str) -> tuple[Simulation, dict[str, Any]]:
        """Return the simulation, and which of its robots is planned for."""
        return self._live.simulation, {"name": robot}

    def execute(self, plan: "Plan") -> str:
        """Send a plan to its controller."""
        self._goal = self._live.simulation.send_planned(plan)
        self._moving = "" if self._goal else plan.robot.name
        return f"executing: {self._goal.controller if self._goal else self._moving}"

    def stop(self) -> str:
        """Cancel what was sent."""
        simulation = self._live.simulation
        if self._moving:
            simulation.stop_planned(self._moving)
            self._moving = ""
            return "cancelled"
        if self._goal is None or self._goal.status.is_terminal:
            return "stopped"
        simulation.controller(self._goal.controller).cancel()
        return "cancelled"

    def progress(self) -> str:
        """Return how the goal ended, once."""
        if self._moving and self._live.simulation.rests(self._moving):
            self._moving = ""
            return "executed"
        if self._goal is None or not self._goal.status.is_terminal:
            return ""
        goal, self._goal = self._goal, None
        return f"{goal.controller}: goal {goal.describe()}"
