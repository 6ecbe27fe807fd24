"""Gazebo's plugins and sensors that run here: the system that stands for each tag."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.registry import import_name
from arm_drake.description import gazebo_plugins
from arm_drake.description.gazebo_plugins import ContactSensorTag, ImuSensorTag
from arm_drake.description.plugin_control import GROUPED

# "module:System" by class of the tag, imported when a robot has one.
_SYSTEMS: Mapping[type, str] = {
    gazebo_plugins.JointPositionController: "joint_controllers:JointPositionController",
    gazebo_plugins.JointController: "joint_controllers:JointController",
    gazebo_plugins.ApplyJointForce: "apply_joint_force:ApplyJointForce",
    gazebo_plugins.JointTrajectoryController: (
        "joint_trajectory:JointTrajectoryController"
    ),
    gazebo_plugins.JointStatePublisher: "joint_state_publisher:JointStatePublisher",
    gazebo_plugins.OdometryPublisher: "odometry_publisher:OdometryPublisher",
    ContactSensorTag: "contact_sensor:ContactSensor",
    ImuSensorTag: "imu_sensor:ImuSensor",
    gazebo_plugins.DiffDrive: "diff_drive:DiffDrive",
    gazebo_plugins.AckermannSteering: "ackermann_drive:AckermannSteering",
    gazebo_plugins.MecanumDrive: "mecanum_drive:MecanumDrive",
    gazebo_plugins.VelocityControl: "velocity_control:VelocityControl",
    gazebo_plugins.GazeboRosPlanarMove: "velocity_control:GazeboRosPlanarMove",
    gazebo_plugins.GazeboRosAckermannDrive: "ackermann_drive:GazeboRosAckermannDrive",
    gazebo_plugins.GazeboRosDiffDrive: "diff_drive:GazeboRosDiffDrive",
    gazebo_plugins.GazeboRosJointPoseTrajectory: (
        "joint_trajectory:GazeboRosJointPoseTrajectory"
    ),
    gazebo_plugins.GazeboRosJointStatePublisher: (
        "joint_state_publisher:GazeboRosJointStatePublisher"
    ),
}


def find_system(kind: type) -> Callable[..., ControllerInterface]:
    """Return the class of the system that stands for tags of a class."""
    module, name = _SYSTEMS[kind].split(":")
    system: Callable[..., ControllerInterface] = import_name(f"gazebo.{module}.{name}")
    return system


def make_plugin(
    tags: Sequence[Any], params: ControllerInterfaceParams
) -> ControllerInterface:
    """Return the system that stands for tags of one kind: for one, or for all."""
    kind = type(tags[0])
    system = find_system(kind)
    return system(tuple(tags) if kind in GROUPED else tags[0], params)
