import dataclasses as dc
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import arm_drake as ad
from arm_drake.controllers.force_torque_sensor_broadcaster import (
    ForceTorqueSensorBroadcaster,
)
from arm_drake.controllers.sensor_broadcasters import (
    GPSSensorBroadcaster,
    IMUSensorBroadcaster,
    MagnetometerBroadcaster,
    PoseBroadcaster,
    RangeSensorBroadcaster,
    StateInterfacesBroadcaster,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    Header,
    PoseStamped,
    Quaternion,
    TFMessage,
    Time,
    Vector3,
    Wrench,
    WrenchStamped,
)
from arm_drake.messages.sensors import (
    Float64Values,
    Imu,
    MagneticField,
    NavSatFix,
    NavSatStatus,
    Range,
)
from arm_drake.plant.kinematics import PlantKinematics
from tests import models
from tests.controllers.driving import NAME, Driven, make_params
from tests.controllers.parameters import (
    GPS,
    IMU,
    MAGNETOMETER,
    MINIMAL,
    POSE,
    RANGE,
    STATES,
    WRENCH,
    load,
    report_of,
)

SYSTEMS: Mapping[str, Any] = {
    IMU: IMUSensorBroadcaster,
    WRENCH: ForceTorqueSensorBroadcaster,
    RANGE: RangeSensorBroadcaster,
    POSE: PoseBroadcaster,
    GPS: GPSSensorBroadcaster,
    MAGNETOMETER: MagnetometerBroadcaster,
    STATES: StateInterfacesBroadcaster,
}

