"""Motion files: what is sent to the controllers, and when.

A YAML list of steps, see `docs/motions.md`; a step that this version doesn't know is an
error, not nothing.
"""

import dataclasses as dc
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from arm_drake import yaml_files
from arm_drake.errors import MotionError, suggest
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryGoal,
    Header,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryPoint,
    Message,
    Time,
)

T = TypeVar("T", bound=Time)


@dc.dataclass(frozen=True)
class MotionStep:
    """Something that is sent to a controller."""

    # When, from the start of the motion [s].
    at: float

    # Name of the controller.
    controller: str

    # FollowJointTrajectoryGoal or JointTrajectory; None cancels the active goal.
    message: Message | None

    # Place in the file, for messages.
    where: str


@dc.dataclass(frozen=True)
class Motion:
    """The steps of a motion file, in the order of their times."""

    file: Path | None
    steps: tuple[MotionStep, ...]

    @property
    def duration(self) -> float:
        """When the last step's trajectory has ended [s]."""
        return max((_end(step) for step in self.steps), default=0.0)


def load_motion(path: str | Path) -> Motion:
    """Return the motion of a YAML file.

    Raises:
        MotionError: If the file can't be used.
    """
    path = Path(path)
    try:
        data = yaml_files.load(path)
    except yaml_files.YamlError as error:
        raise MotionError(error.problem, file=path, line=error.line) from None
    return parse_motion(data, path)


def parse_motion(data: Any, file: Path | None = None) -> Motion:
    """Return the motion of a list of steps, as in a motion file.

    Args:
        data: The list.
        file: File it came from, for messages.

    Raises:
        MotionError: If a step is malformed.
    """
    if not isinstance(data, list):
        raise MotionError(
            f"expected a list of steps, got {type(data).__name__}", file=file
        )
    steps = [
        step
        for index, item in enumerate(data)
        for step in _Step(item, index, file).parse()
    ]
    return Motion(file, tuple(sorted(steps, key=lambda step: step.at)))


# More repetitions than this are a slip, and would fill the memory.
_MAX_COUNT = 100_000

_COMMON_KEYS = ("at", "every", "count", "controller")


