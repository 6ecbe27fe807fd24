"""Defaults of ros2_controllers, jazzy's where they differ.

The numbers are those of upstream's parameter files.
"""

import math
from typing import Any

import pytest

from arm_drake.controllers import CONTROLLER_TYPES
from tests.controllers.parameters import (
    ACKERMANN,
    ADMITTANCE,
    BATTERY,
    BICYCLE,
    DIFF_DRIVE,
    EFFORT_GRIPPER,
    FILTER,
    FORWARD,
    GPIO,
    GPS,
    GRIPPER,
    GROUPS,
    IMU,
    JSB,
    JTC,
    MAGNETOMETER,
    MECANUM,
    MINIMAL,
    MULTI,
    OLD_JSB,
    OMNI,
    PARALLEL_GRIPPER,
    PASSTHROUGH,
    PID,
    POSE,
    RANGE,
    SAFETY,
    SCALED_JTC,
    STATES,
    SWERVE,
    TRICYCLE,
    TRICYCLE_STEERING,
    WRENCH,
    flat,
    load,
)

INF, NAN = math.inf, math.nan


def nested(prefix: str, values: dict[str, Any]) -> dict[str, Any]:
    return {f"{prefix}.{name}": value for name, value in values.items()}


PID_GAINS = {
    "p": 0.0,
    "i": 0.0,
    "d": 0.0,
    "u_clamp_max": INF,
    "u_clamp_min": -INF,
    "i_clamp_max": INF,
    "i_clamp_min": -INF,
    "antiwindup_strategy": "legacy",
    "antiwindup": False,
    "tracking_time_constant": 0.0,
    "error_deadband": 0.0,
}
JTC_GAINS = {**PID_GAINS, "ff_velocity_scale": 0.0, "angle_wraparound": False}
DOF_GAINS = {
    **PID_GAINS,
    "error_deadband": 1e-16,
    "feedforward_gain": 0.0,
    "angle_wraparound": False,
    "save_i_term": True,
    "activate_state_publisher": False,
}
JOINT_CONSTRAINTS = {"trajectory": 0.0, "goal": 0.0, "max_deceleration_on_cancel": 0.0}
SPEED_LIMITS = dict.fromkeys(
    (
        "max_velocity",
        "min_velocity",
        "max_acceleration",
        "max_deceleration",
        "max_acceleration_reverse",
        "max_deceleration_reverse",
        "max_jerk",
        "min_jerk",
    ),
    NAN,
)
TRACTION_LIMITS = {
    f"{end}_{quantity}": NAN
    for end in ("max", "min")
    for quantity in ("velocity", "acceleration", "deceleration", "jerk")
}
STEERING_LIMITS = {
    f"{end}_{quantity}": NAN
    for end in ("max", "min")
    for quantity in ("position", "velocity", "acceleration")
}
GRIPPER_DEFAULTS = {
    "action_monitor_rate": 20.0,
    "goal_tolerance": 0.01,
    "max_effort": 0.0,
    "allow_stalling": False,
    "stall_velocity_threshold": 0.001,
    "stall_timeout": 1.0,
}
STEERING = {
    "traction_joints_state_names": (),
    "steering_joints_state_names": (),
    "reference_timeout": 1.0,
    "open_loop": False,
    "reduce_wheel_speed_until_steering_reached": False,
    "velocity_rolling_window_size": 10,
    "base_frame_id": "base_link",
    "odom_frame_id": "odom",
    "tf_frame_prefix": "",
    "enable_odom_tf": True,
    "twist_covariance_diagonal": (0.0, 7.0, 14.0, 21.0, 28.0, 35.0),
    "pose_covariance_diagonal": (0.0, 7.0, 14.0, 21.0, 28.0, 35.0),
    "position_feedback": False,
    "use_stamped_vel": True,
}
JTC_DEFAULTS = {
    "command_joints": (),
    "allow_partial_joints_goal": False,
    "allow_trajectory_replacement": False,
    "interpolate_from_desired_state": False,
    "open_loop_control": False,
    "allow_integration_in_goal_trajectories": False,
    "set_last_command_interface_value_as_state_on_activation": True,
    "action_monitor_rate": 20.0,
    "interpolation_method": "splines",
    "allow_nonzero_velocity_at_trajectory_end": False,
    "cmd_timeout": 0.0,
    "state_publish_rate": 50.0,
    "start_with_holding": True,
    "positions_upsampling.enable": False,
    "positions_upsampling.policy_frequency": 0.0,
    "speed_scaling.initial_scaling_factor": 1.0,
    "speed_scaling.state_interface": "",
    "speed_scaling.command_interface": "",
    "constraints.stopped_velocity_tolerance": 0.01,
    "constraints.goal_time": 0.0,
    "constraints.decelerate_on_cancel": False,
    **nested("constraints.a", JOINT_CONSTRAINTS),
    **nested("constraints.b", JOINT_CONSTRAINTS),
    **nested("gains.a", JTC_GAINS),
    **nested("gains.b", JTC_GAINS),
}
JSB_DEFAULTS = {
    "joints": (),
    "interfaces": (),
    "extra_joints": (),
    "map_interface_to_joint_state.position": "position",
    "map_interface_to_joint_state.velocity": "velocity",
    "map_interface_to_joint_state.effort": "effort",
    "use_local_topics": False,
    "use_urdf_to_filter": True,
    "publish_dynamic_joint_states": True,
    "frame_id": "",
}

