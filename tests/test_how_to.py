"""The pages that say how to add something: whoever follows them gets there."""

import ast
import re
import shutil
import tomllib
from pathlib import Path

import pytest

from tests.plugin_package import add_package
from tests.snippets import ROOT, follow, read_blocks

pytestmark = pytest.mark.slow

CONTROLLER = ROOT / "docs/add_a_controller.md"
ROBOT = ROOT / "docs/add_a_robot.md"


def test_the_steps_to_a_controller_lead_to_one(tmp_path: Path) -> None:
    (toml,) = (b.text for b in read_blocks(CONTROLLER) if b.language == "toml")
    ((group, points),) = tomllib.loads(toml)["project"]["entry-points"].items()
    # What the step that isn't run leaves behind.
    add_package(tmp_path, "waves", points, group=group)

    printed = follow(CONTROLLER, tmp_path)

    (positions,) = re.findall(r"^nothing to report\n({.*})$", printed, re.MULTILINE)
    # A quarter of a turn of its sine of 0.2 rad, and joints that it doesn't move.
    for joint, position in ast.literal_eval(positions).items():
        top = 0.2 if joint in ("joint1", "joint3") else 0.0
        assert position == pytest.approx(top, abs=1e-3)
    assert "2 passed" in printed
    assert re.search(r"^wave +my_controllers/Wave +active$", printed, re.MULTILINE)
    assert (tmp_path / "waves.png").is_file()


def test_the_steps_to_a_robot_lead_to_one(tmp_path: Path) -> None:
    for name in ("arm_drake", "configs", "docs", "models", "tests"):
        # What is compiled already no program compiles anew.
        ignored = shutil.ignore_patterns("*.pyc.*", "node_modules")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, tmp_path)

    printed = follow(ROBOT, tmp_path, package=tmp_path)

    assert "report: nothing" in printed
    assert "joint_trajectory_controller: SUCCEEDED" in printed
    assert (tmp_path / "reach.png").is_file()
    # Both runs of the tests found some.
    assert len(re.findall(r"\[100%\]", printed)) == 2


@pytest.mark.parametrize("page", [CONTROLLER, ROBOT], ids=lambda page: page.stem)
def test_there_are_at_most_ten_steps(page: Path) -> None:
    text = page.read_text(encoding="utf-8").partition("\n## ")[0]
    steps = [int(n) for n in re.findall(r"^(\d+)\. ", text, flags=re.MULTILINE)]

    assert steps == list(range(1, len(steps) + 1))
    assert 0 < len(steps) <= 10
