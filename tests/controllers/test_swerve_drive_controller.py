import dataclasses as dc
import math
from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.bases.swerve_drive_controller import (
    AXLES,
    WHEELS,
    SwerveController,
    SwerveControllerParameters,
    SwerveKinematics,
    SwerveOdometry,
)
from arm_drake.messages import (
    Header,
    Odometry,
    TFMessage,
    Time,
    Twist,
    TwistStamped,
    Vector3,
)
from tests.controllers.driving import Driven, make_params

DRIVEN = ("fl", "fr", "rl", "rr")
STEERED = ("fl_axle", "fr_axle", "rl_axle", "rr_axle")

RADIUS = 0.1

# Wheels at the corners of a square of 2 m.
KINEMATICS = SwerveKinematics(np.array([1, 1, -1, -1.0]), np.array([1, -1, 1, -1.0]))

# How wheels stand on the circle about the middle.
CIRCLE = np.array([3.0, 1.0, -3.0, -1.0]) * math.pi / 4.0


def make_parameters(**changes: Any) -> SwerveControllerParameters:
    joints = dict(zip((*WHEELS, *AXLES), (*DRIVEN, *STEERED), strict=True))
    sizes = {"wheelbase": 2.0, "trackwidth": 2.0, "wheel_radius": RADIUS}
    return SwerveControllerParameters(**{**joints, **sizes, **changes})


def drive(*, namespace: str = "", **changes: Any) -> Driven:
    params = dc.replace(make_params((*DRIVEN, *STEERED)), namespace=namespace)
    return Driven(SwerveController(make_parameters(**changes), params))


def measure(driven: Driven, wheels: Any, axles: Any) -> None:
    """Set velocities of the wheels [rad/s] and angles of the axles [rad]."""
    positions = [0.0] * 4 + list(axles)
    driven.measure([*positions, *wheels, *[0.0] * 4])


def twist(x: float, y: float = 0.0, z: float = 0.0, *, at: float = 0.0) -> TwistStamped:
    """Return a message; a stamp of 0 s means now."""
    velocity = Twist(Vector3(x, y, 0.0), Vector3(0.0, 0.0, z))
    return TwistStamped(Header(Time.of(at)), velocity)


@pytest.mark.parametrize(
    ("velocity", "speeds", "angles"),
    [
        ((2.0, 0.0, 0.0), [2.0] * 4, [0.0] * 4),
        ((0.0, -2.0, 0.0), [2.0] * 4, [-math.pi / 2.0] * 4),
        # About the middle: a wheel is sqrt(2) m away.
        ((0.0, 0.0, 1.0), [math.sqrt(2.0)] * 4, CIRCLE),
        # About the front left wheel's place: it stands, the right one goes forwards.
        ((1.0, -1.0, 1.0), [0.0, 2.0, 2.0, 8.0**0.5], None),
    ],
)
def test_a_wheel_goes_as_the_base_does_where_it_is(
    velocity: tuple[float, ...], speeds: list[float], angles: Any
) -> None:
    found = KINEMATICS.to_wheels(velocity)

    np.testing.assert_allclose(found[0], speeds, atol=1e-15)
    if angles is not None:
        np.testing.assert_allclose(found[1], angles, atol=1e-15)


def test_wheels_tell_the_velocity_that_they_were_told() -> None:
    kinematics = SwerveKinematics.of(make_parameters(trackwidth=1.2))
    velocity = (0.7, -0.3, 1.1)

    found = kinematics.to_base(*kinematics.to_wheels(velocity))

    np.testing.assert_allclose(found, velocity, atol=1e-15)


def test_an_offset_moves_where_the_base_turns() -> None:
    kinematics = SwerveKinematics.of(make_parameters(offset=(1.0, 1.0)))

    speeds, _ = kinematics.to_wheels((0.0, 0.0, 1.0))

    # The front left wheel stands there.
    np.testing.assert_allclose(speeds, [0.0, 2.0, 2.0, 8.0**0.5], atol=1e-15)


def test_the_odometry_follows_an_arc_whose_heading_ends_at_half_a_turn() -> None:
    odometry = SwerveOdometry().move((math.pi / 2.0, 0.0, math.pi / 2.0), 1.0)

    # A quarter of a circle of 1 m.
    np.testing.assert_allclose(odometry.pose, (1.0, 1.0, math.pi / 2.0), rtol=1e-15)

    odometry = odometry.move((0.0, 1.0, math.pi), 1.0)
    # Half of a circle of 1/pi m, to the left of where it looked: against x first.
    np.testing.assert_allclose(
        odometry.pose, (1.0, 1.0 - 2.0 / math.pi, -math.pi / 2.0), atol=1e-15
    )


def test_a_turn_too_small_for_an_arc_is_a_straight_line() -> None:
    odometry = SwerveOdometry().move((3.0, 1.0, 0.0), 2.0)

    assert odometry.pose == (6.0, 2.0, 0.0)
    assert odometry.velocity == (3.0, 1.0, 0.0)


