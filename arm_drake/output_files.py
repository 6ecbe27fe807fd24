"""Output files of results, checked before the simulation."""

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

from arm_drake.errors import OutputError

# What cameras' pictures can be in a log.
IMAGE_FORMATS = ("raw", "jpeg", "png")

# What a plot of a rollout can show; the first is the default.
PLOT_KINDS = ("overview", "tracking", "error", "effort", "phase", "path")

PLOT_SUFFIXES = (".png", ".svg", ".pdf")


def check_suffix(path: Path, kind: str, suffixes: Sequence[str]) -> None:
    """Raise OutputError if a file can't be of this kind, such as "a picture"."""
    if path.suffix not in suffixes:
        several = "one of " if len(suffixes) > 1 else ""
        raise OutputError(
            f"unknown type {path.suffix!r} of {kind}; expected {several}"
            f"{', '.join(suffixes)}",
            file=path,
        )


def check_plot_path(path: Path) -> None:
    """Raise OutputError if a picture can't be of this type."""
    check_suffix(path, "a picture", PLOT_SUFFIXES)


def check_writable(path: Path) -> None:
    """Raise OutputError if a file can't be written; an existing one stays as it is."""
    if path.is_fifo():  # To open one is to wait for its reader.
        raise OutputError("can't be written: it is a pipe; name a file", file=path)
    existed = path.exists()
    with writing(path), path.open("ab"):
        pass
    if not existed:
        path.resolve().unlink()  # A link to it was there before.


def find_free_path(stem: str) -> Path:
    """Return the YAML file of stem, stem_2, ... that isn't in the working folder."""
    path, number = Path(f"{stem}.yaml"), 2
    while path.exists():
        path, number = Path(f"{stem}_{number}.yaml"), number + 1
    return path


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says about a file into an OutputError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        if isinstance(error, FileNotFoundError) and not path.parent.is_dir():
            reason = f"the folder {str(path.parent)!r} doesn't exist"
        raise OutputError(f"can't be written: {reason}", file=path) from None


@contextlib.contextmanager
def unbroken() -> Iterator[None]:
    """Put Ctrl-C off until the end of the block; it counts then."""
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT)
    if not is_main or before is None:
        yield
        return
    pressed = threading.Event()
    signal.signal(signal.SIGINT, lambda *signal_and_frame: pressed.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed.is_set():
        signal.raise_signal(signal.SIGINT)
