"""Initial positions that `<ros2_control>` blocks give, in all their forms."""

from pathlib import Path

import pytest

from arm_drake.description.hardware_info import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
)
from arm_drake.description.initial_positions import initial_values
from arm_drake.description.report import LoadReport

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
