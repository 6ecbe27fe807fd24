"""What a joint_trajectory_controller makes of messages and of the goals of its action.

The rules are those of ros2_controllers' joint_trajectory_controller (version 6.9.0)
with the action server that it uses, see `action_goals`. One more quirk is kept: a
trajectory on the topic doesn't end the goal that is being executed; it is judged by the
new trajectory from then on.
"""

import dataclasses as dc
import functools
import math

from arm_drake.control.action_goals import ActiveGoal, answer_cancel
from arm_drake.control.tolerances import resolve_tolerances
from arm_drake.controllers.joint_trajectory.joint_trajectory_report import (
    make_feedback,
    take_snapshot,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_stop import stop_motion
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
    add_events,
)
from arm_drake.controllers.joint_trajectory.trajectory_upsampling import upsample
from arm_drake.controllers.joint_trajectory.trajectory_validation import find_fault
from arm_drake.messages import (
    ActionRequest,
    CancelGoal,
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GoalEvent,
    GoalStatus,
    JointTrajectory,
    SendGoal,
    SpeedScalingFactor,
    TopicRejected,
)

_INACTIVE = "the controller is inactive; activate it first"


def receive(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state that has dealt with what has come.

    Args:
        rules: Numbers that hold until the next tick.
        state: State after the last tick.
        inputs: What has come since.
    """
    for factor in inputs.scaling_factors:
        state = _take_scaling_factor(rules, state, factor)
    for message in inputs.topics:
        state = _take_topic(rules, state, message, inputs.time_ns)
    for request in inputs.requests:
        state = _take_request(rules, state, request, inputs)
    return state


def monitor(
    rules: JointTrajectoryRules, state: JointTrajectoryState, now_ns: int
) -> JointTrajectoryState:
    """Return the state that has told a goal's result, or else feedback, if it is due.

    Args:
        rules: Numbers that hold until the next tick.
        state: State after the last tick and the messages since.
        now_ns: Time [ns].
    """
    goal = state.goal
    if goal is None or now_ns < goal.monitor_ns:
        return state
    if goal.outcome is not None:
        if not goal.is_deliverable:
            return state
        return add_events(state._replace(goal=None), goal.outcome)
    due_ns = goal.next_monitor(now_ns, rules.monitor_period_ns)
    snapshot = take_snapshot(state)
    # What dataclasses.replace makes, sooner.
    goal = ActiveGoal(goal.request, goal.accepted_ns, due_ns, None, goal.is_canceling)
    state = state._replace(goal=goal)
    if snapshot is None or snapshot.time_ns < goal.accepted_ns:
        return state
    make = functools.partial(make_feedback, rules, snapshot)
    event = GoalEvent(goal.request, GoalStatus.EXECUTING, feedback_source=make)
    return add_events(state, event)


def conclude(
    state: JointTrajectoryState, status: GoalStatus, code: int, text: str
) -> JointTrajectoryState:
    """Return the state that has noted how the goal ended; its monitor will tell."""
    goal = state.goal
    assert goal is not None
    result = FollowJointTrajectoryResult(int(code), text)
    return state._replace(goal=goal.end(status, result))


def is_executing(state: JointTrajectoryState) -> bool:
    """Return whether there is a goal that hasn't ended."""
    return state.goal is not None and state.goal.is_executing


def _take_scaling_factor(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    message: SpeedScalingFactor,
) -> JointTrajectoryState:
    factor, fault = message.factor, ""
    if not rules.is_position_only:
        commands = list(rules.command_interfaces)
        fault = f"speed is scaled where positions alone are commanded, not {commands}"
    elif not 0.0 <= factor < math.inf:
        fault = f"factor is {factor}; expected at least 0, 1 being full speed"
    if fault:
        return add_events(state, TopicRejected(message, fault))
    plan = state.plan._replace(requested_scaling=factor)
    if rules.has_scaling_state:
        return state._replace(plan=plan)
    return state._replace(plan=plan, scaling_factor=factor)


def _take_topic(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    given: JointTrajectory,
    now_ns: int,
) -> JointTrajectoryState:
    message, frequency = given, rules.upsampling_frequency
    if frequency is not None and rules.interpolation == "splines":
        message = upsample(given, frequency)
    fault = _INACTIVE
    if state.plan.is_active:
        fault = find_fault(message, rules.allowed, now_ns) or ""
    if fault:
        return add_events(state, TopicRejected(given, fault))
    return _follow(state, message)


def _follow(
    state: JointTrajectoryState, message: JointTrajectory
) -> JointTrajectoryState:
    plan = state.plan._replace(pending=message, is_hold_pending=False, is_holding=False)
    return state._replace(plan=plan)


def _take_request(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    request: ActionRequest,
    inputs: TickInputs,
) -> JointTrajectoryState:
    if isinstance(request, CancelGoal):
        return _cancel(rules, state, request)
    if not isinstance(request, SendGoal):
        return state
    goal, fault = request.goal, _INACTIVE
    if not isinstance(goal, FollowJointTrajectoryGoal):
        fault = f"expected a FollowJointTrajectoryGoal, got a {type(goal).__name__}"
    elif state.plan.is_active:
        fault = find_fault(goal.trajectory, rules.allowed, inputs.time_ns) or ""
        if not fault:
            return _accept(rules, state, request, goal, inputs.time_ns)
    code = FollowJointTrajectoryErrorCode.INVALID_GOAL
    result = FollowJointTrajectoryResult(int(code), fault)
    return add_events(state, GoalEvent(request, GoalStatus.REJECTED, result))


def _accept(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    request: SendGoal,
    goal: FollowJointTrajectoryGoal,
    now_ns: int,
) -> JointTrajectoryState:
    resolution = resolve_tolerances(goal, rules.joints, rules.tolerances)
    accepted = GoalEvent(request, GoalStatus.EXECUTING, note=resolution.problem)
    news, old = [accepted], state.goal
    if old is not None and old.is_executing:
        code = FollowJointTrajectoryErrorCode.INVALID_GOAL
        result = FollowJointTrajectoryResult(int(code), rules.preempted_text)
        news.append(GoalEvent(old.request, rules.preempted_status, result))
    elif old is not None:
        result = FollowJointTrajectoryResult()
        news.append(GoalEvent(old.request, GoalStatus.CANCELED, result))
    state = _follow(state, goal.trajectory)
    plan = state.plan._replace(tolerances=resolution.tolerances)
    active = ActiveGoal(request, now_ns, now_ns + rules.monitor_period_ns)
    return add_events(state._replace(plan=plan, goal=active), *news)


def _cancel(
    rules: JointTrajectoryRules, state: JointTrajectoryState, request: CancelGoal
) -> JointTrajectoryState:
    goal, response = state.goal, answer_cancel(state.goal, request)
    if goal is None or not response.accepted:
        return add_events(state, response)
    state = state._replace(goal=dc.replace(goal, is_canceling=True))
    if goal.is_executing:
        state = conclude(state, GoalStatus.CANCELED, 0, "")
        # Whoever has accepted a goal is active, and knows where its joints are.
        assert state.position is not None
        state = stop_motion(rules, state, state.position, state.velocity)
    return add_events(state, response)
