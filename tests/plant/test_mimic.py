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
