"""Topics by name: who they are, what they take, and what motions send to them."""

import dataclasses as dc
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES, ControllerType
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import Events, add_events, new_messages
from arm_drake.errors import InputError, MotionError
from arm_drake.messages import (
    ActionRequest,
    Float32,
    Float64,
    Float64MultiArray,
    GoalStatus,
    GripperCommandGoal,
    Header,
    JointState,
    Message,
    SendGoal,
    SpeedScalingFactor,
    TopicRejected,
)
from arm_drake.messages.control import GripperCommand
from arm_drake.simulation.directory import TopicInfo
from arm_drake.simulation.motion_files import load_motion, parse_motion
from arm_drake.simulation.topics import VIRTUAL_TOPICS, VirtualTopic
from tests import models

TYPES: dict[str, type[Message]] = {
    kind.__name__: kind for kind in (Float64, Float32, Float64MultiArray, ActionRequest)
}

SHOULDER, ELBOW = (
    f"/model/two_links/joint/{joint}/cmd_pos" for joint in ("shoulder", "elbow")
)


class Heard(NamedTuple):
    """A message that came: in which tick [ns], on which topic, and what."""

    time_ns: int
    topic: str
    message: Message


@dc.dataclass(frozen=True)
class ListenerParameters:
    """Parameters of a Listener."""

    # What it takes, and its class of messages; and what it publishes.
    topics: tuple[str, ...] = ()
    message: str = "Float64"
    outputs: tuple[str, ...] = ()

    # Stamp of what it publishes [s].
    stamp: int = 0


class ListenerState(NamedTuple):
    """State of a Listener between two ticks."""

    heard: tuple[Heard, ...] = ()
    seen: tuple[tuple[Message, ...], ...] = ()
    events: Events = ()


class Listener(TickingController[ListenerState]):
    """Keeps what comes on its topics; numbers below 0 are refused."""

    def __init__(
        self, parameters: ListenerParameters, params: ControllerInterfaceParams
    ) -> None:
        self._type = TYPES[parameters.message]
        self.message_types = dict.fromkeys(parameters.topics, self._type)
        super().__init__(params, ListenerState(seen=((),) * len(parameters.topics)))
        nothing = AbstractValue.Make(())
        self._topics = [
            self.DeclareAbstractInputPort(name, nothing) for name in parameters.topics
        ]
        published = JointState(Header(parameters.stamp, params.controller_name))
        for name in parameters.outputs:
            self._declare_topic(name, lambda state: published, default=published)
        self._declare_topic("heard", lambda state: state.heard)
        self._declare_topic("events", lambda state: state.events)

    def _update(self, now: UpdateContext, state: ListenerState) -> ListenerState:
        heard, seen, refused = [*state.heard], [], []
        for port, old in zip(self._topics, state.seen, strict=True):
            new, there = new_messages(port, now.context, self._type, old)
            seen.append(there)
            for message in new:
                if getattr(message, "data", 0.0) < 0.0 and self._type is Float32:
                    refused.append(TopicRejected(message, "below 0"))
                heard.append(Heard(now.time_ns, port.get_name(), message))
        events = add_events(state.events, refused)
        return ListenerState(tuple(heard), tuple(seen), events)


@pytest.fixture(autouse=True)
def listener_type(monkeypatch):
    row = ControllerType(ListenerParameters, Listener)
    monkeypatch.setitem(CONTROLLER_TYPES, "test/Listener", row)


CONTROLLERS = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
    group: {{type: forward_command_controller/ForwardCommandController}}
    jsb: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    ear: {{type: test/Listener}}
arm:
  ros__parameters:
    joints: [shoulder]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
