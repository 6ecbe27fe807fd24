"""Base of the messages, times, headers and the state of joints, and checks of fields.

These messages are of `builtin_interfaces`, `std_msgs` and `sensor_msgs`. A controller
reads messages in its ticks and relies on their types. All that goes into a simulation
is checked where it is made, so that a slip is an error in the line that made it.
"""

import dataclasses as dc
import functools
import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Self, TypeVar

from arm_drake.importing import dataclass

# What `arm_drake.messages` has of it.
__all__ = [
    "NANOSECONDS",
    "Duration",
    "Header",
    "JointState",
    "Message",
    "Time",
    "TimeLike",
]

T = TypeVar("T")

_FLOAT = {float}
_STR = {str}

# What float() takes, but isn't a number.
_NO_NUMBERS = (bool, str, bytes, bytearray)


def to_floats(values: Any, field: str) -> tuple[float, ...]:
    """Return numbers as a tuple of floats; raise ValueError for anything else."""
    if type(values) is not tuple:
        values = _to_tuple(values, field, "numbers")
    if _FLOAT.issuperset(map(type, values)):
        numbers: tuple[float, ...] = values
        return numbers
    try:
        return tuple(map(_to_float, values))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field}: expected numbers, got {list(values)!r}") from None


def to_float(value: Any, field: str) -> float:
    """Return a number as a float; raise ValueError for anything else."""
    try:
        return _to_float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field}: expected a number, got {_show(value)}") from None


def take_numbers(message: object, *fields: str) -> None:
    """Make floats of the numbers in fields of a message."""
    # A Vector3 takes 0.6 us so, 1.0 where attributes are looked up one by one.
    values = message.__dict__
    for field in fields:
        if type(values[field]) is not float:
            values[field] = to_float(values[field], field)


def to_names(values: Any, field: str, *, noun: str = "names") -> tuple[str, ...]:
    """Return names as a tuple; raise ValueError for anything else, a string too."""
    if isinstance(values, str):
        raise ValueError(f"{field}: expected {noun}, got {values!r}")
    names = _to_tuple(values, field, noun)
    if _STR.issuperset(map(type, names)):
        return names
    if not all(isinstance(name, str) for name in names):
        raise ValueError(f"{field}: expected {noun}, got {list(names)!r}")
    return tuple(map(str, names))


def check_name(value: Any, field: str) -> None:
    """Raise ValueError if a value isn't a string."""
    if not isinstance(value, str):
        raise ValueError(f"{field}: expected a string, got {_show(value)}")


def check_type(
    value: Any, kind: type | tuple[type, ...], field: str, *, hint: str = ""
) -> None:
    """Raise ValueError, with a hint what else to do, if a value isn't of a kind."""
    if not isinstance(value, kind):
        more = f"; {hint}" if hint else ""
        kinds = kind if isinstance(kind, tuple) else (kind,)
        names = " or ".join(f"a {each.__name__}" for each in kinds)
        raise ValueError(f"{field}: expected {names}, got {_show(value)}{more}")


def to_message(value: Any, kind: type[T], field: str) -> T:
    """Return a message of a kind, made of a mapping of its fields if it is one.

    Raise ValueError if it is neither, or a field is not what it must be.
    """
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        check_type(value, kind, field, hint="or a mapping of its fields")
    names = [each.name for each in dc.fields(kind)]  # type: ignore[arg-type]
    unknown = [str(name) for name in value if name not in names]
    if unknown:
        raise ValueError(
            f"{field}: a {kind.__name__} has no field {', '.join(unknown)}; "
            f"it has {', '.join(names)}"
        )
    try:
        return kind(**value)
    except ValueError as error:
        raise ValueError(f"{field}.{error}") from None


def to_messages(values: Any, kind: type[T], field: str) -> tuple[T, ...]:
    """Return messages of a kind as a tuple; raise ValueError for anything else.

    One may be a mapping of its fields.
    """
    messages = _to_tuple(values, field, f"a sequence of {kind.__name__}")
    if {kind}.issuperset(map(type, messages)):
        return messages
    found = []
    for index, message in enumerate(messages):
        place = f"{field}[{index}]"
        if isinstance(message, Mapping):
            found.append(to_message(message, kind, place))
        else:
            check_type(message, kind, place)
            found.append(message)
    return tuple(found)


def _to_tuple(values: Any, field: str, noun: str) -> tuple[Any, ...]:
    if not isinstance(values, Iterable):
        raise ValueError(f"{field}: expected {noun}, got {_show(values)}")
    try:
        return tuple(values)
    except TypeError:
        # An array without dimensions has an iterator, and none that works.
        raise ValueError(f"{field}: expected {noun}, got {values!r}") from None


def _to_float(value: Any) -> float:
    if type(value) is float:
        return value
    # float() would take a vector of one element, too.
    if isinstance(value, _NO_NUMBERS) or getattr(value, "ndim", 0) > 0:
        raise TypeError
    return float(value)


def _show(value: Any) -> str:
    """Return a value as it is written; of a message, which may be long, its class."""
    return f"a {type(value).__name__}" if dc.is_dataclass(value) else repr(value)


NANOSECONDS = 1_000_000_000

