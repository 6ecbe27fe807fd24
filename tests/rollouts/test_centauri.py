"""Centauri: its ramp to 15 degrees, its poses and its gripper, in physics."""

import math
import runpy
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
import trimesh
from numpy.typing import NDArray

import arm_drake as ad
from arm_drake.description.entry import bundled_motions, models_folder

Array = NDArray[np.float64]

ARM = tuple(f"joint{i}" for i in range(1, 7))
GROUP = "joint_group_position_controller"
ANGLE = math.radians(15.0)  # the ramp's end
MESHES = models_folder() / "centauri" / "meshes"

# Joints of the gripper, and how far each turns with the first.
GRIPPER = {
    "right_gear_joint": 1.0,
    "right_finger_joint": -1.0,
    "right_pivot_joint": 1.0,
    "left_gear_joint": -1.0,
    "left_finger_joint": 1.0,
    "left_pivot_joint": -1.0,
}

# Configuration [rad], origin of tool_center in the world [m], of the published URDF.
GOLDEN = [
    ((0.0,) * 6, (0.00247, -0.00364, 0.90110)),
    ((ANGLE,) * 6, (0.07879, -0.24404, 0.82663)),
    ((1.07, 0.68, 0.99, -1.57, 0.77, 1.56), (0.35447, -0.28322, 0.47792)),
    ((0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0), (0.0072, -0.5646, 0.3329)),
]

# Corners of the boxes around the published meshes [m]; that of link0 is not published.
BOXES = {
    "base_footprint": ((-0.275, -0.3552, -0.116), (0.275, 0.1948, 0.0)),
    "link1": ((-0.1556, 0.0, -0.09748), (0.1556, 0.2055, 0.09748)),
    "link2": ((-0.06, -0.05998, -0.06804), (0.06, 0.2686, 0.06655)),
    "link3": ((-0.0475, -0.0475, -0.03875), (0.0475, 0.1276, 0.03875)),
    "link4": ((-0.04504, -0.03606, 0.0), (0.04504, 0.03606, 0.1299)),
    "link5": ((-0.03498, -0.035, -0.024), (0.035, 0.04905, 0.024)),
    "link6": ((-0.03367, -0.04992, 0.0), (0.0304, 0.02451, 0.049)),
    "right_gear": ((-0.044, -0.015, -0.006), (0.01489, 0.01497, 0.0)),
    "right_finger": ((-0.01555, -0.006998, -0.01225), (0.007613, 0.06475, 0.00575)),
    "right_pivot": ((-0.04397, -0.003993, -0.006), (0.003973, 0.003993, 0.0)),
    "left_gear": ((-0.044, -0.01497, -0.006), (0.015, 0.01499, 0.0)),
    "left_finger": ((-0.01641, -0.06454, -0.01225), (0.007323, 0.006994, 0.00575)),
    "left_pivot": ((-0.04397, -0.003993, -0.006), (0.003973, 0.003993, 0.0)),
}


def simulate(
    robot: ad.Robot, motion_name: str, time_step: float = 1e-3
) -> tuple[ad.Simulation, ad.Rollout]:
    motion = ad.load_motion(bundled_motions("centauri")[motion_name])
    options = ad.SimulationOptions(time_step=time_step)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    sim.run(motion.duration + 1.0, motion)
    return sim, sim.rollout()


def command(robot: ad.Robot, q: tuple[float, ...], seconds: float) -> ad.Simulation:
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.controller(GROUP).command(list(q))
    sim.advance_to(seconds)
    return sim


def link_pose(sim: ad.Simulation, link: str) -> Array:
    """Return the pose of a link in the simulated world, shape (4, 4)."""
    (robot,) = sim.robots.values()
    port = sim.diagram.GetOutputPort("frames")
    context = port.get_system().GetMyContextFromRoot(sim.simulator.get_context())
    index = robot.description.links.index(link)
    return np.array(port.Eval(context)[index].GetAsMatrix4())


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("centauri")


