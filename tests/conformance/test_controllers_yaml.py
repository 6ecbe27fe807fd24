"""Controllers YAML of real robots is read as their index of expectations says."""

import re
from pathlib import Path
from typing import Any

import pytest

from arm_drake.description.controllers import ControllerConfig, load_controllers
from arm_drake.description.report import LoadReport
from tests.robots import read_index, robot_names, robots_folder

# In the index the joints of a controller are one list, whatever their parameters.
JOINTS = (
    "joints",
    "joint",
    "left_wheel_names",
    "right_wheel_names",
    "rear_wheels_names",
    "front_wheels_names",
    "traction_joints_names",
    "steering_joints_names",
)
# The older name is taken where the newer one is missing.
INTERFACES = ("command_interfaces", "interface_name")


@pytest.fixture(scope="module", params=robot_names())
def row(request) -> dict[str, Any]:
    return read_index()[request.param]


@pytest.fixture(scope="module")
def loaded(row):
    report = LoadReport()
    files = [robots_folder() / file for file in row["controllers_yaml"]]
    return load_controllers(files, row["launch_vars"], report), report


def substitute(value: Any, variables: dict[str, str]) -> Any:
    """Return a value of the index with its `$(var NAME)` replaced."""
    if isinstance(value, str):
        return re.sub(r"\$\(var (\w+)\)", lambda m: variables[m.group(1)], value)
    return [substitute(item, variables) for item in value]


def flatten(value: Any, name: str) -> dict[str, Any]:
    """Return the parameters that nested mappings stand for, read through lists."""
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        (value,) = value
    if not isinstance(value, dict):
        return {name: value}
    flat: dict[str, Any] = {}
    for key, below in value.items():
        flat |= flatten(below, f"{name}.{key}")
    return flat


def joints(controller: ControllerConfig) -> list[str]:
    inputs = (controller.parameters.get(name) for name in JOINTS)
    lists = (p.value for p in inputs if p is not None)
    return [j for v in lists for j in ([v] if isinstance(v, str) else v)]


def test_the_rate_of_a_real_robot_is_its_files(row, loaded):
    config, report = loaded

    rate = row["expected"].get("update_rate")
    assert config.update_rate == (100 if rate is None else rate)
    is_reported = any("update_rate is not given" in e.what for e in report)
    assert is_reported == (rate is None and bool(row["controllers_yaml"]))


def test_the_controllers_of_a_real_robot_are_its_files(row, loaded):
    config, _ = loaded

    expected = row["expected"].get("controllers") or {}
    assert {c.name: c.type for c in config.controllers} == {
        name: parts["type"] for name, parts in expected.items()
    }


def test_the_joints_of_a_real_robots_controllers_are_its_files(row, loaded):
    config, _ = loaded

    for name, parts in (row["expected"].get("controllers") or {}).items():
        (controller,) = (c for c in config.controllers if c.name == name)
        if "joints" in parts:
            assert joints(controller) == substitute(parts["joints"], row["launch_vars"])


def test_the_interfaces_of_a_real_robots_controllers_are_its_files(row, loaded):
    config, _ = loaded

    for name, parts in (row["expected"].get("controllers") or {}).items():
        (controller,) = (c for c in config.controllers if c.name == name)
        if "command_interfaces" not in parts:
            continue
        read = {key: p.value for key, p in controller.parameters.items()}
        (used, *_) = (n for n in INTERFACES if any(k.split(".")[0] == n for k in read))
        expected = flatten(parts["command_interfaces"], used)
        assert {k: v for k, v in read.items() if k.split(".")[0] == used} == expected


def test_a_real_robots_files_have_their_lines(row, loaded):
    config, _ = loaded

    for controller in config.controllers:
        for name, parameter in controller.parameters.items():
            text = Path(parameter.file).read_text(encoding="utf-8")
            # A list in block style begins below its key.
            near = "\n".join(text.splitlines()[: parameter.line][-3:])
            assert name.rpartition(".")[2] in substitute(near, row["launch_vars"])
