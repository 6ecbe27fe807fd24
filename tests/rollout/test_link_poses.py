"""Poses of a rollout's links: against closed forms and Drake's own kinematics."""

import itertools

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.rollout.rollout import Rollout
from tests.made_rollouts import make_described

# Sums of a few rounded products of numbers near 1.
ROUNDING = 1e-12

# A crane: it turns about z, 1 m up, and lets its hook down from a boom of 2 m.
CRANE = """<robot name="crane">
  <link name="base"/><link name="boom"/><link name="hook"/><link name="tool0"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="boom"/>
    <origin xyz="0 0 1"/><axis xyz="0 0 1"/></joint>
  <joint name="lower" type="prismatic"><parent link="boom"/><child link="hook"/>
    <origin xyz="2 0 0"/><axis xyz="0 0 -1"/></joint>
  <joint name="mount" type="fixed"><parent link="hook"/><child link="tool0"/>
    <origin xyz="0 0.5 0"/></joint>
</robot>"""


def make_crane(description: str = CRANE, **changes) -> Rollout:
    return make_described(
        description,
        {"turn": "continuous", "lower": "prismatic"},
        np.array([[0.0, 0.0], [np.pi / 2, 0.25]]),
        **changes,
    )


def test_a_link_is_where_its_joints_put_it():
    poses = make_crane().link_poses("tool0")

    # Turned to the left, the boom points along y, and the tool's offset along -x.
    np.testing.assert_allclose(
        poses[:, :3], [[2.0, 0.5, 1.0], [-0.5, 2.0, 0.75]], atol=ROUNDING
    )
    half = np.pi / 4
    np.testing.assert_allclose(
        poses[:, 3:], [[1, 0, 0, 0], [np.cos(half), 0, 0, np.sin(half)]], atol=ROUNDING
    )


def test_a_robot_stands_where_it_was_put():
    pose = [1.0, 2.0, 0.0, 0.0, 0.0, np.pi / 2]

    poses = make_crane(info={"robot": {"pose": pose}}).link_poses("boom")

    np.testing.assert_allclose(poses[0, :3], [1.0, 2.0, 1.0], atol=ROUNDING)
    np.testing.assert_allclose(poses[0, 3:], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


def test_a_free_base_carries_its_links_and_stays_as_recorded():
    base = np.array([[3.0, 0, 0, 1, 0, 0, 0], [4.0, 0, 0, 0, 0, 0, 1]])
    rollout = make_crane(free_poses={"base": base})

    poses = rollout.link_poses("boom")
    rollout.link_poses("base")[:] = 0.0

    np.testing.assert_allclose(poses[:, :3], [[3, 0, 1], [4, 0, 1]], atol=ROUNDING)
    assert rollout.free_poses["base"][1, 0] == 4.0


def test_drake_has_the_links_of_a_bundled_robot_in_the_same_places():
    pose = (0.1, -0.2, 0.3, 0.2, -0.1, 0.4)
    start = {f"joint{k}": 0.3 * k - 0.8 for k in range(1, 7)}
    robot = ad.load_robot("doosan_a0912", pose=pose, initial_positions=start)
    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.run(0.05)
    wanted = simulation.link_poses()
    # Rows are before their tick; with what is measured now, the present is the last.
    rollout = simulation.rollout()
    now = simulation.joint_states()
    rollout.position[-1] = [
        now.position[now.name.index(j)] for j in rollout.joint_names
    ]

    for link in ("link1", "link4", "link6"):
        found = rollout.link_poses(link)[-1]
        np.testing.assert_allclose(found[:3], wanted[link].translation(), atol=1e-9)
        quaternion = wanted[link].rotation().ToQuaternion().wxyz()
        # Both signs are the same rotation.
        assert abs(found[3:] @ quaternion) == pytest.approx(1.0, abs=1e-9)


def test_without_a_description_it_is_said_what_keeps_one():
    with pytest.raises(InputError) as error:
        make_crane(description="").link_poses("boom")

    assert str(error.value) == (
        "the rollout has no description of its robot, so where links were is unknown; "
        ".npz and .mcap files keep it, .csv files don't"
    )


def test_an_unknown_link_is_said_with_those_that_exist():
    with pytest.raises(InputError) as error:
        make_crane().link_poses("hok")

    assert str(error.value) == (
        "no link 'hok' in the description; did you mean 'hook'? known: base, boom, "
        "hook, tool0"
    )


def test_what_is_not_recorded_is_not_made_up():
    planar = CRANE.replace('name="turn" type="continuous"', 'name="turn" type="planar"')

    with pytest.raises(InputError) as error:
        make_crane(description=planar).link_poses("tool0")

    assert str(error.value) == (
        "joint 'turn' is planar, and how it moved isn't recorded, so where 'boom' was "
        "is unknown"
    )


def chain(*links: str, kind: str = "revolute") -> str:
    """Return joints that make a chain of links."""
    return "".join(
        f'<joint name="{child}_joint" type="{kind}">'
        f'<parent link="{parent}"/><child link="{child}"/></joint>'
        for parent, child in itertools.pairwise(links)
    )


ARM = chain("base", "a", "b", "c")
FINGERS = chain("c", "left") + chain("c", "right")


@pytest.mark.parametrize(
    ("joints", "tip"),
    [
        (ARM, "c"),
        (ARM + chain("c", "plate", "cover", kind="fixed"), "cover"),
        (
            ARM
            + chain("c", "camera", "lens", kind="fixed")
            + chain("c", "tool0", kind="fixed"),
            "tool0",
        ),
        # A hand with fingers, not one of these.
        (ARM + FINGERS, "c"),
        (ARM + FINGERS + chain("c", "grasp_frame", kind="fixed"), "grasp_frame"),
        # Two arms are no fingers.
        (ARM + chain("base", "d", "e", "f", "g"), "g"),
        # A pendulum's links are no hand either.
        (chain("base", "a", "b"), "b"),
    ],
)
def test_the_tip_is_the_end_of_the_longest_chain(joints, tip):
    names = dict.fromkeys(named_links(joints))
    links = "".join(f'<link name="{name}"/>' for name in names)
    rollout = make_described(f'<robot name="r">{links}{joints}</robot>', {}, None)

    assert rollout.find_tip() == tip


def test_a_base_that_drives_is_its_own_tip():
    joints = chain("base", "wheel")
    links = '<link name="base"/><link name="wheel"/>'
    text = f'<robot name="r">{links}{joints}</robot>'

    rollout = make_described(text, {}, None, free_poses={"base": np.zeros((1, 7))})

    assert rollout.find_tip() == "base"


def named_links(joints: str) -> list[str]:
    """Return the links that joints name, in order."""
    words = joints.split('link="')[1:]
    return [word.split('"')[0] for word in words]
