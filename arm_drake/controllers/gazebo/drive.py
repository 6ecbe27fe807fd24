"""Base of Gazebo's drives of bases: limits of speeds, topics, odometry.

Sources: gz-sim, src/systems/diff_drive/DiffDrive.cc and those beside it, which limit
speeds and publish alike; gz-math, src/SpeedLimiter.cc.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import RollingMean, WheelOdometryState
from arm_drake.controllers.bases.base import (
    BaseFrames,
    Velocity,
    diagonal,
    make_odometry,
    make_transform,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.gazebo.plugin import (
    drive_topics,
    find_twist_fault,
    publish_period_ns,
    ros_topic,
)
from arm_drake.controllers.topics import Inbox, TopicController, TopicState
from arm_drake.description.gazebo_plugins import ClassicBase, ClassicDrive, WheelDrive
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
)


class SpeedLimits(NamedTuple):
    """Limits of a speed of Gazebo's drives [m/s] or [rad/s], and of its rates."""

    min_velocity: float = -math.inf
    max_velocity: float = math.inf
    min_acceleration: float = -math.inf
    max_acceleration: float = math.inf
    min_jerk: float = -math.inf
    max_jerk: float = math.inf

    def limit(self, requested: float, last: float, before: float, dt: float) -> float:
        """Return a speed within the limits: of its jerk, its rate, then its own.

        Unlike ros2_control's, the limits hold in both directions and at all times; of
        a minimum above its maximum, the minimum holds.

        `dt` [s].
        """
        rate = (last - before) / dt
        jerk = ((requested - last) / dt - rate) / dt
        if not self.min_jerk <= jerk <= self.max_jerk:
            requested = (
                last + (rate + clamp(jerk, self.min_jerk, self.max_jerk) * dt) * dt
            )
        rate = (requested - last) / dt
        if not self.min_acceleration <= rate <= self.max_acceleration:
            rate = clamp(rate, self.min_acceleration, self.max_acceleration)
            requested = last + rate * dt
        return clamp(requested, self.min_velocity, self.max_velocity)


def find_limits(tag: WheelDrive, kind: str) -> SpeedLimits:
    """Return the limits of a "linear" or an "angular" speed."""
    limits = {}
    for name in SpeedLimits._fields:
        end, _, quantity = name.partition("_")
        own: float = getattr(tag, f"{end}_{kind}_{quantity}", math.nan)
        limits[name] = getattr(tag, name) if math.isnan(own) else own
    return SpeedLimits(**limits)


def clamp(value: float, low: float, high: float) -> float:
    """Return a value within its limits; of crossed limits the lower one."""
    return max(min(value, high), low)


REST = (0.0, 0.0)


class BasePluginState(TopicState, Protocol):
    """State of a BasePlugin: a named tuple with these fields and its own."""

    @property
    def published(self) -> Odometry:
        """Return what was published last."""


B = TypeVar("B", bound=BasePluginState)


class BasePlugin(TopicController[B]):
    """Base of Gazebo's plugins that move a base as told, or tell where it is.

    The last command holds for ever; there is no timeout.
    """

    # Whether velocities have a component to the left.
    moves_sideways: ClassVar[bool] = False

    def __init__(
        self,
        params: ControllerInterfaceParams,
        initial: B,
        *,
        frames: tuple[str, str],
        links: Sequence[str] = (),
        **names: Any,
    ) -> None:
        """Create the system with the odometry's frames; it sees where `links` are."""
        super().__init__(params, initial, **names)
        self._frames = BaseFrames(*frames)
        self._links = None
        if links:
            poses = AbstractValue.Make([RigidTransform()])
            self._links = self.DeclareAbstractInputPort(interfaces.FRAMES_PORT, poses)
            self._seen = [params.links.index(link) for link in links]

    def _see(self, now: UpdateContext) -> list[RigidTransform]:
        """Return where the links are; nothing if nobody tells it."""
        if self._links is None or not self._links.HasValue(now.context):
            return []
        poses = self._links.Eval(now.context)
        return [poses[index] for index in self._seen]

    def _declare_odometry(self, odometry: str, tf: str) -> None:
        """Declare the topics of the odometry, and the events."""
        self._declare_topic(odometry, lambda state: state.published)
        self._declare_topic(tf, lambda state: make_transform(state.published))
        self._declare_events()

    def _take_twist(self, state: B, message: Twist, time_ns: int) -> tuple[B, str]:
        if fault := find_twist_fault(message, sideways=self.moves_sideways):
            return state, fault
        linear = (message.linear.x, message.linear.y)[: 1 + self.moves_sideways]
        return state._replace(target=(*linear, message.angular.z)), ""


