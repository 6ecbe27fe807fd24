"""Simulation: a Simulator with commands in and a Rollout out."""

import collections
import math
from collections.abc import Callable, Sequence
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from arm_drake.clients import ControllerHandle, GoalHandle
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, MotionError, suggest
from arm_drake.loaded_controllers import ControllerState, LoadedController
from arm_drake.manager import MANAGER, SWITCH_PORT, ControllerManager
from arm_drake.messages import (
    FollowJointTrajectoryGoal,
    GoalEvent,
    JointState,
    JointTrajectory,
    Message,
    Strictness,
    SwitchController,
    TopicRejected,
)
from arm_drake.motion import Motion, MotionStep
from arm_drake.recording import read_rollout
from arm_drake.rollout import Rollout

# Ticks between two looks at the controllers' news; they keep the latest 64.
_TICKS_AT_A_TIME = 50

# A step is due at the first tick that isn't earlier by more than this part of a period.
_TICK_TOLERANCE = 1e-6


class Simulation:
    """Runs a diagram of `build_diagram`, sends to its controllers, records it."""

    def __init__(self, diagram: Diagram) -> None:
        """Create a simulation at time 0.

        Args:
            diagram: Diagram of `build_diagram`; with its robots and controllers in it.

        Raises:
            InputError: If there is no robot in the diagram.
        """
        self.diagram = diagram
        self._managers = {
            system.robot.name: system
            for system in diagram.GetSystems()
            if isinstance(system, ControllerManager)
        }
        if not self._managers:
            raise InputError(
                "the diagram has no robot at its top; expected one of build_diagram"
            )
        self.simulator = Simulator(diagram)
        self._period = min(manager.period for manager in self._managers.values())
        self._on_event: list[Callable[[GoalHandle | TopicRejected], None]] = []
        self._event_ports = [
            f"{manager.prefix}{controller.name}.events"
            for manager in self._managers.values()
            for controller in manager.controllers
            if _has_port(controller, "events")
        ]
        self._start()

    def _start(self) -> None:
        self.simulator.Initialize()
        self._handles: dict[int, GoalHandle] = {}
        # What lies on the ports, and since when [s].
        self._published: dict[str, list[tuple[float, Message]]] = {}
        self._next_event = dict.fromkeys(self._event_ports, 0)
        self.goals: list[GoalHandle] = []
        self.rejected: list[TopicRejected] = []
        self._sources: dict[int, tuple[JointTrajectory, str]] = {}

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.simulator.get_context().get_time())

    @property
    def robots(self) -> dict[str, Robot]:
        """The robots by name."""
        return {name: manager.robot for name, manager in self._managers.items()}

    @property
    def report(self) -> LoadReport:
        """The load report of the first robot, and what its controllers lack."""
        return self._manager(None).report

    def controller(self, name: str) -> ControllerHandle:
        """Return what sends to a controller.

        Args:
            name: Its name; `<robot>/<name>` where there are several robots.

        Raises:
            InputError: If there is no such controller, or it could not be loaded.
        """
        controllers = {
            manager.prefix + controller.name: controller
            for manager in self._managers.values()
            for controller in manager.controllers
        }
        if name not in controllers:
            raise InputError(f"no controller {name!r}; {suggest(name, controllers)}")
        controller = controllers[name]
        if controller.system is None:
            raise InputError(f"controller {name!r} is unconfigured; see the report")
        return ControllerHandle(self, name, controller.system, controller.type)

    def list_controllers(self) -> list[ControllerState]:
        """Return the controllers and their states, in the order of the YAML."""
        return [
            row
            for manager in self._managers.values()
            for row in manager.GetOutputPort("controllers").Eval(
                manager.GetMyContextFromRoot(self.simulator.get_context())
            )
        ]

    def switch_controllers(
        self,
        activate: Sequence[str] = (),
        deactivate: Sequence[str] = (),
        *,
        strictness: Strictness = "strict",
        robot: str | None = None,
    ) -> tuple[str, ...]:
        """Activate and deactivate controllers of a robot in the manager's next cycle.

        Args:
            activate: Names of controllers to start.
            deactivate: Names of controllers to stop; one in both lists is restarted.
            strictness: "strict" does all of it or nothing; "best_effort" what can be.
            robot: Name of the robot; by default the first one.

        Returns:
            What can't be done and is left out, in words.

        Raises:
            InputError: If it is strict and can't be done.
        """
        manager = self._manager(robot)
        request = SwitchController(tuple(activate), tuple(deactivate), strictness)
        problems = manager.find_problems(self.simulator.get_context(), request)
        if problems and strictness == "strict":
            raise InputError("; ".join(problems))
        port = f"{manager.prefix}{MANAGER}.{SWITCH_PORT}"
        self.publish(port, request, manager.period)
        return problems

    def joint_states(self, robot: str | None = None) -> JointState:
        """Return position, velocity and effort of every movable joint, now.

        Args:
            robot: Name of the robot; by default the first one.
        """
        manager = self._manager(robot)
        values = self.eval_output(f"{manager.prefix}joint_states").reshape(3, -1)
        names = tuple(j.name for j in manager.robot.description.movable_joints)
        return JointState(
            name=names,
            position=tuple(values[0].tolist()),
            velocity=tuple(values[1].tolist()),
            effort=tuple(values[2].tolist()),
        )

    def on_event(self, callback: Callable[[GoalHandle | TopicRejected], None]) -> None:
        """Call a function with every goal that has news and every refused message."""
        self._on_event.append(callback)

    def advance_to(self, time: float) -> None:
        """Simulate up to a time.

        Args:
            time: Simulated time to stop at [s].

        Raises:
            ValueError: If the time is past, or no number.
        """
        if not time >= self.time or not math.isfinite(time):
            raise ValueError(f"can't go from {self.time} s to {time} s")
        while self.time < time:
            chunk = self.time + _TICKS_AT_A_TIME * self._period
            self.simulator.AdvanceTo(min(chunk, time))
            self._collect()

    def run(
        self,
        duration: float,
        motion: Motion | None = None,
        realtime_rate: float = 0.0,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Simulate for a while, sending the steps of a motion when they are due.

        Args:
            duration: How long [s].
            motion: What to send, its times counted from now.
            realtime_rate: Simulated seconds per second of wall time; 0 is as fast as
                it goes.
            progress: Called with the simulated time [s], ten times a second of it.

        Raises:
            MotionError: If a step is for a controller that isn't active.
            ValueError: If the duration is negative, or no number.
        """
        if not (math.isfinite(duration) and duration >= 0.0):
            raise ValueError(f"duration must be at least 0 s, got {duration!r}")
        start = self.time
        steps = collections.deque(motion.steps if motion else ())
        self.check_motion(motion)
        # The rate counts from now.
        self.simulator.ResetStatistics()
        self.simulator.set_target_realtime_rate(realtime_rate)
        end, tolerance = start + duration, _TICK_TOLERANCE * self._period
        report_at = start
        while True:
            while steps and start + steps[0].at <= self.time + tolerance:
                self._send_step(steps.popleft(), motion)
            if progress is not None and self.time >= report_at:
                progress(self.time)
                report_at += 0.1
            if self.time >= end:
                break
            targets = [end]
            if steps:
                targets.append(start + steps[0].at)
            if progress is not None:
                targets.append(report_at)
            self.advance_to(max(min(targets), self.time))
        self.simulator.set_target_realtime_rate(0.0)

    def check_motion(self, motion: Motion | None) -> None:
        """Raise MotionError if a step is for a controller that can't take it."""
        for step in motion.steps if motion else ():
            try:
                self.controller(step.controller).check(step.message)
            except InputError as error:
                file = motion.file if motion else None
                raise MotionError(error.problem, file=file, where=step.where) from None

    def link_poses(self, robot: str | None = None) -> dict[str, RigidTransform]:
        """Return the pose of every link in the world, by the link's name.

        Args:
            robot: Name of the robot; by default the first one.
        """
        manager = self._manager(robot)
        poses = self.eval_output(f"{manager.prefix}frames")
        return dict(zip(manager.robot.description.links, poses, strict=True))

    def reset(self) -> None:
        """Go back to the start: time 0, initial positions, nothing sent."""
        self.simulator.reset_context(self.diagram.CreateDefaultContext())
        self._start()

    def rollout(self, robot: str | None = None) -> Rollout:
        """Return what was recorded so far.

        Args:
            robot: Name of the robot; by default the first one.
        """
        manager = self._manager(robot)
        return read_rollout(self.diagram, self.simulator.get_context(), manager)

    def _manager(self, robot: str | None) -> ControllerManager:
        if robot is None:
            return next(iter(self._managers.values()))
        if robot not in self._managers:
            raise InputError(f"no robot {robot!r}; {suggest(robot, self._managers)}")
        return self._managers[robot]

    def _send_step(self, step: MotionStep, motion: Motion | None) -> None:
        handle = self.controller(step.controller)
        file = motion.file if motion else None
        where = f"{file}: {step.where}" if file else step.where
        if step.message is None:
            handle.cancel()
        elif isinstance(step.message, FollowJointTrajectoryGoal):
            handle.send_goal(step.message, where=where)
        elif isinstance(step.message, JointTrajectory):
            handle.send_trajectory(step.message, where=where)

    def _collect(self) -> None:
        """Take the news since the last time."""
        for port in self._event_ports:
            events = self.eval_output(port)
            if not events or events[-1][0] < self._next_event[port]:
                # Nothing new, or the context is one of before.
                self._next_event[port] = events[-1][0] + 1 if events else 0
                continue
            for number, event in events:
                if number >= self._next_event[port]:
                    self._take(event)
            self._next_event[port] = events[-1][0] + 1

    def _take(self, event: GoalEvent | TopicRejected) -> None:
        news: GoalHandle | TopicRejected | None = None
        if isinstance(event, TopicRejected):
            self.rejected.append(event)
            news = event
        else:
            news = self._handles.get(id(event.request))
            if news is None:  # Sent past the Simulation, by a system of the user's.
                return
            news.update(event)
        for callback in self._on_event:
            callback(news)

    def add_goal(self, goal: GoalHandle) -> None:
        """Take note of a goal that is being sent."""
        self._handles[id(goal.request)] = goal
        self.goals.append(goal)

    def add_message(self, message: JointTrajectory, where: str) -> None:
        """Take note of where a message that is being sent comes from."""
        self._sources[id(message)] = (message, where)

    def publish(self, port: str, message: Message, period: float) -> None:
        """Put a message on a port, where its controller sees it at its next tick.

        Those of before stay as long as the controller may not have seen them.

        Args:
            port: Input port of the diagram.
            message: What to put there.
            period: Period of the controller [s].
        """
        recent = [
            (sent, other)
            for sent, other in self._published.get(port, ())
            if sent > self.time - 2.0 * period
        ]
        self._published[port] = [*recent, (self.time, message)]
        messages = tuple(message for _, message in self._published[port])
        value = AbstractValue.Make(messages)
        context = self.simulator.get_mutable_context()
        self.diagram.GetInputPort(port).FixValue(context, value)

    def eval_output(self, port: str) -> Any:
        """Return the present value of an output port of the diagram."""
        return self.diagram.GetOutputPort(port).Eval(self.simulator.get_context())

    def source_of(self, rejected: TopicRejected) -> str:
        """Return where a refused message comes from; empty if from a program."""
        _, where = self._sources.get(id(rejected.message), (None, ""))
        return where


def _has_port(controller: LoadedController, name: str) -> bool:
    system = controller.system
    return system is not None and bool(system.HasOutputPort(name))
