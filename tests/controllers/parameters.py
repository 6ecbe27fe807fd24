"""Parameters of controllers as a YAML would give them, by their dotted names."""

import dataclasses as dc
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport

JTC = "joint_trajectory_controller/JointTrajectoryController"
JSB = "joint_state_broadcaster/JointStateBroadcaster"
FORWARD = "forward_command_controller/ForwardCommandController"
MULTI = "forward_command_controller/MultiInterfaceForwardCommandController"
GROUPS = (
    "position_controllers/JointGroupPositionController",
    "velocity_controllers/JointGroupVelocityController",
    "effort_controllers/JointGroupEffortController",
)
GRIPPER = "position_controllers/GripperActionController"
EFFORT_GRIPPER = "effort_controllers/GripperActionController"
PARALLEL_GRIPPER = "parallel_gripper_action_controller/GripperActionController"
PID = "pid_controller/PidController"
DIFF_DRIVE = "diff_drive_controller/DiffDriveController"
BICYCLE = "bicycle_steering_controller/BicycleSteeringController"
TRICYCLE_STEERING = "tricycle_steering_controller/TricycleSteeringController"
ACKERMANN = "ackermann_steering_controller/AckermannSteeringController"
TRICYCLE = "tricycle_controller/TricycleController"
MECANUM = "mecanum_drive_controller/MecanumDriveController"
OMNI = "omni_wheel_drive_controller/OmniWheelDriveController"
SWERVE = "swerve_drive_controller/SwerveController"
ADMITTANCE = "admittance_controller/AdmittanceController"
GPIO = "gpio_controllers/GpioCommandController"
FILTER = "chained_filter_controller/ChainedFilter"
IMU = "imu_sensor_broadcaster/IMUSensorBroadcaster"
WRENCH = "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster"
RANGE = "range_sensor_broadcaster/RangeSensorBroadcaster"
POSE = "pose_broadcaster/PoseBroadcaster"
GPS = "gps_sensor_broadcaster/GPSSensorBroadcaster"
MAGNETOMETER = "magnetometer_broadcaster/MagnetometerBroadcaster"
BATTERY = "battery_state_broadcaster/BatteryStateBroadcaster"
STATES = "state_interfaces_broadcaster/StateInterfacesBroadcaster"
SAFETY = "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster"
PASSTHROUGH = "passthrough_controller/PassthroughController"
SCALED_JTC = "ur_controllers/ScaledJointTrajectoryController"
OLD_JSB = "joint_state_controller/JointStateController"

_WHEELS = ("front_left", "front_right", "rear_right", "rear_left")
_JOINTS = {"joints": ["a", "b"]}
_SENSOR = {"sensor_name": "s", "frame_id": "f"}

