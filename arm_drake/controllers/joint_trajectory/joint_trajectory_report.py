"""What a joint_trajectory_controller tells of itself, as messages.

The rules are those of ros2_controllers' joint_trajectory_controller (`publish_state`,
`query_state_service`, version 6.9.0). Messages are made when someone looks at them.
"""

import functools
from typing import NamedTuple

from arm_drake.arrays import Array
from arm_drake.control.trajectory import Sample
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.state import JointTrajectoryState
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryFeedback,
    Header,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    QueryTrajectoryState,
    Time,
)
from arm_drake.messages.lazy import make_lazy

_INTERFACES = ("position", "velocity", "acceleration", "effort")
_AT_ONCE = Duration()


class Snapshot(NamedTuple):
    """What a tick saw: reference, measurement and error, each of shape (n,)."""

    time_ns: int

    # Trajectory at the time, and times since its start [ns]: scaled, and as they are.
    desired: Sample
    desired_from_start_ns: int
    actual_from_start_ns: int

    # Measured.
    position: Array
    velocity: Array | None
    acceleration: Array | None

    # Reference minus measurement.
    error: Array

    # Index of the point of the message that the motion is heading for.
    next_point: int


def take_snapshot(state: JointTrajectoryState) -> Snapshot | None:
    """Return what the last tick saw; None if nothing so far."""
    plan, desired, position = state.plan, state.desired, state.position
    if desired is None or position is None or plan.trajectory is None:
        return None
    assert state.error is not None
    start_ns = plan.trajectory.start_ns
    return Snapshot(
        state.time_ns,
        desired,
        state.clock_ns - start_ns,
        state.time_ns - start_ns,
        position,
        state.velocity,
        state.acceleration,
        state.error,
        max(desired.segment_end - plan.num_prefix, 0),
    )


def make_feedback(
    rules: JointTrajectoryRules, snapshot: Snapshot
) -> FollowJointTrajectoryFeedback:
    """Return the feedback message of what a tick saw."""
    reference, feedback, error = _make_points(rules, snapshot)
    return FollowJointTrajectoryFeedback(
        header=Header(stamp=Time.from_nanoseconds(snapshot.time_ns)),
        joint_names=rules.joints,
        desired=reference,
        actual=feedback,
        error=error,
        index=snapshot.next_point,
    )


def make_controller_state(
    rules: JointTrajectoryRules, state: JointTrajectoryState
) -> JointTrajectoryControllerState:
    """Return the message of what the last tick saw and commanded.

    It is made when a field is asked for. Its `output` are the last values of the
    command interfaces that were all finite, 0 before; a joint that isn't commanded has
    NaN.

    Args:
        rules: Numbers of the controller.
        state: State after a tick.
    """
    make = functools.partial(_make_message, rules, state)
    return make_lazy(JointTrajectoryControllerState, make)


def _make_message(
    rules: JointTrajectoryRules, state: JointTrajectoryState
) -> JointTrajectoryControllerState:
    snapshot = take_snapshot(state)
    if snapshot is None:
        return JointTrajectoryControllerState(joint_names=rules.joints)
    reference, feedback, error = _make_points(rules, snapshot)
    return JointTrajectoryControllerState(
        header=Header(stamp=Time.from_nanoseconds(snapshot.time_ns)),
        joint_names=rules.joints,
        reference=reference,
        feedback=feedback,
        error=error,
        output=_make_output(rules, state.output),
        speed_scaling_factor=state.scaling_factor,
    )


def make_query_response(
    rules: JointTrajectoryRules, state: JointTrajectoryState, time_ns: int
) -> QueryTrajectoryState:
    """Return what is planned for a time, the state being untouched.

    It fails outside of the trajectory: the answer is its last point then, or before its
    start what was measured last. (Upstream the search for the next reference goes on
    from the time asked for, and the motion may jump to its end; that isn't copied.)

    Args:
        rules: Numbers of the controller.
        state: State after the last tick.
        time_ns: When [ns].
    """
    if not state.plan.is_active:
        message = "the controller is inactive; activate it first"
        return QueryTrajectoryState(message=message)
    trajectory = state.plan.trajectory
    sample = None
    if trajectory is not None:
        sample = trajectory.sample(time_ns, state.cursor, state.seen)
    if trajectory is None or sample is None:
        what = "there is no trajectory yet"
        if trajectory is not None:
            what = f"the trajectory starts after {time_ns} ns"
        vectors = (state.position, state.velocity, state.acceleration)
        return QueryTrajectoryState(False, what, rules.joints, *map(_floats, vectors))
    is_over = sample.segment_end == len(trajectory.times_ns)
    return QueryTrajectoryState(
        not is_over,
        f"the trajectory ends before {time_ns} ns" if is_over else "",
        rules.joints,
        _floats(sample.position),
        _floats(sample.velocity),
        _floats(sample.acceleration),
    )


def _make_points(
    rules: JointTrajectoryRules, seen: Snapshot
) -> tuple[JointTrajectoryPoint, JointTrajectoryPoint, JointTrajectoryPoint]:
    """Return reference, feedback and error.

    The error of what isn't commanded stays 0.
    """
    desired, v, a = seen.desired, seen.velocity, seen.acceleration
    v_d, a_d = desired.velocity, desired.acceleration
    desired_time, actual_time = (
        Duration.from_nanoseconds(time_ns)
        for time_ns in (seen.desired_from_start_ns, seen.actual_from_start_ns)
    )
    is_sped, is_accelerated = rules.has_velocity_error, rules.has_acceleration_error
    return (
        _point_of(
            _floats(desired.position), _floats(v_d), _floats(a_d), (), desired_time
        ),
        _point_of(_floats(seen.position), _floats(v), _floats(a), (), actual_time),
        _point_of(
            _floats(seen.error),
            _error_of(v_d if is_sped else None, v),
            _error_of(a_d if is_accelerated else None, a),
            (),
            _AT_ONCE,
        ),
    )


def _error_of(desired: Array | None, measured: Array | None) -> tuple[float, ...]:
    """Return reference minus measurement; 0 without a reference."""
    if measured is None:
        return ()
    if desired is None:
        return (0.0,) * len(measured)
    return _floats(desired - measured)


def _make_output(
    rules: JointTrajectoryRules, output: Array | None
) -> JointTrajectoryPoint:
    def values_of(interface: str) -> tuple[float, ...]:
        if output is not None:
            return _floats(rules.command_of(output, interface))
        is_claimed = interface in rules.command_interfaces
        return (0.0,) * len(rules.joints) if is_claimed else ()

    q, v, a, u = map(values_of, _INTERFACES)
    return _point_of(q, v, a, u, _AT_ONCE)


def _point_of(
    positions: tuple[float, ...],
    velocities: tuple[float, ...],
    accelerations: tuple[float, ...],
    effort: tuple[float, ...],
    time_from_start: Duration,
) -> JointTrajectoryPoint:
    """Return a point, past the checks of what a user gives: they take most of it."""
    point = object.__new__(JointTrajectoryPoint)
    fields = point.__dict__
    fields["positions"] = positions
    fields["velocities"] = velocities
    fields["accelerations"] = accelerations
    fields["effort"] = effort
    fields["time_from_start"] = time_from_start
    return point


def _floats(vector: Array | None) -> tuple[float, ...]:
    return () if vector is None else tuple(vector.tolist())
