"""Gazebo's plugins that publish the state of joints.

Sources: gz-sim, src/systems/joint_state_publisher/JointStatePublisher.cc;
gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/gazebo_ros_joint_state_publisher.cpp.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiscreteValues

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.cycles import last_cycle
from arm_drake.controllers.gazebo.plugin import (
    is_early,
    joint_state_topic,
    ros_topic,
)
from arm_drake.description.gazebo_plugins import (
    GazeboRosJointStatePublisher as GazeboRosJointStatePublisherTag,
)
from arm_drake.description.gazebo_plugins import (
    JointStatePublisher as JointStatePublisherTag,
)
from arm_drake.messages import Header, JointState


class JointStatePublisher(ControllerInterface):
    """Publishes the state of joints in every tick, as Gazebo Sim does.

    .. pydrake_system::

        name: JointStatePublisher
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - /<topic>

    ==================  ====  ======  ==================================================
    port                size  unit    meaning
    ==================  ====  ======  ==================================================
    controller_manager  --    --      Cycle: whether the publisher is active
    state_interfaces    m     rad,    everything that is measured, held since the last
                              rad/s,  tick
                              N·m
    /<topic>            --    --      JointState of the last tick: positions, velocities
                                      and efforts
    ==================  ====  ======  ==================================================

    The joints are those of the tag, or all, in the order of the description. It has no
    state: what it publishes is sampled in the ticks before it gets there. Inactive, and
    before the first tick, its message is empty.
    """

    is_sampled = True

    def __init__(
        self, tag: JointStatePublisherTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        joints = params.joint_types
        self._joints = tuple(
            name for name in joints if name in tag.joint_names or not tag.joint_names
        )
        names = interfaces.interface_names(self._joints, interfaces.STATE_INTERFACES)
        super().__init__(params, state_interfaces=names)
        self.DeclareAbstractOutputPort(
            joint_state_topic(tag, params.robot_name, params.world_name),
            lambda: AbstractValue.Make(JointState()),
            self._calc_joint_state,
            # Time and input ports, for there is no state.
            prerequisites_of_calc={self.all_sources_ticket()},
        )

    def _calc_joint_state(self, context: Context, output: AbstractValue) -> None:
        cycle = last_cycle(context, self.params.period)
        message = JointState()
        if cycle >= 0 and self._is_active(context):
            values = self._read(context).tolist()
            message = _make_message(self._tick_time(cycle), self._joints, values)
        output.set_value(message)


class GazeboRosJointStatePublisher(ControllerInterface):
    """Publishes positions and velocities of joints at a rate, as Gazebo Classic does.

    .. pydrake_system::

        name: GazeboRosJointStatePublisher
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - /joint_states

    ==================  ====  ======  ==================================================
    port                size  unit    meaning
    ==================  ====  ======  ==================================================
    controller_manager  --    --      Cycle: the time, and whether the publisher is
                                      active
    state_interfaces    2J    rad,    positions and velocities of all joints, or more
                              rad/s
    /joint_states       --    --      JointState without efforts; by the name that
                                      namespace and remappings make
    ==================  ====  ======  ==================================================

    The joints are those of the tag, in its order. The first tick publishes, then each
    that is at least 1 / ``update_rate`` after the last that did; with a rate of 0 all
    do.

    The state is discrete: what was measured, and the time [ns]; NaN before the first
    tick and while inactive, when the message is empty. Drake updates it after what is
    unrestricted: the manager has run its cycle and tells of it.
    """

    def __init__(
        self,
        tag: GazeboRosJointStatePublisherTag,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._joints, self._rate = tag.joint_names, tag.update_rate
        standard = (interfaces.POSITION, interfaces.VELOCITY)
        names = interfaces.interface_names(self._joints, standard)
        super().__init__(params, state_interfaces=names)
        # Drake takes a plain number quicker than its own kind of index. A time is a
        # whole number, exact up to 2^53 ns, which is 104 days.
        self._time = int(self.DeclareDiscreteState([math.nan]))
        self._sample = int(self.DeclareDiscreteState(len(names)))
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._update_sample)
        self.DeclareAbstractOutputPort(
            ros_topic("joint_states", tag.namespace, tag.remappings),
            lambda: AbstractValue.Make(JointState()),
            self._calc_joint_states,
            prerequisites_of_calc={self.xd_ticket()},
        )

    def _update_sample(self, context: Context, state: DiscreteValues) -> None:
        if not self._is_active(context):
            state.set_value(self._time, [math.nan])
            return
        time_ns = self._time_ns(context)
        last_ns = float(context.get_discrete_state(self._time).value()[0])
        if is_early(time_ns - last_ns, self._rate):
            return
        state.set_value(self._time, [time_ns])
        state.set_value(self._sample, self._read(context))

    def _calc_joint_states(self, context: Context, output: AbstractValue) -> None:
        time_ns = float(context.get_discrete_state(self._time).value()[0])
        message = JointState()
        if not math.isnan(time_ns):
            values = context.get_discrete_state(self._sample).value()
            message = _make_message(
                int(time_ns), self._joints, np.asarray(values).tolist()
            )
        output.set_value(message)


def _make_message(
    time_ns: int, joints: tuple[str, ...], values: Sequence[float]
) -> JointState:
    """Return a message; `values` shape (2N,)."""
    n = len(joints)
    fields = [tuple(values[k : k + n]) for k in range(0, len(values), n)]
    return JointState(Header.from_nanoseconds(time_ns), joints, *fields)
