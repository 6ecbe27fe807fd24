"""`<transmission>` tags in `<ros2_control>` blocks."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ActuatorInfo,
    TransmissionInfo,
    TransmissionJointInfo,
    read_hardware,
)

PLUGIN = "<plugin>t/Simple</plugin>"
PLACE = "arm.urdf: ros2_control 'h', transmission 't'"


def read(
    body: str, attributes: str = 'name="t"', type_: str = "system"
) -> tuple[tuple[TransmissionInfo, ...], list[str]]:
    report = LoadReport()
    root = ET.XML(
        f'<robot><ros2_control name="h" type="{type_}"><joint name="j"/>'
        f"<transmission {attributes}>{body}</transmission></ros2_control></robot>"
    )
    (block,) = read_hardware(root, ["j", "k"], report, Path("arm.urdf"))
    return block.transmissions, [str(entry) for entry in report]


def test_a_transmission_has_joints_and_actuators_with_reductions_and_offsets():
    transmissions, lines = read(
        f'{PLUGIN}<actuator name="a" role="actuator1" read_only="true">'
        "<mechanical_reduction>50</mechanical_reduction></actuator>"
        '<joint name="j" role="joint1"><mechanical_reduction>2</mechanical_reduction>'
        '<offset>0.25</offset></joint><param name="p">x</param>'
    )

    assert transmissions == (
        TransmissionInfo(
            name="t",
            type="t/Simple",
            joints=(TransmissionJointInfo("j", "joint1", 2.0, 0.25, False),),
            actuators=(ActuatorInfo("a", "actuator1", 50.0, 0.0, True),),
            parameters={"p": "x"},
        ),
    )
    assert lines == []


def test_a_reduction_is_1_and_an_offset_0_where_none_is_given():
    (transmission,), _ = read(f'{PLUGIN}<joint name="j" role="r"/>')

    assert transmission.joints == (TransmissionJointInfo("j", "r", 1.0, 0.0),)


@pytest.mark.parametrize(
    ("body", "attributes", "problem"),
    [
        ('<joint name="j" role="r"/>', 'name="t"', "no <plugin>"),
        (
            f'{PLUGIN}<joint role="r"/>',
            'name="t"',
            "each joint and actuator needs a name and a role",
        ),
        (
            f'{PLUGIN}<actuator name="a"/>',
            'name="t"',
            "each joint and actuator needs a name and a role",
        ),
        (
            f'{PLUGIN}<joint name="k" role="r"/>',
            'name="t"',
            "the block has no joint 'k'; known: j",
        ),
        (f'{PLUGIN}<joint name="j" role="r"/>', "", "a <transmission> has no name"),
    ],
)
def test_a_transmission_that_ros2_control_refuses_is_left_out(
    body, attributes, problem
):
    transmissions, lines = read(body, attributes)

    assert transmissions == ()
    place = PLACE if attributes else PLACE.replace("'t'", "''")
    assert lines == [f"warning: {place}: {problem}; it is left out"]


def test_the_transmission_of_an_actuator_has_one_joint():
    transmissions, lines = read(PLUGIN, type_="actuator")

    assert transmissions == ()
    assert lines == [
        f"warning: {PLACE}: an actuator has one joint, got 0; it is left out"
    ]


@pytest.mark.parametrize(("type_", "count"), [("actuator", 1), ("system", 0)])
def test_a_transmission_has_the_joints_that_its_block_may_have(type_, count):
    joints = '<joint name="j" role="r"/>' * count

    (transmission,), lines = read(PLUGIN + joints, type_=type_)

    assert len(transmission.joints) == count
    assert lines == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("0", "expected a number other than 0"),
        ("fast", "expected a number, got 'fast'"),
        ("inf", "expected a finite number, got 'inf'"),
    ],
)
def test_a_reduction_that_cant_be_counts_as_not_given(text, problem):
    (transmission,), lines = read(
        f'{PLUGIN}<joint name="j" role="r">'
        f"<mechanical_reduction>{text}</mechanical_reduction></joint>"
    )

    assert transmission.joints[0].mechanical_reduction == 1.0
    assert lines == [
        f"warning: {PLACE}, joint 'j': mechanical_reduction: {problem}; "
        "taken as not given"
    ]


def test_unknown_parts_of_a_transmission_are_reported():
    _, lines = read(
        f'{PLUGIN}<type>x</type><joint name="j" role="r"><ratio>1</ratio></joint>'
    )

    assert lines == [
        f"warning: {PLACE}: <transmission> has no <type>; it has no effect",
        f"warning: {PLACE}, joint 'j': <joint> has no <ratio>; it has no effect",
    ]
