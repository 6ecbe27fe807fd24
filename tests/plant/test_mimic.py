"""Mimic joints are constraints: they hold under load, through chains and offsets."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from tests import models


def link(name: str, mass: float) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/>'
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
        "</inertial></link>"
    )


def joint(name: str, kind: str, parent: str, axis: str, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}_link"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="200" velocity="5"/>{more}</joint>'
        + link(f"{name}_link", 2.0)
    )


# The master turns about a vertical axis and bears no weight. One follower slides up and
# down with 2 kg of its own and those of the next, which follows it, the other way.
URDF = (
    '<robot name="lift"><link name="base"/>'
    + joint("crank", "revolute", "base", "0 0 1")
    + joint(
        "slide",
        "prismatic",
        "base",
        "0 0 1",
        '<mimic joint="crank" multiplier="0.5" offset="0.1"/>',
    )
    + joint(
        "tip",
        "prismatic",
        "slide_link",
        "0 0 1",
        '<mimic joint="slide" multiplier="-1.5"/>',
    )
    + "</robot>"
)


def expected_positions(crank: np.ndarray) -> np.ndarray:
    slide = 0.5 * crank + 0.1
    return np.stack([crank, slide, -1.5 * slide], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("time_step", "tolerance"),
    # The constraint is compliant: its error grows with the square of the step.
    [(1e-3, 2e-5), (5e-3, 5e-4)],
)
def test_followers_hold_under_their_weight_at_rest_and_in_motion(
    tmp_path: Path, time_step: float, tolerance: float
) -> None:
    robot = models.load(
        tmp_path,
        URDF,
        models.trajectory_controllers({"arm": ["crank"]}),
        initial_positions={"crank": 0.3},
    )
    options = ad.SimulationOptions(time_step=time_step)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(1.0)
    simulation.controller("arm").send_goal(
        ad.JointTrajectory(
            joint_names=("crank",),
            points=(ad.JointTrajectoryPoint(positions=(-0.5,), time_from_start=1.0),),
        )
    )
    simulation.advance_to(3.0)

    rollout = simulation.rollout()
    assert rollout.joint_names == ("crank", "slide", "tip")
    crank = rollout.position[:, 0]
    np.testing.assert_allclose(
        rollout.position, expected_positions(crank), atol=tolerance
    )
    # The master carries it all: virtual work gives its effort.
    weight = 9.81 * 2.0
    by_slide, by_tip = 0.5 * 2.0 * weight, -0.75 * weight
    assert rollout.effort[-1, 0] == pytest.approx(by_slide + by_tip, rel=1e-3)
    assert crank[99] == pytest.approx(0.3, abs=1e-4)
    assert crank[-1] == pytest.approx(-0.5, abs=1e-3)


def jaws(limit: str, mimic: str, axis: str = "0 1 0") -> str:
    """Return a gripper whose second finger follows the first."""
    finger = (
        '<joint name="{name}" type="prismatic"><parent link="palm"/>'
        '<child link="{name}_link"/><axis xyz="{axis}"/>{limit}{more}</joint>'
    )
    first = finger.format(
        name="left",
        axis="0 1 0",
        limit='<limit lower="0" upper="0.02" effort="50" velocity="1"/>',
        more="",
    )
    second = finger.format(name="right", axis=axis, limit=limit, more=mimic)
    links = link("left_link", 0.1) + link("right_link", 0.1)
    return f'<robot name="jaws"><link name="palm"/>{first}{second}{links}</robot>'


SAME_SIDE = '<limit lower="0" upper="0.02" effort="50" velocity="1"/>'
OPPOSITE = '<mimic joint="left" multiplier="-1"/>'


def test_limits_of_a_follower_dont_stop_its_master(tmp_path: Path) -> None:
    # Both fingers have the limits of the first, and the second goes the other way.
    robot = models.load(
        tmp_path,
        jaws(SAME_SIDE, OPPOSITE),
        models.trajectory_controllers({"gripper": ["left"]}),
    )
    simulation = ad.Simulation(ad.build_diagram(robot))
    point = ad.JointTrajectoryPoint(positions=(0.015,), time_from_start=0.5)
    simulation.controller("gripper").send_goal(
        ad.JointTrajectory(joint_names=("left",), points=(point,))
    )
    simulation.advance_to(1.0)

    assert simulation.rollout().position[-1] == pytest.approx([0.015, -0.015], abs=1e-4)


@pytest.mark.parametrize(
    ("limit", "mimic", "severity", "told", "done"),
    [
        (
            SAME_SIDE,
            OPPOSITE,
            "warning",
            "limits of 0 to 0.02 would stop 'left', which takes it from -0.02 to 0",
            "it follows beyond them",
        ),
        (
            '<limit lower="0" upper="0.0199" effort="50" velocity="1"/>',
            '<mimic joint="left"/>',
            "info",
            "limits of 0 to 0.0199 would stop 'left', which takes it from 0 to 0.02",
            "it follows beyond them",
        ),
        (
            SAME_SIDE,
            '<mimic joint="left" multiplier="0" offset="0.03"/>',
            "warning",
            "it stands at 0.03, beyond its limits of 0 to 0.02",
            "they don't hold it",
        ),
    ],
)
def test_it_is_told_that_a_follower_goes_beyond_its_limits(
    tmp_path: Path, limit: str, mimic: str, severity: str, told: str, done: str
) -> None:
    robot = models.load(tmp_path, jaws(limit, mimic))

    (entry,) = [each for each in robot.report if each.where == "joint 'right'"]
    assert (entry.severity, entry.what, entry.done) == (severity, told, done)


def test_limits_that_a_follower_keeps_are_left(tmp_path: Path) -> None:
    limit = '<limit lower="-0.02" upper="0.01" effort="50" velocity="1"/>'
    robot = models.load(tmp_path, jaws(limit, OPPOSITE))

    assert not any("would stop" in entry.what for entry in robot.report)
    (follower,) = [j for j in robot.description.joints if j.name == "right"]
    assert (follower.limits.lower, follower.limits.upper) == (-0.02, 0.01)


def test_a_follower_of_a_master_without_limits_has_none(tmp_path: Path) -> None:
    gear = '<mimic joint="crank" multiplier="-2"/>'
    limited = joint("gear", "revolute", "base", "0 0 1", gear)
    urdf = '<robot name="gears"><link name="base"/>'
    urdf += joint("crank", "continuous", "base", "0 0 1") + limited + "</robot>"
    robot = models.load(tmp_path, urdf, models.trajectory_controllers({"c": ["crank"]}))
    simulation = ad.Simulation(ad.build_diagram(robot))
    point = ad.JointTrajectoryPoint(positions=(3.0,), time_from_start=1.0)
    simulation.controller("c").send_goal(
        ad.JointTrajectory(joint_names=("crank",), points=(point,))
    )
    simulation.advance_to(1.5)

    assert simulation.rollout().position[-1] == pytest.approx([3.0, -6.0], abs=1e-3)
