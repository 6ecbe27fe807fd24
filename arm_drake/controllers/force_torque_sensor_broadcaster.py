"""The ``force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster``.

Sources: ros2_controllers, `force_torque_sensor_broadcaster` (version 6.9.0); filters,
`filter_chain.hpp`; control_toolbox, `gravity_compensation.cpp` (version 6.0.0).
"""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final, NamedTuple

import numpy as np

from arm_drake.arrays import Array, cross
from arm_drake.control.admittance import ChainKinematics
from arm_drake.control.filters import (
    ChainState,
    ExponentialFilter,
    FilterChain,
    FilterState,
    LowPassFilter,
    SmoothingFilter,
    find_unused,
    parameters_of,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import SteadyTicks, UpdateResult
from arm_drake.controllers.topics import SensorBroadcaster, SteadyBroadcast
from arm_drake.description.parameters import ParameterGroup, Rule, check_not_empty
from arm_drake.errors import ParameterError, suggest
from arm_drake.importing import dataclass
from arm_drake.interfaces import FORCES
from arm_drake.messages import Header, Vector3, Wrench, WrenchStamped

# Where the axes of a wrench stand in its parameters, in the order of its numbers.
_AXES: Final = tuple((part, axis) for part in ("force", "torque") for axis in "xyz")

# Group of the filters' parameters.
_CHAIN: Final = "sensor_filter_chain"

# Filters of wrenches, and their parameters.
_SMOOTHING: Final[Mapping[str, type[SmoothingFilter]]] = {
    "control_filters/LowPassFilterWrench": LowPassFilter,
    "control_filters/ExponentialFilterWrench": ExponentialFilter,
}
_GRAVITY: Final = "control_filters/GravityCompensationWrench"
_FILTERS: Final = {
    **{name: parameters_of(kind) for name, kind in _SMOOTHING.items()},
    _GRAVITY: (
        "world_frame",
        "sensor_frame",
        "tool.mass",
        "tool.CoG",
        "tool.gravity_field",
    ),
}

# Gravity where none is given [m/s^2].
_GRAVITY_FIELD: Final = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class AxisNames:
    """Full names of the interfaces along x, y and z; "" is none."""

    x: str = ""
    y: str = ""
    z: str = ""


@dataclass(frozen=True)
class InterfaceNames:
    """Full names of the interfaces of a wrench."""

    force: AxisNames = AxisNames()
    torque: AxisNames = AxisNames()


@dataclass(frozen=True)
class AxisOffsets:
    """Offsets along x, y and z."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(frozen=True)
class Offset:
    """Offset added to a measured wrench [N], [N·m]."""

    force: AxisOffsets = AxisOffsets()
    torque: AxisOffsets = AxisOffsets()


@dataclass(frozen=True)
class AxisMultipliers:
    """Factors along x, y and z."""

    x: float = 1.0
    y: float = 1.0
    z: float = 1.0


@dataclass(frozen=True)
class Multiplier:
    """Factors of a wrench after its offset."""

    force: AxisMultipliers = AxisMultipliers()
    torque: AxisMultipliers = AxisMultipliers()


@dataclass(frozen=True)
class ForceTorqueSensorBroadcasterParameters:
    """Parameters of a ForceTorqueSensorBroadcaster."""

    # Frame of the message's header.
    frame_id: str

    # Sensor to read, or else the interfaces.
    sensor_name: str = ""
    interface_names: InterfaceNames = InterfaceNames()

    offset: Annotated[Offset, Rule(since="jazzy")] = Offset()
    multiplier: Annotated[Multiplier, Rule(since="jazzy")] = Multiplier()

    # Parameters of filters by name, such as "filter1.type".
    sensor_filter_chain: Annotated[dict[str, Any], Rule(since="jazzy")] = dc.field(
        default_factory=dict
    )

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Report what belongs to no filter."""
        if params.is_before("jazzy"):
            return
        for name, why in find_unused(params.group(_CHAIN), _FILTERS).items():
            what = f"{_CHAIN}.{name}"
            params.add(what, "warning", "ignored", why, "it has no effect")

    def __post_init__(self) -> None:
        check_not_empty(self, "frame_id")
        has_names = self.interface_names != InterfaceNames()
        if bool(self.sensor_name) == has_names:
            got = "both" if has_names else "neither"
            raise ValueError(
                f"expected either sensor_name or interface_names, got {got}"
            )


class ForceTorqueSensorBroadcasterState(NamedTuple):
    """Messages that a ForceTorqueSensorBroadcaster published last, and its filters."""

    wrench: WrenchStamped
    wrench_filtered: WrenchStamped
    filters: ChainState


class ForceTorqueSensorBroadcaster(
    SensorBroadcaster[ForceTorqueSensorBroadcasterState]
):
    """Publishes a wrench.

    The state is a ForceTorqueSensorBroadcasterState. Of each axis::

        wrench = (measured + offset) * multiplier

    Filters are applied one after the other; they go on where they were when the
    broadcaster is activated again. `GravityCompensationWrench` knows from the measured
    positions of joints how the sensor stands.
    """

    reads = (
        "``force.{x,y,z}`` [N] and ``torque.{x,y,z}`` [N·m] of ``<sensor_name>``, or "
        "``interface_names``"
    )
    exports = (
        "(k,): the wrench of the last tick, as ``<name>/`` and the name of what is "
        "read; not in humble"
    )
    topics: ClassVar = {
        "wrench": "WrenchStamped of the last tick; NaN along axes without an interface",
        "wrench_filtered": (
            "the same, filtered; there only with a ``sensor_filter_chain``"
        ),
    }

    def __init__(
        self,
        parameters: ForceTorqueSensorBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        chain = make_filters(parameters.sensor_filter_chain)
        filters, joints = _place(chain, parameters.frame_id, params)
        self._filters = filters
        names = _of_axes(parameters.interface_names)
        if parameters.sensor_name:
            names = [f"{parameters.sensor_name}/{name}" for name in FORCES]
        nothing = WrenchStamped()
        states = tuple(FilterState.initial(len(_AXES)) for _ in filters)
        initial = ChainState(states, np.full(len(_AXES), np.nan))
        super().__init__(
            parameters,
            params,
            ForceTorqueSensorBroadcasterState(nothing, nothing, initial),
            state_interfaces=tuple(name for name in names if name),
            positions_of=joints,
            without=() if filters else ("wrench_filtered",),
        )
        # Where what is read stands in the wrench.
        self._at = [index for index, name in enumerate(names) if name]
        self._offset = np.array(_of_axes(parameters.offset))
        self._multiplier = np.array(_of_axes(parameters.multiplier))
        self.num_remembered = len(_to_numbers(initial))

    def _make(
        self, header: Header, values: Array, last: ForceTorqueSensorBroadcasterState
    ) -> ForceTorqueSensorBroadcasterState:
        wrench = self._find_wrench(values)
        return self._show(header, wrench, self._filter(last.filters, wrench, values))

    def _find_wrench(self, values: Array) -> Array:
        """Return a wrench, not filtered, shape (6,)."""
        wrench = np.full(len(_AXES), math.nan)
        wrench[self._at] = values[: len(self._at)]
        wrench = (wrench + self._offset) * self._multiplier
        return wrench

    def _filter(self, last: ChainState, wrench: Array, values: Array) -> ChainState:
        """Return what the filters remember after a wrench, shape (6,)."""
        q = values[len(self._at) :]
        filters = tuple(
            each.at(q) if isinstance(each, GravityCompensation) else each
            for each in self._filters
        )
        return FilterChain(filters).update(last, wrench)

    def _show(
        self, header: Header, wrench: Array, filters: ChainState
    ) -> ForceTorqueSensorBroadcasterState:
        return ForceTorqueSensorBroadcasterState(
            WrenchStamped(header, make_wrench(wrench)),
            WrenchStamped(header, make_wrench(filters.output)),
            filters,
        )

    def steady(
        self, last: UpdateResult[ForceTorqueSensorBroadcasterState], time_ns: int
    ) -> SteadyTicks[ForceTorqueSensorBroadcasterState] | None:
        """Return ticks that remember what the filters do."""
        if not self.num_remembered:
            return super().steady(last, time_ns)
        return _SteadyFilters(self, last.state)

    def remember(self, state: ForceTorqueSensorBroadcasterState) -> list[float]:
        """Return what filters remember."""
        return _to_numbers(state.filters)

    def _export(self, state: ForceTorqueSensorBroadcasterState) -> Array:
        return np.array(_of_axes(state.wrench.wrench))[self._at]


class _SteadyFilters(SteadyBroadcast[ForceTorqueSensorBroadcasterState]):
    """Steady ticks with filters."""

    _system: ForceTorqueSensorBroadcaster

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> Sequence[float]:
        """Return no values; the wrench goes through the filters."""
        system, values = self._system, self._values(motions)
        wrench = system._find_wrench(values)
        memory[:] = _to_numbers(system._filter(_to_state(memory), wrench, values))
        return ()

    def commands_ahead(self, times_ns: Sequence[int]) -> None:
        """Return None, for the wrench counts."""
        return None

    def state(
        self, time_ns: int, motions: Array, memory: Sequence[float]
    ) -> ForceTorqueSensorBroadcasterState:
        """Return what a tick publishes."""
        system = self._system
        wrench = system._find_wrench(self._values(motions))
        return system._show(system._header(time_ns), wrench, _to_state(memory))


def _to_numbers(filters: ChainState) -> list[float]:
    """Return what filters of a wrench remember, one after the other."""
    return [
        number for state in filters.states for row in state for number in row.tolist()
    ]


def _to_state(numbers: Sequence[float]) -> ChainState:
    """Return what at least one filter remembers, of its numbers."""
    rows = np.reshape(numbers, (-1, 2, len(_AXES)))
    states = tuple(FilterState(*pair) for pair in rows)
    return ChainState(states, states[-1].output)


def make_wrench(values: Array) -> Wrench:
    """Return a wrench of its force and torque along x, y and z, shape (6,)."""
    numbers = values.tolist()
    return Wrench(Vector3(*numbers[:3]), Vector3(*numbers[3:]))


class ToolWeight(NamedTuple):
    """Parameters of the gravity compensation of a tool."""

    # Frame in which gravity is given, and that in which the center of gravity is.
    world_frame: str
    sensor_frame: str

    # Weight [N] and center of gravity [m], each of shape (3,).
    weight: Array
    center_of_gravity: Array


class WrenchDifference(NamedTuple):
    """Takes a wrench off another, both of shape (6,)."""

    wrench: Array

    def initial(self, n: int) -> FilterState:
        """Return the state of n channels before the first sample."""
        return FilterState.initial(n)

    def update(self, state: FilterState, sample: Array) -> FilterState:
        """Return the state after a sample; it holds the output."""
        return FilterState(sample, sample - self.wrench)


class GravityCompensation(NamedTuple):
    """Takes the weight of a tool off a wrench in a frame F of the robot.

    With S the sensor's frame, seen from the frame W in which gravity is given, c the
    tool's center of gravity and f its weight::

        force -= R_FW f,  torque -= R_FW ((p_WS + R_WS c - p_WF) x f)
    """

    tool: ToolWeight
    frame: str

    # Seen from the tool's world_frame.
    kinematics: ChainKinematics

    def at(self, q: Array) -> WrenchDifference:
        """Return what takes off the weight at joint positions [rad] or [m]."""
        X_WS = self.kinematics.pose(q, self.tool.sensor_frame)
        X_WF = self.kinematics.pose(q, self.frame)
        f = self.tool.weight
        arm = X_WS[:3, :3] @ self.tool.center_of_gravity + X_WS[:3, 3] - X_WF[:3, 3]
        R_FW = X_WF[:3, :3].T
        return WrenchDifference(np.concatenate([R_FW @ f, R_FW @ cross(arm, f)]))


def _place(
    filters: Sequence[SmoothingFilter | ToolWeight],
    frame: str,
    params: ControllerInterfaceParams,
) -> tuple[tuple[SmoothingFilter | GravityCompensation, ...], tuple[str, ...]]:
    """Return filters that know where the robot's frames are.

    Also the joints whose positions they need, in the order of `GravityCompensation.at`.
    """
    joints: dict[str, None] = {}
    for number, each in enumerate(filters, start=1):
        if isinstance(each, ToolWeight):
            prefix = f"{_CHAIN}.filter{number}.params."
            for key, link in (
                (f"{prefix}world_frame", each.world_frame),
                (f"{prefix}sensor_frame", each.sensor_frame),
                ("frame_id", frame),
            ):
                if link not in params.links:
                    what = f"the robot has no link {link!r}"
                    raise ParameterError(
                        f"{key}: {what}; {suggest(link, params.links)}"
                    )
            chain = _make_kinematics(each, (), params)
            for joint in (*chain.joints_to(each.sensor_frame), *chain.joints_to(frame)):
                if f"{joint}/position" not in params.state_interfaces:
                    raise ParameterError(
                        f"{prefix[:-1]}: joint {joint!r} moves these frames, "
                        "but has no state interface 'position'"
                    )
                joints[joint] = None
    names = tuple(joints)
    placed = (
        GravityCompensation(each, frame, _make_kinematics(each, names, params))
        if isinstance(each, ToolWeight)
        else each
        for each in filters
    )
    return tuple(placed), names


def _make_kinematics(
    tool: ToolWeight, joints: tuple[str, ...], params: ControllerInterfaceParams
) -> ChainKinematics:
    """Return the kinematics of joints, seen from a tool's `world_frame`."""
    if params.make_kinematics is None:
        raise ParameterError(f"{_CHAIN}: nothing is known of the robot's kinematics")
    return params.make_kinematics(joints, tool.world_frame)


def make_filters(chain: Mapping[str, Any]) -> tuple[SmoothingFilter | ToolWeight, ...]:
    """Return the filters of a wrench, in their order."""
    filters: list[SmoothingFilter | ToolWeight] = []
    names: list[str] = []
    while True:
        prefix = f"filter{len(filters) + 1}"
        if f"{prefix}.name" not in chain and f"{prefix}.type" not in chain:
            return tuple(filters)
        name, kind = (_take(chain, f"{prefix}.{n}", str) for n in ("name", "type"))
        if name in names:
            raise _error(f"{prefix}.name", f"must not repeat a name, got {name!r}")
        if kind in _SMOOTHING:
            filters.append(_make_smoothing(chain, kind, f"{prefix}.params"))
        elif kind == _GRAVITY:
            filters.append(_make_tool_weight(chain, f"{prefix}.params"))
        else:
            what = f"no filter of wrenches {kind!r}; {suggest(kind, _FILTERS)}"
            raise _error(f"{prefix}.type", what)
        names.append(name)


def _make_smoothing(
    chain: Mapping[str, Any], kind: str, prefix: str
) -> SmoothingFilter:
    values = [_take(chain, f"{prefix}.{n}", float) for n in _FILTERS[kind]]
    try:
        return _SMOOTHING[kind](*values)
    except ValueError as error:
        raise _error(prefix, str(error)) from None


def _make_tool_weight(chain: Mapping[str, Any], prefix: str) -> ToolWeight:
    frames = (f"{prefix}.{name}" for name in ("world_frame", "sensor_frame"))
    world, sensor = (_take(chain, key, str) for key in frames)
    mass: float = _take(chain, f"{prefix}.tool.mass", float)
    center = _take_vector(chain, f"{prefix}.tool.CoG")
    key = f"{prefix}.tool.gravity_field"
    field = _take_vector({key: _GRAVITY_FIELD, **chain}, key)
    return ToolWeight(world, sensor, mass * field, center)


def _take_vector(chain: Mapping[str, Any], key: str) -> Array:
    """Return a parameter of a filter that is three numbers."""
    values = _take(chain, key, list | tuple)
    if len(values) != 3 or not all(type(each) in (int, float) for each in values):
        raise _error(key, f"expected 3 floats, got {list(values)}")
    return np.array(values, dtype=float)


def _take(chain: Mapping[str, Any], key: str, kind: Any) -> Any:
    """Return a parameter of a filter that is a string, a float or a list."""
    if key not in chain:
        raise _error(key, "is required but missing")
    value = chain[key]
    if kind is float and type(value) is int:
        return float(value)
    if not isinstance(value, kind):
        expected = getattr(kind, "__name__", "list of float")
        raise _error(key, f"expected {expected}, got {value!r}")
    return value


def _error(key: str, problem: str) -> ParameterError:
    return ParameterError(f"{_CHAIN}.{key}: {problem}")


def _of_axes(group: Any) -> list[Any]:
    """Return what a group has for x, y and z of force and torque."""
    return [getattr(getattr(group, part), axis) for part, axis in _AXES]