# Range of builtin_interfaces: int32 sec, uint32 nanosec.
_SECONDS = range(-(2**31), 2**31)
_RANGES = {"sec": _SECONDS, "nanosec": range(2**32)}

# Range of our own sums and differences of times [ns], as in rcl: int64.
_INT64 = 2**63


class Message:
    """A message: immutable, so that a copy is the message itself."""

    # Its type in ROS, empty if it has none there; a class that derives from it, maybe
    # with more fields, has its own or none.
    _ros_type: ClassVar[str] = ""

    def __init_subclass__(cls, ros: str = "") -> None:
        """Take `ros`: its package in ROS, or its type if the names differ."""
        super().__init_subclass__()
        package, _, name = ros.partition("/")
        name = name or cls.__name__
        name = name if "/" in name else f"msg/{name}"
        cls._ros_type = f"{package}/{name}" if ros else ""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


def ros_type(kind: type[Message]) -> str | None:
    """Return the type of a message in ROS, None if it has none."""
    return kind._ros_type or None


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
        # Past the checks: it is done at every tick, and may be beyond ROS's range.
        # It takes 0.4 us so, 0.7 us with object.__setattr__, 1.3 us with the checks; a
        # tick of a joint_state_broadcaster with its `joint_states` takes 8 us.
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


@dataclass(frozen=True)
class Header(Message, ros="std_msgs"):
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
        """Return the header of a time [ns]; 0.9 us, where 1.6 us with the checks."""
        header = object.__new__(cls)
        fields = header.__dict__
        fields["stamp"], fields["frame_id"] = Time.from_nanoseconds(stamp_ns), frame_id
        return header


def stamp_of(message: Any) -> int:
    """Return when a message holds [ns]; 0 if it has no header."""
    header = getattr(message, "header", None)
    return header.stamp.to_nanoseconds() if header else 0


@dataclass(frozen=True)
class JointState(Message, ros="sensor_msgs"):
    """State of a set of joints, N of them (`sensor_msgs/JointState`)."""

    header: Header = Header()

    name: tuple[str, ...] = ()

    # [rad] or [m], shape (N,); NaN where a joint has no such interface.
    position: tuple[float, ...] = ()

    # [rad/s] or [m/s], shape (N,).
    velocity: tuple[float, ...] = ()

    # [N·m] or [N], shape (N,).
    effort: tuple[float, ...] = ()


M = TypeVar("M", bound=Message)

# Where such a message keeps what makes it, and what that made.
_MAKE, _MADE = "_make", "_made"


def make_lazy(kind: type[M], make: Callable[[], M]) -> M:
    """Return a message that is made when one of its fields is first read, once.

    It is one of its kind in all respects: it equals the message that is made, and
    `dataclasses.replace` and `pickle` make ordinary ones of it. A subscriber evaluates
    a topic at every tick and looks at few of its messages: a tick of a trajectory
    controller of six joints whose outputs are read takes 60 us, and 100 us if all
    messages are made (`python -m tests.benchmarks.ticks`, "looked at").
    """
    message: M = object.__new__(_lazy_class(kind))  # type: ignore[arg-type]
    message.__dict__[_MAKE] = make
    return message


@functools.cache
def _lazy_class(kind: type[M]) -> type[M]:
    names = [field.name for field in dc.fields(kind)]  # type: ignore[arg-type]
    attributes: dict[str, Any] = {name: _field(name) for name in names}
    # Dataclasses compare, show and copy messages by what they say their class is.
    attributes["__class__"] = property(lambda self: kind)
    attributes["__reduce__"] = lambda self: (
        kind,
        tuple(getattr(self, name) for name in names),
    )
    return type(kind.__name__, (kind,), attributes)


def _field(name: str) -> property:
    def get(self: Message) -> Any:
        kept = self.__dict__
        if _MADE not in kept:
            # Another thread may make the same meanwhile.
            make = kept.get(_MAKE)
            if make is not None:
                kept[_MADE] = make()
            # What it was made of may be large.
            kept.pop(_MAKE, None)
        return getattr(kept[_MADE], name)

    return property(get)


E = TypeVar("E")

# How many are kept; a Simulation looks every 50 ticks.
NUM_KEPT = 256


def make_unchecked(kind: type[T], **fields: Any) -> T:
    """Return a message of all its fields, past the checks of what a user gives.

    A point of six joints takes 0.45 us so, and 1.65 with them.
    """
    message = object.__new__(kind)
    message.__dict__.update(fields)
    return message


def renew(message: M) -> M:
    """Return another object with the same fields, which aren't checked once more."""
    kind = message.__class__
    # Else it is no message, is made lazily, or its fields are elsewhere.
    is_plain = issubclass(kind, Message) and not hasattr(kind, "__slots__")
    if is_plain and type(message) is kind:
        return make_unchecked(kind, **message.__dict__)
    return dc.replace(message)  # type: ignore[type-var]


def append_events(
    events: tuple[tuple[int, E], ...], new_events: Iterable[E]
) -> tuple[tuple[int, E], ...]:
    """Return the latest events, numbered one after the other, the newest last."""
    first = events[-1][0] + 1 if events else 0
    return (*events, *enumerate(new_events, start=first))[-NUM_KEPT:]
