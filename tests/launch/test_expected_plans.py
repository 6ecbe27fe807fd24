"""Real launch files give the plans that a careful reader wrote down."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.errors import ArmDrakeError
from tests.robots import read_yaml, robots_folder, skip_or_fail

EXPECTED = Path(__file__).with_name("expected_plans.yaml")
RECORDS = read_yaml(EXPECTED)

# Nobody can know the name of what a launch file writes.
TEMPORARY = "(a temporary file)"


def launch_folder() -> Path:
    """Return the folder of real launch files, beside the robots, or skip the test."""
    given = os.environ.get("ARM_DRAKE_LAUNCH")
    folder = Path(given) if given else robots_folder().parent / "launch"
    if not folder.is_dir():
        skip_or_fail(f"no folder {folder}; ARM_DRAKE_LAUNCH may name another")
    return folder.resolve()


def name_of(record: dict[str, Any]) -> str:
    given = ",".join(f"{k}={v}" for k, v in record["arguments"].items())
    return f"{Path(record['file']).name} {given}"


def below(path: Any, root: Path) -> Any:
    """Return a path as it is called from a repository's folder."""
    if not isinstance(path, Path):
        return path
    return str(path.relative_to(root)) if path.is_relative_to(root) else TEMPORARY


def to_record(plan: ad.LaunchPlan, root: Path) -> dict[str, Any]:
    """Return a plan in the form of the expected ones."""
    robots = [
        {
            "name": robot.name,
            "namespace": robot.namespace,
            "description": below(robot.source, root),
            "xacro_args": {
                name: below(Path(value), root)
                if value.startswith((str(root), tempfile.gettempdir()))
                else value
                for name, value in robot.xacro_args.items()
            },
            "frame_prefix": robot.frame_prefix,
            "controllers_yaml": [
                name
                for path in robot.controllers
                if (name := below(path, root)) != TEMPORARY
            ],
            "controllers": list(robot.spawned.items()),
            "pose": list(robot.pose or (0.0,) * 6),
            "remappings": [
                [source.strip("/"), target.strip("/")]
                for source, target, _ in robot.remappings
            ],
        }
        for robot in plan.robots
    ]
    robots += [
        {
            "name": model.name,
            "namespace": "",
            "description": below(model.file, root),
            "xacro_args": {},
            "frame_prefix": "",
            "controllers_yaml": [],
            "controllers": [],
            "pose": list(model.pose or (0.0,) * 6),
            "remappings": [],
        }
        for model in plan.models
    ]
    return {
        "declared": [argument.name for argument in plan.arguments],
        "robots": robots,
        "simulator": plan.simulator,
        "world": below(plan.world, root),
        "paused": plan.is_paused,
        # The folder of one that isn't there is nobody's.
        "rviz": plan.rviz and Path(plan.rviz).name,
        "sliders": plan.has_sliders,
        "bridge": [
            *map(str, plan.bridges),
            *(f"config: {below(p, root)}" for p in plan.bridge_files),
        ],
        "static_frames": [[p, c, list(pose)] for p, c, pose in plan.static_frames],
        "move_group": plan.has_move_group,
        "not_started": sorted(each.name for each in plan.not_started),
    }


def parameters_of(files: Iterable[Path], node: str) -> dict[str, Any]:
    """Return the parameters that a node has in files, the last one of each."""
    found: dict[str, Any] = {}
    for path in files:
        found |= (read_yaml(path).get(node) or {}).get("ros__parameters", {})
    return found


@pytest.mark.slow
@pytest.mark.parametrize("record", RECORDS, ids=map(name_of, RECORDS))
def test_a_real_launch_file_gives_the_plan_of_a_careful_reader(
    record: dict[str, Any],
) -> None:
    path = launch_folder() / record["file"]
    root = launch_folder() / Path(record["file"]).parts[0]
    given = record["arguments"]
    if "error" in record:
        with pytest.raises(ArmDrakeError) as error:
            ad.load_launch(path, arguments=given)
        assert record["error_name"] in str(error.value)
        return

    plan = ad.load_launch(path, arguments=given)
    found = to_record(plan, root)

    expected = {name: record[name] for name in found}
    expected["rviz"] = record["rviz"] and Path(record["rviz"]).name
    # A file that is included by a path of its own is looked into when it is run only.
    found["declared"] = [n for n in found["declared"] if n in record["declared"]]
    expected["robots"] = [
        {
            "remappings": [],
            **{name: value for name, value in robot.items() if name != "parameters"},
            "controllers": list(robot["controllers"].items()),
            "controllers_yaml": [
                name for name in robot["controllers_yaml"] if name != TEMPORARY
            ],
        }
        for robot in record["robots"]
    ]
    assert found == expected
    for robot, launched in zip(record["robots"], plan.robots, strict=False):
        for node, values in robot.get("parameters", {}).items():
            assert values.items() <= parameters_of(launched.controllers, node).items()
