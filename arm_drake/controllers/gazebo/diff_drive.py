"""Gazebo's plugins for bases with differential drive, which aren't ros2_control's.

Sources: gz-sim, src/systems/diff_drive/DiffDrive.cc (Ignition Gazebo has the same);
gz-math, src/DiffDriveOdometry.cc, which is that of `arm_drake.control.odometry`; of
Gazebo Classic gazebo_ros_pkgs, branch ros2,
gazebo_plugins/src/gazebo_ros_diff_drive.cpp.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.control.odometry import (
    DiffDriveKinematics,
    DiffDriveMotion,
    PlanarPose,
    WheelOdometryState,
)
from arm_drake.controllers.bases.base import (
    Velocity,
    make_odometry,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    SilentTicks,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.gazebo.drive import (
    REST,
    ClassicController,
    GazeboDrive,
    GazeboDriveState,
)
from arm_drake.controllers.gazebo.plugin import (
    drive_topics,
    is_early,
)
from arm_drake.controllers.topics import Inbox
from arm_drake.description.gazebo_plugins import DiffDrive as DiffDriveTag
from arm_drake.description.gazebo_plugins import (
    GazeboRosDiffDrive as GazeboRosDiffDriveTag,
)
from arm_drake.messages import (
    NANOSECONDS,
    Bool,
    Odometry,
    TransformStamped,
    Twist,
)

# Wheels whose rims are nearer to what is asked for have reached it [m/s].
_REACHED = 0.01


class EncoderOdometry(NamedTuple):
    """Odometry of a base of Gazebo Classic by the turning of its first wheels."""

    pose: PlanarPose = PlanarPose()

    # Along its way, never negative [m/s], and of turning [rad/s].
    speed: float = 0.0
    turning: float = 0.0

    def move(self, left: float, right: float, separation: float, dt: float) -> Self:
        """Return the odometry after the wheels have turned for a while.

        `left` [m/s]; `separation` [m]; `dt` [s].
        """
        way, angle = (left + right) / 2.0 * dt, (right - left) / separation * dt
        x, y, heading = self.pose
        direction = heading + angle / 2.0
        pose = PlanarPose(
            x + way * math.cos(direction),
            y + way * math.sin(direction),
            heading + angle,
        )
        return self._replace(pose=pose, speed=abs(way) / dt, turning=angle / dt)


def accelerate(
    desired: Array, measured: Array, commanded: Array, step: float
) -> tuple[Array, Array]:
    """Return the wheel commands of Gazebo Classic, and the ramped ones it keeps.

    What the wheels are told, shape (n, 2): what is desired where both wheels of a
    pair have nearly reached it. Else what was kept moves by the way that is left,
    or by a step.

    `desired` [m/s], shape (n, 2); `measured`, `commanded` shape (n, 2); `step` [m/s].
    """
    left = desired - measured
    is_reached = (np.abs(left) < _REACHED).all(axis=1, keepdims=True)
    kept = np.where(is_reached, commanded, commanded + np.clip(left, -step, step))
    return np.where(is_reached, desired, kept), kept


class _SteadyDrive(SilentTicks):
    """Ticks of a base that aims at the same velocity and publishes nothing."""

    def __init__(
        self, system: "DiffDrive", last: GazeboDriveState, period_ns: int
    ) -> None:
        """Take what a tick has left, and whose ticks these are."""
        self._system, self._last, self._dt = system, last, period_ns / NANOSECONDS
        self.until_ns = last.published_ns + system._period_ns

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> list[float] | None:
        """Return the velocities of the wheels; None where a position isn't finite."""
        system, dt = self._system, self._dt
        limited, odometry = DiffDriveMotion.from_numbers(memory, system.window)
        limited = system._limit(self._last.target, limited, dt)
        left, right = motions[system._read_at].tolist()
        if not math.isfinite(left + right):
            return None
        odometry = system._kinematics.from_positions(odometry, left, right, dt)
        memory[:] = DiffDriveMotion(limited, odometry).numbers(len(memory))
        return system._to_wheels(limited[0]).tolist()

    def state(
        self, time_ns: int, motions: Array, memory: Sequence[float]
    ) -> GazeboDriveState:
        """Return the state that a tick leaves behind."""
        limited, odometry = DiffDriveMotion.from_numbers(memory, self._system.window)
        command = self._system._to_wheels(limited[0])
        return self._last._replace(limited=limited, command=command, odometry=odometry)


