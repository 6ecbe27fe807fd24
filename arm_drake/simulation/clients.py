"""Handles of controllers and topics: goals, commands, and parameters at run time.

Parameters are read as the loader reads a YAML. Which ones may change is that of
ros2_controllers' parameter declarations (version 6.9.0, `read_only`).
"""

import dataclasses as dc
import fnmatch
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.controllers import find_controller_type
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.controllers import ControllerConfig
from arm_drake.description.parameters import Parameter, Parameters, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import ArmDrakeWarning, InputError, ParameterError
from arm_drake.messages import (
    Bool,
    CancelGoal,
    Float32,
    Float64,
    Float64MultiArray,
    Goal,
    GripperCommand,
    JointTrajectory,
    Message,
    MultiDOFCommand,
    QueryTrajectoryState,
    SendGoal,
    SpeedScalingFactor,
    SwitchController,
    TFMessage,
    Time,
    TimeLike,
    Twist,
    TwistStamped,
)
from arm_drake.messages.base import renew, stamp_of, to_message
from arm_drake.simulation.directory import TopicInfo, TopicList
from arm_drake.simulation.mailbox import GoalHandle, Mailbox
from arm_drake.simulation.motion import StepMessage
from arm_drake.simulation.motion_files import make_message
from arm_drake.simulation.topics import (
    COMMANDS,
    REFERENCE,
    SPEED_SCALING,
    TOPIC,
    ControllerTopics,
    Topic,
    TopicNames,
    TopicPort,
    message_type,
    sensor_type,
)


