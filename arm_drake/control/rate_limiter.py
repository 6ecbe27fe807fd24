"""Limits of a value and of its first and second derivatives.

The rules are those of control_toolbox's class ``RateLimiter`` (version 6.3.0), as
speeds of mobile bases are limited. A value is in any unit, such as [m/s]; derivatives
are per second.
"""

import dataclasses as dc
import math
from typing import NamedTuple


class Limited(NamedTuple):
    """A limited value, and by what factor it differs from what was asked for."""

    value: float

    # 1 if 0 was asked for.
    factor: float


@dc.dataclass(frozen=True)
class RateLimiter:
    """Limits of a value; NaN is no limit.

    A maximum of NaN switches its pair off. Other limits of NaN are made from the
    maximum, as told below, and the fields then hold what was made.
    """

    # Limits of the value; a minimum of NaN is the opposite of the maximum.
    min_value: float = math.nan
    max_value: float = math.nan

    # Limits of the first derivative while speeding up: below 0, where NaN is the
    # opposite of the maximum, and above 0.
    min_first_derivative_neg: float = math.nan
    max_first_derivative_pos: float = math.nan

    # The same while slowing down, from values above 0 and below 0; NaN is the limit
    # of speeding up.
    min_first_derivative_pos: float = math.nan
    max_first_derivative_neg: float = math.nan

    # Limits of the second derivative; a minimum of NaN is the opposite of the maximum.
    min_second_derivative: float = math.nan
    max_second_derivative: float = math.nan

    def __post_init__(self) -> None:
        """Make limits that aren't given."""
        self._complete("min_value", "max_value")
        self._complete("min_first_derivative_neg", "max_first_derivative_pos")
        if not math.isnan(self.max_first_derivative_pos):
            for name, other in (
                ("min_first_derivative_pos", self.min_first_derivative_neg),
                ("max_first_derivative_neg", self.max_first_derivative_pos),
            ):
                if math.isnan(getattr(self, name)):
                    object.__setattr__(self, name, other)
            self._complete("min_first_derivative_pos", "max_first_derivative_neg")
        self._complete("min_second_derivative", "max_second_derivative")

    def limit(self, v: float, v0: float, v1: float, dt: float) -> Limited:
        """Return a value within all limits: second derivative, first, then value.

        `v0` is the last one, `v1` that before it, `dt` the time between values [s].
        """
        limited = self.limit_second_derivative(v, v0, v1, dt).value
        limited = self.limit_first_derivative(limited, v0, dt).value
        return _compare(self.limit_value(limited).value, v)

    def limit_value(self, v: float) -> Limited:
        """Return a value within the limits of the value alone."""
        if math.isnan(self.max_value):
            return _compare(v, v)
        return _compare(_clamp(v, self.min_value, self.max_value), v)

    def limit_first_derivative(self, v: float, v0: float, dt: float) -> Limited:
        """Return a value within the limits of the first derivative alone.

        Which of them hold depends on the sign of the last value.
        """
        if math.isnan(self.max_first_derivative_pos):
            return _compare(v, v)
        low, high = self.min_first_derivative_neg, self.max_first_derivative_pos
        if v0 > 0.0:
            low = self.min_first_derivative_pos
        elif v0 < 0.0:
            high = self.max_first_derivative_neg
        return _compare(v0 + _clamp(v - v0, low * dt, high * dt), v)

    def limit_second_derivative(
        self, v: float, v0: float, v1: float, dt: float
    ) -> Limited:
        """Return a value within the limits of the second derivative alone.

        They hold only where the first derivative is to grow in its own direction.
        """
        if math.isnan(self.max_second_derivative):
            return _compare(v, v)
        last = v0 - v1
        change = v - v0 - last
        if not change * (v - v0) > 0.0:
            return _compare(v, v)
        low = self.min_second_derivative * dt * dt
        high = self.max_second_derivative * dt * dt
        return _compare(v0 + last + _clamp(change, low, high), v)

    def _complete(self, min_name: str, max_name: str) -> None:
        low, high = getattr(self, min_name), getattr(self, max_name)
        if math.isnan(low):
            low = -high
            object.__setattr__(self, min_name, low)
        if low > high:
            raise ValueError(
                f"{min_name} must not exceed {max_name}, got {low} and {high}"
            )


def _clamp(value: float, low: float, high: float) -> float:
    # NaN stays NaN, for it is the first argument.
    return min(max(value, low), high)


def _compare(limited: float, v: float) -> Limited:
    return Limited(limited, limited / v if v != 0.0 else 1.0)
