"""rosbridge as foreign clients see it: roslibpy, and plain websockets."""

import asyncio
import datetime
import json
import math
import xml.etree.ElementTree as ET
from random import Random
from typing import Any

import cbor2
import pytest
import tornado.httpclient
import tornado.websocket

from arm_drake.rollout.link_poses import multiply, rotate
from tests.wire.served import JTC, port_of, run_client, served, simulation

pytestmark = pytest.mark.slow

SUCCEEDED, CANCELED = 4, 5


@pytest.fixture(scope="module")
def seen() -> dict[str, Any]:
    """What roslibpy saw of a Doosan."""
    with served(simulation()) as server:
        found: dict[str, Any] = run_client("roslibpy_client.py", port_of(server))
    return found


def test_roslibpy_gets_states_as_often_as_they_are_published(
    seen: dict[str, Any],
) -> None:
    counts, spans = seen["counts"], seen["spans"]
    first, last = seen["states"]

    # By the simulated time of what came: 100 and 50 Hz; a busy machine may lose some.
    assert spans["joint_states"] >= 0.9
    assert 0.8 <= counts["joint_states"] / (100.0 * spans["joint_states"] + 1.0) <= 1.01
    assert 0.8 <= counts["tf"] / (50.0 * spans["tf"] + 1.0) <= 1.01
    # At most one every 0.2 s of the wall clock, as was asked for.
    assert 2 <= counts["clock"] <= 5.0 * spans["clock"] + 2.0
    assert first["name"] == [f"joint{index}" for index in range(1, 7)]
    assert len(last["effort"]) == 6
    assert last["header"]["stamp"]["sec"] > first["header"]["stamp"]["sec"]


def test_roslibpy_gets_the_description_that_was_told_before_it_came(
    seen: dict[str, Any],
) -> None:
    [message] = seen["description"]

    assert ET.fromstring(message["data"]).tag == "robot"  # noqa: S314


def test_frames_lead_to_where_the_links_are(seen: dict[str, Any]) -> None:
    # All frames of one instant, from the world to the tool, beside Drake's kinematics.
    import numpy as np

    import arm_drake as ad

    robot = ad.load_robot("doosan_a0912")
    [fixed] = seen["fixed"]
    transforms = {
        each["child_frame_id"]: each
        for each in [*fixed["transforms"], *seen["frames"]["transforms"]]
    }
    position, turn, link = np.zeros(3), np.array([[1.0, 0.0, 0.0, 0.0]]), "link6"
    while link in transforms:
        each = transforms[link]["transform"]
        q = np.array([each["rotation"][axis] for axis in "wxyz"])
        p = np.array([each["translation"][axis] for axis in "xyz"])
        position, turn = p + rotate(q, position), multiply(q[None], turn)
        link = transforms[link]["header"]["frame_id"]

    assert link == "world"
    state = seen["states"][1]
    known = dict(zip(state["name"], state["position"], strict=True))
    expected = ad.forward_kinematics(robot, known, "link6")
    assert position == pytest.approx(expected.translation(), abs=2e-3)


def test_roslibpy_follows_a_goal_to_its_result(seen: dict[str, Any]) -> None:
    reached = seen["reached"]

    assert reached["status"] == SUCCEEDED
    assert reached["values"]["error_code"] == 0
    # 20 Hz for a second.
    assert 10 <= len(reached["feedback"]) <= 25
    assert reached["feedback"][-1]["desired"]["positions"] == pytest.approx(
        [0.2] * 6, abs=0.02
    )


def test_roslibpy_cancels_a_goal(seen: dict[str, Any]) -> None:
    assert seen["cancelled"]["status"] == CANCELED


def test_roslibpy_publishes_a_trajectory(seen: dict[str, Any]) -> None:
    # Half a second after its end.
    assert seen["state"]["feedback"]["positions"] == pytest.approx([-0.1] * 6, abs=1e-3)
    assert seen["state"]["multi_dof_joint_names"] == []


def test_roslibpy_calls_services(seen: dict[str, Any]) -> None:
    rows = {row["name"]: row for row in seen["controllers"]}
    goal_time, joints, missing = seen["parameters"]

    assert rows["joint_trajectory_controller"]["state"] == "active"
    assert rows["joint_trajectory_controller"]["claimed_interfaces"] == [
        f"joint{index}/position" for index in range(1, 7)
    ]
    # rcl_interfaces/msg/ParameterType.
    assert (goal_time["type"], joints["type"], missing["type"]) == (3, 9, 0)
    assert joints["string_array_value"] == [f"joint{index}" for index in range(1, 7)]
    assert seen["param"] == goal_time["double_value"]
    assert seen["switched"] == {"ok": True, "message": ""}


