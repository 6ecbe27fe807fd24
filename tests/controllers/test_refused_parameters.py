"""Parameters that ros2_controllers refuses: one message here, too."""

from typing import Any

import pytest

from arm_drake.errors import ParameterError
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
    JTC,
    MAGNETOMETER,
    MECANUM,
    MINIMAL,
    MULTI,
    OMNI,
    PARALLEL_GRIPPER,
    PASSTHROUGH,
    PID,
    POSE,
    RANGE,
    STATES,
    TRICYCLE,
    TRICYCLE_STEERING,
    WRENCH,
    load,
)

COMMANDS = (
    "['position'], ['position', 'velocity'], ['acceleration', 'position', 'velocity'], "
    "['velocity'], ['effort'], ['effort', 'position']"
)
STATE_CHOICES = (
    "['position'], ['position', 'velocity'], ['acceleration', 'position', 'velocity']"
)
NINE = "must have 9 elements, got 1: [1.0]"
SIX = "must have 6 elements, got 1: [1.0]"
ONE = "must have at least one element"
TWICE = "joints must not repeat elements, got ['a', 'a']"

CASES: list[tuple[str, dict[str, Any], str]] = [
    (JTC, {"joints": []}, f"joints {ONE}"),
    (JTC, {"joints": ["a", "a"]}, TWICE),
    (JTC, {"command_interfaces": []}, f"command_interfaces {ONE}"),
    *(
        (
            JTC,
            {"command_interfaces": names},
            f"command_interfaces must be one of {COMMANDS}, got {names}",
        )
        for names in (
            ["effort", "velocity"],
            ["effort", "acceleration"],
            ["effort", "velocity", "acceleration"],
            ["velocity", "acceleration"],
            ["acceleration"],
            ["position", "acceleration"],
        )
    ),
    (JTC, {"state_interfaces": []}, f"state_interfaces {ONE}"),
    *(
        (
            JTC,
            {"state_interfaces": names},
            f"state_interfaces must have 'position', got {names}",
        )
        for names in (["velocity"], ["velocity", "acceleration"], ["acceleration"])
    ),
    (
        JTC,
        {"state_interfaces": ["position", "acceleration"]},
        f"state_interfaces must be one of {STATE_CHOICES}, "
        "got ['position', 'acceleration']",
    ),
    *(
        (
            JTC,
            {"command_interfaces": names, "state_interfaces": ["position"]},
            f"state_interfaces must have 'velocity' to command {names}, "
            "got ['position']",
        )
        for names in (["velocity"], ["effort"], ["effort", "position"])
    ),
    (
        JTC,
        {"command_joints": ["a", "b", "c"]},
        "command_joints must be some of ['a', 'b'], or as many, got ['a', 'b', 'c']",
    ),
    (
        JTC,
        {"command_joints": ["c"]},
        "command_joints must be some of ['a', 'b'], or as many, got ['c']",
    ),
    (JTC, {"cmd_timeout": -1.0}, "cmd_timeout must be at least 0, got -1.0"),
    (
        JTC,
        {"action_monitor_rate": 0.05},
        "action_monitor_rate must be at least 0.1 Hz, got 0.05",
    ),
    (
        JTC,
        {"constraints.goal_time": -1.0},
        "constraints: goal_time must be at least 0, got -1.0",
    ),
    (
        JTC,
        {"constraints.a.max_deceleration_on_cancel": -1.0},
        "constraints.a: max_deceleration_on_cancel must be at least 0, got -1.0",
    ),
    (
        JTC,
        {"speed_scaling.initial_scaling_factor": -1.0},
        "speed_scaling: initial_scaling_factor must be at least 0, got -1.0",
    ),
    (
        JTC,
        {"positions_upsampling.policy_frequency": -1.0},
        "positions_upsampling: policy_frequency must be at least 0, got -1.0",
    ),
    *(
        (JTC, {"command_interfaces": ["velocity"], **parameters}, message)
        for parameters, message in (
            (
                {"gains.a.u_clamp_max": -1.0, "gains.a.u_clamp_min": 1.0},
                "gains.a.u_clamp_min must be below u_clamp_max, got 1.0 and -1.0",
            ),
            (
                {"gains.a.u_clamp_max": 1.0, "gains.a.u_clamp_min": 1.0},
                "gains.a.u_clamp_min must be below u_clamp_max, got 1.0 and 1.0",
            ),
            (
                {"gains.a.i_clamp_min": 1.0},
                "gains.a.i_clamp_min and i_clamp_max must have 0 between them, got 1.0 "
                "and inf",
            ),
            (
                {
                    "gains.a.antiwindup_strategy": "back_calculation",
                    "gains.a.tracking_time_constant": -1.0,
                },
                "gains.a.tracking_time_constant must be at least 0, got -1.0",
            ),
        )
    ),
    (FORWARD, {"joints": []}, f"joints {ONE}"),
    (FORWARD, {"joints": ["a", "a"]}, TWICE),
    (FORWARD, {"interface_name": ""}, "interface_name must not be empty, got ''"),
    (MULTI, {"joint": ""}, "joint must not be empty, got ''"),
    (MULTI, {"interface_names": []}, f"interface_names {ONE}"),
    (
        MULTI,
        {"interface_names": ["effort", "effort"]},
        "interface_names must not repeat elements, got ['effort', 'effort']",
    ),
    *((group, {"joints": []}, f"joints {ONE}") for group in GROUPS),
    *((group, {"joints": ["a", "a"]}, TWICE) for group in GROUPS),
    *(
        (gripper, parameters, message)
        for gripper in (GRIPPER, EFFORT_GRIPPER, PARALLEL_GRIPPER)
        for parameters, message in (
            ({"joint": ""}, "joint must not be empty, got ''"),
            (
                {"action_monitor_rate": 0.05},
                "action_monitor_rate must be at least 0.1, got 0.05",
            ),
            ({"goal_tolerance": -1.0}, "goal_tolerance must be at least 0, got -1.0"),
            ({"max_effort": -1.0}, "max_effort must be at least 0, got -1.0"),
        )
    ),
    (
        EFFORT_GRIPPER,
        {"gains.a.i_clamp": -1.0},
        "gains.a: i_clamp must be at least 0, got -1.0",
    ),
    (
        PARALLEL_GRIPPER,
        {"stall_timeout": -1.0},
        "stall_timeout must be at least 0, got -1.0",
    ),
    (
        PARALLEL_GRIPPER,
        {"max_velocity": -1.0},
        "max_velocity must be at least 0, got -1.0",
    ),
    (PID, {"dof_names": []}, f"dof_names {ONE}"),
    (
        PID,
        {"dof_names": ["a", "a"]},
        "dof_names must not repeat elements, got ['a', 'a']",
    ),
    (PID, {"command_interface": ""}, "command_interface must not be empty, got ''"),
    (
        PID,
        {"reference_and_state_interfaces": []},
        f"reference_and_state_interfaces {ONE}",
    ),
    (
        PID,
        {"reference_and_state_interfaces": ["p", "v", "a"]},
        "reference_and_state_interfaces must have 1 or 2 elements, got ['p', 'v', 'a']",
    ),
    (
        PID,
        {"reference_and_state_dof_names": ["c"]},
        "reference_and_state_dof_names must be as many as dof_names, got ['c']",
    ),
    (
        PID,
        {"gains.b.u_clamp_max": -1.0, "gains.b.u_clamp_min": 1.0},
        "gains.b.u_clamp_min must be below u_clamp_max, got 1.0 and -1.0",
    ),
    (DIFF_DRIVE, {"left_wheel_names": []}, f"left_wheel_names {ONE}"),
    (DIFF_DRIVE, {"right_wheel_names": []}, f"right_wheel_names {ONE}"),
    (
        DIFF_DRIVE,
        {"right_wheel_names": ["r", "r2"]},
        "right_wheel_names must be as many as left_wheel_names, "
        "got ['r', 'r2'] and ['l']",
    ),
    (DIFF_DRIVE, {"wheel_radius": 0.0}, "wheel_radius must be above 0, got 0.0"),
    (
        DIFF_DRIVE,
        {"wheel_separation": -0.5},
        "wheel_separation must be above 0, got -0.5",
    ),
    (
        DIFF_DRIVE,
        {"velocity_rolling_window_size": 0},
        "velocity_rolling_window_size must be at least 1, got 0",
    ),
    (
        DIFF_DRIVE,
        {"pose_covariance_diagonal": [1.0]},
        f"pose_covariance_diagonal {SIX}",
    ),
    *(
        (
            DIFF_DRIVE,
            {f"linear.x.{name}": -sign},
            f"linear.x: {name} must be at {'least' if sign > 0 else 'most'} 0, "
            f"got {-sign}",
        )
        for name, sign in (
            ("max_velocity", 1.0),
            ("min_velocity", -1.0),
            ("max_acceleration", 1.0),
            ("max_acceleration_reverse", -1.0),
            ("max_deceleration_reverse", 1.0),
            ("max_jerk", 1.0),
            ("min_jerk", -1.0),
        )
    ),
    *(
        (type_, parameters, message)
        for type_ in (BICYCLE, TRICYCLE_STEERING, ACKERMANN)
        for parameters, message in (
            ({"traction_joints_names": []}, f"traction_joints_names {ONE}"),
            ({"steering_joints_names": []}, f"steering_joints_names {ONE}"),
            ({"wheelbase": 0.0}, "wheelbase must be above 0, got 0.0"),
            (
                {"velocity_rolling_window_size": 0},
                "velocity_rolling_window_size must be at least 1, got 0",
            ),
        )
    ),
    (
        BICYCLE,
        {"traction_joints_names": ["a", "b"]},
        "traction_joints_names must have 1 elements, got 2: ['a', 'b']",
    ),
    (
        ACKERMANN,
        {"steering_joints_names": ["a"]},
        "steering_joints_names must have 2 elements, got 1: ['a']",
    ),
    (
        ACKERMANN,
        {"traction_joints_names": ["a", "a"]},
        "traction_joints_names must not repeat elements, got ['a', 'a']",
    ),
    (
        ACKERMANN,
        {"traction_joints_state_names": ["a"]},
        "traction_joints_state_names must have 2 elements, got 1: ['a']",
    ),
    (
        BICYCLE,
        {"traction_wheel_radius": 0.0},
        "traction_wheel_radius must be above 0, got 0.0",
    ),
    *(
        (type_, {name: 0.0}, f"{name} must be above 0, got 0.0")
        for type_ in (TRICYCLE_STEERING, ACKERMANN)
        for name in ("traction_track_width", "traction_wheels_radius")
    ),
    (
        TRICYCLE,
        {"traction_joint_name": ""},
        "traction_joint_name must not be empty, got ''",
    ),
    (
        TRICYCLE,
        {"steering_joint_name": ""},
        "steering_joint_name must not be empty, got ''",
    ),
    (TRICYCLE, {"wheelbase": 0.0}, "wheelbase must be above 0, got 0.0"),
    (TRICYCLE, {"wheel_radius": 0.0}, "wheel_radius must be above 0, got 0.0"),
    (
        TRICYCLE,
        {"velocity_rolling_window_size": 0},
        "velocity_rolling_window_size must be at least 1, got 0",
    ),
    (
        TRICYCLE,
        {"traction.max_velocity": -1.0},
        "traction: max_velocity must be at least 0, got -1.0",
    ),
    (
        TRICYCLE,
        {"traction.min_jerk": 2.0, "traction.max_jerk": 1.0},
        "traction: min_jerk must be at most max_jerk, got 2.0 and 1.0",
    ),
    (
        TRICYCLE,
        {"steering.min_position": 2.0, "steering.max_position": 1.0},
        "steering: min_position must be at most max_position, got 2.0 and 1.0",
    ),
    (
        TRICYCLE,
        {"steering.max_velocity": -1.0},
        "steering: max_velocity must be at least 0, got -1.0",
    ),
    (
        MECANUM,
        {"rear_left_wheel_command_joint_name": ""},
        "rear_left_wheel_command_joint_name must not be empty, got ''",
    ),
    (
        MECANUM,
        {"kinematics.wheels_radius": 0.0},
        "kinematics: wheels_radius must be above 0, got 0.0",
    ),
    (
        OMNI,
        {"wheel_names": ["a", "b"]},
        "wheel_names must have at least 3 elements, got ['a', 'b']",
    ),
    (OMNI, {"robot_radius": 0.0}, "robot_radius must be above 0, got 0.0"),
    (OMNI, {"wheel_radius": 0.0}, "wheel_radius must be above 0, got 0.0"),
    (
        OMNI,
        {"diagonal_covariance.twist": [1.0]},
        f"diagonal_covariance: twist {SIX}",
    ),
    (ADMITTANCE, {"joints": []}, f"joints {ONE}"),
    (
        ADMITTANCE,
        {"state_interfaces": ["velocity"]},
        "state_interfaces must have 'position', got ['velocity']",
    ),
    (
        ADMITTANCE,
        {"gravity_compensation.CoG.pos": [1.0]},
        "gravity_compensation.CoG: pos must have 3 elements, got 1: [1.0]",
    ),
    (ADMITTANCE, {"admittance.mass": [1.0]}, f"admittance: mass {SIX}"),
    (
        ADMITTANCE,
        {"admittance.damping_ratio": [float("nan")] * 6},
        "admittance: damping_ratio must be in [-1.79769e+308, 1.79769e+308], got nan",
    ),
    (
        ADMITTANCE,
        {"ft_sensor.filter_coefficient": float("nan")},
        "ft_sensor: filter_coefficient must be a finite number, got nan",
    ),
    (
        DIFF_DRIVE,
        {"cmd_vel_timeout": 1e300},
        "cmd_vel_timeout must be a number of seconds, got 1e+300",
    ),
    (
        DIFF_DRIVE,
        {"left_wheel_radius_multiplier": 0.0},
        "left_wheel_radius_multiplier must be a finite number and not 0, got 0.0",
    ),
    (
        ADMITTANCE,
        {"admittance.mass": [1.0, 1.0, 1.0, 1.0, 1.0, 0.0]},
        "admittance: mass must be in [0.0001, 1e+06], got 0.0",
    ),
    (
        ADMITTANCE,
        {"admittance.stiffness": [-1.0] * 6},
        "admittance: stiffness must be in [0, 1e+08], got -1.0",
    ),
    (
        ADMITTANCE,
        {"admittance.joint_damping": -1.0},
        "admittance: joint_damping must be at least 0, got -1.0",
    ),
    (GPIO, {"gpios": []}, f"gpios {ONE}"),
    (GPIO, {"gpios": ["a", "a"]}, "gpios must not repeat elements, got ['a', 'a']"),
    (
        GPIO,
        {"state_interfaces.b.interfaces": ["x", "x"]},
        "state_interfaces.b: interfaces must not repeat elements, got ['x', 'x']",
    ),
    (FILTER, {"input_interfaces": []}, f"input_interfaces {ONE}"),
    (FILTER, {"output_interfaces": []}, f"output_interfaces {ONE}"),
    (
        FILTER,
        {"output_interfaces": ["x", "y"]},
        "output_interfaces must be as many as input_interfaces, "
        "got ['x', 'y'] and ['a/position']",
    ),
    *(
        (type_, {name: ""}, f"{name} must not be empty, got ''")
        for type_ in (IMU, RANGE, GPS, MAGNETOMETER)
        for name in ("sensor_name", "frame_id")
    ),
    (POSE, {"pose_name": ""}, "pose_name must not be empty, got ''"),
    (POSE, {"frame_id": ""}, "frame_id must not be empty, got ''"),
    *(
        (type_, {name: [1.0]}, f"{name} {NINE}")
        for type_, name in (
            (IMU, "static_covariance_orientation"),
            (IMU, "static_covariance_angular_velocity"),
            (IMU, "static_covariance_linear_acceleration"),
            (GPS, "static_position_covariance"),
            (MAGNETOMETER, "static_covariance"),
        )
    ),
    (WRENCH, {"frame_id": ""}, "frame_id must not be empty, got ''"),
    (
        WRENCH,
        {"sensor_name": ""},
        "expected either sensor_name or interface_names, got neither",
    ),
    (
        WRENCH,
        {"interface_names.force.x": "s/f"},
        "expected either sensor_name or interface_names, got both",
    ),
    (
        BATTERY,
        {"batteries": ["a", "a"]},
        "batteries must not repeat elements, got ['a', 'a']",
    ),
    (
        BATTERY,
        {"batteries": ["a"], "a.power_supply_technology": 9},
        "a: power_supply_technology must be in [0, 8], got 9",
    ),
    (
        BATTERY,
        {"power_supply_technology": -1},
        "power_supply_technology must be in [0, 8], got -1",
    ),
    (STATES, {"interfaces": []}, f"interfaces {ONE}"),
    (PASSTHROUGH, {"interfaces": []}, f"interfaces {ONE}"),
    (
        PASSTHROUGH,
        {"interfaces": ["a/position", "a/position"]},
        "interfaces must not repeat elements, got ['a/position', 'a/position']",
    ),
    *(
        (type_, {name: [1.0]}, f"{name} {SIX}")
        for type_ in (BICYCLE, TRICYCLE, MECANUM, DIFF_DRIVE)
        for name in ("pose_covariance_diagonal", "twist_covariance_diagonal")
    ),
    *(
        (ADMITTANCE, {name: values}, f"{name} must not repeat elements, got {values}")
        for name, values in (
            ("joints", ["a", "a"]),
            ("command_interfaces", ["position", "position"]),
            ("state_interfaces", ["position", "position"]),
        )
    ),
    *(
        (
            TRICYCLE,
            {f"{part}.min_{quantity}": 2.0, f"{part}.max_{quantity}": 1.0},
            f"{part}: min_{quantity} must be at most max_{quantity}, got 2.0 and 1.0",
        )
        for part, quantity in (
            ("traction", "velocity"),
            ("traction", "acceleration"),
            ("traction", "deceleration"),
            ("steering", "velocity"),
            ("steering", "acceleration"),
        )
    ),
    *(
        (
            JTC,
            {name: ["position", "position"]},
            f"{name} must not repeat elements, got ['position', 'position']",
        )
        for name in ("command_interfaces", "state_interfaces")
    ),
    (
        JTC,
        {"command_joints": ["a", "a"]},
        "command_joints must not repeat elements, got ['a', 'a']",
    ),
    (
        PID,
        {"reference_and_state_dof_names": ["a", "a"]},
        "reference_and_state_dof_names must not repeat elements, got ['a', 'a']",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("type_", "parameters", "message"),
    CASES,
    ids=[
        f"{t.partition('/')[0]}-{'-'.join(g)}-{i}" for i, (t, g, _) in enumerate(CASES)
    ],
)
def test_what_upstream_refuses_is_refused(
    type_: str, parameters: dict[str, Any], message: str
) -> None:
    # A parameter of later distros alone would be ignored in jazzy.
    distro = (
        "rolling" if "positions_upsampling.policy_frequency" in parameters else "jazzy"
    )

    with pytest.raises(ParameterError) as caught:
        load(type_, parameters, distro=distro)

    place = message if ": " in message.partition(" must ")[0] else f": {message}"
    line, values = caught.value.line, [*{**MINIMAL[type_], **parameters}]
    where = "c.yaml" if line is None else f"c.yaml:{line}"
    assert str(caught.value) == f"{where}: c{'' if place[0] == ':' else '.'}{place}"
    assert line is None or values[line - 1].rpartition(".")[2] in message


@pytest.mark.parametrize(
    ("type_", "name"),
    [
        (JTC, "joints"),
        (JTC, "command_interfaces"),
        (JTC, "state_interfaces"),
        (FORWARD, "joints"),
        (FORWARD, "interface_name"),
        *((group, "joints") for group in GROUPS),
        (MULTI, "joint"),
        (MULTI, "interface_names"),
        (GRIPPER, "joint"),
        (PID, "dof_names"),
        (PID, "command_interface"),
        (PID, "reference_and_state_interfaces"),
        (DIFF_DRIVE, "left_wheel_names"),
        (BICYCLE, "traction_joints_names"),
        (TRICYCLE, "traction_joint_name"),
        (MECANUM, "front_left_wheel_command_joint_name"),
        (OMNI, "wheel_offset"),
        (ADMITTANCE, "kinematics.base"),
        (GPIO, "gpios"),
        (FILTER, "input_interfaces"),
        (IMU, "frame_id"),
        (STATES, "interfaces"),
        (PASSTHROUGH, "interfaces"),
    ],
)
def test_what_has_no_default_is_required(type_: str, name: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load(type_, without=(name,))

    assert str(caught.value) == f"c.yaml: c.{name}: is required but missing"


@pytest.mark.parametrize(
    ("type_", "parameters", "message"),
    [
        (
            JTC,
            {"state_interfaces": ["position", "effort"]},
            "c.yaml:3: c.state_interfaces: expected one of "
            "['position', 'velocity', 'acceleration'], got 'effort'",
        ),
        (
            JTC,
            {"command_interfaces": ["bad_name"]},
            "c.yaml:2: c.command_interfaces: expected one of "
            "['position', 'velocity', 'acceleration', 'effort'], got 'bad_name'",
        ),
        (
            JTC,
            {"gains.a.antiwindup_strategy": "foo"},
            "c.yaml:4: c.gains.a.antiwindup_strategy: expected one of ['none', "
            "'conditional_integration', 'back_calculation', 'legacy'], got 'foo'",
        ),
        (
            ADMITTANCE,
            {"chainable_command_interfaces": ["effort"]},
            "c.yaml:4: c.chainable_command_interfaces: expected one of "
            "['position', 'velocity'], got 'effort'",
        ),
        (
            TRICYCLE,
            {"cmd_vel_timeout": 0.5},
            "c.yaml:5: c.cmd_vel_timeout: expected int, got 0.5",
        ),
    ],
)
def test_a_value_of_another_kind_is_refused(
    type_: str, parameters: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        load(type_, parameters)

    assert str(caught.value) == message


@pytest.mark.parametrize(
    "commands",
    [
        ["position"],
        ["position", "velocity"],
        ["position", "velocity", "acceleration"],
        ["velocity"],
        ["effort"],
        ["position", "effort"],
    ],
)
@pytest.mark.parametrize(
    "states", [["position", "velocity"], ["position", "velocity", "acceleration"]]
)
def test_what_upstream_takes_together_is_taken(
    commands: list[str], states: list[str]
) -> None:
    parameters = {"command_interfaces": commands, "state_interfaces": states}

    loaded = load(JTC, parameters)

    assert loaded.command_interfaces == tuple(commands)
    assert loaded.state_interfaces == tuple(states)


def test_gains_that_no_pid_has_are_of_no_harm_where_there_is_none() -> None:
    parameters = {"gains.a.u_clamp_max": -1.0, "gains.a.u_clamp_min": 1.0}

    assert load(JTC, parameters).gains.joint["a"].u_clamp_max == -1.0
