"""A pose as YAML and as words of a command line, there and back."""

import math
import shlex
from types import SimpleNamespace

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_drake import yaml_files
from arm_drake.commands.view import read_positions
from arm_drake.errors import InputError
from arm_drake.plant.joint_ranges import JointRange
from arm_drake.visualization.page.panel import pose_words, pose_yaml

AWKWARD = [
    *("yes", "No", "on", "y", "null", "~", "", "1e3", "1.5", "0x1F", "0o7", "1:30"),
    *("a: b", "a #b", "- a", "? a", "[a]", "{a}", "&a", "*a", "!a", "|", ">", "%a"),
    *("2026-01-31", ".inf", "<<", "=", "'a'", '"a"', "a\\b", " a ", "a\nb", "\u2028"),
    *("é", "関節", "\U0001f9be", "\ufeffa", "@a", "`a", "a,b", "---", "...", "a/b-c.d"),
]
NAMES = st.sampled_from(AWKWARD) | st.text(
    st.characters(exclude_categories=["Cs"]), max_size=200
)
POSITIONS = st.floats(-1e6, 1e6)
POSES = st.dictionaries(NAMES, POSITIONS, max_size=8)


def ranges_of(pose: dict[str, float], end: float = math.inf) -> list[JointRange]:
    return [JointRange(name, "rad", -end, end) for name in pose]


def text_of(position: float, lower: float = -4.0, upper: float = 4.0) -> str:
    """Return the number of a pose of one joint."""
    text = pose_yaml({"j": position}, [JointRange("j", "rad", lower, upper)])
    return text.removeprefix("j: ").removesuffix("\n")


def rounded(pose: dict[str, float]) -> dict[str, float]:
    return {name: float(f"{value:.5e}") for name, value in pose.items()}


@pytest.mark.slow
@settings(deadline=None)
@given(POSES)
def test_yaml_gives_back_names_and_numbers_of_six_digits(pose):
    found = yaml.safe_load(pose_yaml(pose, ranges_of(pose))) or {}

    assert found == rounded(pose)
    assert list(found) == list(pose)
    assert {type(value) for value in found.values()} <= {float}


@pytest.mark.slow
@settings(deadline=None)
@given(POSES)
def test_ros_reads_the_same_yaml(pose):
    # Where 1e3 is a number and "yes" a bool, in keys too.
    found = yaml_files.parse(pose_yaml(pose, ranges_of(pose))) or {}

    assert found == rounded(pose)
    assert {type(name) for name in found} <= {str}


@pytest.mark.slow
@settings(deadline=None)
@given(
    # A joint's name is what stands before the first "="; one that starts with a dash is
    # an option.
    st.dictionaries(
        NAMES.filter(lambda name: name and "=" not in name and name[0] != "-"),
        POSITIONS,
        min_size=1,
        max_size=8,
    )
)
def test_a_shell_and_the_command_line_give_back_the_words(pose):
    option, *words = shlex.split(pose_words(pose, ranges_of(pose)))

    joints = [SimpleNamespace(name=name, mimic=None) for name in pose]
    description = SimpleNamespace(movable_joints=joints)
    assert option == "--position"
    assert read_positions(words, description) == rounded(pose)


def test_usual_poses_are_short():
    pose = {
        "shoulder_pan_joint": 0.5,
        "tool0/wrist-3": -1.2000000001,
        "yes": -0.0,
        "naïf": 1.0,
    }

    assert pose_yaml(pose, ranges_of(pose)) == (
        'shoulder_pan_joint: 0.5\ntool0/wrist-3: -1.2\n"yes": 0.0\n"naïf": 1.0\n'
    )
    assert pose_words(pose, ranges_of(pose)) == (
        "--position shoulder_pan_joint=0.5 tool0/wrist-3=-1.2 yes=0.0 'naïf=1.0'"
    )


def test_words_are_quoted_for_a_shell():
    pose = {"a b": 1.0, "$HOME": 2.0}

    assert pose_words(pose, ranges_of(pose)) == "--position 'a b=1.0' '$HOME=2.0'"


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        (0.0, "0.0"),
        (-0.0, "0.0"),
        (1.0, "1.0"),
        (1.0 / 3.0, "0.333333"),
        (-math.pi / 2.0, "-1.5708"),
        # YAML 1.1 needs the point and the sign.
        (1e-5, "1.0e-05"),
        (-1.25e-7, "-1.25e-07"),
        (0.1 + 0.2, "0.3"),
    ],
)
def test_numbers_have_six_digits(position, expected):
    assert text_of(position) == expected


@pytest.mark.parametrize(
    ("limit", "expected"),
    # Six digits would be 2.0944 and 0.628319; both are beyond the limit.
    [(2.0943951, "2.094395"), (0.62831853, "0.6283185"), (math.pi, "3.14159")],
)
def test_a_joint_at_its_limit_stays_within(limit, expected):
    assert text_of(limit, -1.0, limit) == expected
    assert text_of(-limit, -limit, 1.0) == f"-{expected}"


@settings(deadline=None)
@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(0.0, 1.0))
def test_what_is_within_the_range_is_within_it_as_text(one, two, share):
    lower, upper = sorted((one, two))
    position = min(max(lower + share * (upper - lower), lower), upper)

    assert lower <= float(text_of(position, lower, upper)) <= upper


def test_a_position_beyond_the_range_is_shown_as_it_is():
    assert text_of(7.0000001) == "7.0"


def test_joints_that_follow_are_left_out_and_the_ranges_give_the_order():
    ranges = [
        JointRange("b", "rad", -1.0, 1.0),
        JointRange("c", "rad", -1.0, 1.0, follows="b"),
        JointRange("a", "m", -1.0, 1.0),
    ]
    pose = {"a": 0.25, "b": 0.5, "c": 0.75, "other": 1.0}

    assert pose_yaml(pose, ranges) == "b: 0.5\na: 0.25\n"
    assert pose_words(pose, ranges) == "--position b=0.5 a=0.25"


def test_a_robot_without_joints_has_no_pose():
    assert pose_yaml({}, []) == ""
    assert pose_words({}, []) == ""


@pytest.mark.parametrize("pose", [{}, {"j": math.nan}, {"j": math.inf}])
@pytest.mark.parametrize("write", [pose_yaml, pose_words])
def test_a_position_that_is_no_number_is_an_error(write, pose):
    with pytest.raises(InputError) as caught:
        write(pose, [JointRange("j", "rad", -1.0, 1.0)])

    found = pose.get("j")
    assert str(caught.value) == f"joint 'j': expected a finite position, got {found!r}"
