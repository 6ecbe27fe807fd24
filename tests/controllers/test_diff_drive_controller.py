"""DiffDriveController: vectors of the specification, and what users run into."""

import dataclasses as dc
import math
from typing import Any

import numpy as np
import pytest

from arm_drake.control.odometry import (
    DiffDriveKinematics,
    RollingMean,
    WheelOdometryState,
    from_commands,
)
from arm_drake.controllers.bases.diff_drive_controller import (
    DiffDriveController,
    DiffDriveControllerParameters,
    DiffDriveLinear,
    DiffDriveSpeedLimits,
)
from arm_drake.messages import SetOdometry, Twist, TwistStamped
from tests.controllers.driving import Driven, make_params

WHEELS = ("left", "right")
GIVEN = DiffDriveControllerParameters(
    ("left",), ("right",), wheel_separation=0.4, wheel_radius=1.0
)

# As the vectors are given.
TOLERANCE = {"rel": 0.0, "abs": 1e-8}


def drive(
    *, distro: str = "rolling", namespace: str = "", rate: int = 100, **parameters: Any
) -> Driven:
    params = make_params(WHEELS, distro=distro, rate=rate)
    params = dc.replace(params, namespace=namespace)
    return Driven(DiffDriveController(dc.replace(GIVEN, **parameters), params))


def twist(v: float, w: float = 0.0, *, stamp: float = 0.0) -> TwistStamped:
    return TwistStamped(
        header={"stamp": stamp}, twist={"linear": {"x": v}, "angular": {"z": w}}
    )


class Base:
    """The odometry alone: separation 1, radii 1, velocities."""

    def __init__(self) -> None:
        self.kinematics = DiffDriveKinematics(1.0, 1.0, 1.0)
        self.state = WheelOdometryState(RollingMean(10))

    def move(self, left: float, right: float, dt: float) -> tuple[float, ...]:
        self.state = self.kinematics.from_velocities(self.state, left, right, dt)
        return (*self.state.pose, *self.state.velocity)


@pytest.mark.parametrize(
    ("wheels", "dt", "expected"),
    [
        ((1.0, 1.0), 1.0, (1.0, 0.0, 0.0, 1.0, 0.0)),
        ((-1.0, 1.0), 1.0, (0.0, 0.0, 2.0, 0.0, 2.0)),
        ((1.0, 2.0), 1.0, (1.26220648, 0.68954654, 1.0, 1.5, 1.0)),
        ((1.0, 1.0), 1e-7, (0.0, 0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_odometry_of_velocities(
    wheels: tuple[float, float], dt: float, expected: tuple[float, ...]
) -> None:
    assert Base().move(*wheels, dt) == pytest.approx(expected, **TOLERANCE)


def test_odometry_of_commands() -> None:
    state = from_commands(Base().state, 2.0, 0.5, 1.0)

    assert state.pose == pytest.approx((1.91770215, 0.48966975, 0.5), **TOLERANCE)


def test_odometry_of_positions() -> None:
    base = Base()

    state = base.kinematics.from_positions(base.state, 1.0, 1.0, 1.0)

    assert state.pose == pytest.approx((1.0, 0.0, 0.0), **TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "goal", "ticks"), [(0, 1, 500), (1, 0, 250), (0, -1, 125), (-1, 0, 100)]
)
def test_accelerations_take_their_time(start: int, goal: int, ticks: int) -> None:
    limits = DiffDriveSpeedLimits(
        max_acceleration=2.0,
        max_deceleration=-4.0,
        max_acceleration_reverse=-8.0,
        max_deceleration_reverse=10.0,
    )
    linear = DiffDriveLinear(limits)
    driven = drive(rate=1000, wheel_radius=0.1, linear=linear, cmd_vel_timeout=0.0)
    driven.run({"cmd_vel": twist(start)})
    while abs(driven.command_values[0] - start / 0.1) > 1e-9:
        driven.run()

    driven.run({"cmd_vel": twist(goal)})
    taken = 1
    while abs(driven.command_values[0] - goal / 0.1) > 1e-9:
        driven.run()
        taken += 1

    assert taken == ticks


@pytest.mark.parametrize(
    ("v", "w", "wheels"), [(1.0, 0.0, (1.0, 1.0)), (0.0, 1.0, (-0.2, 0.2))]
)
def test_wheels_of_a_velocity(v: float, w: float, wheels: tuple[float, float]) -> None:
    driven = drive()

    driven.run({"cmd_vel": twist(v, w)})

    np.testing.assert_allclose(driven.command_values, wheels, rtol=0, atol=1e-12)


def test_no_new_command_brakes() -> None:
    driven = drive(cmd_vel_timeout=0.1)
    driven.run({"cmd_vel": twist(1.0)})
    for _ in range(10):
        driven.run()
    np.testing.assert_array_equal(driven.command_values, (1.0, 1.0))

    driven.run()

    np.testing.assert_array_equal(driven.command_values, (0.0, 0.0))


@pytest.mark.slow
def test_without_timeout_a_command_lasts() -> None:
    driven = drive(cmd_vel_timeout=0.0)
    driven.run({"cmd_vel": twist(1.0)})

    for _ in range(1000):
        driven.run()

    np.testing.assert_array_equal(driven.command_values, (1.0, 1.0))


def test_with_a_negative_timeout_no_command_is_taken() -> None:
    driven = drive(cmd_vel_timeout=-1.0)

    driven.run({"cmd_vel": twist(1.0)})
    driven.run()

    np.testing.assert_array_equal(driven.command_values, (0.0, 0.0))
    assert len(driven.reasons()) == 1


def test_old_command_is_reported_and_not_taken() -> None:
    driven = drive(cmd_vel_timeout=0.1)
    for _ in range(30):
        driven.run()

    driven.run({"cmd_vel": twist(1.0, stamp=0.05)})

    np.testing.assert_array_equal(driven.command_values, (0.0, 0.0))
    assert driven.reasons() == ["it is 0.25 s old; cmd_vel_timeout is less"]


@pytest.mark.parametrize(("v", "w"), [(math.nan, 0.0), (0.0, math.inf)])
def test_command_that_is_not_finite_leaves_the_last(v: float, w: float) -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(1.0)})

    driven.run({"cmd_vel": twist(v, w)})

    np.testing.assert_array_equal(driven.command_values, (1.0, 1.0))
    assert "must be finite" in driven.reasons()[0]


def test_deactivation_stops_the_wheels() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(1.0)})

    driven.run(activation=None)

    np.testing.assert_array_equal(driven.command_values, (0.0, 0.0))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"right_wheel_names": ("a", "b")}, "as many as left_wheel_names"),
        ({"left_wheel_names": ()}, "left_wheel_names"),
        ({"right_wheel_names": ()}, "right_wheel_names"),
        ({"wheel_radius": 0.0}, "wheel_radius"),
    ],
)
def test_wheels_that_make_no_base(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dc.replace(GIVEN, **parameters)


def test_open_loop_reads_nothing() -> None:
    assert drive(open_loop=True).system.state_interfaces == ()


@pytest.mark.parametrize(
    ("parameters", "what"), [(True, "position"), (False, "velocity")]
)
def test_feedback(parameters: bool, what: str) -> None:
    driven = drive(position_feedback=parameters)

    assert driven.system.state_interfaces == (f"left/{what}", f"right/{what}")


def test_odometry_that_is_set() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(0.0)})

    driven.run({"set_odometry": SetOdometry(5.0, -2.0, math.pi / 2.0)})

    pose = driven.output("odom").pose.pose
    assert (pose.position.x, pose.position.y) == (5.0, -2.0)
    orientation = (pose.orientation.z, pose.orientation.w)
    assert orientation == pytest.approx((0.70710678, 0.70710678), **TOLERANCE)


