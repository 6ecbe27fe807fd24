"""State and rules of a joint_trajectory_controller, see `joint_trajectory`."""

import dataclasses as dc
from typing import NamedTuple

import numpy as np

from arm_drake.control.tolerances import Array, Mask, Tolerances
from arm_drake.control.trajectory import Interpolation, Sample, StateBefore, Trajectory
from arm_drake.control.trajectory_validation import TrajectoryRules
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    Duration,
    FollowJointTrajectoryFeedback,
    GoalEvent,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    Message,
    SendGoal,
    Time,
    TopicRejected,
)


@dc.dataclass(frozen=True)
class JointTrajectoryRules:
    """Numbers of a controller of n joints that don't change while it runs."""

    # What is allowed in a trajectory, and the joints.
    allowed: TrajectoryRules

    # Tolerances where a goal asks for none.
    tolerances: Tolerances

    # How far ahead commands are sampled: a period of the controller [ns].
    look_ahead_ns: int

    # Period in which goals give feedback and results [ns].
    monitor_period_ns: int

    interpolation: Interpolation = "splines"

    # Whether trajectories start from the last command instead of the measured state.
    interpolate_from_desired_state: bool = False

    # How long the last point is held before the joints stop where they are [s]; 0 is
    # for ever.
    cmd_timeout: float = 0.0

    # Which joints turn without end, shape (n,); None if none does.
    wraparound: Mask | None = None


class Snapshot(NamedTuple):
    """What a tick saw: reference, measurement and error, each of shape (n,)."""

    time_ns: int

    # Trajectory at the time, and the time since its start.
    desired: Sample
    desired_from_start_ns: int

    # Measured.
    position: Array
    velocity: Array | None

    # Reference minus measurement.
    error: Array

    # What is commanded.
    command: Array


class LookAhead(NamedTuple):
    """The sample that a tick commanded: the next tick's reference."""

    time_ns: int
    sample: Sample


@dc.dataclass(frozen=True, eq=False)
class ActiveGoal(Message):
    """A goal that was accepted and whose result isn't delivered yet."""

    request: SendGoal

    # When it was accepted [ns].
    accepted_ns: int

    # When feedback or the result is due [ns].
    monitor_ns: int

    # How it ended.
    outcome: GoalEvent | None = None


class JointTrajectoryState(NamedTuple):
    """State of the controller; None where nothing has happened yet.

    A tuple, for it is made anew at every tick.
    """

    trajectory: Trajectory | None = None

    # What replaces the trajectory at the next tick.
    pending: JointTrajectory | None = None

    # Whether the trajectory holds the joints where they stopped.
    is_holding: bool = False

    # Segment that the last sample was in, and the time of that sample [ns].
    cursor: int = 0
    clock_ns: int = 0

    tolerances: Tolerances | None = None
    goal: ActiveGoal | None = None

    # Measured positions and the last commanded point.
    position: Array | None = None
    commanded: StateBefore | None = None

    snapshot: Snapshot | None = None
    ahead: LookAhead | None = None

    # The latest news, numbered, the newest last.
    events: tuple[tuple[int, GoalEvent | TopicRejected], ...] = ()

    # The messages last seen on the topic and on the action's port.
    topic: JointTrajectory | None = None
    request: ActionRequest | None = None


class TickInputs(NamedTuple):
    """What a tick reads."""

    time_ns: int
    period_ns: int

    # Measured, shape (n,); velocities if there is such a state interface.
    position: Array
    velocity: Array | None

    # What lies on the topic and on the action's port.
    topic: JointTrajectory | None
    request: ActionRequest | None


def make_feedback(
    joints: tuple[str, ...], snapshot: Snapshot
) -> FollowJointTrajectoryFeedback:
    """Return the feedback message of what a tick saw.

    Args:
        joints: The controller's joints, n of them.
        snapshot: What the tick saw.
    """
    return FollowJointTrajectoryFeedback(
        header=Header(stamp=Time.from_nanoseconds(snapshot.time_ns)),
        joint_names=joints,
        desired=make_point(
            snapshot.desired.position,
            snapshot.desired.velocity,
            snapshot.desired.acceleration,
            snapshot.desired_from_start_ns,
        ),
        actual=make_point(
            snapshot.position, snapshot.velocity, None, snapshot.desired_from_start_ns
        ),
        error=make_error(snapshot),
        index=snapshot.desired.segment_end,
    )


def make_error(snapshot: Snapshot) -> JointTrajectoryPoint:
    """Return the error of what a tick saw, as a message.

    Without a velocity command interface, velocity errors stay 0.
    """
    velocity = None if snapshot.velocity is None else np.zeros_like(snapshot.velocity)
    return make_point(snapshot.error, velocity, None, snapshot.desired_from_start_ns)


def make_point(
    position: Array,
    velocity: Array | None,
    acceleration: Array | None,
    from_start_ns: int,
) -> JointTrajectoryPoint:
    """Return arrays as a message; each of shape (n,), None for empty."""
    return JointTrajectoryPoint(
        tuple(position.tolist()),
        () if velocity is None else tuple(velocity.tolist()),
        () if acceleration is None else tuple(acceleration.tolist()),
        (),
        Duration.from_nanoseconds(from_start_ns),
    )


def commanded_positions(commanded: StateBefore | None, measured: Array) -> Array:
    """Return the last commanded positions, or the measured ones before any, (n,)."""
    if commanded is None or commanded.positions is None:
        return measured
    return commanded.positions


def in_joint_order(
    message: JointTrajectory, joints: tuple[str, ...], missing: Array
) -> JointTrajectory:
    """Return a trajectory of all joints in the controller's order.

    Args:
        message: A trajectory of some of the joints, in any order.
        joints: The controller's joints, n of them.
        missing: Positions of the joints that the trajectory leaves out, shape (n,).
    """
    if message.joint_names == joints:
        return message
    at = [
        message.joint_names.index(joint) if joint in message.joint_names else None
        for joint in joints
    ]

    def ordered(values: tuple[float, ...], absent: Array | None) -> tuple[float, ...]:
        if not values:
            return ()
        return tuple(
            (0.0 if absent is None else float(absent[k])) if i is None else values[i]
            for k, i in enumerate(at)
        )

    points = tuple(
        JointTrajectoryPoint(
            ordered(point.positions, missing),
            ordered(point.velocities, None),
            ordered(point.accelerations, None),
            ordered(point.effort, None),
            point.time_from_start,
        )
        for point in message.points
    )
    return JointTrajectory(message.header, joints, points)


def since_last_point(trajectory: Trajectory, time_ns: int) -> float:
    """Return how long the last point of a trajectory is past [s].

    Upstream subtracts seconds, not nanoseconds, and so decides ties by their rounding.
    """
    return time_ns / NANOSECONDS - trajectory.times_ns[-1] / NANOSECONDS
