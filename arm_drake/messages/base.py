"""Times, headers and the state of joints (`builtin_interfaces`, `std_msgs`, ...)."""

import dataclasses as dc
import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Any, Self

NANOSECONDS = 1_000_000_000


def to_floats(values: Sequence[Any], field: str) -> tuple[float, ...]:
    """Return numbers as a tuple of floats; raise ValueError for anything else."""
    numbers = tuple(values)
    if all(type(number) is float for number in numbers):
        return numbers
    if any(isinstance(v, bool | str) for v in numbers):
        raise ValueError(f"{field}: expected numbers, got {list(numbers)!r}")
    return tuple(float(v) for v in numbers)


class Message:
    """A message: immutable, so that a copy is the message itself."""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


@dc.dataclass(frozen=True, order=True)
class Time(Message):
    """A point in time, or a duration: sec + nanosec, nanosec in [0, 1e9)."""

    # Whole seconds; negative before the origin.
    sec: int = 0

    # The rest [ns].
    nanosec: int = 0

    @classmethod
    def of(cls, value: "TimeLike") -> Self:
        """Return the time that a number of seconds, a mapping or a Time stands for.

        Raises:
            ValueError: If the value isn't a finite time.
        """
        if type(value) is cls:
            return value
        if isinstance(value, Time):
            return cls(value.sec, value.nanosec)
        if isinstance(value, Mapping):
            unknown = set(value) - {"sec", "nanosec"}
            parts = [value.get("sec", 0), value.get("nanosec", 0)]
            if unknown or any(type(part) is not int for part in parts):
                raise ValueError(
                    "expected seconds or {sec: int, nanosec: int}, "
                    f"got {dict(value)!r}"
                )
            return cls.from_nanoseconds(parts[0] * NANOSECONDS + parts[1])
        is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise ValueError(
                f"expected seconds or {{sec: int, nanosec: int}}, got {value!r}"
            )
        return cls.from_nanoseconds(round(float(value) * NANOSECONDS))

    @classmethod
    def from_nanoseconds(cls, nanoseconds: int) -> Self:
        """Return the time of this many nanoseconds."""
        return cls(*divmod(nanoseconds, NANOSECONDS))

    def to_nanoseconds(self) -> int:
        """Return the time in nanoseconds."""
        return self.sec * NANOSECONDS + self.nanosec

    def to_seconds(self) -> float:
        """Return the time in seconds."""
        return self.to_nanoseconds() / NANOSECONDS


class Duration(Time):
    """A length of time."""


TimeLike = Time | float | Mapping[str, int]


@dc.dataclass(frozen=True)
class Header(Message):
    """When and in which frame a message holds."""

    # Time of validity; 0 means "now" where a command is concerned.
    stamp: Time = Time()

    frame_id: str = ""


@dc.dataclass(frozen=True)
class JointState(Message):
    """State of a set of joints, N of them (`sensor_msgs/JointState`)."""

    header: Header = Header()

    name: tuple[str, ...] = ()

    # [rad] or [m], shape (N,); NaN where a joint has no such interface.
    position: tuple[float, ...] = ()

    # [rad/s] or [m/s], shape (N,).
    velocity: tuple[float, ...] = ()

    # [N·m] or [N], shape (N,).
    effort: tuple[float, ...] = ()