@pytest.mark.parametrize("is_chained", [False, True])
def test_wheels_are_driven_and_steered(*, is_chained: bool) -> None:
    driven = drive()

    if is_chained:
        tick = driven.run(references=(0.0, 0.0, 1.0))
    else:
        tick = driven.run({"cmd_vel": twist(0.0, 0.0, 1.0)})

    np.testing.assert_allclose(tick.command[:4], math.sqrt(2.0) / RADIUS)
    np.testing.assert_allclose(tick.command[4:], CIRCLE)
    assert driven.system.command_interfaces == (
        *(f"{joint}/velocity" for joint in DRIVEN),
        *(f"{joint}/position" for joint in STEERED),
    )
    assert driven.system.reference_interfaces == (
        "controller/linear/x/velocity",
        "controller/linear/y/velocity",
        "controller/angular/z/velocity",
    )


def test_from_an_activation_on_wheels_rest_as_they_are_found() -> None:
    driven = drive()
    measure(driven, [0.0] * 4, [0.1, 0.2, 0.3, 0.4])

    first = driven.run()
    measure(driven, [0.0] * 4, [0.5] * 4)
    second = driven.run()

    assert first.command.tolist() == [0.0] * 4 + [0.1, 0.2, 0.3, 0.4]
    assert second.command.tolist() == first.command.tolist()


def test_a_command_that_gets_too_old_stops_the_wheels_as_they_are_steered() -> None:
    driven = drive(cmd_vel_timeout=0.02)
    driven.run({"cmd_vel": twist(0.0, 1.0)})

    ticks = [driven.run() for _ in range(4)]

    # The cycle is 0.01 s: an age of just the timeout is not too old.
    moving = [bool(tick.command[:4].any()) for tick in ticks]
    assert moving == [True, True, False, False]
    np.testing.assert_allclose(ticks[-1].command[4:], math.pi / 2.0)


def test_of_a_command_that_is_not_finite_nothing_counts() -> None:
    driven = drive()
    before = driven.run({"cmd_vel": twist(1.0)})

    after = driven.run({"cmd_vel": twist(math.nan, 1.0)})

    assert after.command.tolist() == before.command.tolist()
    (event,) = driven.output("events")
    assert event[1].reason == (
        "linear.x, linear.y and angular.z must be finite, got nan, 1.0, 0.0; the last "
        "reference goes on"
    )


def test_references_that_no_one_gave_command_and_publish_nothing() -> None:
    driven = drive()

    tick = driven.run(references=(math.nan, 0.0, 0.0))

    assert np.isnan(tick.command).all()
    assert (driven.output("odom"), driven.output("tf")) == (Odometry(), TFMessage())


def test_the_odometry_is_what_wheels_and_axles_measure() -> None:
    driven = drive(namespace="/robot")
    measure(driven, [10.0] * 4, [math.pi / 2.0] * 4)

    driven.run({"cmd_vel": twist(1.0)})

    odometry = driven.output("odom")
    # A cycle of 0.01 s at 1 m/s to the left.
    assert odometry.pose.pose.position.y == pytest.approx(0.01)
    assert odometry.twist.twist.linear.y == pytest.approx(1.0)
    frames = odometry.header.frame_id, odometry.child_frame_id
    assert frames == ("robot/odom", "robot/base_footprint")
    # Upstream's own, whatever the parameters say.
    assert odometry.pose.covariance[::7] == (0.01,) * 6
    (transform,) = driven.output("tf").transforms
    assert transform.transform.translation.y == pytest.approx(0.01)


def test_an_open_loop_takes_commands_within_the_thresholds_for_the_odometry() -> None:
    limits = {name.replace("wheel_joint", "velocity_threshold"): 0.2 for name in WHEELS}
    driven = drive(open_loop=True, enable_odom_tf=False, **limits)

    tick = driven.run({"cmd_vel": twist(3.0)})

    # As upstream divides by the radius, 0.2 m/s are 2; the wheels aren't limited.
    np.testing.assert_allclose(tick.command[:4], 3.0 / RADIUS)
    assert driven.output("odom").twist.twist.linear.x == pytest.approx(2.0)
    assert not driven.system.HasOutputPort("tf")


def test_a_deactivation_stops_the_wheels_and_steers_them_ahead() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(0.0, 1.0)})

    tick = driven.run(activation=None)

    assert tick.command.tolist() == [0.0] * 8


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rear_left_axle_joint": ""}, "rear_left_axle_joint"),
        ({"wheelbase": 0.0}, "wheelbase must be above 0, got 0.0"),
        ({"offset": (0.0,)}, "offset"),
    ],
)
def test_parameters_that_upstream_refuses_are_refused(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make_parameters(**changes)
