"""The main job: the Doosan A0912 follows the tutorial's trajectory, in physics."""

import functools
import re
import runpy
from pathlib import Path

import collada
import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.entry import bundled_motions, models_folder
from tests.robots import real_robot

JTC = "joint_trajectory_controller"
GOAL = np.array([0.1, 0.0, 1.5, 1.5, 1.0, 0.4])  # rad, the tutorial's last point
REAL = "doosan_a0912/my_doosan_pkg/description/xacro/a0912.urdf.xacro"

# Poses that don't touch the ground: upright, bent, twisted, stretched out, folded.
POSES = [
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.0, 0.6, 0.8, 0.0, 0.5, 0.0),
    (1.0, -0.5, 1.2, -1.0, 0.7, 2.0),
    (-2.0, 1.2, -1.0, 0.5, -1.0, 0.0),
    (0.5, 0.0, 1.57, 0.0, 1.2, -1.0),
]


# Angles [rad], and where the flange is with them [m], of the published URDF in Drake.
KEY_POSES = [
    ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.00013, 0.03924, 1.39500)),
    ((0.0, 0.0, 0.52, 0.0, 0.0, 0.0), (0.31812, 0.03916, 1.31034)),
    ((0.0, 0.0, -0.17, 0.0, 0.0, 0.0), (-0.10815, 0.03926, 1.38580)),
    ((0.0, 0.0, -0.52, 0.0, 0.0, 0.0), (-0.31789, 0.03929, 1.31047)),
    ((0.0, 0.0, 0.17, 0.0, 0.0, 0.0), (0.10841, 0.03922, 1.38575)),
    ((0.1, 0.0, 1.5, 1.5, 1.0, 0.4), (0.56492, 0.20047, 0.78875)),
    ((-0.5, -0.5, -0.5, 0.5, 0.5, -0.5), (-0.63969, 0.42676, 1.06803)),
    ((0.0, np.pi / 2.0, 0.0, 0.0, 0.0, 0.0), (1.20000, 0.03876, 0.19487)),
]
JOINTS = [f"joint{i}" for i in range(1, 7)]
BUMPER = "/contact_sensor/bumper_link6"


@pytest.fixture(params=["as published", "bundled"])
def source(request) -> str:
    return "doosan_a0912" if request.param == "bundled" else str(real_robot(REAL))


def follow_tutorial(
    robot: ad.Robot | str, **options
) -> tuple[ad.Simulation, ad.Rollout]:
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    robot = ad.load_robot(robot) if isinstance(robot, str) else robot
    diagram = ad.build_diagram(robot, options=ad.SimulationOptions(**options))
    sim = ad.Simulation(diagram)
    sim.run(motion.duration + 1.5, motion)
    return sim, sim.rollout()


@functools.cache
def follow_tutorial_once(source: str) -> tuple[ad.Simulation, ad.Rollout]:
    """Return what several tests look at."""
    return follow_tutorial(source)


def flange(sim: ad.Simulation) -> np.ndarray:
    """Return where the origin of link6 is [m]."""
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    body = plant.GetBodyByName("link6")
    return plant.EvalBodyPoseInWorld(context, body).translation()


def with_effort_limit(folder: Path, effort: float) -> Path:
    """Return the entry file of the bundled package with other effort limits."""
    target = folder / "doosan_a0912"
    for path in (models_folder() / "doosan_a0912").rglob("*"):
        copy = target / path.relative_to(models_folder() / "doosan_a0912")
        if path.is_file():
            copy.parent.mkdir(parents=True, exist_ok=True)
            text = path.read_text(encoding="utf-8")
            text = re.sub(r'effort="\d+"', f'effort="{effort}"', text)
            copy.write_text(text, encoding="utf-8")
    return target / "urdf" / "doosan_a0912.urdf.xacro"


def test_the_arm_reaches_the_goal_within_2_mrad(source):
    sim, rollout = follow_tutorial_once(source)

    np.testing.assert_allclose(rollout.position[-1], GOAL, rtol=0.0, atol=2e-3)
    (goal,) = sim.goals
    assert goal.status is ad.GoalStatus.SUCCEEDED
    assert goal.result.error_code == 0


def test_the_arm_tracks_the_trajectory_within_15_mrad(source):
    _, rollout = follow_tutorial_once(source)

    error = rollout.tracking_error(JTC)
    assert np.isfinite(error[:-1]).all()
    assert np.abs(error[:-1]).max() <= 15e-3
    # Half-way between the tutorial's points, the straight line between them.
    (row,) = np.flatnonzero(np.isclose(rollout.time, 3.0))
    np.testing.assert_allclose(rollout.references[JTC].position[row], GOAL / 2)


