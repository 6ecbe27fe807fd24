"""Replays the tolerances that upstream resolves and checks."""

from typing import Any

import numpy as np
import pytest

from arm_drake.control.tolerances import (
    StateTolerances,
    exceeds,
    make_default_tolerances,
    resolve_tolerances,
    violates,
)
from arm_drake.messages import FollowJointTrajectoryGoal, JointTolerance
from tests.conformance.oracle_files import read_files
from tests.oracle import number, oracle_cases

NAMES = ("goal_tolerance_resolution", "state_tolerance_check")
FILES = read_files(NAMES)
RESOLUTIONS = FILES.get("goal_tolerance_resolution", [])
CHECKS = FILES.get("state_tolerance_check", [])


def make_tolerance(tolerance: dict[str, Any]) -> JointTolerance:
    limits = {f: number(value) for f, value in tolerance.items() if f != "name"}
    return JointTolerance(tolerance["name"], **limits)


def make_goal(goal: dict[str, Any]) -> FollowJointTrajectoryGoal:
    return FollowJointTrajectoryGoal(
        path_tolerance=[make_tolerance(t) for t in goal["path_tolerance"]],
        goal_tolerance=[make_tolerance(t) for t in goal["goal_tolerance"]],
        goal_time_tolerance=goal["goal_time_tolerance"],
    )


def table(tolerances: StateTolerances) -> list[list[float]]:
    fields = (tolerances.position, tolerances.velocity, tolerances.acceleration)
    return np.stack(fields, axis=1).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_a_file_has_cases(name: str) -> None:
    assert oracle_cases(name)


@pytest.mark.parametrize("case", RESOLUTIONS)
def test_goal_tolerances_resolve_as_upstream(case: dict[str, Any]) -> None:
    joints = case["input"]["params"]["joints"]
    constraints = case["input"]["params"].get("constraints", {})
    by_joint = [constraints.get(joint, {}) for joint in joints]
    defaults = make_default_tolerances(
        [number(of_joint.get("trajectory", 0.0)) for of_joint in by_joint],
        [number(of_joint.get("goal", 0.0)) for of_joint in by_joint],
        stopped_velocity_tolerance=number(
            constraints.get("stopped_velocity_tolerance", 0.01)
        ),
        goal_time=number(constraints.get("goal_time", 0.0)),
    )

    resolved = resolve_tolerances(make_goal(case["input"]["goal"]), joints, defaults)

    pairs = (("default", defaults), ("active", resolved.tolerances))
    for key, tolerances in pairs:
        expected = case["output"][key]
        for ours, theirs in (
            (tolerances.path, expected["state"]),
            (tolerances.goal, expected["goal"]),
        ):
            np.testing.assert_array_equal(table(ours), np.array(theirs, dtype=float))
        goal_time = number(expected["goal_time"])
        assert tolerances.goal_time == pytest.approx(goal_time, rel=1e-12, nan_ok=True)


@pytest.mark.parametrize("case", CHECKS)
def test_errors_violate_tolerances_as_upstream(case: dict[str, Any]) -> None:
    limits = [np.array([number(limit)]) for limit in case["input"]["tol"]]
    tolerances = StateTolerances(*limits)

    allowed, not_exceeded = [], []
    for error in case["input"]["errors"]:
        fields = [None if e is None else np.array([number(e)]) for e in error]
        allowed.append(not violates(*fields, tolerances).any())
        not_exceeded.append(not exceeds(*fields, tolerances))

    assert not_exceeded == allowed
    assert allowed == case["output"]["ok"]
