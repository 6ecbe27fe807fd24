"""The steps of a motion, how their fields are checked, and how long they take."""

import dataclasses as dc
import itertools
import math
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeVar

import yaml

from arm_drake import interfaces, yaml_files
from arm_drake.arrays import is_finite
from arm_drake.description.joints import JointInfo, beyond_limits
from arm_drake.errors import MotionError, counted, quoted, suggest
from arm_drake.importing import dataclass
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryGoal,
    JointTrajectory,
    Message,
    SpeedScalingFactor,
    Time,
)
from arm_drake.plant.payloads import Payload

T = TypeVar("T", bound=Time)

# What a task takes at most where nobody says how long to simulate [s].
_AT_MOST = 30.0

# How long to simulate without a motion, and what follows one [s].
_WITHOUT_MOTION = 10.0
AFTER_MOTION = 1.0

# One of those of `motion_files.STEP_KINDS`; None cancels the controller's goal. Numbers
# are for any controller that takes commands, also as another message.
StepMessage: TypeAlias = Message | None


class TopicMessage(NamedTuple):
    """Message to a topic, whose type only the robot knows."""

    # Name as in ROS or Gazebo.
    topic: str

    # Fields of its message, if it is a mapping.
    data: float | bool | tuple[float, ...] | JointTrajectory | Mapping[str, Any]


class SetPayloads(NamedTuple):
    """Things that links carry from now on, by link."""

    payloads: Mapping[str, Payload]


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(Message):
    """Task of a robot that begins once it rests, however long it takes."""

    # Which robot; None is the first one.
    robot: str | None = None

    # Further arguments of the function of the same name: `plan`, `pick`, ...
    options: Mapping[str, Any] = dc.field(default_factory=dict)

    # What it is called in a motion file.
    kind: ClassVar[str] = ""