# What the hardware reports, by the type that reads all of it; the sensor is "s", the
# pose "p".
FORCES = tuple(f"s/{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
READ: Mapping[str, tuple[str, ...]] = {
    IMU: (
        *(f"s/orientation.{axis}" for axis in "xyzw"),
        *(f"s/angular_velocity.{axis}" for axis in "xyz"),
        *(f"s/linear_acceleration.{axis}" for axis in "xyz"),
    ),
    WRENCH: FORCES,
    RANGE: ("s/range",),
    POSE: (
        *(f"p/position.{axis}" for axis in "xyz"),
        *(f"p/orientation.{axis}" for axis in "xyzw"),
    ),
    GPS: tuple(
        f"s/{name}"
        for name in ("status", "service", "latitude", "longitude", "altitude")
    ),
    MAGNETOMETER: tuple(f"s/magnetic_field.{axis}" for axis in "xyz"),
    STATES: ("a/position",),
}
TOPICS = {
    IMU: "imu",
    WRENCH: "wrench",
    RANGE: "range",
    POSE: "pose",
    GPS: "gps/fix",
    MAGNETOMETER: "magnetic_field",
    STATES: "values",
}

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
DIAGONAL = (1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0)


def drive(
    type_: str,
    values: Mapping[str, Any] | None = None,
    *,
    available: tuple[str, ...] | None = None,
    distro: str = "kilted",
    **hardware_interfaces: Any,
) -> Driven:
    """Return a broadcaster of hardware that reports what it reads, and "other"."""
    parameters = load(type_, values, distro=distro)
    measured = ("other", *(READ[type_] if available is None else available))
    params = dc.replace(
        make_params((), distro=distro),
        measured=measured,
        state_interfaces=frozenset(measured),
        **hardware_interfaces,
    )
    return Driven(SYSTEMS[type_](parameters, params))


def publish(driven: Driven, values: Any, topic: str = "") -> Any:
    """Run a cycle in which the sensor measures values; return what is published."""
    driven.measure([-99.0, *values])
    driven.run()
    return driven.output(topic) if topic else None


def numbers(vector: Any) -> tuple[float, ...]:
    return tuple(getattr(vector, axis) for axis in "xyzw" if hasattr(vector, axis))


def wrench_of(message: WrenchStamped) -> tuple[float, ...]:
    return (*numbers(message.wrench.force), *numbers(message.wrench.torque))


def turned(parameters: Mapping[str, Any], values: Any) -> Imu:
    parameters = {f"rotation_offset.{key}": value for key, value in parameters.items()}
    parameters["static_covariance_orientation"] = list(DIAGONAL)
    parameters["static_covariance_angular_velocity"] = list(DIAGONAL)
    parameters["static_covariance_linear_acceleration"] = list(DIAGONAL)
    message: Imu = publish(drive(IMU, parameters), values, "imu")
    return message


@pytest.mark.parametrize("type_", SYSTEMS)
def test_it_reads_its_interfaces_and_commands_none(type_: str) -> None:  # B18b, B20c
    driven = drive(type_)

    assert driven.system.state_interfaces == READ[type_]
    assert driven.system.command_interfaces == ()


@pytest.mark.parametrize("type_", SYSTEMS)
def test_what_was_published_last_stays_when_it_is_inactive(type_: str) -> None:  # B14b
    driven = drive(type_)
    values = np.arange(1.0, len(READ[type_]) + 1.0)
    before = publish(driven, values, TOPICS[type_])

    driven.measure([-99.0, *(values + 1.0)])
    driven.run(activation=None)

    assert driven.output(TOPICS[type_]) is before
    assert driven.system.state_interfaces == READ[type_]


@pytest.mark.parametrize("type_", SYSTEMS)
def test_the_header_is_that_of_the_tick(type_: str) -> None:  # B20d
    driven = drive(type_)
    values = [0.0] * len(READ[type_])

    publish(driven, values)
    message = publish(driven, values, TOPICS[type_])

    # The second tick of 100 Hz; only `values` has no frame.
    frame = "" if type_ == STATES else "f"
    assert message.header == Header(Time(0, 10_000_000), frame)


@pytest.mark.parametrize(
    ("type_", "default"),
    [
        (IMU, Imu()),
        (RANGE, Range()),
        (POSE, PoseStamped()),
        (GPS, NavSatFix()),
        (MAGNETOMETER, MagneticField()),
    ],
)
def test_before_the_first_tick_there_is_a_default_message(
    type_: str, default: Any
) -> None:
    assert drive(type_).output(TOPICS[type_]) == default


@pytest.mark.parametrize(
    ("type_", "name"),
    [
        *(
            (type_, name)
            for type_ in (IMU, RANGE, GPS, MAGNETOMETER)
            for name in ("sensor_name", "frame_id")
        ),
        (POSE, "pose_name"),
        (POSE, "frame_id"),
        (WRENCH, "frame_id"),
    ],
)
def test_a_name_that_is_missing_or_empty_is_refused(  # B7, B14, B19d, B20b
    type_: str, name: str
) -> None:
    with pytest.raises(ParameterError) as missing:
        load(type_, without=(name,))
    with pytest.raises(ParameterError) as empty:
        load(type_, {name: ""})

    assert str(missing.value) == f"c.yaml: c.{name}: is required but missing"
    line = [*{**MINIMAL[type_], name: ""}].index(name) + 1
    assert str(empty.value) == f"c.yaml:{line}: c: {name} must not be empty, got ''"


def test_imu_values_come_in_the_order_of_the_interfaces() -> None:  # B1
    message = publish(drive(IMU), range(1, 11), "imu")

    assert numbers(message.orientation) == (1.0, 2.0, 3.0, 4.0)
    assert numbers(message.angular_velocity) == (5.0, 6.0, 7.0)
    assert numbers(message.linear_acceleration) == (8.0, 9.0, 10.0)


def test_imu_covariances_are_the_parameters() -> None:
    parameters = {
        f"static_covariance_{name}": [float(first + i) for i in range(9)]
        for first, name in (
            (0, "orientation"),
            (10, "angular_velocity"),
            (20, "linear_acceleration"),
        )
    }

    message = publish(drive(IMU, parameters), [0.0] * 10, "imu")

    assert message.orientation_covariance == tuple(range(9))
    assert message.angular_velocity_covariance == tuple(range(10, 19))
    assert message.linear_acceleration_covariance == tuple(range(20, 29))


@pytest.mark.parametrize(
    ("offset", "diagonal"),
    [
        ({"yaw": math.pi / 2}, (2, 1, 3)),  # B2
        ({"yaw": -math.pi / 2}, (2, 1, 3)),
        ({"roll": math.pi / 2}, (1, 3, 2)),  # B3
        ({"pitch": math.pi / 2}, (3, 2, 1)),
    ],
)
def test_imu_covariances_turn_with_the_offset(
    offset: dict[str, float], diagonal: tuple[float, ...]
) -> None:
    message = turned(offset, [0.0] * 10)

    # cos(pi/2) is off 0 by 6e-17, and covariances are up to 3.
    expected = np.diag(diagonal).ravel()
    for covariance in (
        message.angular_velocity_covariance,
        message.linear_acceleration_covariance,
    ):
        np.testing.assert_allclose(covariance, expected, rtol=0, atol=1e-14)
    assert message.orientation_covariance == DIAGONAL  # B6


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        ({"yaw": math.pi / 2}, (-2.0, 1.0, 3.0)),  # B4
        ({"roll": math.pi, "yaw": math.pi / 2}, (2.0, 1.0, -3.0)),  # B5
    ],
)
def test_imu_vectors_turn_with_the_offset(
    offset: dict[str, float], expected: tuple[float, ...]
) -> None:
    message = turned(offset, [0, 0, 0, 1, 1, 2, 3, 1, 2, 3])

    # sin(pi) is off 0 by 1.2e-16, and values are up to 3.
    for vector in (message.angular_velocity, message.linear_acceleration):
        np.testing.assert_allclose(numbers(vector), expected, rtol=0, atol=1e-14)


