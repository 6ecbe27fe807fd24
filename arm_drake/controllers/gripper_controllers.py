"""The ``GripperActionController`` of three packages, which command grippers to a goal.

Sources: ros2_controllers, `gripper_controllers` (jazzy), for `position_controllers` and
`effort_controllers`; `parallel_gripper_controller` (version 6.9.0), for
``parallel_gripper_action_controller``. The tick itself is `arm_drake.control.gripper`.
"""

import dataclasses as dc
import functools
import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control import gripper as control
from arm_drake.control.gripper import (
    Ending,
    GripperInputs,
    GripperRules,
    GripperState,
    Target,
)
from arm_drake.control.pid import Pid, PidGains
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import (
    GRIPPER_COMMAND,
    find_part_fault,
    new_messages,
    position_of,
)
from arm_drake.description.parameters import (
    check_at_least,
    check_finite,
    check_not_empty,
    per_element_of,
)
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    Float32,
    Float64,
    GripperCommandGoal,
    GripperCommandResult,
    JointState,
    Message,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
    Result,
    SendGoal,
    TopicRejected,
)


class GripperControllerState(NamedTuple):
    """State of a gripper controller between two ticks."""

    control: GripperState = GripperState()

    # Whether it writes: an end of an activation leaves all as it is.
    is_active: bool = False

    # What was on the ports at the last tick.
    requests: tuple[ActionRequest, ...] = ()
    parts: tuple[Float64, ...] = ()


class GripperControllerBase(TickingController[GripperControllerState]):
    """Moves one joint to the position of a goal, and tells whether it got there."""

    @abstractmethod
    def __init__(
        self,
        rules: GripperRules,
        params: ControllerInterfaceParams,
        *,
        joint: str,
        claims: tuple[str, ...],
        limits: Mapping[str, str] | None = None,
    ) -> None:
        """Create the system."""
        self._rules = rules
        states = interfaces.interface_names(
            (joint,), (interfaces.POSITION, interfaces.VELOCITY)
        )
        super().__init__(
            params,
            GripperControllerState(),
            state_interfaces=states,
            command_interfaces=claims,
            limit_interfaces=limits or {},
        )
        nothing = AbstractValue.Make(())
        self._action = self.DeclareAbstractInputPort("gripper_cmd", nothing)
        self._range = params.gripper_ranges.get(joint)
        self.message_types: dict[str, type[Message]] = {}
        if self._range is not None:
            self._part = self.DeclareAbstractInputPort(GRIPPER_COMMAND, nothing)
            self.message_types = {GRIPPER_COMMAND: Float32}
        self._declare_topic("events", lambda state: state.control.events)
        self._unknown = np.full(len(claims), np.nan)

    @abstractmethod
    def _write(self, state: GripperState) -> Array:
        """Return the command, shape (k,), of a controller that has been active."""

    def _update(
        self, now: UpdateContext, state: GripperControllerState
    ) -> GripperControllerState:
        state, inputs = self._receive(now, state)
        return state._replace(control=control.tick(self._rules, state.control, inputs))

    def _idle(
        self, now: UpdateContext, state: GripperControllerState
    ) -> GripperControllerState:
        state, inputs = self._receive(now, state)
        new = control.idle(self._rules, state.control, inputs)
        return state if new is state.control else state._replace(control=new)

    def _activate(
        self, now: UpdateContext, state: GripperControllerState
    ) -> GripperControllerState:
        new = control.activate(self._rules, state.control, self._sense(now))
        return state._replace(control=new, is_active=True)

    def _deactivate(
        self, now: UpdateContext, state: GripperControllerState
    ) -> GripperControllerState:
        return state._replace(is_active=False)

    def _command(self, state: GripperControllerState) -> Array:
        if state.control.target is None or not state.is_active:
            return self._unknown
        return self._write(state.control)

    def _receive(
        self, now: UpdateContext, state: GripperControllerState
    ) -> tuple[GripperControllerState, GripperInputs]:
        """Return the state with what came in, and the inputs of the tick."""
        requests, seen = new_messages(
            self._action, now.context, ActionRequest, state.requests
        )
        if seen is not state.requests:
            state = state._replace(requests=seen)
        inputs = self._sense(now)
        if requests:
            inputs = inputs._replace(requests=requests)
        if self._range is None:
            return state, inputs
        new, parts = new_messages(self._part, now.context, Float64, state.parts)
        if parts is state.parts:
            return state, inputs
        taken = state.control
        for message in new:
            fault = find_part_fault(message)
            if fault:
                taken = control.add_events(taken, TopicRejected(message, fault))
            else:
                at = position_of(message.data, self._range)
                taken = control.command(self._rules, taken, at)
        return state._replace(control=taken, parts=parts), inputs

    def _sense(self, now: UpdateContext) -> GripperInputs:
        """Return what the tick reads besides messages."""
        position, velocity = self._read(now.context).tolist()
        return GripperInputs(now.time_ns, now.period_ns, position, velocity)


