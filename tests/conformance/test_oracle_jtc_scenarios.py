"""Replays the joint_trajectory_controller scenarios of upstream, tick by tick.

Files without "jazzy" in their name are of its master, distro rolling; those of jazzy
hold the outputs that differ, and the names of the scenarios whose outputs don't. What
comes out is compared: commands, controller_state, answers, and the news of goals.
A file that isn't there is skipped, alone; scenarios of our own are always replayed.
"""

import math
from collections import defaultdict
from functools import cache, lru_cache
from itertools import zip_longest
from typing import Any

import numpy as np
import pytest

from arm_drake.errors import ParameterError
from arm_drake.messages import (
    CancelGoal,
    CancelResponse,
    GoalEvent,
    GoalStatus,
    JointTrajectoryControllerState,
    SendGoal,
    TopicRejected,
)
from tests.conformance.jtc_own_scenarios import OWN_SCENARIOS
from tests.conformance.jtc_players import (
    Dict,
    FunctionsPlayer,
    Player,
    SystemPlayer,
    flatten,
    load,
    suits_the_system,
)
from tests.conformance.oracle_files import read_files
from tests.oracle import oracle_cases

MASTER, JAZZY = "jtc_scenarios", "jtc_scenarios_jazzy_4.42.1"
IDENTICAL, DIFFERING = f"{JAZZY}_identical", f"{JAZZY}_differing"
NAMES = (MASTER, IDENTICAL, DIFFERING)
FILES = read_files(NAMES)

INPUTS: dict[str, Dict] = {}
OUTPUTS: dict[tuple[str, str], Dict] = {}
for _case in [*FILES.get(MASTER, ()), *OWN_SCENARIOS]:
    INPUTS[_case["input"]["name"]] = _case["input"]
    OUTPUTS["rolling", _case["input"]["name"]] = _case["output"]
SAME = FILES.get(IDENTICAL, {}).get("identical_to_master", [])
for _name in [*SAME, *(_case["input"]["name"] for _case in OWN_SCENARIOS)]:
    if _name in INPUTS:
        OUTPUTS["jazzy", _name] = OUTPUTS["rolling", _name]
for _case in FILES.get(DIFFERING, ()):
    if _case["name"] in INPUTS:
        OUTPUTS["jazzy", _case["name"]] = _case["output"]


def is_configured(output: Dict) -> bool:
    return ["configure", "SUCCESS"] in [row[1:] for row in output["lifecycle"]]


CONFIGURED = [key for key, output in OUTPUTS.items() if is_configured(output)]
REFUSED = [key for key, output in OUTPUTS.items() if not is_configured(output)]
REPLAYED = [key for key in CONFIGURED if "command" in OUTPUTS[key]]
NEVER_ACTIVE = [key for key in CONFIGURED if "command" not in OUTPUTS[key]]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_has_cases(name: str) -> None:
    assert oracle_cases(name)


def refusal_of(message: Dict, *, has_effort: bool) -> str | None:
    """Return what our refusal of a message says that upstream takes.

    It checks neither whether joints are named twice (another one is left out, and gets
    a number that an earlier message left behind) nor whether numbers are finite, nor
    how many efforts there are.
    """
    names = message.get("joint_names", [])
    if len(set(names)) < len(names):
        return "is named twice; name each joint once"
    for point in message.get("points", []):
        vectors = [v for v in point.values() if isinstance(v, list)]
        if not all(math.isfinite(float(x)) for vector in vectors for x in vector):
            return "expected a finite number"
        if has_effort and len(point.get("effort") or names) != len(names):
            return "effort has"
    return None


@cache
def first_refusal(name: str) -> tuple[int, str] | None:
    """Return the cycle of the first message that we refuse, and what we say.

    Rows are compared up to there.
    """
    inputs, output = INPUTS[name], OUTPUTS["rolling", name]
    has_effort = "effort" in inputs["params"]["command_interfaces"]
    is_active = True
    responses = output.get("responses", [])
    for event, row in zip_longest(inputs["events"], responses, fillvalue={}):
        if event["type"] in ("activate", "deactivate"):
            is_active = event["type"] == "activate"
        message = event.get("msg") or event.get("goal", {}).get("trajectory", {})
        text = refusal_of(message, has_effort=has_effort)
        # What upstream refuses, too, may have another reason.
        is_refused = not is_active or row.get("response") == "rejected"
        if text is not None and not is_refused:
            return event["cycle"], text
    return None


