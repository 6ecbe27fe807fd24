"""Time, determinism, and that nobody outside can stop a simulation."""

import asyncio
import dataclasses as dc
import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError, OutputError
from arm_drake.rollout.rollout import ClientInput
from arm_drake.wire.server import MAX_REQUESTS, Request, RosServer, run
from tests.wire.served import (
    DOOSAN_JOINTS,
    JTC,
    port_of,
    run_client,
    served,
    simulation,
    wait_for,
)
from tests.wire.test_rosbridge import Socket, connect, talk

pytestmark = pytest.mark.slow


def call(service: str, **args: Any) -> dict[str, Any]:
    return {"op": "call_service", "service": service, "args": args}


def trajectory(target: float, seconds: float) -> dict[str, Any]:
    nanoseconds = round(1e9 * seconds)
    sec, nanosec = divmod(nanoseconds, 10**9)
    point = {
        "positions": [target] * 6,
        "time_from_start": {"sec": sec, "nanosec": nanosec},
    }
    return {"joint_names": DOOSAN_JOINTS, "points": [point]}


def test_a_run_without_ros_imports_nothing_of_it() -> None:
    program = """
        import sys
        from arm_drake.cli import main
        main(["sim", "doosan_a0912", "--headless", "--duration", "0.1", "--json"])
        found = [name for name in sys.modules if name.startswith("arm_drake.wire")]
        print(found, [n for n in ("rosbags", "tornado", "cbor2") if n in sys.modules])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )

    assert done.stdout.splitlines()[-1] == "[] []"


def test_services_answer_while_it_is_paused_and_time_stands() -> None:
    with served(simulation()) as server:

        async def conversation(socket: Socket) -> None:
            await socket.ask(call("/pause"))
            await socket.say({"op": "subscribe", "topic": "/clock"})
            before = server.simulation.time
            states = await socket.ask(call("/controller_manager/list_controllers"))
            switch = await socket.ask(
                call(
                    "/controller_manager/switch_controller",
                    deactivate_controllers=["joint_trajectory_controller"],
                    timeout={"sec": 0, "nanosec": 200_000_000},
                )
            )
            assert states["values"]["controller"][0]["state"] == "active"
            # No cycle came in which it could have been done.
            assert switch["values"]["ok"] is False
            assert "time is up" in switch["values"]["message"]
            assert server.simulation.time == before
            await socket.say(call("/play"))
            answers = [await socket.hear() for _ in range(3)]
            assert {answer["op"] for answer in answers} == {
                "publish",
                "service_response",
            }
            assert server.simulation.time > before

        talk(port_of(server), conversation)


@pytest.mark.parametrize("keep_clock", [True, False])
def test_the_clock_grows_after_a_reset_unless_asked_otherwise(
    keep_clock: bool,
) -> None:
    with served(simulation(), keep_clock=keep_clock, rate=0.0) as server:

        async def conversation(socket: Socket) -> None:
            wait_for(lambda: server.simulation.time > 2.0)
            await socket.ask(call("/reset"))
            await socket.say({"op": "subscribe", "topic": "/joint_states"})
            stamp = (await socket.hear())["msg"]["header"]["stamp"]
            assert (stamp["sec"] >= 2) is keep_clock
            assert len(server.simulation.goals) == 0

        talk(port_of(server), conversation)


def test_a_reset_ends_goals() -> None:
    with served(simulation()) as server:

        async def conversation(socket: Socket) -> None:
            goal = {"trajectory": trajectory(0.5, 9.0)}
            action = f"{JTC}/follow_joint_trajectory"
            content = {"op": "send_action_goal", "action": action, "args": goal}
            await socket.say({**content, "id": "1"})
            wait_for(lambda: server.simulation.goals)
            await socket.say(call("/reset"))
            answers = {a["op"]: a for a in [await socket.hear(), await socket.hear()]}
            assert answers["action_result"]["status"] == 6

        talk(port_of(server), conversation)


def run_with_client(path: Path) -> None:
    """Record a run in which a client does all that changes something."""
    sim = simulation()
    recorder = sim.record_to(path)
    with served(sim, rate=0.0) as server:

        async def conversation(socket: Socket) -> None:
            topic = {"op": "publish", "topic": f"{JTC}/joint_trajectory"}
            await socket.say({**topic, "msg": trajectory(0.3, 0.7)})
            now = server.simulation.time
            wait_for(lambda: server.simulation.time > now + 0.4)
            goal = {"trajectory": trajectory(-0.2, 1.0)}
            action = f"{JTC}/follow_joint_trajectory"
            content = {"op": "send_action_goal", "action": action, "args": goal}
            await socket.say({**content, "id": "1"})
            wait_for(lambda: server.simulation.time > now + 0.9)
            cancel = {"op": "cancel_action_goal", "action": action, "id": "1"}
            await socket.ask(cancel)
            value = {"type": 3, "double_value": 3.0}
            parameter = {"name": "constraints.goal_time", "value": value}
            answer = await socket.ask(
                call(f"{JTC}/set_parameters", parameters=[parameter])
            )
            assert answer["values"]["results"] == [{"successful": True, "reason": ""}]
            await socket.ask(
                call(
                    "/controller_manager/switch_controller",
                    deactivate_controllers=["joint_trajectory_controller"],
                    strictness=2,
                )
            )

        talk(port_of(server), conversation)
    recorder.close()


def test_what_came_in_is_logged_and_gives_the_same_bits_again(tmp_path: Path) -> None:
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    run_with_client(first)
    recorded = ad.Rollout.load(first)

    sim = simulation()
    recorder = sim.record_to(second)
    duration = recorded.time[-1] + 0.05
    run(RosServer(sim, (), inputs=recorded.inputs), duration, realtime_rate=0.0)
    recorder.close()
    again = ad.Rollout.load(second)

    kinds = [each.kind for each in recorded.inputs]
    assert kinds == ["publish", "goal", "cancel", "call", "call"]
    assert all(each.sender.startswith("rosbridge 127") for each in recorded.inputs)
    assert again.inputs == recorded.inputs
    rows = len(recorded.time)
    assert len(again.time) >= rows
    np.testing.assert_array_equal(again.position[:rows], recorded.position[:rows])
    np.testing.assert_array_equal(again.effort[:rows], recorded.effort[:rows])
    assert np.abs(recorded.position).max() > 0.05
    assert [goal.status for goal in again.goals] == ["CANCELED"]


def test_inputs_survive_every_kind_of_log(tmp_path: Path) -> None:
    sim = simulation()
    each = ClientInput(0.0, "publish", "/x", "me", {"data": 1.0})
    sim.mailbox.inputs.append(each)
    sim.advance_to(0.05)
    for name in ("a.npz", "a.mcap"):
        sim.rollout().save(tmp_path / name)
        assert ad.Rollout.load(tmp_path / name).inputs == (each,)


def test_more_requests_than_can_wait_are_refused() -> None:
    server = RosServer(simulation(), ())
    for _ in range(MAX_REQUESTS):
        server.submit(Request("call", "/pause", {}, "me"))

    with pytest.raises(InputError, match="requests wait"):
        server.submit(Request("call", "/pause", {}, "me"))


def test_what_waits_to_be_read_is_bounded(capsys: pytest.CaptureFixture[str]) -> None:
    server = RosServer(simulation(), ())
    done: list[int] = []

    def post() -> int:
        # As many as there is room for, whatever else is done.
        return sum(server.post(lambda: done.append(1), 10**7) for _ in range(20))

    first = post()
    server._poll()
    again = post()

    assert first == again == len(done) == 6
    assert "some of it is dropped" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("transports", "problem"),
    [
        ("rosbrige", "did you mean 'rosbridge'"),
        ("rosbridge:x", "expected a port"),
        ("rosbridge:70000", "expected a port"),
    ],
)
def test_transports_that_there_are_not(transports: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        RosServer(simulation(), transports)


def test_a_port_that_is_taken_is_one_message() -> None:
    with served(simulation()) as server:
        port = port_of(server)
        with pytest.raises(OutputError, match="can't listen"):
            RosServer(simulation(), f"rosbridge:{port}").start()


LISTENER = """
import asyncio, json, sys, tornado.websocket
async def main(port):
    url = f"ws://127.0.0.1:{port}"
    client = await tornado.websocket.websocket_connect(url)
    for topic in ("/joint_states", "/tf", "/robot_description"):
        await client.write_message(json.dumps({"op": "subscribe", "topic": topic}))
    print("ready", flush=True)
    while await client.read_message() is not None:
        pass
