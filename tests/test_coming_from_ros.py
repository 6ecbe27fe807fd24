"""The page for users of ROS (coming_from_ros.md): all that it says to type works."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

import arm_drake as ad
from arm_drake.cli import main

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/coming_from_ros.md"
TEXT = PAGE.read_text(encoding="utf-8")

# Cells of the tables: ROS, the command line, Python.
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TEXT.splitlines()
    if line.startswith("| ") and not line.startswith("| ---")
]
CODE = re.compile("`([^`]+)`")
MIDDLE = list(dict.fromkeys(code for row in ROWS for code in CODE.findall(row[1])))
COMMANDS = [code for code in MIDDLE if code.startswith("arm-drake ")]
STEPS = [code for code in MIDDLE if code.startswith("{")]

# How long one is tried [s].
DURATION = 0.2


def list_python(text: str) -> list[str]:
    """Return blocks and the tables' Python of a text, in their order."""
    blocks = re.finditer(r"^```python\n(.*?)^```|^\| [^\n]*", text, re.S | re.M)
    found = []
    for block in blocks:
        cells = block[0].strip("|").split("|")
        found += [block[1]] if block[1] else CODE.findall(cells[2])
    return found


def test_every_row_has_three_cells_and_says_something() -> None:
    assert len(ROWS) > 40
    assert {len(row) for row in ROWS} == {3}
    for row in ROWS:
        assert row[0]
        assert row[1] or row[2]
    assert len(COMMANDS) > 12
    assert len(STEPS) > 7


@pytest.mark.parametrize(
    "words",
    [
        *("colcon build", "ros2 launch", "gz sim", "rviz2", "robot_state_publisher"),
        *("joint_state_publisher_gui", "rqt_joint_trajectory_controller"),
        *("ros2 topic pub", "ros2 topic echo", "ros2 topic list", "ros2 bag record"),
        *("ros2 control list_controllers", "ros2 control switch_controllers"),
        *("ros2 control load_controller", "spawner", "ros2 action send_goal"),
        *("ros2 service call", "ros2 param set", "ros_gz_bridge"),
    ],
)
def test_what_a_ros_user_types_is_there(words: str) -> None:
    assert any(words in row[0] for row in ROWS)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_runs(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = shlex.split(command)[1:]
    words = [str(ROOT / w) if w.startswith("configs/") else w for w in words]
    monkeypatch.chdir(tmp_path)
    if words[0] == "sim":
        words += [] if "--headless" in words else ["--headless"]
        words += ["--duration", str(DURATION)]  # The last one counts.
    for viewer in ("robot_viewer.RobotViewer", "replay.ReplayPage"):
        # Without somebody who looks.
        monkeypatch.setattr(
            f"arm_drake.visualization.page.{viewer}.run", lambda *_, **__: None
        )
    if words[0] == "replay":
        sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
        sim.run(DURATION)
        sim.rollout().save(words[1])

    code = main(words)

    assert code == 0, capsys.readouterr().err
    for option in ("-o", "--log", "--record", "--plot"):
        if option in words:
            assert (tmp_path / words[words.index(option) + 1]).is_file()


@pytest.fixture(scope="module")
def diagrams() -> dict[str, Any]:
    names = ("doosan_a0912", "centauri")
    return {name: ad.build_diagram(ad.load_robot(name)) for name in names}


@pytest.mark.slow
@pytest.mark.parametrize("step", STEPS, ids=range(len(STEPS)))
def test_a_step_is_taken(step: str, diagrams: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "motion.yaml"
    file.write_text(f"- {step}\n", encoding="utf-8")
    assert yaml.safe_load(step)
    sim = ad.Simulation(diagrams["centauri" if "_group_" in step else "doosan_a0912"])

    sim.run(motion=file)

    assert sim.rejected == []
    assert sim.failures == []
    for goal in sim.goals:
        assert goal.status is ad.GoalStatus.SUCCEEDED
    if "positions" in step or "_group_" in step:
        assert sim.joint_states().position[:6] == pytest.approx([0.1] * 6, abs=2e-3)
    if "deactivate" in step:
        states = {c.name: c.state for c in sim.list_controllers()}
        assert states["joint_trajectory_controller"] == "inactive"


@pytest.mark.slow
def test_the_python_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    names: dict[str, Any] = {}
    pages: list[ad.PageHandle] = []

    def run(code: str) -> None:
        exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102  our own text.

    head, *sections = TEXT.split("\n## ")
    for section in sections:
        # Each begins with a simulation of its own, of which something is there to see.
        (start,) = list_python(head)
        for code in (start, f"sim.run({DURATION})", *list_python(section)):
            run(code)
            if code.startswith("page ="):
                pages.append(names["page"])
    for page in pages:
        page.close()

    assert names["goal"].status is ad.GoalStatus.SUCCEEDED
    assert names["goal"].result.error_code == 0
    # The loop: each of 20 messages asks for 0.02 rad more than there is.
    assert 0.1 < names["sim"].joint_states().position[0] < 0.4
    for file in ("run.csv", "run.mcap", "run.png"):
        assert (tmp_path / file).is_file()
