"""Replays what upstream's diff_drive_controller did, tick by tick."""

from typing import Any

import pytest

from tests.conformance.open_loop import OpenLoop
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("controller_diff_drive")


@pytest.mark.parametrize("case", CASES)
def test_ticks_equal_upstream(case: dict[str, Any]) -> None:
    loop = OpenLoop(case["input"], case["output"])
    expected = case["output"]
    topics = expected["published"]
    odometry = {row[0]: row[1:] for row in topics["odom"]["rows"]}
    limited = {
        row[0]: row[1:] for row in topics.get("cmd_vel_out", {"rows": []})["rows"]
    }
    last = loop.output("odom")

    for cycle in loop.cycles():
        place = f"cycle {cycle}"
        assert loop.update_return == loop.expected_return(cycle), place
        assert_close(loop.command, expected["command"][cycle], place)
        assert_close(loop.tick.state.reference, expected["reference"][cycle], place)
        odom = loop.output("odom")
        is_new = odom.header.stamp != last.header.stamp
        assert is_new == (loop.time_ns in odometry), place
        last = odom
        if loop.time_ns in odometry:
            assert odom.header.stamp.to_nanoseconds() == loop.time_ns
            assert_close(_numbers(odom), odometry[loop.time_ns], place)
        if loop.time_ns in limited:
            twist = loop.output("cmd_vel_out").twist
            assert_close(
                (twist.linear.x, twist.linear.y, twist.angular.z),
                limited[loop.time_ns],
                place,
            )

    assert last.header.frame_id == topics["odom"]["frame_id"]
    assert last.child_frame_id == topics["odom"]["child_frame_id"]
    assert_close(last.pose.covariance, topics["odom"]["pose_covariance"])
    (transform,) = loop.output("tf").transforms
    assert_close(
        (transform.transform.translation.x, transform.transform.rotation.z),
        (
            topics["/tf"]["last"]["translation"]["x"],
            topics["/tf"]["last"]["rotation"]["z"],
        ),
    )


def _numbers(odom: Any) -> tuple[float, ...]:
    pose, twist = odom.pose.pose, odom.twist.twist
    return (
        pose.position.x,
        pose.position.y,
        pose.orientation.z,
        pose.orientation.w,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
    )
