"""Motions from files: their parameters, tables, and the kinds of steps."""

import itertools
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import yaml

from arm_drake import yaml_files
from arm_drake.description.entry import bundled_motions, bundled_robots
from arm_drake.description.robot import Robot, list_robots
from arm_drake.errors import InputError, MotionError, suggest
from arm_drake.messages import (
    Duration,
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    GripperCommand,
    Header,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryPoint,
    Message,
    SpeedScalingFactor,
    SwitchController,
    Time,
    Twist,
)
from arm_drake.plant.payloads import Payload
from arm_drake.simulation.motion import (
    STEPS,
    Fields,
    Motion,
    MotionFile,
    MotionStep,
    Needs,
    Sent,
    SetPayloads,
    TopicMessage,
    read_follow,
    read_pick,
    read_place,
    read_plan_to,
)
from arm_drake.simulation.topics import ControllerTopics

# Keys beside the steps of a motion: its parameters, and what it needs.
PARAMETERS, NEEDS = "parameters", "needs"

_REFERENCE = re.compile(r"\$\(\s*([^()]*?)\s*\)")


def fill_in(data: Any, parameters: Mapping[str, Any], file: MotionFile) -> Any:
    """Return the list of a motion's steps, with the values of its parameters.

    A text that is nothing but `$(name)` becomes the value, whatever it is; inside a
    text the value's own text stands. `parameters` takes the place of the defaults.
    """
    declared: Mapping[str, Any] = {}
    steps = data
    if isinstance(data, Mapping):
        for key in data:
            if key not in (NEEDS, PARAMETERS, STEPS):
                hint = suggest(str(key), (NEEDS, PARAMETERS, STEPS))
                raise file.error(f"unknown key {key!r}; {hint}", key=str(key))
        declared, steps = data.get(PARAMETERS) or {}, data.get(STEPS)
        if not isinstance(declared, Mapping):
            problem = f"expected names with defaults, got {declared!r}"
            raise file.error(problem, PARAMETERS)
        for name in declared:
            if not isinstance(name, str):
                problem = f"expected names, got {name!r}"
                raise file.error(problem, PARAMETERS)
        if not isinstance(steps, list):
            problem = f"expected a list of steps, got {type(steps).__name__}"
            raise file.error(problem, STEPS)
    for name in parameters:
        if name not in declared:
            raise _unknown(name, declared, file)
    values = {**declared, **parameters}
    if not isinstance(steps, list):
        return steps
    return [_filled(step, values, f"[{n}]", file) for n, step in enumerate(steps)]


def _filled(value: Any, values: Mapping[str, Any], where: str, file: MotionFile) -> Any:
    """Return a part of a step with the values of parameters."""
    if isinstance(value, list):
        return [_filled(v, values, f"{where}[{n}]", file) for n, v in enumerate(value)]
    if isinstance(value, Mapping):
        return {
            key: _filled(item, values, f"{where}.{key}", file)
            for key, item in value.items()
        }
    if not isinstance(value, str):
        return value
    for name in _REFERENCE.findall(value):
        if name not in values:
            raise _unknown(name, values, file, where)
    whole = _REFERENCE.fullmatch(value)
    if whole:
        return values[whole[1]]
    return _REFERENCE.sub(lambda match: str(values[match[1]]), value)


def _unknown(
    name: str, known: Mapping[str, Any], file: MotionFile, where: str = ""
) -> MotionError:
    hint = suggest(name, known) if known else "the motion declares none"
    return file.error(f"no parameter {name!r}; {hint}", where)


def read_needs(data: Any, file: MotionFile) -> Needs:
    """Return what a motion needs beside the name of its robot."""
    if not isinstance(data, Mapping) or NEEDS not in data:
        return Needs()
    fields = Fields(NEEDS, file)
    needs = fields.mapping(data[NEEDS], "", ("xacro_args", "world", "scene"))
    if "scene" in needs and len(needs) > 1:
        raise fields.error("scene", "a scene has its own arguments and its own world")
    texts = fields.mapping(needs.get("xacro_args", {}), "xacro_args")
    places = {f"xacro_args.{name}": value for name, value in texts.items()}
    places |= {key: needs[key] for key in ("world", "scene") if key in needs}
    for place, value in places.items():
        if not isinstance(value, str):
            raise fields.error(place, f"expected a text, got {value!r}")
    folder = Path() if file.path is None else file.path.parent
    scene = Path(os.path.abspath(folder / needs["scene"])) if "scene" in needs else None
    return Needs({str(n): v for n, v in texts.items()}, needs.get("world"), scene)


