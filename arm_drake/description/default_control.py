"""Controllers of a robot whose files say nothing about control."""

from arm_drake.description.controller_manager import ControllerConfig
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.given import Parameter
from arm_drake.description.plugin_joints import plugin_joints
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription

_NAMES = {
    "joint_state_broadcaster": "joint_state_broadcaster/JointStateBroadcaster",
    "joint_trajectory_controller": (
        "joint_trajectory_controller/JointTrajectoryController"
    ),
}


def default_controllers(
    description: RobotDescription, report: LoadReport
) -> ControllerManagerConfig:
    """Return a trajectory controller of all joints that nothing else moves.

    Args:
        description: The robot; its hardware is taken to have what these need.
        report: Where it is said.
    """
    file = description.file
    moved = plugin_joints(description)
    joints = [
        joint.name
        for joint in description.movable_joints
        if joint.mimic is None and joint.name not in moved
    ]
    if not joints:
        return ControllerManagerConfig()
    parameters = {
        "joints": joints,
        "command_interfaces": ["position"],
        "state_interfaces": ["position", "velocity"],
    }
    broadcaster, trajectory = (
        ControllerConfig(
            name,
            type_,
            {key: Parameter(value, file, 1) for key, value in values.items()},
            file,
            1,
        )
        for (name, type_), values in zip(_NAMES.items(), ({}, parameters), strict=True)
    )
    report.add(
        "info",
        "missing",
        "neither <ros2_control> tags nor a controllers YAML",
        f"one joint_trajectory_controller moves its {len(joints)} independent joints",
        file=file,
    )
    return ControllerManagerConfig(controllers=(broadcaster, trajectory))
