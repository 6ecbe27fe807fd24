"""The legacy tricycle controller: conformance vectors TR1 to TR12, odometry, faults."""

import math
from typing import Any

import numpy as np
import pytest

from arm_drake.control.odometry import RollingMean
from arm_drake.controllers.bases.tricycle_controller import (
    Range,
    SteeringLimiter,
    SteeringLimits,
    TractionLimiter,
    TractionLimits,
    TricycleController,
    TricycleOdometry,
    make_range,
    make_symmetric_range,
    speed_scale,
    to_wheel_command,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import Header, Odometry, Time, Twist, TwistStamped, Vector3
from arm_drake.messages.control import AckermannDrive, ResetOdometry
from tests.controllers.driving import Driven, make_params
from tests.controllers.parameters import TRICYCLE, load

DT = 0.5
ACCELERATION, DECELERATION, JERK = Range(0.5, 1.0), Range(2.0, 3.0), Range(0.5, 5.0)
ALL = TractionLimiter(None, ACCELERATION, DECELERATION, JERK)
RATES = ALL._replace(jerk=None)
JERK_ONLY = TractionLimiter(jerk=JERK)


def drive(*, distro: str = "jazzy", **settings: Any) -> Driven:
    values = {"wheelbase": 1.0, "wheel_radius": 1.0, **settings}
    parameters = load(TRICYCLE, values, distro=distro)
    params = make_params(("t", "s"), distro=distro)
    return Driven(TricycleController(parameters, params))


def measure(driven: Driven, rate: float, angle: float) -> None:
    driven.measure([0.0, angle, rate, 0.0])


def command(v: float, w: float, stamp: float = 0.0) -> dict[str, Any]:
    twist = Twist(Vector3(v), Vector3(0.0, 0.0, w))
    return {"cmd_vel": TwistStamped(Header(Time.of(stamp)), twist)}


# TR1.
@pytest.mark.parametrize(
    "quantity", ["velocity", "acceleration", "deceleration", "jerk"]
)
def test_limits_are_sizes_and_in_order(quantity: str) -> None:
    low, high = f"min_{quantity}", f"max_{quantity}"

    for limits in ({low: -1.0}, {high: -1.0}, {low: 2.0, high: 1.0}):
        with pytest.raises(ValueError, match=quantity):
            TractionLimits(**limits)
    if quantity in ("velocity", "acceleration"):
        for limits in ({low: -1.0}, {high: -1.0}, {low: 2.0, high: 1.0}):
            with pytest.raises(ValueError, match=quantity):
                SteeringLimits(**limits)


# TR2 to TR9; a deceleration alone is off upstream, so an acceleration is there, too.
@pytest.mark.parametrize(
    ("limiter", "v", "v0", "v1", "limited"),
    [
        (ALL, 10.0, 0.0, 0.0, 0.5),
        (ALL, -10.0, 0.0, 0.0, -0.5),
        (JERK_ONLY, 10.0, 0.0, 0.0, 2.5),
        (JERK_ONLY, -10.0, 0.0, 0.0, -2.5),
        (JERK_ONLY, 0.0, 0.0, 0.0, 0.25),
        (TractionLimiter(acceleration=ACCELERATION), 0.0, 0.0, 0.0, 0.25),
        (TractionLimiter(acceleration=ACCELERATION), -1e-9, 0.0, 0.0, -0.25),
        (RATES, 0.0, 10.0, 10.0, 8.5),
        (RATES, 0.0, -10.0, -10.0, -8.5),
        (RATES, 9.9, 10.0, 10.0, 9.0),
        (RATES, -9.9, -10.0, -10.0, -9.0),
        (ALL, 0.0, 10.0, 10.0, 8.5),
        (TractionLimiter(velocity=Range(1.0, 2.0)), -0.5, 0.0, 0.0, -1.0),
        (TractionLimiter(velocity=Range(1.0, 2.0)), 3.0, 0.0, 0.0, 2.0),
        (TractionLimiter(deceleration=DECELERATION), 0.0, 10.0, 10.0, 0.0),
    ],
)
def test_velocities_are_limited(
    limiter: TractionLimiter, v: float, v0: float, v1: float, limited: float
) -> None:
    assert limiter.limit(v, v0, v1, DT) == pytest.approx(limited, rel=1e-15)


@pytest.mark.parametrize(
    ("limiter", "p", "limited"),
    [
        (SteeringLimiter(position=Range(-0.2, 0.3)), -1.0, -0.2),
        (SteeringLimiter(velocity=Range(0.0, 0.4)), 1.0, 0.3),
        # 0.1 and a change of 0.1 as before, and 2 * 0.2 * DT^2 more.
        (SteeringLimiter(acceleration=Range(0.0, 0.2)), 1.0, 0.3),
        (SteeringLimiter(), 1.0, 1.0),
    ],
)
def test_angles_are_limited(limiter: SteeringLimiter, p: float, limited: float) -> None:
    assert limiter.limit(p, 0.1, 0.0, DT) == pytest.approx(limited, rel=1e-14)


def test_one_end_of_a_range_makes_the_other() -> None:
    assert make_range(math.nan, math.nan) is None
    assert make_range(2.0, math.nan) == (2.0, 1000.0)
    assert make_range(math.nan, 2.0) == (0.0, 2.0)
    assert make_symmetric_range(math.nan, 2.0) == (-2.0, 2.0)
    assert make_symmetric_range(-2.0, math.nan) == (-2.0, 2.0)


# TR10.
def test_a_base_goes_straight_on() -> None:
    driven = drive()

    driven.run(command(1.0, 0.0))

    assert driven.command_values.tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    ("v", "w", "rate", "angle"),
    [
        (0.0, 0.5, 2.0, math.pi / 2.0),
        (0.0, -0.5, 2.0, -math.pi / 2.0),
        (0.0, 0.0, 0.0, 0.0),
        # The front wheel at 45 degrees: sqrt(2) as fast as the rear axle.
        (1.0, 0.5, 2.0 * math.sqrt(2.0), math.pi / 4.0),
    ],
)
def test_the_front_wheel_rolls_about_the_center_of_the_turn(
    v: float, w: float, rate: float, angle: float
) -> None:
    published = to_wheel_command(v, w, wheelbase=2.0, radius=0.5)

    np.testing.assert_allclose(published, [rate, angle], rtol=1e-15)


