"""Files that results are written to: found out early what can't be written late."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from arm_drake.errors import OutputError


def check_suffix(path: Path, kind: str, suffixes: Sequence[str]) -> None:
    """Raise OutputError if a file can't be of this type.

    Args:
        path: File to be written.
        kind: What it is, such as "a picture".
        suffixes: What it may end in.
    """
    if path.suffix not in suffixes:
        several = "one of " if len(suffixes) > 1 else ""
        raise OutputError(
            f"unknown type {path.suffix!r} of {kind}; expected {several}"
            f"{', '.join(suffixes)}",
            file=path,
        )


def check_writable(path: Path) -> None:
    """Raise OutputError if a file can't be written; an existing one stays as it is."""
    if path.is_fifo():  # To open one is to wait for its reader.
        raise OutputError("can't be written: it is a pipe; name a file", file=path)
    existed = path.exists()
    with writing(path), path.open("ab"):
        pass
    if not existed:
        path.resolve().unlink()  # A link to it was there before.


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says about a file into an OutputError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"can't be written: {reason}", file=path) from None
