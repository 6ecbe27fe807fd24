"""The distros differ as ros2_controllers' versions do, row by row: F1 to F43.

The rows are those of a list of differences between humble and rolling; what each row
says stands above its check.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest

from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.description.parameters import DISTROS
from arm_drake.errors import ParameterError
from tests.controllers.parameters import (
    ACKERMANN,
    BICYCLE,
    DIFF_DRIVE,
    EFFORT_GRIPPER,
    GRIPPER,
    GROUPS,
    JSB,
    JTC,
    PID,
    TRICYCLE,
    TRICYCLE_STEERING,
    WRENCH,
    flat,
    load,
    report_of,
)
from tests.controllers.test_distros_running import CHECKS as IN_MOTION

Check = Callable[[str], None]
CHECKS: dict[str, Check] = {}

# Rows that say nothing of a controller's parameters, and where they belong.
RUNNING = "test_distros_running"
ELSEWHERE = {
    **dict.fromkeys(
        ("F8", "F10", "F11", "F11b", "F31", "F32", "F34", "F36", "F37", "F43"), RUNNING
    ),
    "F24": "command before the first message: the diff drive isn't simulated yet",
    "F33": "parameter of the controller manager: description/controllers",
    "F35": "mimic joints: description/ros2_control",
    "F38": "names of Gazebo plugins: description/ros2_control",
    "F39": "Gazebo's position mode: the servo",
    "F40": "type in the controller's own section: description/controllers",
}

# Rows of parameters alone; test_distros_running has the others.
NOT_RUNNING = {
    "F17": "such a controller does not load",
    "F18": "nor does such a one in humble; others are rows V37 to V40",
    **dict.fromkeys(("F19", "F20", "F21", "F22", "F23"), "the diff drive"),
    **dict.fromkeys(("F25", "F42"), "steered robots"),
    "F28": "grippers",
    "F41": "the broadcaster of forces and torques",
}


def row(name: str) -> Callable[[Check], Check]:
    """Return a decorator that makes a function the check of a row."""

    def register(check: Check) -> Check:
        assert name not in CHECKS
        CHECKS[name] = check
        return check

    return register


def value(type_: str, name: str, parameters: dict[str, Any], distro: str) -> Any:
    return dict(flat(load(type_, parameters, distro=distro)))[name]


def limits(parameters: dict[str, Any], distro: str) -> dict[str, float]:
    """Return those of the diff drive's limits forwards that are on."""
    named = {f"linear.x.{name}": number for name, number in parameters.items()}
    loaded = flat(load(DIFF_DRIVE, named, distro=distro))
    return {
        name.removeprefix("linear.x."): number
        for name, number in loaded
        if name.startswith("linear.x.") and not math.isnan(number)
    }


# open_loop_control -> interpolate_from_desired_state.
@row("F1")
def check_open_loop_control(distro: str) -> None:
    name = "interpolate_from_desired_state"

    assert value(JTC, name, {"open_loop_control": True}, distro) is True
    assert value(JTC, name, {name: True}, distro) is True
    assert report_of(JTC, {"open_loop_control": True}, distro=distro) == [
        f"info: open_loop_control: older parameter; later: {name}: True; taken as that"
    ]
    assert report_of(JTC, {name: True}, distro=distro) == (
        [f"warning: {name}: a parameter since jazzy only, not of humble; it is taken"]
        if distro == "humble"
        else []
    )


# Only humble's open loop switches the PID of velocity commands off.
@row("F2")
def check_open_loop_without_pid(distro: str) -> None:
    parameters = {"open_loop_control": True}

    is_open_loop = value(JTC, "open_loop_control", parameters, distro)

    assert is_open_loop is (distro == "humble")


@row("F3")
def check_velocity_at_the_end(distro: str) -> None:
    name = "allow_nonzero_velocity_at_trajectory_end"

    assert value(JTC, name, {}, distro) is (distro == "humble")
    assert value(JTC, name, {name: True}, distro) is True
    assert value(JTC, name, {name: False}, distro) is False


# Accepted, and ignored after humble.
@row("F4")
def check_state_publish_rate(distro: str) -> None:
    parameters = {"state_publish_rate": 100.0}

    rate = value(JTC, "state_publish_rate", parameters, distro)

    assert rate == (100.0 if distro == "humble" else 50.0)
    assert report_of(JTC, parameters, distro=distro) == (
        []
        if distro == "humble"
        else [
            "info: state_publish_rate: a parameter up to humble only, not of "
            f"{distro}; it has no effect"
        ]
    )


