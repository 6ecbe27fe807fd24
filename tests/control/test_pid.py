"""Vectors without a remark are control_toolbox's own tests, or follow from its rules.

Those of `HUMBLE` follow from the rules of its branch humble.
"""

import copy
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm_drake.control.pid import (
    STRATEGIES,
    Pid,
    PidGains,
    PidState,
    PlainPids,
    find_fault,
)

INF, NAN = math.inf, math.nan


def make_gains(**gains: Any) -> SimpleNamespace:
    defaults = {
        "p": 0.0,
        "i": 0.0,
        "d": 0.0,
        "u_clamp_max": INF,
        "u_clamp_min": -INF,
        "i_clamp_max": INF,
        "i_clamp_min": -INF,
        "antiwindup_strategy": "none",
        "antiwindup": False,
        "tracking_time_constant": 0.0,
        "error_deadband": 1e-16,
    }
    u, i = gains.pop("u", None), gains.pop("i_clamp", None)
    if u is not None:
        gains |= {"u_clamp_max": u, "u_clamp_min": -u}
    if i is not None:
        gains |= {"i_clamp_max": i, "i_clamp_min": -i}
    assert not gains.keys() - defaults.keys()
    return SimpleNamespace(**(defaults | gains))


def make_pid(*, is_humble: bool = False, **gains: Any) -> Pid:
    return Pid.from_gains([make_gains(**gains)], is_humble=is_humble)


def step(
    pid: Pid, state: PidState, error: float, dt: float = 1.0, rate: float | None = None
) -> PidState:
    rates = None if rate is None else np.array([rate])
    return pid.step(state, np.array([error]), dt, rates)


def run(
    pid: Pid, errors: list[float], dt: Any = 1.0, state: PidState | None = None
) -> tuple[list[float], list[float], PidState]:
    state = pid.initial() if state is None else state
    commands, i_terms = [], []
    for error, time in zip(errors, np.broadcast_to(dt, len(errors)), strict=True):
        state = step(pid, state, error, float(time))
        commands.append(state.command.item())
        i_terms.append(state.i_term.item())
    return commands, i_terms, state


UPWARDS = [0.5, 1.0, 2.0, 10.0, 50.0, 100.0]
BOTH = UPWARDS + [-e for e in UPWARDS]
BACK = {"antiwindup_strategy": "back_calculation"}
CONDITIONAL = {"antiwindup_strategy": "conditional_integration"}
LEGACY = {"antiwindup_strategy": "legacy"}

