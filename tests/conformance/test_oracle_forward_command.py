"""Replays what upstream's forward command controllers did."""

from typing import Any

import pytest

from arm_drake.errors import ParameterError
from tests.conformance.open_loop import OpenLoop, is_started
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("controller_forward_command")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["input"]["name"])
def test_commands_are_upstream_s(case: dict[str, Any]) -> None:
    expected = case["output"]
    if not is_started(expected):
        with pytest.raises(ParameterError):
            OpenLoop(case["input"], expected)
        return
    loop = OpenLoop(case["input"], expected)

    for cycle in loop.cycles():
        assert_close(loop.command, expected["command"][cycle], f"cycle {cycle}")
        assert loop.update_return == loop.expected_return(cycle), f"cycle {cycle}"
    assert loop.system.command_interfaces == tuple(expected["command_interfaces"])
