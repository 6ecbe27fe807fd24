"""The ``joint_trajectory_controller/JointTrajectoryController``: tick and life cycle.

Pure functions from one state to the next, by the rules of ros2_controllers'
`joint_trajectory_controller` (`update`, `on_activate`, `on_deactivate`; version 6.9.0
and jazzy): commands are the trajectory one period ahead, errors and tolerances are
those of the present; what stops a motion acts from the next tick on. n is the number of
joints, k that of command interfaces.

Upstream reads run-time parameters in its ticks: messages are judged by the rules of the
last tick, and the tolerances of a goal stay until the next goal, whatever the rules.
One quirk is kept: when `cmd_timeout` stops a motion with a goal, the goal succeeds.
"""

import functools
import math
import operator
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.pid import PidState, PlainPids
from arm_drake.control.tolerances import StateTolerances, exceeds
from arm_drake.control.trajectory import (
    Positions,
    Sample,
    StateBefore,
    Trajectory,
    scaled,
    shortest_angular_distance,
)
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import (
    NEVER_NS,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.joint_trajectory.goals import (
    FINE,
    commanded_before,
    conclude,
    conclude_if_due,
    find_lasting_fault,
    hold,
    install,
    is_executing,
    judge,
    make_hold_point,
    monitor,
    receive,
    send_feedback,
)
from arm_drake.controllers.joint_trajectory.parameters import (
    Inbox,
    JointTrajectoryControllerParameters,
    check_change,
    make_rules,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryRules,
    JointTrajectoryState,
    Plan,
    TickInputs,
    add_events,
    command_of_pid,
    errors_of,
    make_command,
    make_controller_state,
    make_query_response,
    present_commands,
    take_snapshot,
)
from arm_drake.controllers.topics import new_messages, new_parameters
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryGoal,
    GoalStatus,
    JointTrajectory,
    JointTrajectoryControllerState,
    ParametersRejected,
    QueryTrajectoryState,
    SpeedScalingFactor,
    Time,
    TimeLike,
)


class _Commands(NamedTuple):
    """Commands of a tick: fields of the state of the same names, in their order."""

    commanded: Sample | StateBefore | None
    commanded_ns: int
    command: Array | None
    output: Array | None
    pid: PidState | None


def follow(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    is_first: bool,
) -> JointTrajectoryState:
    """Return the state that has sampled, judged and commanded the trajectory."""
    plan, trajectory, measured = state.plan, state.plan.trajectory, inputs.position
    if trajectory is None:
        return state
    clock_ns = state.clock_ns
    if not is_first:
        factor, period_ns = state.scaling_factor, inputs.period_ns
        clock_ns += period_ns if factor == 1.0 else scaled(period_ns, factor)
    ahead_ns = clock_ns + rules.look_ahead_ns
    desired, ahead, cursor = _sample(state, trajectory, clock_ns, ahead_ns)
    if desired is None or ahead is None:
        return _wait(state, inputs, clock_ns)
    is_finished = ahead.segment_end == len(trajectory.times_ns)
    if is_finished and rules.is_cursor_pinned:
        cursor = ahead.segment_start

    error = desired.position - measured
    if rules.wraparound is not None:
        shortest = shortest_angular_distance(measured, desired.position)
        error = np.where(rules.wraparound, shortest, error)
    verdict = FINE
    if not plan.is_holding:
        late = trajectory.since_end(clock_ns) if is_finished else None
        checks_path = is_first or not is_finished
        verdict = judge(rules, plan, inputs, desired, error, checks_path, late)
    if verdict.is_off_path or verdict.is_late:
        commands = _leave(rules, state, inputs)
    elif rules.is_plain:
        values = ahead.position
        commands = _Commands(ahead, inputs.time_ns, values, values, state.pid)
    else:
        commands = _command(rules, state, inputs, desired, ahead, error)
    new = JointTrajectoryState(
        plan,
        state.goal,
        inputs.time_ns,
        clock_ns,
        cursor,
        measured,
        inputs.velocity,
        inputs.acceleration,
        desired,
        error,
        ahead_ns,
        ahead,
        *commands,
        state.scaling_factor,
    )
    if verdict is FINE and (state.goal is None or not is_finished):
        return new
    return conclude_if_due(rules, new, inputs, trajectory, verdict, is_finished)


