"""PIDs, forces and topics of Gazebo's joint plugins, and what of their tags isn't done.

The rule of a PID is that of gz-math's class ``PID`` (src/PID.cc), n at a time. An error
is measurement minus target, the other way round than in ros2_control, and a command
works against it. A limit whose maximum lies below its minimum is none. Errors are in
the unit of what is controlled, such as [rad] or [m]; commands in the unit that the
gains make of it.

Gazebo pushes every joint by itself, a mimic joint too. Here a mimic joint follows its
master rigidly and has no drive of its own, so the force at it acts on the master. With
dq_follower = m dq_master, both do the same work if the master's effort is m times the
force (virtual work).

Sources: gz-sim, src/systems/joint_position_controller/JointPositionController.cc and
those beside it; gz-transport, src/TopicUtils.cc; ROS 2's design, "Topic and Service
name mapping" and "Static Remapping of Names".
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array, Indices, Mask, clamp
from arm_drake.description.gazebo_plugins import (
    AckermannSteering,
    ApplyJointForce,
    ClassicBase,
    ContactSensorTag,
    GazeboRosDiffDrive,
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    ImuSensorTag,
    JointController,
    JointPlugin,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
    OdometryPublisher,
    VelocityControl,
    WheelDrive,
)
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS, Float64, Message, Twist


class GazeboPidState(NamedTuple):
    """State of n PIDs; arrays of shape (n,), never changed."""

    # Integral term, gain included.
    i_term: Array

    # Error that the next derivative starts from.
    error_last: Array


@dataclass(frozen=True, eq=False)
class GazeboPid(Message):
    """Gains and limits of n PIDs, made by `from_gains`; arrays of shape (n,)."""

    # Proportional, integral and derivative gains.
    p: Array
    i: Array
    d: Array

    # Limits of the integral term, gain included; infinite where there are none.
    i_max: Array
    i_min: Array

    # Limits of the command; infinite where there are none.
    cmd_max: Array
    cmd_min: Array

    # What is added to every command, before its limits.
    cmd_offset: Array

    @classmethod
    def from_gains(
        cls,
        p: Sequence[float],
        i: Sequence[float],
        d: Sequence[float],
        i_max: Sequence[float],
        i_min: Sequence[float],
        cmd_max: Sequence[float],
        cmd_min: Sequence[float],
        cmd_offset: Sequence[float],
    ) -> Self:
        """Return PIDs with these gains, n of each."""
        highest, lowest = _limits(i_max, i_min)
        upper, lower = _limits(cmd_max, cmd_min)
        return cls(
            p=_array(p),
            i=_array(i),
            d=_array(d),
            i_max=highest,
            i_min=lowest,
            cmd_max=upper,
            cmd_min=lower,
            cmd_offset=_array(cmd_offset),
        )

    def initial(self) -> GazeboPidState:
        """Return the state before the first step; the last error is 0."""
        zeros = _array([0.0] * len(self.p))
        return GazeboPidState(zeros, zeros)

    def step(
        self,
        state: GazeboPidState,
        error: Array,
        dt: float,
        *,
        where: Mask | None = None,
    ) -> tuple[GazeboPidState, Array]:
        """Return the state after one step, and the commands, shape (n,).

        The integral acts at once::

            i_term := clamp(i_term + i dt error, i_min, i_max)
            command = clamp(cmd_offset - p error - i_term - d (error - error_last) / dt)

        Where the error or its rate isn't finite, and with a `dt` of 0, the command is 0
        and nothing changes.

        `error` shape (n,); `dt` [s]; `where` shape (n,), None is all.
        """
        if dt == 0.0:
            return state, np.zeros(len(self.p))
        # A copy, for the state keeps it and the caller may reuse its array.
        error = np.array(error, dtype=float)
        # The difference of errors that aren't finite isn't either.
        with np.errstate(invalid="ignore", over="ignore"):
            rate = (error - state.error_last) / dt
        # The quickest way to see that all are finite.
        if where is None and math.isfinite(sum(rate.tolist())):
            i_term, command = self._advance(state.i_term, error, rate, dt)
            return GazeboPidState(i_term, error), command

        steps = np.isfinite(rate) if where is None else where & np.isfinite(rate)
        usable_error, usable_rate = np.where(steps, [error, rate], 0.0)
        i_term, command = self._advance(state.i_term, usable_error, usable_rate, dt)
        after = GazeboPidState(
            np.where(steps, i_term, state.i_term),
            np.where(steps, error, state.error_last),
        )
        return after, np.where(steps, command, 0.0)

    def _advance(
        self, i_term: Array, error: Array, rate: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return the new integral terms and the commands; all is finite."""
        i_term = clamp(i_term + self.i * dt * error, self.i_min, self.i_max)
        command = self.cmd_offset - self.p * error - i_term - self.d * rate
        return i_term, clamp(command, self.cmd_min, self.cmd_max)


