"""Activation, deactivation, ticks while inactive, and queries (spec C1.11 to C1.13)."""

import copy
import dataclasses as dc
from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.joint_trajectory.controller import (
    activate,
    deactivate,
    idle,
    tick,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryRules,
    JointTrajectoryState,
    TickInputs,
    make_controller_state,
    make_query_response,
)
from arm_drake.messages import (
    CancelGoal,
    CancelResponse,
    FollowJointTrajectoryResult,
    GoalStatus,
    JointTolerance,
    JointTrajectoryControllerState,
    SpeedScalingFactor,
    TopicRejected,
)
from tests.control.joint_trajectory_runs import (
    JOINTS,
    PERIOD_NS,
    START,
    make_goal,
    make_message,
    make_rules,
    news,
    run,
    stick,
)
from tests.control.test_joint_trajectory_commands import make_pid

INACTIVE = "the controller is inactive; activate it first"
DEACTIVATED = FollowJointTrajectoryResult(
    -1, "Current goal cancelled during deactivate transition."
)


def inputs_at(k: int, **fields: Any) -> TickInputs:
    """Return the inputs of tick k with joints that stay at their start."""
    inputs = {"position": np.array(START), "velocity": np.zeros(3), **fields}
    return TickInputs(k * PERIOD_NS, PERIOD_NS, **inputs)


def ticks(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    start: int,
    stop: int,
    **fields: Any,
) -> JointTrajectoryState:
    for k in range(start, stop):
        state = tick(rules, state, inputs_at(k, **fields))
    return state


def restart(
    rules: JointTrajectoryRules, state: JointTrajectoryState, k: int, **fields: Any
) -> JointTrajectoryState:
    """Return the state that was deactivated, activated and ticked once."""
    state = deactivate(rules, state)
    state = activate(rules, state, inputs_at(k, **fields))
    return tick(rules, state, inputs_at(k, **fields))


def test_an_inactive_controller_refuses_what_comes() -> None:
    goal, message = make_goal(make_message((0.1, START))), make_message((0.1, START))
    rules = make_rules()

    state = idle(
        rules, JointTrajectoryState(), inputs_at(0, topics=(message,), requests=(goal,))
    )

    (_, topic), (_, rejected) = state.events
    assert topic == TopicRejected(message, INACTIVE)
    assert rejected.status is GoalStatus.REJECTED
    assert rejected.result == FollowJointTrajectoryResult(-1, INACTIVE)
    assert state.plan.pending is None


def test_an_inactive_controller_takes_speed_factors() -> None:
    rules = make_rules()
    factor = SpeedScalingFactor(0.5)

    state = idle(rules, JointTrajectoryState(), inputs_at(0, scaling_factors=(factor,)))
    state = tick(rules, state, inputs_at(1))

    assert state.scaling_factor == 0.5


def test_a_goal_that_a_deactivation_aborts_is_reported_by_its_monitor() -> None:  # A15
    rules, goal = make_rules(), make_goal(make_message((1.0, (2.0, 3.0, 4.0))))
    state = tick(rules, JointTrajectoryState(), inputs_at(0, requests=(goal,)))
    state = deactivate(rules, state)
    states = [state]

    for k in range(1, 10):
        states.append(idle(rules, states[-1], inputs_at(k)))

    assert news(states, goal)[1:] == [(5, GoalStatus.ABORTED, DEACTIVATED)]


def test_an_inactive_controller_answers_cancels() -> None:
    rules, goal = make_rules(), make_goal(make_message((1.0, (2.0, 3.0, 4.0))))
    cancels = CancelGoal(goal), CancelGoal(goal)
    state = tick(rules, JointTrajectoryState(), inputs_at(0, requests=(goal,)))
    state = deactivate(rules, state)

    state = idle(rules, state, inputs_at(1, requests=cancels))

    answers = [e for _, e in state.events if isinstance(e, CancelResponse)]
    assert [(a.request, a.accepted) for a in answers] == [
        (cancels[0], True),
        (cancels[1], False),
    ]
    assert state.plan.pending is None


def test_tolerances_outlast_a_deactivation() -> None:
    rules = make_rules()
    message = make_message((0.0, START))
    goal = make_goal(message, path_tolerance=[JointTolerance("joint1", 0.5)])
    state = tick(rules, JointTrajectoryState(), inputs_at(0, requests=(goal,)))

    state = restart(rules, state, 1)

    assert state.plan.tolerances.path.position.tolist() == [0.5, 0.0, 0.0]


def test_new_default_tolerances_act_on_later_goals_alone() -> None:
    rules, later = make_rules(), make_rules(path=0.1)
    state = tick(rules, JointTrajectoryState(), inputs_at(0))
    first = tick(later, state, inputs_at(1, topics=(make_message((1.0, START)),)))

    goal = make_goal(make_message((1.0, START)))
    second = tick(later, first, inputs_at(2, requests=(goal,)))

    assert not first.plan.tolerances.path.is_checked
    assert second.plan.tolerances.path.position.tolist() == [0.1] * 3


