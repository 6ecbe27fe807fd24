"""Small packages with launch files, made for a test."""

import textwrap
from pathlib import Path

URDF = """
<robot name="pendulum" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="prefix" default=""/>
  <link name="world"/>
  <link name="arm">
    <inertial><mass value="1"/><origin xyz="0 0 -0.5"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.1 0.1 1"/></geometry></visual>
  </link>
  <joint name="$(arg prefix)swing" type="revolute">
    <parent link="world"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/>
  </joint>
  <ros2_control name="pendulum" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    <joint name="$(arg prefix)swing">
      <command_interface name="position"/>
      <state_interface name="position"/><state_interface name="velocity"/>
    </joint>
  </ros2_control>
</robot>
"""

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 100
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    arm_controller: {type: joint_trajectory_controller/JointTrajectoryController}
    forward: {type: forward_command_controller/ForwardCommandController}
arm_controller:
  ros__parameters:
    joints: [swing]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
forward:
  ros__parameters: {joints: [swing], interface_name: position}
"""

# What most launch files begin with.
IMPORTS = """
import os
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import *
from launch.actions import (
    DeclareLaunchArgument, EmitEvent, ExecuteProcess, GroupAction,
    IncludeLaunchDescription, LogInfo, OpaqueFunction, RegisterEventHandler,
    SetEnvironmentVariable, SetLaunchConfiguration, TimerAction)
from launch.conditions import IfCondition, LaunchConfigurationEquals, UnlessCondition
from launch.event_handlers import OnExecutionComplete, OnProcessExit, OnProcessStart
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import (
    Command, EnvironmentVariable, FindExecutable, LaunchConfiguration,
    PathJoinSubstitution, PythonExpression, ThisLaunchFileDir)
from launch_ros.actions import Node, PushRosNamespace, SetParameter
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = get_package_share_directory("pendulum_bringup")
XACRO = ["xacro ", os.path.join(PACKAGE, "urdf", "pendulum.urdf.xacro")]
YAML = os.path.join(PACKAGE, "config", "controllers.yaml")


def publisher(command=XACRO, **others):
    return Node(
        package="robot_state_publisher", executable="robot_state_publisher",
        parameters=[{"robot_description": Command(command), "use_sim_time": True}],
        **others)


def manager(**others):
    return Node(
        package="controller_manager", executable="ros2_control_node",
        parameters=[YAML], **others)


def spawner(*words, **others):
    return Node(
        package="controller_manager", executable="spawner", arguments=[*words],
        **others)
"""


def make_package(folder: Path) -> Path:
    """Return the folder of a package with a description and controllers."""
    package = folder / "pendulum_bringup"
    for name, text in {
        "package.xml": "<package><name>pendulum_bringup</name></package>",
        "urdf/pendulum.urdf.xacro": URDF,
        "config/controllers.yaml": CONTROLLERS,
    }.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    (package / "launch").mkdir(exist_ok=True)
    return package


def write_launch(package: Path, text: str, name: str = "test.launch.py") -> Path:
    """Write a launch file into a package; return its path."""
    path = package / "launch" / name
    path.write_text(textwrap.dedent(text), encoding="utf-8")
    return path


def describe(package: Path, entities: str, before: str = "") -> Path:
    """Write a launch file that describes some entities; return its path."""
    text = f"{IMPORTS}\n{textwrap.dedent(before)}\n"
    body = textwrap.indent(textwrap.dedent(entities).strip(), " " * 8)
    text += "def generate_launch_description():\n"
    text += f"    return LaunchDescription([\n{body}\n    ])\n"
    path = package / "launch" / "test.launch.py"
    path.write_text(text, encoding="utf-8")
    return path