def test_imu_offset_acts_as_an_independent_library_says() -> None:  # B6
    roll, pitch, yaw = 0.3, -0.5, 1.1
    rotation = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    measured = pin.Quaternion(0.1, -0.7, 0.5, 0.3).normalized()
    values = [*measured.coeffs(), 0.2, -3.0, 4.0, 9.0, -1.0, 2.0]
    offset = {"roll": roll, "pitch": pitch, "yaw": yaw}

    at_rest = turned(offset, [0, 0, 0, 1, *values[4:]])
    message = turned(offset, values)

    # Rounding of products of a few numbers up to 10.
    close = {"rtol": 0, "atol": 1e-14}
    inverse = pin.Quaternion(rotation).inverse()
    if numbers(at_rest.orientation)[3] * inverse.w < 0.0:
        inverse = pin.Quaternion(-inverse.coeffs())
    expected = (measured * inverse).coeffs()
    np.testing.assert_allclose(numbers(at_rest.orientation), inverse.coeffs(), **close)
    np.testing.assert_allclose(numbers(message.orientation), expected, **close)
    np.testing.assert_allclose(
        numbers(message.angular_velocity), rotation @ values[4:7], **close
    )
    np.testing.assert_allclose(
        numbers(message.linear_acceleration), rotation @ values[7:], **close
    )
    np.testing.assert_allclose(
        message.angular_velocity_covariance,
        (rotation @ np.diag([1.0, 2.0, 3.0]) @ rotation.T).ravel(),
        **close,
    )


def test_an_imu_orientation_of_any_length_keeps_it() -> None:
    message = turned({"roll": 0.3, "yaw": 2.0}, [1, 2, 3, 4, 0, 0, 0, 0, 0, 0])

    # |q r| = |q| |r|, and |(1, 2, 3, 4)|^2 = 30; rounding.
    assert sum(n * n for n in numbers(message.orientation)) == pytest.approx(30.0)


def test_without_an_offset_nan_stays_on_its_axis() -> None:
    values = [0.0, 0.0, 0.0, 1.0, math.nan, 2.0, 3.0, 4.0, 5.0, 6.0]

    message = publish(drive(IMU), values, "imu")

    np.testing.assert_array_equal(
        numbers(message.angular_velocity), [math.nan, 2.0, 3.0]
    )


@pytest.mark.parametrize("type_", [IMU, WRENCH])
@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted", "rolling"])
def test_what_is_published_is_exported_but_in_humble(type_: str, distro: str) -> None:
    driven = drive(type_, distro=distro)
    values = np.arange(1.0, len(READ[type_]) + 1.0)

    publish(driven, values)

    exported = driven.system.exported_interfaces
    if distro == "humble":
        assert exported == ()
    else:
        assert exported == tuple(f"{NAME}/{name}" for name in READ[type_])
        np.testing.assert_array_equal(
            driven.output("exported_state_interfaces"), values
        )


def test_a_turned_imu_exports_what_it_publishes() -> None:
    driven = drive(IMU, {"rotation_offset.yaw": math.pi / 2})

    publish(driven, [0, 0, 0, 1, 1, 2, 3, 1, 2, 3])

    # A quarter turn back about z, then (1, 2, 3) turned a quarter; rounding of pi/2.
    half = math.sqrt(0.5)
    expected = [0, 0, -half, half, -2, 1, 3, -2, 1, 3]
    exported = driven.output("exported_state_interfaces")
    np.testing.assert_allclose(exported, expected, rtol=0, atol=1e-15)