def test_roslibpy_hears_of_a_service_that_is_missing(seen: dict[str, Any]) -> None:
    [error] = seen["errors"]

    assert error.startswith("no service '/no/such'")


def test_roslibpy_lists_what_there_is(seen: dict[str, Any]) -> None:
    assert "/joint_states" in seen["topics"]
    assert seen["topic_type"] == "sensor_msgs/msg/JointState"
    assert "/controller_manager/switch_controller" in seen["services"]
    assert "/joint_trajectory_controller" in seen["nodes"]
    assert seen["time"]["secs"] > 3


class Socket:
    """A websocket that says and hears JSON."""

    def __init__(self, connection: tornado.websocket.WebSocketClientConnection) -> None:
        self._connection = connection

    async def say(self, content: Any) -> None:
        is_raw = isinstance(content, str | bytes)
        data = content if is_raw else json.dumps(content)
        await self._connection.write_message(data, binary=isinstance(data, bytes))

    async def hear(self) -> Any:
        data = await asyncio.wait_for(self._connection.read_message(), 10.0)
        assert data is not None, "the connection is closed"
        return data if isinstance(data, bytes) else json.loads(data)

    async def ask(self, content: Any) -> Any:
        await self.say(content)
        return await self.hear()

    def leave(self) -> None:
        self._connection.close()

    async def close(self) -> None:
        self._connection.close()
        while await self._connection.read_message() is not None:
            pass


async def connect(port: int, **headers: str) -> Socket:
    request = tornado.httpclient.HTTPRequest(
        f"ws://127.0.0.1:{port}", headers=headers or None
    )
    return Socket(await tornado.websocket.websocket_connect(request))


def talk(port: int, conversation: Any, **headers: str) -> Any:
    """Run a conversation over a connection of its own."""

    async def run() -> Any:
        socket = await connect(port, **headers)
        try:
            return await asyncio.wait_for(conversation(socket), 30.0)
        finally:
            await socket.close()

    return asyncio.run(run())


@pytest.fixture(scope="module")
def port() -> Any:
    with served(simulation()) as server:
        yield port_of(server)


MALFORMED: list[tuple[Any, str]] = [
    ("{", "no JSON"),
    ("[1]", "expected an object"),
    (b"\xff\xff", "no CBOR"),
    ("[" * 100_000, "no JSON"),
    ({"op": "fly"}, "unknown op"),
    ({"op": ["publish"]}, "unknown op"),
    ({"op": "publish", "topic": 3, "msg": {}}, "expected topic"),
    ({"op": "publish", "topic": "/nope", "msg": {}}, "no topic '/nope'"),
    ({"op": "publish", "topic": "/joint_states", "msg": {}}, "nobody takes"),
    (
        {"op": "publish", "topic": f"{JTC}/joint_trajectory", "msg": {"joint_name": 1}},
        "did you mean 'joint_names'",
    ),
    (
        {
            "op": "publish",
            "topic": f"{JTC}/joint_trajectory",
            "msg": {"joint_names": "x"},
        },
        "expected a list",
    ),
    (
        {
            "op": "publish",
            "topic": f"{JTC}/joint_trajectory",
            "msg": {"points": [{"positions": ["a"]}]},
        },
        "positions[0]: expected a number",
    ),
    (
        {
            "op": "publish",
            "topic": f"{JTC}/joint_trajectory",
            "msg": {"points": [{"time_from_start": {"sec": 2**40}}]},
        },
        "expected an integer from",
    ),
    ({"op": "subscribe", "topic": "/not/yet"}, "give its type"),
    ({"op": "subscribe", "topic": "/tf", "type": "std_msgs/String"}, "is of type"),
    ({"op": "subscribe", "topic": "/tf", "throttle_rate": -1}, "throttle_rate"),
    ({"op": "subscribe", "topic": "/tf", "compression": "zip"}, "no compression"),
    ({"op": "unsubscribe", "topic": "/tf_static"}, "isn't subscribed"),
    ({"op": "advertise", "topic": "/mine", "type": "a/B"}, "unknown type"),
    ({"op": "set_level", "level": "loud"}, "no level"),
    ({"op": "auth", "mac": "x"}, "no authentication"),
    ({"op": "fragment", "id": "1", "num": 5, "total": 2, "data": ""}, "fragment"),
    ({"op": "png", "data": "AAAA"}, "png"),
    ({"op": "service_response", "service": "/x", "id": "1"}, "nobody waits"),
    ({"op": "cancel_action_goal", "action": "/x", "id": "1"}, "no goal"),
]


