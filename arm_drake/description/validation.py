"""Checks that many parameter dataclasses share, as upstream's parameter library has."""

import math
from typing import Any

# Longer than any duration in ROS, which counts 64 bit nanoseconds [s].
_LONGEST = 2.0**63 / 1e9


def check_finite(owner: Any, *names: str) -> None:
    """Raise ValueError for a number that isn't finite."""
    for name in names:
        value = getattr(owner, name)
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, got {value}")


def check_at_least(owner: Any, low: float, *names: str) -> None:
    """Raise ValueError for a number that isn't finite and at least ``low``."""
    for name in names:
        value = getattr(owner, name)
        if not low <= value < math.inf:
            raise ValueError(f"{name} must be at least {low:g}, got {value}")


def check_above(owner: Any, low: float, *names: str) -> None:
    """Raise ValueError for a number that isn't finite and above ``low``."""
    for name in names:
        value = getattr(owner, name)
        if not low < value < math.inf:
            raise ValueError(f"{name} must be above {low:g}, got {value}")


def check_not_zero(owner: Any, *names: str) -> None:
    """Raise ValueError for a number that is 0 or isn't finite."""
    for name in names:
        value = getattr(owner, name)
        if not math.isfinite(value) or value == 0.0:
            raise ValueError(f"{name} must be a finite number and not 0, got {value}")


def check_duration(owner: Any, *names: str) -> None:
    """Raise ValueError for a duration [s] that doesn't fit in 64 bit nanoseconds."""
    for name in names:
        value = getattr(owner, name)
        if not abs(value) < _LONGEST:
            raise ValueError(f"{name} must be a number of seconds, got {value}")


def check_within(owner: Any, low: float, high: float, *names: str) -> None:
    """Raise ValueError for a number, or an element of a list, out of bounds."""
    for name in names:
        value = getattr(owner, name)
        for number in value if isinstance(value, tuple) else (value,):
            if not low <= number <= high:
                raise ValueError(f"{name} must be in [{low:g}, {high:g}], got {number}")


def check_not_empty(owner: Any, *names: str) -> None:
    """Raise ValueError for an empty string or list."""
    for name in names:
        value = getattr(owner, name)
        if value == ():
            raise ValueError(f"{name} must have at least one element")
        if value == "":
            raise ValueError(f"{name} must not be empty, got ''")


def check_unique(owner: Any, *names: str) -> None:
    """Raise ValueError for a list that has an element twice."""
    for name in names:
        values = getattr(owner, name)
        if len(set(values)) != len(values):
            raise ValueError(f"{name} must not repeat elements, got {list(values)}")


def check_length(owner: Any, length: int, *names: str) -> None:
    """Raise ValueError for a list that doesn't have ``length`` elements."""
    for name in names:
        values = getattr(owner, name)
        if len(values) != length:
            raise ValueError(
                f"{name} must have {length} elements, got {len(values)}: {list(values)}"
            )
