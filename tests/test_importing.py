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


@pytest.fixture(autouse=True, scope="module")
def frozen_tests() -> Iterator[None]:
    yield
    # As the other tests have it, see `tests/conftest.py`.
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def collection() -> Iterator[None]:
    gc.unfreeze()
    yield
    gc.unfreeze()
    gc.enable()


def test_no_garbage_is_looked_for_meanwhile() -> None:
    with without_collection():
        circles = [weakref.ref(Circle()) for _ in range(10 * gc.get_threshold()[0])]

        assert all(circle() is not None for circle in circles)


@pytest.mark.slow
def test_afterwards_it_is_found_like_any_other() -> None:
    before = weakref.ref(Circle())

    with without_collection():
        meanwhile = weakref.ref(Circle())

    assert gc.isenabled()
    gc.collect()
    assert before() is None
    assert meanwhile() is None


def test_it_is_looked_for_again_after_a_failure() -> None:
    with pytest.raises(ImportError), without_collection():
        raise ImportError

    assert gc.isenabled()


def test_who_has_turned_it_off_keeps_it_off() -> None:
    gc.disable()

    with without_collection():
        pass

    assert not gc.isenabled()


@pytest.mark.slow
def test_what_is_frozen_stays_frozen() -> None:
    gc.freeze()
    count = gc.get_freeze_count()

    with without_collection():
        pass

    assert count > 0
    # Some of it may have ended since, without a search.
    assert gc.get_freeze_count() == pytest.approx(count, rel=0.01)


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

    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )

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
