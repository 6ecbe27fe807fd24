"""Gazebo's DiffDrive against closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.gazebo.diff_drive import DiffDrive
from arm_drake.controllers.gazebo.drive import SpeedLimits
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Bool, Odometry, Twist, Vector3
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import commands, make_surroundings

COMMAND, ENABLE = "/model/arm/cmd_vel", "/model/arm/enable"
ODOMETRY, TF = "/model/arm/odometry", "/model/arm/tf"

SEPARATION, RADIUS = 0.5, 0.1

# Rounding alone, of values around 1.
EXACT = {"rel": 0.0, "abs": 1e-12}


def drive(
    left: tuple[str, ...] = ("l",),
    right: tuple[str, ...] = ("r",),
    *,
    rate: int = 1000,
    **fields: Any,
) -> Driven:
    fields = {"wheel_separation": SEPARATION, "wheel_radius": RADIUS, **fields}
    tag = gazebo_plugins.DiffDrive(left, right, **fields)
    params = make_surroundings(*dict.fromkeys((*left, *right)), rate=rate)
    return Driven(DiffDrive(tag, params))


def twist(v: float, w: float = 0.0) -> Twist:
    return Twist(Vector3(x=v), Vector3(z=w))


def move(driven: Driven, v: float, w: float = 0.0) -> list[float]:
    """Command a velocity, and return what the wheels are told."""
    driven.run({COMMAND: (twist(v, w),)})
    return list(commands(driven).values())


def base_speed(driven: Driven) -> tuple[float, float]:
    """Return the velocity that the wheels of the two sides make."""
    left, right = (value * RADIUS for value in driven.command_values)
    return (left + right) / 2.0, (right - left) / SEPARATION


def turn(driven: Driven, left: float, right: float, ticks: int) -> Odometry:
    """Let the wheels turn at constant speeds [rad/s] from 0 on, tick by tick."""
    dt = driven.system.params.period
    for k in range(ticks + 1):
        driven.measure([left * k * dt, right * k * dt])
        driven.run()
    message = driven.output(ODOMETRY)
    assert isinstance(message, Odometry)
    return message


def test_topics_are_called_as_in_gazebo() -> None:
    system = drive().system
    named = drive(topic="go", odom_topic="/where", tf_topic="frames").system

    assert system.message_types == {COMMAND: Twist, ENABLE: Bool}
    assert all(map(system.HasOutputPort, (ODOMETRY, TF)))
    assert named.message_types == {"/go": Twist, ENABLE: Bool}
    assert all(map(named.HasOutputPort, ("/where", "/frames")))


@pytest.mark.parametrize(("v", "w"), [(0.5, 0.0), (0.0, 0.8), (-0.3, 1.0)])
def test_all_wheels_of_a_side_turn_as_its_rim_moves(v: float, w: float) -> None:
    driven = drive(("l1", "l2"), ("r1", "r2", "r3"))

    left, right = (v - w * 0.25) / 0.1, (v + w * 0.25) / 0.1

    assert move(driven, v, w) == pytest.approx([left] * 2 + [right] * 3, **EXACT)
    assert driven.system.command_interfaces == (
        *("l1/velocity", "l2/velocity"),
        *("r1/velocity", "r2/velocity", "r3/velocity"),
    )


def test_a_wheel_of_both_sides_follows_the_right_one() -> None:
    assert move(drive(("a",), ("a",)), 0.0, 1.0) == pytest.approx([2.5], **EXACT)


@pytest.mark.slow
def test_wheels_rest_until_there_is_a_command_which_then_holds() -> None:
    driven = drive()
    driven.run()
    assert commands(driven) == {"l/velocity": 0.0, "r/velocity": 0.0}

    move(driven, 0.5)
    for _ in range(3000):
        driven.run()

    assert base_speed(driven) == pytest.approx((0.5, 0.0), **EXACT)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, (2.0, -3.0)),
        ({"max_velocity": 1.0}, (1.0, -3.0)),
        ({"max_velocity": 1.0, "min_velocity": -1.0}, (1.0, -1.0)),
        ({"max_velocity": 1.0, "max_linear_velocity": 1.5}, (1.5, -3.0)),
        ({"min_velocity": -1.0, "min_angular_velocity": -2.0}, (2.0, -2.0)),
        ({"max_angular_velocity": 1.0, "min_linear_velocity": -1.0}, (2.0, -3.0)),
        # Of a minimum above its maximum, the minimum holds.
        ({"max_linear_velocity": 1.0, "min_linear_velocity": 1.5}, (1.5, -3.0)),
    ],
)
def test_speeds_stay_within_their_limits(
    limits: dict[str, float], expected: tuple[float, float]
) -> None:
    driven = drive(**limits)

    move(driven, 2.0, -3.0)

    assert base_speed(driven) == pytest.approx(expected, **EXACT)


def test_accelerations_have_a_limit_each_way() -> None:
    driven = drive(rate=100, max_linear_acceleration=2.0, min_linear_acceleration=-5.0)

    up = [base_speed(driven)[0] for _ in range(30) if move(driven, 0.4)]
    down = [base_speed(driven)[0] for _ in range(30) if move(driven, -0.2)]

    steps = np.arange(1, 31)
    assert up == pytest.approx(np.minimum(0.02 * steps, 0.4), **EXACT)
    # Also beyond standstill, where ros2_control would take the other limit.
    assert down == pytest.approx(np.maximum(0.4 - 0.05 * steps, -0.2), **EXACT)


def test_turning_has_limits_of_its_own() -> None:
    driven = drive(rate=100, max_acceleration=1.0, max_angular_acceleration=3.0)

    move(driven, 1.0, 1.0)

    assert base_speed(driven) == pytest.approx((0.01, 0.03), **EXACT)


def test_a_jerk_limit_makes_the_speed_grow_by_squares() -> None:
    driven = drive(rate=100, max_jerk=4.0)

    speeds = [base_speed(driven)[0] for _ in range(10) if move(driven, 1.0)]

    # Accelerations 4 k dt, and their sum.
    steps = np.arange(1, 11)
    assert speeds == pytest.approx(4e-4 * steps * (steps + 1) / 2.0, **EXACT)


def test_a_jerk_limit_also_holds_while_the_acceleration_falls() -> None:
    limits = SpeedLimits(min_jerk=-10.0, max_jerk=10.0)

    # From an acceleration of 1 m/s^2 the target is only 0.1 mm/s away.
    speed = limits.limit(0.2001, 0.2, 0.19, 0.01)

    assert speed == pytest.approx(0.2 + (1.0 - 0.1) * 0.01, **EXACT)


def test_a_base_that_is_disabled_stops_and_takes_no_command() -> None:
    driven = drive()
    move(driven, 0.5)

    driven.run({ENABLE: (Bool(False),)})
    assert base_speed(driven) == (0.0, 0.0)
    move(driven, 0.6)
    assert base_speed(driven) == (0.0, 0.0)
    assert driven.reasons() == [f"{ENABLE} is false"]

    driven.run({ENABLE: (Bool(True),)})
    assert base_speed(driven) == (0.0, 0.0)
    move(driven, 0.7)
    assert base_speed(driven) == pytest.approx((0.7, 0.0), **EXACT)


@pytest.mark.parametrize(("v", "w"), [(math.nan, 0.0), (0.0, math.inf)])
def test_what_is_not_finite_is_dropped(v: float, w: float) -> None:
    driven = drive()
    move(driven, 0.5)

    move(driven, v, w)

    assert base_speed(driven) == pytest.approx((0.5, 0.0), **EXACT)
    (reason,) = driven.reasons()
    assert reason == "linear.x and angular.z must be finite; the message is dropped"


def test_a_deactivation_stops_the_base_until_a_new_command() -> None:
    driven = drive()
    move(driven, 0.5)

    driven.run(activation=None)
    assert base_speed(driven) == (0.0, 0.0)
    driven.run({COMMAND: (twist(0.6),)}, activation=None)
    assert driven.reasons() == ["the controller is not active"]
    driven.run(activation=2)

    assert base_speed(driven) == (0.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("left", "right"), [(3.0, 3.0), (-2.0, -2.0), (-2.0, 2.0), (1.0, 4.0), (4.0, -1.0)]
)
def test_odometry_is_the_arc_of_constant_wheel_speeds(
    left: float, right: float
) -> None:
    message = turn(drive(rate=100), left, right, 300)

    t = 3.0
    v, w = (left + right) / 2.0 * RADIUS, (right - left) * RADIUS / SEPARATION
    x = v / w * math.sin(w * t) if w else v * t
    y = v / w * (1.0 - math.cos(w * t)) if w else 0.0
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    assert (position.x, position.y) == pytest.approx((x, y), **EXACT)
    expected = (math.sin(w * t / 2.0), math.cos(w * t / 2.0))
    assert (orientation.z, orientation.w) == pytest.approx(expected, **EXACT)
    velocity = message.twist.twist
    # Differences of angles around 10 rad over 10 ms.
    assert (velocity.linear.x, velocity.angular.z) == pytest.approx((v, w), abs=1e-11)


def test_published_velocities_are_means_of_ten_ticks() -> None:
    driven = drive(rate=50)
    turn(driven, 0.0, 0.0, 20)

    speeds = []
    for k in range(1, 13):
        driven.measure([0.4 * k, 0.4 * k])
        driven.run()
        speeds.append(driven.output(ODOMETRY).twist.twist.linear.x)

    # Ticks of 0.04 m in 20 ms: 2 m/s.
    expected = 2.0 * np.minimum(np.arange(1, 13) / 10.0, 1.0)
    assert speeds == pytest.approx(expected, **EXACT)


def test_odometry_counts_the_first_wheel_of_each_side_from_the_angle_0() -> None:
    driven = drive(("l1", "l2"), ("r1", "r2"), rate=100)
    driven.measure([1.0, 50.0, 1.0, 70.0])
    driven.run()

    for _ in range(2):
        driven.run()

    assert driven.output(ODOMETRY).pose.pose.position.x == pytest.approx(0.1, **EXACT)


@pytest.mark.parametrize(
    ("fields", "stamps"),
    [
        ({}, [20, 40, 60]),
        ({"odom_publish_frequency": 30.0}, [34, 68]),
        ({"odom_publish_frequency": 0.0}, list(range(1, 70))),
        ({"odom_publish_frequency": 1e6}, list(range(1, 70))),
    ],
)
def test_odometry_comes_at_its_frequency(
    fields: dict[str, float], stamps: list[int]
) -> None:
    driven = drive(**fields)
    seen = []

    for _ in range(70):
        driven.run()
        message = driven.output(ODOMETRY)
        if message != Odometry():
            seen.append(message.header.stamp.to_nanoseconds() // 1_000_000)

    # The first tick is at 0, where Gazebo begins to count.
    assert list(dict.fromkeys(seen)) == stamps


def test_frames_are_called_as_in_gazebo_or_as_the_tag_says() -> None:
    plain = turn(drive(base_link="base"), 0.0, 0.0, 20)
    named = drive(base_link="base", frame_id="odom", child_frame_id="foot")
    message = turn(named, 1.0, 2.0, 20)

    assert (plain.header.frame_id, plain.child_frame_id) == ("arm/odom", "arm/base")
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "foot")
    (frame,) = named.output(TF).transforms
    assert (frame.header, frame.child_frame_id) == (message.header, "foot")
    position = message.pose.pose.position
    assert (frame.transform.translation.x, frame.transform.translation.y) == (
        position.x,
        position.y,
    )
    assert frame.transform.rotation == message.pose.pose.orientation


def test_before_the_first_odometry_the_topics_are_empty() -> None:
    driven = drive()

    driven.run()

    assert driven.output(ODOMETRY) == Odometry()
    assert driven.output(TF).transforms == ()
