"""Flat ROS parameters become a typed dataclass, or one located message."""

import dataclasses as dc
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from arm_drake.description.parameters import (
    DISTROS,
    Parameter,
    ParameterGroup,
    Rule,
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
    inputs = {"joints": ["a", "b"]} | values
    parameters = {
        name.replace("__", "."): Parameter(value, FILE, line)
        for line, (name, value) in enumerate(inputs.items(), start=1)
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


def test_a_value_in_place_of_a_mapping_is_reported_with_its_keys():
    report = LoadReport()

    load(report, a=1, limits=[1.0, 2.0])

    assert str(report).splitlines() == [
        "warning: c.yaml:2: arm.a: expected a mapping of i, p, got 1; it has no effect",
        "warning: c.yaml:3: arm.limits: expected a mapping of rate, got [1.0, 2.0]; "
        "it has no effect",
    ]


def test_an_unknown_parameter_is_reported_with_the_closest():
    report = LoadReport()

    load(report, cuont=1, zzz=2)

    assert str(report).splitlines() == [
        "warning: c.yaml:2: arm.cuont: unknown parameter; did you mean 'count'?; "
        "it has no effect",
        "warning: c.yaml:3: arm.zzz: unknown parameter; it has no effect",
    ]


def test_an_unknown_parameter_is_no_misspelling_of_one_that_is_given():
    report = LoadReport()

    load(report, counts=1, count=2)

    assert str(report) == (
        "warning: c.yaml:2: arm.counts: unknown parameter; it has no effect"
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"joints": ...}, "c.yaml: arm.joints: is required but missing"),
        (
            {"joints": ..., "jionts": ["a"]},
            "c.yaml:2: arm.joints: is required but missing, 'jionts' is given instead",
        ),
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
        ({"a__p": -1.0}, "c.yaml:2: arm.a: p must be at least 0, got -1.0"),
    ],
)
def test_a_bad_parameter_is_one_located_message(values, message):
    with pytest.raises(ParameterError) as caught:
        load(**values)

    assert str(caught.value) == message


@dc.dataclass(frozen=True)
class Group:
    mass: float = 1.0


@dc.dataclass(frozen=True)
class Tool:
    group: Group = Group()
    ports: dict[str, Gains] = per_element_of("names")


@dc.dataclass(frozen=True)
class Versions:
    names: tuple[str, ...] = ()
    joint: str = ""
    rate: Annotated[float, Rule(humble=5.0, rolling=7.0)] = 6.0
    newer: Annotated[int, Rule(since="kilted")] = 0
    older: Annotated[int, Rule(until="humble", instead="rate decides")] = 0
    harmless: Annotated[int, Rule(until="humble", is_harmless=True)] = 0
    kept: Annotated[int, Rule(since="kilted", is_kept=True)] = 0
    renamed: Annotated[int, Rule(was=("former", "first"))] = 0
    only: Annotated[int, Rule(only=3)] = 3
    low: float = -1.0
    high: float = 1.0
    group: Annotated[Group, Rule(since="rolling")] = Group()
    chain: dict[str, Any] = dc.field(default_factory=dict)
    tools: dict[str, Tool] = per_element_of("names")
    of_joint: dict[str, Gains] = per_element_of("joint")

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        span = params.get("span", float)
        if span is not None and params.is_before("rolling"):
            params.replace("span", {"low": -span, "high": span})


def load_versions(
    report: LoadReport | None = None, *, distro: str = "jazzy", **values: Any
) -> Versions:
    parameters = {
        name.replace("__", "."): Parameter(value, FILE, line)
        for line, (name, value) in enumerate(values.items(), start=1)
    }
    report = LoadReport() if report is None else report
    return load_parameters(Versions, parameters, "arm", FILE, report, distro=distro)


def test_a_default_is_that_of_the_distro():
    rates = [load_versions(distro=distro).rate for distro in DISTROS]

    assert rates == [5.0, 6.0, 6.0, 7.0]
    assert load_versions(distro="humble", rate=1.0).rate == 1.0
    assert load_versions().rate == Versions().rate


@pytest.mark.parametrize(
    ("name", "distros", "line"),
    [
        (
            "newer",
            ["kilted", "rolling"],
            "warning: c.yaml:1: arm.newer: a parameter since kilted only, not of "
            "{distro}; it has no effect",
        ),
        (
            "older",
            ["humble"],
            "warning: c.yaml:1: arm.older: a parameter up to humble only, not of "
            "{distro}; it has no effect: rate decides",
        ),
        (
            "harmless",
            ["humble"],
            "info: c.yaml:1: arm.harmless: a parameter up to humble only, not of "
            "{distro}; it has no effect",
        ),
    ],
)
def test_what_a_distro_lacks_is_ignored_and_reported(name, distros, line):
    for distro in DISTROS:
        report = LoadReport()

        loaded = load_versions(report, distro=distro, **{name: 4})

        is_known = distro in distros
        assert getattr(loaded, name) == 4 * is_known
        expected = "nothing to report" if is_known else line.format(distro=distro)
        assert str(report) == expected