def make_rules(
    parameters: Any,
    *,
    read_goal: Callable[[GripperRules, SendGoal], Target | str],
    make_result: Callable[[Ending | None], Result],
    max_velocity: float = 0.0,
    pid: Pid | None = None,
) -> GripperRules:
    """Return the rules of a controller.

    `max_velocity` [rad/s] or [m/s].
    """
    return GripperRules(
        goal_tolerance=parameters.goal_tolerance,
        allow_stalling=parameters.allow_stalling,
        stall_velocity_threshold=parameters.stall_velocity_threshold,
        stall_timeout=parameters.stall_timeout,
        monitor_period_ns=int(1.0 / parameters.action_monitor_rate * NANOSECONDS),
        max_effort=parameters.max_effort,
        max_velocity=max_velocity,
        read_goal=read_goal,
        make_result=make_result,
        pid=pid,
    )


@dc.dataclass(frozen=True)
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

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(self, 0.0, "goal_tolerance", "max_effort")


@dc.dataclass(frozen=True)
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
        """Reject what the types alone can't express."""
        check_finite(self, "p", "i", "d")
        check_at_least(self, 0.0, "i_clamp")


@dc.dataclass(frozen=True)
class GripperGains:
    """PIDs by joint."""

    joint: dict[str, GripperPidGains] = per_element_of("joint")


@dc.dataclass(frozen=True)
class EffortGripperActionControllerParameters(GripperActionControllerParameters):
    """Parameters of a GripperActionController that commands an effort."""

    gains: GripperGains = GripperGains()


class GripperActionController(GripperControllerBase):
    """Moves a joint to the position of a GripperCommand goal.

    .. pydrake_system::

        name: GripperActionController
        input_ports:
        - controller_manager
        - state_interfaces
        - gripper_cmd
        - gripper_command
        output_ports:
        - command_interfaces
        - events

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad,     measured positions, then velocities, of all J
                              rad/s    joints of the robot
    gripper_cmd         --    --       SendGoal of a GripperCommandGoal, or CancelGoal
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       where it is known what that is
    command_interfaces  --    --       UpdateResult; command (1,): the position, or with
                                       gains the effort
    events              --    --       tuple of the latest (number, event), the newest
                                       last; an event is a GoalEvent, a CancelResponse
                                       or a TopicRejected
    ==================  ====  =======  =================================================

    The state is a GripperControllerState. With the goal's position p and the measured
    position q, a tick commands p, or in `effort_controllers`::

        effort = clamp(pid(p - q, -v), ±max_effort)

    so that a goal without max_effort has no effort at all; upstream takes the time of
    the clock on the wall there, here it is the controller's period. A position command
    knows no max_effort, and reports it as the effort of its result.
    """

    goal_type = GripperCommandGoal

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
            make_rules(
                parameters,
                read_goal=_read_goal,
                make_result=_make_result,
                pid=_make_pid(parameters) if is_effort else None,
            ),
            params,
            joint=parameters.joint,
            claims=(f"{parameters.joint}/{interface}",),
        )

    def _write(self, state: GripperState) -> Array:
        assert state.target is not None
        is_effort = self._commands_effort
        return np.array([state.effort if is_effort else state.target.position])


def _read_goal(rules: GripperRules, request: SendGoal) -> Target | str:
    goal = request.goal
    if not isinstance(goal, GripperCommandGoal):
        return f"expected a GripperCommandGoal, got a {type(goal).__name__}"
    command = goal.command
    for field in ("position", "max_effort"):
        value = getattr(command, field)
        if not math.isfinite(value):
            return f"command.{field} must be finite, got {value}"
    return Target(command.position, command.max_effort)


def _make_result(ending: Ending | None) -> GripperCommandResult:
    if ending is None:
        return GripperCommandResult()
    position, effort, is_stalled = ending
    return GripperCommandResult(position, effort, is_stalled, not is_stalled)


def _make_pid(parameters: GripperActionControllerParameters) -> Pid:
    assert isinstance(parameters, EffortGripperActionControllerParameters)
    gains = parameters.gains.joint.get(parameters.joint, GripperPidGains())
    limit = gains.i_clamp
    return Pid.from_gains(
        [PidGains(gains.p, gains.i, gains.d, i_clamp_max=limit, i_clamp_min=-limit)]
    )


