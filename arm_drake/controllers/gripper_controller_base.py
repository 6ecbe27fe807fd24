"""What the gripper controllers share: the action `gripper_cmd`, ticks, a life cycle."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

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
from arm_drake.control.pid import Pid
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.gripper_command import (
    GRIPPER_COMMAND,
    find_part_fault,
    position_of,
)
from arm_drake.controllers.topics import new_messages
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    Float32,
    Float64,
    Message,
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
        """Create the system.

        Args:
            rules: What its parameters say; upstream reads them once.
            params: Rate and surroundings of the controller.
            joint: The joint.
            claims: Command interfaces, k of them.
            limits: Those of them that limit how the joint moves: "effort" or
                "velocity", by name.
        """
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
        self, now: Now, state: GripperControllerState
    ) -> GripperControllerState:
        state, inputs = self._receive(now, state)
        return state._replace(control=control.tick(self._rules, state.control, inputs))

    def _idle(self, now: Now, state: GripperControllerState) -> GripperControllerState:
        state, inputs = self._receive(now, state)
        new = control.idle(self._rules, state.control, inputs)
        return state if new is state.control else state._replace(control=new)

    def _activate(
        self, now: Now, state: GripperControllerState
    ) -> GripperControllerState:
        new = control.activate(self._rules, state.control, self._sense(now))
        return state._replace(control=new, is_active=True)

    def _deactivate(
        self, now: Now, state: GripperControllerState
    ) -> GripperControllerState:
        del now
        return state._replace(is_active=False)

    def _command(self, state: GripperControllerState) -> Array:
        if state.control.target is None or not state.is_active:
            return self._unknown
        return self._write(state.control)

    def _receive(
        self, now: Now, state: GripperControllerState
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

    def _sense(self, now: Now) -> GripperInputs:
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

    Args:
        parameters: What all gripper controllers have among their parameters.
        read_goal: As in GripperRules.
        make_result: As in GripperRules.
        max_velocity: What a hold is done with [rad/s] or [m/s].
        pid: Commands efforts, if there is one.
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
