"""The graph of a simulation: topics, actions and nodes; it knows no transport.

Topics are read by the thread that simulates, as messages of ours; what they are in ROS
is made where they are sent.
"""

import collections
import dataclasses as dc
import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.controllers.cycles import Cycle
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.interfaces import MOTIONS_PORT
from arm_drake.manager import MANAGER, ControllerManager
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    FollowJointTrajectoryGoal,
    Goal,
    GripperCommandGoal,
    Message,
    ParallelGripperCommandGoal,
    ResetOdometry,
    SetOdometry,
    TFMessage,
    Time,
)
from arm_drake.messages.base import ros_type
from arm_drake.rollout.bag import contact_topic, make_tf, stamp
from arm_drake.rollout.link_poses import (
    LinkTransform,
    fixed_pose,
    read_transforms,
    root_links,
)
from arm_drake.simulation.clients import input_type
from arm_drake.simulation.recording import read_joint_states
from arm_drake.simulation.simulation import Simulation
from arm_drake.simulation.topics import (
    ACTIONS,
    TopicNames,
    TopicPort,
    message_type,
    sensor_type,
)
from arm_drake.wire.types import WireTypes, to_fields

# How often a topic is told at most [Hz]: that of robot_state_publisher, and of ours.
_TF_RATE, _CLOCK_RATE = 50.0, 100.0

# Values that wait for the network; older ones are dropped.
_NUM_WAITING = 128

# How often it is looked whether controllers' states have changed [s].
_ACTIVITY_PERIOD = 0.05

TF, TF_STATIC, CLOCK, ROSOUT = "/tf", "/tf_static", "/clock", "/rosout"

# rcl_interfaces/msg/Log.
INFO, WARN, ERROR = 20, 30, 40

# lifecycle_msgs/msg/State.
STATES = {"unconfigured": 1, "inactive": 2, "active": 3, "finalized": 4}

JOINT_STATES, DESCRIPTION = "/joint_states", "/robot_description"

# The node of what no controller has: Gazebo's.
SIMULATOR = "/gazebo"


# In a class with a field `type` they have no other name.
MessageClass: TypeAlias = type[Message]
GoalClass: TypeAlias = type[Goal]


class Qos(NamedTuple):
    """Quality of service that a topic is offered or requested with."""

    depth: int = 10

    # Whether a late subscriber gets the last message.
    is_latched: bool = False

    is_reliable: bool = True


DEFAULT_QOS = Qos()
LATCHED = Qos(depth=1, is_latched=True)


@dc.dataclass(eq=False)
class Topic:
    """A topic: what is published on it, and whether anybody takes messages."""

    name: str

    # Such as "sensor_msgs/msg/JointState".
    type: str

    # Who publishes and who subscribes to it, by name; nobody has none.
    publisher: str = ""
    subscriber: str = ""

    qos: Qos = DEFAULT_QOS

    # Returns what is to be told, the same object if that is not new; in the thread that
    # simulates.
    read: Callable[[Context], Any] | None = None

    # Returns it as plain data, with stamps so much later [ns], or None if there is
    # nothing to tell; in the network's thread.
    convert: Callable[[Any, int], dict[str, Any] | None] = to_fields

    # The class of messages that are taken.
    takes: MessageClass | None = None

    # What late listeners are told, as plain data: if it is latched, and at once if it
    # is told but once.
    constant: dict[str, Any] | None = None

    # How often it is told at most [s].
    period: float = 0.0

    # When it is told next [s], what was told last, and what waits.
    due: float = -math.inf
    last: Any = None
    waiting: collections.deque[Any] = dc.field(
        default_factory=lambda: collections.deque(maxlen=_NUM_WAITING)
    )

    # What other sensors publish on it, each in its own time; what waits is the same.
    others: list["Topic"] = dc.field(default_factory=list)

    def update(self, context: Context, time: float) -> None:
        """Take note of what is new at a time [s]."""
        for topic in (self, *self.others):
            topic._update(context, time)

    def _update(self, context: Context, time: float) -> None:
        if time < self.due or self.read is None:
            return
        if self.period:
            # As often on average, whatever the ticks are.
            ahead = self.due + self.period if math.isfinite(self.due) else time
            self.due = ahead if ahead > time else time + self.period * (1.0 - 1e-6)
        value = self.read(context)
        if value is not self.last and not _is_same(value, self.last):
            self.last = value
            self.waiting.append(value)

    def reset(self) -> None:
        """Begin anew, as the simulation does."""
        self.due, self.last = -math.inf, None
        for other in self.others:
            other.reset()