@pytest.mark.parametrize("distro", DISTROS)
@pytest.mark.parametrize("name", ["newer", "older", "harmless", "kept"])
def test_a_default_that_a_distro_lacks_is_nothing_to_report(name, distro):
    report = LoadReport()

    load_versions(report, distro=distro, **{name: 0})

    assert not list(report)


def test_what_a_distro_lacks_can_be_kept():
    report = LoadReport()

    assert load_versions(report, kept=4).kept == 4
    assert str(report) == (
        "warning: c.yaml:1: arm.kept: a parameter since kilted only, not of jazzy; it "
        "is taken"
    )


def test_a_group_that_a_distro_lacks_is_ignored_whole():
    report = LoadReport()

    assert load_versions(report, group__mass=2.0).group == Group(1.0)
    assert str(report) == (
        "warning: c.yaml:1: arm.group.mass: a parameter since rolling only, not of "
        "jazzy; it has no effect"
    )
    assert load_versions(group__mass=2.0, distro="rolling").group == Group(2.0)


@pytest.mark.parametrize("distro", DISTROS)
@pytest.mark.parametrize("old", ["former", "first"])
def test_an_older_name_is_taken_in_every_distro(old, distro):
    report = LoadReport()

    loaded = load_versions(report, distro=distro, **{old: 4})

    assert loaded.renamed == 4
    assert str(report) == (
        f"info: c.yaml:1: arm.{old}: older parameter; later: renamed: 4; taken as that"
    )


def test_an_older_name_gives_way_to_the_newer():
    report = LoadReport()

    assert load_versions(report, former=4, renamed=5).renamed == 5
    assert str(report) == (
        "warning: c.yaml:1: arm.former: older parameter; later: renamed: 4; it has no "
        "effect"
    )


def test_a_bad_value_is_found_where_the_older_name_stands():
    with pytest.raises(ParameterError) as caught:
        load_versions(rate=1.0, former="x")

    assert str(caught.value) == "c.yaml:2: arm.renamed: expected int, got 'x'"


def test_a_value_that_has_no_effect_yet_is_reported():
    report = LoadReport()

    assert load_versions(report, only=4).only == 4
    assert str(report) == (
        "warning: c.yaml:1: arm.only: 4 is not acted on yet; the controller acts as "
        "with 3"
    )
    assert not list(_reported(only=3))


def _reported(**values: Any) -> LoadReport:
    report = LoadReport()
    load_versions(report, **values)
    return report


def test_a_schema_can_compute_newer_parameters_from_older():
    report = LoadReport()

    loaded = load_versions(report, span=2.0, high=3.0)

    assert (loaded.low, loaded.high) == (-2.0, 3.0)
    assert str(report) == (
        "info: c.yaml:1: arm.span: older parameter; later: low: -2.0, high: 2.0; taken "
        "as that"
    )
    assert str(_reported(span=2.0, distro="rolling")) == (
        "warning: c.yaml:1: arm.span: unknown parameter; it has no effect"
    )


def test_a_plain_dict_takes_what_lies_below_it():
    report = LoadReport()

    loaded = load_versions(report, chain__filter1__type="x", chain__filter1__a=[1, 2])

    assert loaded.chain == {"filter1.type": "x", "filter1.a": [1, 2]}
    assert not list(report)


def test_groups_of_an_element_can_have_groups_themselves():
    loaded = load_versions(names=["a", "b"], a__group__mass=2.0, a__b__p=3.0)

    assert loaded.tools == {
        "a": Tool(Group(2.0), {"a": Gains(), "b": Gains(p=3.0)}),
        "b": Tool(Group(1.0), {"a": Gains(), "b": Gains()}),
    }


def test_a_single_name_has_a_group_too():
    assert load_versions(joint="j", j__p=3.0).of_joint == {"j": Gains(p=3.0)}
    assert load_versions().of_joint == {}


def test_threads_of_a_controller_are_no_unknown_parameters():
    lines = list(_reported(is_async=True, async_parameters__cpu=[1]))

    assert [line.where for line in lines] == [
        "arm.async_parameters.cpu",
        "arm.is_async",
    ]
    assert {(line.severity, line.what, line.done) for line in lines} == {
        ("info", "a simulation has no threads", "it has no effect")
    }
    assert not list(_reported(is_async=False))
