"""Controller types of other packages that are one of ours by another name.

Vendors' drivers bring types of their own, and names of ROS 1 live on in files for
ROS 2. Only those are here whose parameters, actions and behaviour in a simulation are
those of one of ros2_control's types; where that can be read stands beside each. They
are run as it, and the report says so.
"""

import dataclasses as dc
import functools
from typing import Literal, NamedTuple


class Equivalent(NamedTuple):
    """Which type of the registry another package's type is."""

    runs_as: str

    # What a trajectory controller commands by default, as those of ROS 1 say by their
    # names; empty if that type's parameters are this one's.
    commands: Literal["", "position", "velocity", "effort"] = ""


@functools.cache
def parameters_of(equivalent: Equivalent) -> type | None:
    """Return the dataclass of a type's parameters, None if that of what it runs as.

    Args:
        equivalent: A row of `EQUIVALENTS`.
    """
    if not equivalent.commands:
        return None
    # Not at the top: few robots have one.
    from arm_drake.controllers.joint_trajectory.parameters import (
        CommandInterface,
        JointTrajectoryControllerParameters,
        StateInterface,
    )

    # They always read the same.
    states: tuple[StateInterface, ...] = ("position", "velocity")
    return dc.make_dataclass(
        "JointTrajectoryControllerParametersOfRos1",
        [
            (
                "command_interfaces",
                tuple[CommandInterface, ...],
                (equivalent.commands,),
            ),
            ("state_interfaces", tuple[StateInterface, ...], states),
        ],
        bases=(JointTrajectoryControllerParameters,),
        frozen=True,
    )


_JTC = "joint_trajectory_controller/JointTrajectoryController"
_SCALED = "ur_controllers/ScaledJointTrajectoryController"
_PARALLEL_GRIPPER = "parallel_gripper_action_controller/GripperActionController"

EQUIVALENTS = {
    # ROS 1: same parameters, action and splines; the topic is called `command` there.
    # ros-controls/ros_controllers: joint_trajectory_controller/ros_control_plugins.xml.
    "effort_controllers/JointTrajectoryController": Equivalent(_JTC, "effort"),
    "position_controllers/JointTrajectoryController": Equivalent(_JTC, "position"),
    "velocity_controllers/JointTrajectoryController": Equivalent(_JTC, "velocity"),
    # ROS 1: these, slowed down as the robot says, which here is never.
    # UniversalRobots/Universal_Robots_ROS_scaled_controllers:
    # scaled_joint_trajectory_controller/src/scaled_joint_trajectory_controller.cpp.
    "position_controllers/ScaledJointTrajectoryController": Equivalent(
        _JTC, "position"
    ),
    "velocity_controllers/ScaledJointTrajectoryController": Equivalent(
        _JTC, "velocity"
    ),
    # That of ur_controllers, parameter by parameter.
    # Elite-Robots/Elite_Robots_CS_ROS2_Driver: eli_cs_controllers.
    "eli_cs_controllers/ScaledJointTrajectoryController": Equivalent(_SCALED),
    # A subclass without further parameters; a topic and the robot slow it down, from
    # 100 %. FANUC-CORPORATION/fanuc_driver: fanuc_controllers.
    "fanuc_controllers/ScaledJointTrajectoryController": Equivalent(_JTC),
    # A copy, of the time before upstream's commanded efforts.
    # frankaemika/franka_ros2: joint_effort_trajectory_controller/README.md.
    "joint_effort_trajectory_controller/JointTrajectoryController": Equivalent(_JTC),
    # What upstream's deprecated grippers call their successor in their warning.
    # ros-controls/ros2_controllers: gripper_controllers (jazzy).
    "parallel_gripper_controllers/GripperActionController": Equivalent(
        _PARALLEL_GRIPPER
    ),
}
