"""What a simulation without an end keeps of its past."""

import numpy as np
from pydrake.systems.primitives import VectorLogSink

from arm_drake.simulation import Simulation


class History:
    """Keeps the logs of a simulation from growing for ever."""

    def __init__(self, simulation: Simulation, duration: float) -> None:
        """Create it.

        Args:
            simulation: The simulation.
            duration: How much of the past is kept at least [s], and no more than twice
                as much.
        """
        self._simulation = simulation
        self._duration = duration
        self._start = simulation.time

    def trim(self) -> None:
        """Forget what is too old, if there is much of it."""
        now = self._simulation.time
        # A simulation that was reset has logged nothing of before.
        self._start = min(self._start, now)
        if now - self._start <= 2.0 * self._duration:
            return
        self._start = now - self._duration
        root = self._simulation.simulator.get_mutable_context()
        for system in self._simulation.diagram.GetSystems():
            if isinstance(system, VectorLogSink):
                log = system.FindMutableLog(root)
                times, rows = log.sample_times().copy(), log.data().T.copy()
                log.Clear()
                for row in range(int(np.searchsorted(times, self._start)), len(times)):
                    log.AddData(times[row], rows[row])