def test_efforts_stay_within_the_limits_of_the_description(source):
    _, rollout = follow_tutorial_once(source)

    limits = [411.0, 411.0, 194.0, 50.0, 50.0, 50.0]  # N·m, as published
    assert rollout.effort_limit.tolist() == limits
    assert (np.abs(rollout.effort) <= limits).all()
    # The arm does work: the shoulder carries what lies beyond it.
    assert np.abs(rollout.effort).max() > 10.0


@pytest.mark.parametrize(("pose", "where"), KEY_POSES)
def test_the_flange_is_where_the_published_one_is(pose, where):
    initial = dict(zip(JOINTS, pose, strict=True))
    robot = ad.load_robot("doosan_a0912", initial_positions=initial)

    sim = ad.Simulation(ad.build_diagram(robot))

    # The figures have five decimals.
    np.testing.assert_allclose(flange(sim), where, rtol=0.0, atol=6e-6)


@pytest.mark.parametrize(("pose", "where"), KEY_POSES)
def test_the_flange_gets_to_the_key_poses_within_3_mm(pose, where):
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    point = ad.JointTrajectoryPoint(pose, time_from_start=1.0)
    goal = ad.JointTrajectory(joint_names=JOINTS, points=[point])
    handle = sim.controller(JTC).send_goal(goal)

    sim.advance_to(1.5)

    assert handle.status is ad.GoalStatus.SUCCEEDED
    np.testing.assert_allclose(flange(sim), where, rtol=0.0, atol=3e-3)


def test_the_repositorys_waypoints_are_passed_in_time():
    motion = ad.load_motion(bundled_motions("doosan_a0912")["waypoints"])
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))

    sim.run(11.0, motion)

    (goal,) = sim.goals
    assert goal.status is ad.GoalStatus.SUCCEEDED
    rollout = sim.rollout()
    for time, elbow in [(2, 0.0), (4, 0.52), (6, -0.17), (8, -0.52), (10, 0.17)]:
        (row,) = np.flatnonzero(np.isclose(rollout.time, time))
        expected = [0.0, 0.0, elbow, 0.0, 0.0, 0.0]
        # At up to 0.35 rad/s half a tick is 2 mrad, and a corner is rounded off.
        np.testing.assert_allclose(rollout.position[row], expected, rtol=0.0, atol=5e-3)
    np.testing.assert_allclose(flange(sim), KEY_POSES[4][1], rtol=0.0, atol=3e-3)


def test_messages_that_start_over_halve_the_way_each_second():
    motion = ad.load_motion(bundled_motions("doosan_a0912")["topic"])
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))

    sim.run(6.0, motion)

    rollout = sim.rollout()
    pose = np.array(KEY_POSES[6][0])
    for second in range(1, 6):
        (row,) = np.flatnonzero(np.isclose(rollout.time, second))
        # The first second ends at 0.25 rad/s, which in half a tick is 1.3 mrad; what is
        # left of the way halves from then on, and the error with it.
        np.testing.assert_allclose(
            rollout.position[row], pose * (1.0 - 0.5**second), rtol=0.0, atol=4e-3
        )


def test_the_bumper_feels_the_ground_under_the_flange():
    # The flange points down: 14 mm over the ground, then 16 mm below it.
    over, under = (
        (0.0, 1.2, 0.9, 0.0, np.pi - 2.1, 0.0),
        (0.0, 1.23, 0.9, 0.0, 1.0, 0.0),
    )
    initial = dict(zip(JOINTS, over, strict=True))
    robot = ad.load_robot("doosan_a0912", initial_positions=initial)
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)
    assert sim.topic(BUMPER).value().states == ()
    point = ad.JointTrajectoryPoint(under, time_from_start=1.0)
    down = ad.JointTrajectory(joint_names=JOINTS, points=[point])
    sim.controller(JTC).send_goal(down)

    sim.run(1.5)

    message = sim.topic(BUMPER).value()
    (state,) = message.states
    assert message.header.frame_id == "link6"
    assert state.collision1_name == "a0912::link6::link6_collision"
    assert state.collision2_name == "world::ground"
    # In the link's frame, whose z axis points down: the ground pushes against it.
    assert state.total_wrench.force.z < -10.0


def test_the_bumper_is_the_published_one(source):
    sim = ad.Simulation(ad.build_diagram(ad.load_robot(source)))

    assert BUMPER in [topic.name for topic in sim.list_topics()]


