"""RosServer: a simulation that talks to other people's programs.

One thread serves all transports. Between it and the thread that simulates there are
queues alone: what is told waits where the network looks for it every few milliseconds,
what comes in is done between two ticks, in the order of its arrival. A simulation never
waits for a client, and never wakes the network's thread.
"""

import asyncio
import collections
import importlib
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol, Self

from arm_drake.errors import (
    ArmDrakeError,
    InputError,
    MissingExtraError,
    OutputError,
    suggest,
)
from arm_drake.messages import (
    CancelResponse,
    GoalStatus,
    SwitchController,
    SwitchControllerResult,
)
from arm_drake.rollout.rollout import ClientInput
from arm_drake.simulation.mailbox import GoalHandle, SimulationEvent
from arm_drake.simulation.motion import TaskOutcome
from arm_drake.simulation.recording import History
from arm_drake.simulation.simulation import ResetRequested, Simulation
from arm_drake.timing import cycle_at
from arm_drake.wire.graph import (
    ERROR,
    INFO,
    WARN,
    Action,
    Call,
    GoalEvent,
    Graph,
    Request,
    Topic,
)
from arm_drake.wire.services import Controls, add_services
from arm_drake.wire.types import load_wire_types, to_fields, to_message

# How often the network looks for what is new, and a paused simulation for requests [s].
POLL_PERIOD, _PAUSED_PERIOD = 0.005, 0.005

# Requests that may wait for the next tick.
MAX_REQUESTS = 1000

# What libraries' threads have taken of clients, and nobody has read yet [bytes].
_MAX_UNREAD = 64_000_000

# A topic is told at most so often by the wall clock [Hz]: a simulation that runs faster
# than that leaves messages out.
_MAX_RATE = 1250.0

# Events of goals are looked for so often [s].
_EVENTS_PERIOD = 0.01

LOOPBACK = ("127.0.0.1", "::1", "localhost")


class TransportRow(NamedTuple):
    """A transport: where it is, and what it needs."""

    module: str
    name: str
    port: int
    extra: str
    package: str


# By the names of `--ros`.
TRANSPORTS: Mapping[str, TransportRow] = {
    "rosbridge": TransportRow(
        "arm_drake.wire.rosbridge", "Rosbridge", 9090, "ros", "cbor2"
    ),
    "foxglove": TransportRow(
        "arm_drake.wire.foxglove", "Foxglove", 8765, "foxglove", "foxglove"
    ),
    "zenoh": TransportRow("arm_drake.wire.zenoh", "Zenoh", 7447, "zenoh", "zenoh"),
}


# action_msgs/msg/GoalStatus.
STATUS: Mapping[GoalStatus, int] = {
    GoalStatus.PENDING: 1,
    GoalStatus.EXECUTING: 2,
    GoalStatus.SUCCEEDED: 4,
    GoalStatus.CANCELED: 5,
    GoalStatus.ABORTED: 6,
    GoalStatus.REJECTED: 6,
}


class Transport(Protocol):
    """Transport to clients; all is called in the network's thread."""

    name: ClassVar[str]

    async def start(self) -> list[str]:
        """Listen; return its address, and what to type on the other side."""

    def poll(self, received: Mapping[Topic, Sequence[dict[str, Any]]]) -> None:
        """Send what is new of topics that it watches."""

    def watched(self) -> Iterable[Topic]:
        """Return the topics that somebody listens to."""

    async def stop(self) -> None:
        """End."""


_REFUSALS = (RuntimeError, ValueError, TypeError, LookupError)


class _Goal:
    """A goal of a client."""

    def __init__(self, request: Request, action: Action, handle: GoalHandle) -> None:
        self.request, self.action, self.handle = request, action, handle
        self.reported: GoalStatus = GoalStatus.PENDING
        self.num_feedback = 0


class _Switch(NamedTuple):
    """A switch whose caller waits."""

    request: SwitchController
    reply: Callable[[dict[str, Any]], None]

    # Wall time at which the caller gives up [s].
    deadline: float


