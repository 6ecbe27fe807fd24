"""Which file type is written and read by what."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from arm_drake.errors import InputError, OutputError
from arm_drake.logs.arrays import read_npz, write_npz
from arm_drake.logs.bag import BagWriter, write_mcap
from arm_drake.logs.bag_reader import read_mcap
from arm_drake.logs.table import TableWriter, read_csv, write_csv

if TYPE_CHECKING:
    from arm_drake.rollout import Rollout

Write = Callable[["Rollout", Path], None]

# Returns the fields of a Rollout; a Reference is its joints and positions.
Read = Callable[[Path, str | None], dict[str, Any]]


class PartWriter(Protocol):
    """Writes a rollout part by part; the file is complete after each of them."""

    def __init__(self, path: Path) -> None:
        """Create the file, in place of one that is there."""

    def write(self, *rollouts: "Rollout") -> None:
        """Write what is new of each robot."""

    def close(self) -> None:
        """Close the file."""


class _Format(NamedTuple):
    write: Write
    read: Read

    # What writes it while it grows, if that is possible.
    stream: type[PartWriter] | None = None


_FORMATS: Mapping[str, _Format] = {
    ".npz": _Format(write_npz, lambda path, _: read_npz(path)),
    ".csv": _Format(write_csv, lambda path, _: read_csv(path), TableWriter),
    ".mcap": _Format(write_mcap, read_mcap, BagWriter),
}


def writer_for(path: Path) -> Write:
    """Return what writes a rollout to a file of this type.

    Raises:
        OutputError: If the type is unknown.
    """
    return _find(path, OutputError).write


def reader_for(path: Path) -> Read:
    """Return what reads a rollout from a file of this type.

    Raises:
        InputError: If the type is unknown.
    """
    return _find(path, InputError).read


def can_stream(path: Path) -> bool:
    """Return whether a file of this type can be written while it grows."""
    return path.suffix in _FORMATS and _FORMATS[path.suffix].stream is not None


def stream_writer_for(path: Path) -> type[PartWriter]:
    """Return what writes a rollout to a file of this type while it grows.

    Raises:
        OutputError: If the type is unknown, or can only be written at the end.
    """
    stream = _find(path, OutputError).stream
    if stream is None:
        known = sorted(suffix for suffix, each in _FORMATS.items() if each.stream)
        raise OutputError(
            f"a {path.suffix} file can't grow while a simulation runs; expected one "
            f"of {', '.join(known)}, or Rollout.save at the end",
            file=path,
        )
    return stream


def _find(path: Path, error: type[InputError]) -> _Format:
    if path.suffix not in _FORMATS:
        raise error(
            f"unknown type {path.suffix!r} of a log; expected one of "
            f"{', '.join(sorted(_FORMATS))}",
            file=path,
        )
    return _FORMATS[path.suffix]
