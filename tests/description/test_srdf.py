"""Collisions that MoveIt's files disable, and states of groups with a name."""

from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.description.report import LoadReport
from arm_drake.description.srdf import (
    GroupState,
    find_disabled_collisions,
    find_group_states,
    find_srdf_files,
)
from arm_drake.errors import ArmDrakeError
from arm_drake.plant.joint_ranges import find_gripper_ranges
from tests import models

SRDF = """<robot name="{name}">
  <disable_collisions link1="last" link2="first" reason="Never"/>
  <disable_collisions link1="first" link2="elsewhere" reason="Never"/>
</robot>"""

# Two balls that overlap by 0.2 mm.
TOUCHING = models.OVERLAPPING.replace("0.05 0 0", "0.0999 0 0")


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.fixture
def robot(tmp_path, monkeypatch) -> ad.Robot:
    """Return a robot of two balls in a package of its own."""
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    write(tmp_path / "arm/package.xml", "<name>arm</name>")
    write(tmp_path / "arm/urdf/arm.urdf", TOUCHING)
    write(tmp_path / "arm_moveit_config/package.xml", "<name>arm_moveit_config</name>")
    return ad.load_robot(tmp_path / "arm")


@pytest.mark.parametrize(
    "place", ["arm/srdf/arm.srdf", "arm_moveit_config/config/arm.srdf"]
)
def test_the_files_of_the_package_and_of_moveit_are_read(robot, tmp_path, place):
    write(tmp_path / place, SRDF.format(name="overlapping"))
    report = LoadReport()

    pairs = find_disabled_collisions(robot, report)

    assert pairs == {("first", "last")}
    assert len(report) == 0


def test_moveit_packages_elsewhere_are_found_by_package_paths(robot, tmp_path):
    elsewhere = tmp_path.parent / f"{tmp_path.name}_elsewhere"
    write(elsewhere / "m/package.xml", "<name>my_moveit_config</name>")
    write(elsewhere / "m/config/arm.srdf", SRDF.format(name="overlapping"))

    other = ad.load_robot(tmp_path / "arm", package_paths=elsewhere)

    assert find_disabled_collisions(robot, LoadReport()) == frozenset()
    assert find_disabled_collisions(other, LoadReport()) == {("first", "last")}


def test_the_file_of_another_robot_says_nothing(robot, tmp_path):
    write(tmp_path / "arm/srdf/arm.srdf", SRDF.format(name="other"))

    assert find_disabled_collisions(robot, LoadReport()) == frozenset()


def test_of_several_files_that_of_the_name_of_the_description_counts(robot, tmp_path):
    # As example-robot-data has them: one file for each tool, all of one robot's name.
    none = '<robot name="overlapping"/>'
    write(tmp_path / "arm/srdf/arm.srdf", none)
    write(tmp_path / "arm/srdf/arm_gripper.srdf", SRDF.format(name="overlapping"))

    assert [file.name for file in find_srdf_files(robot)] == ["arm.srdf"]
    assert find_disabled_collisions(robot, LoadReport()) == frozenset()


def test_a_pair_that_one_of_several_files_leaves_out_may_not_touch(robot, tmp_path):
    write(tmp_path / "arm/srdf/with_tool.srdf", SRDF.format(name="overlapping"))
    alone = find_disabled_collisions(robot, LoadReport())
    write(tmp_path / "arm/srdf/without.srdf", '<robot name="overlapping"/>')

    assert alone == {("first", "last")}
    assert find_disabled_collisions(robot, LoadReport()) == frozenset()


def test_a_broken_file_is_reported(robot, tmp_path):
    write(tmp_path / "arm/srdf/arm.srdf", "<robot")
    report = LoadReport()

    assert find_disabled_collisions(robot, report) == frozenset()
    assert str(report).startswith(f"warning: {tmp_path / 'arm/srdf/arm.srdf'}: the SRD")


@pytest.mark.parametrize(("name", "contacts"), [("overlapping", 0), ("other", 1)])
def test_disabled_links_pass_through_each_other(robot, tmp_path, name, contacts):
    write(tmp_path / "arm/srdf/arm.srdf", SRDF.format(name=name))
    options = ad.SimulationOptions(self_collision=True)
    diagram = ad.build_diagram(robot, world="void", options=options)

    plant = diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    results = plant.get_contact_results_output_port().Eval(context)

    assert results.num_point_pair_contacts() == contacts


