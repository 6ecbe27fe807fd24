"""`arm-drake sim SCENE.yaml`: several robots, things, and what is written of them."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.commands.output import say_report
from tests import models
from tests.test_schemas import validator

SCENE = """
robots:
- {robot: ball.urdf, name: one}
- {robot: ball.urdf, name: two, pose: [0, 1, 0], initial: {fall: 0.5}}
world: void
options: {time_step: 0.002}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "ball.urdf").write_text(models.FALLING_BALL, encoding="utf-8")
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE, encoding="utf-8")
    return file


def sim(*words: object) -> int:
    return main(["sim", *map(str, words), "--headless", "--duration", "0.1"])


def test_what_is_found_in_many_places_is_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    report = ad.LoadReport()
    what, done = "damping -1 is negative", "taken as 0"
    for name in "ab":
        report.add("warning", "repair", what, done, where=f"joint {name!r}", file="r")

    say_report(report, strict=False)

    assert capsys.readouterr().err == (
        f"warning: r: joint 'a', joint 'b': {what}; {done}\n"
    )


@pytest.mark.slow
def test_all_robots_of_a_scene_are_simulated(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = scene.with_name("log.mcap")

    code = sim(scene, "--json", "--log", log)

    content = json.loads(capsys.readouterr().out)
    validator("sim").validate(content)
    assert (code, content["robot"]) == (0, "one, two")
    # Both fall as far in 50 steps of 2 ms.
    fallen = models.GRAVITY * 0.002**2 * 50 * 51 / 2.0
    assert content["final"] == pytest.approx(
        {"one/fall": -fallen, "two/fall": 0.5 - fallen}
    )
    two = ad.Rollout.load(log, robot="two")
    assert two.position[0, 0] == pytest.approx(0.5)


def test_words_of_the_command_line_come_before_the_scenes_options(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sim(scene, "--json", "--gravity", "off", "--preset", "kinematic")

    assert json.loads(capsys.readouterr().out)["final"]["two/fall"] == 0.5


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--pose", 0, 0, 0, 0, 0, 0],
            "scene.yaml: --pose is for one robot; a scene has its own",
        ),
        (
            ["a:=1"],
            "scene.yaml: NAME:=VALUE is for one robot; a scene has its own",
        ),
        (
            ["--log", "log.npz"],
            "log.npz: a .npz file is of one robot; expected .mcap",
        ),
    ],
)
def test_what_is_for_one_robot_is_refused(
    scene: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: list[object],
    message: str,
) -> None:
    monkeypatch.chdir(scene.parent)

    code = sim("scene.yaml", *words)

    assert (code, capsys.readouterr().err) == (2, f"arm-drake: {message}\n")


def test_a_scene_of_things_alone_is_for_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "things.yaml"
    file.write_text("things: [{name: a, sphere: 1, fixed: true}]", encoding="utf-8")

    code = sim(file)

    text = "a scene without robots is for build_diagram; expected one at least"
    assert (code, capsys.readouterr().err) == (2, f"arm-drake: {file}: {text}\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check"], "check takes a robot; a scene is for sim and view"),
        (["graph", "-o", "g.svg"], "graph takes a robot; a scene is for sim and view"),
        (
            ["view", "--position", "0.5"],
            "--position is for one robot; a scene has its own",
        ),
        (["view", "--ghost", "0.5"], "--ghost is for one robot; a scene has several"),
    ],
)
def test_other_commands_say_what_they_take(
    scene: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(scene.parent)
    command, *rest = words

    code = main([command, "scene.yaml", *rest])

    assert (code, capsys.readouterr().err) == (2, f"arm-drake: scene.yaml: {message}\n")


@pytest.mark.browser
def test_the_picture_of_a_scene_is_of_its_robots(tmp_path: Path) -> None:
    ball = (
        '<robot name="ball"><link name="ball"><visual><geometry><sphere radius="0.2"/>'
        '</geometry><material name="m"><color rgba="1 0 1 1"/></material></visual>'
        "</link></robot>"
    )
    (tmp_path / "ball.urdf").write_text(ball, encoding="utf-8")
    scene, picture = tmp_path / "scene.yaml", tmp_path / "scene.png"
    scene.write_text(
        "robots: [{robot: ball.urdf, name: one, pose: [0, 0, 0.3]}]\n"
        "things: [{name: wall, box: [1, 1, 1], fixed: true, pose: [-30, 30, 0]}]\n",
        encoding="utf-8",
    )

    code = main(["view", str(scene), "--screenshot", str(picture)])

    assert code == 0
    red, green, blue = np.moveaxis(imread(picture)[..., :3], -1, 0)
    # A ball that fills the picture's height but for margins, lit from one side; if the
    # wall counted, it would be a few pixels.
    assert ((red > 0.3) & (blue > 0.3) & (green < 0.5 * red)).mean() > 0.05
