"""The ``battery_state_broadcaster/BatteryStateBroadcaster`` and its parameters.

Source: ros2_controllers, `battery_state_broadcaster` (version 6.9.0).
"""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import SensorBroadcaster
from arm_drake.description.parameters import check_unique, check_within, per_element_of
from arm_drake.errors import ParameterError
from arm_drake.importing import dataclass
from arm_drake.messages import Header
from arm_drake.messages.sensors import BatteryState, BatteryStateArray, to_code


def are_known(limits: tuple[float, float]) -> bool:
    """Return whether voltages of an empty and a full battery are finite."""
    return all(map(math.isfinite, limits))


def measure(
    battery: BatteryState, measured: Mapping[str, float], limits: tuple[float, float]
) -> BatteryState:
    """Return the state of a battery after a measurement.

    `limits` [V], NaN is unknown.
    """
    voltage, percentage = measured["voltage"], measured.get("percentage", math.nan)
    if "percentage" not in measured and are_known(limits):
        low, high = limits
        percentage = (voltage - low) * 100.0 / (high - low)
    present = measured.get("present", voltage)
    return dc.replace(
        battery,
        voltage=voltage,
        temperature=measured.get("temperature", math.nan),
        current=measured.get("current", math.nan),
        charge=measured.get("charge", math.nan),
        percentage=percentage,
        power_supply_status=to_code(measured.get("power_supply_status", 0.0), 0),
        power_supply_health=to_code(measured.get("power_supply_health", 0.0), 0),
        present=present != 0.0 and not math.isnan(present),
    )


def combine(
    start: BatteryState,
    batteries: Sequence[BatteryState],
    having: Mapping[str, Sequence[int]],
) -> BatteryState:
    """Return the state of several batteries in one."""
    values: dict[str, Any] = {}
    for quantity, indices in having.items():
        if indices:
            total = sum(getattr(batteries[index], quantity) for index in indices)
            values[quantity] = total if quantity == "charge" else total / len(indices)
    for code in ("power_supply_status", "power_supply_health"):
        values[code] = max(getattr(battery, code) for battery in batteries)
    return dc.replace(start, **values)


# What is combined of those batteries that have it.
_COMBINED = ("voltage", "temperature", "current", "charge", "percentage")

# What is said before anything is measured.
_UNKNOWN = BatteryState(
    voltage=math.nan,
    temperature=math.nan,
    current=math.nan,
    charge=math.nan,
    percentage=math.nan,
    present=True,
)


@dataclass(frozen=True)
class BatteryInterfaces:
    """Quantities of a battery that are read besides its voltage."""

    battery_temperature: bool = False
    battery_current: bool = False
    battery_charge: bool = False
    battery_percentage: bool = False
    battery_power_supply_status: bool = False
    battery_power_supply_health: bool = False
    battery_present: bool = False


@dataclass(frozen=True)
class InterfacesByBattery:
    """Quantities by battery."""

    battery: dict[str, BatteryInterfaces] = per_element_of("batteries")


@dataclass(frozen=True)
class Battery:
    """Known data of a battery; NaN and "" are unknown."""

    # Voltages of an empty and of a full battery [V].
    minimum_voltage: float = math.nan
    maximum_voltage: float = math.nan

    # Last known and new capacity [A·h].
    capacity: float = math.nan
    design_capacity: float = math.nan

    # POWER_SUPPLY_TECHNOLOGY of sensor_msgs/BatteryState, 0 to 8.
    power_supply_technology: int = 0

    # Where it is, and its number.
    location: str = ""
    serial_number: str = ""

    def __post_init__(self) -> None:
        check_within(self, 0, 8, "power_supply_technology")

    @property
    def limits(self) -> tuple[float, float]:
        """Voltages of an empty and of a full battery [V]."""
        return self.minimum_voltage, self.maximum_voltage


@dataclass(frozen=True)
class BatteryStateBroadcasterParameters:
    """Parameters of a BatteryStateBroadcaster."""

    # Batteries to read, each once.
    batteries: tuple[str, ...] = ()

    interfaces: InterfacesByBattery = InterfacesByBattery()
    battery: dict[str, Battery] = per_element_of("batteries")

    # Older way: one sensor, of which the voltage is read, and what is known of it.
    sensor_name: str = ""
    design_capacity: float = math.nan
    power_supply_technology: int = 0

    def __post_init__(self) -> None:
        check_unique(self, "batteries")
        check_within(self, 0, 8, "power_supply_technology")
        if self.sensor_name and self.batteries:
            raise ValueError(
                f"expected either batteries or sensor_name, got {list(self.batteries)} "
                f"and {self.sensor_name!r}"
            )
        for name, known in self.battery.items():
            low, high = known.limits
            if low >= high and "percentage" not in self.quantities(name):
                raise ValueError(
                    f"{name}.minimum_voltage must be below maximum_voltage, "
                    f"got {low} and {high}"
                )

    def quantities(self, battery: str) -> tuple[str, ...]:
        """Return the quantities of a battery that are read, in their order."""
        switches = dc.asdict(self.interfaces.battery.get(battery, BatteryInterfaces()))
        read = (name.removeprefix("battery_") for name, on in switches.items() if on)
        return ("voltage", *read)