SIX = (1.1, 2.2, 3.3, 4.4, 5.5, 6.6)


def test_a_wrench_is_force_and_torque() -> None:  # B8
    driven = drive(WRENCH)

    message = publish(driven, SIX, "wrench")

    assert message.wrench == Wrench(Vector3(1.1, 2.2, 3.3), Vector3(4.4, 5.5, 6.6))
    assert not driven.system.HasOutputPort("wrench_filtered")


def test_a_wrench_is_offset_and_then_multiplied() -> None:  # B9
    offset = (10.0, 30.0, -2.0, 0.5, -0.25, 7.0)
    multiplier = (2.0, -1.0, 0.0, 4.0, 0.5, 3.0)
    parameters = {
        f"{group}.{name.removeprefix('s/')}": value
        for group, values in (("offset", offset), ("multiplier", multiplier))
        for name, value in zip(FORCES, values, strict=True)
    }

    message = publish(drive(WRENCH, parameters), (1, 2, 3, 4, 5, 6), "wrench")

    # Binary fractions, so without rounding.
    assert wrench_of(message) == (22.0, -32.0, 0.0, 18.0, 2.375, 39.0)


def test_axes_without_an_interface_are_nan() -> None:  # B10
    parameters = {
        "sensor_name": "",
        "interface_names.force.x": "s/force.x",
        "interface_names.torque.z": "t/z",
    }
    driven = drive(WRENCH, parameters, available=("t/z", "s/force.x"))

    message = publish(driven, (6.6, 1.1), "wrench")

    expected = [1.1, *[math.nan] * 4, 6.6]
    np.testing.assert_array_equal(wrench_of(message), expected)
    assert driven.system.state_interfaces == ("s/force.x", "t/z")
    assert driven.system.exported_interfaces == (f"{NAME}/s/force.x", f"{NAME}/t/z")
    np.testing.assert_array_equal(
        driven.output("exported_state_interfaces"), [1.1, 6.6]
    )


@pytest.mark.parametrize(
    ("parameters", "got"),
    [
        ({"interface_names.force.x": "s/force.x"}, "both"),  # B11
        ({"sensor_name": ""}, "neither"),
        (  # B12
            {
                "sensor_name": "",
                **{f"interface_names.{n.removeprefix('s/')}": "" for n in FORCES},
            },
            "neither",
        ),
    ],
)
def test_a_wrench_has_either_a_sensor_or_interfaces(
    parameters: dict[str, Any], got: str
) -> None:
    with pytest.raises(ParameterError) as error:
        load(WRENCH, parameters)

    assert str(error.value) == (
        f"c.yaml: c: expected either sensor_name or interface_names, got {got}"
    )


def chain(number: int, name: str, **parameters: Any) -> dict[str, Any]:
    start = f"sensor_filter_chain.filter{number}"
    values = {
        "sampling_frequency": 200.0,
        "damping_frequency": 50,
        "damping_intensity": 1.0,
        **parameters,
    }
    return {
        f"{start}.name": name,
        f"{start}.type": "control_filters/LowPassFilterWrench",
        **{f"{start}.params.{key}": value for key, value in values.items()},
    }


def test_a_filtered_wrench_is_that_of_its_filters_in_a_row() -> None:
    parameters = {
        **chain(1, "first"),
        **chain(2, "second", damping_frequency=5.0),
        "offset.force.x": 1.0,
    }
    driven = drive(WRENCH, parameters)
    samples = [(0.0, *SIX[1:]), (7.0, *SIX[1:]), (7.0, *SIX[1:])]

    messages = [publish(driven, sample, "wrench_filtered") for sample in samples]

    # y_k = b x_(k-1) + a y_(k-1), from the first sample on: of 1, 8, 8 the first filter
    # makes 1, 1, 8 b + a, and the second 1, 1, 1.
    a = math.exp(-2 * math.pi * 50 / 200 * 10**0.1)
    a2 = math.exp(-2 * math.pi * 5 / 200 * 10**0.1)
    assert [m.wrench.force.x for m in messages] == pytest.approx([1.0] * 3, abs=1e-15)
    fourth = publish(driven, samples[-1], "wrench_filtered").wrench.force.x
    first = 8.0 * (1.0 - a) + a
    assert fourth == pytest.approx((1.0 - a2) * first + a2, abs=1e-14)
    assert messages[0].header == Header(Time(), "f")
    # The other axes don't change; rounding.
    assert wrench_of(messages[-1])[1:] == pytest.approx(SIX[1:])
    assert wrench_of(driven.output("wrench")) == (8.0, *SIX[1:])