group: {{ros__parameters: {{joints: [elbow], interface_name: position}}}}
ear: {{ros__parameters: {{topics: [{SHOULDER}, {ELBOW}]}}}}
"""


def listeners(**parameters: str) -> str:
    """Return a YAML with a Listener per name, with these parameters."""
    types = "".join(f"\n    {name}: {{type: test/Listener}}" for name in parameters)
    sections = "".join(
        f"\n{name}: {{ros__parameters: {{{text}}}}}"
        for name, text in parameters.items()
    )
    manager = f"ros__parameters:\n    update_rate: 100{types}"
    return f"controller_manager:\n  {manager}{sections}"


def simulate(folder: Path, controllers: str = CONTROLLERS, **options) -> ad.Simulation:
    robot = models.load(folder, models.TWO_LINKS, controllers, **options)
    return start(robot)


def start(*robots: ad.Robot) -> ad.Simulation:
    options = ad.SimulationOptions(preset="kinematic")
    return ad.Simulation(ad.build_diagram(robots, options=options))


@pytest.fixture
def sim(tmp_path) -> ad.Simulation:
    return simulate(tmp_path)


def heard(sim: ad.Simulation, listener: str = "ear") -> list[Heard]:
    sim.advance_to(sim.time + 0.1)
    return list(sim.eval_output(f"{listener}.heard"))


def trajectory(position: float) -> ad.JointTrajectory:
    point = ad.JointTrajectoryPoint([position], time_from_start=0.5)
    return ad.JointTrajectory(joint_names=["shoulder"], points=[point])


# Names


@pytest.mark.parametrize(
    ("inputs", "name"),
    [
        ("/arm/joint_trajectory", "/arm/joint_trajectory"),
        ("group/commands", "/group/commands"),
        ("/arm/controller_state", "/arm/controller_state"),
        (SHOULDER, SHOULDER),
        (SHOULDER[1:], SHOULDER),
        ("/model/two_links/joint/shoulder/0/cmd_pos", SHOULDER),
        ("/joint_states", "/joint_states"),
        ("/jsb/joint_states", "/joint_states"),
    ],
)
def test_a_topic_has_the_name_that_it_has_in_ros(sim, inputs, name):
    assert sim.topic(inputs).name == name


@pytest.mark.parametrize(
    ("inputs", "name"),
    [
        ("/tg/arm/joint_trajectory", "/tg/arm/joint_trajectory"),
        ("arm/joint_trajectory", "/tg/arm/joint_trajectory"),
        ("/tg/joint_states", "/tg/joint_states"),
        ("joint_states", "/tg/joint_states"),
        ("/tg/jsb/joint_states", "/tg/joint_states"),
        ("jsb/joint_states", "/tg/joint_states"),
        # What begins with a slash at its controller, as in Gazebo, is its whole name.
        (SHOULDER, SHOULDER),
    ],
)
def test_alone_a_robot_has_the_name_space_of_its_nodes(tmp_path, inputs, name):
    sim = simulate(tmp_path, namespace="tg")

    assert sim.topic(inputs).name == name
    assert name in [row.name for row in sim.list_topics()]


def test_a_name_space_is_in_front_of_no_name_of_ours(tmp_path):
    sim = simulate(tmp_path, namespace="tg")
    sim.controller("arm").send_goal(trajectory(0.3))
    sim.topic("group/commands").publish(Float64MultiArray([0.5]))
    sim.topic(SHOULDER).publish(Float64(1.0))

    assert [h.topic for h in heard(sim)] == [SHOULDER]
    assert sim.list_controllers()[0].name == "arm"
    assert [goal.controller for goal in sim.rollout().goals] == ["arm"]
    topics = [message.topic for message in sim.rollout().messages]
    assert topics == ["/tg/group/commands", SHOULDER]


@pytest.mark.parametrize("space", ["", "/tg"])
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        (
            "/arm/follow_joint_trajectory",
            "is an action, not a topic; sim.controller('arm').send_goal sends to it",
        ),
        (
            "/controller_manager/list_controllers",
            "is a service, not a topic; sim.list_controllers calls it",
        ),
        (
            "/arm/query_state",
            "is a service, not a topic; sim.controller('arm').query_state calls it",
        ),
    ],
)
def test_in_a_name_space_it_is_said_what_is_no_topic(tmp_path, space, name, reason):
    sim = simulate(tmp_path, namespace="tg")

    with pytest.raises(InputError) as error:
        sim.topic(f"{space}{name}")

    assert str(error.value) == f"{space + name!r} {reason}"


def test_the_list_of_topics_has_names_types_and_directions(sim):
    topics = sim.list_topics()

    assert sorted(topics) == sorted(
        [
            TopicInfo("/arm/joint_trajectory", "JointTrajectory", "input"),
            TopicInfo("/arm/speed_scaling_input", "SpeedScalingFactor", "input"),
            TopicInfo(
                "/arm/controller_state", "JointTrajectoryControllerState", "output"
            ),
            TopicInfo("/group/commands", "Float64MultiArray", "input"),
            TopicInfo("/joint_states", "JointState", "output"),
            TopicInfo("/dynamic_joint_states", "DynamicJointState", "output"),
            TopicInfo(SHOULDER, "Float64", "input"),
            TopicInfo(ELBOW, "Float64", "input"),
            TopicInfo("/ear/heard", "tuple", "output"),
        ]
    )


def test_the_list_of_topics_is_a_table(tmp_path):
    alias = "ros_topic_name: a, gz_topic_name: /b"
    types = "ros_type_name: std_msgs/msg/Float64, gz_type_name: gz.msgs.Double"
    sim = bridged(tmp_path, f"- {{{alias}, {types}}}", topics="[/b]")

    assert str(sim.list_topics()) == (
        "/b          Float64  input\n"
        "/ear/heard  tuple    output\n"
        "/a          Float64  input   /b"
    )


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        (
            "/arm/joint_trajectori",
            "no topic '/arm/joint_trajectori'; did you mean '/arm/joint_trajectory'? "
            "known: /arm/controller_state, /arm/joint_trajectory, "
            "/arm/speed_scaling_input, /dynamic_joint_states, /ear/heard, "
            f"/group/commands, /joint_states, {ELBOW}, {SHOULDER}",
        ),
        ("", "expected the name of a topic, got ''"),
        ("/", "expected the name of a topic, got '/'"),
        (5, "expected the name of a topic, got 5"),
        (
            "/arm/follow_joint_trajectory",
            "'/arm/follow_joint_trajectory' is an action, not a topic; "
            "sim.controller('arm').send_goal sends to it",
        ),
        (
            "arm/follow_joint_trajectory/_action/feedback",
            "'/arm/follow_joint_trajectory/_action/feedback' is an action, not a "
            "topic; sim.controller('arm').send_goal sends to it",
        ),
        (
            "/arm/query_state",
            "'/arm/query_state' is a service, not a topic; "
            "sim.controller('arm').query_state calls it",
        ),
        (
            "/controller_manager/switch_controller",
            "'/controller_manager/switch_controller' is a service, not a topic; "
            "sim.switch_controllers calls it",
        ),
    ],
)
def test_what_is_no_topic_is_an_error_that_says_so(sim, name, problem):
    with pytest.raises(InputError) as error:
        sim.topic(name)

    assert str(error.value) == problem


def test_a_controllers_own_action_is_no_topic(tmp_path):
    sim = simulate(tmp_path, listeners(ear="topics: [dance], message: ActionRequest"))

    with pytest.raises(InputError) as error:
        sim.topic("/ear/dance")

    assert str(error.value) == (
        "'/ear/dance' is an action, not a topic; sim.controller('ear').send_goal "
        "sends to it"
    )


def test_an_events_port_is_no_topic(sim):
    with pytest.raises(InputError, match=r"^no topic '/arm/events'"):
        sim.topic("/arm/events")


def test_a_broadcaster_with_local_topics_has_its_name_in_front(tmp_path):
    text = "jsb: {ros__parameters: {use_local_topics: true}}\n"

    sim = simulate(tmp_path, CONTROLLERS + text)

    assert sim.topic("/jsb/joint_states").name == "/jsb/joint_states"
    with pytest.raises(InputError, match=r"^no topic '/joint_states'"):
        sim.topic("/joint_states")


def two_robots(folder: Path) -> ad.Simulation:
    robots = []
    for name, controllers in (("one", CONTROLLERS), ("two", CONTROLLERS)):
        (folder / name).mkdir()
        text = controllers.replace("two_links", name)
        robots.append(models.load(folder / name, models.TWO_LINKS, text, name=name))
    return start(*robots)


def test_with_several_robots_a_robots_name_stands_in_front(tmp_path):
    sim = two_robots(tmp_path)
    own = "/model/one/joint/shoulder/cmd_pos"

    sim.topic("/two/group/commands").publish([0.2])
    sim.topic(own).publish(1.0)
    sim.topic(f"/one{own}").publish(2.0)
    sim.advance_to(0.1)

    assert sim.topic("two/group/commands").name == "/two/group/commands"
    assert sim.topic(own).name == sim.topic(f"/one{own}").name == f"/one{own}"
    assert [h.message.data for h in sim.eval_output("one/ear.heard")] == [1.0, 2.0]
    assert sim.eval_output("two/ear.heard") == ()
    assert sim.joint_states("one").position[1] == 0.0
    assert sim.joint_states("two").position[1] == 0.2


def test_a_name_that_two_robots_have_is_an_error(tmp_path):
    sim = two_robots(tmp_path)

    with pytest.raises(InputError) as error:
        sim.topic("/joint_states")

    assert str(error.value) == (
        "several robots have a topic '/joint_states'; known: '/one/joint_states', "
        "'/two/joint_states'"
    )


# Publishing


@pytest.mark.parametrize("data", [2, 2.0, np.float32(2.0), np.array(2.0), Float64(2.0)])
def test_a_number_is_heard_on_a_topic_of_numbers(sim, data):
    sim.topic(SHOULDER).publish(data)

    ((_, topic, message),) = heard(sim)
    assert topic == SHOULDER
    assert type(message) is Float64
    assert message.data == 2.0


def test_a_number_is_a_float32_on_a_topic_of_these(tmp_path):
    sim = simulate(tmp_path, listeners(ear="topics: [/a], message: Float32"))

    sim.topic("/a").publish(0.1)

    (message,) = (h.message for h in heard(sim))
    assert type(message) is Float32
    # It keeps the digits that it is given.
    assert message.data == 0.1


@pytest.mark.parametrize(
    "values", [[0.3], (0.3,), np.array([0.3]), Float64MultiArray([0.3])]
)
def test_values_move_the_joints_of_a_group(sim, values):
    sim.topic("/group/commands").publish(values)

    sim.advance_to(0.1)

    assert sim.joint_states().position[1] == 0.3


def test_a_list_is_heard_on_a_topic_of_lists(tmp_path):
    text = listeners(ear="topics: [/a], message: Float64MultiArray")
    topic = simulate(tmp_path, text).topic("/a")

    topic.check([1.0, 2.0])
    with pytest.raises(InputError) as error:
        topic.check([1.0, math.nan])

    assert str(error.value) == (
        "topic '/a' takes a list of finite numbers or a Float64MultiArray, got "
        "[1.0, nan]"
    )


def test_a_trajectory_is_followed_at_the_speed_of_its_topic(sim):
    sim.topic("/arm/speed_scaling_input").publish(0.5)
    sim.topic("/arm/joint_trajectory").publish(trajectory(0.4))

    sim.advance_to(0.8)
    on_the_way = sim.joint_states().position[0]
    sim.advance_to(1.1)

    # The trajectory takes 1 s at half the speed.
    assert 0.0 < on_the_way < 0.4
    assert sim.joint_states().position[0] == pytest.approx(0.4, rel=1e-12)


def test_references_of_a_pid_controller_are_values_too(tmp_path):
    urdf = models.pendulum(control=models.ros2_control("swing", command="effort"))
    text = (
        "controller_manager: {ros__parameters: {pid: {type: pid_controller/"
        "PidController}}}\npid: {ros__parameters: {dof_names: [swing], "
        "command_interface: effort, reference_and_state_interfaces: [position], "
        "use_external_measured_states: true, gains: {swing: {p: 1.0}}}}"
    )
    sim = ad.Simulation(ad.build_diagram(models.load(tmp_path, urdf, text)))

    sim.topic("/pid/reference").publish([0.5])
    sim.advance_to(0.1)

    (dof,) = sim.topic("/pid/controller_state").value().dof_states
    assert dof.reference == 0.5
    inputs = [row for row in sim.list_topics() if row.direction == "input"]
    assert inputs == [
        TopicInfo("/pid/reference", "MultiDOFCommand", "input"),
        TopicInfo("/pid/measured_state", "MultiDOFCommand", "input"),
    ]


@pytest.mark.parametrize("message", [1.0, Float64(1.0)])
def test_the_same_message_once_more_is_a_new_one(sim, message):
    for _ in range(3):
        sim.topic(SHOULDER).publish(message)
        sim.advance_to(sim.time + 0.01)

    assert [h.message.data for h in heard(sim)] == [1.0] * 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "data", "problem"),
    [
        (SHOULDER, "1", "takes a finite number or a Float64, got '1'"),
        (SHOULDER, True, "takes a finite number or a Float64, got True"),
        (SHOULDER, [1.0], "takes a finite number or a Float64, got [1.0]"),
        (SHOULDER, None, "takes a finite number or a Float64, got None"),
        (SHOULDER, math.inf, "takes a finite number or a Float64, got inf"),
        (
            SHOULDER,
            Float64MultiArray([1.0]),
            "takes a finite number or a Float64, got a Float64MultiArray",
        ),
        (
            "/group/commands",
            1.0,
            "takes a list of finite numbers or a Float64MultiArray, got 1.0",
        ),
        (
            "/group/commands",
            "1",
            "takes a list of finite numbers or a Float64MultiArray, got '1'",
        ),
        (
            "/arm/speed_scaling_input",
            [1.0],
            "takes a finite number or a SpeedScalingFactor, got [1.0]",
        ),
        (
            "/arm/joint_trajectory",
            [1.0],
            "takes a JointTrajectory, got [1.0]",
        ),
        (
            "/arm/joint_trajectory",
            ad.FollowJointTrajectoryGoal(),
            "takes a JointTrajectory, got a FollowJointTrajectoryGoal",
        ),
    ],
)
def test_other_data_is_an_error_that_says_what_the_topic_takes(
    sim, topic, data, problem
):
    with pytest.raises(InputError) as error:
        sim.topic(topic).publish(data)

    assert str(error.value) == f"topic {topic!r} {problem}"


def test_another_number_of_values_is_an_error_with_their_names(sim):
    with pytest.raises(InputError) as error:
        sim.topic("/group/commands").publish([0.1, 0.2])

    assert str(error.value) == (
        "controller 'group': expected 1 value (elbow/position), got 2"
    )


def test_what_nobody_takes_cant_be_published(sim):
    with pytest.raises(InputError) as error:
        sim.topic("/joint_states").publish(JointState())

    assert str(error.value) == (
        "nobody takes messages of topic '/joint_states'; 'jsb' publishes on it"
    )


def test_all_who_read_a_topic_hear_all_of_its_messages(tmp_path):
    # The second one is ten times as slow.
    slow = "topics: [/a], update_rate: 10"
    sim = simulate(tmp_path, listeners(fast="topics: [/a]", slow=slow))
    sim.advance_to(0.005)

    for value in (1.0, 2.0, 3.0):
        sim.topic("/a").publish(value)
        sim.advance_to(sim.time + 0.03)

    assert sim.topic("/a").controllers == ("fast", "slow")
    for name in ("fast", "slow"):
        assert [h.message.data for h in heard(sim, name)] == [1.0, 2.0, 3.0]


def test_a_refused_message_is_reported_with_its_place(tmp_path):
    sim = simulate(tmp_path, listeners(ear="topics: [/a], message: Float32"))

    sim.topic("/a").publish(-1.0, where="here")
    sim.advance_to(0.1)

    (rejection,) = sim.rejected
    assert sim.mailbox.describe(rejection) == "here: ear: command refused: below 0"


# Reading


def test_the_value_of_a_topic_is_its_latest_message(sim):
    sim.topic("/group/commands").publish([0.3])
    sim.advance_to(0.5)

    message = sim.topic("/joint_states").value()

    assert isinstance(message, JointState)
    assert dict(zip(message.name, message.position, strict=True))["elbow"] == 0.3
    # The tick of this very instant hasn't run.
    assert message.header.stamp.to_seconds() == 0.49


def test_of_several_publishers_the_latest_message_counts(tmp_path):
    text = CONTROLLERS.replace(
        f"topics: [{SHOULDER}, {ELBOW}]", "outputs: [/joint_states], stamp: 1"
    )
    sim = simulate(tmp_path, text)

    def publisher() -> str:
        message = sim.topic("/joint_states").value()
        return message.header.frame_id or "jsb"

    sim.advance_to(0.5)
    assert publisher() == "ear"
    sim.advance_to(1.5)
    assert publisher() == "jsb"


def pose_sensor(name: str, x: float) -> str:
    """Return a sensor that tells a pose for ever."""
    values = {"position.x": x, "position.y": 0, "position.z": 0}
    values |= {f"orientation.{axis}": axis == "w" for axis in "xyzw"}
    states = "".join(
        f'<state_interface name="{key}"><param name="initial_value">{float(value)}'
        "</param></state_interface>"
        for key, value in values.items()
    )
    return f'<sensor name="{name}">{states}</sensor>'


POSES = """
controller_manager:
  ros__parameters:
    a: {type: pose_broadcaster/PoseBroadcaster}
    b: {type: pose_broadcaster/PoseBroadcaster}
    c: {type: pose_broadcaster/PoseBroadcaster}
