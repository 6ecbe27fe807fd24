"""Cycles and ticks: what manager and controllers tell each other."""

import math
from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, Self, TypeVar

from pydrake.systems.framework import Context, InputPort

from arm_drake.arrays import Array
from arm_drake.messages import Message

S = TypeVar("S")
M = TypeVar("M", bound=Message)


class Cycle(NamedTuple):
    """What the manager tells its controllers in a cycle."""

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
    """What a tick of a controller leaves behind."""

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


class HardwareValues(NamedTuple):
    """What a manager has read for all of its controllers."""

    # What is on a port of positions and velocities of all joints.
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


def messages_on(port: InputPort, context: Context, expected: type[M]) -> tuple[M, ...]:
    """Return the messages on an abstract port: one, a tuple of them, or nothing."""
    if not port.HasValue(context):
        return ()
    value = port.Eval(context)
    messages = value if isinstance(value, tuple) else (value,)
    for message in messages:
        if not isinstance(message, expected):
            raise TypeError(
                f"{port.get_system().get_name()}.{port.get_name()}: expected a "
                f"{expected.__name__}, got {message!r}"
            )
    return messages
