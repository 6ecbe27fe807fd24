"""``joint_state_broadcaster/JointStateBroadcaster``.

Source: ros2_controllers, `joint_state_broadcaster` (version 6.9.0, defaults of jazzy).
"""

import dataclasses as dc
import math
from typing import Annotated

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.description.parameters import Rule
from arm_drake.errors import ParameterError
from arm_drake.messages import Header, JointState, Time

# How far the time may be off a tick and still be the tick, in periods.
_TICK_TOLERANCE = 1e-6


@dc.dataclass(frozen=True)
class InterfaceMap:
    """Names of the interfaces that are published as positions, velocities, efforts."""

    position: Annotated[str, Rule(only="position")] = "position"
    velocity: Annotated[str, Rule(only="velocity")] = "velocity"
    effort: Annotated[str, Rule(only="effort")] = "effort"


@dc.dataclass(frozen=True)
class JointStateBroadcasterParameters:
    """Parameters of a JointStateBroadcaster."""

    # Joints and interfaces to publish; unless both are given, all that there are.
    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()

    # Names published with zeros besides.
    extra_joints: tuple[str, ...] = ()

    map_interface_to_joint_state: InterfaceMap = InterfaceMap()

    # Whether the topic is the broadcaster's own; without effect on a port's name.
    use_local_topics: bool = False

    # Whether only joints of the description are published; a simulator has no others.
    use_urdf_to_filter: bool = True

    # Whether dynamic_joint_states are published too.
    publish_dynamic_joint_states: Annotated[
        bool, Rule(rolling=False, until="kilted", only=False)
    ] = True

    # Frame of the message's header.
    frame_id: Annotated[str, Rule(rolling="base_link")] = ""


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
    state_interfaces  3J    rad,    positions, velocities and efforts of all J joints
                            rad/s,  of the robot, held since the last tick
                            N·m
    joint_states      --    --      JointState of the last tick; NaN where a joint
                                    has no such interface
    ================  ====  ======  ================================================

    The joints are published in the order of the parameter ``joints``, else by name.
    It has no state: what it publishes is sampled at its rate before it gets there, and
    after the commands of the tick, so efforts are those that they cause.
    """

    is_sampled = True

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
        self._at = [params.measured.index(name) for name in published]
        row = {name: index for index, name in enumerate(published)}
        self._rows = [
            [row.get(f"{joint}/{interface}") for joint in self._names]
            for interface in interfaces.STATE_INTERFACES
        ]
        self.DeclareAbstractOutputPort(
            "joint_states",
            lambda: AbstractValue.Make(JointState()),
            self._calc_joint_states,
            prerequisites_of_calc={self._measured.ticket(), self.time_ticket()},
        )

    def _calc_joint_states(self, context: Context, output: AbstractValue) -> None:
        # The tick of this very instant, if it is one, hasn't run.
        ticks = context.get_time() / self.params.period
        last = math.ceil(ticks - _TICK_TOLERANCE) - 1
        if last < 0:
            output.set_value(JointState())
            return
        time = Time.from_nanoseconds(self._tick_time(last))
        measured = self._measured.Eval(context).tolist()
        values = [measured[at] for at in self._at]
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
        # Others are for dynamic_joint_states.
        return names, tuple(name for name in published if name in params.measured)
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