a: {ros__parameters: {pose_name: one, frame_id: map}}
b: {ros__parameters: {pose_name: two, frame_id: map}}
c: {ros__parameters: {pose_name: three, frame_id: map, tf: {child_frame_id: two}}}
"""


@pytest.mark.parametrize(("ended", "there"), [("b", 3.0), ("c", 2.0)])
def test_the_frames_of_all_publishers_are_on_tf(tmp_path, ended, there):
    names = {"one": 1.0, "two": 2.0, "three": 3.0}
    sensors = "".join(pose_sensor(name, x) for name, x in names.items())
    control = models.ros2_control("swing").replace(
        "</ros2_control>", f"{sensors}</ros2_control>"
    )
    robot = models.load(tmp_path, models.pendulum(control=control), POSES)
    sim = start(robot)
    sim.advance_to(0.1)
    sim.switch_controllers(deactivate=[ended])
    sim.advance_to(0.2)

    message = sim.topic("/tf").value()

    # "two" is told by two of them, one of whom has ended.
    reported = {t.child_frame_id: t.transform.translation.x for t in message.transforms}
    assert reported == {"one": 1.0, "two": there}
    assert len(message.transforms) == 2
    assert sim.topic("/b/tf").value().transforms[0].transform.translation.x == 2.0
    assert "/tf" in [topic.name for topic in sim.list_topics()]


def test_without_a_publisher_there_is_no_tf(sim):
    with pytest.raises(InputError, match="no topic '/tf'"):
        sim.topic("/tf")


def test_several_publishers_of_one_name_are_one_line(tmp_path):
    names = dict.fromkeys("acd", "outputs: [/b]")
    sim = simulate(tmp_path, listeners(**names))

    lines = [str(e) for e in sim.report.grouped() if e.kind == "unsupported"]
    assert lines == [
        "warning: controller 'c', controller 'd': publishes on the topic '/b', as 'a' "
        "does; what 'a' publishes is there"
    ]
    assert sim.topic("/b").value().header.frame_id == "a"


def test_what_nobody_publishes_has_no_value(sim):
    with pytest.raises(InputError) as error:
        sim.topic("/group/commands").value()

    assert str(error.value) == (
        "nobody publishes on topic '/group/commands'; 'group' takes its messages"
    )


# Bridges


def bridged(folder: Path, bridge: str, *, topics: str, outputs: str = "[]"):
    """Return a simulation of a Listener whose robot has a bridge."""
    file = folder / "bridge.yaml"
    file.write_text(bridge, encoding="utf-8")
    controllers = folder / "controllers.yaml"
    text = listeners(ear=f"topics: {topics}, outputs: {outputs}")
    controllers.write_text(text, encoding="utf-8")
    robot = folder / "robot.urdf"
    robot.write_text(models.TWO_LINKS, encoding="utf-8")
    return start(ad.load_robot(robot, controllers=[controllers, file]))


def entry(ros: str, gz: str, direction: str, kind: str = "Float64", to: str = "Double"):
    package = "sensor_msgs" if kind == "JointState" else "std_msgs"
    return (
        f"- {{ros_topic_name: {ros}, gz_topic_name: {gz}, direction: {direction}, "
        f"ros_type_name: {package}/msg/{kind}, gz_type_name: gz.msgs.{to}}}\n"
    )


@pytest.mark.parametrize("direction", ["ROS_TO_GZ", "BIDIRECTIONAL"])
@pytest.mark.parametrize("index", ["", "/0"])
def test_a_name_of_a_bridge_is_that_of_gazebos_topic(tmp_path, direction, index):
    gz = f"model/m/joint/j{index}/cmd_pos"
    text = entry("/arm/j", gz, direction)
    sim = bridged(tmp_path, text, topics="[/model/m/joint/j/cmd_pos]")

    sim.topic("arm/j").publish(1.0)

    assert sim.topic("arm/j").name == "/arm/j"
    (message,) = heard(sim)
    assert (message.topic, message.message.data) == ("/model/m/joint/j/cmd_pos", 1.0)


def test_a_name_that_is_bridged_twice_reaches_both(tmp_path):
    text = entry("/a", "/b", "ROS_TO_GZ") + entry("/a", "/c", "BIDIRECTIONAL")
    sim = bridged(tmp_path, text, topics="[/b, /c]")

    sim.topic("/a").publish(1.0)

    assert sorted(h.topic for h in heard(sim)) == ["/b", "/c"]


def test_a_bridge_to_ros_can_be_read(tmp_path):
    text = entry("/joint_states", "/gz/state", "GZ_TO_ROS", "JointState", "Model")
    sim = bridged(tmp_path, text, topics="[]", outputs="[/gz/state]")

    assert sim.topic("/joint_states").value().header.frame_id == "ear"
    assert TopicInfo("/joint_states", "JointState", "output", ("/gz/state",)) in (
        sim.list_topics()
    )


def test_against_the_direction_of_its_bridge_a_name_is_of_no_use(tmp_path):
    text = entry("/in", "/a", "GZ_TO_ROS") + entry(
        "/out", "/b", "ROS_TO_GZ", "JointState", "Model"
    )
    sim = bridged(tmp_path, text, topics="[/a]", outputs="[/b]")

    with pytest.raises(InputError) as publishing:
        sim.topic("/in").publish(1.0)
    with pytest.raises(InputError) as reading:
        sim.topic("/out").value()

    file = tmp_path / "bridge.yaml"
    assert str(publishing.value) == (
        f"topic '/in' is bridged GZ_TO_ROS ({file}:1); publishing needs ROS_TO_GZ or "
        "BIDIRECTIONAL"
    )
    assert str(reading.value) == (
        f"topic '/out' is bridged ROS_TO_GZ ({file}:2); reading needs GZ_TO_ROS or "
        "BIDIRECTIONAL"
    )


def test_a_bridge_in_both_directions_takes_no_more_than_gazebos_topic(tmp_path):
    text = entry("/a", "/b", "BIDIRECTIONAL", "JointState", "Model")
    sim = bridged(tmp_path, text, topics="[]", outputs="[/b]")

    with pytest.raises(InputError) as error:
        sim.topic("/a").publish(JointState())

    assert str(error.value) == (
        "nobody takes messages of topic '/a'; 'ear' publishes on it"
    )


def test_a_bridge_to_a_topic_that_isnt_there_is_reported_when_it_is_used(tmp_path):
    text = entry("/a", "/model/other/cmd_vel", "ROS_TO_GZ")
    sim = bridged(tmp_path, text, topics="[/model/mine/cmd_vel]")

    with pytest.raises(InputError) as error:
        sim.topic("/a")

    assert str(error.value) == (
        "topic '/a' is bridged to '/model/other/cmd_vel' "
        f"({tmp_path / 'bridge.yaml'}:1), which nobody has; did you mean "
        "'/model/mine/cmd_vel'? known: /ear/heard, /model/mine/cmd_vel"
    )
    assert list(sim.report) == []
    assert "/a" not in [row.name for row in sim.list_topics()]


# Topics that stand for something else


def test_a_virtual_topic_is_told_to_its_controller_in_its_own_way(
    monkeypatch, tmp_path
):
    def make(system: Listener, message: Float32) -> tuple[str, Message]:
        return "/a", Float64(10.0 * message.data)

    virtual = VirtualTopic(Float32, lambda system: isinstance(system, Listener), make)
    monkeypatch.setitem(VIRTUAL_TOPICS, "/gripper_command", virtual)
    (tmp_path / "two").mkdir()
    sim = simulate(tmp_path, listeners(ear="topics: [/a]"))
    several = simulate(tmp_path / "two", listeners(a="topics: [/a]", b="topics: [/b]"))

    sim.topic("gripper_command").publish(0.5)

    assert [h.message.data for h in heard(sim)] == [5.0]
    assert TopicInfo("/gripper_command", "Float32", "input") in sim.list_topics()
    with pytest.raises(InputError) as error:
        several.topic("/gripper_command")
    assert str(error.value) == (
        "topic '/gripper_command' may be meant for 'a', 'b'; use their own topics or "
        "actions"
    )


GRIPPER = """
controller_manager:
  ros__parameters:
    update_rate: 100
    hand: {type: position_controllers/GripperActionController}