class BatteryStateBroadcasterState(NamedTuple):
    """Messages that a BatteryStateBroadcaster published last."""

    battery_state: BatteryState = BatteryState()
    raw_battery_states: BatteryStateArray = BatteryStateArray()


class BatteryStateBroadcaster(SensorBroadcaster[BatteryStateBroadcasterState]):
    """Publishes the states of batteries, one by one and as one.

    The state is a BatteryStateBroadcasterState. A percentage that isn't read is where
    the voltage stands between minimum and maximum; a battery that doesn't tell whether
    it is present is, unless its voltage is 0 or NaN. Of all batteries the voltage,
    temperature, current and percentage are means of those that have them, the charge
    and the capacities are sums, status and health the largest numbers, and the
    technology is that of all or 0. Locations and serial numbers are in a row, each
    followed by a comma.
    """

    message = BatteryStateBroadcasterState
    reads = (
        "``<battery>/battery_voltage`` of each battery and what ``interfaces`` "
        "switches on, or ``<sensor_name>/voltage``"
    )
    topics: ClassVar = {
        "battery_state": "BatteryState of all batteries in the last tick",
        "raw_battery_states": (
            "BatteryStateArray of them; without any if there is only a ``sensor_name``"
        ),
    }

    def __init__(
        self,
        parameters: BatteryStateBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._quantities = {n: parameters.quantities(n) for n in parameters.batteries}
        names = [f"{n}/battery_{q}" for n, own in self._quantities.items() for q in own]
        if parameters.sensor_name:
            names = [f"{parameters.sensor_name}/voltage"]
        if not names:
            raise ParameterError("batteries must have at least one element, got []")
        super().__init__(parameters, params, state_interfaces=tuple(names))
        self._known = [parameters.battery.get(n, Battery()) for n in self._quantities]
        self._having = {
            quantity: [
                index
                for index, own in enumerate(self._quantities.values())
                if quantity in own
                or (quantity == "percentage" and are_known(self._known[index].limits))
            ]
            for quantity in _COMBINED
        }
        self._at_start = self._make_initial(parameters)

    def _make_initial(
        self, parameters: BatteryStateBroadcasterParameters
    ) -> BatteryStateBroadcasterState:
        """Return what is published when the broadcaster is activated."""
        raw = tuple(
            dc.replace(
                _UNKNOWN,
                header=Header(frame_id=name),
                capacity=known.capacity,
                design_capacity=known.design_capacity,
                power_supply_technology=known.power_supply_technology,
                location=known.location,
                serial_number=known.serial_number,
            )
            for name, known in zip(self._quantities, self._known, strict=True)
        )
        technologies = {each.power_supply_technology for each in raw}
        technology = technologies.pop() if len(technologies) == 1 else 0
        design = sum((each.design_capacity for each in raw), 0.0)
        if parameters.sensor_name:
            technology = parameters.power_supply_technology
            design = parameters.design_capacity
        combined = dc.replace(
            _UNKNOWN,
            capacity=sum((each.capacity for each in raw), 0.0),
            design_capacity=design,
            power_supply_technology=technology,
            location="".join(f"{each.location}, " for each in raw),
            serial_number="".join(f"{each.serial_number}, " for each in raw),
        )
        return BatteryStateBroadcasterState(combined, BatteryStateArray(raw))

    def _activate(
        self, now: UpdateContext, state: BatteryStateBroadcasterState
    ) -> BatteryStateBroadcasterState:
        return self._at_start

    def _make(
        self, header: Header, values: Array, last: BatteryStateBroadcasterState
    ) -> BatteryStateBroadcasterState:
        numbers = values.tolist()
        combined, raw = self._at_start
        combined = dc.replace(combined, header=header)
        if not self._quantities:
            combined = dc.replace(combined, voltage=numbers[0])
            return BatteryStateBroadcasterState(combined, raw)
        batteries = []
        for battery, (name, quantities), known in zip(
            raw.battery_states, self._quantities.items(), self._known, strict=True
        ):
            measured = dict(zip(quantities, numbers, strict=False))
            del numbers[: len(quantities)]
            battery = dc.replace(battery, header=Header(header.stamp, name))
            batteries.append(measure(battery, measured, known.limits))
        return BatteryStateBroadcasterState(
            combine(combined, batteries, self._having),
            BatteryStateArray(tuple(batteries)),
        )
