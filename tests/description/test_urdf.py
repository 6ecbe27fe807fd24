"""URDF text to a RobotDescription, or to one message with its place."""

import copy
import dataclasses as dc
import time
from pathlib import Path

import pytest

from arm_drake.description.joints import JointInfo, JointLimits, Mimic
from arm_drake.description.links import InertialInfo
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription, parse_urdf
from arm_drake.errors import DescriptionError

FILE = Path("arm.urdf")

LINKS = '<link name="a"/><link name="b"/><link name="c"/>'
TYPES = "revolute, continuous, prismatic, fixed, floating, planar"


def joint(
    body: str = "", *, name="j", type="revolute", parent="a", child="b", limit=""
) -> str:
    return (
        f'<joint name="{name}" type="{type}"><parent link="{parent}"/>'
        f'<child link="{child}"/><limit {limit}/>{body}</joint>'
    )


def parse(body: str) -> RobotDescription:
    text = f'<robot name="hand">{body}</robot>'
    return parse_urdf(text, FILE, PackageFinder(FILE), LoadReport())


def read_joint(*args, **kwargs) -> JointInfo:
    return parse(LINKS + joint(*args, **kwargs)).joint("j")


def test_descriptions_are_equal_if_they_say_the_same():
    robot = parse(LINKS + joint())
    first, *others = robot.link_infos
    changed = dc.replace(first, inertial=InertialInfo(1.0))

    assert robot == copy.deepcopy(robot)
    assert robot != dc.replace(robot, link_infos=(changed, *others))


WHOLE = """
<material name="m"><color rgba="0.1 0.2 0.3 0.4"/></material>
<link name="a &amp; &quot;b&quot;">
  <inertial><origin xyz="0.1 0.2 0.3" rpy="0.3 0.2 0.1"/><mass value="0.7"/>
  <inertia ixx="0.11" ixy="0.001" ixz="0.002" iyy="0.12" iyz="0.003" izz="0.13"/>
  </inertial>
  <visual name="v"><origin rpy="0.1 0 0"/><geometry><box size="0.1 0.2 0.3"/></geometry>
  <material name="m"/></visual>
  <visual><geometry><capsule radius="0.1" length="0.7"/></geometry></visual>
  <collision name="c"><geometry><sphere radius="0.1"/></geometry></collision>
  <collision><geometry><cylinder radius="0.1" length="0.3"/></geometry></collision>
</link>
<link name="c"><inertial><mass value="1e-7"/>
<inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/></inertial></link>
<link name="d"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="tip"/>
<joint name="j" type="revolute"><parent link="a &amp; &quot;b&quot;"/><child link="c"/>
<origin xyz="0.1 -0.1 1e-17" rpy="0.7 0 0"/><axis xyz="0.6 0 0.8"/>
<limit lower="-0.1" upper="0.3" effort="0.7" velocity="0.9"/><dynamics damping="0.1"/>
</joint>
<joint name="k" type="prismatic"><parent link="c"/><child link="d"/>
<limit upper="0.1" effort="1" velocity="1"/>
<mimic joint="j" multiplier="-0.1" offset="0.05"/></joint>
<joint name="f" type="fixed"><parent link="d"/><child link="tip"/></joint>
"""


def test_what_is_written_is_what_was_read_to_the_bit():
    robot = parse(WHOLE)

    again = parse_urdf(robot.urdf, FILE, PackageFinder(FILE), LoadReport())

    assert again.link_infos == robot.link_infos
    assert again.joints == robot.joints
    first = robot.link_infos[0]
    assert first.name == 'a & "b"'
    assert (first.mass, first.inertial.origin.rpy) == (0.7, (0.3, 0.2, 0.1))
    assert first.inertial.moments == (0.11, 0.001, 0.002, 0.12, 0.003, 0.13)
    assert [v.geometry.type for v in first.visuals] == ["box", "capsule"]
    assert first.visuals[0].color == (0.1, 0.2, 0.3, 0.4)
    assert [c.name for c in first.collisions] == ["c", ""]
    assert robot.joint("k").limits == JointLimits(0.0, 0.1, 1.0, 1.0)


