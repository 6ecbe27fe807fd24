"""How far many runs are, on standard error."""

import contextlib
import sys
import time

# A terminal is told as often, a file as seldom [s].
_IN_PLACE, _AS_LINE = 0.1, 5.0

_WIDTH = 20


class Progress:
    """A bar in place on a terminal and in a notebook; lines elsewhere, or nothing."""

    def __init__(self, num_runs: int, shown: bool | None) -> None:
        """Create it, and show it.

        Args:
            num_runs: How many runs there are.
            shown: Whether to show it; None is in terminals and notebooks alone.
        """
        self._is_in_place = _can_overwrite()
        self._is_shown = self._is_in_place if shown is None else shown
        self._num_runs = num_runs
        self._num_done = self._num_failed = 0
        self._start = time.perf_counter()
        self._told_at = self._start if not self._is_in_place else -_AS_LINE
        self._width = 0
        if self._is_in_place and num_runs:
            self._tell(self._start)

    def add(self, *, failed: bool) -> None:
        """Count a run that has ended.

        Args:
            failed: Whether it has an error.
        """
        self._num_done += 1
        self._num_failed += failed
        now = time.perf_counter()
        often = _IN_PLACE if self._is_in_place else _AS_LINE
        if now - self._told_at >= often:
            self._tell(now)

    def close(self) -> None:
        """Show where it ended, and leave that line."""
        if not (self._is_shown and self._num_runs):
            return
        self._tell(time.perf_counter())
        if self._is_in_place:
            _write("\n")

    def _tell(self, now: float) -> None:
        if not self._is_shown:
            return
        self._told_at = now
        text = self._describe(now - self._start)
        if self._is_in_place:
            _write(f"\r{text.ljust(self._width)}")
            self._width = len(text)
        else:
            _write(f"{text}\n")

    def _describe(self, seconds: float) -> str:
        done, total = self._num_done, self._num_runs
        text = f"{done}/{total} runs, {_clock(seconds)}"
        if self._num_failed:
            text += f", {self._num_failed} failed"
        if 0 < done < total:
            text += f", {_clock(seconds / done * (total - done))} left"
        if not self._is_in_place:
            return text
        filled = _WIDTH * done // total
        return f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {text}"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _write(text: str) -> None:
    # It may be closed, or none: of a program without a console.
    with contextlib.suppress(AttributeError, ValueError, OSError):
        sys.stderr.write(text)
        sys.stderr.flush()


def _can_overwrite() -> bool:
    """Return whether standard error is a terminal, or a notebook's."""
    with contextlib.suppress(AttributeError, ValueError):
        return sys.stderr.isatty() or _is_notebook()
    return False


def _is_notebook() -> bool:
    return type(sys.stderr).__module__.startswith("ipykernel")
