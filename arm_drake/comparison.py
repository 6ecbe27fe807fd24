"""Where two rollouts differ, in numbers."""

import dataclasses as dc
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.rollout import Rollout

Array = NDArray[np.float64]

TIME = "time [s]"

# Times nearer to each other are the same [s]: logs have whole nanoseconds.
_SAME_TIME = 1e-9


@dc.dataclass(frozen=True)
class ColumnDifference:
    """How far a quantity of two rollouts is apart, in its unit."""

    # What it is, with its unit, such as "joint1 position [rad]".
    name: str

    # Largest absolute difference, and when [s]; 0 and None if there is none.
    largest: float
    at: float | None

    # Root of the mean square of the difference.
    rms: float

    # B less A in the last row that both have; None if one of them has no value there.
    final: float | None

    # Rows in which only one of them has a value.
    num_missing: int


@dc.dataclass(frozen=True)
class Comparison:
    """Where two rollouts, A and B, differ."""

    columns: tuple[ColumnDifference, ...]

    # What differs besides, in words: rows, joints, goals.
    differences: tuple[str, ...]

    # What differs of that which made them, in words: files, options, versions. It
    # alone makes no difference.
    inputs: tuple[str, ...]

    # How many rows were compared, and whether B had to be interpolated there.
    num_rows: int
    is_interpolated: bool

    # What counts as equal, in the unit of each quantity.
    tolerance: float

    @property
    def different(self) -> tuple[ColumnDifference, ...]:
        """The columns that differ by more than the tolerance, the worst first."""
        columns = (
            column
            for column in self.columns
            if column.largest > self.tolerance or column.num_missing
        )
        return tuple(sorted(columns, key=lambda column: -column.largest))

    @property
    def is_equal(self) -> bool:
        """Whether they are equal within the tolerance."""
        return not self.different and not self.differences


def compare(a: Rollout, b: Rollout, tolerance: float = 0.0) -> Comparison:
    """Return where two rollouts differ.

    Rows are compared at the times of A that B has too; if it has none of them, B is
    interpolated where both were running.

    Args:
        a: A rollout.
        b: Another one.
        tolerance: What counts as equal, in the unit of each quantity.
    """
    differences = [*_compare_shape(a, b), *_compare_goals(a, b, tolerance)]
    rows, values, is_interpolated = _common_rows(a, b)
    columns = []
    for name, column in a.columns().items():
        if name in values and name != TIME:
            columns.append(_compare_column(name, a.time[rows], column[rows], values))
    if not len(rows):
        differences.append("they have no time in common")
    return Comparison(
        tuple(columns),
        tuple(differences),
        tuple(_compare_inputs(a.info, b.info)),
        len(rows),
        is_interpolated,
        tolerance,
    )


def _common_rows(
    a: Rollout, b: Rollout
) -> tuple[NDArray[np.intp], dict[str, Array], bool]:
    """Return rows of A, the columns of B at their times, and whether in between."""
    columns = b.columns()
    if not len(a.time) or not len(b.time):
        return np.zeros(0, dtype=np.intp), dict.fromkeys(columns, np.zeros(0)), False
    after = np.minimum(np.searchsorted(b.time, a.time - _SAME_TIME), len(b.time) - 1)
    rows = np.flatnonzero(np.abs(b.time[after] - a.time) <= _SAME_TIME)
    if len(rows):
        return rows, {k: v[after[rows]] for k, v in columns.items()}, False
    rows = np.flatnonzero((a.time >= b.time[0]) & (a.time <= b.time[-1]))
    between = {k: np.interp(a.time[rows], b.time, v) for k, v in columns.items()}
    return rows, between, True


def _compare_column(
    name: str, time: Array, a: Array, others: Mapping[str, Array]
) -> ColumnDifference:
    b = others[name]
    known = np.isfinite(a) & np.isfinite(b)
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    error = np.where(known, b - a, np.where(same, 0.0, np.nan))
    missing = int(np.isnan(error).sum())
    size = np.abs(np.nan_to_num(error))
    largest = float(size.max(initial=0.0))
    at = float(time[int(size.argmax())]) if largest > 0.0 else None
    count = max(len(size) - missing, 1)
    rms = math.sqrt(float(np.sum(size**2)) / count)
    final = float(error[-1]) if len(error) and math.isfinite(error[-1]) else None
    return ColumnDifference(name, largest, at, rms, final, missing)


def _compare_shape(a: Rollout, b: Rollout) -> Iterator[str]:
    """Yield what differs of rows and columns."""
    for end, first, second in (
        ("start", a.time[:1], b.time[:1]),
        ("end", a.time[-1:], b.time[-1:]),
    ):
        if not np.array_equal(first, second):
            texts = [f"{t[0]:g} s" if len(t) else "nowhere" for t in (first, second)]
            yield f"rows {end} at {texts[0]} in A, at {texts[1]} in B"
    if len(a.time) != len(b.time):
        yield f"{len(a.time)} rows in A, {len(b.time)} rows in B"
    mine, theirs = a.columns(), b.columns()
    for name, own, other in (("A", mine, theirs), ("B", theirs, mine)):
        only = [head for head in own if head not in other]
        if only:
            yield f"only in {name}: {', '.join(only)}"


def _compare_goals(a: Rollout, b: Rollout, tolerance: float) -> Iterator[str]:
    """Yield what differs of goals, if both files tell of goals."""
    if not (a.info and b.info):
        return
    if len(a.goals) != len(b.goals):
        yield f"{len(a.goals)} goals in A, {len(b.goals)} goals in B"
    pairs = zip(a.goals, b.goals, strict=False)
    for number, (first, second) in enumerate(pairs, start=1):
        for field in ("controller", "status", "error_code", "goal"):
            values = (getattr(first, field), getattr(second, field))
            if values[0] != values[1]:
                texts = (
                    "" if field == "goal" else f": {values[0]} in A, {values[1]} in B"
                )
                yield f"goal {number}: another {field}{texts}"
        times = (first.sent_at, second.sent_at)
        if abs(times[0] - times[1]) > tolerance:
            yield f"goal {number}: sent at {times[0]:g} s in A, at {times[1]:g} s in B"


def _compare_inputs(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    """Yield what differs of versions, files, options and motions."""
    if not (a and b):
        yield from (
            f"{name} doesn't tell what made it"
            for name, info in (("A", a), ("B", b))
            if not info
        )
        return
    mine, theirs = (dict(_flatten(info)) for info in (a, b))
    for place in dict.fromkeys((*mine, *theirs)):
        values = (mine.get(place, "nothing"), theirs.get(place, "nothing"))
        if values[0] != values[1]:
            is_hash = place.endswith("sha256")
            first, second = (str(v)[:12] if is_hash else str(v) for v in values)
            yield f"{place}: {first} in A, {second} in B"


def _flatten(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of plain data with their places; files are known by name."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _flatten(each, f"{place}.{key}" if place else str(key))
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for number, each in enumerate(value):
            name = each.get("file") or number
            yield from _flatten(each, f"{place}[{name}]")
    else:
        yield place, value
