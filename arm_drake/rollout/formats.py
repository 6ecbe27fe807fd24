"""File types of rollouts: which module writes and reads each, imported when used."""

import contextlib
import functools
import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from arm_drake.errors import ArmDrakeError, InputError, OutputError, suggest
from arm_drake.output_files import writing

# Kinds of arrays that are numbers: floating, integer, boolean.
_NUMBERS = "fiub"

# Longer than any simulation [s]: about a century.
_MAX_TIME = 3.2e9


class PartWriter(Protocol):
    """Writes rollouts part by part; the file is complete after each of them."""

    def __init__(self, path: Path) -> None:
        """Create the file, replacing an existing one."""

    def write(self, *rollouts: Any) -> None:
        """Write what is new of each robot."""

    def close(self) -> None:
        """Close the file."""


class _Format(NamedTuple):
    # It has read_fields(path, robot), which returns the fields of a Rollout; a
    # Reference is its joints and positions.
    module: str

    # The PartWriter there, if a file of this type can grow; else it has
    # write_rollout(rollout, path).
    part_writer: str = ""

    def load(self, name: str) -> Any:
        return getattr(importlib.import_module(self.module), name)


_FORMATS: Mapping[str, _Format] = {
    ".csv": _Format("arm_drake.rollout.table", "TableWriter"),
    ".mcap": _Format("arm_drake.rollout.bag", "BagWriter"),
    ".npz": _Format("arm_drake.rollout.npz"),
}


def writer_for(path: Path) -> Callable[[Any, Path], None]:
    """Return what writes a rollout to a file, or raise OutputError."""
    found = _find(path, OutputError)
    if found.part_writer:
        return functools.partial(_write_part, found.load(found.part_writer))
    write: Callable[[Any, Path], None] = found.load("write_rollout")
    return write


def _write_part(make: type[PartWriter], rollout: Any, path: Path) -> None:
    """Write a rollout as the only part of a file."""
    with contextlib.closing(make(path)) as writer:
        writer.write(rollout)


def save_rollout(rollout: Any, path: Path) -> None:
    """Write a rollout, as `Rollout.save` says."""
    write = writer_for(path)
    with writing(path):
        write(rollout, path)


def load_fields(path: Path, robot: str | None) -> dict[str, Any]:
    """Return the fields of the rollout in a file, as `Rollout.load` says."""
    read = _find(path, InputError).load("read_fields")
    try:
        fields: dict[str, Any] = read(path, robot)
        _check_fields(fields)
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
    return fields


def can_stream(path: Path) -> bool:
    """Return whether a file of this type can be written while it grows."""
    return path.suffix in _FORMATS and bool(_FORMATS[path.suffix].part_writer)


def stream_writer_for(path: Path) -> type[PartWriter]:
    """Return what writes a file while it grows, or raise OutputError."""
    found = _find(path, OutputError)
    if not found.part_writer:
        known = sorted(suffix for suffix, row in _FORMATS.items() if row.part_writer)
        raise OutputError(
            f"a {path.suffix} file can't grow while a simulation runs; expected one "
            f"of {', '.join(known)}, or Rollout.save at the end",
            file=path,
        )
    writer: type[PartWriter] = found.load(found.part_writer)
    return writer


def _find(path: Path, error: type[InputError]) -> _Format:
    if path.suffix not in _FORMATS:
        raise error(
            f"unknown type {path.suffix!r} of a log; expected one of "
            f"{', '.join(sorted(_FORMATS))}",
            file=path,
        )
    return _FORMATS[path.suffix]


def _check_fields(fields: Mapping[str, Any]) -> None:
    """Raise ValueError if fields of a Rollout don't fit together."""
    time, joints = np.asarray(fields["time"]), fields["joint_names"]
    if (
        time.dtype.kind not in _NUMBERS
        or time.ndim != 1
        or not np.all(np.abs(time) <= _MAX_TIME)
    ):
        raise ValueError("times are no numbers of seconds")
    if np.any(np.diff(time) <= 0.0):
        raise ValueError("times don't rise")
    num_rows, num_joints = len(time), len(joints)
    names = fields.get("command_names", ())
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
        name: (fields[name], (num_rows, num_joints))
        for name in ("position", "velocity", "effort")
    }
    shapes["effort_limit"] = fields["effort_limit"], (num_joints,)
    if names:
        shapes["command"] = fields["command"], (num_rows, len(names))
    if fields.get("controllers"):
        shapes["active"] = fields["active"], (num_rows, len(fields["controllers"]))
    for link, poses in fields.get("free_poses", {}).items():
        shapes[f"pose of {link!r}"] = poses, (num_rows, 7)
    for link, forces in fields.get("contact_forces", {}).items():
        shapes[f"contact force of {link!r}"] = forces, (num_rows, 3)
    for controller, (joint_names, position) in fields["references"].items():
        what = f"reference of {controller!r}"
        shapes[what] = position, (num_rows, len(joint_names))
        unknown = [joint for joint in joint_names if joint not in joints]
        if unknown:
            raise ValueError(
                f"{what} is of a joint {unknown[0]!r} that the rollout doesn't have"
            )
    for name, (values, shape) in shapes.items():
        found = np.shape(values)
        if found != shape:
            raise ValueError(f"{name} has shape {found}, expected {shape}")
        kind = np.asarray(values).dtype
        if kind.kind not in _NUMBERS:
            raise ValueError(f"{name} holds {kind}, expected numbers")
    if len(fields["joint_types"]) != num_joints:
        raise ValueError(f"{len(fields['joint_types'])} types of {num_joints} joints")
    info = fields.get("info", {})
    if not isinstance(info, Mapping) or not isinstance(info.get("robot", {}), Mapping):
        raise ValueError("info is no mapping with a mapping of the robot")
