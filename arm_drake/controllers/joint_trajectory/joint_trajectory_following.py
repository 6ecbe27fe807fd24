"""How a joint_trajectory_controller follows its trajectory in a tick.

The rules are those of ros2_controllers' joint_trajectory_controller (`update`,
version 6.9.0): commands are the trajectory one period ahead, errors and tolerances are
those of the present; what stops a motion acts from the next tick on.

One quirk is kept: when `cmd_timeout` stops a motion with a goal, the goal succeeds.
"""

import math
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.pid import PidState
from arm_drake.control.tolerances import StateTolerances, exceeds
from arm_drake.control.trajectory import Sample, Trajectory, shortest_angular_distance
from arm_drake.control.trajectory_replacement import scaled
from arm_drake.control.trajectory_segments import StateBefore
from arm_drake.controllers.joint_trajectory.goals import conclude
from arm_drake.controllers.joint_trajectory.joint_trajectory_commands import (
    errors_of,
    make_command,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_stop import (
    repeat_last_point,
    stop_motion,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    Plan,
    TickInputs,
    present_commands,
)
from arm_drake.messages import NANOSECONDS, FollowJointTrajectoryErrorCode, GoalStatus

_SUCCESS_TEXT = "Goal successfully reached!"
_PATH_TEXT = "Aborted due to path tolerance violation"


class _Verdict(NamedTuple):
    """How a trajectory is followed."""

    is_timed_out: bool = False
    is_off_path: bool = False
    is_off_goal: bool = False

    # Whether it is off its goal for too long, and how long its end is past [s].
    is_late: bool = False
    late: float = 0.0


_FINE = _Verdict()


class _Commands(NamedTuple):
    """What a tick commands: fields of the state of the same names, in their order."""

    commanded: Sample | StateBefore | None
    commanded_ns: int
    command: Array | None
    output: Array | None
    pid: PidState | None


def follow(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    is_first: bool,
) -> JointTrajectoryState:
    """Return the state that has sampled, judged and commanded the trajectory.

    Args:
        rules: Numbers of the controller.
        state: State with a trajectory.
        inputs: What the tick reads.
        is_first: Whether this is the trajectory's first tick.
    """
    plan, trajectory, measured = state.plan, state.plan.trajectory, inputs.position
    if trajectory is None:
        return state
    clock_ns = state.clock_ns
    if not is_first:
        factor, period_ns = state.scaling_factor, inputs.period_ns
        clock_ns += period_ns if factor == 1.0 else scaled(period_ns, factor)
    ahead_ns = clock_ns + rules.look_ahead_ns
    desired, ahead, cursor = _sample(state, trajectory, clock_ns, ahead_ns)
    if desired is None or ahead is None:
        return state._replace(
            time_ns=inputs.time_ns,
            clock_ns=clock_ns,
            position=measured,
            velocity=inputs.velocity,
            acceleration=inputs.acceleration,
            ahead_ns=-1,
            ahead=None,
        )
    is_finished = ahead.segment_end == len(trajectory.times_ns)
    if is_finished and rules.is_cursor_pinned:
        cursor = ahead.segment_start

    error = desired.position - measured
    if rules.wraparound is not None:
        shortest = shortest_angular_distance(measured, desired.position)
        error = np.where(rules.wraparound, shortest, error)
    verdict = _FINE
    if not plan.is_holding:
        late = _since_last_point(trajectory, clock_ns) if is_finished else None
        checks_path = is_first or not is_finished
        verdict = _judge(rules, plan, inputs, desired, error, checks_path, late)
    if verdict.is_off_path or verdict.is_late:
        commands = _leave(rules, state, inputs)
    elif rules.is_plain:
        values = ahead.position
        commands = _Commands(ahead, inputs.time_ns, values, values, state.pid)
    else:
        commands = _command(rules, state, inputs, desired, ahead, error)
    new = JointTrajectoryState(
        plan,
        state.goal,
        inputs.time_ns,
        clock_ns,
        cursor,
        measured,
        inputs.velocity,
        inputs.acceleration,
        desired,
        error,
        ahead_ns,
        ahead,
        *commands,
        state.scaling_factor,
    )
    if verdict is _FINE and (state.goal is None or not is_finished):
        return new
    return _conclude(rules, new, inputs, trajectory, verdict, is_finished)


def _sample(
    state: JointTrajectoryState, trajectory: Trajectory, clock_ns: int, ahead_ns: int
) -> tuple[Sample | None, Sample | None, int]:
    """Return the trajectory at present and ahead, and where to search next."""
    cursor, desired = state.cursor, state.ahead
    # What the last tick saw ahead is the present, unless the search has moved on.
    if desired is None or state.ahead_ns != clock_ns or desired.segment_start < cursor:
        desired = trajectory.sample(clock_ns, cursor, state.seen)
    if desired is not None and desired.segment_start > cursor:
        cursor = desired.segment_start
    return desired, trajectory.sample(ahead_ns, cursor), cursor


def _leave(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> _Commands:
    """Return the commands of a tick that gives none."""
    output, present = state.output, present_commands(rules, inputs)
    if np.isfinite(present).all():
        output = present
    last, last_ns = state.commanded, state.commanded_ns
    return _Commands(last, last_ns, state.command, output, state.pid)


def _command(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    desired: Sample,
    ahead: Sample,
    error: Array,
) -> _Commands:
    """Return the commands of what isn't positions of all joints alone."""
    command, pid = make_command(rules, state, inputs, desired, ahead, error)
    # A sum is finite only if all of its terms are.
    output = command if math.isfinite(command.sum()) else state.output
    return _Commands(ahead, inputs.time_ns, command, output, pid)


def _since_last_point(trajectory: Trajectory, time_ns: int) -> float:
    """Return how long the last point of a trajectory is past [s].

    Upstream subtracts seconds, not nanoseconds, and so decides ties by their rounding.
    """
    return time_ns / NANOSECONDS - trajectory.times_ns[-1] / NANOSECONDS


def _judge(
    rules: JointTrajectoryRules,
    plan: Plan,
    inputs: TickInputs,
    desired: Sample,
    error: Array,
    checks_path: bool,
    late: float | None,
) -> _Verdict:
    """Return how a trajectory is followed; `late` is None before its end."""
    if late is not None and 0.0 < plan.cmd_timeout < late:
        return _Verdict(is_timed_out=True)
    tolerances = plan.tolerances
    if tolerances is None:
        return _FINE
    is_off_path = is_off_goal = is_late = False
    path, goal = tolerances.path, tolerances.goal
    if path.is_checked and checks_path:
        is_off_path = _exceeds(rules, inputs, desired, error, path)
    if late is not None and goal.is_checked:
        is_off_goal = _exceeds(rules, inputs, desired, error, goal)
        is_late = is_off_goal and 0.0 != tolerances.goal_time < late
    if not (is_off_path or is_off_goal):
        return _FINE
    return _Verdict(False, is_off_path, is_off_goal, is_late, late or 0.0)


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


def _conclude(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    trajectory: Trajectory,
    verdict: _Verdict,
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
        return conclude(state, GoalStatus.ABORTED, code, _PATH_TEXT)
    if verdict.is_late:
        text = (
            f"Aborted due to goal_time_tolerance exceeding by {verdict.late:f} seconds"
        )
        code = codes.GOAL_TOLERANCE_VIOLATED
        return conclude(state, GoalStatus.ABORTED, code, text)
    if is_finished and not verdict.is_off_goal:
        code = codes.SUCCESSFUL
        state = conclude(state, GoalStatus.SUCCEEDED, code, _SUCCESS_TEXT)
        return repeat_last_point(rules, state, trajectory)
    return state