class RosServer:
    """Serves a simulation to programs that speak ROS 2's protocols."""

    def __init__(
        self,
        simulation: Simulation,
        transports: str | Sequence[str] = "rosbridge",
        *,
        host: str = "127.0.0.1",
        domain: int = 0,
        origins: Sequence[str] = (),
        distro: str | None = None,
        controls: Controls | None = None,
        keep_clock: bool = True,
        history: float | None = None,
        inputs: Iterable[ClientInput] = (),
    ) -> None:
        """Create it; `start` lets others in.

        Args:
            simulation: What is served.
            transports: Their names, with ":PORT" if it isn't the usual one; as a text
                with commas between them.
            host: Address to listen at. Any other than the loopback is open to all who
                reach this machine.
            domain: Domain of ROS 2, for zenoh.
            origins: Web pages' origins that may connect besides local ones.
            distro: Distribution whose types are spoken; by default the first robot's.
            controls: What pauses and resets; by default it pauses by itself, and a
                reset is refused.
            keep_clock: Whether the clock goes on growing after a reset.
            history: How much of the past the simulation has to keep at least [s]; by
                default all of it.
            inputs: What clients sent in another run, to be done again.

        Raises:
            InputError: If there is no such transport.
            MissingExtraError: If what it needs isn't installed.
        """
        robot = next(iter(simulation.robots.values()))
        self.simulation = simulation
        self.types = load_wire_types(distro or robot.distro)
        self.graph = Graph(simulation, self.types)
        self.host, self.domain = host, domain
        self.origins = tuple(origins)
        self.keep_clock = keep_clock
        self.controls: Controls = controls or _OwnControls()
        add_services(self)
        self._transports = [
            self._make(*_read_transport(word)) for word in _split(transports)
        ]
        self._history: History | None = None
        if history is not None:
            self._history = History(simulation.mailbox, history)
        self._inputs = collections.deque(sorted(inputs, key=lambda each: each.time))
        self._begin()
        simulation.on_event(self._take_event)
        simulation.exchange = self.exchange

    def _begin(self) -> None:
        """Make what changes while it runs."""
        # Lines that say where it listens.
        self.addresses: list[str] = []
        self.offset_ns = 0
        self._requests: collections.deque[Request] = collections.deque()
        self._replies: collections.deque[Callable[[], None]] = collections.deque()
        self._num_unread, self._unread_lock = 0, threading.Lock()
        self._watched: tuple[Topic, ...] = ()
        self._goals: dict[str, _Goal] = {}
        self._switches: list[_Switch] = []
        self._last_time = self.simulation.time
        self._events_due = 0.0
        self._trim_due = 0.0
        self._warn_due = 0.0
        self._polled = time.monotonic()
        self._thread: threading.Thread | None = None
        self._is_stopping = threading.Event()
        self._ready = threading.Event()
        self._error: BaseException | None = None

    def _make(self, name: str, port: int | None) -> Transport:
        row = TRANSPORTS[name]
        try:
            importlib.import_module(row.package)
        except ImportError:
            raise MissingExtraError(f"--ros {name}", row.extra) from None
        kind = getattr(importlib.import_module(row.module), row.name)
        transport: Transport = kind(self, row.port if port is None else port)
        return transport

    def start(self) -> Self:
        """Listen.

        Raises:
            OutputError: If an address can't be listened at.
        """
        if self._transports and self._thread is None:
            self._thread = threading.Thread(
                target=self._serve, name="arm_drake wire", daemon=True
            )
            self._thread.start()
            self._ready.wait()
            if self._error is not None:
                self._thread.join()
                self._detach()
                error, text = self._error, str(self._error)
                if isinstance(error, ArmDrakeError):
                    raise error
                if not isinstance(error, OSError):
                    raise error
                raise OutputError(f"--ros can't listen at {self.host}: {text}")
        return self

    def stop(self) -> None:
        """End all connections; the simulation goes on alone."""
        self._is_stopping.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
            self._thread = None
        self._detach()

    def _detach(self) -> None:
        if self.simulation.exchange == self.exchange:
            self.simulation.exchange = None

    def __enter__(self) -> Self:
        """Listen; leaving the block ends it."""
        return self.start()

    def __exit__(self, *error: object) -> None:
        """End all connections."""
        self.stop()

    # What the thread that simulates does.

    def exchange(self) -> float:
        """Do what came in, and take note of what is new; between two ticks.

        Returns:
            The time at which it has to be called next at the latest [s].

        Raises:
            ResetRequested: If a client asked for a reset.
        """
        now = self._look_at_time()
        until = math.inf
        if self._inputs:
            self._do_again(now)
            until = self._inputs[0].time if self._inputs else math.inf
        if cycle_at(now, self.simulation.period) is None:
            return until
        self._update(now)
        self._drain()
        while self.controls.is_waiting and not self._is_stopping.is_set():
            time.sleep(_PAUSED_PERIOD)
            self._drain()
            if not self.controls.is_waiting:
                # What was missed of real time isn't made up for.
                self.simulation.simulator.ResetStatistics()
        return until

    def idle(self) -> None:
        """Do what came in while time stands.

        Raises:
            ResetRequested: If a client asked for a reset.
        """
        self._look_at_time()
        self._drain()

    def _look_at_time(self) -> float:
        """Return the time [s]; if it has begun anew, take note of that."""
        now = self.simulation.time
        if now < self._last_time:
            self._note_reset(self._last_time)
        self._last_time = now
        return now

    def _update(self, now: float) -> None:
        if self._watched:
            self.graph.update(self._watched, now)
        if now >= self._events_due or now < self._events_due - 1.0:
            self._events_due = now + _EVENTS_PERIOD
            if self._goals or self._switches:
                self.simulation.collect_events()
            if self._history is not None and now >= self._trim_due:
                self._trim_due = now + 1.0
                self._history.trim()

    def _drain(self) -> None:
        self._give_up_switches()
        for _ in range(len(self._requests)):
            self._do(self._requests.popleft())

    def _do_again(self, now: float) -> None:
        while self._inputs and self._inputs[0].time <= now:
            each = self._inputs.popleft()
            self._do(
                Request(
                    each.kind,
                    each.name,
                    dict(each.data),
                    each.sender,
                    each.goal_id,
                    offset_ns=each.offset_ns,
                )
            )

    def _do(self, request: Request) -> None:
        try:
            getattr(self, f"_do_{request.kind}")(request)
        except ArmDrakeError as error:
            text = str(error)
            self._post(lambda: request.refuse(text))
        # A slip of ours must not end the simulation; nor may what Drake refuses.
        except (*_REFUSALS, ArithmeticError, AssertionError, AttributeError) as e:
            problem = f"it can't be done ({type(e).__name__}: {e})"
            self.warn(f"{request.kind} {request.name}: {problem}")
            self._post(lambda: request.refuse(problem))

    def _log(self, request: Request) -> None:
        """Keep a request that changes the simulation, with its sender."""
        self.simulation.mailbox.inputs.append(
            ClientInput(
                self.simulation.time,
                request.kind,
                request.name,
                request.sender,
                request.data,
                request.goal_id,
                request.offset_ns,
            )
        )

    def _do_publish(self, request: Request) -> None:
        topic = self.graph.topic(request.name)
        if topic.takes is None:
            raise InputError(f"nobody takes messages of topic {topic.name!r}")
        message = to_message(topic.takes, request.data, request.offset_ns)
        self._log(request)
        self.simulation.topic(topic.name).publish(message, where=request.sender)

    def _do_call(self, request: Request) -> None:
        service = self.graph.service(request.name)
        if service.acts:
            self._log(request)

        def reply(response: dict[str, Any]) -> None:
            self._post(lambda: request.reply(response))

        response = service.call(Call(request.data, request.sender, reply))
        if response is not None:
            reply(response)

    def _do_goal(self, request: Request) -> None:
        action = self.graph.action(request.name)
        goal: Any = to_message(action.goal, request.data, request.offset_ns)
        if request.goal_id in self._goals:
            raise InputError(f"goal {request.goal_id!r} is there already")
        self._log(request)
        controller = self.simulation.controller(action.controller)
        handle = controller.send_goal(goal, where=request.sender)
        self._goals[request.goal_id] = _Goal(request, action, handle)

    def _do_cancel(self, request: Request) -> None:
        goal = self._goals.get(request.goal_id)
        if goal is None:
            raise InputError(f"no goal {request.goal_id!r} that could be cancelled")
        self._log(request)
        self.simulation.controller(goal.action.controller).cancel(goal.handle)

    def request_reset(self) -> None:
        """Have the simulation begin anew, between two ticks."""
        if not self.controls.can_reset:
            raise InputError("the program that runs this simulation can't reset it")
        raise ResetRequested

    def _note_reset(self, time: float) -> None:
        """Take note that the simulation has begun anew, after a time [s]."""
        if self.keep_clock:
            self.offset_ns += round(time * 1e9)
        for topic in self.graph.topics.values():
            topic.reset()
        self._events_due = self._trim_due = 0.0
        for goal in list(self._goals.values()):
            self._update_goal(goal, GoalStatus.ABORTED, {}, "the simulation was reset")
        self._goals.clear()
        for switch in self._switches:
            switch.reply({"ok": False, "message": "the simulation was reset"})
        self._switches.clear()

    def add_switch(
        self,
        request: SwitchController,
        reply: Callable[[dict[str, Any]], None],
        timeout: float,
    ) -> None:
        """Reply when a switch is done, at the latest after a wall time [s]."""
        self._switches.append(_Switch(request, reply, time.monotonic() + timeout))

    def _give_up_switches(self) -> None:
        if self._switches:
            now = time.monotonic()
            for switch in [each for each in self._switches if each.deadline <= now]:
                self._switches.remove(switch)
                text = "the time is up, and no cycle of the manager came"
                switch.reply({"ok": False, "message": text})

    def _report(self, event: SimulationEvent) -> None:
        """Log an event on /rosout."""
        level, name = WARN, "controller_manager"
        if isinstance(event, GoalHandle):
            if not event.status.is_terminal:
                return
            name, text = event.controller, f"goal {event.status.value}"
            reason = getattr(event.result, "error_string", "") or event.note
            text = f"{text}: {reason}" if reason else text
            is_well = event.status in (GoalStatus.SUCCEEDED, GoalStatus.CANCELED)
            level = INFO if is_well else ERROR
        elif isinstance(event, SwitchControllerResult):
            level = INFO if event.ok else ERROR
            text = event.message or "controllers were switched"
        elif isinstance(event, CancelResponse):
            if event.accepted:
                return
            text = f"a goal can't be cancelled: {event.reason}"
        else:
            level = INFO if isinstance(event, TaskOutcome) else WARN
            text = self.simulation.mailbox.describe(event)
        self.graph.log(level, name, text, round(self.simulation.time * 1e9))

    def _take_event(self, event: SimulationEvent) -> None:
        self._report(event)
        if isinstance(event, SwitchControllerResult):
            for switch in [s for s in self._switches if s.request is event.request]:
                self._switches.remove(switch)
                switch.reply({"ok": event.ok, "message": event.message})
        elif isinstance(event, GoalHandle):
            for goal in [g for g in self._goals.values() if g.handle is event]:
                self._take_goal(goal)
        elif isinstance(event, CancelResponse) and not event.accepted:
            for goal in self._goals.values():
                if goal.handle.request is event.request.request:
                    answer = GoalEvent(
                        goal.request.goal_id, goal.action, "cancel", reason=event.reason
                    )
                    self._reply(goal, answer)

    def _take_goal(self, goal: _Goal) -> None:
        """Send a client the news of its goal."""
        handle = goal.handle
        is_new = goal.reported is GoalStatus.PENDING
        if is_new and handle.status not in (GoalStatus.PENDING, GoalStatus.REJECTED):
            goal.reported = GoalStatus.EXECUTING
            self._update_goal(goal, GoalStatus.EXECUTING, {}, "", kind="accepted")
        feedback = handle.feedback
        for each in feedback[goal.num_feedback :]:
            fields = to_fields(each, self.offset_ns)
            self._update_goal(goal, GoalStatus.EXECUTING, fields, "", kind="feedback")
        goal.num_feedback = len(feedback)
        if handle.status.is_terminal and not goal.reported.is_terminal:
            goal.reported = handle.status
            result = to_fields(handle.result) if handle.result is not None else {}
            reason = getattr(handle.result, "error_string", "") or handle.note
            self._update_goal(goal, handle.status, result, reason)
            self._goals.pop(goal.request.goal_id, None)

    def _update_goal(
        self,
        goal: _Goal,
        status: GoalStatus,
        data: dict[str, Any],
        reason: str,
        kind: str = "",
    ) -> None:
        if not kind:
            kind = "rejected" if status is GoalStatus.REJECTED else "result"
        type_ = f"{goal.action.type}_{'Feedback' if kind == 'feedback' else 'Result'}"
        stamp_ns = round(self.simulation.time * 1e9) + self.offset_ns
        self._reply(
            goal,
            GoalEvent(
                goal.request.goal_id,
                goal.action,
                kind,
                STATUS[status],
                self.types.complete(type_, data),
                reason,
                stamp_ns,
            ),
        )

    def _reply(self, goal: _Goal, event: GoalEvent) -> None:
        self._post(lambda: goal.request.reply(event))

    def _post(self, act: Callable[[], None]) -> None:
        """Have the network's thread do something, when it looks next."""
        if self._thread is not None:
            self._replies.append(act)

    # What the network's thread does.

    def submit(self, request: Request) -> None:
        """Queue a request; it is done at the next tick.

        Raises:
            InputError: If too much waits already.
        """
        if len(self._requests) >= MAX_REQUESTS:
            raise InputError(
                f"{MAX_REQUESTS} requests wait for the next tick; send fewer at a time"
            )
        self._requests.append(request._replace(offset_ns=self.offset_ns))

    def post(self, act: Callable[[], None], size: int = 0) -> bool:
        """Have the network's thread do something; for threads of libraries.

        What is over so much that waits is dropped, and said.

        Args:
            act: What is to be done.
            size: Of the message that it keeps [bytes].

        Returns:
            Whether it will be done.
        """

        def read() -> None:
            with self._unread_lock:
                self._num_unread -= size
            act()

        with self._unread_lock:
            is_room = self._num_unread + size <= _MAX_UNREAD
            is_room = is_room and len(self._replies) <= MAX_REQUESTS * 10
            if is_room:
                self._num_unread += size
                self._replies.append(read)
        if not is_room:
            self.warn("too much comes in at once; some of it is dropped")
        return is_room

    @property
    def now_ns(self) -> int:
        """The time of the last tick [ns], by the clock that clients see."""
        return round(self._last_time * 1e9) + self.offset_ns

    def warn(self, text: str) -> None:
        """Print a warning, at most ten times a second."""
        now = time.monotonic()
        if now >= self._warn_due:
            self._warn_due = now + 0.1
            print(f"warning: --ros: {text}", file=sys.stderr)
            self.graph.log(WARN, "arm_drake", text, round(self._last_time * 1e9))

    def watch(self) -> None:
        """Look which topics somebody listens to."""
        names = {id(t): t for each in self._transports for t in each.watched()}
        # Late listeners of what is latched want to know what was told before.
        latched = {id(t): t for t in self.graph.topics.values() if t.qos.is_latched}
        found = (latched | names).values()
        self._watched = tuple(t for t in found if t.read is not None)

    def _serve(self) -> None:
        try:
            asyncio.run(self._run())
        except BaseException as error:
            self._error = error
        finally:
            self._ready.set()

    async def _run(self) -> None:
        started: list[Transport] = []
        try:
            for transport in self._transports:
                self.addresses += await transport.start()
                started.append(transport)
            self.watch()
            self._ready.set()
            while not self._is_stopping.is_set():
                self._poll()
                await asyncio.sleep(POLL_PERIOD)
            self._poll()
        finally:
            for transport in started:
                await transport.stop()

    def _poll(self) -> None:
        for _ in range(len(self._replies)):
            self._attempt(self._replies.popleft())
        new: dict[Topic, list[dict[str, Any]]] = {}
        now = time.monotonic()
        limit = math.ceil((now - self._polled) * _MAX_RATE)
        self._polled = now
        for topic in self._watched:
            for _ in range(len(topic.waiting) - limit):
                topic.waiting.popleft()
            while topic.waiting:
                fields = topic.convert(topic.waiting.popleft(), self.offset_ns)
                if fields is not None:
                    new.setdefault(topic, []).append(fields)
                    if topic.qos.is_latched:
                        topic.constant = fields
        for transport in self._transports:
            self._attempt(lambda transport=transport: transport.poll(new))  # type: ignore[misc]

    def _attempt(self, act: Callable[[], None]) -> None:
        """Do something for a client; what fails for one is no matter of others."""
        try:
            act()
        except Exception as error:  # A slip of ours must not end all connections.
            print(f"arm_drake: --ros: {type(error).__name__}: {error}", file=sys.stderr)


