"""A new trajectory put into the place of the one that is being followed.

The rules are those of ros2_controllers' joint_trajectory_controller: the order of
joints and what a message leaves out (`sort_to_local_joint_order`, `fill_partial_goal`),
and blending (its parameter `allow_trajectory_replacement`; version 6.9.0). n is the
number of joints.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from arm_drake.arrays import Array
from arm_drake.control.trajectory import Sample, Trajectory
from arm_drake.messages import Duration, JointTrajectory, JointTrajectoryPoint

# Returns the value of a joint, by its index, that a vector doesn't have; for each of
# positions, velocities, accelerations and efforts.
Missing = tuple[Callable[[int], float], ...]


class Replacement(NamedTuple):
    """A blended trajectory."""

    message: JointTrajectory

    # How many of its points are from before the new message.
    num_prefix: int


def in_joint_order(
    message: JointTrajectory, joints: tuple[str, ...], missing: Array
) -> JointTrajectory:
    """Return a trajectory of all joints in the controller's order.

    Args:
        message: A trajectory of some of the joints, in any order.
        joints: The controller's joints, n of them.
        missing: Positions of the joints that the trajectory leaves out, shape (n,).
            What else these lack is 0.
    """
    if message.joint_names == joints:
        return message
    at = _places(message, joints)
    fill: Missing = (lambda k: float(missing[k]), _zero, _zero, _zero)
    points = tuple(_ordered(point, at, fill) for point in message.points)
    return JointTrajectory(message.header, joints, points)


def blend(
    message: JointTrajectory,
    old: Trajectory,
    joints: tuple[str, ...],
    missing: Array,
    *,
    cursor_ns: int,
    delay_ns: int,
    cursor: int,
    seen: int,
) -> Replacement | None:
    """Return a trajectory that goes on with the old one until the new one takes over.

    Its times count from the present place on the old trajectory. Before the handoff
    are the old points, and one at the handoff itself with all that the old trajectory
    has there. Joints that the new trajectory leaves out follow the old one to its end,
    and the others stay at the end of the new one meanwhile.

    None if that isn't possible: joints are left out, and the last point has no
    positions.

    Args:
        message: A new trajectory of some of the joints, in any order.
        old: The trajectory that is being followed.
        joints: The controller's joints, n of them.
        missing: Positions of joints that are left out, where the old trajectory has
            none, shape (n,).
        cursor_ns: Where the old trajectory is being followed [ns].
        delay_ns: Time on it until the new one takes over [ns].
        cursor: Point from which on the old trajectory is searched.
        seen: Greatest `segment_end` of the samples of the old trajectory so far.
    """
    points = message.points
    is_partial = len(message.joint_names) < len(joints)
    if is_partial and not points[-1].positions:
        return None
    handoff_ns = cursor_ns + delay_ns
    at = _places(message, joints)

    def shifted(point: JointTrajectoryPoint, time_ns: int) -> JointTrajectoryPoint:
        time = Duration.from_nanoseconds(time_ns - cursor_ns)
        return JointTrajectoryPoint(
            point.positions, point.velocities, point.accelerations, point.effort, time
        )

    # Points whose segment was sampled have got what they lacked.
    bridge = old.sample(handoff_ns, cursor, seen)
    handoff = -1 if bridge is None else bridge.segment_end
    prefix = [
        shifted(
            old.point(i, is_deduced=i <= seen, is_left=i < seen or i + 1 == handoff),
            time_ns,
        )
        for i, time_ns in enumerate(old.times_ns)
        if cursor_ns < time_ns < handoff_ns
    ]
    first_ns = handoff_ns + points[0].time_from_start.to_nanoseconds()
    if bridge is not None and handoff_ns < first_ns:
        prefix.append(shifted(_point_of(bridge), handoff_ns))

    new = []
    for point in points:
        time_ns = handoff_ns + point.time_from_start.to_nanoseconds()
        there = old.sample(time_ns, cursor, seen) if is_partial else None
        new.append(shifted(_ordered(point, at, _follow_old(there, missing)), time_ns))

    suffix = []
    if is_partial:
        end_ns = handoff_ns + points[-1].time_from_start.to_nanoseconds()
        stays = [i is not None for i in at]
        suffix = [
            shifted(_frozen(old.point(i), stays, new[-1]), time_ns)
            for i, time_ns in enumerate(old.times_ns)
            if time_ns > end_ns
        ]
    blended = JointTrajectory(joint_names=joints, points=(*prefix, *new, *suffix))
    return Replacement(blended, len(prefix))


def _places(message: JointTrajectory, joints: tuple[str, ...]) -> list[int | None]:
    """Return where each joint stands in a message; None if it doesn't."""
    at = {name: i for i, name in enumerate(message.joint_names)}
    return [at.get(joint) for joint in joints]


