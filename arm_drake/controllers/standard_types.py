"""Our controller types, by their ros2_control names: those of ros2_controllers."""

import functools

from arm_drake.controllers.admittance_controller import AdmittanceController
from arm_drake.controllers.admittance_parameters import AdmittanceControllerParameters
from arm_drake.controllers.battery_state_broadcaster import (
    BatteryStateBroadcaster,
    BatteryStateBroadcasterParameters,
)
from arm_drake.controllers.chained_filter_controller import (
    ChainedFilter,
    ChainedFilterParameters,
)
from arm_drake.controllers.controller_type import ControllerType
from arm_drake.controllers.diff_drive_controller import DiffDriveController
from arm_drake.controllers.diff_drive_parameters import DiffDriveControllerParameters
from arm_drake.controllers.force_torque_sensor_broadcaster import (
    ForceTorqueSensorBroadcaster,
    ForceTorqueSensorBroadcasterParameters,
)
from arm_drake.controllers.forward_command_controller import (
    ForwardCommandController,
    ForwardCommandControllerParameters,
    JointGroupController,
    JointGroupControllerParameters,
    MultiInterfaceForwardCommandController,
    MultiInterfaceForwardCommandControllerParameters,
)
from arm_drake.controllers.gpio_controllers import (
    GpioCommandController,
    GpioCommandControllerParameters,
)
from arm_drake.controllers.gps_sensor_broadcaster import (
    GPSSensorBroadcaster,
    GPSSensorBroadcasterParameters,
)
from arm_drake.controllers.gripper_controllers import (
    EffortGripperActionControllerParameters,
    GripperActionController,
    GripperActionControllerParameters,
)
from arm_drake.controllers.imu_sensor_broadcaster import (
    IMUSensorBroadcaster,
    IMUSensorBroadcasterParameters,
)
from arm_drake.controllers.joint_state_broadcaster import (
    JointStateBroadcaster,
    JointStateBroadcasterParameters,
)
from arm_drake.controllers.joint_trajectory_controller import JointTrajectoryController
from arm_drake.controllers.joint_trajectory_parameters import (
    JointTrajectoryControllerParameters,
    ScaledJointTrajectoryControllerParameters,
)
from arm_drake.controllers.magnetometer_broadcaster import (
    MagnetometerBroadcaster,
    MagnetometerBroadcasterParameters,
)
from arm_drake.controllers.mecanum_drive_controller import MecanumDriveController
from arm_drake.controllers.mecanum_drive_parameters import (
    MecanumDriveControllerParameters,
)
from arm_drake.controllers.omni_wheel_drive_controller import OmniWheelDriveController
from arm_drake.controllers.omni_wheel_drive_parameters import (
    OmniWheelDriveControllerParameters,
)
from arm_drake.controllers.parallel_gripper_action_controller import (
    ParallelGripperActionController,
    ParallelGripperActionControllerParameters,
)
from arm_drake.controllers.passthrough_controller import (
    PassthroughController,
    PassthroughControllerParameters,
)
from arm_drake.controllers.pid_controller import PidController
from arm_drake.controllers.pid_parameters import PidControllerParameters
from arm_drake.controllers.pose_broadcaster import (
    PoseBroadcaster,
    PoseBroadcasterParameters,
)
from arm_drake.controllers.range_sensor_broadcaster import (
    RangeSensorBroadcaster,
    RangeSensorBroadcasterParameters,
)
from arm_drake.controllers.state_interfaces_broadcaster import (
    StateInterfacesBroadcaster,
    StateInterfacesBroadcasterParameters,
)
from arm_drake.controllers.steering_controllers import SteeringController
from arm_drake.controllers.steering_parameters import (
    AckermannSteeringControllerParameters,
    BicycleSteeringControllerParameters,
    TricycleSteeringControllerParameters,
)
from arm_drake.controllers.tricycle_controller import TricycleController
from arm_drake.controllers.tricycle_parameters import TricycleControllerParameters
from arm_drake.controllers.vda5050_safety_state_broadcaster import (
    Vda5050SafetyStateBroadcaster,
    Vda5050SafetyStateBroadcasterParameters,
)

_JSB = "joint_state_broadcaster/JointStateBroadcaster"
_JTC = "joint_trajectory_controller/JointTrajectoryController"