def num_cycles(name: str) -> int | None:
    """Return how many cycles are compared; None is all of them."""
    refusal = first_refusal(name)
    return None if refusal is None else refusal[0]


def make_player(distro: str, name: str) -> Player:
    inputs, output = INPUTS[name], OUTPUTS[distro, name]
    kind = SystemPlayer if suits_the_system(inputs) else FunctionsPlayer
    return kind(distro, inputs, output)


# All tests of one, then all of the next: a thousand replays are a million objects.
for_each_replayed = pytest.mark.parametrize(
    ("distro", "name"), REPLAYED, scope="module"
)


@lru_cache(maxsize=1)
def replay(distro: str, name: str) -> Player:
    player = make_player(distro, name)
    player.play(num_cycles(name))
    return player


def are_close(actual: list[Any], expected: list[Any]) -> bool:
    """Return whether rows are, all at once; no, where they differ in length."""
    count = min(len(actual), len(expected))
    try:
        ours, theirs = np.array(actual[:count]), np.array(expected[:count], float)
    except ValueError:
        return False
    return (
        ours.dtype.kind in "fi"
        and ours.shape == theirs.shape
        and np.allclose(ours, theirs, 1e-9, 1e-12, equal_nan=True)
    )


def assert_rows(name: str, actual: list[Any], expected: list[Any]) -> None:
    """Compare a column; one element stands for all rows."""
    if len(expected) == 1:
        expected = expected * len(actual)
    if are_close(actual, expected):
        return
    for k, (ours, theirs) in enumerate(zip(actual, expected, strict=False)):
        theirs = np.array(theirs, float)
        assert np.shape(ours) == theirs.shape, f"{name} in row {k}: {ours}, {theirs}"
        np.testing.assert_allclose(
            ours, theirs, 1e-9, 1e-12, err_msg=f"{name} in row {k}"
        )


def column_of(report: JointTrajectoryControllerState, column: str) -> Any:
    if column == "speed_scaling_factor":
        return report.speed_scaling_factor
    point, _, field = column.partition("_")
    value = getattr(getattr(report, point), field.removesuffix("_ns"))
    return value.to_nanoseconds() if field.endswith("_ns") else value


@for_each_replayed
def test_commands_are_upstream_s(distro: str, name: str) -> None:
    output = OUTPUTS[distro, name]

    seen = replay(distro, name)

    returns = output["update_return"]
    if isinstance(returns, str):
        returns = [returns] * len(output["t_ns"])
    assert seen.returns == returns[: len(seen.returns)]
    names = output["command_interfaces"]
    assert sorted(names) == sorted(seen.claimed)
    at = [seen.claimed.index(name) for name in names]
    ours = [[row[i] for i in at] for row in seen.commands]
    expected = output["command"]
    if first_refusal(name) is None:
        assert len(ours) == len(expected)
    assert_rows("command", ours, expected)


@for_each_replayed
def test_controller_states_are_upstream_s(distro: str, name: str) -> None:
    columns = dict(OUTPUTS[distro, name].get("controller_state", {}))
    times = columns.pop("t_ns", OUTPUTS[distro, name]["t_ns"])

    seen = replay(distro, name)

    ours = [report.header.stamp.to_nanoseconds() for report in seen.reports]
    assert ours == times[: len(ours)]
    if first_refusal(name) is None:
        assert len(ours) == len(times)
    for column, rows in columns.items():
        assert_rows(column, [column_of(r, column) for r in seen.reports], rows)
    filled = {
        f"{point}_{field}"
        for point in ("reference", "feedback", "error", "output")
        for field in ("positions", "velocities", "accelerations", "effort")
        if any(getattr(getattr(r, point), field) for r in seen.reports)
    }
    assert filled <= set(columns)


def summaries(event: Any) -> list[str]:
    """Return what the action server of the reference calls our news."""
    if isinstance(event, CancelResponse):
        return ["canceling" if event.accepted else "cancel_rejected"]
    if not isinstance(event, GoalEvent):
        return []
    if event.feedback is not None:
        return ["feedback"]
    if event.status is GoalStatus.EXECUTING:
        return ["accepted", "executing"]
    return [event.status.name.lower()]


def name_of(event: GoalEvent | CancelResponse, names: dict[SendGoal, str]) -> str:
    request = event.request
    return names[request.request if isinstance(request, CancelGoal) else request]


