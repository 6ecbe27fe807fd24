"""Periods of ticks and steps that meet exactly.

Drake computes the times of periodic events as k * period, in floating point. The steps
of the plant and the ticks of a manager meet only if their periods are exact multiples
of each other; else a command acts a step late now and then.
"""

import math
from collections.abc import Sequence
from fractions import Fraction

# A common step below this part of the largest one isn't worth it.
_SMALLEST_PART = Fraction(1, 10)

# Part of a period by which an event may miss its time.
_TOLERANCE = 1e-6


def choose_time_step(
    wanted: float, update_rates: Sequence[int]
) -> tuple[float, list[float]]:
    """Return the step of the plant and the periods of the managers.

    Args:
        wanted: Largest step [s].
        update_rates: Rates of the managers [Hz].

    Returns:
        The step [s], at most ``wanted``, that divides every manager's period, and these
        periods [s] as exact multiples of it. Where no step of reasonable size divides
        all of them, the first one's is divided.
    """
    if not update_rates:
        return wanted, []
    # No manager ticks more often than the plant steps.
    fastest = Fraction(1, max(update_rates))
    largest = min(Fraction(wanted).limit_denominator(10**9), fastest)
    common = Fraction(1, math.lcm(*update_rates))
    if common < _SMALLEST_PART * largest:
        common = Fraction(1, update_rates[0])
    exact = common / math.ceil(common / largest)
    multiples = [round(Fraction(1, rate) / exact) for rate in update_rates]
    step = _round_up(float(exact), max(multiples).bit_length())
    return step, [step * multiple for multiple in multiples]


def cycle_at(time: float, period: float) -> int | None:
    """Return the number of the cycle that is at a time, or None between two cycles.

    Args:
        time: Drake's time [s].
        period: Period of the cycles [s].
    """
    cycles = time / period
    number = round(cycles)
    return number if abs(cycles - number) <= _TOLERANCE else None


def has_rate(period: float, rate: int) -> bool:
    """Return whether cycles of a period [s] come at a rate [Hz], but for rounding."""
    return abs(rate * period - 1.0) < _TOLERANCE


def _round_up(value: float, bits: int) -> float:
    """Return the next number whose last bits are 0, so that multiples are exact.

    Upwards, so that an event never comes before its time in decimals.
    """
    mantissa, exponent = math.frexp(value)
    scale = 2.0 ** (53 - bits)
    return math.ldexp(math.ceil(mantissa * scale) / scale, exponent)