def _is_same(value: Any, last: Any) -> bool:
    """Return whether a message is the last one, made once more: its stamp says so."""
    stamps = [getattr(getattr(v, "header", None), "stamp", None) for v in (value, last)]
    if stamps[0] is None or stamps[0] != stamps[1]:
        return False
    # Not everybody gives messages a stamp.
    return stamps[0] != Time() or bool(value == last)


class _LastCycle:
    """The last cycle of a robot's manager: read once a tick, and made once."""

    def __init__(self, manager: ControllerManager) -> None:
        """Create it."""
        self._manager = manager
        self._read: _Once | None = None

    def read(self, root: Context) -> "_Once":
        """Return what makes it, in the thread that simulates."""
        if self._read is None:
            context = self._manager.GetMyContextFromRoot(root)
            self._read = _Once(self._manager.look(context))
        return self._read

    def forget(self) -> None:
        """Take note of a new tick."""
        self._read = None


class _Once:
    """Result of a function, which is called when it is first needed."""

    def __init__(self, make: Callable[[], Cycle]) -> None:
        """Create it."""
        self._make = make
        self._made: Cycle | None = None

    def __call__(self) -> Cycle:
        """Return it."""
        if self._made is None:
            self._made = self._make()
        return self._made


class _OncePerStamp:
    """Makes the messages of a topic of what was read of them, each time once."""

    def __init__(self, convert: Callable[[Any, int], dict[str, Any] | None]) -> None:
        """Create it, with a function that makes plain data of them."""
        self._convert = convert
        self._stamp: Any = None

    def __call__(self, value: Any, offset_ns: int) -> dict[str, Any] | None:
        """Return a message as plain data, None if it was sent already."""
        make, cycle = value
        message = make(cycle())
        header = getattr(message, "header", None)
        if header is not None:
            if header.stamp == self._stamp:
                return None
            self._stamp = header.stamp
        return None if message is None else self._convert(message, offset_ns)


class Action(NamedTuple):
    """An action of a controller."""

    name: str

    # Such as "control_msgs/action/FollowJointTrajectory".
    type: str

    # The controller with its robot's prefix, and the class of its goals.
    controller: str
    goal: GoalClass

    # Its node.
    node: str


@dataclass(frozen=True, eq=False)
class Service:
    """A service; `call` is done by the thread that simulates."""

    name: str

    # Such as "std_srvs/srv/Empty".
    type: str

    node: str

    # Returns the response to a request, both as plain data, or None if it comes later.
    call: Callable[["Call"], dict[str, Any] | None]

    # Whether it changes anything in the simulation.
    acts: bool = False


class LogLine(NamedTuple):
    """Log entry, in words."""

    time_ns: int

    # INFO, WARN or ERROR, of rcl_interfaces/msg/Log.
    level: int

    # Who says so.
    name: str

    text: str


class Call(NamedTuple):
    """A call of a service."""

    request: dict[str, Any]

    # Who calls.
    sender: str

    # Takes the response if it comes later.
    reply: Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class GoalEvent:
    """Event of a goal that a client sent."""

    goal_id: str
    action: Action

    # "accepted", "rejected", "feedback", "result" or "cancel".
    kind: str

    # Of action_msgs/msg/GoalStatus.
    status: int = 0

    # Feedback or result as plain data.
    data: dict[str, Any] = dc.field(default_factory=dict)

    # Why it is refused, in words.
    reason: str = ""

    stamp_ns: int = 0


class Request(NamedTuple):
    """Request of a client."""

    # "publish", "call", "goal" or "cancel".
    kind: str

    # Name of the topic, service or action.
    name: str

    # Plain data, with all fields of its type.
    data: dict[str, Any]

    # Who asks, such as "rosbridge 127.0.0.1:51234".
    sender: str

    # Of a goal.
    goal_id: str = ""

    # Takes the response to a call, or GoalEvent; it is called in the network's thread.
    reply: Callable[[Any], None] = lambda answer: None

    # Takes what is wrong, in words.
    refuse: Callable[[str], None] = lambda problem: None

    # How much later the client's clock is than that of the simulation [ns].
    offset_ns: int = 0


