"""Where the last tick of a controller is: its manager keeps it, or else itself."""

from typing import Any, Generic, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DependencyTicket, LeafSystem, State

from arm_drake import interfaces
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Cycle, Tick
from arm_drake.messages import NANOSECONDS
from arm_drake.timing import cycle_at

S = TypeVar("S")


class KeptTicks(Generic[S]):
    """The last tick of a controller, on a port of its manager's."""

    def __init__(
        self, system: LeafSystem, params: ControllerInterfaceParams, first: Tick[S]
    ) -> None:
        """Declare the port.

        Args:
            system: The controller.
            params: Its surroundings.
            first: What there is before its first tick.
        """
        self._name = params.controller_name
        self._port = system.DeclareAbstractInputPort(
            interfaces.TICKS_PORT, AbstractValue.Make(())
        )
        self.ticket: DependencyTicket = system.input_port_ticket(self._port.get_index())

    def last(self, context: Context) -> Tick[S]:
        """Return what the last tick left behind."""
        tick: Tick[S] = self._port.Eval(context).ticks[self._name]
        return tick

    def at(self, context: Context, told: Cycle | None) -> tuple[Cycle, Tick[S]]:
        """Return a cycle, and what the tick before it left behind.

        Args:
            context: Context of the controller.
            told: What its manager says; None without one.
        """
        assert told is not None
        return told, told.ticks[self._name]


class OwnTicks(KeptTicks[S]):
    """The same in the state of a controller that has no manager."""

    def __init__(
        self, system: LeafSystem, params: ControllerInterfaceParams, first: Tick[S]
    ) -> None:
        """Declare the state; arguments are those of KeptTicks."""
        self._update_rate, self._period = params.update_rate, params.period
        # Without a manager on its port it is always active.
        self._always_active = {params.controller_name: 1}
        # An immutable Python object goes into the Context as it is. Drake takes a plain
        # number quicker than its own kind of index.
        self._index = int(system.DeclareAbstractState(AbstractValue.Make(first)))
        self.ticket = system.xa_ticket()

    def last(self, context: Context) -> Tick[S]:
        """Return what the last tick left behind."""
        tick: Tick[S] = context.get_abstract_state(self._index).get_value()
        return tick

    def at(self, context: Context, told: Cycle | None) -> tuple[Cycle, Tick[S]]:
        """Return a cycle, and what the tick before it left behind; as KeptTicks."""
        held = self.last(context)
        if told is not None:
            return told, held
        number = cycle_at(context.get_time(), self._period)
        if number is None:
            number = -1 if held.number is None else held.number
        time_ns = self._time_ns(number)
        period_ns = time_ns - self._time_ns(number - 1)
        return Cycle(number, time_ns, period_ns, self._always_active), held

    def store(self, state: State, tick: Tick[Any]) -> None:
        """Store what a tick has left behind."""
        state.get_mutable_abstract_state(self._index).set_value(tick)

    def _time_ns(self, number: int) -> int:
        return number * NANOSECONDS // self._update_rate
