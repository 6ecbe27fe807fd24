"""What all controllers share: ticks, a life cycle, all state in the Context.

In a cycle a ros2_control manager reads, updates and writes in one instant. Drake's
events of one instant all see the old state, so what a tick computes is an output port
of its own, `tick`: a cached function of the old state, the inputs and the time. The
manager takes the commands there, and a controller further down a chain its references;
an unrestricted update of the manager then stores it, for every update and every state
has its price in Drake. Off the cycles `tick` is what was stored. A controller without a
manager stores it itself.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    InputPort,
    OutputPort,
    State,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Cycle, Given, Now, Tick
from arm_drake.controllers.kept_ticks import OwnTicks
from arm_drake.controllers.tick_reader import TickReader

S = TypeVar("S")

_NO_COMMAND: Array = np.empty(0)


class TickingController(TickReader[S]):
    """Base of controllers with an immutable state of type S, renewed at every tick.

    A subclass implements `_update`, and what else it needs of `_activate`,
    `_deactivate`, `_idle`, `_command` and `_is_ok`. It declares its further ports;
    outputs depend on the state alone and show what the last tick left behind.
    Without a manager on its port a controller is always active.
    """

    # Whether all that it reads while `Now.is_quiet` goes through `_measured_now` and
    # `_read_commands`, so that its manager can call it without a Context. It holds for
    # the class that says so, not for those derived from it.
    reads_by_now = False

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
            initial,
            state_interfaces=state_interfaces,
            command_interfaces=command_interfaces,
            reference_interfaces=reference_interfaces,
            exported_interfaces=exported_interfaces,
            limit_interfaces=limit_interfaces,
        )
        # Whether it says of an update how it went.
        self.can_fail = own._is_ok is not TickingController._is_ok
        # Humble's manager goes on with a controller whose update fails.
        self._ends_on_failure = params.distro != "humble"
        self._tick_port = self.DeclareAbstractOutputPort(
            interfaces.COMMAND_PORT, lambda: AbstractValue.Make(()), self._calc_tick
        )
        if isinstance(self._ticks, OwnTicks):
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
                prerequisites_of_calc={self._ticks.ticket},
            )

    def add_exporter_tick(self, controller: "TickingController[Any]") -> InputPort:
        """Declare the port of a controller that ticks first and exports state to this.

        Args:
            controller: As in `ControllerInterface.add_exporter`; here its tick of this
                very instant counts.
        """
        name = f"{interfaces.EXPORT_PORT}:{controller.params.controller_name}"
        port = self.DeclareAbstractInputPort(name, AbstractValue.Make(()))
        self._read_exports(
            controller.exported_interfaces,
            lambda context: controller._export(port.Eval(context).state),
        )
        return port

    @property
    def is_direct(self) -> bool:
        """Whether it needs no Context while nothing comes: see `reads_by_now`."""
        takes_motions = self._read_at is not None and not self.reads_all
        takes = self.reference_interfaces or not takes_motions
        reads_by_now = vars(type(self)).get("reads_by_now", False)
        return bool(self.params.is_managed and reads_by_now and not takes)

    def tick(self, cycle: Cycle, given: Given) -> Tick[S]:
        """Return what a cycle leaves behind in which nothing comes.

        The same as what the port says, without a way through Drake.

        Args:
            cycle: A cycle with the `news` of the last tick.
            given: What there is to read.
        """
        return self._run(None, cycle.ticks[self.params.controller_name], cycle, given)

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

    def rests(self, state: S) -> bool:
        """Return whether only a message can change the state while inactive.

        A controller with an `_idle` that does no more than take messages says so here,
        and then costs nothing while it is inactive and nothing comes. It holds for the
        class whose `_idle` it is, not for those with one of their own.
        """
        del state
        return type(self)._idle is TickingController._idle

    @property
    def may_rest(self) -> bool:
        """Whether `rests` speaks of this class's own `_idle`."""
        for kind in type(self).__mro__:
            if "rests" in vars(kind):
                return True
            if "_idle" in vars(kind):
                return False
        return True

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

    def _declare_topic(
        self, name: str, calc: Callable[[S], Any], *, default: Any = ()
    ) -> OutputPort:
        """Declare an abstract output port that shows something of the state."""
        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(default),
            lambda context, output: output.set_value(calc(self._state(context))),
            prerequisites_of_calc={self._ticks.ticket},
        )

    def _calc_tick(self, context: Context, output: AbstractValue) -> None:
        has_manager = self.params.is_managed or self._manager.HasValue(context)
        told = self._manager.Eval(context) if has_manager else None
        cycle, held = self._ticks.at(context, told)
        if cycle.number != held.number:
            held = self._run(context, held, cycle)
        output.set_value(held)

    def _run(
        self, context: Context, held: Tick[S], cycle: Cycle, given: Given | None = None
    ) -> Tick[S]:
        """Return what a cycle leaves behind."""
        name = self.params.controller_name
        period_ns = cycle.period_ns
        if cycle.periods:
            period_ns = cycle.periods.get(name, period_ns)
        news = cycle.news
        is_quiet = news is not None and news is held.news
        now = Now(context, cycle.time_ns, period_ns, cycle, is_quiet, given)
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
        elif not period_ns:
            news = held.news
        else:
            state = self._update(now, state)
            command, is_ok = self._command(state), self._is_ok(state)
            if not is_ok:
                fault = self._fault(state)
                if self._ends_on_failure:
                    state, activation = self._deactivate(now, state), None
                    command = self._command(state)
        if ending is not None:  # What a restart leaves unwritten ends.
            command = np.where(np.isnan(command), ending, command)
        return Tick(cycle.number, activation, state, command, is_ok, fault, news)

    def _update_state(self, context: Context, state: State) -> None:
        assert isinstance(self._ticks, OwnTicks)
        self._ticks.store(state, self._tick_port.Eval(context))