@pytest.mark.parametrize("pose", POSES)
def test_without_a_command_the_arm_holds_its_pose(source, pose):
    initial = {f"joint{i}": angle for i, angle in enumerate(pose, start=1)}
    robot = ad.load_robot(source, initial_positions=initial)
    sim = ad.Simulation(ad.build_diagram(robot))

    sim.advance_to(2.0)

    position = sim.rollout().position
    np.testing.assert_allclose(position[0], pose, rtol=0.0, atol=1e-12)
    # 0.1 mrad a second, were it to creep.
    assert np.abs(position - pose).max() <= 2e-4


def test_with_little_effort_the_arm_sags_and_says_so(tmp_path):
    entry = with_effort_limit(tmp_path, 5)
    controllers = ad.load_robot("doosan_a0912").controllers.files
    # Stretched out: holding takes far more than 5 N·m.
    robot = ad.load_robot(
        entry, controllers=controllers, initial_positions={"joint2": 1.2}
    )

    sim, rollout = follow_tutorial(robot)

    (goal,) = sim.goals
    assert goal.status is ad.GoalStatus.ABORTED
    assert goal.result.error_code == -5  # GOAL_TOLERANCE_VIOLATED
    assert re.fullmatch(
        r"Aborted due to goal_time_tolerance exceeding by 1\.0\d+ seconds",
        goal.result.error_string,
    )
    # Its upper arm fell; upstream's text stays, and the handle says more.
    assert re.search(
        r"seconds \(position of 'joint2' is off by [\d.]+ rad, its goal tolerance is "
        r"0\.005 rad",
        goal.describe(),
    )
    assert (np.abs(rollout.effort) <= 5.0).all()
    assert rollout.position[-1, 1] > 1.3  # rad: it fell
    seconds = rollout.effort_saturation()
    assert seconds["joint2"] > 1.0
    assert set(seconds) <= set(rollout.joint_names)


def test_two_runs_write_the_same_bytes(tmp_path):
    runs = follow_tutorial_once("doosan_a0912"), follow_tutorial("doosan_a0912")

    for suffix in (".npz", ".csv"):
        files = [tmp_path / name / f"run{suffix}" for name in "ab"]
        for file, (_, rollout) in zip(files, runs, strict=True):
            file.parent.mkdir(exist_ok=True)
            rollout.save(file)
        first, second = (file.read_bytes() for file in files)
        assert first == second


@pytest.mark.parametrize("time_step", [0.002, 0.005, 0.01])
def test_larger_steps_reach_the_goal_too(time_step):
    sim, rollout = follow_tutorial(ad.load_robot("doosan_a0912"), time_step=time_step)
    np.testing.assert_allclose(rollout.position[-1], GOAL, rtol=0.0, atol=2e-3)
    assert sim.goals[0].status is ad.GoalStatus.SUCCEEDED


def test_of_the_published_description_only_unknown_parameters_are_left_out():
    robot = ad.load_robot(real_robot(REAL))

    remarks = [entry for entry in robot.report if entry.severity != "info"]
    assert {entry.what for entry in remarks} == {"unknown parameter"}
    assert [entry.where.rpartition(".")[2] for entry in remarks] == [
        "deduce_states_from_derivatives",
        "hardware_state_has_offset",
        "interface_name",
        "write_op_modes",
    ]
    assert robot.description.name == "a0912"
    assert [file.name for file in robot.controllers.files] == ["simple_controller.yaml"]


@pytest.mark.parametrize("color", ["blue", "white"])
def test_nothing_of_the_bundled_robot_is_reported(color):
    robot = ad.load_robot("doosan_a0912", xacro_args={"color": color})

    assert list(robot.report) == []


def test_the_script_makes_the_meshes_that_are_there():
    folder = models_folder() / "doosan_a0912" / "meshes"
    made = runpy.run_path(str(folder / "make_meshes.py"))["documents"]()

    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*.dae")}
    assert set(made) == there
    for name, document in made.items():
        kept = collada.Collada(str(folder / name))
        assert [m.name for m in kept.materials] == [m.name for m in document.materials]
        for ours, file in zip(document.geometries, kept.geometries, strict=True):
            (shape,), (written,) = ours.primitives, file.primitives
            np.testing.assert_array_equal(written.vertex_index, shape.vertex_index)
            # Rounded to 0.01 mm.
            np.testing.assert_allclose(written.vertex, shape.vertex, atol=2e-5)
