"""The ``force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster``.

Source: ros2_controllers, `force_torque_sensor_broadcaster` (version 6.9.0), and
filters, `filter_chain.hpp`.
"""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final, NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.filters import (
    ChainState,
    FilterChain,
    FilterState,
    LowPassFilter,
    find_unused,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import SteadyTicks, UpdateResult
from arm_drake.controllers.topics import SensorBroadcaster, SteadyBroadcast
from arm_drake.description.parameters import ParameterGroup, Rule, check_not_empty
from arm_drake.errors import ParameterError
from arm_drake.importing import dataclass
from arm_drake.interfaces import FORCES
from arm_drake.messages import Header, Vector3, Wrench, WrenchStamped

# Where the axes of a wrench stand in its parameters, in the order of its numbers.
_AXES: Final = tuple((part, axis) for part in ("force", "torque") for axis in "xyz")

# Group of the filters' parameters.
_CHAIN: Final = "sensor_filter_chain"

# The filter of wrenches there is, and its parameters.
_FILTER_TYPE: Final = "control_filters/LowPassFilterWrench"
_FILTER_PARAMETERS: Final = (
    "sampling_frequency",
    "damping_frequency",
    "damping_intensity",
)


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
    """What is added along x, y and z."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(frozen=True)
class Offset:
    """What is added to a measured wrench [N], [N·m]."""

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
        known = {_FILTER_TYPE: _FILTER_PARAMETERS}
        for name, why in find_unused(params.group(_CHAIN), known).items():
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
    """What a ForceTorqueSensorBroadcaster published last, and its filters."""

    wrench: WrenchStamped
    wrench_filtered: WrenchStamped
    filters: ChainState


class ForceTorqueSensorBroadcaster(
    SensorBroadcaster[ForceTorqueSensorBroadcasterState]
):
    """Publishes a wrench.

    The state is a ForceTorqueSensorBroadcasterState. Of each axis::

        wrench = (measured + offset) * multiplier

    Filters are applied one after the other, to each axis by itself; they go on where
    they were when the broadcaster is activated again.
    """

    reads_by_now = True
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
        self._filters = FilterChain(make_filters(parameters.sensor_filter_chain))
        names = _of_axes(parameters.interface_names)
        if parameters.sensor_name:
            names = [f"{parameters.sensor_name}/{name}" for name in FORCES]
        nothing = WrenchStamped()
        initial = self._filters.initial(len(_AXES))
        super().__init__(
            parameters,
            params,
            ForceTorqueSensorBroadcasterState(nothing, nothing, initial),
            state_interfaces=tuple(name for name in names if name),
            without=() if self._filters.filters else ("wrench_filtered",),
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
        return self._show(header, wrench, self._filters.update(last.filters, wrench))

    def _find_wrench(self, values: Array) -> Array:
        """Return a wrench, not filtered, shape (6,)."""
        wrench = np.full(len(_AXES), math.nan)
        wrench[self._at] = values
        wrench = (wrench + self._offset) * self._multiplier
        return wrench

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
        del time_ns
        wrench = self._system._find_wrench(self._values(motions))
        filters = self._system._filters.update(_to_state(memory), wrench)
        memory[:] = _to_numbers(filters)
        return ()

    def commands_ahead(self, times_ns: Sequence[int]) -> None:
        """Return None, for the wrench counts."""
        del times_ns
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


def make_filters(chain: Mapping[str, Any]) -> tuple[LowPassFilter, ...]:
    """Return the filters of a wrench, in their order."""
    filters: list[LowPassFilter] = []
    names: list[str] = []
    while True:
        prefix = f"filter{len(filters) + 1}"
        if f"{prefix}.name" not in chain and f"{prefix}.type" not in chain:
            return tuple(filters)
        name, kind = (_take(chain, f"{prefix}.{n}", str) for n in ("name", "type"))
        if name in names:
            raise _error(f"{prefix}.name", f"must not repeat a name, got {name!r}")
        if kind != _FILTER_TYPE:
            raise _error(f"{prefix}.type", f"expected {_FILTER_TYPE!r}, got {kind!r}")
        keys = [f"{prefix}.params.{n}" for n in _FILTER_PARAMETERS]
        values = [_take(chain, key, float) for key in keys]
        try:
            filters.append(LowPassFilter(*values))
        except ValueError as error:
            raise _error(f"{prefix}.params", str(error)) from None
        names.append(name)


def _take(chain: Mapping[str, Any], key: str, kind: type) -> Any:
    """Return a parameter of a filter that is a string or a float."""
    if key not in chain:
        raise _error(key, "is required but missing")
    value = chain[key]
    if kind is float and type(value) is int:
        return float(value)
    if not isinstance(value, kind):
        raise _error(key, f"expected {kind.__name__}, got {value!r}")
    return value


def _error(key: str, problem: str) -> ParameterError:
    return ParameterError(f"{_CHAIN}.{key}: {problem}")


def _of_axes(group: Any) -> list[Any]:
    """Return what a group has for x, y and z of force and torque."""
    return [getattr(getattr(group, part), axis) for part, axis in _AXES]
