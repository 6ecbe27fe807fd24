"""Rules, state and inputs of a joint_trajectory_controller, and its messages.

n is the number of joints, m that of commanded joints and k that of claimed command
interfaces: all commanded joints of the first, then all of the second, and so on.

Which trajectories are taken, and in which order faults are looked for, is ruled by
ros2_controllers' joint_trajectory_controller (`validate_trajectory_msg`, version
6.9.0); numbers that aren't finite and joints named twice, which upstream lets through
to its undefined behaviour, are refused as well. Messages (`publish_state`,
`query_state_service`) are made when someone looks at them, commands of what is sampled.
"""

import dataclasses as dc
import functools
import math
from collections import Counter
from collections.abc import Callable, Collection
from typing import NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array, Mask
from arm_drake.control.action_goals import ActiveGoal
from arm_drake.control.pid import Pid, PidState
from arm_drake.control.tolerances import EPSILON, Tolerances
from arm_drake.control.trajectory import Interpolation, Sample, StateBefore, Trajectory
from arm_drake.controllers.topics import Event
from arm_drake.errors import suggest
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    Duration,
    FollowJointTrajectoryFeedback,
    GoalStatus,
    Header,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    Message,
    QueryTrajectoryState,
    SpeedScalingFactor,
    Time,
)
from arm_drake.messages.base import append_events, make_lazy


@dataclass(frozen=True)
class TrajectoryRules:
    """Rules of a controller for trajectories."""

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
    """Return why a trajectory is refused, or None if it isn't."""
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
        abs(velocity) > EPSILON for velocity in last.velocities
    ):
        return (
            f"the last point has velocities {list(last.velocities)}; they must be 0, "
            "or allow_nonzero_velocity_at_trajectory_end set"
        )
    stamp_ns = message.header.stamp.to_nanoseconds()
    if stamp_ns == 0:
        return None
    end_ns = stamp_ns + last.time_from_start.to_nanoseconds()
    if end_ns >= now_ns:
        return None
    return (
        f"ends in the past: at {end_ns / NANOSECONDS} s, and it is "
        f"{now_ns / NANOSECONDS} s; a stamp of 0 starts now"
    )


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
    return _fault_in_jumps(message, rules) if rules.needed else None


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


class Deceleration(NamedTuple):
    """Deceleration of joints, instead of a stop at once."""

    # Of each joint [rad/s^2] or [m/s^2], above 0, shape (n,).
    decelerations: Array

    # Points that a braking trajectory has at least.
    num_points: int


