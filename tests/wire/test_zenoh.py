"""Zenoh as rmw_zenoh speaks it, by a session of its own and by zenoh-ros2-sdk."""

import struct
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh
import zenoh.ext

from arm_drake.wire.server import RosServer
from arm_drake.wire.types import load_wire_types
from tests.wire.served import (
    DOOSAN_JOINTS,
    JTC,
    port_of,
    run_zenoh_peer,
    served,
    simulation,
    wait_for,
)

pytestmark = pytest.mark.slow

ATTACHMENT = struct.Struct("<qqB16s")
ACTION = f"{JTC}/follow_joint_trajectory/_action"
GID = bytes(range(16))
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


@pytest.fixture(scope="module")
def server() -> Iterator[RosServer]:
    with served(simulation(), "zenoh:0", domain=3) as server:
        yield server


@pytest.fixture(scope="module")
def session(server: RosServer) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    endpoint = f'["tcp/127.0.0.1:{port_of(server, "zenoh")}"]'
    config.insert_json5("connect/endpoints", endpoint)
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    yield session
    session.close()


def key(server: RosServer, name: str, type_: str) -> str:
    package, kind, own = type_.split("/")
    return f"3{name}/{package}::{kind}::dds_::{own}_/{server.types.hash(type_)}"


def call(
    server: RosServer, session: zenoh.Session, name: str, type_: str, request: Any
) -> Any:
    """Call a service as rmw_zenoh does; return its response."""
    data = server.types.encode(f"{type_}_Request", request)
    attachment = ATTACHMENT.pack(41, 0, 16, GID)
    [reply] = session.get(
        key(server, name, type_), payload=data, attachment=attachment, timeout=20.0
    )
    assert reply.ok is not None, reply.err
    sequence, _, size, gid = ATTACHMENT.unpack(bytes(reply.ok.attachment))
    assert (sequence, size, gid) == (41, 16, GID)
    return server.types.decode(f"{type_}_Response", bytes(reply.ok.payload))


def test_the_graph_is_told_as_ros2_topic_list_reads_it(
    server: RosServer, session: zenoh.Session
) -> None:
    found = [
        str(reply.ok.key_expr).split("/")
        for reply in session.liveliness().get("@ros2_lv/3/**")
        if reply.ok is not None
    ]
    kinds = {parts[5] for parts in found}
    [states] = [p for p in found if p[5] == "MP" and p[9] == "%joint_states"]
    [description] = [p for p in found if p[5] == "MP" and p[9] == "%robot_description"]

    assert kinds == {"NN", "MP", "MS", "SS"}
    assert states[2] == found[0][2]
    assert states[6:9] == ["%", "%", "joint_state_broadcaster"]
    assert states[10] == "sensor_msgs::msg::dds_::JointState_"
    # As `ros2 topic info --verbose` prints it.
    assert states[11].startswith("RIHS01_a13ee3a3")
    assert (states[12], description[12]) == ("::,10:,:,:,,", ":1:,1:,:,:,,")
    assert {p[8] for p in found if p[5] == "NN"} >= {"controller_manager", "gazebo"}


def test_messages_are_cdr_with_an_attachment(
    server: RosServer, session: zenoh.Session
) -> None:
    samples: list[zenoh.Sample] = []
    name, type_ = "/joint_states", "sensor_msgs/msg/JointState"
    subscriber = session.declare_subscriber(key(server, name, type_), samples.append)
    wait_for(lambda: len(samples) > 20)
    subscriber.undeclare()
    message = server.types.decode(type_, bytes(samples[-1].payload))
    numbers = [ATTACHMENT.unpack(bytes(each.attachment)) for each in samples]

    assert bytes(samples[0].payload)[:4] == b"\0\1\0\0"
    assert message["name"] == DOOSAN_JOINTS
    assert [each[0] for each in numbers] == list(
        range(numbers[0][0], numbers[0][0] + len(samples))
    )
    assert len({each[3] for each in numbers}) == 1


