"""The README tells the truth: its programs run, its tables are the registry."""

import re
import sys
import tomllib
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES, find_controller_type
from arm_drake.controllers.type_table import render_others, render_types
from arm_drake.controllers.vendor_types import EQUIVALENTS
from arm_drake.motion import parse_motion
from tests.plugin_package import add_package

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")

# A whole table, of any kind.
TABLE = re.compile(r"^\|[^\n]*\n\| ---[^\n]*\n(?:\|[^\n]*\n)*", flags=re.MULTILINE)


def code_blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def tables() -> list[str]:
    """Return the README's tables as the registry makes them, in their order."""
    run_as = {}
    for name in (*CONTROLLER_TYPES, *EQUIVALENTS):
        row = find_controller_type(name, installed={})
        if row is not None and row.runs_as:
            run_as[name] = row.runs_as
    return [render_types(CONTROLLER_TYPES), render_others(run_as)]


def renew(text: str) -> str:
    """Return the README with its tables made anew."""
    made = iter(tables())
    return TABLE.sub(lambda _: f"{next(made)}\n", text)


@pytest.mark.slow
def test_the_program_runs_and_succeeds(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program = code_blocks(README, "python")[0]

    exec(compile(program, "README.md", "exec"), {})  # noqa: S102  our own text.

    assert "GoalStatus.SUCCEEDED" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"run.npz", "run.png"}


def test_the_tables_are_those_of_the_registry():
    assert [table.rstrip() for table in TABLE.findall(README)] == tables(), (
        "python -m tests.test_readme renews them"
    )


def check_wave(robot: ad.Robot, *, amplitude: float) -> None:
    """Check that the joints follow a sine of 1 rad/s, at its top."""
    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.advance_to(1.57)

    state = simulation.joint_states()
    positions = dict(zip(state.name, state.position, strict=True))
    # At its top the sine is flat: a lag of 0.1 s would be amplitude * 0.1**2 / 2.
    assert positions["joint1"] == pytest.approx(amplitude, abs=1e-3)
    assert positions["joint3"] == pytest.approx(amplitude, abs=1e-3)
    assert positions["joint2"] == pytest.approx(0.0, abs=1e-3)


def write_own_type(folder: Path) -> None:
    (folder / "waves.py").write_text(code_blocks(README, "python")[1])
    (yaml,) = code_blocks(README, "yaml")
    (folder / "waves.yaml").write_text(yaml)


@pytest.fixture
def without_waves():
    """Forget the example's module after the test."""
    yield
    sys.modules.pop("waves", None)


def test_the_controller_type_of_the_readme_moves_a_robot(
    tmp_path, monkeypatch, without_waves
):
    write_own_type(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    names: dict[str, ad.Robot] = {}

    exec(compile(code_blocks(README, "python")[2], "README.md", "exec"), names)  # noqa: S102

    assert len(code_blocks(README, "python")[1].splitlines()) <= 40
    assert str(names["robot"].report) == ""
    check_wave(names["robot"], amplitude=0.2)


def test_so_does_the_package_of_the_readme(tmp_path, monkeypatch, without_waves):
    (toml,) = code_blocks(README, "toml")
    ((group, points),) = tomllib.loads(toml)["project"]["entry-points"].items()
    add_package(tmp_path, "waves", points, group=group)
    write_own_type(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)

    robot = ad.load_robot("doosan_a0912", controllers=tmp_path / "waves.yaml")

    assert str(robot.report) == ""
    check_wave(robot, amplitude=0.2)


def test_the_commands_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for command in re.findall(r"`?make (\w+)", README):
        assert re.search(rf"^{command}:", makefile, flags=re.MULTILINE), command


def test_the_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)]+)\)", README):
        if not target.startswith("https://"):
            file, _, heading = target.partition("#")
            text = (ROOT / file).read_text(encoding="utf-8") if heading else ""
            assert (ROOT / file).exists(), target
            assert not heading or f"\n## {heading.replace('-', ' ')}\n" in text.lower()


def test_the_motion_of_the_docs_can_be_read():
    import yaml

    docs = (ROOT / "docs/motions.md").read_text(encoding="utf-8")
    (text,) = code_blocks(docs, "yaml")
    motion = parse_motion(yaml.safe_load(text))
    assert [step.at for step in motion.steps] == [0.0, 3.0, 4.0, 5.0, 7.0]


if __name__ == "__main__":
    (ROOT / "README.md").write_text(renew(README), encoding="utf-8")
