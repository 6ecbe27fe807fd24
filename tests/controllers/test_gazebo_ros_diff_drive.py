"""The drive of Gazebo Classic against closed forms."""

import dataclasses as dc
import math
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake.controllers.gazebo.diff_drive import GazeboRosDiffDrive
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Odometry, TFMessage, Twist, Vector3
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import commands, make_surroundings

# Rounding alone, of values around 1.
EXACT = {"rel": 0.0, "abs": 1e-12}

# The default measures [m].
SEPARATION, RADIUS = 0.34, 0.075

LINKS = ("base", "left_wheel", "right_wheel")


def drive(
    left: tuple[str, ...] = ("l",),
    right: tuple[str, ...] = ("r",),
    *,
    rate: int = 1000,
    **fields: Any,
) -> Driven:
    tag = gazebo_plugins.GazeboRosDiffDrive(
        left,
        right,
        len(left),
        base_link="base",
        wheel_links=(("base", "right_wheel"), ("base", "left_wheel")),
        **{"publish_odom": True, "odometry_source": 0, **fields},
    )
    params = make_surroundings(*dict.fromkeys((*left, *right)), rate=rate)
    return Driven(GazeboRosDiffDrive(tag, dc.replace(params, links=LINKS)))


def move(driven: Driven, v: float, w: float = 0.0, ticks: int = 1) -> None:
    driven.run({"/cmd_vel": (Twist(Vector3(x=v), Vector3(z=w)),)})
    for _ in range(ticks - 1):
        driven.run()


def rims(driven: Driven) -> list[float]:
    return [float(value) * RADIUS for value in driven.command_values]


def stand(driven: Driven, *poses: RigidTransform) -> None:
    """Run a cycle with the links at these poses."""
    driven.run({"link_frames": AbstractValue.Make(list(poses))})


def at(x: float, y: float, yaw: float) -> RigidTransform:
    return RigidTransform(RollPitchYaw(0.0, 0.0, yaw), [x, y, 0.1])


def velocity(message: Odometry) -> tuple[float, float, float]:
    twist = message.twist.twist
    return twist.linear.x, twist.linear.y, twist.angular.z


def test_wheels_of_each_pair_turn_as_their_rims_move() -> None:
    driven = drive(
        ("l1", "l2"),
        ("r1", "r2"),
        update_rate=0.0,
        wheel_separation=(0.6,),
        wheel_diameter=(0.2, 0.4),
    )

    move(driven, 0.5, 0.8)

    assert commands(driven) == pytest.approx(
        {
            "l1/velocity": (0.5 - 0.8 * 0.3) / 0.1,
            "r1/velocity": (0.5 + 0.8 * 0.3) / 0.1,
            # The separation that isn't given.
            "l2/velocity": (0.5 - 0.8 * 0.17) / 0.2,
            "r2/velocity": (0.5 + 0.8 * 0.17) / 0.2,
        },
        **EXACT,
    )


@pytest.mark.parametrize(("rate", "ticks"), [(100.0, 10), (30.0, 34), (1000.0, 1)])
def test_wheels_are_told_at_the_update_rate(rate: float, ticks: int) -> None:
    driven = drive(update_rate=rate)

    driven.run()
    speeds = []
    for _ in range(2 * ticks):
        move(driven, 0.5)
        speeds.append(rims(driven)[0])

    assert speeds == pytest.approx([0.0] * (ticks - 1) + [0.5] * (ticks + 1), **EXACT)


@pytest.mark.slow
def test_the_last_command_holds() -> None:
    driven = drive()

    move(driven, 0.5, ticks=3000)

    assert rims(driven) == pytest.approx([0.5, 0.5], **EXACT)


