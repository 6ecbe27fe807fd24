"""The lab's arm of three cylinders: what its node `control` does, in physics."""

import functools
import math
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.description.entry import bundled_motions
from arm_drake.simulation.motion_files import load_motion

Array = NDArray[np.float64]

JTC = "joint_trajectory_controller"
JOINTS = ("base_arm1_joint", "arm1_arm2_joint", "arm2_arm3_joint")
START = (0.0, 0.1, 0.2)  # rad, the description's initial positions
DEFAULT = (1.5, 0.5, 1.2)  # rad, the node's own goal
BEYOND = (3.5, 1.5, -1.2)  # rad, that of the lab's step 14
LIMIT = 2.14  # rad

# The arm reaches below its own foot; 1 m up it can.
PEDESTAL = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

# Configuration [rad], origin of arm3_link in the world [m], of the published URDF.
GOLDEN = [
    ((0.0, 0.0, 0.0), (0.0, 0.0, 1.05)),
    ((0.0, 0.1, 0.2), (0.04992, 0.0, 1.0475)),
    ((0.5, 0.2, 0.5), (0.56182, 0.0, 0.87121)),
    ((0.5, 0.5, 0.5), (0.66045, 0.0, 0.75894)),
    ((1.5, 0.5, 1.2), (0.9534, 0.0, -0.1227)),
    ((2.14, 1.5, -1.2), (0.18215, 0.0, -0.65865)),
]


@functools.cache
def follow(goal: tuple[float, ...], **options) -> tuple[ad.Simulation, ad.Rollout]:
    """Run the node `control` with a goal, until it has long been reached.

    What several tests look at is run once.
    """
    motion = load_motion(
        bundled_motions("lab5_arm")["control"], {"joint_angles": list(goal)}
    )
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm", **options)))
    sim.run(motion.duration + 1.0, motion)
    return sim, sim.rollout()


def link_origin(sim: ad.Simulation, link: str) -> Array:
    """Return where a link is in the simulated world [m]."""
    (robot,) = sim.robots.values()
    port = sim.diagram.GetOutputPort("frames")
    frames = port.Eval(
        port.get_system().GetMyContextFromRoot(sim.simulator.get_context())
    )
    return np.array(frames[robot.description.links.index(link)].translation())


@pytest.mark.parametrize(("q", "origin"), GOLDEN)
def test_the_last_link_is_where_the_published_one_is(q, origin):
    model = pinocchio.buildModelFromXML(ad.load_robot("lab5_arm").description.urdf)
    data = model.createData()

    pinocchio.framesForwardKinematics(model, data, np.array(q))

    assert list(model.names)[1:] == list(JOINTS)
    found = data.oMf[model.getFrameId("arm3_link")].translation
    # The figures have five decimals.
    np.testing.assert_allclose(found, origin, rtol=0.0, atol=6e-6)


def test_joints_and_masses_are_the_published_ones():
    description = ad.load_robot("lab5_arm").description

    joints = {joint.name: joint for joint in description.joints}
    assert set(joints) == {*JOINTS, "world_base_joint"}
    for name in JOINTS:
        limits = joints[name].limits
        assert (limits.lower, limits.upper) == (-LIMIT, LIMIT)
        assert (limits.effort, limits.velocity) == (100.0, 100.0)
        assert (joints[name].damping, joints[name].friction) == (10.0, 1.0)
    root = ElementTree.fromstring(description.urdf)  # noqa: S314  # Our own.
    masses = {
        link.attrib["name"]: float(mass.attrib["value"])
        for link in root.iterfind("link")
        for mass in link.iter("mass")
    }
    assert masses == {
        **{"base_link": 5.0, "arm1_link": 5.0},
        **{"arm2_link": 0.01, "arm3_link": 0.01},
    }


def test_only_the_older_name_of_a_parameter_is_reported():
    report = ad.load_robot("lab5_arm").report

    assert [(entry.severity, entry.where) for entry in report] == [
        ("info", f"{JTC}.open_loop_control")
    ]


