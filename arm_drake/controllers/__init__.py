"""The controller types, by their ros2_control names.

To add one, write its module (parameters dataclass and system) and its test, then add
its row to `CONTROLLER_TYPES`.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any

from arm_drake.controllers.admittance_controller import AdmittanceControllerParameters
from arm_drake.controllers.battery_state_broadcaster import (
    BatteryStateBroadcasterParameters,
)
from arm_drake.controllers.chained_filter_controller import ChainedFilterParameters
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.controller_type import (
    ControllerType,
    check_controller_type,
    check_controller_types,
)
from arm_drake.controllers.diff_drive_controller import DiffDriveController
from arm_drake.controllers.diff_drive_parameters import DiffDriveControllerParameters
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
    GripperActionController,
    GripperActionControllerParameters,
)
from arm_drake.controllers.imu_sensor_broadcaster import IMUSensorBroadcasterParameters
from arm_drake.controllers.installed_types import InstalledType, installed_types
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
    ParallelGripperActionController,
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
from arm_drake.controllers.vendor_types import EQUIVALENTS

__all__ = [
    "CONTROLLER_TYPES",
    "ControllerType",
    "check_controller_type",
    "check_controller_types",
    "find_controller_type",
    "installed_types",
    "list_types",
    "register_controller",
]


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


def find_controller_type(
    name: str,
    own: Mapping[str, ControllerType] | None = None,
    installed: Mapping[str, InstalledType] | None = None,
) -> ControllerType | None:
    """Return the row of a controller type, or None.

    A robot's own types come first, then those of installed packages, then ours, and
    last other packages' types that are one of ours.

    Args:
        name: A ros2_control type.
        own: Types of the robot alone.
        installed: What `installed_types` returns; by default it is asked.

    Raises:
        InputError: If an installed package offers what can't be used.
    """
    ours = CONTROLLER_TYPES.get(name)
    is_ours = name in EQUIVALENTS if ours is None else not ours.origin
    others = ("arm_drake",) if is_ours else ()
    if own and name in own:
        origin = "load_robot(controller_types=...)"
        return own[name]._replace(origin=origin, others=others)
    offer = (installed_types() if installed is None else installed).get(name)
    if offer is not None:
        row = check_controller_type(offer.load(), offer.origin)
        return row._replace(origin=offer.origin, others=(*others, *offer.others))
    if ours is not None:
        return ours
    if "::" in name:  # As C++ calls it.
        written = name.replace("::", "/")
        row_as_written = find_controller_type(written, own, installed)
        return row_as_written and row_as_written._replace(
            runs_as=row_as_written.runs_as or written
        )
    if name not in EQUIVALENTS:
        return None
    type_, parameters = EQUIVALENTS[name]
    row = CONTROLLER_TYPES[type_]
    return row._replace(
        parameters=parameters or row.parameters, runs_as=row.runs_as or type_
    )


def list_types() -> list[str]:
    """Return the names of our types, without those that are run as another one."""
    return [name for name, row in CONTROLLER_TYPES.items() if not row.runs_as]


def register_controller(
    name: str,
    parameters: type,
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface],
) -> None:
    """Add a controller type of one's own for all robots that are loaded later.

    `load_robot(..., controller_types=...)` does it for one robot. A package that is
    installed does it with an entry point of the group `arm_drake.controllers`.

    Args:
        name: Its ros2_control type, such as "my_controllers/MyController".
        parameters: Frozen dataclass of its parameters.
        system: Makes the system from parameters and surroundings.

    Raises:
        ValueError: If there is a type of this name.
        InputError: If it can't be used.
    """
    if name in CONTROLLER_TYPES or name in installed_types():
        raise ValueError(f"controller type {name!r} is registered already")
    origin = "register_controller"
    row = check_controller_type(ControllerType(parameters, system), origin)
    CONTROLLER_TYPES[name] = row._replace(origin=origin)