DEFAULTS: dict[str, dict[str, Any]] = {
    JTC: JTC_DEFAULTS,
    SCALED_JTC: JTC_DEFAULTS,
    JSB: JSB_DEFAULTS,
    OLD_JSB: JSB_DEFAULTS,
    FORWARD: {},
    MULTI: {},
    **{group: {"interface_name": ""} for group in GROUPS},
    GRIPPER: GRIPPER_DEFAULTS,
    EFFORT_GRIPPER: {
        **GRIPPER_DEFAULTS,
        **nested("gains.a", dict.fromkeys(("p", "i", "d", "i_clamp"), 0.0)),
    },
    PARALLEL_GRIPPER: {
        "action_monitor_rate": 20.0,
        "state_interfaces": ("position", "velocity"),
        "goal_tolerance": 0.01,
        "allow_stalling": False,
        "stall_velocity_threshold": 0.001,
        "stall_timeout": 1.0,
        "max_effort_interface": "",
        "max_effort": 10.0,
        "max_velocity_interface": "",
        "max_velocity": 0.1,
    },
    PID: {
        "reference_and_state_dof_names": (),
        "set_current_state_as_first_setpoint": True,
        "use_external_measured_states": False,
        "enable_feedforward": False,
        **nested("gains.a", DOF_GAINS),
        **nested("gains.b", DOF_GAINS),
    },
    DIFF_DRIVE: {
        "wheel_separation_multiplier": 1.0,
        "left_wheel_radius_multiplier": 1.0,
        "right_wheel_radius_multiplier": 1.0,
        "wheels_per_side": 0,
        "odom_frame_id": "odom",
        "base_frame_id": "base_link",
        "tf_frame_prefix_enable": True,
        "tf_frame_prefix": "",
        "pose_covariance_diagonal": (0.0,) * 6,
        "twist_covariance_diagonal": (0.0,) * 6,
        "open_loop": False,
        "position_feedback": True,
        "enable_odom_tf": True,
        "cmd_vel_timeout": 0.5,
        "publish_limited_velocity": False,
        "velocity_rolling_window_size": 10,
        "use_stamped_vel": True,
        "publish_rate": 50.0,
        **nested("linear.x", SPEED_LIMITS),
        **nested("angular.z", SPEED_LIMITS),
    },
    BICYCLE: STEERING,
    TRICYCLE_STEERING: STEERING,
    ACKERMANN: {**STEERING, "steering_track_width": 0.0},
    TRICYCLE: {
        "odom_frame_id": "odom",
        "base_frame_id": "base_link",
        "pose_covariance_diagonal": (0.0,) * 6,
        "twist_covariance_diagonal": (0.0,) * 6,
        "open_loop": False,
        "enable_odom_tf": False,
        "odom_only_twist": False,
        "cmd_vel_timeout": 500,
        "publish_ackermann_command": False,
        "velocity_rolling_window_size": 10,
        "use_stamped_vel": True,
        **nested("traction", TRACTION_LIMITS),
        **nested("steering", STEERING_LIMITS),
    },
    MECANUM: {
        "front_left_wheel_state_joint_name": "",
        "front_right_wheel_state_joint_name": "",
        "rear_right_wheel_state_joint_name": "",
        "rear_left_wheel_state_joint_name": "",
        "reference_timeout": 0.0,
        "kinematics.base_frame_offset.x": 0.0,
        "kinematics.base_frame_offset.y": 0.0,
        "kinematics.base_frame_offset.theta": 0.0,
        "kinematics.sum_of_robot_center_projection_on_X_Y_axis": 0.0,
        "tf_frame_prefix_enable": True,
        "tf_frame_prefix": "",
        "base_frame_id": "base_link",
        "odom_frame_id": "odom",
        "enable_odom_tf": True,
        "twist_covariance_diagonal": (0.1,) * 6,
        "pose_covariance_diagonal": (0.1,) * 6,
        **nested("linear.x", SPEED_LIMITS),
        **nested("linear.y", SPEED_LIMITS),
        **nested("angular.z", SPEED_LIMITS),
    },
    OMNI: {
        "tf_frame_prefix_enable": True,
        "tf_frame_prefix": "",
        "odom_frame_id": "odom",
        "base_frame_id": "base_link",
        "diagonal_covariance.pose": (0.0,) * 6,
        "diagonal_covariance.twist": (0.0,) * 6,
        "open_loop": False,
        "position_feedback": True,
        "enable_odom_tf": True,
        "cmd_vel_timeout": 0.5,
    },
    SWERVE: {
        "wheelbase": 0.85,
        "trackwidth": 0.75,
        "offset": (0.0, 0.0),
        "wheel_radius": 0.04,
        "center_of_rotation": (0.0, 0.0),
        "cmd_vel_timeout": 10.0,
        "odom": "odom",
        "base_footprint": "base_footprint",
        "enable_odom_tf": True,
        "open_loop": False,
        "front_left_velocity_threshold": 2.0,
        "front_right_velocity_threshold": 2.0,
        "rear_left_velocity_threshold": 2.0,
        "rear_right_velocity_threshold": 2.0,
        "pose_covariance_diagonal": (0.0,) * 6,
        "twist_covariance_diagonal": (0.0,) * 6,
    },
    ADMITTANCE: {
        "command_joints": (),
        "kinematics.alpha": 0.01,
        "ft_sensor.filter_coefficient": 0.05,
        "ft_sensor.frame.external": False,
        "control.frame.external": False,
        "fixed_world_frame.frame.external": False,
        "gravity_compensation.frame.external": False,
        "gravity_compensation.CoG.force": 0.0,
        "admittance.joint_damping": 5.0,
        "enable_parameter_update_without_reactivation": True,
    },
    GPIO: {
        "command_interfaces.a.interfaces": (),
        "command_interfaces.b.interfaces": (),
        "state_interfaces.a.interfaces": (),
        "state_interfaces.b.interfaces": (),
    },
    FILTER: {"filter_chain": {}, "a/position.filter_chain": {}},
    IMU: {
        "static_covariance_orientation": (0.0,) * 9,
        "static_covariance_angular_velocity": (0.0,) * 9,
        "static_covariance_linear_acceleration": (0.0,) * 9,
        **nested("rotation_offset", {"roll": 0.0, "pitch": 0.0, "yaw": 0.0}),
    },
    WRENCH: {
        **{
            f"{group}.{part}.{axis}": value
            for group, value in (
                ("interface_names", ""),
                ("offset", 0.0),
                ("multiplier", 1.0),
            )
            for part in ("force", "torque")
            for axis in "xyz"
        },
        "sensor_filter_chain": {},
    },
    RANGE: {
        "radiation_type": 0,
        "field_of_view": 0.52,
        "min_range": 0.52,
        "max_range": 4.0,
        "variance": 0.0,
    },
    POSE: {"tf.enable": True, "tf.child_frame_id": ""},
    GPS: {
        "static_position_covariance": (0.0,) * 9,
        "read_covariance_from_interface": False,
    },
    MAGNETOMETER: {"static_covariance": (0.0,) * 9},
    BATTERY: {
        "batteries": (),
        "sensor_name": "",
        "design_capacity": NAN,
        "power_supply_technology": 0,
    },
    STATES: {},
    SAFETY: nested("interfaces.e_stop", {"manual": (), "remote": (), "autoack": ()}),
    PASSTHROUGH: {},
}


