"""Gazebo's plugin that publishes where a model really is.

Source: gz-sim, src/systems/odometry_publisher/OdometryPublisher.cc.
"""

from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.gazebo.drive import (
    BasePlugin,
    along_heading,
    find_velocity,
    orientation_of,
)
from arm_drake.controllers.gazebo.plugin import as_topic, publish_period_ns
from arm_drake.controllers.topics import Inbox
from arm_drake.description.gazebo_plugins import (
    OdometryPublisher as OdometryPublisherTag,
)
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Twist,
    TwistWithCovariance,
    Vector3,
)


class OdometryPublisherState(NamedTuple):
    """State of an OdometryPublisher between two ticks."""

    # It writes nothing, shape (0,).
    command: Array

    # Where the frame was at the last tick; None before the first.
    pose: RigidTransform | None = None

    # What was published last, and when [ns].
    published: Odometry = Odometry()
    published_ns: int = 0

    inbox: Inbox = Inbox()


class OdometryPublisher(BasePlugin[OdometryPublisherState]):
    """Publishes the pose of the robot's root link in the world, and its velocity.

    With J joints:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    link_frames         --    --       list of RigidTransform: pose of each link in the
                                       world
    command_interfaces  --    --       UpdateResult; nothing
    /<odom_topic>       --    --       Odometry: the truth
    /<tf_topic>         --    --       TFMessage with the same
    events              --    --       tuple without an element
    ==================  ====  =======  =================================================

    The state is an OdometryPublisherState, renewed in every tick. The pose is that of
    the link, with ``xyz_offset`` and ``rpy_offset`` in it; with 2 ``dimensions`` at the
    height 0. Velocities are those from the last tick to this one, along the axes of the
    frame; with 2 dimensions in the plane alone. Gazebo's are means of ten steps, as
    long as a tick at 100 Hz. It is published at times
    1 / ``odom_publish_frequency`` apart; with a frequency of 0 in every tick. Its
    covariances are 0. Without link_frames its messages are empty.
    """

    def __init__(
        self, tag: OdometryPublisherTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        rate, model = tag.odom_publish_frequency, params.robot_name
        self._period_ns = publish_period_ns(rate)
        self._is_flat = tag.dimensions == 2
        xyz, rpy = (v or (0.0,) * 3 for v in (tag.xyz_offset, tag.rpy_offset))
        self._X_LF = RigidTransform(RollPitchYaw(list(rpy)), list(xyz))
        super().__init__(
            params,
            OdometryPublisherState(np.zeros(0)),
            frames=(
                tag.odom_frame or f"{model}/odom",
                tag.robot_base_frame or f"{model}/base_footprint",
            ),
            links=(tag.base_link,),
        )
        odom, tf = (
            as_topic(name or f"model/{model}/{end}")
            for name, end in ((tag.odom_topic, "odometry"), (tag.tf_topic, "pose"))
        )
        self._declare_odometry(odom, tf)

    def _activate(
        self, now: UpdateContext, state: OdometryPublisherState
    ) -> OdometryPublisherState:
        # Where the frame was when it stopped tells no velocity.
        return state._replace(pose=None)

    def _update(
        self, now: UpdateContext, state: OdometryPublisherState
    ) -> OdometryPublisherState:
        if not (poses := self._see(now)):
            return state
        pose = poses[0] @ self._X_LF
        last, state = state.pose, state._replace(pose=pose)
        elapsed_ns = now.time_ns - state.published_ns
        # Times of ticks are cut to whole nanoseconds.
        if last is None or 0 < elapsed_ns < self._period_ns - 1:
            return state
        twist = self._find_twist(last, pose, now.period_ns / NANOSECONDS)
        message = self._describe(now.time_ns, pose, twist)
        return state._replace(published=message, published_ns=now.time_ns)

    def _find_twist(
        self, last: RigidTransform, pose: RigidTransform, dt: float
    ) -> Twist:
        """Return the velocity along the axes of the frame; `dt` [s]."""
        moved, turned = find_velocity(last, pose, dt)
        R_FW = pose.rotation().inverse()
        wx, wy, wz = R_FW.multiply(turned).tolist()
        if not self._is_flat:
            x, y, z = R_FW.multiply(moved).tolist()
            return Twist(Vector3(x, y, z), Vector3(wx, wy, wz))
        return Twist(along_heading(pose, moved), Vector3(z=wz))

    def _describe(self, time_ns: int, pose: RigidTransform, twist: Twist) -> Odometry:
        """Return the message of a tick."""
        x, y, z = pose.translation().tolist()
        at = Point(x, y, 0.0 if self._is_flat else z)
        return Odometry(
            Header.from_nanoseconds(time_ns, self._frames.odom),
            self._frames.base,
            PoseWithCovariance(Pose(at, orientation_of(pose))),
            TwistWithCovariance(twist),
        )
