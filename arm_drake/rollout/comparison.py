"""Differences of two rollouts, in numbers."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.importing import dataclass
from arm_drake.rollout.rollout import TIME, Rollout

# Times nearer to each other are the same [s]: logs have whole nanoseconds, or numbers
# that are rounded to these.
_SAME_TIME = 0.6e-9


@dataclass(frozen=True)
class ColumnDifference:
    """Difference of a quantity between two rollouts, in its unit."""

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

    # The largest difference as a part of how far all quantities of this unit range, or
    # the part of the rows that only one has, if that is more. What has another unit is
    # compared by it.
    relative: float


@dataclass(frozen=True)
class Comparison:
    """Differences between two rollouts, A and B."""

    columns: tuple[ColumnDifference, ...]

    # What differs besides, in words: rows, joints, effort limits, controllers' types,
    # goals, messages.
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
        """The columns that differ by more than the tolerance.

        First is what differs most for its unit.
        """
        columns = (
            column
            for column in self.columns
            if column.largest > self.tolerance or column.num_missing
        )
        return tuple(sorted(columns, key=lambda column: -column.relative))

    @property
    def is_equal(self) -> bool:
        """Whether they are equal within the tolerance."""
        return not self.different and not self.differences


def compare(a: Rollout, b: Rollout, tolerance: float = 0.0) -> Comparison:
    """Return where two rollouts differ.

    Rows are compared at the times of A that B has too; if it has none of them, B is
    interpolated where both were running. What differs by less than the tolerance, in
    the unit of each quantity, is equal.
    """
    mine, theirs = a.columns(), b.columns()
    differences = [*_compare_times(a.time, b.time)]
    for name, own, other in (("A", mine, theirs), ("B", theirs, mine)):
        if only := [head for head in own if head not in other]:
            differences.append(f"only in {name}: {', '.join(only)}")
    if a.info and b.info:  # A table knows nothing besides its rows.
        differences += [*_compare_parts(a, b), *_compare_sent(a, b, tolerance)]
    rows, others, is_interpolated = _common_rows(a.time, b.time, theirs)
    pairs = {
        name: (column[rows], others[name])
        for name, column in mine.items()
        if name in others and name != TIME
    }
    with np.errstate(over="ignore"):  # Squares of 1e300 are infinite, and told so.
        ranges = _find_ranges(pairs)
        columns = [
            _compare_column(name, a.time[rows], *pair, ranges[_unit(name)])
            for name, pair in pairs.items()
        ]
    if not len(rows) and (len(a.time) or len(b.time)):
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
    a: Array, b: Array, columns: Mapping[str, Array]
) -> tuple[NDArray[np.intp], dict[str, Array], bool]:
    """Return rows of A, the columns of B at their times, and whether in between."""
    if not len(a) or not len(b):
        return np.zeros(0, dtype=np.intp), dict.fromkeys(columns, np.zeros(0)), False
    after = np.minimum(np.searchsorted(b, a - _SAME_TIME), len(b) - 1)
    rows = np.flatnonzero(np.abs(b[after] - a) <= _SAME_TIME)
    if len(rows):
        return rows, {k: v[after[rows]] for k, v in columns.items()}, False
    rows = np.flatnonzero((a >= b[0]) & (a <= b[-1]))
    between = {k: np.interp(a[rows], b, v) for k, v in columns.items()}
    return rows, between, True


def _unit(name: str) -> str:
    """Return the unit of a column: what its name has in brackets."""
    return name.rpartition(" [")[2] if name.endswith("]") else ""


def _find_ranges(pairs: Mapping[str, tuple[Array, Array]]) -> dict[str, float]:
    """Return how far the columns of each unit range, whatever each is about."""
    # What has no unit, as parts of quaternions, ranges over about 1.
    ranges: dict[str, float] = {"": 1.0}
    for name, pair in pairs.items():
        values = np.concatenate(pair)
        values = values[np.isfinite(values)]
        extent = float(np.ptp(values)) if len(values) else 0.0
        ranges[_unit(name)] = max(ranges.get(_unit(name), 0.0), extent)
    return ranges


def _compare_column(
    name: str, time: Array, a: Array, b: Array, extent: float
) -> ColumnDifference:
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
    relative = largest / extent if extent > 0.0 else 0.0
    relative = max(relative, missing / max(1, len(a)))
    return ColumnDifference(name, largest, at, rms, final, missing, relative)


def _compare_times(a: Array, b: Array) -> Iterator[str]:
    """Yield what differs of the times of the rows."""
    for end, first, second in (("start", a[:1], b[:1]), ("end", a[-1:], b[-1:])):
        if len(first) != len(second) or (np.abs(first - second) > _SAME_TIME).any():
            texts = [f"{t[0]:.12g} s" if len(t) else "nowhere" for t in (first, second)]
            yield f"rows {end} at {texts[0]} in A, at {texts[1]} in B"
    if len(a) != len(b):
        yield f"{len(a)} rows in A, {len(b)} rows in B"


def _compare_parts(a: Rollout, b: Rollout) -> Iterator[str]:
    """Yield what differs of effort limits and controllers' types."""
    theirs = dict(zip(b.joint_names, b.effort_limit.tolist(), strict=True))
    for name, limit in zip(a.joint_names, a.effort_limit.tolist(), strict=True):
        if theirs.get(name, limit) != limit:
            yield f"{name}: effort limit {limit:g} in A, {theirs[name]:g} in B"
    for name, kind in a.controllers.items():
        if b.controllers.get(name, kind) != kind:
            yield f"controller {name}: {kind} in A, {b.controllers[name]} in B"


def _compare_sent(a: Rollout, b: Rollout, tolerance: float) -> Iterator[str]:
    """Yield what differs of goals and messages."""
    columns = ("controller", "status", "error_code", "goal")
    yield from _compare_records("goal", a.goals, b.goals, columns, "sent_at", tolerance)
    sent = ("topic", "type", "data")
    yield from _compare_records(
        "message", a.messages, b.messages, sent, "time", tolerance
    )


def _compare_records(
    what: str,
    a: Sequence[Any],
    b: Sequence[Any],
    fields: Sequence[str],
    time: str,
    tolerance: float,
) -> Iterator[str]:
    """Yield what differs of goals or of messages; of fields of data only that."""
    if len(a) != len(b):
        yield f"{len(a)} {what}s in A, {len(b)} {what}s in B"
    for number, (first, second) in enumerate(zip(a, b, strict=False), start=1):
        for field in fields:
            mine, theirs = getattr(first, field), getattr(second, field)
            if mine != theirs:
                is_data = isinstance(mine, Mapping)
                texts = "" if is_data else f": {mine} in A, {theirs} in B"
                yield f"{what} {number}: another {field}{texts}"
        mine, theirs = getattr(first, time), getattr(second, time)
        if abs(mine - theirs) > max(tolerance, _SAME_TIME):
            yield f"{what} {number}: sent at {mine:g} s in A, at {theirs:g} s in B"


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
        names: Counter[str] = Counter()
        for number, each in enumerate(value):
            name = str(each.get("file") or number)
            names[name] += 1
            if names[name] > 1:
                name = f"{name} ({names[name]})"
            yield from _flatten(each, f"{place}[{name}]")
    else:
        yield place, value
