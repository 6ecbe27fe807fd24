"""Gazebo's plugins that push single joints by a force, all of a robot's at once.

Source: gz-sim, src/systems/apply_joint_force/ApplyJointForce.cc.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.gazebo.plugin import (
    JointForces,
    find_number_fault,
    force_topic,
)
from arm_drake.controllers.topics import Inbox, TopicController
from arm_drake.description.gazebo_plugins import ApplyJointForce as ApplyJointForceTag
from arm_drake.messages import Float64


class JointForceState(NamedTuple):
    """State of an ApplyJointForce between two ticks, with n tags."""

    # Force of each tag [N·m] or [N], shape (n,).
    forces: Array

    # What to write, shape (k,).
    command: Array

    inbox: Inbox = Inbox()


class ApplyJointForce(TopicController[JointForceState]):
    """Pushes joints by the forces that come on topics.

    With n tags, J joints and k joints that carry forces; each has a topic of its own:

    =======================================  ====  =======  ============================
    port                                     size  unit     meaning
    =======================================  ====  =======  ============================
    controller_manager                       --    --       Cycle: when to tick
    state_interfaces                         2J    rad, ..  positions and velocities of
                                                            all joints, or more
    /model/<model>/joint/<joint>/cmd_force   --    --       Float64: the force [N·m] or
                                                            [N] from now on
    command_interfaces                       --    N·m, N   UpdateResult; command (k,)
    events                                   --    --       tuple of the latest (number,
                                                            TopicRejected), the newest
                                                            last
    =======================================  ====  =======  ============================

    The state is a JointForceState, renewed in every tick. Until a message comes there
    is no force; the last one acts for ever. It is limited by the joint's effort limit.
    That at a mimic joint acts on its master, see JointForces. Of two tags with the same
    joint the last one pushes it. A message whose number isn't finite is dropped.
    """

    def __init__(
        self,
        tags: tuple[ApplyJointForceTag, ...],
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        pushed = {tag.joint_names[0]: k for k, tag in enumerate(tags)}
        self._forces = JointForces.from_joints(
            pushed, params.followed, params.effort_limits
        )
        joints = self._forces.joints
        super().__init__(
            params,
            JointForceState(np.zeros(len(tags)), np.zeros(len(joints))),
            state_interfaces=(),
            command_interfaces=tuple(f"{joint}/effort" for joint in joints),
        )
        topics = [force_topic(tag, params.robot_name) for tag in tags]
        for name in dict.fromkeys(topics):
            at = [k for k, topic in enumerate(topics) if topic == name]
            self._subscribe(name, Float64, partial(self._take, at))
        self._declare_events()

    def _update(self, now: UpdateContext, state: JointForceState) -> JointForceState:
        state = self._receive(now, state)
        return state._replace(command=self._forces.to_efforts(state.forces))

    def _take(
        self,
        tags: list[int],
        state: JointForceState,
        message: Float64,
        time_ns: int,
    ) -> tuple[JointForceState, str]:
        """Return the state with a force of tags."""
        if fault := find_number_fault(message):
            return state, fault
        forces = state.forces.copy()
        forces[tags] = message.data
        return state._replace(forces=forces), ""

    def _activate(self, now: UpdateContext, state: JointForceState) -> JointForceState:
        return state._replace(forces=np.zeros(len(state.forces)))

    def _deactivate(
        self, now: UpdateContext, state: JointForceState
    ) -> JointForceState:
        return state._replace(command=np.zeros(len(state.command)))
