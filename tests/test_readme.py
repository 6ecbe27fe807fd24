"""The README tells the truth: its program runs, its table is the registry."""

import re
from pathlib import Path

import pytest

from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.motion import parse_motion

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def code_blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


@pytest.mark.slow
def test_the_program_runs_and_succeeds(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (program,) = code_blocks(README, "python")

    exec(compile(program, "README.md", "exec"), {})  # noqa: S102  our own text.

    assert "GoalStatus.SUCCEEDED" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"run.npz", "run.png"}


def test_the_table_lists_the_controller_types():
    rows = re.findall(r"^\| `([^`]+)` \|", README, flags=re.MULTILINE)
    simulated = [
        name
        for name, row in CONTROLLER_TYPES.items()
        if row.system is not None and not row.runs_as
    ]
    assert sorted(rows) == sorted(simulated)


def test_the_commands_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for command in re.findall(r"`?make (\w+)", README):
        assert re.search(rf"^{command}:", makefile, flags=re.MULTILINE), command


def test_the_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)]+)\)", README):
        if not target.startswith("https://"):
            assert (ROOT / target).exists(), target


def test_the_motion_of_the_docs_can_be_read():
    import yaml

    docs = (ROOT / "docs/motions.md").read_text(encoding="utf-8")
    (text,) = code_blocks(docs, "yaml")
    motion = parse_motion(yaml.safe_load(text))
    assert [step.at for step in motion.steps] == [0.0, 3.0, 4.0, 5.0, 7.0]