def test_a_robot_has_the_names_of_its_links_and_joints_in_order():
    robot = parse(
        '<link name="world"/><link name="b"/><link name="a"/>'
        + joint(name="k", type="fixed", parent="world", child="a")
        + joint(name="j", parent="a", child="b")
    )

    assert robot.name == "hand"
    assert robot.links == ("world", "b", "a")
    assert [j.name for j in robot.joints] == ["k", "j"]
    assert [j.name for j in robot.movable_joints] == ["j"]
    assert robot.roots == ()


def test_a_robot_without_a_name_is_called_like_its_file():
    text = '<robot><link name="a"/></robot>'
    file = Path("elbow.urdf.xacro")

    robot = parse_urdf(text, file, PackageFinder(file), LoadReport())

    assert robot.name == "elbow"
    assert robot.roots == ("a",)


def test_the_source_is_kept_as_written_and_the_urdf_without_what_drake_refuses():
    robot = parse(LINKS + '<transmission name="t"/><gazebo/><ros2_control name="x"/>')

    assert "<transmission" in robot.source
    for tag in ("<transmission", "<gazebo", "<ros2_control"):
        assert tag not in robot.urdf


def test_a_joint_has_its_limits_damping_and_friction():
    limit = 'lower="-1" upper="2" effort="3" velocity="4"'

    read = read_joint('<dynamics damping="5" friction="6"/>', limit=limit)

    assert read.limits == JointLimits(lower=-1.0, upper=2.0, effort=3.0, velocity=4.0)
    assert (read.damping, read.friction) == (5.0, 6.0)
    assert (read.parent, read.child, read.type) == ("a", "b", "revolute")


def test_limits_left_out_are_as_the_urdf_specification_says():
    assert read_joint().limits == JointLimits(lower=0.0, upper=0.0)


@pytest.mark.parametrize("unset", ["0", "0.0", "inf"])
def test_an_effort_or_speed_of_zero_or_infinity_is_unset(unset):
    limit = f'effort="{unset}" velocity="{unset}"'

    assert read_joint(limit=limit).limits == JointLimits(lower=0.0, upper=0.0)


def test_a_negative_effort_or_speed_is_meant_as_its_amount():
    limits = read_joint(limit='effort="-3" velocity="-4"').limits

    assert (limits.effort, limits.velocity) == (3.0, 4.0)


def test_a_continuous_joint_has_no_range():
    limits = read_joint(type="continuous", limit='lower="1" upper="-1"').limits

    assert (limits.lower, limits.upper) == (None, None)


def test_a_joint_without_a_limit_has_none():
    text = LINKS + joint().replace("<limit />", "")

    assert parse(text).joint("j").limits == JointLimits()


def test_a_mimic_joint_has_its_master_multiplier_and_offset():
    master = joint(name="m", parent="b", child="c")

    inputs = '<mimic joint="m" multiplier="-2" offset="0.5"/>'
    full = parse(LINKS + master + joint(inputs)).joint("j").mimic
    short = parse(LINKS + master + joint('<mimic joint="m"/>')).joint("j").mimic

    assert full == Mimic("m", multiplier=-2.0, offset=0.5)
    assert short == Mimic("m", multiplier=1.0, offset=0.0)


