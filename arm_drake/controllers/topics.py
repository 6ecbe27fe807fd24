"""Topics of controllers: who takes messages, what was refused, who publishes."""

import inspect
import textwrap
from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from operator import attrgetter, is_
from typing import (
    Any,
    ClassVar,
    Generic,
    NamedTuple,
    Protocol,
    Self,
    TypeAlias,
    TypeVar,
)

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import (
    SilentTicks,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
    messages_on,
)
from arm_drake.messages import (
    CancelResponse,
    Float64,
    GoalEvent,
    Header,
    Message,
    ParametersRejected,
    TopicRejected,
)
from arm_drake.messages.base import append_events

M = TypeVar("M", bound=Message)
P = TypeVar("P")
T = TypeVar("T", bound="TopicState")

# What a controller tells of messages.
Event: TypeAlias = TopicRejected | ParametersRejected | GoalEvent | CancelResponse

# Why messages aren't taken.
CHAINED = "another controller commands the references"
INACTIVE = "the controller is not active"
ALWAYS = (CHAINED, INACTIVE)

# The latest events, numbered, the newest last.
Events: TypeAlias = tuple[tuple[int, Event], ...]


def new_messages(
    port: InputPort, context: Context, expected: type[M], seen: tuple[M, ...]
) -> tuple[tuple[M, ...], tuple[M, ...]]:
    """Return the messages since the last tick, and all that are on the port.

    A message is new if it is another object than those of the last tick, `seen`, which
    is returned itself if it is still there. On the port is a message, a tuple of
    messages, or nothing; anything else is a TypeError.
    """
    if not port.HasValue(context):
        return (), seen if not seen else ()
    value = port.Eval(context)
    if value is seen or (len(seen) == 1 and value is seen[0]):
        return (), seen
    messages = messages_on(port, context, expected)
    known = set(map(id, seen))
    new = tuple(m for m in messages if id(m) not in known)
    return new, seen if not new and len(messages) == len(seen) else messages


def new_parameters(port: InputPort, context: Context, seen: object) -> object:
    """Return the parameters on a port if they are others than those of the last tick.

    Equal ones aren't: a Context's clone holds a copy of what was fixed on its ports.
    Where there is nothing new, `seen` is returned itself.
    """
    if not port.HasValue(context):
        return seen
    received_parameters = port.Eval(context)
    if received_parameters is seen or (
        type(received_parameters) is type(seen) and bool(received_parameters == seen)
    ):
        return seen
    return received_parameters


def check_change(old: P, new: object, read_only: Sequence[str]) -> P:
    """Return parameters that may take the place of others while a controller runs.

    `read_only` are dotted names of those that can't change.

    Raises:
        ValueError: If they aren't parameters of the same kind, or one has changed.
    """
    kind = type(old)
    if not isinstance(new, kind):
        raise ValueError(f"expected {kind.__name__}, got {new!r}")
    for name in read_only:
        if attrgetter(name)(new) != attrgetter(name)(old):
            raise ValueError(f"{name} can't change while the controller runs")
    return new


def add_events(events: Events, new_events: Sequence[Event]) -> Events:
    """Return the latest events, those of this tick at their end."""
    return append_events(events, new_events) if new_events else events


class Inbox(NamedTuple):
    """Input received on the topics of a controller."""

    # Messages on each port at the last tick; empty before the first one.
    seen: tuple[tuple[Message, ...], ...] = ()

    # What was on the port of parameters then.
    parameters: object = ()

    # The latest of all that was not accepted.
    events: Events = ()


def latest_reason(inbox: Inbox) -> str:
    """Return why the update fails that the latest message makes fail."""
    event = inbox.events[-1][1] if inbox.events else None
    reason = event.reason if isinstance(event, TopicRejected) else ""
    return reason.removesuffix("; the update fails")


def add_event(state: T, event: Event) -> T:
    """Return the state with one more event."""
    events = add_events(state.inbox.events, [event])
    return state._replace(inbox=state.inbox._replace(events=events))


class TopicState(Protocol):
    """State of a TopicController: a named tuple with these fields and its own."""

    @property
    def inbox(self) -> Inbox:
        """Return what came in."""

    @property
    def command(self) -> Array:
        """Return what to write, shape (k,); NaN leaves one as it is."""

    def _replace(self, *args: Any, **kwargs: Any) -> Self: ...


# Takes a message that came at a time [ns]; returns the new state, and what is wrong
# with the message.
TakeMessage: TypeAlias = Callable[[T, Any, int], tuple[T, str]]

