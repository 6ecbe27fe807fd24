"""What the forward command controllers share: a topic's values, written as they are.

Source: ros2_controllers, `forward_command_controller` (version 6.9.0 and jazzy).
"""

import math
from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import INACTIVE, Events, add_events, new_messages
from arm_drake.messages import Float64MultiArray, TopicRejected


class ForwardCommandState(NamedTuple):
    """State of a ForwardCommandController between two ticks."""

    # What to write, shape (k,); NaN leaves a command interface as it is.
    command: Array

    # Whether the message in effect has the right size.
    is_ok: bool = True

    # Messages on the port at the last tick.
    seen: tuple[Float64MultiArray, ...] = ()

    # The latest messages that were not accepted.
    events: Events = ()


class ForwardControllersBase(TickingController[ForwardCommandState]):
    """Writes the values of a topic to command interfaces."""

    @abstractmethod
    def __init__(
        self,
        claims: tuple[str, ...],
        params: ControllerInterfaceParams,
        *,
        stops: bool = False,
    ) -> None:
        """Create the system.

        Args:
            claims: Command interfaces, in the order of the values, k of them.
            params: Rate and surroundings of the controller.
            stops: Whether it writes 0 when it is deactivated.
        """
        self._nothing = np.full(len(claims), np.nan)
        self._at_end = np.zeros(len(claims)) if stops else self._nothing
        initial = ForwardCommandState(self._nothing)
        super().__init__(params, initial, command_interfaces=claims)
        self._topic = self.DeclareAbstractInputPort("commands", AbstractValue.Make(()))
        self._declare_topic("events", lambda state: state.events)
        self._drops_non_finite = params.distro != "humble"

    def _update(self, now: Now, state: ForwardCommandState) -> ForwardCommandState:
        new, seen = new_messages(
            self._topic, now.context, Float64MultiArray, state.seen
        )
        if seen is state.seen:
            return state
        command, is_ok, rejected = state.command, state.is_ok, []
        for message in new:
            fault = self._find_fault(message)
            if fault is not None:
                rejected.append(TopicRejected(message, fault))
                continue
            size = len(message.data)
            is_ok = size in (0, len(self._nothing))
            command = self._nothing
            if not is_ok:
                rejected.append(TopicRejected(message, self._expected(size)))
            elif size:
                values = np.array(message.data)
                command = np.where(np.isfinite(values), values, np.nan)
        events = add_events(state.events, rejected)
        return ForwardCommandState(command, is_ok, seen, events)

    def _find_fault(self, message: Float64MultiArray) -> str | None:
        """Return why a message is dropped, or None."""
        for index, value in enumerate(message.data):
            if self._drops_non_finite and not math.isfinite(value):
                return f"data[{index}] must be finite, got {value}; it is dropped"
        return None

    def _expected(self, size: int) -> str:
        names = self.command_interfaces
        return (
            f"data must have {len(names)} value{'s' * (len(names) != 1)} "
            f"({', '.join(names)}), got {size}; the update fails"
        )

    def _activate(self, now: Now, state: ForwardCommandState) -> ForwardCommandState:
        del now
        return state._replace(command=self._nothing, is_ok=True)

    def _deactivate(self, now: Now, state: ForwardCommandState) -> ForwardCommandState:
        del now
        return state._replace(command=self._at_end)

    def _idle(self, now: Now, state: ForwardCommandState) -> ForwardCommandState:
        new, seen = new_messages(
            self._topic, now.context, Float64MultiArray, state.seen
        )
        if seen is state.seen:
            return state
        rejected = [TopicRejected(m, INACTIVE) for m in new]
        events = add_events(state.events, rejected)
        return state._replace(seen=seen, events=events)

    def rests(self, state: ForwardCommandState) -> bool:
        """Return whether only a message can change the state while inactive."""
        del state
        return True

    def _command(self, state: ForwardCommandState) -> Array:
        return state.command

    def _is_ok(self, state: ForwardCommandState) -> bool:
        return state.is_ok

    def _fault(self, state: ForwardCommandState) -> str:
        reason = state.events[-1][1].reason if state.events else ""
        return reason.removesuffix("; the update fails")
