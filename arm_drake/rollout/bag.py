"""Rollouts as bags of ROS 2 messages, in an `.mcap` file.

What ROS has messages for is in topics as ROS names them; the rest is in topics of ours,
as JSON, so that a rollout comes out of its bag as it went in.
"""

import functools
import itertools
import json
import math
import operator
import re
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.description.joints import WORLD
from arm_drake.errors import InputError, check_known
from arm_drake.messages import NANOSECONDS
from arm_drake.messages.base import ros_type
from arm_drake.rollout.link_poses import (
    LinkTransform,
    base_pose,
    fixed_pose,
    read_transforms,
    root_links,
)
from arm_drake.rollout.mcap import MAGIC, McapFile, load_types, type_of
from arm_drake.rollout.rollout import (
    STATIC_FIELDS,
    ClientInput,
    GoalRecord,
    Rollout,
    SentMessage,
    make_static,
    read_static,
    to_plain,
)
from arm_drake.rollout.sensor_messages import SENSOR_TYPES, make_message, to_fields

# Names of topics that are ours; in front of them stands the robot's namespace.
STATIC, GOALS = "/arm_drake/rollout", "/arm_drake/goals"
MESSAGES, ACTIVE = "/arm_drake/messages", "/arm_drake/active_controllers"
INPUTS = "/arm_drake/inputs"
COMMANDS, POSES = "/arm_drake/command_interfaces", "/arm_drake/pose/"
CONTACTS = "/arm_drake/contact_force/"

JOINT_STATES, DESCRIPTION = "/joint_states", "/robot_description"
CONTROLLER_STATE = "/controller_state"

JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
STRING_TYPE = "std_msgs/msg/String"
STATE_TYPE = "control_msgs/msg/JointTrajectoryControllerState"
COMMANDS_TYPE = "control_msgs/msg/DynamicJointState"
NUMBERS_TYPE = "std_msgs/msg/Float64MultiArray"
POSE_TYPE = "geometry_msgs/msg/PoseStamped"
WRENCH_TYPE = "geometry_msgs/msg/WrenchStamped"
_TF_TYPE = "tf2_msgs/msg/TFMessage"
_LOG_TYPE = "rcl_interfaces/msg/Log"

# What names of topics can't have.
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_/]")

# Topics that tell a late listener their last message.
LATCHED = (DESCRIPTION, "/tf_static", STATIC, ACTIVE)

# Levels of rcl_interfaces/msg/Log.
_INFO, _ERROR = 20, 40


class BagMessage(NamedTuple):
    """A message, its topic and time."""

    topic: str
    type: str
    time_ns: int
    fields: Mapping[str, Any]


def stamp(time_ns: int) -> dict[str, int]:
    """Return a time as the fields of builtin_interfaces/Time."""
    sec, nanosec = divmod(time_ns, NANOSECONDS)
    return {"sec": sec, "nanosec": nanosec}


def pose_topic(namespace: str, link: str) -> str:
    """Return the topic with the poses of a free link."""
    return f"{namespace}{POSES}{_topic_part(link)}"


def contact_topic(namespace: str, link: str) -> str:
    """Return the topic with the contact forces on a link."""
    return f"{namespace}{CONTACTS}{_topic_part(link)}"


def _topic_part(link: str) -> str:
    """Return the name of a link as topics may have it, another one for each link."""
    name = _NOT_IN_NAMES.sub("_", link)
    return name if name == link else f"{name}_{zlib.crc32(link.encode()):08x}"


@functools.lru_cache(maxsize=16)  # Every row asks.
def group_commands(names: tuple[str, ...]) -> Mapping[str, list[tuple[str, int]]]:
    """Return by joint the names of "<joint>/<interface>", and their places here."""
    groups: dict[str, list[tuple[str, int]]] = {}
    for index, name in enumerate(names):
        joint, _, interface = name.rpartition("/")
        groups.setdefault(joint, []).append((interface, index))
    return groups


