"""The topics of a diagram by their names in ROS and in Gazebo."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.controllers.joint_state_broadcaster import JointStateBroadcaster
from arm_drake.controllers.topics import GRIPPER_COMMAND
from arm_drake.description.bridge import TopicAlias
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.manager import MANAGER, ControllerManager
from arm_drake.manager.connections import exported_name, with_prefix
from arm_drake.messages import (
    ActionRequest,
    Float32,
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    Goal,
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    JointState,
    JointTrajectory,
    Message,
    MultiDOFCommand,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
    SpeedScalingFactor,
    Twist,
    TwistStamped,
)
from arm_drake.messages.base import renew

# A class of messages; in a class with a field `type` it has no other name.
_Kind: TypeAlias = type[Message]

# Input ports of controllers.
ACTIONS: Mapping[str, tuple[type, ...]] = {
    "follow_joint_trajectory": (FollowJointTrajectoryGoal,),
    "gripper_cmd": (GripperCommandGoal, ParallelGripperCommandGoal),
}
TOPIC = "joint_trajectory"
COMMANDS = "commands"
REFERENCE = "reference"
VELOCITY = "cmd_vel"
SPEED_SCALING = "speed_scaling_input"


@dataclass(frozen=True)
class ControllerTopics:
    """Makes messages for one controller, or an error that says what it takes."""

    # Name of the controller with its robot's prefix, and its ros2_control type.
    name: str
    type: str

    system: ControllerInterface

    def check(self, port: str) -> None:
        """Raise InputError if the controller has no such input port."""
        if self.system.HasInputPort(port):
            return
        names = [
            self.system.get_input_port(index).get_name()
            for index in range(self.system.num_input_ports())
        ]
        topics = ", ".join(name for name in names if not interfaces.is_internal(name))
        takes = f"; it takes {topics}" if topics else ""
        raise InputError(
            f"controller {self.name!r} of type {self.type!r} has no {port}{takes}"
        )

    def exported_as(self, port: str) -> str:
        """Return the name in the diagram of a port of the controller."""
        own = self.system.params.controller_name
        return with_prefix(self.name.removesuffix(own), exported_name(port, own))

    def find_action(self) -> str:
        """Return the port of the controller's action, or raise InputError."""
        for port in ACTIONS:
            if self.system.HasInputPort(port):
                return port
        self.check(next(iter(ACTIONS)))
        raise AssertionError

    def make_goal(
        self, requested: Goal | JointTrajectory | GripperCommand
    ) -> tuple[str, Goal]:
        """Return the port of the controller's action, and a goal as it takes it.

        A goal may be its trajectory or command alone. What it can't take is an
        InputError.
        """
        goal: Any = requested
        if isinstance(requested, JointTrajectory):
            goal = FollowJointTrajectoryGoal(trajectory=requested)
        elif isinstance(requested, GripperCommand):
            goal = GripperCommandGoal(requested)
        kind = getattr(self.system, "goal_type", None)
        if kind is ParallelGripperCommandGoal and isinstance(goal, GripperCommandGoal):
            goal = _parallel_goal(goal.command)
        is_trajectory = isinstance(goal, FollowJointTrajectoryGoal)
        if is_trajectory and kind in (GripperCommandGoal, ParallelGripperCommandGoal):
            text = "a gripper takes no trajectory; give it"
            raise self._error(
                f"{text} gripper_command: {{position: ..., max_effort: ...}}"
            )
        for port, kinds in ACTIONS.items():
            if isinstance(goal, kinds):
                self.check(port)
        if kind is not None and not isinstance(goal, kind):
            raise self._error(
                f"expected a {kind.__name__}, got a {type(goal).__name__}"
            )
        return self.find_action(), goal

    def make_command(
        self, values: Sequence[float], values_dot: Sequence[float] = ()
    ) -> tuple[str, Float64MultiArray | MultiDOFCommand]:
        """Return the port on which the controller takes commands, and the message.

        The values are of its interfaces, or references, in its order; references may
        have rates of change. What it can't take is an InputError.
        """
        system = self.system
        if self._takes(COMMANDS, Float64MultiArray):
            if len(values_dot):
                raise self._error("it takes no rates (values_dot)")
            data = self._check_values(values, system.command_interfaces)
            return COMMANDS, Float64MultiArray(data)
        if not self._takes(REFERENCE, MultiDOFCommand):
            if system.HasInputPort(COMMANDS):
                raise self._error(f"its {COMMANDS} aren't numbers; see `sim.topic`")
            self.check(COMMANDS)
        # All names of the first interface come first.
        prefix = f"{system.params.controller_name}/"
        references = [n.removeprefix(prefix) for n in system.reference_interfaces]
        num_dofs = len(system.command_interfaces)
        dofs, rates = references[:num_dofs], references[num_dofs:]
        data = self._check_values(values, dofs)
        data_dot: tuple[float, ...] = ()
        if len(values_dot):
            if not rates:
                second = "a second one of reference_and_state_interfaces"
                raise self._error(f"it takes no rates (values_dot) without {second}")
            data_dot = self._check_values(values_dot, rates)
        names = tuple(dof.rpartition("/")[0] for dof in dofs)
        return REFERENCE, MultiDOFCommand(names, data, data_dot)

    def make_velocity(self, twist: Twist) -> tuple[str, Twist | TwistStamped]:
        """Return the port on which a base takes velocities, and the message.

        If it takes none, it is an InputError.
        """
        message = TwistStamped(twist=twist)
        types = getattr(self.system, "message_types", {})
        for port in (VELOCITY, REFERENCE):
            if types.get(port) is TwistStamped:
                return port, message
        for port, kind in types.items():
            # Gazebo's plugins call their ports as their tags say.
            if kind is Twist and port.startswith("/"):
                return port, renew(twist)
        self.check(VELOCITY)
        raise AssertionError

    def make_trajectory(
        self, trajectory: JointTrajectory
    ) -> tuple[str, JointTrajectory]:
        """Return the port on which the controller takes trajectories, and a new one.

        If it takes none, it is an InputError.
        """
        self.check(TOPIC)
        # A copy: the same message once more is a new one.
        return TOPIC, renew(trajectory)

    def _takes(self, port: str, kind: _Kind) -> bool:
        """Return whether the controller has a port that takes messages of a kind."""
        types = getattr(self.system, "message_types", {})
        return self.system.HasInputPort(port) and types.get(port, kind) is kind

    def make_speed_scaling(self, factor: float) -> tuple[str, SpeedScalingFactor]:
        """Return the speed-scaling port of the controller, and its message.

        The factor is at least 0. Without such a port it is an InputError.
        """
        self.check(SPEED_SCALING)
        if not _is_finite(factor) or factor < 0.0:
            raise self._error(
                f"expected a speed scaling factor of at least 0, got {factor!r}"
            )
        return SPEED_SCALING, SpeedScalingFactor(float(factor))

    def _check_values(
        self, values: Sequence[float], names: Sequence[str]
    ) -> tuple[float, ...]:
        """Return finite numbers, one for each name."""
        noun = "value" if len(names) == 1 else "values"
        expected = f"expected {len(names)} {noun} ({', '.join(names)})"
        try:
            numbers = list(values)
        except TypeError:
            raise self._error(f"{expected}, got {values!r}") from None
        if len(numbers) != len(names):
            raise self._error(f"{expected}, got {len(numbers)}")
        for name, value in zip(names, numbers, strict=True):
            if not _is_finite(value):
                raise self._error(f"{name}: expected a finite number, got {value!r}")
        return tuple(map(float, numbers))

    def _error(self, problem: str) -> InputError:
        return InputError(f"controller {self.name!r}: {problem}")


