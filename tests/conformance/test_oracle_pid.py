"""Replays the PIDs of upstream."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm_drake.control.pid import Pid, find_fault
from tests.oracle import assert_close, number, oracle_cases, oracle_folder

NAMES = ("pid", "pid_jazzy_legacy_antiwindup")


def load_cases() -> list[Any]:
    files = {path.name.split(".")[0] for path in oracle_folder().glob("pid*.json*")}
    # Without any file, this skips or fails as it is to.
    names = [name for name in NAMES if name in files] or NAMES[:1]
    return [
        pytest.param(case, id=f"{name}-{case['input']['antiwindup']}-{i}")
        for name in names
        for i, case in enumerate(oracle_cases(name))
    ]


def make_gains(inputs: dict[str, Any]) -> SimpleNamespace:
    return SimpleNamespace(
        p=number(inputs["p"]),
        i=number(inputs["i"]),
        d=number(inputs["d"]),
        u_clamp_max=number(inputs["u_max"]),
        u_clamp_min=number(inputs["u_min"]),
        i_clamp_max=number(inputs["i_max"]),
        i_clamp_min=number(inputs["i_min"]),
        antiwindup_strategy=inputs["antiwindup"],
        antiwindup=False,
        tracking_time_constant=number(inputs["tracking_time_constant"]),
        error_deadband=number(inputs["error_deadband"]),
    )


def make_zero_gains() -> SimpleNamespace:
    """Return the gains of upstream's PID that refused its gains."""
    zeros = dict.fromkeys(["p", "i", "d", "tracking_time_constant"], 0.0)
    limits = {"u_max": "inf", "u_min": "-inf", "i_max": "inf", "i_min": "-inf"}
    rest = {"antiwindup": "none", "error_deadband": 0.0}
    return make_gains(zeros | limits | rest)


@pytest.mark.parametrize("case", load_cases())
def test_commands_are_upstream_s(case: dict[str, Any]) -> None:
    inputs, expected = case["input"], case["output"]
    gains = make_gains(inputs)
    assert (find_fault(gains) is None) == expected["init_ok"]
    if not expected["init_ok"]:
        gains = make_zero_gains()
    pid = Pid.from_gains([gains])
    rates = inputs.get("error_dot") or [None] * len(inputs["error"])
    resets: dict[int, list[bool]] = {}
    for k, save_i_term in inputs.get("reset_at") or []:
        resets.setdefault(k, []).append(save_i_term)

    state = pid.initial()
    commands: list[float] = []
    i_terms: list[float] = []
    error_rates: list[float] = []
    steps = zip(inputs["dt"], inputs["error"], rates, expected["command"], strict=True)
    for k, (dt, error, rate, command) in enumerate(steps):
        for save_i_term in resets.get(k, []):
            state = pid.reset(state, save_i_term)
        arguments = (
            np.array([number(error)]),
            number(dt),
            None if rate is None else np.array([number(rate)]),
        )
        if command == "exception":
            with pytest.raises(ValueError, match="dt"):
                pid.step(state, *arguments)
        else:
            state = pid.step(state, *arguments)
            commands.append(state.command.item())
        i_terms.append(state.i_term.item())
        error_rates.append(state.error_rate.item())

    used = expected["tracking_time_constant_used"]
    assert_close(pid.tracking_time_constant, [used])
    assert_close(commands, [x for x in expected["command"] if x != "exception"])
    assert_close(i_terms, expected["i_term"])
    assert_close(error_rates, expected["d_error"])
