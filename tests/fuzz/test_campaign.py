"""A fixed sample of the campaign, and that the campaign finds what there is."""

import os
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from tests.fuzz import campaign
from tests.fuzz.campaign import KINDS, prepare, run_input, table

pytestmark = pytest.mark.slow

# Inputs of each kind: the first of the campaign, most of which `make bench` has alone.
COUNTS = [5, pytest.param(100, marks=pytest.mark.long)]

# Of these few can be used at all; so many are quick.
RARELY_OK = {"log": 20, "words": 20}


@pytest.fixture(scope="module", autouse=True)
def prepared() -> None:
    prepare()


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", KINDS)
def test_no_mutated_input_ends_in_a_traceback(kind: str, count: int) -> None:
    outcomes = [
        run_input(0, kind, number)
        for number in range(max(count, RARELY_OK.get(kind, 0)))
    ]

    found = [o for o in outcomes if o.what not in ("ok", "clean error")]
    assert found == []
    # Mutations that break all, or nothing, show little.
    assert {o.what for o in outcomes} == {"ok", "clean error"} or kind in (
        *("mesh", "page", "srdf"),  # What can't be used of these is reported.
    )


def test_a_library_that_logs_a_traceback_is_silent() -> None:
    # Facets of an STL file that can't be read as normals; pytest would catch the log.
    words = ["--kind", "mesh", "--first", "20311", "--count", "1", "--workers", "1"]

    ended = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", *words], capture_output=True, check=False
    )

    assert ended.returncode == 0, ended.stdout.decode()


def test_inputs_are_the_same_each_time(tmp_path: Path) -> None:
    for kind, make in KINDS.items():
        words = []
        for turn in ("one", "two"):
            (tmp_path / turn).mkdir(exist_ok=True)
            made = make(Random(f"0/{kind}/7"), tmp_path / turn)  # noqa: S311
            files = sorted(p for p in (tmp_path / turn).iterdir())
            text = "\n".join(made).replace(str(tmp_path / turn), "")
            # An archive has the times of its files.
            data = [p.read_bytes() for p in files if p.suffix != ".npz"]
            words.append((text, [p.name for p in files], data))
            for path in files:
                path.unlink()
        assert words[0] == words[1], kind


def _dies(words: list[str]) -> int:
    del words
    os.abort()


def _raises(words: list[str]) -> int:
    raise KeyError(words[0])


def _takes_memory(words: list[str]) -> int:
    return len(bytearray(1 << 31)) + len(words)


def _runs_on(words: list[str]) -> int:
    while words:
        pass
    return 0


def _is_silent(words: list[str]) -> int:
    return 2 if words else 0


def _warns(words: list[str]) -> int:
    print(f"/x/{words[0]}.py:12: RuntimeWarning: overflow", file=sys.stderr)
    return 0


@pytest.mark.parametrize(
    ("main", "what", "where"),
    [
        (_dies, "death", "SIGABRT"),
        (_raises, "traceback", " KeyError: 'check'"),
        (_takes_memory, "limit", "memory, "),
        (_runs_on, "limit", "SIGXCPU"),
        (_is_silent, "traceback", "exit code 2 without a message"),
        (_warns, "traceback", "/x/check.py:12: RuntimeWarning: overflow"),
    ],
)
def test_what_is_to_be_found_is_found(
    main: object, what: str, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "_main", main)
    monkeypatch.setattr(campaign, "CPU_TIME", 1)
    monkeypatch.setattr(campaign, "KINDS", {"xacro": KINDS["xacro"]})

    outcome = run_input(0, "xacro", 1)

    assert (outcome.what, outcome.where) == (what, where)


def test_the_table_adds_up() -> None:
    text = table({"urdf": {"ok": 1000, "death": 1}, "mesh": {"ok": 2}})

    assert text.splitlines()[2:] == [
        "| urdf | 1,000 | 0 | 0 | 1 | 0 |",
        "| mesh | 2 | 0 | 0 | 0 | 0 |",
        "| all | 1,002 | 0 | 0 | 1 | 0 |",
    ]
