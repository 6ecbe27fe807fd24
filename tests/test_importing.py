"""Quick imports change neither what is garbage nor what a dataclass is."""

import copy
import dataclasses as dc
import gc
import inspect
import pickle
import re
import subprocess
import sys
import weakref
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import pytest

from arm_drake.importing import dataclass, without_collection


class Circle:
    """Refers to itself."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture(autouse=True)
def collection() -> Iterator[None]:
    yield
    gc.enable()


def run(program: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a Python of its own, in which nothing is frozen."""
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )


def test_no_garbage_is_looked_for_meanwhile() -> None:
    with without_collection():
        circles = [weakref.ref(Circle()) for _ in range(10 * gc.get_threshold()[0])]

        assert all(circle() is not None for circle in circles)


def test_afterwards_it_is_found_like_any_other() -> None:
    program = """
import gc, weakref
from arm_drake.importing import without_collection
class Circle:
    def __init__(self):
        self.itself = self
before = weakref.ref(Circle())
with without_collection():
    meanwhile = [weakref.ref(Circle()) for _ in range(2 * gc.get_threshold()[0])]
print(gc.isenabled(), gc.get_freeze_count(), before() is None)
gc.collect()
print(before(), {circle() for circle in meanwhile})
"""

    assert run(program).stdout == "True 0 False\nNone {None}\n"


def test_afterwards_what_is_new_counts_as_old() -> None:
    program = """
import gc
from arm_drake.importing import without_collection
with without_collection():
    new = [[] for _ in range(2 * gc.get_threshold()[0])]
young, middle, old = (len(gc.get_objects(generation)) for generation in range(3))
print(young + middle < len(new) <= old)
"""

    assert run(program).stdout == "True\n"


def test_it_is_looked_for_again_after_a_failure() -> None:
    with pytest.raises(ImportError), without_collection():
        raise ImportError

    assert gc.isenabled()


def test_who_has_turned_it_off_keeps_it_off() -> None:
    gc.disable()

    with without_collection():
        pass

    assert not gc.isenabled()


def test_what_is_frozen_stays_frozen() -> None:
    program = """
import gc
from arm_drake.importing import without_collection
gc.freeze()
count = gc.get_freeze_count()
with without_collection():
    new = [[] for _ in range(2 * gc.get_threshold()[0])]
print(count > 1000, gc.get_freeze_count() > 0.99 * count)
"""

    assert run(program).stdout == "True True\n"


def test_what_is_frozen_is_not_counted_where_nothing_is_new(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gc, "get_freeze_count", lambda: pytest.fail("counted"))
    gc.collect(0)

    with without_collection():
        pass


@pytest.mark.slow
def test_public_names_are_imported_when_they_are_used() -> None:
    program = """
import sys
import arm_drake
ours = {name for name in sys.modules if name.startswith("arm_drake")}
print(*sorted(ours))
print(arm_drake.__all__ == dir(arm_drake), "load_robot" in dir(arm_drake))
from arm_drake import *
print(load_robot is arm_drake.load_robot, Header.__module__)
from arm_drake import anything
"""

    done = run(program)

    assert done.stdout == (
        "arm_drake arm_drake.importing\nTrue True\nTrue arm_drake.messages.base\n"
    )
    assert "ImportError: cannot import name 'anything'" in done.stderr


def test_a_command_line_is_read_without_numpy() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "arm_drake", "sim", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )

    assert "arm_drake.commands.arguments" in done.stderr
    assert not re.search(r"\bnumpy\b", done.stderr)


def plain(make: Any) -> type:
    @make(frozen=True)
    class Plain:
        """Its text."""

        kind: ClassVar[str] = "plain"
        a: int
        b: float = 2.0
        c: tuple[str, ...] = dc.field(default_factory=lambda: ("x",))
        d: str = dc.field(default="d", repr=False, compare=False)
        e: int = dc.field(default=5, kw_only=True)
        f: int = dc.field(init=False, default=7)
        g: list[int] = dc.field(init=False, default_factory=list, hash=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "b", float(self.b))

    return Plain


def keywords(make: Any) -> type:
    @make(frozen=True, kw_only=True)
    class Keywords:
        a: int
        b: object = None

    return Keywords


def by_identity(make: Any) -> type:
    @make(frozen=True, eq=False, repr=False)
    class ByIdentity:
        a: int = 1

    return ByIdentity


def empty(make: Any) -> type:
    @make(frozen=True)
    class Empty:
        pass

    return Empty