_CERTAIN = diagonal((0.0,) * 6)


class GazeboDriveState(NamedTuple):
    """State of a drive of Gazebo Sim between two ticks."""

    odometry: WheelOdometryState

    # What to write [rad/s], shape (k,).
    command: Array

    # Forwards [m/s], turning [rad/s], or with a speed to the left between them: what is
    # asked for, and the last two that the limits let through, the newest first.
    target: Velocity
    limited: tuple[Velocity, Velocity]

    # Whether commands are taken.
    is_enabled: bool = True

    # Whether the odometry has begun to count.
    counts: bool = False

    # What was published last, and when [ns].
    published: Odometry = Odometry()
    published_ns: int = 0

    inbox: Inbox = Inbox()


class GazeboDrive(BasePlugin[GazeboDriveState]):
    """Base of Gazebo Sim's systems that drive wheels by a velocity command.

    A subclass says by `_find_command` and `_count` how the joints of each group are to
    turn, and where their turning has taken the base.
    """

    # Samples over which the published velocities are means.
    window: ClassVar[int] = 10

    def __init__(
        self,
        tag: WheelDrive,
        params: ControllerInterfaceParams,
        groups: Sequence[Sequence[str]],
        *,
        only_steers: bool = False,
    ) -> None:
        """Create the system; of each group of joints the first one's position is read.

        One that only steers takes no velocities, and has no odometry.
        """
        linear, angular = (find_limits(tag, kind) for kind in ("linear", "angular"))
        sideways = (linear,) if self.moves_sideways else ()
        self._limits = (linear, *sideways, angular)
        self._rest = (0.0,) * len(self._limits)
        self._period_ns = publish_period_ns(tag.odom_publish_frequency)
        # A joint of several groups follows the last of them.
        moved = {joint: at for at, joints in enumerate(groups) for joint in joints}
        self._group = np.array(list(moved.values()), dtype=np.intp)
        odometry = WheelOdometryState(
            RollingMean(self.window),
            velocity=self._rest,
            positions=(0.0,) * len(groups),
        )
        model = params.robot_name
        super().__init__(
            params,
            GazeboDriveState(
                odometry, np.zeros(len(moved)), self._rest, (self._rest, self._rest)
            ),
            frames=(
                tag.frame_id or f"{model}/odom",
                tag.child_frame_id or f"{model}/{tag.base_link}",
            ),
            state_interfaces=tuple(f"{joints[0]}/position" for joints in groups),
            command_interfaces=tuple(f"{joint}/velocity" for joint in moved),
        )
        topics = drive_topics(tag, model)
        if only_steers:
            self._declare_events()
        else:
            self._subscribe(topics.command, Twist, self._take_twist)
            self._declare_odometry(topics.odometry, topics.tf)

    @abstractmethod
    def _find_command(self, velocity: Velocity, measured: Array, dt: float) -> Array:
        """Return what to write for a velocity within the limits; `dt` [s]."""

    @abstractmethod
    def _count(
        self, odometry: WheelOdometryState, measured: Array, dt: float
    ) -> WheelOdometryState:
        """Return the odometry after a tick; `dt` [s]."""

    def _update(self, now: UpdateContext, state: GazeboDriveState) -> GazeboDriveState:
        state = self._receive(now, state)
        dt = now.period_ns / NANOSECONDS
        measured = self._measured_now(now)
        limited = self._limit(state.target, state.limited, dt)
        command = self._find_command(limited[0], measured, dt)
        state = state._replace(limited=limited, command=command)
        if not state.counts:
            return state._replace(counts=True)
        odometry = self._count(state.odometry, measured, dt)
        state = state._replace(odometry=odometry)
        if now.time_ns - state.published_ns < self._period_ns:
            return state
        pose, velocity, both = odometry.pose, odometry.velocity, (_CERTAIN, _CERTAIN)
        message = make_odometry(now.time_ns, self._frames, pose, velocity, both)
        return state._replace(published=message, published_ns=now.time_ns)

    def _limit(
        self, target: Velocity, limited: tuple[Velocity, Velocity], dt: float
    ) -> tuple[Velocity, Velocity]:
        """Return the last two velocities after a tick that aims at one."""
        last, before = limited
        velocity = tuple(
            limits.limit(requested, v0, v1, dt)
            for limits, requested, v0, v1 in zip(
                self._limits, target, last, before, strict=True
            )
        )
        return velocity, last

    def _deactivate(
        self, now: UpdateContext, state: GazeboDriveState
    ) -> GazeboDriveState:
        return state._replace(
            command=np.zeros(len(state.command)),
            target=self._rest,
            limited=(self._rest, self._rest),
        )


