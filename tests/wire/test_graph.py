"""Messages of topics, beside the ports that they are read from."""

import dataclasses as dc
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

import arm_drake as ad
from arm_drake.controllers import ControllerType
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryGoal,
    Header,
    JointState,
    JointTrajectory,
    JointTrajectoryPoint,
    Message,
)
from arm_drake.rollout.rollout import ClientInput
from arm_drake.simulation.topics import TopicNames
from arm_drake.wire.graph import SIMULATOR, Call, Graph, Topic
from arm_drake.wire.server import RosServer, run
from arm_drake.wire.types import to_fields
from tests import models
from tests.carts import cart, diff_drive
from tests.carts import load as load_cart
from tests.perception.test_lidar import load_two as load_two_lidars
from tests.rollouts.test_several_robots import cart as plain_cart
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


@dc.dataclass(frozen=True)
class Level(Message, ros="std_msgs/msg/UInt8"):
    """A message that ROS has and arm_drake hasn't."""

    data: int = 7


@dc.dataclass(frozen=True)
class Secret(Message, ros="my_msgs"):
    """A message whose type nobody else knows."""


@dc.dataclass(frozen=True)
class NoParameters:
    """Parameters of a Teller: none."""


class Teller(TickingController[None]):
    """Publishes messages of a plugin's own."""

    def __init__(self, parameters: object, params: ControllerInterfaceParams) -> None:
        super().__init__(params, None)
        self._declare_topic("level", lambda state: Level(), default=Level())
        self._declare_topic("secret", lambda state: Secret(), default=Secret())

    def _update(self, now: UpdateContext, state: None) -> None:
        return None


def test_messages_of_a_plugin_are_told_if_their_type_is_known(tmp_path: Path) -> None:
    yaml = "controller_manager: {ros__parameters: {update_rate: 100, own: {type: T}}}"
    types = {"T": ControllerType(NoParameters, Teller)}
    robot = models.load(tmp_path, models.TWO_LINKS, yaml, controller_types=types)
    sim = ad.Simulation(ad.build_diagram(robot))

    graph = RosServer(sim, ()).graph
    graph.update([graph.topics["/own/level"]], 0.0)

    level = graph.topics["/own/level"]
    assert level.type == "std_msgs/msg/UInt8"
    assert level.convert(level.waiting.popleft(), 0) == {"data": 7}
    assert graph.left_out == ["/own/secret"]


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


PLUGIN = """
  <gazebo><plugin filename="libgazebo_ros2_control.so" name="control">
    <ros><namespace>/tg</namespace></ros></plugin></gazebo>"""
STATES = """
  <gazebo><plugin filename="libgazebo_ros_joint_state_publisher.so" name="states">
    <ros><namespace>tg</namespace><remapping>joint_states:=seen</remapping></ros>
    <joint_name>elbow</joint_name></plugin></gazebo>"""

CONTROLLERS = """
controller_manager:
  ros__parameters:
    joint_trajectory_controller:
      type: joint_trajectory_controller/JointTrajectoryController
    BROADCASTER
joint_trajectory_controller:
  ros__parameters:
    joints: [shoulder]
    command_interfaces: [position]
    state_interfaces: [position]
"""


BROADCASTER = """
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}"""


def graph_of(
    folder: Path, *blocks: str, broadcaster: str = BROADCASTER, **more: Any
) -> Graph:
    """Return the graph of an arm with these blocks in its description."""
    controllers = CONTROLLERS.replace("BROADCASTER", broadcaster)
    urdf = models.TWO_LINKS.replace("</robot>", "".join(blocks) + "</robot>")
    robot = models.load(folder, urdf, controllers, **more)
    options = ad.SimulationOptions(log_contacts=True)
    diagram = ad.build_diagram(robot, options=options)
    return RosServer(ad.Simulation(diagram), ()).graph


@pytest.mark.parametrize("broadcaster", [BROADCASTER, ""])
@pytest.mark.parametrize("is_tag", [True, False])
def test_alone_a_robot_has_its_name_space_in_front(
    tmp_path: Path, is_tag: bool, broadcaster: str
) -> None:
    more = {} if is_tag else {"namespace": "tg"}
    for name in ("named", "plain"):
        (tmp_path / name).mkdir()
    blocks = (PLUGIN,) if is_tag else ()

    named = graph_of(tmp_path / "named", *blocks, broadcaster=broadcaster, **more)

    plain = graph_of(tmp_path / "plain", broadcaster=broadcaster)
    # tf2's topics are absolute, and these are of no robot.
    own = {"/tf", "/tf_static", "/clock", "/rosout"}
    assert set(named.topics) == own | {f"/tg{n}" for n in set(plain.topics) - own}
    assert "/tg/joint_states" in named.topics
    assert "/tg/robot_description" in named.topics
    assert "/tg/controller_manager/activity" in named.topics
    assert "/tg/arm_drake/contact_force/upper" in named.topics
    assert set(named.actions) == {f"/tg{name}" for name in plain.actions}
    action = "/tg/joint_trajectory_controller/follow_joint_trajectory"
    assert named.actions[action].node == "/tg/joint_trajectory_controller"
    # What plans for a hand has the robot's name in front, as in its own package.
    others = {SIMULATOR, "/two_links/kinematics_server"}
    nodes = set(plain.nodes()) - others
    assert nodes == {
        *("/controller_manager", "/joint_trajectory_controller"),
        *(["/joint_state_broadcaster"] if broadcaster else []),
        "/robot_state_publisher",
    }
    assert set(named.nodes()) == others | {f"/tg{name}" for name in nodes}
    of_nodes = {s.name for s in plain.services.values() if s.node in nodes}
    rest = set(plain.services) - of_nodes
    assert set(named.services) == rest | {f"/tg{name}" for name in of_nodes}
    assert "/tg/controller_manager/list_controllers" in named.services


