"""The process of a command: its folder, open files and encoding, and its end."""

import contextlib
import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

from arm_drake.errors import InputError

# Files that may be open at once: a page with some browsers needs so many.
_FILES = 64

# What the machine has run out of.
_SHORTAGES = (errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.EIO)
_OF_FILES = (errno.EMFILE, errno.ENFILE)


def check_process() -> None:
    """Raise InputError if this process lacks what Drake can't do without."""
    try:
        os.getcwd()
    except OSError:
        text = "the working directory is not there any more; change to another"
        raise InputError(text) from None
    if sys.getfilesystemencoding() == "ascii":
        text = "Drake can't be used with ASCII; set PYTHONUTF8=1, or LC_ALL=C.UTF-8"
        raise InputError(text)
    if sys.platform != "win32":
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        if limit != resource.RLIM_INFINITY and limit < _FILES:
            text = f"no more than {limit} files may be open; expected {_FILES} at least"
            raise InputError(f"{text}: ulimit -n {_FILES}")


@contextlib.contextmanager
def terminating() -> Iterator[None]:
    """Take SIGTERM, which `timeout` and containers send, as Ctrl-C."""
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def interrupt(number: int, frame: Any) -> None:
        handler = signal.getsignal(signal.SIGINT)
        if callable(handler):
            handler(signal.SIGINT, frame)
        else:  # Shells have jobs in the background ignore Ctrl-C, but not this.
            raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def shortage(error: OSError) -> str | None:
    """Return what the machine has run out of, or None if it is something else."""
    if error.errno not in _SHORTAGES:
        return None
    place = error.filename
    if place is None and error.errno not in _OF_FILES:
        place = "standard output"
    return f"{place}: {error.strerror}" if place else str(error.strerror)


def drop_output() -> None:
    """Write nothing more to standard output, also not what is still on its way."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
