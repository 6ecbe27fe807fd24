"""Gazebo's PID against numbers by hand; they are sums of powers of 2, so exact."""

from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.gazebo.plugin import GazeboPid

DT = 0.5

# Limits of which the maximum is below the minimum.
NONE: dict[str, float] = {"i_max": -1.0, "i_min": 0.0, "cmd_max": -1.0, "cmd_min": 0.0}


def make_pid(*gains: dict[str, float]) -> GazeboPid:
    """Return a PID for each set of gains; without limits unless they say so."""
    defaults = {"p": 0.0, "i": 0.0, "d": 0.0, **NONE, "cmd_offset": 0.0}
    full = [{**defaults, **own} for own in gains]
    return GazeboPid.from_gains(**{name: [g[name] for g in full] for name in defaults})


def run(pid: GazeboPid, *errors: Any, dt: float = DT) -> list[list[float]]:
    """Return the commands of one step after the other."""
    state, commands = pid.initial(), []
    for error in errors:
        state, command = pid.step(state, np.atleast_1d(np.array(error, float)), dt)
        commands.append(command.tolist())
    return commands


def test_a_command_works_against_the_error() -> None:
    assert run(make_pid({"p": 2.0}), 1.0, -0.25) == [[-2.0], [0.5]]


def test_an_integral_acts_at_once() -> None:
    # i dt = 2: 2 * 1, then 2 * (1 - 0.5), then 2 * (1 - 0.5 + 3).
    assert run(make_pid({"i": 4.0}), 1.0, -0.5, 3.0) == [[-2.0], [-1.0], [-7.0]]


def test_the_first_derivative_starts_from_an_error_of_0() -> None:
    assert run(make_pid({"d": 0.5}), 1.0, -0.5, -0.5) == [[-1.0], [1.5], [0.0]]


def test_all_terms_and_the_offset_add_up() -> None:
    pid = make_pid({"p": 2.0, "i": 4.0, "d": 0.5, "cmd_offset": 0.25})

    # -2 - 2 - 1, then 1 - 1 + 1.5, then -6 - 7 - 3.5.
    assert run(pid, 1.0, -0.5, 3.0) == [[-4.75], [1.75], [-16.25]]


def test_the_limits_of_the_integral_are_those_of_its_contribution() -> None:
    pid = make_pid({"i": 4.0, "i_max": 5.0, "i_min": -1.0})

    # 8 is cut to 5, and 5 - 2 is 3: what is cut off is forgotten; -5 is cut to -1.
    assert run(pid, 4.0, -1.0, -4.0) == [[-5.0], [-3.0], [1.0]]


def test_the_limits_of_the_command_hold_after_the_offset() -> None:
    pid = make_pid({"p": 1.0, "cmd_max": 2.0, "cmd_min": -3.0, "cmd_offset": 1.0})

    assert run(pid, 5.0, -5.0, -0.5) == [[-3.0], [2.0], [1.5]]


def test_equal_limits_are_limits() -> None:
    pid = make_pid({"p": 1.0, "cmd_max": 0.5, "cmd_min": 0.5})

    assert run(pid, 5.0, -5.0) == [[0.5], [0.5]]


def test_limits_of_the_wrong_order_are_none() -> None:
    gains = {"p": 1.0, "i": 2.0, "cmd_max": -4.0, "cmd_min": 4.0}

    assert run(make_pid({**gains, "i_max": -4.0, "i_min": 4.0}), 64.0) == [[-128.0]]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_error_that_is_not_finite_commands_0_and_changes_nothing(bad: float) -> None:
    pid = make_pid({"p": 2.0, "i": 4.0, "d": 0.5, "cmd_offset": 0.25})

    assert run(pid, 1.0, bad, -0.5) == [[-4.75], [0.0], [1.75]]


def test_an_integral_is_limited_only_in_steps_that_count() -> None:
    pid = make_pid({"i": 4.0, "i_max": 2.0, "i_min": 1.0})

    after, _ = pid.step(pid.initial(), np.array([np.nan]), DT)

    assert after.i_term.tolist() == [0.0]


def test_a_rate_that_is_not_finite_commands_0_and_changes_nothing() -> None:
    pid = make_pid({"p": 2.0, "d": 0.5})

    # 1e308 / 0.5 is beyond all floats.
    assert run(pid, 1.0, 1e308, -0.5) == [[-3.0], [0.0], [2.5]]


def test_without_time_the_command_is_0_and_nothing_changes() -> None:
    pid = make_pid({"p": 2.0, "cmd_offset": 0.25})
    state = pid.initial()

    after, command = pid.step(state, np.array([1.0]), 0.0)

    assert command.tolist() == [0.0]
    assert after is state


GAINS = (
    {"p": 1.0, "i": 2.0, "i_max": 1.0, "i_min": -1.0},
    {"d": 4.0, "cmd_offset": -1.0},
    {"p": 0.5, "cmd_max": 0.5, "cmd_min": -0.5},
)
ERRORS = ([1.0, -2.0, 8.0], [4.0, np.nan, -0.25], [-0.5, 0.125, np.inf])


def test_many_pids_are_as_many_single_ones() -> None:
    together = np.array(run(make_pid(*GAINS), *ERRORS))

    for k, gains in enumerate(GAINS):
        alone = run(make_pid(gains), *(errors[k] for errors in ERRORS))
        assert together[:, k].tolist() == [command for (command,) in alone]


def test_pids_that_do_not_step_stay_and_command_0() -> None:
    pid = make_pid({"p": 1.0, "i": 2.0}, {"p": 1.0, "i": 2.0})
    state, _ = pid.step(pid.initial(), np.array([1.0, 1.0]), DT)

    after, command = pid.step(
        state, np.array([3.0, 3.0]), DT, where=np.array([False, True])
    )

    # The second one's integral is 1 + 3.
    assert command.tolist() == [0.0, -7.0]
    assert after.i_term.tolist() == [1.0, 4.0]
    assert after.error_last.tolist() == [1.0, 3.0]


def test_a_state_does_not_change_with_the_arrays_it_came_from() -> None:
    pid = make_pid({"p": 1.0, "d": 1.0})
    error = np.array([1.0])
    before = pid.initial()

    state, _ = pid.step(before, error, DT)
    error[0] = 99.0
    pid.step(state, np.array([5.0]), DT)

    assert before.error_last.tolist() == [0.0]
    assert state.error_last.tolist() == [1.0]