asyncio.run(main(int(sys.argv[1])))
"""


def test_a_client_that_stands_still_stops_nobody() -> None:
    with served(simulation(), rate=0.0) as server:
        client = subprocess.Popen(
            [sys.executable, "-c", LISTENER, str(port_of(server))],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert client.stdout is not None
        assert client.stdout.readline() == "ready\n"
        os.kill(client.pid, signal.SIGSTOP)
        start = server.simulation.time
        try:
            wait_for(lambda: server.simulation.time > start + 5.0)

            async def conversation(socket: Socket) -> Any:
                return await socket.ask(call("/controller_manager/list_controllers"))

            answer = talk(port_of(server), conversation)
        finally:
            client.kill()
            client.wait()
            client.stdout.close()

        assert answer["result"] is True


def test_clients_come_and_go() -> None:
    with served(simulation()) as server:
        port = port_of(server)
        [bridge] = server._transports

        async def visit() -> None:
            socket = await connect(port)
            await socket.say({"op": "subscribe", "topic": "/joint_states"})
            await socket.hear()
            await socket.close()

        async def all_of_them() -> None:
            await asyncio.gather(*(visit() for _ in range(20)))

        asyncio.run(all_of_them())
        wait_for(lambda: not bridge.clients)  # type: ignore[attr-defined]
        # But for what is kept for late listeners.
        wait_for(lambda: all(t.qos.is_latched for t in server._watched))
        assert server.simulation.time > 0.0


def test_twenty_clients_of_roslibpy_come_and_go() -> None:
    with served(simulation()) as server:
        [bridge] = server._transports
        counts = run_client("roslibpy_visits.py", port_of(server))
        now = server.simulation.time

        assert len(counts) == 20
        assert min(counts) > 0
        wait_for(lambda: not bridge.clients)  # type: ignore[attr-defined]
        wait_for(lambda: all(t.qos.is_latched for t in server._watched))
        wait_for(lambda: server.simulation.time > now)


@pytest.mark.long
@pytest.mark.slow
def test_two_clients_get_a_thousand_states_a_second_of_thirty_joints(
    tmp_path: Path,
) -> None:
    names = [f"j{index}" for index in range(30)]
    links = "".join(f'<link name="l{index}"/>' for index in range(31))
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial>'
    )
    links = links.replace('"/>', f'">{inertial}</link>')
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l0"/>'
        f'<child link="l{index + 1}"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
        for index, name in enumerate(names)
    )
    control = "".join(
        f'<joint name="{name}"><command_interface name="position"/>'
        '<state_interface name="position"/><state_interface name="velocity"/></joint>'
        for name in names
    )
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(
        f'<robot name="many">{links}{joints}<ros2_control name="h" type="system">'
        "<hardware><plugin>mock_components/GenericSystem</plugin></hardware>"
        f"{control}</ros2_control></robot>"
    )
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(
        json.dumps(
            {
                "controller_manager": {
                    "ros__parameters": {
                        "update_rate": 1000,
                        "jsb": {
                            "type": "joint_state_broadcaster/JointStateBroadcaster"
                        },
                    }
                }
            }
        )
    )
    robot = ad.load_robot(urdf, controllers=[yaml])
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    counts = [0, 0]

    def listen(index: int, port: int, stop: threading.Event) -> None:
        async def conversation(socket: Socket) -> None:
            await socket.say({"op": "subscribe", "topic": "/joint_states"})
            while not stop.is_set():
                await socket._connection.read_message()
                counts[index] += 1

        talk(port, conversation)

    with served(sim) as server:
        stop = threading.Event()
        threads = [
            threading.Thread(target=listen, args=(index, port_of(server), stop))
            for index in range(2)
        ]
        for thread in threads:
            thread.start()
        wait_for(lambda: min(counts) > 100)
        first, start = sim.time, list(counts)
        time.sleep(1.0)
        passed = sim.time - first
        rates = [
            (end - begin) / passed for begin, end in zip(start, counts, strict=True)
        ]
        stop.set()
        for thread in threads:
            thread.join()

    # Of what was told while it ran: a busy machine runs slower, and drops no more.
    assert min(rates) >= 900.0


def test_things_are_put_where_a_client_wants_them(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "robots:\n- {robot: doosan_a0912}\nthings:\n"
        "- {name: ball, sphere: 0.05, mass: 0.1, pose: [0.9, 0, 0.5]}\n"
    )
    sim = ad.Simulation(ad.build_diagram(ad.load_scene(scene)))
    server = RosServer(sim, ())
    answers: list[Any] = []
    pose = {"position": {"x": 2.0, "y": 1.0, "z": 3.0}}
    state = {"name": "ball", "pose": pose, "twist": {"linear": {"x": 1.0}}}
    types = server.types
    server._post = lambda act: act()  # type: ignore[method-assign]
    for name, request in (
        ("SetEntityState", {"state": state}),
        ("GetEntityState", {"name": "ball"}),
        ("SetEntityState", {"state": {**state, "name": "bull"}}),
    ):
        type_ = f"gazebo_msgs/srv/{name}_Request"
        path = "/set_entity_state" if name.startswith("Set") else "/get_entity_state"
        fields = types.fill(type_, request)
        server.submit(
            Request("call", path, fields, "me", "", answers.append, answers.append)
        )
    server.exchange()
    sim.advance_to(0.5)

    assert answers[0] == {"success": True}
    assert answers[1]["state"]["pose"]["position"] == {"x": 2.0, "y": 1.0, "z": 3.0}
    assert answers[1]["state"]["twist"]["linear"]["x"] == 1.0
    assert "did you mean 'ball'" in answers[2]
    # It falls freely meanwhile, half a meter ahead.
    x, _, z = _position_of(sim, "ball")
    assert (x, z) == pytest.approx((2.5, 3.0 - 0.5 * 9.81 * 0.25), abs=5e-3)


def _position_of(sim: ad.Simulation, name: str) -> Any:
    context = sim.plant.GetMyContextFromRoot(sim.context)
    body = sim.plant.GetBodyByName(name)
    return sim.plant.EvalBodyPoseInWorld(context, body).translation()


def test_a_slip_in_a_service_is_its_answer_and_no_end() -> None:
    server = RosServer(simulation(), ())
    answers: list[Any] = []
    server._post = lambda act: act()  # type: ignore[method-assign]
    service = server.graph.services["/pause"]

    def fail(call: Any) -> None:
        raise KeyError("oops")

    server.graph.services["/pause"] = dc.replace(service, call=fail)
    server.submit(Request("call", "/pause", {}, "me", refuse=answers.append))
    server.exchange()

    assert answers == ["it can't be done (KeyError: 'oops')"]
