"""The steering controllers: conformance vectors ST1 to ST19, topics, faults."""

import math
from typing import Any

import numpy as np
import pytest

from arm_drake.control.odometry import (
    PlanarPose,
    RollingMean,
    SteeringGeometry,
    SteeringOdometry,
    to_base_velocity,
    to_wheel_commands,
)
from arm_drake.controllers.bases.steering_controllers import SteeringController
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
from arm_drake.messages.control import SteeringControllerStatus
from tests.controllers.driving import NAME, Driven, make_params
from tests.controllers.parameters import ACKERMANN, BICYCLE, TRICYCLE_STEERING, load

TYPES = (BICYCLE, TRICYCLE_STEERING, ACKERMANN)
NUM_DRIVEN = {BICYCLE: 1, TRICYCLE_STEERING: 2, ACKERMANN: 2}
RADII = {
    BICYCLE: "traction_wheel_radius",
    TRICYCLE_STEERING: "traction_wheels_radius",
    ACKERMANN: "traction_wheels_radius",
}

# Of upstream's tests.
WHEELBASE, RADIUS = 3.24644, 0.45
UPSTREAM = {type_: {"wheelbase": WHEELBASE, RADII[type_]: RADIUS} for type_ in TYPES}
SQUARE = SteeringGeometry(1.0, 1.0, 2, 2, 1.0, 1.0)
WIDE = SteeringGeometry(2.0, 1.0, 2, 2, 1.0, 1.0)
SLOW = SteeringGeometry(2.0, 1.0)


def drive(type_: str = BICYCLE, *, distro: str = "jazzy", **values: Any) -> Driven:
    parameters = load(type_, {**UPSTREAM[type_], **values}, distro=distro)
    joints = (*parameters.traction_joints_names, *parameters.steering_joints_names)
    return Driven(SteeringController(parameters, make_params(joints, distro=distro)))


def twist(v: float, w: float) -> Twist:
    return Twist(Vector3(v), Vector3(0.0, 0.0, w))


def refer(v: float, w: float, stamp: float = 0.0) -> dict[str, Any]:
    return {"reference": TwistStamped(Header(Time.of(stamp)), twist(v, w))}


# ST1 to ST3. The README of upstream's tests has six digits.
@pytest.mark.parametrize("type_", TYPES)
def test_wheels_are_told_the_velocity_of_the_base(type_: str) -> None:
    driven = drive(type_)

    driven.run(refer(0.1, 0.2))

    n = NUM_DRIVEN[type_]
    np.testing.assert_allclose(driven.command_values[:n], 0.22222222, atol=1e-6)
    np.testing.assert_allclose(driven.command_values[n:], 1.41798220, atol=1e-6)


# ST4, ST5: numbers of eight digits.
@pytest.mark.parametrize(
    ("measured", "traction"), [(0.2, [1.05067751, 0.94932249]), (None, [1.05, 0.95])]
)
def test_wheels_of_an_axle_are_told_apart(
    measured: float | None, traction: list[float]
) -> None:
    commands = to_wheel_commands(WIDE, 1.0, 0.1, measured=measured)

    np.testing.assert_allclose(commands.traction, traction, atol=5e-9)
    steering = [0.18822151, 0.20749623]
    np.testing.assert_allclose(commands.steering, steering, atol=5e-9)


# ST6, ST7.
@pytest.mark.parametrize(
    ("geometry", "measured"),
    [(SLOW, 0.0), (SLOW, None), (WIDE, 0.0), (WIDE._replace(num_steered=1), None)],
)
@pytest.mark.parametrize(
    ("v", "w", "rate", "angle"),
    [
        (1.0, 0.0, 1.0, 0.0),
        (0.0, 1.0, 0.0, math.pi / 2.0),
        (0.0, -1.0, 0.0, -math.pi / 2.0),
        (-0.0, 1.0, 0.0, -math.pi / 2.0),
        (0.0, 0.0, 0.0, 0.0),
    ],
)
def test_wheels_of_a_base_that_goes_straight_or_turns_on_the_spot(
    geometry: SteeringGeometry,
    measured: float | None,
    v: float,
    w: float,
    rate: float,
    angle: float,
) -> None:
    commands = to_wheel_commands(geometry, v, w, measured=measured)

    np.testing.assert_allclose(commands.traction, rate, atol=1e-15)
    np.testing.assert_allclose(commands.steering, angle, atol=1e-15)


