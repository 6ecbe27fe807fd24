"""Sensors of `<ros2_control>` get the places that their authors have written."""

import math
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake import interfaces
from tests import models
from tests.robots import load_real_robot

FORCE = "".join(f'<state_interface name="{name}"/>' for name in interfaces.FORCES)
FTS = "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster"


def urdf(sensor: str, extra: str = "") -> str:
    """Return two links on joints, with a `<sensor>`."""
    control = models.ros2_control("upper_joint").replace(
        "</ros2_control>", f"{sensor}</ros2_control>"
    )
    return f"""<robot name="arm"><link name="base"/>{models.bob("upper")}
    {models.bob("tool")}{models.joint("upper_joint", "base", "upper")}
    {models.joint("tool_joint", "upper", "tool", type="fixed")}{control}{extra}
    </robot>"""


def load(
    folder: Path, sensor: str, extra: str = "", yaml: str | None = None
) -> ad.Robot:
    (folder / "robot.urdf").write_text(urdf(sensor, extra))
    controllers = None
    if yaml is not None:
        controllers = folder / "controllers.yaml"
        controllers.write_text(yaml)
    return ad.load_robot(folder / "robot.urdf", controllers=controllers)


def broadcaster(parameters: str) -> str:
    return f"""
controller_manager:
  ros__parameters:
    wrench: {{type: {FTS}}}
wrench:
  ros__parameters: {{{parameters}}}
"""


