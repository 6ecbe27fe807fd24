"""Gazebo's joint plugins: which system stands for which tag."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.gazebo_contact_sensor import ContactSensor
from arm_drake.controllers.gazebo_diff_drive import DiffDrive
from arm_drake.controllers.gazebo_joint_controller import JointController
from arm_drake.controllers.gazebo_joint_pose_trajectory import (
    GazeboRosJointPoseTrajectory,
)
from arm_drake.controllers.gazebo_joint_position_controller import (
    JointPositionController,
)
from arm_drake.controllers.gazebo_joint_state_publisher import (
    GazeboRosJointStatePublisher,
    JointStatePublisher,
)
from arm_drake.controllers.gazebo_joint_trajectory_controller import (
    JointTrajectoryController,
)
from arm_drake.controllers.gazebo_ros_diff_drive import GazeboRosDiffDrive
from arm_drake.description import gazebo_drives, gazebo_joints
from arm_drake.description.gazebo_bumpers import ContactSensorTag

# Those whose system stands for all tags of the kind.
_OF_ALL: Mapping[type, Callable[..., ControllerInterface]] = {
    gazebo_joints.JointPositionController: JointPositionController,
    gazebo_joints.JointController: JointController,
}

# And for one tag.
_OF_ONE: Mapping[type, Callable[..., ControllerInterface]] = {
    gazebo_joints.JointTrajectoryController: JointTrajectoryController,
    gazebo_joints.JointStatePublisher: JointStatePublisher,
    ContactSensorTag: ContactSensor,
    gazebo_drives.DiffDrive: DiffDrive,
    gazebo_drives.GazeboRosDiffDrive: GazeboRosDiffDrive,
    gazebo_joints.GazeboRosJointPoseTrajectory: GazeboRosJointPoseTrajectory,
    gazebo_joints.GazeboRosJointStatePublisher: GazeboRosJointStatePublisher,
}


def make_plugin(
    tags: Sequence[Any], params: ControllerInterfaceParams
) -> ControllerInterface:
    """Return the system that stands for tags of one kind.

    Args:
        tags: The tags; one, if their kind has a system for each.
        params: Rate and surroundings of the system.
    """
    kind = type(tags[0])
    if kind in _OF_ALL:
        return _OF_ALL[kind](tuple(tags), params)
    return _OF_ONE[kind](tags[0], params)
