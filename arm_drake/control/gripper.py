"""Update and life cycle of a gripper's controller.

Pure functions from one state to the next, by the rules of ros2_controllers'
gripper_controllers (jazzy) and parallel_gripper_controller (version 6.9.0), which are
the same but for what is written: a goal is reached within `goal_tolerance` of it; the
gripper stalls when it was slower than `stall_velocity_threshold` for longer than
`stall_timeout`. What was commanded last goes on after a goal has ended.

The action server lives from the first activation on. A goal that is executed when the
controller is deactivated goes on when it is activated again: at the position held then
it has been reached.
"""

import dataclasses as dc
import math
from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from arm_drake.control.action_goals import ActiveGoal, answer_cancel
from arm_drake.control.pid import Pid, PidState
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    CancelGoal,
    CancelResponse,
    GoalEvent,
    GoalStatus,
    Message,
    Result,
    SendGoal,
    TopicRejected,
)
from arm_drake.messages.base import append_events

# Events of a controller.
Event = GoalEvent | CancelResponse | TopicRejected

_INACTIVE = "the controller was never active; activate it first"


class Target(NamedTuple):
    """Where the joint is to go, and with what."""

    # [rad] or [m].
    position: float

    # [N·m] or [N].
    max_effort: float = 0.0

    # [rad/s] or [m/s].
    max_velocity: float = 0.0


@dc.dataclass(frozen=True, eq=False)
class GripperRules(Message):
    """Numbers and choices of a controller of a controller."""

    # Distance at which a goal is reached [rad] or [m].
    goal_tolerance: float

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool

    # Speed up to which it stands [rad/s] or [m/s], and for how long until it stalls
    # [s].
    stall_velocity_threshold: float
    stall_timeout: float

    # Period of the goal's monitor [ns].
    monitor_period_ns: int

    # What a hold is done with.
    max_effort: float
    max_velocity: float

    # Returns the target of a goal, or in words why there is none.
    read_goal: Callable[["GripperRules", SendGoal], Target | str]

    # Returns a result: of a position, an effort, whether stalled, whether reached. None
    # is the result of a goal that has been cancelled.
    make_result: Callable[["Ending | None"], Result]

    # Commands efforts; without it, positions are.
    pid: Pid | None = None


class Ending(NamedTuple):
    """How a goal ended by itself."""

    # [rad] or [m].
    position: float

    # What was commanded last [N·m] or [N].
    effort: float

    is_stalled: bool


class GripperInputs(NamedTuple):
    """What a tick reads."""

    time_ns: int

    # Time since the last tick [ns].
    period_ns: int

    # Measured [rad] or [m], and per second.
    position: float
    velocity: float

    requests: tuple[ActionRequest, ...] = ()


class GripperState(NamedTuple):
    """State of the controller; a tuple, for it is made anew at every tick."""

    # What is commanded; None before the first activation.
    target: Target | None = None

    goal: ActiveGoal | None = None

    # When the joint moved last, or the goal was accepted [ns].
    moved_ns: int = 0

    # Effort that the last tick commanded, or what it was limited to.
    effort: float = 0.0

    pid: PidState | None = None

    # The latest news, numbered, the newest last.
    events: tuple[tuple[int, Event], ...] = ()

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


def activate(
    rules: GripperRules, state: GripperState, inputs: GripperInputs
) -> GripperState:
    """Return the state after an activation: the joint is held where it is."""
    pid = None if rules.pid is None else rules.pid.initial()
    return state._replace(target=_hold(rules, inputs), pid=pid)


def tick(
    rules: GripperRules, state: GripperState, inputs: GripperInputs
) -> GripperState:
    """Return the state after a tick."""
    state = idle(rules, state, inputs)
    target = state.target
    assert target is not None  # Since the activation.
    error = target.position - inputs.position
    state = _judge(rules, state, inputs, error)
    if rules.pid is None:
        return state._replace(effort=target.max_effort)
    assert state.pid is not None
    pid = rules.pid.step(
        state.pid,
        np.array([error]),
        inputs.period_ns / NANOSECONDS,
        np.array([-inputs.velocity]),
    )
    most = abs(target.max_effort)
    effort = min(max(float(pid.command[0]), -most), most)
    return state._replace(effort=effort, pid=pid)


