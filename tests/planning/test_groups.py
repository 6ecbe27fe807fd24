"""Groups of SRDF files, and of controllers where there are none."""

import json
import math
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.planning.groups import find_group, find_state
from arm_drake.planning.timing import motion_limits

JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
<limit lower="-1" upper="1" effort="1" velocity="{3}"/>{4}</joint>"""

URDF = (
    '<robot name="arm">'
    + "".join(f'<link name="{n}"/>' for n in ("base", "one", "two", "three", "l", "r"))
    + JOINT.format("a", "base", "one", 2, "")
    + JOINT.format("b", "one", "two", 3, "")
    + JOINT.format("c", "two", "three", 0, "")
    + JOINT.format("left", "three", "l", 1, "")
    + JOINT.format("right", "three", "r", 1, '<mimic joint="left"/>')
    + "</robot>"
)

SRDF = """<robot name="arm">
  <virtual_joint name="v" type="fixed" parent_frame="world" child_link="base"/>
  <group name="arm"><chain base_link="base" tip_link="three"/></group>
  <group name="gripper"><link name="l"/><joint name="right"/></group>
  <group name="both"><group name="arm"/><group name="gripper"/></group>
  <group name="circle"><group name="circle"/><joint name="a"/></group>
  <group name="empty"/>
  <passive_joint name="b"/>
  <end_effector name="hand" parent_link="three" group="gripper"/>
  <group_state name="up" group="arm"><joint name="a" value="0.5"/>
    <joint name="c" value="-0.5"/></group_state>
  <group_state name="half" group="arm"><joint name="a" value="0.5"/></group_state>
</robot>"""

LIMITS = """default_velocity_scaling_factor: 0.5
default_acceleration_scaling_factor: 1.5
joint_limits:
  a: {has_velocity_limits: true, max_velocity: 1.5,
      has_position_limits: true, min_position: -1, has_effort_limits: false,
      has_acceleration_limits: true, max_acceleration: 7,
      has_jerk_limits: true, max_jerk: 50}
  b: {has_velocity_limits: false, max_velocity: 1.0}
  left: {max_velocity: 0.7}
"""


KINEMATICS = """arm:
  kinematics_solver: kdl_kinematics_plugin/KDLKinematicsPlugin
  kinematics_solver_timeout: 0.005
  position_only_ik: true
gripper: {position_only_ik: false}
"""

WRONG_SRDF = SRDF.replace(
    '<group name="empty"/>',
    """<group name="empty"/>
  <group name="tool"><joint name="v"/><link name="base"/><joint name="right"/></group>
  <group name="ghost"><joint name="d"/><joint name="e"/><link name="four"/></group>
  <group name="ring"><group name="round"/></group>
  <group name="round"><group name="ring"/><group name="nowhere"/></group>
  <group name="down"><chain base_link="three" tip_link="one"/></group>
  <group_state name="shut" group="gripper"><joint name="left" value="much"/>
    <joint name="right" value="0"/><joint name="d" value="0"/></group_state>""",
)

WRONG_LIMITS = """joint_limit: {}
default_velocity_scaling_factor: true
joint_limits:
  a: {has_velocity_limits: true, max_velocity: -1, max_acceleration: fast}
  b: {has_velocity_limits: "yes", max_velocity: 1}
  c: [1, 2]
  j9: {has_velocity_limits: true, max_velocity: 1}