def test_the_hold_of_a_success_outlasts_a_deactivation() -> None:
    rules = make_rules(
        allow=["nonzero_velocity_at_trajectory_end"],
        command_interfaces=("position", "velocity"),
    )
    goal = make_goal(make_message((0.0, START), velocities=(1.0, 2.0, 3.0)))
    moving = {"velocity": np.array([1.0, 2.0, 3.0])}
    state = tick(
        rules, JointTrajectoryState(), inputs_at(0, requests=(goal,), **moving)
    )

    state = restart(rules, state, 5)

    assert state.command.tolist() == [*START, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("cmd_timeout", "goal_time", "effective"),
    [(3.0, 2.0, 3.0), (1.0, 2.0, 0.0), (2.0, 2.0, 0.0)],
)
def test_cmd_timeout_must_exceed_goal_time(
    cmd_timeout: float, goal_time: float, effective: float
) -> None:
    rules = make_rules(goal_time=goal_time, cmd_timeout=cmd_timeout)

    state = activate(rules, JointTrajectoryState(), inputs_at(0))

    assert state.plan.cmd_timeout == effective


def test_integrals_start_from_0_with_each_activation() -> None:
    rules = make_rules(command_interfaces=("effort",), pid=make_pid(p=0.0, i=1.0))
    away = make_message((0.0, tuple(q + 1.0 for q in START)))
    state = tick(rules, JointTrajectoryState(), inputs_at(0, topics=(away,)))
    state = ticks(rules, state, 1, 5)
    assert state.pid.i_term.tolist() == pytest.approx([0.05] * 3)

    state = restart(rules, state, 5)

    assert state.pid.i_term.tolist() == [0.0] * 3


def test_a_speed_factor_outlasts_a_deactivation() -> None:
    rules = make_rules()
    factor = SpeedScalingFactor(0.5)
    state = tick(rules, JointTrajectoryState(), inputs_at(0, scaling_factors=(factor,)))

    assert restart(rules, state, 1).scaling_factor == 0.5


def test_what_a_tick_does_not_command_is_reported_as_it_is() -> None:
    rules = make_rules(path=1e-4)
    away = make_message((0.0, (9.0, 9.0, 9.0)))
    present = np.array([1.5, 2.5, 3.5])

    state = tick(
        rules,
        JointTrajectoryState(),
        inputs_at(0, topics=(away,), commands=lambda: present),
    )

    assert np.isnan(state.command).all()
    report = make_controller_state(rules, state)
    assert report.output.positions == tuple(present)


def test_feedback_tells_both_times_since_the_start() -> None:
    rules = make_rules(initial_scaling_factor=0.5)
    message = make_message((1.0, (2.0, 3.0, 4.0)))
    state = tick(rules, JointTrajectoryState(), inputs_at(0, topics=(message,)))

    report = make_controller_state(rules, ticks(rules, state, 1, 5))

    assert report.reference.time_from_start.to_nanoseconds() == 2 * PERIOD_NS
    assert report.feedback.time_from_start.to_nanoseconds() == 4 * PERIOD_NS


def test_the_monitor_keeps_its_own_time() -> None:
    goal = make_goal(make_message((1.0, (2.0, 3.0, 4.0))))
    rules = make_rules(monitor_period_ns=25_000_000)

    states = run(rules, 0.15, plant=stick, requests={0.0: goal})

    servo_input = [
        k for k in range(1, 16) if states[k].events[-1] != states[k - 1].events[-1]
    ]
    # Due at 25, 50, 75, 100, 125, 150 ms.
    assert servo_input == [3, 5, 8, 10, 13, 15]


@pytest.mark.parametrize(
    ("fields", "before_ns"),
    [
        ({}, PERIOD_NS),
        ({"starts_at_last_command": False}, 2 * PERIOD_NS),
        ({"interpolate_from_desired_state": False}, 2 * PERIOD_NS),
    ],
)
def test_a_trajectory_starts_when_the_last_command_was_given(
    fields: dict[str, Any], before_ns: int
) -> None:
    rules = make_rules(**{"interpolate_from_desired_state": True, **fields})
    state = ticks(rules, JointTrajectoryState(), 0, 2)
    message = make_message((1.0, (2.0, 3.0, 4.0)))

    state = tick(rules, state, inputs_at(2, topics=(message,)))

    assert state.plan.trajectory.before_ns == before_ns


def test_a_last_command_at_time_0_counts_as_none() -> None:
    rules = make_rules(interpolate_from_desired_state=True)
    state = ticks(rules, JointTrajectoryState(), 0, 1)
    message = make_message((1.0, (2.0, 3.0, 4.0)))

    state = tick(rules, state, inputs_at(1, topics=(message,)))

    assert state.plan.trajectory.before_ns == PERIOD_NS


