"""Every snippet of the README and the docs is run, or says why it isn't."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.cli import main
from tests.models import pendulum
from tests.snippets import PAGES, PROGRAMS, ROOT, Block, read_blocks
from tests.test_tutorials import COMMANDS

# The tests that run the programs and read the YAML of pages.
TESTS = "\n".join(
    file.read_text(encoding="utf-8")
    for file in sorted((ROOT / "tests").rglob("test_*.py"))
    if file != Path(__file__)
)

# How long a simulation is tried [s]; rollouts of the robots' own tests are longer.
DURATION = 0.2

# The reader's own robot and motion, which the README's commands are for.
FILES = {
    "path/to/package.xml": "<package><name>pendulum</name></package>",
    "path/to/robot.urdf.xacro": pendulum().replace("bob", "forearm"),
    "path/to/config/controllers.yaml": """
controller_manager:
  ros__parameters:
    joint_trajectory_controller:
      type: joint_trajectory_controller/JointTrajectoryController
joint_trajectory_controller:
  ros__parameters:
    joints: [swing]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
""",
    "goal.yaml": """
- at: 0.0
  controller: joint_trajectory_controller
  goal:
    joint_names: [swing]
    points: [{positions: [0.0], time_from_start: 0.1}]
""",
    # As `arm-drake plan` writes it.
    "motion.yaml": """
- at: 0.0
  controller: joint_trajectory_controller
  goal:
    joint_names: [joint1, joint2, joint3, joint4, joint5, joint6]
    points: [{positions: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], time_from_start: 0.1}]
""",
}


def is_commands(block: Block) -> bool:
    words = block.text.split()
    return block.language == "sh" or (not block.language and words[0] in PROGRAMS)


def list_commands() -> list[Any]:
    """Return the commands of all pages, as words; some need a browser.

    Those that the tutorials have too are run with these.
    """
    tutorials = {f"arm-drake {command}" for command in COMMANDS}
    found: dict[str, list[str]] = {}
    for page in PAGES:
        for block in read_blocks(page):
            is_step = page.stem.startswith("add_a_")
            if is_commands(block) and not (is_step or block.not_run):
                found |= {shlex.join(words): words for words in block.commands()}
    browser = {"--video", "--screenshot"}
    return [
        pytest.param(
            words, id=name, marks=[pytest.mark.browser] if browser & {*words} else []
        )
        for name, words in found.items()
        # Setting up has done what the first two do.
        if words[0] not in ("make", "pip") and name not in tutorials
    ]


def write_logs(files: list[str]) -> None:
    """Write what an earlier command of the page leaves behind."""
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
    sim.run(DURATION)
    for file in files:
        sim.rollout().save(file)


@pytest.mark.slow
@pytest.mark.parametrize("words", list_commands())
def test_a_command_runs(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for viewer in ("robot_viewer.RobotViewer", "replay.ReplayPage"):
        monkeypatch.setattr(
            f"arm_drake.visualization.page.{viewer}.run", lambda *_, **__: None
        )
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    assert words[0] == "arm-drake"
    # A page that is held or paused waits for somebody.
    words = [word for word in words[1:] if word not in ("--hold", "--paused")]
    if words[0] in ("replay", "compare"):
        write_logs([word for word in words if word.endswith(".mcap")])
    if words[0] == "sim":
        words += ["--duration", str(DURATION)]  # The last one counts.

    code = main(words)

    assert code == 0, capsys.readouterr().err
    for option in ("-o", "--log", "--record", "--video", "--screenshot"):
        if option in words:
            assert (tmp_path / words[words.index(option) + 1]).is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_snippet_is_run_by_a_test_or_says_why_not(page: Path) -> None:
    for block in read_blocks(page):
        if block.language in ("", "sh"):
            # Equations, trees and tables are no commands.
            lines = block.text.splitlines()
            assert is_commands(block) or not any(
                line.strip().startswith(tuple(f"{name} " for name in PROGRAMS))
                for line in lines
            ), block
        elif not block.not_run:
            # Each such test reads the page, and so has its name.
            assert page.name in TESTS, block


def test_make_knows_the_targets_of_the_pages() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = {
        words[1]
        for page in PAGES
        for block in read_blocks(page)
        if is_commands(block)
        for words in block.commands()
        if words[0] == "make"
    }

    assert targets >= {"demo", "test"}
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
