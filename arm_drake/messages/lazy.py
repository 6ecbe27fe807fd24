"""Messages that are made when someone looks at them, for most of them nobody does."""

import dataclasses as dc
import functools
from collections.abc import Callable
from typing import Any, TypeVar

from arm_drake.messages.base import Message

M = TypeVar("M", bound=Message)

# Where such a message keeps what makes it, and what that made.
_MAKE, _MADE = "_make", "_made"


def make_lazy(kind: type[M], make: Callable[[], M]) -> M:
    """Return a message that is made when one of its fields is asked for, once.

    It is one of its kind in all respects: it equals the message that is made, and
    `dataclasses.replace` and `pickle` make ordinary ones of it.

    Args:
        kind: Class of the message, a frozen dataclass.
        make: Makes it, of what doesn't change.
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
            kept[_MADE] = kept[_MAKE]()
            # What it was made of may be large.
            del kept[_MAKE]
        return getattr(kept[_MADE], name)

    return property(get)
