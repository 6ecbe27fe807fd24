"""What happened in a simulation besides its rows: goals and messages."""

import dataclasses as dc
import enum
import math
from collections.abc import Mapping
from typing import Any

# Plain data: what JSON can hold.
Plain = Any


@dc.dataclass(frozen=True)
class GoalRecord:
    """A goal of an action, and what became of it."""

    # Name of the controller, with that of its robot in front if there are several.
    controller: str

    # Class of the goal, such as "FollowJointTrajectoryGoal".
    type: str

    # When it was sent [s].
    sent_at: float

    # When its end was noticed [s], at most 50 cycles late; None if it is not done.
    ended_at: float | None

    # A GoalStatus: "SUCCEEDED", "ABORTED", ...
    status: str

    # Of a FollowJointTrajectory result; None if there is no such result.
    error_code: int | None = None

    # Why, in words; empty if there is nothing to say.
    error_string: str = ""

    # The goal's fields.
    goal: Mapping[str, Plain] = dc.field(default_factory=dict)

    # Fields of the result, if there is one.
    result: Mapping[str, Plain] | None = None


@dc.dataclass(frozen=True)
class SentMessage:
    """A message that was sent to a controller, or a request to the manager."""

    # When [s].
    time: float

    # Name as in ROS.
    topic: str

    # Class of the message, such as "JointTrajectory".
    type: str

    # Its fields.
    data: Mapping[str, Plain]


def to_plain(value: Any) -> Plain:
    """Return a message, or part of one, as data that JSON can hold.

    Numbers beyond all limits become the texts that `float` reads.

    Args:
        value: A dataclass, a sequence, a mapping, a path or a plain value.
    """
    if dc.is_dataclass(value) and not isinstance(value, type):
        fields = (field.name for field in dc.fields(value))
        return {name: to_plain(getattr(value, name)) for name in fields}
    if isinstance(value, enum.Enum):
        return to_plain(value.value)
    if isinstance(value, Mapping):
        return {str(key): to_plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [to_plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)
