"""The tick and the life cycle of a joint_trajectory_controller.

Pure functions from one state to the next, by the rules of ros2_controllers'
joint_trajectory_controller (`update`, `on_activate`, `on_deactivate`, version 6.9.0):
commands are the trajectory one period ahead, errors and tolerances are those of the
present; what stops a motion acts from the next tick on.

Upstream reads run-time parameters in its ticks: messages are judged by the rules of the
last tick, and the tolerances of a goal stay until the next goal, whatever the rules.
"""

import math

import numpy as np

from arm_drake.controllers.joint_trajectory.goals import (
    conclude,
    is_executing,
    monitor,
    receive,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_following import follow
from arm_drake.controllers.joint_trajectory.joint_trajectory_install import (
    commanded_before,
    install,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_report import (
    make_controller_state,
    make_query_response,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_stop import (
    hold,
    make_hold_point,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    Plan,
    TickInputs,
    present_commands,
)
from arm_drake.messages import FollowJointTrajectoryErrorCode, GoalStatus

__all__ = [
    "activate",
    "deactivate",
    "idle",
    "make_controller_state",
    "query",
    "receive",
    "tick",
]

_DEACTIVATED_TEXT = "Current goal cancelled during deactivate transition."

query = make_query_response


def activate(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after an activation: the joints are held where they are.

    That is where they were commanded to be before, if `rules.starts_from_commands`.
    Messages among the inputs are left to the tick.

    Args:
        rules: Numbers of the controller.
        state: State before; the initial one, or that of a deactivation.
        inputs: What is read.
    """
    plan, commands = state.plan, present_commands(rules, inputs)
    before = commanded_before(rules, inputs, commands)
    assert before.positions is not None
    timeout, requested = rules.cmd_timeout, plan.requested_scaling
    if requested is None:
        is_scaled = rules.is_position_only
        requested = rules.initial_scaling_factor if is_scaled else 1.0
    plan = Plan(
        rules=rules,
        is_active=True,
        hold=plan.hold if plan.hold.positions else make_hold_point(rules),
        num_stop_points=plan.num_stop_points,
        tolerances=plan.tolerances or rules.tolerances,
        cmd_timeout=timeout if timeout > rules.tolerances.goal_time else 0.0,
        requested_scaling=requested,
        events=plan.events,
    )
    state = JointTrajectoryState(
        plan=plan,
        goal=state.goal,
        time_ns=inputs.time_ns,
        position=before.positions,
        velocity=before.velocities,
        acceleration=before.accelerations,
        commanded=before,
        command=np.full(len(commands), math.nan),
        output=state.output,
        pid=None if rules.pid is None else rules.pid.initial(),
        scaling_factor=requested,
    )
    return hold(rules, state, before.positions)


def deactivate(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after a deactivation.

    The goal aborts. Velocity, acceleration and effort commands become 0, and position
    commands stay.

    Args:
        rules: Numbers of the controller.
        state: State of an active controller.
        inputs: What is read; not used.
    """
    del inputs
    if is_executing(state):
        code = FollowJointTrajectoryErrorCode.INVALID_GOAL
        state = conclude(state, GoalStatus.ABORTED, code, _DEACTIVATED_TEXT)
    num_joints = len(rules.commanded_joints or rules.joints)
    halt = [math.nan if i == "position" else 0.0 for i in rules.command_interfaces]
    return state._replace(
        plan=state.plan._replace(is_active=False, pending=None, is_hold_pending=False),
        command=np.repeat(halt, num_joints),
    )


def idle(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after a tick of an inactive controller.

    Messages are refused, and results that are due are told.

    Args:
        rules: Numbers of the controller.
        state: State of an inactive controller.
        inputs: What is read.
    """
    rules = state.plan.rules or rules
    return monitor(rules, receive(rules, state, inputs), inputs.time_ns)


def tick(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after a tick of an active controller.

    A controller that was never activated is activated first.

    Args:
        rules: Numbers of the controller.
        state: State after the last tick.
        inputs: What is read in this tick.
    """
    if state.plan.rules is None:
        state = activate(rules, state, inputs)
    last = state.plan.rules or rules
    if inputs.topics or inputs.requests or inputs.scaling_factors:
        state = receive(last, state, inputs)
    goal = state.goal
    if goal is not None and goal.monitor_ns <= inputs.time_ns:
        state = monitor(last, state, inputs.time_ns)
    if last is not rules:
        state = state._replace(plan=state.plan._replace(rules=rules))
    factor = inputs.scaling_state
    if rules.has_scaling_state and factor is not None and math.isfinite(factor):
        state = state._replace(scaling_factor=factor)
    is_first = state.plan.pending is not None
    if is_first:
        state = install(rules, state, inputs)
    return follow(rules, state, inputs, is_first)
