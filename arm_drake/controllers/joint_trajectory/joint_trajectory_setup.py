"""From the parameters of a JointTrajectoryController to the rules of its ticks."""

import dataclasses as dc
from collections.abc import Mapping

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.pid import Pid
from arm_drake.control.tolerances import Mask, make_default_tolerances
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    Deceleration,
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_stop import min_stop_points
from arm_drake.controllers.joint_trajectory.parameters import (
    JointConstraints,
    JointGains,
    JointTrajectoryControllerParameters,
)
from arm_drake.controllers.joint_trajectory.trajectory_validation import (
    TrajectoryRules,
    needed_fields,
)
from arm_drake.messages import NANOSECONDS, GoalStatus

# Parameters that can't change while the controller runs.
_READ_ONLY = (
    "joints",
    "command_joints",
    "command_interfaces",
    "state_interfaces",
    "interpolate_from_desired_state",
    "open_loop_control",
    "action_monitor_rate",
    "interpolation_method",
    "speed_scaling",
    "constraints.decelerate_on_cancel",
)

# Fields of points by state interface.
_FIELDS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
}

_HUMBLE_PREEMPTED_TEXT = "Current goal cancelled due to new incoming action."


def make_rules(
    parameters: JointTrajectoryControllerParameters,
    *,
    update_rate: int,
    joint_types: Mapping[str, str],
    velocity_limits: Mapping[str, float],
    distro: str,
) -> JointTrajectoryRules:
    """Return the rules of a controller.

    Args:
        parameters: Its parameters.
        update_rate: Rate of its ticks [Hz].
        joint_types: URDF type of joints.
        velocity_limits: URDF velocity limit of joints [rad/s]; others have none.
        distro: Distribution whose behaviour holds.
    """
    joints, constraints = parameters.joints, parameters.constraints
    by_joint = [constraints.joint.get(joint, JointConstraints()) for joint in joints]
    endless = _find_endless(parameters, joint_types)
    upsampling, scaling = parameters.positions_upsampling, parameters.speed_scaling
    period_ns = NANOSECONDS // update_rate
    pid, ff_velocity_scale = _make_pid(parameters, distro)
    is_scaled = parameters.command_interfaces == ("position",)
    rules = JointTrajectoryRules(
        allowed=_make_allowed(parameters),
        tolerances=make_default_tolerances(
            [constraint.trajectory for constraint in by_joint],
            [constraint.goal for constraint in by_joint],
            stopped_velocity_tolerance=constraints.stopped_velocity_tolerance,
            goal_time=constraints.goal_time,
        ),
        look_ahead_ns=period_ns,
        monitor_period_ns=int(NANOSECONDS / parameters.action_monitor_rate),
        command_interfaces=parameters.command_interfaces,
        commanded_joints=_commanded_joints(parameters),
        interpolation=parameters.interpolation_method,
        interpolate_from_desired_state=(
            parameters.interpolate_from_desired_state or parameters.open_loop_control
        ),
        cmd_timeout=parameters.cmd_timeout,
        wraparound=endless if endless.any() else None,
        pid=pid,
        ff_velocity_scale=ff_velocity_scale,
        starts_from_commands=(
            parameters.set_last_command_interface_value_as_state_on_activation
        ),
        deceleration=_make_deceleration(parameters, velocity_limits, period_ns),
        allow_replacement=parameters.allow_trajectory_replacement,
        upsampling_frequency=upsampling.policy_frequency if upsampling.enable else None,
        initial_scaling_factor=scaling.initial_scaling_factor,
        has_scaling_state=is_scaled and bool(scaling.state_interface),
        has_scaling_command=bool(scaling.command_interface),
        is_cursor_pinned=distro == "jazzy",
    )
    if distro != "humble":
        return rules
    return dc.replace(
        rules,
        allowed=dc.replace(rules.allowed, has_effort_command=False),
        starts_at_last_command=False,
        carries_effort=False,
        preempted_status=GoalStatus.CANCELED,
        preempted_text=_HUMBLE_PREEMPTED_TEXT,
    )


