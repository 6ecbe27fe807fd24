"""Which point of a trajectory is the target, as Gazebo's own controller has it.

Source: gz-sim, src/systems/joint_trajectory_controller/JointTrajectoryController.cc.
n is the number of the controller's joints.
"""

from collections.abc import Mapping
from typing import NamedTuple

from arm_drake.arrays import Array
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint


class Following(NamedTuple):
    """A trajectory on its way; it has points."""

    message: JointTrajectory

    # When it starts [ns].
    start_ns: int

    # The point that is the target; None before the start.
    point: int | None = None

    @property
    def progress(self) -> float:
        """Part of the points so far, that of the target included."""
        so_far = 0 if self.point is None else self.point + 1
        return so_far / len(self.message.points)


class Targets(NamedTuple):
    """What joints are to do; arrays of shape (n,) that nobody changes."""

    # [rad] or [m].
    position: Array

    # [rad/s] or [m/s].
    velocity: Array

    # [N·m] or [N].
    effort: Array


def advance(following: Following, time_ns: int) -> Following:
    """Return a trajectory with the target of a time; itself if that is no other.

    The first point is the target from the start on, each further one as soon as the
    time since the start is above the `time_from_start` of the one before.

    Args:
        following: The trajectory.
        time_ns: The time [ns].
    """
    elapsed_ns = time_ns - following.start_ns
    if elapsed_ns < 0:
        return following
    points, point = following.message.points, following.point or 0
    last = len(points) - 1
    while point < last and points[point].time_from_start.to_nanoseconds() < elapsed_ns:
        point += 1
    return following if point == following.point else following._replace(point=point)


def take_targets(
    targets: Targets,
    point: JointTrajectoryPoint,
    names: tuple[str, ...],
    joints: Mapping[str, int],
) -> Targets:
    """Return the targets of a point; what it lacks stays as it was.

    Args:
        targets: The targets before.
        point: The point; it may have fewer values than there are names.
        names: Names of the trajectory's joints.
        joints: Index of each of the controller's joints; others are passed over.
    """
    new = Targets(*(part.copy() for part in targets))
    given = (point.positions, point.velocities, point.effort)
    for values, goal in zip(given, new, strict=True):
        for name, value in zip(names, values, strict=False):
            if name in joints:
                goal[joints[name]] = value
    return new
