"""Confidence intervals of a rate, and of a mean."""

import bisect
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from arm_drake.errors import InputError


class Interval(NamedTuple):
    """A value that was found, and between which it is with some confidence."""

    value: float
    low: float
    high: float


def rate_interval(
    successes: int, number: int, confidence: float = 0.95, *, sides: int = 2
) -> Interval:
    """Return a rate of success with Wilson's interval.

    Args:
        successes: How many of the runs did.
        number: How many runs there were, at least one.
        confidence: Of the interval, between 0 and 1.
        sides: 2; or 1 for a lower bound alone, with an upper one of 1.
    """
    check_confidence(confidence)
    if not 0 <= successes <= number or number < 1:
        raise InputError(f"expected successes of runs, got {successes} of {number}")
    # Not at the top: it takes a while to import.
    from scipy.stats import binomtest

    kind = "two-sided" if sides == 2 else "greater"
    test = binomtest(successes, number, alternative=kind)
    found = test.proportion_ci(confidence, method="wilson")
    return Interval(successes / number, float(found.low), float(found.high))


def mean_interval(values: Sequence[float], confidence: float = 0.95) -> Interval:
    """Return the mean of some numbers, with Student's interval; inf of fewer than 2."""
    check_confidence(confidence)
    numbers = np.asarray(values, dtype=float)
    if numbers.size == 0:
        raise InputError("expected numbers to take the mean of, got none")
    from scipy.stats import t

    mean = float(numbers.mean())
    if numbers.size < 2:
        return Interval(mean, -math.inf, math.inf)
    error = float(numbers.std(ddof=1)) / math.sqrt(numbers.size)
    half = float(t.ppf(0.5 + confidence / 2.0, numbers.size - 1)) * error
    return Interval(mean, mean - half, mean + half)


def most_failures(number: int, at_least: float, confidence: float) -> int:
    """Return how many of some runs may fail for a rate to be shown; -1 if none may."""

    def is_too_many(failures: int) -> bool:
        found = rate_interval(number - failures, number, confidence, sides=1)
        return found.low < at_least

    return bisect.bisect_left(range(number), True, key=is_too_many) - 1


def check_confidence(confidence: float) -> None:
    """Raise InputError for what is none."""
    if not 0.0 < confidence < 1.0:
        text = f"confidence: expected a number between 0 and 1, got {confidence!r}"
        raise InputError(text)