def _is_finite(value: Any) -> bool:
    """Return whether a value is a finite number."""
    try:
        return not isinstance(value, bool) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def _parallel_goal(command: GripperCommand) -> ParallelGripperCommandGoal:
    """Return what a command is to a gripper with limits; no effort is the default."""
    effort = (command.max_effort,) if command.max_effort else ()
    state = JointState(position=(command.position,), effort=effort)
    return ParallelGripperCommandGoal(state)


def describe_grip(
    result: GripperCommandResult | ParallelGripperCommandResult,
    position: Sequence[float],
) -> str:
    """Return how a gripper's motion ended, at [rad] or [m], if it did by itself."""
    if not (result.stalled or result.reached_goal):
        return ""
    how = "stalled" if result.stalled else "reached the goal"
    return f", {how} at {', '.join(f'{q:.4g}' for q in position)}"


# Services of controllers that their handles have, and of the manager what does them.
_SERVICES = ("query_state", "set_parameters")
_MANAGER_SERVICES = {
    "switch_controller": "switch_controllers",
    "list_controllers": "list_controllers",
}

# Events for the Simulation; no topic of ROS.
_EVENTS = "events"

# Where all of a robot publish where their frames are, in ROS.
_TF = "/tf"

# Gazebo's default name has the index of the joint's axis; there is but one.
_AXIS = re.compile(r"^(/model/.+/joint/.+)/0(/cmd_pos)$")


