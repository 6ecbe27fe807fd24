"""``battery_state_broadcaster/BatteryStateBroadcaster``.

Source: ros2_controllers, `battery_state_broadcaster` (version 6.9.0). Parameters only.
"""

import dataclasses as dc
import math

from arm_drake.controllers.validation import check_unique, check_within
from arm_drake.description.parameters import per_element_of


@dc.dataclass(frozen=True)
class BatteryInterfaces:
    """Which quantities of a battery are read, besides its voltage."""

    battery_temperature: bool = False
    battery_current: bool = False
    battery_charge: bool = False
    battery_percentage: bool = False
    battery_power_supply_status: bool = False
    battery_power_supply_health: bool = False
    battery_present: bool = False


@dc.dataclass(frozen=True)
class InterfacesByBattery:
    """Quantities by battery."""

    battery: dict[str, BatteryInterfaces] = per_element_of("batteries")


@dc.dataclass(frozen=True)
class Battery:
    """What is known of a battery; NaN and "" are unknown."""

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
        """Reject what the types alone can't express."""
        check_within(self, 0, 8, "power_supply_technology")


@dc.dataclass(frozen=True)
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
        """Reject what the types alone can't express."""
        check_unique(self, "batteries")
        check_within(self, 0, 8, "power_supply_technology")
