"""Interfaces that a robot's description offers to controllers."""

import math
from pathlib import Path

import pytest

from arm_drake import interfaces
from arm_drake.control.generic_system import GenericSystem
from arm_drake.manager.hardware_interfaces import (
    HardwareInterfaces,
    find_hardware_interfaces,
)
from tests import models

HARDWARE = """
  <ros2_control name="{name}" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    {inside}
  </ros2_control>"""


def component(tag: str, name: str, *interfaces: str) -> str:
    """Return a joint, sensor or gpio; "command:position" or "state:out=2.5"."""
    lines = ""
    for text in interfaces:
        kind, _, rest = text.partition(":")
        interface, _, initial = rest.partition("=")
        value = f'<param name="initial_value">{initial}</param>' if initial else ""
        lines += f'<{kind}_interface name="{interface}">{value}</{kind}_interface>'
    return f'<{tag} name="{name}">{lines}</{tag}>'


def arm(*blocks: str, second: str = "") -> str:
    """Return an arm of a revolute and a prismatic joint with hardware blocks."""
    hardware = "".join(
        HARDWARE.format(name=f"block{i}", inside=inside)
        for i, inside in enumerate(blocks)
    )
    slide = models.joint("slide", "a", "b", type="prismatic", inside=second)
    return f"""
    <robot name="arm">
      <link name="base"/>
      {models.joint("turn", "base", "a")}{models.bob("a")}{slide}{models.bob("b")}
      {hardware}
    </robot>"""


def find(folder: Path, urdf: str) -> HardwareInterfaces:
    robot = models.load(folder, urdf)
    return find_hardware_interfaces(robot.description, robot.initial_positions)


POSITION = ("command:position", "state:position", "state:velocity")


def test_interfaces_are_in_the_order_of_the_file(tmp_path):
    joints = component("joint", "slide", "command:velocity", "state:position")
    text = arm(
        joints + component("joint", "turn", *POSITION),
        component("sensor", "imu", "state:gyro.z")
        + component("gpio", "tool", "command:out", "state:out"),
    )

    found = find(tmp_path, text)

    assert found.command_interfaces == (
        "slide/velocity",
        "turn/position",
        "tool/out",
    )
    assert found.state_interfaces == (
        "slide/position",
        "turn/position",
        "turn/velocity",
        "imu/gyro.z",
        "tool/out",
    )
    # Joints are in the order of the description.
    assert list(found.joint_types.items()) == [
        ("turn", "revolute"),
        ("slide", "prismatic"),
    ]
    assert found.has_physics


def test_what_physics_does_not_know_is_stored(tmp_path):
    text = arm(
        component("joint", "turn", *POSITION, "state:effort", "state:temperature=36.5")
        + component("joint", "slide", *POSITION, "state:current"),
        component("sensor", "imu", "state:gyro.z", "state:gyro.x=0.25")
        + component("gpio", "tool", "command:out", "state:out=1.0"),
    )

    found = find(tmp_path, text)

    unknown = pytest.approx(math.nan, nan_ok=True)
    assert found.stored == {
        "turn/temperature": 36.5,
        "slide/current": 0.0,
        "imu/gyro.z": unknown,
        "imu/gyro.x": 0.25,
        "tool/out": 1.0,
    }


def test_joints_are_measured_by_quantity_and_what_is_stored_comes_last(tmp_path):
    text = arm(component("joint", "slide", *POSITION, "state:current"))

    found = find(tmp_path, text)

    assert found.measured == (
        "turn/position",
        "slide/position",
        "turn/velocity",
        "slide/velocity",
        "turn/effort",
        "slide/effort",
        "slide/current",
    )


def test_joints_that_are_commanded_are_driven_unless_they_follow_others(tmp_path):
    both = component("joint", "turn", *POSITION) + component(
        "joint", "slide", *POSITION
    )
    one = component("joint", "turn", *POSITION) + component(
        "joint", "slide", "state:position"
    )
    gpio = both + component("gpio", "tool", "command:out")
    mimic = '<mimic joint="turn"/>'

    found = [
        find(tmp_path, text).driven
        for text in (arm(both), arm(one), arm(gpio), arm(both, second=mimic))
    ]

    assert found == [{"turn", "slide"}, {"turn"}, {"turn", "slide"}, {"turn"}]


def test_interfaces_know_their_block(tmp_path):
    text = arm(
        component("joint", "turn", *POSITION),
        component("gpio", "tool", "command:out", "state:level"),
    )

    found = find(tmp_path, text)

    assert dict(found.blocks) == {
        "turn/position": "block0",
        "turn/velocity": "block0",
        "tool/out": "block1",
        "tool/level": "block1",
    }


def test_states_that_are_no_doubles_are_known(tmp_path):
    gpio = component("gpio", "tool", "command:out", "state:out", "state:level")
    level = '<state_interface name="level"'
    assert level in gpio
    text = arm(gpio.replace(level, f'{level} data_type="bool"'))

    assert find(tmp_path, text).other_types == {"tool/level"}


def test_velocity_limits_are_those_of_the_joints_that_have_one(tmp_path):
    text = arm(component("joint", "turn", *POSITION)).replace(
        'velocity="10"', 'velocity="0"', 1
    )

    found = find(tmp_path, text)

    assert dict(found.velocity_limits) == {"slide": 10.0}


def test_initial_positions_are_kept(tmp_path):
    robot = models.load(
        tmp_path,
        arm(component("joint", "turn", *POSITION)),
        initial_positions={"turn": 0.4},
    )

    found = find_hardware_interfaces(robot.description, robot.initial_positions)

    assert dict(found.initial_positions) == {"turn": 0.4, "slide": 0.0}


def test_of_a_mirror_there_is_what_it_mirrors(tmp_path):
    text = arm(
        component("joint", "turn", "command:position", "state:position=0.3")
        + component("joint", "slide", "command:speed", "state:speed=0.2")
        + component("gpio", "tool", "command:out", "state:out")
    )
    robot = models.load(tmp_path, text)
    description = robot.description
    (block,) = description.hardware
    mirror = GenericSystem.from_component(block, description.movable_joints)

    found = find_hardware_interfaces(description, robot.initial_positions, [mirror])

    assert found.command_interfaces == ("turn/position", "slide/speed", "tool/out")
    assert found.state_interfaces == ("turn/position", "slide/speed", "tool/out")
    unknown = pytest.approx(math.nan, nan_ok=True)
    assert found.stored == {"slide/speed": 0.2, "tool/out": unknown}
    assert found.driven == frozenset()
    assert not found.has_physics


def test_a_mirror_of_nothing_offers_nothing(tmp_path):
    robot = models.load(tmp_path, arm(component("joint", "turn", *POSITION)))

    found = find_hardware_interfaces(robot.description, robot.initial_positions, [])

    assert (found.command_interfaces, found.state_interfaces) == ((), ())
    assert (found.driven, found.stored) == (frozenset(), {})
    assert found.measured == interfaces.interface_names(
        ("turn", "slide"), interfaces.STATE_INTERFACES
    )
