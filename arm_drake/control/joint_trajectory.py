"""The tick of a joint_trajectory_controller with a position command interface.

A pure function from one state to the next, by the rules of ros2_controllers'
joint_trajectory_controller (`update`, `goal_accepted_callback`, version 6.9.0, with the
defaults of jazzy): the command is the trajectory one period ahead, errors and
tolerances are those of the present; goals report at their monitor's rate.
"""

import dataclasses as dc
import functools

import numpy as np

from arm_drake.control.joint_trajectory_state import (
    ActiveGoal,
    JointTrajectoryRules,
    JointTrajectoryState,
    LookAhead,
    Snapshot,
    TickInputs,
    commanded_positions,
    in_joint_order,
    make_feedback,
    since_last_point,
)
from arm_drake.control.tolerances import Array, resolve_tolerances, violates
from arm_drake.control.trajectory import (
    Sample,
    StateBefore,
    Trajectory,
    shortest_angular_distance,
)
from arm_drake.control.trajectory_validation import find_fault
from arm_drake.messages import (
    ActionRequest,
    CancelGoal,
    Duration,
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryResult,
    GoalEvent,
    GoalStatus,
    JointTrajectory,
    JointTrajectoryPoint,
    SendGoal,
    TopicRejected,
)

# How many events are kept for those who don't look at every tick.
_NUM_EVENTS = 64

_SUCCESS_TEXT = "Goal successfully reached!"
_PATH_TEXT = "Aborted due to path tolerance violation"
_PREEMPTED_TEXT = "Current goal preempted by new incoming action."