def _array(values: Sequence[float] | Array) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def _limits(high: Sequence[float], low: Sequence[float]) -> tuple[Array, Array]:
    """Return upper and lower limits, infinite where there are none."""
    is_limited = np.array(high, dtype=float) >= np.array(low, dtype=float)
    return (
        _array(np.where(is_limited, high, math.inf)),
        _array(np.where(is_limited, low, -math.inf)),
    )


@dataclass(frozen=True, eq=False)
class JointForces(Message):
    """Joints on which n forces act, and their factors; made by `from_joints`."""

    # Joints that carry them, k of them.
    joints: tuple[str, ...]

    # Of each place where one acts: index of the force, largest absolute value [N·m] or
    # [N], how far the place moves per unit of the joint that carries it, and that
    # joint's index.
    _force: Indices
    _limit: Array
    _multiplier: Array
    _joint: Indices

    @classmethod
    def from_joints(
        cls,
        forces: Mapping[str, int],
        followed: Mapping[str, tuple[str, float]],
        effort_limits: Mapping[str, float],
    ) -> Self:
        """Return where forces act; `effort_limits` [N·m] or [N]."""
        carriers = [followed.get(joint, (joint, 1.0)) for joint in forces]
        joints = tuple(dict.fromkeys(name for name, _ in carriers))
        return cls(
            joints,
            np.array(list(forces.values()), dtype=np.intp),
            np.array([effort_limits.get(joint, math.inf) for joint in forces]),
            np.array([multiplier for _, multiplier in carriers]),
            np.array([joints.index(name) for name, _ in carriers], dtype=np.intp),
        )

    def places(self) -> list[tuple[int, float, float, int]]:
        """Return where each force acts, as plain numbers in the order of the fields."""
        fields = (self._force, self._limit, self._multiplier, self._joint)
        return list(zip(*(field.tolist() for field in fields), strict=True))

    def to_efforts(self, forces: Array) -> Array:
        """Return the efforts of `joints`, shape (k,).

        Each force is limited to the effort limit of the joint at which it acts.

        `forces` [N·m] or [N], shape (n,).
        """
        here = forces[self._force]
        limited = np.minimum(np.maximum(here, -self._limit), self._limit)
        # It adds in the order of the places, on every machine.
        weights, k = self._multiplier * limited, len(self.joints)
        # Of no forces it counts in whole numbers.
        return np.bincount(self._joint, weights, minlength=k).astype(float)


GazeboTag = JointPlugin | ImuSensorTag

_Classic = ClassicBase | GazeboRosJointPoseTrajectory | GazeboRosJointStatePublisher
_OneJoint = JointPositionController | JointController

# What a topic of Gazebo Sim can't have in its name.
_NOT_IN_TOPICS = re.compile("@|~|//|:=")

# A remapping of a topic: from, to.
_REMAPPING = re.compile(r"(?P<old>[\w/]+):=(?P<new>[\w/]+)")

# Remaps the namespace itself.
_NAMESPACE = "__ns"


