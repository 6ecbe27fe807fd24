"""Cycles and ticks: the data that manager and controllers exchange."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from pydrake.systems.framework import Context, InputPort

from arm_drake.arrays import Array
from arm_drake.messages import Message

S = TypeVar("S")
S_co = TypeVar("S_co", covariant=True)
M = TypeVar("M", bound=Message)
R = TypeVar("R", bound=tuple[Any, ...])


def with_field(record: R, index: int, value: object) -> R:
    """Return a named tuple with another value in a place, sooner than `_replace`."""
    values = (*record[:index], value, *record[index + 1 :])
    return tuple.__new__(type(record), values)


class Cycle(NamedTuple):
    """Input of the manager's controllers in a cycle."""

    # Number of the cycle, its time, and the time since the last one [ns].
    number: int
    time_ns: int
    period_ns: int

    # Active controllers, and the number of their activation.
    active: Mapping[str, int]

    # Those whose references are commanded by another controller.
    chained: frozenset[str] = frozenset()

    # Time since the last tick of controllers with a rate of their own [ns]; 0 if they
    # don't tick in this cycle.
    periods: Mapping[str, int] = {}

    # Values of the command interfaces if a switch has changed them, shape (k,).
    commands: Array | None = None

    # The last ticks of the controllers whose state the manager keeps.
    ticks: Mapping[str, "UpdateResult[Any]"] = {}

    # What lies on their ports: the same object as long as nothing new does; None if
    # that isn't known.
    inputs: object = None

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class UpdateResult(NamedTuple, Generic[S]):
    """Result of a tick of a controller."""

    # Number of the cycle; None before the first one.
    number: int | None

    # Number of the activation; None if the controller is inactive.
    activation: int | None

    # State of the controller.
    state: S

    # Values of its command interfaces, shape (k,); NaN is left as it is.
    command: Array

    # Whether the tick went well; a controller that fails is deactivated.
    is_ok: bool = True

    # Why it didn't.
    fault: str = ""

    # The cycle's `inputs` when the controller last looked at its ports.
    inputs: object = None

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


# Where the state stands in a result.
STATE: Final = UpdateResult._fields.index("state")


class SteadyTicks(Protocol[S_co]):
    """Ticks of a controller from a state on without new input, number by number.

    All methods are functions of their arguments and of that state alone, so the state
    after any such tick follows from what was measured in it, and from the numbers that
    the controller remembers, if any: see `TickingController.num_remembered`.
    """

    # From this time on it ticks in full, and from the other on it has to tell
    # something [ns].
    until_ns: int
    monitor_ns: int

    # Whether ticks that are known ahead hang on what `allows` says.
    is_judging: bool

    def report(
        self, time_ns: int, last_ns: int, motions: Array
    ) -> "tuple[S_co, SteadyTicks[S_co]] | None":
        """Return the state to go on from, with due reports, and its steady ticks.

        It differs from the one before in what has been told alone. None for a tick in
        full. `motions` is what was measured in the last tick, at `last_ns`.
        """

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> Sequence[float] | None:
        """Return the values that a tick commands; None if it has to be one in full.

        `motions` are as in HardwareValues. In `memory`, what the last tick has left, it
        puts what this one leaves, unless it returns None.
        """

    def commands_ahead(self, times_ns: Sequence[int]) -> Array | None:
        """Return what ticks command at times, a row for each, to the bit.

        They follow from the state alone, as long as it `allows` what is measured; None
        where what is measured counts for more.
        """

    def allows(self, time_ns: int, motions: Array) -> bool:
        """Return whether a tick that is known ahead is one; if not, it may be."""

    def state(self, time_ns: int, motions: Array, memory: Sequence[float]) -> S_co:
        """Return the state that this tick leaves behind."""


# A time that never comes [ns].
NEVER_NS = 2**63


class SilentTicks:
    """Steady ticks that report nothing; some number of them, or for ever."""

    monitor_ns = until_ns = NEVER_NS
    is_judging = False

    def report(self, time_ns: int, last_ns: int, motions: Array) -> None:
        """Return None, for nothing is reported."""
        return None

    def commands_ahead(self, times_ns: Sequence[int]) -> Array | None:
        """Return None, for what is measured counts."""
        return None

    def allows(self, time_ns: int, motions: Array) -> bool:
        """Return True: nothing is judged."""
        return True


class SteadyCommand(SilentTicks, Generic[S]):
    """Steady ticks that command the same."""

    def __init__(
        self,
        command: Array,
        state: S,
        sense: Callable[[S, int, Array], S] | None = None,
        *,
        until_ns: int = NEVER_NS,
    ) -> None:
        """Create it; `sense` returns the state with time and what is measured."""
        self._command, self._state, self._sense = command.tolist(), state, sense
        self.until_ns = until_ns

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> Sequence[float]:
        """Return the values that a tick commands."""
        return self._command

    def commands_ahead(self, times_ns: Sequence[int]) -> Array:
        """Return the same at all times."""
        return np.tile(np.array(self._command), (len(times_ns), 1))

    def state(self, time_ns: int, motions: Array, memory: Sequence[float]) -> S:
        """Return the state that a tick leaves behind."""
        if self._sense is None:
            return self._state
        return self._sense(self._state, time_ns, motions)


class HardwareValues(NamedTuple):
    """Values that a manager has read for all of its controllers."""

    # Positions and velocities of all J joints, shape (2 J,), or all that is measured,
    # these first, if one of those that tick reads more.
    motions: Array

    # What the command interfaces hold.
    values: Array


class UpdateContext(NamedTuple):
    """When and where a tick happens."""

    # Where inputs are read; None if `hardware_values` has all that is read.
    context: Context

    time_ns: int

    # Time since the last tick [ns].
    period_ns: int

    cycle: Cycle

    # Whether nothing can have come on the controller's ports since it last looked.
    is_quiet: bool = False

    # What else is read, where the manager has it at hand.
    hardware_values: HardwareValues | None = None


# Its older public name.
Now = UpdateContext


# How far the time may be off a tick and still be the tick, in periods.
_TICK_TOLERANCE = 1e-6


def last_cycle(context: Context, period: float) -> int:
    """Return the number of the cycle before now, below 0 before the first one.

    That of this very instant, if there is one, hasn't run.
    """
    return math.ceil(context.get_time() / period - _TICK_TOLERANCE) - 1


class MessageBatch:
    """Messages on a port: the first ones of a list that does nothing but grow.

    So many can be put on a port, one after the other, without copies of all before.
    """

    __slots__ = ("_growing", "_size")

    def __init__(self, growing: list[Message]) -> None:
        """Create it for all present messages."""
        self._growing, self._size = growing, len(growing)

    @property
    def messages(self) -> tuple[Message, ...]:
        """The messages, the newest last."""
        return tuple(self._growing[: self._size])

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, index: int) -> Message:
        return self.messages[index]

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


def messages_on(port: InputPort, context: Context, expected: type[M]) -> tuple[M, ...]:
    """Return the messages on an abstract port: one, several, or nothing.

    Several are a tuple or a MessageBatch.
    """
    if not port.HasValue(context):
        return ()
    value = port.Eval(context)
    if isinstance(value, MessageBatch):
        value = value.messages
    messages = value if isinstance(value, tuple) else (value,)
    for message in messages:
        if not isinstance(message, expected):
            raise TypeError(
                f"{port.get_system().get_name()}.{port.get_name()}: expected a "
                f"{expected.__name__}, got {message!r}"
            )
    return messages
