"""What all controllers share: a tick at their update rate, all state in the Context.

In a tick a ros2_control manager reads, updates and writes in one instant. Drake's
events of one instant all see the old state. So a controller's commands are, at a tick,
what the tick *will* leave behind, computed from the old state and the inputs; the
update event stores it. Between ticks the commands are what the last tick left. Topics
always show what the last tick left.
"""

import dataclasses as dc
from abc import abstractmethod
from collections.abc import Mapping
from typing import Generic, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    State,
    ValueProducer,
)

from arm_drake import interfaces
from arm_drake.messages import NANOSECONDS, Message

S = TypeVar("S", bound=Message)
M = TypeVar("M", bound=Message)

# How far the time may be off a tick and still be the tick, in periods. Times are sums
# of rounded numbers.
_TICK_TOLERANCE = 1e-6


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


@dc.dataclass(frozen=True, eq=False)
class _Ticked(Message, Generic[S]):
    """State of a controller and the number of the next tick."""

    next_tick: int
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


class ControllerInterface(LeafSystem, Generic[S]):
    """Base of the controllers: an immutable state of type S, renewed at every tick.

    A subclass declares its input ports, calls `_declare_tick`, declares its output
    ports with the prerequisites that this returns, and implements `_tick`, and
    `_calc_command` if it claims something.
    """

    # Interfaces behind the ports of these names, such as "joint1/position", in order.
    state_interfaces: tuple[str, ...]
    command_interfaces: tuple[str, ...]

    def __init__(
        self,
        params: ControllerInterfaceParams,
        *,
        state_interfaces: tuple[str, ...],
        command_interfaces: tuple[str, ...] = (),
    ) -> None:
        """Create the system with its port of measured quantities.

        Args:
            params: Rate and surroundings of the controller.
            state_interfaces: What it reads.
            command_interfaces: What it claims.
        """
        super().__init__()
        self.set_name(params.controller_name)
        self.params = params
        self.state_interfaces = state_interfaces
        self.command_interfaces = command_interfaces
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, len(state_interfaces)
        )

    def _declare_tick(self, initial: S) -> set[object]:
        """Declare the state, its update and the commands.

        Args:
            initial: State before the first tick.

        Returns:
            The prerequisites of outputs that use `_state_after`.
        """
        # An immutable Python object goes into the Context as it is.
        self.DeclareAbstractState(AbstractValue.Make(_Ticked(0, initial)))
        self._next = self.DeclareCacheEntry(
            "state after the tick",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(_Ticked(0, initial)),
                calc=self._calc_next,
            ),
            {self.time_ticket(), self.xa_ticket(), self.all_input_ports_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            self.params.period, 0.0, self._update_state
        )
        prerequisites = {self._next.ticket()}
        if self.command_interfaces:
            self.DeclareVectorOutputPort(
                interfaces.COMMAND_PORT,
                len(self.command_interfaces),
                self._calc_command,
                prerequisites_of_calc=prerequisites,
            )
        return prerequisites

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        """Write the commands of this instant's tick; NaN is no command."""
        raise AssertionError("a controller with command interfaces commands them")

    @abstractmethod
    def _tick(self, context: Context, state: S, time_ns: int, period_ns: int) -> S:
        """Return the state after a tick.

        Args:
            context: Where the inputs are read; its state is ``state``.
            state: State after the last tick.
            time_ns: Time of the tick [ns].
            period_ns: Time since the last tick [ns].
        """

    def _state_after(self, context: Context) -> S:
        """Return the state after this instant's tick, or the last one's."""
        ticked: _Ticked[S] = self._next.Eval(context)
        return ticked.state

    def _state_before(self, context: Context) -> S:
        """Return the state that the last tick stored; prerequisite: xa_ticket()."""
        ticked: _Ticked[S] = context.get_abstract_state(0).get_value()
        return ticked.state

    def _calc_next(self, context: Context, value: AbstractValue) -> None:
        ticked = context.get_abstract_state(0).get_value()
        ticks = context.get_time() / self.params.period
        tick = round(ticks)
        if abs(ticks - tick) <= _TICK_TOLERANCE and tick >= ticked.next_tick:
            rate = self.params.update_rate
            time_ns = tick * NANOSECONDS // rate
            period_ns = time_ns - (tick - 1) * NANOSECONDS // rate
            state = self._tick(context, ticked.state, time_ns, period_ns)
            ticked = _Ticked(tick + 1, state)
        value.set_value(ticked)

    def _update_state(self, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(0).set_value(self._next.Eval(context))
