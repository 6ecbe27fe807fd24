"""JSON output of commands, against the checked-in schemas."""

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

import arm_drake
from arm_drake.cli import main
from arm_drake.description.entry import bundled_robots
from tests.models import load, pendulum
from tests.rollout.test_comparison import changed
from tests.rollout.test_rollout import make_rollout

SCHEMAS = Path(arm_drake.__file__).parent / "schemas"

# A goal that can't be reached in time, one of no joint, and one that is done.
FAILING = """
- at: 0.0
  controller: joint_trajectory_controller
  goal:
    joint_names: [joint1, joint2, joint3, joint4, joint5, joint6]
    points: [{positions: [3, 0, 0, 0, 0, 0], time_from_start: 0.05}]
    goal_tolerance: [{name: joint1, position: 0.001}]
    goal_time_tolerance: 0.01
- at: 0.5
  controller: joint_trajectory_controller
  goal:  # It is over when it comes.
    header: {stamp: 0.1}
    joint_names: [joint1, joint2, joint3, joint4, joint5, joint6]
    points: [{positions: [1, 0, 0, 0, 0, 0], time_from_start: 0.1}]
- at: 0.6
  controller: joint_trajectory_controller
  goal:
    joint_names: [joint1, joint2, joint3, joint4, joint5, joint6]
    points: [{positions: [0, 0, 0, 0, 0, 0], time_from_start: 60.0}]
"""


def validator(name: str) -> Draft202012Validator:
    file = SCHEMAS / f"{name}.schema.json"
    schema = json.loads(file.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def run(capsys: Any, *words: object) -> tuple[int, Any]:
    """Run a command that prints JSON; return its exit code, and what it prints."""
    code = main([*map(str, words), "--json"])

    def refuse(text: str) -> None:
        raise AssertionError(f"{text} is no JSON")

    return code, json.loads(capsys.readouterr().out, parse_constant=refuse)


def test_every_schema_is_used_and_in_the_package() -> None:
    names = {file.name.removesuffix(".schema.json") for file in SCHEMAS.iterdir()}

    assert names == {"sim", "check", "compare", "scene", "study"}


@pytest.mark.slow
@pytest.mark.parametrize("robot", list(bundled_robots()))
def test_sim_prints_what_its_schema_says(capsys: Any, robot: str) -> None:
    code, content = run(capsys, "sim", robot, "--headless", "--duration", "0.2")

    validator("sim").validate(content)
    assert code == 0
    assert content["failures"] == []
    assert content["final"].keys() == set(content["joints"])


@pytest.mark.slow
def test_failing_goals_are_what_the_schema_says(capsys: Any, tmp_path: Path) -> None:
    motion = tmp_path / "motion.yaml"
    motion.write_text(FAILING, encoding="utf-8")
    words = ("sim", "doosan_a0912", "--headless", "--duration", "1", "--motion", motion)

    code, content = run(capsys, *words)

    validator("sim").validate(content)
    assert code == 1
    statuses = [goal["status"] for goal in content["goals"]]
    assert statuses == ["ABORTED", "REJECTED", "EXECUTING"]
    assert [goal["error_code"] for goal in content["goals"]] == [-5, -1, None]
    assert len(content["failures"]) == 2


@pytest.mark.slow
def test_a_report_is_what_the_schema_says(capsys: Any, tmp_path: Path) -> None:
    load(tmp_path, pendulum(limit='effort="1"'))
    (file,) = tmp_path.glob("*.urdf")

    for command in (("sim", file, "--headless", "--duration", "0.1"), ("check", file)):
        _, content = run(capsys, *command)
        validator(command[0]).validate(content)
        assert content["report"]


@pytest.mark.slow
@pytest.mark.parametrize("robot", list(bundled_robots()))
def test_check_prints_what_its_schema_says(capsys: Any, robot: str) -> None:
    code, content = run(capsys, "check", robot)

    validator("check").validate(content)
    assert code == 0
    assert content["robot"]


@pytest.mark.parametrize(("by", "expected"), [(0.0, 0), (0.5, 1), (float("nan"), 1)])
def test_compare_prints_what_its_schema_says(
    capsys: Any, tmp_path: Path, by: float, expected: int
) -> None:
    files = [tmp_path / "a.npz", tmp_path / "b.npz"]
    make_rollout().save(files[0])
    changed("position", 2, 1, by).save(files[1])

    code, content = run(capsys, "compare", *files)

    validator("compare").validate(content)
    assert (code, content["equal"]) == (expected, not expected)


def test_the_schemas_refuse_what_is_missing_or_too_much(capsys: Any) -> None:
    _, content = run(capsys, "check", "lab5_arm")
    check = validator("check")

    for bad in (
        {**content, "more": 1},
        {key: value for key, value in content.items() if key != "mass"},
        {**content, "base": "loose"},
    ):
        with pytest.raises(ValidationError):
            check.validate(bad)
