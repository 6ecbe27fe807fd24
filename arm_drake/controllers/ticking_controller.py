"""What all controllers share: ticks, a life cycle, all state in the Context.

In a cycle a ros2_control manager reads, updates and writes in one instant. Drake's
events of one instant all see the old state, so what a tick computes is an output port
of its own, `tick`: a cached function of the old state, the inputs and the time. The
manager takes the commands there, and a controller further down a chain its references;
an unrestricted update then stores it. Off the cycles `tick` is what was stored.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    InputPort,
    OutputPort,
    State,
)

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.cycles import Array, Cycle, Now, Tick
from arm_drake.timing import cycle_at

S = TypeVar("S")

_NO_COMMAND: Array = np.empty(0)


class TickingController(ControllerInterface, Generic[S]):
    """Base of controllers with an immutable state of type S, renewed at every tick.

    A subclass implements `_update`, and what else it needs of `_activate`,
    `_deactivate`, `_idle`, `_command` and `_is_ok`. It declares its further ports;
    outputs depend on `xa_ticket()` alone and show what the last tick left behind.
    Without a manager on its port a controller is always active.
    """

    def __init__(
        self,
        params: ControllerInterfaceParams,
        initial: S,
        *,
        state_interfaces: tuple[str, ...] = (),
        command_interfaces: tuple[str, ...] = (),
        reference_interfaces: tuple[str, ...] = (),
        exported_interfaces: tuple[str, ...] = (),
        limit_interfaces: Mapping[str, str] | None = None,
    ) -> None:
        """Create the system with its state, its tick and its interfaces.

        Args:
            params: Rate and surroundings of the controller.
            initial: State before the first tick.
            state_interfaces: As in ControllerInterface.
            command_interfaces: As in ControllerInterface.
            reference_interfaces: As in ControllerInterface.
            exported_interfaces: As in ControllerInterface.
            limit_interfaces: As in ControllerInterface.
        """
        # Drake's classes take no notice of what is abstract.
        own = type(self)
        if own._update is TickingController._update:
            raise TypeError(f"{own.__name__} has no _update")
        if command_interfaces and own._command is TickingController._command:
            raise TypeError(f"{own.__name__} has command interfaces and no _command")
        super().__init__(
            params,
            state_interfaces=state_interfaces,
            command_interfaces=command_interfaces,
            reference_interfaces=reference_interfaces,
            exported_interfaces=exported_interfaces,
            limit_interfaces=limit_interfaces,
        )
        # Whether it says of an update how it went.
        self.can_fail = own._is_ok is not TickingController._is_ok
        # What is active where there is no manager.
        self._always_active = {params.controller_name: 1}
        # Values of all command interfaces, and where those of this one stand there.
        self._values: InputPort | None = None
        self._values_at: list[tuple[int, int]] = []
        # Humble's manager goes on with a controller whose update fails.
        self._ends_on_failure = params.distro != "humble"
        # Of each controller that may command references: its port, and where its
        # commands stand among them.
        self._predecessors: list[tuple[str, InputPort, list[int], list[int]]] = []
        self._no_references = np.full(len(reference_interfaces), np.nan)
        # An immutable Python object goes into the Context as it is. Drake takes a plain
        # number quicker than its own kind of index.
        first: Tick[S] = Tick(
            None, None, initial, np.full(len(command_interfaces), np.nan)
        )
        self._ticks = int(self.DeclareAbstractState(AbstractValue.Make(first)))
        self._tick_port = self.DeclareAbstractOutputPort(
            interfaces.COMMAND_PORT, lambda: AbstractValue.Make(()), self._calc_tick
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            params.period, 0.0, self._update_state
        )
        if exported_interfaces:
            self.DeclareVectorOutputPort(
                interfaces.EXPORT_PORT,
                len(exported_interfaces),
                lambda context, output: output.SetFromVector(
                    self._export(self._state(context))
                ),
                prerequisites_of_calc={self.xa_ticket()},
            )

    def add_command_values(self, order: Sequence[str]) -> InputPort:
        """Declare the port of what all command interfaces hold.

        Args:
            order: Their names, in the order of the port.
        """
        at = {name: index for index, name in enumerate(order)}
        self._values = self.DeclareVectorInputPort(interfaces.VALUES_PORT, len(order))
        self._values_at = [
            (i, at[n]) for i, n in enumerate(self.command_interfaces) if n in at
        ]
        return self._values

    def add_predecessor(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of a controller that commands references of this one.

        Args:
            controller: One whose command interfaces are among the references.
        """
        names = controller.command_interfaces
        here = [i for i, ref in enumerate(self.reference_interfaces) if ref in names]
        there = [names.index(self.reference_interfaces[i]) for i in here]
        name = controller.params.controller_name
        port = self.DeclareAbstractInputPort(
            f"{interfaces.CHAIN_PORT}{name}", AbstractValue.Make(())
        )
        self._predecessors.append((name, port, here, there))
        return port

    def add_exporter_tick(self, controller: "TickingController[Any]") -> InputPort:
        """Declare the port of a controller that ticks first and exports state to this.

        Args:
            controller: As in `add_exporter`; here its tick of this very instant counts.
        """
        name = f"{interfaces.EXPORT_PORT}:{controller.params.controller_name}"
        port = self.DeclareAbstractInputPort(name, AbstractValue.Make(()))
        self._read_exports(
            controller.exported_interfaces,
            lambda context: controller._export(port.Eval(context).state),
        )
        return port

    @abstractmethod
    def _update(self, now: Now, state: S) -> S:
        """Return the state after a tick.

        Args:
            now: The time, and where the inputs are read.
            state: State after the last tick.
        """

    def _activate(self, now: Now, state: S) -> S:
        """Return the state at the start of an activation, before its first tick."""
        del now
        return state

    def _deactivate(self, now: Now, state: S) -> S:
        """Return the state at the end of an activation."""
        del now
        return state

    def _idle(self, now: Now, state: S) -> S:
        """Return the state after a cycle in which the controller is inactive."""
        del now
        return state

    def _command(self, state: S) -> Array:
        """Return the commands of a state, shape (k,); NaN leaves one as it is."""
        del state
        return _NO_COMMAND

    def _export(self, state: S) -> Array:
        """Return the exported state interfaces of a state."""
        del state
        return np.full(len(self.exported_interfaces), np.nan)

    def _fault(self, state: S) -> str:
        """Return why the last tick went wrong, in words."""
        del state
        return ""

    def _is_ok(self, state: S) -> bool:
        """Return whether the last tick went well."""
        del state
        return True

    def _state(self, context: Context) -> S:
        """Return the state that the last tick left."""
        tick: Tick[S] = context.get_abstract_state(self._ticks).get_value()
        return tick.state

    def _read_commands(self, now: Now) -> Array:
        """Return the present values of the command interfaces, shape (k,).

        NaN is what was never written. References of other controllers are what was
        written to them last.
        """
        context = now.context
        values = np.array(context.get_abstract_state(self._ticks).get_value().command)
        if self._values is not None:
            present = now.cycle.commands
            if present is None:
                present = self._values.Eval(context)
            for i, at in self._values_at:
                values[i] = present[at]
        return values

    def _read_references(self, now: Now) -> Array | None:
        """Return what other controllers command, NaN where none does; None if none.

        Shape (number of reference_interfaces,).
        """
        if self.params.controller_name not in now.cycle.chained:
            return None
        references = self._no_references.copy()
        for name, port, here, there in self._predecessors:
            if name in now.cycle.active:
                references[here] = port.Eval(now.context).command[there]
        return references

    def _declare_topic(
        self, name: str, calc: Callable[[S], Any], *, default: Any = ()
    ) -> OutputPort:
        """Declare an abstract output port that shows something of the state."""
        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(default),
            lambda context, output: output.set_value(calc(self._state(context))),
            prerequisites_of_calc={self.xa_ticket()},
        )

    def _calc_tick(self, context: Context, output: AbstractValue) -> None:
        held: Tick[S] = context.get_abstract_state(self._ticks).get_value()
        if self._manager.HasValue(context):
            cycle: Cycle = self._manager.Eval(context)
        else:
            cycle = self._own_cycle(context, held)
        if cycle.number != held.number:
            held = self._run(context, held, cycle)
        output.set_value(held)

    def _run(self, context: Context, held: Tick[S], cycle: Cycle) -> Tick[S]:
        """Return what a cycle leaves behind."""
        name = self.params.controller_name
        period_ns = cycle.period_ns
        if cycle.periods:
            period_ns = cycle.periods.get(name, period_ns)
        now = Now(context, cycle.time_ns, period_ns, cycle)
        activation = cycle.active.get(name)
        state, command, is_ok, fault = held.state, held.command, True, ""
        ending: Array | None = None
        if activation != held.activation:
            if held.activation is not None:
                state = self._deactivate(now, state)
                command = ending = self._command(state)
            if activation is not None:
                state = self._activate(now, state)
        if activation is None:
            state = self._idle(now, state)
        elif period_ns:
            state = self._update(now, state)
            command, is_ok = self._command(state), self._is_ok(state)
            if not is_ok:
                fault = self._fault(state)
                if self._ends_on_failure:
                    state, activation = self._deactivate(now, state), None
                    command = self._command(state)
        if ending is not None:  # What a restart leaves unwritten ends.
            command = np.where(np.isnan(command), ending, command)
        return Tick(cycle.number, activation, state, command, is_ok, fault)

    def _own_cycle(self, context: Context, held: Tick[S]) -> Cycle:
        """Return a cycle of a controller that has no manager."""
        number = cycle_at(context.get_time(), self.params.period)
        if number is None:
            number = -1 if held.number is None else held.number
        time_ns = self._tick_time(number)
        period_ns = time_ns - self._tick_time(number - 1)
        return Cycle(number, time_ns, period_ns, self._always_active)

    def _update_state(self, context: Context, state: State) -> None:
        tick = self._tick_port.Eval(context)
        state.get_mutable_abstract_state(self._ticks).set_value(tick)
