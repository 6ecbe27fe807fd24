"""What a program holds of a topic."""

import dataclasses as dc
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.errors import InputError
from arm_drake.messages import (
    Bool,
    Float32,
    Float64,
    Float64MultiArray,
    JointTrajectory,
    Message,
    MultiDOFCommand,
    SendGoal,
    SpeedScalingFactor,
    TFMessage,
    Twist,
    TwistStamped,
)
from arm_drake.messages.checks import to_message
from arm_drake.simulation.controller_topics import (
    COMMANDS,
    REFERENCE,
    SPEED_SCALING,
    TOPIC,
    ControllerTopics,
)
from arm_drake.simulation.directory import TopicInfo, TopicList
from arm_drake.simulation.mailbox import GoalHandle, Mailbox
from arm_drake.simulation.topics import Topic, TopicNames, TopicPort, message_type

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
        """Create the handle; `Simulation.topic` does that.

        Args:
            mailbox: Of the simulation where the topic is.
            topic: Who takes its messages, and who publishes them.
        """
        self.name = topic.name
        self._mailbox = mailbox
        self._topic = topic

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names of the controllers that take its messages."""
        return tuple(port.controller for port in self._topic.inputs)

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
            if isinstance(message, SendGoal):
                self._mailbox.add_goal(GoalHandle(reader.controller, message, where))
        for name, message in messages.items():
            if where:
                self._mailbox.add_message(message, where)
            self._mailbox.publish(name, message, periods[name])

    def value(self) -> Any:
        """Return the latest message that was published on the topic.

        Of frames it is the latest of each that anybody tells.

        Raises:
            InputError: If nobody publishes on it.
        """
        outputs = self._topic.outputs
        if not outputs:
            self._check_direction("GZ_TO_ROS", "reading")
            raise InputError(
                f"nobody publishes on topic {self.name!r}; "
                f"{_list(self.controllers)} takes its messages"
            )
        values = [
            self._mailbox.eval_output(port.exported_as(port.port)) for port in outputs
        ]
        if all(isinstance(value, TFMessage) for value in values):
            return _merge(values)
        # Without a stamp they are all as new; the first of equals is taken.
        return max(values, key=_stamp)

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
            return dc.replace(data)  # type: ignore[type-var]
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
        given = f"a {type(data).__name__}" if dc.is_dataclass(data) else repr(data)
        raise InputError(f"topic {self.name!r} takes {takes}, got {given}")

    def _check_direction(self, needed: str, doing: str) -> None:
        """Raise InputError if bridges of the topic go the other way alone."""
        for alias in self._topic.aliases:
            if alias.direction not in (needed, "BIDIRECTIONAL"):
                raise InputError(
                    f"topic {self.name!r} is bridged {alias.direction} "
                    f"({alias.place}); {doing} needs {needed} or BIDIRECTIONAL"
                )


def input_type(port: TopicPort) -> type[Message]:
    """Return what is expected on a port.

    Args:
        port: An input.
    """
    if port.virtual is not None:
        return port.virtual.message_type
    return message_type(port.system, port.port) or _TYPES.get(port.port, Message)


def list_topics(names: TopicNames, eval_output: Callable[[str], Any]) -> TopicList:
    """Return the topics, with the classes of their messages.

    Args:
        names: The topics.
        eval_output: Returns the value of an output port of the diagram.
    """
    rows = TopicList()
    for topic in names.all():
        bridged_to = tuple(alias.gz_name for alias in topic.aliases)
        for port in topic.inputs[:1]:
            kind = input_type(port).__name__
            rows.append(TopicInfo(topic.name, kind, "input", bridged_to))
        for port in topic.outputs[:1]:
            kind = type(eval_output(port.exported_as(port.port))).__name__
            rows.append(TopicInfo(topic.name, kind, "output", bridged_to))
    return rows


def _merge(messages: Sequence[TFMessage]) -> TFMessage:
    """Return one message with all frames, of equal ones the latest."""
    if len(messages) == 1:
        return messages[0]
    told = (transform for message in messages for transform in message.transforms)
    return TFMessage(
        tuple({t.child_frame_id: t for t in sorted(told, key=_stamp)}.values())
    )


def _stamp(message: Any) -> tuple[int, int]:
    header = getattr(message, "header", None)
    return (header.stamp.sec, header.stamp.nanosec) if header else (0, 0)


def _is_sequence(data: Any) -> bool:
    """Return whether data is several numbers, and not a text or a message."""
    if isinstance(data, str | bytes) or dc.is_dataclass(data):
        return False
    return isinstance(data, Sequence) or getattr(data, "ndim", 0) > 0


def _list(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in dict.fromkeys(names))
