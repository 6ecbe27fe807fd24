"""Waiting for what another thread or process does: for a state, not for a time."""

import time
from collections.abc import Callable

# Nothing is waited for longer than this, on a machine that has other things to do [s].
PATIENCE = 60.0


def wait_until(is_so: Callable[[], object], what: str = "it comes") -> None:
    """Wait until something is so, which another thread or process does.

    Args:
        is_so: Says whether it is; it may raise where it can't be any more.
        what: What is waited for, in words.
    """
    deadline = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < deadline, f"not within {PATIENCE:g} s: {what}"
        time.sleep(0.005)