def _find_endless(
    parameters: JointTrajectoryControllerParameters, joint_types: Mapping[str, str]
) -> Mask:
    """Return which joints turn without end, shape (n,): by URDF, or humble's gains."""
    gains = parameters.gains.joint
    return np.array(
        [
            joint_types.get(joint) == "continuous"
            or (joint in gains and gains[joint].angle_wraparound)
            for joint in parameters.joints
        ]
    )


def _make_allowed(parameters: JointTrajectoryControllerParameters) -> TrajectoryRules:
    commands, states = parameters.command_interfaces, parameters.state_interfaces
    return TrajectoryRules(
        joints=parameters.joints,
        allow_partial_joints_goal=parameters.allow_partial_joints_goal,
        allow_nonzero_velocity_at_trajectory_end=(
            parameters.allow_nonzero_velocity_at_trajectory_end
        ),
        allow_integration_in_goal_trajectories=(
            parameters.allow_integration_in_goal_trajectories
        ),
        has_effort_command="effort" in commands,
        needed=needed_fields(commands, parameters.interpolation_method),
        known_at_start=("effort", *(_FIELDS[name] for name in states)),
    )


def _commanded_joints(
    parameters: JointTrajectoryControllerParameters,
) -> tuple[int, ...] | None:
    """Return which joints are commanded; None if all are, whatever they are called."""
    joints, commanded = parameters.joints, parameters.command_joints
    if not commanded or len(commanded) == len(joints):
        return None
    return tuple(joints.index(joint) for joint in commanded)


def _make_pid(
    parameters: JointTrajectoryControllerParameters, distro: str
) -> tuple[Pid | None, Array | None]:
    """Return the PIDs of all joints and their feed-forward scales, shape (n,)."""
    commands = parameters.command_interfaces
    is_open = distro == "humble" and parameters.open_loop_control
    if commands not in (("velocity",), ("effort",)) or (
        is_open and commands == ("velocity",)
    ):
        return None, None
    by_joint = parameters.gains.joint
    gains = [by_joint.get(joint, JointGains()) for joint in parameters.joints]
    scales = np.array([gain.ff_velocity_scale for gain in gains])
    return Pid.from_gains(gains, is_humble=distro == "humble"), scales


def _make_deceleration(
    parameters: JointTrajectoryControllerParameters,
    velocity_limits: Mapping[str, float],
    period_ns: int,
) -> Deceleration | None:
    """Return how joints brake; None unless all of them can.

    That takes a deceleration, a velocity limit in the URDF and measured velocities.
    """
    constraints, joints = parameters.constraints, parameters.joints
    if not constraints.decelerate_on_cancel:
        return None
    by_joint = [constraints.joint.get(joint, JointConstraints()) for joint in joints]
    decelerations = np.array([c.max_deceleration_on_cancel for c in by_joint])
    limits = np.array([velocity_limits.get(joint, 0.0) for joint in joints])
    if "velocity" not in parameters.state_interfaces or not (
        (decelerations > 0.0).all() and (limits > 0.0).all()
    ):
        return None
    num_points = min_stop_points(decelerations, limits, period_ns)
    return Deceleration(decelerations, num_points)


def check_change(
    old: JointTrajectoryControllerParameters, new: object
) -> JointTrajectoryControllerParameters:
    """Return parameters that may take the place of others while a controller runs.

    Args:
        old: Parameters in effect.
        new: What is to take their place.

    Raises:
        ValueError: If it can't.
    """
    if not isinstance(new, JointTrajectoryControllerParameters):
        raise ValueError(f"expected JointTrajectoryControllerParameters, got {new!r}")
    changed = [name for name in _READ_ONLY if _get(new, name) != _get(old, name)]
    for joint in old.joints:
        was, is_ = (_decelerations(p).get(joint, 0.0) for p in (old, new))
        if was != is_:
            changed.append(f"constraints.{joint}.max_deceleration_on_cancel")
    if changed:
        raise ValueError(f"{changed[0]} can't change while the controller runs")
    return new


def _decelerations(parameters: JointTrajectoryControllerParameters) -> dict[str, float]:
    by_joint = parameters.constraints.joint.items()
    return {joint: c.max_deceleration_on_cancel for joint, c in by_joint}


def _get(parameters: object, name: str) -> object:
    """Return a parameter by its dotted name."""
    for part in name.split("."):
        parameters = getattr(parameters, part)
    return parameters