# What actions of controllers are in ROS.
_ACTION_TYPES: Mapping[type, str] = {
    FollowJointTrajectoryGoal: "control_msgs/action/FollowJointTrajectory",
    GripperCommandGoal: "control_msgs/action/GripperCommand",
    ParallelGripperCommandGoal: "control_msgs/action/ParallelGripperCommand",
}


class Graph:
    """The topics, actions and services of a simulation, by their names."""

    def __init__(self, simulation: Simulation, types: WireTypes) -> None:
        """Create it; what has no type in ROS is left out, and listed."""
        self.simulation, self.types = simulation, types
        self.topics: dict[str, Topic] = {}
        self.actions: dict[str, Action] = {}
        self.services: dict[str, Service] = {}

        # Topics that no message of ROS can tell.
        self.left_out: list[str] = []
        managers = simulation.directory.managers.values()
        self._cycles = {id(manager): _LastCycle(manager) for manager in managers}
        for topic in self._find_topics():
            self._add(topic)
        self._add(_clock())
        self.rosout = _rosout()
        self._add(self.rosout)
        for manager in managers:
            for topic in _robot_topics(simulation, manager, self.topics):
                self._add(topic)
            if types.distro != "humble":  # It has none.
                self._add(_activity(manager))
            for action in _find_actions(manager):
                self.actions[action.name] = action

    def _add(self, topic: Topic) -> None:
        known = self.topics.get(topic.name)
        if known is not None and not known.subscriber and known.read is None:
            known.publisher = known.publisher or topic.publisher
            return
        self.topics[topic.name] = topic

    def update(self, topics: Iterable[Topic], time: float) -> None:
        """Take note of what is new on topics at a time [s]."""
        for cycle in self._cycles.values():
            cycle.forget()
        context = self.simulation.simulator.get_context()
        for topic in topics:
            topic.update(context, time)

    def _find_topics(self) -> Iterator[Topic]:
        """Yield the topics of controllers and plugins."""
        for found in TopicNames(self.simulation.directory.managers).all():
            topic = Topic(found.name, "")
            if found.outputs and not self._read(topic, found.outputs[0]):
                continue
            for source in found.outputs[1:]:
                other = Topic(found.name, "", waiting=topic.waiting)
                if sensor_type(source) and self._read(other, source):
                    topic.others.append(other)
            taken = input_type(found.inputs[0]) if found.inputs else None
            kind = None if taken is None else ros_type(taken)
            if kind is not None and topic.type in ("", kind):
                topic.type, topic.takes = kind, taken
                topic.subscriber = _node_of(found.inputs[0])
            if topic.type:
                yield topic
            elif taken not in (SetOdometry, ResetOdometry):  # They are services.
                self.left_out.append(found.name)

    def _read(self, topic: Topic, source: TopicPort) -> bool:
        """Have a topic read from a port; return whether it is to be published."""
        port = self.simulation.diagram.GetOutputPort(source.exported_as(source.port))
        made = sensor_type(source)
        if made is not None:
            # A camera, which takes a picture only when somebody wants it.
            topic.period = 1.0 / source.system.params.update_rate
        else:
            value = port.Eval(self.simulation.simulator.get_context())
            made = value.__class__ if isinstance(value, Message) else None
        kind = None if made is None else ros_type(made)
        if made is None or kind is None:
            self.left_out.append(topic.name)
            return False
        if topic.name == TF:
            return False
        topic.type, topic.publisher = kind, _node_of(source)
        topic.read = port.Eval
        if not self.types.is_whole(made, kind):
            topic.convert = functools.partial(_complete, self.types, kind)
        if isinstance(source.system, ControllerInterface):
            look = source.system.find_look(source.port)
            if look is not None:
                cycle = self._cycles[id(source.manager)]
                topic.convert = _OncePerStamp(topic.convert)
                topic.read = lambda context: (look(context), cycle.read(context))
        return True

    def log(self, level: int, name: str, text: str, time_ns: int) -> None:
        """Log an event in words, on /rosout."""
        self.rosout.waiting.append(LogLine(time_ns, level, name, text))

    def topic(self, name: str) -> Topic:
        """Return the topic of a name, or raise InputError."""
        return _find(self.topics, name, "topic")

    def action(self, name: str) -> Action:
        """Return the action of a name, or raise InputError."""
        return _find(self.actions, name, "action")

    def service(self, name: str) -> Service:
        """Return the service of a name, or raise InputError."""
        return _find(self.services, name, "service")

    def nodes(self) -> list[str]:
        """Return the names of all nodes."""
        topics = [each for t in self.topics.values() for each in (t, *t.others)]
        names = [t.publisher for t in topics]
        names += [t.subscriber for t in self.topics.values()]
        names += [s.node for s in self.services.values()]
        names += [a.node for a in self.actions.values()]
        return sorted({name for name in names if name})


