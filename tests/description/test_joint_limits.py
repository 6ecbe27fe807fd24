"""Limits of joints in a URDF and its `<ros2_control>` blocks."""

import math
from pathlib import Path

import pytest

from arm_drake.description.joint_limits import (
    JointLimits,
    SoftJointLimits,
    find_joint_limits,
)
from arm_drake.description.joints import SafetyController
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription, parse_urdf

FILE = Path("arm.urdf")

LIMIT = '<limit lower="-1" upper="2" velocity="3" effort="4"/>'
HARD = JointLimits(-1.0, 2.0, max_velocity=3.0, max_effort=4.0)


def parse(
    joint: str, commands: str = "", *, type: str = "revolute", blocks: str = ""
) -> tuple[RobotDescription, list[str]]:
    if commands:
        blocks += f'<ros2_control name="c"><joint name="j">{commands}</joint>'
        blocks += "</ros2_control>"
    report = LoadReport()
    robot = parse_urdf(
        '<robot name="r"><link name="a"/><link name="b"/>'
        f'<joint name="j" type="{type}"><parent link="a"/><child link="b"/>{joint}'
        f"</joint>{blocks}</robot>",
        FILE,
        PackageFinder(FILE),
        report,
    )
    return robot, [str(entry) for entry in report if "joint 'j'" in entry.where]


def find(*args, **kwargs) -> tuple[JointLimits, SoftJointLimits | None]:
    robot, _ = parse(*args, **kwargs)
    return find_joint_limits(robot)["j"]


def command(name: str, low: object = None, high: object = None, more: str = "") -> str:
    for key, value in (("min", low), ("max", high)):
        if value is not None:
            more += f'<param name="{key}">{value}</param>'
    return f'<command_interface name="{name}">{more}</command_interface>'


OFF = '<limits enable="false"/>'


@pytest.mark.parametrize(
    ("type", "limit", "limits"),
    [
        ("revolute", LIMIT, HARD),
        ("prismatic", LIMIT, HARD),
        ("continuous", LIMIT, JointLimits(max_velocity=3.0, max_effort=4.0)),
        ("revolute", "", JointLimits()),
        (
            "revolute",
            '<limit lower="-1" upper="2" velocity="-3" effort="-4"/>',
            HARD,
        ),
        (
            "revolute",
            '<limit lower="-1" upper="2" velocity="0" effort="0"/>',
            JointLimits(-1.0, 2.0),
        ),
    ],
)
def test_a_joint_is_limited_by_its_urdf(type, limit, limits):
    assert find(limit, type=type) == (limits, None)


def test_every_movable_joint_has_limits_in_the_order_of_the_file():
    text = '<joint name="{}" type="{}"><parent link="a"/><child link="{}"/></joint>'
    joints = (("z", "fixed", "c"), ("y", "continuous", "d"), ("x", "revolute", "e"))
    links = "".join(f'<link name="{child}"/>' for _, _, child in joints)
    robot, _ = parse(LIMIT, blocks=links + "".join(text.format(*j) for j in joints))

    assert find_joint_limits(robot) == {
        "j": (HARD, None),
        "y": (JointLimits(), None),
        "x": (JointLimits(), None),
    }


