"""Filters of measurements, n channels at a time.

The rules are those of control_toolbox's ``LowPassFilter``, ``ExponentialFilter`` and
``RateLimiter`` (version 6.3.0) for numbers: each channel is a filter of its own. Those
of ROS's package `filters` are in `sample_filters`.
"""

import dataclasses as dc
import math
from typing import NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.rate_limiter import RateLimiter


class FilterState(NamedTuple):
    """What a filter of n channels remembers; arrays of shape (n,), never changed."""

    # The last sample.
    sample: Array

    # What came out; NaN where there has been nothing to start from.
    output: Array

    @classmethod
    def initial(cls, n: int) -> Self:
        """Return the state of n channels before the first sample."""
        nothing = np.full(n, np.nan)
        return cls(nothing, nothing)


@dc.dataclass(frozen=True)
class LowPassFilter:
    """A low-pass filter of first order: y_k = b x_(k-1) + a y_(k-1).

    With x the samples and y the outputs,
    a = exp(-2 pi damping_frequency 10^(damping_intensity / 10) / sampling_frequency)
    and b = 1 - a.
    """

    # How often there is a sample [Hz], above 0.
    sampling_frequency: float

    # Where the filter starts to damp [Hz], above 0, and how much, finite.
    damping_frequency: float
    damping_intensity: float

    # The coefficient a.
    a: float = dc.field(init=False)

    def __post_init__(self) -> None:
        """Compute the coefficient.

        Raises:
            ValueError: If a parameter is out of range.
        """
        for name in ("sampling_frequency", "damping_frequency"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} must be above 0, got {value}")
        if not math.isfinite(self.damping_intensity):
            raise ValueError(
                f"damping_intensity must be finite, got {self.damping_intensity}"
            )
        decay = 2.0 * math.pi * self.damping_frequency / self.sampling_frequency
        # Far below the bound everything passes already; 10^309 is too large a float.
        decay *= 10.0 ** min(self.damping_intensity / 10.0, 300.0)
        object.__setattr__(self, "a", math.exp(-decay))

    @staticmethod
    def initial(n: int) -> FilterState:
        """Return the state of n channels before the first sample."""
        return FilterState.initial(n)

    def update(self, state: FilterState, sample: Array) -> FilterState:
        """Return the state after a sample; it holds the output.

        The first finite sample of a channel is its output. Later a NaN makes the next
        output NaN, and the finite sample after that is the first one again.

        Args:
            state: The state so far.
            sample: What is measured, shape (n,).
        """
        sample = np.array(sample, dtype=float)
        last, output = _start(state, sample)
        # An infinite sample may meet one of the other sign.
        with np.errstate(invalid="ignore"):
            return FilterState(sample, (1.0 - self.a) * last + self.a * output)


@dc.dataclass(frozen=True)
class ExponentialFilter:
    """Exponential smoothing: y_k = alpha x_k + (1 - alpha) y_(k-1).

    With x the samples and y the outputs.
    """

    # How much of a new sample passes, from 0 to 1.
    alpha: float

    def __post_init__(self) -> None:
        """Check the parameter.

        Raises:
            ValueError: If it is out of range.
        """
        if not 0.0 <= self.alpha <= 1.0:
            raise ValueError(f"alpha must be from 0 to 1, got {self.alpha}")

    @staticmethod
    def initial(n: int) -> FilterState:
        """Return the state of n channels before the first sample."""
        return FilterState.initial(n)

    def update(self, state: FilterState, sample: Array) -> FilterState:
        """Return the state after a sample; it holds the output.

        The first finite sample of a channel is its output. A later NaN is an output,
        and the next finite sample is the first one again.

        Args:
            state: The state so far.
            sample: What is measured, shape (n,).
        """
        sample = np.array(sample, dtype=float)
        _, output = _start(state, sample)
        # An infinite sample may meet one of the other sign, or a factor of 0.
        with np.errstate(invalid="ignore"):
            smooth = self.alpha * sample + (1.0 - self.alpha) * output
        return FilterState(sample, smooth)


class LimiterState(NamedTuple):
    """What a rate limiter of n channels remembers; arrays of shape (n,)."""

    # The last output but one.
    before: Array

    # What came out; NaN where there has been nothing to start from.
    output: Array


@dc.dataclass(frozen=True)
class RateLimiterFilter:
    """A `RateLimiter` whose last values are its own outputs.

    It begins at its first sample, as if it had been there before. NaN is no limit.
    """

    # Time between samples [s], above 0.
    sampling_interval: float

    # As in RateLimiter; a maximum isn't below 0, a minimum not above.
    max_value: float = math.nan
    min_value: float = math.nan
    max_first_derivative_pos: float = math.nan
    min_first_derivative_pos: float = math.nan
    max_first_derivative_neg: float = math.nan
    min_first_derivative_neg: float = math.nan
    max_second_derivative: float = math.nan
    min_second_derivative: float = math.nan

    _limiter: RateLimiter = dc.field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Make the limiter.

        Raises:
            ValueError: If a parameter is out of range.
        """
        if not 0.0 < self.sampling_interval < math.inf:
            raise ValueError(
                f"sampling_interval must be above 0, got {self.sampling_interval}"
            )
        limits = {
            field.name: getattr(self, field.name) for field in dc.fields(RateLimiter)
        }
        for name, limit in limits.items():
            if name.startswith("max") and limit < 0.0:
                raise ValueError(f"{name} must not be below 0, got {limit}")
            if name.startswith("min") and limit > 0.0:
                raise ValueError(f"{name} must not be above 0, got {limit}")
        object.__setattr__(self, "_limiter", RateLimiter(**limits))

    @staticmethod
    def initial(n: int) -> LimiterState:
        """Return the state of n channels before the first sample."""
        nothing = np.full(n, np.nan)
        return LimiterState(nothing, nothing)

    def update(self, state: LimiterState, sample: Array) -> LimiterState:
        """Return the state after a sample; it holds the output.

        Args:
            state: The state so far.
            sample: What is measured, shape (n,).
        """
        is_new = np.isnan(state.output)
        last = np.where(is_new, sample, state.output)
        before = np.where(is_new, sample, state.before)
        columns = zip(sample.tolist(), last.tolist(), before.tolist(), strict=True)
        limit, period = self._limiter.limit, self.sampling_interval
        output = [limit(v, v0, v1, period).value for v, v0, v1 in columns]
        return LimiterState(last, np.array(output))


def _start(state: FilterState, sample: Array) -> FilterState:
    """Return the state, begun at the sample where it has no output yet."""
    is_new = np.isnan(state.output)
    if not is_new.any():
        return state
    first = np.where(np.isfinite(sample), sample, np.nan)
    return FilterState(
        np.where(is_new, first, state.sample), np.where(is_new, first, state.output)
    )
