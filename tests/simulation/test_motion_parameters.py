"""Parameters and tables of motion files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import MotionError
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint
from arm_drake.simulation.motion import TopicMessage
from arm_drake.simulation.motion_files import load_motion, parse_motion

STEPS = [{"controller": "arm", "commands": "$(angles)"}]
DECLARED = {"parameters": {"angles": [1.5, 0.5], "start": 2.0}, "steps": STEPS}


def test_a_parameter_has_its_default() -> None:
    motion = parse_motion(DECLARED)

    assert motion.steps[0].message.data == (1.5, 0.5)


def test_a_parameter_may_be_given() -> None:
    motion = parse_motion(DECLARED, parameters={"angles": [3, -1]})

    assert motion.steps[0].message.data == (3.0, -1.0)


def test_a_parameter_keeps_its_type_and_may_stand_in_a_text() -> None:
    step = {"at": "$(start)", "topic": "/$(side)/cmd", "data": ["$(n)", "$( n )"]}
    data = {"parameters": {"start": 1.5, "side": "left", "n": 2}, "steps": [step]}

    (read,) = parse_motion(data).steps

    assert read.at == 1.5
    assert read.message == TopicMessage("/left/cmd", (2.0, 2.0))


@pytest.mark.parametrize(
    ("data", "inputs", "message"),
    [
        (STEPS, {}, "[0].commands: no parameter 'angles'; the motion declares none"),
        (STEPS, {"angles": 1}, "no parameter 'angles'; the motion declares none"),
        (DECLARED, {"angle": 1}, "no parameter 'angle'; did you mean 'angles'?"),
        (
            {"parameters": {"a": 1}, "steps": [{"commands": ["$(b)"]}]},
            {},
            "[0].commands[0]: no parameter 'b'; known: a",
        ),
        ({"parameters": [1], "steps": []}, {}, "parameters: expected names with"),
        (
            {"parameters": {}, "steps": 1},
            {},
            "steps: expected a list of steps",
        ),
        ({"parameter": {}, "steps": []}, {}, "unknown key 'parameter'; did you mean"),
        ({"needs": [1], "steps": []}, {}, "needs: expected a mapping, got [1]"),
        (
            {"needs": {"arg": "a"}, "steps": []},
            {},
            "needs: unknown key 'arg'; known: scene, world, xacro_args",
        ),
        (
            {"needs": {"xacro_args": {"a": 1}}, "steps": []},
            {},
            "needs.xacro_args.a: expected a text, got 1",
        ),
        (
            {"needs": {"scene": "a.yaml", "world": "empty"}, "steps": []},
            {},
            "needs.scene: a scene has its own arguments and its own world",
        ),
    ],
)
def test_what_is_no_parameter_is_said(data: Any, inputs: Any, message: str) -> None:
    with pytest.raises(MotionError) as caught:
        parse_motion(data, parameters=inputs)

    assert message in str(caught.value)


def trajectory(row: tuple[float, ...], time: float) -> JointTrajectory:
    point = JointTrajectoryPoint(row, time_from_start=time)
    return JointTrajectory(joint_names=("a", "b"), points=(point,))


def write(folder: Path, table: str, **step: object) -> Path:
    (folder / "table.csv").write_text(table)
    path = folder / "motion.yaml"
    fields = {"controller": "arm", "every": 0.5, "trajectory_table": "table.csv"}
    path.write_text(json.dumps([{**fields, **step}]))
    return path


@pytest.mark.parametrize(
    ("table", "times"),
    [
        ("a,b\n0,1\n2,3.5\n", (0.5, 0.5)),
        ("a, time_from_start, b\n0, 1.0, 1\n\n2, 0.25, 3.5\n", (1.0, 0.25)),
    ],
)
def test_a_table_is_a_trajectory_for_each_row(
    tmp_path: Path, table: str, times: tuple[float, ...]
) -> None:
    motion = load_motion(write(tmp_path, table, at=1.0))

    assert [step.at for step in motion.steps] == [1.0, 1.5]
    rows = ((0.0, 1.0), (2.0, 3.5))
    expected = [trajectory(row, t) for row, t in zip(rows, times, strict=True)]
    assert [repr(step.message) for step in motion.steps] == list(map(repr, expected))
    assert motion.duration == 2.0


def test_a_table_may_stand_in_the_motion() -> None:
    table = {"joint_names": ["a", "b"], "points": [[0, 1], [2, 3.5]]}
    step = {"topic": "/arm/joint_trajectory", "every": 0.5, "trajectory_table": table}

    motion = parse_motion([step])

    (first, second) = (step.message for step in motion.steps)
    assert isinstance(first, TopicMessage)
    assert isinstance(second, TopicMessage)
    assert repr(first.data) == repr(trajectory((0.0, 1.0), 0.5))
    assert repr(second.data) == repr(trajectory((2.0, 3.5), 0.5))


@pytest.mark.parametrize(
    ("table", "step", "message"),
    [
        (
            "",
            {},
            "table.csv: expected distinct names of joints",
        ),
        ("a,a\n", {}, "expected distinct names of joints"),
        ("a,b\n", {}, "expected at least one row"),
        ("a,b\n1\n", {}, "table.csv, line 2: expected 2 values, got 1"),
        ("a,b\n1,x\n", {}, "table.csv, line 2: b: expected a number, got 'x'"),
        ("a,b\n1,nan\n", {}, "table.csv, line 2: expected a finite number, got nan"),
        ("a,b\n1,2\n", {"count": 2}, "[0].count: a trajectory_table has its rows"),
        (
            "a,b\n1,2\n",
            {"ping_pong": True},
            "[0].ping_pong: a trajectory_table has",
        ),
        ("a\n1\n", {"trajectory_table": "no.csv"}, "no.csv: No such file"),
        ("a\n1\n", {"trajectory_table": 3}, "trajectory_table: expected a mapping"),
        ("a\n1\n", {"every": 0}, "expected a positive number of seconds, got 0"),
    ],
)
def test_a_table_that_can_not_be_used_says_where(
    tmp_path: Path, table: str, step: dict[str, object], message: str
) -> None:
    with pytest.raises(MotionError) as caught:
        load_motion(write(tmp_path, table, **step))

    assert message in str(caught.value)


@pytest.mark.slow
def test_the_command_line_sets_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "motion.yaml"
    names = [f"joint{number}" for number in range(1, 7)]
    point = {"positions": "$(q)", "time_from_start": 0.5}
    goal = {"joint_names": names, "points": [point]}
    step = {"controller": "joint_trajectory_controller", "goal": goal}
    path.write_text(json.dumps({"parameters": {"q": [0.0] * 6}, "steps": [step]}))
    words = ["sim", "doosan_a0912", "--headless", "--json", "--motion", str(path)]

    code = main([*words, "--set", "q=[0.1, 0, 0.2, 0, 0, 0]"])

    assert code == 0
    final = json.loads(capsys.readouterr().out)["final"]
    found = [final[name] for name in names]
    np.testing.assert_allclose(found, [0.1, 0, 0.2, 0, 0, 0], atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--set", "q=1"], "--set is for a parameter of a motion; give --motion, too"),
        (["--motion", "tutorial", "--set", "q=[1"], "--set q=[1: malformed YAML"),
        (["--motion", "tutorial", "--set", "q=1"], "no parameter 'q'; the motion decl"),
    ],
)
def test_parameters_that_can_not_be_set_are_said(
    capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    code = main(["sim", "doosan_a0912", "--headless", *words])

    assert code == 2
    assert message in capsys.readouterr().err


def test_load_motion_takes_parameters(tmp_path: Path) -> None:
    path = tmp_path / "motion.yaml"
    path.write_text(json.dumps(DECLARED))

    motion = ad.load_motion(path, {"angles": [7.0]})

    assert motion.steps[0].message.data == (7.0,)
