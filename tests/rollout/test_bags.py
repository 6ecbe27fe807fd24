"""Bags of ROS 2 messages, as readers that aren't ours see them."""

import json
import re
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.rosbag2 import Reader

import arm_drake as ad
from arm_drake.description.entry import bundled_motions, bundled_robots
from arm_drake.rollout.bag import CONTACTS, contact_topic
from arm_drake.rollout.link_poses import multiply, read_transforms, rotate
from arm_drake.rollout.mcap import type_of
from tests import models
from tests.carts import cart, diff_drive
from tests.carts import load as load_cart

# How much of a motion is played [s]: the longest one takes half a minute, and in 3 s
# none sends anything of a kind that it hasn't sent in the first.
DURATION = 1.0

# What `control` has to be for a motion of the MyCobot.
CONTROL = {
    "classic": "classic",
    "plan_to_poses": "ros2_control",
    "trajectories": "ros2_control",
}

# Motions that need a scene of their own.
SCENES = ("follow", "pick_and_place", "pick_by_camera")

MOTIONS = [
    (robot, motion)
    for robot in bundled_robots()
    for motion in bundled_motions(robot)
    if motion not in SCENES
]


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return times [ns] and messages by topic, as mcap-ros2-support reads them."""
    topics: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    for message in read_ros2_messages(path):
        topics[message.channel.topic].append((message.log_time_ns, message.ros_msg))
    return topics


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def seen(values: list[list[float]]) -> np.ndarray:
    return np.array(values, dtype=float)


@pytest.fixture(scope="module")
def doosan(tmp_path_factory: pytest.TempPathFactory) -> tuple[ad.Rollout, Path]:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim.run(motion.duration + 1.0, motion)
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    sim.rollout().save(path)
    return sim.rollout(), path


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "name"), MOTIONS)
def test_a_bag_of_each_motion_is_read_back_complete(
    tmp_path: Path, robot: str, name: str
) -> None:
    inputs = {"control": CONTROL[name]} if name in CONTROL else {}
    loaded = ad.load_robot(robot, xacro_args=inputs)
    sim = ad.Simulation(ad.build_diagram(loaded))
    motion = ad.load_motion(bundled_motions(robot)[name])
    sim.run(min(motion.duration + 0.5, DURATION), motion)
    rollout = sim.rollout()
    rollout.save(tmp_path / "a.mcap")

    topics = read(tmp_path / "a.mcap")

    times = np.round(rollout.time * 1e9).astype(np.int64).tolist()
    states = topics["/joint_states"]
    assert [time for time, _ in states] == times
    assert [nanoseconds(m.header.stamp) for _, m in states] == times
    assert [nanoseconds(m.clock) for _, m in topics["/clock"]] == times
    assert {tuple(m.name) for _, m in states} == {rollout.joint_names}
    for field in ("position", "velocity", "effort"):
        found = seen([getattr(m, field) for _, m in states])
        np.testing.assert_array_equal(found, getattr(rollout, field))
    for controller, reference in rollout.references.items():
        reported = topics[f"/{controller}/controller_state"]
        rows = [times.index(time) for time, _ in reported]
        unknown = np.isnan(reference.position).all(axis=1)
        assert rows == np.flatnonzero(~unknown).tolist()
        assert {tuple(m.joint_names) for _, m in reported} == {reference.joint_names}
        wanted = seen([m.reference.positions for _, m in reported])
        np.testing.assert_array_equal(wanted, reference.position[rows])
        error = seen([m.error.positions for _, m in reported])
        np.testing.assert_array_equal(error, rollout.tracking_error(controller)[rows])
    ((_, description),) = topics["/robot_description"]
    assert description.data == rollout.description
    sent = Counter(message.topic for message in rollout.messages)
    assert sent or rollout.goals
    for topic, number in sent.items():
        assert len(topics[topic]) == number
    # What isn't ours to read, ours reads: nothing is lost.
    again = ad.Rollout.load(tmp_path / "a.mcap")
    np.testing.assert_array_equal(again.position, rollout.position)
    np.testing.assert_array_equal(again.command, rollout.command)
    assert (again.messages, again.goals) == (rollout.messages, rollout.goals)


@pytest.mark.slow
def test_messages_have_the_fields_that_were_sent(tmp_path: Path) -> None:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    points = [
        ad.JointTrajectoryPoint((0.1 * k,) * 6, time_from_start=0.5 * k) for k in (1, 2)
    ]
    sim.advance_to(0.2)
    sent = ad.JointTrajectory(
        header=ad.Header(frame_id="·"),
        joint_names=[f"joint{k}" for k in range(1, 7)],
        points=points,
    )
    sim.controller("joint_trajectory_controller").send_trajectory(sent)
    sim.advance_to(0.3)
    sim.rollout().save(tmp_path / "a.mcap")

    ((time, got),) = read(tmp_path / "a.mcap")[
        "/joint_trajectory_controller/joint_trajectory"
    ]

    assert time == 200_000_000
    assert (got.header.frame_id, tuple(got.joint_names)) == ("·", sent.joint_names)
    for point, expected in zip(got.points, sent.points, strict=True):
        assert tuple(point.positions) == expected.positions
        assert list(point.velocities) == []
        due = expected.time_from_start.to_nanoseconds()
        assert nanoseconds(point.time_from_start) == due


@pytest.mark.slow
def test_goals_are_told_as_trajectories_and_in_the_log(doosan: Any) -> None:
    rollout, path = doosan

    topics = read(path)

    ((_, trajectory),) = topics[
        "/joint_trajectory_controller/follow_joint_trajectory/trajectory"
    ]
    assert (
        list(trajectory.joint_names)
        == rollout.goals[0].goal["trajectory"]["joint_names"]
    )
    ((time, line),) = topics["/rosout"]
    assert time == round(rollout.goals[0].ended_at * 1e9)
    assert (line.level, line.name) == (20, "joint_trajectory_controller")
    assert line.msg.startswith("goal SUCCEEDED, error code 0")


@pytest.mark.slow
def test_the_metadata_is_that_of_ros_2(doosan: Any) -> None:
    _, path = doosan
    with path.open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()

    assert header.profile == "ros2"
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert {channel.message_encoding for channel in channels.values()} == {"cdr"}
    for topic, channel in channels.items():
        (qos,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        is_latched = topic in ("/robot_description", "/tf_static")
        if is_latched or topic in ("/joint_states", "/tf", "/clock"):
            wanted = "transient_local" if is_latched else "volatile"
            assert (qos["reliability"], qos["durability"]) == ("reliable", wanted)
    # As `ros2 topic info --verbose` shows it for this type.
    known = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    assert channels["/joint_states"].metadata["topic_type_hash"] == known
    assert summary.statistics.message_count == sum(
        summary.statistics.channel_message_counts.values()
    )


@pytest.mark.slow
def test_reading_from_start_to_end_gives_the_same_as_by_the_index(doosan: Any) -> None:
    _, path = doosan
    found = []
    for make in (make_reader, NonSeekingReader):
        with path.open("rb") as file:
            messages = make(file).iter_messages(log_time_order=True)
            found.append(Counter((c.topic, m.log_time, m.data) for _, c, m in messages))

    assert found[0] == found[1]
    assert sum(found[0].values()) > 1000


def test_rosbags_opens_the_file_as_a_bag(doosan: Any) -> None:
    rollout, path = doosan

    with Reader(path) as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}

    assert counts["/joint_states"] == len(rollout.time)


def compose(topics: Any, link: str, time_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position and quaternion of a link in the world, out of the frames."""
    frames = {}
    for time, message in (*topics["/tf_static"], *topics["/tf"]):
        if time <= time_ns:
            frames.update({each.child_frame_id: each for each in message.transforms})
    position, rotation = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    chain = []
    while link != "world":
        chain.append(frames[link])
        link = frames[link].header.frame_id
    for frame in reversed(chain):
        p, q = frame.transform.translation, frame.transform.rotation
        position = position + rotate(rotation, np.array([p.x, p.y, p.z]))
        turn = np.array([[q.w, q.x, q.y, q.z]])
        rotation = multiply(rotation[None], turn)[0]
    return position, rotation