def _ordered(
    point: JointTrajectoryPoint, at: list[int | None], missing: Missing
) -> JointTrajectoryPoint:
    """Return a point of all joints; a vector that is empty stays so."""
    vectors = (point.positions, point.velocities, point.accelerations, point.effort)
    ordered = (
        tuple(fill(k) if i is None else vector[i] for k, i in enumerate(at))
        if vector
        else ()
        for vector, fill in zip(vectors, missing, strict=True)
    )
    q, v, a, u = ordered
    return JointTrajectoryPoint(q, v, a, u, point.time_from_start)


def _follow_old(there: Sample | None, missing: Array) -> Missing:
    """Return the values of joints that follow the old trajectory."""
    if there is None:
        return (lambda k: float(missing[k]), _zero, _zero, _zero)
    vectors = (there.position, there.velocity, there.acceleration)

    def value_of(vector: Array | None) -> Callable[[int], float]:
        return _zero if vector is None else lambda k: float(vector[k])

    return (*map(value_of, vectors), _zero)


def _point_of(sample: Sample) -> JointTrajectoryPoint:
    vectors = (sample.position, sample.velocity, sample.acceleration, sample.effort)
    q, v, a, u = (() if x is None else tuple(x.tolist()) for x in vectors)
    return JointTrajectoryPoint(q, v, a, u)


def _frozen(
    old: JointTrajectoryPoint, stays: list[bool], end: JointTrajectoryPoint
) -> JointTrajectoryPoint:
    """Return an old point where some joints stay at the end of the new trajectory."""

    def mixed(vector: tuple[float, ...], still: tuple[float, ...]) -> tuple[float, ...]:
        if not vector:
            return ()
        choices = zip(vector, stays, still, strict=True)
        return tuple(rest if stay else value for value, stay, rest in choices)

    zeros = (0.0,) * len(stays)
    return JointTrajectoryPoint(
        mixed(old.positions, end.positions),
        mixed(old.velocities, zeros),
        mixed(old.accelerations, zeros),
        mixed(old.effort, zeros),
    )


def _zero(joint: int) -> float:
    del joint
    return 0.0


def scaled(duration_ns: int, factor: float) -> int:
    """Return a duration [ns] times a factor, cut to whole nanoseconds.

    The product is exact before it is cut, for upstream multiplies in more digits than
    a float has: 10 ms times 0.3 is 2 999 999 ns.
    """
    if factor == 1.0:
        return duration_ns
    numerator, denominator = factor.as_integer_ratio()
    product = duration_ns * numerator
    return product // denominator if product >= 0 else -(-product // denominator)


def positions_or(present: Array | None, measured: Array) -> Array:
    """Return commanded positions, and measured ones where there are none, (n,)."""
    if present is None:
        return measured
    pairs = zip(present.tolist(), measured.tolist(), strict=True)
    merged = measured.copy()
    merged[:] = [q if math.isnan(command) else command for command, q in pairs]
    return merged
