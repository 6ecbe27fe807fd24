"""Flat ROS parameters become a typed dataclass, or one located message."""

import dataclasses as dc
from pathlib import Path
from typing import Any, Literal

import pytest

from arm_drake.description.parameters import (
    Parameter,
    load_parameters,
    per_element_of,
)
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError

FILE = Path("c.yaml")


@dc.dataclass(frozen=True)
class Gains:
    p: float = 1.0
    i: float = 0.0

    def __post_init__(self) -> None:
        if self.p < 0.0:
            raise ValueError(f"p must be at least 0, got {self.p}")


@dc.dataclass(frozen=True)
class Limits:
    rate: float = 20.0


@dc.dataclass(frozen=True)
class Schema:
    joints: tuple[str, ...]
    name: str = "arm"
    count: int = 1
    is_open: bool = False
    offsets: tuple[float, ...] = ()
    method: Literal["splines", "none"] = "splines"
    limits: Limits = Limits()
    gains: dict[str, Gains] = per_element_of("joints")


def load(report: LoadReport | None = None, /, **values: Any) -> Schema:
    report = LoadReport() if report is None else report
    given = {"joints": ["a", "b"]} | values
    parameters = {
        name.replace("__", "."): Parameter(value, FILE, line)
        for line, (name, value) in enumerate(given.items(), start=1)
        if value is not ...
    }
    return load_parameters(Schema, parameters, "arm", FILE, report)


def test_what_isnt_given_has_its_default():
    assert load() == Schema(("a", "b"), gains={"a": Gains(), "b": Gains()})


def test_given_values_are_taken():
    loaded = load(
        name="leg",
        count=2,
        is_open=True,
        offsets=[0.5, 1.5],
        method="none",
        limits__rate=10.0,
        a__p=2.0,
        b__i=3.0,
    )

    assert loaded == Schema(
        joints=("a", "b"),
        name="leg",
        count=2,
        is_open=True,
        offsets=(0.5, 1.5),
        method="none",
        limits=Limits(10.0),
        gains={"a": Gains(p=2.0), "b": Gains(i=3.0)},
    )


def test_an_integer_is_taken_for_a_double_and_reported():
    report = LoadReport()

    loaded = load(report, limits__rate=10)

    assert loaded.limits.rate == 10.0
    assert type(loaded.limits.rate) is float
    assert str(report) == (
        "info: c.yaml:2: arm.limits.rate: 10 is an integer; ros2_control refuses it "
        "for a double; taken as 10.0"
    )


def test_an_unknown_parameter_is_reported_with_the_closest():
    report = LoadReport()

    load(report, cuont=1, zzz=2)

    assert str(report).splitlines() == [
        "info: c.yaml:2: arm.cuont: unknown parameter; did you mean 'count'?; "
        "it has no effect",
        "info: c.yaml:3: arm.zzz: unknown parameter; it has no effect",
    ]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"joints": ...}, "c.yaml: arm.joints: is required but missing"),
        ({"joints": "a"}, "c.yaml:1: arm.joints: expected a list of str, got 'a'"),
        ({"joints": ["a", 1]}, "c.yaml:1: arm.joints: expected str, got 1"),
        ({"joints": None}, "c.yaml:1: arm.joints: expected a list of str, got None"),
        ({"name": 1}, "c.yaml:2: arm.name: expected str, got 1"),
        ({"count": "1"}, "c.yaml:2: arm.count: expected int, got '1'"),
        ({"count": 1.0}, "c.yaml:2: arm.count: expected int, got 1.0"),
        ({"count": True}, "c.yaml:2: arm.count: expected int, got True"),
        ({"is_open": 1}, "c.yaml:2: arm.is_open: expected bool, got 1"),
        ({"offsets": [True]}, "c.yaml:2: arm.offsets: expected float, got True"),
        ({"offsets": 1.0}, "c.yaml:2: arm.offsets: expected a list of float, got 1.0"),
        (
            {"limits__rate": "fast"},
            "c.yaml:2: arm.limits.rate: expected float, got 'fast'",
        ),
        (
            {"limits__rate": 2**63},
            "c.yaml:2: arm.limits.rate: expected float, got 9223372036854775808",
        ),
        (
            {"method": "spline"},
            "c.yaml:2: arm.method: expected one of ['splines', 'none'], got 'spline'",
        ),
        ({"a__p": "x"}, "c.yaml:2: arm.a.p: expected float, got 'x'"),
        ({"a__p": -1.0}, "c.yaml: arm.a: p must be at least 0, got -1.0"),
    ],
)
def test_a_bad_parameter_is_one_located_message(values, message):
    with pytest.raises(ParameterError) as caught:
        load(**values)

    assert str(caught.value) == message
