"""Acceptance and refusal of trajectories and goals, and the position that is held.

The rules are those of ros2_controllers' joint_trajectory_controller (`update`,
`positions_upsampling`; version 6.9.0) with the action server that it uses, see
`arm_drake.control.action_goals`. Splines go through positions that come without
velocities, or even without times.

Quirks of upstream that are kept:

* A trajectory on the topic doesn't end the goal that is being executed; it is judged by
  the new trajectory from then on.
* There is one hold message, made once. Holding changes its positions alone; success
  makes its point the goal's last one. So after a success later holds repeat the
  velocities, accelerations and efforts of that goal's last point, and a hold while it
  is being followed already has no new start.
"""

import dataclasses as dc
import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.action_goals import ActiveGoal, answer_cancel
from arm_drake.control.tolerances import (
    EPSILON,
    StateTolerances,
    describe_violation,
    exceeds,
    resolve_tolerances,
)
from arm_drake.control.trajectory import (
    Sample,
    StateBefore,
    Trajectory,
    blend,
    in_joint_order,
    positions_or,
    scaled,
)
from arm_drake.controllers.cycles import with_field
from arm_drake.controllers.joint_trajectory.state import (
    Deceleration,
    JointTrajectoryRules,
    JointTrajectoryState,
    Plan,
    TickInputs,
    add_events,
    errors_of,
    find_fault,
    make_feedback,
    present_commands,
    take_snapshot,
)
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    CancelGoal,
    Duration,
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GoalEvent,
    GoalStatus,
    JointTrajectory,
    JointTrajectoryPoint,
    SendGoal,
    SpeedScalingFactor,
    TopicRejected,
)
from arm_drake.messages.base import append_events, make_unchecked


def upsample(message: JointTrajectory, frequency: float) -> JointTrajectory:
    """Return a trajectory of mere positions with times and velocities.

    If all times are 0, point i is due after (i + 1) / frequency. The velocities make
    its cubic segments twice differentiable. A trajectory that has velocities or
    accelerations, positions of different sizes, or times that don't increase, is
    returned as it is; whether it is allowed is not checked here.

    `frequency` [Hz], 0 gives them none.
    """
    points = message.points
    if any(p.velocities or p.accelerations or not p.positions for p in points):
        return message
    if frequency > 0.0 and not any(p.time_from_start.to_nanoseconds() for p in points):
        times = [int((i + 1) / frequency * NANOSECONDS) for i in range(len(points))]
        points = tuple(
            dc.replace(p, time_from_start=Duration.from_nanoseconds(time))
            for p, time in zip(points, times, strict=True)
        )
        message = JointTrajectory(message.header, message.joint_names, points)
    if len({len(p.positions) for p in points}) != 1:
        return message
    velocities = fill_cubic_spline_velocities(
        np.array([p.time_from_start.to_nanoseconds() for p in points]) / NANOSECONDS,
        np.array([p.positions for p in points]),
    )
    if velocities is None:
        return message
    return JointTrajectory(
        message.header,
        message.joint_names,
        tuple(
            JointTrajectoryPoint(
                p.positions, v, effort=p.effort, time_from_start=p.time_from_start
            )
            for p, v in zip(points, velocities.tolist(), strict=True)
        ),
    )


def fill_cubic_spline_velocities(times: Array, positions: Array) -> Array | None:
    """Return the velocities that make cubic segments twice differentiable.

    They are 0 at both ends. None if there is nothing to solve: fewer than two points,
    or times that don't increase.

    `times` [s], shape (m,); `positions` shape (m, n).
    """
    h = np.diff(times)[:, None]
    if len(times) < 2 or not (h > 0.0).all():
        return None
    velocities = np.zeros_like(positions)
    slopes = np.diff(positions, axis=0) / h**2
    right = 3.0 * (slopes[1:] + slopes[:-1])
    diagonal = 2.0 * (1.0 / h[:-1] + 1.0 / h[1:])
    # The Thomas algorithm: eliminate downwards, substitute upwards.
    for i in range(1, len(diagonal)):
        factor = 1.0 / (h[i] * diagonal[i - 1])
        diagonal[i] -= factor / h[i]
        right[i] -= factor * right[i - 1]
    for i in reversed(range(len(diagonal))):
        velocities[i + 1] = (right[i] - velocities[i + 2] / h[i + 1]) / diagonal[i]
    return velocities