def _find(known: Mapping[str, Any], name: Any, what: str) -> Any:
    key = f"/{name.strip('/')}" if isinstance(name, str) else name
    if not isinstance(key, str) or key not in known:
        raise InputError(f"no {what} {str(name)[:200]!r}; {suggest(str(key), known)}")
    return known[key]


def _complete(
    types: WireTypes, kind: str, message: Message, offset_ns: int
) -> dict[str, Any]:
    return types.complete(kind, to_fields(message, offset_ns))


def _node_of(port: TopicPort) -> str:
    return f"{port.manager.namespace}/{port.system.params.controller_name}"


def _clock() -> Topic:
    def read(context: Context) -> int:
        return round(context.get_time() * NANOSECONDS)

    return Topic(
        CLOCK,
        "rosgraph_msgs/msg/Clock",
        publisher=SIMULATOR,
        read=read,
        convert=lambda time_ns, offset_ns: {"clock": stamp(time_ns + offset_ns)},
        period=1.0 / _CLOCK_RATE,
    )


def _rosout() -> Topic:
    """Return the topic of what happens in words; `Graph.log` puts it there."""
    return Topic(
        ROSOUT,
        "rcl_interfaces/msg/Log",
        publisher=SIMULATOR,
        qos=Qos(depth=1000, is_latched=True),
        # Whatever happens is put there.
        read=lambda context: None,
        period=math.inf,
        convert=lambda line, offset_ns: {
            "stamp": stamp(line.time_ns + offset_ns),
            "level": line.level,
            "name": line.name,
            "msg": line.text,
            "file": "",
            "function": "",
            "line": 0,
        },
    )


def _activity(manager: ControllerManager) -> Topic:
    """Return the topic with the states of a robot's controllers, when they change."""
    states, part = manager.GetOutputPort("controllers"), manager.numbers.active
    last: list[Any] = [None, None]
    hardware = [
        {"name": block.name, "state": {"id": 3, "label": "active"}}
        for block in manager.robot.description.hardware
    ]

    def read(root: Context) -> Any:
        active = manager.read_numbers(root, part).tolist()
        if active != last[0]:
            context = manager.GetMyContextFromRoot(root)
            time_ns = round(root.get_time() * NANOSECONDS)
            last[:] = active, (time_ns, states.Eval(context))
        return last[1]

    def convert(value: Any, offset_ns: int) -> dict[str, Any]:
        time_ns, rows = value
        named = [
            {"name": r.name, "state": {"id": STATES[r.state], "label": r.state}}
            for r in rows
        ]
        header = {"stamp": stamp(time_ns + offset_ns), "frame_id": ""}
        return {
            "header": header,
            "controllers": named,
            "hardware_components": hardware,
        }

    node = f"{manager.namespace}/{MANAGER}"
    return Topic(
        f"{node}/activity",
        "controller_manager_msgs/msg/ControllerManagerActivity",
        publisher=node,
        qos=LATCHED,
        read=read,
        convert=convert,
        period=_ACTIVITY_PERIOD,
    )


