"""Sensors in `<gazebo>` tags: each is simulated, or the report says that it isn't."""

from pathlib import Path

import pytest

from arm_drake.description import perception_sensors
from tests import models

CONTROL = models.ros2_control("slide").replace(
    "</ros2_control>",
    '<sensor name="s"><state_interface name="force.x"/></sensor></ros2_control>',
)


def lines_of(folder: Path, *types: str, control: str | None = None) -> list[str]:
    """Return what is told of sensors "s" of these types, without their file."""
    tags = "".join(f'<sensor name="s" type="{kind}"/>' for kind in types)
    urdf = models.LIFT.replace(
        "</robot>", f'<gazebo reference="load">{tags}</gazebo></robot>'
    )
    if control is not None:
        urdf = urdf.replace(models.ros2_control("slide"), control)
    report = models.load(folder, urdf).report
    return [
        f"{e.severity}: {e.where}: {e.what}; {e.done}"
        for e in report
        if "sensor 's'" in str(e)
    ]


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("altimeter", "sensors of type 'altimeter' are not simulated"),
        ("magnetometer", "sensors of type 'magnetometer' are not simulated"),
        ("navsat", "sensors of type 'navsat' are not simulated"),
        ("gps", "sensors of type 'gps' are not simulated"),
        ("air_pressure", "sensors of type 'air_pressure' are not simulated"),
        (
            "force_torque",
            "of type 'force_torque', without a <sensor> of its name in <ros2_control>",
        ),
    ],
)
def test_what_is_not_simulated_has_a_line(tmp_path: Path, kind: str, line: str) -> None:
    # Not because of its name, which a sensor that is simulated has, too.
    assert lines_of(tmp_path, kind, "imu") == [
        f"warning: sensor 's': {line}; nothing is published"
    ]


@pytest.mark.parametrize(
    ("kind", "hint"), [("imuu", "did you mean 'imu'?"), ("gpu_lidr", "'gpu_lidar'")]
)
def test_a_misspelt_type_has_a_line_with_what_is_meant(
    tmp_path: Path, kind: str, hint: str
) -> None:
    (line,) = lines_of(tmp_path, kind)

    assert line.startswith(f"warning: sensor 's': unknown type {kind!r}; ")
    assert hint in line


@pytest.mark.parametrize("kind", ["imu", "contact", "force_torque", "sonar", ""])
def test_what_measures_for_ros2_control_needs_no_line(
    tmp_path: Path, kind: str
) -> None:
    lines = lines_of(tmp_path, kind, control=CONTROL)

    assert not [line for line in lines if "simulated" in line or "type" in line]


@pytest.mark.parametrize("kind", perception_sensors.TYPES)
def test_what_cameras_and_lidars_are_is_known_to_be_simulated(
    tmp_path: Path, kind: str
) -> None:
    lines = lines_of(tmp_path, kind)

    assert not [line for line in lines if "simulated" in line or "type" in line]
