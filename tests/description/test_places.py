"""Lines of elements in the files that a description is made of."""

from pathlib import Path

import pytest

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import Places
from arm_drake.description.xacro import expand_xacro
from arm_drake.errors import DescriptionError

ENTRY = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="part.xacro"/>
  <link name="base"/>
  <joint type="fixed"
         name='weld'/>
  <xacro:arm name="a"/>
  <xacro:arm name="b"/>
  <xacro:if value="false"><link name="c_arm"/></xacro:if>
  <ros2_control name="arm" type="system">
    <xacro:drive name="weld"/>
  </ros2_control>
</robot>
"""
PART = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="arm" params="name">
    <link name="${name}_arm">
      <visual/>

      <visual><material name="${name}"/></visual>
    </link>
    <xacro:element xacro:name="${'li' + 'nk'}" name="${name}"/>
  </xacro:macro>
  <xacro:macro name="drive" params="name">
    <joint name="${name}"/>
  </xacro:macro>
</robot>
"""

PLAIN = """
<robot name="r">
  <!-- <joint name="weld" type="fixed"/>
       <link name="tip"/> -->
  <ros2_control name="arm" type="system">
    <joint name="weld">
      <command_interface name="position"/>
    </joint>
  </ros2_control>
  <transmission name="t"><joint name="weld"/></transmission>
  <gazebo reference="a > b"><plugin name="p"><joint name="weld"/></plugin></gazebo>
  <gazebo reference="tip"/>
  <joint name="weld" type="fixed"/>
  <gazebo><sensor type="camera" name="front"><joint name="weld"/></sensor></gazebo>
  <link name="tip"/>
</robot>
"""


def places_of(entry: Path) -> Places:
    places = Places()
    expand_xacro(entry, {}, PackageFinder(entry), places=places)
    return places


@pytest.mark.parametrize(
    ("where", "line"),
    [
        ("joint 'weld'", 13),
        ("link 'tip'", 15),
        ("ros2_control 'arm', joint 'weld'", 6),
        ("ros2_control 'arm', joint 'other'", 5),
        ("sensor 'front'", 14),
        ("IMU 'front', linear_acceleration/z", 14),
    ],
)
def test_comments_and_joints_of_other_blocks_are_not_meant(tmp_path, where, line):
    file = tmp_path / "entry.urdf"
    file.write_text(PLAIN, encoding="utf-8")

    assert places_of(file).find(where) == (file, line)


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("link 'base'", ("entry.xacro", 3)),
        ("link 'base', visual 0", ("entry.xacro", 3)),
        ("joint 'weld'", ("entry.xacro", 4)),
        # Of macros the line in the macro.
        ("link 'a_arm'", ("part.xacro", 3)),
        ("link 'b_arm', inertial", ("part.xacro", 3)),
        ("link 'b_arm', visual 1", ("part.xacro", 6)),
        ("link 'b_arm', visual 2", ("part.xacro", 3)),
        ("material 'b'", ("part.xacro", 6)),
        ("ros2_control 'arm', joint 'weld'", ("part.xacro", 11)),
        ("link 'c_arm'", None),
        ("controller 'base'", None),
        ("", None),
    ],
)
def test_a_place_is_found_in_the_file_that_makes_it(tmp_path, where, expected):
    for name, text in (("entry.xacro", ENTRY), ("part.xacro", PART)):
        (tmp_path / name).write_text(text, encoding="utf-8")

    found = places_of(tmp_path / "entry.xacro").find(where)

    assert (found and (found[0].name, found[1])) == expected


@pytest.mark.parametrize("name", ["entry.urdf", "entry.xacro"])
def test_lines_before_a_declaration_count(tmp_path, name):
    file = tmp_path / name
    declaration = '\n\n<?xml version="1.0"\n  encoding="utf-8"?>'
    if name == "entry.urdf":
        file.write_text(declaration + PLAIN, encoding="utf-8")

        assert places_of(file).find("link 'tip'") == (file, 18)
    else:
        file.write_text(declaration + ENTRY, encoding="utf-8")
        told = "XML or text declaration not at start of entity"
        with pytest.raises(DescriptionError, match=f":3: malformed XML: {told}$"):
            places_of(file)


def test_a_text_has_no_places():
    assert Places().find("link 'base'") is None
