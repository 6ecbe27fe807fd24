"""Which file type is written and read by what."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from arm_drake.errors import ArmDrakeError, InputError, OutputError, suggest
from arm_drake.output_files import writing
from arm_drake.rollout.bag import BagWriter, read_mcap, write_mcap
from arm_drake.rollout.npz import read_npz, write_npz
from arm_drake.rollout.rollout import Reference, Rollout, check_fields
from arm_drake.rollout.table import TableWriter, read_csv, write_csv

Write = Callable[[Rollout, Path], None]

# Returns the fields of a Rollout; a Reference is its joints and positions.
Read = Callable[[Path, str | None], dict[str, Any]]


class PartWriter(Protocol):
    """Writes a rollout part by part; the file is complete after each of them."""

    def __init__(self, path: Path) -> None:
        """Create the file, in place of one that is there."""

    def write(self, *rollouts: Rollout) -> None:
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


def save_rollout(rollout: Rollout, path: Path) -> None:
    """Write a rollout; `Rollout.save` does that.

    Args:
        rollout: The rollout.
        path: File to write.

    Raises:
        MissingExtraError: If what the file needs isn't installed.
        OutputError: If the file can't be written, or its type is unknown.
    """
    write = writer_for(path)
    with writing(path):
        write(rollout, path)


def load_fields(path: Path, robot: str | None) -> dict[str, Any]:
    """Return the fields of the rollout in a file; `Rollout.load` makes it of them.

    Args:
        path: File to read.
        robot: Name of the robot, in a bag of several; by default the first one.

    Raises:
        InputError: If the file can't be read, or is no rollout.
        MissingExtraError: If what the file needs isn't installed.
    """
    read = reader_for(path)
    try:
        fields = read(path, robot)
        check_fields(fields)
        known = fields.get("robot_name")
        if robot and known and robot != known:
            problem = f"no robot {robot!r}; {suggest(robot, [known])}"
            raise InputError(problem, file=path)
    except (ArmDrakeError, KeyboardInterrupt):
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"can't be read: {reason}", file=path) from None
    except Exception as error:  # Whatever a damaged file makes of its readers.
        reason = " ".join(str(error).split()) or type(error).__name__
        text = f"can't be read: it is damaged or no log ({reason})"
        raise InputError(text, file=path) from None
    wanted = fields.pop("references")
    references = {name: Reference(*parts) for name, parts in wanted.items()}
    return {**fields, "references": references}


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