# ST8 to ST10; upstream's tests say 1e-3 for the pose.
@pytest.mark.parametrize(
    ("geometry", "v", "w"),
    [
        (SQUARE, 1.0025358, 0.1008404),
        (SQUARE._replace(num_steered=1), 1.0025231, 0.1005878),
        (SteeringGeometry(1.0, 1.0), 1.0, 0.10033467),
    ],
)
def test_odometry_of_measured_wheels(
    geometry: SteeringGeometry, v: float, w: float
) -> None:
    rates = (1.0,) * geometry.num_driven
    angles = (0.1,) * geometry.num_steered

    odometry = SteeringOdometry(RollingMean(10)).measure_velocities(
        geometry, rates, angles, 0.1
    )

    np.testing.assert_allclose(odometry.velocity, [v, w], atol=5e-8)
    np.testing.assert_allclose(odometry.pose.x, 0.1, atol=1e-3)
    np.testing.assert_allclose(odometry.pose.heading, 0.01, atol=1e-3)


@pytest.mark.parametrize("v", [0.7, -0.4])
@pytest.mark.parametrize("w", [0.3, -0.2])
def test_wheels_that_do_as_told_move_the_base_as_asked(v: float, w: float) -> None:
    # What a steered middle wheel would do, the geometry of the inverse.
    steering = math.atan(w * WIDE.wheelbase / v)
    commands = to_wheel_commands(WIDE, v, w, measured=None)

    moved = to_base_velocity(WIDE, commands.traction, steering)

    np.testing.assert_allclose(moved, [v, w], rtol=1e-14)


# ST11 to ST13.
@pytest.mark.parametrize(
    ("measured", "scale"), [(-0.785, 1.0), (-0.1, 0.89393114), (math.pi, 0.01154257)]
)
def test_wheels_wait_for_the_steering(measured: float, scale: float) -> None:
    commands = to_wheel_commands(SLOW, 1.0, -0.5, measured=measured, slows_down=True)

    np.testing.assert_allclose(commands.traction, [scale], atol=5e-9)
    np.testing.assert_allclose(commands.steering, [-math.pi / 4.0], rtol=1e-15)


# ST14: sums of 100 roundings.
def test_odometry_of_commands_goes_along_a_circle() -> None:
    driven = drive(open_loop=True)

    for _ in range(100):
        driven.run(refer(1.0, 1.0))

    pose = driven.output("odometry").pose.pose
    assert pose.position.x == pytest.approx(math.sin(1.0), abs=1e-14)
    assert pose.position.y == pytest.approx(1.0 - math.cos(1.0), abs=1e-14)
    assert pose.orientation.z == pytest.approx(math.sin(0.5), abs=1e-14)


# ST15.
@pytest.mark.parametrize("type_", TYPES)
def test_an_old_reference_stops_the_wheels_and_leaves_the_steering(type_: str) -> None:
    driven, n = drive(type_, reference_timeout=0.05), NUM_DRIVEN[type_]
    driven.run(refer(0.1, 0.2))
    steering = driven.command_values[n:].copy()

    for _ in range(5):
        driven.run()
    # As old as it may be.
    assert (driven.command_values[:n] > 0.0).all()
    driven.run()

    assert (driven.command_values[:n] == 0.0).all()
    np.testing.assert_array_equal(driven.command_values[n:], steering)


