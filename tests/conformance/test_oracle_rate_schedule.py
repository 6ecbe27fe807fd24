"""Replays in which ticks of the manager slower controllers run."""

from typing import Any

import pytest

from arm_drake.manager.lifecycle import due_period
from tests.oracle import oracle_cases

CASES = oracle_cases("controller_manager_rate_schedule")


def case_id(case: dict[str, Any]) -> str:
    inputs = case["input"]
    kind = "even" if len(set(inputs["periods_ns"])) == 1 else "jittered"
    return f"{inputs['controller_update_rate']}-of-{inputs['cm_update_rate']}-{kind}"


@pytest.mark.parametrize("case", CASES, ids=case_id)
def test_updates_are_due_when_upstream_runs_them(case: dict[str, Any]) -> None:
    inputs = case["input"]
    rate, manager_rate = inputs["controller_update_rate"], inputs["cm_update_rate"]
    time_ns, last_ns = inputs["t0_ns"], None
    times, periods = [], []
    for tick, manager_period_ns in enumerate(inputs["periods_ns"]):
        time_ns += manager_period_ns if tick else 0
        period_ns = due_period(time_ns, last_ns, rate, manager_rate, manager_period_ns)
        if period_ns is not None:
            last_ns = time_ns
        times.append(time_ns)
        periods.append(period_ns)

    assert times == case["output"]["t_ns"]
    assert periods == case["output"]["period_passed_ns"]
    assert [p is not None for p in periods] == case["output"]["runs"]
