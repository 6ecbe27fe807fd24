import dataclasses as dc
import math
import re
from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.bases.omni_wheel_drive_controller import (
    DiagonalCovariance,
    OmniWheelDriveController,
    OmniWheelDriveControllerParameters,
    OmniWheelKinematics,
    OmniWheelOdometry,
)
from arm_drake.messages import (
    Header,
    Odometry,
    SetOdometry,
    TFMessage,
    Time,
    Twist,
    TwistStamped,
    Vector3,
)
from tests.controllers.driving import Driven, make_params

JOINTS = ("w0", "w1", "w2", "w3")

# The measures of D15.
KINEMATICS = OmniWheelKinematics(4, 0.0, 1.0, 0.1)
START = OmniWheelOdometry((0.0,) * 4)


def make_parameters(**changes: Any) -> OmniWheelDriveControllerParameters:
    parameters = {
        "wheel_names": JOINTS,
        "wheel_offset": 0.0,
        "robot_radius": 1.0,
        "wheel_radius": 0.1,
        "cmd_vel_timeout": 0.1,
        **changes,
    }
    return OmniWheelDriveControllerParameters(**parameters)


def drive(*, namespace: str = "", **changes: Any) -> Driven:
    params = dc.replace(make_params(JOINTS), namespace=namespace)
    return Driven(OmniWheelDriveController(make_parameters(**changes), params))


def twist(x: float, y: float = 0.0, z: float = 0.0, *, at: float = 0.0) -> TwistStamped:
    """Return a message; a stamp of 0 s means now."""
    velocity = Twist(Vector3(x, y, 0.0), Vector3(0.0, 0.0, z))
    return TwistStamped(Header(Time.of(at)), velocity)


def pose_of(odometry: Odometry) -> list[float]:
    pose = odometry.pose.pose
    yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    return [pose.position.x, pose.position.y, yaw]


@pytest.mark.parametrize(
    ("wheels", "pose"),
    [
        ((0.0, 10.0, 0.0, -10.0), (1.0, 0.0, 0.0)),  # OM1
        ((-10.0, 0.0, 10.0, 0.0), (0.0, 1.0, 0.0)),  # OM2
        ((-20.0,) * 4, (0.0, 0.0, 2.0)),  # OM3
        ((-15.0, 5.0, -5.0, -25.0), (1.03235763, 1.11028203, 1.0)),  # OM4
    ],
)
@pytest.mark.parametrize("is_position", [False, True])  # OM7
def test_wheels_move_the_base(
    wheels: tuple[float, ...], pose: tuple[float, ...], *, is_position: bool
) -> None:
    if is_position:
        odometry = START.from_positions(KINEMATICS, wheels, 1.0)
    else:
        odometry = START.from_velocities(KINEMATICS, np.array(wheels), 1.0)

    # The numbers have eight digits.
    np.testing.assert_allclose(odometry.pose, pose, atol=5e-9)


def test_a_command_moves_the_base_along_an_arc() -> None:  # OM5
    odometry = START.move((2.0, 0.5, 1.0), 1.0)

    # The numbers have eight digits.
    np.testing.assert_allclose(odometry.pose, (1.45309312, 1.34013088, 1.0), atol=5e-9)
    assert odometry.velocity == (2.0, 0.5, 1.0)


@pytest.mark.parametrize("dt", [1e-7, 0.0, -1e-7])
def test_a_step_that_is_too_short_changes_nothing(dt: float) -> None:  # OM6
    wheels = (0.0, 10.0, 0.0, -10.0)

    assert START.from_velocities(KINEMATICS, np.array(wheels), dt) is START
    assert START.from_positions(KINEMATICS, wheels, dt) is START
    assert START.move((1.0, 0.0, 0.0), dt) is START


def test_a_turn_too_small_for_an_arc_is_a_straight_line() -> None:
    start = START._replace(pose=START.pose._replace(heading=math.pi / 2.0))

    odometry = start.move((3.0, 1.0, 1e-7), 1.0)

    # The heading before the step: forwards is along y, to the left is against x.
    np.testing.assert_allclose(
        odometry.pose, (-1.0, 3.0, math.pi / 2.0 + 1e-7), rtol=1e-15
    )


def test_two_wheels_are_refused() -> None:  # OM8
    message = "wheel_names must have at least 3 elements, got ['w0', 'w1']"

    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make_parameters(wheel_names=("w0", "w1"))


