"""End what would last for ever, such as reading a pipe that nobody writes to."""

import contextlib
import signal
from collections.abc import Iterator


@contextlib.contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fail if what is inside takes longer.

    Args:
        seconds: How long it may take [s].
    """
    ended = []

    def end(*_: object) -> None:
        ended.append(True)
        raise TimeoutError

    saved = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, saved)
        # What is inside may have caught the error.
        assert not ended, f"not done after {seconds} s"
