"""Connects controllers that command or read each other."""

import itertools
import math
from collections.abc import Collection, Mapping

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle
from arm_drake.python_system import PythonSystem


def connect_chains(
    builder: DiagramBuilder, systems: Collection[ControllerInterface]
) -> None:
    """Connect the ticks of controllers that command or read each other.

    As in ros2_control, who commands comes before the commanded, and who exports before
    the reader; so all of them see this very tick. Where both can't be, because who
    exports is commanded by the reader, the reader sees the tick before.

    Args:
        builder: Where the controllers are.
        systems: The controllers of a robot; they don't command each other in a circle.
    """
    # Whose ticks a controller's tick waits for.
    waits: dict[str, set[str]] = {system.get_name(): set() for system in systems}
    pairs = list(itertools.permutations(systems, 2))
    for first, second in pairs:
        if not set(first.command_interfaces).isdisjoint(second.reference_interfaces):
            tick = first.GetOutputPort(interfaces.COMMAND_PORT)
            builder.Connect(tick, second.add_predecessor(first))
            waits[second.get_name()].add(first.get_name())
    for first, second in pairs:
        if set(first.exported_interfaces).isdisjoint(second.state_interfaces):
            continue
        if (
            isinstance(first, TickingController)
            and isinstance(second, TickingController)
            and not _waits(first.get_name(), second.get_name(), waits)
        ):
            tick = first.GetOutputPort(interfaces.COMMAND_PORT)
            builder.Connect(tick, second.add_exporter_tick(first))
            waits[second.get_name()].add(first.get_name())
        else:
            held = first.GetOutputPort(interfaces.EXPORT_PORT)
            builder.Connect(held, second.add_exporter(first))


def _waits(name: str, other: str, waits: Mapping[str, Collection[str]]) -> bool:
    """Return whether a controller's tick waits for another's, over however many."""
    found, waiting = {name}, [name]
    while waiting:
        new = set(waits[waiting.pop()]) - found
        found |= new
        waiting += new
    return other in found


class SampledStates(PythonSystem):
    """Holds what was measured in the last tick of one slow controller.

    .. pydrake_system::

        name: SampledStates
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - state_interfaces
        - tick_time

    ==================  ====  ======  ==============================================
    port                size  unit    meaning
    ==================  ====  ======  ==============================================
    controller_manager  --    --      Cycle: which controllers tick
    state_interfaces    m     rad,    in: what is measured; out: the same, held since
                              rad/s,  the controller's last tick
                              N·m
    tick_time           1     ns      when that was; NaN before the first tick, and
                                      while the controller is inactive
    ==================  ====  ======  ==============================================

    The state is what the outputs show. It is a discrete update at the manager's period:
    Drake does these after the unrestricted updates of an instant, so the manager has
    run its cycle, tells of it and no more of the next one, and what is measured are the
    effects of its commands. A time is a whole number of nanoseconds, exact up to 2^53,
    which is 104 days.
    """

    def __init__(self, controller: str, num_measured: int, period: float) -> None:
        """Create the system.

        Args:
            controller: Name of the controller.
            num_measured: Size m of what is measured.
            period: Period of the manager in Drake's time [s].
        """
        super().__init__()
        self._controller = controller
        self._manager = self.DeclareAbstractInputPort(
            interfaces.MANAGER_PORT, AbstractValue.Make(())
        )
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        values = self.DeclareDiscreteState(num_measured)
        time = self.DeclareDiscreteState([math.nan])
        # Drake takes plain numbers quicker than its own kinds of index.
        self._values, self._time = int(values), int(time)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareStateOutputPort(interfaces.STATE_PORT, values)
        self.DeclareStateOutputPort(interfaces.TICK_PORT, time)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        cycle: Cycle = self._manager.Eval(context)
        if cycle.periods.get(self._controller):
            state.set_value(self._values, self._measured.Eval(context))
            state.set_value(self._time, [cycle.time_ns])
        elif self._controller not in cycle.active:
            state.set_value(self._time, [math.nan])