# The least that every type has to be given.
MINIMAL: Mapping[str, Mapping[str, Any]] = {
    JTC: {
        **_JOINTS,
        "command_interfaces": ["position"],
        "state_interfaces": ["position", "velocity"],
    },
    JSB: {},
    FORWARD: {**_JOINTS, "interface_name": "position"},
    MULTI: {"joint": "a", "interface_names": ["position", "kp"]},
    **dict.fromkeys(GROUPS, _JOINTS),
    GRIPPER: {"joint": "a"},
    EFFORT_GRIPPER: {"joint": "a"},
    PARALLEL_GRIPPER: {"joint": "a"},
    PID: {
        "dof_names": ["a", "b"],
        "command_interface": "effort",
        "reference_and_state_interfaces": ["position"],
    },
    DIFF_DRIVE: {
        "left_wheel_names": ["l"],
        "right_wheel_names": ["r"],
        "wheel_separation": 0.5,
        "wheel_radius": 0.1,
    },
    BICYCLE: {
        "traction_joints_names": ["t"],
        "steering_joints_names": ["s"],
        "wheelbase": 1.0,
        "traction_wheel_radius": 0.3,
    },
    TRICYCLE_STEERING: {
        "traction_joints_names": ["tr", "tl"],
        "steering_joints_names": ["s"],
        "wheelbase": 1.0,
        "traction_track_width": 0.8,
        "traction_wheels_radius": 0.3,
    },
    ACKERMANN: {
        "traction_joints_names": ["tr", "tl"],
        "steering_joints_names": ["sr", "sl"],
        "wheelbase": 1.0,
        "traction_track_width": 0.8,
        "traction_wheels_radius": 0.3,
    },
    TRICYCLE: {
        "traction_joint_name": "t",
        "steering_joint_name": "s",
        "wheelbase": 1.0,
        "wheel_radius": 0.3,
    },
    MECANUM: {
        **{f"{wheel}_wheel_command_joint_name": wheel for wheel in _WHEELS},
        "kinematics.wheels_radius": 0.1,
    },
    OMNI: {
        "wheel_names": ["a", "b", "c"],
        "wheel_offset": 0.0,
        "robot_radius": 0.2,
        "wheel_radius": 0.05,
    },
    SWERVE: {
        f"{wheel}_{part}_joint": f"{wheel}_{part}"
        for wheel in _WHEELS
        for part in ("wheel", "axle")
    },
    ADMITTANCE: {
        **_JOINTS,
        "command_interfaces": ["position"],
        "state_interfaces": ["position"],
        "chainable_command_interfaces": ["position", "velocity"],
        "kinematics.plugin_name": "kinematics_interface_kdl/KinematicsInterfaceKDL",
        "kinematics.plugin_package": "kinematics_interface",
        "kinematics.base": "base",
        "kinematics.tip": "tip",
        "ft_sensor.name": "ft",
        "ft_sensor.frame.id": "tip",
        "control.frame.id": "tip",
        "fixed_world_frame.frame.id": "base",
        "gravity_compensation.frame.id": "tip",
        "gravity_compensation.CoG.pos": [0.1, 0.0, 0.0],
        "admittance.selected_axes": [True] * 6,
        "admittance.mass": [5.0] * 6,
        "admittance.damping_ratio": [2.0] * 6,
        "admittance.stiffness": [200.0] * 6,
    },
    GPIO: {"gpios": ["a", "b"]},
    FILTER: {"input_interfaces": ["a/position"], "output_interfaces": ["a/filtered"]},
    IMU: _SENSOR,
    WRENCH: _SENSOR,
    RANGE: _SENSOR,
    POSE: {"pose_name": "p", "frame_id": "f"},
    GPS: _SENSOR,
    MAGNETOMETER: _SENSOR,
    BATTERY: {},
    STATES: {"interfaces": ["a/position"]},
    SAFETY: {"interfaces.field_violation": ["a/field"]},
    PASSTHROUGH: {"interfaces": ["a/position"]},
}
MINIMAL = {**MINIMAL, SCALED_JTC: MINIMAL[JTC], OLD_JSB: MINIMAL[JSB]}


def load(
    type_: str,
    settings: Mapping[str, Any] | None = None,
    *,
    distro: str = "jazzy",
    report: LoadReport | None = None,
    without: tuple[str, ...] = (),
) -> Any:
    """Return parameters of a type: the least there is to give, and what is given."""
    values = {**MINIMAL[type_], **(settings or {})}
    file = Path("c.yaml")
    parameters = {
        name: Parameter(value, file, line)
        for line, (name, value) in enumerate(values.items(), start=1)
        if name not in without
    }
    schema = CONTROLLER_TYPES[type_].parameters
    report = LoadReport() if report is None else report
    return load_parameters(schema, parameters, "c", file, report, distro=distro)


def report_of(
    type_: str, parameters: Mapping[str, Any], *, distro: str = "jazzy"
) -> list[str]:
    """Return the lines of the report, without severity, file and name of the node."""
    report = LoadReport()
    load(type_, parameters, distro=distro, report=report)
    return [
        f"{entry.severity}: {entry.where.removeprefix('c.')}: {entry.what}; "
        f"{entry.done}"
        for entry in report
    ]


def flat(parameters: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield loaded parameters by their dotted names, as groups have them."""
    for field in dc.fields(parameters):
        value = getattr(parameters, field.name)
        if dc.is_dataclass(value):
            yield from flat(value, f"{prefix}{field.name}.")
        elif "per_element_of" in field.metadata:
            for element, group in value.items():
                yield from flat(group, f"{prefix}{element}.")
        else:
            yield prefix + field.name, value