def tick(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after a tick.

    Args:
        rules: Numbers of the controller.
        state: State after the last tick.
        inputs: What is read in this tick.
    """
    return _Tick(rules, state, inputs).run()


class _Tick:
    """One tick: takes the state apart, changes it, puts it together again."""

    def __init__(
        self,
        rules: JointTrajectoryRules,
        state: JointTrajectoryState,
        inputs: TickInputs,
    ) -> None:
        self._rules = rules
        self._inputs = inputs
        self._trajectory = state.trajectory
        self._pending = state.pending
        self._is_holding = state.is_holding
        self._cursor = state.cursor
        self._clock_ns = state.clock_ns + inputs.period_ns
        self._tolerances = state.tolerances or rules.tolerances
        self._goal = state.goal
        self._commanded = state.commanded
        self._snapshot = state.snapshot
        self._ahead = state.ahead
        self._events: list[GoalEvent | TopicRejected] = []
        self._last = state

    def run(self) -> JointTrajectoryState:
        inputs, last = self._inputs, self._last
        if last.position is None:  # Activated: hold what is measured.
            self._hold(inputs.position)
            self._commanded = StateBefore(inputs.time_ns, inputs.position)
        if inputs.topic is not None and inputs.topic is not last.topic:
            self._take_topic(inputs.topic)
        if inputs.request is not None and inputs.request is not last.request:
            self._take_request(inputs.request)
        if self._goal is not None:
            self._monitor(self._goal)
        is_first = self._pending is not None
        if self._pending is not None:
            self._install(self._pending)
        self._follow(is_first)
        return JointTrajectoryState(
            self._trajectory,
            self._pending,
            self._is_holding,
            self._cursor,
            self._clock_ns,
            self._tolerances,
            self._goal,
            inputs.position,
            self._commanded,
            self._snapshot,
            self._ahead,
            self._numbered_events(),
            inputs.topic,
            inputs.request,
        )

    def _numbered_events(self) -> tuple[tuple[int, GoalEvent | TopicRejected], ...]:
        """Return the latest events with those of this tick."""
        events = self._last.events
        if not self._events:
            return events
        first = events[-1][0] + 1 if events else 0
        return (*events, *enumerate(self._events, start=first))[-_NUM_EVENTS:]

    def _take_topic(self, message: JointTrajectory) -> None:
        fault = find_fault(message, self._rules.allowed, self._inputs.time_ns)
        if fault:
            self._events.append(TopicRejected(message, fault))
            return
        self._pending, self._is_holding = message, False

    def _take_request(self, request: ActionRequest) -> None:
        if isinstance(request, CancelGoal):
            goal = self._goal
            if goal and goal.request is request.request and goal.outcome is None:
                self._conclude(goal, GoalStatus.CANCELED, 0, "")
                last = self._last.position
                self._hold(self._inputs.position if last is None else last)
            return
        if not isinstance(request, SendGoal):
            return
        message = request.goal.trajectory
        fault = find_fault(message, self._rules.allowed, self._inputs.time_ns)
        if fault:
            code = FollowJointTrajectoryErrorCode.INVALID_GOAL
            result = FollowJointTrajectoryResult(code, fault)
            self._events.append(GoalEvent(request, GoalStatus.REJECTED, result))
            return
        if self._goal is not None:
            if self._goal.outcome is None:
                code = FollowJointTrajectoryErrorCode.INVALID_GOAL
                self._conclude(self._goal, GoalStatus.ABORTED, code, _PREEMPTED_TEXT)
            self._deliver()
        self._pending, self._is_holding = message, False
        self._tolerances, problem = resolve_tolerances(
            request.goal, self._rules.allowed.joints, self._rules.tolerances
        )
        now_ns = self._inputs.time_ns
        due_ns = now_ns + self._rules.monitor_period_ns
        self._goal = ActiveGoal(request, now_ns, due_ns)
        accepted = GoalEvent(request, GoalStatus.EXECUTING, note=problem)
        self._events.append(accepted)

    def _monitor(self, goal: ActiveGoal) -> None:
        """Deliver the result, or else feedback, when it is due."""
        if self._inputs.time_ns < goal.monitor_ns:
            return
        if goal.outcome is not None:
            self._deliver()
            return
        seen = self._last.snapshot
        if seen is not None and seen.time_ns >= goal.accepted_ns:
            make = functools.partial(make_feedback, self._rules.allowed.joints, seen)
            event = GoalEvent(goal.request, GoalStatus.EXECUTING, feedback_source=make)
            self._events.append(event)
        due_ns = goal.monitor_ns + self._rules.monitor_period_ns
        self._goal = dc.replace(goal, monitor_ns=due_ns)

    def _conclude(
        self, goal: ActiveGoal, status: GoalStatus, code: int, text: str
    ) -> None:
        """Note how a goal ended; its monitor delivers that."""
        result = FollowJointTrajectoryResult(int(code), text)
        outcome = GoalEvent(goal.request, status, result)
        self._goal = dc.replace(goal, outcome=outcome)

    def _deliver(self) -> None:
        if self._goal is not None and self._goal.outcome is not None:
            self._events.append(self._goal.outcome)
            self._goal = None

    def _hold(self, position: Array) -> None:
        """Stop at a position, from the next installation on."""
        point = JointTrajectoryPoint(tuple(position))
        joints = self._rules.allowed.joints
        self._pending = JointTrajectory(joint_names=joints, points=(point,))
        self._is_holding = True

    def _install(self, message: JointTrajectory) -> None:
        inputs, commanded = self._inputs, self._commanded
        before = StateBefore(inputs.time_ns, inputs.position, inputs.velocity)
        if self._rules.interpolate_from_desired_state and commanded is not None:
            before = commanded
        ordered = in_joint_order(
            message,
            self._rules.allowed.joints,
            commanded_positions(commanded, inputs.position),
        )
        self._trajectory = Trajectory.from_message(
            ordered,
            before,
            now_ns=inputs.time_ns,
            interpolation=self._rules.interpolation,
            wraparound=self._rules.wraparound,
        )
        self._pending = None
        self._cursor = 0
        self._clock_ns = inputs.time_ns

    def _follow(self, is_first: bool) -> None:
        """Sample the trajectory, command it, and judge how it is followed."""
        trajectory, now_ns = self._trajectory, self._clock_ns
        if trajectory is None:
            return
        looked = self._ahead
        if looked is not None and looked.time_ns == now_ns and not is_first:
            desired: Sample | None = looked.sample  # What the last tick saw ahead.
        else:
            desired = trajectory.sample(now_ns, self._cursor)
        ahead_ns = now_ns + self._rules.look_ahead_ns
        ahead = trajectory.sample(ahead_ns, self._cursor)
        if desired is None or ahead is None:
            return
        self._ahead = LookAhead(ahead_ns, ahead)
        self._cursor = max(self._cursor, desired.segment_start)
        error = self._position_error(desired.position)
        is_finished = ahead.segment_end == len(trajectory.times_ns)
        if is_finished:  # As in jazzy, where only this search ahead is kept.
            self._cursor = max(self._cursor, ahead.segment_start)
        since = since_last_point(trajectory, now_ns) if is_finished else 0.0
        rules = self._rules
        if is_finished and not self._is_holding and 0.0 < rules.cmd_timeout < since:
            self._hold(self._inputs.position)
        is_off_path = is_off_goal = is_late = False
        if not self._is_holding:
            tolerances = self._tolerances
            path, goal = tolerances.path, tolerances.goal
            if path.is_checked and (is_first or not is_finished):
                is_off_path = bool(violates(error, None, None, path).any())
            if goal.is_checked and is_finished:
                is_off_goal = bool(violates(error, None, None, goal).any())
                is_late = is_off_goal and 0.0 != tolerances.goal_time < since
        if not (is_off_path or is_late):
            self._commanded = StateBefore(
                self._inputs.time_ns, ahead.position, ahead.velocity, ahead.acceleration
            )
        self._snapshot = Snapshot(
            self._inputs.time_ns,
            desired,
            now_ns - trajectory.start_ns,
            self._inputs.position,
            self._inputs.velocity,
            error,
            commanded_positions(self._commanded, self._inputs.position),
        )
        self._judge(trajectory, is_off_path, is_finished and not is_off_goal, is_late)

    def _judge(
        self, trajectory: Trajectory, is_off_path: bool, is_there: bool, is_late: bool
    ) -> None:
        """End the goal, or stop the motion, if it is time to."""
        goal = self._goal
        if goal is None or goal.outcome is not None:
            if is_off_path or is_late:
                self._hold(self._inputs.position)
            return
        codes = FollowJointTrajectoryErrorCode
        if is_off_path:
            code = codes.PATH_TOLERANCE_VIOLATED
            self._conclude(goal, GoalStatus.ABORTED, code, _PATH_TEXT)
            self._hold(self._inputs.position)
        elif is_there:
            self._conclude(goal, GoalStatus.SUCCEEDED, codes.SUCCESSFUL, _SUCCESS_TEXT)
            self._repeat_last_point(trajectory)
        elif is_late:
            late = since_last_point(trajectory, self._clock_ns)
            text = f"Aborted due to goal_time_tolerance exceeding by {late:f} seconds"
            code = codes.GOAL_TOLERANCE_VIOLATED
            self._conclude(goal, GoalStatus.ABORTED, code, text)
            self._hold(self._inputs.position)

    def _repeat_last_point(self, trajectory: Trajectory) -> None:
        """Hold the last point of a trajectory, with its velocities if it has some."""
        last = dc.replace(trajectory.message.points[-1], time_from_start=Duration())
        joints = self._rules.allowed.joints
        self._pending = JointTrajectory(joint_names=joints, points=(last,))
        self._is_holding = True

    def _position_error(self, desired: Array) -> Array:
        """Return desired less measured positions, within half a turn if endless."""
        error = desired - self._inputs.position
        endless = self._rules.wraparound
        if endless is None:
            return error
        shortest = shortest_angular_distance(self._inputs.position, desired)
        return np.where(endless, shortest, error)