def of_its_own(make: Any) -> type:
    @make(frozen=True)
    class OfItsOwn:
        a: object = 1

        def __init__(self, twice: Any) -> None:
            object.__setattr__(self, "a", 2 * twice)

        def __repr__(self) -> str:
            return "its own"

        def __hash__(self) -> int:
            return 3

    return OfItsOwn


def equal_in_its_own_way(make: Any) -> type:
    @make(frozen=True)
    class Equal:
        a: int
        b: int = 0

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Equal) and self.a == other.a

    return Equal


def without_hash(make: Any) -> type:
    @make(frozen=True)
    class WithoutHash:
        a: object = 1
        __hash__ = None  # type: ignore[assignment]

    return WithoutHash


def of_odd_names(make: Any) -> type:
    @make(frozen=True)
    class OfOddNames:
        a: list[object] = dc.field(default_factory=list)
        b: int = 1
        self: int = 2
        cls: int = 3
        _set: int = 4
        _make_a: int = 5
        __set: int = 6

        def __post_init__(self) -> None:
            object.__setattr__(self, "b", 2 * self.b)

    return OfOddNames


def derived(make: Any) -> type:
    @make(frozen=True)
    class Derived(plain(make)):  # type: ignore[misc]
        b: float = 4.0
        h: int = 8

    return Derived


def derived_by_the_standard_library(make: Any) -> type:
    @dc.dataclass(frozen=True)
    class Derived(plain(make)):  # type: ignore[misc]
        h: int = 8

    return Derived


CLASSES = [
    plain,
    keywords,
    by_identity,
    empty,
    of_its_own,
    equal_in_its_own_way,
    without_hash,
    of_odd_names,
    derived,
    derived_by_the_standard_library,
]


def outcome(do: Callable[[], object]) -> object:
    try:
        return do()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


@pytest.mark.parametrize("define", CLASSES)
def test_a_dataclass_is_as_the_standard_library_s(
    define: Callable[[Any], type],
) -> None:
    def told(make: Any) -> list[object]:
        cls: Any = define(make)
        lines: list[object] = [
            str(inspect.signature(cls)),
            cls.__init__.__annotations__,
            cls.__dataclass_params__.__repr__(),
            cls.__match_args__,
            [(f.name, f.type, f.init, f.kw_only) for f in dc.fields(cls)],
        ]
        for method in ("__init__", "__repr__", "__eq__", "__hash__", "__setattr__"):
            names = ("__module__", "__qualname__")
            lines += [getattr(getattr(cls, method), n, None) for n in names]
        for given in [(), (1,), (1, 3), (1, 3, ("y",), "other"), (1, 2, 3, 4, 5, 6, 7)]:
            for named in [{}, {"a": 9}, {"e": 6}, {"a": 1, "b": 3}, {"z": 0}]:
                lines.append(outcome(lambda g=given, n=named: vars(cls(*g, **n))))
                item = outcome(lambda g=given, n=named: cls(*g, **n))
                if not isinstance(item, cls):
                    continue
                if cls.__repr__ is not object.__repr__:
                    lines.append(repr(item))
                if cls.__hash__ is not object.__hash__:
                    lines.append(outcome(lambda i=item: hash(i)))
                same, other = copy.copy(item), outcome(lambda: cls(a=2))
                lines += [item == same, item == other, item == 1, item.__eq__(1)]
                lines.append(outcome(lambda i=item: vars(dc.replace(i, a=8))))
                for name in ("a", "other"):
                    lines.append(outcome(lambda i=item, n=name: setattr(i, n, 1)))
                    lines.append(outcome(lambda i=item, n=name: delattr(i, n)))
        return lines

    assert told(dataclass) == told(dc.dataclass)


def test_what_is_no_dataclass_may_add_to_one() -> None:
    class More(plain(dataclass)):  # type: ignore[misc]
        pass

    more = More(1)
    more.other = 2

    assert more.other == 2
    with pytest.raises(dc.FrozenInstanceError, match="field 'a'"):
        more.a = 2


def test_a_dataclass_that_holds_itself_is_told() -> None:
    cls: Any = keywords(dataclass)
    held: list[object] = []
    item = cls(a=1, b=held)
    held.append(item)

    assert repr(item).endswith(".Keywords(a=1, b=[...])")


@dataclass(frozen=True)
class Point:
    """At the top of a module, where pickle finds it."""

    x: float
    y: float = 0.0


def test_a_dataclass_is_sent_to_other_processes() -> None:
    sent = pickle.dumps(Point(1.0))

    assert pickle.loads(sent) == Point(1.0)  # noqa: S301