@dataclass(frozen=True, eq=False)
class JointTrajectoryRules(Message):
    """Numbers of a controller of n joints. New ones may hold from any tick on."""

    # What is allowed in a trajectory, and the joints.
    allowed: TrajectoryRules

    # Tolerances where a goal asks for none.
    tolerances: Tolerances

    # How far ahead commands are sampled: a period of the controller [ns].
    look_ahead_ns: int

    # Period in which goals give feedback and results [ns].
    monitor_period_ns: int

    # What is commanded of each commanded joint.
    command_interfaces: tuple[str, ...] = ("position",)

    # Index of each commanded joint, m of them; None commands all in their order.
    commanded_joints: tuple[int, ...] | None = None

    interpolation: Interpolation = "splines"

    # Whether trajectories start from the last command instead of the measured state.
    interpolate_from_desired_state: bool = False

    # How long the last point is held before the joints stop where they are [s]; 0 is
    # for ever.
    cmd_timeout: float = 0.0

    # Which joints turn without end, shape (n,); None if none does.
    wraparound: Mask | None = None

    # Which joints are prismatic, shape (n,); None if none is.
    is_prismatic: Mask | None = None

    # PIDs of all joints, and how much of the velocity is added to their output, (n,).
    pid: Pid | None = None
    ff_velocity_scale: Array | None = None

    # Whether the last command counts from its own time, not from the new trajectory's.
    starts_at_last_command: bool = True

    # Whether trajectories lead from the last commanded efforts to those of points.
    carries_effort: bool = True

    # Whether it starts from what was commanded before its activation.
    starts_from_commands: bool = True

    # How joints brake when a goal is cancelled or fails; None stops them at once.
    deceleration: Deceleration | None = None

    # Whether a new trajectory is blended with the one that runs.
    allow_replacement: bool = False

    # Rate of positions without times [Hz], 0 for none; None leaves trajectories alone.
    upsampling_frequency: float | None = None

    # How fast time passes, to start with, and whether interfaces tell or are told it.
    initial_scaling_factor: float = 1.0
    has_scaling_state: bool = False
    has_scaling_command: bool = False

    # Whether a look-ahead that sees the end also ends the search for the next sample.
    is_cursor_pinned: bool = False

    # How a goal ends that another one preempts.
    preempted_status: GoalStatus = GoalStatus.ABORTED
    preempted_text: str = "Current goal preempted by new incoming action."

    # Names of the joints.
    joints: tuple[str, ...] = dc.field(init=False)

    # Whether positions are commanded and nothing else; of all joints in their order.
    is_position_only: bool = dc.field(init=False)
    is_plain: bool = dc.field(init=False)

    # Whether velocities and accelerations have errors, if they are measured.
    has_velocity_error: bool = dc.field(init=False)
    has_acceleration_error: bool = dc.field(init=False)

    def __post_init__(self) -> None:
        """Prepare what every tick would find out anew."""
        commands = self.command_interfaces
        is_position_only = commands == ("position",)
        derived = {
            "joints": self.allowed.joints,
            "is_position_only": is_position_only,
            "is_plain": is_position_only and self.commanded_joints is None,
            "has_velocity_error": "velocity" in commands or "effort" in commands,
            "has_acceleration_error": "acceleration" in commands,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def command_of(self, commands: Array, interface: str) -> Array | None:
        """Return the values of one interface by joint, shape (n,).

        `commands` shape (k,); `interface`: None is returned for others.
        """
        if interface not in self.command_interfaces:
            return None
        m = len(commands) // len(self.command_interfaces)
        first = m * self.command_interfaces.index(interface)
        values = commands[first : first + m]
        if self.commanded_joints is None:
            return values
        by_joint = np.full(len(self.joints), math.nan)
        by_joint[list(self.commanded_joints)] = values
        return by_joint


class Plan(NamedTuple):
    """Part of the state that seldom changes from tick to tick."""

    # Rules of the last tick; messages are judged by them.
    rules: JointTrajectoryRules | None = None

    is_active: bool = False

    trajectory: Trajectory | None = None

    # How many points a replacement put before those of its message.
    num_prefix: int = 0

    # What replaces the trajectory at the next tick.
    pending: JointTrajectory | None = None

    # Whether trajectory and pending message are the controller's one hold message.
    is_hold_installed: bool = False
    is_hold_pending: bool = False

    # Whether the trajectory holds the joints where they stopped.
    is_holding: bool = False

    # The point of the hold message.
    hold: JointTrajectoryPoint = JointTrajectoryPoint()

    # Points that the longest braking trajectory had so far.
    num_stop_points: int = 0

    # Tolerances of the last goal; None before the first activation.
    tolerances: Tolerances | None = None

    cmd_timeout: float = 0.0

    # How fast time is to pass; None before the first activation.
    requested_scaling: float | None = None

    # The latest events, numbered, the newest last.
    events: tuple[tuple[int, Event], ...] = ()

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class JointTrajectoryState(NamedTuple):
    """State of the controller; None where nothing has happened yet.

    A tuple, for it is made anew at every tick. Arrays are never changed.
    """

    plan: Plan = Plan()
    goal: ActiveGoal | None = None

    # Time of the last tick, and how far trajectories are followed [ns].
    time_ns: int = 0
    clock_ns: int = 0

    # Segment that the last sample was in.
    cursor: int = 0

    # Measured in the last tick, shape (n,). After an activation this is what was
    # commanded before it, if that counts.
    position: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None

    # Reference of the last tick, and reference minus measurement, shape (n,).
    desired: Sample | None = None
    error: Array | None = None

    # The point that the last tick commanded, for the time after it [ns].
    ahead_ns: int = -1
    ahead: Sample | None = None

    # The last commanded point, and when it was commanded [ns].
    commanded: Sample | StateBefore | None = None
    commanded_ns: int = 0

    # Values of the command interfaces, shape (k,); NaN is not written. The second is
    # what is reported: the last values that were all finite.
    command: Array | None = None
    output: Array | None = None

    pid: PidState | None = None

    # How fast time passes: 1 as it does, 0 not at all.
    scaling_factor: float = 1.0

    @property
    def seen(self) -> int:
        """Last segment of the trajectory that was sampled; -1 if none was."""
        return -1 if self.ahead is None else self.ahead.segment_end

    @property
    def events(self) -> tuple[tuple[int, Event], ...]:
        """The latest events, numbered, the newest last."""
        return self.plan.events

    @property
    def speed_scaling_command(self) -> float:
        """Value of the command interface of speed scaling, if there is one."""
        requested = self.plan.requested_scaling
        return 1.0 if requested is None else requested

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class TickInputs(NamedTuple):
    """Inputs of a tick. Nobody changes the arrays afterwards."""

    time_ns: int

    # Time since the last tick [ns].
    period_ns: int

    # Measured, shape (n,); None without such state interfaces.
    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None

    # Returns the present values of the command interfaces, shape (k,); NaN where
    # nothing was commanded so far. None stands for NaN everywhere.
    commands: Callable[[], Array] | None = None

    # What has come since the last tick, in order.
    topics: tuple[JointTrajectory, ...] = ()
    requests: tuple[ActionRequest, ...] = ()
    scaling_factors: tuple[SpeedScalingFactor, ...] = ()

    # What the state interface of speed scaling says.
    scaling_state: float | None = None


def present_commands(rules: JointTrajectoryRules, inputs: TickInputs) -> Array:
    """Return the present values of the command interfaces, shape (k,)."""
    if inputs.commands is not None:
        return inputs.commands()
    joints = rules.joints if rules.commanded_joints is None else rules.commanded_joints
    return np.full(len(joints) * len(rules.command_interfaces), math.nan)


def errors_of(
    rules: JointTrajectoryRules, inputs: TickInputs, desired: Sample, error: Array
) -> tuple[Array, Array | None, Array | None]:
    """Return reference minus measurement, each of shape (n,); None isn't compared.

    Velocities are compared if they are measured, and velocities or efforts commanded;
    accelerations if both are.

    `error` shape (n,).
    """
    velocity = acceleration = None
    if rules.has_velocity_error and inputs.velocity is not None:
        reference = desired.velocity
        velocity = None if reference is None else reference - inputs.velocity
    if rules.has_acceleration_error and inputs.acceleration is not None:
        reference = desired.acceleration
        acceleration = None if reference is None else reference - inputs.acceleration
    return error, velocity, acceleration


def make_command(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    desired: Sample,
    ahead: Sample,
    error: Array,
) -> tuple[Array, PidState | None]:
    """Return the values of all command interfaces, shape (k,), and what PIDs remember.

    Efforts beside positions are those of the present, all others are one period ahead.
    What a PID commands is, with the velocities v and efforts u one period ahead::

        ff_velocity_scale v + u + PID(error, error of the velocity)

    where velocities are commanded, without u.

    `error` shape (n,).
    """
    if rules.pid is not None:
        last = rules.pid.initial() if state.pid is None else state.pid
        _, rate, _ = errors_of(rules, inputs, desired, error)
        pid = rules.pid.step(last, error, inputs.period_ns / NANOSECONDS, rate)
        return command_of_pid(rules, ahead, pid.command), pid
    vectors = [_open_loop(name, desired, ahead) for name in rules.command_interfaces]
    n = len(rules.joints)
    values = [np.full(n, math.nan) if v is None else v for v in vectors]
    if rules.commanded_joints is not None:
        at = list(rules.commanded_joints)
        values = [vector[at] for vector in values]
    return (values[0] if len(values) == 1 else np.concatenate(values)), state.pid


def command_of_pid(rules: JointTrajectoryRules, ahead: Sample, output: Array) -> Array:
    """Return the values of all command interfaces, shape (k,), by what PIDs put out."""
    if rules.ff_velocity_scale is not None and ahead.velocity is not None:
        output = rules.ff_velocity_scale * ahead.velocity + output
    if rules.command_interfaces == ("effort",) and ahead.effort is not None:
        output = output + ahead.effort
    if rules.commanded_joints is not None:
        output = output[list(rules.commanded_joints)]
    return output


def _open_loop(interface: str, desired: Sample, ahead: Sample) -> Array | None:
    match interface:
        case "position":
            return ahead.position
        case "velocity":
            return ahead.velocity
        case "acceleration":
            return ahead.acceleration
    return desired.effort


def add_events(state: JointTrajectoryState, *new_events: Event) -> JointTrajectoryState:
    """Return the state with more events."""
    events = append_events(state.plan.events, new_events)
    return state._replace(plan=state.plan._replace(events=events))


_INTERFACES = ("position", "velocity", "acceleration", "effort")
_AT_ONCE = Duration()


class Snapshot(NamedTuple):
    """Reference, measurement and error of a tick, each of shape (n,)."""

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
    """Return a point, past the checks of what a user gives: 0.28 us, and 1.65 us."""
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
