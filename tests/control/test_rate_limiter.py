import dataclasses as dc
import math
from typing import Any

import pytest

from arm_drake.control.filters import RateLimiter

NAN = math.nan
DT = 0.5


def make_limiter(
    value: Any = (NAN, NAN),
    acceleration: Any = (NAN, NAN),
    deceleration: Any = (NAN, NAN),
    jerk: Any = (NAN, NAN),
) -> RateLimiter:
    return RateLimiter(*value, *acceleration, *deceleration, *jerk)


ALL = {"value": (-0.5, 1), "acceleration": (-0.5, 1), "jerk": (-2, 5)}
NO_VALUE = {"acceleration": (-0.5, 1), "jerk": (-2, 2)}
NO_VALUE_SLOW_REVERSE = {"acceleration": (-0.5, 1), "jerk": (-0.5, 5)}
JERK = {"jerk": (-0.5, 5)}
LOW_JERK = {"value": (-0.5, 1), "acceleration": (-0.5, 1), "jerk": (-1, 1)}
BRAKES = {"value": (-0.5, 1), "acceleration": (-0.5, 1), "deceleration": (-5, 10)}


@pytest.mark.parametrize(
    ("limits", "v", "limited"),
    [
        (ALL, 10, 1),
        (ALL, -10, -0.5),
        (ALL, 0.7, 0.7),
        (NO_VALUE_SLOW_REVERSE, 10, 10),
        (NO_VALUE_SLOW_REVERSE, -10, -10),
        ({"value": (0.3, NAN)}, 0.1, 0.1),
        ({"value": (NAN, 1)}, -10, -1),
        ({}, -10, -10),
    ],
)
def test_a_value_stays_within_its_limits(limits: Any, v: float, limited: float) -> None:
    result = make_limiter(**limits).limit_value(v)

    assert result == pytest.approx((limited, limited / v), rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "v", "v0", "limited"),
    [
        (ALL, 10, 0, 0.5),
        (ALL, -10, 0, -0.25),
        (BRAKES, 10, 5, 5.5),
        (BRAKES, -10, 5, 2.5),
        (BRAKES, 10, -5, 0),
        (BRAKES, -10, -5, -5.25),
        # From 0 both ways are speeding up.
        (BRAKES, 10, 0, 0.5),
        (BRAKES, -10, 0, -0.25),
        # Without limits of its own, braking is as speeding up.
        (ALL, -10, 5, 4.75),
        (ALL, 10, -5, -4.5),
        ({"acceleration": (NAN, 1)}, -10, 0, -0.5),
        ({"acceleration": (-0.1, NAN), "deceleration": (-5, 10)}, 10, 5, 10),
        ({}, 10, 0, 10),
    ],
)
def test_the_first_derivative_stays_within_its_limits(
    limits: Any, v: float, v0: float, limited: float
) -> None:
    result = make_limiter(**limits).limit_first_derivative(v, v0, DT)

    assert result == pytest.approx((limited, limited / v), rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "v", "v0", "v1", "limited"),
    [
        (JERK, 10, 0, 0, 1.25),
        (JERK, -10, 0, 0, -0.125),
        (LOW_JERK, 10, 0, 0, 0.25),
        (LOW_JERK, -10, 0, 0, -0.25),
        # From 1 at a step of 1: to 2, and as much more as the jerk allows.
        (LOW_JERK, 10, 1, 0, 2.25),
        # A first derivative that is to shrink isn't limited.
        (LOW_JERK, 1.1, 1, 0, 1.1),
        ({"jerk": (NAN, 2)}, -10, 0, 0, -0.5),
        ({"jerk": (-2, NAN)}, -10, 0, 0, -10),
        ({}, 10, 0, 0, 10),
    ],
)
def test_the_second_derivative_stays_within_its_limits(
    limits: Any, v: float, v0: float, v1: float, limited: float
) -> None:
    result = make_limiter(**limits).limit_second_derivative(v, v0, v1, DT)

    assert result == pytest.approx((limited, limited / v), rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "v", "limited"),
    [
        (ALL, 10, 0.5),
        (ALL, -10, -0.25),
        (NO_VALUE, 10, 0.5),
        (NO_VALUE, -10, -0.25),
        (NO_VALUE_SLOW_REVERSE, 10, 0.5),
        (NO_VALUE_SLOW_REVERSE, -10, -0.125),
        (LOW_JERK, 10, 0.25),
        (LOW_JERK, -10, -0.25),
        ({"value": (-0.2, 0.1), **NO_VALUE}, 10, 0.1),
        ({}, 10, 10),
        ({}, -10, -10),
    ],
)
def test_the_strictest_limit_binds(limits: Any, v: float, limited: float) -> None:
    result = make_limiter(**limits).limit(v, 0.0, 0.0, DT)

    assert result == pytest.approx((limited, limited / v), rel=1e-12)


def test_the_factor_of_0_is_1() -> None:
    limiter = make_limiter(**ALL)

    assert limiter.limit_value(0.0) == (0.0, 1.0)
    assert limiter.limit_first_derivative(0.0, 5.0, DT) == (4.75, 1.0)
    assert limiter.limit_second_derivative(0.0, 0.0, 0.0, DT) == (0.0, 1.0)
    assert limiter.limit(0.0, 5.0, 5.0, DT) == (1.0, 1.0)


def test_nan_is_not_taken_for_a_limit() -> None:
    assert math.isnan(make_limiter(**ALL).limit(NAN, 0.0, 0.0, DT).value)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"value": (1.0, -1.0)}, "min_value must not exceed max_value, got 1.0 and -1"),
        ({"value": (NAN, -2.0)}, "min_value must not exceed max_value, got 2.0 and -2"),
        (
            {"acceleration": (1.0, -1.0)},
            "min_first_derivative_neg must not exceed max_first_derivative_pos, "
            "got 1.0 and -1",
        ),
        (
            {"acceleration": (-1.0, 1.0), "deceleration": (1.0, -1.0)},
            "min_first_derivative_pos must not exceed max_first_derivative_neg, "
            "got 1.0 and -1",
        ),
        (
            {"jerk": (1.0, -1.0)},
            "min_second_derivative must not exceed max_second_derivative, "
            "got 1.0 and -1",
        ),
    ],
)
def test_crossed_limits_are_named(limits: Any, message: str) -> None:
    with pytest.raises(ValueError, match="must not exceed") as caught:
        make_limiter(**limits)

    assert str(caught.value) == f"{message}.0"


def test_braking_limits_do_not_matter_without_those_of_speeding_up() -> None:
    limiter = make_limiter(deceleration=(1.0, -1.0))

    assert limiter.limit_first_derivative(10.0, 5.0, DT) == (10.0, 1.0)


def test_limits_that_are_not_given_are_made_from_others() -> None:
    limiter = make_limiter(value=(NAN, 1.0), acceleration=(-2.0, 3.0), jerk=(NAN, 4.0))

    expected = (-1.0, 1.0, -2.0, 3.0, -2.0, 3.0, -4.0, 4.0)
    assert dc.astuple(limiter) == expected
