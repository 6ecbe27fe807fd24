"""The tables of types say what the parameters' rules say."""

import dataclasses as dc
from typing import Annotated

from arm_drake.controllers import CONTROLLER_TYPES, ControllerType
from arm_drake.description.parameters import ParameterGroup, Rule, per_element_of
from tests.type_table import render_others, render_types

ALL = "humble, jazzy, kilted, rolling"


@dc.dataclass(frozen=True)
class Limits:
    """A group with an older name, in one distribution."""

    limit: float = 0.0
    soft: Annotated[float, Rule(since="jazzy", until="kilted")] = 0.0

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        params.rename("max", "limit")
        if params.is_before("jazzy"):
            params.get("has_limit", bool)


@dc.dataclass(frozen=True)
class Plain:
    joints: tuple[str, ...]


@dc.dataclass(frozen=True)
class Ruled:
    joints: tuple[str, ...]
    limits: dict[str, Limits] = per_element_of("joints")
    rate: Annotated[float, Rule(until="humble")] = 1.0
    first: Annotated[float, Rule(since="jazzy", was=("primary",))] = 1.0
    second: Annotated[float, Rule(since="jazzy")] = 1.0
    third: Annotated[float, Rule(since="jazzy")] = 1.0
    fourth: Annotated[float, Rule(since="jazzy")] = 1.0
    group: Annotated[Limits, Rule(since="rolling")] = Limits()
    old: Annotated[float, Rule(until="kilted")] = 1.0


@dc.dataclass(frozen=True)
class New:
    name: Annotated[str, Rule(since="kilted")]


def cells(row: ControllerType) -> list[str]:
    """Return the cells of a type's row, without its name."""
    table = render_types({"a/B": row}).splitlines()
    assert len(table) == 3
    name, *others = table[2].strip("| ").split(" | ")
    assert name == "`a/B`"
    return [cell.strip(" |") for cell in others]


def test_a_type_without_rules_is_the_same_in_all_distributions() -> None:
    assert cells(ControllerType(Plain)) == ["parameters only", ALL]


def test_what_is_not_in_all_of_them_is_listed_by_distribution() -> None:
    *_, distros, some = cells(ControllerType(Ruled))

    assert distros == ALL
    assert some.split("; ") == [
        "humble: `rate`",
        "up to kilted: `old`",
        "jazzy to kilted: `soft`",
        "since jazzy: `first`, `second`, `third` and 1 more",
        "rolling: `group`",
        "older: `max`, `has_limit`, `primary`",
    ]


def test_a_distribution_without_a_required_parameter_is_not_named() -> None:
    assert cells(ControllerType(New))[1:] == [
        "kilted, rolling",
        "since kilted: `name`",
    ]


def test_simulated_types_come_first_and_others_by_their_own_names_not_at_all() -> None:
    types = {
        "a/Read": ControllerType(Plain),
        "b/Simulated": ControllerType(Plain, lambda *_: None),  # type: ignore[arg-type, return-value]
        "c/Alias": ControllerType(Plain, runs_as="b/Simulated"),
    }

    rows = render_types(types).splitlines()[2:]

    assert [row.split(" | ")[:2] for row in rows] == [
        ["| `b/Simulated`", "all of it"],
        ["| `a/Read`", "parameters only"],
    ]


def test_other_names_are_listed_with_what_they_are_run_as() -> None:
    assert render_others({"z/Z": "a/A", "b/B": "a/A"}).splitlines()[2:] == [
        "| `b/B` | `a/A` |",
        "| `z/Z` | `a/A` |",
    ]


def test_what_upstream_renamed_is_in_the_table() -> None:
    # From ros2_controllers' migration guides.
    facts = {
        "joint_trajectory_controller/JointTrajectoryController": (
            "humble: `open_loop_control`",
            "since jazzy: `interpolate_from_desired_state`",
        ),
        "ackermann_steering_controller/AckermannSteeringController": (
            "older: `front_steering`, `rear_wheels_names`",
        ),
        "pid_controller/PidController": ("up to jazzy: `enable_feedforward`",),
    }

    rows = {
        line.split("`")[1]: line
        for line in render_types(CONTROLLER_TYPES).splitlines()[2:]
    }

    for name, texts in facts.items():
        assert all(text in rows[name] for text in texts), rows[name]
        assert f"| {ALL} |" in rows[name]
