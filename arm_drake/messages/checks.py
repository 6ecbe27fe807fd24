"""What the fields of messages must be, checked where a message is made.

A controller reads messages in its ticks and relies on their types. All that goes into a
simulation is checked, so that a slip is an error in the line that made it.
"""

import dataclasses as dc
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

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


def to_names(values: Any, field: str, *, noun: str = "names") -> tuple[str, ...]:
    """Return names as a tuple; raise ValueError for anything else, a string too.

    Args:
        values: The names.
        field: Field that they are for.
        noun: What they are, for the error.
    """
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
    """Raise ValueError if a value isn't of a kind.

    Args:
        value: The value.
        kind: Class of messages that it must be of, or several.
        field: Field that it is for.
        hint: What else to do, for the error.
    """
    if not isinstance(value, kind):
        more = f"; {hint}" if hint else ""
        kinds = kind if isinstance(kind, tuple) else (kind,)
        names = " or ".join(f"a {each.__name__}" for each in kinds)
        raise ValueError(f"{field}: expected {names}, got {_show(value)}{more}")


def to_message(value: Any, kind: type[T], field: str) -> T:
    """Return a message of a kind, made of a mapping of its fields if it is one.

    Args:
        value: The message, or its fields by name.
        kind: Its class.
        field: Field that it is for.

    Raises:
        ValueError: If it is neither, or a field is not what it must be.
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

    Args:
        values: The messages.
        kind: Their class.
        field: Field that they are for.
    """
    messages = _to_tuple(values, field, f"a sequence of {kind.__name__}")
    if not {kind}.issuperset(map(type, messages)):
        for index, message in enumerate(messages):
            check_type(message, kind, f"{field}[{index}]")
    return messages


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
