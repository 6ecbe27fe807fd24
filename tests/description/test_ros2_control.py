"""`<ros2_control>` blocks and Gazebo plugin tags."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    GazeboPlugin,
    HardwareInfo,
    InterfaceInfo,
    read_gazebo_plugins,
    read_hardware,
)


def read(block: str) -> tuple[tuple[HardwareInfo, ...], list[str]]:
    report = LoadReport()
    root = ET.XML(f"<robot>{block}</robot>")
    hardware = read_hardware(root, ["j", "k"], report, Path("arm.urdf"))
    return hardware, [str(entry) for entry in report]


def read_joint(body: str) -> tuple[ComponentInfo, list[str]]:
    (block,), lines = read(
        f'<ros2_control name="h" type="system"><joint name="j">{body}</joint>'
        "</ros2_control>"
    )
    return block.joints[0], lines


def test_a_block_has_its_name_type_plugin_and_parameters():
    (block,), lines = read(
        '<ros2_control name=" h " type="System"><hardware><plugin> a/B </plugin>'
        '<param name="port"> /dev/x </param><param name="empty"/></hardware>'
        "</ros2_control>"
    )

    assert block == HardwareInfo(
        name="h",
        type="system",
        plugin="a/B",
        parameters={"port": "/dev/x", "empty": ""},
    )
    assert lines == []


@pytest.mark.parametrize(
    "hardware", ["", "<hardware/>", "<hardware><plugin/></hardware>"]
)
def test_a_block_may_have_no_plugin(hardware):
    (block,), _ = read(
        f'<ros2_control name="h" type="system">{hardware}</ros2_control>'
    )

    assert block == HardwareInfo(name="h", type="system", plugin="")


def test_every_block_is_read_in_order():
    blocks, _ = read(
        '<ros2_control name="a" type="system"/><ros2_control name="b" type="sensor"/>'
    )

    assert [(block.name, block.type) for block in blocks] == [
        ("a", "system"),
        ("b", "sensor"),
    ]


def test_a_joint_has_its_interfaces_with_limits_and_initial_values():
    joint, lines = read_joint(
        '<command_interface name="position"><param name="min">-1</param>'
        '<param name="max">2</param></command_interface>'
        '<state_interface name="position"><param name="initial_value">0.5</param>'
        '</state_interface><state_interface name="velocity"/>'
        '<param name="offset">3</param>'
    )

    assert joint == ComponentInfo(
        name="j",
        command_interfaces=(
            InterfaceInfo("position", -1.0, 2.0, None, {"min": "-1", "max": "2"}),
        ),
        state_interfaces=(
            InterfaceInfo("position", None, None, 0.5, {"initial_value": "0.5"}),
            InterfaceInfo("velocity"),
        ),
        parameters={"offset": "3"},
    )
    assert joint.has_command_interface("position")
    assert not joint.has_command_interface("velocity")
    assert lines == []


@pytest.mark.parametrize("text", ["", "half", "nan", "1 2"])
@pytest.mark.parametrize("name", ["min", "max", "initial_value"])
def test_a_value_of_a_joint_that_is_no_number_is_reported(name, text):
    joint, lines = read_joint(
        f'<state_interface name="position"><param name="{name}">{text}</param>'
        "</state_interface>"
    )

    assert getattr(joint.state_interfaces[0], name) is None
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': "
        f"position, {name}: expected a number, got {text!r}; taken as not given"
    ]


def test_sensors_and_gpios_keep_any_value_as_text():
    (block,), lines = read(
        '<ros2_control name="h" type="system">'
        '<sensor name="s"><state_interface name="force.x"/></sensor>'
        '<gpio name="g"><command_interface name="vacuum">'
        '<param name="initial_value">true</param></command_interface></gpio>'
        "</ros2_control>"
    )

    assert [i.name for i in block.sensors[0].state_interfaces] == ["force.x"]
    vacuum = block.gpios[0].command_interfaces[0]
    assert vacuum == InterfaceInfo("vacuum", parameters={"initial_value": "true"})
    assert lines == []


def test_a_joint_that_the_robot_lacks_is_left_out_and_reported():
    (block,), lines = read(
        '<ros2_control name="h" type="system"><joint name="x"/><joint name="k"/>'
        "</ros2_control>"
    )

    assert [joint.name for joint in block.joints] == ["k"]
    assert lines == [
        "error: arm.urdf: ros2_control 'h': the robot has no joint 'x'; "
        "the joint's interfaces are left out"
    ]


def test_gazebo_plugins_are_read_with_repeated_fields():
    root = ET.XML(
        "<robot><gazebo/><gazebo reference='a'><plugin name='p' filename='f.so'>"
        "<parameters> a.yaml </parameters><parameters>b.yaml</parameters><!-- c -->"
        "<empty/></plugin><plugin/></gazebo></robot>"
    )

    plugins = read_gazebo_plugins(root)

    assert plugins == (
        GazeboPlugin(
            "p",
            "f.so",
            (("parameters", "a.yaml"), ("parameters", "b.yaml"), ("empty", "")),
        ),
        GazeboPlugin("", ""),
    )
    assert plugins[0].texts("parameters") == ("a.yaml", "b.yaml")
    assert plugins[0].texts("nope") == ()
