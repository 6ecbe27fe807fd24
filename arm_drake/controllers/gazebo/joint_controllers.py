"""Gazebo's controllers of single joints, all of a robot's at once: topics of numbers.

Sources: gz-sim, src/systems/joint_position_controller/JointPositionController.cc and
joint_controller/JointController.cc.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import SilentTicks, UpdateContext, UpdateResult
from arm_drake.controllers.gazebo.plugin import (
    GazeboPid,
    GazeboPidState,
    JointForces,
    find_number_fault,
    position_topic,
    velocity_topic,
)
from arm_drake.controllers.topics import (
    GRIPPER_COMMAND,
    Inbox,
    TopicController,
    find_part_fault,
)
from arm_drake.description.gazebo_plugins import JointController as JointControllerTag
from arm_drake.description.gazebo_plugins import (
    JointPositionController as JointPositionControllerTag,
)
from arm_drake.messages import NANOSECONDS, Float32, Float64

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

    inbox: Inbox = Inbox()


class GazeboCommandBase(TopicController[JointCommandState]):
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
        """Create the system."""
        self._by_force = np.array(by_force, dtype=bool)
        self._pid = GazeboPid.from_gains(
            *([getattr(tag, name) for tag in tags] for name in (*_GAINS, *_LIMITS))
        )
        moved, pushed = _split(tags, by_force, params.followed)
        self._forces = JointForces.from_joints(
            pushed, params.followed, params.effort_limits
        )
        self._moved_by = np.array(list(moved.values()), dtype=np.intp)
        claims = (
            *(f"{joint}/effort" for joint in self._forces.joints),
            *(f"{joint}/velocity" for joint in moved),
        )
        self.num_remembered = 2 * len(tags) + len(claims)
        self._start = np.array(targets, dtype=float)
        self._at_rest = np.zeros(len(claims))
        # Of those that follow it: where it is open, and how far it closes.
        ends = np.array(list((grips or {}).values())).reshape(-1, 2)
        self._grips = np.array(list(grips or {}), dtype=np.intp)
        self._open, self._way = ends[:, 0], ends[:, 1] - ends[:, 0]
        super().__init__(
            params,
            JointCommandState(self._start, self._pid.initial(), self._at_rest),
            state_interfaces=tuple(f"{tag.joint_names[0]}/{read}" for tag in tags),
            command_interfaces=claims,
        )
        # One topic may be that of several tags.
        for name in dict.fromkeys(topics):
            at = [k for k, topic in enumerate(topics) if topic == name]
            take = partial(self._take, at)
            self._subscribe(name, Float64, take, label=f"{name}: ")
        if grips:
            label = f"{GRIPPER_COMMAND}: "
            self._subscribe(GRIPPER_COMMAND, Float64, self._take_part, label=label)
            self.message_types[GRIPPER_COMMAND] = Float32
        self._declare_events()

    @abstractmethod
    def _step(
        self, pid: GazeboPidState, measured: Array, targets: Array, dt: float
    ) -> tuple[GazeboPidState, Array]:
        """Return the PIDs' state after a tick, and force or velocity of each tag.

        `measured`, `targets` shape (n,); `dt` [s].
        """

    def _update(
        self, now: UpdateContext, state: JointCommandState
    ) -> JointCommandState:
        state = self._receive(now, state)
        measured = self._measured_now(now)
        dt = now.period_ns / NANOSECONDS
        pid, values = self._step(state.pid, measured, state.targets, dt)
        command = self._forces.to_efforts(values)
        if self._moved_by.size:
            command = np.concatenate([command, values[self._moved_by]])
        return state._replace(pid=pid, command=command)

    def steady(
        self, last: UpdateResult[JointCommandState], time_ns: int
    ) -> "SteadyForces | None":
        """Return the forces that follow from targets that stay."""
        period_ns = self.whole_period_ns
        if self._moved_by.size or period_ns is None:
            return None
        period = period_ns / NANOSECONDS
        return SteadyForces(last.state, self._pid, self._forces, self._read_at, period)

    def remember(self, state: JointCommandState) -> list[float]:
        """Return what the PIDs remember, and the efforts, of which a state is made."""
        pid, command = state.pid, state.command
        return [*pid.i_term.tolist(), *pid.error_last.tolist(), *command.tolist()]

    def _take(
        self,
        tags: list[int],
        state: JointCommandState,
        message: Float64,
        time_ns: int,
    ) -> tuple[JointCommandState, str]:
        """Return the state with a target of tags."""
        if fault := find_number_fault(message):
            return state, fault
        targets = state.targets.copy()
        targets[tags] = message.data
        return state._replace(targets=targets), ""

    def _take_part(
        self, state: JointCommandState, message: Float64, time_ns: int
    ) -> tuple[JointCommandState, str]:
        """Return the state with how far a gripper is to close."""
        if fault := find_part_fault(message):
            return state, fault
        targets = state.targets.copy()
        targets[self._grips] = self._open + message.data * self._way
        return state._replace(targets=targets), ""

    def _activate(
        self, now: UpdateContext, state: JointCommandState
    ) -> JointCommandState:
        return state._replace(targets=self._start, pid=self._pid.initial())

    def _deactivate(
        self, now: UpdateContext, state: JointCommandState
    ) -> JointCommandState:
        return state._replace(command=self._at_rest)


class SteadyForces(SilentTicks):
    """Forces of n tags on k joints while their targets stay, in plain numbers.

    They remember integral terms and errors, n each, and the efforts. To the bit what
    `GazeboPid.step` and `JointForces.to_efforts` give, in a fifth of the time.
    """

    def __init__(
        self,
        state: JointCommandState,
        pid: GazeboPid,
        forces: JointForces,
        read_at: Any,
        dt: float,
    ) -> None:
        """Create them; `dt` is the period [s]."""
        self._state, self._read_at, self._dt = state, read_at, dt
        columns = (
            state.targets,
            pid.p,
            pid.i * dt,
            pid.d,
            pid.i_min,
            pid.i_max,
            pid.cmd_min,
            pid.cmd_max,
            pid.cmd_offset,
        )
        self._tags = list(zip(*(c.tolist() for c in columns), strict=True))
        self._places = forces.places()
        self._rest = [0.0] * len(forces.joints)

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> list[float] | None:
        """Return the efforts of a tick; None where an error isn't finite."""
        dt, n, total = self._dt, len(self._tags), 0.0
        terms, errors, forces = [], [], []
        measured = motions[self._read_at].tolist()
        for tag, q, term, last in zip(
            self._tags, measured, memory[:n], memory[n : 2 * n], strict=True
        ):
            target, p, i, d, i_min, i_max, low, high, offset = tag
            error = q - target
            rate = (error - last) / dt
            total += rate
            i_term = term + i * error
            if i_term < i_min:
                i_term = i_min
            if i_term > i_max:
                i_term = i_max
            force = offset - p * error - i_term - d * rate
            if force < low:
                force = low
            if force > high:
                force = high
            terms.append(i_term)
            errors.append(error)
            forces.append(force)
        if not math.isfinite(total):
            return None
        efforts = self._rest.copy()
        for at, limit, multiplier, joint in self._places:
            force = forces[at]
            if force < -limit:
                force = -limit
            if force > limit:
                force = limit
            efforts[joint] += multiplier * force
        memory[:] = terms + errors + efforts
        return efforts

    def state(
        self, time_ns: int, motions: Array, memory: Sequence[float]
    ) -> JointCommandState:
        """Return the state that a tick leaves behind."""
        n = len(self._tags)
        terms, errors, efforts = np.split(np.array(memory), [n, 2 * n])
        pid = GazeboPidState(terms, errors)
        return self._state._replace(pid=pid, command=efforts)


