"""Messages, and whatever else is recorded, as plain data."""

import dataclasses as dc
import enum
import math
from collections.abc import Mapping
from typing import Any

# Plain data: what JSON can hold.
Plain = Any


def to_plain(value: Any) -> Plain:
    """Return a message, or part of one, as data that JSON can hold.

    Numbers beyond all limits become the texts that `float` reads.

    Args:
        value: A dataclass, a sequence, a mapping, a path or a plain value.
    """
    if dc.is_dataclass(value) and not isinstance(value, type):
        fields = (field.name for field in dc.fields(value))
        return {name: to_plain(getattr(value, name)) for name in fields}
    if isinstance(value, enum.Enum):
        return to_plain(value.value)
    if isinstance(value, Mapping):
        return {str(key): to_plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [to_plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)
