import copy

import numpy as np
import pytest

from arm_drake.control.tolerances import (
    StateTolerances,
    describe_violation,
    exceeds,
    make_default_tolerances,
    resolve_tolerances,
    violates,
)
from arm_drake.messages import FollowJointTrajectoryGoal, JointTolerance

JOINTS = ("joint1", "joint2", "joint3")
DEFAULTS = make_default_tolerances(
    [0.1] * 3, [0.1] * 3, stopped_velocity_tolerance=0.1, goal_time=0.1
)


def make_goal(path=(), goal=(), goal_time=0.0) -> FollowJointTrajectoryGoal:
    return FollowJointTrajectoryGoal(
        path_tolerance=[JointTolerance(*tolerance) for tolerance in path],
        goal_tolerance=[JointTolerance(*tolerance) for tolerance in goal],
        goal_time_tolerance=goal_time,
    )


def table(tolerances: StateTolerances) -> list[list[float]]:
    fields = (tolerances.position, tolerances.velocity, tolerances.acceleration)
    return np.stack(fields, axis=1).tolist()


def test_a_goal_s_tolerances_follow_their_joint_names():
    goal = make_goal(
        path=[(joint, 0.2, 0.3, 0.4) for joint in JOINTS],
        goal=[
            ("joint2", 1.2, 2.2, 3.2),
            ("joint3", 1.3, 2.3, 3.3),
            ("joint1", 1.1, 2.1, 3.1),
        ],
        goal_time=2.0,
    )

    tolerances, problem = resolve_tolerances(goal, JOINTS, DEFAULTS)

    assert problem == ""
    assert tolerances.goal_time == 2.0
    assert table(tolerances.path) == [[0.2, 0.3, 0.4]] * 3
    assert table(tolerances.goal) == [[1.1, 2.1, 3.1], [1.2, 2.2, 3.2], [1.3, 2.3, 3.3]]


def test_a_goal_without_tolerances_has_the_very_defaults():
    tolerances, problem = resolve_tolerances(make_goal(), JOINTS, DEFAULTS)

    assert problem == ""
    assert tolerances is DEFAULTS


def test_minus_one_takes_every_tolerance_away():
    erased = [(joint, -1, -1, -1) for joint in JOINTS]
    goal = make_goal(path=erased, goal=erased, goal_time=-1)

    tolerances, problem = resolve_tolerances(goal, JOINTS, DEFAULTS)

    assert problem == ""
    assert tolerances.goal_time == 0.0
    assert table(tolerances.path) == table(tolerances.goal) == [[0, 0, 0]] * 3


@pytest.mark.parametrize(
    "goal",
    [
        make_goal(),
        make_goal(path=[("joint1",)], goal=[("joint3",)]),
        make_goal(path=[("joint1", float("nan"))]),
    ],
)
def test_what_a_goal_does_not_say_is_the_default(goal):
    tolerances, problem = resolve_tolerances(goal, JOINTS, DEFAULTS)

    assert problem == ""
    assert tolerances.goal_time == DEFAULTS.goal_time
    assert table(tolerances.path) == [[0.1, 0, 0]] * 3
    assert table(tolerances.goal) == [[0.1, 0.1, 0]] * 3


EXPECTED = "expected a positive number, 0 (the default) or -1 (no limit), got "
KNOWN = "known: joint1, joint2, joint3"


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        (make_goal(goal_time=-123), f"goal_time_tolerance: {EXPECTED}-123.0"),
        (
            make_goal(path=[("joint1", -123)], goal_time=3),
            f"path_tolerance['joint1'].position: {EXPECTED}-123.0",
        ),
        (
            make_goal(path=[("joint1", 0, -123)], goal_time=3),
            f"path_tolerance['joint1'].velocity: {EXPECTED}-123.0",
        ),
        (
            make_goal(path=[("joint1", 0, 0, -123)], goal_time=3),
            f"path_tolerance['joint1'].acceleration: {EXPECTED}-123.0",
        ),
        (
            make_goal(goal=[("joint1", -123)], goal_time=3),
            f"goal_tolerance['joint1'].position: {EXPECTED}-123.0",
        ),
        (
            make_goal(goal=[("joint1", 0, -123)], goal_time=3),
            f"goal_tolerance['joint1'].velocity: {EXPECTED}-123.0",
        ),
        (
            make_goal(goal=[("joint1", 0, 0, -0.99)], goal_time=3),
            f"goal_tolerance['joint1'].acceleration: {EXPECTED}-0.99",
        ),
        (
            make_goal(path=[("joint2", 0.5), ("jiont2", 0.5)]),
            f"path_tolerance: no joint 'jiont2'; did you mean 'joint2'? {KNOWN}",
        ),
        (
            make_goal(path=[("joint2", 0.5)], goal=[("elbow", 0.5)]),
            f"goal_tolerance: no joint 'elbow'; {KNOWN}",
        ),
    ],
)
def test_one_invalid_tolerance_leaves_all_defaults(goal, message):
    tolerances, problem = resolve_tolerances(goal, JOINTS, DEFAULTS)

    assert tolerances is DEFAULTS
    assert problem == f"{message}; the controller's defaults hold"


