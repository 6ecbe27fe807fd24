"""The programs of the docs run, as scripts; tables and names are those of the code."""

import dataclasses as dc
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

import arm_drake as ad
from arm_drake.batch.api import Backend

DOCS = (Path(__file__).parents[2] / "docs/many.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_programs_of_the_docs_run(tmp_path) -> None:
    programs = re.findall(r"```python\n(.*?)```", DOCS, re.DOTALL)
    said = []

    for program in programs:
        (tmp_path / "study.py").write_text(program)
        done = subprocess.run(
            [sys.executable, "study.py"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        said.append((done.stdout.splitlines(), done.stderr))

    (study, _), (settled, _), (nothing, progress), (noisy, _) = said
    assert [line.split(" rad")[0] for line in study[:3]] == ["0.5", "1.0", "1.5"]
    assert re.match(r"3 runs in [\d.]+ s, 0 failed; ", study[3])
    assert [line.split()[0] for line in settled] == ["0", "1", "2", "3"]
    # They are there, within the controller's own tolerance of a goal.
    assert all(float(line.split()[1]) < 0.01 for line in settled)
    assert nothing == []
    assert noisy[0].startswith("1 runs in ")
    assert len(noisy) == 1  # None failed.
    assert re.search(r"^4/4 runs, \d:\d\d$", progress, re.MULTILINE)


def test_the_docs_name_each_backend_and_field() -> None:
    rows = re.findall(r"^\| `(\w+)` \|", DOCS, re.MULTILINE)
    (fields,) = re.findall(r"A `Run` says what .*?: (.*?)\.\n", DOCS, re.DOTALL)

    assert sorted(rows) == sorted(get_args(Backend))
    named = set(re.findall(r"`(\w+)`", fields)) - {"load_robot", "build_diagram"}
    assert named == {field.name for field in dc.fields(ad.Run)} - {"name"}
