"""Tables of trajectories: one point in each row, sent one after the other."""

import csv
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.messages import JointTrajectory
from arm_drake.simulation.fields import Fields
from arm_drake.simulation.trajectories import read_trajectory

KIND = "trajectory_table"

# Column with the time after which a row's point is to be reached [s].
_TIME = "time_from_start"

# A larger table is a slip, and would fill the memory.
_MAX_ROWS = 100_000


def read_table(
    fields: Fields, value: Any, every: float, file: Path | None
) -> list[JointTrajectory]:
    """Return the trajectories of a table, one of one point for each row.

    Args:
        fields: What checks the step.
        value: A CSV file, seen from the motion's folder, whose first row names the
            joints and may have a column `time_from_start`; or a mapping of
            `joint_names`, `points` (a list of lists of positions) and, perhaps,
            `time_from_start`. Without one it is ``every``.
        every: Time from row to row [s].
        file: The motion's file.

    Raises:
        MotionError: If it can't be used.
    """
    if isinstance(value, str):
        names, rows, times = _read_csv(fields, value, file)
    else:
        names, rows, times = _read_inline(fields, value)
    if not rows:
        raise fields.error(KIND, "expected at least one row")
    return [
        read_trajectory(
            fields,
            {
                "joint_names": list(names),
                "points": [{"positions": row, _TIME: every if t is None else t}],
            },
            f"{KIND}[{index}]",
        )
        for index, (row, t) in enumerate(zip(rows, times, strict=True))
    ]


_Table = tuple[Sequence[str], list[list[float]], list[float | None]]


def _read_inline(fields: Fields, value: Any) -> _Table:
    data: Mapping[str, Any] = fields.mapping(
        value, KIND, ("joint_names", "points", _TIME)
    )
    names = fields.names(data.get("joint_names"), f"{KIND}.joint_names")
    rows = [
        list(fields.numbers(row, f"{KIND}.points[{index}]"))
        for index, row in enumerate(fields.list(data.get("points"), f"{KIND}.points"))
    ]
    time = data.get(_TIME)
    if time is not None:
        time = fields.seconds(time, f"{KIND}.{_TIME}")
    return names, rows, [time] * len(rows)


def _read_csv(fields: Fields, name: str, file: Path | None) -> _Table:
    path = Path(name) if file is None else file.parent / name
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream)
            filled = (
                (reader.line_num, row) for row in reader if any(map(str.strip, row))
            )
            lines = list(itertools.islice(filled, _MAX_ROWS + 2))
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise fields.error(KIND, f"{name}: {reason}") from None
    if len(lines) > _MAX_ROWS + 1:
        raise fields.error(KIND, f"{name}: more than {_MAX_ROWS} rows")
    header = [cell.strip() for cell in lines[0][1]] if lines else []
    joints = [column for column in header if column != _TIME]
    if not joints or "" in header or len(set(header)) < len(header):
        problem = f"expected distinct names of joints in the first row, got {header}"
        raise fields.error(KIND, f"{name}: {problem}")
    rows, times = [], []
    for number, line in lines[1:]:
        place = f"{name}, line {number}"
        if len(line) != len(header):
            problem = f"expected {len(header)} values, got {len(line)}"
            raise fields.error(KIND, f"{place}: {problem}")
        values = dict(zip(header, map(_number, line), strict=True))
        for column, cell in zip(header, line, strict=True):
            if values[column] is None:
                problem = f"{column}: expected a number, got {cell.strip()!r}"
                raise fields.error(KIND, f"{place}: {problem}")
        rows.append(
            [fields.number(values[joint], f"{KIND}, {place}") for joint in joints]
        )
        times.append(values.get(_TIME))
    return joints, rows, times


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None