def row_messages(
    rollout: Rollout, row: int, time_ns: int, prefix: str
) -> Iterator[BagMessage]:
    """Yield what a row says, but for frames."""
    header = {"stamp": stamp(time_ns)}
    position, velocity = rollout.position[row], rollout.velocity[row]
    fields: dict[str, Any] = {
        "header": header,
        "name": rollout.joint_names,
        "position": position,
        "velocity": velocity,
        "effort": rollout.effort[row],
    }
    yield BagMessage(f"{prefix}{JOINT_STATES}", JOINT_STATE_TYPE, time_ns, fields)
    if rollout.command_names:
        values = rollout.command[row]
        groups = group_commands(rollout.command_names)
        fields = {
            "header": header,
            "joint_names": list(groups),
            "interface_values": [
                {
                    "interface_names": [name for name, _ in parts],
                    "values": [values[index] for _, index in parts],
                }
                for parts in groups.values()
            ],
        }
        yield BagMessage(f"{prefix}{COMMANDS}", COMMANDS_TYPE, time_ns, fields)
    for name, reference in rollout.references.items():
        reference_position = reference.position[row]
        if np.all(np.isnan(reference_position)):
            continue
        columns = [rollout.joint_names.index(joint) for joint in reference.joint_names]
        fields = {
            "header": header,
            "joint_names": reference.joint_names,
            "reference": {"positions": reference_position},
            "feedback": {
                "positions": position[columns],
                "velocities": velocity[columns],
            },
            "error": {"positions": reference_position - position[columns]},
            "output": _output(rollout, row, reference.joint_names, reference_position),
            "speed_scaling_factor": 1.0,
        }
        topic = f"{prefix}/{name}{CONTROLLER_STATE}"
        yield BagMessage(topic, STATE_TYPE, time_ns, fields)
    for link, poses in rollout.free_poses.items():
        if np.all(np.isfinite(poses[row])):
            placed = {"stamp": stamp(time_ns), "frame_id": WORLD}
            fields = {"header": placed, "pose": _pose(poses[row])}
            yield BagMessage(pose_topic(prefix, link), POSE_TYPE, time_ns, fields)
    for link, forces in rollout.contact_forces.items():
        # Where nothing touches there is nothing to tell: most links, at most times.
        if forces[row].any() and np.any(force := np.nan_to_num(forces[row])):
            fields = {"header": header, "wrench": {"force": _vector(force)}}
            yield BagMessage(contact_topic(prefix, link), WRENCH_TYPE, time_ns, fields)


def _output(
    rollout: Rollout, row: int, joints: Sequence[str], reference_position: Array
) -> dict[str, Any]:
    """Return what a controller commands, if that is the positions that it wants."""
    names = [f"{joint}/position" for joint in joints]
    if not set(names) <= set(rollout.command_names):
        return {}
    columns = [rollout.command_names.index(name) for name in names]
    is_same = np.array_equal(
        rollout.command[row, columns], reference_position, equal_nan=True
    )
    return {"positions": reference_position} if is_same else {}


def sent_messages(message: SentMessage, prefix: str) -> Iterator[BagMessage]:
    """Yield a message on its own topic, if there is one, and as text in any case."""
    time_ns = round(message.time * NANOSECONDS)
    type_ = type_of(message.type)
    if type_ is not None:
        yield BagMessage(message.topic, type_, time_ns, message.data)
    yield make_string(f"{prefix}{MESSAGES}", time_ns, _json(message))


def goal_messages(
    goal: GoalRecord, number: int, *, is_new: bool, rollout: Rollout
) -> Iterator[BagMessage]:
    """Yield what is new about a goal."""
    prefix, sent_ns = rollout.namespace, round(goal.sent_at * NANOSECONDS)
    trajectory = goal.goal.get("trajectory")
    if is_new and trajectory:
        # Among several robots the controller's name has that of its robot.
        root = rollout.namespace if rollout.has_own_namespace else ""
        topic = f"{root}/{goal.controller}/follow_joint_trajectory/trajectory"
        type_ = "trajectory_msgs/msg/JointTrajectory"
        yield BagMessage(topic, type_, sent_ns, trajectory)
    time_ns = sent_ns
    if goal.ended_at is not None:
        time_ns = round(goal.ended_at * NANOSECONDS)
    elif not is_new and len(rollout.time):
        time_ns = round(float(rollout.time[-1]) * NANOSECONDS)
    yield make_string(
        f"{prefix}{GOALS}", time_ns, _json({"number": number, "goal": goal})
    )
    text = f"goal {goal.status}"
    if goal.error_code is not None:
        text += f", error code {goal.error_code}"
    fields = {
        "stamp": stamp(time_ns),
        "level": _ERROR if goal.status in ("REJECTED", "ABORTED") else _INFO,
        "name": goal.controller,
        "msg": f"{text}: {goal.error_string}" if goal.error_string else text,
    }
    yield BagMessage("/rosout", _LOG_TYPE, time_ns, fields)