# Gains, errors, periods, commands, integral terms.
SEQUENCES = {
    "p-limited-above": ({"p": 1, "u": 1}, UPWARDS, 1, [0.5, 1, 1, 1, 1, 1], None),
    "p-limited-below": (
        {"p": 1, "u": 1},
        [-e for e in UPWARDS],
        1,
        [-0.5, -1, -1, -1, -1, -1],
        None,
    ),
    "p-unlimited": ({"p": 1}, BOTH, 1, BOTH, None),
    "p-within-limits": (
        {"p": 1, "u": 10},
        [-0.5, -0.5, -1, 0.5],
        1,
        [-0.5, -0.5, -1, 0.5],
        None,
    ),
    "zeros-back": (
        {"u": 20, "i_clamp": 1, **BACK},
        [-1, -1, -1, 10, 10, 10],
        1,
        [0] * 6,
        [0] * 6,
    ),
    "zeros-conditional": (
        {"u": 20, "i_clamp": 1, **CONDITIONAL},
        [-1, -1, -1, 10, 10, 10],
        1,
        [0] * 6,
        [0] * 6,
    ),
    "back-clamped": (
        {"i": 2, "i_clamp": 1, "tracking_time_constant": 1, **BACK},
        [-1, -1, 0.5, 0],
        1,
        [0, -1, -1, 0],
        [-1, -1, 0, 0],
    ),
    "i": (
        {"i": 1, "u": 5},
        [-0.5, -0.5, 0, 0, 1, 0],
        1,
        [0, -0.5, -1, -1, -1, 0],
        [-0.5, -1, -1, -1, 0, 0],
    ),
    "d": (
        {"d": 1, "u": 10},
        [-0.5, -0.5, -0.5, -1, -0.5],
        [1, 1, 0.1, 1, 1],
        [-0.5, 0, 0, -0.5, 0.5],
        None,
    ),
    "pid": (
        {"p": 1, "i": 1, "d": 1, "u": 5, "i_clamp": 10},
        [-0.5, -0.5, 0],
        1,
        [-1, -1, -0.5],
        [-0.5, -1, -1],
    ),
    "back": (
        {"i": 1, "u": 5, "i_clamp": 10, "tracking_time_constant": 1, **BACK},
        [1, 2, 3, 1, 2, -1, 1],
        1,
        [0, 1, 3, 5, 5, 5, 4],
        [1, 3, 6, 6, 7, 4, 5],
    ),
    "conditional": (
        {"i": 1, "u": 5, "i_clamp": 10, **CONDITIONAL},
        [1, 2, 3, 1, 2, -1, 0],
        1,
        [0, 1, 3, 5, 5, 5, 5],
        [1, 3, 6, 6, 6, 5, 5],
    ),
    "back-without-i": ({"p": 2, "d": 1, **BACK}, [1], 1, [3], [0]),
    "back-made-constant": (
        {"p": 6, "i": 1, "d": 2, "u": 5, **BACK},
        [1, 0.5, 0.2, 0, -0.1],
        0.01,
        [5, -5, -5, -5, -5],
        [-1.41128463, -0.74576710, -0.35807028, -0.35807028, -0.24622969],
    ),
    "conditional-pid": (
        {"p": 6, "i": 1, "d": 2, "u": 5, **CONDITIONAL},
        [1, 0.5, 0.2, 0, -0.1],
        0.01,
        [5, -5, -5, -5, -5],
        [0, 0.005, 0.007, 0.007, 0.007],
    ),
    "none-pid": (
        {"p": 10, "i": 2, "d": 0.5},
        [0.1, 0.1, 0.08, 0.05, 0],
        0.01,
        [6, 1.002, -0.196, -0.9944, -2.4934],
        [0.002, 0.004, 0.0056, 0.0066, 0.0066],
    ),
    "deadband": (
        {"i": 1, "error_deadband": 0.1},
        [0.05, 0.1, 0.2, 0.05, 0.2],
        1,
        [0, 0, 0, 0.2, 0.2],
        [0, 0, 0.2, 0.2, 0.4],
    ),
    "i-clamped": (
        {"i": 1, "i_clamp": 0.5},
        [0.3, 0.3, 0.3, -2, 0],
        1,
        [0, 0.3, 0.5, 0.5, -0.5],
        [0.3, 0.5, 0.5, -0.5, -0.5],
    ),
    # The integral acts at once, and only its own limits hold it.
    "legacy": (
        {"p": 1, "i": 1, "u": 2, "i_clamp": 3, **LEGACY},
        [1, 1, 1, 1, -2],
        1,
        [2, 2, 2, 2, -1],
        [1, 2, 3, 3, 1],
    ),
    "legacy-deadband": (
        {"i": 1, "error_deadband": 0.1, **LEGACY},
        [0.05, 0.2, 0.1],
        1,
        [0, 0.2, 0.2],
        [0, 0.2, 0.2],
    ),
    # Back-calculation doesn't act in the deadband, errors of 0 included.
    "back-deadband": (
        {"p": 1, "i": 1, "u": 1, "error_deadband": 0, "tracking_time_constant": 1}
        | BACK,
        [5, 0, 0],
        1,
        [1, 1, 1],
        [1, 1, 1],
    ),
    # As upstream: nothing to make the time constant from.
    "back-without-constant": ({"i": 1, **BACK}, [1, 1], 1, [0, NAN], [NAN, NAN]),
}


@pytest.mark.parametrize("case", SEQUENCES.values(), ids=SEQUENCES)
def test_commands_follow_from_errors(case: Any) -> None:
    gains, errors, dt, expected_commands, expected_i_terms = case

    commands, i_terms, _ = run(make_pid(**gains), errors, dt)

    assert commands == pytest.approx(expected_commands, abs=1e-9, nan_ok=True)
    if expected_i_terms is not None:
        tolerance = 1e-8 if "p" in gains else 1e-9
        assert i_terms == pytest.approx(expected_i_terms, abs=tolerance, nan_ok=True)