KEY = "sensor_filter_chain.filter1"


def test_a_wrench_is_smoothed_exponentially() -> None:
    parameters = {
        f"{KEY}.name": "first",
        f"{KEY}.type": "control_filters/ExponentialFilterWrench",
        f"{KEY}.params.alpha": 0.7,
    }
    driven = drive(WRENCH, parameters)

    first, second = (
        wrench_of(publish(driven, sample, "wrench_filtered"))
        for sample in (SIX, [0.0] * 6)
    )

    assert first == pytest.approx(SIX)
    assert second == pytest.approx([0.3 * value for value in SIX])


def test_filters_go_on_where_they_were() -> None:
    driven = drive(WRENCH, chain(1, "first"))
    publish(driven, [0.0] * 6)
    driven.run(activation=None)
    driven.measure([-99.0, *[8.0] * 6])

    driven.run(activation=2)

    # The sample before it was 0.
    assert wrench_of(driven.output("wrench_filtered")) == (0.0,) * 6


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {f"{KEY}.type": "control_filters/LowPassFilterDouble"},
            "type: no filter of wrenches 'control_filters/LowPassFilterDouble'; did "
            "you mean 'control_filters/LowPassFilterWrench'? known: "
            "control_filters/ExponentialFilterWrench, "
            "control_filters/GravityCompensationWrench, "
            "control_filters/LowPassFilterWrench",
        ),
        (
            {f"{KEY}.type": "control_filters/ExponentialFilterWrench"},
            "params.alpha: is required but missing",
        ),
        (
            {
                f"{KEY}.type": "control_filters/ExponentialFilterWrench",
                f"{KEY}.params.alpha": 1.5,
            },
            "params: alpha must be from 0 to 1, got 1.5",
        ),
        ({f"{KEY}.name": 3}, "name: expected str, got 3"),
        (
            {f"{KEY}.params.damping_frequency": "5"},
            "params.damping_frequency: expected float, got '5'",
        ),
        (
            {f"{KEY}.params.damping_frequency": 0.0},
            "params: damping_frequency must be above 0, got 0.0",
        ),
    ],
)
def test_a_filter_that_cannot_be_made_is_an_error(
    parameters: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError) as error:
        drive(WRENCH, {**chain(1, "first"), **parameters})

    assert str(error.value) == f"{KEY}.{message}"


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (
            f"{KEY}.params.divider",
            "the filter has no such parameter; known: damping_frequency, "
            "damping_intensity, sampling_frequency",
        ),
        (
            "sensor_filter_chain.filter3.name",
            "belongs to no filter; they are numbered from filter1 on, and the chain "
            "has 1, each with name, type and params",
        ),
    ],
)
def test_what_belongs_to_no_filter_is_reported(more: str, problem: str) -> None:
    parameters = {"sensor_name": "s", **chain(1, "first")}

    lines = report_of(WRENCH, {**parameters, more: "x"})

    assert lines == [f"warning: {more}: {problem}; it has no effect"]
    assert report_of(WRENCH, parameters) == []


def test_filters_are_whole_and_have_names_of_their_own() -> None:
    whole = chain(1, "first")
    for key in whole:
        rest = {name: value for name, value in whole.items() if name != key}
        with pytest.raises(ParameterError) as error:
            drive(WRENCH, rest)
        assert str(error.value) == f"{key}: is required but missing"
    with pytest.raises(ParameterError) as error:
        drive(WRENCH, {**whole, **chain(2, "first")})
    assert str(error.value) == (
        "sensor_filter_chain.filter2.name: must not repeat a name, got 'first'"
    )


