"""What all controllers share: a tick at their update rate, all state in the Context.

In a tick a ros2_control manager reads, updates and writes in one instant. Here the tick
is an unrestricted update: Drake runs it before the plant's step of the same instant, so
the command that it stores acts on the very step that starts with the tick, and holds
until the next one.
"""

import dataclasses as dc
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    InputPort,
    LeafSystem,
    State,
)

from arm_drake import interfaces
from arm_drake.messages import NANOSECONDS, Message

S = TypeVar("S")
M = TypeVar("M", bound=Message)


@dc.dataclass(frozen=True)
class ControllerInterfaceParams:
    """What a controller is given besides its parameters."""

    controller_name: str

    # Rate of its ticks [Hz].
    update_rate: int

    # Period of its ticks in Drake's time [s]: 1 / update_rate, but for rounding.
    period: float

    # URDF type of every movable joint of the robot.
    joint_types: Mapping[str, str]

    # What the hardware has, such as "joint1/position".
    command_interfaces: frozenset[str]
    state_interfaces: frozenset[str]

    # Order of the vector of all measured quantities.
    measured: tuple[str, ...]

    # What command interfaces hold until they are commanded; 0 where nothing is said.
    initial_commands: Mapping[str, float]


@dc.dataclass(frozen=True, eq=False, slots=True)
class _Ticked(Message, Generic[S]):
    """What a tick leaves behind."""

    # Number of the tick; None before the first one.
    number: int | None

    # State of the controller.
    state: S


def message_on(port: InputPort, context: Context, expected: type[M]) -> M | None:
    """Return the message on an abstract port; None if nothing is connected.

    Args:
        port: The port.
        context: Context of its system.
        expected: Type of the message.

    Raises:
        TypeError: If something else is there.
    """
    message = port.Eval(context) if port.HasValue(context) else None
    if message is None or isinstance(message, expected):
        return message
    raise TypeError(
        f"{port.get_system().get_name()}.{port.get_name()}: expected a "
        f"{expected.__name__}, got {message!r}"
    )


class ControllerInterface(LeafSystem):
    """Base of all controllers: what they read, what they claim.

    A controller that reads no efforts is given none: its port ends after the
    velocities. Efforts take the servo's whole computation. A controller without an
    update of its own, `is_sampled`, is given all of them, held from tick to tick.
    """

    is_sampled = False

    def __init__(
        self,
        params: ControllerInterfaceParams,
        *,
        state_interfaces: tuple[str, ...],
        command_interfaces: tuple[str, ...] = (),
    ) -> None:
        """Create the system with its input port of measured quantities.

        Args:
            params: Rate and surroundings of the controller.
            state_interfaces: What it reads, such as "joint1/position".
            command_interfaces: What it claims.
        """
        super().__init__()
        self.set_name(params.controller_name)
        self.params = params
        self.state_interfaces = state_interfaces
        self.command_interfaces = command_interfaces
        self.reads_effort = self.is_sampled or any(
            name.endswith(f"/{interfaces.EFFORT}") for name in state_interfaces
        )
        num_measured = len(params.measured)
        if not self.reads_effort:
            num_measured -= num_measured // len(interfaces.STATE_INTERFACES)
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        self._read_at = _positions(state_interfaces, params.measured)

    def _read(self, context: Context) -> NDArray[np.float64]:
        """Return the measured `state_interfaces`."""
        return self._measured.Eval(context)[self._read_at]

    def _tick_time(self, number: int) -> int:
        """Return the time of a tick [ns]."""
        return number * NANOSECONDS // self.params.update_rate


class TickingController(ControllerInterface, Generic[S]):
    """Base of controllers with an immutable state of type S, renewed at every tick.

    A subclass implements `_tick`, and `_command` if it claims something. It declares
    its further ports; outputs depend on `xa_ticket()` alone and show what the last tick
    left behind.
    """

    def __init__(
        self,
        params: ControllerInterfaceParams,
        initial: S,
        *,
        state_interfaces: tuple[str, ...],
        command_interfaces: tuple[str, ...] = (),
    ) -> None:
        """Create the system with its state, its tick and its interfaces.

        Args:
            params: Rate and surroundings of the controller.
            initial: State before the first tick.
            state_interfaces: What it reads, such as "joint1/position".
            command_interfaces: What it claims.
        """
        super().__init__(
            params,
            state_interfaces=state_interfaces,
            command_interfaces=command_interfaces,
        )
        # An immutable Python object goes into the Context as it is.
        self.DeclareAbstractState(AbstractValue.Make(_Ticked(None, initial)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            params.period, 0.0, self._update_state
        )
        if command_interfaces:
            hold = [params.initial_commands.get(n, 0.0) for n in command_interfaces]
            # Commands, and their rates of change: what the servo reads without Python.
            state = self.DeclareDiscreteState(
                np.concatenate([hold, np.zeros(len(command_interfaces))])
            )
            self.DeclareStateOutputPort(interfaces.COMMAND_PORT, state)

    @abstractmethod
    def _tick(self, context: Context, state: S, time_ns: int, period_ns: int) -> S:
        """Return the state after a tick.

        Args:
            context: Where the inputs are read; its state is ``state``.
            state: State after the last tick.
            time_ns: Time of the tick [ns].
            period_ns: Time since the last tick [ns].
        """

    def _command(self, state: S) -> NDArray[np.float64]:
        """Return the commands of a state, shape (k,); NaN keeps the last command."""
        del state
        return np.empty(0)

    def _state(self, context: Context) -> S:
        """Return the state that the last tick left."""
        ticked: _Ticked[S] = context.get_abstract_state(0).get_value()
        return ticked.state

    def _update_state(self, context: Context, state: State) -> None:
        ticked = context.get_abstract_state(0).get_value()
        params = self.params
        # Ticks are counted, for times are sums of rounded numbers.
        number, rate = round(context.get_time() / params.period), params.update_rate
        time_ns = number * NANOSECONDS // rate
        period_ns = time_ns - (number - 1) * NANOSECONDS // rate
        new = self._tick(context, ticked.state, time_ns, period_ns)
        state.get_mutable_abstract_state(0).set_value(_Ticked(number, new))
        if self.command_interfaces:
            values = self._command(new)
            held = context.get_discrete_state_vector().value()[: len(values)]
            # A sum is finite only if all of its terms are.
            if not math.isfinite(values.sum()):
                values = np.where(np.isfinite(values), values, held)
            # A jump at the first tick is no speed.
            rates = (values - held) * (0 if ticked.number is None else rate)
            command = np.concatenate((values, rates))
            state.get_mutable_discrete_state(0).set_value(command)


def _positions(names: Sequence[str], order: Sequence[str]) -> slice | list[int]:
    """Return where names stand in a vector; as a slice if they are in a row."""
    try:
        at = [order.index(name) for name in names]
    except ValueError:
        # The manager says so before such a controller starts.
        return []
    if at and at == list(range(at[0], at[0] + len(at))):
        return slice(at[0], at[0] + len(at))
    return at
