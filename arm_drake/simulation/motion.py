"""The steps of a motion, and how long they take."""

import dataclasses as dc
import itertools
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from arm_drake.messages import (
    FollowJointTrajectoryGoal,
    JointTrajectory,
    Message,
    SpeedScalingFactor,
)
from arm_drake.plant.payloads import Payload

# One of those of `motion_files.STEP_KINDS`; None cancels the controller's goal. Numbers
# are for any controller that takes commands, also as another message.
StepMessage: TypeAlias = Message | None


class TopicMessage(NamedTuple):
    """What is sent to a topic, whose type only the robot knows."""

    # Name as in ROS or Gazebo.
    topic: str

    # Fields of its message, if it is a mapping.
    data: float | bool | tuple[float, ...] | JointTrajectory | Mapping[str, Any]


class CarriedPayloads(NamedTuple):
    """Things that links carry from now on, by link."""

    payloads: Mapping[str, Payload]


# What a step stands for.
Sent: TypeAlias = StepMessage | TopicMessage | CarriedPayloads


# End of the name of the topic on which controllers are told how fast to move.
_SPEED_TOPIC = "/speed_scaling_input"


@dc.dataclass(frozen=True)
class MotionStep:
    """Something that is sent to a controller, a topic, or the controller manager."""

    # When, from the start of the motion [s].
    at: float

    # Name of the controller; None is a topic, the controller manager, or links.
    controller: str | None

    message: Sent

    # Place in the file, for messages.
    where: str

    # Time between the messages of a step that has several [s].
    every: float = 0.0


@dc.dataclass(frozen=True)
class Motion:
    """The steps of a motion file, in the order of their times."""

    file: Path | None
    steps: tuple[MotionStep, ...]

    # Whether it starts over when it is done.
    repeats: bool = False

    # Values that were given to its parameters, in place of their defaults.
    parameters: Mapping[str, Any] = dc.field(default_factory=dict)

    @property
    def duration(self) -> float:
        """When the last step is done, trajectories at their scaled speed [s].

        Of a motion that repeats it is that of one round: the next one starts when a
        further message of its steps would be due.
        """
        factors: dict[str | None, list[tuple[float, float]]] = {}
        for step in self.steps:
            factor = _speed_of(step.message)
            if factor is not None:
                factors.setdefault(_receiver(step), []).append((step.at, factor))
        ends = [_end(step, factors.get(_receiver(step), ())) for step in self.steps]
        if self.repeats:
            ends += [step.at + step.every for step in self.steps]
        return max(ends, default=0.0)

    def timeline(self) -> Iterator[tuple[float, MotionStep]]:
        """Yield when each step is due [s], and the step; for ever if it repeats."""
        duration = self.duration if self.repeats else 0.0
        for number in itertools.count() if self.repeats else range(1):
            for step in self.steps:
                yield number * duration + step.at, step

    def place(self, step: MotionStep) -> str:
        """Return where a step stands, for messages."""
        return f"{self.file}: {step.where}" if self.file else step.where


def _receiver(step: MotionStep) -> str | None:
    """Return the controller that a step is for, also if it is a topic of one."""
    if isinstance(step.message, TopicMessage):
        return step.message.topic.strip("/").rpartition("/")[0]
    return step.controller


def _speed_of(message: Sent) -> float | None:
    """Return how fast trajectories are to be followed, if a message says so."""
    if isinstance(message, SpeedScalingFactor):
        return message.factor
    if isinstance(message, TopicMessage) and message.topic.endswith(_SPEED_TOPIC):
        data = message.data
        return float(data) if isinstance(data, int | float) else None
    return None


def _end(step: MotionStep, factors: Iterable[tuple[float, float]]) -> float:
    """Return when a step is done [s], given its controller's changes of speed."""
    message = step.message
    if isinstance(message, TopicMessage):
        message = message.data if isinstance(message.data, JointTrajectory) else None
    elif isinstance(message, FollowJointTrajectoryGoal):
        message = message.trajectory
    if not isinstance(message, JointTrajectory) or not message.points:
        return step.at
    # A stamp counts from the start of the simulation.
    start = max(step.at, message.header.stamp.to_seconds())
    length = message.points[-1].time_from_start.to_seconds()
    return _scaled_end(start, max(0.0, length), factors)


def _scaled_end(
    start: float, length: float, factors: Iterable[tuple[float, float]]
) -> float:
    """Return when a trajectory ends [s]; if it stops for ever, when it does.

    It takes `length` [s] at full speed; `factors` say from when [s] its time passes how
    fast, in order.
    """
    now, speed = start, 1.0
    for at, factor in factors:
        if at > now:
            done = (at - now) * speed
            if done >= length:
                break
            now, length = at, length - done
        speed = factor
    return now + length / speed if speed > 0.0 else now