def gravity(**parameters: Any) -> dict[str, Any]:
    values = {
        "world_frame": "base",
        "sensor_frame": "base",
        "tool.mass": 5.0,
        "tool.CoG": [0.0, 0.0, 0.0],
        **{key.replace("__", "."): value for key, value in parameters.items()},
    }
    return {
        f"{KEY}.name": "gravity",
        f"{KEY}.type": "control_filters/GravityCompensationWrench",
        **{f"{KEY}.params.{key}": value for key, value in values.items()},
    }


def compensate(
    folder: Path,
    parameters: Mapping[str, Any],
    frame: str,
    joint_state: str = "swing/position",
) -> Driven:
    """Return a broadcaster on a pendulum whose joint is measured before the sensor."""
    robot = models.load(folder, models.pendulum())
    return drive(
        WRENCH,
        {"frame_id": frame, **parameters},
        available=(*READ[WRENCH], joint_state),
        links=tuple(robot.description.links),
        make_kinematics=partial(PlantKinematics, robot.description, {}),
    )


def test_gravity_is_compensated_where_all_frames_are_one(tmp_path: Path) -> None:
    # As upstream's test of the filter.
    driven = compensate(tmp_path, gravity(), "base")

    message = publish(driven, (1, 0, 0, 10, 0, 0, 0), "wrench_filtered")

    assert wrench_of(message) == pytest.approx((1, 0, 9.81 * 5, 10, 0, 0))
    assert driven.system.exported_interfaces == tuple(
        f"{NAME}/{name}" for name in READ[WRENCH]
    )


@pytest.mark.parametrize("sensor", ["base", "bob"])
def test_gravity_is_that_in_the_frame_of_the_wrench(
    tmp_path: Path, sensor: str
) -> None:
    # Gravity along x of the base, 3 N, at 0.5 m along z of the sensor's frame; the bob
    # is turned a quarter about y, its x along -z of the base and its z along x.
    field = {"tool__gravity_field": [1.5, 0.0, 0.0], "tool__mass": 2.0}
    chain = gravity(sensor_frame=sensor, tool__CoG=[0.0, 0.0, 0.5], **field)
    driven = compensate(tmp_path, chain, "bob")

    message = publish(driven, (*[0.0] * 6, math.pi / 2), "wrench_filtered")

    # Along z of the bob; about y if the tool is above the base, else through it.
    moment = 1.5 if sensor == "base" else 0.0
    expected = (0.0, 0.0, -3.0, 0.0, -moment, 0.0)
    assert wrench_of(message) == pytest.approx(expected, abs=1e-15)
    assert driven.system.state_interfaces[6:] == ("swing/position",)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"world_frame": "word"},
            f"{KEY}.params.world_frame: the robot has no link 'word'; known: base, bob",
        ),
        (
            {"tool__CoG": [0.0, 0.0]},
            f"{KEY}.params.tool.CoG: expected 3 floats, got [0.0, 0.0]",
        ),
        (
            {"tool__mass": "1"},
            f"{KEY}.params.tool.mass: expected float, got '1'",
        ),
        (
            {"tool__gravity_field": 9.81},
            f"{KEY}.params.tool.gravity_field: expected list of float, got 9.81",
        ),
    ],
)
def test_a_gravity_compensation_that_cannot_be_made_is_an_error(
    tmp_path: Path, parameters: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError) as error:
        compensate(tmp_path, gravity(**parameters), "base")

    assert str(error.value) == message


def test_a_gravity_compensation_needs_the_frame_of_the_message(tmp_path: Path) -> None:
    with pytest.raises(ParameterError) as error:
        compensate(tmp_path, gravity(), "f")

    assert str(error.value) == "frame_id: the robot has no link 'f'; known: base, bob"


def test_a_gravity_compensation_needs_the_positions_of_joints(tmp_path: Path) -> None:
    with pytest.raises(ParameterError) as error:
        compensate(tmp_path, gravity(), "bob", joint_state="swing/effort")

    assert str(error.value) == (
        f"{KEY}.params: joint 'swing' moves these frames, "
        "but has no state interface 'position'"
    )


RANGE_PARAMETERS = {
    "radiation_type": 1,
    "field_of_view": 0.1,
    "min_range": 0.1,
    "max_range": 7.0,
    "variance": 1.0,
}


def test_a_range_has_the_parameters_of_its_sensor() -> None:  # B13
    message = publish(drive(RANGE, RANGE_PARAMETERS), [3.1], "range")

    assert message == Range(Header(Time(), "f"), 1, 0.1, 0.1, 7.0, 3.1, 1.0)


