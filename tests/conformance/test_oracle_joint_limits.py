"""Replays commands that upstream's saturation and soft limiters held to limits."""

from typing import Any

import numpy as np
import pytest

from arm_drake.control.joint_limits import (
    NO_COMMAND,
    JointControlInterfacesData,
    PositionOutOfBoundsError,
    limit,
)
from arm_drake.description.joint_limits import JointLimits, SoftJointLimits
from tests.oracle import assert_close, number, oracle_cases

CASES = oracle_cases("joint_limits")

# The letters of the file, in the order of the dataclass.
KEYS = "pveaj"


def numbers(inputs: dict[str, float | str]) -> dict[str, float]:
    """Return limits as numbers; those that are NaN upstream are not set."""
    found = {key: number(value) for key, value in inputs.items()}
    return {key: value for key, value in found.items() if not np.isnan(value)}


def make_soft_limits(inputs: dict[str, Any]) -> SoftJointLimits | None:
    if inputs["limiter"] == "saturation":
        return None
    return SoftJointLimits(**numbers(inputs.get("soft", {})))


def make_data(inputs: dict[str, float | str]) -> JointControlInterfacesData:
    assert set(inputs) <= set(KEYS)
    values = [number(inputs[key]) if key in inputs else None for key in KEYS]
    return JointControlInterfacesData(*values)


def replay(inputs: dict[str, Any]) -> list[dict[str, Any]]:
    limits, soft_limits = (
        JointLimits(**numbers(inputs["limits"])),
        make_soft_limits(inputs),
    )
    previous, rows = NO_COMMAND, []
    for step in inputs["steps"]:
        measured, desired = make_data(step["actual"]), make_data(step["desired"])
        try:
            command, is_limited, previous = limit(
                limits, soft_limits, previous, measured, desired, step["dt_ns"] / 1e9
            )
        except PositionOutOfBoundsError as error:
            previous = error.previous
            rows.append({"exception": "runtime_error"})
            continue
        values = zip(KEYS, command, strict=True)
        found = {key: value for key, value in values if value is not None}
        rows.append({"command": found, "limited": is_limited})
    return rows


@pytest.mark.parametrize(
    "case", CASES, ids=[f"{c['input']['limiter']}-{i}" for i, c in enumerate(CASES)]
)
def test_limited_commands_are_upstream_s(case: dict[str, Any]) -> None:
    rows, expected = replay(case["input"]), case["output"]["steps"]

    assert len(rows) == len(expected)
    for row, wanted in zip(rows, expected, strict=True):
        assert row.keys() == wanted.keys()
        assert row.get("exception") == wanted.get("exception")
        assert row.get("limited") == wanted.get("limited")
        command = row.get("command", {})
        limited = {key: number(x) for key, x in wanted.get("command", {}).items()}
        assert command.keys() == limited.keys()
        for key, value in limited.items():
            assert_close(command[key], value)
