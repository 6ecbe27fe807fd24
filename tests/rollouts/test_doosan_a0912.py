"""The main job: the Doosan A0912 follows the tutorial's trajectory, in physics."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.bundled import bundled_motions, models_folder
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


@pytest.fixture(params=["as published", "bundled"])
def source(request) -> str:
    return "doosan_a0912" if request.param == "bundled" else str(real_robot(REAL))


def follow_tutorial(robot: ad.Robot, **options) -> tuple[ad.Simulation, ad.Rollout]:
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    diagram = ad.build_diagram(robot, options=ad.SimulationOptions(**options))
    sim = ad.Simulation(diagram)
    sim.run(motion.duration + 1.5, motion)
    return sim, sim.rollout()


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
    sim, rollout = follow_tutorial(ad.load_robot(source))

    np.testing.assert_allclose(rollout.position[-1], GOAL, rtol=0.0, atol=2e-3)
    (goal,) = sim.goals
    assert goal.status is ad.GoalStatus.SUCCEEDED
    assert goal.result.error_code == 0


def test_the_arm_tracks_the_trajectory_within_15_mrad(source):
    _, rollout = follow_tutorial(ad.load_robot(source))

    error = rollout.tracking_error(JTC)
    assert np.isfinite(error[:-1]).all()
    assert np.abs(error[:-1]).max() <= 15e-3
    # Half-way between the tutorial's points, the straight line between them.
    (row,) = np.flatnonzero(np.isclose(rollout.time, 3.0))
    np.testing.assert_allclose(rollout.references[JTC].position[row], GOAL / 2)


def test_efforts_stay_within_the_limits_of_the_description(source):
    _, rollout = follow_tutorial(ad.load_robot(source))

    limits = [411.0, 411.0, 194.0, 50.0, 50.0, 50.0]  # N·m, as published
    assert rollout.effort_limit.tolist() == limits
    assert (np.abs(rollout.effort) <= limits).all()
    # The arm does work: the shoulder carries what lies beyond it.
    assert np.abs(rollout.effort).max() > 10.0


@pytest.mark.parametrize("pose", POSES)
def test_without_a_command_the_arm_holds_its_pose(source, pose):
    initial = {f"joint{i}": angle for i, angle in enumerate(pose, start=1)}
    robot = ad.load_robot(source, initial_positions=initial)
    sim = ad.Simulation(ad.build_diagram(robot))

    sim.advance_to(10.0)

    position = sim.rollout().position
    np.testing.assert_allclose(position[0], pose, rtol=0.0, atol=1e-12)
    assert np.abs(position - pose).max() <= 1e-3


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
    assert (np.abs(rollout.effort) <= 5.0).all()
    assert rollout.position[-1, 1] > 1.3  # rad: it fell
    seconds = rollout.effort_saturation()
    assert seconds["joint2"] > 1.0
    assert set(seconds) <= set(rollout.joint_names)


def saves(suffix: str) -> Callable[[Path], bytes]:
    def save(folder: Path) -> bytes:
        _, rollout = follow_tutorial(ad.load_robot("doosan_a0912"))
        path = folder / f"run{suffix}"
        rollout.save(path)
        return path.read_bytes()

    return save


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_two_runs_write_the_same_bytes(tmp_path, suffix):
    save = saves(suffix)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    assert save(tmp_path / "a") == save(tmp_path / "b")


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