def position_topic(tag: JointPositionController, model: str) -> str:
    """Return the topic of a JointPositionController.

    Gazebo's default contains the index of the axis. That of the first axis, the only
    one that a joint of a URDF has, is left out here, as on the ROS side of the bridges.
    """
    index = f"/{tag.joint_index}" if tag.joint_index else ""
    return _command_topic(tag, model, f"{index}/cmd_pos")


def velocity_topic(tag: JointController, model: str) -> str:
    """Return the topic of a JointController."""
    return _command_topic(tag, model, "/cmd_vel")


def force_topic(tag: ApplyJointForce, model: str) -> str:
    """Return the topic of an ApplyJointForce."""
    return as_topic(f"model/{model}/joint/{tag.joint_names[0]}/cmd_force")


def trajectory_topic(tag: JointTrajectoryController, model: str) -> str:
    """Return the topic of a JointTrajectoryController."""
    return as_topic(tag.topic or f"model/{model}/joint_trajectory")


def joint_state_topic(tag: JointStatePublisher, model: str, world: str) -> str:
    """Return the topic of a JointStatePublisher."""
    return as_topic(tag.topic or f"world/{world}/model/{model}/joint_state")


def contact_topic(tag: ContactSensorTag, model: str, world: str) -> str:
    """Return the topic of a contact sensor."""
    if tag.is_classic:
        return ros_topic("bumper_states", tag.namespace, tag.remappings)
    place = f"world/{world}/model/{model}/link/{tag.link}/sensor/{tag.name}"
    return as_topic(tag.topic or f"{place}/contact")


def imu_topic(tag: ImuSensorTag, model: str, world: str) -> str:
    """Return the topic of an IMU."""
    if tag.is_classic:
        rules = with_node(tag.remappings, tag.namespace, tag.node)
        return ros_topic(f"{tag.node}/out", tag.namespace, rules)
    link = tag.merged or tag.link
    place = f"world/{world}/model/{model}/link/{link}/sensor/{tag.name}"
    return as_topic(tag.topic or f"{place}/imu")


class DriveTopics(NamedTuple):
    """Topics of a drive of Gazebo Sim; `enable` is a DiffDrive's alone."""

    command: str
    enable: str
    odometry: str
    tf: str


def drive_topics(tag: WheelDrive, model: str) -> DriveTopics:
    """Return the topics of a drive of Gazebo Sim."""
    topic, end = tag.topic, "cmd_vel"
    if isinstance(tag, AckermannSteering):
        end = "steer_angle" if tag.is_steering_alone else end
        if tag.sub_topic and not topic:
            topic = f"model/{model}/{tag.sub_topic.strip()}"
    tag_topics = (topic, "", tag.odom_topic, tag.tf_topic)
    ends = (end, "enable", "odometry", "tf")
    names = (
        as_topic(name or f"model/{model}/{end}")
        for name, end in zip(tag_topics, ends, strict=True)
    )
    return DriveTopics(*names)


def ros_topic(name: str, namespace: str, remappings: Sequence[str]) -> str:
    """Return the full name of a topic of a plugin of Gazebo Classic."""
    rules = [rule for text in remappings if (rule := _REMAPPING.fullmatch(text))]
    for rule in rules:
        if rule["old"] == _NAMESPACE:
            namespace = rule["new"]
            break
    topic = _resolve(name, namespace)
    for rule in rules:
        if _resolve(rule["old"], namespace) == topic:
            return _resolve(rule["new"], namespace)
    return topic


def with_node(remappings: Sequence[str], namespace: str, node: str) -> list[str]:
    """Return remappings with the full name of a plugin's node instead of its ~."""
    name = _resolve(node, namespace)
    rules = [
        text.replace("~", name, 1) if text[:1] == "~" else text for text in remappings
    ]
    return [rule.replace(":=~", f":={name}", 1) for rule in rules]


def find_number_fault(message: Float64) -> str:
    """Return why a number is dropped; empty if it isn't."""
    if math.isfinite(message.data):
        return ""
    return f"data must be finite, got {message.data}; it is dropped"


