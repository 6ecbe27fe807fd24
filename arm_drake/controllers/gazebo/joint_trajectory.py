"""Gazebo's plugins that take joints from point to point of a trajectory.

They aren't ros2_control's controller. n is the number of the controller's joints.

Sources: gz-sim, src/systems/joint_trajectory_controller/JointTrajectoryController.cc;
of Gazebo Classic gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/
gazebo_ros_joint_pose_trajectory.cpp.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.gazebo.plugin import (
    GazeboPid,
    GazeboPidState,
    JointForces,
    is_early,
    ros_topic,
    trajectory_topic,
)
from arm_drake.controllers.topics import Inbox, TopicController
from arm_drake.description.gazebo_plugins import (
    GazeboRosJointPoseTrajectory as GazeboRosJointPoseTrajectoryTag,
)
from arm_drake.description.gazebo_plugins import (
    JointTrajectoryController as JointTrajectoryControllerTag,
)
from arm_drake.errors import suggest
from arm_drake.messages import (
    NANOSECONDS,
    Float32,
    JointTrajectory,
    JointTrajectoryPoint,
)


class Following(NamedTuple):
    """A trajectory on its way; it has points."""

    message: JointTrajectory

    # When it starts [ns].
    start_ns: int

    # The point that is the target; None before the start.
    point: int | None = None

    @property
    def progress(self) -> float:
        """Part of the points so far, that of the target included."""
        so_far = 0 if self.point is None else self.point + 1
        return so_far / len(self.message.points)


class Targets(NamedTuple):
    """Targets of n joints; arrays of shape (n,), never changed."""

    # [rad] or [m].
    position: Array

    # [rad/s] or [m/s].
    velocity: Array

    # [N·m] or [N].
    effort: Array


def advance(following: Following, time_ns: int) -> Following:
    """Return a trajectory with the target of a time; itself if that is no other.

    The first point is the target from the start on, each further one as soon as the
    time since the start is above the `time_from_start` of the one before.
    """
    elapsed_ns = time_ns - following.start_ns
    if elapsed_ns < 0:
        return following
    points, point = following.message.points, following.point or 0
    last = len(points) - 1
    while point < last and points[point].time_from_start.to_nanoseconds() < elapsed_ns:
        point += 1
    return following if point == following.point else following._replace(point=point)


def take_targets(
    targets: Targets,
    point: JointTrajectoryPoint,
    names: tuple[str, ...],
    joints: Mapping[str, int],
) -> Targets:
    """Return the targets of a point; what it lacks stays as it was."""
    new = Targets(*(part.copy() for part in targets))
    commanded = (point.positions, point.velocities, point.effort)
    for values, goal in zip(commanded, new, strict=True):
        for name, value in zip(names, values, strict=False):
            if name in joints:
                goal[joints[name]] = value
    return new


# Fields of the tag for each of the two PIDs, and what holds for joints without a value.
# These limits are none, for the maximum is below the minimum.
_GAINS = {
    **{"p_gain": 0.0, "i_gain": 0.0, "d_gain": 0.0},
    **{"i_max": -1.0, "i_min": 0.0, "cmd_max": -1.0, "cmd_min": 0.0},
    "cmd_offset": 0.0,
}
_PIDS = (interfaces.POSITION, interfaces.VELOCITY)


class GazeboTrajectoryState(NamedTuple):
    """State of a JointTrajectoryController between two ticks."""

    targets: Targets

    # Of the PIDs for positions, then velocities.
    pid: GazeboPidState

    # What to write, shape (k,).
    command: Array

    # None before the first one.
    following: Following | None = None

    # Part of the points so far, in (0, 1]; 0 before the first one.
    progress: Float32 = Float32(0.0)

    inbox: Inbox = Inbox()


class JointTrajectoryController(TopicController[GazeboTrajectoryState]):
    """Takes joints from point to point of a trajectory by the forces of PIDs.

    With n joints of the tag, J joints and k joints that carry forces:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       JointTrajectory: what to do from now on
    command_interfaces  --    --       UpdateResult; command (k,), in N·m or N
    /<topic>_progress   --    --       Float32: part of the points so far, that of the
                                       present target included
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a GazeboTrajectoryState, renewed in every tick. At each joint, with
    position q, velocity v, and targets r, w and f of the present point::

        force = position_pid(q - r) + velocity_pid(v - w) + f

    The first point is the target from the start on, each further one as soon as the
    time since the start is above ``time_from_start`` of the one before; there is no
    interpolation. What a point lacks leaves the target as it was, and the PIDs go on:
    in gz-sim they start anew only when time jumps back. The last target holds.

    A trajectory starts at the tick that sees it. With ``use_header_start_time`` it
    starts at the time in its header, if there is one, and nothing changes before; in
    gz-sim it then never gets beyond its first point.

    Joints that aren't the controller's are left out of a trajectory, with an event. One
    without points ends the one before and keeps its target; one without joints, without
    any of the controller's, or with numbers that aren't finite is dropped.

    The force at a joint is limited by the joint's effort limit. That at a mimic joint
    acts on its master, see JointForces. An activation starts from the tag's initial
    positions; when it ends, efforts are 0.
    """

    reads_by_now = True

    def __init__(
        self,
        tag: JointTrajectoryControllerTag,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        # All joints, where none is named.
        joints = tuple(dict.fromkeys(tag.joint_names)) or tuple(params.joint_types)
        self._at = {joint: k for k, joint in enumerate(joints)}
        self._uses_stamp = tag.use_header_start_time
        self._pid = GazeboPid.from_gains(
            *(
                [
                    value
                    for pid in _PIDS
                    for value in _fill(getattr(tag, f"{pid}_{name}"), joints, default)
                ]
                for name, default in _GAINS.items()
            )
        )
        self._forces = JointForces.from_joints(
            self._at, params.followed, params.effort_limits
        )
        claims = interfaces.interface_names(self._forces.joints, (interfaces.EFFORT,))
        at_start = _fill(tag.initial_positions, joints, 0.0)
        zeros = np.zeros(len(joints))
        self._start = Targets(np.array(at_start), zeros, zeros)
        self._at_rest = np.zeros(len(claims))
        super().__init__(
            params,
            GazeboTrajectoryState(self._start, self._pid.initial(), self._at_rest),
            state_interfaces=interfaces.interface_names(joints, _PIDS),
            command_interfaces=claims,
        )
        topic = trajectory_topic(tag, params.robot_name)
        self._subscribe(topic, JointTrajectory, self._take)
        self._declare_topic(
            f"{topic}_progress", lambda state: state.progress, default=Float32()
        )
        self._declare_events()

    def _update(
        self, now: UpdateContext, state: GazeboTrajectoryState
    ) -> GazeboTrajectoryState:
        state = self._advance(now, self._receive(now, state))
        targets = state.targets
        desired = np.concatenate([targets.position, targets.velocity])
        error = self._measured_now(now) - desired
        pid, parts = self._pid.step(state.pid, error, now.period_ns / NANOSECONDS)
        n = len(self._at)
        command = self._forces.to_efforts(parts[:n] + parts[n:] + targets.effort)
        return state._replace(pid=pid, command=command)

    def _advance(
        self, now: UpdateContext, state: GazeboTrajectoryState
    ) -> GazeboTrajectoryState:
        """Return the state with the targets of this tick."""
        if state.following is None:
            return state
        following = advance(state.following, now.time_ns)
        if following is state.following or following.point is None:
            return state
        message = following.message
        point, names = message.points[following.point], message.joint_names
        return state._replace(
            targets=take_targets(state.targets, point, names, self._at),
            following=following,
            progress=Float32(following.progress),
        )

    def _take(
        self, state: GazeboTrajectoryState, message: JointTrajectory, time_ns: int
    ) -> tuple[GazeboTrajectoryState, str]:
        if fault := self._find_fault(message):
            return state, fault
        unknown = [name for name in message.joint_names if name not in self._at]
        if unknown:
            names = ", ".join(map(repr, unknown))
            fault = f"no joint {names} here; the other joints follow it"
        stamp_ns = message.header.stamp.to_nanoseconds()
        start_ns = stamp_ns if self._uses_stamp and stamp_ns else time_ns
        following = Following(message, start_ns) if message.points else None
        return state._replace(following=following), fault

    def _find_fault(self, message: JointTrajectory) -> str:
        """Return why a message is dropped; empty if it isn't."""
        if not message.joint_names:
            return "joint_names must not be empty; the trajectory is dropped"
        if self._at.keys().isdisjoint(message.joint_names):
            hint = suggest(message.joint_names[0], self._at)
            return f"none of its joints is here; {hint}; the trajectory is dropped"
        for k, point in enumerate(message.points):
            for field in ("positions", "velocities", "effort"):
                for i, value in enumerate(getattr(point, field)):
                    if not math.isfinite(value):
                        place = f"points[{k}].{field}[{i}]"
                        fault = f"{place} must be finite, got {value}"
                        return f"{fault}; the trajectory is dropped"
        return ""

    def _activate(
        self, now: UpdateContext, state: GazeboTrajectoryState
    ) -> GazeboTrajectoryState:
        return state._replace(
            targets=self._start, pid=self._pid.initial(), following=None
        )

    def _deactivate(
        self, now: UpdateContext, state: GazeboTrajectoryState
    ) -> GazeboTrajectoryState:
        return state._replace(command=self._at_rest)