"""

WRONG_KINEMATICS = """/**:
  ros__parameters:
    robot_description_kinematics:
      arm: {position_only_ik: "true"}
      legs: {position_only_ik: true}
"""


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ad.Robot:
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    files = {
        "arm/package.xml": "<name>arm</name>",
        "arm/urdf/arm.urdf": URDF,
        "arm_moveit_config/package.xml": "<name>arm_moveit_config</name>",
        "arm_moveit_config/config/arm.srdf": SRDF,
        "arm_moveit_config/config/joint_limits.yaml": LIMITS,
        "arm_moveit_config/config/kinematics.yaml": KINEMATICS,
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return ad.load_robot(tmp_path / "arm")


def test_groups_are_those_of_the_srdf_then_controllers(robot: ad.Robot) -> None:
    groups = ad.planning_groups(robot)

    members = {name: group.joints for name, group in groups.items()}
    # Passive joints and those that follow others are in none; "empty" is no group.
    from_srdf = {
        "arm": ("a", "c"),
        "gripper": ("left",),
        "both": ("a", "c", "left"),
        "circle": ("a",),
    }
    assert from_srdf.items() <= members.items()
    assert set(members) - set(from_srdf) == {"joint_trajectory_controller"}
    assert groups["arm"].tip == "three"
    assert groups["circle"].tip == "one"


def test_states_are_those_of_a_group_s_joints(robot: ad.Robot) -> None:
    group = find_group(robot, "arm")

    assert find_state(group, "up") == {"a": 0.5, "c": -0.5}
    assert find_state(group, "center") == {"a": 0.0, "c": 0.0}
    # Joints that a state leaves out stay where they are.
    assert find_state(group, "half") == {"a": 0.5}
    plan = ad.plan(robot, "half", group="arm", world="void", start={"c": 0.2})
    assert plan.end == pytest.approx({"a": 0.5, "c": 0.2})
    # It is of the group alone.
    assert "up" in find_group(robot, ["a"]).states
    with pytest.raises(ad.ArmDrakeError) as caught:
        find_state(find_group(robot, "both"), "half")
    assert str(caught.value) == (
        "group 'both' has no state 'half'; known: center, home, initial"
    )


def test_speeds_are_those_of_moveit_then_the_description(robot: ad.Robot) -> None:
    limits = motion_limits(robot)

    assert limits["a"] == (1.5, 7.0, 50.0)
    # Full speed takes a second where nothing is said.
    assert limits["b"] == (3.0, 3.0, math.inf)
    # A speed of 0 is none: 1 rad/s.
    assert limits["c"] == (1.0, 1.0, math.inf)
    # What has no flag counts.
    assert limits["left"] == (0.7, 0.7, math.inf)


@pytest.mark.slow
def test_plans_are_as_fast_as_joint_limits_yaml_says(robot: ad.Robot) -> None:
    by_default, whole, half = (
        ad.plan(robot, {"c": 1.0}, group="arm", world="void", velocity_scaling=scaling)
        for scaling in (None, 1.0, 0.5)
    )

    assert by_default.trajectory == half.trajectory
    # Joint c goes at 1 rad/s within a second: 1 rad takes 2 s, 2.5 s at half of that.
    assert whole.duration == pytest.approx(2.0, rel=0.03)
    assert half.duration == pytest.approx(2.5, rel=0.03)


def test_what_of_moveit_s_files_has_no_effect_is_in_the_report(
    robot: ad.Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "arm_moveit_config/config"

    assert check(tmp_path / "arm", folder, capsys) == [
        ("warning", "arm.srdf", "group 'circle'", "it is part of itself"),
        ("warning", "arm.srdf", "group 'empty'", "no joint of it moves by itself"),
        (
            "warning",
            "joint_limits.yaml",
            "default_acceleration_scaling_factor",
            "expected a number above 0, at most 1, got 1.5",
        ),
        (
            "info",
            "joint_limits.yaml",
            "joint 'a'",
            "parameters 'has_position_limits', 'min_position'",
        ),
        (
            "info",
            "kinematics.yaml",
            "group 'arm'",
            "parameters 'kinematics_solver', 'kinematics_solver_timeout'",
        ),
    ]


def check(
    package: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> list[tuple[str, ...]]:
    """Return what `arm-drake check` says of the files of a folder, by file."""
    main(["check", str(package), "--json"])
    found = [
        (entry["severity"], Path(entry["file"]).name, entry["where"], entry["what"])
        for entry in json.loads(capsys.readouterr().out)["report"]
        if entry["file"] and Path(entry["file"]).parent == folder
    ]
    return sorted(found, key=lambda each: each[1:3])


def test_what_of_moveit_s_files_can_not_be_used_is_in_the_report(
    robot: ad.Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "arm_moveit_config/config"
    (folder / "arm.srdf").write_text(WRONG_SRDF, encoding="utf-8")
    (folder / "joint_limits.yaml").write_text(WRONG_LIMITS, encoding="utf-8")
    (folder / "kinematics.yaml").write_text(WRONG_KINEMATICS, encoding="utf-8")

    found = check(tmp_path / "arm", folder, capsys)

    joint, itself = "no joint of it moves by itself", "it is part of itself"
    group = "group {!r}".format
    state = "state 'shut' of group 'gripper'"
    expected = {
        "arm.srdf": [
            (group("circle"), itself),
            (group("down"), "link 'three' doesn't carry link 'one'"),
            (group("down"), joint),
            (group("empty"), joint),
            (group("ghost"), "there is no joint 'd', 'e'"),
            (group("ghost"), "there is no link 'four'"),
            (group("ghost"), joint),
            (group("ring"), itself),
            (group("ring"), joint),
            (group("round"), itself),
            (group("round"), "there is no group 'nowhere'"),
            (group("round"), joint),
            (group("tool"), joint),
            (state, "joint 'left': expected a number, got 'much'"),
            (state, "there is no joint 'd'"),
        ],
        "joint_limits.yaml": [
            ("", "parameters 'joint_limit'"),
            (
                "default_velocity_scaling_factor",
                "expected a number above 0, at most 1, got True",
            ),
            ("joint 'a'", "max_velocity: expected a number above 0, got -1"),
            ("joint 'a'", "max_acceleration: expected a number above 0, got 'fast'"),
            ("joint 'b'", "has_velocity_limits: expected true or false, got 'yes'"),
            ("joint 'c'", "expected a mapping, got [1, 2]"),
            ("joint 'j9'", "there is no such joint that moves"),
        ],
        "kinematics.yaml": [
            (group("arm"), "position_only_ik: expected true or false, got 'true'"),
            (group("legs"), "there is no such group that moves"),
        ],
    }
    for name, lines in expected.items():
        assert [each[2:] for each in found if each[1] == name] == lines
    # A tool and what isn't a parameter are no fault.
    kinds = {each[2] for each in found if each[0] == "info"}
    assert kinds == {"", group("tool")}


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("joint_limits.yaml", "joint_limits: [1, 2]", "expected a mapping by joint"),
        ("joint_limits.yaml", "- 3", "expected a mapping"),
        ("kinematics.yaml", "yes", "expected a mapping"),
    ],
)
def test_files_of_moveit_that_are_no_mappings_are_in_the_report(
    robot: ad.Robot, name: str, text: str, what: str
) -> None:
    (path,) = robot.description.file.parents[2].glob(f"*/config/{name}")
    path.write_text(text, encoding="utf-8")

    ad.planning_groups(robot)

    assert motion_limits(robot)["b"] == (3.0, 3.0, math.inf)
    assert [e.what for e in robot.report if e.file == str(path)] == [what]