# Used by humble alone, later the joint's type decides; normalize_error is older still.
@row("F5")
def check_angle_wraparound(distro: str) -> None:
    name = "gains.a.angle_wraparound"
    velocity = {"command_interfaces": ["velocity"]}
    decides = "the joint's type 'continuous' decides"

    for old in (name, "gains.a.normalize_error"):
        is_wrapped = value(JTC, name, {**velocity, old: True}, distro)
        assert is_wrapped is (distro == "humble")
    lines = report_of(JTC, {**velocity, name: True}, distro=distro)
    assert lines == (
        []
        if distro == "humble"
        else [
            f"warning: {name}: a parameter up to humble only, not of {distro}; it has "
            f"no effect: {decides}"
        ]
    )


# Humble's default 0 switches the integral off; everywhere c becomes -c and c.
@row("F6")
def check_i_clamp(distro: str) -> None:
    default = 0.0 if distro == "humble" else math.inf
    for type_ in (JTC, PID):
        loaded = dict(flat(load(type_, distro=distro)))
        assert loaded["gains.a.i_clamp_max"] == default
        assert loaded["gains.a.i_clamp_min"] == -default

        loaded = dict(flat(load(type_, {"gains.a.i_clamp": 2.5}, distro=distro)))
        assert loaded["gains.a.i_clamp_max"] == 2.5
        assert loaded["gains.a.i_clamp_min"] == -2.5
    assert report_of(PID, {"gains.a.i_clamp": 2.5}, distro=distro) == [
        "info: gains.a.i_clamp: older parameter; later: i_clamp_max: 2.5, "
        "i_clamp_min: -2.5; taken as that"
    ]


# A bool in humble, "legacy" by default in jazzy, "none" later.
@row("F7")
def check_antiwindup(distro: str) -> None:
    strategy, stored = "gains.a.antiwindup_strategy", "gains.a.antiwindup"
    is_new = distro in ("kilted", "rolling")

    assert value(PID, strategy, {}, distro) == ("none" if is_new else "legacy")
    for is_clamped in (False, True):
        loaded = dict(flat(load(PID, {stored: is_clamped}, distro=distro)))
        assert loaded[strategy] == "legacy"
        assert loaded[stored] is is_clamped
    assert len(report_of(PID, {stored: True}, distro=distro)) == is_new

    # Humble doesn't know strategies, and later ones don't know this one.
    parameters = {strategy: "conditional_integration"}
    taken = "legacy" if distro == "humble" else "conditional_integration"
    assert value(PID, strategy, parameters, distro) == taken
    assert value(PID, strategy, {strategy: "legacy"}, distro) == "legacy"
    assert len(report_of(PID, {strategy: "legacy"}, distro=distro)) == is_new


# Humble's PID has no limits of its output; saturation: false takes them off.
@row("F9")
def check_output_limits(distro: str) -> None:
    name = "gains.a.u_clamp_max"
    parameters = {name: 2.0}

    limit = value(PID, name, parameters, distro)
    assert limit == (math.inf if distro == "humble" else 2.0)
    unlimited = {**parameters, "gains.a.saturation": False}
    assert value(PID, name, unlimited, distro) == math.inf
    assert len(report_of(PID, unlimited, distro=distro)) == 1


# Humble commands efforts alone only.
@row("F12")
def check_position_and_effort(distro: str) -> None:
    parameters = {"command_interfaces": ["position", "effort"]}

    if distro != "humble":
        loaded = load(JTC, parameters, distro=distro)
        assert loaded.command_interfaces == ("position", "effort")
        return
    with pytest.raises(ParameterError) as caught:
        load(JTC, parameters, distro=distro)
    assert str(caught.value) == (
        "c.yaml:2: c.command_interfaces: humble takes 'effort' alone only, "
        "got ['position', 'effort']"
    )


# In all of them, by back-ports.
@row("F13")
def check_speed_scaling(distro: str) -> None:
    name = "speed_scaling.initial_scaling_factor"

    assert value(JTC, name, {}, distro) == 1.0
    assert value(JTC, name, {name: 0.5}, distro) == 0.5
    assert report_of(JTC, {name: 0.5}, distro=distro) == []


