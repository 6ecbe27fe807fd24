"""Gazebo's MecanumDrive against closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.gazebo.mecanum_drive import MecanumDrive
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Odometry, Twist, Vector3
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import make_surroundings

COMMAND = "/model/arm/cmd_vel"
ODOMETRY, TF = "/model/arm/odometry", "/model/arm/tf"

SEPARATION, BASE, RADIUS = 0.3, 0.5, 0.1

# Half of both distances [m].
REACH = 0.4

# Rounding alone, of values around 1.
EXACT = {"rel": 0.0, "abs": 1e-12}

CORNERS = (("fl",), ("fr",), ("bl",), ("br",))


def drive(*corners: tuple[str, ...], rate: int = 1000, **fields: Any) -> Driven:
    corners = corners or CORNERS
    measures = {"wheel_separation": SEPARATION, "wheelbase": BASE}
    tag = gazebo_plugins.MecanumDrive(
        *corners, **{**measures, "wheel_radius": RADIUS, **fields}
    )
    joints = dict.fromkeys(joint for corner in corners for joint in corner)
    return Driven(MecanumDrive(tag, make_surroundings(*joints, rate=rate)))


def move(driven: Driven, x: float, y: float, w: float) -> list[float]:
    """Command a velocity, and return what the wheels are told."""
    driven.run({COMMAND: (Twist(Vector3(x=x, y=y), Vector3(z=w)),)})
    values: list[float] = driven.command_values.tolist()
    return values


def turn(driven: Driven, speeds: list[float], ticks: int) -> Odometry:
    """Let the wheels turn at constant speeds [rad/s] from 0 on, tick by tick."""
    for k in range(ticks + 1):
        driven.measure(np.array(speeds) * k * driven.system.params.period)
        driven.run()
    message = driven.output(ODOMETRY)
    assert isinstance(message, Odometry)
    return message


def planar(message: Odometry) -> list[float]:
    """Return x, y [m] and yaw [rad]."""
    place, turned = message.pose.pose.position, message.pose.pose.orientation
    return [place.x, place.y, 2.0 * math.atan2(turned.z, turned.w)]


def test_topics_are_called_as_in_gazebo() -> None:
    system = drive().system
    named = drive(topic="go", odom_topic="/where", tf_topic="frames").system

    assert system.message_types == {COMMAND: Twist}
    assert all(map(system.HasOutputPort, (ODOMETRY, TF)))
    assert named.message_types == {"/go": Twist}
    assert all(map(named.HasOutputPort, ("/where", "/frames")))


@pytest.mark.parametrize(
    ("velocity", "wheels"),
    [
        ((0.5, 0.0, 0.0), [5.0, 5.0, 5.0, 5.0]),
        ((0.0, 0.5, 0.0), [-5.0, 5.0, 5.0, -5.0]),
        ((0.0, 0.0, 1.0), [-4.0, 4.0, -4.0, 4.0]),
        ((0.1, -0.2, 0.5), [1.0, 1.0, -3.0, 5.0]),
    ],
)
def test_wheels_turn_as_the_rollers_let_them(
    velocity: tuple[float, float, float], wheels: list[float]
) -> None:
    assert move(drive(), *velocity) == pytest.approx(wheels, **EXACT)


def test_all_wheels_of_a_corner_turn_alike_and_the_last_corner_has_a_shared_one() -> (
    None
):
    driven = drive(("a", "b"), ("c",), ("d",), ("b",))

    assert move(driven, 0.0, 0.5, 0.0) == pytest.approx([-5.0, -5.0, 5.0, 5.0], **EXACT)
    names = ("a/velocity", "b/velocity", "c/velocity", "d/velocity")
    assert driven.system.command_interfaces == names


def test_both_linear_velocities_have_the_same_limits() -> None:
    driven = drive(max_velocity=1.0, min_linear_velocity=-0.2, max_angular_velocity=0.5)

    # Forwards 1, to the right 0.2, turning 0.5 times the reach of 0.4.
    found = move(driven, 9.0, -9.0, 9.0)

    assert found == pytest.approx([10.0, 10.0, 6.0, 14.0], **EXACT)


def test_accelerations_are_limited_tick_by_tick() -> None:
    driven = drive(rate=100, max_linear_acceleration=2.0, min_linear_acceleration=-1.0)

    sideways = [move(driven, 0.0, 1.0, 0.0)[1] * RADIUS for _ in range(3)]
    slower = move(driven, 0.0, 0.0, 0.0)[1] * RADIUS

    assert sideways == pytest.approx([0.02, 0.04, 0.06], **EXACT)
    assert slower == pytest.approx(0.05, **EXACT)


def test_the_last_command_holds_for_ever() -> None:
    driven = drive(rate=10)
    move(driven, 0.0, 0.5, 0.0)

    for _ in range(100):
        driven.run()

    np.testing.assert_allclose(driven.command_values, [-5.0, 5.0, 5.0, -5.0])


@pytest.mark.parametrize("velocity", [(0.4, 0.0, 0.5), (0.0, 0.4, 0.5), (0.3, 0.4, 1)])
def test_the_odometry_goes_round_a_circle(
    velocity: tuple[float, float, float],
) -> None:
    driven = drive(rate=100)
    x, y, w = velocity
    speeds = [(x - y - w * REACH), (x + y + w * REACH)]
    speeds += [(x + y - w * REACH), (x - y + w * REACH)]

    message = turn(driven, [v / RADIUS for v in speeds], 200)

    # The frame turns by w t about a point that is (-y, x) / w from its start.
    angle = 2.0 * w
    sin, cos = math.sin(angle), math.cos(angle)
    wanted = [(x * sin + y * (cos - 1.0)) / w, (y * sin - x * (cos - 1.0)) / w]
    assert planar(message)[:2] == pytest.approx(wanted, abs=1e-12)
    assert planar(message)[2] == pytest.approx(angle, abs=1e-12)
    twist = message.twist.twist
    found = (twist.linear.x, twist.linear.y, twist.angular.z)
    assert found == pytest.approx(velocity, abs=1e-12)


def test_the_odometry_goes_straight_across() -> None:
    message = turn(drive(rate=100), [-4.0, 4.0, 4.0, -4.0], 100)

    assert planar(message) == pytest.approx([0.0, 0.4, 0.0], abs=1e-12)


def test_the_odometry_is_published_at_its_frequency_with_its_frames() -> None:
    driven = drive(rate=1000, odom_publish_frequency=100.0, base_link="trunk")
    message = turn(driven, [1.0] * 4, 19)
    named = drive(frame_id="o", child_frame_id="b", odom_publish_frequency=0.0)
    every = turn(named, [1.0] * 4, 3)

    assert message.header.stamp.to_nanoseconds() == 10_000_000
    assert (message.header.frame_id, message.child_frame_id) == (
        "arm/odom",
        "arm/trunk",
    )
    assert every.header.stamp.to_nanoseconds() == 3_000_000
    assert (every.header.frame_id, every.child_frame_id) == ("o", "b")
    (frame,) = named.output(TF).transforms
    assert frame.transform.translation.x == pytest.approx(0.003 * RADIUS, **EXACT)


def test_a_message_that_is_not_finite_is_dropped() -> None:
    driven = drive()
    move(driven, 0.0, 0.5, 0.0)

    after = move(driven, 0.0, math.nan, 0.0)

    assert after == pytest.approx([-5.0, 5.0, 5.0, -5.0], **EXACT)
    assert driven.reasons() == [
        "linear.x, linear.y and angular.z must be finite; the message is dropped"
    ]
