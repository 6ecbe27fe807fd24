"""Which trajectories a joint_trajectory_controller takes.

The rules and their order are those of ros2_controllers' joint_trajectory_controller
(`validate_trajectory_msg`); numbers that aren't finite and joints named twice, which
upstream lets through to its undefined behaviour, are refused as well.
"""

import dataclasses as dc
import math
from collections import Counter
from collections.abc import Collection

from arm_drake.errors import suggest
from arm_drake.messages import NANOSECONDS, JointTrajectory, JointTrajectoryPoint

# A velocity below this counts as zero: epsilon of a 32-bit float.
_EPSILON = 1.1920929e-7


@dc.dataclass(frozen=True)
class TrajectoryRules:
    """What a controller allows in a trajectory."""

    # The controller's joints.
    joints: tuple[str, ...]

    # Whether a trajectory may leave joints out.
    allow_partial_joints_goal: bool = False

    # Whether the last point may have a velocity.
    allow_nonzero_velocity_at_trajectory_end: bool = False

    # Whether positions may be left out and be integrated.
    allow_integration_in_goal_trajectories: bool = False

    # Whether efforts can be commanded.
    has_effort_command: bool = False

    # Fields that every point must have, and those that the first one may lack.
    needed: tuple[str, ...] = ()
    known_at_start: tuple[str, ...] = ()


def needed_fields(
    command_interfaces: Collection[str], interpolation: str
) -> tuple[str, ...]:
    """Return which fields every point must have.

    With interpolation "none" a point is commanded as it is. What it lacks, upstream
    reads from an empty vector, and crashes.

    Args:
        command_interfaces: What is commanded.
        interpolation: "splines" or "none".
    """
    if interpolation != "none":
        return ()
    fields = ["positions"]
    # Efforts come with errors of velocities.
    if {"velocity", "effort"} & set(command_interfaces):
        fields.append("velocities")
    if "acceleration" in command_interfaces:
        fields.append("accelerations")
    if "effort" in command_interfaces:
        fields.append("effort")
    return tuple(fields)


def find_fault(
    message: JointTrajectory, rules: TrajectoryRules, now_ns: int
) -> str | None:
    """Return why a trajectory is refused, or None if it isn't.

    Args:
        message: The trajectory.
        rules: What is allowed.
        now_ns: Time at which it arrives [ns].
    """
    return (
        _fault_in_joints(message, rules)
        or _fault_in_end(message, rules, now_ns)
        or _fault_in_points(message, rules)
    )


def _fault_in_joints(message: JointTrajectory, rules: TrajectoryRules) -> str | None:
    names = message.joint_names
    if not names:
        return "no joint_names; name the joints of the positions"
    if not message.points:
        return "no points; a trajectory needs at least one"
    for name in names:
        if name not in rules.joints:
            return f"unknown joint {name!r}; {suggest(name, rules.joints)}"
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        return f"joint {repeated[0]!r} is named twice; name each joint once"
    missing = [joint for joint in rules.joints if joint not in names]
    if missing and not rules.allow_partial_joints_goal:
        return (
            f"joints {missing} are missing; name all joints, or set "
            "allow_partial_joints_goal"
        )
    return None


def _fault_in_end(
    message: JointTrajectory, rules: TrajectoryRules, now_ns: int
) -> str | None:
    last = message.points[-1]
    if not rules.allow_nonzero_velocity_at_trajectory_end and any(
        abs(velocity) > _EPSILON for velocity in last.velocities
    ):
        return (
            f"the last point has velocities {list(last.velocities)}; they must be 0, "
            "or allow_nonzero_velocity_at_trajectory_end set"
        )
    stamp_ns = message.header.stamp.to_nanoseconds()
    end_ns = stamp_ns + last.time_from_start.to_nanoseconds()
    if stamp_ns != 0 and end_ns < now_ns:
        return (
            f"ends in the past: at {end_ns / NANOSECONDS} s, and it is "
            f"{now_ns / NANOSECONDS} s; a stamp of 0 starts now"
        )
    return None


def _fault_in_points(message: JointTrajectory, rules: TrajectoryRules) -> str | None:
    n = len(message.joint_names)
    before: JointTrajectoryPoint | None = None
    for index, point in enumerate(message.points):
        time = point.time_from_start
        if before is not None and time <= before.time_from_start:
            return (
                f"points[{index}].time_from_start is {time.to_seconds()} s, after "
                f"{before.time_from_start.to_seconds()} s; times must increase"
            )
        fault = _fault_in_point(point, n, rules)
        if fault:
            return f"points[{index}].{fault}"
        before = point
    return _fault_in_jumps(message, rules)


def _fault_in_jumps(message: JointTrajectory, rules: TrajectoryRules) -> str | None:
    """Return what points lack that are commanded as they are."""
    first = message.points[0].time_from_start.to_nanoseconds()
    # Such a point is the end of its trajectory, where what is missing is 0.
    is_end = len(message.points) == 1 and first == 0
    is_end &= message.header.stamp.to_nanoseconds() == 0
    for index, point in enumerate(message.points):
        for field in rules.needed:
            is_known = index == 0 and (is_end or field in rules.known_at_start)
            if not getattr(point, field) and (field == "positions" or not is_known):
                return (
                    f"points[{index}] has no {field}; with interpolation_method 'none' "
                    f"every point needs {', '.join(rules.needed)}"
                )
    return None


def _fault_in_point(
    point: JointTrajectoryPoint, n: int, rules: TrajectoryRules
) -> str | None:
    vectors = {
        "positions": point.positions,
        "velocities": point.velocities,
        "accelerations": point.accelerations,
        "effort": point.effort,
    }
    motion = ("positions", "velocities", "accelerations")
    if not rules.allow_integration_in_goal_trajectories and not point.positions:
        return f"positions has no elements; expected {n}, one per joint"
    if not any(vectors[name] for name in motion):
        return f"positions has no elements; expected {n}, one per joint"
    if point.effort and not rules.has_effort_command:
        return "effort is given; the controller has no effort command interface"
    for name, values in vectors.items():
        if values and len(values) != n:
            return f"{name} has {len(values)} elements; expected {n}, one per joint"
        for index, value in enumerate(values):
            if not math.isfinite(value):
                return f"{name}[{index}] is {value}; expected a finite number"
    return None