def _contacts(simulation: Simulation, manager: ControllerManager) -> Iterator[Topic]:
    """Yield the forces on links where they are logged, by the names of bags."""
    name = f"{manager.prefix}sample:contacts"
    if not simulation.diagram.HasSubsystemNamed(name):
        return
    sample = simulation.diagram.GetSubsystemByName(name)
    port = sample.get_output_port()

    def read(root: Context) -> Any:
        forces = port.Eval(sample.GetMyContextFromRoot(root))
        return round(root.get_time() * NANOSECONDS), forces.tolist()

    for index, link in enumerate(manager.robot.description.links):
        if link != WORLD:
            at = slice(3 * index, 3 * index + 3)
            yield Topic(
                contact_topic(manager.namespace, link),
                "geometry_msgs/msg/WrenchStamped",
                publisher=SIMULATOR,
                read=read,
                convert=functools.partial(_make_force, at),
            )


def _make_force(at: slice, value: Any, offset_ns: int) -> dict[str, Any]:
    time_ns, forces = value
    nothing = dict.fromkeys("xyz", 0.0)
    force = dict(zip("xyz", forces[at], strict=True))
    return {
        "header": {"stamp": stamp(time_ns + offset_ns), "frame_id": WORLD},
        "wrench": {"force": force, "torque": nothing},
    }


def _robot_topics(
    simulation: Simulation, manager: ControllerManager, known: Mapping[str, Topic]
) -> Iterator[Topic]:
    """Yield the topics of a robot's robot_state_publisher, and its joints."""
    robot, namespace = manager.robot, manager.namespace
    root = f"/{manager.prefix}".rstrip("/")  # tf2 listens there, wherever its node is.
    node = f"{namespace}/robot_state_publisher"
    yield Topic(
        f"{namespace}{DESCRIPTION}",
        "std_msgs/msg/String",
        publisher=node,
        qos=LATCHED,
        constant={"data": robot.portable_source},
    )
    yield from _contacts(simulation, manager)
    frames = RobotFrames(simulation, manager)
    yield Topic(
        f"{root}{TF}",
        "tf2_msgs/msg/TFMessage",
        publisher=node,
        read=frames.read,
        convert=frames.convert,
        period=1.0 / _TF_RATE,
    )
    yield Topic(
        f"{root}{TF_STATIC}",
        "tf2_msgs/msg/TFMessage",
        publisher=node,
        qos=LATCHED,
        constant=frames.fixed(),
    )
    if f"{namespace}{JOINT_STATES}" not in known:
        yield Topic(
            f"{namespace}{JOINT_STATES}",
            "sensor_msgs/msg/JointState",
            publisher=SIMULATOR,
            read=lambda c: read_joint_states(simulation.diagram, c, manager),
        )


class RobotFrames:
    """The frames of a robot, as robot_state_publisher publishes them."""

    def __init__(self, simulation: Simulation, manager: ControllerManager) -> None:
        """Create it."""
        robot = manager.robot
        self._namespace = manager.prefix.rstrip("/")
        pose = [0.0] * 6 if robot.pose is None else list(robot.pose)
        self._transforms = read_transforms(robot.portable_source, pose)
        joints = {j.name: i for i, j in enumerate(robot.description.movable_joints)}
        self._moving = [
            (transform, joints[transform.joint])
            for transform in self._transforms
            if transform.joint in joints
        ]
        # Not the port with efforts too, which would be computed for nothing.
        self._manager, self._port = manager, manager.GetInputPort(MOTIONS_PORT)
        self._bodies = _free_bodies(simulation, robot)
        roots = root_links(robot.portable_source, self._transforms)
        free = {name for name, _ in self._bodies}
        self._topics = _frame_ports(simulation, manager)
        context = simulation.simulator.get_context()
        driven = {
            transform.child_frame_id.rpartition("/")[2]
            for read in self._topics
            for transform in read(context).transforms
        }
        # Whoever drives tells where the base is, and a frame has one parent.
        self._bodies = [
            (name, read) for name, read in self._bodies if name not in driven
        ]
        self._fixed = [
            (t.parent, t.child, t.poses(np.zeros(1))[0])
            for t in self._transforms
            if not t.joint
        ]
        self._fixed += [
            (WORLD, root, np.hstack(fixed_pose(pose)))
            for root in roots
            if root not in free | driven
        ]

    def fixed(self) -> dict[str, Any]:
        """Return the frames that never move, as plain data."""
        return dict(make_tf(TF_STATIC, self._fixed, 0, self._namespace).fields)

    def read(self, context: Context) -> Any:
        """Return what is known of the frames now."""
        return (
            round(context.get_time() * NANOSECONDS),
            self._port.Eval(self._manager.GetMyContextFromRoot(context)),
            [(name, read(context)) for name, read in self._bodies],
            [read(context) for read in self._topics],
        )

    def convert(self, value: Any, offset_ns: int) -> dict[str, Any]:
        """Return it as plain data."""
        time_ns, positions, bodies, messages = value
        frames = [(WORLD, name, pose) for name, pose in bodies]
        frames += [
            (each.parent, each.child, _moved(each, float(positions[index])))
            for each, index in self._moving
        ]
        found = make_tf(TF, frames, time_ns + offset_ns, self._namespace).fields
        transforms = list(found["transforms"])
        for message in messages:
            transforms += to_fields(message, offset_ns)["transforms"]
        return {"transforms": transforms}


