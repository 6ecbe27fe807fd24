"""Periods of ticks and steps that meet exactly.

Drake computes the times of periodic events as k * period, in floating point. The steps
of the plant and the ticks of a manager meet only if their periods are exact multiples
of each other; else a command acts a step late now and then.
"""

import functools
import math
from collections.abc import Sequence

# A common step below this part of the largest one isn't worth it.
_SMALLEST_PART = 0.1

# Part of a period by which an event may miss its time.
TOLERANCE = 1e-6

# A log of more steps than that, or of parts of steps smaller than these, needn't meet
# ticks: it would cost precision of the steps' own times.
_MOST_STEPS, _MOST_PARTS = 100_000, 100

_NANOSECONDS = 1_000_000_000


def choose_time_step(
    max_step: float, update_rates: Sequence[int], log_rate: float | None = None
) -> tuple[float, list[float]]:
    """Return the step of the plant and the periods of the managers [s].

    The step is at most `max_step` [s] and divides every manager's period; these are
    exact multiples of it. Where no step of reasonable size divides all of them, the
    first one's is divided. Rates are [Hz]; for that of a log see `fit_period`.
    """
    if not update_rates:
        return max_step, []
    # No manager ticks more often than the plant steps.
    largest = min(max_step, 1.0 / max(update_rates))
    # All steps are exact parts of a second.
    common = math.lcm(*update_rates)
    if _without_noise(_SMALLEST_PART * largest * common) > 1.0:
        common = update_rates[0]
    steps = common * math.ceil(_without_noise(1.0 / (common * largest)))
    multiples = [round(steps / rate) for rate in update_rates]
    # A log's period is an exact multiple of a part of the step.
    ratio = None if log_rate is None else _ratio(log_rate, 1.0 / steps)
    logged, parts = ratio or (1, 1)
    bits = (parts * max([*multiples, logged])).bit_length()
    step = parts * _round_up(1.0 / steps / parts, bits)
    return step, [step * multiple for multiple in multiples]


def _without_noise(value: float) -> float:
    """Return an integer for a number that rounding alone keeps from being one."""
    nearest = round(value)
    return nearest if abs(value - nearest) <= 1e-9 * value else value


def fit_period(rate: float, step: float) -> float:
    """Return the period of a rate [s], as an exact fraction of a step if it is one.

    What happens at such a period comes at the same instant as a tick, and not a
    rounding error earlier, when the tick's command isn't there yet. The rate is in
    [Hz], the plant's step in [s].
    """
    ratio = _ratio(rate, step)
    if ratio is None:
        return 1.0 / rate
    steps, parts = ratio
    return steps * (step / parts)


def _ratio(rate: float, step: float) -> tuple[int, int] | None:
    """Return a rate's period per step, as numerator and denominator.

    The denominator is at most `_MOST_PARTS`; None if no such fraction is near.
    """
    steps = 1.0 / (rate * step)
    if steps > _MOST_STEPS:
        return None
    parts = min(
        range(1, _MOST_PARTS + 1), key=lambda n: abs(round(steps * n) / n - steps)
    )
    number = round(steps * parts)
    is_near = abs(number / parts - steps) <= TOLERANCE * steps
    divisor = math.gcd(number, parts)
    return (number // divisor, parts // divisor) if number and is_near else None


def cycle_at(time: float, period: float) -> int | None:
    """Return the number of the cycle at a time [s], or None between two cycles."""
    cycles = time / period
    number = round(cycles)
    return number if abs(cycles - number) <= TOLERANCE else None


def cycle_time(number: int, period: float, rate: int) -> int:
    """Return the time of a cycle [ns], by its nominal rate [Hz] and period [s]."""
    if has_rate(period, rate):
        return number * _NANOSECONDS // rate
    # Another robot's manager has the say about the steps.
    return round(number * period * _NANOSECONDS)


def cycle_times(number: int, period: float, rate: int) -> tuple[int, int]:
    """Return the time of a cycle, and the time since the last one [ns].

    Arguments are those of `cycle_time`.
    """
    time_ns = cycle_time(number, period, rate)
    return time_ns, time_ns - cycle_time(number - 1, period, rate)


@functools.cache
def has_rate(period: float, rate: int) -> bool:
    """Return whether cycles of a period [s] come at a rate [Hz], but for rounding."""
    return abs(rate * period - 1.0) < TOLERANCE


def _round_up(value: float, bits: int) -> float:
    """Return the next number whose last bits are 0, so that multiples are exact.

    Upwards, so that an event never comes before its time in decimals.
    """
    mantissa, exponent = math.frexp(value)
    scale = 2.0 ** (53 - bits)
    return math.ldexp(math.ceil(mantissa * scale) / scale, exponent)
