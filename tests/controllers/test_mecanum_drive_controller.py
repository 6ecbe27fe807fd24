import dataclasses as dc
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_drake.control.odometry import MecanumKinematics, MecanumWheels, PlanarPose
from arm_drake.controllers.bases.base import SpeedLimits
from arm_drake.controllers.bases.mecanum_drive_controller import (
    MecanumAngular,
    MecanumDriveController,
    MecanumDriveControllerParameters,
    MecanumKinematicsParameters,
    MecanumLinear,
    MecanumOdometry,
)
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
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
from arm_drake.messages.control import MecanumDriveControllerState
from tests.controllers.driving import Driven, make_params

# In the order of the commands.
JOINTS = ("fl", "fr", "rr", "rl")

# The measures of D15: the wheels' turns are then (vx -+ vy -+ w) / 0.5.
MEASURES = MecanumKinematicsParameters(
    wheels_radius=0.5, sum_of_robot_center_projection_on_X_Y_axis=1.0
)


def make_parameters(**changes: Any) -> MecanumDriveControllerParameters:
    parameters = {"reference_timeout": 0.1, "kinematics": MEASURES, **changes}
    return MecanumDriveControllerParameters(*JOINTS, **parameters)


def drive(*, namespace: str = "", **changes: Any) -> Driven:
    params = dc.replace(make_params(JOINTS), namespace=namespace)
    return Driven(MecanumDriveController(make_parameters(**changes), params))


def twist(x: float, y: float = 0.0, z: float = 0.0, *, at: float = 0.0) -> TwistStamped:
    """Return a message; a stamp of 0 s means now."""
    velocity = Twist(Vector3(x, y, 0.0), Vector3(0.0, 0.0, z))
    return TwistStamped(Header(Time.of(at)), velocity)


def turn_wheels(driven: Driven, *velocities: float) -> None:
    driven.measure([0.0] * 4 + list(velocities))


def pose_of(odometry: Odometry) -> list[float]:
    pose = odometry.pose.pose
    yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    return [pose.position.x, pose.position.y, yaw]


@pytest.mark.parametrize(
    ("requested", "wheels"),
    [
        ((10.0, 5.0, 3.0), [4.0, 36.0, 16.0, 24.0]),  # ME1
        ((1.5, 0.0, 0.0), [3.0] * 4),  # ME2
        ((3.0, 0.0, 0.0), [6.0] * 4),  # ME3
    ],
)
@pytest.mark.parametrize("is_chained", [False, True])
def test_wheels_turn_as_the_base_is_to_move(
    requested: tuple[float, float, float], wheels: list[float], *, is_chained: bool
) -> None:
    driven = drive()

    if is_chained:
        tick = driven.run(references=requested)
    else:
        tick = driven.run({"reference": twist(*requested)})

    # Quotients by 0.5 are exact.
    assert tick.command.tolist() == wheels
    assert driven.system.command_interfaces == tuple(f"{j}/velocity" for j in JOINTS)
    assert driven.system.reference_interfaces == (
        "controller/linear/x/velocity",
        "controller/linear/y/velocity",
        "controller/angular/z/velocity",
    )


def test_before_the_first_message_all_wheels_are_told_to_stop() -> None:
    driven = drive()

    tick = driven.run()

    assert tick.command.tolist() == [0.0] * 4


def test_a_reference_that_gets_too_old_stops_all_wheels() -> None:  # ME4
    driven = drive(reference_timeout=0.02)
    driven.run({"reference": twist(3.0)})

    ticks = [driven.run() for _ in range(4)]

    # The cycle is 0.01 s: an age of just the timeout is not too old.
    assert [tick.command.tolist() for tick in ticks] == [
        [6.0] * 4,
        [6.0] * 4,
        [0.0] * 4,
        [0.0] * 4,
    ]


def test_in_the_tick_of_the_timeout_rest_is_asked_for_and_then_nothing() -> None:
    driven = drive(reference_timeout=0.01)
    driven.run({"reference": twist(3.0)})
    requested = []

    for _ in range(3):
        driven.run()
        requested.append(driven.output("controller_state").reference_velocity.linear.x)

    np.testing.assert_array_equal(requested, [3.0, 0.0, math.nan])


