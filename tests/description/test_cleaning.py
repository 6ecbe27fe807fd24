"""Lines of the report about elements that aren't read: one for each."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import report_unread

FILE = Path("arm.urdf")

KNOWN = (
    '<robot name="r"><material name="m"><color rgba="1 0 0 1" /></material>'
    '<link name="a"><inertial><origin xyz="0 0 1" rpy="0 0 0" /><mass value="1" />'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1" /></inertial>'
    '<visual name="v"><origin xyz="0 0 1" /><geometry><mesh filename="a" scale="1" />'
    '</geometry><material name="m" /></visual><collision><geometry>'
    '<cylinder radius="1" length="2" /></geometry></collision></link>'
    '<joint name="j" type="revolute"><parent link="world" /><child link="a" />'
    '<axis xyz="0 0 1" /><limit lower="0" upper="1" effort="1" velocity="1" />'
    '<dynamics damping="1" friction="1" /><mimic joint="k" offset="1" /></joint>'
    "</robot>"
)


def unread(body: str) -> list[str]:
    report = LoadReport()
    report_unread(ET.fromstring(f"<robot>{body}</robot>"), FILE, report)  # noqa: S314
    return [f"{entry.what}; {entry.done}" for entry in report]


def test_what_is_read_is_no_news():
    report = LoadReport()

    report_unread(ET.fromstring(KNOWN), FILE, report)  # noqa: S314

    assert not len(report)


def test_tags_of_hardware_and_gazebo_are_reported_by_those_who_read_them():
    body = "<gazebo/><ros2_control/><joint><safety_controller/></joint>"

    assert unread(body) == []


@pytest.mark.parametrize(
    ("body", "line"),
    [
        ('<link type="x"/>' * 2, "<link type=...>, 2 times; "),
        (
            "<joint><calibration/></joint>" * 3,
            "<joint/calibration>, 3 times; joints are calibrated",
        ),
        ("<transmission/>", "<transmission>; actuators come from <ros2_control>"),
        ("<sensor><a/></sensor>", "<sensor>; it has no effect"),
        (
            "<joint><limit lower='1' soft='2'/></joint>",
            "<joint/limit soft=...>; it has no effect",
        ),
        (
            "<link><inertial><mass value='1'/><x/></inertial></link>",
            "<link/inertial/x>; it has no effect",
        ),
    ],
)
def test_what_is_not_read_is_said_once(body, line):
    (said,) = unread(body)

    assert said.startswith(line)


def test_what_is_beside_the_right_word_is_not_misspelt():
    body = '<joint><limit velocity="1" gear_velocity="2"/></joint>'

    assert unread(body) == ["<joint/limit gear_velocity=...>; it has no effect"]


@pytest.mark.parametrize(
    ("body", "line"),
    [
        (
            '<joint name="j"><orign xyz="0 0 1"/></joint>',
            "joint 'j': <joint/orign>; did you mean <origin>?",
        ),
        (
            '<link name="a"><inertial><mass val="1"/></inertial></link>',
            "link 'a': <link/inertial/mass val=...>; did you mean 'value'?",
        ),
        ('<jiont name="j"/>', "jiont 'j': <jiont>; did you mean <joint>?"),
        ("<ros2_contol/>" * 2, "<ros2_contol>, 2 times; did you mean <ros2_control>?"),
    ],
)
def test_what_seems_misspelt_is_a_warning_with_its_place(body, line):
    report = LoadReport()

    report_unread(ET.fromstring(f"<robot>{body}</robot>"), FILE, report)  # noqa: S314

    assert [*map(str, report)] == [f"warning: arm.urdf: {line}; it has no effect"]


def test_a_geometry_is_left_to_its_own_repair():
    body = "<link><visual><geometry><cone a='1'/></geometry></visual></link>"

    assert unread(body) == []


def test_attributes_of_other_name_spaces_are_no_news():
    assert unread('<link xmlns:x="http://x" x:y="1" name="a"/>') == []