# Takes parameters; returns the new state, or raises ValueError. The last argument is
# why no commands are taken.
TakeParameters: TypeAlias = Callable[[T, Any, str], T]


class _Topic(NamedTuple, Generic[T]):
    """A topic of a controller."""

    port: InputPort
    kind: type[Message]
    take: TakeMessage[T]

    # Why commands may not be taken, and its messages are all the same.
    despite: Collection[str]

    # What goes before the words that say what is wrong with a message.
    label: str


class TopicController(TickingController[T]):
    """Base of controllers that messages command, while they are inactive in vain.

    A subclass declares its topics by `_subscribe`, the last of its ports by
    `_declare_events`, and calls `_receive` in its `_update`.
    """

    def __init__(
        self, params: ControllerInterfaceParams, initial: T, **names: Any
    ) -> None:
        """Create the system without topics; `names` are as in TickingController."""
        super().__init__(params, initial, **names)
        self.message_types: dict[str, type[Message]] = {}
        # In the order in which their messages are taken.
        self._topics: list[_Topic[T]] = []
        # At most one.
        self._parameter_ports: list[tuple[InputPort, TakeParameters[T]]] = []

    def _subscribe(
        self,
        name: str,
        kind: type[Message],
        take: TakeMessage[T],
        *,
        despite: Collection[str] = (),
        label: str = "",
    ) -> None:
        """Declare the input port of a topic; `despite` and `label` as in _Topic."""
        port = self.DeclareAbstractInputPort(name, AbstractValue.Make(()))
        self.message_types[name] = kind
        self._topics.append(_Topic(port, kind, take, despite, label))

    def _subscribe_parameters(self, take: TakeParameters[T]) -> None:
        """Declare the input port of parameters to go on with."""
        port = self.DeclareAbstractInputPort(
            interfaces.PARAMETERS_PORT, AbstractValue.Make(())
        )
        self._parameter_ports.append((port, take))

    def _declare_events(self) -> None:
        """Declare the output port of what was not accepted."""
        self._declare_topic("events", lambda state: state.inbox.events)

    def _receive(self, now: UpdateContext, state: T, obstacle: str = "") -> T:
        """Return the state with what has come in; itself if nothing has."""
        if now.is_quiet:
            return state
        state = self._receive_parameters(now, state, obstacle)
        seen = state.inbox.seen or ((),) * len(self._topics)
        received: list[tuple[Message, ...]] = []
        for topic, before in zip(self._topics, seen, strict=True):
            new, messages = new_messages(topic.port, now.context, topic.kind, before)
            received.append(messages)
            for message in new:
                fault = "" if obstacle in topic.despite else obstacle
                if not fault:
                    state, fault = topic.take(state, message, now.time_ns)
                if fault:
                    rejected = TopicRejected(message, f"{topic.label}{fault}")
                    state = add_event(state, rejected)
        if all(map(is_, received, seen)):
            return state
        return state._replace(inbox=state.inbox._replace(seen=tuple(received)))

    def _receive_parameters(self, now: UpdateContext, state: T, obstacle: str) -> T:
        """Return the state with new parameters, if they can be taken."""
        for port, take in self._parameter_ports:
            seen = state.inbox.parameters
            new = new_parameters(port, now.context, seen)
            if new is seen:
                continue
            state = state._replace(inbox=state.inbox._replace(parameters=new))
            if new != ():  # Else nothing is on the port any more.
                try:
                    state = take(state, new, obstacle)
                except ValueError as error:
                    state = add_event(state, ParametersRejected(str(error)))
        return state

    def _idle(self, now: UpdateContext, state: T) -> T:
        return self._receive(now, state, INACTIVE)

    def rests(self, state: T) -> bool:
        """Return whether only a message can change the state while inactive."""
        return type(self)._receive is TopicController._receive

    def _command(self, state: T) -> Array:
        return state.command


# What a broadcaster published last.
S = TypeVar("S")