def _wait(
    state: JointTrajectoryState, inputs: TickInputs, clock_ns: int
) -> JointTrajectoryState:
    """Return the state after a tick before the trajectory starts."""
    return state._replace(
        time_ns=inputs.time_ns,
        clock_ns=clock_ns,
        position=inputs.position,
        velocity=inputs.velocity,
        acceleration=inputs.acceleration,
        ahead_ns=-1,
        ahead=None,
    )


def _sample(
    state: JointTrajectoryState, trajectory: Trajectory, clock_ns: int, ahead_ns: int
) -> tuple[Sample | None, Sample | None, int]:
    """Return the trajectory at present and ahead, and where to search next."""
    cursor, desired = state.cursor, state.ahead
    # What the last tick saw ahead is the present, unless the search has moved on.
    if desired is None or state.ahead_ns != clock_ns or desired.segment_start < cursor:
        desired = trajectory.sample(clock_ns, cursor, state.seen)
    if desired is not None and desired.segment_start > cursor:
        cursor = desired.segment_start
    return desired, trajectory.sample(ahead_ns, cursor), cursor


def _leave(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> _Commands:
    """Return the commands of a tick that gives none."""
    output, present = state.output, present_commands(rules, inputs)
    if np.isfinite(present).all():
        output = present
    last, last_ns = state.commanded, state.commanded_ns
    return _Commands(last, last_ns, state.command, output, state.pid)


def _command(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    desired: Sample,
    ahead: Sample,
    error: Array,
) -> _Commands:
    """Return the commands of what isn't positions of all joints alone."""
    command, pid = make_command(rules, state, inputs, desired, ahead, error)
    # A sum is finite only if all of its terms are.
    output = command if math.isfinite(command.sum()) else state.output
    return _Commands(ahead, inputs.time_ns, command, output, pid)


_DEACTIVATED_TEXT = "Current goal cancelled during deactivate transition."


def activate(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after an activation: the joints are held where they are.

    That is where they were commanded to be before, if `rules.starts_from_commands`.
    Messages among the inputs are left to the tick.
    """
    plan, commands = state.plan, present_commands(rules, inputs)
    before = commanded_before(rules, inputs, commands)
    assert before.positions is not None
    timeout, requested = rules.cmd_timeout, plan.requested_scaling
    if requested is None:
        is_scaled = rules.is_position_only
        requested = rules.initial_scaling_factor if is_scaled else 1.0
    plan = Plan(
        rules=rules,
        is_active=True,
        hold=plan.hold if plan.hold.positions else make_hold_point(rules),
        num_stop_points=plan.num_stop_points,
        tolerances=plan.tolerances or rules.tolerances,
        cmd_timeout=timeout if timeout > rules.tolerances.goal_time else 0.0,
        requested_scaling=requested,
        events=plan.events,
    )
    state = JointTrajectoryState(
        plan=plan,
        goal=state.goal,
        time_ns=inputs.time_ns,
        position=before.positions,
        velocity=before.velocities,
        acceleration=before.accelerations,
        commanded=before,
        command=np.full(len(commands), math.nan),
        output=state.output,
        pid=None if rules.pid is None else rules.pid.initial(),
        scaling_factor=requested,
    )
    return hold(rules, state, before.positions)


def deactivate(
    rules: JointTrajectoryRules, state: JointTrajectoryState
) -> JointTrajectoryState:
    """Return the state after a deactivation.

    The goal aborts. Velocity, acceleration and effort commands become 0, and position
    commands stay.
    """
    if is_executing(state):
        code = FollowJointTrajectoryErrorCode.INVALID_GOAL
        state = conclude(state, GoalStatus.ABORTED, code, _DEACTIVATED_TEXT)
    num_joints = len(rules.commanded_joints or rules.joints)
    halt = [math.nan if i == "position" else 0.0 for i in rules.command_interfaces]
    return state._replace(
        plan=state.plan._replace(is_active=False, pending=None, is_hold_pending=False),
        command=np.repeat(halt, num_joints),
    )


def idle(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after a tick of an inactive controller.

    Messages are refused, and results that are due are told.
    """
    rules = state.plan.rules or rules
    return monitor(rules, receive(rules, state, inputs), inputs.time_ns)


def tick(
    rules: JointTrajectoryRules, state: JointTrajectoryState, inputs: TickInputs
) -> JointTrajectoryState:
    """Return the state after a tick of an active controller.

    A controller that was never activated is activated first.
    """
    if state.plan.rules is None:
        state = activate(rules, state, inputs)
    last = state.plan.rules or rules
    if inputs.topics or inputs.requests or inputs.scaling_factors:
        state = receive(last, state, inputs)
    goal = state.goal
    if goal is not None and goal.monitor_ns <= inputs.time_ns:
        state = monitor(last, state, inputs.time_ns)
    if last is not rules:
        state = state._replace(plan=state.plan._replace(rules=rules))
    factor = inputs.scaling_state
    if rules.has_scaling_state and factor is not None and math.isfinite(factor):
        state = state._replace(scaling_factor=factor)
    is_first = state.plan.pending is not None
    if is_first:
        state = install(rules, state, inputs)
    return follow(rules, state, inputs, is_first)


class JointTrajectoryControllerSystemState(NamedTuple):
    """State of a JointTrajectoryController between two ticks."""

    inbox: Inbox
    control: JointTrajectoryState


class _Course:
    """Common data of steady ticks of a trajectory, whatever has been reported."""

    __slots__ = (
        "ahead",
        "ahead_ns",
        "is_finished",
        "no_events",
        "path",
        "pids",
        "present",
        "present_ns",
        "rules",
        "sense",
        "trajectory",
        "until_ns",
    )

    def __init__(
        self,
        system: JointTrajectoryControllerSystemState,
        time_ns: int,
        sense: Callable[[int, Array], TickInputs],
        dt: float,
    ) -> None:
        """Take what a tick has left at a time, and what gives the inputs of others."""
        rules, state = system.inbox.rules, system.control
        plan, trajectory = state.plan, state.plan.trajectory
        assert trajectory is not None
        self.rules, self.trajectory, self.sense = rules, trajectory, sense
        # From the time to the place on the trajectory [ns], at present and ahead.
        self.present_ns = state.clock_ns - time_ns
        self.ahead_ns = self.present_ns + rules.look_ahead_ns
        self.is_finished = trajectory.ends_with(state.desired)
        self.until_ns = NEVER_NS
        if not self.is_finished:
            self.until_ns = trajectory.times_ns[-1] - self.ahead_ns
        tolerances = plan.tolerances
        self.path: StateTolerances | None = None
        if not (plan.is_holding or self.is_finished or tolerances is None):
            self.path = tolerances.path if tolerances.path.is_checked else None
        # The PIDs, if there are any.
        self.pids = None if rules.pid is None else PlainPids(rules.pid, dt)
        # The positions there.
        self.present = Positions(trajectory, state.cursor)
        self.ahead = Positions(trajectory, state.cursor)
        # The same ticks of a state without events.
        self.no_events: SteadyTrajectory | None = None


class SteadyTrajectory:
    """Steady ticks of `follow`: between two points of a trajectory, or at its end.

    Each of them leaves what `follow` would: the samples are functions of the time, and
    what is measured only counts where a path has tolerances.
    """

    def __init__(
        self,
        system: JointTrajectoryControllerSystemState,
        time_ns: int,
        sense: Callable[[int, Array], TickInputs],
        dt: float,
    ) -> None:
        """Take the state that a tick has left; `dt` is the period [s]."""
        self._take(system, _Course(system, time_ns, sense, dt))

    def _take(
        self, system: JointTrajectoryControllerSystemState, course: "_Course"
    ) -> None:
        self._system, self._last, self._course = system, system.control, course
        self.until_ns, goal = course.until_ns, system.control.goal
        self.monitor_ns = NEVER_NS if goal is None else goal.monitor_ns
        self.is_judging = course.path is not None

    @classmethod
    def can_follow(
        cls, system: JointTrajectoryControllerSystemState, time_ns: int
    ) -> bool:
        """Return whether ticks from a state on are of this kind."""
        rules, state = system.inbox.rules, system.control
        plan, desired, tolerances = state.plan, state.desired, state.plan.tolerances
        is_plain = rules.pid is None or PlainPids.are_plain(rules.pid)
        is_plain = is_plain and rules.wraparound is None
        is_timed = not (rules.has_scaling_state or rules.has_scaling_command)
        if not (is_plain and is_timed and state.scaling_factor == 1.0):
            return False
        if plan.rules is not rules or plan.pending is not None or desired is None:
            return False
        trajectory = plan.trajectory
        if trajectory is None or trajectory.changes or state.time_ns != time_ns:
            return False
        if not trajectory.ends_with(desired):
            is_alone = tolerances is None or tolerances.path.is_position_only
            return state.cursor == desired.segment_start and is_alone
        is_judged = plan.cmd_timeout > 0.0 or (
            tolerances is not None and tolerances.goal_time != 0.0
        )
        is_over = state.goal is None or state.goal.outcome is not None
        return is_over and (plan.is_holding or not is_judged)

    def report(
        self, time_ns: int, last_ns: int, motions: Array
    ) -> "tuple[JointTrajectoryControllerSystemState, SteadyTrajectory] | None":
        """Return the state with the feedback that is due; None if a result is."""
        last, goal, course = self._last, self._last.goal, self._course
        if goal is None or goal.outcome is not None:
            return None
        if course.no_events is None:  # Events with the state would keep all before it.
            plan = last.plan._replace(events=())
            course.no_events = self._after(last._replace(plan=plan, goal=None))
        look = functools.partial(course.no_events._control_at, last_ns, motions)
        new = self._after(send_feedback(course.rules, last, time_ns, last_ns, look))
        return new._system, new

    def _after(self, state: JointTrajectoryState) -> "SteadyTrajectory":
        """Return the ticks after a state that differs in its reports alone."""
        new: SteadyTrajectory = object.__new__(SteadyTrajectory)
        system = JointTrajectoryControllerSystemState(self._system.inbox, state)
        new._take(system, self._course)
        return new

    def _control_at(self, time_ns: int, motions: Array) -> JointTrajectoryState:
        return self.state(time_ns, motions, ()).control

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> list[float] | None:
        """Return the values that a tick commands; None where it has to judge them."""
        course = self._course
        path, ahead_ns = course.path, time_ns + course.ahead_ns
        if course.rules.is_plain and self.allows(time_ns, motions):
            return course.ahead.at(ahead_ns)
        inputs = course.sense(time_ns, motions)
        desired = self._sample(time_ns + course.present_ns)
        error = desired.position - inputs.position
        if path is not None and exceeds(error, None, None, path):
            return None
        ahead = self._sample(ahead_ns)
        if course.pids is None:
            if memory:
                memory[-len(error) :] = desired.position.tolist()
            return self._make_command(inputs, desired, ahead, error).tolist()
        _, rate, _ = errors_of(course.rules, inputs, desired, error)
        rates = None if rate is None else rate.tolist()
        output = course.pids.step(memory, error.tolist(), rates)
        memory += desired.position.tolist()
        if output is None:
            return None
        values = command_of_pid(course.rules, ahead, np.array(output)).tolist()
        return values if math.isfinite(sum(values)) else None

    def allows(self, time_ns: int, motions: Array) -> bool:
        """Return whether what is measured is surely within the path's tolerances."""
        course, path = self._course, self._course.path
        if path is None:
            return True
        wanted = course.present.at(time_ns + course.present_ns)
        position = course.sense(time_ns, motions).position.tolist()
        return path.allows(map(operator.sub, wanted, position))

    def commands_ahead(self, times_ns: Sequence[int]) -> Array | None:
        """Return the positions that ticks command; None where a PID does."""
        course = self._course
        if not course.rules.is_plain:
            return None
        return course.ahead.at_all([t + course.ahead_ns for t in times_ns])

    def _sample(self, time_ns: int) -> Sample:
        sample = self._course.trajectory.sample(time_ns, self._last.cursor)
        assert sample is not None
        return sample

    def _make_command(
        self, inputs: TickInputs, desired: Sample, ahead: Sample, error: Array
    ) -> Array:
        rules = self._course.rules
        if rules.is_plain:
            return ahead.position
        return make_command(rules, self._last, inputs, desired, ahead, error)[0]

    def state(
        self, time_ns: int, motions: Array, memory: Sequence[float]
    ) -> JointTrajectoryControllerSystemState:
        """Return the state that a tick leaves behind."""
        last, course, pid = self._last, self._course, self._last.pid
        inputs = course.sense(time_ns, motions)
        present_ns, ahead_ns = time_ns + course.present_ns, time_ns + course.ahead_ns
        desired, ahead = self._sample(present_ns), self._sample(ahead_ns)
        error = desired.position - inputs.position
        if course.pids is None or not memory:  # Feedback doesn't tell commands.
            values = self._make_command(inputs, desired, ahead, error)
        else:
            *fields, _ = np.split(np.array(memory), len(PidState._fields) + 1)
            pid = PidState(*fields)
            values = command_of_pid(course.rules, ahead, pid.command)
        new = JointTrajectoryState(
            last.plan,
            last.goal,
            time_ns,
            present_ns,
            last.cursor if course.is_finished else desired.segment_start,
            inputs.position,
            inputs.velocity,
            inputs.acceleration,
            desired,
            error,
            ahead_ns,
            ahead,
            ahead,
            time_ns,
            values,
            values,
            pid,
            last.scaling_factor,
        )
        return JointTrajectoryControllerSystemState(self._system.inbox, new)


class JointTrajectoryController(
    TickingController[JointTrajectoryControllerSystemState]
):
    """Moves joints along trajectories, from a topic or as goals of an action.

    With n = len(joints), m = len(command_joints) or n, and vectors in their order:

    =======================  ====  ======  ===========================================
    port                     size  unit    meaning
    =======================  ====  ======  ===========================================
    controller_manager       --    --      Cycle: when to tick
    state_interfaces         2J    rad,    measured positions, then velocities, of
                                   rad/s   all J joints of the robot, or more
    joint_trajectory         --    --      JointTrajectory to follow from now on
    follow_joint_trajectory  --    --      SendGoal or CancelGoal: a goal to reach
    speed_scaling_input      --    --      SpeedScalingFactor; there only where
                                           positions alone are commanded
    parameters               --    --      JointTrajectoryControllerParameters to go
                                           on with
    command_interfaces       --    --      UpdateResult; m values of each of
                                           ``command_interfaces``, one after the
                                           other, and the speed scaling factor if
                                           there is an interface for it
    controller_state         --    --      JointTrajectoryControllerState
    events                   --    --      tuple of the latest (number, event), the
                                           newest last; an event is a GoalEvent, a
                                           CancelResponse, a TopicRejected or a
                                           ParametersRejected
    =======================  ====  ======  ===========================================

    Each port of messages takes one, or a tuple of them in order; those of the topic
    come before those of the action.

    The state is a JointTrajectoryControllerSystemState. At every tick, with period T,
    trajectory s and measured positions q::

        command = s(t + T)          error = s(t) - q

    where velocities or efforts alone are commanded, a PID makes the command of the
    error. An error beyond a path tolerance, or beyond a goal tolerance for longer than
    goal_time after the end, stops the motion and aborts the goal.
    """

    goal_type = FollowJointTrajectoryGoal
    reads_by_now = True

    def __init__(
        self,
        parameters: JointTrajectoryControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        joints, scaling = parameters.joints, parameters.speed_scaling
        states = interfaces.interface_names(joints, parameters.state_interfaces)
        commands = interfaces.interface_names(
            parameters.command_joints or joints, parameters.command_interfaces
        )
        self._num_commands = len(commands)
        self._make_rules = functools.partial(
            make_rules,
            update_rate=params.update_rate,
            joint_types=params.joint_types,
            velocity_limits=params.velocity_limits,
            distro=params.distro,
        )
        rules = self._make_rules(parameters)
        if interfaces.POSITION not in parameters.command_interfaces:
            self.num_remembered = (len(PidState._fields) + 1) * len(joints)
        self._has_scaling_state = bool(scaling.state_interface)  # rules may ignore it
        self._has_scaling_command = rules.has_scaling_command
        super().__init__(
            params,
            JointTrajectoryControllerSystemState(
                Inbox(parameters, rules), JointTrajectoryState()
            ),
            state_interfaces=(*states, scaling.state_interface)
            if self._has_scaling_state
            else states,
            command_interfaces=(*commands, scaling.command_interface)
            if self._has_scaling_command
            else commands,
        )
        n, order = len(joints), parameters.state_interfaces
        at = {name: slice(n * k, n * (k + 1)) for k, name in enumerate(order)}
        self._position_at = at[interfaces.POSITION]
        self._velocity_at = at.get(interfaces.VELOCITY)
        self._acceleration_at = at.get(interfaces.ACCELERATION)
        self._topic = self._declare_input("joint_trajectory")
        self._action = self._declare_input("follow_joint_trajectory")
        name = "speed_scaling_input"
        self._scaling = self._declare_input(name) if rules.is_position_only else None
        self._parameters = self._declare_input(interfaces.PARAMETERS_PORT)
        self._declare_topic("controller_state", self._describe)
        self._declare_topic("events", operator.attrgetter("control.plan.events"))
        self._unknown = np.full(self._num_commands, np.nan)

    def query_state(self, context: Context, time: TimeLike) -> QueryTrajectoryState:
        """Return what is planned for a time: the service `query_state`."""
        inbox, state = self._state(context)
        time_ns = Time.of(time).to_nanoseconds()
        return make_query_response(inbox.rules, state, time_ns)

    def find_lasting_fault(self, context: Context, message: object) -> str:
        """Return why the last tick's rules refuse a trajectory whenever it comes."""
        if not isinstance(message, JointTrajectory | FollowJointTrajectoryGoal):
            return ""
        return find_lasting_fault(self._state(context).inbox.rules, message)

    def _declare_input(self, name: str) -> InputPort:
        return self.DeclareAbstractInputPort(name, AbstractValue.Make(()))

    def _update(
        self, now: UpdateContext, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        inbox, inputs, last = self._receive(now, state)
        new = tick(inbox.rules, last, inputs)
        return JointTrajectoryControllerSystemState(inbox, new)

    def steady(
        self, last: UpdateResult[JointTrajectoryControllerSystemState], time_ns: int
    ) -> SteadyTicks[JointTrajectoryControllerSystemState] | None:
        """Return how it follows a trajectory between two of its points."""
        # Accelerations and scaling factors that are read take ticks in full.
        if self.reads_all or not SteadyTrajectory.can_follow(last.state, time_ns):
            return None
        period_ns = self.whole_period_ns
        if last.state.inbox.rules.pid is not None and not period_ns:
            return None
        dt = (period_ns or 0) / NANOSECONDS
        return SteadyTrajectory(last.state, time_ns, self._sense_motions, dt)

    def remember(self, state: JointTrajectoryControllerSystemState) -> list[float]:
        """Return what PIDs remember, and the reference where it is no command."""
        pid, seen = state.control.pid, take_snapshot(state.control)
        n = self.num_remembered // (len(PidState._fields) + 1)
        reference = [math.nan] * n if seen is None else seen.desired.position.tolist()
        if pid is None:
            return [0.0] * (self.num_remembered - n) + reference
        return [number for field in (*pid, reference) for number in field]

    def _sense_motions(self, time_ns: int, motions: Array) -> TickInputs:
        measured, velocity_at = motions[self._read_at], self._velocity_at
        velocity = None if velocity_at is None else measured[velocity_at]
        return TickInputs(time_ns, 0, measured[self._position_at], velocity)

    def _idle(
        self, now: UpdateContext, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        inbox, inputs, last = self._receive(now, state)
        new = idle(inbox.rules, last, inputs)
        return JointTrajectoryControllerSystemState(inbox, new)

    def rests(self, state: JointTrajectoryControllerSystemState) -> bool:
        """Return whether only a message can change the state while inactive."""
        return state.control.goal is None  # Else its result is due.

    def _activate(
        self, now: UpdateContext, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        inbox, last = self._take_parameters(now, state.inbox, state.control)
        new = activate(inbox.rules, last, self._sense(now))
        return JointTrajectoryControllerSystemState(inbox, new)

    def _deactivate(
        self, now: UpdateContext, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        return state._replace(control=deactivate(state.inbox.rules, state.control))

    def _receive(
        self, now: UpdateContext, state: JointTrajectoryControllerSystemState
    ) -> tuple[Inbox, TickInputs, JointTrajectoryState]:
        """Return what has come in, the inputs of the tick, and the state before it."""
        if now.is_quiet:
            return state.inbox, self._sense(now), state.control
        inbox, last = self._take_parameters(now, state.inbox, state.control)
        context = now.context
        topics, seen_topics = new_messages(
            self._topic, context, JointTrajectory, inbox.topics
        )
        requests, seen_requests = new_messages(
            self._action, context, ActionRequest, inbox.requests
        )
        factors: tuple[SpeedScalingFactor, ...] = ()
        seen_factors = inbox.factors
        if self._scaling is not None:
            factors, seen_factors = new_messages(
                self._scaling, context, SpeedScalingFactor, seen_factors
            )
        inputs = self._sense(now)
        if topics or requests or factors:
            inputs = inputs._replace(
                topics=topics, requests=requests, scaling_factors=factors
            )
        inbox = inbox._replace(
            topics=seen_topics, requests=seen_requests, factors=seen_factors
        )
        return inbox, inputs, last

    def _take_parameters(
        self, now: UpdateContext, inbox: Inbox, last: JointTrajectoryState
    ) -> tuple[Inbox, JointTrajectoryState]:
        """Return the inbox with new parameters, and the state that reports a fault."""
        received_parameters = new_parameters(
            self._parameters, now.context, inbox.received_parameters
        )
        if received_parameters is inbox.received_parameters:
            return inbox, last
        parameters, rules = inbox.parameters, inbox.rules
        if received_parameters != ():
            try:
                parameters = check_change(parameters, received_parameters)
                rules = self._make_rules(parameters)
            except ValueError as error:
                last = add_events(last, ParametersRejected(str(error)))
        return inbox._replace(
            parameters=parameters, rules=rules, received_parameters=received_parameters
        ), last

    def _sense(self, now: UpdateContext) -> TickInputs:
        """Return what the tick reads besides messages."""
        measured = self._measured_now(now)
        velocity_at, acceleration_at = self._velocity_at, self._acceleration_at
        return TickInputs(
            now.time_ns,
            now.period_ns,
            measured[self._position_at],
            None if velocity_at is None else measured[velocity_at],
            None if acceleration_at is None else measured[acceleration_at],
            lambda: self._read_commands(now)[: self._num_commands],
            (),
            (),
            (),
            float(measured[-1]) if self._has_scaling_state else None,
        )

    def _command(self, state: JointTrajectoryControllerSystemState) -> Array:
        command = state.control.command
        if command is None:
            command = self._unknown
        if not self._has_scaling_command:
            return command
        return np.append(command, state.control.speed_scaling_command)

    def _describe(
        self, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerState:
        return make_controller_state(state.inbox.rules, state.control)