@pytest.mark.slow
def test_frames_lead_to_where_drake_has_the_links(tmp_path: Path) -> None:
    robot = ad.load_robot("doosan_a0912", pose=(0.3, -0.2, 0.5, 0.1, 0.2, 0.3))
    sim = ad.Simulation(ad.build_diagram(robot))
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim.run(2.0, motion)
    poses = sim.link_poses()
    sim.advance_to(2.02)
    sim.rollout().save(tmp_path / "a.mcap")

    topics = read(tmp_path / "a.mcap")

    assert len(read_transforms(robot.description.source)) == len(poses) - 1
    for link, X_WL in poses.items():
        position, rotation = compose(topics, link, 2_000_000_000)
        # Both are sums and products of a dozen numbers of about 1.
        np.testing.assert_allclose(position, X_WL.translation(), atol=1e-13)
        cosine = abs(rotation @ X_WL.rotation().ToQuaternion().wxyz())
        assert cosine == pytest.approx(1.0, abs=1e-13)


@pytest.mark.slow
def test_a_free_base_is_in_the_frames(tmp_path: Path) -> None:
    robot = load_cart(tmp_path, cart(diff_drive()))
    sim = ad.Simulation(ad.build_diagram(robot))
    for tick in range(50):
        sim.topic("/model/cart/cmd_vel").publish({"linear": {"x": 0.5}})
        sim.advance_to((tick + 1) * 0.01)
    poses = sim.link_poses()
    sim.advance_to(0.51)
    sim.rollout().save(tmp_path / "a.mcap")

    topics = read(tmp_path / "a.mcap")

    assert len(topics["/model/cart/cmd_vel"]) == 50
    assert {m.linear.x for _, m in topics["/model/cart/cmd_vel"]} == {0.5}
    for link, X_WL in poses.items():
        position, _ = compose(topics, link, 500_000_000)
        np.testing.assert_allclose(position, X_WL.translation(), atol=1e-13)
    assert poses["base_link"].translation()[0] > 0.1


