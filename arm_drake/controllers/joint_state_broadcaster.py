"""``joint_state_broadcaster/JointStateBroadcaster``.

Source: ros2_controllers, `joint_state_broadcaster` (version 6.9.0, defaults of jazzy).
"""

import dataclasses as dc
import math

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiscreteValues

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import Header, JointState, Time


@dc.dataclass(frozen=True)
class JointStateBroadcasterParameters:
    """Parameters of a JointStateBroadcaster."""

    # Joints and interfaces to publish; unless both are given, all that there are.
    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()

    # Names published with zeros besides.
    extra_joints: tuple[str, ...] = ()

    # Whether the topic is the broadcaster's own; without effect on a port's name.
    use_local_topics: bool = False

    # Whether only joints of the description are published; a simulator has no others.
    use_urdf_to_filter: bool = True

    # Whether dynamic_joint_states are published too; not modelled.
    publish_dynamic_joint_states: bool = True

    # Frame of the message's header.
    frame_id: str = ""


class JointStateBroadcaster(ControllerInterface):
    """Publishes the state of the joints.

    .. pydrake_system::

        name: JointStateBroadcaster
        input_ports:
        - state_interfaces
        output_ports:
        - joint_states

    ================  ====  ======  ================================================
    port              size  unit    meaning
    ================  ====  ======  ================================================
    state_interfaces  3J    rad,    measured positions, velocities and efforts of
                            rad/s,  all J joints of the robot; without efforts (2J)
                            N·m     if none is published
    joint_states      --    --      JointState of the last tick; NaN where a joint
                                    has no such interface
    ================  ====  ======  ================================================

    The joints are published in the order of the parameter ``joints``, else by name.
    The discrete state is the number of the last tick, -1 before the first one, and what
    was measured at that tick; efforts are those that the tick's commands cause.
    """

    def __init__(
        self,
        parameters: JointStateBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.

        Raises:
            ParameterError: If an interface is asked for that isn't there.
        """
        self._names, published = _published(parameters, params)
        super().__init__(params, state_interfaces=published)
        self._extra = tuple(
            name for name in parameters.extra_joints if name not in self._names
        )
        self._frame_id = parameters.frame_id
        row = {name: index for index, name in enumerate(published)}
        self._rows = [
            [row.get(f"{joint}/{interface}") for joint in self._names]
            for interface in interfaces.STATE_INTERFACES
        ]
        self.DeclareDiscreteState(np.concatenate([[-1.0], np.zeros(len(published))]))
        self.DeclarePeriodicDiscreteUpdateEvent(
            params.period, 0.0, self._update_measured
        )
        self.DeclareAbstractOutputPort(
            "joint_states",
            lambda: AbstractValue.Make(JointState()),
            self._calc_joint_states,
            prerequisites_of_calc={self.xd_ticket()},
        )

    def _update_measured(self, context: Context, state: DiscreteValues) -> None:
        new = np.concatenate(((self._tick_number(context),), self._read(context)))
        state.set_value(new)

    def _calc_joint_states(self, context: Context, output: AbstractValue) -> None:
        number, *values = context.get_discrete_state_vector().value().tolist()
        if number < 0.0:
            output.set_value(JointState())
            return
        time = Time.from_nanoseconds(self._tick_time(int(number)))
        zeros = (0.0,) * len(self._extra)
        fields = (
            tuple(math.nan if row is None else values[row] for row in rows) + zeros
            for rows in self._rows
        )
        header = Header(time, self._frame_id)
        output.set_value(JointState(header, self._names + self._extra, *fields))


def _published(
    parameters: JointStateBroadcasterParameters, params: ControllerInterfaceParams
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the joints and the interfaces to publish."""
    there = params.state_interfaces
    if parameters.joints and parameters.interfaces:
        names = parameters.joints
        published = interfaces.interface_names(names, parameters.interfaces)
        for name in published:
            if name not in there:
                raise ParameterError(
                    f"no state interface {name}; it has {sorted(there)}"
                )
        return names, published
    names = tuple(sorted(params.joint_types))
    published = tuple(
        name
        for name in interfaces.interface_names(names, interfaces.STATE_INTERFACES)
        if name in there
    )
    if not published:
        raise ParameterError("no state interface to publish; the hardware has none")
    reporting = {name.rpartition("/")[0] for name in published}
    return tuple(name for name in names if name in reporting), published
