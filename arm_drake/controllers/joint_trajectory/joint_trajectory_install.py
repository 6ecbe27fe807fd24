"""How a joint_trajectory_controller starts to follow a message.

The rules are those of ros2_controllers' joint_trajectory_controller (`update`,
version 6.9.0).
"""

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.trajectory import Trajectory
from arm_drake.control.trajectory_replacement import (
    blend,
    in_joint_order,
    positions_or,
    scaled,
)
from arm_drake.control.trajectory_segments import StateBefore
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
    present_commands,
)
from arm_drake.messages import JointTrajectory

# A time of the last command up to this counts as none: in seconds, epsilon of a 32-bit
# float [ns].
_NO_TIME_NS = 119


def install(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state that follows the pending message from now on.

    Args:
        rules: Numbers of the controller.
        state: State with a pending message.
        inputs: What the tick reads.
    """
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

    Args:
        rules: Numbers of the controller.
        inputs: What the activation reads.
        commands: Present values of the command interfaces, shape (k,).
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