class VirtualTopic(NamedTuple):
    """A topic that no controller has, but that one can receive in its own way."""

    message_type: type[Message]

    # Whether it can be told to a controller; the name stands for the only one.
    is_for: Callable[[ControllerInterface], bool]

    # What is published, and on which of its ports, for a message on the topic.
    make: Callable[[ControllerInterface, Message], tuple[str, Message]]


# By their names.
VIRTUAL_TOPICS: dict[str, VirtualTopic] = {
    f"/{GRIPPER_COMMAND}": VirtualTopic(
        Float32,
        lambda system: system.HasInputPort(GRIPPER_COMMAND),
        lambda system, message: (GRIPPER_COMMAND, message),
    )
}


class TopicPort(NamedTuple):
    """A port of a controller, or of a camera or lidar, that is a topic."""

    manager: ControllerManager
    system: Any

    # Name at the controller; "" is that of a virtual topic.
    port: str

    virtual: VirtualTopic | None = None

    @property
    def controller(self) -> str:
        """Name of the controller with its robot's prefix."""
        return f"{self.manager.prefix}{self.system.params.controller_name}"

    def exported_as(self, port: str) -> str:
        """Return the name in the diagram of a port of the same controller."""
        name = exported_name(port, self.system.params.controller_name)
        return with_prefix(self.manager.prefix, name)


def sensor_type(port: TopicPort) -> type[Message] | None:
    """Return the class of a camera's or lidar's messages on a port; None of others."""
    kind: type[Message] | None = getattr(port.system, "output_types", {}).get(port.port)
    return kind


class Topic(NamedTuple):
    """Subscribers and publishers of a topic."""

    name: str
    inputs: tuple[TopicPort, ...] = ()
    outputs: tuple[TopicPort, ...] = ()

    # Bridges between this name and that of the ports.
    aliases: tuple[TopicAlias, ...] = ()


class TopicNames:
    """Finds topics by name.

    A name is `/<controller>/<topic>`, or that of a port which starts with a slash, or
    one that a bridge of the robot gives. With several robots `/<robot>` stands in
    front; what only one of them has is found without it, too. So it is with the name
    space of a robot alone, which stands in front of what doesn't start with a slash.
    """

    def __init__(self, managers: Mapping[str, ControllerManager]) -> None:
        """Create it for the controller managers of all robots."""
        self._robots = [_RobotTopics(manager) for manager in managers.values()]

    def find(self, name: str) -> Topic:
        """Return the topic of a name; a slash in front may be left out.

        If there is none, or several robots have it, it is an InputError.
        """
        if not isinstance(name, str) or not name.strip("/"):
            raise InputError(f"expected the name of a topic, got {name!r}")
        key = _key(name)
        found = [topic for robot in self._robots for topic in robot.find(key)]
        if len(found) > 1:
            names = ", ".join(repr(topic.name) for topic in found)
            raise InputError(f"several robots have a topic {key!r}; known: {names}")
        if found:
            return found[0]
        for robot in self._robots:
            robot.explain(key)
        known = (topic.name for topic in self.all())
        raise InputError(f"no topic {name!r}; {suggest(key, known)}")

    def all(self) -> list[Topic]:
        """Return the topics, robot by robot, those by other names last."""
        return [topic for robot in self._robots for topic in robot.all()]