def idle(
    rules: GripperRules, state: GripperState, inputs: GripperInputs
) -> GripperState:
    """Return the state that has dealt with messages and told results that are due."""
    for request in inputs.requests:
        if isinstance(request, CancelGoal):
            state = _cancel(rules, state, request, inputs)
        elif isinstance(request, SendGoal):
            state = _take(rules, state, request, inputs.time_ns)
    goal = state.goal
    if goal is None or inputs.time_ns < goal.monitor_ns:
        return state
    if goal.outcome is not None:
        if not goal.is_deliverable:
            return state
        return add_events(state._replace(goal=None), goal.outcome)
    monitor_ns = goal.next_monitor(inputs.time_ns, rules.monitor_period_ns)
    return state._replace(goal=dc.replace(goal, monitor_ns=monitor_ns))


def command(rules: GripperRules, state: GripperState, position: float) -> GripperState:
    """Return the state that goes to a position without a goal; the present one ends.

    `position` [rad] or [m].
    """
    if state.target is None:
        return state
    goal = state.goal
    if goal is not None:
        result = rules.make_result(None)
        event = GoalEvent(goal.request, GoalStatus.CANCELED, result)
        state = add_events(state._replace(goal=None), event)
    effort = rules.max_effort
    if rules.pid is not None and not effort:
        effort = math.inf
    target = Target(position, effort, rules.max_velocity)
    return state._replace(target=target)


def add_events(state: GripperState, *new_events: Event) -> GripperState:
    """Return the state that tells news, after those it has told."""
    return state._replace(events=append_events(state.events, new_events))


def _hold(rules: GripperRules, inputs: GripperInputs) -> Target:
    return Target(inputs.position, rules.max_effort, rules.max_velocity)


def _judge(
    rules: GripperRules, state: GripperState, inputs: GripperInputs, error: float
) -> GripperState:
    """Return the state that has noted whether the goal ends."""
    goal = state.goal
    if goal is None or not goal.is_executing:
        return state
    is_reached = abs(error) < rules.goal_tolerance
    if not is_reached:
        if abs(inputs.velocity) > rules.stall_velocity_threshold:
            return state._replace(moved_ns=inputs.time_ns)
        standing = (inputs.time_ns - state.moved_ns) / NANOSECONDS
        if not standing > rules.stall_timeout:
            return state
    ending = Ending(inputs.position, state.effort, not is_reached)
    is_good = is_reached or rules.allow_stalling
    status = GoalStatus.SUCCEEDED if is_good else GoalStatus.ABORTED
    return state._replace(goal=goal.end(status, rules.make_result(ending)))


def _take(
    rules: GripperRules, state: GripperState, request: SendGoal, now_ns: int
) -> GripperState:
    """Return the state that executes a goal, or has rejected it."""
    target = rules.read_goal(rules, request) if state.target else _INACTIVE
    if isinstance(target, str):
        rejected = GoalEvent(request, GoalStatus.REJECTED, note=target)
        return add_events(state, rejected)
    new_events, old = [GoalEvent(request, GoalStatus.EXECUTING)], state.goal
    if old is not None:
        result = rules.make_result(None)
        new_events.append(GoalEvent(old.request, GoalStatus.CANCELED, result))
    goal = ActiveGoal(request, now_ns, now_ns + rules.monitor_period_ns)
    return add_events(
        state._replace(target=target, goal=goal, moved_ns=now_ns), *new_events
    )


def _cancel(
    rules: GripperRules,
    state: GripperState,
    request: CancelGoal,
    inputs: GripperInputs,
) -> GripperState:
    goal, response = state.goal, answer_cancel(state.goal, request)
    if goal is None or not response.accepted:
        return add_events(state, response)
    if goal.is_executing:
        goal = goal.end(GoalStatus.CANCELED, rules.make_result(None))
        state = state._replace(target=_hold(rules, inputs))
    state = state._replace(goal=dc.replace(goal, is_canceling=True))
    return add_events(state, response)