class _Step:
    """One step of a motion file on its way to messages."""

    def __init__(self, item: Any, index: int, file: Path | None) -> None:
        self._file = file
        self._where = f"[{index}]"
        if not isinstance(item, Mapping):
            raise self._error("", f"expected a mapping, got {item!r}")
        self._item = item

    def parse(self) -> list[MotionStep]:
        kinds: dict[str, Callable[[Any], Message | None]] = {
            "goal": self._goal,
            "trajectory": lambda value: self._trajectory(value, "trajectory"),
            "cancel": self._cancel,
        }
        for key in self._item:
            if key not in (*kinds, *_COMMON_KEYS):
                hint = suggest(str(key), [*kinds, *_COMMON_KEYS])
                raise self._error("", f"unknown key {key!r}; {hint}")
        chosen = [key for key in kinds if key in self._item]
        if len(chosen) != 1:
            raise self._error("", f"expected one of {sorted(kinds)}, got {chosen}")
        controller = self._item.get("controller")
        if not isinstance(controller, str):
            raise self._error("controller", f"expected a name, got {controller!r}")
        message = kinds[chosen[0]](self._item[chosen[0]])
        where = f"{self._where}.{chosen[0]}"
        return [MotionStep(at, controller, message, where) for at in self._times()]

    def _times(self) -> list[float]:
        start = self._seconds(self._item.get("at", 0.0), "at")
        if "every" not in self._item and "count" not in self._item:
            return [start]
        every = self._seconds(self._item.get("every"), "every")
        count = self._item.get("count")
        if type(count) is not int or not 1 <= count <= _MAX_COUNT:
            expected = f"expected an integer from 1 to {_MAX_COUNT}"
            raise self._error("count", f"{expected}, got {count!r}")
        if every == 0.0:
            raise self._error("every", "expected a positive number of seconds, got 0")
        return [start + every * index for index in range(count)]

    def _seconds(self, value: Any, key: str) -> float:
        seconds = self._time(Duration, value, key).to_seconds()
        if seconds < 0.0:
            raise self._error(key, f"expected at least 0 s, got {value!r}")
        return seconds

    def _time(self, kind: type[T], value: Any, where: str) -> T:
        try:
            return kind.of(value)
        except ValueError as error:
            raise self._error(where, str(error)) from None
        except OverflowError:
            raise self._error(where, f"{value!r} s is out of range") from None

    def _cancel(self, value: Any) -> None:
        if value is not True:
            raise self._error("cancel", f"expected true, got {value!r}")

    def _goal(self, value: Any) -> FollowJointTrajectoryGoal:
        goal = dict(self._mapping(value, "goal"))
        tolerances = {
            name: self._tolerances(goal.pop(name, []), f"goal.{name}")
            for name in ("path_tolerance", "goal_tolerance")
        }
        late = goal.pop("goal_time_tolerance", 0.0)
        # The action nests the trajectory; leaving that level out is fine.
        trajectory = goal.pop("trajectory", None)
        if trajectory is None:
            trajectory, goal = goal, {}
        if goal:
            raise self._error("goal", f"unknown key {next(iter(goal))!r}")
        time = self._time(Duration, late, "goal.goal_time_tolerance")
        return FollowJointTrajectoryGoal(
            trajectory=self._trajectory(trajectory, "goal"),
            goal_time_tolerance=time,
            **tolerances,
        )

    def _tolerances(self, value: Any, where: str) -> tuple[JointTolerance, ...]:
        return tuple(
            self._build(JointTolerance, item, f"{where}[{index}]")
            for index, item in enumerate(self._list(value, where))
        )

    def _trajectory(self, value: Any, where: str) -> JointTrajectory:
        data = dict(self._mapping(value, where))
        header = dict(self._mapping(data.pop("header", {}), f"{where}.header"))
        for key in header:
            if key not in ("stamp", "frame_id"):
                hint = suggest(str(key), ["stamp", "frame_id"])
                raise self._error(f"{where}.header", f"unknown key {key!r}; {hint}")
        names = self._list(data.pop("joint_names", []), f"{where}.joint_names")
        for name in names:
            if not isinstance(name, str):
                raise self._error(
                    f"{where}.joint_names", f"expected names, got {name!r}"
                )
        points = self._list(data.pop("points", []), f"{where}.points")
        if data:
            key = str(next(iter(data)))
            known = ["header", "joint_names", "points"]
            raise self._error(where, f"unknown key {key!r}; {suggest(key, known)}")
        stamp = self._time(Time, header.get("stamp", 0.0), f"{where}.header.stamp")
        return JointTrajectory(
            header=Header(stamp=stamp, frame_id=str(header.get("frame_id", ""))),
            joint_names=tuple(names),
            points=tuple(
                self._build(JointTrajectoryPoint, point, f"{where}.points[{index}]")
                for index, point in enumerate(points)
            ),
        )

    def _build(self, kind: Callable[..., Any], value: Any, where: str) -> Any:
        fields = [field.name for field in dc.fields(kind)]  # type: ignore[arg-type]
        data = self._mapping(value, where)
        for key in data:
            if key not in fields:
                hint = suggest(str(key), fields)
                raise self._error(where, f"unknown key {key!r}; {hint}")
        for name in set(data) & {"position", "velocity", "acceleration"}:
            self._check_number(data[name], f"{where}.{name}")
        for name in set(data) & {"positions", "velocities", "accelerations", "effort"}:
            self._check_numbers(data[name], f"{where}.{name}")
        try:
            return kind(**data)
        except (TypeError, ValueError, OverflowError) as error:
            raise self._error(where, str(error)) from None

    def _check_numbers(self, value: Any, where: str) -> None:
        for index, number in enumerate(self._list(value, where)):
            self._check_number(number, f"{where}[{index}]")

    def _check_number(self, number: Any, where: str) -> None:
        if type(number) not in (int, float) or not abs(number) < math.inf:
            raise self._error(where, f"expected a finite number, got {number!r}")

    def _mapping(self, value: Any, where: str) -> Mapping[str, Any]:
        if not isinstance(value, Mapping):
            raise self._error(where, f"expected a mapping, got {value!r}")
        return value

    def _list(self, value: Any, where: str) -> Sequence[Any]:
        if not isinstance(value, list):
            raise self._error(where, f"expected a list, got {value!r}")
        return value

    def _error(self, where: str, problem: str) -> MotionError:
        place = f"{self._where}.{where}" if where else self._where
        return MotionError(problem, file=self._file, where=place)


def _end(step: MotionStep) -> float:
    """Return when a step is done [s]."""
    message = step.message
    if isinstance(message, FollowJointTrajectoryGoal):
        message = message.trajectory
    if not isinstance(message, JointTrajectory) or not message.points:
        return step.at
    # A stamp counts from the start of the simulation.
    start = max(step.at, message.header.stamp.to_seconds())
    return start + max(0.0, message.points[-1].time_from_start.to_seconds())
