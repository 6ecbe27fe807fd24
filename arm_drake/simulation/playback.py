"""Playback of a motion: its steps, sent to the controllers of a simulation."""

import contextlib
import math
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from arm_drake.description.entry import bundled_motions
from arm_drake.description.robot import Robot
from arm_drake.errors import ArmDrakeError, ArmDrakeWarning, InputError, MotionError
from arm_drake.messages import JointState, JointTrajectory, SwitchController
from arm_drake.plant.payloads import Payload, Payloads
from arm_drake.simulation import clients
from arm_drake.simulation.clients import ControllerHandle, TopicHandle
from arm_drake.simulation.directory import ControllerList, Directory
from arm_drake.simulation.mailbox import Mailbox
from arm_drake.simulation.motion import (
    AFTER_MOTION,
    FollowThing,
    LimitWatch,
    Motion,
    MotionStep,
    PickThing,
    PlaceThing,
    PlanTo,
    SetPayloads,
    Task,
    TaskOutcome,
    TopicMessage,
)
from arm_drake.simulation.recording import find_build_info

# How often is looked whether a robot rests whose motion is to be planned [s].
_LOOK_PERIOD = 0.05


class Runner(Protocol):
    """Player of motions: a Simulation."""

    directory: Directory
    mailbox: Mailbox
    simulator: Simulator

    diagram: Diagram

    # Of the quickest controller manager [s].
    period: float

    # What was played, in order.
    motions: list[Motion]

    @property
    def robots(self) -> dict[str, Robot]:
        """The robots by name."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""

    def advance_to(self, time: float) -> None:
        """Simulate up to a time [s]."""

    def joint_states(self, robot: str | None = None) -> JointState:
        """Return where the joints of a robot are, and how fast they move."""

    def list_controllers(self) -> ControllerList:
        """Return the controllers and their states."""

    def controller(self, name: str) -> ControllerHandle:
        """Return what sends to a controller."""

    def topic(self, name: str) -> TopicHandle:
        """Return what publishes on a topic."""

    def check_payloads(self, payloads: Payloads) -> object:
        """Raise InputError if there are no such links, or no physics."""

    def set_payload(self, link: str, payload: Payload | float) -> None:
        """Fix a thing to a link from now on."""

    def check_plan(self, message: PlanTo) -> None:
        """Raise InputError if no plan can be made, or no controller takes it."""

    def send_plan(self, message: PlanTo, *, where: str) -> bool:
        """Plan and send a motion, unless the robot moves; return whether it rested."""

    def rests(self, robot: str | None = None) -> bool:
        """Return whether no joint of a robot moves, and no goal makes one move."""

    def end_task(self, outcome: TaskOutcome) -> None:
        """Take note of what became of a task."""

    def request_switch(self, request: SwitchController, *, where: str) -> None:
        """Send a request to a controller manager."""


class Player:
    """Sends each step of a motion when it is due."""

    def __init__(
        self, simulation: Runner, motion: Motion | None, tolerance: float
    ) -> None:
        """Create it, with nothing sent; times count from now.

        A step may be sent `tolerance` [s] before its time. It may raise MotionError, as
        `check_motion`.
        """
        self._simulation = simulation
        self._motion = Motion(None, ()) if motion is None else motion
        self._tolerance = tolerance
        check_motion(simulation, self._motion)
        for line in list_beyond_limits(simulation, self._motion):
            warnings.warn(line, ArmDrakeWarning, stacklevel=3)
        if motion is not None:
            simulation.motions.append(motion)
        self._start = simulation.time
        self._waiting: list[MotionStep] = []
        # By robot; None is the first one.
        self._running: dict[str, _Running] = {}
        # By robot: how what it picked lies in its palm, if a camera saw it.
        self._grasps: dict[str, RigidTransform] = {}
        self._steps = self._motion.timeline()
        self._next = next(self._steps, None)
        # When a motion with tasks is over, a while after they are done [s]; the robots
        # that do them; and when the rest of the motion is done, from its start [s].
        self._over_at = math.inf
        self._robots = {task.robot for task in self._motion.tasks}
        self._done = self._motion.end_of_messages if self._robots else 0.0

    @property
    def is_over(self) -> bool:
        """Whether what is played by `play` with `ends` was done a while ago."""
        return self._simulation.time >= self._over_at

    @contextlib.contextmanager
    def paced(self, realtime_rate: float) -> Iterator[None]:
        """Let the simulation keep a rate; in the end, also by Ctrl-C, give up.

        The rate is in simulated seconds per second and counts from now; 0 is as fast
        as it goes.
        """
        simulator = self._simulation.simulator
        simulator.ResetStatistics()
        simulator.set_target_realtime_rate(realtime_rate)
        try:
            yield
        finally:
            self.give_up()
            simulator.set_target_realtime_rate(0.0)

    def play(
        self,
        duration: float,
        progress: Callable[[float], None] | None = None,
        *,
        ends: bool = False,
    ) -> None:
        """Simulate for a while [s] and send what is due.

        `progress` is called with the simulated time [s], ten times a second of it.
        `ends` is whether to stop before, when the motion is over.
        """
        simulation = self._simulation
        end, report_at = simulation.time + duration, simulation.time
        while True:
            self._send_due()
            if progress is not None and simulation.time >= report_at:
                progress(simulation.time)
                report_at += 0.1
            if ends:
                self._look_for_end()
                end = min(end, self._over_at)
            if simulation.time >= end:
                return
            targets = [end]
            if ends and self._over_at == math.inf and self._is_idle():
                targets.append(simulation.time + _LOOK_PERIOD)
            if self._next is not None:
                # Rounded, it may come after its tick, which would not see it.
                due = self._start + self._next[0]
                targets.append(due - 0.5 * self._tolerance)
            if self._waiting:
                targets.append(simulation.time + _LOOK_PERIOD)
            targets += [task.due for task in self._running.values()]
            if progress is not None:
                targets.append(report_at)
            simulation.advance_to(max(min(targets), simulation.time))

    def _is_idle(self) -> bool:
        """Return whether there were tasks, and nothing is begun or to be begun."""
        left = self._waiting or self._running or self._next is not None
        return bool(self._robots) and not left

    def _look_for_end(self) -> None:
        """Find out whether all is done, and the robots rest that did it."""
        if self._over_at < math.inf or not self._is_idle():
            return
        now = self._simulation.time
        is_done = now >= self._start + self._done
        if is_done and all(map(self._simulation.rests, self._robots)):
            self._over_at = now + AFTER_MOTION

    def give_up(self) -> None:
        """Report tasks that weren't ended, or not even begun."""
        ended = "not done: the simulation ended before"
        for task in self._running.values():
            # Who follows has nowhere to get to.
            if not isinstance(task.step.message, FollowThing):
                self._reject(task.step, ended)
        for step in self._waiting:
            reason = "not planned: the robot didn't come to rest in time"
            if not isinstance(step.message, PlanTo):
                reason = "not begun: the simulation ended before the robot was free"
            self._reject(step, reason)
        if self._robots:  # Then the motion doesn't repeat.
            later = [] if self._next is None else [self._next, *self._steps]
            for _, step in later:
                if isinstance(step.message, Task):
                    reason = "not begun: the simulation ended before its time"
                    self._reject(step, reason)
            self._next = None
        self._waiting.clear()
        self._running.clear()

    def _reject(self, step: MotionStep, reason: str) -> None:
        assert isinstance(step.message, Task)
        where, now = self._motion.place(step), self._simulation.time
        self._simulation.end_task(TaskOutcome(step.message, where, now, None, reason))

    def _send_due(self) -> None:
        now = self._simulation.time + self._tolerance
        while self._next is not None and self._start + self._next[0] <= now:
            step = self._next[1]
            if isinstance(step.message, Task):
                self._waiting.append(step)
            else:
                send_step(self._simulation, self._motion, step)
            self._next = next(self._steps, None)
        self._go_on(now)
        self._start_tasks()

    def _go_on(self, now: float) -> None:
        """Go on with what robots do, where it is time [s]."""
        for robot, task in tuple(self._running.items()):
            if task.due > now:
                continue
            due = next(task.times, None)
            if due is None:
                del self._running[robot]
            else:
                self._running[robot] = task._replace(due=due)

    def _start_tasks(self) -> None:
        """Start what robots do that rest, of each robot the first."""
        busy = set(self._running)
        for step in tuple(self._waiting):
            message, where = step.message, self._motion.place(step)
            assert isinstance(message, Task)
            robot = self._simulation.directory.manager(message.robot).robot.name
            if robot in busy:
                continue
            busy.add(robot)
            if isinstance(message, PlanTo):
                if self._simulation.send_plan(message, where=where):
                    self._waiting.remove(step)
                continue
            if self._simulation.rests(message.robot):
                self._waiting.remove(step)
                times = _perform(self._simulation, message, where, self._grasps)
                self._running[robot] = _Running(step, times, 0.0)
                self._go_on(self._simulation.time)