@pytest.mark.parametrize(("content", "problem"), MALFORMED)
def test_what_is_malformed_gets_one_answer(
    port: int, content: Any, problem: str
) -> None:
    async def conversation(socket: Socket) -> None:
        answer = await socket.ask(content)

        assert (answer["op"], answer["level"]) == ("status", "error")
        assert problem in answer["msg"]
        # And it goes on.
        again = await socket.ask({"op": "call_service", "service": "/rosapi/nodes"})
        assert again["op"] == "service_response"

    talk(port, conversation)


def test_wrong_arguments_of_a_service_are_its_response(port: int) -> None:
    async def conversation(socket: Socket) -> None:
        call = {"op": "call_service", "id": "7", "args": {"names": 3}}
        answer = await socket.ask({**call, "service": f"{JTC}/get_parameters"})

        assert (answer["id"], answer["result"]) == ("7", False)
        assert "names: expected a list" in answer["values"]

    talk(port, conversation)


def test_a_goal_that_the_controller_refuses_is_a_failed_result(port: int) -> None:
    async def conversation(socket: Socket) -> None:
        names = {"joint_names": ["nope"], "points": [{"positions": [math.pi]}]}
        answer = await socket.ask(
            {
                "op": "send_action_goal",
                "action": f"{JTC}/follow_joint_trajectory",
                "id": "g",
                "args": {"trajectory": names},
            }
        )

        assert (answer["op"], answer["id"]) == ("action_result", "g")
        assert answer["result"] is False
        assert "nope" in answer["values"]

    talk(port, conversation)


@pytest.mark.parametrize(
    ("origin", "is_let_in"),
    [
        ("http://localhost:8000", True),
        ("http://127.0.0.1", True),
        ("https://example.org", False),
        ("http://localhost.example.org", False),
        ("null", False),
    ],
)
def test_pages_of_other_machines_are_not_let_in(
    port: int, origin: str, is_let_in: bool
) -> None:
    async def conversation(socket: Socket) -> str:
        call = {"op": "call_service", "service": "/rosapi/get_ros_version"}
        return str((await socket.ask(call))["values"]["distro"])

    if is_let_in:
        assert talk(port, conversation, Origin=origin) == "jazzy"
    else:
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            talk(port, conversation, Origin=origin)


def test_clients_serve_each_other(port: int) -> None:
    async def run() -> None:
        one, other = await connect(port), await connect(port)
        await one.say({"op": "advertise_service", "service": "/add", "type": "a/Add"})
        await one.ask({"op": "call_service", "service": "/rosapi/nodes"})
        await other.say(
            {"op": "call_service", "service": "/add", "id": "1", "args": {"a": 2}}
        )
        request = await one.hear()
        response = {"op": "service_response", "service": "/add", "result": True}
        await one.say({**response, "id": request["id"], "values": {"sum": 4}})
        answer = await other.hear()
        topic = {"topic": "/chat", "type": "std_msgs/String"}
        await other.say({"op": "subscribe", **topic})
        await other.ask({"op": "call_service", "service": "/rosapi/nodes"})
        await one.say({"op": "publish", **topic, "msg": {"data": "hello"}})
        heard = await other.hear()
        await one.close()
        await other.close()

        assert request["args"] == {"a": 2}
        assert (answer["id"], answer["values"]) == ("1", {"sum": 4})
        assert heard["msg"] == {"data": "hello"}

    asyncio.run(run())


def test_clients_have_actions_for_each_other(port: int) -> None:
    async def conversation(server: Socket) -> None:
        client = await connect(port)
        action = {"action": "/bake", "action_type": "example/Bake"}
        await server.say(
            {"op": "advertise_action", "action": "/bake", "type": "x/Bake"}
        )
        answer = await server.ask({"op": "call_service", "service": "/rosapi/nodes"})
        assert answer["result"] is True
        goal = {"op": "send_action_goal", **action, "args": {"minutes": 3}}
        await client.say({**goal, "id": "1", "feedback": True})
        asked = await server.hear()
        assert (asked["op"], asked["args"]) == ("send_action_goal", {"minutes": 3})

        await server.say(
            {"op": "action_feedback", "id": asked["id"], "values": {"at": 1}}
        )
        feedback = await client.hear()
        await client.say({"op": "cancel_action_goal", "action": "/bake", "id": "1"})
        cancel = await server.hear()
        result = {"op": "action_result", "id": asked["id"], "values": {"done": False}}
        await server.say({**result, "status": CANCELED, "result": True})
        ended = await client.hear()
        # And whose server goes is told so.
        await client.say({**goal, "id": "2"})
        assert (await server.hear())["op"] == "send_action_goal"
        server.leave()
        lost = await client.hear()
        await client.close()

        assert (feedback["op"], feedback["id"]) == ("action_feedback", "1")
        assert feedback["values"] == {"at": 1}
        assert (cancel["op"], cancel["id"]) == ("cancel_action_goal", asked["id"])
        assert (ended["op"], ended["id"], ended["status"]) == ("action_result", "1", 5)
        assert (lost["op"], lost["id"], lost["result"]) == ("action_result", "2", False)
        assert "gone" in lost["values"]

    talk(port, conversation)


