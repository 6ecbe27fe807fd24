"""The ``GripperActionController`` of three packages, which command grippers to a goal.

A goal is reached within `goal_tolerance` of it; the gripper stalls when it was slower
than `stall_velocity_threshold` for longer than `stall_timeout`. What was commanded last
goes on after a goal has ended. The action server lives from the first activation on. A
goal that is executed when the controller is deactivated goes on when it is activated
again: at the position held then it has been reached.

Sources: ros2_controllers, `gripper_controllers` (jazzy), for `position_controllers` and
`effort_controllers`; `parallel_gripper_controller` (version 6.9.0), for
``parallel_gripper_action_controller``. Their rules are the same but for what is
written.
"""

import dataclasses as dc
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.action_goals import ActiveGoal, answer_cancel
from arm_drake.control.pid import Pid, PidGains, PidState
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    SteadyCommand,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.topics import (
    ALWAYS,
    GRIPPER_COMMAND,
    Inbox,
    TopicController,
    add_event,
    find_part_fault,
    position_of,
)
from arm_drake.description.parameters import (
    ParameterGroup,
    check_at_least,
    check_finite,
    check_not_empty,
    per_element_of,
)
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    CancelGoal,
    Float32,
    Float64,
    GoalEvent,
    GoalStatus,
    GripperCommandGoal,
    GripperCommandResult,
    JointState,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
    Result,
    SendGoal,
)

_INACTIVE = "the controller was never active; activate it first"


@dataclass(frozen=True)
class GripperActionControllerParameters:
    """Parameters of a GripperActionController that commands a position."""

    # Joint to command.
    joint: str

    # Rate of results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # Distance at which a goal is reached, at least 0 [rad] or [m].
    goal_tolerance: float = 0.01

    # Largest effort of a hold, at least 0 [N·m] or [N].
    max_effort: float = 0.0

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool = False

    # Speed below which the gripper stalls [rad/s] or [m/s], and after how long [s].
    stall_velocity_threshold: float = 0.001
    stall_timeout: float = 1.0

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Report the effect of numbers that are NaN."""
        done = "the gripper counts as standing, however fast it is"
        params.warn_of_nan("stall_velocity_threshold", done)
        params.warn_of_nan("stall_timeout", "the gripper never stalls")

    def __post_init__(self) -> None:
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(self, 0.0, "goal_tolerance", "max_effort")


@dataclass(frozen=True)
class GripperPidGains:
    """PID of a gripper's joint."""

    # Proportional gain, of the error.
    p: float = 0.0

    # Integral gain, of the error's integral over time.
    i: float = 0.0

    # Derivative gain, of the error's rate.
    d: float = 0.0

    # Limit of the integral term, on both sides; 0 switches it off.
    i_clamp: float = 0.0

    def __post_init__(self) -> None:
        check_finite(self, "p", "i", "d")
        check_at_least(self, 0.0, "i_clamp")


@dataclass(frozen=True)
class GripperGains:
    """PIDs by joint."""

    joint: dict[str, GripperPidGains] = per_element_of("joint")


@dataclass(frozen=True)
class EffortGripperActionControllerParameters(GripperActionControllerParameters):
    """Parameters of a GripperActionController that commands an effort."""

    gains: GripperGains = GripperGains()


@dataclass(frozen=True)
class ParallelGripperActionControllerParameters(GripperActionControllerParameters):
    """Parameters of a GripperActionController with limits of effort and velocity."""

    # Interfaces to read of the joint.
    state_interfaces: tuple[str, ...] = ("position", "velocity")

    # Full name of the interface that takes the limit of the effort; "" is none.
    max_effort_interface: str = ""

    # Effort where a goal has none, at least 0 [N·m] or [N].
    max_effort: float = 10.0

    # Full name of the interface that takes the limit of the velocity; "" is none.
    max_velocity_interface: str = ""

    # Velocity where a goal has none, at least 0 [rad/s] or [m/s].
    max_velocity: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(self, 0.0, "stall_timeout", "max_velocity")
        limits = [self.max_effort_interface, self.max_velocity_interface]
        for name in filter(None, limits):
            if name == f"{self.joint}/{interfaces.POSITION}" or limits.count(name) > 1:
                raise ValueError(
                    "max_effort_interface and max_velocity_interface must be two "
                    f"interfaces beside the position, got {limits}"
                )


class Target(NamedTuple):
    """Target position of the joint, with effort and velocity."""

    # [rad] or [m].
    position: float

    # [N·m] or [N].
    max_effort: float = 0.0

    # [rad/s] or [m/s].
    max_velocity: float = 0.0


