"""The ``joint_state_broadcaster/JointStateBroadcaster`` and its parameters.

Source: ros2_controllers, `joint_state_broadcaster` (version 6.9.0, defaults of jazzy).
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from operator import itemgetter
from typing import Annotated

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.cycles import Cycle, last_cycle
from arm_drake.description.parameters import Rule
from arm_drake.errors import ParameterError
from arm_drake.importing import dataclass
from arm_drake.messages import (
    DynamicJointState,
    Header,
    InterfaceValue,
    JointState,
    Message,
)
from arm_drake.messages.base import make_lazy

Picker = Callable[[Sequence[float]], tuple[float, ...]]

# Types of the joints whose interfaces rolling looks for.
_JOINT_TYPES = ("continuous", "revolute", "prismatic")


@dataclass(frozen=True)
class InterfaceMap:
    """Names of the interfaces that are published as positions, velocities, efforts."""

    position: str = "position"
    velocity: str = "velocity"
    effort: str = "effort"


@dataclass(frozen=True)
class JointStateBroadcasterParameters:
    """Parameters of a JointStateBroadcaster."""

    # Joints and interfaces to publish; unless both are given, all that there are.
    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()

    # Names published with zeros besides.
    extra_joints: tuple[str, ...] = ()

    # What stands for a standard interface that isn't among `interfaces`.
    map_interface_to_joint_state: InterfaceMap = InterfaceMap()

    # Whether the topics' names start with the broadcaster's; a port's always does.
    use_local_topics: bool = False

    # Whether only joints of the description are published, if `joints` aren't given;
    # else whatever has such an interface.
    use_urdf_to_filter: bool = True

    # Whether dynamic_joint_states are published too.
    publish_dynamic_joint_states: Annotated[
        bool, Rule(rolling=False, until="kilted")
    ] = True

    # Frame of the message's header.
    frame_id: Annotated[str, Rule(rolling="base_link")] = ""


class JointStateBroadcaster(ControllerInterface):
    """Publishes the state of the joints.

    .. pydrake_system::

        name: JointStateBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - joint_states
        - dynamic_joint_states

    ====================  ====  ======  ============================================
    port                  size  unit    meaning
    ====================  ====  ======  ============================================
    controller_manager    --    --      Cycle: whether the broadcaster is active
    state_interfaces      m     rad,    everything that is measured, held since the
                                rad/s,  last tick
                                N·m
    joint_states          --    --      JointState of the last tick; NaN where a
                                        joint has no such interface
    dynamic_joint_states  --    --      DynamicJointState of the last tick: other
                                        interfaces too; only if the parameter
                                        ``publish_dynamic_joint_states`` is true
    ====================  ====  ======  ============================================

    The joints are published in the order of the parameter ``joints``, else by name.
    Unless it is given with ``interfaces``, rolling publishes what there is of the
    robot's joints; before, everything is read, sensors and GPIOs into the dynamic
    message alone. That one names mapped interfaces as in JointState, as upstream's.
    ``use_local_topics`` changes the names of topics alone, and no port.

    It has no state: what it publishes is sampled in its ticks before it gets there, and
    after the commands of the tick, so efforts are those that they cause. Inactive, and
    before the first tick, its messages are empty.

    Slower than the manager, it has a further input port, `tick_time`, with the time of
    its last tick [ns]; else it ticks in every cycle.
    """

    is_sampled = True

    def __init__(
        self,
        parameters: JointStateBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        fields = _map_interfaces(parameters)
        claims = _find_claims(parameters, params, fields)
        super().__init__(params, state_interfaces=claims)
        layout = _Layout(parameters, params, fields, claims)
        self._names, self._rows = layout.names, layout.rows
        self._components, self._values = layout.components, layout.values
        self._frame_id = parameters.frame_id
        self._declare_message("joint_states", JointState, self._make_joint_state)
        if parameters.publish_dynamic_joint_states:
            name = "dynamic_joint_states"
            self._declare_message(name, DynamicJointState, self._make_dynamic)

    def _declare_message(
        self, name: str, kind: type[Message], make: Callable[[int, Array], Message]
    ) -> None:
        """Declare a port of what is made of the time of a tick [ns] and of an array."""

        def calc(context: Context, output: AbstractValue) -> None:
            time_ns = self._last_tick(context) if self._is_active(context) else None
            if time_ns is None:
                output.set_value(kind())
                return
            output.set_value(make(time_ns, self._measured.Eval(context)))

        def look(root: Context) -> Callable[[Cycle], Message | None]:
            context = self.GetMyContextFromRoot(root)
            time_ns, measured = self._last_tick(context), self._measured.Eval(context)

            def tell(cycle: Cycle) -> Message | None:
                is_active = self.params.controller_name in cycle.active
                if time_ns is None or not is_active:
                    return None
                return make(time_ns, measured)

            return tell

        self._looks[name] = look
        self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(kind()),
            calc,
            # Time and input ports, for there is no state.
            prerequisites_of_calc={self.all_sources_ticket()},
        )

    def _make_joint_state(self, time_ns: int, measured: Array) -> JointState:
        header = Header.from_nanoseconds(time_ns, self._frame_id)
        values = _extend(measured)
        position, velocity, effort = self._rows
        fields = position(values), velocity(values), effort(values)
        return JointState(header, self._names, *fields)

    def _make_dynamic(self, time_ns: int, measured: Array) -> DynamicJointState:
        header = Header.from_nanoseconds(time_ns, self._frame_id)
        components, rows, values = self._components, self._values, _extend(measured)
        make = partial(_make_dynamic, header, components, rows, values)
        return make_lazy(DynamicJointState, make)

    def _last_tick(self, context: Context) -> int | None:
        """Return the time of the last tick [ns], or None before the first one."""
        for port in self._tick_times:
            time_ns = float(port.Eval(context)[0])
            return None if math.isnan(time_ns) else int(time_ns)
        cycle = last_cycle(context, self.params.period)
        return None if cycle < 0 else self._tick_time(cycle)


def _extend(measured: Array) -> list[float]:
    """Return what is measured; after it NaN and 0, for what isn't."""
    return [*measured.tolist(), math.nan, 0.0]


