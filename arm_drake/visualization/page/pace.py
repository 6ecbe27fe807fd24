"""How far a simulation should be by now, and how fast it has been."""

import math
import time

from arm_drake.errors import InputError

# What was missed of real time for longer than this is given up [s].
_LONGEST_LAG = 0.1

# How long the page may wait for a simulation that is slow [s].
_LONGEST_STEP = 0.05

# The real-time factor is that of so much wall time [s].
_FACTOR_WINDOW = 1.0


class Pace:
    """Sets how far to simulate, by the wall clock; it stands until `start`."""

    def __init__(self, rate: float) -> None:
        """Create it.

        Args:
            rate: Simulated seconds per second; 0 is as fast as it goes.

        Raises:
            InputError: If it is negative, or no number.
        """
        if not (math.isfinite(rate) and rate >= 0.0):
            raise InputError(f"real-time rate: expected at least 0, got {rate!r}")
        self.rate = float(rate)
        self._step = _LONGEST_STEP
        self._played = 0.0
        self._is_started = False
        self._since = 0.0
        # Wall times and the simulated times that belong to them [s].
        self._anchor = (0.0, 0.0)
        self._moments = [self._anchor]

    @property
    def factor(self) -> float:
        """Simulated seconds per second in the last second."""
        (first, start), (last, end) = self._moments[0], self._moments[-1]
        return (end - start) / (last - first) if last > first else 0.0

    @property
    def wall_time(self) -> float:
        """Wall time between starts and stops so far [s]."""
        running = time.perf_counter() - self._since if self._is_started else 0.0
        return self._played + running

    def start(self, simulated: float) -> None:
        """Let real time count from now.

        Args:
            simulated: Simulated time [s].
        """
        now = time.perf_counter()
        self._since, self._is_started = now, True
        self._anchor = (now, simulated)
        self._moments = [self._anchor]

    def stop(self) -> None:
        """Let real time count no more."""
        self._played = self.wall_time
        self._is_started = False

    def go_on_from(self, other: "Pace") -> None:
        """Count the wall time of another pace, which this one replaces."""
        self._played = other.wall_time

    def target(self, simulated: float) -> float:
        """Return the time to simulate up to now [s].

        Args:
            simulated: Simulated time [s].
        """
        target = math.inf
        if self.rate > 0.0:
            now = time.perf_counter()
            wall, start = self._anchor
            target = start + self.rate * (now - wall)
            if target > simulated + _LONGEST_LAG * self.rate:
                target = simulated + _LONGEST_LAG * self.rate
                self._anchor = (now, target)
        return min(target, simulated + self._step)

    def note(self, simulated: float, step: float, took: float) -> None:
        """Take note of how long a step took.

        Args:
            simulated: Simulated time after it [s].
            step: How far it went [s].
            took: Its wall time [s].
        """
        if step > 0.0:
            # As long as the page may wait, but not all at once.
            longest = step * _LONGEST_STEP / max(took, 1e-6)
            self._step = min(longest, 2.0 * max(step, self._step))
        now = time.perf_counter()
        self._moments.append((now, simulated))
        while len(self._moments) > 2 and self._moments[1][0] < now - _FACTOR_WINDOW:
            self._moments.pop(0)