# Rolling alone blends trajectories, and does so by default.
@row("F14")
def check_trajectory_replacement(distro: str) -> None:
    name = "allow_trajectory_replacement"
    is_rolling = distro == "rolling"

    assert value(JTC, name, {}, distro) is is_rolling
    assert value(JTC, name, {name: True}, distro) is is_rolling
    assert value(JTC, name, {name: False}, distro) is False
    lines = report_of(JTC, {name: True}, distro=distro)
    assert lines == (
        []
        if is_rolling
        else [
            f"warning: {name}: a parameter since rolling only, not of {distro}; it has "
            "no effect"
        ]
    )


# Rolling alone.
@row("F15")
def check_positions_upsampling(distro: str) -> None:
    name = "positions_upsampling.enable"

    assert value(JTC, name, {}, distro) is False
    assert value(JTC, name, {name: True}, distro) is (distro == "rolling")
    assert len(report_of(JTC, {name: True}, distro=distro)) == (distro != "rolling")


# Not in humble.
@row("F16")
def check_decelerate_on_cancel(distro: str) -> None:
    parameters = {
        "constraints.decelerate_on_cancel": True,
        "constraints.a.max_deceleration_on_cancel": 2.0,
    }

    loaded = dict(flat(load(JTC, parameters, distro=distro)))

    is_known = distro != "humble"
    assert loaded["constraints.decelerate_on_cancel"] is is_known
    assert loaded["constraints.a.max_deceleration_on_cancel"] == 2.0 * is_known
    assert len(report_of(JTC, parameters, distro=distro)) == (0 if is_known else 2)