@pytest.mark.parametrize("num_wheels", [3, 4, 7])
def test_wheels_tell_the_velocity_that_they_were_told(num_wheels: int) -> None:
    kinematics = OmniWheelKinematics(num_wheels, 0.4, 0.3, 0.07)
    velocity = (0.7, -0.3, 1.1)

    wheels = kinematics.to_wheels(velocity)

    # A well-conditioned least squares of numbers up to 20.
    np.testing.assert_allclose(kinematics.to_base(wheels), velocity, atol=1e-13)


@pytest.mark.parametrize("is_chained", [False, True])
def test_wheels_turn_as_the_base_is_to_move(*, is_chained: bool) -> None:
    driven = drive()

    if is_chained:
        tick = driven.run(references=(1.0, 2.0, 3.0))
    else:
        tick = driven.run({"cmd_vel": twist(1.0, 2.0, 3.0)})

    # Wheels at 0, 90, 180 and 270 degrees: -vy, vx, vy, -vx, each - R w, over r.
    np.testing.assert_allclose(tick.command, [-50.0, -20.0, -10.0, -40.0], rtol=1e-14)
    assert driven.system.command_interfaces == tuple(f"{j}/velocity" for j in JOINTS)
    assert driven.system.reference_interfaces == (
        "controller/linear/x/velocity",
        "controller/linear/y/velocity",
        "controller/angular/z/velocity",
    )


def test_before_the_first_command_nothing_is_commanded_or_published() -> None:
    driven = drive(cmd_vel_timeout=0.02)

    ticks = [driven.run() for _ in range(3)]
    published = driven.output("odom"), driven.output("tf")
    late = driven.run()

    assert all(np.isnan(tick.command).all() for tick in ticks)
    assert published == (Odometry(), TFMessage())
    # 0.03 s after the first cycle the timeout asks for rest.
    assert late.command.tolist() == [0.0] * 4
    assert driven.output("odom").header == Header(Time.of(0.03), "odom")


def test_a_command_that_gets_too_old_stops_the_base() -> None:
    driven = drive(cmd_vel_timeout=0.02)
    driven.run({"cmd_vel": twist(1.0)})

    ticks = [driven.run() for _ in range(4)]

    # The cycle is 0.01 s: an age of just the timeout is not too old.
    moving = [bool(tick.command.any()) for tick in ticks]
    assert moving == [True, True, False, False]


def test_a_command_that_comes_too_late_is_ignored_and_reported() -> None:
    driven = drive(cmd_vel_timeout=0.02)
    for _ in range(10):
        driven.run()
    driven.run({"cmd_vel": twist(1.0)})

    # Now is 0.11 s.
    tick = driven.run({"cmd_vel": twist(5.0, at=0.09)})

    np.testing.assert_allclose(tick.command, [0.0, 10.0, 0.0, -10.0], atol=1e-14)
    assert driven.reasons() == [
        "it is 0.02 s old, not less than cmd_vel_timeout (0.02 s); it is ignored"
    ]


def test_a_timeout_of_0_brakes_in_the_next_tick() -> None:
    driven = drive(cmd_vel_timeout=0.0)
    driven.run()

    first = driven.run({"cmd_vel": twist(1.0)})
    second = driven.run()
    late = driven.run({"cmd_vel": twist(1.0, at=0.01)})

    assert first.command[1] == pytest.approx(10.0, rel=1e-14)
    assert second.command.tolist() == [0.0] * 4
    assert late.command.tolist() == [0.0] * 4
    assert driven.reasons() == []


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_command_that_is_not_finite_leaves_the_last_one(bad: float) -> None:
    driven = drive(cmd_vel_timeout=0.02)
    driven.run({"cmd_vel": twist(1.0)})
    driven.run()

    tick = driven.run({"cmd_vel": twist(2.0, bad)})
    later = [driven.run() for _ in range(3)]

    assert tick.command[1] == pytest.approx(10.0, rel=1e-14)
    assert driven.reasons() == [
        f"linear.x, linear.y and angular.z must be finite, got 2.0, {bad}, 0.0; "
        "the last reference goes on"
    ]
    # Its stamp counts: the timeout starts anew.
    moving = [bool(tick.command.any()) for tick in later]
    assert moving == [True, True, False]


def test_what_another_controller_leaves_open_stays() -> None:
    driven = drive()
    driven.run(references=(1.0, 2.0, 0.0))

    tick = driven.run(references=(math.nan, 3.0, math.nan))

    # -vy, vx, vy, -vx over r.
    np.testing.assert_allclose(tick.command, [-30.0, 10.0, 30.0, -10.0], rtol=1e-14)


def test_a_message_is_rejected_while_another_controller_commands() -> None:
    driven = drive()

    tick = driven.run({"cmd_vel": twist(3.0)}, references=(1.0, 0.0, 0.0))

    assert tick.command[1] == pytest.approx(10.0, rel=1e-14)
    assert driven.reasons() == ["another controller commands the references"]