HUMBLE = {
    "i": ({"i": 1, "i_clamp": 10}, [-0.5, -0.5, 0, 0, 1], 1, [-0.5, -1, -1, -1, 0]),
    "antiwindup": (
        {"i": 2, "i_clamp": 1, "antiwindup": True},
        [-1, -1, 0.5, 0],
        1,
        [-1, -1, 0, 0],
    ),
    "no-antiwindup": ({"i": 2, "i_clamp": 1}, [-1, -1, 0.5, 0], 1, [-1, -1, -1, -1]),
    "negative-i": (
        {"i": -2, "i_clamp": 1, "antiwindup": True},
        [-1, -1, 0.5, 0],
        1,
        [1, 1, 0, 0],
    ),
    "pid": (
        {"p": 1, "i": 1, "d": 1, "i_clamp": 5},
        [-0.5, -0.5, 0],
        1,
        [-1.5, -1.5, -0.5],
    ),
    "i-clamp-0": ({"p": 10, "i": 5, "i_clamp": 0}, [0.1, 0.1], 0.01, [1, 1]),
    "no-i": ({"p": 1, "i_clamp": 1, "antiwindup": True}, [1, 2], 1, [1, 2]),
    "not-finite": ({"p": 1}, [1, NAN, INF, 2], 1, [1, 0, 0, 2]),
    "no-period": ({"p": 1}, [1, 1, 2], [1, 0, 1], [1, 0, 2]),
    "not-limited": ({"p": 1, "u": 1, "error_deadband": 9}, [5], 1, [5]),
}


@pytest.mark.parametrize("case", HUMBLE.values(), ids=HUMBLE)
def test_humble_integrates_first(case: Any) -> None:
    gains, errors, dt, expected = case

    commands, _, _ = run(make_pid(is_humble=True, **gains), errors, dt)

    assert commands == pytest.approx(expected, abs=1e-9)


FAULTS = [
    (
        {"u_clamp_max": -1.0, "u_clamp_min": 1.0},
        "u_clamp_min must be below u_clamp_max, got 1.0 and -1.0",
    ),
    (
        {"u_clamp_max": 1.0, "u_clamp_min": 1.0},
        "u_clamp_min must be below u_clamp_max, got 1.0 and 1.0",
    ),
    ({"u_clamp_max": NAN}, "u_clamp_min must be below u_clamp_max, got -inf and nan"),
    (
        {"i_clamp_max": -1.0, "i_clamp_min": 1.0},
        "i_clamp_min and i_clamp_max must have 0 between them, got 1.0 and -1.0",
    ),
    (
        {"i_clamp_min": 0.5},
        "i_clamp_min and i_clamp_max must have 0 between them, got 0.5 and inf",
    ),
    (
        {"tracking_time_constant": -1.0, **BACK},
        "tracking_time_constant must be at least 0, got -1.0",
    ),
    (
        {"tracking_time_constant": INF, **BACK},
        "tracking_time_constant must be at least 0, got inf",
    ),
    (
        {"antiwindup_strategy": "foo"},
        "antiwindup_strategy: expected one of 'none', 'conditional_integration', "
        "'back_calculation', 'legacy', got 'foo'",
    ),
]


@pytest.mark.parametrize(("gains", "message"), FAULTS)
def test_gains_that_contradict_each_other_are_named(gains: Any, message: str) -> None:
    with pytest.raises(ValueError, match="gains") as caught:
        Pid.from_gains([make_gains(), make_gains(**gains)])

    assert str(caught.value) == f"gains[1]: {message}"
    assert find_fault(make_gains(**gains)) == message


@pytest.mark.parametrize(
    "strategy", ["none", "conditional_integration", "back_calculation", "legacy"]
)
def test_each_strategy_is_known(strategy: str) -> None:
    assert find_fault(make_gains(antiwindup_strategy=strategy)) is None


def test_humble_wants_nothing_but_limits_in_order() -> None:
    known = make_gains(u_clamp_max=-1.0, u_clamp_min=1.0, antiwindup_strategy="foo")
    crossed = make_gains(i_clamp_max=-1.0, i_clamp_min=1.0)

    assert find_fault(known, is_humble=True) is None
    assert find_fault(crossed, is_humble=True) == (
        "i_clamp_min must not exceed i_clamp_max, got 1.0 and -1.0"
    )