hand: {ros__parameters: {joint: finger}}
"""


@pytest.fixture
def gripper(tmp_path) -> ad.Simulation:
    robot = models.load(tmp_path, models.GRIPPER, GRIPPER)
    return ad.Simulation(ad.build_diagram(robot))


@pytest.mark.slow
def test_a_virtual_topic_may_send_a_goal(monkeypatch, gripper):
    def make(system: object, message: Float32) -> tuple[str, Message]:
        goal = GripperCommandGoal(GripperCommand(message.data))
        return "gripper_cmd", SendGoal(goal)

    virtual = VirtualTopic(Float32, lambda system: True, make)
    monkeypatch.setitem(VIRTUAL_TOPICS, "/gripper_command", virtual)

    gripper.topic("/gripper_command").publish(0.25, where="here")
    gripper.advance_to(2.0)

    (goal,) = gripper.goals
    assert (goal.controller, goal.where) == ("hand", "here")
    assert goal.status is GoalStatus.SUCCEEDED
    assert gripper.joint_states().position[0] == pytest.approx(0.25, abs=0.01)


# Motions


@pytest.mark.slow
def test_a_motion_sends_a_gripper_to_its_goal(gripper):
    motion = [
        {
            "at": 0.5,
            "controller": "hand",
            "gripper_command": {"position": 0.2, "max_effort": 5.0},
        }
    ]
    gripper.run(2.0, parse_motion(motion))

    (goal,) = gripper.goals
    assert goal.request.goal == GripperCommandGoal(GripperCommand(0.2, 5.0))
    assert goal.where == "[0].gripper_command"
    assert goal.status is GoalStatus.SUCCEEDED


def test_a_motion_sends_to_topics(sim):
    motion = [
        {"at": 0.1, "topic": SHOULDER, "data": -2},
        {"at": 0.1, "topic": "group/commands", "data": [0.3]},
        {
            "at": 0.2,
            "topic": "/arm/joint_trajectory",
            "trajectory": {
                "joint_names": ["shoulder"],
                "points": [{"positions": [0.4], "time_from_start": 0.5}],
            },
        },
    ]
    sim.run(1.0, parse_motion(motion))

    ((time_ns, topic, message),) = heard(sim)
    assert (time_ns, topic, message.data) == (100_000_000, SHOULDER, -2.0)
    assert sim.joint_states().position == pytest.approx((0.4, 0.3), rel=1e-12)


# The end of the tutorial's script; all starts at 0.
SCRIPT_END = (
    *(-1.345, -1.23, 0.264, -0.296, 0.389, -1.5),
    *(-0.7, -0.7, 0.7, 0.7, 0.7, -0.7),
)


# At 500 Hz the sums of rounded numbers that say when a step is due come after their
# ticks now and then.
@pytest.mark.slow
@pytest.mark.parametrize("rate", [100, 500])
def test_the_tutorials_script_sends_its_poses_in_its_ticks_for_ever(tmp_path, rate):
    topics = [f"/model/arm/joint/j{index}/cmd_pos" for index in range(12)]
    text = listeners(ear=f"topics: {topics}")
    sim = simulate(tmp_path, text.replace("rate: 100", f"rate: {rate}"))
    file = tmp_path / "script.yaml"
    file.write_text(
        f"- every: 0.05\n  count: 52\n  topics: {topics}\n"
        f"  data_from_to: [{[0.0] * 12}, {list(SCRIPT_END)}]\n  ping_pong: true\n"
        "- {repeat: true}\n"
    )

    sim.run(11.0, load_motion(file))

    # A timer of 0.05 s: poses 0/51 to 51/51 and back, each end twice, 104 ticks long.
    ticks = 221
    messages = heard(sim)
    assert len(messages) == 12 * ticks
    for count, (time_ns, topic, message) in enumerate(messages):
        tick, joint = divmod(count, 12)
        pose = min(tick % 104, 103 - tick % 104)
        expected = SCRIPT_END[joint] * pose / 51
        assert (time_ns, topic) == (tick * 50_000_000, topics[joint])
        # Two roundings in each of the two ways to compute it.
        assert message.data == pytest.approx(expected, rel=2**-51, abs=0.0)


def test_a_motion_that_repeats_ends_with_its_run_and_starts_anew(sim):
    steps = [
        {"every": 0.1, "count": 2, "topic": SHOULDER, "data": 1},
        {"repeat": True},
    ]
    motion = parse_motion(steps)

    sim.run(0.25, motion)
    sim.run(0.1, motion)

    times = [h.time_ns for h in heard(sim)]
    # The end of a run belongs to it; a step off the ticks waits for the next.
    assert times == [n * 10_000_000 for n in (0, 10, 20, 25, 35)]


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        (
            f"{{topic: {SHOULDER}s, data: 1}}",
            f"[1].data: no topic '{SHOULDER}s'; did you mean {SHOULDER!r}? known: ",
        ),
        (
            f"{{topic: {SHOULDER}, data: [1]}}",
            f"[1].data: topic {SHOULDER!r} takes a finite number or a Float64, got "
            "(1.0,)",
        ),
        (
            f"{{topic: {SHOULDER}, trajectory: {{}}}}",
            f"[1].trajectory: topic {SHOULDER!r} takes a finite number or a Float64, "
            "got a JointTrajectory",
        ),
        (
            "{topic: /arm/follow_joint_trajectory, trajectory: {}}",
            "[1].trajectory: '/arm/follow_joint_trajectory' is an action, not a topic; "
            "sim.controller('arm').send_goal sends to it",
        ),
        (
            f"{{every: 1, count: 2, topics: [{SHOULDER}, /x], "
            "data_from_to: [[1, 1], [2, 2]]}",
            "[1].data_from_to: no topic '/x'; ",
        ),
        (
            "{controller: arm, gripper_command: {position: 1}}",
            "[1].gripper_command: controller 'arm'",
        ),
    ],
)
def test_a_motion_is_checked_before_it_moves_anything(sim, tmp_path, step, problem):
    file = tmp_path / "motion.yaml"
    file.write_text(f"- {{topic: {SHOULDER}, data: 1}}\n- {step}\n")

    with pytest.raises(MotionError) as error:
        sim.run(1.0, load_motion(file))

    assert str(error.value).startswith(f"{file}:2: {problem}")
    assert sim.time == 0.0


def test_a_topic_of_an_inactive_controller_must_be_activated_first(tmp_path):
    robot = models.load(tmp_path, models.TWO_LINKS, CONTROLLERS)
    options = ad.SimulationOptions(preset="kinematic", inactive=("ear",))
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    step = {"at": 0.2, "topic": SHOULDER, "data": 1}
    switch = {"at": 0.1, "switch_controllers": {"activate": ["ear"]}}

    with pytest.raises(MotionError) as error:
        sim.run(0.5, parse_motion([step]))
    sim.run(0.5, parse_motion([switch, step]))

    assert str(error.value) == "[0].data: controller 'ear' is inactive, not active"
    assert [h.message.data for h in heard(sim)] == [1.0]


def test_one_active_reader_of_a_topic_is_enough_for_a_motion(tmp_path):
    text = listeners(on="topics: [/a]", off="topics: [/a]")
    robot = models.load(tmp_path, models.TWO_LINKS, text)
    options = ad.SimulationOptions(preset="kinematic", inactive=("off",))
    sim = ad.Simulation(ad.build_diagram(robot, options=options))

    sim.run(0.1, parse_motion([{"topic": "/a", "data": 1}]))

    assert [h.message.data for h in heard(sim, "on")] == [1.0]
    assert heard(sim, "off") == []


def test_a_factor_of_speed_keeps_its_class(sim):
    sim.topic("/arm/speed_scaling_input").publish(SpeedScalingFactor(0.5))
    sim.advance_to(0.1)

    assert sim.topic("/arm/controller_state").value().speed_scaling_factor == 0.5


def test_a_trajectory_for_a_gripper_says_what_it_takes(gripper):
    goal = {"joint_names": ["finger"], "points": [{"positions": [0.2]}]}
    motion = parse_motion([{"controller": "hand", "goal": goal}])

    with pytest.raises(MotionError) as caught:
        gripper.run(0.1, motion)

    assert str(caught.value) == (
        "[0].goal: controller 'hand': a gripper takes no trajectory; give it "
        "gripper_command: {position: ..., max_effort: ...}"
    )