# ST16.
def test_without_a_timeout_a_message_drives_one_tick() -> None:
    driven = drive(reference_timeout=0.0)

    driven.run(refer(0.1, 0.2))
    assert driven.command_values[0] == pytest.approx(0.1 / RADIUS)
    driven.run()

    assert driven.command_values[0] == 0.0


# ST17.
def test_references_of_another_controller_last_one_tick() -> None:
    driven = drive()
    names = driven.system.reference_interfaces
    assert names == (f"{NAME}/linear/velocity", f"{NAME}/angular/velocity")

    driven.run(references=(0.1, 0.2))
    assert driven.command_values[0] == pytest.approx(0.1 / RADIUS)
    assert driven.command_values[1] == pytest.approx(math.atan(0.2 * WHEELBASE / 0.1))
    driven.run(refer(0.1, 0.2), references=(math.nan, math.nan))

    assert driven.command_values[0] == 0.0
    assert driven.reasons() == ["another controller commands the references"]


# ST18.
@pytest.mark.parametrize("use", ["traction", "steering"])
@pytest.mark.parametrize("type_", TYPES)
def test_a_type_has_its_number_of_wheels(type_: str, use: str) -> None:
    name = f"{use}_joints_names"

    with pytest.raises(ParameterError, match=name):
        load(type_, {**UPSTREAM[type_], name: ["a", "b", "c"]})


# ST19.
@pytest.mark.parametrize("type_", TYPES)
def test_a_deactivation_leaves_no_command(type_: str) -> None:
    driven = drive(type_)
    driven.run(refer(0.1, 0.2))

    tick = driven.run(activation=None)
    again = driven.run(activation=2)

    n = NUM_DRIVEN[type_]
    assert np.isnan(tick.command).all()
    assert (again.command[:n] == 0.0).all()
    assert np.isnan(again.command[n:]).all()


def test_what_cannot_be_taken_is_reported() -> None:
    driven = drive(reference_timeout=0.05)
    for _ in range(20):
        driven.run()
    driven.run(refer(0.1, 0.2))

    driven.run(refer(0.3, 0.2, stamp=0.1))
    assert driven.command_values[0] == pytest.approx(0.1 / RADIUS)
    driven.run(refer(math.nan, 0.2))
    assert driven.command_values[0] == 0.0
    driven.run(refer(0.1, math.inf))
    assert driven.command_values[0] == 0.0
    driven.run({**refer(0.1, 0.2), "set_odometry": SetOdometry(y=math.nan)})
    driven.run(refer(0.1, 0.2), activation=None)

    assert driven.reasons() == [
        "header.stamp must be at most 0.05 s (reference_timeout) old, got 0.11 s",
        "linear.x and angular.z must be finite, got [nan, 0.2]",
        "linear.x and angular.z must be finite, got [0.1, inf]",
        "x, y and yaw must be finite, got [0.0, nan, 0.0]",
        "the controller is not active",
    ]


def test_a_request_puts_the_base_somewhere_for_one_tick() -> None:
    driven = drive(traction_wheel_radius=1.0)
    driven.measure([0.0, 0.0, 1.0, 0.0])
    driven.run()

    driven.run({"set_odometry": SetOdometry(1.0, 2.0, math.pi / 2.0)})
    pose = driven.output("odometry").pose.pose
    assert (pose.position.x, pose.position.y) == (1.0, 2.0)
    driven.run()

    # One tick at 1 m/s in the direction of y.
    pose = driven.output("odometry").pose.pose
    np.testing.assert_allclose([pose.position.x, pose.position.y], [1.0, 2.01])


def test_measurements_that_are_not_finite_leave_the_odometry() -> None:
    start = SteeringOdometry(RollingMean(10), PlanarPose(1.0, 2.0, 3.0))

    for bad in (math.nan, math.inf):
        assert start.measure_velocities(SLOW, (bad,), (0.0,), 0.1) is start
        assert start.measure_positions(SLOW, (0.0,), (bad,), 0.1) is start