def test_a_plugin_of_gazebo_classic_lets_a_joint_follow_without_a_line_of_no_effect():
    plugin = """<gazebo><plugin name="p" filename="libgazebo_mimic_joint_plugin.so">
      <joint>m</joint><mimicJoint>j</mimicJoint></plugin></gazebo>"""

    master = joint(name="m", parent="b", child="c")
    robot, lines = report_of(LINKS + master + joint() + plugin)

    assert robot.joint("j").mimic == Mimic("m")
    assert [line for line in lines if "no effect" in line] == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "arm.urdf:1: the file is empty"),
        (
            "<robot>\0</robot>",
            "arm.urdf:1: malformed XML: not well-formed (invalid token), inside "
            "<robot> of line 1: '<robot>\\x00</robot>'",
        ),
        (
            "<robot>\n<a>\n</robot>",
            "arm.urdf:3: malformed XML: mismatched tag, inside <a> of line 2: "
            "'</robot>'",
        ),
        (
            '<robot>\n<link name="a">\n<visual/>\n',
            'arm.urdf:4: malformed XML: the file ends inside <link name="a"> of '
            "line 2; is it complete?",
        ),
        (
            "<robot>\n<a b=/>",
            "arm.urdf:2: malformed XML: not well-formed (invalid token), inside "
            "<robot> of line 1: '<a b=/>'",
        ),
        ("<sdf/>", "arm.urdf: the root element is <sdf>; expected <robot>"),
        (
            "<robot/>",
            "arm.urdf: no robot was instantiated: the file has no <link>; a file that "
            "only defines macros needs one that calls them",
        ),
    ],
)
def test_a_text_that_is_no_robot_is_an_error(text, message):
    with pytest.raises(DescriptionError) as caught:
        parse_urdf(text, FILE, PackageFinder(FILE), LoadReport())

    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("<link/>", 'a link has no name; expected <link name="...">'),
        (
            '<link name="a"/><link name="a"/>',
            "two links are called 'a'; names must be unique",
        ),
        (
            f'<link name="a">{"<visual/>" * 1001}</link>',
            "link 'a': 1001 <visual> of one link; expected 1000 at most, for Drake's "
            "time grows with their square: one mesh may hold all",
        ),
        (
            f'<link name="a">{"<collision/>" * 1001}</link>',
            "link 'a': 1001 <collision> of one link; expected 1000 at most, for "
            "Drake's time grows with their square: one mesh may hold all",
        ),
        ('<link name="a"/>' * 3001, "3001 <link>; expected 3000 at most"),
        (
            f'<link name="a">{"<visual/>" * 1000}</link>' * 4,
            "4000 <link/visual>; expected 3000 at most",
        ),
        (
            LINKS + joint(type="revolute") * 1001,
            "1001 joints that move; expected 1000 at most",
        ),
        ("<gazebo/>" * 100_000, "100001 elements; expected 100000 at most"),
        (LINKS + "<joint/>", 'a joint has no name; expected <joint name="...">'),
        (LINKS + joint() * 2, "two joints are called 'j'; names must be unique"),
        (
            LINKS + joint(type="hinge"),
            f"joint 'j': type 'hinge'; expected one of {TYPES}",
        ),
        (LINKS + '<joint name="j"/>', f"joint 'j': type ''; expected one of {TYPES}"),
        (
            LINKS + '<joint name="j" type="fixed"/>',
            "joint 'j': expected <parent link=\"...\">",
        ),
        (
            LINKS + '<joint name="j" type="fixed"><parent link="a"/><child/></joint>',
            "joint 'j': expected <child link=\"...\">",
        ),
        (
            LINKS + joint(parent="aa"),
            "joint 'j': parent link 'aa' doesn't exist; "
            "did you mean 'a'? known: a, b, c",
        ),
        (
            LINKS + joint(child="x"),
            "joint 'j': child link 'x' doesn't exist; known: a, b, c",
        ),
        (
            LINKS + joint() + joint(name="k", parent="c"),
            "joint 'k': joint 'j' holds link 'b' already; "
            "a link is the child of one joint",
        ),
        (
            LINKS + joint(parent="b"),
            "joint 'j': link 'b' hangs on itself; links and joints form a tree",
        ),
        (
            LINKS + joint() + joint(name="k", parent="b", child="a", type="fixed"),
            "joint 'j': link 'b' hangs on itself; links and joints form a tree",
        ),
        (
            LINKS + joint('<mimic joint="j" multiplier="x"/>'),
            "joint 'j': <mimic multiplier>: expected a finite number, got 'x'",
        ),
        (
            LINKS + joint('<mimic joint="j" offset="x"/>'),
            "joint 'j': <mimic offset>: expected a finite number, got 'x'",
        ),
        (
            LINKS + joint(limit='lower="low"'),
            "joint 'j': <limit lower>: expected a number, got 'low'",
        ),
        (
            LINKS + joint(limit='upper="nan"'),
            "joint 'j': <limit upper>: expected a number, got 'nan'",
        ),
        (
            LINKS + joint(limit='effort="1,5"'),
            "joint 'j': <limit effort>: expected a number, got '1,5'",
        ),
        (
            LINKS + joint(limit='velocity=""'),
            "joint 'j': <limit velocity>: expected a number, got ''",
        ),
        (
            LINKS + joint(limit='effort="1_0"'),
            "joint 'j': <limit effort>: expected a number, got '1_0'",
        ),
        (
            LINKS + joint(parent="a", child="world"),
            "joint 'j': the child is 'world', which nothing moves; "
            "it can only be a parent",
        ),
        (
            LINKS
            + joint(name="k", parent="world", child="a")
            + joint(parent="a", child="world", type="fixed"),
            "joint 'j': the child is 'world', which nothing moves; "
            "it can only be a parent",
        ),
        (
            LINKS + joint('<dynamics damping="x"/>'),
            "joint 'j': <dynamics damping>: expected a finite number, got 'x'",
        ),
        (
            LINKS + joint('<dynamics friction="x"/>'),
            "joint 'j': <dynamics friction>: expected a finite number, got 'x'",
        ),
    ],
)
def test_a_malformed_robot_is_one_located_message(body, message):
    with pytest.raises(DescriptionError) as caught:
        parse(body)

    assert str(caught.value) == f"arm.urdf: {message}"


