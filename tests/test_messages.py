"""Messages: the fields of ROS, frozen, and copied as themselves."""

import copy
import dataclasses as dc
import math

import numpy as np
import pytest

from arm_drake.messages import (
    CancelGoal,
    Duration,
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryGoal,
    GoalStatus,
    JointState,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    SendGoal,
    SwitchController,
    Time,
)

TIME = "expected seconds or {sec: int, nanosec: int}"


@pytest.mark.parametrize(
    ("value", "sec", "nanosec"),
    [
        (0, 0, 0),
        (1.5, 1, 500_000_000),
        (0.1, 0, 100_000_000),
        # As in builtin_interfaces: nanosec is never negative.
        (-0.25, -1, 750_000_000),
        (1e-10, 0, 0),
        (np.float64(2.0), 2, 0),
        (np.int64(2), 2, 0),
        ({"sec": 2, "nanosec": 3}, 2, 3),
        ({"sec": 2}, 2, 0),
        ({"nanosec": 1_500_000_000}, 1, 500_000_000),
        (Time(2, 3), 2, 3),
        (Duration(2, 3), 2, 3),
    ],
)
@pytest.mark.parametrize("kind", [Time, Duration])
def test_a_time_is_made_of_what_stands_for_one(kind, value, sec, nanosec):
    time = kind.of(value)

    assert type(time) is kind
    assert (time.sec, time.nanosec) == (sec, nanosec)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("1", "'1'"),
        (None, "None"),
        (True, "True"),
        (math.nan, "nan"),
        (math.inf, "inf"),
        ([1], "[1]"),
        ({"sec": 1.0}, "{'sec': 1.0}"),
        ({"sec": True}, "{'sec': True}"),
        ({"secs": 1}, "{'secs': 1}"),
    ],
)
def test_anything_else_is_no_time(value, shown):
    with pytest.raises(ValueError, match="expected seconds") as caught:
        Duration.of(value)

    assert str(caught.value) == f"{TIME}, got {shown}"


def test_a_time_converts_to_seconds_and_nanoseconds():
    assert Time(1, 500_000_000).to_seconds() == 1.5
    assert Time(-1, 750_000_000).to_nanoseconds() == -250_000_000
    assert Time.from_nanoseconds(-250_000_000) == Time(-1, 750_000_000)


def test_times_are_ordered():
    assert Time(0, 5) < Time(1, 0) < Time(1, 1)


@pytest.mark.parametrize(
    "message",
    [
        Time(1),
        JointState(name=("a",)),
        JointTrajectory(),
        FollowJointTrajectoryGoal(),
        JointTrajectoryControllerState(),
        SendGoal(FollowJointTrajectoryGoal()),
    ],
)
def test_a_message_never_changes_and_copies_as_itself(message):
    assert copy.copy(message) is message
    assert copy.deepcopy([message])[0] is message
    with pytest.raises(dc.FrozenInstanceError):
        setattr(message, dc.fields(message)[0].name, None)


def test_a_point_takes_sequences_and_seconds():
    point = JointTrajectoryPoint(
        positions=[1, 2],
        velocities=np.array([3.0, 4.0]),
        accelerations=(5,),
        effort=range(2),
        time_from_start=0.5,
    )

    assert point == JointTrajectoryPoint(
        (1.0, 2.0), (3.0, 4.0), (5.0,), (0.0, 1.0), Duration(0, 500_000_000)
    )
    assert [type(value) for value in (*point.positions, *point.velocities)] == [
        float
    ] * 4


@pytest.mark.parametrize(
    "field", ["positions", "velocities", "accelerations", "effort"]
)
@pytest.mark.parametrize(
    ("values", "shown"), [(["1"], "['1']"), ([True], "[True]"), ("1", "['1']")]
)
def test_a_point_refuses_what_is_no_number(field, values, shown):
    with pytest.raises(ValueError, match="expected numbers") as caught:
        JointTrajectoryPoint(**{field: values})

    assert str(caught.value) == f"{field}: expected numbers, got {shown}"


def test_a_tolerance_refuses_what_is_no_number():
    with pytest.raises(ValueError, match="expected numbers") as caught:
        JointTolerance("a", velocity="1")

    assert str(caught.value) == "velocity: expected numbers, got ['1']"


def test_a_tolerance_takes_integers():
    tolerance = JointTolerance("a", position=1, velocity=-1)

    assert (tolerance.position, tolerance.velocity) == (1.0, -1.0)
    assert type(tolerance.position) is float


def test_a_trajectory_and_a_goal_take_lists():
    point = JointTrajectoryPoint([1.0])
    trajectory = JointTrajectory(joint_names=["a"], points=[point])
    goal = FollowJointTrajectoryGoal(
        trajectory, [JointTolerance("a")], [JointTolerance("b")], 1.5
    )

    assert trajectory.joint_names == ("a",)
    assert trajectory.points == (point,)
    assert goal.path_tolerance == (JointTolerance("a"),)
    assert goal.goal_tolerance == (JointTolerance("b"),)
    assert goal.goal_time_tolerance == Duration(1, 500_000_000)


def test_equal_goals_sent_twice_are_two_requests():
    goal = FollowJointTrajectoryGoal()
    first, second = SendGoal(goal), SendGoal(goal)

    assert first != second
    assert CancelGoal(first) != CancelGoal(first)


def test_error_codes_are_those_of_control_msgs():
    codes = {code.name: int(code) for code in FollowJointTrajectoryErrorCode}

    assert codes == {
        "SUCCESSFUL": 0,
        "INVALID_GOAL": -1,
        "INVALID_JOINTS": -2,
        "OLD_HEADER_TIMESTAMP": -3,
        "PATH_TOLERANCE_VIOLATED": -4,
        "GOAL_TOLERANCE_VIOLATED": -5,
    }


def test_a_goal_is_done_unless_it_waits_or_runs():
    running = {status for status in GoalStatus if not status.is_terminal}

    assert running == {GoalStatus.PENDING, GoalStatus.EXECUTING}


def test_a_switch_takes_sequences_of_names():
    request = SwitchController(["a"], (name for name in "bc"), "best_effort")

    assert request.activate_controllers == ("a",)
    assert request.deactivate_controllers == ("b", "c")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"activate_controllers": "abc"},
            "activate_controllers: expected names of controllers, got 'abc'",
        ),
        (
            {"activate_controllers": None},
            "activate_controllers: expected names of controllers, got None",
        ),
        (
            {"deactivate_controllers": [1]},
            "deactivate_controllers: expected names of controllers, got [1]",
        ),
        (
            {"strictness": "bogus"},
            "strictness: expected one of 'strict', 'best_effort', '', got 'bogus'",
        ),
        (
            {"strictness": [1]},
            "strictness: expected one of 'strict', 'best_effort', '', got [1]",
        ),
    ],
)
def test_a_switch_refuses_what_no_service_would_get(arguments, message):
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared.
        SwitchController(**arguments)

    assert str(caught.value) == message
