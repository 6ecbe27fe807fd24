"""Gazebo's plugins for bases with steered wheels against closed forms."""

import dataclasses as dc
import math
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from arm_drake import interfaces
from arm_drake.controllers.gazebo.ackermann_drive import (
    AckermannGeometry,
    AckermannSteering,
    GazeboRosAckermannDrive,
)
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Float64, Odometry, Twist, Vector3
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import make_surroundings

COMMAND, ANGLE = "/model/arm/cmd_vel", "/model/arm/steer_angle"
ODOMETRY, TF = "/model/arm/odometry", "/model/arm/tf"

BASE, SEPARATION, WIDTH, RADIUS, LIMIT = 0.6, 0.5, 0.4, 0.1, 0.5

# The smallest radius of a curve [m].
SMALLEST = BASE / math.sin(LIMIT)

# Rounding alone, of values around 1.
EXACT = {"rel": 0.0, "abs": 1e-12}

JOINTS = ("l", "r", "sl", "sr")

GEOMETRY = AckermannGeometry(BASE, SEPARATION, WIDTH, RADIUS, LIMIT)


def drive(*, rate: int = 1000, **fields: Any) -> Driven:
    measures = {"wheel_base": BASE, "wheel_separation": SEPARATION}
    measures |= {"kingpin_width": WIDTH, "wheel_radius": RADIUS}
    tag = gazebo_plugins.AckermannSteering(
        *((joint,) for joint in JOINTS), **{**measures, **fields}
    )
    return Driven(AckermannSteering(tag, make_surroundings(*JOINTS, rate=rate)))


def move(driven: Driven, v: float, w: float) -> list[float]:
    """Command a velocity, and return what the joints are told."""
    driven.run({COMMAND: (Twist(Vector3(x=v), Vector3(z=w)),)})
    values: list[float] = driven.command_values.tolist()
    return values


def test_topics_are_called_as_in_gazebo() -> None:
    system = drive().system
    named = drive(topic="go", odom_topic="/where", tf_topic="frames").system
    short = drive(sub_topic="steer/go").system
    alone = drive(steering_only=True).system

    assert system.message_types == {COMMAND: Twist}
    assert all(map(system.HasOutputPort, (ODOMETRY, TF)))
    assert named.message_types == {"/go": Twist}
    assert all(map(named.HasOutputPort, ("/where", "/frames")))
    assert short.message_types == {"/model/arm/steer/go": Twist}
    assert alone.message_types == {ANGLE: Float64}
    assert not alone.HasOutputPort(ODOMETRY)


@pytest.mark.parametrize("radius", [2.0, -3.0])
def test_all_wheels_go_round_one_centre(radius: float) -> None:
    speed = 0.5
    # At rest at 0, a gain of 1 gives the angles as velocities.
    left, right, steer_left, steer_right = move(drive(), speed, speed / radius)

    w = speed / radius
    assert left * RADIUS == pytest.approx(w * (radius - SEPARATION / 2.0), **EXACT)
    assert right * RADIUS == pytest.approx(w * (radius + SEPARATION / 2.0), **EXACT)
    # A wheel at (BASE, side) is steered across its way to the centre at (0, radius).
    for angle, side in ((steer_left, WIDTH / 2.0), (steer_right, -WIDTH / 2.0)):
        across = BASE * math.cos(angle) - (radius - side) * math.sin(angle)
        assert across == pytest.approx(0.0, **EXACT)


@pytest.mark.parametrize(
    ("v", "w", "radius"),
    [
        (1.0, 0.5, 2.0),
        (-1.0, 0.5, -2.0),
        # As far as the steering goes.
        (0.1, 2.0, SMALLEST),
        (0.1, -2.0, -SMALLEST),
        (-0.1, 2.0, -SMALLEST),
        # It turns its wheels where it stands.
        (0.0, 0.3, SMALLEST),
        (0.0, -0.3, -SMALLEST),
        # What is no turn.
        (0.5, 0.0009, 1e9),
        (0.0, 0.0, 1e9),
    ],
)
def test_curves_are_no_narrower_than_the_limit(
    v: float, w: float, radius: float
) -> None:
    assert GEOMETRY.turning_radius(v, w) == pytest.approx(radius, rel=1e-12)


def test_a_curve_about_a_kingpin_turns_its_wheel_by_a_quarter() -> None:
    assert GEOMETRY.angles(WIDTH / 2.0)[0] == math.pi / 2.0


def test_a_pid_without_memory_steers() -> None:
    driven = drive(rate=100, steer_p_gain=2.0, steer_d_gain=0.1, steer_cmd_max=1.5)
    driven.measure([0.0, 0.0, 0.1, -0.05])

    for _ in range(3):
        steering = move(driven, 0.0, 0.0)[2:]

    # From an error of 0 before: 2 e + 0.1 e / 0.01, up to the limit above.
    assert steering == pytest.approx([-1.2, 0.6], abs=1e-8)
    driven.measure([0.0, 0.0, -0.5, 0.0])
    assert move(driven, 0.0, 0.0)[2] == pytest.approx(1.5, **EXACT)