@pytest.mark.parametrize("value", [0.10, 4.0, 0.0, 6.0, math.inf])
def test_a_range_is_not_clipped(value: float) -> None:  # B14a
    parameters = {"min_range": 0.1, "max_range": 4.0}

    assert publish(drive(RANGE, parameters), [value], "range").range == value


PLACE = (1.1, 2.2, 3.3, 0.5, 0.5, 0.5, 0.5)


def test_a_pose_goes_to_its_topic_and_to_tf() -> None:  # B15
    driven = drive(POSE)
    empty = driven.output("tf")

    message = publish(driven, PLACE, "pose")

    (transform,) = driven.output("tf").transforms
    assert empty == TFMessage()
    assert numbers(message.pose.position) == PLACE[:3]
    assert message.pose.orientation == Quaternion(0.5, 0.5, 0.5, 0.5)
    assert message.header == transform.header == Header(Time(), "f")
    assert transform.child_frame_id == "p"
    assert numbers(transform.transform.translation) == PLACE[:3]
    assert transform.transform.rotation == message.pose.orientation


def test_tf_can_be_switched_off() -> None:  # B16
    driven = drive(POSE, {"tf.enable": False})

    message = publish(driven, PLACE, "pose")

    assert numbers(message.pose.position) == PLACE[:3]
    assert not driven.system.HasOutputPort("tf")


@pytest.mark.parametrize(
    "values",
    [
        *(
            (*PLACE[:index], bad, *PLACE[index + 1 :])
            for index in range(7)
            for bad in (math.nan, math.inf, -math.inf)
        ),
        (*PLACE[:3], 0.0, 0.0, 0.0, 0.0),  # B18a
        # Just beyond a squared norm of 1.01 and 0.99.
        (*PLACE[:3], 0.0, 0.0, 0.0, math.sqrt(1.01) + 1e-9),
        (*PLACE[:3], 0.0, 0.0, 0.0, math.sqrt(0.99) - 1e-9),
    ],
)
def test_an_invalid_pose_is_published_but_not_on_tf(  # B17
    values: tuple[float, ...],
) -> None:
    driven = drive(POSE)
    publish(driven, PLACE)
    last = driven.output("tf")

    message = publish(driven, values, "pose")

    got = (*numbers(message.pose.position), *numbers(message.pose.orientation))
    np.testing.assert_array_equal(got, values)
    assert message.header.stamp == Time(0, 10_000_000)
    assert driven.output("tf") is last


@pytest.mark.parametrize(
    "w", [math.sqrt(1.01) - 1e-9, math.sqrt(0.99) + 1e-9], ids=["long", "short"]
)
def test_an_orientation_may_be_a_little_off_its_length(w: float) -> None:
    driven = drive(POSE)

    publish(driven, (*PLACE[:3], 0.0, 0.0, 0.0, w))

    (transform,) = driven.output("tf").transforms
    assert transform.transform.rotation.w == w


def test_tf_has_the_child_frame_that_is_asked_for() -> None:  # B18
    driven = drive(POSE, {"tf.child_frame_id": "tool"})

    publish(driven, PLACE)

    assert driven.output("tf").transforms[0].child_frame_id == "tool"


FIX = (1.0, 1.0, 1.1, 2.2, 3.3)


@pytest.mark.parametrize(
    ("parameters", "covariance"),
    [
        ({}, (0.0,) * 9),  # B19a
        ({"static_position_covariance": list(IDENTITY)}, IDENTITY),  # B19b
    ],
)
def test_a_fix_has_the_covariance_of_the_parameters(
    parameters: dict[str, Any], covariance: tuple[float, ...]
) -> None:
    message = publish(drive(GPS, parameters), FIX, "gps/fix")

    header = Header(Time(), "f")
    status = NavSatStatus(1, 1)
    assert message == NavSatFix(header, status, 1.1, 2.2, 3.3, covariance, 3)


def test_a_fix_can_tell_its_covariance() -> None:  # B19, B19c
    names = tuple(f"{name}_covariance" for name in READ[GPS][2:])
    parameters = {
        "read_covariance_from_interface": True,
        "static_position_covariance": list(IDENTITY),
    }
    driven = drive(GPS, parameters, available=(*READ[GPS], *names))

    message = publish(driven, (*FIX, 0.5, 0.7, 0.9), "gps/fix")

    assert driven.system.state_interfaces == (*READ[GPS], *names)
    assert message.position_covariance == (0.5, 0, 0, 0, 0.7, 0, 0, 0, 0.9)
    assert message.position_covariance_type == 2