def test_gains_are_what_was_given() -> None:
    first = make_gains(p=1, i=2, d=3, u=4, i_clamp=5, **CONDITIONAL)
    first.tracking_time_constant, first.error_deadband = 6.0, 7.0
    inputs = [first, PidGains(p=8.0, antiwindup=True)]

    pid = Pid.from_gains(inputs)

    for name in vars(first):
        values = getattr(pid, name)
        assert list(values) == [getattr(gains, name) for gains in inputs]


def test_a_copy_has_the_gains_and_no_history() -> None:
    pid = make_pid(p=1, i=1, d=1)
    _, _, state = run(pid, [2.0, 3.0])

    other = copy.deepcopy(pid)

    assert [other.p, other.i, other.d] == [pid.p, pid.i, pid.d] == [1.0, 1.0, 1.0]
    assert other.initial() == PidState(*np.zeros((len(state), 1)))
    assert run(other, [2.0])[0] == [4.0]


@pytest.mark.parametrize(
    ("gains", "constant"),
    [
        ({"p": 2, "i": 4, "d": 1}, 0.5),
        ({"p": 2, "i": 4}, 0.5),
        ({"p": 2, "d": 1}, 0.0),
        ({"p": 6, "i": 1, "d": 2}, math.sqrt(2.0)),
        ({"p": 2, "i": 4, "d": 1, "tracking_time_constant": 3.0}, 3.0),
        ({"p": 2, "i": 4, "d": -1}, NAN),
    ],
)
def test_a_time_constant_that_is_not_given_is_made(gains: Any, constant: float) -> None:
    made = make_pid(**gains, **BACK).tracking_time_constant

    assert made == pytest.approx([constant], nan_ok=True)


def test_a_reset_forgets_all_but_a_saved_integral() -> None:
    pid = make_pid(i=1, u=5)
    errors = [-0.5, -0.5, 0, 0, 1, 0]

    _, _, state = run(pid, errors)
    upwards, _, state = run(pid, [0.5, 0], state=pid.reset(state))
    downwards, _, state = run(pid, [-0.5, 0], state=pid.reset(state, save_i_term=False))
    saved, _, _ = run(pid, [0], state=pid.reset(state, save_i_term=True))

    assert upwards == [0, 0.5]
    assert downwards == [0, -0.5]
    assert saved == [-0.5]


def test_a_reset_forgets_error_and_command() -> None:
    pid = make_pid(p=1, i=1, d=1)
    _, _, state = run(pid, [2.0, 3.0])

    state = pid.reset(state, save_i_term=True)

    assert state.i_term == [5.0]
    assert state.command == state.error_last == state.error == state.error_rate == [0.0]


def test_each_channel_saves_its_own_integral() -> None:
    pid = Pid.from_gains([make_gains(i=1)] * 2)
    state = pid.step(pid.initial(), np.array([2.0, 3.0]), 1.0)

    state = pid.reset(state, save_i_term=np.array([False, True]))

    assert state.i_term.tolist() == [0.0, 3.0]


def test_a_given_rate_leaves_the_numeric_one_alone() -> None:
    pid = make_pid(p=1, i=1, d=1, u=5)

    state = step(pid, pid.initial(), -0.5)
    assert state.command == [-1.0]
    state = step(pid, state, -0.5, rate=0.0)
    assert (state.command, state.i_term) == ([-1.0], [-1.0])
    state = step(pid, state, -0.5, rate=0.0)
    assert (state.command, state.i_term) == ([-1.5], [-1.5])
    state = step(pid, state, -0.5, dt=0.0)
    assert (state.command, state.i_term) == ([-1.5], [-1.5])
    state = step(pid, step(pid, state, -0.7, rate=0.0), -0.5)
    # The difference to -0.5, not to -0.7.
    assert state.error_rate == [0.0]


def test_a_step_without_time_changes_nothing() -> None:
    pid = make_pid(p=1, i=1, d=1, u=5)
    before = step(pid, pid.initial(), -0.5, rate=0.0)

    assert step(pid, before, 3.0, dt=0.0) is before
    assert step(pid, before, NAN, dt=1e-17, rate=NAN) is before