def fixed_frames(
    rollout: Rollout, transforms: Sequence[LinkTransform]
) -> list[tuple[str, str, Array]]:
    """Return the frames that never move: parent, child, pose."""
    nothing = np.zeros(1)
    found = [
        (t.parent, t.child, t.poses(nothing)[0]) for t in transforms if not t.joint
    ]
    roots = root_links(rollout.description, transforms)
    found += [
        (WORLD, root, np.hstack(fixed_pose(base_pose(rollout.info))))
        for root in roots
        if root not in rollout.free_poses
    ]
    return found


def _frames_of(rollout: Rollout) -> str:
    """Return the name space of a robot's frames: its name if there are several."""
    return "" if rollout.has_own_namespace else rollout.namespace


def make_tf(
    topic: str,
    frames: Sequence[tuple[str, str, Array]],
    time_ns: int,
    namespace: str,
) -> BagMessage:
    """Return frames as a message; those of several robots have the robot's name."""
    prefix = f"{namespace.strip('/')}/" if namespace else ""

    def name(link: str) -> str:
        return link if link == WORLD else f"{prefix}{link}"

    transforms = []
    for parent, child, pose in frames:
        parts = _pose(pose)
        transforms.append(
            {
                "header": {"stamp": stamp(time_ns), "frame_id": name(parent)},
                "child_frame_id": name(child),
                "transform": {
                    "translation": parts["position"],
                    "rotation": parts["orientation"],
                },
            }
        )
    return BagMessage(topic, _TF_TYPE, time_ns, {"transforms": transforms})


def _vector(values: Array) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))


def _pose(pose: Array) -> dict[str, dict[str, float]]:
    """Return x, y, z, quaternion w, x, y, z as the fields of a pose."""
    x, y, z, w, i, j, k = pose.tolist()
    orientation = {"x": i, "y": j, "z": k, "w": w}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}


def make_string(topic: str, time_ns: int, text: str) -> BagMessage:
    """Return a text as a message."""
    return BagMessage(topic, STRING_TYPE, time_ns, {"data": text})


def _json(value: Any) -> str:
    return json.dumps(to_plain(value), ensure_ascii=False)


# Frames are told at most so often [Hz], as robot_state_publisher does.
_TF_RATE = 50.0


