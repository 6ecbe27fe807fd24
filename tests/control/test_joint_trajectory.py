import dataclasses as dc
from collections.abc import Sequence
from math import inf, pi

import numpy as np
import pytest

from arm_drake.controllers.joint_trajectory.controller import tick
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
)
from arm_drake.messages import (
    CancelGoal,
    FollowJointTrajectoryResult,
    GoalStatus,
    JointTolerance,
    TopicRejected,
)
from arm_drake.messages.base import NUM_KEPT
from tests.control.joint_trajectory_runs import (
    JOINTS,
    PERIOD_NS,
    START,
    commands,
    feedback,
    lag,
    make_goal,
    make_message,
    make_rules,
    news,
    references,
    run,
    stick,
)

SUCCEEDED = FollowJointTrajectoryResult(0, "Goal successfully reached!")
CANCELED = FollowJointTrajectoryResult(0, "")
PREEMPTED = FollowJointTrajectoryResult(
    -1, "Current goal preempted by new incoming action."
)
OFF_PATH = FollowJointTrajectoryResult(-4, "Aborted due to path tolerance violation")


def test_the_joints_are_held_where_they_are_at_activation() -> None:
    def sag(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
        return measured - 0.01

    states = run(make_rules(), 0.25, plant=sag)

    assert (commands(states) == START).all()
    assert (references(states) == START).all()
    np.testing.assert_allclose(states[-1].error, 0.25, rtol=1e-12)
    assert states[-1].desired.velocity.tolist() == [0.0] * 3


def test_commands_look_ahead_by_one_period() -> None:
    message = make_message((0.5, (2.1, 2.1, 2.1)))

    states = run(make_rules(), 0.8, topic={0.1: message})

    t = np.arange(81) / 100
    progress = ((t - 0.1) / 0.5).clip(0.0, 1.0)[:, None]
    ahead = np.where(t < 0.1, 0.0, (t - 0.09) / 0.5).clip(0.0, 1.0)[:, None]
    way = np.array([1.0, 0.0, -1.0])
    np.testing.assert_allclose(references(states), START + progress * way, rtol=1e-9)
    np.testing.assert_allclose(commands(states), START + ahead * way, rtol=1e-9)


@pytest.mark.parametrize(("velocity", "v_0"), [(None, 0.0), ((0.5, 0.5, 0.5), 0.5)])
def test_points_with_velocities_are_joined_by_cubics(
    velocity: Sequence[float] | None, v_0: float
) -> None:
    message = make_message((1.0, (2.1, 3.1, 4.1)), velocities=(0.0, 0.0, 0.0))

    states = run(make_rules(), 0.5, velocity=velocity, topic={0.0: message})

    # Hermite polynomial from (0, v_0) to (1, 0).
    t = (np.arange(51) / 100)[:, None]
    hermite = (t**3 - 2 * t**2 + t) * v_0 + 3 * t**2 - 2 * t**3
    np.testing.assert_allclose(references(states), START + hermite, rtol=1e-9)


def test_interpolation_none_jumps_from_point_to_point() -> None:
    message = make_message((0.1, (1.0, 1.0, 1.0)), (0.2, (2.0, 2.0, 2.0)))

    states = run(make_rules(interpolation="none"), 0.3, topic={0.0: message})

    first = references(states)[:, 0].tolist()
    assert first == [1.1] * 10 + [2.0] * 21


def test_a_goal_succeeds_one_period_early_and_its_monitor_says_so() -> None:
    goal = make_goal(make_message((0.2, (2.0, 2.0, 2.0)), (0.5, (1.0, 2.0, 3.0))))

    states = run(make_rules(), 0.8, requests={0.03: goal})

    # At 0.52 s the look-ahead reaches the end; the monitor looks every 0.05 s.
    assert news(states, goal) == [
        (3, GoalStatus.EXECUTING, None),
        (53, GoalStatus.SUCCEEDED, SUCCEEDED),
    ]
    assert states[51].goal.outcome is None
    assert states[52].goal.outcome is not None
    assert commands(states)[-1].tolist() == [1.0, 2.0, 3.0]
    assert len(states[-1].plan.trajectory.times_ns) == 1


def test_a_goal_succeeds_as_soon_as_its_joints_are_close() -> None:
    goal = make_goal(make_message((0.1, (2.1, 3.1, 4.1))))

    states = run(make_rules(goal=0.01), 0.5, plant=lag, requests={0.0: goal})

    errors = np.abs([s.error for s in states[9:]]).max(axis=1)
    done = 9 + int(np.argmax(errors <= 0.01))
    assert done > 9
    assert states[done - 1].goal.outcome is None
    assert states[done].goal.outcome.result == SUCCEEDED


def test_after_success_the_last_point_is_held_whatever_happens() -> None:
    def drift(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
        return measured + 0.01

    goal = make_goal(make_message((0.1, (1.2, 2.2, 3.2))))
    rules = make_rules(path=0.3, goal=0.1, goal_time=0.1, cmd_timeout=0.2)

    states = run(rules, 1.0, plant=drift, requests={0.0: goal})

    assert news(states, goal)[-1] == (10, GoalStatus.SUCCEEDED, SUCCEEDED)
    assert (commands(states[10:]) == (1.2, 2.2, 3.2)).all()


def test_after_success_the_velocity_of_the_last_point_is_kept() -> None:
    message = make_message((0.5, (1.0, 2.0, 3.0)), velocities=(1.0, 1.0, 1.0))
    rules = make_rules(allow=["nonzero_velocity_at_trajectory_end"])
    goal = make_goal(message)

    states = run(rules, 0.8, requests={0.0: goal})

    assert news(states, goal)[-1] == (50, GoalStatus.SUCCEEDED, SUCCEEDED)
    assert states[-1].desired.velocity.tolist() == [1.0] * 3
    assert references(states)[-1].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("first", [0.0, 0.1])
def test_beyond_a_path_tolerance_the_goal_aborts_and_the_joints_hold(
    first: float,
) -> None:
    message = make_message((first, (4.0, 5.0, 6.0)), (first + 0.1, (7.0, 8.0, 9.0)))
    goal = make_goal(message)

    states = run(make_rules(path=1e-4), 0.5, plant=stick, requests={0.1: goal})

    assert news(states, goal) == [
        (10, GoalStatus.EXECUTING, None),
        (15, GoalStatus.ABORTED, OFF_PATH),
    ]
    # Nothing is commanded in the tick that finds the violation.
    violation = 10 if first == 0.0 else 11
    assert states[violation].goal.outcome is not None
    assert (commands(states[violation + 1 :]) == START).all()
    before = commands(states)[violation - 1]
    assert (commands(states)[violation] == before).all()


def test_a_single_point_due_at_once_is_checked_on_its_path_too() -> None:
    goal = make_goal(make_message((0.0, (4.0, 5.0, 6.0))))

    states = run(make_rules(path=1e-4), 0.2, plant=stick, requests={0.0: goal})

    assert news(states, goal)[-1] == (5, GoalStatus.ABORTED, OFF_PATH)
    # Nothing is commanded in the tick that finds the violation.
    assert np.isnan(commands(states)[0]).all()
    assert (commands(states[1:]) == START).all()


def test_later_than_goal_time_the_goal_aborts_and_the_joints_hold() -> None:
    goal = make_goal(make_message((0.5, (4.0, 5.0, 6.0))))
    rules = make_rules(goal=0.1, goal_time=0.1)

    states = run(rules, 0.8, plant=stick, requests={0.0: goal})

    text = "Aborted due to goal_time_tolerance exceeding by 0.110000 seconds"
    result = FollowJointTrajectoryResult(-5, text)
    assert news(states, goal)[-1] == (65, GoalStatus.ABORTED, result)
    assert commands(states)[61].tolist() == [4.0, 5.0, 6.0]
    assert (commands(states[62:]) == START).all()


def test_a_goal_may_ask_for_more_time() -> None:
    message = make_message((0.0, (4.0, 5.0, 6.0)))
    goal = make_goal(message, goal_time_tolerance=1.0)
    rules = make_rules(goal=0.1, goal_time=1e-6)

    states = run(rules, 1.2, plant=stick, requests={0.0: goal})

    tick_of_result, status, result = news(states, goal)[-1]
    assert (tick_of_result, status) == (105, GoalStatus.ABORTED)
    assert result.error_string == (
        "Aborted due to goal_time_tolerance exceeding by 1.010000 seconds"
    )


def test_without_goal_time_a_goal_waits_for_ever() -> None:
    goal = make_goal(make_message((0.1, (4.0, 5.0, 6.0))))

    states = run(make_rules(goal=0.1), 20.0, plant=stick, requests={0.0: goal})

    assert news(states, goal) == [(0, GoalStatus.EXECUTING, None)]
    assert states[-1].goal is not None
    assert states[-1].goal.outcome is None
    assert commands(states)[-1].tolist() == [4.0, 5.0, 6.0]


def test_a_canceled_goal_holds_where_the_joints_were() -> None:
    goal = make_goal(make_message((1.0, (2.1, 3.1, 4.1))))

    states = run(
        make_rules(), 0.8, plant=lag, requests={0.0: goal, 0.52: CancelGoal(goal)}
    )

    assert news(states, goal) == [
        (0, GoalStatus.EXECUTING, None),
        (55, GoalStatus.CANCELED, CANCELED),
    ]
    assert (commands(states[52:]) == states[51].position).all()


def test_only_the_active_goal_can_be_canceled() -> None:
    done = make_goal(make_message((0.1, (1.0, 2.0, 3.0))))
    active = make_goal(make_message((1.0, (2.0, 3.0, 4.0))))

    states = run(
        make_rules(),
        1.4,
        requests={0.0: done, 0.3: active, 0.5: CancelGoal(done)},
    )

    assert news(states, done)[-1] == (10, GoalStatus.SUCCEEDED, SUCCEEDED)
    assert news(states, active)[-1] == (130, GoalStatus.SUCCEEDED, SUCCEEDED)


def test_a_goal_that_is_canceled_between_its_end_and_its_monitor_is_left_hanging() -> (
    None
):
    goal = make_goal(make_message((0.11, (1.0, 2.0, 3.0))))
    other = make_goal(make_message((0.1, (1.0, 2.0, 3.0))))

    states = run(
        make_rules(), 0.6, requests={0.0: goal, 0.12: CancelGoal(goal), 0.5: other}
    )

    assert news(states, goal) == [
        (0, GoalStatus.EXECUTING, None),
        (50, GoalStatus.CANCELED, CANCELED),
    ]
    assert commands(states)[-1].tolist() == [1.0, 2.0, 3.0]


def test_a_new_goal_preempts_the_old_one_at_once() -> None:
    old = make_goal(make_message((1.0, (2.1, 3.1, 4.1))))
    new = make_goal(make_message((0.5, (1.0, 2.0, 3.0))))

    states = run(make_rules(), 1.0, requests={0.0: old, 0.32: new})

    assert news(states, old) == [
        (0, GoalStatus.EXECUTING, None),
        (32, GoalStatus.ABORTED, PREEMPTED),
    ]
    # The new goal's monitor starts anew.
    assert news(states, new) == [
        (32, GoalStatus.EXECUTING, None),
        (82, GoalStatus.SUCCEEDED, SUCCEEDED),
    ]


def test_a_result_that_waits_for_its_monitor_is_lost_to_a_new_goal() -> None:
    first = make_goal(make_message((0.11, (1.0, 2.0, 3.0))))
    second = make_goal(make_message((0.5, (2.0, 3.0, 4.0))))

    states = run(make_rules(), 0.3, requests={0.0: first, 0.12: second})

    assert news(states, first)[-1] == (12, GoalStatus.CANCELED, CANCELED)


def test_a_rejected_goal_leaves_goal_and_motion_alone() -> None:
    message = make_message((0.5, (2.1, 3.1, 4.1)))
    goal, undisturbed = make_goal(message), make_goal(message)
    bad = make_goal(make_message((0.5, (1.0, 2.0))))

    states = run(make_rules(), 0.8, requests={0.0: goal, 0.2: bad})

    alone = run(make_rules(), 0.8, requests={0.0: undisturbed})
    text = "points[0].positions has 2 elements; expected 3, one per joint"
    result = FollowJointTrajectoryResult(-1, text)
    assert news(states, bad) == [(20, GoalStatus.REJECTED, result)]
    assert news(states, goal) == news(alone, undisturbed)
    assert news(states, goal)[-1][1] is GoalStatus.SUCCEEDED
    assert (commands(states) == commands(alone)).all()


def test_a_rejected_trajectory_on_the_topic_is_reported_once() -> None:
    good = make_message((0.5, (2.1, 3.1, 4.1)))
    bad = make_message()

    states = run(make_rules(), 0.8, topic={0.0: good, 0.2: bad})

    reason = "no points; a trajectory needs at least one"
    assert states[19].events == ()
    assert states[-1].events == ((0, TopicRejected(bad, reason)),)
    assert commands(states)[-1].tolist() == [2.1, 3.1, 4.1]


def test_trajectories_come_in_any_order_of_joints() -> None:
    joints = ("joint2", "joint3", "joint1")
    message = make_message((0.25, (2.0, 3.0, 1.0)), joints=joints)

    states = run(make_rules(), 0.3, topic={0.0: message})

    assert commands(states)[-1].tolist() == [1.0, 2.0, 3.0]


def test_joints_that_a_trajectory_leaves_out_stay_where_they_are_commanded() -> None:
    everywhere = make_message((0.0, (1.0, 2.0, 3.0)))
    partial = make_message(
        (0.25, (2.5, 1.5)), joints=("joint2", "joint1"), velocities=(0.0, 0.0)
    )
    rules = make_rules(allow=["partial_joints_goal"])

    states = run(rules, 0.5, plant=lag, topic={0.0: everywhere, 0.2: partial})

    assert commands(states)[-1].tolist() == [1.5, 2.5, 3.0]


def test_feedback_comes_at_the_monitor_s_rate_and_tells_of_the_tick_before() -> None:
    message = make_message((0.2, (4.0, 5.0, 6.0)), (0.3, (7.0, 8.0, 9.0)))
    goal = make_goal(message)

    states = run(
        make_rules(), 0.5, plant=lag, velocity=(0.1, 0.2, 0.3), requests={0.02: goal}
    )

    found = feedback(states)
    assert [k for k, _ in found] == [7, 12, 17, 22, 27]
    stamps = [f.header.stamp.to_nanoseconds() for _, f in found]
    assert stamps == [(k - 1) * PERIOD_NS for k, _ in found]
    # 0 until the first point, at 0.22 s, then 1.
    assert [f.index for _, f in found] == [0, 0, 0, 0, 1]
    seen, message = states[16], found[2][1]
    assert message.joint_names == JOINTS
    assert message.desired.time_from_start.to_nanoseconds() == 14 * PERIOD_NS
    # 14 of 20 ticks from the start to the first point.
    expected = np.array(START) + 0.7 * (np.array([4.0, 5.0, 6.0]) - START)
    np.testing.assert_allclose(message.desired.positions, expected, rtol=1e-9)
    assert message.actual.positions == tuple(seen.position)
    assert message.actual.velocities == (0.1, 0.2, 0.3)
    np.testing.assert_allclose(
        message.error.positions, expected - seen.position, rtol=1e-9
    )


def test_feedback_never_tells_of_before_its_goal() -> None:
    goal = make_goal(make_message((0.2, (1.0, 2.0, 3.0))))

    states = run(make_rules(monitor_period_ns=0), 0.1, requests={0.02: goal})

    found = feedback(states)
    assert [k for k, _ in found] == list(range(3, 11))
    assert found[0][1].header.stamp.to_nanoseconds() == 2 * PERIOD_NS


def test_after_cmd_timeout_the_joints_hold_where_they_are() -> None:
    message = make_message((0.1, (4.0, 5.0, 6.0)), (0.2, (7.0, 8.0, 9.0)))
    rules = make_rules(cmd_timeout=0.1)

    states = run(rules, 0.6, plant=stick, topic={0.0: message})

    # The last point is due at 0.2 s; 0.31 s is the first tick more than 0.1 s later.
    assert (commands(states[20:32]) == (7.0, 8.0, 9.0)).all()
    assert (commands(states[32:]) == START).all()
    assert len(states[-1].plan.trajectory.times_ns) == 1


def test_without_cmd_timeout_the_last_point_stays_commanded() -> None:
    message = make_message((0.1, (4.0, 5.0, 6.0)), (0.2, (7.0, 8.0, 9.0)))

    states = run(make_rules(), 2.0, plant=stick, topic={0.0: message})

    assert (commands(states[20:]) == (7.0, 8.0, 9.0)).all()
    assert len(states[-1].plan.trajectory.times_ns) == 2


def test_continuous_joints_take_the_short_way() -> None:
    rules = make_rules(("wheel", "arm"), wraparound=np.array([True, False]))
    message = make_message((1.0, (-3.0, -3.0)), joints=("wheel", "arm"))

    states = run(rules, 1.0, start=(3.0, 3.0), plant=stick, topic={0.0: message})

    half = states[50]
    # The wheel turns forwards through pi, by 2 pi - 6 in all; the arm goes back by 6.
    turn = (2 * pi - 6) / 2
    np.testing.assert_allclose(half.desired.position, [-3.0 - turn, 0.0], atol=1e-12)
    np.testing.assert_allclose(half.error, [turn, -3.0], rtol=1e-9)


@pytest.mark.parametrize(
    ("wraparound", "way", "error"),
    [
        (True, 1.5 * pi, -0.5 * pi),
        (True, 0.75 * pi, 0.75 * pi),
        (False, 1.5 * pi, 1.5 * pi),
    ],
)
def test_errors_of_continuous_joints_are_within_half_a_turn(
    wraparound: bool, way: float, error: float
) -> None:
    rules = make_rules(("joint1",), wraparound=np.array([wraparound]))
    message = make_message((0.0, (1.1 + way,)), joints=("joint1",))

    states = run(rules, 0.1, start=(1.1,), plant=stick, topic={0.0: message})

    np.testing.assert_allclose(states[-1].error, [error], rtol=1e-9)


@pytest.mark.parametrize(("desired", "start"), [(False, 0.7), (True, 1.0)])
def test_a_trajectory_starts_from_the_measured_or_the_desired_state(
    desired: bool, start: float
) -> None:
    def offset(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
        return command - 0.3

    rules = make_rules(("joint1",), interpolate_from_desired_state=desired)
    first = make_message((0.0, (1.0,)), joints=("joint1",))
    second = make_message((1.0, (2.0,)), joints=("joint1",))

    states = run(
        rules, 0.7, start=(0.7,), plant=offset, topic={0.0: first, 0.2: second}
    )

    # The last command is a tick old: so is the start of the motion from it.
    duration = 1.01 if desired else 1.0
    rate = (2.0 - start) / duration
    assert commands(states)[20, 0] == pytest.approx(
        start + rate * (duration - 0.99), rel=1e-9
    )
    assert commands(states)[70, 0] == pytest.approx(2.0 - 0.49 * rate, rel=1e-9)


def test_a_trajectory_of_the_future_is_approached_at_once() -> None:
    message = make_message((0.3, (4.1, 5.1, 6.1)), stamp=0.5)

    states = run(make_rules(), 1.0, topic={0.2: message})

    # From 0.2 s to 0.8 s.
    np.testing.assert_allclose(references(states)[50], np.add(START, 1.5), rtol=1e-9)
    np.testing.assert_allclose(references(states)[-1], np.add(START, 3.0), rtol=1e-9)


def test_a_stamp_in_the_past_starts_in_the_middle() -> None:
    message = make_message((0.2, (0.0, 0.0, 0.0)), (0.6, (4.0, 4.0, 4.0)), stamp=0.1)

    states = run(make_rules(), 0.6, topic={0.5: message})

    np.testing.assert_allclose(references(states)[50], 2.0, rtol=1e-9)


def test_a_topic_s_trajectory_off_its_path_is_held_without_news() -> None:
    message = make_message((0.1, (4.0, 5.0, 6.0)), (0.2, (7.0, 8.0, 9.0)))

    states = run(make_rules(path=1e-4), 0.5, plant=stick, topic={0.1: message})

    assert (commands(states[12:]) == START).all()
    assert len(states[-1].plan.trajectory.times_ns) == 1
    assert states[-1].events == ()


def test_a_topic_s_trajectory_too_late_is_held() -> None:
    message = make_message((0.1, (4.0, 5.0, 6.0)))
    rules = make_rules(goal=0.1, goal_time=0.1)

    states = run(rules, 0.5, plant=stick, topic={0.0: message})

    assert commands(states)[21].tolist() == [4.0, 5.0, 6.0]
    assert (commands(states[22:]) == START).all()


def test_a_topic_s_trajectory_that_is_reached_stays_commanded() -> None:
    message = make_message((0.1, (1.0, 2.0, 3.0)))
    rules = make_rules(goal=0.2, goal_time=0.1)

    states = run(rules, 0.5, plant=stick, topic={0.0: message})

    assert (commands(states[10:]) == (1.0, 2.0, 3.0)).all()


def test_path_tolerances_end_with_the_path() -> None:
    def slip_at_the_end(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
        return command - 0.5 * (command == (1.0, 2.0, 3.0))

    message = make_message((0.2, (1.0, 2.0, 3.0)))

    states = run(make_rules(path=0.2), 0.5, plant=slip_at_the_end, topic={0.0: message})

    np.testing.assert_allclose(states[-1].error, 0.5, rtol=1e-9)
    assert (commands(states[20:]) == (1.0, 2.0, 3.0)).all()


def test_holding_knows_no_tolerances() -> None:
    def drift(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
        return measured + 0.01

    rules = make_rules(path=1e-4, goal=1e-4, goal_time=1e-6, cmd_timeout=0.01)

    states = run(rules, 0.3, plant=drift)

    assert (commands(states) == START).all()


def test_a_topic_s_trajectory_takes_over_the_active_goal() -> None:
    goal = make_goal(make_message((1.0, (2.1, 3.1, 4.1))))
    message = make_message((0.2, (1.0, 2.0, 3.0)))

    states = run(make_rules(), 0.8, topic={0.3: message}, requests={0.0: goal})

    assert news(states, goal)[-1] == (50, GoalStatus.SUCCEEDED, SUCCEEDED)
    assert commands(states)[-1].tolist() == [1.0, 2.0, 3.0]


def test_a_message_is_taken_once_and_its_like_again() -> None:
    message = make_message((0.1, (1.0, 2.0, 3.0)))

    states = run(make_rules(), 0.6, topic={0.0: message, 0.3: dc.replace(message)})

    starts = [state.plan.trajectory.start_ns // PERIOD_NS for state in states]
    assert starts == [0] * 30 + [30] * 31


def test_every_trajectory_is_searched_from_its_start() -> None:
    points = [(t, (10 * t,) * 3) for t in (0.1, 0.2, 0.3)]
    first, second = make_message(*points), make_message(*points)

    states = run(make_rules(), 0.8, topic={0.0: first, 0.4: second})

    middle = references(states)[[15, 55]]
    np.testing.assert_allclose(middle, 1.5, rtol=1e-9)


def test_events_are_numbered_and_the_latest_are_kept() -> None:
    messages = {k / 100: make_message() for k in range(NUM_KEPT + 36)}

    states = run(make_rules(), (NUM_KEPT + 36) / 100, topic=messages)

    assert [number for number, _ in states[9].events] == list(range(10))
    last = [number for number, _ in states[-1].events]
    assert last == list(range(36, 36 + NUM_KEPT))


@pytest.mark.parametrize(("is_pinned", "last"), [(True, 1.0), (False, 0.94)])
def test_a_look_ahead_beyond_the_end_makes_a_short_next_tick_see_the_end_in_jazzy(
    is_pinned: bool, last: float
) -> None:
    rules = make_rules(("joint1",), goal=inf, is_cursor_pinned=is_pinned)
    message = make_message((0.0, (0.0,)), (0.1, (1.0,)), joints=("joint1",))
    state = JointTrajectoryState()
    measured = np.array([0.0])
    last_ms = 0

    seen = []
    for ms, messages in ((0, (message,)), (90, ()), (94, ())):
        inputs = TickInputs(
            ms * 1_000_000, (ms - last_ms) * 1_000_000, measured, topics=messages
        )
        state = tick(rules, state, inputs)
        seen.append(float(state.desired.position[0]))
        last_ms = ms

    # There the search for the segment doesn't go back.
    np.testing.assert_allclose(seen, [0.0, 0.9, last], atol=1e-12)


def test_ticks_change_no_state_that_was_before() -> None:
    goal = make_goal(make_message((0.1, (1.0, 2.0, 3.0)), (0.3, (2.0, 3.0, 4.0))))
    states = run(make_rules(), 0.2, requests={0.0: goal})
    rules, inputs = (
        make_rules(),
        TickInputs(21 * PERIOD_NS, PERIOD_NS, np.array(START)),
    )

    once, again = tick(rules, states[-1], inputs), tick(rules, states[-1], inputs)

    assert commands([once]).tolist() == commands([again]).tolist()
    assert once.clock_ns == again.clock_ns
    assert states[-1].clock_ns == 20 * PERIOD_NS


def test_a_refused_message_of_a_moving_controller_changes_nothing() -> None:
    good, bad = make_message((0.5, (2.1, 3.1, 4.1))), make_message((0.5, (1.0,)))

    states = run(make_rules(), 0.5, topic={0.0: good, 0.1: bad})

    assert (
        commands(states) == commands(run(make_rules(), 0.5, topic={0.0: good}))
    ).all()


def test_messages_are_judged_by_the_rules_of_the_last_tick() -> None:
    strict, lax = make_rules(), make_rules(allow=["partial_joints_goal"])
    partial = make_message((0.5, (1.0,)), joints=("joint1",))
    measured = np.array(START)
    state = tick(strict, JointTrajectoryState(), TickInputs(0, PERIOD_NS, measured))

    reasons = []
    for k in (1, 2):
        inputs = TickInputs(k * PERIOD_NS, PERIOD_NS, measured, topics=(partial,))
        state = tick(lax, state, inputs)
        reasons.append(len(state.events))

    assert reasons == [1, 1]
    assert state.plan.trajectory.message.points[0].positions[0] == 1.0


def test_tolerances_of_a_goal_stay_for_the_topic_after_it() -> None:
    there = make_message((0.0, START))
    goal = make_goal(there, path_tolerance=[JointTolerance("joint1", 0.05)])
    away = make_message((0.2, (2.1, 2.1, 3.1)))

    checked = run(
        make_rules(), 0.8, plant=stick, requests={0.0: goal}, topic={0.5: away}
    )
    unchecked = run(make_rules(), 0.8, plant=stick, topic={0.5: away})

    # 0.05 rad off after 10 ms.
    assert commands(checked)[-1].tolist() == list(START)
    assert commands(unchecked)[-1].tolist() == [2.1, 2.1, 3.1]