@pytest.mark.parametrize("is_humble", [False, True])
@pytest.mark.parametrize("dt", [-0.01, NAN])
def test_time_does_not_go_back(dt: float, is_humble: bool) -> None:
    pid = make_pid(p=1, is_humble=is_humble)

    with pytest.raises(ValueError, match="dt") as caught:
        step(pid, pid.initial(), 1.0, dt=dt)

    assert str(caught.value) == f"dt must be at least 0, got {dt}"


@pytest.mark.parametrize("strategy", ["none", "legacy"])
@pytest.mark.parametrize("rate", [None, 0.5])
@pytest.mark.parametrize("error", [NAN, INF, -INF])
def test_an_error_that_is_not_finite_gives_nan_once(
    error: float, rate: float | None, strategy: str
) -> None:
    pid = make_pid(p=1, i=1, d=1, antiwindup_strategy=strategy)
    before = step(pid, pid.initial(), 1.0, rate=rate)

    failed = step(pid, before, error, rate=rate)
    after = step(pid, failed, 2.0, rate=rate)

    assert math.isnan(failed.command.item())
    assert (failed.i_term, failed.error_last) == (before.i_term, before.error_last)
    assert after.command == step(pid, before, 2.0, rate=rate).command
    # What is reported: a numeric derivative doesn't even see the error.
    seen = before.error.item() if rate is None else error
    assert failed.error.item() == pytest.approx(seen, nan_ok=True)


@pytest.mark.parametrize("rate", [NAN, INF])
def test_a_rate_that_is_not_finite_gives_nan_once(rate: float) -> None:
    pid = make_pid(p=1, i=1)
    before = step(pid, pid.initial(), 1.0, rate=0.0)

    failed = step(pid, before, 2.0, rate=rate)
    after = step(pid, failed, 2.0, rate=0.0)

    assert math.isnan(failed.command.item())
    assert failed.i_term == before.i_term
    assert after.command == [3.0]


def test_gains_change_while_the_state_goes_on() -> None:
    first, second = make_pid(i=1, u=5), make_pid(p=1, i=3, i_clamp=1.5)
    _, _, state = run(first, [1.0, 1.0])

    state = step(second, state, 0.5)

    # 0.5 + 2, then the integral comes within its new limits.
    assert state.command == [2.5]
    assert state.i_term == [1.5]


def test_without_an_integral_gain_the_old_integral_still_acts() -> None:
    for strategy in ("none", "legacy", "conditional_integration", "back_calculation"):
        _, _, state = run(make_pid(i=1), [1.0, 1.0])
        pid = make_pid(p=1, i_clamp=1.5, u=9, antiwindup_strategy=strategy)

        state = step(pid, step(pid, state, 0.0), 0.5)

        assert state.command == [2.0]


MIXED = [
    make_gains(p=3, i=9, d=0.1, u=1.0, i_clamp=0.7),
    make_gains(p=2, i=5, d=0.02, u=0.8, **BACK),
    make_gains(p=2, i=5, u=0.8, **CONDITIONAL),
    make_gains(p=1, i=5, d=0.1, i_clamp=0.3, error_deadband=0.2, **LEGACY),
    make_gains(p=1, d=0.1, **BACK),
    make_gains(p=1, i=2, error_deadband=0.3, u_clamp_max=0.1),
    make_gains(i=4, antiwindup=True, i_clamp=0.2, **LEGACY),
]