def test_a_joint_may_hang_on_the_world_without_a_link_of_that_name():
    assert read_joint(parent="world").parent == "world"


def test_an_unknown_joint_is_a_key_error():
    with pytest.raises(KeyError):
        parse(LINKS).joint("j")


@pytest.mark.slow
def test_long_chains_of_links_and_mimics_are_no_problem():
    n = 2000
    links = "".join(f'<link name="l{i}"/>' for i in range(n))
    joints = "".join(
        joint(
            f'<mimic joint="j{i - 1}"/>' if 1 < i < 300 else "",
            name=f"j{i}",
            type="revolute" if i < 300 else "fixed",
            parent=f"l{i - 1}",
            child=f"l{i}",
        )
        for i in range(1, n)
    )

    assert len(parse(links + joints).joints) == n - 1


def test_an_external_entity_is_not_read(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("the secret", encoding="utf-8")
    text = (
        f'<!DOCTYPE r [<!ENTITY e SYSTEM "file://{secret}">]>\n'
        '<robot><link name="a">&e;</link></robot>'
    )

    with pytest.raises(DescriptionError) as caught:
        parse_urdf(text, FILE, PackageFinder(FILE), LoadReport())

    assert str(caught.value).startswith(
        "arm.urdf:2: malformed XML: undefined entity &e;: "
    )


@pytest.mark.slow
def test_entities_that_multiply_end_in_an_error_at_once():
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    text = f'<!DOCTYPE r [<!ENTITY e0 "lol">{entities}]><robot>&e11;</robot>'
    start = time.process_time()

    with pytest.raises(DescriptionError) as caught:
        parse_urdf(text, FILE, PackageFinder(FILE), LoadReport())

    assert str(caught.value) == (
        "arm.urdf:1: malformed XML: limit on input amplification factor "
        "(from DTD and entities) breached"
    )
    assert time.process_time() - start < 2.0


def test_links_attached_to_nothing_are_fixed_to_the_world_and_reported():
    report = LoadReport()
    file = Path("a.urdf")
    text = (
        '<robot name="r"><link name="world"/>'
        + LINKS
        + joint(name="j", parent="a", child="b")
        + "</robot>"
    )

    robot = parse_urdf(text, file, PackageFinder(file), report)

    assert robot.roots == ("a", "c")
    assert str(report).splitlines()[-1] == (
        "warning: a.urdf: links ['a', 'c'] are attached to nothing; they are fixed to "
        "the world"
    )


def report_of(body: str) -> tuple[RobotDescription, list[str]]:
    report = LoadReport()
    text = f'<robot name="r">{body}</robot>'
    robot = parse_urdf(text, FILE, PackageFinder(FILE), report)
    return robot, [f"{entry.what}; {entry.done}" for entry in report]


MOVES = "the joint moves on its own"


@pytest.mark.parametrize(
    ("body", "lines"),
    [
        (joint('<mimic joint="j"/>'), [f"mimics itself, through 'j'; {MOVES}"]),
        (
            joint('<mimic joint="k"/>')
            + joint('<mimic joint="j"/>', name="k", parent="b", child="c"),
            [f"mimics itself, through 'k'; {MOVES}"],
        ),
        (
            joint('<mimic joint="i"/>'),
            [f"mimics 'i', which doesn't exist; known: j; {MOVES}"],
        ),
        (
            joint('<mimic joint="k"/>')
            + joint(name="k", type="fixed", parent="b", child="c"),
            [
                "mimics 'k', which is fixed; expected one of revolute, continuous, "
                f"prismatic; {MOVES}"
            ],
        ),
        (
            joint('<mimic joint="k"/>', type="fixed")
            + joint(name="k", parent="b", child="c"),
            ["mimics 'k', but is fixed; it is fixed"],
        ),
    ],
)
def test_a_mimic_joint_that_can_follow_nothing_is_mended(body, lines):
    robot, reported = report_of(LINKS + body)

    assert robot.joint("j").mimic is None
    assert 'name="j"' in robot.urdf
    assert "<mimic" not in robot.urdf.partition('name="k"')[0]
    assert [line for line in reported if "mimics" in line] == lines


@pytest.mark.parametrize("is_reversed", [False, True])
def test_only_the_mimic_that_is_wrong_is_cut_whatever_the_order(is_reversed):
    parts = [
        joint('<mimic joint="nope"/>', name="s", parent="a", child="b"),
        joint('<mimic joint="s"/>', name="s2", parent="b", child="c"),
    ]

    robot, reported = report_of(LINKS + "".join(parts[:: -1 if is_reversed else 1]))

    assert robot.joint("s").mimic is None
    assert robot.joint("s2").mimic == Mimic("s")
    assert [line.partition("; ")[0] for line in reported if "mimics" in line] == [
        "mimics 'nope', which doesn't exist"
    ]


def test_a_joint_that_follows_a_circle_still_follows_where_that_is_cut():
    links = LINKS + '<link name="d"/>'
    robot, reported = report_of(
        links
        + joint('<mimic joint="k"/>', name="j", parent="a", child="b")
        + joint('<mimic joint="i"/>', name="k", parent="b", child="c")
        + joint('<mimic joint="k"/>', name="i", parent="c", child="d")
    )

    masters = [j.mimic and j.mimic.joint for j in robot.joints]
    assert masters == ["k", None, "k"]
    assert [line for line in reported if "mimics" in line] == [
        f"mimics itself, through 'i'; {MOVES}"
    ]


def test_a_floating_joint_that_mimics_moves_on_its_own():
    body = joint('<mimic joint="k"/>', type="floating")

    _, reported = report_of(LINKS + body + joint(name="k", parent="b", child="c"))

    assert f"mimics 'k', but is floating; {MOVES}" in reported


@pytest.mark.parametrize("tag", ["gazebo", "gazebo><plugin", "x", "link"])
def test_elements_nested_without_end_are_one_message(tag):
    inner = "<a>" * 3000 + "</a>" * 3000
    name, _, child = tag.partition("><")
    if child:
        inner = f"<{child}>{inner}</{child}>"

    with pytest.raises(DescriptionError) as caught:
        parse(f'<link name="a"/><{name}>{inner}</{name}>')

    assert str(caught.value) == (
        "arm.urdf: elements are nested more than 200 deep; no URDF needs that"
    )


def test_elements_may_be_nested_as_deep_as_is_said():
    # <robot> and <gazebo> are two of the 200.
    inner = "<a>" * 198 + "</a>" * 198

    assert parse(f'<link name="a"/><gazebo>{inner}</gazebo>').links == ("a",)


def test_a_description_is_short_in_notebooks():
    robot = parse(LINKS + joint())

    assert repr(robot) == "<RobotDescription 'hand', 3 links, joints ['j']>"


def test_limits_the_wrong_way_round_are_swapped():
    robot, reported = report_of(LINKS + joint(limit='lower="2" upper="1"'))

    limits = robot.joint("j").limits
    assert (limits.lower, limits.upper) == (1.0, 2.0)
    assert '<limit lower="1.0" upper="2.0"' in robot.urdf
    assert "the lower limit 2.0 is above the upper one, 1.0; swapped" in reported


@pytest.mark.parametrize(
    ("joint_type", "limit", "lines"),
    [
        (
            "revolute",
            '<limit lower="1" upper="2"/>',
            [
                "<limit> without 'effort', which ROS takes in no joint; taken as unset",
                "<limit> without 'velocity', which ROS takes in no joint; "
                "taken as unset",
            ],
        ),
        (
            "prismatic",
            "",
            [
                "no <limit>, without which ROS takes no prismatic joint; "
                "it moves without limits"
            ],
        ),
        (
            "revolute",
            '<limit effort="1" velocity="1"/>',
            ["<limit> without 'lower' and 'upper'; both are 0, as in ROS"],
        ),
        ("prismatic", '<limit upper="1" effort="1" velocity="1"/>', []),
        ("continuous", "", []),
        ("fixed", "", []),
    ],
)
def test_a_limit_that_ros_asks_for_is_missed(joint_type, limit, lines):
    text = joint(type=joint_type).replace("<limit />", limit)

    _, reported = report_of(LINKS + text)

    assert [line for line in reported if "ROS" in line] == lines


@pytest.mark.parametrize("name", ["damping", "friction"])
def test_a_negative_damping_or_friction_counts_as_none(name):
    body = f'<dynamics {name}="-1"/>'

    robot, reported = report_of(LINKS + joint(body))

    assert getattr(robot.joint("j"), name) == 0.0
    assert 'damping="-1"' not in robot.urdf
    assert f"{name} -1 is negative; taken as 0" in reported


@pytest.mark.parametrize("joint_type", ["floating", "planar"])
def test_joints_of_several_degrees_of_freedom_are_no_movable_joints(joint_type):
    robot, reported = report_of(LINKS + joint(type=joint_type))

    assert robot.joint("j").type == joint_type
    assert robot.movable_joints == ()
    assert f"the joint is {joint_type}; it moves freely, no controller moves it" in (
        reported
    )


@pytest.mark.parametrize(
    ("limit", "lines"),
    [
        (
            'lower="-90" upper="90" velocity="180"',
            [
                "limits -90 to 90 rad are 14 turns each way; in degrees? URDF has "
                "radians: -1.5708 to 1.5708",
                "velocity limit 180 rad/s is 29 turns a second; in degrees? URDF has "
                "radians: 3.1416",
            ],
        ),
        (
            'lower="0" upper="45"',
            [
                "limits 0 to 45 rad are 7 turns; in degrees? URDF has radians: "
                "0 to 0.7854"
            ],
        ),
        # Two turns, no limits, any speed, and what no degrees are.
        ('lower="-12" upper="12" velocity="100"', []),
        ('lower="-1e9" upper="1e9" velocity="1000"', []),
        ('lower="-12.57" upper="12.57" velocity="62.8"', []),
    ],
)
def test_limits_in_degrees_are_noticed_and_kept(limit, lines):
    report = LoadReport()
    text = f'<robot name="hand">{LINKS}{joint(limit=limit)}</robot>'

    robot = parse_urdf(text, FILE, PackageFinder(FILE), report)
    parse_urdf(text.replace("revolute", "prismatic"), FILE, PackageFinder(FILE), report)

    found = [entry.what for entry in report if entry.kind == "invalid"]
    assert found == lines
    assert robot.joint("j").limits.upper == float(limit.split('"')[3])
