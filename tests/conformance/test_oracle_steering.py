"""Replays what upstream's bicycle, tricycle and ackermann controllers did."""

from typing import Any

import numpy as np
import pytest

from arm_drake.messages import Odometry, TwistStamped
from arm_drake.messages.control import SteeringControllerStatus
from tests.conformance.open_loop import OpenLoop
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("controller_steering")

# A steering command of a quarter of a turn, where wheels went 2e14 rad: from this row
# on the odometry of this case is rounding noise (the data's README, "Properties").
NUM_GOOD_ROWS = {"tricycle_position": 113}


def odometry_row(message: Odometry) -> list[float]:
    pose, twist = message.pose.pose, message.twist.twist
    return [
        message.header.stamp.to_nanoseconds(),
        pose.position.x,
        pose.position.y,
        pose.orientation.z,
        pose.orientation.w,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
    ]


def assert_status(
    status: SteeringControllerStatus, columns: list[str], row: list[Any], what: str
) -> None:
    for name, expected in zip(columns, row, strict=True):
        if name == "t_ns":
            assert status.header.stamp.to_nanoseconds() == expected, what
        else:
            assert_close(getattr(status, name), expected, f"{what}: {name}")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["input"]["name"])
def test_commands_odometry_and_states_are_upstream_s(case: dict[str, Any]) -> None:
    expected = case["output"]
    published, t_ns = expected["published"], expected["t_ns"]
    rows = {row[0]: row for row in published["odometry"]["rows"]}
    states = {row[0]: row for row in published["controller_state"]["rows"]}
    num_rows = NUM_GOOD_ROWS.get(case["input"]["name"], len(t_ns))
    loop = OpenLoop(case["input"], expected, messages={"reference": TwistStamped})

    for cycle in loop.cycles():
        what = f"cycle {cycle}"
        # What the controller leaves behind itself: NaN is told to no drive.
        assert_close(loop.tick.command, expected["command"][cycle], what)
        assert loop.update_return == loop.expected_return(cycle), what
        # References last for one tick: nothing of them is kept.
        assert np.isnan(np.array(expected["reference"][cycle], dtype=float)).all()
        if t_ns[cycle] not in rows:
            assert loop.update_return == "inactive"
            continue
        odometry = loop.output("odometry")
        row = odometry_row(odometry)
        assert row[0] == t_ns[cycle]
        good = rows[t_ns[cycle]]
        if cycle < num_rows:
            assert_close(row, good, what)
        status = loop.output("controller_state")
        columns = published["controller_state"]["columns"]
        assert_status(status, columns, states[t_ns[cycle]], what)
    if num_rows == len(t_ns):
        assert_transform(loop.output("tf_odometry"), published["tf_odometry"])
    assert_frames(loop.output("odometry"), published["odometry"])
    system = loop.system
    assert system.command_interfaces == tuple(expected["command_interfaces"])
    assert system.state_interfaces == tuple(expected["state_interfaces"])
    assert system.reference_interfaces == tuple(expected["reference_interfaces"])


def assert_transform(message: Any, expected: dict[str, Any]) -> None:
    (transform,) = message.transforms
    assert transform.header.frame_id == expected["frame_id"]
    assert transform.child_frame_id == expected["child_frame_id"]
    for part, fields in expected["last"].items():
        for name, value in fields.items():
            assert_close(getattr(getattr(transform.transform, part), name), value)


def assert_frames(message: Odometry, expected: dict[str, Any]) -> None:
    assert message.header.frame_id == expected["frame_id"]
    assert message.child_frame_id == expected["child_frame_id"]
    for part in ("pose", "twist"):
        covariance = getattr(message, part).covariance
        variances = expected[f"{part}_covariance"]
        if len(variances) == 6:
            covariance = covariance[::7]
        assert_close(covariance, variances)