def comparable(value: Any) -> Any:
    """Return a value that equals itself, which NaN doesn't."""
    return "NaN" if isinstance(value, float) and math.isnan(value) else value


def test_every_type_has_its_defaults_here() -> None:
    assert DEFAULTS.keys() == CONTROLLER_TYPES.keys()


@pytest.mark.parametrize("type_", DEFAULTS)
def test_what_isnt_given_is_as_upstream(type_: str) -> None:
    parameters = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in MINIMAL[type_].items()
    }
    expected = {**DEFAULTS[type_], **parameters}

    loaded = dict(flat(load(type_)))

    assert {name: comparable(value) for name, value in loaded.items()} == {
        name: comparable(value) for name, value in expected.items()
    }


@pytest.mark.parametrize("type_", DEFAULTS)
def test_a_default_has_the_type_that_a_yaml_gives(type_: str) -> None:
    for name, value in flat(load(type_)):
        is_list = isinstance(value, tuple)
        for element in value if is_list else (value,):
            assert type(element) in (bool, int, float, str, dict), name


@pytest.mark.parametrize(
    ("type_", "parameters"),
    [
        (GPIO, {"command_interfaces.a.interfaces": ["out_1", "out_2"]}),
        (FILTER, {"a/position.filter_chain": {"filter1.type": "x"}}),
        (FILTER, {"filter_chain": {"filter1.type": "x", "filter1.params.a": 0.5}}),
        (WRENCH, {"sensor_filter_chain": {"filter1.name": "low_pass"}}),
        (BATTERY, {"interfaces.a.battery_current": True, "a.capacity": 2.5}),
        (PID, {"gains.b.p": 10.0}),
        (EFFORT_GRIPPER, {"gains.a.p": 10.0}),
        (ADMITTANCE, {"control.frame.id": "tool"}),
        (MECANUM, {"kinematics.base_frame_offset.x": 0.25}),
        (WRENCH, {"multiplier.torque.z": -1.0}),
    ],
)
def test_a_nested_parameter_is_taken(type_: str, parameters: dict[str, Any]) -> None:
    written: dict[str, Any] = {"batteries": ["a"]} if type_ == BATTERY else {}
    for name, value in parameters.items():
        below = value if isinstance(value, dict) else {}
        written |= nested(name, below) if below else {name: value}

    loaded = dict(flat(load(type_, written)))

    for name, value in parameters.items():
        assert loaded[name] == (tuple(value) if isinstance(value, list) else value)