def test_each_wheel_accelerates_at_its_limit() -> None:
    driven = drive(rate=100, max_wheel_acceleration=2.0)
    driven.run()
    seen = []

    for _ in range(40):
        # The wheels are as fast as they were told.
        driven.measure([0.0, 0.0, *driven.command_values])
        move(driven, 0.25, -1.0)
        seen.append(rims(driven))

    # The left rim goes to 0.42, the right one to 0.08 m/s.
    steps = 0.02 * np.arange(1, 41)
    targets = 0.25 + 0.5 * SEPARATION, 0.25 - 0.5 * SEPARATION
    expected = np.column_stack([np.minimum(steps, target) for target in targets])
    np.testing.assert_allclose(seen, expected, atol=1e-12)


def test_wheels_that_are_held_are_told_more_and_more() -> None:
    # What they are told grows from what it was, not from what is measured.
    driven = drive(rate=100, max_wheel_acceleration=2.0)
    driven.run()

    move(driven, 0.5, ticks=50)

    assert rims(driven) == pytest.approx([1.0, 1.0], **EXACT)


def test_a_wheel_near_its_speed_is_told_it_if_the_other_one_is_too() -> None:
    driven = drive(rate=100, max_wheel_acceleration=0.1)
    driven.run()

    driven.measure([0.0, 0.0, 0.495 / RADIUS, 0.48 / RADIUS])
    move(driven, 0.5)
    one_is_there = rims(driven)
    driven.measure([0.0, 0.0, 0.495 / RADIUS, 0.505 / RADIUS])
    driven.run()

    assert one_is_there == pytest.approx([0.001, 0.001], **EXACT)
    assert rims(driven) == pytest.approx([0.5, 0.5], **EXACT)


@pytest.mark.parametrize(("left", "right"), [(3.0, 3.0), (-2.0, 2.0), (2.0, 6.0)])
def test_encoders_say_where_chords_of_the_arc_lead(left: float, right: float) -> None:
    driven = drive(rate=100)
    driven.measure([0.0, 0.0, left, right])

    for _ in range(101):
        driven.run()

    # Chords of a length s that turn by an angle a lie on a circle of radius
    # s / (2 sin(a/2)).
    s = (left + right) / 2.0 * RADIUS * 0.01
    a = (right - left) * RADIUS / SEPARATION * 0.01
    circle = s / (2.0 * math.sin(a / 2.0)) if a else 0.0
    x = circle * math.sin(100 * a) if a else 100 * s
    y = circle * (1.0 - math.cos(100 * a))
    message = driven.output("/odom")
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    assert (position.x, position.y) == pytest.approx((x, y), **EXACT)
    expected = (math.sin(50 * a), math.cos(50 * a))
    assert (orientation.z, orientation.w) == pytest.approx(expected, **EXACT)
    assert velocity(message) == pytest.approx((100 * s, 0.0, 100 * a), **EXACT)


def test_encoders_know_no_backwards() -> None:
    driven = drive(rate=100)
    driven.measure([0.0, 0.0, -2.0, -2.0])

    for _ in range(11):
        driven.run()

    message = driven.output("/odom")
    assert velocity(message) == pytest.approx((2.0 * RADIUS, 0.0, 0.0), **EXACT)
    x = message.pose.pose.position.x
    assert x == pytest.approx(-2.0 * RADIUS * 0.1, **EXACT)


def test_the_world_says_where_the_base_is_and_how_it_moves() -> None:
    driven = drive(rate=100, odometry_source=1)
    other = RigidTransform()
    stand(driven, at(1.0, 2.0, 0.5), other, other)

    # 0.1 m along x of the world and 0.04 rad within 10 ms.
    stand(driven, at(1.001, 2.0, 0.54), other, other)

    message = driven.output("/odom")
    pose = message.pose.pose
    assert pose.position == dc.replace(pose.position, x=1.001, y=2.0, z=0.1)
    assert (pose.orientation.z, pose.orientation.w) == pytest.approx(
        (math.sin(0.27), math.cos(0.27)), **EXACT
    )
    assert velocity(message) == pytest.approx(
        # Differences of numbers around 1 over 10 ms.
        (0.1 * math.cos(0.54), -0.1 * math.sin(0.54), 4.0),
        abs=1e-11,
    )