def test_links_with_names_alike_have_topics_of_their_own() -> None:
    topics = {contact_topic("/a", name) for name in ("l_1", "l.1", "l-1")}

    assert len(topics) == 3
    assert "/a" + CONTACTS + "l_1" in topics
    assert all(re.fullmatch(r"[A-Za-z0-9_/]+", topic) for topic in topics)


@pytest.mark.slow
def test_several_robots_have_namespaces(tmp_path: Path) -> None:
    robots = [ad.load_robot("doosan_a0912", name=name) for name in "ab"]
    sim = ad.Simulation(ad.build_diagram(robots))
    sim.advance_to(0.05)
    sim.rollout("b").save(tmp_path / "b.mcap")

    topics = read(tmp_path / "b.mcap")

    assert {"/b/joint_states", "/b/robot_description", "/clock", "/tf"} < set(topics)
    assert "/joint_states" not in topics
    frames = {t.child_frame_id for _, m in topics["/tf"] for t in m.transforms}
    assert all(frame.startswith("b/") for frame in frames)
    again = ad.Rollout.load(tmp_path / "b.mcap", "b")
    assert (again.robot_name, again.namespace) == ("b", "/b")
    with pytest.raises(ad.ArmDrakeError, match="no robot 'c'; known: b"):
        ad.Rollout.load(tmp_path / "b.mcap", "c")


def test_alone_a_robot_has_its_name_space(tmp_path: Path) -> None:
    controllers = models.trajectory_controllers(
        {"joint_trajectory_controller": ["shoulder"]}
    )
    robot = models.load(tmp_path, models.TWO_LINKS, controllers, namespace="tg")
    sim = ad.Simulation(ad.build_diagram(robot))
    point = ad.JointTrajectoryPoint([0.2], time_from_start=0.1)
    goal = ad.JointTrajectory(joint_names=["shoulder"], points=[point])
    sim.controller("joint_trajectory_controller").send_goal(goal)
    sim.advance_to(0.05)
    rollout = sim.rollout()
    rollout.save(tmp_path / "a.mcap")

    topics = read(tmp_path / "a.mcap")

    jtc = "/tg/joint_trajectory_controller"
    assert set(topics) == {
        *("/clock", "/rosout", "/tf", "/tf_static"),
        *("/tg/joint_states", "/tg/robot_description"),
        *(f"{jtc}/controller_state", f"{jtc}/follow_joint_trajectory/trajectory"),
        *(f"/tg/arm_drake/{each}" for each in ("rollout", "goals")),
        *("/tg/arm_drake/active_controllers", "/tg/arm_drake/command_interfaces"),
    }
    # A name space doesn't reach frames: robot_state_publisher has a prefix for them.
    frames = {t.child_frame_id for _, m in topics["/tf"] for t in m.transforms}
    assert frames == {"upper", "lower"}
    again = ad.Rollout.load(tmp_path / "a.mcap")
    again.save(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    rollout.save(tmp_path / "a.npz")
    for each in (again, ad.Rollout.load(tmp_path / "a.npz")):
        assert each.namespace == "/tg"
        np.testing.assert_array_equal(each.position, rollout.position)
        assert each.goals[0].controller == "joint_trajectory_controller"


@pytest.mark.slow
def test_what_a_bag_cannot_tell_as_a_message_it_tells_as_text(tmp_path: Path) -> None:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    sim.switch_controllers(deactivate=["joint_trajectory_controller"])
    sim.advance_to(0.05)
    sim.rollout().save(tmp_path / "a.mcap")

    ((_, text),) = read(tmp_path / "a.mcap")["/arm_drake/messages"]

    reported = json.loads(text.data)
    assert reported["type"] == "SwitchController"
    assert reported["data"]["deactivate_controllers"] == ["joint_trajectory_controller"]


@pytest.mark.parametrize(
    ("message", "type_"),
    [
        ("Twist", "geometry_msgs/msg/Twist"),
        # No store of rosbags has it.
        ("AckermannDrive", "ackermann_msgs/msg/AckermannDrive"),
        # A part of an action, whose topics are hidden in ROS.
        ("GripperCommandGoal", None),
        ("SwitchController", None),
    ],
)
def test_a_bag_has_topics_for_messages_of_ros(message: str, type_: str | None) -> None:
    assert type_of(message) == type_


@pytest.mark.slow
def test_without_rosbags_it_is_said_what_is_missing(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['rosbags.typesys'] = None\n"
        "from tests.rollout.test_rollout import make_rollout\n"
        "try: make_rollout().save(sys.argv[1])\n"
        "except ImportError as error: print(error)"
    )

    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "a.mcap"],
        capture_output=True,
        text=True,
        timeout=120,
    )

    assert done.stdout == (
        "a log of ROS 2 messages (.mcap) needs `pip install 'arm-drake[bag]'`\n"
    )