class Ending(NamedTuple):
    """Final state of a goal that ended by itself."""

    # [rad] or [m].
    position: float

    # What was commanded last [N·m] or [N].
    effort: float

    is_stalled: bool


class GripperState(NamedTuple):
    """State of a gripper controller between two ticks."""

    # What to write, shape (k,); NaN while it is inactive.
    command: Array

    # Where it is to go; None before the first activation.
    target: Target | None = None

    goal: ActiveGoal | None = None

    # When the joint moved last, or the goal was accepted [ns].
    moved_ns: int = 0

    # Effort that the last tick commanded, or what it was limited to.
    effort: float = 0.0

    pid: PidState | None = None

    # What was measured last [rad] or [m], and per second.
    position: float = math.nan
    velocity: float = math.nan

    inbox: Inbox = Inbox()


class GripperControllerBase(TopicController[GripperState]):
    """Moves one joint to the position of a goal, and reports the result.

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad,     measured positions, then velocities, of all J
                              rad/s    joints of the robot
    gripper_cmd         --    --       SendGoal of a GripperCommandGoal, or of a
                                       ParallelGripperCommandGoal, or CancelGoal
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       where it is known what that is
    command_interfaces  --    --       UpdateResult; the position, or with gains the
                                       effort; then as there are such interfaces the
                                       largest effort and the largest velocity
    events              --    --       tuple of the latest (number, event), the newest
                                       last; an event is a GoalEvent, a CancelResponse
                                       or a TopicRejected
    ==================  ====  =======  =================================================
    """

    @abstractmethod
    def __init__(
        self,
        parameters: GripperActionControllerParameters,
        params: ControllerInterfaceParams,
        *,
        claims: tuple[str, ...],
        limits: Mapping[str, str] | None = None,
        pid: Pid | None = None,
        max_velocity: float = 0.0,
    ) -> None:
        """Create the system."""
        joint = parameters.joint
        self._config, self._max_velocity = parameters, max_velocity
        self._monitor_ns = int(1.0 / parameters.action_monitor_rate * NANOSECONDS)
        # Commands efforts; without it, positions are.
        self._pid = pid
        self._unknown = np.full(len(claims), np.nan)
        super().__init__(
            params,
            GripperState(self._unknown),
            state_interfaces=interfaces.interface_names(
                (joint,), (interfaces.POSITION, interfaces.VELOCITY)
            ),
            command_interfaces=claims,
            limit_interfaces=limits,
        )
        self._subscribe(
            "gripper_cmd", ActionRequest, self._take_request, despite=ALWAYS
        )
        self._range = params.gripper_ranges.get(joint)
        self.message_types = {}
        if self._range is not None:
            self._subscribe(GRIPPER_COMMAND, Float64, self._take_part, despite=ALWAYS)
            self.message_types = {GRIPPER_COMMAND: Float32}
        # Of both in one tick, a gripper command counts first.
        self._topics.reverse()
        self._declare_events()

    @abstractmethod
    def _read_goal(self, goal: object) -> Target | str:
        """Return the target of a goal, or in words why there is none."""

    @abstractmethod
    def _make_result(self, ending: Ending | None) -> Result:
        """Return the result of a goal; None is one that has been cancelled."""

    @abstractmethod
    def _write(self, target: Target, effort: float) -> Array:
        """Return the command, shape (k,), for a target and the effort of the tick."""

    def _activate(self, now: UpdateContext, state: GripperState) -> GripperState:
        position, _ = self._measured_now(now).tolist()
        pid = None if self._pid is None else self._pid.initial()
        return state._replace(target=self._target_at(position), pid=pid)

    def _update(self, now: UpdateContext, state: GripperState) -> GripperState:
        state = self._receive(now, state)
        target = state.target
        assert target is not None  # Since the activation.
        error = target.position - state.position
        state = self._judge(state, now.time_ns, error)
        effort, pid = target.max_effort, state.pid
        if self._pid is not None:
            assert pid is not None
            dt = now.period_ns / NANOSECONDS
            rate = np.array([-state.velocity])
            pid = self._pid.step(pid, np.array([error]), dt, rate)
            most = abs(target.max_effort)
            effort = min(max(float(pid.command[0]), -most), most)
        command = self._write(target, effort)
        return state._replace(effort=effort, pid=pid, command=command)

    def steady(
        self, last: UpdateResult[GripperState], time_ns: int
    ) -> SteadyTicks[GripperState] | None:
        """Return the command that holds where no goal is watched."""
        if self._pid is not None or last.state.goal is not None:
            return None
        return SteadyCommand(last.command, last.state, self._sense)

    def _sense(self, state: GripperState, time_ns: int, motions: Array) -> GripperState:
        position, velocity = motions[self._read_at].tolist()
        return state._replace(position=position, velocity=velocity)

    def _deactivate(self, now: UpdateContext, state: GripperState) -> GripperState:
        return state._replace(command=self._unknown)

    def _receive(
        self, now: UpdateContext, state: GripperState, obstacle: str = ""
    ) -> GripperState:
        """Return the state after messages were taken and due results were sent.

        It does so while it is inactive, too.
        """
        position, velocity = self._measured_now(now).tolist()
        state = state._replace(position=position, velocity=velocity)
        state = super()._receive(now, state, obstacle)
        goal = state.goal
        if goal is None or now.time_ns < goal.monitor_ns:
            return state
        if goal.outcome is None:
            monitor_ns = goal.next_monitor(now.time_ns, self._monitor_ns)
            return state._replace(goal=dc.replace(goal, monitor_ns=monitor_ns))
        if not goal.is_deliverable:
            return state
        return add_event(state._replace(goal=None), goal.outcome)

    def _take_request(
        self, state: GripperState, message: ActionRequest, time_ns: int
    ) -> tuple[GripperState, str]:
        """Return the state that deals with a request; nothing is wrong with it."""
        if isinstance(message, CancelGoal):
            return self._cancel(state, message), ""
        if isinstance(message, SendGoal):
            return self._take_goal(state, message, time_ns), ""
        return state, ""

    def _take_goal(
        self, state: GripperState, request: SendGoal, time_ns: int
    ) -> GripperState:
        """Return the state that executes a goal, or has rejected it."""
        target = self._read_goal(request.goal) if state.target else _INACTIVE
        if isinstance(target, str):
            rejected = GoalEvent(request, GoalStatus.REJECTED, note=target)
            return add_event(state, rejected)
        state = add_event(state, GoalEvent(request, GoalStatus.EXECUTING))
        state = self._drop_goal(state)
        goal = ActiveGoal(request, time_ns, time_ns + self._monitor_ns)
        return state._replace(target=target, goal=goal, moved_ns=time_ns)

    def _cancel(self, state: GripperState, request: CancelGoal) -> GripperState:
        goal, response = state.goal, answer_cancel(state.goal, request)
        if goal is not None and response.accepted:
            if goal.is_executing:
                goal = goal.end(GoalStatus.CANCELED, self._make_result(None))
                state = state._replace(target=self._target_at(state.position))
            state = state._replace(goal=dc.replace(goal, is_canceling=True))
        return add_event(state, response)

    def _take_part(
        self, state: GripperState, message: Float64, time_ns: int
    ) -> tuple[GripperState, str]:
        """Return the state that goes to a position without a goal."""
        fault = find_part_fault(message)
        if fault or state.target is None:
            return state, fault
        assert self._range is not None
        target = self._target_at(position_of(message.data, self._range))
        if self._pid is not None and not target.max_effort:
            target = target._replace(max_effort=math.inf)
        return self._drop_goal(state)._replace(target=target), ""

    def _drop_goal(self, state: GripperState) -> GripperState:
        """Return the state without its goal, which another one takes the place of."""
        if state.goal is None:
            return state
        result = self._make_result(None)
        event = GoalEvent(state.goal.request, GoalStatus.CANCELED, result)
        return add_event(state._replace(goal=None), event)

    def _target_at(self, position: float) -> Target:
        return Target(position, self._config.max_effort, self._max_velocity)

    def _judge(self, state: GripperState, time_ns: int, error: float) -> GripperState:
        """Return the state that has noted whether the goal ends."""
        goal, rules = state.goal, self._config
        if goal is None or not goal.is_executing:
            return state
        is_reached = abs(error) < rules.goal_tolerance
        if not is_reached:
            if abs(state.velocity) > rules.stall_velocity_threshold:
                return state._replace(moved_ns=time_ns)
            standing = (time_ns - state.moved_ns) / NANOSECONDS
            if not standing > rules.stall_timeout:
                return state
        result = self._make_result(Ending(state.position, state.effort, not is_reached))
        is_good = is_reached or rules.allow_stalling
        status = GoalStatus.SUCCEEDED if is_good else GoalStatus.ABORTED
        return state._replace(goal=goal.end(status, result))


