"""What topics tell, beside the ports that they are read from."""

from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

import arm_drake as ad
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryGoal,
    Header,
    JointState,
    JointTrajectory,
    JointTrajectoryPoint,
)
from arm_drake.simulation.topics import TopicNames
from arm_drake.wire.graph import Topic
from arm_drake.wire.server import RosServer
from arm_drake.wire.types import to_fields
from tests.carts import cart, diff_drive
from tests.carts import load as load_cart
from tests.perception.test_lidar import load_two as load_two_lidars
from tests.wire.served import simulation

STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["doosan_a0912", "teslabot"])
def test_what_is_read_of_a_tick_makes_the_message_of_the_port(robot: str) -> None:
    sim = simulation(robot)
    server = RosServer(sim, ())
    ports = {
        topic.name: (topic.outputs[0], server.graph.topics[topic.name])
        for topic in TopicNames(sim.directory.managers).all()
        if topic.outputs and topic.name in server.graph.topics
    }
    looks = [
        (source, topic)
        for source, topic in ports.values()
        if isinstance(source.system, ControllerInterface)
        and source.system.find_look(source.port)
    ]
    assert {"/joint_states", "/dynamic_joint_states"} <= {t.name for _, t in looks}
    compared = 0
    for tick in range(30):
        if tick == 10:
            for name in next(iter(sim.directory.managers.values())).controllers:
                if name.type.endswith("/JointTrajectoryController"):
                    sim.controller(name.name).send_goal(goal(name))
        sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)
        context = sim.simulator.get_context()
        server.graph.update([topic for _, topic in looks], sim.time)
        later = [(s, t, t.waiting.popleft()) for s, t in looks]
        # What was read isn't touched by ticks that come before it is made.
        expected = [
            sim.diagram.GetOutputPort(s.exported_as(s.port)).Eval(context)
            for s, _ in looks
        ]
        wanted = [to_fields(message) for message in expected]
        sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)
        for (_, topic, value), fields in zip(later, wanted, strict=True):
            made = topic.convert(value, 0)
            if made is not None:
                complete = server.types.complete
                kind, both = topic.type, (made, fields)
                found, port = (repr(complete(kind, each)) for each in both)
                assert found == port, topic.name
                compared += 1
    assert compared >= 2 * 29


def goal(controller: LoadedController) -> FollowJointTrajectoryGoal:
    system = controller.system
    assert system is not None
    names = tuple(name.rpartition("/")[0] for name in system.command_interfaces)
    point = JointTrajectoryPoint(
        (0.1,) * len(names), time_from_start=Duration(0, 2 * 10**8)
    )
    return FollowJointTrajectoryGoal(
        JointTrajectory(joint_names=names, points=(point,))
    )


@pytest.mark.slow
def test_a_camera_takes_pictures_when_somebody_listens() -> None:
    where = (1.5, 0.0, 1.0, 0.0, 0.4, 3.14)
    robot = ad.add_camera(
        ad.load_robot("doosan_a0912"), "world", where, width=32, height=24
    )
    sim = ad.Simulation(ad.build_diagram(robot))
    server = RosServer(sim, ())
    [camera] = next(iter(sim.directory.managers.values())).sensors
    names = [f"/camera/{end}" for end in ("image", "depth_image", "camera_info")]
    topics = [server.graph.topics[name] for name in names]

    def simulate(seconds: float, watched: list[Topic]) -> None:
        end = sim.time + seconds
        while sim.time < end - 1e-6:
            server.graph.update(watched, sim.time)
            sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)

    simulate(0.1, [server.graph.topics["/joint_states"]])
    assert not camera.scenery.is_loaded
    simulate(1.0, topics)

    image, depth, info = (t.convert(t.waiting[-1], 0) for t in topics)
    # It is so often on average, at ticks of 100 Hz.
    assert [len(topic.waiting) for topic in topics] == [pytest.approx(30, abs=1)] * 3
    assert image is not None
    assert depth is not None
    assert info is not None
    seen = sim.camera("camera")
    assert image["data"] == seen.color().tobytes()
    assert depth["data"] == seen.depth().astype("<f4").tobytes()
    assert (info["width"], info["height"]) == (32, 24)
    kind = "sensor_msgs/msg/Image"
    found: Any = STORE.deserialize_cdr(server.types.encode(kind, image), kind)
    assert (found.encoding, found.data.tobytes()) == ("rgb8", image["data"])


@pytest.mark.slow
def test_sensors_that_share_a_topic_are_all_told_on_it() -> None:
    sim = ad.Simulation(ad.build_diagram(load_two_lidars()))
    server = RosServer(sim, ())
    topic = server.graph.topics["/scan"]

    for _ in range(2):
        server.graph.update([topic], sim.time)

    told = [topic.convert(message, 0) for message in topic.waiting]
    frames = [message["header"]["frame_id"] for message in told if message]
    assert frames == ["r/eye/front", "r/eye/rear"]
    assert {"/front", "/rear"} <= set(server.graph.nodes())


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "told"), [(0.0, 3), (0.5, 1)])
def test_a_message_with_the_stamp_of_the_last_one_is_told_once(
    seconds: float, told: int
) -> None:
    positions = iter([1.0, 2.0, 3.0])

    def read(context: object) -> JointState:
        return JointState(Header(seconds), ["a"], [next(positions)])

    topic = Topic("/states", "sensor_msgs/msg/JointState", "someone", read=read)
    for tick in range(3):
        topic.update(None, 0.1 * tick)

    assert len(topic.waiting) == told


def test_what_happens_is_told_in_words_and_who_is_active() -> None:
    sim = simulation()
    server = RosServer(sim, ())
    activity = server.graph.topics["/controller_manager/activity"]

    def active() -> dict[str, str]:
        server.graph.update([activity], sim.time)
        message = activity.convert(activity.waiting[-1], 0)
        assert message is not None
        rows = message["controllers"]
        return {row["name"]: row["state"]["label"] for row in rows}

    sim.advance_to(0.1)
    before = active()
    sim.switch_controllers(deactivate=["joint_trajectory_controller"])
    sim.advance_to(0.6)
    after = active()
    sim.controller("joint_trajectory_controller").send_goal(
        FollowJointTrajectoryGoal(JointTrajectory())
    )
    sim.advance_to(1.2)

    assert len(activity.waiting) == 2
    assert before["joint_trajectory_controller"] == "active"
    assert after["joint_trajectory_controller"] == "inactive"
    rosout = server.graph.rosout
    lines = [rosout.convert(line, 0) for line in rosout.waiting]
    # rcl_interfaces/msg/Log.
    assert [line and line["level"] for line in lines][-1] == 40
    assert "REJECTED" in str(lines[-1])


@pytest.mark.slow
def test_contact_forces_are_topics_where_they_are_logged(tmp_path: Path) -> None:
    robot = load_cart(tmp_path, cart(diff_drive()))
    options = ad.SimulationOptions(log_contacts=True)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    server = RosServer(sim, ())
    prefix = "/arm_drake/contact_force/"
    topics = [t for name, t in server.graph.topics.items() if prefix in name]
    sim.advance_to(1.0)

    server.graph.update(topics, sim.time)

    messages = [topic.convert(topic.waiting[-1], 0) for topic in topics]
    held = sum(m["wrench"]["force"]["z"] for m in messages if m is not None)
    # It neither rises nor sinks: 6.2 kg.
    assert held == pytest.approx(6.2 * 9.81, abs=6.2e-3)
