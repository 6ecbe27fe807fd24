"""Messages of ROS 2, and what of a rollout makes them."""

import functools
import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.joints import WORLD
from arm_drake.messages import NANOSECONDS
from arm_drake.rollout.link_transforms import (
    LinkTransform,
    base_pose,
    fixed_pose,
    root_links,
)
from arm_drake.rollout.records import to_plain
from arm_drake.rollout.rollout import GoalRecord, Rollout, SentMessage
from arm_drake.rollout.ros_types import type_of

# Names of topics that are ours; in front of them stands the robot's namespace.
STATIC, GOALS = "/arm_drake/rollout", "/arm_drake/goals"
MESSAGES, ACTIVE = "/arm_drake/messages", "/arm_drake/active_controllers"
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
    """Return the command interfaces of each joint or other component.

    Args:
        names: "<joint>/<interface>" of each.

    Returns:
        Names of interfaces with their places among all, by joint.
    """
    groups: dict[str, list[tuple[str, int]]] = {}
    for index, name in enumerate(names):
        joint, _, interface = name.rpartition("/")
        groups.setdefault(joint, []).append((interface, index))
    return groups


def tell_row(
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
        wanted = reference.position[row]
        if np.all(np.isnan(wanted)):
            continue
        columns = [rollout.joint_names.index(joint) for joint in reference.joint_names]
        fields = {
            "header": header,
            "joint_names": reference.joint_names,
            "reference": {"positions": wanted},
            "feedback": {
                "positions": position[columns],
                "velocities": velocity[columns],
            },
            "error": {"positions": wanted - position[columns]},
            "output": _output(rollout, row, reference.joint_names, wanted),
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
        # Where nothing touches there is nothing to tell.
        if np.any(force := np.nan_to_num(forces[row])):
            fields = {"header": header, "wrench": {"force": _vector(force)}}
            yield BagMessage(contact_topic(prefix, link), WRENCH_TYPE, time_ns, fields)


def _output(
    rollout: Rollout, row: int, joints: Sequence[str], wanted: Array
) -> dict[str, Any]:
    """Return what a controller commands, if that is the positions that it wants."""
    names = [f"{joint}/position" for joint in joints]
    if not set(names) <= set(rollout.command_names):
        return {}
    columns = [rollout.command_names.index(name) for name in names]
    is_same = np.array_equal(rollout.command[row, columns], wanted, equal_nan=True)
    return {"positions": wanted} if is_same else {}


def tell_sent(message: SentMessage, prefix: str) -> Iterator[BagMessage]:
    """Yield a message on its own topic, if there is one, and as text in any case."""
    time_ns = round(message.time * NANOSECONDS)
    type_ = type_of(message.type)
    if type_ is not None:
        yield BagMessage(message.topic, type_, time_ns, message.data)
    yield make_string(f"{prefix}{MESSAGES}", time_ns, _json(message))


def tell_goal(
    goal: GoalRecord, number: int, *, is_new: bool, rollout: Rollout
) -> Iterator[BagMessage]:
    """Yield what is new about a goal."""
    prefix, sent_ns = rollout.namespace, round(goal.sent_at * NANOSECONDS)
    trajectory = goal.goal.get("trajectory")
    if is_new and trajectory:
        topic = f"/{goal.controller}/follow_joint_trajectory/trajectory"
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
