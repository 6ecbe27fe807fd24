"""Replays what upstream's controllers of mecanum and omni wheels did.

Where there is no reference, upstream meant to stop all wheels of a mecanum base and
wrote to the front left one alone: the others keep what they were told, also in the
recorded `state`. Ours writes 0 to all; upstream's front left one is what is compared.
"""

import math
from typing import Any

import pytest

from arm_drake.errors import ParameterError
from arm_drake.messages import Odometry, TwistStamped
from tests.conformance.open_loop import OpenLoop, is_started, numbers
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("controller_mecanum_omni")
STARTED = [case for case in CASES if is_started(case["output"])]

MESSAGES = {"reference": TwistStamped, "cmd_vel": TwistStamped}

# Topics of odometry and transforms, by the type's name, and our ports.
TOPICS = {
    "MecanumDriveController": ("odometry", "tf_odometry", "tf_odometry"),
    "OmniWheelDriveController": ("odom", "/tf", "tf"),
}

# Fields of controller_state that are numbers.
WHEELS = (
    "front_left_wheel_velocity",
    "front_right_wheel_velocity",
    "back_right_wheel_velocity",
    "back_left_wheel_velocity",
)


def row_of(odometry: Odometry) -> list[float]:
    pose, twist = odometry.pose.pose, odometry.twist.twist
    return [
        odometry.header.stamp.to_nanoseconds(),
        pose.position.x,
        pose.position.y,
        pose.orientation.z,
        pose.orientation.w,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
    ]


def reference_of(state: dict[str, Any]) -> list[float]:
    twist = state["reference_velocity"]
    return [twist["linear"]["x"], twist["linear"]["y"], twist["angular"]["z"]]


def stamp_of(state: dict[str, Any]) -> int:
    stamp = state["header"]["stamp"]
    return int(stamp["sec"] * 10**9 + stamp["nanosec"])


class Published:
    """What upstream published, by time [ns]."""

    def __init__(self, case: dict[str, Any], odometry: str) -> None:
        topics = numbers(case["output"]["published"])
        self.odometry = topics[odometry]
        self.rows = {row[0]: row for row in self.odometry["rows"]}
        self.states = {stamp_of(s): s for s in topics.get("controller_state", ())}


def check_odometry(loop: OpenLoop, port: str, published: Published) -> None:
    odometry = loop.output(port)
    row = published.rows.get(loop.time_ns)
    if row is None:  # The last one is still there.
        assert odometry.header.stamp.to_nanoseconds() != loop.time_ns
        return
    assert_close(row_of(odometry), row)
    assert odometry.header.frame_id == published.odometry["frame_id"]
    assert odometry.child_frame_id == published.odometry["child_frame_id"]
    assert_close(odometry.pose.covariance, published.odometry["pose_covariance"])
    assert_close(odometry.twist.covariance, published.odometry["twist_covariance"])


def check_transform(loop: OpenLoop, port: str, odometry: Odometry) -> None:
    (transform,) = loop.output(port).transforms
    position, pose = odometry.pose.pose.position, transform.transform.translation
    assert transform.header == odometry.header
    assert transform.child_frame_id == odometry.child_frame_id
    assert (pose.x, pose.y, pose.z) == (position.x, position.y, 0.0)
    assert transform.transform.rotation == odometry.pose.pose.orientation


def check_state(loop: OpenLoop, expected: dict[str, Any]) -> None:
    state = loop.output("controller_state")
    assert state.header.stamp.to_nanoseconds() == loop.time_ns
    assert state.header.frame_id == expected["header"]["frame_id"]
    assert_close(
        [getattr(state, name) for name in WHEELS], [expected[name] for name in WHEELS]
    )
    twist = state.reference_velocity
    requested = [twist.linear.x, twist.linear.y, twist.angular.z]
    assert_close(requested, reference_of(expected))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["input"]["name"])
def test_commands_and_topics_are_upstream_s(case: dict[str, Any]) -> None:
    expected = case["output"]
    if not is_started(expected):
        with pytest.raises(ParameterError):
            OpenLoop(case["input"], expected, messages=MESSAGES)
        return
    loop = OpenLoop(case["input"], expected, messages=MESSAGES)
    type_name = case["input"]["controller"].split("::")[1]
    is_mecanum = type_name == "MecanumDriveController"
    odometry, _, transform = TOPICS[type_name]
    published = Published(case, odometry)
    num_rows = num_states = 0

    for cycle in loop.cycles():
        what, command = f"cycle {cycle}", numbers(expected["command"][cycle])
        assert loop.update_return == loop.expected_return(cycle), what
        if is_mecanum:
            # NaN, which upstream writes at the end, leaves our interfaces as they are.
            ours, state = loop.tick.command, published.states.get(loop.time_ns)
            if state and any(map(math.isnan, reference_of(state))):
                assert ours.tolist() == [0.0] * 4, what
                assert command[0] == 0.0, what
            else:
                assert_close(ours, command, what)
            assert (state is None) == (loop.update_return == "inactive"), what
            if state:
                check_state(loop, state)
                num_states += 1
        else:
            assert_close(loop.command, command, what)
            # What asks for the wheels' velocities is kept, as upstream's interfaces.
            assert_close(
                loop.tick.state.reference, numbers(expected["reference"][cycle]), what
            )
        check_odometry(loop, odometry, published)
        if loop.time_ns in published.rows:
            check_transform(loop, transform, loop.output(odometry))
            num_rows += 1

    assert num_rows == len(published.rows) > 0
    assert num_states == len(published.states)
    system = loop.system
    assert system.command_interfaces == tuple(expected["command_interfaces"])
    assert system.state_interfaces == tuple(expected["state_interfaces"])
    assert system.reference_interfaces == tuple(expected["reference_interfaces"])
    assert system.exported_interfaces == tuple(expected["exported_state_interfaces"])


@pytest.mark.parametrize("case", STARTED, ids=lambda case: case["input"]["name"])
def test_the_last_transform_is_upstream_s(case: dict[str, Any]) -> None:
    expected = case["output"]
    loop = OpenLoop(case["input"], expected, messages=MESSAGES)
    type_name = case["input"]["controller"].split("::")[1]
    _, topic, port = TOPICS[type_name]
    wanted = numbers(expected["published"][topic])

    stamps = set()
    for _ in loop.cycles():
        stamps |= {t.header.stamp for t in loop.output(port).transforms}

    (last,) = loop.output(port).transforms
    assert len(stamps) == wanted["count"]
    assert last.header.frame_id == wanted["frame_id"]
    assert last.child_frame_id == wanted["child_frame_id"]
    for part, inputs in wanted["last"].items():
        ours = [getattr(getattr(last.transform, part), axis) for axis in inputs]
        assert_close(ours, list(inputs.values()), part)