# Ours; those without a system have their parameters checked alone.
STANDARD_TYPES: dict[str, ControllerType] = {
    _JSB: ControllerType(JointStateBroadcasterParameters, JointStateBroadcaster),
    _JTC: ControllerType(
        JointTrajectoryControllerParameters, JointTrajectoryController
    ),
    "forward_command_controller/ForwardCommandController": ControllerType(
        ForwardCommandControllerParameters, ForwardCommandController
    ),
    "forward_command_controller/MultiInterfaceForwardCommandController": ControllerType(
        MultiInterfaceForwardCommandControllerParameters,
        MultiInterfaceForwardCommandController,
    ),
    "position_controllers/JointGroupPositionController": ControllerType(
        JointGroupControllerParameters,
        functools.partial(JointGroupController, interface="position"),
    ),
    "velocity_controllers/JointGroupVelocityController": ControllerType(
        JointGroupControllerParameters,
        functools.partial(JointGroupController, interface="velocity"),
    ),
    "effort_controllers/JointGroupEffortController": ControllerType(
        JointGroupControllerParameters,
        functools.partial(JointGroupController, interface="effort"),
    ),
    "position_controllers/GripperActionController": ControllerType(
        GripperActionControllerParameters, GripperActionController
    ),
    "effort_controllers/GripperActionController": ControllerType(
        EffortGripperActionControllerParameters,
        functools.partial(GripperActionController, interface="effort"),
    ),
    "parallel_gripper_action_controller/GripperActionController": ControllerType(
        ParallelGripperActionControllerParameters, ParallelGripperActionController
    ),
    "pid_controller/PidController": ControllerType(
        PidControllerParameters, PidController
    ),
    "diff_drive_controller/DiffDriveController": ControllerType(
        DiffDriveControllerParameters, DiffDriveController
    ),
    "bicycle_steering_controller/BicycleSteeringController": ControllerType(
        BicycleSteeringControllerParameters, SteeringController
    ),
    "tricycle_steering_controller/TricycleSteeringController": ControllerType(
        TricycleSteeringControllerParameters, SteeringController
    ),
    "ackermann_steering_controller/AckermannSteeringController": ControllerType(
        AckermannSteeringControllerParameters, SteeringController
    ),
    "tricycle_controller/TricycleController": ControllerType(
        TricycleControllerParameters, TricycleController
    ),
    "mecanum_drive_controller/MecanumDriveController": ControllerType(
        MecanumDriveControllerParameters, MecanumDriveController
    ),
    "omni_wheel_drive_controller/OmniWheelDriveController": ControllerType(
        OmniWheelDriveControllerParameters, OmniWheelDriveController
    ),
    "admittance_controller/AdmittanceController": ControllerType(
        AdmittanceControllerParameters, AdmittanceController
    ),
    "gpio_controllers/GpioCommandController": ControllerType(
        GpioCommandControllerParameters, GpioCommandController
    ),
    "chained_filter_controller/ChainedFilter": ControllerType(
        ChainedFilterParameters, ChainedFilter
    ),
    "imu_sensor_broadcaster/IMUSensorBroadcaster": ControllerType(
        IMUSensorBroadcasterParameters, IMUSensorBroadcaster
    ),
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster": ControllerType(
        ForceTorqueSensorBroadcasterParameters, ForceTorqueSensorBroadcaster
    ),
    "range_sensor_broadcaster/RangeSensorBroadcaster": ControllerType(
        RangeSensorBroadcasterParameters, RangeSensorBroadcaster
    ),
    "pose_broadcaster/PoseBroadcaster": ControllerType(
        PoseBroadcasterParameters, PoseBroadcaster
    ),
    "gps_sensor_broadcaster/GPSSensorBroadcaster": ControllerType(
        GPSSensorBroadcasterParameters, GPSSensorBroadcaster
    ),
    "magnetometer_broadcaster/MagnetometerBroadcaster": ControllerType(
        MagnetometerBroadcasterParameters, MagnetometerBroadcaster
    ),
    "battery_state_broadcaster/BatteryStateBroadcaster": ControllerType(
        BatteryStateBroadcasterParameters, BatteryStateBroadcaster
    ),
    "state_interfaces_broadcaster/StateInterfacesBroadcaster": ControllerType(
        StateInterfacesBroadcasterParameters, StateInterfacesBroadcaster
    ),
    "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster": ControllerType(
        Vda5050SafetyStateBroadcasterParameters, Vda5050SafetyStateBroadcaster
    ),
    # By other packages, and by older names.
    "passthrough_controller/PassthroughController": ControllerType(
        PassthroughControllerParameters, PassthroughController
    ),
    "ur_controllers/ScaledJointTrajectoryController": ControllerType(
        ScaledJointTrajectoryControllerParameters, JointTrajectoryController, _JTC
    ),
    "joint_state_controller/JointStateController": ControllerType(
        JointStateBroadcasterParameters, JointStateBroadcaster, _JSB
    ),
}
