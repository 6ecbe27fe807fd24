"""What a simulation without an end keeps of its past."""

from typing import TYPE_CHECKING

from arm_drake.recording import forget_rows

if TYPE_CHECKING:
    from arm_drake.simulation import Simulation


class History:
    """Keeps the logs of a simulation from growing for ever."""

    def __init__(self, simulation: "Simulation", duration: float) -> None:
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
        self._simulation.mailbox.forget_before(self._start)
        root = self._simulation.simulator.get_mutable_context()
        forget_rows(self._simulation.diagram, root, self._start)
