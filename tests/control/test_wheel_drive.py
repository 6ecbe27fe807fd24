"""The servo of a wheel bears the base and the wheel alone."""

import math

import numpy as np
import pytest

from arm_drake.control.servo import compute_load_inertia

BANDWIDTH = 40.0


def errors(ratio: float, time_step: float, gain: float) -> list[float]:
    """Return the velocity errors of a wheel after a step, as the servo moves it.

    Args:
        ratio: Its inertia over the one that the servo counts with.
        time_step: Step h [s].
        gain: Gain of the observer.
    """
    h, kv = time_step, (1.0 - math.exp(-BANDWIDTH * time_step)) / time_step
    v = w = 0.0
    found = []
    for _ in range(2000):
        disturbance = w - gain * v / h
        u = kv * (1.0 - v) + disturbance
        w = (1.0 - gain) * disturbance + gain * (v / h + u)
        v += h * u / ratio
        found.append(1.0 - v)
    return found


@pytest.mark.parametrize("time_step", [1e-3, 2e-3, 5e-3, 1e-2])
@pytest.mark.parametrize("gain", [0.2, 0.8])
def test_a_wheel_in_the_air_reaches_its_speed_without_ringing(
    time_step: float, gain: float
) -> None:
    (added,) = compute_load_inertia(
        np.array([0.01]),
        np.array([1e3]),
        bandwidth=BANDWIDTH,
        time_step=time_step,
        observer_gain=gain,
    )

    found = np.abs(errors(0.01 / (0.01 + added), time_step, gain))

    # Of the roots one is 0 and the other one between 0 and 1, so from the second step
    # on the error falls at every step.
    assert (np.diff(found[1:]) <= 1e-12).all()
    assert found[-1] < 1e-6


def test_a_base_on_the_ground_overshoots_less() -> None:
    wheels, load_inertia = np.array([1e-4]), np.array([14e-4])
    (added,) = compute_load_inertia(
        wheels, load_inertia, bandwidth=BANDWIDTH, time_step=1e-3, observer_gain=0.2
    )

    before = -min(errors(15.0, 1e-3, 0.2))
    after = -min(errors(15e-4 / (1e-4 + added), 1e-3, 0.2))

    # A damping of 0.34 and one of 0.71; overshoots are exp(-pi d / sqrt(1 - d^2)),
    # with a zero of the observer that makes them larger.
    assert before > math.exp(-math.pi * 0.34 / math.sqrt(1.0 - 0.34**2))
    assert after < 0.5 * before


def test_no_more_is_added_than_there_is_to_carry() -> None:
    added = compute_load_inertia(
        np.array([1.0, 1.0, 1.0]),
        np.array([0.0, 0.5, 1e3]),
        bandwidth=BANDWIDTH,
        time_step=1e-3,
        observer_gain=0.2,
    )

    # The servo counts with 1 / (c + b - b c) times the wheel's inertia.
    c = 1.0 - math.exp(-0.04)
    assert added == pytest.approx([0.0, 0.5, 1.0 / (0.2 + 0.8 * c) - 1.0])