def _split(
    tags: Sequence[JointPositionControllerTag | JointControllerTag],
    by_force: Sequence[bool],
    followed: Mapping[str, tuple[str, float]],
) -> tuple[dict[str, int], dict[str, int]]:
    """Return which tags move joints by velocity, and which push joints, by joint."""
    tag_of = {joint: k for k, tag in enumerate(tags) for joint in tag.joint_names}
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
    return moved, pushed


class JointController(GazeboCommandBase):
    """Moves joints at velocities that come on topics.

    With n tags, J joints and k joints that carry forces or have velocities:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       one for each topic of the tags: Float64, the
                                       velocity [rad/s] or [m/s] from now on
    command_interfaces  --    --       UpdateResult; command (k,), in N·m, rad/s, ..
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a JointCommandState, renewed in every tick. A tag commands its target
    r, which is ``initial_velocity`` until a message comes; with ``use_force_commands``
    it commands a force instead, with the velocity v of its first joint::

        force = pid(v - r)                               GazeboPid.step

    With ``disable_braking`` a joint runs free that is faster than r, in r's direction,
    or whose r is 0: there is no force, and the PID stays as it is.

    All else is as in JointPositionController: several joints of a tag, effort limits,
    mimic joints, activations.
    """

    reads_by_now = True

    def __init__(
        self,
        tags: tuple[JointControllerTag, ...],
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._may_run_free = np.array([tag.disable_braking for tag in tags], dtype=bool)
        super().__init__(
            tags,
            params,
            topics=[velocity_topic(tag, params.robot_name) for tag in tags],
            targets=[tag.initial_velocity for tag in tags],
            by_force=[tag.use_force_commands for tag in tags],
            read=interfaces.VELOCITY,
        )

    def steady(
        self, last: UpdateResult[JointCommandState], time_ns: int
    ) -> SteadyForces | None:
        """Return the forces, unless some may be left out."""
        return None if self._may_run_free.any() else super().steady(last, time_ns)

    def _step(
        self, pid: GazeboPidState, measured: Array, targets: Array, dt: float
    ) -> tuple[GazeboPidState, Array]:
        if not self._by_force.any():
            return pid, targets
        error = measured - targets
        pushes = None
        if self._may_run_free.any():
            is_fast = (np.sign(targets) * error > 0.0) | (targets == 0.0)
            pushes = ~(self._may_run_free & is_fast)
        pid, force = self._pid.step(pid, error, dt, where=pushes)
        return pid, np.where(self._by_force, force, targets)


class JointPositionController(GazeboCommandBase):
    """Takes joints to positions that come on topics, by force or by velocity.

    With n tags, J joints and k joints that carry forces or have velocities:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       one for each topic of the tags: Float64, the
                                       position [rad] or [m] from now on
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       if a tag moves a gripper of which it is known
                                       what that is
    command_interfaces  --    --       UpdateResult; command (k,), in N·m, rad/s, ..
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a JointCommandState, renewed in every tick. Of each tag, with the
    position q of its first joint and the target r, which is ``initial_position`` until
    a message comes::

        error = q - r
        force = pid(error)                               GazeboPid.step
        velocity = clamp(-error / dt, ±cmd_max)          with use_velocity_commands

    All joints of a tag get the same. Gazebo steps the PID once more for each further
    joint, which multiplies its integral and leaves the derivative to the first one. It
    limits no velocity where the tag has no ``cmd_max``; here the default of 1000 does.

    The force at a joint is limited by the joint's effort limit. That at a mimic joint
    acts on its master, see JointForces; a tag for velocities leaves a mimic joint to
    its master. Of two tags with the same joint the last one moves it. An activation
    starts from the tags' initial values; when it ends, efforts and velocities are 0.
    """

    reads_by_now = True

    def __init__(
        self,
        tags: tuple[JointPositionControllerTag, ...],
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._cmd_max = np.array([tag.cmd_max for tag in tags])
        super().__init__(
            tags,
            params,
            topics=[position_topic(tag, params.robot_name) for tag in tags],
            targets=[tag.initial_position for tag in tags],
            by_force=[not tag.use_velocity_commands for tag in tags],
            read=interfaces.POSITION,
            grips=_find_grips(tags, params),
        )

    def _step(
        self, pid: GazeboPidState, measured: Array, targets: Array, dt: float
    ) -> tuple[GazeboPidState, Array]:
        error = measured - targets
        pid, values = self._pid.step(pid, error, dt)
        if self._moved_by.size:
            velocity = -error / dt
            limited = np.where(error < 0.0, self._cmd_max, -self._cmd_max)
            is_far = np.abs(error) > self._cmd_max * dt
            velocity = np.where(is_far, limited, velocity)
            values = np.where(self._by_force, values, velocity)
        return pid, values


def _find_grips(
    tags: tuple[JointPositionControllerTag, ...], params: ControllerInterfaceParams
) -> dict[int, tuple[float, float]]:
    """Return where a gripper is open and closed, by the tags that move its joints."""
    grips = {}
    for index, tag in enumerate(tags):
        joint = tag.joint_names[0]
        master, multiplier = params.followed.get(joint, (joint, 1.0))
        if master in params.gripper_ranges:
            is_open, is_closed = params.gripper_ranges[master]
            grips[index] = (multiplier * is_open, multiplier * is_closed)
    return grips