class DiffDrive(GazeboDrive):
    """Drives the wheels of two sides of a base by its velocity command.

    With J joints and k wheels:

    =====================  ====  =======  ==============================================
    port                   size  unit     meaning
    =====================  ====  =======  ==============================================
    controller_manager     --    --       Cycle: when to tick
    state_interfaces       2J    rad, ..  positions and velocities of all joints
    /<topic>               --    --       Twist: velocity forwards and of turning
    /model/<model>/enable  --    --       Bool: whether commands are taken
    command_interfaces     --    rad/s    UpdateResult; command (k,), left wheels first
    /<odom_topic>          --    --       Odometry: where the base is by its wheels
    /<tf_topic>            --    --       TFMessage with the same
    events                 --    --       tuple of the latest (number, TopicRejected),
                                          the newest last
    =====================  ====  =======  ==============================================

    The state is a GazeboDriveState, renewed in every tick. The last command holds for
    ever; there is no timeout. False on `enable` stops the base, and commands have no
    effect until there is a true. With v and w within the limits (`SpeedLimits`)::

        left, right = (v -+ w wheel_separation / 2) / wheel_radius

    for all wheels of a side. The odometry counts the first wheel of each side from the
    angle 0 on, whatever it is at the start; its velocities are means of ten ticks. It
    is published at times 1 / ``odom_publish_frequency`` apart, from then on; with a
    frequency of 0 in every tick. Its covariances are 0.

    A message with a number that isn't finite is dropped, which Gazebo takes.
    """

    reads_by_now = True
    num_remembered = DiffDriveMotion.size(GazeboDrive.window)

    def __init__(self, tag: DiffDriveTag, params: ControllerInterfaceParams) -> None:
        """Create the system."""
        radius = tag.wheel_radius
        self._kinematics = DiffDriveKinematics(tag.wheel_separation, radius, radius)
        super().__init__(tag, params, (tag.left_joints, tag.right_joints))
        self._enable = drive_topics(tag, params.robot_name).enable
        self._subscribe(self._enable, Bool, self._take_switch)
        # Of both in one tick, a switch counts first.
        self._topics.reverse()

    def _find_command(self, velocity: Velocity, measured: Array, dt: float) -> Array:
        return self._to_wheels(velocity)

    def _to_wheels(self, velocity: Velocity) -> Array:
        """Return the velocities of the wheels [rad/s], left ones first."""
        v, w = velocity
        return np.array(self._kinematics.wheels(v, w))[self._group]

    def _count(
        self, odometry: WheelOdometryState, measured: Array, dt: float
    ) -> WheelOdometryState:
        left, right = measured.tolist()
        return self._kinematics.from_positions(odometry, left, right, dt)

    def steady(
        self, last: UpdateResult[GazeboDriveState], time_ns: int
    ) -> SteadyTicks[GazeboDriveState] | None:
        """Return how it goes on until the odometry is published again."""
        period_ns = self.whole_period_ns
        if period_ns is None or not (self._period_ns and last.state.counts):
            return None
        return _SteadyDrive(self, last.state, period_ns)

    def remember(self, state: GazeboDriveState) -> list[float]:
        """Return how the base moves, in numbers."""
        motion = DiffDriveMotion(state.limited, state.odometry)
        return motion.numbers(self.num_remembered)

    def _take_switch(
        self, state: GazeboDriveState, message: Bool, time_ns: int
    ) -> tuple[GazeboDriveState, str]:
        target = state.target if message.data else REST
        return state._replace(is_enabled=message.data, target=target), ""

    def _take_twist(
        self, state: GazeboDriveState, message: Twist, time_ns: int
    ) -> tuple[GazeboDriveState, str]:
        taken, fault = super()._take_twist(state, message, time_ns)
        if not (fault or state.is_enabled):
            return state, f"{self._enable} is false"
        return taken, fault


# Value of odometry_source that stands for the truth.
_WORLD = 1


class ClassicDriveState(NamedTuple):
    """State of a GazeboRosDiffDrive between two ticks, with n pairs of wheels."""

    # What to write [rad/s], shape (k,).
    command: Array

    # What the wheels' rims were told last while they sped up [m/s], shape (n, 2).
    commanded: Array

    # Forwards [m/s], turning [rad/s].
    target: tuple[float, float] = (0.0, 0.0)

    # When the wheels were told last [ns].
    last_ns: int = 0

    odometry: EncoderOdometry = EncoderOdometry()

    # Where the base really was at the last update; None before the first tick.
    truth: RigidTransform | None = None

    # What was published last.
    published: Odometry = Odometry()
    wheels: tuple[TransformStamped, ...] = ()

    inbox: Inbox = Inbox()