@pytest.mark.parametrize(
    ("commands", "limits"),
    [
        (command("position"), (-1.0, 2.0, 3.0, 4.0)),
        (command("position", -0.5, 1), (-0.5, 1.0, 3.0, 4.0)),
        (command("position", -5, 5), (-1.0, 2.0, 3.0, 4.0)),
        (command("position", -0.5), (-0.5, 2.0, 3.0, 4.0)),
        (command("position", None, 1), (-1.0, 1.0, 3.0, 4.0)),
        (command("position", more=OFF), (None, None, 3.0, 4.0)),
        (command("position", -0.5, 1, OFF), (None, None, 3.0, 4.0)),
        (command("velocity", -2, 2), (-1.0, 2.0, 2.0, 4.0)),
        (command("velocity", -1, 2), (-1.0, 2.0, 1.0, 4.0)),
        (command("velocity", -2, 1), (-1.0, 2.0, 1.0, 4.0)),
        (command("velocity", -9, 9), (-1.0, 2.0, 3.0, 4.0)),
        (command("velocity", -2), (-1.0, 2.0, 2.0, 4.0)),
        (command("velocity", None, 1), (-1.0, 2.0, 1.0, 4.0)),
        (command("velocity", -2, -1), (-1.0, 2.0, 1.0, 4.0)),
        (command("velocity", -2, 2, OFF), (-1.0, 2.0, None, 4.0)),
        (command("effort", -2, 1), (-1.0, 2.0, 3.0, 1.0)),
        (command("effort", -9, 9), (-1.0, 2.0, 3.0, 4.0)),
        (command("effort", more=OFF), (-1.0, 2.0, 3.0, None)),
        (
            command("position", 0, 1) + command("velocity", -2, 2),
            (0.0, 1.0, 2.0, 4.0),
        ),
        (command("torque", -1, 1), (-1.0, 2.0, 3.0, 4.0)),
        # Of acceleration and jerk a URDF says nothing.
        (command("acceleration", -5, 6), (-1.0, 2.0, 3.0, 4.0, 6.0, 5.0)),
        (command("acceleration", -5), (-1.0, 2.0, 3.0, 4.0, None, 5.0)),
        (command("acceleration", None, 6), (-1.0, 2.0, 3.0, 4.0, 6.0)),
        (command("acceleration", "-inf", "inf"), (-1.0, 2.0, 3.0, 4.0)),
        (command("acceleration", -5, 6, OFF), (-1.0, 2.0, 3.0, 4.0)),
        (command("jerk", -7, 8), (-1.0, 2.0, 3.0, 4.0, None, None, 8.0)),
        (command("jerk", -7), (-1.0, 2.0, 3.0, 4.0)),
        (command("jerk", None, 8, OFF), (-1.0, 2.0, 3.0, 4.0)),
        # All of them off.
        (OFF + command("position", 0, 1), ()),
    ],
)
def test_command_interfaces_narrow_the_limits(commands, limits):
    assert find(LIMIT, commands) == (JointLimits(*limits), None)


def test_command_interfaces_limit_a_joint_whose_urdf_does_not():
    commands = command("position", -1, 2) + command("velocity", -3, 3)
    commands += command("effort", None, 4)

    assert find("", commands, type="continuous") == (HARD, None)


def test_a_joint_in_two_blocks_has_the_limits_of_both():
    other = '<ros2_control name="d"><joint name="j">{}</joint></ros2_control>'
    first = command("position", 0, 1)

    both = find(LIMIT, first, blocks=other.format(command("velocity", -1, 1)))
    off = find(LIMIT, first, blocks=other.format(OFF + command("velocity", -1, 1)))

    assert both == (JointLimits(0.0, 1.0, max_velocity=1.0, max_effort=4.0), None)
    assert off == (JointLimits(), None)


SAFETY = (
    '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="1.5" '
    'k_position="10" k_velocity="20"/>'
)
SOFT = SoftJointLimits(-0.5, 1.5, 10.0, 20.0)


@pytest.mark.parametrize(
    ("body", "commands", "soft"),
    [
        (LIMIT + SAFETY, "", SOFT),
        (SAFETY, "", SOFT),
        # Within the hard ones.
        (LIMIT + SAFETY.replace("-0.5", "-9").replace("1.5", "9"), "", (-1.0, 2.0)),
        (LIMIT + SAFETY, command("position", 0, 1), (0.0, 1.0)),
        (LIMIT + SAFETY, command("position", 0, 1, OFF), SOFT),
        (LIMIT + SAFETY, OFF + command("position"), None),
    ],
)
def test_soft_limits_lie_within_the_hard_ones(body, commands, soft):
    if isinstance(soft, tuple):
        soft = SoftJointLimits(*soft, 10.0, 20.0)

    assert find(body, commands)[1] == soft


@pytest.mark.parametrize(
    ("text", "read", "lines"),
    [
        (SAFETY, SafetyController(-0.5, 1.5, 10.0, 20.0), []),
        ("<safety_controller/>", SafetyController(), []),
        (
            '<safety_controller k_position="fast" k_velocity="20"/>',
            SafetyController(k_velocity=20.0),
            [
                "warning: arm.urdf: joint 'j': k_position: expected a number, "
                "got 'fast'; taken as not given"
            ],
        ),
        (
            '<safety_controller soft_upper_limit="inf" k_velocity="nan"/>',
            SafetyController(),
            [
                "warning: arm.urdf: joint 'j': soft_upper_limit: expected a finite "
                "number, got 'inf'; taken as not given",
                "warning: arm.urdf: joint 'j': k_velocity: expected a number, "
                "got 'nan'; taken as not given",
            ],
        ),
    ],
)
def test_a_safety_controller_is_read(text, read, lines):
    robot, found = parse(LIMIT + text)

    assert robot.joint("j").safety_controller == read
    assert found == lines


