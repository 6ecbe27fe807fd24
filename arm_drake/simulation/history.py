"""What a simulation without an end keeps of its past."""

from arm_drake.simulation.mailbox import Mailbox
from arm_drake.simulation.recording import forget_rows


class History:
    """Keeps the logs of a simulation from growing for ever."""

    def __init__(self, mailbox: Mailbox, duration: float) -> None:
        """Create it.

        Args:
            mailbox: Of the simulation.
            duration: How much of the past is kept at least [s], and no more than twice
                as much.
        """
        self._mailbox = mailbox
        self._duration = duration
        self._start = mailbox.time

    def trim(self) -> None:
        """Forget what is too old, if there is much of it."""
        now = self._mailbox.time
        # A simulation that was reset has logged nothing of before.
        self._start = min(self._start, now)
        if now - self._start <= 2.0 * self._duration:
            return
        self._start = now - self._duration
        self._mailbox.forget_before(self._start)
        root = self._mailbox.simulator.get_mutable_context()
        forget_rows(self._mailbox.diagram, root, self._start)