class GazeboRosDiffDrive(ClassicController[ClassicDriveState]):
    """Drives pairs of wheels by a velocity command, as Gazebo Classic does.

    With J joints and k wheels:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    link_frames         --    --       list of RigidTransform: pose of each link in the
                                       world; only where they are needed
    /cmd_vel            --    --       Twist: velocity forwards and of turning
    command_interfaces  --    rad/s    UpdateResult; (k,), pair by pair, the left
                                       wheel first
    /odom               --    --       Odometry, if ``publish_odom``
    /tf                 --    --       TFMessage with the same, if ``publish_odom_tf``,
                                       and with the wheels, if ``publish_wheel_tf``
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    Topics have the names that namespace and remappings make. The state is a
    ClassicDriveState, renewed in every tick. An update comes 1 / ``update_rate`` after
    the last one at the earliest; a rate of 0 is every tick. It publishes, then tells
    the wheels of pair i::

        left, right = (v -+ w wheel_separation[i] / 2) / radius[i]

    or with ``max_wheel_acceleration`` as `accelerate` says. The last command holds for
    ever; there is no timeout.

    The odometry is the truth with ``odometry_source`` 1, in the world's coordinates;
    its velocities are means since the last update, Gazebo's are of that instant. With 0
    it is what the first pair of wheels says, in every tick: its forward velocity is
    never negative, as in Gazebo. Without link_frames it is that, too. The pose of a
    wheel in /tf is that in the base, though its frame is called the wheel's parent, as
    in Gazebo.

    A message with a number that isn't finite is dropped, which Gazebo takes.
    """

    _tag: GazeboRosDiffDriveTag

    def __init__(
        self, tag: GazeboRosDiffDriveTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        self._rate = tag.update_rate
        self._radii = np.array(tag.radii)[:, None]
        self._separations = np.array(tag.separations)
        # A joint that is named again follows the last of its wheels.
        pairs = zip(tag.left_joints, tag.right_joints, strict=True)
        wheels = [joint for pair in pairs for joint in pair]
        last = {joint: k for k, joint in enumerate(wheels)}
        self._at = np.array(list(last.values()), dtype=np.intp)
        shows = tag.publish_odom or tag.publish_odom_tf
        self._is_true = shows and tag.odometry_source == _WORLD
        super().__init__(
            tag,
            params,
            ClassicDriveState(np.zeros(len(last)), np.zeros((len(self._radii), 2))),
            sees_links=self._is_true or tag.publish_wheel_tf,
            state_interfaces=tuple(f"{joint}/velocity" for joint in wheels),
            command_interfaces=tuple(f"{joint}/velocity" for joint in last),
        )
        self._declare_outputs()

    def _update(
        self, now: UpdateContext, state: ClassicDriveState
    ) -> ClassicDriveState:
        state = self._receive(now, state)
        rims = self._measured_now(now).reshape(-1, 2) * self._radii
        if now.time_ns:
            left, right = rims[0].tolist()
            dt = now.period_ns / NANOSECONDS
            odometry = state.odometry.move(left, right, self._separations[0], dt)
            state = state._replace(odometry=odometry)
        if state.truth is None and self._is_true:
            truth, *_ = self._see(now) or (None,)
            state = state._replace(truth=truth)
        elapsed_ns = now.time_ns - state.last_ns
        if is_early(elapsed_ns, self._rate):
            return state
        state = self._publish(now, state, elapsed_ns / NANOSECONDS)
        v, w = state.target
        half = w * self._separations / 2.0
        speeds, commanded = np.column_stack([v - half, v + half]), state.commanded
        limit = self._tag.max_wheel_acceleration
        if limit:
            step = limit * elapsed_ns / NANOSECONDS
            speeds, commanded = accelerate(speeds, rims, commanded, step)
        command = (speeds / self._radii).ravel()[self._at]
        return state._replace(command=command, commanded=commanded, last_ns=now.time_ns)

    def _publish(
        self, now: UpdateContext, state: ClassicDriveState, dt: float
    ) -> ClassicDriveState:
        """Return the state with what an update publishes; `dt` [s]."""
        time_ns = now.time_ns
        base, *wheels = self._see(now) or (None,)
        if base is not None:
            state = state._replace(wheels=self._describe_wheels(time_ns, base, wheels))
            if state.truth is not None:
                message = self._describe_base(time_ns, state.truth, base, dt)
                return state._replace(truth=base, published=message)
        pose, speed, turning = state.odometry
        velocity, both = (speed, turning), (self._covariance,) * 2
        message = make_odometry(time_ns, self._frames, pose, velocity, both)
        return state._replace(published=message)

    def _deactivate(
        self, now: UpdateContext, state: ClassicDriveState
    ) -> ClassicDriveState:
        return state._replace(
            command=np.zeros(len(state.command)),
            commanded=np.zeros(state.commanded.shape),
            target=(0.0, 0.0),
        )