def test_a_joint_without_a_safety_controller_has_none():
    robot, _ = parse(LIMIT)

    assert robot.joint("j").safety_controller is None


@pytest.mark.parametrize(
    ("soft", "position_range", "slope"),
    [
        (SoftJointLimits(-1.0, 1.0, 2.0), (-1.0, 1.0), 2.0),
        (SoftJointLimits(-1.0, 1.0), (-1.0, 1.0), None),
        (SoftJointLimits(-1.0, 1.0, 0.0), (-1.0, 1.0), None),
        (SoftJointLimits(-1.0, 1.0, math.inf), (-1.0, 1.0), None),
        (SoftJointLimits(-1.0, None, 2.0), None, None),
        (SoftJointLimits(None, 1.0, 2.0), None, None),
        (SoftJointLimits(-math.inf, 1.0, 2.0), None, None),
        (SoftJointLimits(-1.0, math.inf, 2.0), None, None),
        # As those of a tag that gives none.
        (SoftJointLimits(0.0, 0.0, 2.0), None, None),
        (SoftJointLimits(1.0, -1.0, 2.0), None, None),
    ],
)
def test_soft_limits_count_where_they_leave_a_range(soft, position_range, slope):
    assert (soft.position_range, soft.slope) == (position_range, slope)


@pytest.mark.parametrize(
    ("low", "high", "position_range"),
    [
        (None, None, None),
        (-1.0, None, (-1.0, math.inf)),
        (None, 1.0, (-math.inf, 1.0)),
        (-1.0, 1.0, (-1.0, 1.0)),
    ],
)
def test_a_range_may_be_open(low, high, position_range):
    assert JointLimits(low, high).position_range == position_range


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: JointLimits(max_velocity=-1.0),
            "max_velocity: expected a number from 0 on, got -1.0",
        ),
        (
            lambda: JointLimits(max_effort=-1.0),
            "max_effort: expected a number from 0 on, got -1.0",
        ),
        (
            lambda: JointLimits(max_acceleration=-1.0),
            "max_acceleration: expected a number from 0 on, got -1.0",
        ),
        (
            lambda: JointLimits(max_deceleration=-1.0),
            "max_deceleration: expected a number from 0 on, got -1.0",
        ),
        (
            lambda: JointLimits(max_jerk=-1.0),
            "max_jerk: expected a number from 0 on, got -1.0",
        ),
        (
            lambda: JointLimits(min_position=math.nan),
            "min_position: expected a number, got nan",
        ),
        (
            lambda: SoftJointLimits(k_velocity=math.nan),
            "k_velocity: expected a number, got nan",
        ),
    ],
)
def test_limits_that_are_none_are_refused(make, message):
    with pytest.raises(ValueError, match="expected") as caught:
        make()

    assert str(caught.value) == message


LIMITED = "those of position, velocity, effort, acceleration, jerk are"


@pytest.mark.parametrize(
    ("commands", "lines"),
    [
        (command("position", 0, 1) + command("jerk", None, 1), []),
        (command("torque"), []),
        (
            command("torque", -1),
            [f"info: arm.urdf: joint 'j': limits of 'torque'; not enforced; {LIMITED}"],
        ),
        (
            command("grip", None, 1),
            [f"info: arm.urdf: joint 'j': limits of 'grip'; not enforced; {LIMITED}"],
        ),
        (
            command("jerk", -1, 1),
            [
                "info: arm.urdf: joint 'j': jerk, min: expected max alone; "
                "it has no effect"
            ],
        ),
        (
            command("position", 3, 4),
            [
                "warning: arm.urdf: joint 'j': its position is to be at least 3.0 and "
                "at most 2.0; every position is out of bounds"
            ],
        ),
    ],
)
def test_limits_that_can_not_hold_are_reported(commands, lines):
    robot, _ = parse(LIMIT, commands)
    report = LoadReport()

    find_joint_limits(robot, report)

    assert [str(entry) for entry in report] == lines