def test_frames_and_services_are_of_the_same_robot(tmp_path: Path) -> None:
    server = RosServer(graph_of(tmp_path, PLUGIN).simulation, ())

    (frame,) = (server.graph.topics["/tf_static"].constant or {})["transforms"]
    assert frame["child_frame_id"] == "base"
    listed = call(server, "/tg/controller_manager/list_controllers")["controller"]
    jtc, jsb = "joint_trajectory_controller", "joint_state_broadcaster"
    assert {each["name"] for each in listed} == {jtc, jsb}
    path = "/tg/controller_manager/get_parameters"
    (rate,) = call(server, path, names=["update_rate"])["values"]
    assert rate["integer_value"] == 100
    (joints,) = call(server, f"/tg/{jtc}/get_parameters", names=["joints"])["values"]
    assert joints["string_array_value"] == ["shoulder"]


def call(server: RosServer, name: str, **request: Any) -> dict[str, Any]:
    """Return the response of a service."""
    found = server.graph.service(name).call(Call(request, "", lambda answer: None))
    assert found is not None
    return found


def test_a_base_in_a_name_space_has_its_services_there(tmp_path: Path) -> None:
    server = RosServer(ad.Simulation(ad.build_diagram(wheels(tmp_path))), ())
    sim = server.simulation

    call(server, "/tg/drive/set_odometry", x=3.0, y=4.0, yaw=0.0)
    # Without a command it tells nothing until one is late, after 0.5 s.
    sim.advance_to(0.8)

    position = sim.topic("/tg/drive/odom").value().pose.pose.position
    assert (position.x, position.y) == pytest.approx((3.0, 4.0))


def wheels(folder: Path, name: str = "cart") -> ad.Robot:
    return plain_cart(folder, name, namespace="tg", distro="kilted")


def test_each_of_several_managers_has_its_own_parameters(tmp_path: Path) -> None:
    robots = [wheels(tmp_path, name) for name in ("a", "b")]
    robots[1] = models.at_rate_of(robots[1], 0.02)
    server = RosServer(ad.Simulation(ad.build_diagram(robots)), ())

    rates = {}
    for name in ("a", "b"):
        path = f"/{name}/controller_manager/get_parameters"
        (value,) = call(server, path, names=["update_rate"])["values"]
        rates[name] = value["integer_value"]

    assert rates == {"a": 100, "b": 50}
    assert not any(name.startswith("/tg") for name in server.graph.topics)


def test_what_comes_in_by_names_in_a_name_space_reaches_the_robot(
    tmp_path: Path,
) -> None:
    sim = graph_of(tmp_path, PLUGIN).simulation
    node, joints = "/tg/joint_trajectory_controller", ["shoulder"]
    later = {"sec": 1, "nanosec": 0}
    points = [{"positions": [0.5], "time_from_start": later}]
    data = {"joint_names": joints, "points": points}
    action, topic = f"{node}/follow_joint_trajectory", f"{node}/joint_trajectory"
    inputs = [
        ClientInput(0.0, "publish", topic, "me", data),
        ClientInput(0.5, "goal", action, "me", {"trajectory": data}, "1"),
    ]
    run(RosServer(sim, (), inputs=inputs), 2.0, realtime_rate=0.0)

    rollout = sim.rollout()

    assert [message.topic for message in rollout.messages] == [topic]
    assert [goal.status for goal in rollout.goals] == ["SUCCEEDED"]
    assert sim.topic(f"{node}/controller_state").value().feedback.positions == (
        pytest.approx((0.5,), abs=0.02)
    )


def test_a_plugin_says_its_name_space_itself(tmp_path: Path) -> None:
    graph = graph_of(tmp_path, STATES, namespace="other")

    assert {"/tg/seen", "/other/joint_states"} <= set(graph.topics)
    assert "/other/tg/seen" not in graph.topics
