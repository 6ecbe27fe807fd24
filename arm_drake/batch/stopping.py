"""How runs in threads are told to stop, and how nested calls are known."""

import contextvars
import threading

# In a thread that executes runs: whether to stop.
_STOP: contextvars.ContextVar[threading.Event | None] = contextvars.ContextVar(
    "arm_drake_stop", default=None
)

# Set in a worker process.
_IS_WORKER = threading.Event()


class Stop(BaseException):
    """Nobody waits for this run any more."""


def enter_thread(stop: threading.Event) -> None:
    """Note that this thread executes runs, until it is told to stop.

    Args:
        stop: Tells it.
    """
    _STOP.set(stop)


def enter_process() -> None:
    """Note that this process executes runs of another one."""
    _IS_WORKER.set()


def is_nested() -> bool:
    """Return whether this is within a run that has others beside it."""
    return _IS_WORKER.is_set() or _STOP.get() is not None


def check_stop() -> None:
    """Raise Stop if this run was told to stop."""
    stop = _STOP.get()
    if stop is not None and stop.is_set():
        raise Stop