class GripperActionController(GripperControllerBase):
    """Moves a joint to the position of a GripperCommand goal.

    The state is a GripperState. With the goal's position p and the measured
    position q, a tick commands p, or in `effort_controllers`::

        effort = clamp(pid(p - q, -v), ±max_effort)

    so that a goal without max_effort has no effort at all; upstream takes the time of
    the clock on the wall there, here it is the controller's period. A position command
    knows no max_effort, and reports it as the effort of its result.
    """

    goal_type = GripperCommandGoal
    reads_by_now = True

    def __init__(
        self,
        parameters: GripperActionControllerParameters,
        params: ControllerInterfaceParams,
        *,
        interface: Literal["position", "effort"] = "position",
    ) -> None:
        """Create the system."""
        self._commands_effort = is_effort = interface == interfaces.EFFORT
        super().__init__(
            parameters,
            params,
            claims=(f"{parameters.joint}/{interface}",),
            pid=_make_pid(parameters) if is_effort else None,
        )

    def _read_goal(self, goal: object) -> Target | str:
        if not isinstance(goal, GripperCommandGoal):
            return f"expected a GripperCommandGoal, got a {type(goal).__name__}"
        command = goal.command
        for field in ("position", "max_effort"):
            value = getattr(command, field)
            if not math.isfinite(value):
                return f"command.{field} must be finite, got {value}"
        return Target(command.position, command.max_effort)

    def _make_result(self, ending: Ending | None) -> GripperCommandResult:
        if ending is None:
            return GripperCommandResult()
        position, effort, is_stalled = ending
        return GripperCommandResult(position, effort, is_stalled, not is_stalled)

    def _write(self, target: Target, effort: float) -> Array:
        return np.array([effort if self._commands_effort else target.position])