@pytest.mark.parametrize(("q", "origin"), GOLDEN)
def test_the_tool_is_where_the_published_one_is(robot, q, origin):
    model = pinocchio.buildModelFromXML(robot.description.urdf)
    data = model.createData()
    configuration = pinocchio.neutral(model)
    for name, angle in zip(ARM, q, strict=True):
        configuration[model.joints[model.getJointId(name)].idx_q] = angle

    pinocchio.framesForwardKinematics(model, data, configuration)

    found = data.oMf[model.getFrameId("tool_center")].translation
    # Figures of five decimals; of the last one two have four.
    decimals = 6e-5 if q[1] == math.pi / 2 else 6e-6
    np.testing.assert_allclose(found, origin, rtol=0.0, atol=decimals)


@pytest.mark.parametrize(("q", "origin"), GOLDEN)
def test_the_arm_takes_its_tool_there_within_3_mm(robot, q, origin):
    sim = command(robot, q, 2.5)

    found = link_pose(sim, "tool_center")[:3, 3]
    assert np.linalg.norm(found - origin) <= 3e-3


def test_the_ramp_climbs_by_10_mrad_and_saturates_at_15_degrees(robot):
    sim, rollout = simulate(robot, "ramp")

    # What is asked for in the middle of each tenth of a second.
    rows = [
        int(np.argmin(np.abs(rollout.time - t))) for t in 0.1 * np.arange(46) + 0.05
    ]
    expected = np.minimum(0.01 * np.arange(46), ANGLE)
    wanted = rollout.references[GROUP].position[rows]
    # The file has seven decimals.
    np.testing.assert_allclose(wanted, np.tile(expected[:, None], 6), rtol=0, atol=1e-7)
    measured = rollout.position[:, :6]
    assert rollout.joint_names[:6] == ARM
    # Half a step's time after each step the arm isn't a whole step behind.
    assert np.abs(measured[rows] - expected[:, None]).max() < 10e-3
    # Each joint to a tenth of a step, on either side.
    np.testing.assert_allclose(measured[-1], ANGLE, rtol=0.0, atol=1e-3)
    assert measured.max() <= ANGLE + 1e-3
    found = link_pose(sim, "tool_center")[:3, 3]
    assert np.linalg.norm(found - GOLDEN[1][1]) <= 3e-3


def test_without_a_command_the_arm_holds_a_pose_stretched_out():
    robot = ad.load_robot("centauri", initial_positions={"joint2": 1.2, "joint3": 0.3})
    sim = ad.Simulation(ad.build_diagram(robot))

    sim.advance_to(2.5)

    position = sim.rollout().position
    assert position[0, 1:3].tolist() == [1.2, 0.3]
    assert np.abs(position - position[0]).max() <= 5e-4


def test_with_its_first_efforts_the_arm_falls_onto_its_stop_and_says_so():
    first = {"effort": "5", "velocity": "1"}
    # Gravity asks for 8.45 sin 1.2 = 7.9 N·m there; 5 N·m and 1.5 of friction hold 6.5.
    robot = ad.load_robot(
        "centauri", xacro_args=first, initial_positions={"joint2": 1.2}
    )

    sim = command(robot, (0.0, 1.2, 0.0, 0.0, 0.0, 0.0), 3.0)

    rollout = sim.rollout()
    assert rollout.position[-1, 1] == pytest.approx(1.5708, abs=1e-3)
    assert rollout.effort_saturation()["joint2"] > 2.5
    (warning,) = robot.report
    assert warning.where == "joint 'joint2'"
    assert "effort limit is 5 N·m" in warning.what


@pytest.mark.slow
def test_five_joints_of_the_gripper_follow_the_first(robot):
    _, rollout = simulate(robot, "gripper", 5e-3)

    columns = [rollout.joint_names.index(name) for name in GRIPPER]
    angles = rollout.position[:, columns]
    ratios = np.array(list(GRIPPER.values()))
    assert np.abs(angles - angles[:, :1] * ratios).max() <= 1e-3
    at_20_degrees = int(np.argmin(np.abs(rollout.time - 5.9)))
    assert angles[at_20_degrees, 0] == pytest.approx(-math.radians(20.0), abs=1e-3)
    assert angles[-1, 0] == pytest.approx(-math.radians(5.0), abs=1e-3)


