import dataclasses as dc
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.controllers.battery_state_broadcaster import (
    BatteryStateBroadcaster,
    BatteryStateBroadcasterParameters,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import Header, Time
from arm_drake.messages.sensors import BatteryState, BatteryStateArray
from tests import models
from tests.controllers.driving import Driven, make_params
from tests.controllers.parameters import BATTERY, load

# The parameters and measurements of upstream's test,
# battery_state_broadcaster/test/test_battery_state_broadcaster.cpp.
MEASURED = {
    "battery0/battery_voltage": 5.0,
    "battery0/battery_temperature": 60.0,
    "battery0/battery_charge": 6000.0,
    "battery0/battery_power_supply_status": 3.0,
    "battery0/battery_power_supply_health": 0.0,
    "battery1/battery_voltage": 10.0,
    "battery1/battery_temperature": 80.0,
    "battery1/battery_current": 2000.0,
    "battery1/battery_charge": 5000.0,
    "battery1/battery_percentage": 66.0,
    "battery1/battery_power_supply_status": 2.0,
    "battery1/battery_power_supply_health": 4.0,
}
TWO: Mapping[str, Any] = {
    "batteries": ["battery0", "battery1"],
    **{
        f"interfaces.{name.replace('/', '.')}": True
        for name in MEASURED
        if not name.endswith("voltage")
    },
    "battery0.minimum_voltage": 0.0,
    "battery0.maximum_voltage": 10.0,
    "battery0.capacity": 12000.0,
    "battery0.design_capacity": 13000.0,
    "battery0.power_supply_technology": 3,
    "battery0.location": "slot0",
    "battery0.serial_number": "serial_device_0",
    "battery1.minimum_voltage": 0.0,
    "battery1.maximum_voltage": 15.0,
    "battery1.capacity": 17000.0,
    "battery1.design_capacity": 18000.0,
    "battery1.power_supply_technology": 3,
    "battery1.location": "slot1",
    "battery1.serial_number": "serial_device_1",
}


def drive(values: Mapping[str, Any], measured: Mapping[str, float]) -> Driven:
    """Return a broadcaster of hardware that measures these values."""
    parameters = load(BATTERY, values)
    names = ("other", *measured)
    params = dc.replace(
        make_params(()), measured=names, state_interfaces=frozenset(names)
    )
    driven = Driven(BatteryStateBroadcaster(parameters, params))
    driven.measure([-99.0, *measured.values()])
    return driven


def publish(
    parameters: Mapping[str, Any], measured: Mapping[str, float]
) -> tuple[BatteryState, tuple[BatteryState, ...]]:
    """Return what the first tick publishes: all in one, and one by one."""
    driven = drive(parameters, measured)
    driven.run()
    raw: BatteryStateArray = driven.output("raw_battery_states")
    return driven.output("battery_state"), raw.battery_states


def one(measured: Mapping[str, float], **parameters: Any) -> tuple[BatteryState, ...]:
    """Return what a battery "a" publishes of its quantities: in one, and alone."""
    switches = {
        f"interfaces.a.battery_{name}": True for name in measured if name != "voltage"
    }
    known = {f"a.{name}": value for name, value in parameters.items()}
    combined, (raw,) = publish(
        {"batteries": ["a"], **switches, **known},
        {f"a/battery_{name}": value for name, value in measured.items()},
    )
    return combined, raw


def test_the_state_interfaces_are_in_upstreams_order() -> None:  # B23
    driven = drive(TWO, dict(reversed(MEASURED.items())))

    assert driven.system.state_interfaces == tuple(MEASURED)
    assert driven.system.command_interfaces == ()


def test_all_quantities_of_a_battery_are_read_in_order() -> None:
    quantities = (
        "voltage",
        "temperature",
        "current",
        "charge",
        "percentage",
        "power_supply_status",
        "power_supply_health",
        "present",
    )
    measured = {name: float(index) for index, name in enumerate(quantities)}

    _, raw = one(dict(reversed(measured.items())))

    assert tuple(getattr(raw, name) for name in quantities) == (*range(7), True)


def test_each_battery_is_published() -> None:  # B23
    _, (first, second) = publish(TWO, MEASURED)

    assert math.isnan(first.current)
    assert dc.replace(first, current=0.0) == BatteryState(
        header=Header(Time(), "battery0"),
        voltage=5.0,
        temperature=60.0,
        charge=6000.0,
        capacity=12000.0,
        design_capacity=13000.0,
        percentage=50.0,  # 5 V between 0 V and 10 V.
        power_supply_status=3,
        power_supply_health=0,
        power_supply_technology=3,
        present=True,
        location="slot0",
        serial_number="serial_device_0",
    )
    assert second == BatteryState(
        header=Header(Time(), "battery1"),
        voltage=10.0,
        temperature=80.0,
        current=2000.0,
        charge=5000.0,
        capacity=17000.0,
        design_capacity=18000.0,
        percentage=66.0,
        power_supply_status=2,
        power_supply_health=4,
        power_supply_technology=3,
        present=True,
        location="slot1",
        serial_number="serial_device_1",
    )


def test_the_batteries_in_one_are_means_and_sums() -> None:  # B23a, B23d
    combined, _ = publish(TWO, MEASURED)

    assert combined == BatteryState(
        voltage=7.5,
        temperature=70.0,
        current=2000.0,  # Of the only one that has it.
        charge=11000.0,
        capacity=29000.0,
        design_capacity=31000.0,
        percentage=58.0,
        power_supply_status=3,
        power_supply_health=4,
        power_supply_technology=3,
        present=True,
        # As upstream has it, with an end of its own.
        location="slot0, slot1, ",
        serial_number="serial_device_0, serial_device_1, ",
    )


def test_a_voltage_that_is_nan_makes_its_means_nan() -> None:
    nothing = {**MEASURED, "battery0/battery_voltage": math.nan}

    combined, (first, second) = publish(TWO, nothing)

    np.testing.assert_array_equal(
        [first.voltage, first.percentage, combined.voltage, combined.percentage],
        [math.nan] * 4,
    )
    assert (first.present, second.present, combined.present) == (False, True, True)
    assert second.percentage == 66.0


def test_the_percentage_is_the_mean_of_those_that_have_one() -> None:  # B23a
    parameters = {key: value for key, value in TWO.items() if "_voltage" not in key}

    combined, (first, _) = publish(parameters, MEASURED)

    assert math.isnan(first.percentage)
    assert combined.percentage == 66.0


def test_what_no_battery_has_is_nan() -> None:
    combined, raw = one({"voltage": 3.0})

    for message in (combined, raw):
        values = [message.temperature, message.current, message.charge]
        np.testing.assert_array_equal(
            [*values, message.percentage, message.capacity, message.design_capacity],
            [math.nan] * 6,
        )
        assert message.voltage == 3.0
        assert message.power_supply_status == message.power_supply_health == 0


@pytest.mark.parametrize(
    ("voltage", "percentage"), [(10.0, 0.0), (12.0, 40.0), (15.0, 100.0), (16.0, 120.0)]
)
def test_a_voltage_tells_the_percentage(voltage: float, percentage: float) -> None:
    _, raw = one({"voltage": voltage}, minimum_voltage=10.0, maximum_voltage=15.0)

    assert raw.percentage == percentage


@pytest.mark.parametrize(
    ("measured", "present"),
    [
        ({"voltage": 0.0}, False),
        ({"voltage": math.nan}, False),
        ({"voltage": -1.0}, True),
        ({"voltage": 0.0, "present": 1.0}, True),
        ({"voltage": 5.0, "present": 0.0}, False),
        ({"voltage": 5.0, "present": math.nan}, False),
    ],
)
def test_a_battery_is_present_as_it_says_or_with_a_voltage(
    measured: dict[str, float], present: bool
) -> None:
    combined, raw = one(measured)

    assert raw.present is present
    assert combined.present


def test_a_status_that_is_not_a_number_is_unknown() -> None:
    measured = {"voltage": 5.0, "power_supply_status": math.nan}

    _, raw = one(measured)

    assert raw.power_supply_status == 0


@pytest.mark.parametrize(("second", "technology"), [(3, 3), (2, 0)])
def test_technologies_that_differ_are_unknown(second: int, technology: int) -> None:
    combined, _ = publish({**TWO, "battery1.power_supply_technology": second}, MEASURED)

    assert combined.power_supply_technology == technology


def test_the_older_sensor_is_one_battery() -> None:  # B23b
    parameters = {
        "sensor_name": "battery_state",
        "design_capacity": 100.0,
        "power_supply_technology": 2,
    }
    driven = drive(parameters, {"battery_state/voltage": 12.5})

    assert driven.run().is_ok

    combined = driven.output("battery_state")
    assert driven.system.state_interfaces == ("battery_state/voltage",)
    assert combined.voltage == 12.5
    assert combined.design_capacity == 100.0
    assert combined.power_supply_technology == 2
    assert combined.present
    assert math.isnan(combined.percentage)
    assert driven.output("raw_battery_states") == BatteryStateArray()


def test_the_header_is_that_of_the_tick() -> None:
    driven = drive(TWO, MEASURED)

    driven.run()
    driven.run()

    # The second tick of 100 Hz.
    (first, _) = driven.output("raw_battery_states").battery_states
    assert driven.output("battery_state").header == Header(Time(0, 10_000_000))
    assert first.header == Header(Time(0, 10_000_000), "battery0")


def test_before_the_first_tick_there_are_default_messages() -> None:
    driven = drive(TWO, MEASURED)

    assert driven.output("battery_state") == BatteryState()
    assert driven.output("raw_battery_states") == BatteryStateArray()


def test_what_was_published_last_stays_when_it_is_inactive() -> None:
    driven = drive(TWO, MEASURED)
    driven.run()
    before = driven.output("battery_state")

    driven.measure([0.0] * (len(MEASURED) + 1))
    driven.run(activation=None)

    assert driven.output("battery_state") is before


def test_without_a_battery_it_is_never_active(tmp_path: Path) -> None:  # B23c
    yaml = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    power: {{type: {BATTERY}}}
"""
    row = ad.ControllerType(BatteryStateBroadcasterParameters, BatteryStateBroadcaster)
    robot = models.load(
        tmp_path, models.pendulum(), yaml, controller_types={BATTERY: row}
    )

    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.advance_to(0.05)

    states = {c.name: c.state for c in simulation.list_controllers()}
    assert states == {"power": "unconfigured"}
    (error,) = simulation.report.errors
    assert error.where == "power"
    assert error.what == "batteries must have at least one element, got []"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"batteries": ["a"], "sensor_name": "s"},
            "expected either batteries or sensor_name, got ['a'] and 's'",
        ),
        *(
            (
                {
                    "batteries": ["a"],
                    "a.minimum_voltage": low,
                    "a.maximum_voltage": 10.0,
                },
                f"a.minimum_voltage must be below maximum_voltage, got {low} and 10.0",
            )
            for low in (10.0, 11.0)
        ),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(
    parameters: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError) as error:
        load(BATTERY, parameters)

    # Where the message begins with a name, its line is known.
    line = ":2" if message.startswith("a.minimum_voltage") else ""
    assert str(error.value) == f"c.yaml{line}: c: {message}"


def test_limits_do_not_matter_where_the_percentage_is_read() -> None:
    _, raw = one(
        {"voltage": 5.0, "percentage": 7.0}, minimum_voltage=9.0, maximum_voltage=1.0
    )

    assert raw.percentage == 7.0