class _Running(NamedTuple):
    """A task that a robot is about."""

    step: MotionStep

    # Times until which to simulate [s], and the next of them.
    times: Iterator[float]
    due: float


def _perform(
    simulation: Any,
    message: Task,
    where: str,
    grasps: dict[str, RigidTransform],
) -> Iterator[float]:
    """Yield times until which to simulate [s], while a robot does something.

    What a camera saw when a thing was picked is kept by robot, until it is placed.
    """
    from arm_drake.manipulation.pick_and_place import picking, placing
    from arm_drake.manipulation.visual_servoing import following

    options = {**message.options, "robot": message.robot}
    robot = message.robot or next(iter(simulation.robots))
    result: Any = None
    try:
        if isinstance(message, PickThing):
            result = yield from picking(simulation, message.thing, **options)
            if result:
                grasps.pop(robot, None)
                if "camera" in options:
                    grasps[robot] = result.X_PO
        elif isinstance(message, FollowThing):
            result = yield from following(simulation, message.thing, **options)
        else:
            assert isinstance(message, PlaceThing)
            options["held"] = grasps.get(robot)
            result = yield from placing(simulation, message.pose, **options)
            if result:
                grasps.pop(robot, None)
    except ArmDrakeError as error:
        reason = str(error)
    else:
        reason = "" if result else result.reason
    outcome = TaskOutcome(message, where, simulation.time, result, reason)
    simulation.end_task(outcome)