@pytest.mark.parametrize(("carries_effort", "expected"), [(True, 3.96), (False, 0.0)])
def test_efforts_lead_from_the_last_command_to_the_first_point(
    carries_effort: bool, expected: float
) -> None:
    rules = make_rules(
        command_interfaces=("effort",),
        pid=make_pid(p=0.0),
        carries_effort=carries_effort,
    )
    message = make_message((1.0, START))

    state = tick(
        rules,
        JointTrajectoryState(),
        inputs_at(0, topics=(message,), commands=lambda: np.full(3, 4.0)),
    )

    # To 0 within a second, 10 ms ahead.
    np.testing.assert_allclose(state.command, expected, rtol=1e-9)


def test_a_search_that_was_moved_ends_the_trajectory() -> None:
    rules = make_rules()
    points = [(t, (t, t, t)) for t in (0.1, 0.2, 0.3)]
    state = ticks(rules, JointTrajectoryState(), 0, 1)
    state = tick(rules, state, inputs_at(1, topics=(make_message(*points),)))
    state = ticks(rules, state, 2, 12)

    state = tick(rules, state._replace(cursor=1), inputs_at(12))

    # Within the segment from point 0 to point 1.
    assert state.desired.position.tolist() == [0.3, 0.3, 0.3]


def moving_to(*points: tuple[float, Any]) -> tuple[Any, JointTrajectoryState]:
    rules = make_rules()
    message = make_message(*points)
    state = tick(rules, JointTrajectoryState(), inputs_at(0, topics=(message,)))
    return rules, state


def test_a_query_is_answered_with_what_is_planned() -> None:
    rules, state = moving_to((1.0, (2.1, 3.1, 4.1)))

    answer = make_query_response(rules, state, 500_000_000)

    assert answer.success
    assert answer.message == ""
    assert answer.name == JOINTS
    assert answer.position == pytest.approx((1.6, 2.6, 3.6), rel=1e-9)
    assert answer.velocity == pytest.approx((1.0, 1.0, 1.0), rel=1e-9)
    assert answer.acceleration == (0.0, 0.0, 0.0)


def test_a_query_after_the_end_fails_with_the_last_point() -> None:
    rules, state = moving_to((1.0, (2.1, 3.1, 4.1)))

    answer = make_query_response(rules, state, 1_000_000_000)

    assert not answer.success
    assert answer.message == "the trajectory ends before 1000000000 ns"
    assert answer.position == (2.1, 3.1, 4.1)
    assert answer.velocity == (0.0, 0.0, 0.0)


def test_a_query_before_the_start_fails_with_what_was_measured() -> None:
    rules, state = moving_to((1.0, (2.1, 3.1, 4.1)))

    answer = make_query_response(rules, state, -1)

    assert not answer.success
    assert answer.message == "the trajectory starts after -1 ns"
    assert answer.position == START
    assert answer.acceleration == ()


def test_a_query_of_an_inactive_controller_fails_with_nothing() -> None:
    rules, state = moving_to((1.0, (2.1, 3.1, 4.1)))
    state = deactivate(rules, state)

    answer = make_query_response(rules, state, 500_000_000)

    assert not answer.success
    assert answer.message == INACTIVE
    assert answer.name == ()
    assert answer.position == ()


def test_a_query_before_the_first_tick_fails() -> None:
    rules = make_rules()
    state = activate(rules, JointTrajectoryState(), inputs_at(0))

    answer = make_query_response(rules, state, 0)

    assert not answer.success
    assert answer.message == "there is no trajectory yet"
    assert answer.position == START


def test_a_tick_after_a_query_is_as_without() -> None:
    rules, state = moving_to(*((t, (t, t, t)) for t in (0.1, 0.2, 0.3)))

    make_query_response(rules, state, 250_000_000)

    assert ticks(rules, state, 1, 5).command[0] == pytest.approx(1.1 - 1.0 * 0.5)


def test_rules_copy_as_themselves() -> None:
    rules = make_rules()

    assert dc.replace(rules).joints == rules.joints
    assert rules.__deepcopy__({}) is rules


def test_a_report_is_a_message_like_any_other() -> None:
    rules, state = moving_to((1.0, (2.1, 3.1, 4.1)))

    report, again = (make_controller_state(rules, state) for _ in range(2))

    fields = {f.name: getattr(report, f.name) for f in dc.fields(report)}
    plain = JointTrajectoryControllerState(**fields)
    assert report == again
    assert report == plain
    assert plain == report
    assert hash(report) == hash(plain)
    assert repr(report) == repr(plain)
    assert copy.deepcopy(report) is report
    changed = dc.replace(report, speed_scaling_factor=0.5)
    assert changed == dc.replace(plain, speed_scaling_factor=0.5)
    assert changed != report