def make_hold_point(rules: JointTrajectoryRules) -> JointTrajectoryPoint:
    """Return the point of the hold message before the first hold."""
    commands, zeros = rules.command_interfaces, (0.0,) * len(rules.joints)
    has_acceleration = "acceleration" in commands
    return JointTrajectoryPoint(
        positions=zeros,
        velocities=zeros if has_acceleration or "velocity" in commands else (),
        accelerations=zeros if has_acceleration else (),
        effort=zeros if "effort" in commands else (),
    )


def stop_motion(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    position: Array,
    velocity: Array | None,
) -> JointTrajectoryState:
    """Return the state that brakes the joints, or holds them, from the next tick on.

    `position` shape (n,); `velocity` shape (n,), None if that isn't measured.
    """
    is_known = velocity is not None and bool(np.isfinite(velocity).all())
    if rules.deceleration is None or velocity is None or not is_known:
        return hold(rules, state, position)
    period_ns = rules.look_ahead_ns
    message, num_points = _brake(
        rules, position, velocity, period_ns, state.plan.num_stop_points
    )
    plan = state.plan._replace(
        pending=message,
        is_hold_pending=False,
        is_holding=True,
        num_stop_points=num_points,
    )
    return state._replace(plan=plan)


def hold(
    rules: JointTrajectoryRules, state: JointTrajectoryState, position: Array
) -> JointTrajectoryState:
    """Return the state that holds the joints, from the next tick on.

    `position` shape (n,).
    """
    point = dc.replace(state.plan.hold, positions=tuple(position.tolist()))
    return _hold(rules, state, point)


def repeat_last_point(
    rules: JointTrajectoryRules, state: JointTrajectoryState, trajectory: Trajectory
) -> JointTrajectoryState:
    """Return the state that stays at the end of a trajectory, velocities included."""
    return _hold(rules, state, trajectory.last_point())


def _hold(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    point: JointTrajectoryPoint,
) -> JointTrajectoryState:
    plan = state.plan
    message = JointTrajectory(joint_names=rules.joints, points=(point,))
    installed = plan.trajectory
    if installed is None or not plan.is_hold_installed:
        plan = plan._replace(
            pending=message, is_hold_pending=True, is_holding=True, hold=point
        )
        return state._replace(plan=plan)
    before = StateBefore(installed.before_ns, np.array(point.positions))
    changed = Trajectory.from_message(message, before, now_ns=installed.start_ns)
    plan = plan._replace(
        trajectory=changed,
        pending=None,
        is_hold_pending=False,
        is_holding=True,
        hold=point,
    )
    return state._replace(plan=plan, ahead_ns=-1, ahead=None)


def min_stop_points(deceleration: Array, limits: Array, period_ns: int) -> int:
    """Return how many points stop joints from their greatest velocities.

    `deceleration` [rad/s^2], shape (n,); `limits` [rad/s], shape (n,).
    """
    longest = float((limits / deceleration).max())
    return math.ceil(longest / (period_ns / NANOSECONDS)) + 1


def _brake(
    rules: JointTrajectoryRules,
    position: Array,
    velocity: Array,
    period_ns: int,
    num_before: int,
) -> tuple[JointTrajectory, int]:
    """Return a braking trajectory and its number of points, which never shrinks."""
    braking: Deceleration | None = rules.deceleration
    assert braking is not None
    a, dt = braking.decelerations, period_ns / NANOSECONDS
    duration = np.abs(velocity) / a
    needed = math.ceil(float(duration.max()) / dt) + 1
    num_points = max(braking.num_points, num_before, needed)
    sign = np.where(velocity >= 0.0, 1.0, -1.0)
    end = position + sign * velocity**2 / (2.0 * a)
    t = (np.arange(num_points) * dt)[:, None]
    moves = (t < duration) & (np.abs(velocity) > EPSILON)
    v = velocity - sign * a * t
    v = np.where(moves, sign * np.maximum(sign * v, 0.0), 0.0)
    q = np.where(moves, position + velocity * t - sign * a * t**2 / 2.0, end)
    acceleration = np.where(moves, -sign * a, 0.0)
    rows = zip(q.tolist(), v.tolist(), acceleration.tolist(), strict=True)
    points = tuple(
        JointTrajectoryPoint(
            *row, time_from_start=Duration.from_nanoseconds(k * period_ns)
        )
        for k, row in enumerate(rows)
    )
    return JointTrajectory(joint_names=rules.joints, points=points), num_points


