"""Times, headers and the state of joints (`builtin_interfaces`, `std_msgs`, ...)."""

import dataclasses as dc
import math
import numbers
from collections.abc import Mapping
from typing import Any, Self

from arm_drake.messages.checks import check_name

NANOSECONDS = 1_000_000_000

# Range of builtin_interfaces: int32 sec, uint32 nanosec.
_SECONDS = range(-(2**31), 2**31)
_RANGES = {"sec": _SECONDS, "nanosec": range(2**32)}

# Range of our own sums and differences of times [ns], as in rcl: int64.
_INT64 = 2**63


class Message:
    """A message: immutable, so that a copy is the message itself."""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


@dc.dataclass(frozen=True, order=True)
class Time(Message):
    """A point in time, or a duration: sec + nanosec, in the range of ROS."""

    # Whole seconds, int32; negative before the origin.
    sec: int = 0

    # The rest [ns], uint32; in [0, 1e9) but for those who write more themselves.
    nanosec: int = 0

    def __post_init__(self) -> None:
        """Refuse what the message of ROS can't hold."""
        for field, limits in _RANGES.items():
            value = getattr(self, field)
            if type(value) is not int:
                value = _to_int(value, field)
                object.__setattr__(self, field, value)
            if value not in limits:
                raise ValueError(
                    f"{field}: expected an integer from {limits.start} to "
                    f"{limits.stop - 1}, got {value!r}"
                )

    @classmethod
    def of(cls, value: "TimeLike") -> Self:
        """Return the time that a number of seconds, a mapping or a Time stands for.

        Raises:
            ValueError: If the value isn't a time, or none that ROS can hold.
        """
        if type(value) is cls:
            return value
        if isinstance(value, Time):
            return cls.from_nanoseconds(value.to_nanoseconds())
        if isinstance(value, Mapping):
            parts = dict(value)
            if parts.keys() - _RANGES or any(
                type(part) is not int for part in parts.values()
            ):
                raise _no_time(parts)
            return cls.from_nanoseconds(Time(**parts).to_nanoseconds())
        is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
        # Not `isfinite`, which refuses integers beyond all floats.
        if not is_number or value != value or value in (math.inf, -math.inf):
            raise _no_time(value)
        if not _SECONDS.start <= value < _SECONDS.stop:
            raise ValueError(
                f"expected {_SECONDS.start} s to {_SECONDS.stop - 1} s, got {value!r}"
            )
        return cls.from_nanoseconds(round(float(value) * NANOSECONDS))

    @classmethod
    def from_nanoseconds(cls, nanoseconds: int) -> Self:
        """Return the time of this many nanoseconds.

        It may be beyond the range of ROS, as the sum of two times can be.

        Raises:
            ValueError: If it isn't an integer of 64 bits.
        """
        if type(nanoseconds) is not int:
            nanoseconds = _to_int(nanoseconds, "nanoseconds")
        if not -_INT64 <= nanoseconds < _INT64:
            raise ValueError(
                f"nanoseconds: expected an integer of 64 bits, got {nanoseconds!r}"
            )
        # Past the checks, for this is done at every tick.
        time = object.__new__(cls)
        fields = time.__dict__
        fields["sec"], fields["nanosec"] = divmod(nanoseconds, NANOSECONDS)
        return time

    def to_nanoseconds(self) -> int:
        """Return the time in nanoseconds."""
        return self.sec * NANOSECONDS + self.nanosec

    def to_seconds(self) -> float:
        """Return the time in seconds."""
        return self.to_nanoseconds() / NANOSECONDS


class Duration(Time):
    """A length of time."""


TimeLike = Time | float | Mapping[str, int]


def to_duration(value: Any, field: str) -> Duration:
    """Return a duration; raise ValueError with the field's name for anything else."""
    if type(value) is Duration:
        return value
    try:
        return Duration.of(value)
    except ValueError as error:
        raise ValueError(f"{field}: {error}") from None


def _to_int(value: Any, field: str) -> int:
    """Return an integer of any type as an int; raise ValueError for anything else."""
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        raise ValueError(f"{field}: expected an integer, got {value!r}")
    return int(value)


def _no_time(value: Any) -> ValueError:
    return ValueError(f"expected seconds or {{sec: int, nanosec: int}}, got {value!r}")


@dc.dataclass(frozen=True)
class Header(Message):
    """When and in which frame a message holds."""

    # Time of validity, seconds are accepted; 0 means "now" where a command is
    # concerned.
    stamp: Time = Time()

    frame_id: str = ""

    def __post_init__(self) -> None:
        """Take seconds as they come."""
        if type(self.stamp) is not Time:
            try:
                object.__setattr__(self, "stamp", Time.of(self.stamp))
            except ValueError as error:
                raise ValueError(f"stamp: {error}") from None
        check_name(self.frame_id, "frame_id")

    @classmethod
    def from_nanoseconds(cls, stamp_ns: int, frame_id: str = "") -> Self:
        """Return the header of a time [ns]; quick, for messages of every tick."""
        header = object.__new__(cls)
        fields = header.__dict__
        fields["stamp"], fields["frame_id"] = Time.from_nanoseconds(stamp_ns), frame_id
        return header


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
