"""How Gazebo's plugins for bases with differential drive compute speeds and odometry.

Sources: gz-math, src/SpeedLimiter.cc; gazebo_ros_pkgs, branch ros2,
gazebo_plugins/src/gazebo_ros_diff_drive.cpp. The odometry of gz-math
(src/DiffDriveOdometry.cc) is that of `arm_drake.control.diff_drive`.
"""

import math
from typing import NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose

# Wheels whose rims are nearer to what is asked for have reached it [m/s].
_REACHED = 0.01


class SpeedLimits(NamedTuple):
    """Limits of a speed of Gazebo's DiffDrive [m/s] or [rad/s], and of its rates."""

    min_velocity: float = -math.inf
    max_velocity: float = math.inf
    min_acceleration: float = -math.inf
    max_acceleration: float = math.inf
    min_jerk: float = -math.inf
    max_jerk: float = math.inf

    def limit(self, asked: float, last: float, before: float, dt: float) -> float:
        """Return a speed within the limits: of its jerk, its rate, then its own.

        Unlike ros2_control's, the limits hold in both directions and at all times; of
        a minimum above its maximum, the minimum holds.

        Args:
            asked: What is asked for.
            last: The last speed.
            before: The one before.
            dt: Time between two of them [s].
        """
        rate = (last - before) / dt
        jerk = ((asked - last) / dt - rate) / dt
        if not self.min_jerk <= jerk <= self.max_jerk:
            asked = last + (rate + _clamp(jerk, self.min_jerk, self.max_jerk) * dt) * dt
        rate = (asked - last) / dt
        if not self.min_acceleration <= rate <= self.max_acceleration:
            rate = _clamp(rate, self.min_acceleration, self.max_acceleration)
            asked = last + rate * dt
        return _clamp(asked, self.min_velocity, self.max_velocity)


class EncoderOdometry(NamedTuple):
    """Where a base of Gazebo Classic stands by the turning of its first wheels."""

    pose: PlanarPose = PlanarPose()

    # Along its way, never negative [m/s], and of turning [rad/s].
    speed: float = 0.0
    turning: float = 0.0

    def move(self, left: float, right: float, separation: float, dt: float) -> Self:
        """Return the odometry after the wheels have turned for a while.

        Args:
            left: Velocity of the left wheel's rim [m/s].
            right: That of the right one.
            separation: Distance of the wheels [m].
            dt: How long [s], above 0.
        """
        way, angle = (left + right) / 2.0 * dt, (right - left) / separation * dt
        x, y, heading = self.pose
        direction = heading + angle / 2.0
        pose = PlanarPose(
            x + way * math.cos(direction),
            y + way * math.sin(direction),
            heading + angle,
        )
        return self._replace(pose=pose, speed=abs(way) / dt, turning=angle / dt)


def accelerate(
    desired: Array, measured: Array, told: Array, step: float
) -> tuple[Array, Array]:
    """Return what wheels of Gazebo Classic are told, and what is kept of it.

    Args:
        desired: Velocities of the wheels' rims that are asked for [m/s], shape (n, 2),
            a row for each pair.
        measured: What they are, shape (n, 2).
        told: What was kept the last time, shape (n, 2).
        step: How much a velocity may change [m/s].

    Returns:
        What the wheels are told, shape (n, 2): what is desired where both wheels of a
        pair have nearly reached it. Else what was kept moves by the way that is left,
        or by a step.
    """
    left = desired - measured
    is_there = (np.abs(left) < _REACHED).all(axis=1, keepdims=True)
    kept = np.where(is_there, told, told + np.clip(left, -step, step))
    return np.where(is_there, desired, kept), kept


def _clamp(value: float, low: float, high: float) -> float:
    return max(min(value, high), low)