def test_a_message_that_comes_too_late_stops_the_base_and_is_reported() -> None:
    driven = drive(reference_timeout=0.02)
    for _ in range(10):
        driven.run()
    driven.run({"reference": twist(3.0)})

    # Now is 0.11 s.
    tick = driven.run({"reference": twist(5.0, at=0.05)})

    assert tick.command.tolist() == [0.0] * 4
    assert driven.reasons() == [
        "it is 0.06 s old, more than reference_timeout (0.02 s); the base stops"
    ]


def test_a_message_just_as_old_as_the_timeout_is_taken() -> None:
    driven = drive(reference_timeout=0.02)
    for _ in range(10):
        driven.run()

    # Now is 0.1 s.
    tick = driven.run({"reference": twist(3.0, at=0.08)})

    assert tick.command.tolist() == [6.0] * 4
    assert driven.reasons() == []


def test_without_a_timeout_a_message_is_used_once() -> None:  # ME5
    driven = drive(reference_timeout=0.0)
    for _ in range(100):
        driven.run()

    first = driven.run({"reference": twist(3.0, at=0.001)})
    second = driven.run()

    assert first.command.tolist() == [6.0] * 4
    assert second.command.tolist() == [0.0] * 4
    assert driven.reasons() == []


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_message_that_is_not_finite_stops_the_base_and_is_reported(
    bad: float,
) -> None:
    driven = drive()
    driven.run({"reference": twist(3.0)})

    tick = driven.run({"reference": twist(1.0, bad)})

    assert tick.command.tolist() == [0.0] * 4
    assert driven.reasons() == [
        f"linear.x, linear.y and angular.z must be finite, got 1.0, {bad}, 0.0; "
        "the base stops"
    ]


def test_wheels_that_turn_alike_move_the_base_forwards() -> None:  # ME6
    driven = drive()
    turn_wheels(driven, 1.0, 1.0, 1.0, 1.0)

    driven.run()

    odometry = driven.output("odometry")
    moved, turned = odometry.twist.twist.linear, odometry.twist.twist.angular
    assert (moved.x, moved.y, turned.z) == (0.5, 0.0, 0.0)
    assert pose_of(odometry) == [0.005, 0.0, 0.0]
    assert odometry.pose.covariance[::7] == (0.1,) * 6


@pytest.mark.parametrize(
    "wheel", ["front_left", "front_right", "rear_right", "rear_left"]
)
def test_a_wheel_without_a_name_is_refused(wheel: str) -> None:  # ME7
    name = f"{wheel}_wheel_command_joint_name"

    with pytest.raises(ParameterError) as error:
        make_parameters_from_file({name: ""})

    assert str(error.value) == f"base.yaml:1: base: {name} must not be empty, got ''"


@pytest.mark.parametrize(
    ("distro", "limit"), [("humble", math.nan), ("jazzy", 2.0), ("kilted", 2.0)]
)
def test_velocities_have_limits_since_jazzy(distro: str, limit: float) -> None:
    names = ("linear.x.max_velocity", "linear.y.max_velocity", "angular.z.max_velocity")

    loaded = make_parameters_from_file(dict.fromkeys(names, 2.0), distro=distro)

    limits = (loaded.linear.x, loaded.linear.y, loaded.angular.z)
    found = [each.max_velocity for each in limits]
    np.testing.assert_array_equal(found, [limit] * 3)


def make_parameters_from_file(changes: dict[str, Any], distro: str = "rolling") -> Any:
    wheels = ("front_left", "front_right", "rear_right", "rear_left")
    parameters: dict[str, Any] = {
        f"{wheel}_wheel_command_joint_name": wheel for wheel in wheels
    }
    parameters |= {"kinematics.wheels_radius": 0.1, **changes}
    file = Path("base.yaml")
    return load_parameters(
        MecanumDriveControllerParameters,
        {name: Parameter(value, file, 1) for name, value in parameters.items()},
        "base",
        file,
        LoadReport(),
        distro=distro,
    )


def test_wheels_that_cannot_tell_a_turn_are_refused() -> None:
    measures = MecanumKinematicsParameters(wheels_radius=0.1)

    with pytest.raises(ParameterError) as error:
        drive(kinematics=measures)

    assert str(error.value) == (
        "kinematics.sum_of_robot_center_projection_on_X_Y_axis must not be 0; it is "
        "half the wheelbase plus half the distance of left and right wheels [m]"
    )