@pytest.mark.slow
def test_a_robot_without_srdf_has_its_controllers_as_groups() -> None:
    robot = ad.load_robot("doosan_a0912")

    (group,) = ad.planning_groups(robot).values()

    assert group.joints == tuple(f"joint{i}" for i in range(1, 7))
    assert group.tip == "link6"
    assert group.name in [c.name for c in robot.controllers.controllers]


def test_unknown_groups_and_joints_are_named(robot: ad.Robot) -> None:
    for wrong, message in [
        ("am", "no planning group 'am'; did you mean 'arm'? known: "),
        (["d"], "no joint 'd'; known: a, b, c, left"),
        ([], "group: expected at least one joint"),
    ]:
        with pytest.raises(ad.ArmDrakeError) as caught:
            find_group(robot, wrong)
        assert str(caught.value).startswith(message)


def test_a_pose_is_a_position_where_kinematics_yaml_says_so(robot: ad.Robot) -> None:
    groups = ad.planning_groups(robot)
    assert [name for name, g in groups.items() if g.is_position_only] == ["arm"]
    # Its joints turn about one axis, so that no other turn can be reached.
    pose = [*robot.forward_kinematics({}, "three").translation(), 1.0, 1.0, 1.0]

    plan = ad.plan(robot, pose, group="arm", world="void")

    reached = robot.forward_kinematics(plan.end, "three").translation()
    assert reached == pytest.approx(pose[:3], abs=1e-4)
    with pytest.raises(ad.NoSolution):
        ad.plan(robot, pose, group="arm", world="void", mask=(True,) * 6)
    # So it is for inverse kinematics of that group, but not of its joints alone.
    assert robot.solve_ik("three", pose, group="arm").position_error < 1e-5
    with pytest.raises(ad.NoSolution):
        robot.solve_ik("three", pose, group=["a", "c"])


def test_a_kinematics_yaml_that_can_not_be_read_is_named(
    robot: ad.Robot, tmp_path: Path
) -> None:
    file = tmp_path / "arm_moveit_config/config/kinematics.yaml"
    file.write_text("arm: [", encoding="utf-8")

    with pytest.raises(ad.ArmDrakeError) as caught:
        ad.plan(robot, "up", group="arm")

    assert f"{file}:" in str(caught.value)