STATES = """<robot name="{name}">
  <group_state name="home" group="arm">
    <joint name="one" value="0.1"/><joint name="two" value="-0.2"/>
    <joint name="one" value="9"/><joint name="elsewhere" value="1"/>
    <joint name="three" value="none"/>
  </group_state>
  <group_state name="home" group="gripper">
    <joint name="three" value="0.3"/>
  </group_state>
  <group_state name="up" group="arm"><joint name="one" value="1.5"/></group_state>
  <group_state name="home" group="arm"><joint name="one" value="2"/></group_state>
  <group_state name="parked" group="base">
    <joint name="elsewhere" value="1"/>
  </group_state>
</robot>"""


def test_states_of_the_same_name_belong_each_to_its_group(robot, tmp_path):
    write(tmp_path / "arm/srdf/arm.srdf", STATES.format(name="overlapping"))

    states = find_group_states(robot)

    assert states == (
        GroupState("arm", "home", {"one": 0.1, "two": -0.2}),
        GroupState("gripper", "home", {"three": 0.3}),
        GroupState("arm", "up", {"one": 1.5}),
    )
    assert [s.label for s in states] == ["arm: home", "gripper: home", "arm: up"]


@pytest.mark.slow
def test_only_independent_joints_of_one_value_have_a_state(tmp_path):
    joints = (
        models.joint("float", "base", "a", type="floating"),
        models.joint("own", "base", "b"),
        models.joint("follower", "base", "c", inside='<mimic joint="own"/>'),
    )
    links = '<link name="base"/>' + "".join(models.bob(name) for name in "abc")
    robot = models.load(tmp_path, f'<robot name="r">{links}{"".join(joints)}</robot>')
    write(tmp_path / "package.xml", "<name>r</name>")
    write(
        tmp_path / "r.srdf",
        '<robot name="r"><group_state name="home" group="all">'
        '<joint name="float" value="0 0 0 0 0 0 1"/><joint name="follower" value="1"/>'
        '<joint name="own" value="1"/></group_state></robot>',
    )

    assert find_group_states(robot) == (GroupState("all", "home", {"own": 1.0}),)


def test_states_of_another_robot_are_left_out(robot, tmp_path):
    mine = tmp_path / "arm/srdf/arm.srdf"
    write(mine, STATES.format(name="overlapping"))
    write(tmp_path / "arm/srdf/a.srdf", STATES.format(name="other").replace("0.1", "7"))

    assert find_group_states(robot)[0].positions["one"] == 0.1
    assert find_srdf_files(robot) == (mine,)


def test_files_that_are_named_are_taken_in_place_of_those_around(robot, tmp_path):
    write(tmp_path / "arm/srdf/arm.srdf", STATES.format(name="overlapping"))
    other = tmp_path / "other.srdf"
    write(other, STATES.format(name="another").replace("0.1", "0.7"))

    chosen = ad.load_robot(robot.description.file, srdf=other)

    assert find_group_states(chosen)[0].positions["one"] == 0.7
    assert find_srdf_files(chosen) == (other,)
    with pytest.raises(ArmDrakeError, match=r"none\.srdf: no such SRDF file"):
        ad.load_robot(robot.description.file, srdf=[tmp_path / "none.srdf"])


def test_states_called_open_and_closed_are_those_of_the_gripper(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    robot = models.load(tmp_path, models.GRIPPER)
    write(tmp_path / "package.xml", "<name>gripper</name>")
    write(
        tmp_path / "gripper.srdf",
        '<robot name="gripper">'
        '<group_state name="open" group="lid"><joint name="lid" value="2"/>'
        '</group_state><group_state name="open" group="g">'
        '<joint name="finger" value="0.4"/></group_state>'
        '<group_state name="close" group="g">'
        '<joint name="finger" value="-0.2"/></group_state></robot>',
    )

    assert find_gripper_ranges(robot) == {"finger": (0.4, -0.2)}