class ControllerHandle:
    """Sends to one controller, and reads it, whether it is active or not."""

    def __init__(
        self,
        mailbox: Mailbox,
        robot: Robot,
        name: str,
        system: ControllerInterface,
        type_: str,
    ) -> None:
        """Create the handle; `Simulation.controller` does that."""
        self.name = name
        self._mailbox, self._robot = mailbox, robot
        self._system, self._type = system, type_
        self._topics = ControllerTopics(name, type_, system)

    def __repr__(self) -> str:
        """Return which controller it is for."""
        return f"<ControllerHandle {self.name!r} of type {self._type!r}>"

    def check(self, message: StepMessage) -> None:
        """Raise InputError if the controller takes no such message.

        Args:
            message: What a step of a motion sends.
        """
        if message is None:
            self._topics.find_action()
        elif not isinstance(message, SwitchController):
            make_message(self._topics, message)

    def find_lasting_fault(self, message: object) -> str:
        """Return why the controller refuses a message whenever it comes, or "".

        Args:
            message: One for its topic, or a goal for its action.
        """
        root = self._mailbox.simulator.get_context()
        context = self._system.GetMyContextFromRoot(root)
        return self._system.find_lasting_fault(context, message)

    def command(
        self,
        values: Sequence[float],
        *,
        values_dot: Sequence[float] = (),
        where: str = "",
    ) -> None:
        """Send commands, which hold from the controller's next tick on.

        Args:
            values: Command interfaces' values in the order of a forward controller, or
                references of a PidController's degrees of freedom, in their units.
            values_dot: Rates of change of these references, or none.
            where: Where they come from, for messages.

        Raises:
            InputError: If the controller takes none, others, or so many.
        """
        port, message = self._topics.make_command(values, values_dot)
        self._send(port, message, where)

    def schedule_commands(self, rows: Iterable[tuple[float, Sequence[float]]]) -> None:
        """Have commands sent when it is their time, in place of others that wait.

        Args:
            rows: Simulated times [s], and values as those of `command`.

        Raises:
            InputError: If the controller takes none, others, or so many.
        """
        made = [(at, *self._topics.make_command(values)) for at, values in rows]
        for port in dict.fromkeys(port for _, port, _ in made):
            messages = [(at, message) for at, _, message in made]
            period = 1.0 / self._system.params.update_rate
            exported = self._topics.exported_as(port)
            self._mailbox.schedule(exported, messages, period)
        self._mailbox.publish_due(self._mailbox.time)

    def send_goal(
        self, goal: Goal | JointTrajectory | GripperCommand, *, where: str = ""
    ) -> GoalHandle:
        """Send a goal to the controller's action; it sees it at its next tick.

        A controller that isn't active rejects it; a gripper's only if it never was.

        Args:
            goal: The goal, or its trajectory or command alone. Any gripper takes a
                GripperCommand. A trajectory beyond limits of joints is sent with an
                ArmDrakeWarning.
            where: Where the goal comes from, for messages; then there is no warning.

        Raises:
            InputError: If the controller has no such action.
        """
        port, made = self._topics.make_goal(goal)
        if not where:
            _warn_of_limits(self._mailbox, self._robot, self.name, self._system, made)
        request = SendGoal(made)
        handle = GoalHandle(self.name, request, where)
        self._mailbox.add_goal(handle)
        self._send(port, request)
        return handle

    def send_velocity(self, twist: Twist, *, where: str = "") -> None:
        """Send a velocity to a base; controllers stop it when no more is heard.

        Args:
            twist: Velocity in the frame of the base [m/s], [rad/s].
            where: Where it comes from, for messages.

        Raises:
            InputError: If the controller takes no velocities.
        """
        port, message = self._topics.make_velocity(twist)
        self._send(port, message, where)

    def send_trajectory(self, trajectory: JointTrajectory, *, where: str = "") -> None:
        """Send a trajectory to the controller's topic.

        Args:
            trajectory: What to follow from the controller's next tick on.
            where: Where it comes from, for messages. Without it there is an
                ArmDrakeWarning of what goes beyond limits of joints, for the first
                hundred trajectories of an instant.

        Raises:
            InputError: If the controller has no such topic.
        """
        port, message = self._topics.make_trajectory(trajectory)
        if not where:
            robot, system = self._robot, self._system
            _warn_of_limits(self._mailbox, robot, self.name, system, message)
        self._send(port, message, where)

    def cancel(self, goal: GoalHandle | None = None) -> None:
        """Cancel a goal, if it isn't done.

        Args:
            goal: What `send_goal` returned; by default the last one that was sent to
                the controller, if there is one.
        """
        goals = [g for g in self._mailbox.goals if g.controller == self.name]
        goals = goals if goal is None else [goal]
        if goals and not goals[-1].status.is_terminal:
            request = CancelGoal(goals[-1].request)
            self._send(self._topics.find_action(), request)

    def set_speed_scaling(self, factor: float, *, where: str = "") -> None:
        """Let time pass faster or slower along the controller's trajectories.

        Args:
            factor: How fast, at least 0; 1 is real time, 0 pauses.
            where: Where it comes from, for messages.

        Raises:
            InputError: If the factor is none, or the controller has no such topic.
        """
        port, message = self._topics.make_speed_scaling(factor)
        self._send(port, message, where)

    def set_parameters(self, changes: Mapping[str, Any]) -> None:
        """Change parameters from the controller's next tick on.

        Args:
            changes: New values by name, as {"gains.joint1.p": 2.0} or nested.

        Raises:
            InputError: If the controller's parameters can't change.
            ParameterError: If one of them can't, isn't known, or has a bad value.
        """
        if not self._system.HasInputPort(interfaces.PARAMETERS_PORT):
            raise InputError(
                f"controller {self.name!r} of type {self._type!r}: no parameter can "
                "change while it runs"
            )

        root = self._mailbox.simulator.get_mutable_context()
        context = self._system.GetMyMutableContextFromRoot(root)
        publish_parameters(self._robot, self._system, context, changes)

    def query_state(self, time: TimeLike) -> QueryTrajectoryState:
        """Return what the controller plans for a time: the service `query_state`.

        Args:
            time: When [s].

        Raises:
            InputError: If the controller has no such service, or the time is none.
        """
        query = getattr(self._system, "query_state", None)
        if query is None:
            raise InputError(
                f"controller {self.name!r} of type {self._type!r} has no query_state"
            )
        try:
            moment = Time.of(time)
        except (ValueError, OverflowError) as error:
            raise InputError(f"controller {self.name!r}: time: {error}") from None
        root = self._mailbox.simulator.get_context()
        response: QueryTrajectoryState = query(
            self._system.GetMyContextFromRoot(root), moment
        )
        return response

    def state(self) -> Any:
        """Return the controller's `controller_state` message, as of its last tick.

        Raises:
            InputError: If the controller publishes none.
        """
        if not self._system.HasOutputPort("controller_state"):
            what = f"controller {self.name!r} of type {self._type!r}"
            raise InputError(f"{what} publishes no controller_state")
        return self._mailbox.eval_output(f"{self.name}.controller_state")

    def _send(self, port: str, message: Message, where: str = "") -> None:
        if where:
            self._mailbox.add_message(message, where)
        period = 1.0 / self._system.params.update_rate
        self._mailbox.publish(self._topics.exported_as(port), message, period)


