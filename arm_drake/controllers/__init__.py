"""The controller types, by their ros2_control names.

To add one, write its module (parameters dataclass and system) and its test, then add
its row to `CONTROLLER_TYPES`.
"""

import functools
import importlib.metadata
from collections.abc import Callable
from typing import Any, NamedTuple

from arm_drake.controllers.admittance_controller import AdmittanceControllerParameters
from arm_drake.controllers.battery_state_broadcaster import (
    BatteryStateBroadcasterParameters,
)
from arm_drake.controllers.chained_filter_controller import ChainedFilterParameters
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.diff_drive_controller import DiffDriveControllerParameters
from arm_drake.controllers.force_torque_sensor_broadcaster import (
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
from arm_drake.controllers.gpio_controllers import GpioCommandControllerParameters
from arm_drake.controllers.gps_sensor_broadcaster import GPSSensorBroadcasterParameters
from arm_drake.controllers.gripper_controllers import (
    EffortGripperActionControllerParameters,
    GripperActionControllerParameters,
)
from arm_drake.controllers.imu_sensor_broadcaster import IMUSensorBroadcasterParameters
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
    MagnetometerBroadcasterParameters,
)
from arm_drake.controllers.mecanum_drive_controller import (
    MecanumDriveControllerParameters,
)
from arm_drake.controllers.omni_wheel_drive_controller import (
    OmniWheelDriveControllerParameters,
)
from arm_drake.controllers.parallel_gripper_action_controller import (
    ParallelGripperActionControllerParameters,
)
from arm_drake.controllers.pid_controller import PidController
from arm_drake.controllers.pid_parameters import PidControllerParameters
from arm_drake.controllers.pose_broadcaster import PoseBroadcasterParameters
from arm_drake.controllers.range_sensor_broadcaster import (
    RangeSensorBroadcasterParameters,
)
from arm_drake.controllers.state_interfaces_broadcaster import (
    StateInterfacesBroadcasterParameters,
)
from arm_drake.controllers.steering_controllers import (
    AckermannSteeringControllerParameters,
    BicycleSteeringControllerParameters,
    TricycleSteeringControllerParameters,
)
from arm_drake.controllers.tricycle_controller import TricycleControllerParameters


class ControllerType(NamedTuple):
    """How to parse and build one type of controller."""

    parameters: type

    # None if its parameters are read, but it isn't simulated yet.
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface] | None = (
        None
    )

    # The type that it is run as, if not itself.
    runs_as: str = ""


_JSB = "joint_state_broadcaster/JointStateBroadcaster"
_JTC = "joint_trajectory_controller/JointTrajectoryController"

CONTROLLER_TYPES: dict[str, ControllerType] = {
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
        GripperActionControllerParameters
    ),
    "effort_controllers/GripperActionController": ControllerType(
        EffortGripperActionControllerParameters
    ),
    "parallel_gripper_action_controller/GripperActionController": ControllerType(
        ParallelGripperActionControllerParameters
    ),
    "pid_controller/PidController": ControllerType(
        PidControllerParameters, PidController
    ),
    "diff_drive_controller/DiffDriveController": ControllerType(
        DiffDriveControllerParameters
    ),
    "bicycle_steering_controller/BicycleSteeringController": ControllerType(
        BicycleSteeringControllerParameters
    ),
    "tricycle_steering_controller/TricycleSteeringController": ControllerType(
        TricycleSteeringControllerParameters
    ),
    "ackermann_steering_controller/AckermannSteeringController": ControllerType(
        AckermannSteeringControllerParameters
    ),
    "tricycle_controller/TricycleController": ControllerType(
        TricycleControllerParameters
    ),
    "mecanum_drive_controller/MecanumDriveController": ControllerType(
        MecanumDriveControllerParameters
    ),
    "omni_wheel_drive_controller/OmniWheelDriveController": ControllerType(
        OmniWheelDriveControllerParameters
    ),
    "admittance_controller/AdmittanceController": ControllerType(
        AdmittanceControllerParameters
    ),
    "gpio_controllers/GpioCommandController": ControllerType(
        GpioCommandControllerParameters
    ),
    "chained_filter_controller/ChainedFilter": ControllerType(ChainedFilterParameters),
    "imu_sensor_broadcaster/IMUSensorBroadcaster": ControllerType(
        IMUSensorBroadcasterParameters
    ),
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster": ControllerType(
        ForceTorqueSensorBroadcasterParameters
    ),
    "range_sensor_broadcaster/RangeSensorBroadcaster": ControllerType(
        RangeSensorBroadcasterParameters
    ),
    "pose_broadcaster/PoseBroadcaster": ControllerType(PoseBroadcasterParameters),
    "gps_sensor_broadcaster/GPSSensorBroadcaster": ControllerType(
        GPSSensorBroadcasterParameters
    ),
    "magnetometer_broadcaster/MagnetometerBroadcaster": ControllerType(
        MagnetometerBroadcasterParameters
    ),
    "battery_state_broadcaster/BatteryStateBroadcaster": ControllerType(
        BatteryStateBroadcasterParameters
    ),
    "state_interfaces_broadcaster/StateInterfacesBroadcaster": ControllerType(
        StateInterfacesBroadcasterParameters
    ),
    # By other packages, and by older names.
    "ur_controllers/ScaledJointTrajectoryController": ControllerType(
        ScaledJointTrajectoryControllerParameters, JointTrajectoryController, _JTC
    ),
    "joint_state_controller/JointStateController": ControllerType(
        JointStateBroadcasterParameters, JointStateBroadcaster, _JSB
    ),
}

# Group of the entry points through which other packages add types: a name is a
# ros2_control type, its object a ControllerType.
ENTRY_POINTS = "arm_drake.controllers"


def find_controller_type(name: str) -> ControllerType | None:
    """Return the row of a controller type, ours or another package's, or None.

    Args:
        name: A ros2_control type.
    """
    if name not in CONTROLLER_TYPES:
        for entry_point in importlib.metadata.entry_points(group=ENTRY_POINTS):
            if entry_point.name == name:
                CONTROLLER_TYPES[name] = entry_point.load()
    return CONTROLLER_TYPES.get(name)


def register_controller(
    name: str,
    parameters: type,
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface],
) -> None:
    """Add a controller type of one's own, before a robot that has it is loaded.

    A package that is installed does it with an entry point of the group
    `arm_drake.controllers`.

    Args:
        name: Its ros2_control type, such as "my_controllers/MyController".
        parameters: Frozen dataclass of its parameters.
        system: Makes the system from parameters and surroundings.

    Raises:
        ValueError: If there is a type of this name.
    """
    if find_controller_type(name) is not None:
        raise ValueError(f"controller type {name!r} is registered already")
    CONTROLLER_TYPES[name] = ControllerType(parameters, system)