# Humble only warns, but such a controller moves nothing: it doesn't run here either.
@row("F17")
def check_no_joints(distro: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load(JTC, {"joints": []}, distro=distro)

    assert str(caught.value) == "c.yaml:1: c: joints must have at least one element"


# Humble asks for as many as joints.
@row("F18")
def check_command_joints(distro: str) -> None:
    parameters = {"command_joints": ["b"]}

    assert load(JTC, {"command_joints": ["x", "y"]}, distro=distro)
    if distro != "humble":
        assert load(JTC, parameters, distro=distro).command_joints == ("b",)
        return
    with pytest.raises(ParameterError) as caught:
        load(JTC, parameters, distro=distro)
    assert str(caught.value) == (
        "c.yaml:4: c.command_joints: humble takes as many as joints only, got ['b']"
    )


# Taken in every distro: both inputs can be offered.
def check_stamped(type_: str, distro: str) -> None:
    name = "use_stamped_vel"

    assert value(type_, name, {}, distro) is True
    assert value(type_, name, {name: False}, distro) is False
    lines = report_of(type_, {name: False}, distro=distro)
    assert [line for line in lines if name in line] == (
        []
        if distro == "humble"
        else [
            f"info: {name}: a parameter up to humble only, not of {distro}; it is taken"
        ]
    )


@row("F19")
def check_stamped_diff_drive(distro: str) -> None:
    check_stamped(DIFF_DRIVE, distro)


# has_*_limits switch limits on in humble, must fit in jazzy, and are ignored later.
@row("F20")
def check_has_limits(distro: str) -> None:
    parameters = {"max_velocity": 1.0, "max_jerk": 3.0, "min_jerk": -3.0}

    for kind in ("velocity", "jerk"):
        on = {name: number for name, number in parameters.items() if kind in name}
        assert limits(on, distro) == ({} if distro == "humble" else on)
        # Up to kilted the older switch is known.
        switched = limits({**on, f"has_{kind}_limits": False}, distro)
        assert switched == (on if distro == "rolling" else {})
        assert limits({**on, f"has_{kind}_limits": True}, distro) == on
    if distro in ("kilted", "rolling"):
        assert limits({"has_velocity_limits": True}, distro) == {}
        return
    with pytest.raises(ParameterError) as caught:
        limits({"has_velocity_limits": True}, distro)
    assert str(caught.value) == (
        "c.yaml:5: c.linear.x.has_velocity_limits: needs max_velocity, which is not "
        "given"
    )


# min_acceleration becomes max_deceleration and max_acceleration_reverse, negative.
@row("F21")
def check_deceleration(distro: str) -> None:
    both = {"max_deceleration": -2.0, "max_acceleration_reverse": -2.0}
    gate = {"has_acceleration_limits": True} if distro == "humble" else {}
    pair = {"max_acceleration": 1.0, **gate}

    old = {**pair, "min_acceleration": -2.0}
    assert limits(old, distro) == {"max_acceleration": 1.0, **both}
    assert limits({**pair, "max_deceleration": 2.0}, distro) == {
        "max_acceleration": 1.0,
        **({} if distro == "humble" else {"max_deceleration": -2.0}),
    }
    # Of either sign, as the pair is for either direction.
    assert limits({**old, "min_acceleration": 2.0}, distro) == limits(old, distro)
    (line,) = report_of(DIFF_DRIVE, {"linear.x.max_deceleration": 2.0}, distro=distro)
    assert line == "warning: linear.x.max_deceleration: " + (
        "a parameter since jazzy only, not of humble; it has no effect"
        if distro == "humble"
        else "must be at most 0, got 2.0; taken as -2.0"
    )


# Gone in rolling.
@row("F22")
def check_publish_rate(distro: str) -> None:
    parameters = {"publish_rate": 20.0}
    is_known = distro != "rolling"

    rate = value(DIFF_DRIVE, "publish_rate", parameters, distro)
    assert rate == (20.0 if is_known else 50.0)
    assert len(report_of(DIFF_DRIVE, parameters, distro=distro)) == (not is_known)


# Of humble alone.
@row("F23")
def check_wheels_per_side(distro: str) -> None:
    parameters = {"wheels_per_side": 2}
    is_known = distro == "humble"

    assert value(DIFF_DRIVE, "wheels_per_side", parameters, distro) == 2 * is_known
    assert len(report_of(DIFF_DRIVE, parameters, distro=distro)) == (not is_known)


OF_FRONT_AND_REAR: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    # What is given; what is loaded if the front steers, and if the rear does.
    BICYCLE: (
        {"front_wheel_radius": 0.2, "rear_wheel_radius": 0.4},
        {"traction_wheel_radius": 0.4},
        {"traction_wheel_radius": 0.2},
    ),
    TRICYCLE_STEERING: (
        {"front_wheels_radius": 0.2, "rear_wheels_radius": 0.4, "wheel_track": 0.7},
        {"traction_wheels_radius": 0.4, "traction_track_width": 0.7},
        {"traction_wheels_radius": 0.2, "traction_track_width": 0.7},
    ),
    ACKERMANN: (
        {
            "front_wheels_radius": 0.2,
            "rear_wheels_radius": 0.4,
            "front_wheel_track": 0.6,
            "rear_wheel_track": 0.8,
        },
        {
            "traction_wheels_radius": 0.4,
            "traction_track_width": 0.8,
            "steering_track_width": 0.6,
        },
        {
            "traction_wheels_radius": 0.2,
            "traction_track_width": 0.6,
            "steering_track_width": 0.8,
        },
    ),
}
NEWER = (
    "traction_joints_names",
    "steering_joints_names",
    "traction_wheel_radius",
    "traction_wheels_radius",
    "traction_track_width",
)


# Front and rear become traction and steering, in every distro.
@row("F25")
def check_steering_names(distro: str) -> None:
    for type_, (measures, if_front, if_rear) in OF_FRONT_AND_REAR.items():
        counts = CONTROLLER_TYPES[type_].parameters.wheels
        for steers_front, expected in ((True, if_front), (False, if_rear)):
            ends = ("rear", "front") if steers_front else ("front", "rear")
            names = [
                [f"{use}{k}" for k in range(count)]
                for use, count in zip(("driven", "steered"), counts, strict=True)
            ]
            parameters = {
                **measures,
                **{f"{e}_wheels_names": n for e, n in zip(ends, names, strict=True)},
                f"{ends[0]}_wheels_state_names": names[0],
                "front_steering": steers_front,
            }

            loaded = dict(flat(load(type_, parameters, distro=distro, without=NEWER)))

            assert loaded["traction_joints_names"] == tuple(names[0])
            assert loaded["traction_joints_state_names"] == tuple(names[0])
            assert loaded["steering_joints_names"] == tuple(names[1])
            assert expected.items() <= loaded.items()
            # The front steers where nothing is said.
            if steers_front:
                del parameters["front_steering"]
                same = load(type_, parameters, distro=distro, without=NEWER)
                assert dict(flat(same)) == loaded
    check_stamped(ACKERMANN, distro)

    lines = report_of(ACKERMANN, {"front_steering": False}, distro=distro)
    line = "info: front_steering: a parameter of humble; front wheels are the traction"
    assert (f"{line} joints" in lines) is (distro != "humble")

    # The newer names in humble, and a left joint before a right one.
    joints = {"steering_joints_names": ["left", "right"]}
    lines = report_of(ACKERMANN, joints, distro=distro)
    swapped = (
        "warning: steering_joints_names: the right joint comes first, got "
        "['left', 'right']; taken as written: left and right are swapped"
    )
    assert lines == [
        swapped,
        *(
            f"warning: {name}: a parameter since jazzy only, not of humble; it is taken"
            for name in NEWER[:2]
            if distro == "humble"
        ),
    ]