def _check_task(simulation: Any, message: Task) -> None:
    """Raise InputError if a robot can't do the task, or the thing is unknown."""
    from arm_drake.manipulation.activities import read_options
    from arm_drake.manipulation.hand import Hand, PickOptions
    from arm_drake.manipulation.visual_servoing import FollowOptions, Servo

    options = {**message.options, "robot": message.robot}
    if isinstance(message, FollowThing):
        Servo(simulation, message.thing, read_options(FollowOptions, "follow", options))
        return
    hand = Hand(simulation, read_options(PickOptions, "pick", options))
    if isinstance(message, PickThing):
        hand.find_thing(message.thing)


def check_motion(simulation: Runner, motion: Motion) -> None:
    """Raise MotionError if a step is for a controller or topic that can't take it.

    A controller that isn't active must have been activated by an earlier step; whether
    that switch works is seen when its time comes.
    """
    if motion.repeats and not motion.duration >= simulation.period:
        problem = (
            f"a round of {motion.duration:g} s is shorter than a tick, "
            f"{simulation.period:g} s"
        )
        raise MotionError(problem, file=motion.file)
    states = {row.name: row.state for row in simulation.list_controllers()}
    activated: set[str] = set()
    for step in motion.steps:
        try:
            if isinstance(step.message, SetPayloads):
                simulation.check_payloads(step.message.payloads)
            elif isinstance(step.message, Task):
                if motion.repeats:
                    raise InputError("a motion that repeats can't plan; leave it out")
                if isinstance(step.message, PlanTo):
                    simulation.check_plan(step.message)
                else:
                    _check_task(simulation, step.message)
            elif isinstance(step.message, SwitchController):
                activated |= _check_switch(simulation, step.message)
            else:
                _check_message(simulation, step, states, activated)
        except InputError as error:
            problem = error.problem + _hint_at_needs(simulation, motion)
            raise _error_in(motion, step, problem) from None