def assert_feedback(ours: GoalEvent, theirs: Dict, *, has_index: bool) -> None:
    """Compare feedback; jazzy itself always says index 0."""
    feedback = ours.feedback
    assert feedback is not None
    assert feedback.header.stamp.to_nanoseconds() == theirs["stamp_ns"]
    from_start_ns = feedback.desired.time_from_start.to_nanoseconds()
    assert from_start_ns == theirs["desired_time_from_start_ns"]
    if has_index:
        assert feedback.index == theirs["index"]
    for field in ("desired", "actual", "error"):
        assert_rows(field, [getattr(feedback, field).positions], [theirs[field]])


@for_each_replayed
def test_news_of_goals_are_upstream_s(distro: str, name: str) -> None:
    output, end = OUTPUTS[distro, name], num_cycles(name)
    end_ns = math.inf if end is None else output["t_ns"][end]

    seen = replay(distro, name)

    ours = [
        (time_ns, kind, event)
        for time_ns, event in seen.events
        for kind in summaries(event)
    ]
    theirs = [event for event in output["events"] if event["t_ns"] < end_ns]
    # A client hears of a goal whose handle is dropped as of one that is cancelled.
    dropped = "canceled_by_destructor"
    kinds = [
        "canceled" if event["event"] == dropped else event["event"] for event in theirs
    ]
    assert [
        (time_ns, kind, name_of(event, seen.names)) for time_ns, kind, event in ours
    ] == [
        (event["t_ns"], kind, event["goal"])
        for event, kind in zip(theirs, kinds, strict=True)
    ]
    for (_, kind, event), row in zip(ours, theirs, strict=True):
        if kind == "feedback":
            assert_feedback(event, row, has_index=distro != "jazzy")
        elif "result" in row:
            assert event.result.error_code == row["result"]["error_code"]
            assert event.result.error_string == row["result"]["error_string"]


@for_each_replayed
def test_answers_are_upstream_s(distro: str, name: str) -> None:
    responses = OUTPUTS[distro, name]["responses"]
    end = num_cycles(name)
    if end is not None:
        responses = [r for r in responses if r["cycle"] < end]
    by_type = defaultdict(list)
    for row in responses:
        by_type[row["type"]].append(row.get("response"))

    seen = replay(distro, name)

    events = [event for _, event in seen.events]
    goals = [
        "rejected" if "rejected" in summaries(e) else "accepted"
        for e in events
        if {"accepted", "rejected"} & set(summaries(e))
    ]
    cancels = [e.accepted for e in events if isinstance(e, CancelResponse)]
    assert goals == by_type["goal"]
    assert cancels == [answer == "accepted" for answer in by_type["cancel"]]
    assert seen.num_undelivered == by_type["topic"].count("no_subscription")
    assert len(seen.answers) == len(by_type["service"])
    for ours, theirs in zip(seen.answers, by_type["service"], strict=True):
        assert ours.success == theirs["success"]
        assert list(ours.name) == theirs["name"]
        for field in ("position", "velocity", "acceleration"):
            assert_rows(field, [getattr(ours, field)], [theirs[field]])


@pytest.mark.parametrize(
    ("distro", "name"),
    [key for key in REPLAYED if first_refusal(key[1]) is not None],
)
def test_what_upstream_does_not_check_is_refused(distro: str, name: str) -> None:
    refusal = first_refusal(name)
    assert refusal is not None
    player = make_player(distro, name)

    player.play(refusal[0] + 1)

    reasons = [
        event.reason if isinstance(event, TopicRejected) else event.result.error_string
        for _, event in player.events
        if isinstance(event, TopicRejected) or event.status is GoalStatus.REJECTED
    ]
    assert refusal[1] in reasons[-1]


@pytest.mark.parametrize(("distro", "name"), REFUSED)
def test_parameters_that_upstream_refuses_are_refused(distro: str, name: str) -> None:
    with pytest.raises(ParameterError, match=r"must"):
        load(dict(flatten(INPUTS[name]["params"])), distro)


@pytest.mark.parametrize(("distro", "name"), NEVER_ACTIVE)
def test_what_fails_to_activate_has_parameters_that_can_be_taken(
    distro: str, name: str
) -> None:
    parameters = load(dict(flatten(INPUTS[name]["params"])), distro)

    assert parameters.joints == tuple(INPUTS[name]["params"]["joints"])


def test_each_output_of_jazzy_is_said_once() -> None:
    names = [*SAME, *(case["name"] for case in FILES.get(DIFFERING, ()))]

    assert len(names) == len(set(names))