class _RobotTopics:
    """Topics of one robot; its names in ROS are without the robot's."""

    def __init__(self, manager: ControllerManager) -> None:
        self._manager = manager
        self._root = f"/{manager.prefix}"
        # Where its nodes are below that: in the name space of a robot alone.
        self._space = manager.namespace.removeprefix(self._root.rstrip("/"))
        self._topics: dict[str, Topic] = {}
        # Further names of topics.
        self._same: dict[str, str] = {}
        # Controllers of actions, by the actions' names.
        self._actions: dict[str, str] = {}
        for system in self._systems():
            self._add(system)
        for sensor in manager.sensors:
            for port, kind in sensor.output_types.items():
                topic = self._topic(sensor.topic_of(port))
                first = next(iter(topic.outputs), None)
                if first is None or sensor_type(first) is kind:
                    new = (*topic.outputs, TopicPort(manager, sensor, port))
                    self._topics[_key(topic.name)] = topic._replace(outputs=new)
        self._aliases: dict[str, list[TopicAlias]] = {}
        for alias in manager.robot.topic_aliases:
            is_full = alias.ros_name.startswith("/")
            name = alias.ros_name if is_full else f"{self._space}/{alias.ros_name}"
            self._aliases.setdefault(_key(name), []).append(alias)

    def find(self, key: str) -> Iterator[Topic]:
        """Yield the topic of a name, if there is one."""
        for own in self._names(key):
            topic = self._find(own)
            if topic is not None:
                yield topic._replace(name=self._root + topic.name[1:])
                return

    def all(self) -> Iterator[Topic]:
        """Yield the topics, their own names first."""
        for name in dict.fromkeys((*self._topics, *VIRTUAL_TOPICS, *self._aliases)):
            yield from self.find(name)

    def explain(self, key: str) -> None:
        """Raise InputError if a name is known and none of a topic."""
        for own in self._names(key):
            self._explain(key, own)

    def _explain(self, key: str, own: str) -> None:
        if own in self._aliases:
            alias = self._aliases[own][0]
            raise InputError(
                f"topic {key!r} is bridged to {alias.gz_name!r} ({alias.place}), which "
                f"nobody has; {suggest(_key(alias.gz_name), self._topics)}"
            )
        several = self._virtual_ports(own)
        if len(several) > 1:
            listed = ", ".join(repr(port.controller) for port in several)
            problem = f"topic {key!r} may be meant for {listed}; use their own"
            raise InputError(f"{problem} topics or actions")
        for action, controller in self._actions.items():
            if own == action or own.startswith(f"{action}/_action/"):
                raise InputError(
                    f"{key!r} is an action, not a topic; "
                    f"sim.controller({controller!r}).send_goal sends to it"
                )
        node, _, service = own.removeprefix(self._space)[1:].rpartition("/")
        names = [system.params.controller_name for system in self._systems()]
        call = ""
        if node == MANAGER and service in _MANAGER_SERVICES:
            call = f"sim.{_MANAGER_SERVICES[service]}"
        elif node in names and service in _SERVICES:
            call = f"sim.controller({self._manager.prefix + node!r}).{service}"
        if call:
            raise InputError(f"{key!r} is a service, not a topic; {call} calls it")

    def _names(self, key: str) -> Iterable[str]:
        """Return what may be meant: without the robot's name, in its name space."""
        is_below = len(self._root) > 1 and key.startswith(self._root)
        own = f"/{key[len(self._root) :]}" if is_below else key
        return dict.fromkeys((key, own, f"{self._space}{own}"))

    def _systems(self) -> list[ControllerInterface]:
        systems = [controller.system for controller in self._manager.controllers]
        return [system for system in systems if system is not None]

    def _add(self, system: ControllerInterface) -> None:
        """Add the topics of a controller."""
        name = system.params.controller_name
        node = f"{self._space}/{name}"
        for index in range(system.num_input_ports()):
            port = system.get_input_port(index).get_name()
            if not exported_name(port, name):
                continue
            if port in ACTIONS or message_type(system, port) is ActionRequest:
                self._actions[f"{node}/{port}"] = f"{self._manager.prefix}{name}"
                continue
            topic = self._topic(_own_name(port, node))
            new = (*topic.inputs, TopicPort(self._manager, system, port))
            self._topics[_key(topic.name)] = topic._replace(inputs=new)
        for index in range(system.num_output_ports()):
            port = system.get_output_port(index).get_name()
            if not exported_name(port, name) or port == _EVENTS:
                continue
            own = _own_name(port, node)
            if isinstance(system, JointStateBroadcaster) and not self._is_local(name):
                self._same[own] = own = f"{self._space}/{port}"
            for each in (own, _TF) if f"/{port}" == _TF else (own,):
                topic = self._topic(each)
                new = (*topic.outputs, TopicPort(self._manager, system, port))
                self._topics[_key(topic.name)] = topic._replace(outputs=new)

    def _topic(self, own: str) -> Topic:
        return self._topics.get(_key(own), Topic(own))

    def _is_local(self, broadcaster: str) -> bool:
        """Return whether a broadcaster's topics have its name in front."""
        for controller in self._manager.robot.controllers.controllers:
            if controller.name == broadcaster:
                parameter = controller.parameters.get("use_local_topics")
                return parameter is not None and bool(parameter.value)
        return False

    def _find(self, own: str) -> Topic | None:
        own = self._same.get(own, own)
        if own in self._topics:
            return self._topics[own]
        ports = self._virtual_ports(own)
        if len(ports) == 1:
            return Topic(own, inputs=ports)
        pairs = [
            (alias, topic)
            for alias in self._aliases.get(own, ())
            for topic in self._bridged(alias)
        ]
        if not pairs:
            return None
        return Topic(
            own,
            tuple(p for alias, t in pairs if alias.is_to_gz for p in t.inputs),
            tuple(p for alias, t in pairs if alias.is_to_ros for p in t.outputs),
            tuple(alias for alias, _ in pairs),
        )

    def _bridged(self, alias: TopicAlias) -> Iterator[Topic]:
        """Yield the topic that a bridge connects; a launch file's may be relative."""
        name = _key(alias.gz_name)
        for own in dict.fromkeys((name, f"{self._space}{name}")):
            if own in self._topics:
                yield self._topics[own]
                return

    def _virtual_ports(self, own: str) -> tuple[TopicPort, ...]:
        virtual = VIRTUAL_TOPICS.get(own)
        if virtual is None:
            return ()
        return tuple(
            TopicPort(self._manager, system, "", virtual)
            for system in self._systems()
            if virtual.is_for(system)
        )


def _key(name: str) -> str:
    """Return a full name, without the index of a joint's only axis."""
    return _AXIS.sub(r"\1\2", "/" + name.strip("/"))


def _own_name(port: str, node: str) -> str:
    return port if port.startswith("/") else f"{node}/{port}"


def message_type(system: ControllerInterface, port: str) -> type[Message] | None:
    """Return what a controller says that it expects on an input port, if it does."""
    types: Mapping[str, type[Message]] = getattr(system, "message_types", {})
    return types.get(port)
