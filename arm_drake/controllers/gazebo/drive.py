"""What Gazebo's drives of bases share: limits of speeds, topics, odometry.

Sources: gz-sim, src/systems/diff_drive/DiffDrive.cc and those beside it, which limit
speeds and publish alike; gz-math, src/SpeedLimiter.cc.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
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
from arm_drake.controllers.gazebo.plugin import find_twist_fault, publish_period_ns
from arm_drake.controllers.topics import Inbox, TopicController
from arm_drake.description.gazebo_plugins import WheelDrive
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


class GazeboDrive(TopicController[GazeboDriveState]):
    """Base of Gazebo Sim's systems that turn wheels so that a base moves as told.

    The last command holds for ever; there is no timeout. A subclass subscribes to its
    topics, and says by `_find_command` and `_count` how the wheels are to turn and
    where their turning has taken the base.
    """

    # Whether velocities have a component to the left.
    moves_sideways: ClassVar[bool] = False

    # Samples over which the published velocities are means.
    window: ClassVar[int] = 10

    def __init__(
        self,
        tag: WheelDrive,
        params: ControllerInterfaceParams,
        *,
        measured: Sequence[str],
        commanded: Sequence[str],
    ) -> None:
        """Create the system; `measured` are joints whose positions are read."""
        linear, angular = (find_limits(tag, kind) for kind in ("linear", "angular"))
        sideways = (linear,) if self.moves_sideways else ()
        self._limits = (linear, *sideways, angular)
        self._rest = (0.0,) * len(self._limits)
        self._period_ns = publish_period_ns(tag.odom_publish_frequency)
        model = params.robot_name
        self._frames = BaseFrames(
            tag.frame_id or f"{model}/odom",
            tag.child_frame_id or f"{model}/{tag.base_link}",
        )
        odometry = WheelOdometryState(
            RollingMean(self.window),
            velocity=self._rest,
            positions=(0.0,) * len(measured),
        )
        super().__init__(
            params,
            GazeboDriveState(
                odometry,
                np.zeros(len(commanded)),
                self._rest,
                (self._rest, self._rest),
            ),
            state_interfaces=interfaces.interface_names(
                measured, (interfaces.POSITION,)
            ),
            command_interfaces=interfaces.interface_names(
                commanded, (interfaces.VELOCITY,)
            ),
        )

    @abstractmethod
    def _find_command(self, velocity: Velocity, measured: Array, dt: float) -> Array:
        """Return what to write for a velocity within the limits; `dt` [s]."""

    @abstractmethod
    def _count(
        self, odometry: WheelOdometryState, measured: Array, dt: float
    ) -> WheelOdometryState:
        """Return the odometry after a tick; `dt` [s]."""

    def _declare_odometry(self, odometry: str, tf: str) -> None:
        """Declare the topics of the odometry."""
        self._declare_topic(odometry, lambda state: state.published)
        self._declare_topic(tf, lambda state: make_transform(state.published))

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
        v, *sideways, w = odometry.velocity
        message = make_odometry(
            now.time_ns,
            self._frames,
            odometry.pose,
            (v, *(sideways or (0.0,)), w),
            (_CERTAIN, _CERTAIN),
        )
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

    def _take_twist(
        self, state: GazeboDriveState, message: Twist, time_ns: int, obstacle: str
    ) -> tuple[GazeboDriveState, str]:
        sideways = self.moves_sideways
        fault = obstacle or find_twist_fault(message, sideways=sideways)
        if fault:
            return state, fault
        linear = (message.linear.x, message.linear.y)[: 1 + sideways]
        return state._replace(target=(*linear, message.angular.z)), ""

    def _deactivate(
        self, now: UpdateContext, state: GazeboDriveState
    ) -> GazeboDriveState:
        return state._replace(
            command=np.zeros(len(state.command)),
            target=self._rest,
            limited=(self._rest, self._rest),
        )


# Of what a base on the ground doesn't do.
_UNKNOWN = 1e12


def planar_covariance(x: float, y: float, yaw: float) -> tuple[float, ...]:
    """Return the covariance, shape (36,), of a base on the ground in Gazebo Classic."""
    return diagonal((x, y, _UNKNOWN, _UNKNOWN, _UNKNOWN, yaw))


def describe_base(
    time_ns: int,
    frames: BaseFrames,
    poses: tuple[RigidTransform, RigidTransform],
    dt: float,
    covariance: tuple[float, ...],
) -> Odometry:
    """Return the odometry of a base whose pose is known.

    `dt` [s]; `covariance` shape (36,).
    """
    last, pose = poses
    x, y, wz = 0.0, 0.0, 0.0
    if dt > 0.0:
        x, y = (pose.translation() - last.translation())[:2] / dt
        turn = pose.rotation().multiply(last.rotation().inverse()).ToAngleAxis()
        wz = turn.angle() * turn.axis()[2] / dt
    yaw = RollPitchYaw(pose.rotation()).yaw_angle()
    c, s = np.cos(yaw), np.sin(yaw)
    linear = Vector3(c * x + s * y, c * y - s * x, 0.0)
    where = _to_transform(pose)
    at = where.translation
    return Odometry(
        Header.from_nanoseconds(time_ns, frames.odom),
        frames.base,
        PoseWithCovariance(Pose(Point(at.x, at.y, at.z), where.rotation), covariance),
        TwistWithCovariance(Twist(linear, Vector3(0.0, 0.0, wz)), covariance),
    )


def describe_wheels(
    time_ns: int,
    base: RigidTransform,
    links: Sequence[tuple[str, str]],
    poses: Sequence[RigidTransform],
) -> tuple[TransformStamped, ...]:
    """Return the frames of wheels."""
    return tuple(
        TransformStamped(
            Header.from_nanoseconds(time_ns, parent),
            child,
            _to_transform(base.inverse() @ pose),
        )
        for (parent, child), pose in zip(links, poses, strict=True)
    )


def describe_frames(
    wheels: tuple[TransformStamped, ...], odometry: Odometry | None
) -> TFMessage:
    """Return the topic /tf: wheels, and a base if its odometry is told there."""
    base = () if odometry is None else make_transform(odometry).transforms
    return TFMessage((*wheels, *base))


def _to_transform(pose: RigidTransform) -> Transform:
    w, x, y, z = pose.rotation().ToQuaternion().wxyz().tolist()
    return Transform(Vector3(*pose.translation().tolist()), Quaternion(x, y, z, w))
