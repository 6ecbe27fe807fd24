"""Real robots' `<ros2_control>` blocks, against the index that lists them."""

import contextlib
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from arm_drake.description.gazebo import read_gazebo_plugins, read_joint_plugins
from arm_drake.description.gazebo_plugins import (
    JointPositionController,
    JointStatePublisher,
)
from arm_drake.description.joints import JointInfo, Mimic, find_mimics
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    read_hardware,
)
from arm_drake.description.xacro import expand_xacro
from tests.robots import read_index, real_robot, robot_names, robots_folder

# Parts of a block that the index lists where there are any.
OPTIONAL = ("sensors", "gpios", "transmissions")


def listed_robots() -> list[str]:
    """Return the robots whose blocks the index lists, or "none" without it."""
    with contextlib.suppress(pytest.skip.Exception, pytest.fail.Exception):
        rows = read_index()
        return [n for n, row in rows.items() if "ros2_control" in row["expected"]]
    return ["none"]


def expand(row: dict[str, Any]) -> ET.Element:
    """Return the description of a robot."""
    entry = robots_folder() / row["entry"]
    # Some files use functions of xacro that it calls deprecated.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        packages = PackageFinder(entry, [])
        return ET.XML(expand_xacro(entry, row["xacro_args"], packages, LoadReport()))


def read_joints(root: ET.Element) -> tuple[JointInfo, ...]:
    """Return the joints with their type and `<mimic>`."""
    joints = []
    for joint in root.iterfind("joint"):
        inputs = joint.find("mimic")
        mimic = None
        if inputs is not None:
            mimic = Mimic(
                inputs.attrib["joint"],
                float(inputs.get("multiplier", 1)),
                float(inputs.get("offset", 0)),
            )
        name, joint_type = joint.attrib["name"], joint.attrib["type"]
        joints.append(JointInfo(name, joint_type, "", "", mimic=mimic))
    return tuple(joints)


def names(component: ComponentInfo) -> dict[str, list[str]]:
    return {
        "command": [interface.name for interface in component.command_interfaces],
        "state": [interface.name for interface in component.state_interfaces],
    }


def as_listed(block: HardwareInfo) -> dict[str, Any]:
    """Return a block in the form of the index."""
    listed = {
        "name": block.name,
        "type": block.type,
        "hardware_plugin": block.plugin,
        "joints": {
            joint.name: names(joint)
            | ({"params": joint.parameters} if joint.parameters else {})
            for joint in block.joints
        },
        "sensors": {s.name: names(s)["state"] for s in block.sensors},
        "gpios": {gpio.name: names(gpio) for gpio in block.gpios},
        "transmissions": [transmission.type for transmission in block.transmissions],
    }
    return {k: value for k, value in listed.items() if value or k not in OPTIONAL}


@pytest.mark.parametrize("name", listed_robots())
def test_the_blocks_of_a_real_robot_are_as_the_index_says(name: str) -> None:
    row = read_index()[name]
    root = expand(row)
    joints = [joint.name for joint in read_joints(root)]
    report = LoadReport()

    hardware = read_hardware(root, joints, report, Path("robot.urdf"))

    assert [as_listed(block) for block in hardware] == row["expected"]["ros2_control"]


@pytest.mark.parametrize("name", robot_names())
def test_mimic_joints_of_a_real_robot_are_as_the_index_says(name: str) -> None:
    row = read_index()[name]
    root, report = expand(row), LoadReport()
    inputs = read_joints(root)
    file = Path("robot.urdf")
    blocks = read_hardware(root, [joint.name for joint in inputs], report, file)

    joints = find_mimics(inputs, blocks, report, file)

    mimics = {joint.name: joint.mimic for joint in joints if joint.mimic is not None}
    expected = row["expected"]["mimic"]
    assert list(mimics) == [
        row if isinstance(row, str) else row["joint"] for row in expected
    ]
    for relation in expected:
        if isinstance(relation, dict):
            assert mimics[relation["joint"]] == Mimic(
                relation["of"], relation["multiplier"], relation["offset"]
            )


def test_the_mycobot_of_ignition_has_a_position_controller_per_joint() -> None:
    real_robot("mycobot_280/mycobot_gazebo/urdf/mycobot_280_gazebo.urdf.xacro")
    row = read_index()["mycobot_280"]
    root, report = expand(row), LoadReport()
    plugins = read_gazebo_plugins(root)

    states, *controllers = read_joint_plugins(
        plugins, row["expected"]["movable_joints"], report, Path("robot.urdf")
    )

    # The plugin tags of the published file, none of which gives a gain.
    assert states == JointStatePublisher(topic="joint_states")
    assert controllers == [
        JointPositionController((joint,))
        for joint in (
            "link1_to_link2",
            "link2_to_link3",
            "link3_to_link4",
            "link4_to_link5",
            "link5_to_link6",
            "link6_to_link6flange",
            "gripper_controller",
            "gripper_base_to_gripper_left2",
            "gripper_left3_to_gripper_left1",
            "gripper_base_to_gripper_right3",
            "gripper_base_to_gripper_right2",
            "gripper_right3_to_gripper_right1",
        )
    ]
    assert len(report) == 0
