"""States of batteries, one by one and as one.

The rules are those of ros2_controllers' `battery_state_broadcaster` (version 6.9.0).
"""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any

from arm_drake.messages.sensors import BatteryState, to_code


def are_known(limits: tuple[float, float]) -> bool:
    """Return whether voltages of an empty and a full battery tell how full it is."""
    return all(map(math.isfinite, limits))


def measure(
    battery: BatteryState, measured: Mapping[str, float], limits: tuple[float, float]
) -> BatteryState:
    """Return the state of a battery after a measurement.

    Args:
        battery: What doesn't change.
        measured: What is read of it, by quantity; at least its "voltage".
        limits: Voltages of an empty and of a full battery [V]; NaN is unknown.
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
    """Return the state of several batteries in one.

    Args:
        start: What doesn't change.
        batteries: Their states.
        having: Which of them have a quantity, counted from 0.
    """
    values: dict[str, Any] = {}
    for quantity, indices in having.items():
        if indices:
            total = sum(getattr(batteries[index], quantity) for index in indices)
            values[quantity] = total if quantity == "charge" else total / len(indices)
    for code in ("power_supply_status", "power_supply_health"):
        values[code] = max(getattr(battery, code) for battery in batteries)
    return dc.replace(start, **values)
