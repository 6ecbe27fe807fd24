"""Our controller types, by their ros2_control names: those of ros2_controllers."""

from arm_drake.controllers.lazy_types import LazyType

_JSB = "joint_state_broadcaster/JointStateBroadcaster"
_JTC = "joint_trajectory_controller/JointTrajectoryController"

# Ours; those without a system have their parameters checked alone.
STANDARD_TYPES: dict[str, LazyType] = {
    _JSB: LazyType(
        "JointStateBroadcasterParameters",
        "joint_state_broadcaster",
        "JointStateBroadcaster",
    ),
    _JTC: LazyType(
        "JointTrajectoryControllerParameters",
        "joint_trajectory.parameters",
        "JointTrajectoryController",
        "joint_trajectory.controller",
    ),
    "forward_command_controller/ForwardCommandController": LazyType(
        "ForwardCommandControllerParameters",
        "forward_command_controller",
        "ForwardCommandController",
    ),
    "forward_command_controller/MultiInterfaceForwardCommandController": LazyType(
        "MultiInterfaceForwardCommandControllerParameters",
        "forward_command_controller",
        "MultiInterfaceForwardCommandController",
    ),
    "position_controllers/JointGroupPositionController": LazyType(
        "JointGroupControllerParameters",
        "forward_command_controller",
        "JointGroupController",
        interface="position",
    ),
    "velocity_controllers/JointGroupVelocityController": LazyType(
        "JointGroupControllerParameters",
        "forward_command_controller",
        "JointGroupController",
        interface="velocity",
    ),
    "effort_controllers/JointGroupEffortController": LazyType(
        "JointGroupControllerParameters",
        "forward_command_controller",
        "JointGroupController",
        interface="effort",
    ),
    "position_controllers/GripperActionController": LazyType(
        "GripperActionControllerParameters",
        "gripper_controllers",
        "GripperActionController",
    ),
    "effort_controllers/GripperActionController": LazyType(
        "EffortGripperActionControllerParameters",
        "gripper_controllers",
        "GripperActionController",
        interface="effort",
    ),
    "parallel_gripper_action_controller/GripperActionController": LazyType(
        "ParallelGripperActionControllerParameters",
        "parallel_gripper_action_controller",
        "ParallelGripperActionController",
    ),
    "pid_controller/PidController": LazyType(
        "PidControllerParameters", "pid_parameters", "PidController", "pid_controller"
    ),
    "diff_drive_controller/DiffDriveController": LazyType(
        "DiffDriveControllerParameters",
        "bases.diff_drive_parameters",
        "DiffDriveController",
        "bases.diff_drive_controller",
    ),
    "bicycle_steering_controller/BicycleSteeringController": LazyType(
        "BicycleSteeringControllerParameters",
        "bases.steering_parameters",
        "SteeringController",
        "bases.steering_controllers",
    ),
    "tricycle_steering_controller/TricycleSteeringController": LazyType(
        "TricycleSteeringControllerParameters",
        "bases.steering_parameters",
        "SteeringController",
        "bases.steering_controllers",
    ),
    "ackermann_steering_controller/AckermannSteeringController": LazyType(
        "AckermannSteeringControllerParameters",
        "bases.steering_parameters",
        "SteeringController",
        "bases.steering_controllers",
    ),
    "tricycle_controller/TricycleController": LazyType(
        "TricycleControllerParameters",
        "bases.tricycle_parameters",
        "TricycleController",
        "bases.tricycle_controller",
    ),
    "mecanum_drive_controller/MecanumDriveController": LazyType(
        "MecanumDriveControllerParameters",
        "bases.mecanum_drive_parameters",
        "MecanumDriveController",
        "bases.mecanum_drive_controller",
    ),
    "omni_wheel_drive_controller/OmniWheelDriveController": LazyType(
        "OmniWheelDriveControllerParameters",
        "bases.omni_wheel_drive_parameters",
        "OmniWheelDriveController",
        "bases.omni_wheel_drive_controller",
    ),
    "admittance_controller/AdmittanceController": LazyType(
        "AdmittanceControllerParameters",
        "admittance_parameters",
        "AdmittanceController",
        "admittance_controller",
    ),
    "gpio_controllers/GpioCommandController": LazyType(
        "GpioCommandControllerParameters", "gpio_controllers", "GpioCommandController"
    ),
    "chained_filter_controller/ChainedFilter": LazyType(
        "ChainedFilterParameters", "chained_filter_controller", "ChainedFilter"
    ),
    "imu_sensor_broadcaster/IMUSensorBroadcaster": LazyType(
        "IMUSensorBroadcasterParameters",
        "sensor_broadcasters",
        "IMUSensorBroadcaster",
    ),
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster": LazyType(
        "ForceTorqueSensorBroadcasterParameters",
        "force_torque_sensor_broadcaster",
        "ForceTorqueSensorBroadcaster",
    ),
    "range_sensor_broadcaster/RangeSensorBroadcaster": LazyType(
        "RangeSensorBroadcasterParameters",
        "range_sensor_broadcaster",
        "RangeSensorBroadcaster",
    ),
    "pose_broadcaster/PoseBroadcaster": LazyType(
        "PoseBroadcasterParameters", "pose_broadcaster", "PoseBroadcaster"
    ),
    "gps_sensor_broadcaster/GPSSensorBroadcaster": LazyType(
        "GPSSensorBroadcasterParameters",
        "gps_sensor_broadcaster",
        "GPSSensorBroadcaster",
    ),
    "magnetometer_broadcaster/MagnetometerBroadcaster": LazyType(
        "MagnetometerBroadcasterParameters",
        "magnetometer_broadcaster",
        "MagnetometerBroadcaster",
    ),
    "battery_state_broadcaster/BatteryStateBroadcaster": LazyType(
        "BatteryStateBroadcasterParameters",
        "battery_state_broadcaster",
        "BatteryStateBroadcaster",
    ),
    "state_interfaces_broadcaster/StateInterfacesBroadcaster": LazyType(
        "StateInterfacesBroadcasterParameters",
        "state_interfaces_broadcaster",
        "StateInterfacesBroadcaster",
    ),
    "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster": LazyType(
        "Vda5050SafetyStateBroadcasterParameters",
        "vda5050_safety_state_broadcaster",
        "Vda5050SafetyStateBroadcaster",
    ),
    # By other packages, and by older names.
    "passthrough_controller/PassthroughController": LazyType(
        "PassthroughControllerParameters",
        "passthrough_controller",
        "PassthroughController",
    ),
    "ur_controllers/ScaledJointTrajectoryController": LazyType(
        "ScaledJointTrajectoryControllerParameters",
        "joint_trajectory.parameters",
        "JointTrajectoryController",
        "joint_trajectory.controller",
        runs_as=_JTC,
    ),
    "joint_state_controller/JointStateController": LazyType(
        "JointStateBroadcasterParameters",
        "joint_state_broadcaster",
        "JointStateBroadcaster",
        runs_as=_JSB,
    ),
}