def _make_pid(parameters: GripperActionControllerParameters) -> Pid:
    assert isinstance(parameters, EffortGripperActionControllerParameters)
    gains = parameters.gains.joint.get(parameters.joint, GripperPidGains())
    limit = gains.i_clamp
    return Pid.from_gains(
        [PidGains(gains.p, gains.i, gains.d, i_clamp_max=limit, i_clamp_min=-limit)]
    )


class ParallelGripperActionController(GripperControllerBase):
    """Moves a joint to the position of a ParallelGripperCommand goal.

    The state is a GripperState. A goal names no joint that counts; where it
    gives no effort or velocity, the parameters do. The largest effort and velocity go
    to `max_effort_interface` and `max_velocity_interface`, and hold for the joint's
    drive here, whether its description has such interfaces or not; 0 is no limit.
    """

    goal_type = ParallelGripperCommandGoal
    reads_by_now = True

    def __init__(
        self,
        parameters: ParallelGripperActionControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        effort = parameters.max_effort_interface
        velocity = parameters.max_velocity_interface
        self._has_effort, self._has_velocity = bool(effort), bool(velocity)
        limits = {effort: interfaces.EFFORT, velocity: interfaces.VELOCITY}
        limits.pop("", None)
        super().__init__(
            parameters,
            params,
            claims=(f"{parameters.joint}/{interfaces.POSITION}", *limits),
            limits=limits,
            max_velocity=parameters.max_velocity,
        )

    def _read_goal(self, goal: object) -> Target | str:
        if not isinstance(goal, ParallelGripperCommandGoal):
            name = type(goal).__name__
            return f"expected a ParallelGripperCommandGoal, got a {name}"
        command = goal.command
        if len(command.position) != 1:
            return f"command.position must have 1 value, got {len(command.position)}"
        for field in ("position", "velocity", "effort"):
            for value in getattr(command, field):
                if not math.isfinite(value):
                    return f"command.{field} must be finite, got {value}"
        target = self._target_at(command.position[0])
        if self._has_effort and command.effort:
            target = target._replace(max_effort=command.effort[0])
        if self._has_velocity and command.velocity:
            target = target._replace(max_velocity=command.velocity[0])
        return target

    def _make_result(self, ending: Ending | None) -> ParallelGripperCommandResult:
        if ending is None:
            return ParallelGripperCommandResult()
        state = JointState(position=(ending.position,))
        is_stalled = ending.is_stalled
        return ParallelGripperCommandResult(state, is_stalled, not is_stalled)

    def _write(self, target: Target, effort: float) -> Array:
        values = [target.position]
        if self._has_effort:
            values.append(target.max_effort)
        if self._has_velocity:
            values.append(target.max_velocity)
        return np.array(values)