_INACTIVE = "the controller is inactive; activate it first"


def receive(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state that has dealt with what has come."""
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
    """Return the state with a goal's result, or else feedback, sent when due."""
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


class _LateFeedback:
    """Feedback of a state that is made when somebody looks; pickled, it is made."""

    def __init__(
        self, rules: JointTrajectoryRules, look: Callable[[], JointTrajectoryState]
    ) -> None:
        self._rules, self._look = rules, look

    def __call__(self) -> FollowJointTrajectoryFeedback:
        snapshot = take_snapshot(self._look())
        assert snapshot is not None
        return make_feedback(self._rules, snapshot)

    def __deepcopy__(self, memo: object) -> "_LateFeedback":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial, (
            make_feedback,
            self._rules,
            take_snapshot(self._look()),
        )


# Where these stand in the state, and the events in the plan.
_PLAN, _GOAL = (JointTrajectoryState._fields.index(name) for name in ("plan", "goal"))
_EVENTS = Plan._fields.index("events")


def send_feedback(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    now_ns: int,
    last_ns: int,
    look: Callable[[], JointTrajectoryState],
) -> JointTrajectoryState:
    """Return a state with the feedback of `monitor` on a goal that goes on.

    `look` returns the state of the last tick, that of `last_ns`.
    """
    goal = state.goal
    assert goal is not None
    due_ns = goal.next_monitor(now_ns, rules.monitor_period_ns)
    request, accepted_ns = goal.request, goal.accepted_ns
    goal = make_unchecked(
        ActiveGoal,
        request=request,
        accepted_ns=accepted_ns,
        monitor_ns=due_ns,
        outcome=None,
        is_canceling=goal.is_canceling,
    )
    state = with_field(state, _GOAL, goal)
    if last_ns < accepted_ns:
        return state

    make, plan = _LateFeedback(rules, look), state.plan
    event = make_unchecked(
        GoalEvent,
        request=request,
        status=GoalStatus.EXECUTING,
        result=None,
        note="",
        feedback_source=make,
    )
    plan = with_field(plan, _EVENTS, append_events(plan.events, (event,)))
    return with_field(state, _PLAN, plan)


def conclude(
    state: JointTrajectoryState,
    status: GoalStatus,
    code: int,
    text: str,
    detail: str = "",
) -> JointTrajectoryState:
    """Return the state that has noted how the goal ended; its monitor will tell."""
    goal = state.goal
    assert goal is not None
    result = FollowJointTrajectoryResult(int(code), text)
    return state._replace(goal=goal.end(status, result, detail))


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


def _timed(rules: JointTrajectoryRules, message: JointTrajectory) -> JointTrajectory:
    """Return a message of the topic with the times that it gets."""
    frequency = rules.upsampling_frequency
    if frequency is not None and rules.interpolation == "splines":
        return upsample(message, frequency)
    return message


def find_lasting_fault(
    rules: JointTrajectoryRules, message: JointTrajectory | FollowJointTrajectoryGoal
) -> str:
    """Return why a message is refused, whenever it comes; empty if it needn't be."""
    if isinstance(message, FollowJointTrajectoryGoal):
        trajectory = message.trajectory
    else:
        trajectory = _timed(rules, message)
    return find_fault(trajectory, rules.allowed, now_ns=0) or ""


def _take_topic(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    trajectory: JointTrajectory,
    now_ns: int,
) -> JointTrajectoryState:
    message = _timed(rules, trajectory)
    fault = _INACTIVE
    if state.plan.is_active:
        fault = find_fault(message, rules.allowed, now_ns) or ""
    if fault:
        return add_events(state, TopicRejected(trajectory, fault))
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
    new_events, old = [accepted], state.goal
    if old is not None and old.is_executing:
        code = FollowJointTrajectoryErrorCode.INVALID_GOAL
        result = FollowJointTrajectoryResult(int(code), rules.preempted_text)
        new_events.append(GoalEvent(old.request, rules.preempted_status, result))
    elif old is not None:
        result = FollowJointTrajectoryResult()
        new_events.append(GoalEvent(old.request, GoalStatus.CANCELED, result))
    state = _follow(state, goal.trajectory)
    plan = state.plan._replace(tolerances=resolution.tolerances)
    active = ActiveGoal(request, now_ns, now_ns + rules.monitor_period_ns)
    return add_events(state._replace(plan=plan, goal=active), *new_events)


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


# A time of the last command up to this counts as none: in seconds, epsilon of a 32-bit
# float [ns].
_NO_TIME_NS = 119


def install(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state that follows the pending message from now on."""
    plan = state.plan
    assert plan.pending is not None
    message, num_prefix = _prepare(rules, state, inputs, plan.pending)
    trajectory = Trajectory.from_message(
        message,
        _state_before(rules, state, inputs),
        now_ns=inputs.time_ns,
        interpolation=rules.interpolation,
        wraparound=rules.wraparound,
    )
    plan = plan._replace(
        trajectory=trajectory,
        num_prefix=num_prefix,
        is_hold_installed=plan.is_hold_pending,
        pending=None,
        is_hold_pending=False,
    )
    return state._replace(
        plan=plan, clock_ns=inputs.time_ns, cursor=0, ahead_ns=-1, ahead=None
    )


def _prepare(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    message: JointTrajectory,
) -> tuple[JointTrajectory, int]:
    """Return a message of all joints, blended if it is to be, and its prefix."""
    plan, old = state.plan, state.plan.trajectory
    is_blended = (
        rules.allow_replacement
        and not plan.is_holding
        and old is not None
        and len(old.times_ns) > 1
    )
    if not is_blended and message.joint_names == rules.joints:
        return message, 0
    missing = inputs.position
    if len(message.joint_names) < len(rules.joints):
        commands = present_commands(rules, inputs)
        missing = positions_or(rules.command_of(commands, "position"), missing)
    if is_blended:
        assert old is not None
        stamp_ns = message.header.stamp.to_nanoseconds()
        delay_ns = max(stamp_ns - inputs.time_ns, 0)
        replacement = blend(
            message,
            old,
            rules.joints,
            missing,
            cursor_ns=state.clock_ns,
            delay_ns=scaled(delay_ns, state.scaling_factor),
            cursor=state.cursor,
            seen=state.seen,
        )
        if replacement is not None:
            return replacement
    return in_joint_order(message, rules.joints, missing), 0


def _state_before(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> StateBefore:
    """Return where a trajectory starts from: what is measured or was commanded."""
    now_ns, last = inputs.time_ns, state.commanded
    if not rules.interpolate_from_desired_state or last is None:
        effort = None
        if rules.carries_effort and "effort" in rules.command_interfaces:
            effort = rules.command_of(present_commands(rules, inputs), "effort")
        return StateBefore(
            now_ns, inputs.position, inputs.velocity, inputs.acceleration, effort
        )
    is_timed = rules.starts_at_last_command and state.commanded_ns > _NO_TIME_NS
    time_ns = state.commanded_ns if is_timed else now_ns
    if isinstance(last, StateBefore):
        return last._replace(time_ns=time_ns)
    return StateBefore(
        time_ns, last.position, last.velocity, last.acceleration, last.effort
    )


def commanded_before(
    rules: JointTrajectoryRules, inputs: TickInputs, commands: Array
) -> StateBefore:
    """Return the state that an activation takes as the last command.

    Kinds of command interfaces that all have a finite value replace what is measured,
    if all joints are commanded.

    `commands` shape (k,).
    """
    measured = (inputs.position, inputs.velocity, inputs.acceleration, None)
    if not rules.starts_from_commands or len(commands) != (
        len(rules.joints) * len(rules.command_interfaces)
    ):
        return StateBefore(inputs.time_ns, *measured)
    names = ("position", "velocity", "acceleration", "effort")
    fields = []
    for name, vector in zip(names, measured, strict=True):
        values = rules.command_of(commands, name)
        is_known = values is not None and bool(np.isfinite(values).all())
        fields.append(values if is_known else vector)
    return StateBefore(inputs.time_ns, *fields)


class Verdict(NamedTuple):
    """Result of the check of a trajectory's tolerances."""

    is_timed_out: bool = False
    is_off_path: bool = False
    is_off_goal: bool = False

    # Whether it is off its goal for too long, and how long its end is past [s].
    is_late: bool = False
    late: float = 0.0

    # Which joint violates which tolerance, in words, if that ends a goal.
    detail: str = ""


FINE = Verdict()


def judge(
    rules: JointTrajectoryRules,
    plan: Plan,
    inputs: TickInputs,
    desired: Sample,
    error: Array,
    checks_path: bool,
    late: float | None,
) -> Verdict:
    """Return how a trajectory is followed; `late` is None before its end."""
    if late is not None and 0.0 < plan.cmd_timeout < late:
        return Verdict(is_timed_out=True)
    tolerances = plan.tolerances
    if tolerances is None:
        return FINE
    is_off_path = is_off_goal = is_late = False
    path, goal = tolerances.path, tolerances.goal
    if path.is_checked and checks_path:
        is_off_path = _exceeds(rules, inputs, desired, error, path)
    if late is not None and goal.is_checked:
        is_off_goal = _exceeds(rules, inputs, desired, error, goal)
        is_late = is_off_goal and 0.0 != tolerances.goal_time < late
    if not (is_off_path or is_off_goal):
        return FINE
    detail = ""
    if is_off_path or is_late:
        detail = describe_violation(
            errors_of(rules, inputs, desired, error),
            path if is_off_path else goal,
            "path" if is_off_path else "goal",
            rules.joints,
            rules.is_prismatic,
        )
    return Verdict(False, is_off_path, is_off_goal, is_late, late or 0.0, detail)


def _exceeds(
    rules: JointTrajectoryRules,
    inputs: TickInputs,
    desired: Sample,
    error: Array,
    tolerances: StateTolerances,
) -> bool:
    if tolerances.is_position_only:
        return exceeds(error, None, None, tolerances)
    return exceeds(*errors_of(rules, inputs, desired, error), tolerances)


_SUCCESS_TEXT = "Goal successfully reached!"
_PATH_TEXT = "Aborted due to path tolerance violation"


def conclude_if_due(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    trajectory: Trajectory,
    verdict: Verdict,
    is_finished: bool,
) -> JointTrajectoryState:
    """Return the state that stops the motion or ends the goal, if it is time to."""
    if verdict.is_timed_out or verdict.is_off_path or verdict.is_late:
        state = stop_motion(rules, state, inputs.position, inputs.velocity)
    goal, codes = state.goal, FollowJointTrajectoryErrorCode
    if goal is None or goal.outcome is not None:
        return state
    if verdict.is_off_path:
        code = codes.PATH_TOLERANCE_VIOLATED
        return conclude(state, GoalStatus.ABORTED, code, _PATH_TEXT, verdict.detail)
    if verdict.is_late:
        text = (
            f"Aborted due to goal_time_tolerance exceeding by {verdict.late:f} seconds"
        )
        code = codes.GOAL_TOLERANCE_VIOLATED
        return conclude(state, GoalStatus.ABORTED, code, text, verdict.detail)
    if is_finished and not verdict.is_off_goal:
        code = codes.SUCCESSFUL
        state = conclude(state, GoalStatus.SUCCEEDED, code, _SUCCESS_TEXT)
        return repeat_last_point(rules, state, trajectory)
    return state
