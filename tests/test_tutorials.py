"""The tutorials' page: its programs run, and all of its commands do."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.description.bundled import bundled_motions, bundled_robots
from arm_drake.simulation.motion import Task
from arm_drake.simulation.motion_files import load_motion
from tests.launch.test_expected_plans import launch_folder
from tests.robots import read_index, robots_folder

PAGE = Path(__file__).parents[1] / "docs/tutorials.md"
TEXT = PAGE.read_text(encoding="utf-8")

# Each command of the page, once.
COMMANDS = list(dict.fromkeys(re.findall(r"`arm-drake ([^`]+)`", TEXT)))

# How long one is tried [s]; rollouts of the robots' own tests are longer.
DURATION = 0.2


@pytest.mark.slow
def test_the_program_runs() -> None:
    (program,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names: dict[str, Any] = {}

    exec(compile(program, str(PAGE), "exec"), names)  # noqa: S102  our own text.

    assert names["goal"].result.error_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_runs(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = shlex.split(command)
    if words[0] == "launch":
        words += ["--package-path", str(launch_folder())]
        is_shown = re.search("rviz|view", words[2])
        words += [] if is_shown else ["--headless", "--duration", str(DURATION)]
    root = PAGE.parents[1]
    words = [str(root / w) if w.startswith("configs/") else w for w in words]
    if words[0] == "sim":
        # What is about the page needs one, without anybody who looks.
        is_page = any(word in words for word in ("--curve", "--keyboard"))
        words += ["--no-open"] if is_page else ["--headless"]
        # What is planned takes the time that it needs.
        words += [] if is_planned(words) else ["--duration", str(DURATION)]
    if words[0] == "view" or (words[0] == "launch" and "--headless" not in words):
        # Without a browser: what it shows can be loaded, and the pose is one.
        words = [*words, "--json"]
        run = "arm_drake.visualization.page.robot_viewer.RobotViewer.run"
        monkeypatch.setattr(run, _end_at_once)
    monkeypatch.chdir(tmp_path)

    code = main(words)

    assert code == 0, capsys.readouterr().err


@pytest.mark.slow
def test_the_environment_of_its_row_is_made() -> None:
    (call,) = re.findall(r"`(ad\.[^`]+)`", TEXT)

    observation, _ = eval(call, {"ad": ad}).reset(seed=1)  # noqa: S307  our own text.

    assert observation is not None


def is_planned(words: list[str]) -> bool:
    """Whether a motion of a command has steps that are planned."""
    if words[1].endswith("pick_and_place_scene.yaml"):
        return True
    if "--motion" not in words:
        return False
    file = bundled_motions(words[1]).get(words[words.index("--motion") + 1])
    steps = () if file is None else load_motion(file).steps
    return any(isinstance(step.message, Task) for step in steps)


def _end_at_once(viewer: object) -> None:
    """Stand for a viewer that nobody looks at."""


def test_every_capability_has_its_row() -> None:
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \| ([^|]+) \|$", TEXT, re.MULTILINE)

    assert [int(number) for number, *_ in rows] == list(range(1, 69))
    for number, name, here in rows:
        # What a test of this file runs.
        assert re.search(r"`(arm-drake |ad\.)[^`]+`", here), (number, name)


def test_every_bundled_robot_has_its_section() -> None:
    robots = set(bundled_robots())
    commands = map(shlex.split, COMMANDS)
    used = {robot for word, robot, *_ in commands if word != "launch"}
    used = {robot for robot in used if not robot.startswith("configs/")}

    assert used == robots


# Published originals of the index, and motions that are for both.
ORIGINALS = [
    ("doosan_a0912", "doosan_a0912", "tutorial"),
    ("doosan_a0912", "doosan_a0912", "waypoints"),
    ("doosan_a0912", "doosan_a0912", "topic"),
    ("mycobot_280", "mycobot_280", "one_joint"),
    ("mycobot_280", "mycobot_280", "ping_pong"),
    ("mycobot_280_ros2_control", "mycobot_280", "trajectories"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("original", "robot", "motion"), ORIGINALS)
def test_the_originals_take_the_same_motions(
    original: str, robot: str, motion: str, capsys: pytest.CaptureFixture[str]
) -> None:
    row, folder = read_index()[original], robots_folder()
    file = bundled_motions(robot)[motion]
    words = ["sim", str(folder / row["entry"]), "--motion", str(file)]
    words += [f"{name}:={value}" for name, value in row["xacro_args"].items()]
    for path in row["controllers_yaml"]:
        words += ["--controllers", str(folder / path)]

    code = main([*words, "--headless", "--duration", str(DURATION)])

    assert code == 0, capsys.readouterr().err
