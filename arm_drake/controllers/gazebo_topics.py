"""Names of the topics of Gazebo's joint plugins, and what of their tags isn't done.

Sources: gz-sim, src/systems/joint_position_controller/JointPositionController.cc and
those beside it; gz-transport, src/TopicUtils.cc; ROS 2's design, "Topic and Service
name mapping" and "Static Remapping of Names".
"""

import re
from collections.abc import Sequence

from arm_drake.description.gazebo_joints import (
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
)

GazeboTag = (
    JointPositionController
    | JointController
    | JointTrajectoryController
    | JointStatePublisher
    | GazeboRosJointPoseTrajectory
    | GazeboRosJointStatePublisher
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
    if isinstance(tag, GazeboRosJointPoseTrajectory | GazeboRosJointStatePublisher):
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
