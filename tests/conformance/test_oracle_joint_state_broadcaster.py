"""Replays what upstream's JointStateBroadcaster published."""

from typing import Any

import pytest

from arm_drake.errors import ParameterError
from arm_drake.messages import Time
from tests.conformance.open_loop import OpenLoop, is_started
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("controller_joint_state_broadcaster")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["input"]["name"])
def test_messages_are_upstream_s(case: dict[str, Any]) -> None:
    inputs, expected = case["input"], case["output"]
    if not is_started(expected):
        with pytest.raises(ParameterError):
            OpenLoop(inputs, expected)
        return
    loop = OpenLoop(inputs, expected)
    # An inactive one publishes nothing.
    published = iter(expected["published"]["joint_states"])

    for cycle in loop.cycles():
        if loop.expected_return(cycle) == "inactive":
            continue
        message, row = loop.output("joint_states"), next(published)
        assert message.name == tuple(row["name"])
        for field in ("position", "velocity", "effort"):
            what = f"cycle {cycle}: {field}"
            assert_close(getattr(message, field), row[field], what)
        header = row["header"]
        assert message.header.frame_id == header["frame_id"]
        # Drake's time starts from 0.
        since_start = message.header.stamp.to_nanoseconds() + inputs["t0_ns"]
        assert Time.from_nanoseconds(since_start) == Time.of(header["stamp"])
    assert list(published) == []
    # Which interfaces are claimed; their order comes from an unordered map.
    assert set(loop.system.state_interfaces) == set(expected["state_interfaces"])
    assert expected["published"].keys() == {"joint_states"}
    assert not loop.system.HasOutputPort("dynamic_joint_states")