def test_a_pose_takes_the_place_of_one_step_of_the_odometry() -> None:  # ME8
    driven = drive()
    turn_wheels(driven, 1.0, 1.0, 1.0, 1.0)
    driven.run()

    driven.run({"set_odometry": SetOdometry(5.0, -2.0, math.pi / 2.0)})
    pose = pose_of(driven.output("odometry"))
    driven.run()
    after = pose_of(driven.output("odometry"))

    # A few roundings of numbers of size 5.
    np.testing.assert_allclose(pose, [5.0, -2.0, math.pi / 2.0], atol=1e-14)
    np.testing.assert_allclose(after, [5.0, -1.995, math.pi / 2.0], atol=1e-14)


def test_an_end_of_an_activation_leaves_the_commands_unwritten() -> None:  # ME9
    driven = drive()
    driven.run({"reference": twist(3.0)})

    tick = driven.run(activation=None)

    assert np.isnan(tick.command).all()


def test_an_activation_forgets_the_reference_and_keeps_the_odometry() -> None:
    driven = drive(reference_timeout=10.0)
    turn_wheels(driven, 1.0, 1.0, 1.0, 1.0)
    driven.run({"reference": twist(3.0)})
    driven.run(activation=None)

    tick = driven.run(activation=2)

    assert tick.command.tolist() == [0.0] * 4
    assert pose_of(driven.output("odometry"))[0] == pytest.approx(0.01, rel=1e-15)


def test_while_inactive_nothing_is_taken() -> None:
    driven = drive()
    request = SetOdometry(5.0, -2.0, 0.0)

    driven.run({"reference": twist(3.0), "set_odometry": request}, activation=None)
    tick = driven.run()

    assert tick.command.tolist() == [0.0] * 4
    assert pose_of(driven.output("odometry")) == [0.0, 0.0, 0.0]
    assert driven.reasons() == ["the controller is not active"] * 2


def test_a_message_is_rejected_while_another_controller_commands() -> None:
    driven = drive()

    tick = driven.run({"reference": twist(3.0)}, references=(0.5, 0.0, 0.0))

    assert tick.command.tolist() == [1.0] * 4
    assert driven.reasons() == ["another controller commands the references"]


def test_a_limit_of_the_acceleration_makes_the_base_start_slowly() -> None:
    driven = drive(linear=MecanumLinear(x=SpeedLimits(max_acceleration=2.0)))

    ticks = [driven.run({"reference": twist(3.0)})] + [driven.run() for _ in range(2)]

    # v = a t, with 0.01 s a tick; sums are rounded.
    for number, tick in enumerate(ticks, start=1):
        expected = [2.0 * 0.01 * number / 0.5] * 4
        np.testing.assert_allclose(tick.command, expected, rtol=1e-14)


def test_each_component_has_its_own_limits() -> None:
    driven = drive(
        linear=MecanumLinear(
            x=SpeedLimits(max_velocity=1.0), y=SpeedLimits(max_velocity=2.0)
        ),
        angular=MecanumAngular(z=SpeedLimits(max_velocity=3.0)),
    )

    tick = driven.run({"reference": twist(10.0, 10.0, 10.0)})

    # (vx -+ vy -+ w) / 0.5 of 1, 2 and 3.
    assert tick.command.tolist() == [-8.0, 12.0, 4.0, 0.0]


def test_a_new_activation_starts_from_rest() -> None:
    driven = drive(linear=MecanumLinear(x=SpeedLimits(max_acceleration=2.0)))
    for _ in range(5):
        driven.run(references=(3.0, 0.0, 0.0))
    driven.run(activation=None)

    tick = driven.run(references=(3.0, 0.0, 0.0), activation=2)

    # v = a t over one tick of 0.01 s.
    np.testing.assert_allclose(tick.command, [2.0 * 0.01 / 0.5] * 4, rtol=1e-14)


def test_the_timeout_brakes_within_the_limits_for_a_tick() -> None:
    limits = SpeedLimits(max_acceleration=100.0, max_deceleration=-2.0)
    driven = drive(reference_timeout=0.01, linear=MecanumLinear(x=limits))
    driven.run({"reference": twist(1.0)})

    ticks = [driven.run() for _ in range(3)]
    again = driven.run({"reference": twist(1.5)})

    speeds = [tick.command[0] * 0.5 for tick in ticks]
    np.testing.assert_allclose(speeds, [1.0, 1.0 - 2.0 * 0.01, 0.0], rtol=1e-14)
    # From rest: 100 m/s^2 in 0.01 s.
    np.testing.assert_allclose(again.command, [1.0 / 0.5] * 4, rtol=1e-14)