TAG = """<gazebo reference="{}"><sensor name="fts" type="force_torque">
<pose>{}</pose><force_torque><frame>sensor</frame></force_torque></sensor></gazebo>"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "extra", "yaml", "link"),
    [
        # Each says something, from the surest to the least sure; the first one holds.
        (
            f'<sensor name="fts">{FORCE}<param name="frame_id">base</param></sensor>',
            TAG.format("tool", "1 2 3 0 0 0"),
            broadcaster("sensor_name: fts, frame_id: upper"),
            "tool",
        ),
        (
            f'<sensor name="fts">{FORCE}<param name="frame_id">tool</param></sensor>',
            "",
            broadcaster("sensor_name: fts, frame_id: upper"),
            "tool",
        ),
        (
            f'<sensor name="upper">{FORCE}</sensor>',
            "",
            broadcaster("sensor_name: upper, frame_id: tool"),
            "tool",
        ),
        (
            f'<sensor name="upper">{FORCE}</sensor>',
            "",
            broadcaster("interface_names.force.z: upper/force.z, frame_id: tool"),
            "tool",
        ),
        (f'<sensor name="tool">{FORCE}</sensor>', "", None, "tool"),
        # A joint stands for its child.
        (
            f'<sensor name="fts">{FORCE}</sensor>',
            TAG.format("tool_joint", "0 0 0 0 0 0"),
            None,
            "tool",
        ),
    ],
)
def test_a_sensor_is_where_the_surest_source_has_it(
    tmp_path: Path, sensor: str, extra: str, yaml: str | None, link: str
) -> None:
    robot = load(tmp_path, sensor, extra, yaml)

    (info,) = robot.sensors
    assert info.link == link
    assert info.joint == "tool_joint"
    assert info.interfaces == interfaces.FORCES
    assert not robot.report.errors


@pytest.mark.slow
def test_a_tag_of_gazebo_says_where_in_the_link(tmp_path: Path) -> None:
    sensor = f'<sensor name="fts">{FORCE}</sensor>'

    robot = load(tmp_path, sensor, TAG.format("tool", "1 2 3 0.1 0.2 0.3"))

    # Forces are those of the joint; along the sensor's axes, if it says so.
    assert robot.sensors[0].pose == (0.0, 0.0, 0.0, 0.1, 0.2, 0.3)
    in_child = TAG.format("tool", "1 2 3 0.1 0.2 0.3").replace(">sensor<", ">child<")
    assert load(tmp_path, sensor, in_child).sensors[0].pose == (0.0,) * 6


@pytest.mark.slow
def test_a_pose_may_be_in_degrees(tmp_path: Path) -> None:
    rate = '<state_interface name="angular_velocity.x"/>'
    tag = """<gazebo reference="tool"><sensor name="imu" type="imu">
    <pose degrees="true" relative_to="base">1 2 3 90 0 -180</pose></sensor></gazebo>"""

    robot = load(tmp_path, f'<sensor name="imu">{rate}</sensor>', tag)

    assert robot.sensors[0].pose == (1.0, 2.0, 3.0, math.pi / 2.0, 0.0, -math.pi)
    assert "sensor 'imu': pose: relative_to 'base'; it is taken as relative to" in str(
        robot.report
    )


@pytest.mark.slow
def test_another_kind_of_sensor_of_the_same_name_gives_no_place(tmp_path: Path) -> None:
    sensor = f'<sensor name="fts">{FORCE}<param name="frame_id">tool</param></sensor>'
    camera = TAG.format("upper", "1 2 3 0 0 0").replace('"force_torque"', '"camera"')

    robot = load(tmp_path, sensor, camera)

    assert robot.sensors[0].link == "tool"


@pytest.mark.slow
def test_a_load_on_a_loose_link_is_no_load(tmp_path: Path) -> None:
    sensor = f'<sensor name="fts">{FORCE}<param name="frame_id">tool</param></sensor>'
    fixed, loose = 'name="tool_joint" type="fixed"', 'name="loose" type="floating"'
    (tmp_path / "robot.urdf").write_text(urdf(sensor).replace(fixed, loose))

    robot = ad.load_robot(tmp_path / "robot.urdf")

    assert robot.sensors == ()
    assert "link 'tool' is held by no joint that carries a load" in str(robot.report)
    ad.build_diagram(robot)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tool_link", "tool_frame"])
def test_a_link_may_be_named_after_its_sensor(tmp_path: Path, name: str) -> None:
    sensor = f'<sensor name="tool">{FORCE}</sensor>'
    (tmp_path / "robot.urdf").write_text(
        urdf(sensor).replace('"tool"/>', f'"{name}"/>')
    )
    text = urdf(sensor).replace('link name="tool"', f'link name="{name}"')
    (tmp_path / "robot.urdf").write_text(
        text.replace('child link="tool"', f'child link="{name}"')
    )

    robot = ad.load_robot(tmp_path / "robot.urdf")

    assert robot.sensors[0].link == name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "extra", "yaml", "severity", "message"),
    [
        (
            f'<sensor name="fts">{FORCE}</sensor>',
            "",
            None,
            "warning",
            "sensor 'fts': nothing says which link it is on; expected a <gazebo> "
            'sensor of its name, <param name="frame_id">, or the frame_id of a '
            "controller that reads it; known: base, tool, upper; its states keep their "
            "initial values",
        ),
        (
            f'<sensor name="fts">{FORCE}</sensor>',
            "",
            broadcaster("sensor_name: fts, frame_id: tol"),
            "error",
            "sensor 'fts': frame_id of controller 'wrench' names no link: 'tol'; ",
        ),
        (
            f'<sensor name="fts">{FORCE}<param name="frame_id">base</param></sensor>',
            "",
            None,
            "error",
            "sensor 'fts': link 'base' is held by no joint that carries a load",
        ),
        (
            f'<sensor name="fts">{FORCE}</sensor>',
            TAG.format("tool", "1 2 three"),
            None,
            "warning",
            "sensor 'fts': pose: expected x, y, z, roll, pitch, yaw, got '1 2 three'; "
            "it is where its link is",
        ),
        (
            f'<sensor name="fts">{FORCE}<param name="frame_id">tol</param></sensor>',
            "",
            broadcaster("sensor_name: fts, frame_id: tool"),
            "warning",
            "sensor 'fts': its parameter frame_id names no link: 'tol'; it is "
            "measured in 'tool', as frame_id of controller 'wrench' has it",
        ),
    ],
)
def test_a_sensor_without_a_place_says_what_is_missing(
    tmp_path: Path,
    sensor: str,
    extra: str,
    yaml: str | None,
    severity: str,
    message: str,
) -> None:
    robot = load(tmp_path, sensor, extra, yaml)

    lines = [str(entry) for entry in robot.report if entry.severity == severity]
    assert any(message in line for line in lines), str(robot.report)


def test_a_sensor_without_a_place_keeps_its_initial_values(tmp_path: Path) -> None:
    value = '<param name="initial_value">3.5</param>'
    state = f'<state_interface name="force.z">{value}</state_interface>'
    robot = load(
        tmp_path,
        f'<sensor name="fts">{state}</sensor>',
        yaml=broadcaster("interface_names.force.z: fts/force.z, frame_id: nowhere"),
    )
    sim = ad.Simulation(ad.build_diagram(robot))

    sim.run(0.1)

    assert sim.topic("/wrench/wrench").value().wrench.force.z == 3.5


def test_the_sensor_of_a_published_robot_has_a_place() -> None:
    robot = load_real_robot("demo04_rrbot_system_w")

    (info,) = robot.sensors
    assert (info.name, info.link) == ("tcp_fts_sensor", "tool_link")
    assert info.interfaces == ("force.x", "torque.z")