@pytest.mark.parametrize(
    ("deviation", "scale"), [(0.5, 1.0), (1.0, math.cos(1.0)), (1.6, 0.01)]
)
def test_the_wheel_waits_for_the_steering(deviation: float, scale: float) -> None:
    assert speed_scale(deviation) == scale


# TR11: both are 0 upstream.
def test_a_deactivation_and_a_timeout_stop_the_base() -> None:
    driven = drive()
    measure(driven, 0.0, math.pi / 4.0)
    driven.run(command(1.0, 1.0))
    assert driven.command_values.tolist() == pytest.approx(
        [math.sqrt(2.0), math.pi / 4.0]
    )

    for _ in range(50):
        driven.run()
    # As old as it may be: 500 ms.
    assert driven.command_values[0] > 0.0
    driven.run()
    assert driven.command_values.tolist() == [0.0, 0.0]

    driven.run(command(1.0, 1.0))
    assert driven.command_values[0] > 0.0
    driven.run(activation=None)
    assert driven.command_values.tolist() == [0.0, 0.0]


# TR12.
@pytest.mark.parametrize("name", ["traction_joint_name", "steering_joint_name"])
def test_both_joints_are_named(name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        load(TRICYCLE, {}, without=(name,))


def test_the_command_is_limited_by_the_last_two() -> None:
    parameters: dict[str, Any] = {"traction.max_acceleration": 1.0}
    driven = drive(publish_ackermann_command=True, **parameters)

    for _ in range(3):
        driven.run(command(1.0, 0.0))

    # 0.01 each; the last ones are kept in single precision, relative 2^-24.
    assert driven.command_values[0] == pytest.approx(0.03, rel=2.0**-23)
    published = driven.output("cmd_ackermann")
    assert published == AckermannDrive(
        speed=float(np.float32(driven.command_values[0]))
    )


@pytest.mark.parametrize("is_open_loop", [False, True])
def test_odometry_goes_along_a_circle(is_open_loop: bool) -> None:
    driven = drive(open_loop=is_open_loop, enable_odom_tf=True)
    # v = w = 1, as commanded and as measured.
    measure(driven, math.sqrt(2.0), math.pi / 4.0)

    for _ in range(100):
        driven.run(command(1.0, 1.0))

    # Sums of 100 roundings.
    pose = driven.output("odom").pose.pose
    assert pose.position.x == pytest.approx(math.sin(1.0), abs=1e-13)
    assert pose.position.y == pytest.approx(1.0 - math.cos(1.0), abs=1e-13)
    twist = driven.output("odom").twist.twist
    moved = (twist.linear.x, twist.angular.z)
    assert moved == pytest.approx((1.0, 1.0), rel=1e-14)
    (transform,) = driven.output("tf").transforms
    assert transform.transform.translation.x == pose.position.x
    names = (transform.header.frame_id, transform.child_frame_id)
    assert names == ("odom", "base_link")


def test_a_reset_puts_the_base_to_the_origin() -> None:
    driven = drive()
    measure(driven, 1.0, 0.0)
    driven.run()
    assert driven.output("odom").pose.pose.position.x == pytest.approx(0.01)

    driven.run({"reset_odometry": ResetOdometry()})
    assert driven.output("odom").pose.pose.position.x == 0.0
    driven.run()

    assert driven.output("odom").pose.pose.position.x == pytest.approx(0.01)


def test_a_mean_forgets_at_a_reset() -> None:
    start = TricycleOdometry(RollingMean(10)).measure(1.0, 0.0, 1.0, 0.1)

    moved = start.reset().measure(3.0, 0.0, 1.0, 0.1)

    assert moved.velocity == (3.0, 0.0)


def test_odometry_may_be_without_a_pose() -> None:
    driven = drive(odom_only_twist=True)
    measure(driven, 1.0, 0.0)

    driven.run()

    odometry = driven.output("odom")
    assert odometry.pose.pose == Odometry().pose.pose
    assert odometry.twist.twist.linear.x == 1.0


def test_a_tick_that_cannot_read_the_joints_fails() -> None:
    driven = drive()
    measure(driven, math.nan, 0.0)

    tick = driven.run(command(1.0, 0.0))

    assert not tick.is_ok
    assert tick.fault == "not all of t/velocity, s/position could be read"
    assert driven.command_values.tolist() == [0.0, 0.0]


def test_commands_that_are_not_finite_or_come_too_early_are_reported() -> None:
    driven = drive()
    driven.run(command(1.0, 0.0))

    driven.run(command(math.nan, 0.0))
    assert driven.command_values[0] == 0.0
    driven.run(command(1.0, 0.0), activation=None)

    assert driven.reasons() == [
        "linear.x and angular.z must be finite, got [nan, 0.0]",
        "the controller is not active",
    ]


def test_humble_takes_messages_without_a_stamp() -> None:
    driven = drive(distro="humble", use_stamped_vel=False)

    driven.run({"cmd_vel_unstamped": Twist(Vector3(1.0))})

    assert driven.command_values.tolist() == [1.0, 0.0]


def test_topics_are_there_if_they_are_switched_on() -> None:
    system = drive().system

    assert not system.HasOutputPort("tf")
    assert not system.HasOutputPort("cmd_ackermann")
    assert drive().output("odom") == Odometry()