class SensorBroadcaster(TickingController[S]):
    """Base of broadcasters, whose state is what was published last.

    A subclass says what it reads and publishes, and makes its message by `_make`. Of
    several topics each is a field of the state. It has steady ticks of its own if its
    message doesn't follow from the values alone.
    """

    # Class of the message, or of the state.
    message: ClassVar[type]

    # Interfaces of the sensor that it reads, and the parameter with the sensor's name.
    names: ClassVar[tuple[str, ...]] = ()
    sensor: ClassVar[str] = "sensor_name"

    # For its documentation, which names all ports: what it reads, what it exports if it
    # does, and what is on each of its topics.
    reads: ClassVar[str]
    exports: ClassVar[str] = ""
    topics: ClassVar[Mapping[str, str]]

    def __init_subclass__(cls, **more: Any) -> None:
        """Add the ports to the documentation; what `_make` reads is given to it."""
        cls.__doc__ = _tabulate_ports(cls)
        cls.reads_by_now = cls._update is SensorBroadcaster._update
        super().__init_subclass__(**more)

    def __init__(
        self,
        parameters: Any,
        params: ControllerInterfaceParams,
        initial: S | None = None,
        *,
        state_interfaces: tuple[str, ...] = (),
        positions_of: tuple[str, ...] = (),
        without: Collection[str] = (),
    ) -> None:
        """Create the system.

        Positions of the joints `positions_of` are read behind the `state_interfaces`.
        """
        own, read = params.controller_name, state_interfaces
        if self.names:
            sensor = getattr(parameters, self.sensor)
            read = tuple(f"{sensor}/{name}" for name in self.names)
        is_exported = self.exports and params.distro != "humble"
        super().__init__(
            params,
            self.message() if initial is None else initial,
            state_interfaces=(*read, *(f"{joint}/position" for joint in positions_of)),
            exported_interfaces=tuple(f"{own}/{n}" for n in read if is_exported),
        )
        self._parameters = parameters
        for topic in self.topics:
            if topic not in without:
                show = attrgetter(topic) if len(self.topics) > 1 else _itself
                self._declare_topic(topic, show)

    @abstractmethod
    def _make(self, header: Header, values: Array, last: S) -> S:
        """Return what to publish, of what is read and what was published last."""

    def _update(self, now: UpdateContext, state: S) -> S:
        return self._make(self._header(now.time_ns), self._measured_now(now), state)

    def _header(self, time_ns: int) -> Header:
        """Return the header of what is published at a time [ns]."""
        return Header.from_nanoseconds(
            time_ns, getattr(self._parameters, "frame_id", "")
        )

    def steady(self, last: UpdateResult[S], time_ns: int) -> SteadyTicks[S] | None:
        """Return what makes a message of numbers when somebody looks at it."""
        return SteadyBroadcast(self, last.state)


class SteadyBroadcast(SilentTicks, Generic[S]):
    """Steady ticks of a broadcaster: of what was measured the last message is made."""

    def __init__(self, system: SensorBroadcaster[S], last: S) -> None:
        """Create it; `last` is what was published last."""
        self._system, self._last = system, last

    def _values(self, motions: Array) -> Array:
        return motions[self._system._read_at]

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> Sequence[float] | None:
        """Return no values, for it commands nothing."""
        return ()

    def commands_ahead(self, times_ns: Sequence[int]) -> Array | None:
        """Return no values at all times."""
        return np.empty((len(times_ns), 0))

    def state(self, time_ns: int, motions: Array, memory: Sequence[float]) -> S:
        """Return what a tick publishes."""
        system = self._system
        return system._make(system._header(time_ns), self._values(motions), self._last)


def _itself(message: S) -> S:
    return message


def _tabulate_ports(system: type[SensorBroadcaster[Any]]) -> str:
    """Return a broadcaster's documentation with the table of its ports."""
    summary, _, rest = inspect.cleandoc(system.__doc__ or "").partition("\n\n")
    ports = {
        "controller_manager": "Cycle: when to tick",
        "state_interfaces": f"everything that is measured; it reads {system.reads}",
        "command_interfaces": "UpdateResult; no commands",
    }
    if system.exports:
        ports["exported_state_interfaces"] = system.exports
    ports |= system.topics
    width = max(map(len, ports))
    line = f"{'=' * width}  {'=' * (80 - width)}"
    rows = [line, f"{'port':{width}}  meaning", line]
    for name, meaning in ports.items():
        first, *more = textwrap.wrap(meaning, 80 - width, break_on_hyphens=False)
        rows += [f"{name:{width}}  {first}", *(f"{'':{width}}  {m}" for m in more)]
    table = "\n".join([*rows, line])
    return f"{summary}\n\n{table}\n\n{rest}\n"


# Name of the port.
GRIPPER_COMMAND = "gripper_command"


def find_part_fault(message: Float64) -> str:
    """Return why a gripper can't take a `gripper_command`; empty if it can."""
    if 0.0 <= message.data <= 1.0:
        return ""
    return f"data must be from 0 (open) to 1 (closed), got {message.data}"


def position_of(part: float, ends: tuple[float, float]) -> float:
    """Return a position between the ends where a gripper is open, 0, and closed, 1."""
    is_open, is_closed = ends
    return (1.0 - part) * is_open + part * is_closed
