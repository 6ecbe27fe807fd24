"""`<ros2_control>` blocks: what they say, and what becomes of what is malformed."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
    PidGains,
    read_hardware,
)

CLASSIC = "gazebo_ros2_control/GazeboSystem"


def read(
    blocks: str, rest: str = "", joints: tuple[str, ...] = ("j", "k")
) -> tuple[tuple[HardwareInfo, ...], list[str]]:
    report = LoadReport()
    root = ET.XML(f"<robot>{rest}{blocks}</robot>")
    hardware = read_hardware(root, joints, report, Path("arm.urdf"))
    return hardware, [str(entry) for entry in report]


def read_block(
    body: str, attributes: str = "", rest: str = ""
) -> tuple[HardwareInfo, list[str]]:
    (block,), lines = read(
        f'<ros2_control name="h" type="system" {attributes}>{body}</ros2_control>', rest
    )
    return block, lines


def read_joint(
    body: str, attributes: str = "", plugin: str = "p"
) -> tuple[ComponentInfo, list[str]]:
    block, lines = read_block(
        f"<hardware><plugin>{plugin}</plugin></hardware>"
        f'<joint name="j" {attributes}>{body}</joint>'
    )
    return block.joints[0], lines


# Blocks


def test_a_block_has_its_name_type_plugin_and_parameters():
    (block,), lines = read(
        '<ros2_control name=" h " type="system" rw_rate="50" is_async="True" '
        'thread_priority="7"><hardware><plugin> a/B </plugin><group> g </group>'
        '<param name="port"> /dev/x </param></hardware></ros2_control>'
    )

    assert block == HardwareInfo(
        name="h",
        type="system",
        plugin="a/B",
        parameters={"port": "/dev/x"},
        group="g",
        rw_rate=50,
        is_async=True,
        thread_priority=7,
    )
    assert lines == []


@pytest.mark.parametrize(
    "hardware", ["", "<hardware/>", "<hardware><plugin/></hardware>"]
)
def test_a_block_without_a_plugin_has_the_defaults_of_ros2_control(hardware):
    block, lines = read_block(hardware)

    assert block == HardwareInfo(
        name="h",
        type="system",
        plugin="",
        group="",
        rw_rate=0,
        is_async=False,
        thread_priority=50,
    )
    assert lines == []


def test_every_block_is_read_in_order():
    blocks, lines = read(
        '<ros2_control name="a" type="system"/><ros2_control name="b" type="sensor"/>'
        '<ros2_control name="c" type="actuator"><joint name="j"/></ros2_control>'
    )

    assert [(block.name, block.type) for block in blocks] == [
        ("a", "system"),
        ("b", "sensor"),
        ("c", "actuator"),
    ]
    assert lines == []


def test_two_blocks_of_one_name_are_kept_and_reported():
    blocks, lines = read(
        '<ros2_control name="a" type="system"><joint name="j"/></ros2_control>'
        '<ros2_control name="a" type="system"><joint name="k"/></ros2_control>'
    )

    assert [block.joints[0].name for block in blocks] == ["j", "k"]
    assert lines == [
        "warning: arm.urdf: ros2_control 'a': "
        "another block has this name; expected distinct names; both are kept"
    ]


@pytest.mark.parametrize(
    ("inputs", "taken"),
    [("System", "system"), ("SENSOR", "sensor"), ("robot", "system"), ("", "system")],
)
def test_a_type_in_other_letters_is_taken_and_reported(inputs, taken):
    (block,), lines = read(f'<ros2_control name="h" type="{inputs}"/>')

    assert block.type == taken
    assert lines == [
        f"warning: arm.urdf: ros2_control 'h': type {inputs!r}; "
        f"expected one of system, actuator, sensor; taken as {taken!r}"
    ]


def test_a_block_without_a_name_is_kept_and_reported():
    (block,), lines = read('<ros2_control type="system"/>')

    assert block.name == ""
    assert lines == [
        "warning: arm.urdf: ros2_control '': the block has no name; it is kept"
    ]


@pytest.mark.parametrize(
    ("attribute", "expected"),
    [
        ('rw_rate="-1"', "rw_rate: expected an integer from 0 on, got '-1'"),
        ('rw_rate="fast"', "rw_rate: expected an integer from 0 on, got 'fast'"),
        ('is_async="1"', "is_async: expected true or false, got '1'"),
        ('is_async=""', "is_async: expected true or false, got ''"),
        (
            'thread_priority="0"',
            "thread_priority: expected an integer from 1 on, got '0'",
        ),
        (
            'thread_priority="2.5"',
            "thread_priority: expected an integer from 1 on, got '2.5'",
        ),
    ],
)
def test_a_malformed_attribute_counts_as_not_given(attribute, expected):
    block, lines = read_block("", attribute)

    assert (block.rw_rate, block.is_async, block.thread_priority) == (0, False, 50)
    assert lines == [
        f"warning: arm.urdf: ros2_control 'h': {expected}; taken as not given"
    ]


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("<motor/>", "<ros2_control> has no <motor>"),
        ("<hardware><classType/></hardware>", "<hardware> has no <classType>"),
        ("<hardware color='red'/>", "<hardware> has no attribute 'color'"),
        (
            "<hardware><param name='a' type='int'>1</param></hardware>",
            "<param> has no attribute 'type'",
        ),
    ],
)
def test_unknown_elements_and_attributes_are_reported(body, what):
    _, lines = read_block(body)

    assert lines == [f"warning: arm.urdf: ros2_control 'h': {what}; it has no effect"]


def test_properties_of_the_drivers_thread_are_reported_as_without_effect():
    _, lines = read_block("<properties><async thread_priority='3'/></properties>")

    assert lines == [
        "info: arm.urdf: ros2_control 'h': <properties> of the driver's thread; "
        "the simulator has no such thread"
    ]


def test_only_the_first_hardware_counts():
    block, lines = read_block(
        "<hardware><plugin>a</plugin><group>g</group></hardware>"
        "<hardware><plugin>b</plugin><group>i</group></hardware>"
    )

    assert (block.plugin, block.group) == ("a", "g")
    assert lines == [
        "warning: arm.urdf: ros2_control 'h': a second <hardware>; left out"
    ]


@pytest.mark.parametrize(
    ("joints", "count"), [("", 0), ('<joint name="j"/><joint name="k"/>', 2)]
)
def test_an_actuator_has_one_joint(joints, count):
    (block,), lines = read(
        f'<ros2_control name="h" type="actuator">{joints}</ros2_control>'
    )

    assert len(block.joints) == count
    assert lines == [
        f"warning: arm.urdf: ros2_control 'h': an actuator has one joint, "
        f"got {count}; they are kept"
    ]


# Parameters


def test_parameters_without_name_or_text_and_repeated_ones_are_reported():
    block, lines = read_block(
        '<hardware><param>lost</param><param name="empty"/>'
        '<param name="a">1</param><param name="a">2</param></hardware>'
    )

    assert block.parameters == {"empty": "", "a": "2"}
    place = "arm.urdf: ros2_control 'h'"
    assert lines == [
        f"warning: {place}: a <param> without a name, its text is 'lost'; left out",
        f"info: {place}: <param> 'empty' has no text; taken as empty",
        f"warning: {place}: <param> 'a' is given twice; '2' counts",
    ]


# Joints, sensors, gpios


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
    assert lines == []


def test_custom_interfaces_are_kept_with_their_type_and_size():
    joint, lines = read_joint(
        '<command_interface name="stiffness" data_type=" bool " size="3"/>'
        '<state_interface name="kp"/>'
    )

    (stiffness,) = joint.command_interfaces
    assert (stiffness.name, stiffness.data_type, stiffness.size) == (
        "stiffness",
        "bool",
        3,
    )
    assert joint.state_interfaces == (InterfaceInfo("kp", data_type="double", size=1),)
    assert lines == []


@pytest.mark.parametrize("size", ["0", "-1", "two"])
def test_a_size_is_a_positive_integer(size):
    joint, lines = read_joint(f'<command_interface name="a" size="{size}"/>')

    assert joint.command_interfaces[0].size == 1
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j', command_interface 'a': "
        f"size: expected an integer from 1 on, got {size!r}; taken as not given"
    ]


def test_limits_can_be_switched_off_for_a_joint_and_for_an_interface():
    joint, lines = read_joint(
        '<command_interface name="position"><limits enable="False"/>'
        '</command_interface><command_interface name="velocity">'
        '<limits enable="true"/></command_interface><limits enable="false"/>'
    )

    assert not joint.enable_limits
    assert [c.enable_limits for c in joint.command_interfaces] == [False, True]
    assert lines == []


@pytest.mark.parametrize(
    ("limits", "line"),
    [
        (
            '<limits enable="no"/>',
            "enable: expected true or false, got 'no'; taken as not given",
        ),
        ("<limits/>", 'expected <limits enable="...">; the limits hold'),
    ],
)
def test_limits_hold_where_nothing_clear_is_said(limits, line):
    joint, lines = read_joint(limits)

    assert joint.enable_limits
    assert lines == [f"warning: arm.urdf: ros2_control 'h', joint 'j': {line}"]


def test_a_misspelt_parameter_of_an_interface_is_reported():
    _, lines = read_joint(
        '<state_interface name="position"><param name="initial_valu">0.5</param>'
        '<param name="min">0</param><param name="unit">rad</param></state_interface>'
    )

    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j', state_interface 'position': "
        "<param> 'initial_valu'; did you mean 'initial_value'?; it has no effect"
    ]


@pytest.mark.parametrize("text", ["half", "nan", "1 2", "1_0", "0x1"])
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


def test_a_limit_may_be_infinite_but_no_start():
    joint, lines = read_joint(
        '<state_interface name="position"><param name="min">-inf</param>'
        '<param name="max">Inf</param><param name="initial_value">inf</param>'
        "</state_interface>"
    )

    position = joint.state_interfaces[0]
    assert (position.min, position.max) == (-math.inf, math.inf)
    assert position.initial_value is None
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': position, initial_value: "
        "expected a finite number, got 'inf'; taken as not given"
    ]


def test_one_limit_may_be_given_alone():
    joint, lines = read_joint(
        '<command_interface name="position"><param name="min">2</param>'
        '</command_interface><command_interface name="velocity">'
        '<param name="max">-1</param></command_interface>'
    )

    limits = [(command.min, command.max) for command in joint.command_interfaces]
    assert limits == [(2.0, None), (None, -1.0)]
    assert lines == []


@pytest.mark.parametrize(
    ("body", "place", "what"),
    [
        (
            '<state_interface name="a" unit="m"/>',
            ", state_interface 'a'",
            "<state_interface> has no attribute 'unit'",
        ),
        (
            '<limits enable="true"><min/></limits>',
            "",
            "<limits> has no <min>",
        ),
    ],
)
def test_unknown_parts_of_a_joint_are_reported(body, place, what):
    _, lines = read_joint(body)

    assert lines == [
        f"warning: arm.urdf: ros2_control 'h', joint 'j'{place}: {what}; "
        "it has no effect"
    ]


def test_limits_in_the_wrong_order_count_as_not_given():
    joint, lines = read_joint(
        '<command_interface name="position"><param name="min">2</param>'
        '<param name="max">1</param></command_interface>'
    )

    assert (joint.command_interfaces[0].min, joint.command_interfaces[0].max) == (
        None,
        None,
    )
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': "
        "position: min 2.0 is above max 1.0; taken as not given"
    ]


@pytest.mark.parametrize(
    ("attribute", "expected"),
    [("", None), ('mimic="True"', True), ('mimic="false"', False)],
)
def test_a_joint_may_say_whether_it_mimics(attribute, expected):
    joint, lines = read_joint("", attribute)

    assert joint.is_mimic is expected
    assert lines == []


def test_a_mimic_attribute_is_a_bool():
    joint, lines = read_joint("", 'mimic="yes"')

    assert joint.is_mimic is None
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': "
        "mimic: expected true or false, got 'yes'; taken as not given"
    ]


def test_sensors_and_gpios_keep_any_value_as_text():
    block, lines = read_block(
        '<sensor name="s"><state_interface name="force.x"/>'
        '<param name="frame_id">tool</param></sensor>'
        '<gpio name="g"><command_interface name="vacuum" data_type="bool">'
        '<param name="initial_value">true</param></command_interface></gpio>'
    )

    (sensor,), (gpio,) = block.sensors, block.gpios
    assert [i.name for i in sensor.state_interfaces] == ["force.x"]
    assert sensor.parameters == {"frame_id": "tool"}
    assert gpio.command_interfaces == (
        InterfaceInfo("vacuum", parameters={"initial_value": "true"}, data_type="bool"),
    )
    assert lines == []


def test_a_sensor_mimics_nothing_and_a_gpio_has_no_limits():
    block, lines = read_block(
        '<sensor name="s" mimic="true"/><gpio name="g"><limits enable="true"/></gpio>'
    )

    assert block.sensors[0].is_mimic is None
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', sensor 's': "
        "<sensor> has no attribute 'mimic'; it has no effect",
        "warning: arm.urdf: ros2_control 'h', gpio 'g': "
        "<gpio> has no <limits>; it has no effect",
    ]


@pytest.mark.parametrize("tag", ["joint", "sensor", "gpio"])
def test_a_component_without_a_name_is_left_out(tag):
    block, lines = read_block(f'<{tag}><state_interface name="a"/></{tag}>')

    assert (*block.joints, *block.sensors, *block.gpios) == ()
    assert lines == [
        f"error: arm.urdf: ros2_control 'h': a <{tag}> has no name; "
        "its interfaces are left out"
    ]


def test_an_interface_without_a_name_is_left_out():
    joint, lines = read_joint('<command_interface/><state_interface name="effort"/>')

    assert joint.command_interfaces == ()
    assert joint.state_interfaces == (InterfaceInfo("effort"),)
    assert lines == [
        "error: arm.urdf: ros2_control 'h', joint 'j': "
        "a <command_interface> has no name; it is left out"
    ]


def test_a_joint_that_the_robot_lacks_is_kept_as_values_and_reported():
    block, lines = read_block('<joint name="x"/><joint name="k"/>')

    assert [joint.name for joint in block.joints] == ["x", "k"]
    assert lines == [
        "warning: arm.urdf: ros2_control 'h': the robot has no joint 'x'; "
        "its interfaces are kept as plain values"
    ]


def test_a_fixed_joint_is_kept_as_values_and_reported():
    block, lines = read_block(
        '<joint name="j"/><joint name="k"/>',
        rest='<joint name="j" type="fixed"/><joint name="k" type="revolute"/>',
    )

    assert [joint.name for joint in block.joints] == ["j", "k"]
    assert lines == [
        "warning: arm.urdf: ros2_control 'h': joint 'j' is fixed; "
        "expected one that moves; its interfaces are kept as plain values"
    ]


def test_blocks_may_share_a_joint_but_no_interface():
    (motor, encoder), lines = read(
        '<ros2_control name="m" type="system"><joint name="j">'
        '<command_interface name="velocity"/><state_interface name="velocity"/>'
        '</joint></ros2_control><ros2_control name="e" type="sensor"><joint name="j">'
        '<state_interface name="position"/><state_interface name="velocity"/>'
        "</joint></ros2_control>"
    )

    assert motor.joints[0].state_interfaces == (InterfaceInfo("velocity"),)
    assert encoder.joints[0].state_interfaces == (InterfaceInfo("position"),)
    assert lines == [
        "warning: arm.urdf: ros2_control 'e', joint 'j': "
        "block 'm' has <state_interface> 'velocity' already; it is taken once"
    ]


def test_interfaces_that_a_sensor_and_a_gpio_share_are_told_in_one_line():
    states = '<state_interface name="ACC X"/><state_interface name="ACC Y"/>'
    _, lines = read_block(
        f'<sensor name="imu">{states}</sensor><gpio name="imu">{states}</gpio>'
    )

    assert lines == [
        "warning: arm.urdf: ros2_control 'h', gpio 'imu': "
        "block 'h' has <state_interface> 'ACC X', 'ACC Y' already; each is taken once"
    ]


# Gains of Gazebo Classic


def test_gains_of_gazebo_classic_are_read():
    joint, lines = read_joint(
        '<param name="pos_kp">10</param><param name="pos_ki">1</param>'
        '<param name="pos_kd">2</param>'
        '<param name="pos_max_integral_error">5</param>'
        '<param name="pos_min_integral_error">-5</param>'
        '<param name="vel_kd">0.5</param>'
    )

    assert joint.position_pid == PidGains(10.0, 1.0, 2.0, 5.0, -5.0)
    assert joint.velocity_pid == PidGains(
        kp=0.0,
        ki=0.0,
        kd=0.5,
        max_integral_error=math.inf,
        min_integral_error=-math.inf,
    )
    assert lines == []


def test_a_limit_of_the_integral_alone_makes_no_pid():
    joint, _ = read_joint('<param name="pos_max_integral_error">5</param>')

    assert (joint.position_pid, joint.velocity_pid) == (None, None)


@pytest.mark.parametrize("name", ["vel_kp", "vel_max_integral_error"])
def test_gains_of_which_one_is_no_number_make_no_pid(name):
    joint, lines = read_joint(
        f'<param name="{name}">big</param><param name="vel_ki">2</param>'
        '<param name="pos_kp">1</param>'
    )

    assert joint.velocity_pid is None
    assert joint.position_pid == PidGains(kp=1.0)
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': "
        f"{name}: expected a number, got 'big'; the joint servo has its own gains"
    ]


@pytest.mark.parametrize(
    ("plugin", "name", "offered"),
    [
        (CLASSIC, "position_pid", "position"),
        (CLASSIC, "velocity_pid", "velocity"),
        ("a/B", "position_pid", "position_pid"),
    ],
)
def test_gazebo_classic_offers_pid_interfaces_under_the_plain_name(
    plugin, name, offered
):
    joint, lines = read_joint(f'<command_interface name="{name}"/>', plugin=plugin)

    assert joint.command_interfaces == (InterfaceInfo(offered),)
    assert lines == []


def test_a_state_interface_keeps_its_name():
    joint, _ = read_joint('<state_interface name="position_pid"/>', plugin=CLASSIC)

    assert joint.state_interfaces == (InterfaceInfo("position_pid"),)


def test_gazebo_classic_takes_a_quantity_once():
    joint, lines = read_joint(
        '<command_interface name="position"/><command_interface name="position_pid"/>',
        plugin=CLASSIC,
    )

    assert joint.command_interfaces == (InterfaceInfo("position"),)
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': "
        "block 'h' has <command_interface> 'position' already; it is taken once"
    ]