def _hint_at_needs(simulation: Runner, motion: Motion) -> str:
    """Return the end of a message that says what the motion needs and lacks, or ""."""
    robot = next(iter(simulation.robots.values()))
    known = bundled_motions(robot.bundled or "").items()
    arguments = {
        name: str(value)
        for name, value in (robot.load_options.get("xacro_args") or {}).items()
    }
    build = find_build_info(simulation.diagram)
    needs = motion.needs
    has_all = needs.scene is None and needs.xacro_args.items() <= arguments.items()
    if has_all and (build is None or needs.world in (None, build.world)):
        return ""
    name = str(robot.bundled or robot.description.file)
    names = (name for name, file in known if file == motion.file)
    word = next(names, str(motion.file or "FILE"))
    return f"; the motion is for `{needs.command(name, word)}`"


def check_trajectories(simulation: Runner, motion: Motion) -> None:
    """Raise MotionError if a controller refuses a step's trajectory, as it is now.

    Where nobody watches, the end of a run is late to learn of a wrong name.
    """
    for step in motion.steps:
        message: Any = step.message
        names: tuple[str | None, ...] = (step.controller,)
        if isinstance(message, TopicMessage):
            names = simulation.topic(message.topic).controllers
            message = message.data
        for name in filter(None, names):  # A switch is for nobody.
            if fault := simulation.controller(name).find_lasting_fault(message):
                raise _error_in(motion, step, f"{name}: {fault}")


def _error_in(motion: Motion, step: MotionStep, problem: str) -> MotionError:
    return MotionError(problem, file=motion.file, line=step.line, where=step.where)


def list_beyond_limits(simulation: Runner, motion: Motion) -> list[str]:
    """Return the first place where each joint is sent beyond its limits, and how far.

    As upstream, controllers take such goals, and joints stop at their limits.
    """
    found: dict[tuple[str, str], str] = {}
    for step in motion.steps:
        message: Any = step.message
        name = step.controller
        if isinstance(message, TopicMessage):
            name = simulation.topic(message.topic).controllers[0]
            message = message.data
        trajectory = getattr(message, "trajectory", message)
        if not isinstance(trajectory, JointTrajectory):
            continue
        assert name is not None  # Only a switch is for nobody.
        robot = simulation.directory.find(name)[0].robot
        joints, place = robot.description.movable_joints, motion.place(step)
        start: dict[str, float] = {}
        if step.at == 0.0:
            state = simulation.joint_states(robot.name)
            start = dict(zip(state.name, state.position, strict=True))
        for index, joint, problem in LimitWatch(joints).find(trajectory, start):
            line = f"{place}.points[{index}]: {problem}"
            found.setdefault((robot.name, joint), line)
    return list(found.values())


def send_step(simulation: Runner, motion: Motion, step: MotionStep) -> None:
    """Send a step's message."""
    where, message = motion.place(step), step.message
    if isinstance(message, SwitchController):
        simulation.request_switch(message, where=where)
        return
    if isinstance(message, SetPayloads):
        for link, payload in message.payloads.items():
            simulation.set_payload(link, payload)
        return
    if isinstance(message, TopicMessage):
        simulation.topic(message.topic).publish(message.data, where=where)
        return
    assert not isinstance(message, Task)  # A player starts it, when the robot rests.
    clients.send_step(simulation.controller(_receiver(step)), message, where)


def _check_switch(simulation: Runner, message: SwitchController) -> set[str]:
    """Return what a switch activates; raise InputError if it names no controller."""
    for name in (*message.activate_controllers, *message.deactivate_controllers):
        simulation.directory.check_name(name)
    return set(message.activate_controllers)


def _check_message(
    simulation: Runner,
    step: MotionStep,
    states: Mapping[str, str],
    activated: Collection[str],
) -> None:
    names: tuple[str, ...]
    if isinstance(step.message, TopicMessage):
        topic = simulation.topic(step.message.topic)
        topic.check(step.message.data)
        names = topic.controllers
    else:
        names = (_receiver(step),)
        assert not isinstance(step.message, SetPayloads | Task)
        simulation.controller(names[0]).check(step.message)
    # Of several that read a topic, one is enough.
    if not any(states[name] == "active" or name in activated for name in names):
        missing = simulation.directory.find(names[0])[1].missing
        why = f": {'; '.join(missing)}" if missing else ""
        text = f"controller {names[0]!r} is {states[names[0]]}, not active"
        raise InputError(text + why)


def _receiver(step: MotionStep) -> str:
    assert step.controller is not None  # Only a switch is for nobody.
    return step.controller