@pytest.mark.slow
@pytest.mark.parametrize("is_humble", [False, True])
@pytest.mark.parametrize("has_rate", [False, True])
def test_channels_do_not_touch_each_other(has_rate: bool, is_humble: bool) -> None:
    random = np.random.default_rng(4)
    pid = Pid.from_gains(MIXED, is_humble=is_humble)
    alone = [Pid.from_gains([gains], is_humble=is_humble) for gains in MIXED]
    state, states = pid.initial(), [one.initial() for one in alone]

    for _ in range(300):
        errors, rates = random.normal(size=(2, len(MIXED)))
        dt = random.choice([0.0, 0.01, 0.03])
        if random.random() < 0.2:
            errors[random.integers(len(MIXED))] = random.choice([NAN, INF, -INF])
            rates[random.integers(len(MIXED))] = random.choice([NAN, INF, -INF])
        where = random.random(len(MIXED)) < 0.8 if random.random() < 0.3 else None
        state = pid.step(state, errors, dt, rates if has_rate else None, where=where)
        for k, one in enumerate(alone):
            if where is None or where[k]:
                rate = rates[k].item() if has_rate else None
                states[k] = step(one, states[k], errors[k], dt, rate)

        for together, *separate in zip(state, *states, strict=True):
            assert together.tolist() == pytest.approx(
                np.concatenate(separate).tolist(), rel=1e-12, abs=1e-15, nan_ok=True
            )


def test_channels_that_do_not_step_stay_as_they_are() -> None:
    pid = Pid.from_gains([make_gains(p=1, i=1)] * 2)
    before = pid.step(pid.initial(), np.array([1.0, 2.0]), 1.0)

    after = pid.step(before, np.array([3.0, NAN]), 1.0, where=np.array([True, False]))

    assert [field[1] for field in after] == [field[1] for field in before]
    assert after.command[0] == 4.0


@pytest.mark.parametrize("gains", MIXED)
def test_steps_leave_states_and_arguments_alone(gains: Any) -> None:
    pid = Pid.from_gains([gains])
    before = step(pid, pid.initial(), 0.5)
    kept = copy.deepcopy(before)
    error, rate = np.array([1.0]), np.array([2.0])

    after = pid.step(before, error, 0.01, rate)
    error[0] = rate[0] = 9.0

    assert before == kept
    assert (after.error, after.error_rate) == ([1.0], [2.0])


def test_no_pid_at_all_commands_nothing() -> None:
    pid = Pid.from_gains([])

    state = pid.step(pid.initial(), np.zeros(0), 0.01)

    assert state.command.shape == pid.reset(state).command.shape == (0,)


@pytest.mark.parametrize("has_rates", [False, True])
@pytest.mark.parametrize("strategies", [("none",), ("legacy",), STRATEGIES])
def test_plain_numbers_are_the_same_bit_by_bit(
    strategies: tuple[str, ...], has_rates: bool
) -> None:
    rng = np.random.default_rng(len(strategies) + has_rates)
    winds = 0
    for trial in range(30):
        gains = [
            make_gains(
                p=rng.uniform(-3.0, 9.0),
                # A trial in three has no integral at all, one in two no limits.
                i=rng.choice([0.0, rng.uniform(0.1, 20.0)]) * (trial % 3 > 0),
                d=rng.uniform(0.0, 0.1),
                antiwindup_strategy=str(rng.choice(strategies)),
                tracking_time_constant=rng.uniform(0.01, 0.5),
                error_deadband=rng.choice([0.0, 0.3]) * (trial % 5 > 0),
                **({"u": rng.uniform(0.5, 3.0)} if trial % 2 else {}),
                **({"i_clamp": rng.uniform(0.1, 1.0)} if trial % 4 > 1 else {}),
            )
            for _ in range(5)
        ]
        pid = Pid.from_gains(gains)
        plain, state = PlainPids(pid, 0.01), pid.initial()
        memory = [0.0] * 25
        for _ in range(40):
            error = rng.uniform(-1.0, 1.0, size=5)
            rate = rng.uniform(-9.0, 9.0, size=5) if has_rates else None
            unwound = state.i_term
            state = pid.step(state, error, 0.01, rate)
            rates = None if rate is None else rate.tolist()

            assert plain.step(memory, error.tolist(), rates) == state.command.tolist()
            assert memory == np.concatenate(state).tolist()
            winds += bool((state.i_term != unwound).any())
    assert winds > 500


def test_plain_numbers_leave_what_is_not_finite_to_others() -> None:
    plain = PlainPids(make_pid(p=1.0), 0.01)
    memory = [0.0] * 5

    assert plain.step(memory, [NAN], None) is None
    assert memory == [0.0] * 5
    assert not PlainPids.are_plain(make_pid(p=1.0, is_humble=True))
    assert not PlainPids.are_plain(
        make_pid(i=1.0, antiwindup_strategy="back_calculation")
    )
