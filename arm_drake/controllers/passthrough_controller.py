"""The ``passthrough_controller/PassthroughController`` and its parameters.

Source: ros2_control_demos, example_12 (branch ``master``).
"""

import math
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    SteadyCommand,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.topics import CHAINED, Inbox, TopicController
from arm_drake.description.parameters import check_not_empty, check_unique
from arm_drake.importing import dataclass
from arm_drake.messages import Float64MultiArray


@dataclass(frozen=True)
class PassthroughControllerParameters:
    """Parameters of a PassthroughController."""

    # Full names of the interfaces to command, at least one, unique.
    interfaces: tuple[str, ...]

    def __post_init__(self) -> None:
        check_not_empty(self, "interfaces")
        check_unique(self, "interfaces")


class PassthroughState(NamedTuple):
    """State of a PassthroughController between two ticks."""

    # What to pass on, shape (k,); NaN leaves a command interface as it is.
    command: Array

    inbox: Inbox = Inbox()


class PassthroughController(TopicController[PassthroughState]):
    """Passes on commands of other controllers or of a topic.

    With k = len(interfaces), vectors in the order of ``interfaces``:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  not read
    commands            --    --       Float64MultiArray of k values
    command_interfaces  --    --       UpdateResult; command (k,), in the units of the
                                       interfaces
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    Others command its references "<controller>/<interface>"; the topic is ignored then.
    The state is a PassthroughState. A reference holds until the next one, or until the
    controller starts again. A message of another size has no effect, nor has one with
    a value that isn't finite.
    """

    reads_by_now = True

    def __init__(
        self,
        parameters: PassthroughControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        names = parameters.interfaces
        self._nothing = np.full(len(names), np.nan)
        super().__init__(
            params,
            PassthroughState(self._nothing),
            command_interfaces=names,
            reference_interfaces=tuple(f"{params.controller_name}/{n}" for n in names),
        )
        self._subscribe("commands", Float64MultiArray, self._take)
        self._declare_events()

    def _update(self, now: UpdateContext, state: PassthroughState) -> PassthroughState:
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        if chained is None:
            return state
        command = np.where(np.isnan(chained), state.command, chained)
        return state._replace(command=command)

    def steady(
        self, last: UpdateResult[PassthroughState], time_ns: int
    ) -> SteadyTicks[PassthroughState]:
        """Return the references that hold."""
        return SteadyCommand(last.command, last.state)

    def _take(
        self, state: PassthroughState, message: Float64MultiArray, time_ns: int
    ) -> tuple[PassthroughState, str]:
        """Return the state with the references of a message."""
        if fault := self._find_fault(message):
            return state, fault
        return state._replace(command=np.array(message.data, dtype=float)), ""

    def _find_fault(self, message: Float64MultiArray) -> str:
        """Return why a message has no effect, or nothing."""
        names, size = self.command_interfaces, len(message.data)
        if size != len(names):
            noun = "value" if len(names) == 1 else "values"
            return (
                f"data must have {len(names)} {noun} ({', '.join(names)}), got {size}"
            )
        for index, value in enumerate(message.data):
            if not math.isfinite(value):
                return f"data[{index}] must be finite, got {value}"
        return ""

    def _activate(
        self, now: UpdateContext, state: PassthroughState
    ) -> PassthroughState:
        return state._replace(command=self._nothing)

    def _deactivate(
        self, now: UpdateContext, state: PassthroughState
    ) -> PassthroughState:
        return state._replace(command=self._nothing)
