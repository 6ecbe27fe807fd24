"""Fixtures and options of all tests."""

import contextlib
import gc
import json
import os
import signal
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from arm_drake.description import packages, xacro
from arm_drake.description.entry import models_folder
from tests.robots import BESIDE_THE_CHECKOUT

_HERE = Path(__file__).parent

# With `--both-ways`, what the managers of all tests count.
_COUNT = pytest.StashKey[Any]()

# So many of their cycles are steady, or the option has shown too little.
_LEAST_SHARE = 0.5

# Replays of reference data and of whole motions: not for every few minutes.
_SLOW = ("conformance", "physics", "rollouts")


def pytest_addoption(parser: pytest.Parser) -> None:
    # In one process: others wouldn't say how many cycles were steady.
    text = (
        "compute each cycle in which nothing comes in full, too, and compare all bits"
    )
    parser.addoption("--both-ways", action="store_true", help=text)


def pytest_configure(config: pytest.Config) -> None:
    if config.option.both_ways:
        from tests.manager import both_ways

        both_ways.compare(
            config.stash.setdefault(_COUNT, both_ways.Count()), pytest.MonkeyPatch()
        )
    # Where a shell has started the tests in the background they would ignore Ctrl-C,
    # and with them all processes that they start and interrupt.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Of the tests that are collected none goes again, and to look for garbage among
    # 15,000 of them takes half of the collection's time.
    gc.disable()


@pytest.fixture(scope="session", autouse=True)
def tests_that_find_no_packages_of_others(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[None]:
    # Of each test's own folder those of others are siblings, with robots of the same
    # names.
    real, folder = packages.shared_folders, tmp_path_factory.getbasetemp().resolve()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packages, "shared_folders", lambda: (*real(), folder))
        yield


class _Asked:
    """Finds packages, and remembers which were asked for and where they are."""

    def __init__(self, finder: packages.PackageFinder) -> None:
        self._finder = finder
        self.folders: dict[str, Path] = {}

    def find(self, name: str) -> Path:
        self.folders[name] = self._finder.find(name)
        return self.folders[name]


@pytest.fixture(scope="session", autouse=True)
def real_robots_that_are_expanded_once() -> Iterator[None]:
    # Most tests load one of these, whose files stay as they are, and xacro's process
    # takes three times what the rest of the loading does. What reads any other file,
    # or is for another environment, is expanded each time.
    still = (
        models_folder().resolve(),
        BESIDE_THE_CHECKOUT.resolve(),
        BESIDE_THE_CHECKOUT.with_name("launch").resolve(),
    )
    expand = xacro._run
    answers: dict[str, tuple[str, dict[str, Path]]] = {}

    def expand_once(
        path: Path, args: Mapping[str, str], finder: packages.PackageFinder
    ) -> Any:
        surroundings = {k: v for k, v in os.environ.items() if "PYTEST" not in k}
        key = str([path, Path.cwd(), sorted(args.items()), surroundings])
        if key in answers:
            text, folders = answers[key]
            if all(finder.find(name) == folder for name, folder in folders.items()):
                return json.loads(text)
        asked = _Asked(finder)
        answer = expand(path, args, asked)  # type: ignore[arg-type]
        read = [path.resolve(), *(Path(f).resolve() for f in answer["opened"])]
        is_still = all(any(map(file.is_relative_to, still)) for file in read)
        if is_still and "error" not in answer:
            answers[key] = json.dumps(answer), asked.folders
        return answer

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(xacro, "_run", expand_once)
        patch.setattr(xacro, "expanding_ahead", lambda *_: contextlib.nullcontext())
        yield


@pytest.fixture(scope="module", autouse=True)
def files_that_look_for_no_garbage_of_others() -> None:
    # Some keep a million objects, as the data of upstream that they replay, among which
    # each `gc.collect()` of the files after them would take a second or more.
    gc.collect()
    gc.freeze()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    # To read their cases takes longer than many tests.
    wanted = config.option.markexpr
    leaves_out_slow = " or " not in wanted and "not slow" in wanted.split(" and ")
    is_slow = collection_path.parent == _HERE and collection_path.name in _SLOW
    return True if leaves_out_slow and is_slow else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.relative_to(_HERE).parts[0] in _SLOW:
            item.add_marker(pytest.mark.slow)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    # Each `gc.collect()`, and with it each first picture of a simulation, would look
    # through all tests, for a second or more.
    gc.enable()
    gc.collect()
    gc.freeze()


def pytest_sessionfinish(session: pytest.Session) -> None:
    count = session.config.stash.get(_COUNT, None)
    if count is not None:
        print(f"\n{count}")
        if count.num_steady <= _LEAST_SHARE * count.total:
            print(f"less than {_LEAST_SHARE:.0%} of the cycles were steady")
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
