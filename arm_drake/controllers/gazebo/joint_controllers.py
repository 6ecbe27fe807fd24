"""What Gazebo's controllers of single joints share: numbers on topics move joints.

Source: gz-sim, src/systems/joint_position_controller/JointPositionController.cc and
joint_controller/JointController.cc.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.gazebo.gazebo_forces import JointForces
from arm_drake.controllers.gazebo.plugin import GazeboPid, GazeboPidState
from arm_drake.controllers.gripper_command import GRIPPER_COMMAND, find_part_fault
from arm_drake.controllers.topics import INACTIVE, Events, add_events, new_messages
from arm_drake.description.gazebo_joints import JointController as JointControllerTag
from arm_drake.description.gazebo_joints import (
    JointPositionController as JointPositionControllerTag,
)
from arm_drake.messages import NANOSECONDS, Float32, Float64, TopicRejected

_GAINS = ("p_gain", "i_gain", "d_gain")
_LIMITS = ("i_max", "i_min", "cmd_max", "cmd_min", "cmd_offset")


class JointCommandState(NamedTuple):
    """State of a GazeboCommandBase between two ticks, with n tags."""

    # Target of each tag [rad], [rad/s], [m] or [m/s], shape (n,).
    targets: Array

    # Of the n tags' PIDs.
    pid: GazeboPidState

    # What to write, shape (k,).
    command: Array

    # Messages on each topic's port at the last tick.
    seen: tuple[tuple[Float64, ...], ...]

    # The latest messages that were not accepted.
    events: Events = ()


class GazeboCommandBase(TickingController[JointCommandState]):
    """Moves the joints of n tags by forces or velocities that follow from targets."""

    @abstractmethod
    def __init__(
        self,
        tags: Sequence[JointPositionControllerTag | JointControllerTag],
        params: ControllerInterfaceParams,
        *,
        topics: Sequence[str],
        targets: Sequence[float],
        by_force: Sequence[bool],
        read: str,
        grips: Mapping[int, tuple[float, float]] | None = None,
    ) -> None:
        """Create the system.

        Args:
            tags: Fields of the plugins, n of them; of tags with the same joint the last
                one moves it.
            params: Rate and surroundings of the controller.
            topics: Topic of each tag.
            targets: Target of each tag at the start [rad], [rad/s], [m] or [m/s].
            by_force: Whether each tag commands a force, not a velocity.
            read: Interface that the tags read of their first joints.
            grips: Targets at which a gripper is open and closed, by the tags that move
                it; they follow the topic `gripper_command` too.
        """
        self._by_force = np.array(by_force, dtype=bool)
        self._pid = GazeboPid.from_gains(
            *([getattr(tag, name) for tag in tags] for name in (*_GAINS, *_LIMITS))
        )
        tag_of = {joint: k for k, tag in enumerate(tags) for joint in tag.joint_names}
        followed = params.followed
        moved = {
            joint: k
            for joint, k in tag_of.items()
            if not by_force[k] and joint not in followed
        }
        # A joint that moves at a given velocity takes no notice of forces.
        pushed = {
            joint: k
            for joint, k in tag_of.items()
            if by_force[k] and followed.get(joint, (joint,))[0] not in moved
        }
        self._forces = JointForces.from_joints(pushed, followed, params.effort_limits)
        self._moved_by = np.array(list(moved.values()), dtype=np.intp)
        claims = (
            *(f"{joint}/effort" for joint in self._forces.joints),
            *(f"{joint}/velocity" for joint in moved),
        )
        self._start = np.array(targets, dtype=float)
        self._at_rest = np.zeros(len(claims))
        # Of those that follow it: where it is open, and how far it closes.
        ends = np.array(list((grips or {}).values())).reshape(-1, 2)
        self._grips = np.array(list(grips or {}), dtype=np.intp)
        self._open, self._way = ends[:, 0], ends[:, 1] - ends[:, 0]
        names = (*topics, GRIPPER_COMMAND) if grips else topics
        self._names = tuple(dict.fromkeys(names))
        super().__init__(
            params,
            JointCommandState(
                self._start,
                self._pid.initial(),
                self._at_rest,
                ((),) * len(self._names),
            ),
            state_interfaces=tuple(f"{tag.joint_names[0]}/{read}" for tag in tags),
            command_interfaces=claims,
        )
        self.message_types: dict[str, type[Float64]] = {
            name: Float32 if name == GRIPPER_COMMAND else Float64
            for name in self._names
        }
        # One topic may be that of several tags.
        self._topics = [
            (
                self.DeclareAbstractInputPort(name, AbstractValue.Make(())),
                [k for k, topic in enumerate(topics) if topic == name],
            )
            for name in self._names
        ]
        self._declare_topic("events", lambda state: state.events)

    @abstractmethod
    def _step(
        self, pid: GazeboPidState, measured: Array, targets: Array, dt: float
    ) -> tuple[GazeboPidState, Array]:
        """Return the PIDs' state after a tick, and force or velocity of each tag.

        Args:
            pid: State of the PIDs before the tick.
            measured: What is read of the first joint of each tag, shape (n,).
            targets: The targets, shape (n,).
            dt: Time since the last tick [s].
        """

    def _update(self, now: Now, state: JointCommandState) -> JointCommandState:
        state = self._receive(now, state)
        measured = self._read(now.context)
        dt = now.period_ns / NANOSECONDS
        pid, values = self._step(state.pid, measured, state.targets, dt)
        command = self._forces.to_efforts(values)
        if self._moved_by.size:
            command = np.concatenate([command, values[self._moved_by]])
        return state._replace(pid=pid, command=command)

    def _receive(
        self, now: Now, state: JointCommandState, obstacle: str = ""
    ) -> JointCommandState:
        """Return the state with what has come in.

        Args:
            now: Where the inputs are read.
            state: State after the last tick.
            obstacle: Why no message is taken; empty if they are.
        """
        targets, news, changed = state.targets, [], {}
        for index, (port, tags) in enumerate(self._topics):
            before = state.seen[index]
            new, seen = new_messages(port, now.context, Float64, before)
            if seen is before:
                continue
            changed[index] = seen
            is_grip = self._names[index] == GRIPPER_COMMAND
            find_fault = find_part_fault if is_grip else _find_fault
            for message in new:
                fault = obstacle or find_fault(message)
                if fault:
                    reason = f"{self._names[index]}: {fault}"
                    news.append(TopicRejected(message, reason))
                    continue
                targets = targets.copy()
                if is_grip:
                    targets[self._grips] = self._open + message.data * self._way
                else:
                    targets[tags] = message.data
        if not changed:
            return state
        seen_now = tuple(changed.get(k, old) for k, old in enumerate(state.seen))
        events = add_events(state.events, news)
        return state._replace(targets=targets, seen=seen_now, events=events)

    def _activate(self, now: Now, state: JointCommandState) -> JointCommandState:
        del now
        return state._replace(targets=self._start, pid=self._pid.initial())

    def _deactivate(self, now: Now, state: JointCommandState) -> JointCommandState:
        del now
        return state._replace(command=self._at_rest)

    def _idle(self, now: Now, state: JointCommandState) -> JointCommandState:
        return self._receive(now, state, INACTIVE)

    def _command(self, state: JointCommandState) -> Array:
        return state.command


def _find_fault(message: Float64) -> str:
    """Return why a message is dropped; empty if it isn't."""
    if math.isfinite(message.data):
        return ""
    return f"data must be finite, got {message.data}; it is dropped"
