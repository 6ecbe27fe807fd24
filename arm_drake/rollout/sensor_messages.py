"""Messages of cameras and lidars, as plain data for files of rollouts."""

import dataclasses as dc
import functools
import typing
from collections.abc import Iterable, Mapping
from typing import Any, Final

from arm_drake import messages
from arm_drake.messages import Message
from arm_drake.messages.base import ros_type

# Classes of messages that cameras and lidars have.
_CLASSES: Final = (
    messages.CameraInfo,
    messages.CompressedImage,
    messages.Image,
    messages.LaserScan,
    messages.PointCloud,
    messages.PointCloud2,
    messages.Range,
)

# These by their types in ROS.
SENSOR_TYPES: Final[Mapping[str, type[Message]]] = {
    str(ros_type(kind)): kind for kind in _CLASSES
}


def to_fields(message: Any) -> dict[str, Any]:
    """Return the fields of a message; those that are messages as fields, too."""
    return {
        field.name: _to_field(getattr(message, field.name))
        for field in dc.fields(message)
    }


def _to_field(value: Any) -> Any:
    if isinstance(value, Message):
        return to_fields(value)
    if isinstance(value, tuple) and value and isinstance(value[0], Message):
        return [to_fields(each) for each in value]
    return value


def make_message(kind: Any, fields: Any) -> Any:
    """Return a message of its fields, a mapping's or an object's."""
    is_mapping = isinstance(fields, Mapping)
    return kind(
        **{
            name: _make_value(
                hint, fields[name] if is_mapping else getattr(fields, name)
            )
            for name, hint in _hints(kind).items()
        }
    )


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    """Return the types of a message's fields."""
    hints = typing.get_type_hints(kind)
    return {field.name: hints[field.name] for field in dc.fields(kind)}


def _make_value(hint: Any, value: Any) -> Any:
    if dc.is_dataclass(hint):
        return make_message(typing.cast(type, hint), value)
    if typing.get_origin(hint) is tuple:
        kind, items = typing.get_args(hint)[0], typing.cast(Iterable[Any], value)
        return tuple(_make_value(kind, item) for item in items)
    return hint(value)
