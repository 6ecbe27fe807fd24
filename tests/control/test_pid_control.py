import numpy as np
import pytest

from arm_drake.controllers.pid_controller import DofGains, PidControl

NAN = np.nan


def make_control(*, has_rate: bool = False, **gains: float) -> PidControl:
    one = DofGains(p=2.0, antiwindup_strategy="none", **gains)
    return PidControl.from_gains([one, one], has_rate=has_rate)


def test_a_command_is_gain_times_error() -> None:
    control = make_control()

    state = control.step(
        control.initial(), np.array([1.0, 2.0]), np.array([0.5, 0.0]), 0.01
    )

    np.testing.assert_array_equal(state.command, [1.0, 4.0])
    np.testing.assert_array_equal(state.error, [0.5, 2.0])
    np.testing.assert_array_equal(state.output, state.command)


def test_where_something_is_unknown_nothing_is_commanded() -> None:
    control = make_control(i=10.0, feedforward_gain=1.0)
    references = np.array([1.0, NAN])
    state = control.start(control.initial(), references, np.array([7.0, 8.0]))

    state = control.step(state, references, np.zeros(2), 0.01)

    np.testing.assert_array_equal(state.command, [2.0 + 1.0, NAN])
    np.testing.assert_array_equal(state.output, [3.0, 8.0])
    # The integral of the known one alone has grown.
    np.testing.assert_allclose(state.pid.i_term, [0.1, 0.0])


@pytest.mark.parametrize("has_rate", [False, True])
def test_an_unknown_rate_feeds_nothing_forward(has_rate: bool) -> None:
    control = make_control(has_rate=has_rate, feedforward_gain=3.0)
    references = np.array([1.0, 1.0, 5.0, NAN] if has_rate else [1.0, 1.0])

    state = control.step(control.initial(), references, np.zeros(len(references)), 0.01)

    expected = [2.0 + 15.0, 2.0] if has_rate else [2.0 + 3.0, 2.0 + 3.0]
    np.testing.assert_array_equal(state.command, expected)


def test_integrals_that_are_saved_stay() -> None:
    gains = [DofGains(i=1.0, save_i_term=saves) for saves in (True, False)]
    control = PidControl.from_gains(gains, has_rate=False)
    state = control.step(control.initial(), np.ones(2), np.zeros(2), 1.0)

    state = control.start(state, np.zeros(2), np.zeros(2))

    np.testing.assert_array_equal(state.pid.i_term, [1.0, 0.0])


def test_bad_gains_are_refused() -> None:
    with pytest.raises(ValueError, match="u_clamp_min must be below u_clamp_max"):
        make_control(u_clamp_max=-1.0, u_clamp_min=1.0)
