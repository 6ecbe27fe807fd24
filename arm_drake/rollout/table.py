"""Rollouts as a table, in a `.csv` file: the rows, with units in the head."""

import csv
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.errors import InputError
from arm_drake.rollout.rollout import TIME, Rollout

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


class TableWriter:
    """Writes the rows of a robot's rollouts, part by part."""

    def __init__(self, path: Path) -> None:
        """Create the file, replacing an existing one."""
        self._file = path.open("w", encoding="utf-8", newline="")
        self._heads: list[str] = []
        self._last = -math.inf

    def write(self, *rollouts: Rollout) -> None:
        """Write the new rows of a single rollout, and flush them."""
        (rollout,) = rollouts
        columns = rollout.columns()
        if not self._heads:
            self._heads = list(columns)
            csv.writer(self._file, lineterminator="\n").writerow(columns)
        new = rollout.time > self._last
        _write_rows(self._file, [columns[head][new] for head in self._heads])
        if new.any():
            self._last = float(rollout.time[-1])
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _write_rows(file: IO[str], columns: Iterable[Array]) -> None:
    """Write columns, each of shape (N,), as rows; NaN is nothing."""
    for row in zip(*columns, strict=True):
        numbers = ("" if math.isnan(number) else repr(float(number)) for number in row)
        file.write(",".join(numbers) + "\n")


def read_fields(path: Path, robot: str | None = None) -> dict[str, Any]:
    """Return the fields that a table has of its only rollout, or raise InputError.

    A row that is cut short, by the end of who wrote it, is left out.
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