def _warn_of_limits(
    mailbox: Mailbox, robot: Robot, name: str, system: Any, message: Message
) -> None:
    """Warn where a program's trajectory takes each joint beyond its limits first.

    Of motions, whose messages say where they come from, their player does.
    """
    sent = getattr(message, "goal", message)
    trajectory = getattr(sent, "trajectory", sent)
    if not isinstance(trajectory, JointTrajectory):
        return
    prefix = name.removesuffix(system.params.controller_name)
    found = mailbox.watch_limits(robot, prefix)
    if found is None:
        return
    watch, start = found
    lines: dict[str, str] = {}
    for index, joint, problem in watch.find(trajectory, start):
        lines.setdefault(joint, f"{name}: points[{index}]: {problem}")
    for line in lines.values():
        warnings.warn(line, ArmDrakeWarning, stacklevel=3)


def send_step(handle: ControllerHandle, message: StepMessage, where: str) -> None:
    """Send what a step of a motion sends to a controller."""
    if message is None:
        handle.cancel()
        return
    port, made = make_message(handle._topics, message)
    if isinstance(made, Goal):
        handle.send_goal(made, where=where)
    else:
        handle._send(port, made, where)


# What is expected on ports of controllers that don't say it.
_TYPES: dict[str, type[Message]] = {
    TOPIC: JointTrajectory,
    COMMANDS: Float64MultiArray,
    REFERENCE: MultiDOFCommand,
    "measured_state": MultiDOFCommand,
    SPEED_SCALING: SpeedScalingFactor,
}

# Messages of one number.
_NUMBERS: dict[type[Message], Callable[[float], Message]] = {
    Float64: Float64,
    Float32: Float32,
    SpeedScalingFactor: SpeedScalingFactor,
}

# Ports whose messages are numbers for what the controller commands, in its order.
_VALUES = (COMMANDS, REFERENCE)