class RobotTopics:
    """Messages of one robot, part by part; none is repeated."""

    def __init__(self) -> None:
        """Create it, before the first message."""
        self._last_ns = -1
        self._last_tf_ns = -NANOSECONDS
        self._static = self._active = ""
        self._description = ""
        self._transforms: tuple[LinkTransform, ...] = ()
        # Status of each goal as it was told last.
        self._goals: dict[int, str] = {}
        # Time of the last message and input that are told, and how many of that time.
        self._last_sent = self._last_input = (-math.inf, 0)
        # Time of the last message of each topic of cameras and lidars [ns].
        self._sensed: dict[str, int] = {}

    def messages_of(self, rollout: Rollout) -> Iterator[BagMessage]:
        """Yield messages of what is later than the last rollout, not in their order."""
        times = np.round(rollout.time * NANOSECONDS).astype(np.int64)
        new = np.flatnonzero(times > self._last_ns)
        start = max(int(times[new[0]]) if len(new) else self._last_ns, 0)
        yield from self._static_messages(rollout, start)
        yield from self._topic_messages(rollout)
        yield from self._goal_messages(rollout)
        prefix = rollout.namespace
        for row in new:
            time_ns = int(times[row])
            yield from row_messages(rollout, int(row), time_ns, prefix)
            yield from self._active_messages(rollout, int(row), time_ns)
        yield from self._tf_messages(rollout, times, new)
        yield from self._sensor_messages(rollout)
        if len(new):
            self._last_ns = int(times[new[-1]])

    def _sensor_messages(self, rollout: Rollout) -> Iterator[BagMessage]:
        """Yield the messages of cameras and lidars."""
        for topic, messages in rollout.sensor_messages.items():
            for message in messages:
                time_ns = message.header.stamp.to_nanoseconds()  # type: ignore[attr-defined]
                if time_ns > self._sensed.get(topic, -1):
                    self._sensed[topic] = time_ns
                    type_ = str(ros_type(type(message)))
                    yield BagMessage(topic, type_, time_ns, to_fields(message))

    def _static_messages(self, rollout: Rollout, time_ns: int) -> Iterator[BagMessage]:
        prefix = rollout.namespace
        text = make_static(rollout, is_whole=False)
        if text != self._static:
            self._static = text
            yield make_string(f"{prefix}{STATIC}", time_ns, text)
        if rollout.description != self._description:
            self._description = rollout.description
            yield make_string(f"{prefix}{DESCRIPTION}", time_ns, rollout.description)
            try:
                pose = base_pose(rollout.info)
                self._transforms = read_transforms(rollout.description, pose)
            except (ET.ParseError, InputError):
                return
            fixed = fixed_frames(rollout, self._transforms)
            if fixed:
                yield make_tf("/tf_static", fixed, time_ns, _frames_of(rollout))

    def _topic_messages(self, rollout: Rollout) -> Iterator[BagMessage]:
        sent, self._last_sent = _later(rollout.messages, self._last_sent)
        for message in sent:
            yield from sent_messages(message, rollout.namespace)
        inputs, self._last_input = _later(rollout.inputs, self._last_input)
        for each in inputs:
            topic = f"{rollout.namespace}{INPUTS}"
            yield make_string(topic, round(each.time * NANOSECONDS), _json(each))

    def _goal_messages(self, rollout: Rollout) -> Iterator[BagMessage]:
        for number, goal in enumerate(rollout.goals):
            known = self._goals.get(number, "")
            if known == goal.status:
                continue
            self._goals[number] = goal.status
            yield from goal_messages(goal, number, is_new=not known, rollout=rollout)

    def _active_messages(
        self, rollout: Rollout, row: int, time_ns: int
    ) -> Iterator[BagMessage]:
        active = rollout.active[row].tolist()
        if active and str(active) != self._active:
            self._active = str(active)
            yield BagMessage(
                f"{rollout.namespace}{ACTIVE}", NUMBERS_TYPE, time_ns, {"data": active}
            )

    def _tf_messages(
        self, rollout: Rollout, times: NDArray[np.int64], new: NDArray[np.int64]
    ) -> Iterator[BagMessage]:
        rows = []
        for row in new:
            if times[row] - self._last_tf_ns >= NANOSECONDS / _TF_RATE - 1:
                self._last_tf_ns = int(times[row])
                rows.append(int(row))
        frames = [
            (WORLD, link, poses[rows]) for link, poses in rollout.free_poses.items()
        ]
        columns = {name: column for column, name in enumerate(rollout.joint_names)}
        frames += [
            (
                each.parent,
                each.child,
                each.poses(rollout.position[rows, columns[each.joint]]),
            )
            for each in self._transforms
            if each.joint in columns
        ]
        for index, row in enumerate(rows):
            parts = [(parent, child, poses[index]) for parent, child, poses in frames]
            parts = [part for part in parts if np.all(np.isfinite(part[2]))]
            if parts:
                yield make_tf("/tf", parts, int(times[row]), _frames_of(rollout))


_Sent = TypeVar("_Sent", SentMessage, ClientInput)


def _later(
    sent: Sequence[_Sent], last: tuple[float, int]
) -> tuple[list[_Sent], tuple[float, int]]:
    """Return what isn't told yet, and the last time with how many there are of it.

    What is told is known by the last time [s], and how many of that time are told.
    """
    time, count = last
    known = [each for each in sent if each.time == time]
    later = [each for each in sent if each.time > time]
    if sent:
        times = [each.time for each in sent]
        last = times[-1], times.count(times[-1])
    return known[count:] + later, last


_CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""


