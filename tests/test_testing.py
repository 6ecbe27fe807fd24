"""Asserts about a single run."""

import dataclasses as dc

import numpy as np
import pytest

import arm_drake as ad

JTC = "joint_trajectory_controller"


def simulate(duration: float) -> ad.Simulation:
    """Return a simulation of an arm with a goal that takes 1 s."""
    simulation = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    trajectory = ad.JointTrajectory(
        joint_names=tuple(f"joint{n}" for n in range(1, 7)),
        points=(ad.JointTrajectoryPoint(positions=(0.1,) * 6, time_from_start=1.0),),
    )
    goal = ad.FollowJointTrajectoryGoal(trajectory)
    simulation.controller(JTC).send_goal(goal)
    simulation.advance_to(duration)
    return simulation


@pytest.fixture(scope="module")
def simulation() -> ad.Simulation:
    return simulate(0.5)


def test_a_run_whose_goals_ended_well_has_succeeded() -> None:
    ad.testing.assert_succeeded(simulate(2.0))


def test_a_goal_that_has_not_ended_is_no_success(simulation: ad.Simulation) -> None:
    with pytest.raises(AssertionError, match=JTC):
        ad.testing.assert_succeeded(simulation)


def test_a_joint_that_is_off_is_named_with_time_and_error(
    simulation: ad.Simulation,
) -> None:
    rollout = simulation.rollout()
    ad.testing.assert_followed(rollout, JTC, within=0.01, saturation=0.0)
    position = rollout.position.copy()
    position[7, 2] = rollout.references[JTC].position[7, 2] + 0.5

    with pytest.raises(AssertionError) as caught:
        ad.testing.assert_followed(
            dc.replace(rollout, position=position), JTC, within=0.01
        )

    assert str(caught.value) == (
        f"joint 'joint3': tracking error 0.5 at {rollout.time[7]:.4g} s; expected at "
        "most 0.01"
    )


def test_a_joint_at_its_limit_is_named_with_time(simulation: ad.Simulation) -> None:
    rollout = simulation.rollout()
    effort = np.zeros_like(rollout.effort)
    effort[5:8, 1] = rollout.effort_limit[1]
    row = rollout.time[1] - rollout.time[0]

    with pytest.raises(AssertionError) as caught:
        ad.testing.assert_followed(
            dc.replace(rollout, effort=effort), JTC, within=0.01, saturation=row
        )

    assert str(caught.value) == (
        f"joint 'joint2': at its effort limit for {3 * row:.4g} s, first at "
        f"{rollout.time[5]:.4g} s; expected at most {row:g} s"
    )