class TopicHandle:
    """Sends to one topic, or reads it."""

    def __init__(self, mailbox: Mailbox, topic: Topic) -> None:
        """Create the handle; `Simulation.topic` does that."""
        self.name = topic.name
        self._mailbox = mailbox
        self._topic = topic

    def __repr__(self) -> str:
        """Return which topic it is."""
        return f"<TopicHandle {self.name!r}>"

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names of the controllers that take its messages."""
        return tuple(port.controller for port in self._topic.inputs)

    @property
    def sensors(self) -> tuple[Any, ...]:
        """Cameras and lidars that publish on it, in the order of `values`."""
        outputs = self._topic.outputs
        return tuple(port.system for port in outputs if sensor_type(port) is not None)

    def check(self, data: Any) -> None:
        """Raise InputError if the topic takes no such data, see `publish`.

        Args:
            data: What is to be published.
        """
        self._make(data)

    def publish(self, data: Any, *, where: str = "") -> None:
        """Publish a message, which controllers see at their next tick.

        Args:
            data: A number for a topic of numbers, a sequence for one of several, or the
                message itself.
            where: Where it comes from, for messages.

        Raises:
            InputError: If nobody takes messages of the topic, or others.
        """
        made = self._make(data)
        # Of several readers of one port, none may miss a message.
        periods: dict[str, float] = {}
        messages: dict[str, Message] = {}
        for reader, port, message in made:
            name, period = (
                reader.exported_as(port),
                1.0 / reader.system.params.update_rate,
            )
            periods[name] = max(period, periods.get(name, 0.0))
            messages.setdefault(name, message)
            if not where:
                robot, system = reader.manager.robot, reader.system
                _warn_of_limits(
                    self._mailbox, robot, reader.controller, system, message
                )
            if isinstance(message, SendGoal):
                self._mailbox.add_goal(GoalHandle(reader.controller, message, where))
        for name, message in messages.items():
            if where:
                self._mailbox.add_message(message, where)
            self._mailbox.publish(name, message, periods[name])

    def call(self, data: Any) -> Any:
        """Send a request and return its response, where the name is a request's.

        Args:
            data: The request, or a mapping of its fields.

        Raises:
            InputError: If it can't be, or the name is that of a topic.
        """
        raise InputError(f"{self.name!r} is a topic, which gives no answer; publish")

    def value(self) -> Any:
        """Return the latest message that was published on the topic.

        Of frames it is the latest of each that anybody tells.

        Raises:
            InputError: If nobody publishes on it.
        """
        values = self.values()
        if all(isinstance(value, TFMessage) for value in values):
            return _merge(values)
        # Without a stamp they are all as new; the first of equals is taken.
        return max(values, key=stamp_of)

    def values(self) -> tuple[Any, ...]:
        """Return the latest message of each that publishes on the topic.

        Raises:
            InputError: If nobody does.
        """
        outputs = self._topic.outputs
        if not outputs:
            self._check_direction("GZ_TO_ROS", "reading")
            raise InputError(
                f"nobody publishes on topic {self.name!r}; "
                f"{_list(self.controllers)} takes its messages"
            )
        return tuple(
            self._mailbox.eval_output(port.exported_as(port.port)) for port in outputs
        )

    def _make(self, data: Any) -> list[tuple[TopicPort, str, Message]]:
        """Return a message for each controller, and on which of its ports it goes."""
        if not self._topic.inputs:
            self._check_direction("ROS_TO_GZ", "publishing")
            names = [port.controller for port in self._topic.outputs]
            raise InputError(
                f"nobody takes messages of topic {self.name!r}; "
                f"{_list(names)} publishes on it"
            )
        return [self._make_for(reader, data) for reader in self._topic.inputs]

    def _make_for(self, reader: TopicPort, data: Any) -> tuple[TopicPort, str, Message]:
        if reader.virtual is not None:
            message = self._message(reader.virtual.message_type, data)
            return (reader, *reader.virtual.make(reader.system, message))
        expected = input_type(reader)
        is_named = expected in (Float64MultiArray, MultiDOFCommand)
        if reader.port in _VALUES and is_named and _is_sequence(data):
            type_ = type(reader.system).__name__
            topics = ControllerTopics(reader.controller, type_, reader.system)
            return (reader, *topics.make_command(data))
        return reader, reader.port, self._message(expected, data)

    def _message(self, expected: type[Message], data: Any) -> Message:
        """Return data as a message of a class, always a new one."""
        takes = f"a {expected.__name__}"
        if expected is Twist and self._topic.aliases:
            # Bridges take stamped ones, and leave the stamp out.
            if isinstance(data, Mapping) and "twist" in data:
                data = self._message(TwistStamped, data)
            if isinstance(data, TwistStamped):
                data = data.twist
        if isinstance(data, expected):
            return renew(data)
        if isinstance(data, Mapping) and expected is not Message:
            try:
                return to_message(data, expected, f"topic {self.name!r}")
            except ValueError as error:
                raise InputError(str(error)) from None
        try:
            if expected in _NUMBERS:
                takes = f"a finite number or {takes}"
                message = _NUMBERS[expected](data)
                if all(map(math.isfinite, vars(message).values())):
                    return message
            elif expected is Bool:
                takes = "true, false or a Bool"
                return Bool(data)
            elif expected is Float64MultiArray:
                takes = f"a list of finite numbers or {takes}"
                if _is_sequence(data):
                    message = Float64MultiArray(data)
                    if all(map(math.isfinite, message.data)):
                        return message
        except ValueError:
            pass
        got = f"a {type(data).__name__}" if dc.is_dataclass(data) else repr(data)
        raise InputError(f"topic {self.name!r} takes {takes}, got {got}")

    def _check_direction(self, needed: str, doing: str) -> None:
        """Raise InputError if bridges of the topic go the other way alone."""
        for alias in self._topic.aliases:
            if alias.direction not in (needed, "BIDIRECTIONAL"):
                raise InputError(
                    f"topic {self.name!r} is bridged {alias.direction} "
                    f"({alias.place}); {doing} needs {needed} or BIDIRECTIONAL"
                )


def input_type(port: TopicPort) -> type[Message]:
    """Return what is expected on a port."""
    if port.virtual is not None:
        return port.virtual.message_type
    return message_type(port.system, port.port) or _TYPES.get(port.port, Message)


def list_topics(names: TopicNames, eval_output: Callable[[str], Any]) -> TopicList:
    """Return the topics, with the classes of their messages."""
    rows = TopicList()
    for topic in names.all():
        bridged_to = tuple(alias.gz_name for alias in topic.aliases)
        for port in topic.inputs[:1]:
            kind = input_type(port).__name__
            rows.append(TopicInfo(topic.name, kind, "input", bridged_to))
        for port in topic.outputs[:1]:
            # What cameras take only to be read has its class told.
            kind = (
                sensor_type(port) or type(eval_output(port.exported_as(port.port)))
            ).__name__
            rows.append(TopicInfo(topic.name, kind, "output", bridged_to))
    return rows


def _merge(messages: Sequence[TFMessage]) -> TFMessage:
    """Return one message with all frames, of equal ones the latest."""
    if len(messages) == 1:
        return messages[0]
    transforms = (transform for message in messages for transform in message.transforms)
    return TFMessage(
        tuple({t.child_frame_id: t for t in sorted(transforms, key=stamp_of)}.values())
    )


def _is_sequence(data: Any) -> bool:
    """Return whether data is several numbers, and not a text or a message."""
    if isinstance(data, str | bytes) or dc.is_dataclass(data):
        return False
    return isinstance(data, Sequence) or getattr(data, "ndim", 0) > 0


def _list(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in dict.fromkeys(names))


# By the names of types, for few robots have all; of one that isn't here the controller
# itself decides.
_CHANGEABLE: dict[str, tuple[str, ...]] = {
    "PidControllerParameters": (
        "enable_feedforward",
        "gains.*",
        "set_current_state_as_first_setpoint",
    ),
    "JointTrajectoryControllerParameters": (
        "allow_integration_in_goal_trajectories",
        "allow_nonzero_velocity_at_trajectory_end",
        "allow_partial_joints_goal",
        "allow_trajectory_replacement",
        "cmd_timeout",
        "constraints.*.goal",
        "constraints.*.trajectory",
        "constraints.goal_time",
        "constraints.stopped_velocity_tolerance",
        "gains.*",
        "set_last_command_interface_value_as_state_on_activation",
    ),
}

# What the manager takes from a controller's parameters, once.
_OF_THE_MANAGER = ("update_rate", "use_sim_time")

_FIXED = "can't change while the controller runs"

# Where values come from that no file holds.
_NO_FILE = Path()


def publish_parameters(
    robot: Robot,
    system: ControllerInterface,
    context: Context,
    changes: Mapping[str, Any],
) -> None:
    """Put changed parameters on a controller's port, upon what was changed before."""
    config, schema = _find_schema(robot, system)
    assert schema is not None  # It could be loaded.
    present = _changed_before(system, context)
    parameters = _change_parameters(config, schema, present, changes, robot.distro)
    port = system.GetInputPort(interfaces.PARAMETERS_PORT)
    port.FixValue(context, AbstractValue.Make(parameters))


