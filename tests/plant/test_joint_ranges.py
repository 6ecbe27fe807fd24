"""Ranges of sliders, random poses, and poses that are completed."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import arm_drake as ad
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError
from arm_drake.plant.joint_ranges import (
    JointRange,
    center,
    complete,
    joint_ranges,
    randomize,
)
from tests.models import bob, joint, load
from tests.robots import load_real_robot, robot_names

PI = math.pi
WHEEL = JointRange("wheel", "rad", -PI, PI, wraps=True)


def description(tmp_path, *joints: str) -> RobotDescription:
    """Return a robot with these joints between a base and bobs."""
    links = "".join(bob(f"link{i}") for i in range(len(joints)))
    urdf = f'<robot name="r"><link name="base"/>{links}{"".join(joints)}</robot>'
    return load(tmp_path, urdf).description


def one(tmp_path, limit: str, type: str = "revolute", inside: str = "") -> JointRange:
    """Return the range of a joint with this `<limit>`, the only one."""
    text = joint("j", "base", "link0", type=type, limit=limit, inside=inside)
    (found,) = joint_ranges(description(tmp_path, text))
    return found


def mimic(name: str, other: str, multiplier: float, offset: float, child: str) -> str:
    tag = f'<mimic joint="{other}" multiplier="{multiplier}" offset="{offset}"/>'
    return joint(name, "base", child, limit='lower="-1" upper="1"', inside=tag)


@pytest.fixture
def geared(tmp_path) -> RobotDescription:
    """Return a robot whose joint "last" follows "middle", which follows "first"."""
    return description(
        tmp_path,
        mimic("last", "middle", -3, 0.25, "link0"),
        joint("first", "base", "link1", limit='lower="0.5" upper="2"'),
        mimic("middle", "first", 2, 0.1, "link2"),
        joint("wheel", "base", "link3", type="continuous"),
    )


def test_ranges_are_in_the_order_of_the_description(geared):
    ranges = joint_ranges(geared)

    assert ranges == (
        JointRange("last", "rad", -12.05, 1.0, follows="middle"),
        JointRange("first", "rad", 0.5, 2.0),
        JointRange("middle", "rad", -1.0, 4.1, follows="first"),
        WHEEL,
    )


def test_joints_with_several_degrees_of_freedom_have_no_range(tmp_path):
    robot = description(
        tmp_path,
        joint("loose", "base", "link0", type="floating"),
        joint("j", "base", "link1"),
        joint("table", "base", "link2", type="planar"),
        joint("stiff", "base", "link3", type="fixed"),
    )

    assert [r.name for r in joint_ranges(robot)] == ["j"]


@pytest.mark.parametrize(
    ("limit", "type", "expected"),
    [
        ('lower="-0.5" upper="2"', "revolute", ("rad", -0.5, 2.0)),
        ('lower="0.1" upper="0.3"', "prismatic", ("m", 0.1, 0.3)),
        # A joint that can't move.
        ('effort="1" velocity="1"', "revolute", ("rad", 0.0, 0.0)),
        # As good as none.
        ('lower="-inf" upper="inf"', "revolute", ("rad", -PI, PI)),
        ('lower="-1e16" upper="1e16"', "revolute", ("rad", -PI, PI)),
        ('lower="-1e12" upper="1e12"', "prismatic", ("m", -1.0, 1.0)),
        # One of two, and a range as wide.
        ('lower="0.5" upper="inf"', "revolute", ("rad", 0.5, 0.5 + 2.0 * PI)),
        ('lower="-1e9" upper="0.5"', "prismatic", ("m", -1.5, 0.5)),
        # A continuous joint has limits of effort and speed alone.
        ('lower="-0.5" upper="2"', "continuous", ("rad", -PI, PI)),
    ],
)
def test_limits_give_the_range(tmp_path, limit, type, expected):
    found = one(tmp_path, limit, type)

    assert (found.unit, found.lower, found.upper) == expected
    assert found.wraps == (type == "continuous")


def test_a_joint_without_a_limit_tag_goes_from_minus_pi_to_pi(tmp_path):
    text = joint("j", "base", "link0").replace("<limit", "<nothing")

    (found,) = joint_ranges(description(tmp_path, text))

    assert (found.lower, found.upper) == (-PI, PI)


@pytest.mark.parametrize(
    ("soft", "expected"),
    [
        ('soft_lower_limit="-0.9" soft_upper_limit="1.5"', (-0.9, 1.5)),
        ('soft_lower_limit="-9" soft_upper_limit="1.5"', (-1.0, 1.5)),
        # urdfdom reads an attribute that is missing as 0, and both as no limits.
        ('soft_upper_limit="1.5"', (0.0, 1.5)),
        ("", (-1.0, 2.0)),
        # They have nothing in common with the hard ones.
        ('soft_lower_limit="3" soft_upper_limit="4"', (-1.0, 2.0)),
    ],
)
def test_soft_limits_narrow_the_range(tmp_path, soft, expected):
    tag = f'<safety_controller {soft} k_position="1" k_velocity="1"/>'

    found = one(tmp_path, 'lower="-1" upper="2"', inside=tag)

    assert (found.lower, found.upper) == expected


def test_soft_limits_stand_in_for_missing_ones_and_leave_wheels_alone(tmp_path):
    tag = '<safety_controller soft_lower_limit="-4" soft_upper_limit="5"/>'

    endless = one(tmp_path, 'lower="-inf" upper="inf"', inside=tag)
    wheel = one(tmp_path, 'velocity="1"', "continuous", inside=tag)

    assert (endless.lower, endless.upper) == (-4.0, 5.0)
    assert (wheel.lower, wheel.upper) == (-PI, PI)


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ((-1.0, 3.0), 0.0),
        ((0.0, 3.0), 0.0),
        ((-3.0, 0.0), 0.0),
        ((1.0, 3.0), 2.0),
        ((-3.0, -2.0), -2.5),
        ((0.5, 0.5), 0.5),
    ],
)
def test_the_center_is_zero_if_that_is_inside_else_the_middle(ends, expected):
    assert center([JointRange("j", "rad", *ends)]) == {"j": expected}


def test_joints_that_follow_are_not_centered_nor_randomized(geared):
    ranges = joint_ranges(geared)

    assert center(ranges) == {"first": 1.25, "wheel": 0.0}
    assert randomize(ranges, np.random.default_rng(0)).keys() == {"first", "wheel"}


def test_random_positions_are_uniform_in_the_range():
    ranges = [JointRange("a", "rad", -0.25, 1.75), JointRange("b", "m", 0.5, 0.5)]
    rng = np.random.default_rng(1)

    drawn = [randomize(ranges, rng) for _ in range(4000)]

    assert {pose["b"] for pose in drawn} == {0.5}
    a = np.array([pose["a"] for pose in drawn])
    assert ((a >= -0.25) & (a <= 1.75)).all()
    # A uniform distribution of width 2: the mean of 4000 is off by 3.9 standard errors
    # once in 10,000 seeds, and the largest gap at an end is beyond 0.01 in one of 1e8.
    assert a.mean() == pytest.approx(0.75, abs=3.9 * 2.0 / math.sqrt(12 * 4000))
    assert a.min() < -0.24
    assert a.max() > 1.74


def test_the_same_seed_gives_the_same_pose(geared):
    ranges = joint_ranges(geared)

    one, two, other = (
        randomize(ranges, np.random.default_rng(seed)) for seed in (3, 3, 4)
    )

    assert one == two
    assert one != other


def test_joints_that_follow_go_along_the_chain_beyond_their_own_limits(geared):
    positions = complete(geared, {"first": 1.5, "wheel": 0.2})

    # middle = 2 first + 0.1, last = -3 middle + 0.25; their limits are -1 and 1.
    assert list(positions) == ["last", "first", "middle", "wheel"]
    assert positions == pytest.approx(
        {"last": -9.05, "first": 1.5, "middle": 3.1, "wheel": 0.2}, abs=1e-12
    )


def test_positions_are_clamped_and_joints_left_out_are_at_their_centers(geared):
    assert complete(geared, {"first": 7.0})["first"] == 2.0
    assert complete(geared, {"first": -7.0})["first"] == 0.5
    assert complete(geared, {}) == pytest.approx(
        {"last": -7.55, "first": 1.25, "middle": 2.6, "wheel": 0.0}, abs=1e-12
    )


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (PI, PI),
        (-PI, PI),
        (4.0, 4.0 - 2.0 * PI),
        (-4.0, 2.0 * PI - 4.0),
        (-0.5, -0.5),
        (1000.0 * PI + 0.5, 0.5),
    ],
)
def test_a_joint_that_turns_without_end_is_turned_back(geared, angle, expected):
    found = complete(geared, {"wheel": angle})["wheel"]

    # 1000 pi is rounded by up to 2.3e-13.
    assert found == pytest.approx(expected, abs=5e-13)


@settings(deadline=None)
@given(st.floats(-1e6, 1e6))
def test_turning_back_keeps_the_direction(angle):
    fitted = WHEEL.fit(angle)

    assert -PI < fitted <= PI
    # The double nearest to 2 pi is off by 2.4e-16, times 1.6e5 turns, and 1e6 itself is
    # known to 6e-11.
    assert math.cos(fitted - angle) == pytest.approx(1.0, abs=1e-12)
    assert math.sin(fitted - angle) == pytest.approx(0.0, abs=2e-10)


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ({"fist": 1.0}, "no joint 'fist'; did you mean 'first'? known: first, wheel"),
        ({"middle": 1.0}, "'middle' follows 'first'; give that one"),
        (
            {"first": math.nan},
            "joint 'first': expected a finite number, got nan",
        ),
    ],
)
def test_bad_positions_are_explained(geared, positions, message):
    with pytest.raises(InputError) as caught:
        complete(geared, positions)

    assert str(caught.value) == message


@pytest.fixture(scope="module", params=robot_names())
def robot(request) -> ad.Robot:
    return load_real_robot(request.param)


@pytest.mark.slow
def test_real_robots_are_centered_and_randomized_within_their_limits(robot):
    ranges = joint_ranges(robot.description)
    rng = np.random.default_rng(0)
    poses = [center(ranges), *(randomize(ranges, rng) for _ in range(20))]

    assert [r.name for r in ranges] == [
        j.name for j in robot.description.movable_joints
    ]
    limits = {j.name: j.limits for j in robot.description.movable_joints}
    for pose in poses:
        full = complete(robot.description, pose)
        assert list(full) == [r.name for r in ranges]
        for name, position in pose.items():
            # What it was given is within the range, and stays as it is.
            assert full[name] == position
            if limits[name].lower is not None:
                assert limits[name].lower <= position <= limits[name].upper


@pytest.mark.slow
def test_real_robots_start_where_their_completed_pose_is(robot):
    own = [r.name for r in joint_ranges(robot.description) if r.follows is None]
    inputs = {name: robot.initial_positions[name] for name in own}

    assert complete(robot.description, inputs) == robot.initial_positions
