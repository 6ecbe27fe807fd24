"""One step of a motion file: when, to whom, and what."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.errors import suggest
from arm_drake.messages import (
    Float64MultiArray,
    GripperCommand,
    SpeedScalingFactor,
    SwitchController,
    Twist,
)
from arm_drake.simulation.fields import Fields
from arm_drake.simulation.motion import MotionStep, StepMessage, TopicMessage
from arm_drake.simulation.tables import KIND as TABLE
from arm_drake.simulation.tables import read_table
from arm_drake.simulation.trajectories import read_goal, read_trajectory

# Key of the last item of a motion that starts over.
REPEAT = "repeat"

# More repetitions than this are a slip, and would fill the memory.
_MAX_COUNT = 100_000

# Keys that say whom a step is for.
_RECEIVERS = ("controller", "topic", "topics")

# Whom each kind of step may be for; that without any is for the controller manager.
_KINDS: Mapping[str, tuple[str, ...]] = {
    "goal": ("controller",),
    "trajectory": ("controller", "topic"),
    TABLE: ("controller", "topic"),
    "cancel": ("controller",),
    "commands": ("controller",),
    "gripper_command": ("controller",),
    "cmd_vel": ("controller",),
    "speed_scaling": ("controller",),
    "switch_controllers": (),
    "data": ("topic",),
    "commands_from_to": ("controller",),
    "data_from_to": ("topics",),
}

_RAMPS = ("commands_from_to", "data_from_to")

_COMMON_KEYS = ("at", "every", "count", "ping_pong", *_RECEIVERS)

_SWITCH_KEYS = ("activate", "deactivate", "strictness")
_STRICTNESS = ("strict", "best_effort")


def parse_step(item: Any, index: int, file: Path | None) -> list[MotionStep]:
    """Return what a step sends: one message, or several one after the other.

    Args:
        item: The step as the file has it.
        index: Its number in the file, counted from 0.
        file: The file, for messages.

    Raises:
        MotionError: If it is malformed.
    """
    fields = Fields(f"[{index}]", file)
    return list(_Step(fields.mapping(item, ""), fields, file).parse())


class _Step:
    """One step of a motion file on its way to messages."""

    def __init__(
        self, item: Mapping[str, Any], fields: Fields, file: Path | None
    ) -> None:
        self._item = item
        self._fields = fields
        self._file = file

    def parse(self) -> Iterator[MotionStep]:
        fields, item = self._fields, self._item
        if REPEAT in item:
            raise fields.error(REPEAT, "it is the last item of a motion")
        fields.mapping(item, "", (*_KINDS, *_COMMON_KEYS, REPEAT))
        chosen = [key for key in _KINDS if key in item]
        if len(chosen) != 1:
            raise fields.error("", f"expected one of {sorted(_KINDS)}, got {chosen}")
        (kind,) = chosen
        names = self._receivers(kind)
        controller = item.get("controller")
        if kind in _RAMPS:
            rows = self._ramp(kind, item[kind])
            times = self._times(len(rows))
            sent = [self._row_messages(kind, names, row) for row in rows]
        elif kind == TABLE:
            sent = self._table(item[kind])
            times = self._times(len(sent))
        else:
            if "ping_pong" in item:
                problem = f"only {' and '.join(_RAMPS)} have it"
                raise fields.error("ping_pong", problem)
            message = self._message(kind, item[kind])
            times = self._times()
            sent = [[message]] * len(times)
        every = fields.seconds(item.get("every", 0.0), "every")
        for at, messages in zip(times, sent, strict=True):
            for each in messages:
                where = f"{fields.step}.{kind}"
                yield MotionStep(at, controller, each, where, every)

    def _receivers(self, kind: str) -> tuple[str, ...]:
        """Return the names of whom the step is for; none is the controller manager."""
        fields, item, allowed = self._fields, self._item, _KINDS[kind]
        given = [key for key in _RECEIVERS if key in item]
        for key in given:
            if not allowed:
                problem = f"{kind} is for the controller manager; leave it out"
                raise fields.error(key, problem)
            if key not in allowed:
                problem = f"{kind} goes with {' or '.join(allowed)}; leave it out"
                raise fields.error(key, problem)
        if len(given) > 1:
            problem = f"the step is for a {given[0]} already; leave it out"
            raise fields.error(given[1], problem)
        if not allowed:
            return ()
        key = given[0] if given else allowed[0]
        value = item.get(key)
        if key == "topics":
            return self._topics(value)
        if not isinstance(value, str):
            raise fields.error(key, f"expected a name, got {value!r}")
        return (value,)

    def _topics(self, value: Any) -> tuple[str, ...]:
        names = self._fields.names(value, "topics")
        if not names:
            raise self._fields.error("topics", "expected at least one name")
        return names

    def _message(self, kind: str, value: Any) -> StepMessage | TopicMessage:
        """Return what a step sends that isn't a ramp."""
        fields = self._fields
        topic = self._item.get("topic")
        if topic is not None:
            if kind == "trajectory":
                return TopicMessage(topic, read_trajectory(fields, value, kind))
            return TopicMessage(topic, self._data(value))
        read: Mapping[str, Callable[[Any], StepMessage]] = {
            "goal": lambda value: read_goal(fields, value, kind),
            "trajectory": lambda value: read_trajectory(fields, value, kind),
            "cancel": self._cancel,
            "commands": lambda v: Float64MultiArray(fields.numbers(v, kind)),
            "gripper_command": self._gripper_command,
            "cmd_vel": self._cmd_vel,
            "speed_scaling": self._speed_scaling,
            "switch_controllers": self._switch,
        }
        return read[kind](value)

    def _table(self, value: Any) -> list[list[StepMessage | TopicMessage]]:
        """Return what a table sends, row by row."""
        fields, item = self._fields, self._item
        for key in ("count", "ping_pong"):
            if key in item:
                raise fields.error(key, f"a {TABLE} has its rows; leave it out")
        every = fields.seconds(item.get("every"), "every")
        rows = read_table(fields, value, every, self._file)
        topic = item.get("topic")
        return [[row if topic is None else TopicMessage(topic, row)] for row in rows]

    def _row_messages(
        self, kind: str, names: Sequence[str], row: tuple[float, ...]
    ) -> list[StepMessage | TopicMessage]:
        """Return what a ramp sends at one time."""
        if kind == "commands_from_to":
            return [Float64MultiArray(row)]
        return [TopicMessage(*pair) for pair in zip(names, row, strict=True)]

    def _times(self, count: int = 0) -> list[float]:
        """Return when the step's messages are sent [s]; ``count`` of them if given."""
        fields, item = self._fields, self._item
        start = fields.seconds(item.get("at", 0.0), "at")
        if "every" not in item and "count" not in item:
            return [start]
        every = fields.seconds(item.get("every"), "every")
        count = count or self._count(1)
        if every == 0.0:
            raise fields.error("every", "expected a positive number of seconds, got 0")
        return [start + every * index for index in range(count)]

    def _count(self, smallest: int) -> int:
        count = self._item.get("count")
        if type(count) is not int or not smallest <= count <= _MAX_COUNT:
            expected = f"expected an integer from {smallest} to {_MAX_COUNT}"
            raise self._fields.error("count", f"{expected}, got {count!r}")
        return count

    def _cancel(self, value: Any) -> None:
        if value is not True:
            raise self._fields.error("cancel", f"expected true, got {value!r}")

    def _data(self, value: Any) -> float | tuple[float, ...] | Mapping[str, Any]:
        """Return what goes to a topic: a number, a list of them, a bool, or fields."""
        if isinstance(value, Mapping | bool):
            return value
        if isinstance(value, list):
            return self._fields.numbers(value, "data")
        return self._fields.number(value, "data")

    def _ramp(self, where: str, value: Any) -> list[tuple[float, ...]]:
        """Return values from one list to another, and back if asked."""
        fields = self._fields
        ends = fields.list(value, where)
        if len(ends) != 2:
            problem = f"expected two lists of values, got {len(ends)}"
            raise fields.error(where, problem)
        first, last = (
            fields.numbers(end, f"{where}[{index}]") for index, end in enumerate(ends)
        )
        topics = self._item.get("topics")
        if topics is not None and len(first) != len(topics):
            problem = f"expected a value for each of {len(topics)} topics"
            raise fields.error(f"{where}[0]", f"{problem}, got {len(first)}")
        if len(first) != len(last):
            problem = f"expected as many values as in the first list, {len(first)}"
            raise fields.error(f"{where}[1]", f"{problem}, got {len(last)}")
        is_back_and_forth = self._item.get("ping_pong", False)
        if type(is_back_and_forth) is not bool:
            problem = f"expected true or false, got {is_back_and_forth!r}"
            raise fields.error("ping_pong", problem)
        count = self._count(2)
        parts = [index / (count - 1) for index in range(count)]
        if is_back_and_forth:
            parts += reversed(parts)
        return [
            tuple((1.0 - s) * a + s * b for a, b in zip(first, last, strict=True))
            for s in parts
        ]

    def _gripper_command(self, value: Any) -> GripperCommand:
        fields, where = self._fields, "gripper_command"
        data = fields.mapping(value, where, ("position", "max_effort"))
        if "position" not in data:
            raise fields.error(where, "expected a position")
        numbers = {key: fields.number(v, f"{where}.{key}") for key, v in data.items()}
        return GripperCommand(**numbers)

    def _cmd_vel(self, value: Any) -> Twist:
        fields, where = self._fields, "cmd_vel"
        for part, vector in fields.mapping(value, where, ("linear", "angular")).items():
            place = f"{where}.{part}"
            for axis, number in fields.mapping(vector, place, ("x", "y", "z")).items():
                fields.number(number, f"{place}.{axis}")
        return Twist(**value)

    def _speed_scaling(self, value: Any) -> SpeedScalingFactor:
        factor = self._fields.number(value, "speed_scaling")
        if factor < 0.0:
            problem = f"expected at least 0, got {value!r}"
            raise self._fields.error("speed_scaling", problem)
        return SpeedScalingFactor(factor)

    def _switch(self, value: Any) -> SwitchController:
        fields, where = self._fields, "switch_controllers"
        data = fields.mapping(value, where, _SWITCH_KEYS)
        activate, deactivate = (
            fields.names(data.get(key, []), f"{where}.{key}")
            for key in _SWITCH_KEYS[:2]
        )
        if not activate and not deactivate:
            problem = "expected controllers to activate or to deactivate, got none"
            raise fields.error(where, problem)
        strictness = data.get("strictness", "strict")
        if strictness not in _STRICTNESS:
            hint = suggest(str(strictness), _STRICTNESS)
            problem = f"unknown strictness {strictness!r}; {hint}"
            raise fields.error(f"{where}.strictness", problem)
        return SwitchController(activate, deactivate, strictness)