def _free_bodies(
    simulation: Simulation, robot: Robot
) -> list[tuple[str, Callable[[Context], Array]]]:
    """Return what reads the poses of links that nothing holds."""
    plant = simulation.diagram.GetSubsystemByName("plant")
    if not isinstance(plant, MultibodyPlant):
        return []
    model = plant.GetModelInstanceByName(robot.name)

    def reader(index: Any) -> Callable[[Context], Array]:
        def read(context: Context) -> Array:
            here = plant.GetMyContextFromRoot(context)
            pose = plant.EvalBodyPoseInWorld(here, plant.get_body(index))
            quaternion = pose.rotation().ToQuaternion().wxyz()
            return np.hstack([pose.translation(), quaternion])

        return read

    return [
        (plant.get_body(index).name(), reader(index))
        for index in plant.GetBodyIndices(model)
        if plant.get_body(index).is_floating_base_body()
    ]


def _frame_ports(
    simulation: Simulation, manager: ControllerManager
) -> list[Callable[[Context], TFMessage]]:
    """Return functions that read the frames that a robot's controllers publish."""
    names = TopicNames({manager.robot.name: manager})
    context, found = simulation.simulator.get_context(), []
    for topic in names.all():
        for each in topic.outputs if topic.name.endswith(TF) else ():
            port = simulation.diagram.GetOutputPort(each.exported_as(each.port))
            if isinstance(port.Eval(context), TFMessage):
                found.append(port.Eval)
    return found


def _moved(transform: LinkTransform, position: float) -> Array:
    """Return x, y, z [m], quaternion w, x, y, z of a link at a joint's position.

    It is that of `LinkTransform.poses`, of one position and quicker.
    """
    w, x, y, z = transform.rotation.tolist()
    i, j, k = transform.axis.tolist()
    if transform.is_prismatic:
        return transform.poses(np.array([position]))[0]
    cosine, sine = math.cos(0.5 * position), math.sin(0.5 * position)
    i, j, k = sine * i, sine * j, sine * k
    turned = (
        w * cosine - x * i - y * j - z * k,
        w * i + x * cosine + y * k - z * j,
        w * j - x * k + y * cosine + z * i,
        w * k + x * j - y * i + z * cosine,
    )
    return np.array([*transform.origin.tolist(), *turned])


def _find_actions(manager: ControllerManager) -> Iterator[Action]:
    """Yield the actions of a robot's controllers."""
    for controller in manager.controllers:
        system = controller.system
        for port in () if system is None else _action_ports(system):
            kind: Any = getattr(system, "goal_type", None)
            if kind not in _ACTION_TYPES:
                kind = ACTIONS.get(port, (FollowJointTrajectoryGoal,))[0]
            name = f"{manager.prefix}{controller.name}"
            node = f"{manager.namespace}/{controller.name}"
            own = port if port.startswith("/") else f"{node}/{port}"
            yield Action(own, _ACTION_TYPES[kind], name, kind, node)


def _action_ports(system: ControllerInterface) -> list[str]:
    names = [
        system.get_input_port(index).get_name()
        for index in range(system.num_input_ports())
    ]
    return [
        name
        for name in names
        if name in ACTIONS or message_type(system, name) is ActionRequest
    ]