class _OwnControls:
    """Pauses by letting the thread that simulates wait."""

    can_reset = False

    def __init__(self) -> None:
        self.is_waiting = False

    def pause(self) -> None:
        self.is_waiting = True

    def play(self) -> None:
        self.is_waiting = False


def _split(transports: str | Sequence[str]) -> list[str]:
    words = transports.split(",") if isinstance(transports, str) else list(transports)
    return [word.strip() for word in words if word.strip()]


def _read_transport(word: str) -> tuple[str, int | None]:
    """Return name and port of "rosbridge" or "rosbridge:9090"."""
    name, colon, port = word.partition(":")
    if name not in TRANSPORTS:
        raise InputError(f"--ros: no transport {name!r}; {suggest(name, TRANSPORTS)}")
    if not colon:
        return name, None
    if not port.isdecimal() or not 0 <= int(port) < 2**16:
        raise InputError(f"--ros {word}: expected a port from 0 to 65535, got {port!r}")
    return name, int(port)


def run(
    server: RosServer,
    duration: float,
    *,
    motion: Any = None,
    realtime_rate: float = 1.0,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Simulate for a while [s], anew from the start after a reset."""
    server.controls.can_reset = True
    while True:
        try:
            server.simulation.run(duration, motion, realtime_rate, progress)
        except ResetRequested:
            server.simulation.reset()
        else:
            return
