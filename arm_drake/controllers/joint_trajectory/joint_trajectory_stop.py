"""How a joint_trajectory_controller holds its joints, or brakes them.

The rules are those of ros2_controllers' joint_trajectory_controller (version 6.9.0).
Upstream has one hold message, made once. Holding changes its positions alone; success
makes its point the goal's last one. Two quirks follow and are kept here: after a
success later holds repeat the velocities, accelerations and efforts of that goal's last
point, and a hold while it is being followed already has no new start.
"""

import dataclasses as dc
import math

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.trajectory import Trajectory
from arm_drake.control.trajectory_segments import StateBefore
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    Deceleration,
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.state import JointTrajectoryState
from arm_drake.messages import (
    NANOSECONDS,
    Duration,
    JointTrajectory,
    JointTrajectoryPoint,
)

# A velocity below this counts as zero: epsilon of a 32-bit float.
_EPSILON = float(np.finfo(np.float32).eps)


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

    Args:
        rules: Numbers of the controller.
        state: State to change.
        position: Where the joints are, shape (n,).
        velocity: How fast they move, shape (n,); None if that isn't measured. What
            isn't finite counts as not measured.
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

    Args:
        rules: Numbers of the controller.
        state: State to change.
        position: Where to hold the joints, shape (n,).
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

    Args:
        deceleration: Of each joint [rad/s^2], shape (n,).
        limits: Greatest velocities [rad/s], shape (n,).
        period_ns: Time between the points [ns].
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
    moves = (t < duration) & (np.abs(velocity) > _EPSILON)
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