def test_a_late_subscriber_gets_what_is_latched(
    server: RosServer, session: zenoh.Session
) -> None:
    samples: list[zenoh.Sample] = []
    name, type_ = "/robot_description", "std_msgs/msg/String"
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
    subscriber = zenoh.ext.declare_advanced_subscriber(
        session, key(server, name, type_), samples.append, history=history
    )
    wait_for(lambda: samples)
    subscriber.undeclare()

    assert "<robot" in server.types.decode(type_, bytes(samples[0].payload))["data"]


def test_an_action_is_three_services_and_two_topics(
    server: RosServer, session: zenoh.Session
) -> None:
    type_ = "control_msgs/action/FollowJointTrajectory"
    statuses: list[list[int]] = []
    feedback: list[Any] = []

    def listen(name: str, kind: str, take: Callable[[Any], None]) -> Any:
        def decode(sample: zenoh.Sample) -> None:
            take(server.types.decode(kind, bytes(sample.payload)))

        return session.declare_subscriber(key(server, name, kind), decode)

    kept = [
        listen(
            f"{ACTION}/status",
            "action_msgs/msg/GoalStatusArray",
            lambda m: statuses.append([each["status"] for each in m["status_list"]]),
        ),
        listen(f"{ACTION}/feedback", f"{type_}_FeedbackMessage", feedback.append),
    ]

    def send(target: float, seconds: int) -> dict[str, Any]:
        goal_id = {"uuid": uuid.uuid4().bytes}
        point = {"positions": [target] * 6, "time_from_start": {"sec": seconds}}
        trajectory = {"joint_names": DOOSAN_JOINTS, "points": [point]}
        request = {"goal_id": goal_id, "goal": {"trajectory": trajectory}}
        name = f"{ACTION}/send_goal"
        answer = call(server, session, name, f"{type_}_SendGoal", request)
        assert answer["accepted"] is True
        return goal_id

    def result(goal_id: dict[str, Any]) -> Any:
        request, name = {"goal_id": goal_id}, f"{ACTION}/get_result"
        return call(server, session, name, f"{type_}_GetResult", request)

    reached = result(goal_id := send(0.1, 1))
    moving = send(0.5, 9)
    cancel = {"goal_info": {"goal_id": moving}}
    name, kind = f"{ACTION}/cancel_goal", "action_msgs/srv/CancelGoal"
    answer = call(server, session, name, kind, cancel)
    cancelled = result(moving)
    wait_for(lambda: statuses and statuses[-1] == [4, 5])
    for each in kept:
        each.undeclare()

    assert (reached["status"], reached["result"]["error_code"]) == (4, 0)
    assert feedback[0]["goal_id"]["uuid"] == goal_id["uuid"]
    assert feedback[0]["feedback"]["joint_names"] == DOOSAN_JOINTS
    assert answer["return_code"] == 0
    assert [g["goal_id"] for g in answer["goals_canceling"]] == [moving]
    assert cancelled["status"] == 5
    assert statuses[0] == [2]


def test_bytes_that_mean_nothing_are_dropped(
    server: RosServer, session: zenoh.Session, capfd: pytest.CaptureFixture[str]
) -> None:
    type_ = "trajectory_msgs/msg/JointTrajectory"
    name = key(server, f"{JTC}/joint_trajectory", type_)
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 100, bytes(1000)):
        session.put(name, data)
    wait_for(lambda: "no trajectory_msgs/msg/JointTrajectory" in capfd.readouterr().err)
    listed = call(
        server,
        session,
        "/controller_manager/list_controllers",
        "controller_manager_msgs/srv/ListControllers",
        {},
    )

    assert len(listed["controller"]) == 3


def test_zenoh_ros2_sdk_reads_a_latched_topic_calls_and_publishes() -> None:
    sim = simulation()
    with served(sim, "zenoh:0") as server:
        controller, port = "joint_trajectory_controller", port_of(server, "zenoh")
        seen = run_zenoh_peer("zenoh_sdk_client.py", port, controller, "nope")
        time.sleep(0.1)
        factor = sim.controller(controller).state().speed_scaling_factor

    assert seen["answers"] == [True, False]
    assert len(seen["description"]) == 1
    assert "<robot" in seen["description"][0]
    assert factor == 0.5


