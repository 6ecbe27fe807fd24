"""The Tesla Bot does air curls, as its tutorial's node commands them."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh

import arm_drake as ad
from arm_drake.description.entry import bundled_motions, models_folder
from arm_drake.messages import Duration

ELBOWS = ["arm_upper_to_lower_right", "arm_upper_to_lower_left"]
SHOULDERS = [
    *("body_to_shoulder_right", "shoulder_to_arm_upper_right"),
    *("body_to_shoulder_left", "shoulder_to_arm_upper_left"),
]
MESHES = models_folder() / "teslabot" / "meshes"

# Angle of the right elbow, the left one's is its negative [rad]; where the hands are
# with it [m]: y and z. Their x is 0.206 and -0.206. Of the published URDF in Drake.
HANDS = [(0.0, 0.0, 0.2405), (1.5, 0.33715, 0.55459), (3.0, 0.0477, 0.91312)]

# How much of the way to its point a message moves the arm until the next one comes: it
# has 0.1 s of the second that the way takes. That is so in physics, too: a drive
# follows a ramp without lag.
IN_THEORY = 0.1
IN_PHYSICS = IN_THEORY

# Corners of the box around each link's CAD parts [m].
BOXES = {
    "head": ((-0.1531, -0.08834, 0.0), (0.1531, 0.1483, 0.3518)),
    "body": ((-0.1531, -0.09562, -0.4365), (0.1531, 0.1616, 0.0)),
    "shoulder": ((-0.06858, -0.0508, -0.0635), (0.05071, 0.0508, 0.0635)),
    "arm_upper": ((-0.0508, -0.381, -0.0508), (0.0508, 0.0508, 0.0508)),
    "arm_lower": ((-0.0381, -0.3442, -0.03808), (0.03807, 0.01778, 0.03809)),
    "hand_right": ((-0.06138, -0.07059, 0.0), (0.02269, 0.02614, 0.1607)),
    "hand_left": ((-0.06138, -0.02614, 0.0), (0.02269, 0.07059, 0.1607)),
}
SECOND = {"head": "collar", "body": "waist"}


def make_simulation(robot: ad.Robot | None = None, **options) -> ad.Simulation:
    robot = robot or ad.load_robot("teslabot")
    return ad.Simulation(
        ad.build_diagram(robot, options=ad.SimulationOptions(**options))
    )


def origin(sim: ad.Simulation, link: str) -> np.ndarray:
    """Return where a link is in the world [m]."""
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    body = plant.GetBodyByName(link)
    return plant.EvalBodyPoseInWorld(context, body).translation()


def hands(sim: ad.Simulation) -> np.ndarray:
    return np.array([origin(sim, "hand_right"), origin(sim, "hand_left")])


@pytest.fixture(scope="module")
def curls() -> ad.Rollout:
    """In physics."""
    return curl()


def curl(**options) -> ad.Rollout:
    motion = ad.load_motion(bundled_motions("teslabot")["air_curls"])
    sim = make_simulation(**options)
    sim.run(25.0, motion)
    return sim.rollout()


def columns(rollout: ad.Rollout, joints: list[str]) -> np.ndarray:
    names = list(rollout.joint_names)
    return rollout.position[:, [names.index(joint) for joint in joints]]


def swing(share: float) -> complex:
    """Return how the arm answers in the long run: its size [rad] and its phase.

    Message k moves it by ``share`` of what is left to 1.5 (1 - cos 0.1 k).
    """
    return 1.5 * share / (np.exp(0.1j) - (1.0 - share))


def load_script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("teslabot", MESHES / "make_meshes.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


@pytest.mark.parametrize(("angle", "y", "z"), HANDS)
def test_the_hands_are_where_the_published_ones_are(angle, y, z):
    initial = dict(zip(ELBOWS, (angle, -angle), strict=True))
    sim = make_simulation(ad.load_robot("teslabot", initial_positions=initial))

    np.testing.assert_allclose(
        hands(sim), [[0.206, y, z], [-0.206, y, z]], rtol=0.0, atol=1e-5
    )


@pytest.mark.parametrize(("angle", "y", "z"), HANDS)
def test_the_hands_get_there_in_physics(angle, y, z):
    sim = make_simulation()
    point = ad.JointTrajectoryPoint([angle, -angle], time_from_start=2.0)
    goal = ad.JointTrajectory(joint_names=ELBOWS, points=[point])
    handle = sim.controller("joint_trajectory_controller").send_goal(goal)

    sim.advance_to(3.0)

    assert handle.status is ad.GoalStatus.SUCCEEDED
    np.testing.assert_allclose(
        hands(sim), [[0.206, y, z], [-0.206, y, z]], rtol=0.0, atol=3e-3
    )


def test_the_motion_sends_what_the_tutorials_node_sends():
    motion = ad.load_motion(bundled_motions("teslabot")["air_curls"])

    steps = motion.steps
    times = [step.at for step in steps]
    np.testing.assert_allclose(times, 0.1 * np.arange(len(steps)), atol=1e-9)
    for k, step in enumerate(steps):
        (point,) = step.message.points
        right = 1.5 * (1.0 - np.cos(0.1 * k))
        assert list(step.message.joint_names) == ELBOWS
        assert point.time_from_start == Duration(sec=1)
        # The file has six decimals.
        np.testing.assert_allclose(point.positions, [right, -right], atol=5.1e-7)
    # Whole periods: it ends where it starts.
    assert abs(len(steps) - 1 - 5 * 20 * np.pi) < 0.5


def test_commands_that_are_obeyed_exactly_swing_from_0_41_to_2_59_rad():
    rollout = curl(preset="kinematic")

    settled = columns(rollout, ELBOWS)[rollout.time > 12.0]
    # The peak may be half a message from the nearest tick: 1 - cos(0.05) of the swing.
    for side in (settled[:, 0], -settled[:, 1]):
        assert side.min() == pytest.approx(0.41, abs=5e-3)
        assert side.max() == pytest.approx(2.59, abs=5e-3)
        assert side.max() - 1.5 == pytest.approx(abs(swing(IN_THEORY)), abs=1.5e-3)


def test_air_curls_swing_both_forearms_in_physics(curls):
    settled = columns(curls, ELBOWS)[curls.time > 12.0]
    expected = abs(swing(IN_PHYSICS))
    for side in (settled[:, 0], -settled[:, 1]):
        assert side.max() - 1.5 == pytest.approx(expected, abs=3e-3)
        assert 1.5 - side.min() == pytest.approx(expected, abs=3e-3)
    np.testing.assert_allclose(settled[:, 0], -settled[:, 1], rtol=0.0, atol=1e-9)


def test_a_curl_takes_as_long_as_the_commands_period_and_lags(curls):
    right = columns(curls, ELBOWS)[:, 0]
    late = curls.time > 12.0
    phase = np.exp(1j * curls.time[late])
    parts = np.stack([np.ones(late.sum()), phase.real, phase.imag], axis=1)
    (mean, cosine, sine), *_ = np.linalg.lstsq(parts, right[late], rcond=None)
    fit = parts @ [mean, cosine, sine]
    # One sine of 2 pi s; the rest is what each new start does within its 0.1 s.
    assert np.abs(right[late] - fit).max() < 0.03
    assert mean == pytest.approx(1.5, abs=5e-3)
    # The command is highest at pi, the arm 0.78 s later.
    lag = np.arctan2(sine, cosine) % (2.0 * np.pi) - np.pi
    assert lag == pytest.approx(-np.angle(swing(IN_PHYSICS)), abs=5e-3)


def test_the_shoulders_hang_still_though_nothing_drives_them(curls):
    assert np.abs(columns(curls, SHOULDERS)).max() < 1e-9


def test_curls_take_far_less_effort_than_there_is(curls):
    assert curls.effort_limit.tolist() == [100.0] * 6
    assert curls.effort_saturation() == {}


def test_only_what_the_tutorial_says_for_nothing_is_reported():
    robot = ad.load_robot("teslabot")

    remarks = [entry for entry in robot.report if entry.severity != "info"]
    assert not remarks
    assert robot.description.name == "robot"


def test_it_can_be_mounted_on_another_link(tmp_path: Path):
    urdf = tmp_path / "mounted.urdf.xacro"
    urdf.write_text(
        """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="mounted">
        <xacro:include filename="$(find teslabot)/urdf/teslabot_macro.xacro"/>
        <material name="black"><color rgba="0 0 0 1"/></material>
        <material name="gray"><color rgba="0.2 0.2 0.2 1"/></material>
        <material name="white"><color rgba="1 1 1 1"/></material>
        <link name="world"/><link name="torso"/>
        <joint name="world_to_torso" type="fixed"><origin xyz="0 0 2" rpy="0 0 0"/>
        <parent link="world"/><child link="torso"/></joint>
        <xacro:upper_body parent="torso" xyz="0.2 0 0.5"/></robot>""",
        encoding="utf-8",
    )

    robot = ad.load_robot(urdf, package_paths=[models_folder()])

    sim = make_simulation(robot)
    np.testing.assert_allclose(origin(sim, "head"), [0.2, 0.0, 2.5], atol=1e-12)
    # 1.5 m higher than on the ground, 0.2 m to the side.
    np.testing.assert_allclose(hands(sim)[0], [0.406, 0.0, 1.7405], atol=1e-12)


def test_it_can_stand_elsewhere_in_the_world():
    robot = ad.load_robot("teslabot", xacro_args={"xyz": "1 2 3"})

    sim = make_simulation(robot)

    np.testing.assert_allclose(origin(sim, "head"), [1.0, 2.0, 3.0], atol=1e-12)


@pytest.mark.parametrize("link", BOXES)
def test_shapes_fill_the_boxes_of_the_parts(link):
    names = [link, SECOND[link]] if link in SECOND else [link]

    bounds = np.array([trimesh.load(MESHES / f"{name}.STL").bounds for name in names])

    found = [bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)]
    np.testing.assert_allclose(found, BOXES[link], rtol=0.0, atol=0.02)


def test_the_script_makes_the_meshes_that_are_there(tmp_path, monkeypatch, capsys):
    script = load_script()
    monkeypatch.setattr(script, "FOLDER", tmp_path)

    script.main()

    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in MESHES.glob("*.STL"))
    for name in made:
        ours, there = trimesh.load(tmp_path / name), trimesh.load(MESHES / name)
        assert ours.is_volume
        np.testing.assert_allclose(ours.triangles, there.triangles, rtol=0.0, atol=1e-6)
