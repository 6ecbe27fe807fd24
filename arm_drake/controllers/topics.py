"""Topics of controllers: what is new on an input port, and what was not accepted."""

from collections.abc import Sequence
from typing import TypeAlias, TypeVar

from pydrake.systems.framework import Context, InputPort

from arm_drake.controllers.cycles import messages_on
from arm_drake.messages import Float64, Message, ParametersRejected, TopicRejected
from arm_drake.messages.base import add_news

M = TypeVar("M", bound=Message)

Rejection: TypeAlias = TopicRejected | ParametersRejected

# Why messages aren't taken.
CHAINED = "another controller commands the references"
INACTIVE = "the controller is not active"

# The latest news, numbered, the newest last.
Events: TypeAlias = tuple[tuple[int, Rejection], ...]


def new_messages(
    port: InputPort, context: Context, expected: type[M], seen: tuple[M, ...]
) -> tuple[tuple[M, ...], tuple[M, ...]]:
    """Return the messages that came since the last tick, and all that are there.

    A message is new if it is another object than those of the last tick.

    Args:
        port: Abstract input port: a message, a tuple of messages, or nothing.
        context: Context of its system.
        expected: Type of the messages.
        seen: What was there at the last tick; returned itself if it still is.

    Raises:
        TypeError: If something else is there.
    """
    if not port.HasValue(context):
        return (), seen if not seen else ()
    value = port.Eval(context)
    if value is seen or (len(seen) == 1 and value is seen[0]):
        return (), seen
    messages = messages_on(port, context, expected)
    new = tuple(m for m in messages if all(m is not old for old in seen))
    return new, seen if not new and len(messages) == len(seen) else messages


def new_parameters(port: InputPort, context: Context, seen: object) -> object:
    """Return the parameters on a port if they are others than those of the last tick.

    Equal ones aren't: a Context's clone holds a copy of what was fixed on its ports.

    Args:
        port: Abstract input port: parameters, or nothing.
        context: Context of its system.
        seen: What was there at the last tick; returned itself if there is nothing new.
    """
    if not port.HasValue(context):
        return seen
    offered = port.Eval(context)
    if offered is seen or (type(offered) is type(seen) and bool(offered == seen)):
        return seen
    return offered


def add_events(events: Events, news: Sequence[Rejection]) -> Events:
    """Return the latest events, those of this tick at their end.

    Args:
        events: What there was.
        news: What happened in this tick.
    """
    return add_news(events, news) if news else events


# Name of the port.
GRIPPER_COMMAND = "gripper_command"


def find_part_fault(message: Float64) -> str:
    """Return why a gripper can't take a `gripper_command`; empty if it can."""
    if 0.0 <= message.data <= 1.0:
        return ""
    return f"data must be from 0 (open) to 1 (closed), got {message.data}"


def position_of(part: float, ends: tuple[float, float]) -> float:
    """Return a position [rad] or [m] by a part: 0 is open, 1 is closed.

    Args:
        part: From 0 to 1.
        ends: Where the gripper is open and where closed [rad] or [m].
    """
    is_open, is_closed = ends
    return (1.0 - part) * is_open + part * is_closed
