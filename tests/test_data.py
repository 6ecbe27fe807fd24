"""The reference cases that travel with the project: small, and none of our own."""

import functools
import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.oracle import SUBSET, oracle_folder

pytestmark = pytest.mark.slow

NAMES = sorted(path.name.partition(".json")[0] for path in SUBSET.iterdir())


def load_script() -> ModuleType:
    """Return the script that chose the cases; its folder is no package."""
    file = SUBSET.parent / "choose_cases.py"
    spec = importlib.util.spec_from_file_location("choose_cases", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SCRIPT = load_script()

# Unpacking takes longer than what is done with the cases.
SCRIPT.read = functools.cache(SCRIPT.read)


def source(name: str) -> Path:
    """Return the folder of all cases; skip unless its file is the one chosen from."""
    folder = oracle_folder()
    found = list(folder.glob(f"{name}.json*"))
    sources = json.loads(SCRIPT.SOURCES.read_text(encoding="utf-8"))
    if len(found) != 1 or SCRIPT.digest(folder, name) != sources[name]:
        pytest.skip(f"{folder} isn't where the cases of {name} were chosen from")
    return folder


def test_it_takes_less_than_a_megabyte() -> None:
    files = [path for path in SUBSET.parent.rglob("*") if path.is_file()]
    sizes = [path.stat().st_size for path in files if "__pycache__" not in path.parts]

    assert sum(sizes) <= 1_000_000


def test_every_file_that_is_replayed_is_there() -> None:
    jazzy = {f"{SCRIPT.JAZZY}_{kind}" for kind in ("differing", "identical")}

    assert set(NAMES) == {*SCRIPT.FILES, SCRIPT.JTC, *jazzy}
    assert all(len(SCRIPT.read(SUBSET, name)) > 0 for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_case_is_one_of_upstream_s(name: str) -> None:
    ours, theirs = SCRIPT.read(SUBSET, name), SCRIPT.read(source(name), name)

    if isinstance(ours, dict):
        (ours,), (theirs,) = ours.values(), theirs.values()
    texts = {json.dumps(case) for case in theirs}
    assert all(json.dumps(case) in texts for case in ours)


@pytest.mark.parametrize("name", sorted({*SCRIPT.FILES, SCRIPT.JTC}))
def test_every_feature_is_there(name: str) -> None:
    ours, theirs = SCRIPT.read(SUBSET, name), SCRIPT.read(source(name), name)

    def found(cases: Any) -> set[str]:
        return set().union(*map(SCRIPT.features_of, cases))

    assert found(ours) == found(theirs)


def test_both_distros_are_known_of_every_scenario() -> None:
    names = {case["input"]["name"] for case in SCRIPT.read(SUBSET, SCRIPT.JTC)}
    (same,) = SCRIPT.read(SUBSET, f"{SCRIPT.JAZZY}_identical").values()
    differing = SCRIPT.read(SUBSET, f"{SCRIPT.JAZZY}_differing")

    assert sorted([*same, *(case["name"] for case in differing)]) == sorted(names)


@pytest.mark.long
def test_choosing_again_chooses_the_same() -> None:
    (folder,) = {source(name) for name in NAMES}

    chosen = SCRIPT.choose(folder)

    assert sorted(chosen) == NAMES
    assert all(SCRIPT.read(SUBSET, name) == chosen[name] for name in NAMES)
