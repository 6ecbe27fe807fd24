"""``libgazebo_ros_diff_drive.so`` of Gazebo Classic.

Source: gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/gazebo_ros_diff_drive.cpp.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.bases.base import (
    BaseFrames,
    diagonal,
    make_odometry,
    make_transform,
)
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.gazebo.gazebo_diff_drive import EncoderOdometry, accelerate
from arm_drake.controllers.gazebo.gazebo_topics import find_twist_fault, ros_topic
from arm_drake.controllers.gazebo.gazebo_truth import describe_base, describe_wheels
from arm_drake.controllers.topics import INACTIVE, Events, add_events, new_messages
from arm_drake.description.gazebo_drives import (
    GazeboRosDiffDrive as GazeboRosDiffDriveTag,
)
from arm_drake.messages import (
    NANOSECONDS,
    Message,
    Odometry,
    TFMessage,
    TopicRejected,
    TransformStamped,
    Twist,
)

# Of what a base on the ground doesn't do.
_UNKNOWN = 1e12

# Value of odometry_source that stands for the truth.
_WORLD = 1


class ClassicDriveState(NamedTuple):
    """State of a GazeboRosDiffDrive between two ticks, with n pairs of wheels."""

    # What to write [rad/s], shape (k,).
    command: Array

    # What the wheels' rims were told last while they sped up [m/s], shape (n, 2).
    told: Array

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

    # Messages on the port at the last tick.
    twists: tuple[Twist, ...] = ()

    # The latest messages that were not accepted.
    events: Events = ()


class GazeboRosDiffDrive(TickingController[ClassicDriveState]):
    """Turns pairs of wheels so that a base moves as it is told, as Gazebo Classic does.

    .. pydrake_system::

        name: GazeboRosDiffDrive
        input_ports:
        - controller_manager
        - state_interfaces
        - link_frames
        - /cmd_vel
        output_ports:
        - command_interfaces
        - /odom
        - /tf
        - events

    With J joints and k wheels:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    link_frames         --    --       list of RigidTransform: pose of each link in the
                                       world; only where they are needed
    /cmd_vel            --    --       Twist: velocity forwards and of turning
    command_interfaces  --    rad/s    Tick; its command is (k,), pair by pair, the left
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

    def __init__(
        self, tag: GazeboRosDiffDriveTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system.

        Args:
            tag: Fields of the plugin.
            params: Rate and surroundings of the controller.
        """
        self._tag, self._rate = tag, tag.update_rate
        self._radii = np.array(tag.radii)[:, None]
        self._separations = np.array(tag.separations)
        # A joint that is named again follows the last of its wheels.
        pairs = zip(tag.left_joints, tag.right_joints, strict=True)
        wheels = [joint for pair in pairs for joint in pair]
        last = {joint: k for k, joint in enumerate(wheels)}
        self._at = np.array(list(last.values()), dtype=np.intp)
        super().__init__(
            params,
            ClassicDriveState(np.zeros(len(last)), np.zeros((len(self._radii), 2))),
            state_interfaces=tuple(f"{joint}/velocity" for joint in wheels),
            command_interfaces=tuple(f"{joint}/velocity" for joint in last),
        )
        shows = tag.publish_odom or tag.publish_odom_tf
        self._is_true = shows and tag.odometry_source == _WORLD
        nothing = AbstractValue.Make(())
        self._links = None
        if self._is_true or tag.publish_wheel_tf:
            poses = AbstractValue.Make([RigidTransform()])
            self._links = self.DeclareAbstractInputPort(interfaces.FRAMES_PORT, poses)
        topic, odom, tf = (
            ros_topic(name, tag.namespace, tag.remappings)
            for name in ("cmd_vel", "odom", "/tf")
        )
        self.message_types: Mapping[str, type[Message]] = {topic: Twist}
        self._topic = self.DeclareAbstractInputPort(topic, nothing)
        if tag.publish_odom:
            self._declare_topic(odom, lambda state: state.published)
        if tag.publish_odom_tf or tag.publish_wheel_tf:
            self._declare_topic(tf, self._describe_frames)
        self._declare_topic("events", lambda state: state.events)
        self._frames = BaseFrames(tag.odometry_frame, tag.robot_base_frame)
        self._covariance = diagonal(
            (
                tag.covariance_x,
                tag.covariance_y,
                *(_UNKNOWN,) * 3,
                tag.covariance_yaw,
            )
        )

    def _update(self, now: Now, state: ClassicDriveState) -> ClassicDriveState:
        state = self._receive(now, state)
        rims = self._read(now.context).reshape(-1, 2) * self._radii
        if now.time_ns:
            left, right = rims[0].tolist()
            dt = now.period_ns / NANOSECONDS
            odometry = state.odometry.move(left, right, self._separations[0], dt)
            state = state._replace(odometry=odometry)
        if state.truth is None and self._is_true:
            (truth,) = self._see(now, [self._tag.base_link]) or (None,)
            state = state._replace(truth=truth)
        elapsed_ns = now.time_ns - state.last_ns
        # Times of ticks are cut to whole nanoseconds.
        if self._rate > 0.0 and (elapsed_ns + 1) * self._rate < NANOSECONDS:
            return state
        state = self._publish(now, state, elapsed_ns / NANOSECONDS)
        v, w = state.target
        half = w * self._separations / 2.0
        speeds, told = np.column_stack([v - half, v + half]), state.told
        limit = self._tag.max_wheel_acceleration
        if limit:
            step = limit * elapsed_ns / NANOSECONDS
            speeds, told = accelerate(speeds, rims, told, step)
        command = (speeds / self._radii).ravel()[self._at]
        return state._replace(command=command, told=told, last_ns=now.time_ns)

    def _publish(
        self, now: Now, state: ClassicDriveState, dt: float
    ) -> ClassicDriveState:
        """Return the state with what an update publishes.

        Args:
            now: The time, and where the inputs are read.
            state: State before.
            dt: Time since the last update [s].
        """
        time_ns, frames, tag = now.time_ns, self._frames, self._tag
        links = [tag.base_link, *(child for _, child in tag.wheel_links)]
        base, *wheels = self._see(now, links) or (None,)
        if tag.publish_wheel_tf and base is not None:
            shown = describe_wheels(time_ns, base, tag.wheel_links, wheels)
            state = state._replace(wheels=shown)
        covariance = self._covariance
        if state.truth is not None and base is not None:
            poses = (state.truth, base)
            message = describe_base(time_ns, frames, poses, dt, covariance)
            return state._replace(truth=base, published=message)
        pose, speed, turning = state.odometry
        velocity, both = (speed, 0.0, turning), (covariance, covariance)
        message = make_odometry(time_ns, frames, pose, velocity, both)
        return state._replace(published=message)

    def _see(self, now: Now, links: Sequence[str]) -> list[RigidTransform]:
        """Return where links are in the world; nothing if nobody tells it."""
        if self._links is None or not self._links.HasValue(now.context):
            return []
        poses = self._links.Eval(now.context)
        return [poses[self.params.links.index(link)] for link in links]

    def _describe_frames(self, state: ClassicDriveState) -> TFMessage:
        """Return the topic /tf."""
        frames = state.wheels
        if self._tag.publish_odom_tf:
            frames += make_transform(state.published).transforms
        return TFMessage(frames)

    def _receive(
        self, now: Now, state: ClassicDriveState, obstacle: str = ""
    ) -> ClassicDriveState:
        """Return the state with what has come in.

        Args:
            now: Where the inputs are read.
            state: State after the last tick.
            obstacle: Why no message is taken; empty if they are.
        """
        new, twists = new_messages(self._topic, now.context, Twist, state.twists)
        if twists is state.twists:
            return state
        target, news = state.target, []
        for twist in new:
            fault = obstacle or find_twist_fault(twist)
            if fault:
                news.append(TopicRejected(twist, fault))
            else:
                target = (twist.linear.x, twist.angular.z)
        events = add_events(state.events, news)
        return state._replace(target=target, twists=twists, events=events)

    def _deactivate(self, now: Now, state: ClassicDriveState) -> ClassicDriveState:
        del now
        return state._replace(
            command=np.zeros(len(state.command)),
            told=np.zeros(state.told.shape),
            target=(0.0, 0.0),
        )

    def _idle(self, now: Now, state: ClassicDriveState) -> ClassicDriveState:
        return self._receive(now, state, INACTIVE)

    def _command(self, state: ClassicDriveState) -> Array:
        return state.command
