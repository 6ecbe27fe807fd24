"""Activities: what a robot does in a simulation, as generators.

They yield the times until which to simulate, so that whoever runs the simulation does
so, and send to controllers what these take.
"""

import dataclasses as dc
import math
from collections.abc import Generator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.arrays import is_number
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, check_known, quoted, suggest
from arm_drake.manager.loaded_controllers import ControllerState
from arm_drake.messages import (
    Duration,
    GoalStatus,
    GripperCommand,
    JointTrajectory,
    JointTrajectoryPoint,
)
from arm_drake.perception.cameras import CameraHandle
from arm_drake.planning.groups import takes_positions
from arm_drake.planning.motion_planning import Plan
from arm_drake.planning.setting import Running

T = TypeVar("T")

# What yields times until which to simulate [s], and returns something in the end.
Activity: TypeAlias = Generator[float, None, T]


# How often something is looked at [s].
LOOK = 0.02

# How long a gripper takes from open to closed [s].
_GRIPPER_TIME = 1.0

# How much longer than its plan a motion may take, and how often streams of commands
# are sent [s].
_PATIENCE, _STREAM = 5.0, 0.01


class Handle(Protocol):
    """Sender to a controller: a ControllerHandle."""

    def command(self, values: Sequence[float]) -> None:
        """Send commands."""

    def send_goal(self, goal: JointTrajectory | GripperCommand) -> Any:
        """Send a goal."""

    def send_trajectory(self, trajectory: JointTrajectory) -> None:
        """Send a trajectory."""

    def cancel(self, goal: Any) -> None:
        """Cancel a goal."""