# Off unless enabled up to jazzy; later the gain alone decides.
@row("F26")
def check_feedforward(distro: str) -> None:
    name = "enable_feedforward"
    is_old = distro in ("humble", "jazzy")

    assert value(PID, name, {}, distro) is not is_old
    assert value(PID, name, {name: True}, distro) is True
    assert value(PID, name, {name: False}, distro) is not is_old
    assert report_of(PID, {name: False}, distro=distro) == (
        []
        if is_old
        else [
            f"warning: {name}: a parameter up to jazzy only, not of {distro}; it has "
            "no effect: feedforward_gain decides"
        ]
    )


# Kept where they are gone.
@row("F27")
def check_groups(distro: str) -> None:
    for type_ in GROUPS:
        assert load(type_, distro=distro).joints == ("a", "b")


# Kept where they are gone.
@row("F28")
def check_grippers(distro: str) -> None:
    for type_ in (GRIPPER, EFFORT_GRIPPER):
        assert load(type_, distro=distro).joint == "a"


# Rolling publishes none.
@row("F29")
def check_dynamic_joint_states(distro: str) -> None:
    name = "publish_dynamic_joint_states"
    is_known = distro != "rolling"

    assert value(JSB, name, {}, distro) is is_known
    assert value(JSB, name, {name: True}, distro) is is_known
    assert len(report_of(JSB, {name: True}, distro=distro)) == (not is_known)


@row("F30")
def check_frame_id(distro: str) -> None:
    frame = "base_link" if distro == "rolling" else ""

    assert value(JSB, "frame_id", {}, distro) == frame
    assert value(JSB, "frame_id", {"frame_id": "world"}, distro) == "world"


# Humble has a sensor or interfaces only.
@row("F41")
def check_wrench(distro: str) -> None:
    parameters = {
        "offset.force.x": 1.5,
        "multiplier.torque.z": 2.0,
        "sensor_filter_chain.filter1.name": "low_pass",
    }

    loaded = dict(flat(load(WRENCH, parameters, distro=distro)))

    is_known = distro != "humble"
    assert loaded["offset.force.x"] == 1.5 * is_known
    assert loaded["multiplier.torque.z"] == (2.0 if is_known else 1.0)
    chain = {"filter1.name": "low_pass"} if is_known else {}
    assert loaded["sensor_filter_chain"] == chain
    assert len(report_of(WRENCH, parameters, distro=distro)) == (0 if is_known else 3)


@row("F42")
def check_stamped_tricycle(distro: str) -> None:
    check_stamped(TRICYCLE, distro)


@pytest.mark.parametrize("distro", DISTROS)
@pytest.mark.parametrize("name", CHECKS)
def test_a_row_holds(name: str, distro: str) -> None:
    CHECKS[name](distro)


def test_every_row_is_checked_here_or_elsewhere() -> None:
    rows = {f"F{number}" for number in range(1, 44)} | {"F11b"}

    assert CHECKS.keys() | ELSEWHERE.keys() == rows
    assert not CHECKS.keys() & ELSEWHERE.keys()


def test_every_row_of_a_simulated_controller_runs() -> None:
    elsewhere = {name for name, where in ELSEWHERE.items() if where != RUNNING}

    assert IN_MOTION.keys() == {*CHECKS, *ELSEWHERE} - NOT_RUNNING.keys() - elsewhere


def test_a_name_that_no_distro_has_is_reported_with_the_nearest() -> None:
    for distro in DISTROS:
        assert report_of(JTC, {"action_monitor_rat": 20.0}, distro=distro) == [
            "warning: action_monitor_rat: unknown parameter; did you mean "
            "'action_monitor_rate'?; it has no effect"
        ]
