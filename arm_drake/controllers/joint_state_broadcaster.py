"""``joint_state_broadcaster/JointStateBroadcaster``.

Source: ros2_controllers, `joint_state_broadcaster` (version 6.9.0, defaults of jazzy).
"""

import dataclasses as dc
import math

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import Header, JointState, Message, Time


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


@dc.dataclass(frozen=True, eq=False)
class _Measured(Message):
    """What was measured at a tick, by interface."""

    time_ns: int = 0
    values: tuple[np.ndarray, ...] = ()


class JointStateBroadcaster(ControllerInterface[_Measured]):
    """Publishes the state of the joints.

    .. pydrake_system::

        name: JointStateBroadcaster
        input_ports:
        - position_state
        - velocity_state
        - effort_state
        output_ports:
        - joint_states

    ==============  ====  =====  ====================================================
    port            size  unit   meaning
    ==============  ====  =====  ====================================================
    position_state  k     rad    measured positions of the joints that report them
    velocity_state  k     rad/s  measured velocities
    effort_state    k     N·m    measured efforts
    joint_states    --    --     JointState of the last tick; NaN where a joint has
                                 no such interface
    ==============  ====  =====  ====================================================

    An input port is there if a joint has the interface. The joints are published in
    the order of the parameter ``joints``, else by name. The state is what was measured
    at the last tick.
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
        super().__init__(params)
        self._names, joints = _published(parameters, params)
        self._extra = tuple(
            name for name in parameters.extra_joints if name not in self._names
        )
        self._frame_id = parameters.frame_id
        self._inputs = tuple(self._declare_state_ports(joints).items())
        self._rows = {
            interface: [names.index(n) if n in names else None for n in self._names]
            for interface, names in joints.items()
        }
        tick = self._declare_tick(_Measured())
        self.DeclareAbstractOutputPort(
            "joint_states",
            lambda: AbstractValue.Make(JointState()),
            self._calc_joint_states,
            prerequisites_of_calc=tick,
        )

    def _tick(
        self, context: Context, state: _Measured, time_ns: int, period_ns: int
    ) -> _Measured:
        del state, period_ns
        values = tuple(port.Eval(context) for _, port in self._inputs)
        return _Measured(time_ns, values)

    def _calc_joint_states(self, context: Context, output: AbstractValue) -> None:
        measured = self._state_after(context)
        if not measured.values:
            output.set_value(JointState())
            return
        fields = {
            interface: tuple(
                math.nan if row is None else float(values[row])
                for row in self._rows[interface]
            )
            for (interface, _), values in zip(
                self._inputs, measured.values, strict=True
            )
        }
        nothing = (math.nan,) * len(self._names)
        zeros = (0.0,) * len(self._extra)
        output.set_value(
            JointState(
                Header(Time.from_nanoseconds(measured.time_ns), self._frame_id),
                self._names + self._extra,
                *(
                    fields.get(interface, nothing) + zeros
                    for interface in interfaces.STATE_INTERFACES
                ),
            )
        )


def _published(
    parameters: JointStateBroadcasterParameters, params: ControllerInterfaceParams
) -> tuple[tuple[str, ...], dict[str, tuple[str, ...]]]:
    """Return the joints to publish, and those that have each interface."""
    there = params.state_interfaces
    if parameters.joints and parameters.interfaces:
        for joint in parameters.joints:
            for interface in parameters.interfaces:
                if f"{joint}/{interface}" not in there:
                    raise ParameterError(
                        f"no state interface {joint}/{interface}; "
                        f"it has {sorted(there)}"
                    )
        names, chosen = parameters.joints, parameters.interfaces
    else:
        names = tuple(sorted(params.joint_types))
        chosen = interfaces.STATE_INTERFACES
    joints = {
        interface: tuple(name for name in names if f"{name}/{interface}" in there)
        for interface in interfaces.STATE_INTERFACES
        if interface in chosen
    }
    published = {name for group in joints.values() for name in group}
    if not published:
        raise ParameterError("no state interface to publish; the hardware has none")
    return (
        tuple(name for name in names if name in published),
        {interface: group for interface, group in joints.items() if group},
    )
