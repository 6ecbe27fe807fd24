"""``libgazebo_ros_joint_pose_trajectory.so`` of Gazebo Classic.

Source: gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/
gazebo_ros_joint_pose_trajectory.cpp.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.gazebo.gazebo_topics import ros_topic
from arm_drake.controllers.topics import INACTIVE, Events, add_events, new_messages
from arm_drake.description.gazebo_joints import (
    GazeboRosJointPoseTrajectory as GazeboRosJointPoseTrajectoryTag,
)
from arm_drake.errors import suggest
from arm_drake.messages import NANOSECONDS, JointTrajectory, TopicRejected

# Frames of messages that are no links.
_FRAMES = ("world", "map")


class Replay(NamedTuple):
    """A trajectory that is being replayed."""

    message: JointTrajectory

    # Its next point, and from when on [ns] that can be set.
    point: int
    start_ns: int


class PoseTrajectoryState(NamedTuple):
    """State of a GazeboRosJointPoseTrajectory between two ticks."""

    # What to write, shape (k,); NaN for joints that no message has moved.
    command: Array

    # None once all points are set.
    replay: Replay | None = None

    # When the last point was set [ns]; None before the first one.
    last_ns: int | None = None

    # Messages on the port at the last tick.
    seen: tuple[JointTrajectory, ...] = ()

    # The latest messages that were not accepted.
    events: Events = ()


class GazeboRosJointPoseTrajectory(TickingController[PoseTrajectoryState]):
    """Sets joints to the points of a trajectory, one after the other.

    .. pydrake_system::

        name: GazeboRosJointPoseTrajectory
        input_ports:
        - controller_manager
        - state_interfaces
        - /set_joint_trajectory
        output_ports:
        - command_interfaces
        - events

    With J joints and k of them that have a position command and follow no other:

    =====================  ====  =======  ==============================================
    port                   size  unit     meaning
    =====================  ====  =======  ==============================================
    controller_manager     --    --       Cycle: when to tick
    state_interfaces       2J    rad, ..  not read
    /set_joint_trajectory  --    --       JointTrajectory: what to do from now on; by
                                          the name that namespace and remappings make
    command_interfaces     --    --       Tick; its command is (k,), in rad or m
    events                 --    --       tuple of the latest (number, TopicRejected),
                                          the newest last
    =====================  ====  =======  ==============================================

    The state is a PoseTrajectoryState, renewed in every tick. The first point is set at
    the time in the header, or at once if that is past. ``time_from_start`` of a point
    is the *delay until the next one*, not the time since the start. Between two points
    there is at least 1 / ``update_rate``; 0 is every tick. A new message replaces the
    one before.

    Gazebo puts the joints there, without any motion, and lets go of them. Here they are
    positions for the joints' servos to go to and to hold. A mimic joint is where its
    master takes it, whatever the message says.

    A message is dropped if its frame is neither a link nor "world" nor "map"; if it has
    a joint that the robot lacks or that has no position command; if a point has another
    number of positions than there are joints (Gazebo leaves out that point alone) or
    one that isn't finite.
    """

    def __init__(
        self,
        tag: GazeboRosJointPoseTrajectoryTag,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            tag: Fields of the plugin.
            params: Rate and surroundings of the controller.
        """
        names = interfaces.interface_names(params.joint_types, (interfaces.POSITION,))
        here = [
            (joint, name)
            for joint, name in zip(params.joint_types, names, strict=True)
            if joint not in params.followed and name in params.command_interfaces
        ]
        self._at = {joint: k for k, (joint, _) in enumerate(here)}
        self._rate = tag.update_rate
        self._nothing = np.full(len(here), np.nan)
        super().__init__(
            params,
            PoseTrajectoryState(self._nothing),
            command_interfaces=tuple(name for _, name in here),
        )
        topic = ros_topic("set_joint_trajectory", tag.namespace, tag.remappings)
        self.message_types = {topic: JointTrajectory}
        self._topic = self.DeclareAbstractInputPort(topic, AbstractValue.Make(()))
        self._declare_topic("events", lambda state: state.events)

    def _update(self, now: Now, state: PoseTrajectoryState) -> PoseTrajectoryState:
        state = self._receive(now, state)
        replay, time_ns = state.replay, now.time_ns
        if (
            replay is None
            or time_ns < replay.start_ns
            or self._is_early(time_ns, state)
        ):
            return state
        point = replay.message.points[replay.point]
        command = state.command.copy()
        for joint, value in zip(
            replay.message.joint_names, point.positions, strict=True
        ):
            if joint in self._at:
                command[self._at[joint]] = value
        delay_ns = point.time_from_start.to_nanoseconds()
        following = Replay(replay.message, replay.point + 1, replay.start_ns + delay_ns)
        has_more = following.point < len(replay.message.points)
        return state._replace(
            command=command, replay=following if has_more else None, last_ns=time_ns
        )

    def _is_early(self, time_ns: int, state: PoseTrajectoryState) -> bool:
        """Return whether the last point was set less than 1 / update_rate ago."""
        if state.last_ns is None or self._rate <= 0.0:
            return False
        # Times of ticks are cut to whole nanoseconds.
        return (time_ns - state.last_ns + 1) * self._rate < NANOSECONDS

    def _receive(
        self, now: Now, state: PoseTrajectoryState, obstacle: str = ""
    ) -> PoseTrajectoryState:
        """Return the state with what has come in.

        Args:
            now: The time, and where the inputs are read.
            state: State after the last tick.
            obstacle: Why no message is taken; empty if they are.
        """
        new, seen = new_messages(self._topic, now.context, JointTrajectory, state.seen)
        if seen is state.seen:
            return state
        replay, news = state.replay, []
        for message in new:
            fault = obstacle or self._find_fault(message)
            if fault:
                news.append(TopicRejected(message, fault))
                continue
            start_ns = max(message.header.stamp.to_nanoseconds(), now.time_ns)
            replay = Replay(message, 0, start_ns) if message.points else None
        events = add_events(state.events, news)
        return state._replace(replay=replay, seen=seen, events=events)

    def _find_fault(self, message: JointTrajectory) -> str:
        """Return why a message is dropped; empty if it isn't."""
        fault = self._find_name_fault(message) or _find_number_fault(message)
        return f"{fault}; the trajectory is dropped" if fault else ""

    def _find_name_fault(self, message: JointTrajectory) -> str:
        frame, links = message.header.frame_id, self.params.links
        if frame not in (*links, *_FRAMES):
            return (
                f"header.frame_id must be a link, 'world' or 'map', got {frame!r}; "
                f"{suggest(frame, links)}"
            )
        for joint in message.joint_names:
            if joint not in self.params.joint_types:
                hint = suggest(joint, self.params.joint_types)
                return f"the robot has no joint {joint!r}; {hint}"
            if joint not in self._at and joint not in self.params.followed:
                return f"joint {joint!r} has no position command"
        return ""

    def _activate(self, now: Now, state: PoseTrajectoryState) -> PoseTrajectoryState:
        del now
        return state._replace(replay=None)

    def _deactivate(self, now: Now, state: PoseTrajectoryState) -> PoseTrajectoryState:
        del now
        return state._replace(command=self._nothing)

    def _idle(self, now: Now, state: PoseTrajectoryState) -> PoseTrajectoryState:
        return self._receive(now, state, INACTIVE)

    def _command(self, state: PoseTrajectoryState) -> Array:
        return state.command


def _find_number_fault(message: JointTrajectory) -> str:
    n = len(message.joint_names)
    for k, point in enumerate(message.points):
        if len(point.positions) != n:
            return f"points[{k}] has {len(point.positions)} positions for {n} joints"
        for i, value in enumerate(point.positions):
            if not math.isfinite(value):
                return f"points[{k}].positions[{i}] must be finite, got {value}"
    return ""
