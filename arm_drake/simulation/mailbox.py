"""Messages into a running diagram, its events, and the handles of goals."""

import dataclasses as dc
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, InputPort, OutputPort

from arm_drake.controllers.cycles import MessageBatch
from arm_drake.description.robot import Robot
from arm_drake.manager import MANAGER, ControllerManager
from arm_drake.manager.state import CommandLimited, ControllerFailure
from arm_drake.messages import (
    CancelResponse,
    Float32,
    Float64,
    Float64MultiArray,
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryResult,
    GoalEvent,
    GoalStatus,
    GripperCommandResult,
    JointTrajectory,
    Message,
    MultiDOFCommand,
    ParallelGripperCommandResult,
    ParametersRejected,
    Result,
    SendGoal,
    SpeedScalingFactor,
    SwitchControllerResult,
    TopicRejected,
)
from arm_drake.rollout.rollout import ClientInput
from arm_drake.simulation.motion import LimitWatch, PlanTo, TaskOutcome
from arm_drake.simulation.topics import describe_grip


class GoalHandle:
    """A goal that was sent to a controller: what an action client sees of it."""

    def __init__(self, controller: str, request: SendGoal, where: str) -> None:
        """Create the handle; `ControllerHandle.send_goal` does that."""
        self.controller, self.request, self.where = controller, request, where
        self.status = GoalStatus.PENDING
        self.result: Result | None = None

        # When it was sent, and when its end was noticed, at most 50 cycles late [s].
        self.sent_at = 0.0
        self.ended_at: float | None = None

        # What of the goal was not taken as written.
        self.note = ""

        # What its result doesn't tell: which joint violated which tolerance.
        self.detail = ""

        # Whether it is part of a task, as a gripper's that stalls on a thing: what
        # became of the task says whether anything failed.
        self.is_part = False

        self._feedback: list[FollowJointTrajectoryFeedback] = []
        self._sources: list[Callable[[], FollowJointTrajectoryFeedback]] = []

    def update(self, event: GoalEvent) -> None:
        """Take an event of this goal."""
        self.status = event.status
        self.result = event.result or self.result
        self.note = event.note or self.note
        self.detail = event.detail or self.detail
        if event.feedback_source is not None:
            self._sources.append(event.feedback_source)

    @property
    def feedback(self) -> list[FollowJointTrajectoryFeedback]:
        """All feedback so far, the newest last."""
        self._feedback += [make() for make in self._sources]
        self._sources.clear()
        return self._feedback

    def forget_feedback(self) -> None:
        """Forget all feedback so far."""
        self._feedback, self._sources = [], []

    def describe(self) -> str:
        """Return status and result in words."""
        text, result, why = self.status.value, self.result, self.note
        if isinstance(result, FollowJointTrajectoryResult):
            text += f", error code {int(result.error_code)}"
            why = result.error_string
        elif isinstance(result, GripperCommandResult):
            text += describe_grip(result, (result.position,))
        elif isinstance(result, ParallelGripperCommandResult):
            text += describe_grip(result, result.state.position)
        text = f"{text}: {why}" if why else text
        return f"{text} ({self.detail})" if self.detail else text

    def __repr__(self) -> str:
        """Return controller, status and result."""
        return f"<GoalHandle of {self.controller!r}: {self.describe()}>"


Rejection: TypeAlias = TopicRejected | ParametersRejected
Failure: TypeAlias = ControllerFailure | SwitchControllerResult

SimulationEvent: TypeAlias = (
    GoalHandle | Rejection | CancelResponse | Failure | CommandLimited | TaskOutcome
)


# How goals end that failed.
_FAILED = (GoalStatus.REJECTED, GoalStatus.ABORTED)

# So many trajectories of one instant are watched for limits, for each robot.
_MOST_WATCHED = 100

# What `AbstractValue.Make` makes of an object, found once.
_Value = Value[object]

# So many messages are remembered before any is forgotten.
_MIN_PLACES = 2000


class _Source(NamedTuple):
    """A port of a controller or manager on which numbered events are."""

    port: OutputPort

    # Name of the controller with its robot's prefix, or this prefix alone.
    name: str


class Sent(NamedTuple):
    """A message that was put on a port."""

    # When [s].
    time: float

    # Input port of the diagram.
    port: str

    message: Message


