"""Robots of example-robot-data, by their names."""

import importlib.metadata

import pytest

import arm_drake as ad
from arm_drake.description import entry as examples
from arm_drake.errors import DescriptionError, MissingExtraError
from arm_drake.messages import Duration

# Upwards, away from the ground.
GOAL = (0.1, -0.5, 0.1, 0.1, 0.1, 0.1)


def test_every_description_of_the_package_has_a_name():
    names = examples.example_robots()

    assert {"ur5_robot", "panda", "tiago", "so101", "pr2", "z1", "xarm7"} <= set(names)
    # Two files are called anymal.urdf.
    assert {"anymal_b_simple/anymal", "anymal_c_simple/anymal"} <= set(names)
    assert len(names) == 68
    assert all(path.is_file() for path in names.values())


@pytest.mark.slow
def test_an_example_is_loaded_with_a_controller_of_all_its_joints(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path))

    robot = ad.load_robot("example:ur5_robot")

    joints = [joint.name for joint in robot.description.movable_joints]
    assert len(joints) == 6
    assert [c.name for c in robot.controllers.controllers] == [
        "joint_state_broadcaster",
        "joint_trajectory_controller",
    ]
    simulation = ad.Simulation(ad.build_diagram(robot))
    goal = simulation.controller("joint_trajectory_controller").send_goal(
        ad.JointTrajectory(
            joint_names=tuple(joints),
            points=(
                ad.JointTrajectoryPoint(
                    positions=GOAL, time_from_start=Duration(sec=1)
                ),
            ),
        )
    )
    simulation.advance_to(2.0)
    assert goal.status is ad.GoalStatus.SUCCEEDED
    assert simulation.rollout().position[-1] == pytest.approx(GOAL, abs=1e-3)
    assert not robot.report.errors
    lines = [entry for entry in robot.report if "neither" in entry.what]
    assert [entry.done for entry in lines] == [
        "one joint_trajectory_controller moves its 6 independent joints"
    ]


def test_an_unknown_example_is_named_with_the_nearest():
    with pytest.raises(DescriptionError) as caught:
        ad.load_robot("example:pandda")

    assert str(caught.value).startswith(
        "unknown example 'pandda'; did you mean 'panda'? known: panda, panda_"
    )


def test_without_the_package_the_extra_is_named(monkeypatch):
    def nothing(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", nothing)

    assert examples.example_robots() == {}
    with pytest.raises(MissingExtraError) as caught:
        ad.load_robot("example:panda")
    assert str(caught.value) == (
        "example-robot-data needs `pip install 'arm-drake[robots]'`"
    )


def test_an_example_is_proposed_to_whom_names_it_without_its_prefix():
    with pytest.raises(DescriptionError, match=r"and as examples .*:ur5_robot'"):
        examples.find_entry("ur5")