@dataclass(frozen=True, eq=False)
class PlanTo(Task):
    """A motion that is planned when it is due, and sent to the group's controller."""

    kind = "plan_to"

    # Names of states, joint positions [rad] or [m], or poses, one after the other.
    to: tuple[str | Mapping[str, float] | tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class PickThing(Task):
    """A thing that is grasped and lifted."""

    kind = "pick"

    thing: str


@dataclass(frozen=True, eq=False)
class PlaceThing(Task):
    """Goal pose of the held thing."""

    kind = "place"

    # x, y, z [m]; roll, pitch, yaw [rad] may follow.
    pose: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class FollowThing(Task):
    """A thing that an arm keeps in its camera's picture."""

    kind = "follow"

    thing: str


class TaskResult(Protocol):
    """Result of a pick, a place, or of following a thing."""

    # What it was about, and why it failed, or what else is to be said.
    thing: str
    reason: str

    def describe(self) -> str:
        """Return what became of it, if it went well, in words."""

    def to_json(self) -> dict[str, Any]:
        """Return its figures; what isn't known is None."""


@dataclass(frozen=True, eq=False)
class TaskOutcome:
    """Result of a task of a motion."""

    task: Task

    # Where it stands in its file.
    where: str

    # When it ended [s].
    time: float

    # What was told of it, unless it couldn't begin or was broken off.
    result: TaskResult | None

    # Why it failed, in words; empty if it didn't.
    reason: str = ""

    def describe(self) -> str:
        """Return what was done, and what became of it."""
        thing = getattr(self.result, "thing", "") or getattr(self.task, "thing", "")
        outcome = self.reason or (self.result.describe() if self.result else "done")
        robot = f"{self.task.robot}: " if self.task.robot else ""
        return f"{robot}{' '.join(filter(None, (self.task.kind, thing)))}: {outcome}"

    def to_json(self) -> dict[str, Any]:
        """Return what was done, and what became of it, with figures."""
        return {
            "task": self.task.kind,
            "robot": self.task.robot,
            "thing": getattr(self.task, "thing", None),
            "success": not self.reason,
            "reason": self.reason,
            "ended_at": self.time,
            **(self.result.to_json() if self.result else {}),
        }


# What a step stands for.
Sent: TypeAlias = StepMessage | TopicMessage | SetPayloads | Task


# End of the name of the topic on which controllers are told how fast to move.
_SPEED_TOPIC = "/speed_scaling_input"


@dataclass(frozen=True)
class MotionStep:
    """Something that is sent to a controller, a topic, or the controller manager."""

    # When, from the start of the motion [s].
    at: float

    # Name of the controller; None is a topic, the controller manager, or links.
    controller: str | None

    message: Sent

    # Place in the file, for messages.
    where: str

    # Time between the messages of a step that has several [s].
    every: float = 0.0

    # In the file, counted from 1.
    line: int | None = dc.field(default=None, compare=False)


@dataclass(frozen=True)
class Needs:
    """What a motion needs beside the name of its robot."""

    # Arguments of the robot's xacro file.
    xacro_args: Mapping[str, str] = dc.field(default_factory=dict)

    # Name of the world; None is any.
    world: str | None = None

    # Scene file that has the motion, its robot, and what else it needs.
    scene: Path | None = None

    def command(self, robot: str, motion: str) -> str:
        """Return the command that simulates the motion."""
        words = ["arm-drake", "sim"]
        if self.scene is not None:
            here = Path.cwd()
            is_below = self.scene.is_relative_to(here)
            scene = self.scene.relative_to(here) if is_below else self.scene
            return shlex.join([*words, str(scene)])
        words += [robot, *(f"{n}:={value}" for n, value in self.xacro_args.items())]
        if self.world is not None:
            words += ["--world", self.world]
        return shlex.join([*words, "--motion", motion])


@dataclass(frozen=True)
class Motion:
    """The steps of a motion file, in the order of their times."""

    file: Path | None
    steps: tuple[MotionStep, ...]

    # Whether it starts over when it is done.
    repeats: bool = False

    # Values that were given to its parameters, in place of their defaults.
    parameters: Mapping[str, Any] = dc.field(default_factory=dict)

    needs: Needs = dc.field(default_factory=Needs)

    def __repr__(self) -> str:
        """Return its file, and how much it sends to whom; its steps are long."""
        names = sorted({step.controller for step in self.steps if step.controller})
        file = "" if self.file is None else f"{str(self.file)!r}, "
        size = f"{counted(len(self.steps), 'step')}, {self.duration:.2f} s"
        rounds = " a round" if self.repeats else ""
        return f"<Motion {file}{size}{rounds}, controllers {names}>"

    @property
    def duration(self) -> float:
        """When the last step is done, trajectories at their scaled speed [s].

        Of a motion that repeats it is that of one round: the next one starts when a
        further message of its steps would be due.
        """
        ends, planned = [self.end_of_messages], 0.0
        for step in self.steps:
            if isinstance(step.message, Task):  # It waits for those before.
                takes = _AT_MOST
                if isinstance(step.message, FollowThing):
                    takes = step.message.options.get("duration", _AT_MOST)
                planned = max(planned, step.at) + takes
        ends.append(planned)
        if self.repeats:
            ends += [step.at + step.every for step in self.steps]
        return max(ends, default=0.0)

    @property
    def end_of_messages(self) -> float:
        """When the last step is done that is no task [s]."""
        factors: dict[str | None, list[tuple[float, float]]] = {}
        for step in self.steps:
            factor = _speed_of(step.message)
            if factor is not None:
                factors.setdefault(_receiver(step), []).append((step.at, factor))
        ends = (_end(step, factors.get(_receiver(step), ())) for step in self.steps)
        return max(ends, default=0.0)

    @property
    def tasks(self) -> list[Task]:
        """Tasks of robots, however long they take, in order."""
        return [s.message for s in self.steps if isinstance(s.message, Task)]

    def timeline(self) -> Iterator[tuple[float, MotionStep]]:
        """Yield when each step is due [s], and the step; for ever if it repeats."""
        duration = self.duration if self.repeats else 0.0
        for number in itertools.count() if self.repeats else range(1):
            for step in self.steps:
                yield number * duration + step.at, step

    def place(self, step: MotionStep) -> str:
        """Return where a step stands, for messages."""
        if self.file is None:
            return step.where
        line = "" if step.line is None else f":{step.line}"
        return f"{self.file}{line}: {step.where}"


def default_duration(motion: Motion | None) -> float:
    """Return how long to simulate where nobody says it [s]: one round of a motion.

    Of one with tasks it is the most: its player knows when they are done.
    """
    return _WITHOUT_MOTION if motion is None else motion.duration + AFTER_MOTION


def _receiver(step: MotionStep) -> str | None:
    """Return the controller that a step is for, also if it is a topic of one."""
    if isinstance(step.message, TopicMessage):
        return step.message.topic.strip("/").rpartition("/")[0]
    return step.controller


def _speed_of(message: Sent) -> float | None:
    """Return how fast trajectories are to be followed, if a message says so."""
    if isinstance(message, SpeedScalingFactor):
        return message.factor
    if isinstance(message, TopicMessage) and message.topic.endswith(_SPEED_TOPIC):
        data = message.data
        return float(data) if isinstance(data, int | float) else None
    return None


def _end(step: MotionStep, factors: Iterable[tuple[float, float]]) -> float:
    """Return when a step is done [s], for its controller's changes of speed."""
    message = step.message
    if isinstance(message, TopicMessage) and isinstance(message.data, Mapping):
        length = message.data.get("time_range", 0.0)
        return step.at + (length if is_finite(length) else 0.0)
    if isinstance(message, TopicMessage):
        message = message.data if isinstance(message.data, JointTrajectory) else None
    elif isinstance(message, FollowJointTrajectoryGoal):
        message = message.trajectory
    if not isinstance(message, JointTrajectory) or not message.points:
        return step.at
    # A stamp counts from the start of the simulation.
    start = max(step.at, message.header.stamp.to_seconds())
    length = message.points[-1].time_from_start.to_seconds()
    return _scaled_end(start, max(0.0, length), factors)


def _scaled_end(
    start: float, length: float, factors: Iterable[tuple[float, float]]
) -> float:
    """Return when a trajectory ends [s]; if it stops for ever, when it does.

    It takes `length` [s] at full speed; `factors` say from when [s] its time passes how
    fast, in order.
    """
    now, speed = start, 1.0
    for at, factor in factors:
        if at > now:
            done = (at - now) * speed
            if done >= length:
                break
            now, length = at, length - done
        speed = factor
    return now + length / speed if speed > 0.0 else now


# So much faster than its limit a joint is by rounding.
_FASTER = 1.01


class LimitWatch:
    """Finds what in trajectories takes joints beyond their limits."""

    def __init__(self, joints: Iterable[JointInfo]) -> None:
        """Watch joints."""
        self._joints = {joint.name: joint for joint in joints}
        self._limits = {name: _limits_of(joint) for name, joint in self._joints.items()}

    def find(
        self, trajectory: JointTrajectory, start: Mapping[str, float] | None = None
    ) -> Iterator[tuple[int, str, str]]:
        """Yield which point takes which joint beyond limits, and a line about it.

        Speeds are those of the points, and at least what the way between two of them
        takes; `start` is where the joints are before, if that is known.
        """
        order = trajectory.joint_names
        limits = [self._limits.get(name, _NO_LIMITS) for name in order]
        before: Sequence[float | None] = [(start or {}).get(name) for name in order]
        then, none = 0.0, (0.0,) * len(order)
        for index, point in enumerate(trajectory.points):
            positions, velocities = point.positions, point.velocities
            if {len(positions), len(velocities)} - {0, len(order)}:
                return  # The controller rejects it.
            now = point.time_from_start.to_seconds()
            speeds, step, fast, is_beyond = velocities or none, now - then, {}, False
            for k, (lower, upper, most, turns) in enumerate(limits):
                speed = abs(speeds[k])
                if positions:
                    q, last = positions[k], before[k]
                    is_beyond = is_beyond or not lower <= q <= upper
                    if step > 0.0 and last is not None and not turns:
                        speed = max(speed, abs(q - last) / step)
                if speed > most:
                    fast[order[k]] = speed
            if is_beyond and not all(map(math.isfinite, positions)):
                return  # Nor does it take these.
            if is_beyond:
                at = dict(zip(order, positions, strict=True))
                for name, problem in beyond_limits(self._joints.values(), at):
                    yield index, name, problem
            for name, speed in fast.items():
                yield index, name, self._describe(name, speed)
            before, then = positions or before, now

    def _describe(self, name: str, speed: float) -> str:
        joint = self._joints[name]
        unit, limit = interfaces.unit(interfaces.VELOCITY, joint.type), joint.limits
        text = f"{name} would move at {speed:.3g} {unit}"
        return f"{text}, its limit is {limit.velocity:.3g} {unit}"


# Ends of a range, speed above which a joint is beyond its limit, whether it turns
# endlessly.
_NO_LIMITS = (-math.inf, math.inf, math.inf, True)


def _limits_of(joint: JointInfo) -> tuple[float, float, float, bool]:
    limit = joint.limits.velocity
    most = _FASTER * limit if limit is not None and limit > 0.0 else math.inf
    return (*joint.limits.range, most, joint.type == "continuous")


# Key of the steps of a motion that has parameters.
STEPS = "steps"


@dataclass(frozen=True)
class MotionFile:
    """File of a motion, and the YAML node that has the lines, if it is of one."""

    path: Path | None = None
    node: yaml.Node | None = None

    def line(self, place: str) -> int | None:
        """Return the line of a place such as "[1].goal", counted from 1."""
        if self.node is None:
            return None
        is_step = place.startswith("[") and isinstance(self.node, yaml.MappingNode)
        return yaml_files.find_line(self.node, f"{STEPS}{place}" if is_step else place)

    def error(self, problem: str, where: str = "", key: str = "") -> MotionError:
        """Return an error about a place, or about one of its keys."""
        place = f"{where}.{key}" if where and key else where or key
        line = self.line(place) if place else None
        return MotionError(problem, file=self.path, line=line, where=where)


class Fields:
    """Checks the fields of one step; places count from the step on."""

    def __init__(self, step: str, file: MotionFile) -> None:
        """Create it for a step at a place such as "[0]"."""
        self.step = step
        self._file = file

    def error(self, where: str, problem: str, key: str = "") -> MotionError:
        """Return an error about a field, or a key of it; "" is the step itself."""
        place = f"{self.step}.{where}" if where else self.step
        return self._file.error(problem, place, key)

    def mapping(
        self, value: Any, where: str, known: Iterable[str] | None = None
    ) -> Mapping[str, Any]:
        """Return a mapping, with no other keys than those known, if any are."""
        if not isinstance(value, Mapping):
            raise self.error(where, f"expected a mapping, got {value!r}")
        names = list(known or ())
        for key in value if known is not None else ():
            if key not in names:
                hint = suggest(str(key), names)
                raise self.error(where, f"unknown key {key!r}; {hint}", str(key))
        return value

    def list(self, value: Any, where: str) -> Sequence[Any]:
        """Return a list."""
        if not isinstance(value, list):
            raise self.error(where, f"expected a list, got {value!r}")
        return value

    def names(self, value: Any, where: str) -> tuple[str, ...]:
        """Return a list of names."""
        names = self.list(value, where)
        for name in names:
            if not isinstance(name, str):
                raise self.error(where, f"expected names, got {name!r}")
        return tuple(names)

    def number(self, value: Any, where: str) -> float:
        """Return a finite number."""
        if type(value) not in (int, float) or not abs(value) < math.inf:
            raise self.error(where, f"expected a finite number, got {value!r}")
        try:
            return float(value)
        except OverflowError:
            raise self.error(where, "the number is out of range") from None

    def numbers(self, value: Any, where: str) -> tuple[float, ...]:
        """Return a list of finite numbers."""
        return tuple(
            self.number(number, f"{where}[{index}]")
            for index, number in enumerate(self.list(value, where))
        )

    def time(self, kind: type[T], value: Any, where: str) -> T:
        """Return a time, written in seconds or as {sec, nanosec}."""
        try:
            return kind.of(value)
        except ValueError as error:
            raise self.error(where, str(error)) from None
        except OverflowError:
            raise self.error(where, f"{value!r} s is out of range") from None

    def seconds(self, value: Any, where: str) -> float:
        """Return a duration of at least 0 s [s]."""
        seconds = self.time(Duration, value, where).to_seconds()
        if seconds < 0.0:
            raise self.error(where, f"expected at least 0 s, got {value!r}")
        return seconds

    def build(self, kind: Callable[..., Any], value: Any, where: str) -> Any:
        """Return a message whose fields are numbers, vectors, a time and a name."""
        fields = [field.name for field in dc.fields(kind)]  # type: ignore[arg-type]
        data = self.mapping(value, where, fields)
        for name in set(data) & {"position", "velocity", "acceleration"}:
            self.number(data[name], f"{where}.{name}")
        for name in set(data) & {"positions", "velocities", "accelerations", "effort"}:
            self.numbers(data[name], f"{where}.{name}")
        if (time := data.get("time_from_start")) is not None:
            self.time(Duration, time, f"{where}.time_from_start")
        try:
            return kind(**data)
        except (TypeError, ValueError, OverflowError) as error:
            raise self.error(where, str(error)) from None


# What a plan leads to, and how it may be; with the type of each.
PLAN_GOALS = ("state", "positions", "pose")
THROUGH, UPRIGHT = "through", "upright"
PLAN_OPTIONS: Mapping[str, type] = {
    "robot": str,
    "group": str,
    "frame": str,
    "straight": bool,
    "velocity_scaling": float,
    "acceleration_scaling": float,
    "padding": float,
    "time_limit": float,
    "seed": int,
}

# How to pick and to place, with the type of each; None is a pose.
PICK_OPTIONS: Mapping[str, type | None] = {
    "robot": str,
    "group": str,
    "camera": str,
    "goal": None,
    "approach": float,
    "lift": float,
    "retreat": float,
    "tries": int,
    "upright": float,
    "velocity_scaling": float,
    "acceleration_scaling": float,
    "time_limit": float,
    "seed": int,
}


# How to follow, with the type of each.
FOLLOW_OPTIONS: Mapping[str, type | None] = {
    "robot": str,
    "group": str,
    "camera": str,
    "duration": float,
    "gain": float,
    "distance": float,
    "velocity_scaling": float,
}


def read_plan_to(fields: Fields, value: Any, where: str) -> PlanTo:
    """Return where to plan to: a state, positions or a pose, and how."""
    known = (*PLAN_GOALS, THROUGH, UPRIGHT, *PLAN_OPTIONS)
    data = dict(fields.mapping(value, where, known))
    through = fields.list(data.pop(THROUGH, []), f"{where}.{THROUGH}")
    found = []
    for index, goal in enumerate(through):
        place = f"{where}.{THROUGH}[{index}]"
        found.append(
            _read_goal(fields, dict(fields.mapping(goal, place, PLAN_GOALS)), place)
        )
    found.append(_read_goal(fields, data, where))
    masks = {mask for _, mask in found if mask is not None}
    if len(masks) > 1:
        raise fields.error(where, "expected poses that are all x, y, z, or all six")
    _check_options(fields, data, where, PLAN_OPTIONS)
    robot = data.pop("robot", None)
    options = data if masks <= {_WHOLE} else {**data, "mask": masks.pop()}
    if UPRIGHT in options:
        options["upright"] = _read_upright(
            fields, options["upright"], f"{where}.{UPRIGHT}"
        )
    return PlanTo(tuple(goal for goal, _ in found), robot=robot, options=options)


# What counts of poses: all of them, or their positions.
_WHOLE, _POINT = (True,) * 6, (True,) * 3 + (False,) * 3


def _read_goal(
    fields: Fields, data: dict[str, Any], where: str
) -> tuple[Any, tuple[bool, ...] | None]:
    """Take a goal out of a mapping; return it, and what counts of it if it's a pose."""
    goals = [key for key in PLAN_GOALS if key in data]
    if len(goals) != 1:
        expected = f"expected one of {', '.join(PLAN_GOALS)}"
        raise fields.error(where, f"{expected}; got {quoted(goals) or 'none'}")
    (kind,) = goals
    place, to = f"{where}.{kind}", data.pop(kind)
    if kind == "pose":
        pose = _read_place_pose(fields, to, place)
        return (pose, _WHOLE) if len(pose) == 6 else ((*pose, 0.0, 0.0, 0.0), _POINT)
    if kind == "positions":
        names = fields.mapping(to, place)
        return {
            str(n): fields.number(v, f"{place}.{n}") for n, v in names.items()
        }, None
    if not isinstance(to, str):
        raise fields.error(place, f"expected a name, got {to!r}")
    return to, None


def _read_upright(fields: Fields, value: Any, where: str) -> tuple[str, float]:
    """Return a link and how far it may tilt [rad]."""
    data = fields.mapping(value, where)
    if len(data) != 1:
        raise fields.error(where, f"expected one link and its angle, got {value!r}")
    ((link, angle),) = data.items()
    if not isinstance(link, str):
        raise fields.error(where, f"expected the name of a link, got {link!r}")
    return link, fields.number(angle, f"{where}.{link}")


def read_pick(fields: Fields, value: Any, where: str) -> PickThing:
    """Return what to pick, and how: a name, or a mapping with `thing`."""
    thing, data = _read_thing(fields, value, where, PICK_OPTIONS)
    if "goal" in data:
        data["goal"] = _read_place_pose(fields, data["goal"], f"{where}.goal")
    return PickThing(thing, robot=data.pop("robot", None), options=data)


def read_follow(fields: Fields, value: Any, where: str) -> FollowThing:
    """Return what to follow, and how: a name, or a mapping with `thing`."""
    thing, data = _read_thing(fields, value, where, FOLLOW_OPTIONS)
    return FollowThing(thing, robot=data.pop("robot", None), options=data)


def read_place(fields: Fields, value: Any, where: str) -> PlaceThing:
    """Return where to place, and how: a pose, or a mapping with `pose`."""
    data = dict(_task_options(fields, value, where, "pose", PICK_OPTIONS))
    pose = _read_place_pose(fields, data.pop("pose"), where)
    return PlaceThing(pose, robot=data.pop("robot", None), options=data)


def _read_thing(
    fields: Fields, value: Any, where: str, known: Mapping[str, type | None]
) -> tuple[str, dict[str, Any]]:
    """Return the name of a thing, and the options beside it."""
    data = dict(_task_options(fields, value, where, "thing", known))
    thing = data.pop("thing")
    if not isinstance(thing, str):
        raise fields.error(where, f"expected the name of a thing, got {thing!r}")
    return thing, data


def _task_options(
    fields: Fields, value: Any, where: str, key: str, known: Mapping[str, type | None]
) -> Mapping[str, Any]:
    """Return the options of a task; what isn't a mapping is its main part."""
    if not isinstance(value, Mapping):
        return {key: value}
    data = fields.mapping(value, where, (key, *known))
    if key not in data:
        raise fields.error(where, f"expected {key!r}, got {sorted(data)}")
    _check_options(fields, data, where, known)
    return data


def _read_place_pose(fields: Fields, value: Any, where: str) -> tuple[float, ...]:
    numbers = fields.numbers(value, where)
    if len(numbers) not in (3, 6):
        expected = "expected x, y, z [m] or x, y, z, roll, pitch, yaw [m, rad]"
        raise fields.error(where, f"{expected}, got {list(numbers)}")
    return numbers


def _check_options(
    fields: Fields,
    data: Mapping[str, Any],
    where: str,
    known: Mapping[str, type | None],
) -> None:
    """Raise MotionError if an option isn't of its type; None is any."""
    for key, type_ in known.items():
        if key not in data or type_ is None:
            continue
        if type_ is float:
            fields.number(data[key], f"{where}.{key}")
        elif type(data[key]) is not type_:
            noun = {str: "a name", bool: "true or false", int: "an integer"}[type_]
            raise fields.error(f"{where}.{key}", f"expected {noun}, got {data[key]!r}")
