"""Mimic joints, by the URDF and by `<ros2_control>`."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.gazebo import add_mimics, read_gazebo_plugins
from arm_drake.description.joints import JointInfo, Mimic, find_mimics, write_joint
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
)

POSITION = (InterfaceInfo("position"),)
PLACE = "arm.urdf: ros2_control 'h', joint 'j'"


def joint(name: str, mimic: Mimic | None = None, type: str = "revolute") -> JointInfo:
    return JointInfo(name, type, "a", "b", mimic=mimic)


def follower(
    is_mimic: bool | None = None, commands=(), name: str = "j", **parameters: str
) -> ComponentInfo:
    return ComponentInfo(name, commands, POSITION, parameters, is_mimic)


def find(
    component: ComponentInfo,
    mimic: Mimic | None = None,
    others: tuple[JointInfo, ...] = (joint("m"),),
    *,
    has_master: bool = True,
) -> tuple[Mimic | None, list[str]]:
    """Return the relation of joint j, and the report."""
    masters = (ComponentInfo("m", POSITION, POSITION),) if has_master else ()
    block = HardwareInfo("h", "system", "", joints=(*masters, component))
    report = LoadReport()
    joints = find_mimics(
        (*others, joint("j", mimic)), [block], report, Path("arm.urdf")
    )
    lines = [str(entry) for entry in report]
    assert joints[:-1] == others
    return joints[-1].mimic, lines


def follow(plugin: str, mimic: Mimic | None = None) -> tuple[Mimic | None, list[str]]:
    """Return the relation of joint j, which a plugin of Gazebo Classic names."""
    text = f"<robot><gazebo>{plugin}</gazebo></robot>"
    plugins = read_gazebo_plugins(ET.XML(text))
    report = LoadReport()
    joints = add_mimics(
        [joint("m"), joint("j", mimic)], plugins, report, Path("arm.urdf")
    )
    return joints[-1].mimic, [str(entry) for entry in report]


# Plugins of Gazebo Classic


@pytest.mark.parametrize(
    "library",
    [
        "libgazebo_mimic_joint_plugin.so",
        "libroboticsgroup_gazebo_mimic_joint_plugin.so",
        "libroboticsgroup_upatras_gazebo_mimic_joint_plugin.so",
        "libgazebo_ros2_mimic_joint_plugin.so",
    ],
)
def test_a_joint_follows_where_a_plugin_alone_says_so(library):
    plugin = f"""<plugin name="p" filename="{library}"><joint>m</joint>
      <mimicJoint>j</mimicJoint><multiplier>-2</multiplier><offset>0.5</offset>
      <maxEffort>1</maxEffort></plugin>"""

    assert follow(plugin) == (
        Mimic("m", -2.0, 0.5),
        [
            "info: arm.urdf: Gazebo plugin 'p', joint 'j': lets it follow 'm'; the "
            "URDF doesn't; taken as its <mimic>"
        ],
    )


PLUGIN = """<plugin name="p" filename="libgazebo_mimic_joint_plugin.so">
  <joint>m</joint><mimicJoint>{}</mimicJoint></plugin>"""


def test_a_plugin_may_say_what_the_urdf_says():
    assert follow(PLUGIN.format("j"), Mimic("m")) == (Mimic("m"), [])


def test_the_urdf_counts_before_a_plugin():
    assert follow(PLUGIN.format("j"), Mimic("m", -1.0)) == (
        Mimic("m", -1.0),
        [
            "warning: arm.urdf: Gazebo plugin 'p': j = 1 m + 0, in the URDF -1 m + 0; "
            "the URDF counts"
        ],
    )


def test_of_two_plugins_the_first_counts():
    second = PLUGIN.format("j").replace("<joint>", "<offset>1</offset><joint>")

    mimic, (_, line) = follow(PLUGIN.format("j") + second)

    assert mimic == Mimic("m")
    assert line == (
        "warning: arm.urdf: Gazebo plugin 'p': j = 1 m + 1, in a plugin before it "
        "1 m + 0; a plugin before it counts"
    )


def test_a_plugin_of_a_joint_that_isnt_there_is_left_out():
    assert follow(PLUGIN.format("jj")) == (
        None,
        [
            "warning: arm.urdf: Gazebo plugin 'p': <mimicJoint> 'jj', which doesn't "
            "exist; did you mean 'j'? known: j, m; the plugin is left out"
        ],
    )


# The URDF's form


@pytest.mark.parametrize("is_mimic", [None, True])
def test_a_joint_follows_as_the_urdf_says(is_mimic):
    mimic = Mimic("m", 2.0, 0.5)

    assert find(follower(is_mimic), mimic) == (mimic, [])


def test_a_joint_that_the_block_calls_independent_is():
    assert find(follower(False, POSITION), Mimic("m")) == (None, [])


def test_commands_of_a_mimic_joint_are_reported():
    mimic, lines = find(follower(commands=POSITION), Mimic("m"))

    assert mimic == Mimic("m")
    assert lines == [
        f"warning: {PLACE}: command interfaces ['position'] of a mimic joint; "
        "what they get has no effect; it follows 'm'"
    ]


def test_a_joint_cant_follow_without_a_master():
    mimic, lines = find(follower(True, POSITION))

    assert mimic is None
    assert lines == [
        f'error: {PLACE}: mimic="true", but the URDF\'s joint has no <mimic>; '
        "it moves on its own"
    ]


def test_a_master_belongs_into_the_same_block():
    mimic, lines = find(follower(), Mimic("m"), has_master=False)

    assert mimic == Mimic("m")
    assert lines == [
        f"warning: {PLACE}: the block lacks 'm', which the joint mimics; "
        "it follows all the same"
    ]


def test_a_joint_without_hardware_follows_as_the_urdf_says():
    joints = (joint("m"), joint("j", Mimic("m", -1.0)))

    assert find_mimics(joints, [], LoadReport(), Path("x")) == joints


def test_a_joint_of_two_blocks_follows_if_one_says_so():
    blocks = [
        HardwareInfo(name, "system", "", joints=(component, follower(name="m")))
        for name, component in (
            ("a", follower(mimic="m")),
            ("b", follower(commands=POSITION)),
        )
    ]

    joints = find_mimics((joint("m"), joint("j")), blocks, LoadReport(), Path("x"))

    assert joints[1].mimic == Mimic("m")


def test_a_joint_that_the_robot_lacks_is_no_matter():
    block = HardwareInfo("h", "system", "", joints=(follower(name="speed_scaling"),))
    joints = (joint("m"),)

    assert find_mimics(joints, [block], LoadReport(), Path("x")) == joints


# The form up to Humble


def test_the_old_form_counts_where_the_urdf_says_nothing():
    mimic, lines = find(follower(commands=POSITION, mimic="m", multiplier="-0.5"))

    assert mimic == Mimic("m", multiplier=-0.5, offset=0.0)
    assert lines == [
        f"info: {PLACE}: <param> 'mimic', which is the form up to Humble, "
        "names 'm'; taken as the URDF's <mimic>",
        f"warning: {PLACE}: command interfaces ['position'] of a mimic joint; "
        "what they get has no effect; it follows 'm'",
    ]


def test_a_multiplier_is_1_where_none_is_given():
    mimic, _ = find(follower(mimic="m"))

    assert mimic == Mimic("m", 1.0)


def test_a_multiplier_that_is_no_number_is_reported():
    mimic, lines = find(follower(mimic="m", multiplier="twice"))

    assert mimic == Mimic("m", 1.0)
    assert lines[0] == (
        f"warning: {PLACE}: multiplier: expected a number, got 'twice'; "
        "taken as not given"
    )


@pytest.mark.parametrize(
    ("master", "others", "problem"),
    [
        ("n", (joint("m"),), "mimics 'n', which doesn't exist; known: j, m"),
        (
            "m",
            (joint("m", type="floating"),),
            "mimics 'm', which is floating; "
            "expected one of revolute, continuous, prismatic",
        ),
        ("j", (joint("m"),), "mimics itself, through 'j'"),
        ("m", (joint("m", Mimic("j")),), "mimics itself, through 'm'"),
    ],
)
def test_an_impossible_relation_in_the_old_form_is_left_out(master, others, problem):
    mimic, lines = find(follower(commands=POSITION, mimic=master), None, others)

    assert mimic is None
    assert lines[-1] == f"error: {PLACE}: {problem}; it moves on its own"


@pytest.mark.parametrize(
    ("type", "done"),
    [
        ("floating", "it moves on its own"),
        ("planar", "it moves on its own"),
        ("fixed", "it is fixed"),
    ],
)
def test_only_a_joint_of_one_degree_of_freedom_follows_in_the_old_form(type, done):
    block = HardwareInfo("h", "system", "", joints=(follower(mimic="m"),))
    joints = (joint("m"), joint("j", type=type))
    report = LoadReport()

    assert find_mimics(joints, [block], report, Path("arm.urdf")) == joints
    assert [str(entry) for entry in report] == [
        f"error: {PLACE}: mimics 'm', but is {type}; {done}"
    ]


def test_the_urdf_counts_before_the_old_form():
    mimic, lines = find(follower(mimic="m", multiplier="2"), Mimic("m", -1.0))

    assert mimic == Mimic("m", -1.0)
    assert lines == [
        f"warning: {PLACE}: <param> 'mimic' says 2.0 * 'm', "
        "the URDF's <mimic> -1.0 * 'm'; the URDF counts"
    ]


def test_both_forms_may_say_the_same():
    mimic = Mimic("m", 2.0)

    assert find(follower(mimic="m", multiplier="2"), mimic) == (mimic, [])


def test_an_independent_joint_has_no_master_in_the_old_form():
    mimic, lines = find(follower(False, mimic="m"))

    assert mimic is None
    assert lines == [
        f"warning: {PLACE}: mimic=\"false\", but <param> 'mimic' is 'm'; "
        "it moves on its own"
    ]


def test_a_master_that_the_block_frees_may_follow_its_former_follower():
    blocks = [
        HardwareInfo(
            "h", "system", "", joints=(follower(mimic="m"), follower(False, name="m"))
        )
    ]
    joints = (joint("j"), joint("m", Mimic("j")))
    report = LoadReport()

    found = find_mimics(joints, blocks, report, Path("x"))

    assert [j.mimic for j in found] == [Mimic("m"), None]
    assert not report.errors


# Back into the URDF


def test_the_urdf_gets_the_relations_that_hold():
    joints = joint("j"), joint("m"), joint("f", Mimic("m", -1.0, 0.25))

    elements = [ET.XML(write_joint(each)) for each in joints]

    found = {e.get("name"): [m.attrib for m in e.iter("mimic")] for e in elements}
    assert found == {
        "j": [],
        "m": [],
        "f": [{"joint": "m", "multiplier": "-1.0", "offset": "0.25"}],
    }