def test_without_a_command_the_arm_holds_the_initial_positions():
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))

    sim.advance_to(5.0)

    position = sim.rollout().position
    np.testing.assert_allclose(position[0], START, rtol=0.0, atol=1e-12)
    assert np.abs(position - START).max() <= 1e-3


@pytest.mark.parametrize(
    ("goal", "pose"),
    [
        ((0.5, 0.2, 0.5), None),
        ((0.5, 0.5, 0.5), None),
        (DEFAULT, PEDESTAL),
        ((LIMIT, 1.5, -1.2), PEDESTAL),
    ],
)
def test_the_arm_reaches_the_goal_within_3_mm(goal, pose):
    sim, rollout = follow(goal, pose=pose)

    height = 0.0 if pose is None else pose[2]
    expected = np.add(dict(GOLDEN)[goal], (0.0, 0.0, height))
    assert np.linalg.norm(link_origin(sim, "arm3_link") - expected) <= 3e-3
    np.testing.assert_allclose(rollout.position[-1], goal, rtol=0.0, atol=1e-3)
    assert not sim.rejected


def test_half_of_the_way_is_left_each_second():
    # "In two seconds" again each second: a message starts where the last one has got
    # to, one tick back, as the controller commands a tick ahead. So of 2.01 s one more
    # second is left, which is less than half by 0.5 / 201.
    _, rollout = follow(DEFAULT, pose=PEDESTAL)

    seconds = [int(np.argmin(np.abs(rollout.time - t))) for t in range(6)]
    left = np.subtract(DEFAULT, rollout.references[JTC].position[seconds])
    np.testing.assert_allclose(
        left[1:] / left[:-1], 0.5, rtol=0.0, atol=0.5 / 201 + 1e-4
    )


def test_a_goal_beyond_the_limit_ends_at_the_limit_and_the_others_arrive():
    sim, rollout = follow(BEYOND, pose=PEDESTAL)

    # The stop of a joint is compliant; a tenth of a milliradian is none to be seen.
    assert rollout.position[:, 0].max() <= LIMIT + 1e-4
    np.testing.assert_allclose(
        rollout.position[-1], (LIMIT, *BEYOND[1:]), rtol=0.0, atol=1e-3
    )
    expected = np.add(dict(GOLDEN)[LIMIT, *BEYOND[1:]], PEDESTAL[:3])
    assert np.linalg.norm(link_origin(sim, "arm3_link") - expected) <= 3e-3


@pytest.mark.parametrize("preset", ["accurate", "kinematic"])
def test_a_goal_beyond_the_limit_says_so_once(capsys, preset):
    run = ["sim", "lab5_arm", "--headless", "--motion", "control", "--preset", preset]
    pose = ["--pose", "0", "0", "1", "0", "0", "0"]
    goal = ["--set", f"joint_angles={list(BEYOND)}"]

    code = main([*run, *pose, *goal])

    assert code == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    # Where it stands, before the run, and once when it comes to that.
    motion, joint = said
    assert motion.endswith("points[0]: base_arm1_joint 3.5 is outside [-2.14, 2.14]")
    assert joint == (
        "warning: commands of joint 'base_arm1_joint' go beyond its limits; "
        "they are held to them"
    )


@pytest.mark.slow
def test_on_the_ground_the_first_link_lies_down_and_its_effort_says_so():
    _, rollout = follow(BEYOND)

    # The blue cylinder, of radius 0.08 m, touches the ground where it leaves the foot,
    # 0.2 m from the joint, which is 0.05 m up: 0.08 sin q - 0.2 cos q = 0.05.
    flat = math.asin(0.05 / math.hypot(0.08, 0.2)) + math.atan2(0.2, 0.08)
    # 100 N·m over 0.2 m are 500 N, which press it less than a millimetre into the
    # ground: 5 mrad.
    assert rollout.position[-1, 0] == pytest.approx(flat, abs=5e-3)
    assert set(rollout.effort_saturation()) == {"base_arm1_joint"}
    assert rollout.effort_saturation()["base_arm1_joint"] > 5.0