class BagWriter:
    """Writes rollouts of one or several robots, part by part, into one file."""

    def __init__(self, path: Path) -> None:
        """Create the file, replacing an existing one; it takes rosbags."""
        self._types = load_types()
        # It comes with rosbags.
        import zstandard

        compressor = zstandard.ZstdCompressor(level=3)
        self._file = McapFile(path, compress=compressor.compress, compression="zstd")
        self._channels: dict[str, int] = {}
        self._robots: dict[str, RobotTopics] = {}
        self._clock_ns = -1

    def write(self, *rollouts: Rollout) -> None:
        """Write what is later than each robot's last rollout; the file is complete."""
        messages: list[BagMessage] = []
        for rollout in rollouts:
            topics = self._robots.setdefault(rollout.namespace, RobotTopics())
            messages += topics.messages_of(rollout)
            for time in rollout.time:
                time_ns = round(float(time) * NANOSECONDS)
                if time_ns > self._clock_ns:
                    self._clock_ns = time_ns
                    fields = {"clock": stamp(time_ns)}
                    messages.append(BagMessage("/clock", _CLOCK_TYPE, time_ns, fields))
        for message in sorted(messages, key=lambda message: message.time_ns):
            data = self._types.encode(message.type, message.fields)
            self._file.write(self._channel(message), message.time_ns, data)
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _channel(self, message: BagMessage) -> int:
        if message.topic not in self._channels:
            is_latched = message.topic.endswith(LATCHED)
            qos = _QOS.format(
                depth=1 if is_latched else 10,
                durability="transient_local" if is_latched else "volatile",
            )
            self._channels[message.topic] = self._file.add_channel(
                message.topic,
                message.type,
                self._types.schema(message.type),
                {
                    "offered_qos_profiles": qos,
                    "topic_type_hash": self._types.hash(message.type),
                },
            )
        return self._channels[message.topic]


# Messages of a topic with their times [ns].
_Messages = list[tuple[int, Any]]


def read_fields(path: Path, robot: str | None = None) -> dict[str, Any]:
    """Return the fields of a robot's rollout, by default of the first robot.

    Raises InputError if the file is something else, or has no such robot.
    """
    types = load_types()
    from rosbags.rosbag2 import Reader
    from rosbags.rosbag2.errors import ReaderError

    topics: dict[str, _Messages] = {}
    try:
        with Reader(path) as reader:
            ours = [c for c in reader.connections if _is_ours(c.topic, c.msgtype)]
            for connection in ours:
                topics[connection.topic] = []
            for connection, time_ns, data in reader.messages(connections=ours):
                message = types.decode(connection.msgtype, data)
                topics[connection.topic].append((time_ns, message))
        return _read(topics, robot)
    except (ReaderError, ValueError, KeyError, TypeError, AssertionError) as error:
        if isinstance(error, InputError):
            raise InputError(error.problem, file=path) from None
        problem = f"no rollout; expected a bag of Rollout.save ({error})"
        with path.open("rb") as file:
            if isinstance(error, ReaderError) and file.read(len(MAGIC)) == MAGIC:
                problem += "; `mcap recover` mends a bag that was cut"
        raise InputError(problem, file=path) from None


def _is_ours(topic: str, type_: str) -> bool:
    own_topics = (
        STATIC,
        GOALS,
        MESSAGES,
        INPUTS,
        ACTIVE,
        COMMANDS,
        JOINT_STATES,
        DESCRIPTION,
    )
    return (
        topic.endswith((*own_topics, CONTROLLER_STATE))
        or any(part in topic for part in (POSES, CONTACTS))
        or type_ in SENSOR_TYPES
    )


def _read(topics: Mapping[str, _Messages], robot: str | None) -> dict[str, Any]:
    statics = {
        topic.removesuffix(STATIC): read_static(messages[-1][1].data)
        for topic, messages in topics.items()
        if topic.endswith(STATIC)
    }
    names = {static["robot_name"]: prefix for prefix, static in statics.items()}
    if not names:
        raise KeyError(f"no topic {STATIC}")
    if robot is None:
        robot = next(iter(names))
    check_known("robot", robot, names)
    prefix = names[robot]
    return _read_robot(topics, prefix, statics[prefix])


