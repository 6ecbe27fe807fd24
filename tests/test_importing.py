"""Imports change how often Python looks for garbage, not what is garbage."""

import gc
import re
import subprocess
import sys
import weakref
from collections.abc import Iterator

import pytest

from arm_drake.importing import without_collection


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