def test_the_fingers_stay_upright_and_come_together(robot):
    before = ad.Simulation(ad.build_diagram(robot))
    before.advance_to(0.1)
    after = ad.Simulation(ad.build_diagram(robot))
    after.controller("gripper_controller").command([-0.95])

    after.advance_to(3.0)

    for side in ("right", "left"):
        link = f"{side}_finger"
        turned = link_pose(before, link)[:3, :3].T @ link_pose(after, link)[:3, :3]
        # Gear and finger turn by the same angle, there and back.
        np.testing.assert_allclose(turned, np.eye(3), rtol=0.0, atol=1e-3)
    apart = [
        np.linalg.norm(
            link_pose(sim, "right_finger")[:3, 3] - link_pose(sim, "left_finger")[:3, 3]
        )
        for sim in (before, after)
    ]
    # Bars of 40 mm that lean inwards by 22.0 and 23.0 degrees turn by another 54.4.
    closing = [
        0.04 * (math.cos(lean) - math.cos(lean + 0.95)) for lean in (0.38395, 0.40077)
    ]
    assert apart[0] - apart[1] == pytest.approx(sum(closing), abs=1e-3)


def test_joints_and_masses_are_the_published_ones(robot):
    joints = {joint.name: joint for joint in robot.description.joints}

    for name in ARM:
        limits = joints[name].limits
        assert (limits.lower, limits.upper) == (-1.5708, 1.5708)
        assert limits.effort == (300.0 if name == "joint1" else 10.0)
        assert limits.velocity == 10.0
        assert (joints[name].damping, joints[name].friction) == (0.1, 1.5)
    for name, (lower, upper) in {
        **{"right_gear_joint": (-0.95, 0.0), "left_gear_joint": (0.0, 0.95)},
        **{"right_pivot_joint": (-1.5708, 1.5708), "left_finger_joint": (-1.5, 0.0)},
    }.items():
        assert (joints[name].limits.lower, joints[name].limits.upper) == (lower, upper)
    root = ElementTree.fromstring(robot.description.urdf)  # noqa: S314  # Our own.
    masses = {
        link.attrib["name"]: float(mass.attrib["value"])
        for link in root.iterfind("link")
        for mass in link.iter("mass")
    }
    assert sum(masses.values()) == pytest.approx(11.32, abs=0.005)
    fixed = masses["base_footprint"] + masses["link0"]
    assert sum(masses.values()) - fixed == pytest.approx(6.07, abs=0.01)


def test_nothing_is_reported(robot):
    assert not list(robot.report)


@pytest.mark.parametrize("link", BOXES)
def test_meshes_fill_the_boxes_of_the_published_ones(link):
    mesh = trimesh.load_mesh(MESHES / f"{link}.STL")

    # Ours are rounder: a hand without its ribs, jaws without their tips.
    np.testing.assert_allclose(mesh.bounds, BOXES[link], rtol=0.0, atol=0.01)


def test_meshes_are_what_their_script_makes():
    made = runpy.run_path(str(MESHES / "make_meshes.py"))["make_all"]()

    assert {path.stem for path in MESHES.glob("*.STL")} == set(made)
    for name, solids in made.items():
        stored = trimesh.load_mesh(MESHES / f"{name}.STL")
        expected = trimesh.util.concatenate(solids)
        # Which triangles fill a flat face may differ; what they enclose doesn't.
        np.testing.assert_allclose(stored.bounds, expected.bounds, rtol=0, atol=1e-6)
        assert stored.area == pytest.approx(expected.area, rel=1e-4)
        assert all(solid.is_watertight and solid.volume > 0 for solid in solids), name