def test_an_integral_acts_within_its_limits_for_one_tick_each() -> None:
    driven = drive(rate=10, steer_p_gain=0.0, steer_i_gain=1.0, steer_i_max=0.02)
    driven.measure([0.0, 0.0, 0.1, 0.5])

    for _ in range(3):
        steering = move(driven, 0.0, 0.0)[2:]

    assert steering == pytest.approx([-0.01, -0.02], abs=1e-8)


def test_speeds_are_limited_before_they_become_angles() -> None:
    driven = drive(rate=100, max_velocity=0.4, max_acceleration=10.0)

    first = move(driven, 9.0, 0.0)
    for _ in range(5):
        last = move(driven, 9.0, 0.0)

    assert first[0] == pytest.approx(0.1 / RADIUS, rel=1e-6)
    assert last[0] == pytest.approx(0.4 / RADIUS, rel=1e-6)


@pytest.mark.parametrize(("angle", "limited"), [(0.3, 0.3), (0.9, LIMIT), (-2, -LIMIT)])
def test_steering_alone_it_takes_the_angle_of_the_middle(
    angle: float, limited: float
) -> None:
    driven = drive(steering_only=True, steering_limit=LIMIT)
    driven.run({ANGLE: (Float64(angle),)})

    left, right = driven.command_values

    assert driven.system.command_interfaces == ("sl/velocity", "sr/velocity")
    # Both wheels and that between them have one centre on the rear axle.
    radius = BASE / math.tan(limited)
    assert BASE / math.tan(left) == pytest.approx(radius - SEPARATION / 2.0)
    assert BASE / math.tan(right) == pytest.approx(radius + SEPARATION / 2.0)


def test_steering_alone_the_limits_of_turning_hold_for_the_angle() -> None:
    driven = drive(rate=10, use_actuator_msg=True, actuator_number=0, max_velocity=0.1)

    driven.run({ANGLE: (Float64(0.4),)})

    expected = GEOMETRY.angles_around(0.1)
    np.testing.assert_allclose(driven.command_values, expected, rtol=1e-12)
    driven.run({ANGLE: (Float64(math.nan),)})
    assert driven.reasons() == ["data must be finite, got nan; it is dropped"]


def test_the_odometry_goes_round_a_circle() -> None:
    driven = drive(rate=1000, odom_publish_frequency=0.0, base_link="trunk")
    radius, rate, ticks = 2.0, 5.0, 2000
    phi = math.atan(BASE / radius)
    for k in range(ticks + 1):
        driven.measure([rate * k / 1000.0] * 2 + [phi, phi])
        driven.run()

    message = driven.output(ODOMETRY)

    assert isinstance(message, Odometry)
    way = rate * RADIUS * ticks / 1000.0
    place, turned = message.pose.pose.position, message.pose.pose.orientation
    wanted = [radius * math.sin(way / radius), radius * (1.0 - math.cos(way / radius))]
    # A step goes where the base looks at its end: half a step of 0.5 mm.
    assert [place.x, place.y] == pytest.approx(wanted, abs=5e-4)
    yaw = 2.0 * math.atan2(turned.z, turned.w)
    assert yaw == pytest.approx(way / radius, abs=1e-9)
    assert message.twist.twist.linear.x == pytest.approx(0.5, abs=1e-9)
    assert message.twist.twist.angular.z == pytest.approx(0.25, abs=1e-9)
    frames = (message.header.frame_id, message.child_frame_id)
    assert frames == ("arm/odom", "arm/trunk")


def test_the_heading_stays_within_half_a_turn() -> None:
    driven = drive(rate=100, odom_publish_frequency=0.0)
    for k in range(401):
        driven.measure([0.1 * k] * 2 + [0.4, 0.4])
        driven.run()

    z = driven.output(ODOMETRY).pose.pose.orientation.z

    # 4 m at 0.7 rad/m.
    angle = math.remainder(4.0 * math.tan(0.4) / BASE, 2.0 * math.pi)
    assert 2.0 * math.asin(z) == pytest.approx(angle, abs=1e-9)


def classic(*, rate: int = 1000, **fields: Any) -> Driven:
    measures = {"wheel_radius": RADIUS, "wheel_separation": WIDTH, "wheel_base": BASE}
    names = ("fr", "fl", "rr", "rl", "sr", "sl")
    joints = [*((name,) for name in names), fields.pop("wheel", ())]
    fields = {"update_rate": 0.0, "publish_odom": True, **measures, **fields}
    tag = gazebo_plugins.GazeboRosAckermannDrive(*joints, **fields, base_link="trunk")
    own = [name for joint in joints for name in joint]
    params = dc.replace(make_surroundings(*own, rate=rate), links=("trunk",))
    return Driven(GazeboRosAckermannDrive(tag, params))