def read_goal(fields: Fields, value: Any, where: str) -> FollowJointTrajectoryGoal:
    """Return a goal of the action; its trajectory's level may be left out."""
    goal = dict(fields.mapping(value, where))
    tolerances = {
        name: _read_tolerances(fields, goal.pop(name, []), f"{where}.{name}")
        for name in ("path_tolerance", "goal_tolerance")
    }
    late = goal.pop("goal_time_tolerance", 0.0)
    # The action nests the trajectory; leaving that level out is fine.
    trajectory = goal.pop("trajectory", None)
    if trajectory is None:
        trajectory, goal = goal, {}
    if goal:
        key = str(next(iter(goal)))
        raise fields.error(where, f"unknown key {key!r}", key)
    time = fields.time(Duration, late, f"{where}.goal_time_tolerance")
    return FollowJointTrajectoryGoal(
        trajectory=read_trajectory(fields, trajectory, where),
        goal_time_tolerance=time,
        **tolerances,
    )


def read_trajectory(fields: Fields, value: Any, where: str) -> JointTrajectory:
    """Return a trajectory."""
    data = dict(fields.mapping(value, where))
    header = fields.mapping(
        data.pop("header", {}), f"{where}.header", ("stamp", "frame_id")
    )
    names = fields.names(data.pop("joint_names", []), f"{where}.joint_names")
    points = fields.list(data.pop("points", []), f"{where}.points")
    if data:
        key = str(next(iter(data)))
        known = ["header", "joint_names", "points"]
        raise fields.error(where, f"unknown key {key!r}; {suggest(key, known)}", key)
    stamp = fields.time(Time, header.get("stamp", 0.0), f"{where}.header.stamp")
    return JointTrajectory(
        header=Header(stamp=stamp, frame_id=str(header.get("frame_id", ""))),
        joint_names=names,
        points=tuple(
            fields.build(JointTrajectoryPoint, point, f"{where}.points[{index}]")
            for index, point in enumerate(points)
        ),
    )


def _read_tolerances(
    fields: Fields, value: Any, where: str
) -> tuple[JointTolerance, ...]:
    return tuple(
        fields.build(JointTolerance, item, f"{where}[{index}]")
        for index, item in enumerate(fields.list(value, where))
    )


KIND = "trajectory_table"

# Column with the time after which a row's point is to be reached [s].
_TIME = "time_from_start"

# A larger table is a slip, and would fill the memory.
_MAX_ROWS = 100_000


def read_table(
    fields: Fields, value: Any, every: float, file: Path | None
) -> list[JointTrajectory]:
    """Return the trajectories of a table, one of one point for each row.

    It is a CSV file, seen from the motion's folder, whose first row names the joints
    and may have a column `time_from_start`; or a mapping of `joint_names`, `points` (a
    list of lists of positions) and, perhaps, `time_from_start`. Without one it is
    `every`, the time from row to row [s].
    """
    if isinstance(value, str):
        names, rows, times = _read_csv(fields, value, file)
    else:
        names, rows, times = _read_inline(fields, value)
    if not rows:
        raise fields.error(KIND, "expected at least one row")
    return [
        read_trajectory(
            fields,
            {
                "joint_names": list(names),
                "points": [{"positions": row, _TIME: every if t is None else t}],
            },
            f"{KIND}[{index}]",
        )
        for index, (row, t) in enumerate(zip(rows, times, strict=True))
    ]


_Table = tuple[Sequence[str], list[list[float]], list[float | None]]


def _read_inline(fields: Fields, value: Any) -> _Table:
    data: Mapping[str, Any] = fields.mapping(
        value, KIND, ("joint_names", "points", _TIME)
    )
    names = fields.names(data.get("joint_names"), f"{KIND}.joint_names")
    rows = [
        list(fields.numbers(row, f"{KIND}.points[{index}]"))
        for index, row in enumerate(fields.list(data.get("points"), f"{KIND}.points"))
    ]
    time = data.get(_TIME)
    if time is not None:
        time = fields.seconds(time, f"{KIND}.{_TIME}")
    return names, rows, [time] * len(rows)