class Mailbox:
    """Puts messages on the ports of a diagram, and collects the events."""

    def __init__(
        self,
        diagram: Diagram,
        simulator: Simulator,
        managers: Iterable[ControllerManager],
    ) -> None:
        """Create it, with nothing sent."""
        self.move_to(diagram, simulator, managers)
        self.reset()

    def move_to(
        self,
        diagram: Diagram,
        simulator: Simulator,
        managers: Iterable[ControllerManager],
    ) -> None:
        """Serve another diagram with the same ports from now on."""
        self.diagram = diagram
        self.simulator = simulator
        self._sources = []
        self._ports: dict[str, InputPort] = {}

        # What watches trajectories for limits of joints, by the robots' prefixes.
        self._watches: dict[str, LimitWatch] = {}

        # Why controllers can't be activated, by name.
        self._obstacles: dict[str, str] = {}
        for manager in managers:
            self._obstacles |= {
                f"{manager.prefix}{controller.name}": "; ".join(controller.missing)
                for controller in manager.controllers
                if controller.missing
            }
            self._sources += [
                _Source(
                    controller.system.GetOutputPort("events"),
                    f"{manager.prefix}{controller.name}",
                )
                for controller in manager.controllers
                if controller.system is not None
                and controller.system.HasOutputPort("events")
            ]
            self._sources.append(
                _Source(manager.GetOutputPort("events"), manager.prefix)
            )

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.simulator.get_context().get_time())

    def reset(self) -> None:
        """Forget all, as the simulation begins anew."""
        self._next_event = [0] * len(self._sources)

        # Of robots, by their prefixes: a time [s], how many trajectories were watched
        # for limits then, and where the joints are.
        self._starts: dict[str, tuple[float, int, dict[str, float]]] = {}

        # What lies on the ports.
        self._lying: dict[str, list[Sent]] = {}

        # When [s] and for what period [s] a port got its last value, the value, and the
        # messages in it, to which more are added.
        self._published: dict[
            str, tuple[float, float, MessageBatch, list[Message]]
        ] = {}

        # What is to be put on ports, and when [s], the next one first.
        self.waiting: dict[str, list[tuple[float, Message]]] = {}
        self._periods: dict[str, float] = {}

        # Goals, and other messages with the place that they come from, by their id.
        self._handles: dict[int, GoalHandle] = {}
        self._places: dict[int, tuple[Message, str]] = {}
        self._max_places = _MIN_PLACES

        # Name of the source of each rejection and failure, by its id.
        self._names: dict[int, str] = {}

        # What was sent, the latest last.
        self.sent: list[Sent] = []

        # What clients of other programs asked for, in order.
        self.inputs: list[ClientInput] = []

        # Events of the simulation itself.
        self._own: list[Rejection | TaskOutcome] = []

        self.goals: list[GoalHandle] = []
        self.tasks: list[TaskOutcome] = []
        self.rejected: list[Rejection] = []
        self.failures: list[Failure] = []

    def add_goal(self, goal: GoalHandle) -> None:
        """Take note of a goal that is being sent."""
        goal.sent_at = self.time
        self._handles[id(goal.request)] = goal
        self.goals.append(goal)

    def add_message(self, message: Message, where: str) -> None:
        """Take note of where a message that is being sent comes from."""
        self._places[id(message)] = (message, where)
        if len(self._places) > self._max_places:
            self._forget_places()

    def reject(self, message: Message, reason: str, where: str) -> None:
        """Take note of a message that can't be sent on."""
        self.add_message(message, where)
        self._own.append(TopicRejected(message, reason))

    def end_task(self, outcome: TaskOutcome) -> None:
        """Take note of what became of a task; what was planned has goals of its own."""
        if not isinstance(outcome.task, PlanTo):
            self.tasks.append(outcome)
        if outcome.reason:
            self.reject(outcome.task, outcome.reason, outcome.where)
        else:
            self._own.append(outcome)

    @property
    def failed_goals(self) -> list[GoalHandle]:
        """Goals that were rejected or aborted, in the order they were sent."""
        return [g for g in self.goals if g.status in _FAILED and not g.is_part]

    def _forget_places(self) -> None:
        """Forget where messages came from that lie on no port and weren't refused."""
        lying = [each.message for sent in self._lying.values() for each in sent]
        reported = [getattr(event, "message", None) for event in self.rejected]
        reported += [getattr(event, "request", None) for event in self.failures]
        kept = {id(message) for message in (*lying, *reported)}
        # Those that came last may be refused yet.
        recent = set(list(self._places)[-_MIN_PLACES // 2 :])
        self._places = {
            key: place
            for key, place in self._places.items()
            if key in kept or key in recent
        }
        self._max_places = max(_MIN_PLACES, 2 * len(self._places))

    def publish(self, port: str, message: Message, period: float) -> None:
        """Put a message on a port; those of before stay while they may be unseen.

        `period` [s] is that of who reads it.
        """
        context = self.simulator.get_mutable_context()
        time, input_port = context.get_time(), self._ports.get(port)
        if input_port is None:
            input_port = self._ports[port] = self.diagram.GetInputPort(port)
        new = Sent(time, port, message)
        self.sent.append(new)
        # What the context doesn't know was sent after it: it is one of before.
        lying = input_port.Eval(context) if input_port.HasValue(context) else ()
        last = self._published.get(port)
        if last is None or last[:2] != (time, period) or last[2] is not lying:
            if isinstance(lying, MessageBatch):
                lying = lying.messages
            known = set(map(id, lying)) if isinstance(lying, tuple) else {id(lying)}
            sent = [
                other
                for other in self._lying.get(port, ())
                if other.time > time - 2.0 * period and id(other.message) in known
            ]
            self._lying[port] = sent
            messages = [other.message for other in sent]
        else:  # All that was kept then is kept now.
            messages = last[3]
        self._lying[port].append(new)
        messages.append(message)
        batch = MessageBatch(messages)
        self._published[port] = (time, period, batch, messages)
        input_port.FixValue(context, _Value(batch))

    def schedule(
        self, port: str, messages: Iterable[tuple[float, Message]], period: float
    ) -> None:
        """Put messages on a port when it is their time [s]; no others that wait are."""
        # The last one comes first, to be taken off the end.
        self.waiting[port] = sorted(messages, key=lambda each: -each[0])
        self._periods[port] = period

    def forget_waiting(self, prefix: str) -> None:
        """Put nothing that waits on ports whose names begin so."""
        for port in [name for name in self.waiting if name.startswith(prefix)]:
            del self.waiting[port]

    def publish_due(self, time: float) -> float:
        """Put on ports what is due at a time [s]; return when to be called next."""
        for port, messages in tuple(self.waiting.items()):
            while messages and messages[-1][0] <= time:
                self.publish(port, messages.pop()[1], self._periods[port])
            if not messages:
                del self.waiting[port]
        return min((rows[-1][0] for rows in self.waiting.values()), default=math.inf)

    def eval_output(self, port: str) -> Any:
        """Return the present value of an output port of the diagram."""
        return self.diagram.GetOutputPort(port).Eval(self.simulator.get_context())

    def watch_limits(
        self, robot: Robot, prefix: str
    ) -> tuple[LimitWatch, Mapping[str, float]] | None:
        """Return what finds joints beyond their limits, and where they are now.

        Of very many trajectories of one instant the first ones are watched, for it
        takes about as long as sending them: then there is None.
        """
        now = self.time
        then, count, start = self._starts.get(prefix, (math.nan, 0, {}))
        if then != now:
            names = [joint.name for joint in robot.description.movable_joints]
            values = self.eval_output(f"{prefix}joint_states").tolist()
            count, start = 0, dict(zip(names, values, strict=False))
        self._starts[prefix] = now, count + 1, start
        if count >= _MOST_WATCHED:
            return None
        if prefix not in self._watches:
            self._watches[prefix] = LimitWatch(robot.description.movable_joints)
        return self._watches[prefix], start

    def forget_before(self, time: float) -> None:
        """Forget what was sent before a time [s], and feedback of ended goals."""
        self.sent = [sent for sent in self.sent if sent.time >= time]
        self.inputs = [each for each in self.inputs if each.time >= time]
        for goal in self.goals:
            if goal.ended_at is not None and goal.ended_at < time:
                goal.forget_feedback()

    def collect(self) -> Iterator[SimulationEvent]:
        """Yield the events since the last time, one source after the other.

        A goal's handle knows no more than what was told so far.
        """
        root = self.simulator.get_context()
        own, self._own = self._own, []
        for rejection in own:
            yield from self._take(rejection, "")
        for index, (port, name) in enumerate(self._sources):
            events = port.Eval(port.get_system().GetMyContextFromRoot(root))
            first = self._next_event[index]
            self._next_event[index] = events[-1][0] + 1 if events else 0
            # If the last one is older than what was seen, the context is one of before.
            if events and events[-1][0] >= first:
                for number, event in events:
                    if number >= first:
                        yield from self._take(event, name)

    def _take(
        self,
        event: GoalEvent
        | Rejection
        | CancelResponse
        | Failure
        | CommandLimited
        | TaskOutcome,
        name: str,
    ) -> list[SimulationEvent]:
        """Take note of an event; return it, or nothing if nobody waits for it."""
        if name in self._obstacles and isinstance(event, GoalEvent | TopicRejected):
            event = _with_obstacle(event, self._obstacles[name])
        if isinstance(event, GoalEvent):
            handle = self._handles.get(id(event.request))
            if handle is None:  # Sent past the Simulation, by a system of the user's.
                return []
            handle.update(event)
            if handle.status.is_terminal and handle.ended_at is None:
                handle.ended_at = self.time
            return [handle]
        if isinstance(event, TopicRejected | ParametersRejected):
            self._names[id(event)] = name
            self.rejected.append(event)
        elif isinstance(event, CommandLimited):
            self._names[id(event)] = name
        elif isinstance(event, ControllerFailure) or (
            isinstance(event, SwitchControllerResult) and not event.ok
        ):
            self._names[id(event)] = name
            self.failures.append(event)
        return [event]

    def describe(
        self, event: Rejection | Failure | CommandLimited | TaskOutcome
    ) -> str:
        """Return one line about a rejection or a failure: where, who, what, why."""
        if isinstance(event, TaskOutcome):
            return event.describe()
        name = self._names.get(id(event), "")
        if isinstance(event, CommandLimited):
            return f"{name}joint {event.joint!r}: commands are held to its limits"
        if isinstance(event, ControllerFailure):
            return f"{name}{event.controller}: {_describe_failure(event)}"
        if isinstance(event, ParametersRejected):
            return f"{name}: parameters refused: {event.reason}"
        if isinstance(event, SwitchControllerResult):
            place = self._place(event.request)
            return f"{place}{name}{MANAGER}: switch refused: {event.message}"
        kind = _KINDS.get(type(event.message), "message")
        if not name:  # No controller got it.
            return f"{self._place(event.message)}{event.reason}"
        return f"{self._place(event.message)}{name}: {kind} refused: {event.reason}"

    def _place(self, message: Message) -> str:
        """Return the start of a line about a message: where it comes from."""
        _, where = self._places.get(id(message), (None, ""))
        return f"{where}: " if where else ""


def _with_obstacle(
    event: GoalEvent | TopicRejected, obstacle: str
) -> GoalEvent | TopicRejected:
    """Return a rejection that says why it is no use to activate the controller."""
    text = f"the controller can't be activated: {obstacle}"
    if isinstance(event, TopicRejected):
        return dc.replace(event, reason=text)
    if isinstance(event.result, FollowJointTrajectoryResult):
        return dc.replace(event, result=dc.replace(event.result, error_string=text))
    return dc.replace(event, note=text)


# What messages are called.
_KINDS: dict[type[Message], str] = {
    JointTrajectory: "trajectory",
    Float64: "command",
    Float32: "command",
    Float64MultiArray: "commands",
    MultiDOFCommand: "commands",
    SpeedScalingFactor: "speed scaling",
}


def _describe_failure(event: ControllerFailure) -> str:
    others = [repr(name) for name in event.deactivated if name != event.controller]
    reason = f" ({event.reason})" if event.reason else ""
    text = f"the update failed{reason}"
    text += ", the controller is deactivated" if event.deactivated else ""
    if others:
        text += f", its chain too: {', '.join(others)}"
    if event.activated:
        text += f"; active in its place: {', '.join(map(repr, event.activated))}"
    return "; ".join((text, *event.problems))