class Runner(Running, Protocol):
    """Simulator of a diagram with robots and their controllers: a Simulation."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""

    @property
    def plant(self) -> MultibodyPlant:
        """The plant of robots and world."""

    def advance_to(self, time: float) -> None:
        """Simulate up to a time [s]."""

    def list_controllers(self) -> Sequence[ControllerState]:
        """Return the controllers and their states."""

    def controller(self, name: str) -> Handle:
        """Return what sends to a controller."""

    def camera(self, name: str) -> CameraHandle:
        """Return what a camera sees."""


def is_positive(value: Any) -> bool:
    """Return whether something is a finite number above 0."""
    return is_number(value) and 0.0 < value < math.inf


def read_options(kind: type[T], action: str, options: Mapping[str, Any]) -> T:
    """Return the options of an action, or raise InputError."""
    names = [field.name for field in dc.fields(kind)]  # type: ignore[arg-type]
    for name in options:
        if name not in names:
            raise InputError(f"{action}: no option {name!r}; {suggest(name, names)}")
    return kind(**options)


def perform(simulation: "Runner", activity: Activity[T]) -> T:
    """Simulate until an activity is done, and return what it returns."""
    while True:
        try:
            simulation.advance_to(max(next(activity), simulation.time))
        except StopIteration as stop:
            result: T = stop.value
            return result


class Failure(Exception):
    """A stage that failed, and why."""

    def __init__(self, stage: str, reason: str) -> None:
        """Create it."""
        super().__init__(reason)
        self.stage, self.reason = stage, reason


# Ends of the types of controllers that take positions, and how.
_KINDS = {
    "JointTrajectoryController": "trajectory",
    "GripperActionController": "gripper",
    "ParallelGripperActionController": "gripper",
    "GripperController": "gripper",
    "JointGroupPositionController": "commands",
    "ForwardCommandController": "commands",
}


class Drive(NamedTuple):
    """The controller of some joints."""

    controller: str
    kind: str
    joints: tuple[str, ...]

    def send(
        self, simulation: Runner, goal: Mapping[str, float], time: float = _GRIPPER_TIME
    ) -> None:
        """Send joints somewhere [rad] or [m]; a trajectory takes a time [s]."""
        handle = simulation.controller(self.controller)
        values = tuple(goal[name] for name in self.joints)
        if self.kind == "commands":
            handle.command(values)
        elif self.kind == "gripper":
            handle.send_goal(GripperCommand(values[0])).is_part = True
        else:
            point = JointTrajectoryPoint(
                positions=values, time_from_start=Duration.of(time)
            )
            trajectory = JointTrajectory(joint_names=self.joints, points=(point,))
            handle.send_trajectory(trajectory)

    def lead(
        self, simulation: Runner, start: Mapping[str, float], goal: Mapping[str, float]
    ) -> Activity[None]:
        """Send joints somewhere in the time of a gripper, whatever takes positions."""
        count = round(_GRIPPER_TIME / LOOK) if self.kind == "commands" else 1
        for part in range(1, count):
            way = {n: start[n] + part / count * (goal[n] - start[n]) for n in goal}
            self.send(simulation, way)
            yield simulation.time + LOOK
        self.send(simulation, goal)

    def follow(self, simulation: Runner, found: Plan, stage: str) -> Activity[None]:
        """Follow a plan to its end, or raise Failure."""
        if self.kind == "commands":
            yield from self._stream(simulation, found)
            return
        handle = simulation.controller(self.controller)
        goal = handle.send_goal(found.trajectory)
        goal.is_part = True
        end = simulation.time + found.duration + _PATIENCE
        while not goal.status.is_terminal and simulation.time < end:
            yield simulation.time + LOOK
        if goal.status is not GoalStatus.SUCCEEDED:
            late = "" if goal.status.is_terminal else " after its trajectory's end"
            handle.cancel(goal)
            what = f"{self.controller}: goal {goal.describe()}{late}"
            raise Failure(stage, what)

    def _stream(self, simulation: Runner, found: Plan) -> Activity[None]:
        """Send the points of a plan as commands."""
        handle = simulation.controller(self.controller)
        points = found.trajectory.points
        at = [found.trajectory.joint_names.index(name) for name in self.joints]
        t = np.array([point.time_from_start.to_seconds() for point in points])
        q = np.array([point.positions for point in points])[:, at]
        begun = simulation.time
        while True:
            now = simulation.time - begun
            handle.command([float(np.interp(now, t, row)) for row in q.T])
            if now >= t[-1]:
                return
            yield simulation.time + _STREAM


def choose_robot(simulation: Runner, name: str | None) -> tuple[Robot, str]:
    """Return a robot, by default the first, and the prefix of its names.

    InputError if there is none of that name.
    """
    robots = simulation.robots
    name = next(iter(robots)) if name is None else name
    check_known("robot", name, robots, argument="robot")
    return robots[name], f"{name}/" if len(robots) > 1 else ""


def find_drive(
    simulation: Runner, robot: Robot, prefix: str, joints: Sequence[str]
) -> Drive:
    """Return the controller of exactly these joints, an active one first.

    `prefix` is what the names of the robot's controllers begin with.
    """
    states = {row.name: row.state for row in simulation.list_controllers()}
    found = []
    for controller in robot.controllers.controllers:
        kind = next(
            (k for end, k in _KINDS.items() if controller.type.endswith(end)), None
        )
        if kind is None or (kind == "commands" and not takes_positions(controller)):
            continue
        named = [
            parameter.value
            for name in ("joints", "joint")
            if (parameter := controller.parameters.get(name)) is not None
        ]
        names = [named[0]] if named and isinstance(named[0], str) else named[:1]
        flat = names[0] if names and isinstance(names[0], list) else names
        if set(map(str, flat or ())) == set(joints):
            name = f"{prefix}{controller.name}"
            found.append(Drive(name, kind, tuple(map(str, flat))))
    found.sort(key=lambda drive: states.get(drive.controller) != "active")
    if not found:
        names = [each.name for each in robot.controllers.controllers]
        raise InputError(
            f"no controller takes positions of exactly {quoted(joints)}; there "
            f"are {quoted(names) or 'none'}"
        )
    return found[0]
