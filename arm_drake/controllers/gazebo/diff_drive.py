"""Gazebo's own DiffDrive, which isn't ros2_control's.

Source: gz-sim, src/systems/diff_drive/DiffDrive.cc (Ignition Gazebo has the same), with
gz-math's SpeedLimiter and DiffDriveOdometry.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake.arrays import Array
from arm_drake.control.diff_drive import DiffDriveKinematics, DiffDriveOdometryState
from arm_drake.control.odometry import RollingMean
from arm_drake.controllers.bases.base import (
    BaseFrames,
    diagonal,
    make_odometry,
    make_transform,
)
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.gazebo.gazebo_diff_drive import SpeedLimits
from arm_drake.controllers.gazebo.gazebo_topics import drive_topics, find_twist_fault
from arm_drake.controllers.topics import INACTIVE, Events, add_events, new_messages
from arm_drake.description.gazebo_drives import DiffDrive as DiffDriveTag
from arm_drake.messages import (
    NANOSECONDS,
    Bool,
    Message,
    Odometry,
    TopicRejected,
    Twist,
)

_REST = (0.0, 0.0)

# Samples over which the published velocities are means.
_WINDOW = 10

_CERTAIN = diagonal((0.0,) * 6)


class GazeboDriveState(NamedTuple):
    """State of a DiffDrive between two ticks."""

    odometry: DiffDriveOdometryState

    # What to write, left wheels first [rad/s], shape (k,).
    command: Array

    # Forwards [m/s], turning [rad/s]: what is asked for, and the last two that the
    # limits let through, the newest first.
    target: tuple[float, float] = _REST
    limited: tuple[tuple[float, float], tuple[float, float]] = (_REST, _REST)

    # Whether commands are taken.
    is_enabled: bool = True

    # Whether the odometry has begun to count.
    counts: bool = False

    # What was published last, and when [ns].
    published: Odometry = Odometry()
    published_ns: int = 0

    # Messages on the ports at the last tick.
    twists: tuple[Twist, ...] = ()
    switches: tuple[Bool, ...] = ()

    # The latest messages that were not accepted.
    events: Events = ()


class DiffDrive(TickingController[GazeboDriveState]):
    """Turns the wheels of two sides so that a base moves as it is told.

    .. pydrake_system::

        name: DiffDrive
        input_ports:
        - controller_manager
        - state_interfaces
        - /<topic>
        - /model/<model>/enable
        output_ports:
        - command_interfaces
        - /<odom_topic>
        - /<tf_topic>
        - events

    With J joints and k wheels:

    =====================  ====  =======  ==============================================
    port                   size  unit     meaning
    =====================  ====  =======  ==============================================
    controller_manager     --    --       Cycle: when to tick
    state_interfaces       2J    rad, ..  positions and velocities of all joints
    /<topic>               --    --       Twist: velocity forwards and of turning
    /model/<model>/enable  --    --       Bool: whether commands are taken
    command_interfaces     --    rad/s    Tick; its command is (k,), left wheels first
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

    def __init__(self, tag: DiffDriveTag, params: ControllerInterfaceParams) -> None:
        """Create the system.

        Args:
            tag: Fields of the plugin.
            params: Rate and surroundings of the controller.
        """
        radius = tag.wheel_radius
        self._kinematics = DiffDriveKinematics(tag.wheel_separation, radius, radius)
        self._limits = (_find_limits(tag, "linear"), _find_limits(tag, "angular"))
        rate = tag.odom_publish_frequency
        self._period_ns = int(NANOSECONDS / rate) if rate > 0.0 else 0
        model = params.robot_name
        self._frames = BaseFrames(
            tag.frame_id or f"{model}/odom",
            tag.child_frame_id or f"{model}/{tag.base_link}",
        )
        # Of a wheel on both sides, the right one is the last to be told.
        sides = {
            **dict.fromkeys(tag.left_joints, 0),
            **dict.fromkeys(tag.right_joints, 1),
        }
        self._side = np.array(list(sides.values()), dtype=np.intp)
        super().__init__(
            params,
            GazeboDriveState(
                DiffDriveOdometryState(RollingMean(_WINDOW)), np.zeros(len(sides))
            ),
            state_interfaces=tuple(
                f"{side[0]}/position" for side in (tag.left_joints, tag.right_joints)
            ),
            command_interfaces=tuple(f"{joint}/velocity" for joint in sides),
        )
        topics = drive_topics(tag, model)
        self._enable = topics.enable
        self.message_types: Mapping[str, type[Message]] = {
            topics.command: Twist,
            topics.enable: Bool,
        }
        nothing = AbstractValue.Make(())
        self._twists = self.DeclareAbstractInputPort(topics.command, nothing)
        self._switches = self.DeclareAbstractInputPort(topics.enable, nothing)
        self._declare_topic(topics.odometry, lambda state: state.published)
        self._declare_topic(topics.tf, lambda state: make_transform(state.published))
        self._declare_topic("events", lambda state: state.events)

    def _update(self, now: Now, state: GazeboDriveState) -> GazeboDriveState:
        state = self._receive(now, state)
        dt = now.period_ns / NANOSECONDS
        last, before = state.limited
        v, w = (
            limits.limit(asked, v0, v1, dt)
            for limits, asked, v0, v1 in zip(
                self._limits, state.target, last, before, strict=True
            )
        )
        command = np.array(self._kinematics.wheels(v, w))[self._side]
        state = state._replace(limited=((v, w), last), command=command)
        if not state.counts:
            return state._replace(counts=True)
        left, right = self._read(now.context).tolist()
        odometry = self._kinematics.from_positions(state.odometry, left, right, dt)
        state = state._replace(odometry=odometry)
        if now.time_ns - state.published_ns < self._period_ns:
            return state
        v, w = odometry.velocity
        message = make_odometry(
            now.time_ns,
            self._frames,
            odometry.pose,
            (v, 0.0, w),
            (_CERTAIN, _CERTAIN),
        )
        return state._replace(published=message, published_ns=now.time_ns)

    def _receive(
        self, now: Now, state: GazeboDriveState, obstacle: str = ""
    ) -> GazeboDriveState:
        """Return the state with what has come in.

        Args:
            now: Where the inputs are read.
            state: State after the last tick.
            obstacle: Why no message is taken; empty if they are.
        """
        context, news = now.context, []
        switches, all_switches = new_messages(
            self._switches, context, Bool, state.switches
        )
        twists, all_twists = new_messages(self._twists, context, Twist, state.twists)
        if all_switches is state.switches and all_twists is state.twists:
            return state
        target, is_enabled = state.target, state.is_enabled
        for switch in switches:
            if obstacle:
                news.append(TopicRejected(switch, obstacle))
                continue
            is_enabled = switch.data
            target = target if is_enabled else _REST
        disabled = "" if is_enabled else f"{self._enable} is false"
        for twist in twists:
            fault = obstacle or find_twist_fault(twist) or disabled
            if fault:
                news.append(TopicRejected(twist, fault))
            else:
                target = (twist.linear.x, twist.angular.z)
        return state._replace(
            target=target,
            is_enabled=is_enabled,
            twists=all_twists,
            switches=all_switches,
            events=add_events(state.events, news),
        )

    def _deactivate(self, now: Now, state: GazeboDriveState) -> GazeboDriveState:
        del now
        return state._replace(
            command=np.zeros(len(state.command)), target=_REST, limited=(_REST, _REST)
        )

    def _idle(self, now: Now, state: GazeboDriveState) -> GazeboDriveState:
        return self._receive(now, state, INACTIVE)

    def _command(self, state: GazeboDriveState) -> Array:
        return state.command


def _find_limits(tag: DiffDriveTag, kind: str) -> SpeedLimits:
    """Return the limits of a speed.

    Args:
        tag: Fields of the plugin.
        kind: "linear" or "angular".
    """
    limits = {}
    for name in SpeedLimits._fields:
        end, _, quantity = name.partition("_")
        own: float = getattr(tag, f"{end}_{kind}_{quantity}")
        limits[name] = getattr(tag, name) if math.isnan(own) else own
    return SpeedLimits(**limits)