def _read_csv(fields: Fields, name: str, file: Path | None) -> _Table:
    import csv

    path = Path(name) if file is None else file.parent / name
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream)
            filled = (
                (reader.line_num, row) for row in reader if any(map(str.strip, row))
            )
            lines = list(itertools.islice(filled, _MAX_ROWS + 2))
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise fields.error(KIND, f"{name}: {reason}") from None
    if len(lines) > _MAX_ROWS + 1:
        raise fields.error(KIND, f"{name}: more than {_MAX_ROWS} rows")
    header = [cell.strip() for cell in lines[0][1]] if lines else []
    joints = [column for column in header if column != _TIME]
    if not joints or "" in header or len(set(header)) < len(header):
        problem = f"expected distinct names of joints in the first row, got {header}"
        raise fields.error(KIND, f"{name}: {problem}")
    rows, times = [], []
    for number, line in lines[1:]:
        place = f"{name}, line {number}"
        if len(line) != len(header):
            problem = f"expected {len(header)} values, got {len(line)}"
            raise fields.error(KIND, f"{place}: {problem}")
        values = dict(zip(header, map(_number, line), strict=True))
        for column, cell in zip(header, line, strict=True):
            if values[column] is None:
                problem = f"{column}: expected a number, got {cell.strip()!r}"
                raise fields.error(KIND, f"{place}: {problem}")
        rows.append(
            [fields.number(values[joint], f"{KIND}, {place}") for joint in joints]
        )
        times.append(values.get(_TIME))
    return joints, rows, times


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


# Key of the last item of a motion that starts over.
REPEAT = "repeat"

# More repetitions than this are a slip, and would fill the memory.
_MAX_COUNT = 100_000

# Keys that say whom a step is for.
_RECEIVERS = ("controller", "topic", "topics")

_RAMPS = ("commands_from_to", "data_from_to")

_COMMON_KEYS = ("at", "every", "count", "ping_pong", *_RECEIVERS)


def _read_cancel(fields: Fields, value: Any, where: str) -> None:
    """Check the value of `cancel`."""
    if value is not True:
        raise fields.error(where, f"expected true, got {value!r}")


def _read_commands(fields: Fields, value: Any, where: str) -> Float64MultiArray:
    """Return values for a controller's interfaces."""
    return Float64MultiArray(fields.numbers(value, where))


def _read_data(
    fields: Fields, value: Any, where: str
) -> float | tuple[float, ...] | Mapping[str, Any]:
    """Return what goes to a topic: a number, a list of them, a bool, or fields."""
    if isinstance(value, Mapping | bool):
        return value
    if isinstance(value, list):
        return fields.numbers(value, where)
    return fields.number(value, where)


def _read_gripper_command(fields: Fields, value: Any, where: str) -> GripperCommand:
    """Return a gripper's position and effort."""
    data = fields.mapping(value, where, ("position", "max_effort"))
    if "position" not in data:
        raise fields.error(where, "expected a position")
    numbers = {key: fields.number(v, f"{where}.{key}") for key, v in data.items()}
    return GripperCommand(**numbers)


def _read_twist(fields: Fields, value: Any, where: str) -> Twist:
    """Return the velocity of a base."""
    for part, vector in fields.mapping(value, where, ("linear", "angular")).items():
        place = f"{where}.{part}"
        for axis, number in fields.mapping(vector, place, ("x", "y", "z")).items():
            fields.number(number, f"{place}.{axis}")
    return Twist(**value)


def _read_speed_scaling(fields: Fields, value: Any, where: str) -> SpeedScalingFactor:
    """Return how fast time is to pass along trajectories."""
    factor = fields.number(value, where)
    if factor < 0.0:
        raise fields.error(where, f"expected at least 0, got {value!r}")
    return SpeedScalingFactor(factor)


_SWITCH_KEYS = ("activate", "deactivate", "strictness")
_STRICTNESS = ("strict", "best_effort")