def find_velocity(
    last: RigidTransform, pose: RigidTransform, dt: float
) -> tuple[Array, Array]:
    """Return the mean velocity between two poses [m/s] and that of turning [rad/s].

    Both are in the world, shape (3,); `dt` [s].
    """
    turn = pose.rotation().multiply(last.rotation().inverse()).ToAngleAxis()
    moved = pose.translation() - last.translation()
    return moved / dt, turn.angle() * turn.axis() / dt


def along_heading(pose: RigidTransform, velocity: Array) -> Vector3:
    """Return a velocity in the world, shape (3,), forwards and to the left."""
    yaw = RollPitchYaw(pose.rotation()).yaw_angle()
    c, s = float(np.cos(yaw)), float(np.sin(yaw))
    x, y, _ = velocity.tolist()
    return Vector3(c * x + s * y, c * y - s * x, 0.0)


def orientation_of(pose: RigidTransform) -> Quaternion:
    """Return the orientation of a pose as a message."""
    return Quaternion.from_wxyz(pose.rotation().ToQuaternion().wxyz())


# Of what a base on the ground doesn't do.
_UNKNOWN = 1e12


class ClassicController(BasePlugin[B]):
    """Base of Gazebo Classic's plugins that move a base by a velocity command.

    A subclass declares what it publishes by `_declare_outputs`.
    """

    def __init__(
        self,
        tag: ClassicBase,
        params: ControllerInterfaceParams,
        initial: B,
        *,
        sees_links: bool = True,
        **names: Any,
    ) -> None:
        """Create the system; `sees_links` is whether it reads where links are."""
        self._wheels = tag.wheel_links if isinstance(tag, ClassicDrive) else ()
        links = (tag.base_link, *(child for _, child in self._wheels))
        super().__init__(
            params,
            initial,
            frames=(tag.odometry_frame, tag.robot_base_frame),
            links=links if sees_links else (),
            **names,
        )
        self._tag = tag
        x, y, yaw = tag.covariance_x, tag.covariance_y, tag.covariance_yaw
        self._covariance = diagonal((x, y, _UNKNOWN, _UNKNOWN, _UNKNOWN, yaw))
        self._shows_wheels = isinstance(tag, ClassicDrive) and tag.publish_wheel_tf
        self._subscribe(self._topic("cmd_vel"), Twist, self._take_twist)

    def _topic(self, name: str) -> str:
        """Return the full name of a topic."""
        return ros_topic(name, self._tag.namespace, self._tag.remappings)

    def _declare_outputs(self, **others: Callable[[B], Any]) -> None:
        """Declare the topics of the odometry, others between them, and the events."""
        tag = self._tag
        if tag.publish_odom:
            self._declare_topic(self._topic("odom"), lambda state: state.published)
        for name, show in others.items():
            self._declare_topic(self._topic(name), show)
        if tag.publish_odom_tf or self._shows_wheels:
            self._declare_topic(self._topic("/tf"), self._describe_frames)
        self._declare_events()

    def _describe_frames(self, state: B) -> TFMessage:
        """Return the frames of wheels, and of the base if it is published."""
        wheels: tuple[TransformStamped, ...] = getattr(state, "wheels", ())
        if not self._tag.publish_odom_tf:
            return TFMessage(wheels)
        return TFMessage((*wheels, *make_transform(state.published).transforms))

    def _describe_base(
        self, time_ns: int, last: RigidTransform, pose: RigidTransform, dt: float
    ) -> Odometry:
        """Return the odometry of a base whose pose is known; `dt` [s]."""
        moved = turned = np.zeros(3)
        if dt > 0.0:
            moved, turned = find_velocity(last, pose, dt)
        twist = Twist(along_heading(pose, moved), Vector3(z=turned[2]))
        at = Point(*pose.translation().tolist())
        where = Pose(at, orientation_of(pose))
        return Odometry(
            Header.from_nanoseconds(time_ns, self._frames.odom),
            self._frames.base,
            PoseWithCovariance(where, self._covariance),
            TwistWithCovariance(twist, self._covariance),
        )

    def _describe_wheels(
        self, time_ns: int, base: RigidTransform, poses: Sequence[RigidTransform]
    ) -> tuple[TransformStamped, ...]:
        """Return the frames of the wheels, nothing if they aren't published."""
        if not self._shows_wheels:
            return ()
        frames = []
        for (parent, child), pose in zip(self._wheels, poses, strict=True):
            X_BW = base.inverse() @ pose
            at = Vector3(*X_BW.translation().tolist())
            where = Transform(at, orientation_of(X_BW))
            header = Header.from_nanoseconds(time_ns, parent)
            frames.append(TransformStamped(header, child, where))
        return tuple(frames)