def test_parameters_limit_positions_and_the_final_velocity():
    tolerances = make_default_tolerances(
        [1, 2, 3], [10, 20, 30], stopped_velocity_tolerance=0.02, goal_time=1.0
    )

    assert tolerances.goal_time == 1.0
    assert table(tolerances.path) == [[1, 0, 0], [2, 0, 0], [3, 0, 0]]
    assert table(tolerances.goal) == [[10, 0.02, 0], [20, 0.02, 0], [30, 0.02, 0]]


@pytest.mark.parametrize(
    ("tolerance", "error", "violated"),
    [
        (0.1, 0.1, False),
        (0.1, -0.1, False),
        (0.1, 0.1000001, True),
        (0.1, -0.1000001, True),
        (0.1, float("nan"), False),
        (0.0, 1e9, False),
        (-1.0, 1e9, False),
    ],
)
@pytest.mark.parametrize("field", [0, 1, 2])
def test_an_error_must_exceed_a_tolerance_to_violate_it(
    field, tolerance, error, violated
):
    tolerances = [np.zeros(1)] * 3
    errors = [np.zeros(1)] * 3
    tolerances[field] = np.array([tolerance])
    errors[field] = np.array([error])

    assert violates(*errors, StateTolerances(*tolerances)).tolist() == [violated]


def test_each_joint_has_its_own_tolerance():
    tolerances = StateTolerances(np.array([0.1, 0.0, 0.3]), np.zeros(3), np.zeros(3))

    violated = violates(np.array([0.2, 0.2, 0.2]), None, None, tolerances)

    assert violated.tolist() == [True, False, False]


def test_errors_that_are_not_measured_are_not_checked():
    tolerances = StateTolerances(np.zeros(1), np.array([0.1]), np.array([0.1]))

    assert violates(np.array([9.0]), None, None, tolerances).tolist() == [False]


def test_tolerances_can_not_change():
    position = np.array([0.1])
    tolerances = StateTolerances(position, np.zeros(1), np.zeros(1))

    position[0] = 5.0

    assert tolerances.position == [0.1]
    assert not tolerances.position.flags.writeable
    assert copy.deepcopy(tolerances) is tolerances


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ((0.1, 0.2, 0.0), False),
        ((0.1, 0.1, 0.3), False),
        ((0.1001, 0.0, 0.0), True),
        ((0.0, 0.2001, 0.0), True),
        ((-0.1001, 0.0, 0.0), True),
        # The third joint is not checked; NaN never violates.
        ((0.0, 0.0, 100.0), False),
        ((np.nan, 0.0, 0.0), False),
        ((np.nan, 0.3, 0.0), True),
    ],
)
def test_exceeding_is_violating_for_any_joint(error, expected):
    tolerances = StateTolerances([0.1, 0.2, 0.0], [0.0] * 3, [0.0] * 3)
    position = np.array(error)

    assert exceeds(position, None, None, tolerances) is expected
    assert violates(position, None, None, tolerances).any() == expected


def test_exceeding_looks_at_velocities_too():
    tolerances = StateTolerances([0.1], [0.2], [0.0])
    there = np.zeros(1)

    assert exceeds(there, np.array([0.3]), None, tolerances)
    assert not exceeds(there, np.array([0.1]), None, tolerances)
    assert not exceeds(there, None, None, tolerances)


def test_nothing_exceeds_tolerances_that_check_nothing():
    tolerances = StateTolerances([0.0], [0.0], [0.0])

    assert not exceeds(np.array([1e9]), np.array([1e9]), None, tolerances)


@pytest.mark.parametrize("error", [0.0, 0.04, 0.0999, 0.1001, np.nan])
def test_what_is_allowed_in_plain_numbers_never_exceeds(error):
    zeros = np.zeros(3)
    tolerances = StateTolerances(np.array([0.1, 0.2, 0.0]), zeros, zeros)
    errors = np.array([error, 0.0, 0.0])

    is_allowed = tolerances.allows(errors.tolist())
    assert is_allowed == (error < 0.1)
    assert not (is_allowed and violates(errors, None, None, tolerances).any())


@pytest.mark.parametrize(
    ("position", "velocity", "text"),
    [
        (
            [0.0, -0.5, 0.0],
            None,
            "position of 'joint2' is off by 0.5 rad, its path tolerance is 0.1 rad",
        ),
        # Five times the tolerance of a velocity is more than twice that of a position.
        (
            [0.2, 0.0, 0.0],
            [0.0, 0.0, 1.0],
            "velocity of 'joint3' is off by 1 m/s, its path tolerance is 0.2 m/s; "
            "1 other joint too",
        ),
        ([0.05, 0.0, np.nan], [0.0, 0.1, 0.0], ""),
    ],
)
def test_the_joint_furthest_beyond_its_tolerance_is_described(position, velocity, text):
    tolerances = StateTolerances(np.full(3, 0.1), np.full(3, 0.2), np.zeros(3))
    errors = (np.array(position), velocity and np.array(velocity), None)

    described = describe_violation(
        errors, tolerances, "path", JOINTS, np.array([False, False, True])
    )

    assert described == text
