"""Initial positions that `<ros2_control>` blocks give, in all their forms."""

from pathlib import Path

import pytest

from arm_drake.description.initial_positions import (
    find_initial_positions,
    initial_values,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
)
from arm_drake.description.urdf import parse_urdf
from arm_drake.errors import InputError

PLACE = "arm.urdf: ros2_control 'h', joint 'j'"


def start(name: str, value: float | None) -> tuple[InterfaceInfo, ...]:
    return (InterfaceInfo(name, initial_value=value),)


def joint(state=None, command=None, name="position", **parameters) -> ComponentInfo:
    return ComponentInfo("j", start(name, command), start(name, state), parameters)


def read(*joints: ComponentInfo) -> tuple[dict[str, float], list[str]]:
    blocks = [HardwareInfo("h", "system", "", joints=(joint,)) for joint in joints]
    report = LoadReport()
    values = initial_values(blocks, report, Path("arm.urdf"))
    return values, [str(entry) for entry in report]


@pytest.mark.parametrize(
    ("component", "expected"),
    [
        (joint(), {}),
        (joint(state=0.5), {"j": 0.5}),
        (joint(state=0.0), {"j": 0.0}),
        (joint(command=-0.5), {"j": -0.5}),
        (joint(initial_position="0.1"), {"j": 0.1}),
        (joint(state=0.25, command=0.25, initial_position="0.25"), {"j": 0.25}),
    ],
)
def test_a_joint_starts_where_one_form_says(component, expected):
    assert read(component) == (expected, [])


def test_the_state_interface_counts_before_the_command_interface_and_the_parameter():
    values, lines = read(joint(state=1.0, command=2.0, initial_position="3"))

    assert values == {"j": 1.0}
    assert lines == [
        f"warning: {PLACE}: initial_value of the command interface is 2.0, "
        "but another place says 1.0; it starts at 1.0",
        f"warning: {PLACE}: <param> 'initial_position' is 3.0, "
        "but another place says 1.0; it starts at 1.0",
    ]


def test_the_first_block_counts():
    values, lines = read(joint(state=1.0), joint(state=2.0))

    assert values == {"j": 1.0}
    assert lines == [
        f"warning: {PLACE}: initial_value of the state interface is 2.0, "
        "but another place says 1.0; it starts at 1.0"
    ]


@pytest.mark.parametrize(
    ("text", "expected"), [("up", "a number"), ("inf", "a finite number")]
)
def test_an_initial_position_that_is_no_number_is_reported(text, expected):
    values, lines = read(joint(initial_position=text))

    assert values == {}
    assert lines == [
        f"warning: {PLACE}: initial_position: expected {expected}, got {text!r}; "
        "taken as not given"
    ]


def test_a_start_in_motion_is_reported():
    values, lines = read(joint(name="velocity", state=2.0, initial_velocity="3"))

    assert values == {}
    assert lines == [
        f"info: {PLACE}: <param> 'initial_velocity' is 3.0; the robot starts at rest",
        f"info: {PLACE}: initial_value of 'velocity' is 2.0; the robot starts at rest",
    ]


def test_a_start_at_rest_needs_no_line():
    assert read(joint(name="effort", state=0.0, initial_effort="0")) == ({}, [])


# Where a robot starts


def start_robot(limits: str, mimic: str, hardware: str = "", **inputs: float):
    """Return the positions of m and of s, which follows it, and the report."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="m" type="revolute"><parent link="a"/><child link="b"/>'
        '<limit lower="-2" upper="2"/></joint>'
        '<joint name="s" type="revolute"><parent link="a"/><child link="c"/>'
        f"<limit {limits}/>{mimic}</joint>{hardware}</robot>"
    )
    report, file = LoadReport(), Path("arm.urdf")
    description = parse_urdf(text, file, PackageFinder(file), LoadReport())
    positions = find_initial_positions(description, inputs, report)
    return positions, [f"{entry.what}; {entry.done}" for entry in report]


FOLLOWS = '<mimic joint="m" multiplier="-2" offset="0.5"/>'


@pytest.mark.parametrize("limits", ['lower="0" upper="0.5"', 'lower="50" upper="60"'])
def test_the_limits_of_a_follower_do_not_hold_its_master(limits):
    positions, lines = start_robot(limits, FOLLOWS, m=1.0)

    assert positions == {"m": 1.0, "s": -1.5}
    assert lines == []


def test_a_joint_starts_within_its_limits():
    positions, lines = start_robot('lower="-9" upper="9"', FOLLOWS, m=3.0)

    assert positions == {"m": 2.0, "s": -3.5}
    assert lines == ["initial position 3.0 is outside [-2.0, 2.0]; it starts at 2.0"]


def test_a_follower_cant_be_put_elsewhere():
    with pytest.raises(InputError) as caught:
        start_robot('lower="-9" upper="9"', FOLLOWS, m=1.0, s=0.3)

    assert str(caught.value) == (
        "joint 's': the joint follows 'm', which puts it at -1.5, not at 0.3; give 'm' "
        "a position"
    )
    assert start_robot('lower="-9" upper="9"', FOLLOWS, m=1.0, s=-1.5)[1] == []


def test_an_initial_value_that_contradicts_the_master_is_reported():
    hardware = (
        '<ros2_control name="h" type="system"><joint name="s"><state_interface '
        'name="position"><param name="initial_value">0.9</param></state_interface>'
        "</joint></ros2_control>"
    )

    positions, lines = start_robot('lower="-9" upper="9"', FOLLOWS, hardware)

    assert positions == {"m": 0.0, "s": 0.5}
    assert lines == [
        "the joint follows 'm', which puts it at 0.5; its initial value 0.9 is left out"
    ]