@pytest.mark.parametrize("is_position", [True, False])
def test_what_is_measured_is_published(*, is_position: bool) -> None:
    covariance = DiagonalCovariance(pose=(0.2,) * 6, twist=(0.3,) * 6)
    driven = drive(position_feedback=is_position, diagonal_covariance=covariance)
    turned = np.array([0.0, 10.0, 0.0, -10.0])
    unused = np.full(4, 99.0)
    driven.measure([*(0.01 * turned if is_position else unused), *turned])

    driven.run({"cmd_vel": twist(5.0)})

    odometry = driven.output("odom")
    # 1 m/s in 0.01 s; sums of four products.
    np.testing.assert_allclose(pose_of(odometry), [0.01, 0.0, 0.0], atol=1e-15)
    assert odometry.twist.twist.linear.x == pytest.approx(1.0, rel=1e-14)
    assert odometry.pose.covariance[::7] == (0.2,) * 6
    assert odometry.twist.covariance[::7] == (0.3,) * 6


def test_in_a_tick_that_is_too_short_nothing_is_published() -> None:
    # A cycle of 0.5 us.
    params = make_params(JOINTS, rate=2_000_000)
    driven = Driven(OmniWheelDriveController(make_parameters(), params))

    tick = driven.run({"cmd_vel": twist(1.0)})

    assert tick.command[1] == pytest.approx(10.0, rel=1e-14)
    assert driven.output("odom") == Odometry()


def test_with_open_loop_the_commands_are_published() -> None:
    driven = drive(open_loop=True)
    driven.measure([99.0] * 8)

    driven.run({"cmd_vel": twist(1.0, 0.5)})

    assert pose_of(driven.output("odom")) == [0.01, 0.005, 0.0]
    assert driven.system.state_interfaces == ()


def test_a_pose_takes_the_place_of_one_update_of_the_odometry() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(1.0)})
    turned = np.array([0.0, 0.1, 0.0, -0.1])

    driven.measure(turned)
    driven.run({"set_odometry": SetOdometry(5.0, -2.0, math.pi / 2.0)})
    pose = pose_of(driven.output("odom"))
    driven.measure(2.0 * turned)
    driven.run()
    after = pose_of(driven.output("odom"))

    # A few roundings of numbers of size 5. What the wheels turned in the tick of the
    # pose, 0.01 m, is in the next one.
    np.testing.assert_allclose(pose, [5.0, -2.0, math.pi / 2.0], atol=1e-14)
    np.testing.assert_allclose(after, [5.0, -1.98, math.pi / 2.0], atol=1e-14)


def test_a_pose_waits_for_a_reference() -> None:
    driven = drive()
    driven.run({"set_odometry": SetOdometry(5.0, -2.0, 0.0)})
    before = driven.output("odom")

    driven.run({"cmd_vel": twist(1.0)})

    assert before == Odometry()
    assert pose_of(driven.output("odom")) == [5.0, -2.0, 0.0]


def test_a_measurement_of_nan_ends_the_activation_with_wheels_at_rest() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(1.0)})
    driven.measure([0.0, 0.0, math.nan, 0.0])

    tick = driven.run()

    assert not tick.is_ok
    assert tick.fault == "w2/position is NaN"
    assert tick.activation is None
    assert tick.command.tolist() == [0.0] * 4


def test_an_end_of_an_activation_stops_the_wheels_and_forgets_the_command() -> None:
    driven = drive()
    driven.run({"cmd_vel": twist(1.0)})

    end = driven.run(activation=None)
    again = driven.run(activation=2)

    assert end.command.tolist() == [0.0] * 4
    assert np.isnan(again.command).all()


def test_while_inactive_nothing_is_taken() -> None:
    driven = drive()
    request = SetOdometry(5.0, -2.0, 0.0)

    driven.run({"cmd_vel": twist(3.0), "set_odometry": request}, activation=None)
    tick = driven.run()

    assert np.isnan(tick.command).all()
    assert tick.state.pose is None
    assert driven.reasons() == ["the controller is not active"] * 2


def test_frames_have_the_prefix_of_the_namespace() -> None:
    driven = drive(namespace="/robot1")

    driven.run({"cmd_vel": twist(1.0)})

    (transform,) = driven.output("tf").transforms
    assert transform.header.frame_id == "robot1/odom"
    assert transform.child_frame_id == "robot1/base_link"


def test_without_transforms_there_is_no_port() -> None:
    system = drive(enable_odom_tf=False).system

    assert not system.HasOutputPort("tf")
