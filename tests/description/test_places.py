"""Lines of links and joints in the files that make them."""

import pytest

from arm_drake.description.report import find_place

ENTRY = """<robot name="r">
  <link name="base"/>
  <joint type="fixed"
         name='weld'/>
  <link name="${prefix}tip"/>
  <link name="$(arg side)_hand"/>
  <link name="${name}"/>
  <link name="${a}_twin_1"/>
  <ros2_control name="arm" type="system"/>
</robot>
"""
PART = """<robot>
  <link name="base"/>
  <joint name="base" type="fixed"/>
  <link name="${b}_twin_1"/>
</robot>
"""


BLOCKS = """<robot name="r">
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


@pytest.mark.parametrize(
    ("where", "line"),
    [
        ("joint 'weld'", 12),
        ("link 'tip'", 14),
        ("ros2_control 'arm', joint 'weld'", 4),
        ("sensor 'front'", 13),
    ],
)
def test_comments_and_joints_of_other_blocks_are_not_meant(tmp_path, where, line):
    file = tmp_path / "entry"
    file.write_text(BLOCKS, encoding="utf-8")

    assert find_place(lambda: [file])(where) == (file, line)


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("link 'base'", ("entry", 2)),
        ("link 'base', visual 0", ("entry", 2)),
        ("joint 'base'", ("part", 3)),
        ("joint 'weld'", ("entry", 3)),
        ("ros2_control 'arm', joint 'weld'", ("entry", 9)),
        # Computed names.
        ("link 'left_tip'", ("entry", 5)),
        ("link 'left_hand'", ("entry", 6)),
        # Nothing fits, or more than one.
        ("link 'nope'", None),
        ("link 'a_twin_1'", None),
        ("controller 'base'", None),
        ("", None),
    ],
)
def test_a_place_is_found_in_the_files(tmp_path, where, expected):
    for name, text in (("entry", ENTRY), ("part", PART)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    files = [tmp_path / name for name in ("entry", "gone", "part")]

    found = find_place(lambda: files)(where)

    assert (found and (found[0].name, found[1])) == expected
