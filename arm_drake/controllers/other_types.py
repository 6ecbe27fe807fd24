"""Known controller types of other packages that are not one of ours.

The report says of them what they do, and what stands closest. Sources are the packages'
plugin descriptions and code; where they lie stands beside each.
"""

import difflib
from collections.abc import Iterable
from typing import Literal, NamedTuple

# Types that neither move a joint nor tell what physics makes: they serve a device, and
# a simulation without them lacks nothing. By type, what they do.
HARDWARE_ONLY = {
    # ros-industrial/ros2_canopen: canopen_ros2_controllers.
    "canopen_ros2_controllers/CanopenProxyController": (
        "only passes messages of the CAN bus on"
    ),
    # Elite-Robots/Elite_Robots_CS_ROS2_Driver: eli_cs_controllers.
    "eli_cs_controllers/GPIOController": "only serves the real robot's plugs",
    "eli_cs_controllers/SpeedScalingStateBroadcaster": (
        "only tells the real robot's speed slider"
    ),
    # PickNikRobotics/ros2_epick_gripper: epick_controllers.
    "epick_controllers/EpickStatusPublisherController": (
        "only tells the real gripper's status"
    ),
    # kroshu/kuka_drivers: controllers.
    "kuka_controllers/ControlModeHandler": "only sets the real robot's control mode",
    "kuka_controllers/EventBroadcaster": "only tells the real robot's events",
    "kuka_controllers/FRIConfigurationController": (
        "only sets how often the real robot is told something"
    ),
    "kuka_controllers/FRIStateBroadcaster": "only tells the real connection's state",
    "kuka_controllers/KssMessageHandler": "only passes the real robot's messages on",
    # OnRobot/onrobot-ros2: onrobot_gripper_controllers.
    "onrobot_gripper_controllers/GripperRecoveryController": (
        "only clears the real gripper's faults"
    ),
    # PickNikRobotics/picknik_controllers.
    "picknik_reset_fault_controller/PicknikResetFaultController": (
        "only clears the real robot's faults"
    ),
    # PickNikRobotics/ros2_robotiq_gripper: robotiq_controllers.
    "robotiq_controllers/RobotiqActivationController": (
        "only activates the real gripper"
    ),
    # UniversalRobots/Universal_Robots_ROS2_Driver: ur_controllers.
    "ur_controllers/FreedriveModeController": (
        "only lets a person guide the real robot by hand"
    ),
    "ur_controllers/FrictionModelController": (
        "only sets up the real robot's own torque control"
    ),
    "ur_controllers/GPIOController": "only serves the real robot's plugs",
    "ur_controllers/GravityUpdateController": (
        "only tells the real robot where down is"
    ),
    "ur_controllers/SpeedScalingStateBroadcaster": (
        "only tells the real robot's speed slider"
    ),
    "ur_controllers/URConfigurationController": (
        "only sets up the real robot's own controller"
    ),
}


class Other(NamedTuple):
    """What is known of a type that isn't simulated."""

    # What it does, that ours don't.
    does: str

    # The type that stands closest, and how to use it.
    closest: str = ""


_JTC = "joint_trajectory_controller/JointTrajectoryController"
_PID = "pid_controller/PidController"
_OWN_MOTIONS = "it makes Cartesian motions of its own"
_ONE_JOINT = "it is of ROS 1, and takes one 'joint'"
_PID_OF_ROS_1 = "it is of ROS 1, a PID with other parameters"

