"""Gazebo's plugins that set a base's velocity: what they ask for, and when."""

import dataclasses as dc
import math
from typing import Any

import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake import interfaces
from arm_drake.controllers.gazebo.velocity_control import (
    GazeboRosPlanarMove,
    HeldTwist,
    VelocityControl,
)
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Odometry, TFMessage, Twist, Vector3
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import make_surroundings

COMMAND = "/model/arm/cmd_vel"
TWIST = Twist(Vector3(0.1, 0.2, 0.3), Vector3(0.4, 0.5, 0.6))


def control(**fields: Any) -> Driven:
    tag = gazebo_plugins.VelocityControl(**fields)
    return Driven(VelocityControl(tag, make_surroundings("j")))


def planar(*, rate: int = 1000, **fields: Any) -> Driven:
    tag = gazebo_plugins.GazeboRosPlanarMove(**fields, base_link="trunk")
    params = dc.replace(make_surroundings("j", rate=rate), links=("trunk",))
    return Driven(GazeboRosPlanarMove(tag, params))


def held(driven: Driven) -> HeldTwist | None:
    value: HeldTwist | None = driven.output(interfaces.TWIST_PORT)
    return value


def test_topics_are_called_as_in_gazebo() -> None:
    assert control().system.message_types == {COMMAND: Twist}
    assert control(topic="go there").system.message_types == {"/go_there": Twist}
    moving = planar(namespace="r1", remappings=("odom:=where",)).system
    assert moving.message_types == {"/r1/cmd_vel": Twist}
    assert all(map(moving.HasOutputPort, ("/r1/where", "/tf")))
    quiet = planar(publish_odom=False, publish_odom_tf=False).system
    assert not any(map(quiet.HasOutputPort, ("/odom", "/tf")))


def test_a_base_is_held_from_the_start_and_as_last_commanded() -> None:
    driven = control(initial_linear=(1.0, 2.0, 3.0))
    driven.run()
    first = held(driven)

    driven.run({COMMAND: (TWIST,)})
    for _ in range(50):
        driven.run()

    assert first == HeldTwist((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    assert held(driven) == HeldTwist((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))


def test_an_inactive_plugin_holds_nothing_and_forgets() -> None:
    driven = control()
    driven.run({COMMAND: (TWIST,)})

    driven.run(activation=None)
    then = held(driven)
    driven.run(activation=2)

    assert then is None
    assert held(driven) == HeldTwist()


def test_a_message_that_is_not_finite_is_dropped() -> None:
    driven = control()
    driven.run({COMMAND: (Twist(Vector3(z=math.inf)),)})

    assert held(driven) == HeldTwist()
    reason = "all numbers must be finite; the message is dropped"
    assert driven.reasons() == [reason]


def test_classic_sets_the_velocity_at_its_rate() -> None:
    driven = planar(rate=100, update_rate=20.0)
    driven.run({"/cmd_vel": (TWIST,)})
    found = [held(driven)]
    for _ in range(10):
        driven.run()
        found.append(held(driven))

    # Of the command's numbers three count.
    twist = HeldTwist((0.1, 0.2, 0.0), (0.0, 0.0, 0.6), is_level=True)
    assert found == [twist if k in (5, 10) else None for k in range(11)]


def test_classic_sets_it_in_every_tick_at_a_rate_of_0() -> None:
    driven = planar(update_rate=0.0)

    driven.run()
    at_rest = held(driven)
    driven.run({"/cmd_vel": (TWIST,)})

    assert at_rest == HeldTwist(is_level=True)
    twist = held(driven)
    assert twist is not None
    assert twist.linear == (0.1, 0.2, 0.0)


def test_classic_publishes_the_truth_at_its_rate() -> None:
    driven = planar(rate=100, publish_rate=20.0, covariance_yaw=0.5)
    port = driven.system.GetInputPort(interfaces.FRAMES_PORT)
    w, v, yaw = 0.5, 0.2, 0.3
    for k in range(9):
        angle = yaw + w * k / 100.0
        turned = RollPitchYaw(0.0, 0.0, angle)
        # It goes to its left; its origin at 5 ticks is (1, 2, 0).
        left = turned.ToRotationMatrix().matrix()[:, 1]
        place = [1.0, 2.0, 0.0] + left * v * (k - 5) / 100.0
        pose = RigidTransform(turned, place)
        port.FixValue(driven.context, AbstractValue.Make([pose]))
        driven.run()

    message = driven.output("/odom")

    assert isinstance(message, Odometry)
    assert message.header.stamp.to_nanoseconds() == 50_000_000
    assert (message.header.frame_id, message.child_frame_id) == (
        "odom",
        "base_footprint",
    )
    place, turned = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z) == pytest.approx((1.0, 2.0, 0.0))
    assert 2.0 * math.asin(turned.z) == pytest.approx(yaw + w * 0.05)
    twist = message.twist.twist
    # The mean of a tick, in which it turns by 5 mrad.
    found = (twist.linear.x, twist.linear.y, twist.angular.z)
    assert found == pytest.approx((0.0, v, w), abs=5e-3 * v)
    assert message.pose.covariance[::7] == (1e-5, 1e-5, 1e12, 1e12, 1e12, 0.5)
    frames = driven.output("/tf")
    assert isinstance(frames, TFMessage)
    assert frames.transforms[0].transform.translation.x == pytest.approx(1.0)
