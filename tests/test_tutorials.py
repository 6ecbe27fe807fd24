"""The tutorials' page: its programs run, and all of its commands do."""

import contextlib
import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.description.entry import bundled_motions, bundled_robots
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

# Steps of the plant where a thing is picked [s].
STEP = 5e-3


@contextlib.contextmanager
def into_the_bin(simulation: ad.Simulation) -> Iterator[None]:
    """The box is taken from the table into the bin, and the arm goes home."""
    before = box_position(simulation)
    yield
    after = box_position(simulation)
    assert before == pytest.approx([0.2, 0.05, 0.07])
    assert simulation.rejected == []
    # On the bin's bottom, 16 mm high.
    assert after == pytest.approx([0.05, -0.22, 0.036], abs=5e-3)
    assert np.abs(simulation.joint_states().position[:6]).max() < 0.02
    picked, placed = simulation.tasks
    assert picked.describe().startswith("pick box: held and lifted at the first grasp")
    figures = placed.to_json()
    assert figures["thing"] == "box"
    assert figures["pose"][:3] == pytest.approx(after, abs=1e-3)
    assert figures["position_error"] < 5e-3
    assert placed.time + 1.0 < simulation.time < placed.time + 5.0


@contextlib.contextmanager
def on_its_own_table(simulation: ad.Simulation) -> Iterator[None]:
    """The Centauri moves the box, and stands straight up."""
    yield
    assert simulation.rejected == []
    position = box_position(simulation)
    assert position == pytest.approx([-0.1, -0.32, 0.145], abs=5e-3)
    assert np.abs(simulation.joint_states().position[:6]).max() < 0.02


def box_position(simulation: ad.Simulation) -> np.ndarray:
    plant = simulation.plant
    context = plant.GetMyContextFromRoot(simulation.context)
    X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("box"))
    return X.translation()


# What is so after the run of a command, and before.
Watch = Callable[[ad.Simulation], contextlib.AbstractContextManager[None]]
_TABLE = "sim mycobot_280 control:=ros2_control --world house_table"
WATCHES: dict[str, Watch] = {
    f"{_TABLE} --motion pick_and_place": into_the_bin,
    "sim configs/centauri/pick_and_place_scene.yaml": on_its_own_table,
}


def test_what_is_watched_is_a_command_of_the_page() -> None:
    assert set(WATCHES) <= set(COMMANDS)


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
        # What is planned takes the time that it needs, in larger steps than by default:
        # in those a notebook picks, as is known and by camera.
        limit = ["--duration", str(DURATION)]
        words += ["--time-step", str(STEP)] if is_planned(words) else limit
    if words[0] == "analyze":
        # As each step in a tick is differentiated.
        words += ["--time-step", str(STEP)]
    if words[0] == "view" or (words[0] == "launch" and "--headless" not in words):
        # Without a browser: what it shows can be loaded, and the pose is one.
        words = [*words, "--json"]
        viewer = "arm_drake.visualization.page.robot_viewer.RobotViewer.run"
        monkeypatch.setattr(viewer, _end_at_once)
    monkeypatch.chdir(tmp_path)
    watched, run_unwatched = [], ad.Simulation.run

    def run(simulation: ad.Simulation, *args: Any, **options: Any) -> None:
        with WATCHES[command](simulation):
            run_unwatched(simulation, *args, **options)
        watched.append(command)

    if command in WATCHES:
        monkeypatch.setattr(ad.Simulation, "run", run)

    code = main(words)

    assert code == 0, capsys.readouterr().err
    assert watched == [c for c in WATCHES if c == command]


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