def _make_dynamic(
    header: Header,
    components: tuple[str, ...],
    rows: list[tuple[tuple[str, ...], Picker]],
    values: list[float],
) -> DynamicJointState:
    described = tuple(InterfaceValue(names, pick(values)) for names, pick in rows)
    return DynamicJointState(header, components, described)


class _Layout:
    """Indices of the messages' fields among the measured values."""

    def __init__(
        self,
        parameters: JointStateBroadcasterParameters,
        params: ControllerInterfaceParams,
        fields: dict[str, str],
        claims: tuple[str, ...],
    ) -> None:
        measured = {name: index for index, name in enumerate(params.measured)}
        nan, zero = len(measured), len(measured) + 1
        standard = interfaces.STATE_INTERFACES
        # Where the value of each interface of each component stands.
        places: dict[str, dict[str, int]] = {}
        for claim in claims:
            component, _, name = claim.rpartition("/")
            at = places.setdefault(component, {})
            if name in fields or fields.get(name, name) not in at:
                at[fields.get(name, name)] = measured.get(claim, nan)
        is_filtered = parameters.use_urdf_to_filter and not (
            parameters.joints and parameters.interfaces
        )
        names = [
            component
            for component, at in places.items()
            if not at.keys().isdisjoint(standard)
            and (component in params.joint_types or not is_filtered)
        ]
        for extra in parameters.extra_joints:
            if extra not in places:
                places[extra] = dict.fromkeys(standard, zero)
                names.append(extra)
        self.names = tuple(names)
        self.rows = [
            _picker([places[name].get(field, nan) for name in names])
            for field in standard
        ]
        self.components = tuple(places)
        self.values = [
            (tuple(at), _picker(list(at.values()))) for at in places.values()
        ]


def _picker(at: list[int]) -> Picker:
    """Return what picks values out of a sequence."""
    if not at:
        return lambda values: ()
    if len(at) == 1:
        return lambda values: (values[at[0]],)
    return itemgetter(*at)


def _map_interfaces(parameters: JointStateBroadcasterParameters) -> dict[str, str]:
    """Return in which field of JointState an interface is published, by its name."""
    both = bool(parameters.joints and parameters.interfaces)
    requested = parameters.interfaces if both else ()
    return {
        field
        if field in requested
        else getattr(parameters.map_interface_to_joint_state, field): field
        for field in interfaces.STATE_INTERFACES
    }


def _find_claims(
    parameters: JointStateBroadcasterParameters,
    params: ControllerInterfaceParams,
    fields: dict[str, str],
) -> tuple[str, ...]:
    """Return the interfaces to read."""
    available = params.state_interfaces
    if parameters.joints and parameters.interfaces:
        claims = interfaces.interface_names(parameters.joints, parameters.interfaces)
        for claim in claims:
            if claim not in available:
                raise ParameterError(
                    f"no state interface {claim}; it has {sorted(available)}"
                )
        return claims
    available = available - params.other_types
    joints = sorted(params.joint_types)
    if params.distro == "rolling":
        joints = [name for name in joints if params.joint_types[name] in _JOINT_TYPES]
        every = interfaces.interface_names(joints, fields)
        claims = tuple(claim for claim in every if claim in available)
    else:
        order = [name for name in params.measured if name in available]
        if parameters.use_urdf_to_filter:
            rank = {joint: index for index, joint in enumerate(joints)}
            order.sort(key=lambda n: rank.get(n.rpartition("/")[0], len(rank)))
        claims = tuple(order)
    if not claims:
        raise ParameterError("no state interface to publish; the hardware has none")
    return claims