def test_a_very_short_period_moves_the_base_and_not_the_means() -> None:
    start = SteeringOdometry(RollingMean(10))

    moved = start.measure_velocities(SLOW, (1.0,), (0.0,), 5e-5)

    assert moved.pose.x == 5e-5
    assert moved.velocity == (0.0, 0.0)


def test_humble_takes_messages_without_a_stamp() -> None:
    driven = drive(distro="humble", use_stamped_vel=False)

    driven.run({"reference_unstamped": twist(0.1, 0.0)})

    assert driven.command_values[0] == pytest.approx(0.1 / RADIUS)
    assert driven.system.message_types["reference_unstamped"] is Twist


def test_nothing_is_reported_before_the_first_tick() -> None:
    driven = drive()

    assert driven.output("odometry") == Odometry()
    assert driven.output("tf_odometry") == TFMessage()
    assert driven.output("controller_state") == SteeringControllerStatus()


def test_states_and_frames_are_of_the_last_tick() -> None:
    driven = drive(TRICYCLE_STEERING, position_feedback=True, tf_frame_prefix="a/")
    driven.measure([0.1, 0.2, 0.3])
    driven.run(refer(0.1, 0.0))

    driven.run(activation=None)

    status = driven.output("controller_state")
    assert status.traction_wheels_position == (0.1, 0.2)
    assert status.traction_wheels_velocity == ()
    assert status.steer_positions == (0.3,)
    assert status.traction_command == pytest.approx(driven.command_values[:2])
    assert status.steering_angle_command == (0.0,)
    (transform,) = driven.output("tf_odometry").transforms
    names = (transform.header.frame_id, transform.child_frame_id)
    assert names == ("a/odom", "a/base_link")


def test_there_is_no_transform_if_it_is_switched_off() -> None:
    assert not drive(enable_odom_tf=False).system.HasOutputPort("tf_odometry")


def test_a_message_may_be_as_old_as_the_timeout() -> None:
    driven = drive(reference_timeout=0.05)
    for _ in range(20):
        driven.run()

    # At 0.20 s.
    driven.run(refer(0.3, 0.0, stamp=0.15))

    assert driven.command_values[0] == pytest.approx(0.3 / RADIUS)
    assert driven.reasons() == []


def test_a_pose_that_is_set_makes_the_means_anew() -> None:
    start = SteeringOdometry(RollingMean(10))
    moved = start.measure_velocities(SLOW, (1.0,), (0.0,), 0.1)

    posed = moved.set_pose(PlanarPose(1.0, 2.0, 0.0))
    again = posed.measure_velocities(SLOW, (3.0,), (0.0,), 0.1)

    # The last velocity is told until there is a new one.
    assert posed.velocity == (1.0, 0.0)
    assert again.velocity == (3.0, 0.0)


def test_velocities_are_differences_of_positions() -> None:
    start = SteeringOdometry(RollingMean(1))

    # Upstream takes the wheels to have been at 0 before the first tick.
    first = start.measure_positions(SLOW, (0.2,), (0.0,), 0.1)
    second = first.measure_positions(SLOW, (0.5,), (0.0,), 0.1)

    assert first.velocity.v == pytest.approx(2.0, rel=1e-15)
    assert second.velocity.v == pytest.approx(3.0, rel=1e-15)
    assert second.pose.x == pytest.approx(0.5, rel=1e-15)


@pytest.mark.parametrize(("track_width", "width"), [(0.0, 0.8), (0.6, 0.6)])
def test_steered_wheels_have_a_track_width_of_their_own(
    track_width: float, width: float
) -> None:
    driven = drive(
        ACKERMANN,
        wheelbase=1.2,
        traction_track_width=0.8,
        steering_track_width=track_width,
        open_loop=True,
    )

    driven.run(refer(1.0, 0.5))

    # About a center 2 m to the left of the driven axle.
    angles = [math.atan(1.2 / (2.0 + side * width / 2.0)) for side in (1.0, -1.0)]
    np.testing.assert_allclose(driven.command_values[2:], angles, rtol=1e-14)
