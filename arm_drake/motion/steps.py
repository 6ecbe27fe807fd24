"""One step of a motion file: when, to whom, and what."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from arm_drake.errors import suggest
from arm_drake.messages import (
    Float64MultiArray,
    SpeedScalingFactor,
    SwitchController,
)
from arm_drake.motion.fields import Fields
from arm_drake.motion.timeline import MotionStep, StepMessage
from arm_drake.motion.trajectories import read_goal, read_trajectory

# More repetitions than this are a slip, and would fill the memory.
_MAX_COUNT = 100_000

_COMMON_KEYS = ("at", "every", "count", "controller", "ping_pong")

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
    return list(_Step(fields.mapping(item, ""), fields).parse())


class _Step:
    """One step of a motion file on its way to messages."""

    def __init__(self, item: Mapping[str, Any], fields: Fields) -> None:
        self._item = item
        self._fields = fields

    def parse(self) -> Iterator[MotionStep]:
        fields, item = self._fields, self._item
        kinds: dict[str, Callable[[Any], StepMessage]] = {
            "goal": lambda value: read_goal(fields, value, "goal"),
            "trajectory": lambda value: read_trajectory(fields, value, "trajectory"),
            "cancel": self._cancel,
            "commands": self._commands,
            "speed_scaling": self._speed_scaling,
            "switch_controllers": self._switch,
        }
        names = (*kinds, "commands_from_to")
        fields.mapping(item, "", (*names, *_COMMON_KEYS))
        chosen = [key for key in names if key in item]
        if len(chosen) != 1:
            raise fields.error("", f"expected one of {sorted(names)}, got {chosen}")
        (kind,) = chosen
        controller = self._controller(kind)
        where = f"{fields.step}.{kind}"
        if kind == "commands_from_to":
            messages: list[StepMessage] = [*self._ramp(item[kind])]
            times = self._times(len(messages))
        else:
            if "ping_pong" in item:
                raise fields.error("ping_pong", "only commands_from_to has it")
            message = kinds[kind](item[kind])
            times = self._times()
            messages = [message] * len(times)
        for at, message in zip(times, messages, strict=True):
            yield MotionStep(at, controller, message, where)

    def _controller(self, kind: str) -> str | None:
        controller = self._item.get("controller")
        if kind == "switch_controllers":
            if "controller" in self._item:
                problem = f"{kind} is for the controller manager; leave it out"
                raise self._fields.error("controller", problem)
        elif not isinstance(controller, str):
            problem = f"expected a name, got {controller!r}"
            raise self._fields.error("controller", problem)
        return controller

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

    def _commands(self, value: Any) -> Float64MultiArray:
        return Float64MultiArray(self._fields.numbers(value, "commands"))

    def _ramp(self, value: Any) -> list[Float64MultiArray]:
        """Return commands from one list of values to another, and back if asked."""
        fields, where = self._fields, "commands_from_to"
        ends = fields.list(value, where)
        if len(ends) != 2:
            problem = f"expected two lists of values, got {len(ends)}"
            raise fields.error(where, problem)
        first, last = (
            fields.numbers(end, f"{where}[{index}]") for index, end in enumerate(ends)
        )
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
            Float64MultiArray(
                tuple((1.0 - s) * a + s * b for a, b in zip(first, last, strict=True))
            )
            for s in parts
        ]

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
