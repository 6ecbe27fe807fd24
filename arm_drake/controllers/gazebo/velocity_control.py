"""Gazebo's plugins that set the velocity of a robot's base, whatever it takes.

Sources: gz-sim, src/systems/velocity_control/VelocityControl.cc; gazebo_ros_pkgs,
branch ros2, gazebo_plugins/src/gazebo_ros_planar_move.cpp.
"""

import math
from typing import ClassVar, NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.gazebo.drive import ClassicController
from arm_drake.controllers.gazebo.plugin import (
    as_topic,
    find_twist_fault,
    is_early,
)
from arm_drake.controllers.topics import Inbox, TopicController
from arm_drake.description.gazebo_plugins import (
    GazeboRosPlanarMove as GazeboRosPlanarMoveTag,
)
from arm_drake.description.gazebo_plugins import VelocityControl as VelocityControlTag
from arm_drake.messages import NANOSECONDS, Odometry, Twist

_ZERO = (0.0, 0.0, 0.0)


class HeldTwist(NamedTuple):
    """A velocity that a base has, whatever it takes."""

    # Along and about the axes of the base [m/s], [rad/s].
    linear: tuple[float, ...] = _ZERO
    angular: tuple[float, ...] = _ZERO

    # Whether these are the base's axes as it would stand level, turned by its yaw.
    is_level: bool = False


class VelocityControlState(NamedTuple):
    """State of a VelocityControl between two ticks."""

    target: HeldTwist

    # It writes nothing, shape (0,).
    command: Array

    # What the base does until the next tick; None is what it likes.
    held: HeldTwist | None = None

    inbox: Inbox = Inbox()


class VelocityControl(TopicController[VelocityControlState]):
    """Sets the velocity of the robot's base by its command.

    With J joints:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       Twist: velocity along and about the base's axes
    command_interfaces  --    --       UpdateResult; nothing
    held_twist          --    --       HeldTwist, or None while it is inactive
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a VelocityControlState, renewed in every tick. All six components count
    from the start on, that is, without a command the base is held at rest, or at its
    initial velocity; the last command holds for ever. See `BaseServo` for what holds
    it. A message with a number that isn't finite is dropped, which Gazebo takes.
    """

    # Whether velocities have a component to the left.
    moves_sideways: ClassVar[bool] = True

    def __init__(
        self, tag: VelocityControlTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        initial = HeldTwist(tag.initial_linear or _ZERO, tag.initial_angular or _ZERO)
        super().__init__(
            params,
            VelocityControlState(initial, np.zeros(0)),
            state_interfaces=(),
            command_interfaces=(),
        )
        topic = as_topic(tag.topic or f"model/{params.robot_name}/cmd_vel")
        self._subscribe(topic, Twist, self._take_twist)
        self._declare_topic(interfaces.TWIST_PORT, lambda state: state.held)
        self._declare_events()

    def _update(
        self, now: UpdateContext, state: VelocityControlState
    ) -> VelocityControlState:
        state = self._receive(now, state)
        return state._replace(held=state.target)

    def _take_twist(
        self, state: VelocityControlState, message: Twist, time_ns: int
    ) -> tuple[VelocityControlState, str]:
        linear, angular = ((v.x, v.y, v.z) for v in (message.linear, message.angular))
        if not all(map(math.isfinite, (*linear, *angular))):
            return state, "all numbers must be finite; the message is dropped"
        return state._replace(target=HeldTwist(linear, angular)), ""

    def _deactivate(
        self, now: UpdateContext, state: VelocityControlState
    ) -> VelocityControlState:
        return state._replace(target=HeldTwist(), held=None)


class PlanarMoveState(NamedTuple):
    """State of a GazeboRosPlanarMove between two ticks."""

    # It writes nothing, shape (0,).
    command: Array

    target: HeldTwist = HeldTwist(is_level=True)

    # What the base does until the next tick; None is what it likes.
    held: HeldTwist | None = None

    # When that was set last, and when the odometry was told [ns].
    last_ns: int = 0
    published_ns: int = 0

    # Where the base was at the last tick; None before the first.
    truth: RigidTransform | None = None

    # What was published last.
    published: Odometry = Odometry()

    inbox: Inbox = Inbox()


class GazeboRosPlanarMove(ClassicController[PlanarMoveState]):
    """Sets the velocity of the robot's base on the ground, as Gazebo Classic does.

    With J joints:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    link_frames         --    --       list of RigidTransform: pose of each link in the
                                       world
    /cmd_vel            --    --       Twist: velocity forwards, to the left, of turning
    command_interfaces  --    --       UpdateResult; nothing
    held_twist          --    --       HeldTwist for the ticks in which it sets it, else
                                       None
    /odom               --    --       Odometry: the truth, if ``publish_odom``
    /tf                 --    --       TFMessage with the same, if ``publish_odom_tf``
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    Topics have the names that namespace and remappings make. The state is a
    PlanarMoveState, renewed in every tick. It sets the velocity once, 1 /
    ``update_rate`` after the last time at the earliest, and in between the base goes on
    by itself: what rubs on the ground brakes it. The components that a base on the
    ground doesn't have are set to 0. The last command holds for ever. See `BaseServo`
    for what does it.

    The odometry is published at times 1 / ``publish_rate`` apart; its velocities are
    means over a tick. Without link_frames its messages are empty. A rate of 0 is every
    tick. A message with a number that isn't finite is dropped, which Gazebo takes.
    """

    _tag: GazeboRosPlanarMoveTag
    moves_sideways = True

    def __init__(
        self, tag: GazeboRosPlanarMoveTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        super().__init__(tag, params, PlanarMoveState(np.zeros(0)))
        self._declare_topic(interfaces.TWIST_PORT, lambda state: state.held)
        self._declare_outputs()

    def _update(self, now: UpdateContext, state: PlanarMoveState) -> PlanarMoveState:
        state = self._receive(now, state)
        state = self._publish(now, state)
        if is_early(now.time_ns - state.last_ns, self._tag.update_rate):
            return state._replace(held=None)
        return state._replace(held=state.target, last_ns=now.time_ns)

    def _publish(self, now: UpdateContext, state: PlanarMoveState) -> PlanarMoveState:
        """Return the state with the odometry of a tick."""
        if not (poses := self._see(now)):
            return state
        [pose] = poses
        last, state = state.truth or pose, state._replace(truth=pose)
        if is_early(now.time_ns - state.published_ns, self._tag.publish_rate):
            return state
        dt = now.period_ns / NANOSECONDS
        message = self._describe_base(now.time_ns, last, pose, dt)
        return state._replace(published=message, published_ns=now.time_ns)

    def _take_twist(
        self, state: PlanarMoveState, message: Twist, time_ns: int
    ) -> tuple[PlanarMoveState, str]:
        if fault := find_twist_fault(message, sideways=True):
            return state, fault
        linear = (message.linear.x, message.linear.y, 0.0)
        target = HeldTwist(linear, (0.0, 0.0, message.angular.z), is_level=True)
        return state._replace(target=target), ""

    def _activate(self, now: UpdateContext, state: PlanarMoveState) -> PlanarMoveState:
        # Where the base was when it stopped tells no velocity.
        return state._replace(truth=None)

    def _deactivate(
        self, now: UpdateContext, state: PlanarMoveState
    ) -> PlanarMoveState:
        return state._replace(target=HeldTwist(is_level=True), held=None)