def list_parameters(
    robot: Robot, system: ControllerInterface, context: Context
) -> dict[str, Any]:
    """Return a controller's parameters by their dotted names, as they are now.

    A plugin of Gazebo has none.
    """
    config, schema = _find_schema(robot, system)
    if schema is None:
        return {}
    present = None
    if system.HasInputPort(interfaces.PARAMETERS_PORT):
        present = _changed_before(system, context)
    if present is None:
        present, _ = _load(schema, config, _own_parameters(config), robot.distro)
    return {name: _plain(value) for name, value in _leaves(present, "")}


def _changed_before(system: ControllerInterface, context: Context) -> Any:
    """Return the parameters that a controller was given while it runs, if any."""
    port = system.GetInputPort(interfaces.PARAMETERS_PORT)
    return port.Eval(context) if port.HasValue(context) else None


def _own_parameters(config: ControllerConfig) -> dict[str, Parameter]:
    """Return what the YAML gives a controller and not the manager."""
    return {n: p for n, p in config.parameters.items() if n not in _OF_THE_MANAGER}


def is_changeable(robot: Robot, system: ControllerInterface, name: str) -> bool:
    """Return whether a parameter of a controller may change while it runs."""
    if not system.HasInputPort(interfaces.PARAMETERS_PORT) or name in _OF_THE_MANAGER:
        return False
    _, schema = _find_schema(robot, system)
    if schema is None:
        return False
    patterns = _find_changeable(schema) or ("*",)
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)


