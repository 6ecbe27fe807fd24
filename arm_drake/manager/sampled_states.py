"""What is measured, sampled in the ticks of a slow controller."""

import math

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiscreteValues

from arm_drake import interfaces
from arm_drake.controllers.cycles import Cycle
from arm_drake.python_system import PythonSystem


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
