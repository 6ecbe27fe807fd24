"""Splines through positions that come without velocities, or even without times.

The rules are those of ros2_controllers' joint_trajectory_controller
(`positions_upsampling`, version 6.9.0).
"""

import dataclasses as dc

import numpy as np

from arm_drake.arrays import Array
from arm_drake.messages import (
    NANOSECONDS,
    Duration,
    JointTrajectory,
    JointTrajectoryPoint,
)


def upsample(message: JointTrajectory, frequency: float) -> JointTrajectory:
    """Return a trajectory of mere positions with times and velocities.

    If all times are 0, point i is due after (i + 1) / frequency. The velocities make
    its cubic segments twice differentiable. A trajectory that has velocities or
    accelerations, positions of different sizes, or times that don't increase, is
    returned as it is; whether it is allowed is not checked here.

    Args:
        message: Any trajectory.
        frequency: Rate of the points without times [Hz]; 0 gives them none.
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

    Args:
        times: When the points are due [s], shape (m,).
        positions: Positions at the points, shape (m, n).
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