def _find_schema(
    robot: Robot, system: ControllerInterface
) -> tuple[ControllerConfig, type | None]:
    """Return what the YAML says of a controller, and the class of its parameters.

    None for a plugin of Gazebo, whose tag it is that says how it is.
    """
    name = system.params.controller_name
    config = next(c for c in robot.controllers.controllers if c.name == name)
    row = find_controller_type(config.type, robot.controller_types or {})
    return config, None if row is None else row.parameters


def _change_parameters(
    config: ControllerConfig,
    schema: type,
    present: Any,
    changes: Mapping[str, Any],
    distro: str,
) -> Any:
    """Return a controller's parameters with some changed."""
    if not isinstance(changes, Mapping):
        problem = f"expected parameters by name, got {changes!r}"
        raise ParameterError(problem, where=config.name)
    new = _as_parameters(_flatten(changes, ""))
    for name in _OF_THE_MANAGER:
        if name in new:
            raise ParameterError(_FIXED, where=f"{config.name}.{name}")
    base = _own_parameters(config)
    first, _ = _load(schema, config, base, distro)
    present = first if present is None else present
    old = dict(_leaves(first, ""))
    earlier = _as_parameters(
        (name, _plain(value))
        for name, value in _leaves(present, "")
        if name in old and value != old[name]
    )
    changed, report = _load(schema, config, {**base, **earlier, **new}, distro)
    for entry in report:
        name = entry.where.removeprefix(f"{config.name}.")
        if name in new and entry.kind != "repair":
            raise ParameterError(entry.what, where=entry.where)
    _check_changes(config.name, present, changed)
    return changed


def _as_parameters(values: Iterable[tuple[str, Any]]) -> dict[str, Parameter]:
    return {name: Parameter(value, _NO_FILE, 0) for name, value in values}


def _load(
    schema: type, config: ControllerConfig, parameters: Parameters, distro: str
) -> tuple[Any, LoadReport]:
    report = LoadReport()
    try:
        loaded: Any = load_parameters(
            schema, parameters, config.name, config.file, report, distro=distro
        )
    except ParameterError as error:  # What is in the file is as it was.
        raise ParameterError(error.problem, where=error.where) from None
    return loaded, report


def _check_changes(controller: str, before: Any, after: Any) -> None:
    """Raise ParameterError if something changes that mustn't."""
    old, new = dict(_leaves(before, "")), dict(_leaves(after, ""))
    changeable = _find_changeable(type(after)) or ("*",)
    for name, value in new.items():
        if value != old.get(name) and not any(
            fnmatch.fnmatchcase(name, pattern) for pattern in changeable
        ):
            raise ParameterError(
                f"{_FIXED}; these can: {', '.join(changeable)}",
                where=f"{controller}.{name}",
            )


def _find_changeable(schema: type) -> tuple[str, ...]:
    """Return which parameters of a type may change; empty if that isn't known here."""
    found = (_CHANGEABLE.get(kind.__name__) for kind in schema.__mro__)
    return next(filter(None, found), ())


def _flatten(changes: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings by their dotted names."""
    for name, value in changes.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", _plain(value)


def _plain(value: Any) -> Any:
    """Return a value as a YAML would give it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _leaves(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of a parameters dataclass by their dotted names."""
    if dc.is_dataclass(value):
        for field in dc.fields(value):
            # The name of a group per element isn't part of its elements' names.
            own = "" if "per_element_of" in field.metadata else f".{field.name}"
            yield from _leaves(getattr(value, field.name), f"{name}{own}")
    elif isinstance(value, dict):
        for key, below in cast("dict[str, Any]", value).items():
            yield from _leaves(below, f"{name}.{key}")
    else:
        yield name.lstrip("."), value