def _read_switch(fields: Fields, value: Any, where: str) -> SwitchController:
    """Return which controllers to activate and to deactivate."""
    data = fields.mapping(value, where, _SWITCH_KEYS)
    activate, deactivate = (
        fields.names(data.get(key, []), f"{where}.{key}") for key in _SWITCH_KEYS[:2]
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


def _read_payload(fields: Fields, value: Any, where: str) -> SetPayloads:
    """Return the payloads of links: masses [kg], or mappings of mass and com."""
    if not isinstance(value, Mapping) or not value:
        expected = "expected payloads by link, as {tool0: 2.0}"
        raise fields.error(where, f"{expected}, got {value!r}")
    found = {}
    for link, payload in value.items():
        place = f"{where}.{link}"
        data = payload if isinstance(payload, Mapping) else {"mass": payload}
        fields.mapping(data, place, ("mass", "com"))
        mass = fields.number(data.get("mass"), f"{place}.mass")
        com = fields.numbers(data.get("com", [0.0, 0.0, 0.0]), f"{place}.com")
        try:
            found[str(link)] = Payload(mass, com)
        except InputError as error:
            raise fields.error(place, error.problem) from None
    return SetPayloads(found)


class StepKind(NamedTuple):
    """A key of motion files: whom it is for, and the message that it stands for."""

    # Keys that may say whom; none is the controller manager, or what is in the value.
    receivers: tuple[str, ...]

    # Makes a message of a value at a place; None if several are made of it.
    read: Callable[[Fields, Any, str], Any] | None = None

    # Class of the message, if it goes to a controller, and what finds the port on which
    # that takes it, and the message as it takes it.
    message_type: type[Message] | None = None
    make: Callable[[ControllerTopics, Any], tuple[str, Message]] | None = None


_ONE = ("controller",)
_ONE_OR_TOPIC = ("controller", "topic")

# All of a kind of message that a motion can send, but for its class.
STEP_KINDS: Mapping[str, StepKind] = {
    "goal": StepKind(
        _ONE, read_goal, FollowJointTrajectoryGoal, ControllerTopics.make_goal
    ),
    "trajectory": StepKind(
        _ONE_OR_TOPIC,
        read_trajectory,
        JointTrajectory,
        ControllerTopics.make_trajectory,
    ),
    KIND: StepKind(_ONE_OR_TOPIC),
    "cancel": StepKind(_ONE, _read_cancel),
    "commands": StepKind(
        _ONE,
        _read_commands,
        Float64MultiArray,
        lambda topics, message: topics.make_command(message.data),
    ),
    "gripper_command": StepKind(
        _ONE, _read_gripper_command, GripperCommand, ControllerTopics.make_goal
    ),
    "cmd_vel": StepKind(_ONE, _read_twist, Twist, ControllerTopics.make_velocity),
    "speed_scaling": StepKind(
        _ONE,
        _read_speed_scaling,
        SpeedScalingFactor,
        lambda topics, message: topics.make_speed_scaling(message.factor),
    ),
    "switch_controllers": StepKind((), _read_switch),
    "payload": StepKind((), _read_payload),
    "plan_to": StepKind((), read_plan_to),
    "pick": StepKind((), read_pick),
    "place": StepKind((), read_place),
    "follow": StepKind((), read_follow),
    "data": StepKind(("topic",), _read_data),
    "commands_from_to": StepKind(_ONE),
    "data_from_to": StepKind(("topics",)),
}

_MAKERS = {kind.message_type: kind.make for kind in STEP_KINDS.values() if kind.make}


def make_message(topics: ControllerTopics, message: Message) -> tuple[str, Message]:
    """Return on which port a controller takes a step's message, and as what."""
    make = _MAKERS.get(type(message), ControllerTopics.make_goal)
    return make(topics, message)


def parse_step(item: Any, index: int, file: MotionFile) -> list[MotionStep]:
    """Return what step `index` sends: one message, or several one after the other."""
    fields = Fields(f"[{index}]", file)
    return list(_Step(fields.mapping(item, ""), fields, file).parse())


class _Step:
    """One step of a motion file on its way to messages."""

    def __init__(
        self, item: Mapping[str, Any], fields: Fields, file: MotionFile
    ) -> None:
        self._item = item
        self._fields = fields
        self._file = file

    def parse(self) -> Iterator[MotionStep]:
        fields, item = self._fields, self._item
        if REPEAT in item:
            raise fields.error(REPEAT, "it is the last item of a motion")
        fields.mapping(item, "", (*STEP_KINDS, *_COMMON_KEYS, REPEAT))
        chosen = [key for key in STEP_KINDS if key in item]
        if len(chosen) != 1:
            raise fields.error(
                "", f"expected one of {sorted(STEP_KINDS)}, got {chosen}"
            )
        (kind,) = chosen
        names = self._receivers(kind)
        controller = item.get("controller")
        if kind in _RAMPS:
            rows = self._ramp(kind, item[kind])
            times = self._times(len(rows))
            sent = [self._row_messages(kind, names, row) for row in rows]
        elif kind == KIND:
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
        where = f"{fields.step}.{kind}"
        line = self._file.line(where)
        for at, messages in zip(times, sent, strict=True):
            for each in messages:
                yield MotionStep(at, controller, each, where, every, line)

    def _receivers(self, kind: str) -> tuple[str, ...]:
        """Return the names of whom the step is for, if it says so."""
        fields, item = self._fields, self._item
        allowed = STEP_KINDS[kind].receivers
        receivers = [key for key in _RECEIVERS if key in item]
        for key in receivers:
            if not allowed:
                problem = f"{kind} is for no controller or topic; leave it out"
                raise fields.error(key, problem)
            if key not in allowed:
                problem = f"{kind} goes with {' or '.join(allowed)}; leave it out"
                raise fields.error(key, problem)
        if len(receivers) > 1:
            problem = f"the step is for a {receivers[0]} already; leave it out"
            raise fields.error(receivers[1], problem)
        if not allowed:
            return ()
        key = receivers[0] if receivers else allowed[0]
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

    def _message(self, kind: str, value: Any) -> Sent:
        """Return what a step sends that isn't a ramp."""
        read = STEP_KINDS[kind].read
        assert read is not None
        message, topic = read(self._fields, value, kind), self._item.get("topic")
        return message if topic is None else TopicMessage(topic, message)

    def _table(self, value: Any) -> list[list[Sent]]:
        """Return what a table sends, row by row."""
        fields, item = self._fields, self._item
        for key in ("count", "ping_pong"):
            if key in item:
                raise fields.error(key, f"a {KIND} has its rows; leave it out")
        every = fields.seconds(item.get("every"), "every")
        rows = read_table(fields, value, every, self._file.path)
        topic = item.get("topic")
        return [[row if topic is None else TopicMessage(topic, row)] for row in rows]

    def _row_messages(
        self, kind: str, names: Sequence[str], row: tuple[float, ...]
    ) -> list[Sent]:
        """Return what a ramp sends at one time."""
        if kind == "commands_from_to":
            return [Float64MultiArray(row)]
        return [TopicMessage(*pair) for pair in zip(names, row, strict=True)]

    def _times(self, count: int = 0) -> list[float]:
        """Return when the step's messages are sent [s]; ``count`` of them unless 0."""
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

    def _ramp(self, where: str, value: Any) -> list[tuple[float, ...]]:
        """Return values from one list to another, and back if requested."""
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


# What is taken for a motion: itself, a name that comes with the robot, or a file.
MotionSource: TypeAlias = Motion | str | Path


def load_motion(
    path: str | Path,
    parameters: Mapping[str, Any] | None = None,
    *,
    robot: Robot | None = None,
) -> Motion:
    """Return the motion of a YAML file, or one that comes with a robot.

    Args:
        path: The file, or with ``robot`` the name of one of its motions.
        parameters: Values of its parameters, in place of their defaults.
        robot: A bundled robot.

    Raises:
        MotionError: If the file can't be used.
    """
    if robot is not None:
        (robot,) = list_robots(robot)
        return find_motion(path, robot, parameters)
    _refuse_folder(path)
    path = Path(path)
    if not path.suffix and not path.is_file():
        text = f"no such file; the motion {path.name!r} of a robot needs robot="
        raise MotionError(text, file=path)
    try:
        node = yaml_files.compose(yaml_files.read_text(path))
        if node is not None:
            yaml_files.check_keys(node)
        data = None if node is None else yaml_files.plain(node)
    except yaml_files.YamlError as error:
        raise MotionError(error.problem, file=path, line=error.line) from None
    return parse_motion(data, path, parameters, node)


def parse_motion(
    data: Any,
    path: Path | None = None,
    parameters: Mapping[str, Any] | None = None,
    node: yaml.Node | None = None,
) -> Motion:
    """Return the motion of a list of steps, as in a motion file.

    A step that this version doesn't know is an error, not nothing. The file's node has
    the lines for messages.
    """
    file = MotionFile(path, node)
    if data is None and path is not None:
        raise file.error("the file is empty; expected a list of steps")
    needs = read_needs(data, file)
    data = fill_in(data, parameters or {}, file)
    if not isinstance(data, list):
        raise file.error(f"expected a list of steps, got {type(data).__name__}")
    repeats = bool(data) and _is_repeat(data[-1])
    steps = [
        step
        for index, item in enumerate(data[:-1] if repeats else data)
        for step in parse_step(item, index, file)
    ]
    in_order = tuple(sorted(steps, key=lambda step: step.at))
    motion = Motion(path, in_order, repeats, dict(parameters or {}), needs)
    if repeats:
        _check_repeat(data[-1], motion, Fields(f"[{len(data) - 1}]", file))
    return motion


def _is_repeat(item: Any) -> bool:
    return isinstance(item, Mapping) and REPEAT in item


def _check_repeat(item: Mapping[str, Any], motion: Motion, fields: Fields) -> None:
    """Raise MotionError if a motion can't start over as its last item says."""
    fields.mapping(item, "", (REPEAT,))
    if item[REPEAT] is not True:
        raise fields.error(REPEAT, f"expected true, got {item[REPEAT]!r}")
    if motion.duration == 0.0:
        problem = "a round takes no time; `every` and `count` of a step give it some"
        raise fields.error(REPEAT, problem)
    last = motion.steps[-1]
    if last.at >= motion.duration:
        problem = (
            f"the next round starts with the last message, at {last.at:g} s, and takes "
            f"its place; `every` and `count` of {last.where} give it time"
        )
        raise fields.error(REPEAT, problem)


def _fits(motion: Motion, robot: Robot) -> bool:
    """Return whether a robot has all controllers and joints of a motion."""
    controllers = {each.name for each in robot.controllers.controllers}
    joints = {joint.name for joint in robot.description.joints}
    for step in motion.steps:
        message = getattr(step.message, "trajectory", step.message)
        names = getattr(message, "joint_names", ())
        if step.controller not in controllers or not joints.issuperset(names):
            return False
    return True


def _refuse_folder(path: str | Path) -> None:
    # Unlike that of Path, it takes names that no file can have.
    if os.path.isdir(path):
        text = "is a folder; expected the YAML file of a motion"
        raise MotionError(text, file=Path(path))


def find_motion(
    name: MotionSource, robot: Robot, parameters: Mapping[str, Any] | None = None
) -> Motion:
    """Return a motion, that of a name that comes with a robot, or that of a file.

    Parameters replace their defaults. What can't be used is a MotionError. A robot of
    one's own has the motions of the bundled robots whose controllers and joints it has.
    """
    if isinstance(name, Motion):
        return name
    if not isinstance(name, str | Path):
        raise MotionError(f"motion: expected a Motion, a name or a file, got {name!r}")
    known = bundled_motions(robot.bundled) if robot.bundled else {}
    if str(name) in known:
        return load_motion(known[str(name)], parameters)
    if not Path(name).suffix and not Path(name).is_file():
        for other in () if robot.bundled else bundled_robots():
            file = bundled_motions(other).get(str(name))
            if file is not None and _fits(
                motion := load_motion(file, parameters), robot
            ):
                return motion
        _refuse_folder(name)
        owner = robot.bundled or robot.name
        hint = suggest(str(name), known) if known else "give the file of a motion"
        text = f"no motion {str(name)!r} of {owner!r}, and no such file; {hint}"
        raise MotionError(text)
    return load_motion(name, parameters)
