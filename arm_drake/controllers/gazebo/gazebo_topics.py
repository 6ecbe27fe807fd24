"""Names of the topics of Gazebo's joint plugins, and what of their tags isn't done.

Sources: gz-sim, src/systems/joint_position_controller/JointPositionController.cc and
those beside it; gz-transport, src/TopicUtils.cc; ROS 2's design, "Topic and Service
name mapping" and "Static Remapping of Names".
"""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from arm_drake.description.gazebo_bumpers import ContactSensorTag
from arm_drake.description.gazebo_drives import DiffDrive, GazeboRosDiffDrive
from arm_drake.description.gazebo_joints import (
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
)

if TYPE_CHECKING:
    from arm_drake.messages import Twist

GazeboTag = (
    JointPositionController
    | JointController
    | JointTrajectoryController
    | JointStatePublisher
    | DiffDrive
    | GazeboRosJointPoseTrajectory
    | GazeboRosJointStatePublisher
    | GazeboRosDiffDrive
)

_Classic = (
    GazeboRosJointPoseTrajectory | GazeboRosJointStatePublisher | GazeboRosDiffDrive
)
_OneJoint = JointPositionController | JointController

# A remapping of a topic: from, to.
_REMAPPING = re.compile(r"(?P<old>[\w/]+):=(?P<new>[\w/]+)")

# Remaps the namespace itself.
_NAMESPACE = "__ns"


def position_topic(tag: JointPositionController, model: str) -> str:
    """Return the topic of a JointPositionController.

    Gazebo's default contains the index of the axis. That of the first axis, the only
    one that a joint of a URDF has, is left out here, as on the ROS side of the bridges.

    Args:
        tag: The plugin's fields.
        model: Name of the robot.
    """
    index = f"/{tag.joint_index}" if tag.joint_index else ""
    return _command_topic(tag, model, f"{index}/cmd_pos")


def velocity_topic(tag: JointController, model: str) -> str:
    """Return the topic of a JointController.

    Args:
        tag: The plugin's fields.
        model: Name of the robot.
    """
    return _command_topic(tag, model, "/cmd_vel")


def trajectory_topic(tag: JointTrajectoryController, model: str) -> str:
    """Return the topic of a JointTrajectoryController.

    Args:
        tag: The plugin's fields.
        model: Name of the robot.
    """
    return _as_topic(tag.topic or f"model/{model}/joint_trajectory")


def joint_state_topic(tag: JointStatePublisher, model: str, world: str) -> str:
    """Return the topic of a JointStatePublisher.

    Args:
        tag: The plugin's fields.
        model: Name of the robot.
        world: Name of the world.
    """
    return _as_topic(tag.topic or f"world/{world}/model/{model}/joint_state")


def contact_topic(tag: ContactSensorTag, model: str, world: str) -> str:
    """Return the topic of a contact sensor.

    Args:
        tag: The sensor.
        model: Name of the robot.
        world: Name of the world.
    """
    if tag.is_classic:
        return ros_topic("bumper_states", tag.namespace, tag.remappings)
    place = f"world/{world}/model/{model}/link/{tag.link}/sensor/{tag.name}"
    return _as_topic(tag.topic or f"{place}/contact")


class DriveTopics(NamedTuple):
    """Topics of a DiffDrive."""

    command: str
    enable: str
    odometry: str
    tf: str


def drive_topics(tag: DiffDrive, model: str) -> DriveTopics:
    """Return the topics of a DiffDrive.

    Args:
        tag: The plugin's fields.
        model: Name of the robot.
    """
    given = (tag.topic, "", tag.odom_topic, tag.tf_topic)
    ends = ("cmd_vel", "enable", "odometry", "tf")
    names = (
        _as_topic(name or f"model/{model}/{end}")
        for name, end in zip(given, ends, strict=True)
    )
    return DriveTopics(*names)


def ros_topic(name: str, namespace: str, remappings: Sequence[str]) -> str:
    """Return the full name of a topic of a plugin of Gazebo Classic.

    Args:
        name: Its name in the plugin, such as "joint_states".
        namespace: Namespace of the plugin's node; may be empty.
        remappings: Rules "from:=to" of its tag; the first that fits holds.
    """
    rules = [rule for text in remappings if (rule := _REMAPPING.fullmatch(text))]
    for rule in rules:
        if rule["old"] == _NAMESPACE:
            namespace = rule["new"]
            break
    topic = _resolve(name, namespace)
    for rule in rules:
        if _resolve(rule["old"], namespace) == topic:
            return _resolve(rule["new"], namespace)
    return topic


def find_twist_fault(message: "Twist") -> str:
    """Return why a base doesn't take a velocity; empty if it does."""
    numbers = (message.linear.x, message.angular.z)
    if all(map(math.isfinite, numbers)):
        return ""
    return "linear.x and angular.z must be finite; the message is dropped"


def find_unsupported(tag: GazeboTag) -> list[str]:
    """Return what a tag asks for that isn't done, in words for the load report.

    Args:
        tag: The plugin's fields.
    """
    problems = []
    if isinstance(tag, _OneJoint) and tag.use_actuator_msg:
        problems.append(
            "use_actuator_msg: no messages of actuators are taken; the joint's own "
            "topic takes numbers"
        )
    if isinstance(tag, GazeboRosDiffDrive):
        pairs = max(1, tag.num_wheel_pairs)
        for name in ("wheel_separation", "wheel_diameter"):
            number = len(getattr(tag, name))
            if number > pairs:
                problems.append(f"{name}: {number} values for {pairs} pairs of wheels")
    if isinstance(tag, _Classic):
        problems += [
            f"remapping {text!r}: expected from:=to, with names of topics"
            for text in tag.remappings
            if not _REMAPPING.fullmatch(text)
        ]
    return problems


def _command_topic(tag: _OneJoint, model: str, end: str) -> str:
    if tag.topic:
        return _as_topic(tag.topic)
    if tag.sub_topic:
        return _as_topic(f"model/{model}/{tag.sub_topic.strip()}")
    return _as_topic(f"model/{model}/joint/{tag.joint_names[0]}{end}")


def _as_topic(name: str) -> str:
    return "/" + name.strip().lstrip("/").replace(" ", "_")


def _resolve(name: str, namespace: str) -> str:
    """Return the full name of a topic, which may be relative to a namespace."""
    parts = (
        name.split("/") if name.startswith("/") else f"{namespace}/{name}".split("/")
    )
    return "/" + "/".join(filter(None, parts))