def test_a_fix_without_a_status_is_of_unknown_status() -> None:
    message = publish(drive(GPS), (math.nan, math.nan, *FIX[2:]), "gps/fix")

    # STATUS_UNKNOWN and SERVICE_UNKNOWN of sensor_msgs/NavSatStatus.
    assert message.status == NavSatStatus(-2, 0)
    assert message.latitude == 1.1


@pytest.mark.parametrize(
    ("parameters", "covariance"),
    [
        ({}, (0.0,) * 9),  # B20
        ({"static_covariance": list(IDENTITY)}, IDENTITY),  # B20a
    ],
)
def test_a_magnetic_field_is_copied(
    parameters: dict[str, Any], covariance: tuple[float, ...]
) -> None:
    values = (20e-6, 30e-6, 40e-6)

    message = publish(drive(MAGNETOMETER, parameters), values, "magnetic_field")

    assert message == MagneticField(Header(Time(), "f"), Vector3(*values), covariance)


ANY = ("b/y", "joint1/position", "a/x")


def test_names_and_values_are_in_the_order_of_the_parameter() -> None:  # B21
    driven = drive(STATES, {"interfaces": ["a/x", "b/y"]}, available=ANY)
    before = driven.output("names")

    message = publish(driven, (2.0, 7.0, 1.0), "values")

    assert message == Float64Values(Header(Time()), (1.0, 2.0))
    assert before.keys == ("a/x", "b/y")
    assert driven.output("names") == before


def test_there_must_be_an_interface_to_publish() -> None:  # B22
    with pytest.raises(ParameterError) as error:
        load(STATES, {"interfaces": []})

    assert str(error.value) == "c.yaml:1: c: interfaces must have at least one element"


def test_values_are_nan_before_the_first_tick() -> None:  # B22a
    driven = drive(STATES, {"interfaces": ["a/x", "b/y"]}, available=ANY)

    np.testing.assert_array_equal(driven.output("values").values, [math.nan] * 2)


@pytest.mark.parametrize("kinds", [("position",), ("position", "velocity", "effort")])
def test_values_of_joints_are_in_the_order_of_the_list(  # B22b, B22c
    kinds: tuple[str, ...],
) -> None:
    names = [f"joint{number}/{kind}" for number in (1, 2, 3) for kind in kinds]
    values = {name: 1.1 + index for index, name in enumerate(names)}
    available = tuple(sorted(names, reverse=True))
    driven = drive(STATES, {"interfaces": names}, available=available)

    message = publish(driven, [values[name] for name in available], "values")

    assert message.values == tuple(values.values())


def test_what_is_not_a_double_cannot_be_published() -> None:
    with pytest.raises(ParameterError) as error:
        drive(
            STATES,
            {"interfaces": ["a/x", "b/y"]},
            available=ANY,
            other_types=frozenset(["b/y"]),
        )

    assert str(error.value) == (
        "interfaces: expected state interfaces of type double; 'b/y' aren't"
    )


def test_a_sensor_that_the_robot_lacks_is_named(tmp_path: Path) -> None:
    yaml = f"""
controller_manager:
  ros__parameters:
    imu: {{type: {IMU}}}
    states: {{type: {STATES}}}
imu: {{ros__parameters: {{sensor_name: s, frame_id: bob}}}}
states: {{ros__parameters: {{interfaces: [swing/velocity, swing/position]}}}}
"""
    types = {
        type_: ad.ControllerType(type(load(type_)), SYSTEMS[type_])
        for type_ in (IMU, STATES)
    }
    robot = models.load(tmp_path, models.pendulum(), yaml, controller_types=types)

    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.advance_to(0.05)

    states = {c.name: c.state for c in simulation.list_controllers()}
    assert states == {"imu": "inactive", "states": "active"}
    (error,) = simulation.report.errors
    assert error.where == "imu"
    assert "'s'" in error.what
    # The pendulum hangs at rest.
    assert simulation.eval_output("states.values").values == (0.0, 0.0)