def find_twist_fault(message: Twist, *, sideways: bool = False) -> str:
    """Return why a base doesn't take a velocity; empty if it does."""
    numbers = [message.linear.x, message.angular.z]
    names = "linear.x"
    if sideways:
        numbers.append(message.linear.y)
        names += ", linear.y"
    if all(map(math.isfinite, numbers)):
        return ""
    return f"{names} and angular.z must be finite; the message is dropped"


def find_unsupported(tag: GazeboTag) -> list[str]:
    """Return unsupported settings of a tag, in words for the load report."""
    problems = []
    if isinstance(tag, _OneJoint) and tag.use_actuator_msg:
        problems.append(
            "use_actuator_msg: no messages of actuators are taken; the joint's own "
            "topic takes numbers"
        )
    if isinstance(tag, VelocityControl) and tag.link_names:
        links = ", ".join(tag.link_names)
        problems.append(f"link_name: {links}: only the robot's base is moved")
    if isinstance(tag, AckermannSteering) and tag.use_actuator_msg:
        problems.append(
            "use_actuator_msg: no messages of actuators are taken; its topic takes "
            "the angle as a number"
            if tag.is_steering_alone
            else "use_actuator_msg: it needs an <actuator_number> from 0 on"
        )
    if isinstance(tag, OdometryPublisher):
        if tag.gaussian_noise:
            problems.append("gaussian_noise: velocities are told exactly")
        if tag.odom_covariance_topic:
            problems.append(
                "odom_covariance_topic: no odometry with covariances is published"
            )
    if isinstance(tag, GazeboRosDiffDrive):
        pairs = max(1, tag.num_wheel_pairs)
        for name in ("wheel_separation", "wheel_diameter"):
            number = len(getattr(tag, name))
            if number > pairs:
                problems.append(f"{name}: {number} values for {pairs} pairs of wheels")
    if isinstance(tag, _Classic | ImuSensorTag):
        rules: Sequence[str] = tag.remappings
        if isinstance(tag, ImuSensorTag):
            rules = with_node(rules, tag.namespace, tag.node)
        problems += [
            f"remapping {text!r}: expected from:=to, with names of topics"
            for text, rule in zip(tag.remappings, rules, strict=True)
            # Of a node's private topics, which most plugins have none of, too.
            if not _REMAPPING.fullmatch(rule.removeprefix("~"))
        ]
    return problems


def _command_topic(tag: _OneJoint, model: str, end: str) -> str:
    if tag.topic:
        return as_topic(tag.topic)
    if tag.sub_topic:
        return as_topic(f"model/{model}/{tag.sub_topic.strip()}")
    return as_topic(f"model/{model}/joint/{tag.joint_names[0]}{end}")


# Messages that are farther apart come once.
_LONGEST_NS = 2**62


def publish_period_ns(rate: float) -> int:
    """Return the time between messages at a rate [Hz]; 0 for each tick."""
    return int(min(NANOSECONDS / rate, _LONGEST_NS)) if rate > 0.0 else 0


def is_early(elapsed_ns: float, rate: float) -> bool:
    """Return whether less than 1 / rate [Hz] has passed; a rate of 0 is every tick."""
    # Times of ticks are cut to whole nanoseconds. NaN compares as false.
    return rate > 0.0 and (elapsed_ns + 1) * rate < NANOSECONDS


def as_topic(name: str) -> str:
    """Return the full name of a topic of Gazebo Sim, without what may not be in it.

    Source: gz-transport, src/TopicUtils.cc, `AsValidTopic`.
    """
    name = name.strip().lstrip("/").replace(" ", "_")
    return "/" + _NOT_IN_TOPICS.sub("", name).strip("/")


def _resolve(name: str, namespace: str) -> str:
    """Return the full name of a topic, which may be relative to a namespace."""
    parts = (
        name.split("/") if name.startswith("/") else f"{namespace}/{name}".split("/")
    )
    return "/" + "/".join(filter(None, parts))
