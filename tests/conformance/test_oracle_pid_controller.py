"""Replays what upstream's PidController did."""

from typing import Any

import numpy as np
import pytest

from arm_drake.errors import ParameterError
from arm_drake.messages import MultiDOFStateStamped
from tests.conformance.open_loop import OpenLoop, is_started
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("controller_pid_controller")

# Columns of a degree of freedom in the cases.
COLUMNS = (
    "reference",
    "feedback",
    "feedback_dot",
    "error",
    "error_dot",
    "time_step",
    "output",
)


def rows(state: MultiDOFStateStamped) -> list[list[float]]:
    return [[getattr(dof, name) for name in COLUMNS] for dof in state.dof_states]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["input"]["name"])
def test_commands_and_states_are_upstream_s(case: dict[str, Any]) -> None:
    expected = case["output"]
    if not is_started(expected):
        with pytest.raises(ParameterError):
            OpenLoop(case["input"], expected)
        return
    loop = OpenLoop(case["input"], expected)
    states, t_ns = expected["published"]["controller_state"]["rows"], expected["t_ns"]
    published = {time_ns: dofs for time_ns, *dofs in states}
    n = len(loop.system.command_interfaces)

    for cycle in loop.cycles():
        what = f"cycle {cycle}"
        assert_close(loop.command, expected["command"][cycle], what)
        assert loop.update_return == loop.expected_return(cycle), what
        exported = loop.output("exported_state_interfaces")
        assert_close(exported, expected["exported_state"][cycle], what)
        if t_ns[cycle] in published:
            state = loop.output("controller_state")
            assert state.header.stamp.to_nanoseconds() == t_ns[cycle]
            assert_close(rows(state), published.pop(t_ns[cycle]), what)
            references = np.array([dof.reference for dof in state.dof_states])
            assert_close(references, expected["reference"][cycle][:n], what)
    assert not published
    system = loop.system
    assert system.command_interfaces == tuple(expected["command_interfaces"])
    assert system.state_interfaces == tuple(expected["state_interfaces"])
    assert system.reference_interfaces == tuple(expected["reference_interfaces"])
    assert system.exported_interfaces == tuple(expected["exported_state_interfaces"])
