"""Gazebo's joint plugins: which system stands for which tag."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.description import gazebo_plugins
from arm_drake.description.gazebo_plugins import ContactSensorTag

# Modules of this package, and the systems in them; imported when a robot has the tag.
_SYSTEMS: Mapping[type, tuple[str, str]] = {
    gazebo_plugins.JointPositionController: (
        "gazebo.joint_controllers",
        "JointPositionController",
    ),
    gazebo_plugins.JointController: (
        "gazebo.joint_controllers",
        "JointController",
    ),
    gazebo_plugins.JointTrajectoryController: (
        "gazebo.joint_trajectory",
        "JointTrajectoryController",
    ),
    gazebo_plugins.JointStatePublisher: (
        "gazebo.joint_state_publisher",
        "JointStatePublisher",
    ),
    ContactSensorTag: ("gazebo.contact_sensor", "ContactSensor"),
    gazebo_plugins.DiffDrive: ("gazebo.diff_drive", "DiffDrive"),
    gazebo_plugins.GazeboRosDiffDrive: (
        "gazebo.diff_drive",
        "GazeboRosDiffDrive",
    ),
    gazebo_plugins.GazeboRosJointPoseTrajectory: (
        "gazebo.joint_trajectory",
        "GazeboRosJointPoseTrajectory",
    ),
    gazebo_plugins.GazeboRosJointStatePublisher: (
        "gazebo.joint_state_publisher",
        "GazeboRosJointStatePublisher",
    ),
}

# Those whose system stands for all tags of the kind.
_OF_ALL = (gazebo_plugins.JointPositionController, gazebo_plugins.JointController)


def find_system(kind: type) -> Callable[..., ControllerInterface]:
    """Return the class of the system that stands for tags.

    Args:
        kind: Class of the tags.
    """
    module, name = _SYSTEMS[kind]
    found = importlib.import_module(f"arm_drake.controllers.{module}")
    system: Callable[..., ControllerInterface] = getattr(found, name)
    return system


def make_plugin(
    tags: Sequence[Any], params: ControllerInterfaceParams
) -> ControllerInterface:
    """Return the system that stands for tags of one kind.

    Args:
        tags: The tags; one, if their kind has a system for each.
        params: Rate and surroundings of the system.
    """
    kind = type(tags[0])
    system = find_system(kind)
    return system(tuple(tags) if kind in _OF_ALL else tags[0], params)