def test_zenoh_ros2_sdk_has_goals_followed_and_cancelled() -> None:
    with served(simulation(), "zenoh:0") as server:
        seen = run_zenoh_peer("zenoh_action_client.py", port_of(server, "zenoh"))
    positions = seen["positions"]

    assert seen["accepted"] == [True, False]
    assert seen["reached"] == [SUCCEEDED, 0]
    assert seen["joints"] == DOOSAN_JOINTS
    assert len(positions) > 5
    assert positions == sorted(positions)
    assert positions[0] < 0.05 < positions[-1] <= 0.1 + 2e-3
    assert seen["aborted"] == ABORTED
    # One goal is being cancelled; of one that nobody knows, ERROR_UNKNOWN_GOAL_ID.
    assert (seen["cancel"], seen["cancelled"]) == ([0, 1], CANCELED)
    assert seen["unknown"] == 2
    assert seen["statuses"] == [SUCCEEDED, ABORTED, CANCELED]


# What generated code of ROS 2 and other implementations of the hash have recorded.
RECORDED = {
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e116",
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4b",
    "action_msgs/msg/GoalStatusArray": "6c1684b00f177d37438febe6e709fc4e",
    "action_msgs/srv/CancelGoal": "573d8b0a534451d7bc2ac8c5ffde8ac1",
    "rcl_interfaces/srv/GetParameters": "bf9803d5c74cf989a5de3e0c2e994445",
    "rcl_interfaces/srv/GetParameterTypes": "da199c878688b3e530bdfe3ca8f74cb9",
    "rcl_interfaces/srv/SetParameters": "56eed9a67e169f9cb6c1f987bc88f868",
    "rcl_interfaces/srv/SetParametersAtomically": "0e192ef259c07fc3c07a13191d270022",
    "rcl_interfaces/srv/ListParameters": "3e6062bfbb27bfb8730d4cef2558221f",
    "rcl_interfaces/srv/DescribeParameters": "845b484d71eb0673dae682f2e3ba3c48",
    "control_msgs/msg/MultiDOFCommand": "033fb0fa1ffc63a872ca73c61a49ded8",
    "control_msgs/action/FollowJointTrajectory_Goal": (
        "8a9060704b269608f5a340934cc26e66"
    ),
    "control_msgs/action/FollowJointTrajectory_Result": (
        "8002e99ed2c14c6faa522f2a93c26d74"
    ),
    "control_msgs/action/FollowJointTrajectory_Feedback": (
        "3fd0aaecf71725121ae1ff7f01098a5e"
    ),
    "control_msgs/action/FollowJointTrajectory_SendGoal": (
        "b13789dddc325a7a962825c45e28c77d"
    ),
    "control_msgs/action/FollowJointTrajectory_GetResult": (
        "e3ceb38e3e1867c8dc0f46014df26e90"
    ),
    "controller_manager_msgs/msg/ChainConnection": "2daecd1da4b171f48b291c79747657a6",
    "controller_manager_msgs/msg/ControllerState": "9a8780ab9814b6032978a07c6c7033cf",
    "controller_manager_msgs/srv/ListControllers": "4f8e36bb1fa5afdeba45c2d56ae6a209",
}


@pytest.mark.parametrize("type_", RECORDED)
def test_types_have_the_hashes_that_ros_has_recorded(type_: str) -> None:
    types = load_wire_types("jazzy")

    assert types.hash(type_).startswith(f"RIHS01_{RECORDED[type_]}")


def test_humble_knows_no_hashes_and_later_ones_more_fields() -> None:
    humble, rolling = load_wire_types("humble"), load_wire_types("rolling")
    feedback = "control_msgs/action/FollowJointTrajectory_Feedback"

    assert humble.hash("std_msgs/msg/String") == "TypeHashNotSupported"
    assert "index" not in [name for name, _, _ in humble.fields(feedback)]
    assert "index" in [name for name, _, _ in rolling.fields(feedback)]


def test_where_a_router_is_there_it_is_a_client_of_it(server: RosServer) -> None:
    port = port_of(server, "zenoh")

    with served(simulation(), f"zenoh:{port}", domain=4) as other:
        assert other.addresses[0].endswith("(a router that is there)")