@dc.dataclass(frozen=True)
class ParallelGripperActionControllerParameters:
    """Parameters of a GripperActionController with limits of effort and velocity."""

    # Joint to command.
    joint: str

    # Rate of results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # Interfaces to read of the joint.
    state_interfaces: tuple[str, ...] = ("position", "velocity")

    # Distance at which a goal is reached, at least 0 [rad] or [m].
    goal_tolerance: float = 0.01

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool = False

    # Speed below which the gripper stalls [rad/s] or [m/s], and after how long [s], at
    # least 0.
    stall_velocity_threshold: float = 0.001
    stall_timeout: float = 1.0

    # Full name of the interface that takes the limit of the effort; "" is none.
    max_effort_interface: str = ""

    # Effort where a goal has none, at least 0 [N·m] or [N].
    max_effort: float = 10.0

    # Full name of the interface that takes the limit of the velocity; "" is none.
    max_velocity_interface: str = ""

    # Velocity where a goal has none, at least 0 [rad/s] or [m/s].
    max_velocity: float = 0.1

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(
            self, 0.0, "goal_tolerance", "stall_timeout", "max_effort", "max_velocity"
        )
        limits = [self.max_effort_interface, self.max_velocity_interface]
        for name in filter(None, limits):
            if name == f"{self.joint}/{interfaces.POSITION}" or limits.count(name) > 1:
                raise ValueError(
                    "max_effort_interface and max_velocity_interface must be two "
                    f"interfaces beside the position, got {limits}"
                )


class ParallelGripperActionController(GripperControllerBase):
    """Moves a joint to the position of a ParallelGripperCommand goal.

    .. pydrake_system::

        name: ParallelGripperActionController
        input_ports:
        - controller_manager
        - state_interfaces
        - gripper_cmd
        - gripper_command
        output_ports:
        - command_interfaces
        - events

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad,     measured positions, then velocities, of all J
                              rad/s    joints of the robot
    gripper_cmd         --    --       SendGoal of a ParallelGripperCommandGoal, or
                                       CancelGoal
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       where it is known what that is
    command_interfaces  --    --       UpdateResult; the position, then as there
                                       are such interfaces the largest effort and the
                                       largest velocity
    events              --    --       tuple of the latest (number, event), the newest
                                       last; an event is a GoalEvent, a CancelResponse
                                       or a TopicRejected
    ==================  ====  =======  =================================================

    The state is a GripperControllerState. A goal names no joint that counts; where it
    gives no effort or velocity, the parameters do. The largest effort and velocity go
    to `max_effort_interface` and `max_velocity_interface`, and hold for the joint's
    drive here, whether its description has such interfaces or not; 0 is no limit.
    """

    goal_type = ParallelGripperCommandGoal

    def __init__(
        self,
        parameters: ParallelGripperActionControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        effort, velocity = (
            parameters.max_effort_interface,
            parameters.max_velocity_interface,
        )
        self._has_effort, self._has_velocity = bool(effort), bool(velocity)
        limits = tuple(filter(None, (effort, velocity)))
        super().__init__(
            make_rules(
                parameters,
                read_goal=functools.partial(
                    _read_parallel_goal,
                    has_effort=bool(effort),
                    has_velocity=bool(velocity),
                ),
                make_result=_make_parallel_result,
                max_velocity=parameters.max_velocity,
            ),
            params,
            joint=parameters.joint,
            claims=(f"{parameters.joint}/{interfaces.POSITION}", *limits),
            limits={
                name: kind
                for name, kind in (
                    (effort, interfaces.EFFORT),
                    (velocity, interfaces.VELOCITY),
                )
                if name
            },
        )

    def _write(self, state: GripperState) -> Array:
        target = state.target
        assert target is not None
        values = [target.position]
        if self._has_effort:
            values.append(target.max_effort)
        if self._has_velocity:
            values.append(target.max_velocity)
        return np.array(values)


def _read_parallel_goal(
    rules: GripperRules, request: SendGoal, *, has_effort: bool, has_velocity: bool
) -> Target | str:
    goal = request.goal
    if not isinstance(goal, ParallelGripperCommandGoal):
        return f"expected a ParallelGripperCommandGoal, got a {type(goal).__name__}"
    command = goal.command
    if len(command.position) != 1:
        return f"command.position must have 1 value, got {len(command.position)}"
    for field in ("position", "velocity", "effort"):
        for value in getattr(command, field):
            if not math.isfinite(value):
                return f"command.{field} must be finite, got {value}"
    effort, velocity = command.effort, command.velocity
    return Target(
        command.position[0],
        effort[0] if has_effort and effort else rules.max_effort,
        velocity[0] if has_velocity and velocity else rules.max_velocity,
    )


def _make_parallel_result(ending: Ending | None) -> ParallelGripperCommandResult:
    if ending is None:
        return ParallelGripperCommandResult()
    state = JointState(position=(ending.position,))
    is_stalled = ending.is_stalled
    return ParallelGripperCommandResult(state, is_stalled, not is_stalled)