def test_wheels_of_unknown_velocity_leave_the_odometry_as_it_is() -> None:
    driven = drive()
    turn_wheels(driven, 1.0, 1.0, 1.0, 1.0)
    driven.run()
    before = driven.output("odometry")

    turn_wheels(driven, 1.0, math.nan, 1.0, 1.0)
    tick = driven.run({"reference": twist(3.0)})

    after = driven.output("odometry")
    assert tick.is_ok
    assert tick.command.tolist() == [6.0] * 4
    assert (after.pose, after.twist) == (before.pose, before.twist)
    assert after.header.stamp > before.header.stamp
    assert math.isnan(driven.output("controller_state").front_right_wheel_velocity)


def test_the_state_names_each_wheel() -> None:
    driven = drive()
    turn_wheels(driven, 1.0, 2.0, 3.0, 4.0)

    driven.run({"reference": twist(3.0, 2.0, 1.0)})

    assert driven.output("controller_state") == MecanumDriveControllerState(
        Header(Time(), "odom"), 1.0, 2.0, 3.0, 4.0, twist(3.0, 2.0, 1.0).twist
    )


def test_before_the_first_tick_topics_are_empty() -> None:
    driven = drive()

    assert driven.output("odometry") == Odometry()
    assert driven.output("tf_odometry") == TFMessage()
    assert driven.output("controller_state") == MecanumDriveControllerState()


def test_frames_have_the_prefix_of_the_namespace() -> None:
    driven = drive(namespace="/robot1")

    driven.run()

    (transform,) = driven.output("tf_odometry").transforms
    assert transform.header.frame_id == "robot1/odom"
    assert transform.child_frame_id == "robot1/base_link"


def test_without_transforms_there_is_no_port() -> None:
    system = drive(enable_odom_tf=False).system

    assert not system.HasOutputPort("tf_odometry")


def test_joints_of_their_own_can_be_measured() -> None:
    system = drive(front_right_wheel_state_joint_name="fl").system

    assert system.state_interfaces == (
        "fl/velocity",
        "fl/velocity",
        "rr/velocity",
        "rl/velocity",
    )


def test_a_turn_about_the_base_frame_moves_the_wheels_centre_around_it() -> None:
    # The frame stands 0.2 m before the centre, which thus moves with -w x offset:
    # to the right for a turn to the left.
    kinematics = MecanumKinematics(0.5, 1.0, PlanarPose(0.2, 0.0, 0.0))

    wheels = kinematics.to_wheels((0.0, 0.0, 1.0))

    centred = MecanumKinematics(0.5, 1.0).to_wheels((0.0, -0.2, 1.0))
    np.testing.assert_allclose(wheels, centred, rtol=1e-15)


def test_wheels_tell_the_velocity_that_they_were_told() -> None:
    kinematics = MecanumKinematics(0.08, 0.5, PlanarPose(0.2, -0.1, 0.4))
    velocity = (0.7, -0.3, 1.1)

    wheels = kinematics.to_wheels(velocity)

    # Some twenty operations on numbers up to 20.
    np.testing.assert_allclose(kinematics.to_base(wheels), velocity, atol=1e-14)


@pytest.mark.parametrize("dt", [9.9e-5, 0.0, -0.01])
def test_a_step_that_is_too_short_changes_nothing(dt: float) -> None:
    odometry = MecanumOdometry()

    wheels = MecanumWheels(1.0, 1.0, 1.0, 1.0)

    assert odometry.update(MecanumKinematics(0.5, 1.0), wheels, dt) is odometry


def test_a_position_moves_with_the_heading_at_the_end_of_the_step() -> None:
    # Forwards with 1 m/s and turning with pi/2 rad/s: wheels (1 -+ pi/2) / 0.5.
    left, right = (1.0 - math.pi / 2.0) / 0.5, (1.0 + math.pi / 2.0) / 0.5
    wheels = MecanumWheels(left, right, right, left)

    odometry = MecanumOdometry().update(MecanumKinematics(0.5, 1.0), wheels, 1.0)

    np.testing.assert_allclose(
        odometry.pose, [0.0, 1.0, math.pi / 2.0], atol=1e-15, rtol=1e-15
    )
