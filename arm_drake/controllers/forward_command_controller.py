"""Forward command controllers, and the groups of `position_controllers` and others.

A topic's values are written as they are.

Source: ros2_controllers, `forward_command_controller`, `position_controllers`,
`velocity_controllers`, `effort_controllers` (version 6.9.0 and jazzy).
"""

import math
from abc import abstractmethod
from typing import Literal, NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    SteadyCommand,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.topics import Inbox, TopicController, latest_reason
from arm_drake.description.parameters import check_not_empty, check_unique
from arm_drake.importing import dataclass
from arm_drake.messages import Float64MultiArray


class ForwardCommandState(NamedTuple):
    """State of a ForwardCommandController between two ticks."""

    # What to write, shape (k,); NaN leaves a command interface as it is.
    command: Array

    # Whether the message in effect has the right size.
    is_ok: bool = True

    inbox: Inbox = Inbox()


class ForwardControllersBase(TopicController[ForwardCommandState]):
    """Writes the values of a topic to k command interfaces.

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  not read
    commands            --    --       Float64MultiArray of k values
    command_interfaces  --    --       UpdateResult; command (k,), in rad, rad/s or N·m
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================
    """

    @abstractmethod
    def __init__(
        self,
        claims: tuple[str, ...],
        params: ControllerInterfaceParams,
        *,
        stops: bool = False,
    ) -> None:
        """Create the system."""
        self._nothing = np.full(len(claims), np.nan)
        self._at_end = np.zeros(len(claims)) if stops else self._nothing
        initial = ForwardCommandState(self._nothing)
        super().__init__(params, initial, command_interfaces=claims)
        self._subscribe("commands", Float64MultiArray, self._take)
        self._declare_events()
        self._drops_non_finite = params.distro != "humble"

    def _update(
        self, now: UpdateContext, state: ForwardCommandState
    ) -> ForwardCommandState:
        return self._receive(now, state)

    def _take(
        self, state: ForwardCommandState, message: Float64MultiArray, time_ns: int
    ) -> tuple[ForwardCommandState, str]:
        """Return the state with the commands of a message."""
        if fault := self._find_fault(message):
            return state, fault
        names, size = self.command_interfaces, len(message.data)
        if size not in (0, len(names)):
            return state._replace(command=self._nothing, is_ok=False), (
                f"data must have {len(names)} value{'s' * (len(names) != 1)} "
                f"({', '.join(names)}), got {size}; the update fails"
            )
        values = np.array(message.data) if size else self._nothing
        command = np.where(np.isfinite(values), values, np.nan)
        return state._replace(command=command, is_ok=True), ""

    def _find_fault(self, message: Float64MultiArray) -> str:
        """Return why a message is dropped; empty if it isn't."""
        for index, value in enumerate(message.data):
            if self._drops_non_finite and not math.isfinite(value):
                return f"data[{index}] must be finite, got {value}; it is dropped"
        return ""

    def _activate(
        self, now: UpdateContext, state: ForwardCommandState
    ) -> ForwardCommandState:
        return state._replace(command=self._nothing, is_ok=True)

    def _deactivate(
        self, now: UpdateContext, state: ForwardCommandState
    ) -> ForwardCommandState:
        return state._replace(command=self._at_end)

    def steady(
        self, last: UpdateResult[ForwardCommandState], time_ns: int
    ) -> SteadyTicks[ForwardCommandState]:
        """Return the command that holds."""
        return SteadyCommand(last.command, last.state)

    def _is_ok(self, state: ForwardCommandState) -> bool:
        return state.is_ok

    def _fault(self, state: ForwardCommandState) -> str:
        return latest_reason(state.inbox)


@dataclass(frozen=True)
class JointGroupControllerParameters:
    """Parameters of a JointGroup{Position,Velocity,Effort}Controller."""

    # Joints to command, in the order of the values; at least one, unique.
    joints: tuple[str, ...]

    # Known and without effect: upstream overwrites it with the interface of the type.
    interface_name: str = ""

    def __post_init__(self) -> None:
        check_not_empty(self, "joints")
        check_unique(self, "joints")


@dataclass(frozen=True)
class ForwardCommandControllerParameters:
    """Parameters of a ForwardCommandController."""

    # Joints to command, in the order of the values; at least one, unique.
    joints: tuple[str, ...]

    # Interface to claim on each joint.
    interface_name: str

    def __post_init__(self) -> None:
        check_not_empty(self, "joints", "interface_name")
        check_unique(self, "joints")


@dataclass(frozen=True)
class MultiInterfaceForwardCommandControllerParameters:
    """Parameters of a MultiInterfaceForwardCommandController."""

    # Joint to command.
    joint: str

    # Interfaces to claim on it, in the order of the values; at least one, unique.
    interface_names: tuple[str, ...]

    def __post_init__(self) -> None:
        check_not_empty(self, "joint", "interface_names")
        check_unique(self, "interface_names")


class ForwardCommandController(ForwardControllersBase):
    """Writes the values of a topic to one command interface of several joints.

    With k = len(joints), vectors are in the order of ``joints``.

    The state is a ForwardCommandState. The last message holds for ever, or until the
    controller is deactivated; an empty one takes it back and leaves the commands as
    they are. With one of another size every tick fails and nothing is written.

    A message with a value that isn't finite is dropped. Humble writes all of it; here
    its finite values are written, and the other commands stay as they are, for no
    hardware can follow them.
    """

    reads_by_now = True

    def __init__(
        self,
        parameters: ForwardCommandControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        names = (parameters.interface_name,)
        super().__init__(interfaces.interface_names(parameters.joints, names), params)


class MultiInterfaceForwardCommandController(ForwardControllersBase):
    """Writes the values of a topic to several command interfaces of one joint.

    Vectors are in the order of ``interface_names``, k of them. All else is as in
    ForwardCommandController.
    """

    reads_by_now = True

    def __init__(
        self,
        parameters: MultiInterfaceForwardCommandControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        joints, names = (parameters.joint,), parameters.interface_names
        super().__init__(interfaces.interface_names(joints, names), params)


class JointGroupController(ForwardControllersBase):
    """Writes the values of a topic to the joints' positions, velocities or efforts.

    It is `position_controllers/JointGroupPositionController` and those of velocities
    and efforts; these two write 0 when they are deactivated.

    All else is as in ForwardCommandController.
    """

    reads_by_now = True

    def __init__(
        self,
        parameters: JointGroupControllerParameters,
        params: ControllerInterfaceParams,
        *,
        interface: Literal["position", "velocity", "effort"],
    ) -> None:
        """Create the system."""
        claims = interfaces.interface_names(parameters.joints, (interface,))
        super().__init__(claims, params, stops=interface != interfaces.POSITION)