# By type, or by package with a "/" at its end.
OTHERS = {
    "canopen_ros2_controllers/": Other(
        "it asks drives on the CAN bus to move",
        "forward_command_controller/ForwardCommandController",
    ),
    # fzi-forschungszentrum-informatik/cartesian_controllers.
    "cartesian_compliance_controller/": Other(_OWN_MOTIONS, _JTC),
    "cartesian_force_controller/": Other(_OWN_MOTIONS, _JTC),
    "cartesian_motion_controller/": Other(_OWN_MOTIONS, _JTC),
    "crisp_controllers/": Other("it computes efforts of Cartesian control itself"),
    # DoosanRobotics/doosan-robot2: dsr_controller2/config/dsr_controller2.yaml.
    "dsr_controller2/": Other("it asks Doosan's own controller for motions", _JTC),
    "dsr_joint_trajectory/": Other("it asks Doosan's own controller for motions", _JTC),
    # ros-controls/ros_controllers (ROS 1).
    "effort_controllers/JointEffortController": Other(
        _ONE_JOINT, "effort_controllers/JointGroupEffortController with 'joints'"
    ),
    "effort_controllers/JointGroupPositionController": Other(_PID_OF_ROS_1, _PID),
    "effort_controllers/JointPositionController": Other(_PID_OF_ROS_1, _PID),
    "effort_controllers/JointVelocityController": Other(_PID_OF_ROS_1, _PID),
    "force_torque_sensor_controller/ForceTorqueSensorController": Other(
        "it is of ROS 1", "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster"
    ),
    "imu_sensor_controller/ImuSensorController": Other(
        "it is of ROS 1", "imu_sensor_broadcaster/IMUSensorBroadcaster"
    ),
    "position_controllers/JointPositionController": Other(
        _ONE_JOINT, "position_controllers/JointGroupPositionController with 'joints'"
    ),
    "velocity_controllers/JointPositionController": Other(_PID_OF_ROS_1, _PID),
    "velocity_controllers/JointVelocityController": Other(
        _ONE_JOINT, "velocity_controllers/JointGroupVelocityController with 'joints'"
    ),
    # PickNikRobotics/ros2_epick_gripper: epick_gripper_action_controller.cpp.
    "epick_controllers/": Other(
        "it switches suction, of which the physics knows nothing"
    ),
    # frankarobotics/franka_ros2.
    "franka_example_controllers/": Other(
        "it is an example of what Franka's own controller can do", _JTC
    ),
    "franka_robot_state_broadcaster/": Other(
        "it tells what Franka's own controller knows",
        "joint_state_broadcaster/JointStateBroadcaster",
    ),
    # The package's name; its types are called after what they command.
    "gripper_controllers/GripperActionController": Other(
        "it isn't said whether it commands positions or efforts",
        "position_controllers/GripperActionController",
    ),
    "kuka_controllers/JointGroupImpedanceController": Other(
        "it sets stiffness and damping of KUKA's own controller"
    ),
    # lbr-stack/lbr_fri_ros2_stack: lbr_ros2_control.
    "lbr_ros2_control/LBRJointPositionCommandController": Other(
        "it takes messages of its own",
        "position_controllers/JointGroupPositionController",
    ),
    "lbr_ros2_control/LBRStateBroadcaster": Other(
        "it tells what KUKA's own controller knows",
        "joint_state_broadcaster/JointStateBroadcaster",
    ),
    # ros-controls/ros2_controllers: they ask a vendor's controller for motions.
    "motion_primitives_controllers/": Other(
        "it asks a vendor's own controller for motions", _JTC
    ),
    # PAL's bases have mecanum wheels.
    "omni_drive_controller/OmniDriveController": Other(
        "its parameters are PAL's own",
        "mecanum_drive_controller/MecanumDriveController",
    ),
    # OnRobot/onrobot-ros2: onrobot_gripper_controllers/README.md.
    "onrobot_gripper_controllers/GripperStateBroadcaster": Other(
        "it tells what the real gripper knows",
        "joint_state_broadcaster/JointStateBroadcaster",
    ),
    "onrobot_gripper_controllers/ParallelGripperActionController": Other(
        "it stops the real gripper in its own way",
        "parallel_gripper_action_controller/GripperActionController",
    ),
    "picknik_twist_controller/": Other(
        "it asks a vendor's own controller for Cartesian velocities", _JTC
    ),
    # paolofrance/scaled_fjt_controller: it interpolates linearly.
    "scaled_fjt_controller/ScaledFjtController": Other(
        "it interpolates in a way of its own", _JTC
    ),
    "ur_controllers/ForceModeController": Other(
        "it asks the real robot to push with a force",
        "admittance_controller/AdmittanceController",
    ),
    "ur_controllers/ForceTorqueStateBroadcaster": Other(
        "its parameters are its own",
        "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster",
    ),
    # Its action is that of trajectories, but a goal is refused while one runs, and it
    # claims no joint: ur_controllers/doc/index.rst.
    "ur_controllers/PassthroughTrajectoryController": Other(
        "it hands whole trajectories to the real robot", _JTC
    ),
    "ur_controllers/ToolContactController": Other(
        "it asks the real robot to stop at a contact"
    ),
    "ur_controllers/TwistController": Other(
        "it asks the real robot for Cartesian velocities", _JTC
    ),
}


def describe_unknown(
    name: str, known: Iterable[str]
) -> tuple[Literal["info", "error"], str, str]:
    """Return what the report says of a type: severity, what it is, what is done.

    Args:
        name: A type that is neither in the registry nor equivalent to one.
        known: The types that exist.
    """
    what, done = f"controller type {name!r}", "the controller does not run"
    if name in HARDWARE_ONLY:
        done = "left out; a simulation lacks nothing"
        return "info", f"{what} {HARDWARE_ONLY[name]}", done
    other = OTHERS.get(name) or OTHERS.get(f"{name.partition('/')[0]}/")
    if other is not None:
        closest = f"; the closest type is {other.closest}" if other.closest else ""
        return "error", f"{what} is not simulated: {other.does}{closest}", done
    types = list(known)
    close = difflib.get_close_matches(name, types, n=1, cutoff=0.8)
    close += [type_ for type_ in types if type_.rpartition("/")[2] == name]
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return "error", f"unknown {what}{hint}", done
