"""Rollouts as a table, in a `.csv` file: the rows, with units in the head."""

import csv
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.errors import InputError, MissingExtraError
from arm_drake.rollout.rollout import Rollout

if TYPE_CHECKING:
    import pandas as pd

# Name of the column of times.
TIME = "time [s]"
_POSE = ("x [m]", "y [m]", "z [m]", "qw", "qx", "qy", "qz")

# Units of command interfaces of joints that turn, and of those that slide.
_UNITS = {"acceleration": ("rad/s^2", "m/s^2")}

# How columns are called, and what they are, in the order in which they are tried.
_HEADS = {
    # The name of the controller, and that of the joint.
    "reference": re.compile(r"(?P<name>.+) reference \[(?P<unit>.*)\]"),
    "command": re.compile(r"command (?P<name>.+?/.+?)( \[(?P<unit>[^]]*)\])?"),
    "active": re.compile(r"(?P<name>.+) active"),
    "contact force": re.compile(r"contact force (?P<name>.+) [xyz] \[(?P<unit>N)\]"),
    "pose": re.compile(r"pose (?P<name>.+) (?P<unit>[xyz] \[m\]|q[wxyz])"),
    **{
        quantity: re.compile(rf"(?P<name>.+) {quantity} \[(?P<unit>.*)\]")
        for quantity in interfaces.STATE_INTERFACES
    },
}


def make_columns(rollout: Rollout) -> dict[str, Array]:
    """Return the columns of the rows by their heads, each of shape (N,).

    Args:
        rollout: A rollout.
    """
    columns = {TIME: rollout.time}
    types = dict(zip(rollout.joint_names, rollout.joint_types, strict=True))
    for quantity in interfaces.STATE_INTERFACES:
        values = getattr(rollout, quantity)
        for index, (name, kind) in enumerate(types.items()):
            unit = interfaces.unit(quantity, kind)
            columns[f"{name} {quantity} [{unit}]"] = values[:, index]
    for controller, reference in rollout.references.items():
        for index, name in enumerate(reference.joint_names):
            unit = interfaces.unit(interfaces.POSITION, types[name])
            head = f"{controller} {name} reference [{unit}]"
            columns[head] = reference.position[:, index]
    for index, name in enumerate(rollout.command_names):
        columns[f"command {name}{_unit(name, types)}"] = rollout.command[:, index]
    for index, name in enumerate(rollout.controllers):
        columns[f"{name} active"] = rollout.active[:, index]
    for link, poses in rollout.free_poses.items():
        for index, part in enumerate(_POSE):
            columns[f"pose {link} {part}"] = poses[:, index]
    for link, forces in rollout.contact_forces.items():
        for index, axis in enumerate("xyz"):
            columns[f"contact force {link} {axis} [N]"] = forces[:, index]
    return columns


def make_frame(rollout: Rollout) -> "pd.DataFrame":
    """Return the columns of the rows but for the time, which is the index.

    Args:
        rollout: A rollout.

    Raises:
        MissingExtraError: If pandas isn't installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("Rollout.to_pandas", "pandas") from None
    columns = make_columns(rollout)
    index = pd.Index(columns.pop(TIME), name=TIME)
    return pd.DataFrame(columns, index=index)


def write_csv(rollout: Rollout, path: Path) -> None:
    """Write the rows of a rollout.

    Args:
        rollout: The rollout.
        path: File to write.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        columns = make_columns(rollout)
        write_head(file, columns)
        write_rows(file, columns.values())


class TableWriter:
    """Writes the rows of a robot's rollouts, part by part."""

    def __init__(self, path: Path) -> None:
        """Create the file, in place of one that is there.

        Args:
            path: File to write.
        """
        self._file = path.open("w", encoding="utf-8", newline="")
        self._heads: list[str] = []
        self._last = -math.inf

    def write(self, *rollouts: Rollout) -> None:
        """Write what is new, so that all of it is in the file.

        Args:
            rollouts: One, which goes on where the last one ended; rows that it had are
                left out.
        """
        (rollout,) = rollouts
        columns = make_columns(rollout)
        if not self._heads:
            self._heads = list(columns)
            write_head(self._file, columns)
        new = rollout.time > self._last
        write_rows(self._file, [columns[head][new] for head in self._heads])
        if new.any():
            self._last = float(rollout.time[-1])
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def write_head(file: IO[str], heads: Iterable[str]) -> None:
    """Write the first line of a table."""
    csv.writer(file, lineterminator="\n").writerow(heads)


