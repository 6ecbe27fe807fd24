"""Quick imports: without the garbage collector, with dataclasses of shared methods."""

import contextlib
import dataclasses as dc
import gc
from collections.abc import Callable, Iterator
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Let Python look for no garbage meanwhile, nor at once afterwards.

    It would look through all that is new after every 700 objects, and twice more before
    it takes it for old. `arm-drake sim doosan_a0912 --headless --duration 0.05` takes
    0.9 s of processor time, and 0.09 s more with the collector on; if what is new were
    not made old at the end, 0.07 s of these would come back. (`gc.callbacks` timed.)

    Where all was imported before, nothing is done: to count a million
    frozen objects takes Python 10 ms and more.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            is_much = gc.get_count()[0] > gc.get_threshold()[0]
            # Nobody else has frozen anything.
            if is_much and not gc.get_freeze_count():
                # Together they make all objects old, without looking at any of them.
                gc.freeze()
                gc.unfreeze()
            gc.enable()


def _frozen_dataclass(
    cls: type,
    /,
    *,
    init: bool = True,
    repr: bool = True,
    eq: bool = True,
    kw_only: bool = False,
) -> type:
    """Make a frozen dataclass, of whose methods only `__init__` is compiled, later."""
    # One that derives from another must be made frozen: two methods more.
    derives = any(map(dc.is_dataclass, cls.__mro__[1:]))
    dc.dataclass(init=False, repr=False, eq=False, kw_only=kw_only, frozen=derives)(cls)
    # So that others can derive from it by the standard library's decorator, too.
    params: Any = cls.__dataclass_params__  # type: ignore[attr-defined]
    params.init, params.repr, params.eq, params.frozen = init, repr, eq, True
    fields, methods = dc.fields(cls), dict[str, Any]()
    if init and "__init__" not in vars(cls):
        cls.__init__ = _LaterInit(cls, fields)  # type: ignore[misc]
    if repr:
        methods["__repr__"] = _repr(fields)
    if eq:
        methods["__eq__"], methods["__hash__"] = _eq_and_hash(fields)
    if not derives:
        methods["__setattr__"], methods["__delattr__"] = _refusals(cls, fields)
    own = set(vars(cls))
    # Python's, where a class says what equals it.
    if "__eq__" in own and cls.__hash__ is None:
        own.remove("__hash__")
    for name, method in methods.items():
        if name not in own:
            method.__module__ = cls.__module__
            method.__qualname__ = f"{cls.__qualname__}.{name}"
            setattr(cls, name, method)
    return cls


class _Factory:
    """Placeholder of a value that is made anew for each object."""

    def __repr__(self) -> str:
        return "<factory>"


_FACTORY = _Factory()


class _LaterInit:
    """An `__init__` that is compiled when it is first asked for."""

    def __init__(self, cls: type, fields: tuple[dc.Field[Any], ...]) -> None:
        self._cls, self._fields = cls, fields

    def __get__(self, instance: Any, owner: type) -> Any:
        init = _init(self._cls, self._fields)
        init.__module__ = self._cls.__module__
        init.__qualname__ = f"{self._cls.__qualname__}.__init__"
        # Another thread may have done it.
        if vars(self._cls)["__init__"] is self:
            self._cls.__init__ = init
        return init if instance is None else init.__get__(instance, owner)


def _init(cls: type, fields: tuple[dc.Field[Any], ...]) -> Callable[..., None]:
    """Return the `__init__` of a dataclass."""
    # No field has a name with two underscores in front: Python adds that of the class.
    known: dict[str, Any] = {"__set": object.__setattr__, "__factory": _FACTORY}
    positional, keywords = list[str](), list[str]()
    lines = []
    self = "__self" if any(field.name == "self" for field in fields) else "self"
    for field in fields:
        name, value, default = field.name, field.name, ""
        if field.default_factory is not dc.MISSING:
            known[f"__make_{name}"] = field.default_factory
            value, default = f"__make_{name}()", "=__factory"
            if field.init:
                value += f" if {name} is __factory else {name}"
        elif field.default is not dc.MISSING:
            known[f"__default_{name}"], default = field.default, f"=__default_{name}"
        if field.init:
            (keywords if field.kw_only else positional).append(name + default)
        if field.init or field.default_factory is not dc.MISSING:
            lines.append(f" __set({self}, {name!r}, {value})")
    if hasattr(cls, "__post_init__"):
        lines.append(f" {self}.__post_init__()")
    head = ", ".join([self, *positional, *(["*", *keywords] if keywords else [])])
    # As the standard library does; of a class there are names of fields alone in it.
    exec("\n".join([f"def __init__({head}):", *lines, " return None"]), known)  # noqa: S102
    init: Callable[..., None] = known["__init__"]
    types = {field.name: field.type for field in fields if field.init}
    init.__annotations__ = {**types, "return": None}
    return init


def _repr(fields: tuple[dc.Field[Any], ...]) -> Callable[[Any], str]:
    shown = [field for field in fields if field.repr]
    values = _getter(shown)
    form = ", ".join(f"{field.name}=%r" for field in shown)

    @recursive_repr()
    def __repr__(self: Any) -> str:
        return f"{self.__class__.__qualname__}({form % values(self)})"

    return __repr__


def _eq_and_hash(
    fields: tuple[dc.Field[Any], ...],
) -> tuple[Callable[[Any, object], bool], Callable[[Any], int]]:
    compared = [field for field in fields if field.compare]
    values = _getter(compared)
    hashed = _getter(
        [
            field
            for field in fields
            if (field.compare if field.hash is None else field.hash)
        ]
    )

    def __eq__(self: Any, other: object) -> bool:
        if other.__class__ is self.__class__:
            return bool(values(self) == values(other))
        return NotImplemented

    def __hash__(self: Any) -> int:
        return hash(hashed(self))

    return __eq__, __hash__


def _getter(fields: list[dc.Field[Any]]) -> Callable[[Any], tuple[Any, ...]]:
    """Return what gives the values of fields, as a tuple."""
    names = [field.name for field in fields]
    if len(names) > 1:
        return attrgetter(*names)
    if not names:
        return lambda _: ()
    value = attrgetter(*names)
    return lambda item: (value(item),)


def _refusals(
    cls: Any, fields: tuple[dc.Field[Any], ...]
) -> tuple[Callable[[Any, str, Any], None], Callable[[Any, str], None]]:
    """Return the `__setattr__` and `__delattr__` of a frozen dataclass."""
    names = frozenset(field.name for field in fields)

    def __setattr__(self: Any, name: str, value: Any) -> None:
        if type(self) is cls or name in names:
            raise dc.FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: Any, name: str) -> None:
        if type(self) is cls or name in names:
            raise dc.FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    return __setattr__, __delattr__


if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(*, frozen: bool, **options: bool) -> Callable[[type], type]:
        """As `dataclasses.dataclass`, for frozen classes without InitVars.

        The standard library compiles six methods for each class, here it is `__init__`
        alone, where it is used: 230 classes that are imported until a first step took
        90 ms, and now take 20.
        """
        assert frozen
        return lambda cls: _frozen_dataclass(cls, **options)