def _fill(
    values: Sequence[float], joints: Sequence[str], default: float
) -> list[float]:
    """Return a value for each joint, the default where there is none."""
    return [values[k] if k < len(values) else default for k in range(len(joints))]


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

    inbox: Inbox = Inbox()


class GazeboRosJointPoseTrajectory(TopicController[PoseTrajectoryState]):
    """Sets joints to the points of a trajectory, one after the other.

    With J joints and k of them that have a position command and follow no other:

    =====================  ====  =======  ==============================================
    port                   size  unit     meaning
    =====================  ====  =======  ==============================================
    controller_manager     --    --       Cycle: when to tick
    state_interfaces       2J    rad, ..  not read
    /set_joint_trajectory  --    --       JointTrajectory: what to do from now on; by
                                          the name that namespace and remappings make
    command_interfaces     --    --       UpdateResult; command (k,), in rad or m
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
        """Create the system."""
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
        self._subscribe(topic, JointTrajectory, self._take)
        self._declare_events()

    def _update(
        self, now: UpdateContext, state: PoseTrajectoryState
    ) -> PoseTrajectoryState:
        state = self._receive(now, state)
        replay, time_ns = state.replay, now.time_ns
        if replay is None or time_ns < replay.start_ns:
            return state
        if state.last_ns is not None and is_early(time_ns - state.last_ns, self._rate):
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

    def _take(
        self, state: PoseTrajectoryState, message: JointTrajectory, time_ns: int
    ) -> tuple[PoseTrajectoryState, str]:
        if fault := self._find_fault(message):
            return state, fault
        start_ns = max(message.header.stamp.to_nanoseconds(), time_ns)
        replay = Replay(message, 0, start_ns) if message.points else None
        return state._replace(replay=replay), ""

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

    def _activate(
        self, now: UpdateContext, state: PoseTrajectoryState
    ) -> PoseTrajectoryState:
        return state._replace(replay=None)

    def _deactivate(
        self, now: UpdateContext, state: PoseTrajectoryState
    ) -> PoseTrajectoryState:
        return state._replace(command=self._nothing)


def _find_number_fault(message: JointTrajectory) -> str:
    n = len(message.joint_names)
    for k, point in enumerate(message.points):
        if len(point.positions) != n:
            return f"points[{k}] has {len(point.positions)} positions for {n} joints"
        for i, value in enumerate(point.positions):
            if not math.isfinite(value):
                return f"points[{k}].positions[{i}] must be finite, got {value}"
    return ""