class _RobotMessages:
    """Messages of one robot, and the rows that they belong to."""

    def __init__(self, topics: Mapping[str, _Messages], prefix: str) -> None:
        self._topics, self._prefix = topics, prefix
        self.times_ns = [time_ns for time_ns, _ in self.of(JOINT_STATES)]
        self.rows = {time_ns: row for row, time_ns in enumerate(self.times_ns)}

    def of(self, topic: str) -> _Messages:
        """Return the messages of a topic, none if it is missing."""
        return self._topics.get(f"{self._prefix}{topic}", [])

    def texts(self, topic: str) -> list[str]:
        """Return the messages of a topic that are texts."""
        return [message.data for _, message in self.of(topic)]

    def fill(self, topic: str, size: int, read: Callable[[Any], Any]) -> Array:
        """Return a value for each row, NaN where there is no message."""
        values = np.full((len(self.rows), size), np.nan)
        for time_ns, message in self.of(topic):
            values[self.rows[time_ns]] = read(message)
        return values


def _read_robot(
    topics: Mapping[str, _Messages], prefix: str, static: dict[str, Any]
) -> dict[str, Any]:
    found = _RobotMessages(topics, prefix)
    num_joints = len(static["joint_names"])
    goals = {}
    for text in found.texts(GOALS):
        each = json.loads(text)
        goals[each["number"]] = GoalRecord(**each["goal"])
    messages = (json.loads(text) for text in found.texts(MESSAGES))
    inputs = (json.loads(text) for text in found.texts(INPUTS))
    return {
        # Goals, messages and description are in topics of their own.
        **{name: static[name] for name in STATIC_FIELDS if name in static},
        "time": np.array(found.times_ns, dtype=float) / 1e9,
        **{
            name: found.fill(JOINT_STATES, num_joints, operator.attrgetter(name))
            for name in ("position", "velocity", "effort")
        },
        "effort_limit": np.array(static["effort_limit"], dtype=float),
        "command": _read_commands(found, static["command_names"]),
        "active": _read_active(found, len(static["controllers"])),
        "references": dict(_read_references(found, static["references"])),
        "free_poses": {
            link: found.fill(pose_topic("", link), 7, _pose_numbers)
            for link in static["free_poses"]
        },
        "contact_forces": {
            link: np.nan_to_num(found.fill(contact_topic("", link), 3, _force))
            for link in static["contact_forces"]
        },
        "sensor_messages": {
            topic: tuple(
                make_message(SENSOR_TYPES[f"sensor_msgs/msg/{type_}"], message)
                for _, message in topics.get(topic, [])
            )
            for topic, type_ in static.get("sensor_messages", {}).items()
        },
        "goals": tuple(goals[number] for number in sorted(goals)),
        "messages": tuple(SentMessage(**message) for message in messages),
        "inputs": tuple(ClientInput(**each) for each in inputs),
        "description": (found.texts(DESCRIPTION) or [""])[-1],
    }


def _read_commands(found: _RobotMessages, names: tuple[str, ...]) -> Array:
    """Return the values of command interfaces, each in its column."""
    groups = group_commands(names)
    order = [index for parts in groups.values() for _, index in parts]
    command = np.full((len(found.rows), len(order)), np.nan)
    command[:, order] = found.fill(
        COMMANDS,
        len(order),
        lambda m: [value for part in m.interface_values for value in part.values],
    )
    return command


def _read_active(found: _RobotMessages, num_controllers: int) -> Array:
    """Return which controllers were active; a message is there where that changed."""
    active = found.fill(ACTIVE, num_controllers, operator.attrgetter("data"))
    changes = sorted(found.rows[time_ns] for time_ns, _ in found.of(ACTIVE))
    for start, end in itertools.pairwise([*changes, len(found.rows)]):
        active[start:end] = active[start]
    return active


def _read_references(
    found: _RobotMessages, joints: Mapping[str, tuple[str, ...]]
) -> Iterator[tuple[str, tuple[tuple[str, ...], Array]]]:
    """Yield controllers with their joints and positions."""
    positions = operator.attrgetter("reference.positions")
    for name, names in joints.items():
        topic = f"/{name}{CONTROLLER_STATE}"
        # Of one that never was active there are no messages.
        if found.of(topic) or not found.rows:
            yield name, (names, found.fill(topic, len(names), positions))


def _force(message: Any) -> list[float]:
    force = message.wrench.force
    return [force.x, force.y, force.z]


def _pose_numbers(message: Any) -> list[float]:
    p, q = message.pose.position, message.pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