def test_without_a_world_the_encoders_count() -> None:
    driven = drive(rate=100, odometry_source=1)
    driven.measure([0.0, 0.0, 2.0, 2.0])

    for _ in range(11):
        driven.run()

    x = driven.output("/odom").pose.pose.position.x
    assert x == pytest.approx(0.2 * RADIUS, **EXACT)


def test_an_odometry_has_stamp_frames_and_covariances() -> None:
    driven = drive(
        odometry_frame="o",
        robot_base_frame="b",
        covariance_x=1.0,
        covariance_y=2.0,
        covariance_yaw=3.0,
    )

    for _ in range(11):
        driven.run()

    message = driven.output("/odom")
    assert message.header.stamp.to_nanoseconds() == 10_000_000
    assert (message.header.frame_id, message.child_frame_id) == ("o", "b")
    for covariance in (message.pose.covariance, message.twist.covariance):
        table = np.array(covariance).reshape(6, 6)
        np.testing.assert_array_equal(table, np.diag([1.0, 2.0, 1e12, 1e12, 1e12, 3.0]))


def test_frames_of_odometry_and_wheels_are_on_tf() -> None:
    driven = drive(rate=100, publish_odom_tf=True, publish_wheel_tf=True)
    base = at(1.0, 2.0, math.pi / 2.0)
    poses = base, at(0.8, 2.0, 0.0), at(1.2, 2.0, 0.0)
    driven.run({"link_frames": AbstractValue.Make(list(poses))})
    driven.run()

    right, left, odom = driven.output("/tf").transforms
    for frame, name, y in ((right, "right_wheel", -0.2), (left, "left_wheel", 0.2)):
        assert (frame.header.frame_id, frame.child_frame_id) == ("base", name)
        where = frame.transform.translation
        assert (where.x, where.y, where.z) == pytest.approx((0.0, y, 0.0), **EXACT)
        turn = frame.transform.rotation
        expected = (-math.sqrt(0.5), math.sqrt(0.5))
        assert (turn.z, turn.w) == pytest.approx(expected, **EXACT)
    assert (odom.header.frame_id, odom.child_frame_id) == ("odom", "base_footprint")


@pytest.mark.parametrize("name", ["publish_odom_tf", "publish_wheel_tf"])
def test_what_is_not_to_be_published_has_no_port(name: str) -> None:
    silent = drive(publish_odom=False).system
    shown = drive(publish_odom=False, **{name: True}).system

    assert not any(map(silent.HasOutputPort, ("/odom", "/tf")))
    assert not silent.HasInputPort("link_frames")
    assert shown.HasOutputPort("/tf")
    assert not shown.HasOutputPort("/odom")


def test_topics_have_a_namespace_and_remappings() -> None:
    driven = drive(
        namespace="/r1",
        remappings=("cmd_vel:=go", "odom:=/where"),
        publish_odom_tf=True,
    )

    assert driven.system.message_types == {"/r1/go": Twist}
    assert all(map(driven.system.HasOutputPort, ("/where", "/tf")))


def test_what_is_not_finite_is_dropped() -> None:
    driven = drive(update_rate=0.0)
    move(driven, 0.5)

    move(driven, math.nan)

    assert rims(driven) == pytest.approx([0.5, 0.5], **EXACT)
    (reason,) = driven.reasons()
    assert reason == "linear.x and angular.z must be finite; the message is dropped"


def test_a_deactivation_stops_the_base() -> None:
    driven = drive(update_rate=0.0, max_wheel_acceleration=1.0, publish_odom_tf=True)
    move(driven, 0.5, ticks=5)
    assert min(rims(driven)) > 0.0

    driven.run(activation=None)
    stopped = rims(driven)
    driven.run({"/cmd_vel": (Twist(Vector3(x=0.6)),)}, activation=None)
    driven.run(activation=2)

    assert stopped == [0.0, 0.0]
    assert rims(driven) == [0.0, 0.0]
    # It speeds up from rest again.
    move(driven, 0.5)
    assert rims(driven) == pytest.approx([0.001, 0.001], **EXACT)
    assert driven.reasons() == ["the controller is not active"]
    assert isinstance(driven.output("/tf"), TFMessage)