def test_open_loop_integrates_the_limited_velocity() -> None:
    limits = DiffDriveSpeedLimits(max_acceleration=1.0)
    driven = drive(open_loop=True, linear=DiffDriveLinear(limits))

    for _ in range(100):
        driven.run({"cmd_vel": twist(1.0)})

    # sum of k / 100 * 0.01 for k = 1 to 100.
    assert driven.output("odom").pose.pose.position.x == pytest.approx(0.505)


@pytest.mark.parametrize(
    ("parameters", "namespace", "odom"),
    [
        ({"tf_frame_prefix": "test_prefix"}, "", "test_prefix/odom"),
        ({"tf_frame_prefix": "~"}, "/test_namespace", "test_namespace/odom"),
        ({"tf_frame_prefix": "x", "tf_frame_prefix_enable": False}, "", "odom"),
        ({}, "", "odom"),
    ],
)
def test_frames(parameters: dict[str, Any], namespace: str, odom: str) -> None:
    driven = drive(namespace=namespace, **parameters)

    driven.run({"cmd_vel": twist(1.0)})

    message = driven.output("odom")
    (transform,) = driven.output("tf").transforms
    assert message.header.frame_id == odom
    assert message.child_frame_id == odom.replace("odom", "base_link")
    assert transform.header.frame_id == odom


def test_references_of_another_controller() -> None:
    driven = drive()

    driven.run({"cmd_vel": twist(1.0)}, references=(3.0, 0.0))

    np.testing.assert_array_equal(driven.command_values, (3.0, 3.0))
    assert driven.reasons() == ["another controller commands the references"]


def test_twist_without_stamp() -> None:
    driven = drive(distro="humble", use_stamped_vel=False)

    driven.run({"cmd_vel_unstamped": Twist(linear={"x": 1.0})})

    np.testing.assert_array_equal(driven.command_values, (1.0, 1.0))


@pytest.mark.parametrize(("distro", "start"), [("humble", 0.0), ("jazzy", math.nan)])
def test_start_without_command(distro: str, start: float) -> None:
    driven = drive(distro=distro)

    driven.run()

    np.testing.assert_array_equal(driven.command_values, (start, start))


def test_feedback_that_is_not_a_number_is_an_error() -> None:
    driven = drive()
    driven.measure((math.nan, 0.0))

    tick = driven.run({"cmd_vel": twist(1.0)})

    assert not tick.is_ok
    assert tick.fault == "'left/position' is nan"


def test_parameters_while_it_runs() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(1.0)})

    changed = dc.replace(GIVEN, left_wheel_radius_multiplier=0.5)
    driven.run({"parameters": changed})
    driven.run({"parameters": dc.replace(GIVEN, open_loop=True)})

    np.testing.assert_array_equal(driven.command_values, (2.0, 1.0))
    assert driven.reasons() == ["open_loop can't change while the controller runs"]