def write_rows(file: IO[str], columns: Iterable[Array]) -> None:
    """Write rows of a table; NaN is nothing.

    Args:
        file: Where to.
        columns: Columns, each of shape (N,).
    """
    for row in zip(*columns, strict=True):
        numbers = ("" if math.isnan(number) else repr(float(number)) for number in row)
        file.write(",".join(numbers) + "\n")


def read_csv(path: Path) -> dict[str, Any]:
    """Return the fields of a rollout that its table has.

    A row that is cut short, by the end of who wrote it, is left out.

    Args:
        path: File of `write_csv`.

    Raises:
        InputError: If it is something else.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
        head = rows.pop(0) if rows else []
        if not head:
            raise ValueError("the file has no head")
        if head[0] != TIME:
            raise ValueError(f"the first column is {head[0]!r}, not {TIME!r}")
        if rows and not _ends_with_newline(path):
            rows.pop()
        numbers = [[float(cell) if cell else math.nan for cell in row] for row in rows]
        table = np.array(numbers, dtype=float).reshape(len(rows), len(head))
        return _make_fields(dict(zip(head, table.T, strict=True)))
    except (ValueError, IndexError, KeyError, csv.Error) as error:
        problem = f"no rollout; expected a table of Rollout.save ({error})"
        raise InputError(problem, file=path) from None


def _ends_with_newline(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) == b"\n"


def _make_fields(columns: dict[str, Array]) -> dict[str, Any]:
    time = columns.pop(TIME)
    found: dict[str, dict[str, Any]] = {kind: {} for kind in _HEADS}
    types: dict[str, str] = {}
    for head, values in columns.items():
        kind, match = _match(head)
        part, name = match.groupdict(), match["name"]
        if kind == "reference":
            # Both may have spaces; the joints stand before this.
            joints = [joint for joint in types if name.endswith(f" {joint}")]
            if not joints:
                raise ValueError(f"no joint of the column {head!r} is known")
            joint = max(joints, key=len)
            owner = name.removesuffix(f" {joint}")
            found[kind].setdefault(owner, {})[joint] = values
        elif kind in ("pose", "contact force"):
            found[kind].setdefault(name, []).append(values)
        else:
            found[kind][name] = values
        if kind == interfaces.POSITION:
            types[name] = "prismatic" if part["unit"] == "m" else "revolute"

    def stack(arrays: Iterable[Array]) -> Array:
        several = list(arrays)
        return np.stack(several, axis=1) if several else np.zeros((len(time), 0))

    return {
        "time": time,
        "joint_names": tuple(types),
        "joint_types": tuple(types.values()),
        "effort_limit": np.full(len(types), math.inf),
        **{
            name: stack(found[name][joint] for joint in types)
            for name in interfaces.STATE_INTERFACES
        },
        "references": {
            controller: (tuple(by_joint), stack(by_joint.values()))
            for controller, by_joint in found["reference"].items()
            if not len(time) or not np.all(np.isnan(stack(by_joint.values())))
        },
        "command_names": tuple(found["command"]),
        "command": stack(found["command"].values()),
        "controllers": dict.fromkeys(found["active"], ""),
        "active": stack(found["active"].values()),
        "free_poses": {link: stack(parts) for link, parts in found["pose"].items()},
        "contact_forces": {
            link: stack(parts) for link, parts in found["contact force"].items()
        },
    }


def _match(head: str) -> tuple[str, re.Match[str]]:
    for kind, pattern in _HEADS.items():
        if match := pattern.fullmatch(head):
            return kind, match
    raise ValueError(f"unknown column {head!r}")


def _unit(command: str, types: dict[str, str]) -> str:
    """Return the unit of a command interface, where it is known."""
    joint, _, name = command.rpartition("/")
    if joint not in types:
        return ""
    if name in interfaces.STATE_INTERFACES:
        return f" [{interfaces.unit(name, types[joint])}]"
    if name in _UNITS:
        return f" [{_UNITS[name][types[joint] == 'prismatic']}]"
    return ""