def push(driven: Driven, v: float, w: float) -> dict[str, float]:
    """Command once for two ticks, the first of which takes no time for a PID."""
    for _ in range(2):
        driven.run({"/cmd_vel": (Twist(Vector3(x=v), Vector3(z=w)),)})
    names = driven.system.command_interfaces
    return dict(zip(names, driven.command_values.tolist(), strict=True))


STEER = {"left_steering_pid_gain": (2, 0, 0), "right_steering_pid_gain": (3.0, 0, 0)}


def test_classic_has_its_topics() -> None:
    system = classic(
        publish_distance=True, namespace="r1", remappings=("cmd_vel:=go",)
    ).system

    assert system.message_types == {"/r1/go": Twist}
    assert all(map(system.HasOutputPort, ("/r1/odom", "/r1/distance")))
    assert not system.HasOutputPort("/tf")


@pytest.mark.parametrize(
    ("v", "angle", "steered"),
    [(1.0, 0.3, 0.3), (-1.0, 0.3, -0.3), (0.0, 0.3, 0.3), (1.0, 2.0, 0.6)],
)
def test_classic_takes_the_turning_as_an_angle_of_steering(
    v: float, angle: float, steered: float
) -> None:
    found = push(classic(**STEER), v, angle)

    # Wheels and the middle between them have one centre on the rear axle.
    arm = BASE / math.tan(steered)
    left, right = found["sl/effort"] / 2.0, found["sr/effort"] / 3.0
    assert BASE / math.tan(left) == pytest.approx(arm - WIDTH / 2.0)
    assert BASE / math.tan(right) == pytest.approx(arm + WIDTH / 2.0)


def test_classic_pushes_both_rear_wheels_by_the_error_of_the_right_one() -> None:
    driven = classic(linear_velocity_pid_gain=(0.5, 0.0, 0.0), max_speed=0.4)
    port = driven.system.params.measured.index("rr/velocity")
    driven.measure([0.0] * port + [1.0])

    found = push(driven, 9.0, 0.0)

    # 4 rad/s at the limit, less 1 rad/s that it has.
    assert (found["rr/effort"], found["rl/effort"]) == pytest.approx((1.5, 1.5))


def test_classic_s_integral_has_its_range() -> None:
    fields = {"linear_velocity_pid_gain": (0.0, 100.0, 0.0)}
    free = classic(**fields, linear_velocity_i_range=(-5.0, 5.0))
    # Without a range it is 0.
    none = classic(**fields)

    # 10 rad/s for 1 ms, and for 1 s.
    assert push(free, 1.0, 0.0)["rr/effort"] == pytest.approx(1.0)
    for _ in range(1000):
        free.run()
    assert free.command_values[0] == pytest.approx(5.0)
    assert push(none, 1.0, 0.0)["rr/effort"] == 0.0


def test_classic_s_forces_act_for_one_tick_of_an_update() -> None:
    driven = classic(rate=1000, update_rate=100.0, **STEER)
    driven.run({"/cmd_vel": (Twist(angular=Vector3(z=0.3)),)})
    at = driven.system.command_interfaces.index("sl/effort")
    pushes = []
    for _ in range(30):
        driven.run()
        pushes.append(driven.command_values[at] != 0.0)

    assert [k + 1 for k, pushed in enumerate(pushes) if pushed] == [10, 20, 30]


def test_classic_puts_the_steering_wheel_where_the_wheels_have_it() -> None:
    driven = classic(wheel=("w",), max_steer=0.5, max_steering_angle=5.0)
    own = driven.system.params.measured
    values = np.zeros(own.index("sl/position") + 1)
    for name, angle in (("sl/position", 0.2), ("sr/position", 0.1)):
        values[own.index(name)] = angle
    driven.measure(values)

    assert push(driven, 0.0, 0.0)["w/position"] == pytest.approx(1.5)


def test_classic_counts_the_way_and_tells_the_truth() -> None:
    driven = classic(rate=100, update_rate=20.0, publish_distance=True)
    port = driven.system.GetInputPort(interfaces.FRAMES_PORT)
    for k in range(11):
        # Three metres on in four ticks, and back again.
        x = 3.0 - abs(k - 4) * 0.75
        pose = RigidTransform([x, 1.0, 0.2])
        port.FixValue(driven.context, AbstractValue.Make([pose]))
        driven.run()

    assert driven.output("/distance").data == pytest.approx(7.5)
    message = driven.output("/odom")
    assert isinstance(message, Odometry)
    place = message.pose.pose.position
    assert (place.x, place.y, place.z) == pytest.approx((-1.5, 1.0, 0.2))
    assert message.twist.twist.linear.x == pytest.approx(-75.0)
    assert message.header.stamp.to_nanoseconds() == 100_000_000
    frames = (message.header.frame_id, message.child_frame_id)
    assert frames == ("odom", "base_footprint")