def test_every_node_tells_its_parameters(port: int) -> None:
    async def conversation(socket: Socket) -> None:
        call = {"op": "call_service", "service": "/rosapi/services"}
        names = (await socket.ask(call))["values"]["services"]
        lists = [name for name in names if name.endswith("/list_parameters")]
        assert len(lists) >= 3
        for name in lists:
            listed = await socket.ask({"op": "call_service", "service": name})
            assert listed["result"] is True, listed
            wanted = {"names": listed["values"]["result"]["names"]}
            for end in ("get_parameters", "describe_parameters"):
                own = name.replace("list_parameters", end)
                found = await socket.ask(
                    {"op": "call_service", "service": own, "args": wanted}
                )
                assert found["result"] is True, found

    talk(port, conversation)


def test_malformed_cbor_gets_one_answer_each(port: int) -> None:
    random = Random(0)  # noqa: S311
    goal = {"op": "send_action_goal", "action": "/no/such", "id": "g", "args": {}}
    whole = cbor2.dumps({**goal, "args": {"a": [1.0, 2.0]}})
    odd = [
        {**goal, "id": each} for each in (cbor2.undefined, datetime.date(2020, 1, 1))
    ]
    messages = [cbor2.dumps(each) for each in (*odd, {1: 2}, [1], cbor2.undefined)]
    # A list in itself.
    messages.append(bytes.fromhex("d81c81d81d00"))
    for _ in range(300):
        data = bytearray(whole)
        data[random.randrange(len(data))] = random.randrange(256)
        messages.append(bytes(data[: random.randrange(1, len(data) + 1)]))

    async def conversation(socket: Socket) -> None:
        for message in messages:
            answer = await socket.ask(message)
            assert answer["op"] in ("status", "action_result", "service_response")
        answer = await socket.ask({"op": "call_service", "service": "/rosapi/nodes"})
        assert answer["result"] is True

    talk(port, conversation)


def test_a_long_message_comes_in_fragments_or_as_a_picture(port: int) -> None:
    from arm_drake.wire.encodings import Fragments, from_png

    async def conversation(socket: Socket) -> None:
        subscribe = {"op": "subscribe", "topic": "/robot_description"}
        first = await socket.ask({**subscribe, "fragment_size": 3000})
        parts, whole = Fragments(10**6), None
        for number in range(first["total"]):
            part = first if not number else await socket.hear()
            whole = parts.add(part)
        assert whole is not None
        await socket.say({"op": "unsubscribe", "topic": "/robot_description"})
        picture = await socket.ask({**subscribe, "compression": "png"})
        assert picture["op"] == "png"
        text = from_png(picture["data"], 10**6)
        assert json.loads(text) == json.loads(whole)
        assert json.loads(text)["msg"]["data"].startswith("<")

    talk(port, conversation)


def test_a_thousand_malformed_messages_get_as_many_answers(port: int) -> None:
    random = Random(0)  # noqa: S311
    pool = [dict(each) for each, _ in MALFORMED if isinstance(each, dict)]
    pool = [each for each in pool if each.get("op") != "subscribe"]

    def mutated() -> dict[str, Any]:
        content = dict(random.choice(pool))
        values = (None, 1, [], {}, "x", math.nan, True, -1e300, ["a"], {"a": 1})
        content[random.choice(list(content))] = random.choice(values)
        return content

    async def conversation(socket: Socket) -> None:
        # Values that make a message right, such as an id, leave it without an answer.
        messages = [{**mutated(), "op": "fly"} for _ in range(500)]
        messages += [{**mutated(), "op": random.choice(REFUSED)} for _ in range(500)]
        for message in messages:
            answer = await socket.ask(message)
            assert answer["op"] in ("status", "service_response", "action_result")
        answer = await socket.ask({"op": "call_service", "service": "/rosapi/nodes"})
        assert answer["result"] is True

    talk(port, conversation)


# Operations that can't be right with what the messages above have.
REFUSED = (
    "publish",
    "unsubscribe",
    "fragment",
    "png",
    "auth",
    "service_response",
    "cancel_action_goal",
    "send_action_goal",
    "call_service",
    "action_result",
    "advertise",
)
