"""The safety state: numbers of upstream's own tests."""

import dataclasses as dc
import math

import pytest

from arm_drake.controllers.sensor_broadcasters import (
    Vda5050SafetyStateBroadcaster,
    Vda5050SafetyStateBroadcasterParameters,
)
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
from arm_drake.messages.sensors import VDA5050SafetyState
from tests.controllers.driving import Driven, make_params
from tests.controllers.parameters import SAFETY, flat, load

READ = {
    "plc1/field": 0.0,
    "plc2/field": 1.0,
    "plc1/manual": 0.0,
    "plc2/manual": 0.0,
    "plc1/remote": 0.0,
    "plc2/remote": 1.0,
    "plc1/autoack": 1.0,
}
GIVEN = {
    "interfaces.field_violation": ["plc1/field", "plc2/field"],
    "interfaces.e_stop.manual": ["plc1/manual", "plc2/manual"],
    "interfaces.e_stop.remote": ["plc1/remote", "plc2/remote"],
    "interfaces.e_stop.autoack": ["plc1/autoack"],
}
TOPIC = "vda5050_safety_state"


def drive() -> Driven:
    params = dc.replace(
        make_params(()), measured=tuple(READ), state_interfaces=frozenset(READ)
    )
    return Driven(Vda5050SafetyStateBroadcaster(load(SAFETY, GIVEN), params))


def test_it_reads_its_interfaces_in_the_order_of_their_kinds() -> None:
    system = drive().system

    assert system.state_interfaces == tuple(READ)
    assert system.command_interfaces == ()


@pytest.mark.parametrize(
    ("changes", "e_stop", "field_violation"),
    [
        ({}, "remote", True),
        ({"plc2/field": 0.0, "plc1/manual": 1.0}, "manual", False),
        ({"plc2/field": math.nan, "plc2/remote": math.nan}, "autoAck", False),
        ({"plc2/remote": 0.0, "plc1/autoack": 0.0}, "none", True),
    ],
)
def test_the_first_stop_in_order_is_reported(
    changes: dict[str, float], e_stop: str, field_violation: bool
) -> None:
    driven = drive()

    driven.measure(list({**READ, **changes}.values()))
    driven.run()

    assert driven.output(TOPIC) == VDA5050SafetyState(e_stop, field_violation)


def test_before_the_first_tick_nothing_is_reported() -> None:
    assert drive().output(TOPIC) == VDA5050SafetyState("none", field_violation=False)


def test_without_an_interface_there_is_nothing_to_tell() -> None:
    with pytest.raises(ParameterError, match="interfaces must name at least one"):
        load(SAFETY, {"interfaces.field_violation": []})
    with pytest.raises(ValueError, match="got none"):
        Vda5050SafetyStateBroadcasterParameters()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("fieldViolation_interfaces", "interfaces.field_violation"),
        ("interfaces.fieldViolation", "interfaces.field_violation"),
        ("eStop_autoack_interfaces", "interfaces.e_stop.autoack"),
        ("interfaces.eStop.manual", "interfaces.e_stop.manual"),
    ],
)
def test_names_of_before_are_taken(old: str, new: str) -> None:
    report = LoadReport()

    loaded = load(
        SAFETY,
        {old: ["plc1/x"]},
        report=report,
        without=("interfaces.field_violation",),
    )

    assert dict(flat(loaded))[new] == ("plc1/x",)
    (line,) = report
    assert line.where == f"c.{old}"
    assert line.what.startswith(f"older parameter; later: {new}")
