"""Filters of measurements, n channels at a time, chains of them by parameters; limits.

Each channel is a filter of its own; samples and outputs have the shape (n,). The rules
are those of control_toolbox's ``LowPassFilter``, ``ExponentialFilter`` and
``RateLimiter`` (version 6.3.0) for numbers; of the filters of the last few samples in
ROS's package `filters` (branch ``ros2``: ``mean.hpp``, ``median.hpp``,
``transfer_function.hpp``), whose samples are finite; and of its ``filter_chain.hpp``:
``filter1``, ``filter2`` and so on, each with a name, a type and parameters.

`RateLimiter` limits a value and its first and second derivatives, as speeds of mobile
bases are limited too. The value is in any unit, such as [m/s]; derivatives are per
second.
"""

import dataclasses as dc
import math
import typing
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.errors import suggest
from arm_drake.importing import dataclass


class Limited(NamedTuple):
    """Limited value, and its ratio to the requested one."""

    value: float

    # 1 if 0 was asked for.
    factor: float


@dataclass(frozen=True)
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
        """Fill in the limits that are NaN."""
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


class FilterState(NamedTuple):
    """State of a filter of n channels; arrays of shape (n,), never changed."""

    # The last sample.
    sample: Array

    # What came out; NaN where there has been nothing to start from.
    output: Array

    @classmethod
    def initial(cls, n: int) -> Self:
        """Return the state of n channels before the first sample."""
        nothing = np.full(n, np.nan)
        return cls(nothing, nothing)


class SmoothingFilter(ABC):
    """Base of filters of a sample, the last one and the last output.

    The first finite sample of a channel is its output. After an output of NaN the next
    finite sample is the first one again.
    """

    @staticmethod
    def initial(n: int) -> FilterState:
        """Return the state of n channels before the first sample."""
        return FilterState.initial(n)

    def update(self, state: FilterState, sample: Array) -> FilterState:
        """Return the state after a sample; it holds the output."""
        sample = np.array(sample, dtype=float)
        is_new = np.isnan(state.output)
        if is_new.any():
            first = np.where(np.isfinite(sample), sample, np.nan)
            state = FilterState(*(np.where(is_new, first, part) for part in state))
        # An infinite sample may meet one of the other sign, or a factor of 0.
        with np.errstate(invalid="ignore"):
            return FilterState(sample, self._smooth(state, sample))

    @abstractmethod
    def _smooth(self, last: FilterState, sample: Array) -> Array:
        """Return what comes out, shape (n,)."""


@dataclass(frozen=True)
class LowPassFilter(SmoothingFilter):
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
        """Compute the coefficient."""
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

    def _smooth(self, last: FilterState, sample: Array) -> Array:
        return (1.0 - self.a) * last.sample + self.a * last.output


@dataclass(frozen=True)
class ExponentialFilter(SmoothingFilter):
    """Exponential smoothing: y_k = alpha x_k + (1 - alpha) y_(k-1).

    With x the samples and y the outputs.
    """

    # How much of a new sample passes, from 0 to 1.
    alpha: float

    def __post_init__(self) -> None:
        """Check the parameter."""
        if not 0.0 <= self.alpha <= 1.0:
            raise ValueError(f"alpha must be from 0 to 1, got {self.alpha}")

    def _smooth(self, last: FilterState, sample: Array) -> Array:
        return self.alpha * sample + (1.0 - self.alpha) * last.output


class LimiterState(NamedTuple):
    """State of a rate limiter of n channels; arrays of shape (n,)."""

    # The last output but one.
    before: Array

    # What came out; NaN where there has been nothing to start from.
    output: Array


@dataclass(frozen=True)
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
        """Make the limiter."""
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
        """Return the state after a sample; it holds the output."""
        is_new = np.isnan(state.output)
        last = np.where(is_new, sample, state.output)
        before = np.where(is_new, sample, state.before)
        columns = zip(sample.tolist(), last.tolist(), before.tolist(), strict=True)
        limit, period = self._limiter.limit, self.sampling_interval
        output = [limit(v, v0, v1, period).value for v, v0, v1 in columns]
        return LimiterState(last, np.array(output))


class WindowState(NamedTuple):
    """The latest samples of n channels, the oldest first, and what came out."""

    # Each of shape (n,), never changed.
    samples: tuple[Array, ...]
    output: Array


@dataclass(frozen=True)
class WindowFilter(ABC):
    """Statistic of the last samples, of fewer as long as there are no more."""

    # Of how many samples; at least one.
    number_of_observations: int

    def __post_init__(self) -> None:
        """Check the parameter."""
        n = self.number_of_observations
        if n < 1:
            raise ValueError(f"number_of_observations must be at least 1, got {n}")

    @staticmethod
    def initial(n: int) -> WindowState:
        """Return the state of n channels before the first sample."""
        return WindowState((), np.full(n, np.nan))

    def update(self, state: WindowState, sample: Array) -> WindowState:
        """Return the state after a sample; it holds the output."""
        samples = (*state.samples, np.array(sample, dtype=float))
        samples = samples[-self.number_of_observations :]
        return WindowState(samples, self._combine(samples))

    @abstractmethod
    def _combine(self, samples: tuple[Array, ...]) -> Array:
        """Return what comes out, shape (n,)."""


class MeanFilter(WindowFilter):
    """The mean of the last samples."""

    def _combine(self, samples: tuple[Array, ...]) -> Array:
        # One after the other, for the last bit.
        return np.asarray(sum(samples) / len(samples))


class MedianFilter(WindowFilter):
    """The median of the last samples; of an even number the lower of the middle two."""

    def _combine(self, samples: tuple[Array, ...]) -> Array:
        middle: Array = np.sort(samples, axis=0)[(len(samples) - 1) // 2]
        return middle


class TransferState(NamedTuple):
    """State of a digital filter of n channels, the latest first."""

    # Each of shape (n,), never changed.
    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]

    # What came out, shape (n,).
    output: Array


@dataclass(frozen=True)
class TransferFunctionFilter:
    """A digital filter, at rest before its first sample.

    With x the samples and y the outputs::

        a_0 y_k = b_0 x_k + b_1 x_(k-1) + .. - a_1 y_(k-1) - a_2 y_(k-2) - ..
    """

    # Coefficients of outputs and samples, at least one each; the first of a isn't 0.
    a: tuple[float, ...]
    b: tuple[float, ...]

    def __post_init__(self) -> None:
        """Divide by the first coefficient."""
        for name in ("a", "b"):
            values = getattr(self, name)
            if not values or not all(map(math.isfinite, values)):
                raise ValueError(
                    f"{name} must be finite numbers, at least one, got {list(values)}"
                )
        if self.a[0] == 0.0:
            raise ValueError(f"a must not begin with 0, got {list(self.a)}")
        for name in ("b", "a"):
            scaled = tuple(value / self.a[0] for value in getattr(self, name))
            object.__setattr__(self, name, scaled)

    @staticmethod
    def initial(n: int) -> TransferState:
        """Return the state of n channels before the first sample."""
        return TransferState((), (), np.full(n, np.nan))

    def update(self, state: TransferState, sample: Array) -> TransferState:
        """Return the state after a sample; it holds the output."""
        output = self.b[0] * sample
        for b, x in zip(self.b[1:], state.inputs, strict=False):
            output = output + b * x
        for a, y in zip(self.a[1:], state.outputs, strict=False):
            output = output - a * y
        return TransferState(
            (sample, *state.inputs)[: len(self.b) - 1],
            (output, *state.outputs)[: len(self.a) - 1],
            output,
        )


# Filters of numbers; their fields are their parameters.
FILTERS: Mapping[str, type] = {
    "filters/MeanFilterDouble": MeanFilter,
    "filters/MedianFilterDouble": MedianFilter,
    "filters/TransferFunctionFilterDouble": TransferFunctionFilter,
    "control_filters/LowPassFilterDouble": LowPassFilter,
    "control_filters/ExponentialFilterDouble": ExponentialFilter,
    "control_filters/RateLimiterDouble": RateLimiterFilter,
}


class Filter(Protocol):
    """Interface of all filters."""

    def initial(self, n: int) -> Any:
        """Return the state of n channels before the first sample."""

    def update(self, state: Any, sample: Array) -> Any:
        """Return the state after a sample of shape (n,); it holds the `output`."""


class ChainState(NamedTuple):
    """States of the filters of a chain, and the output of the last one."""

    states: tuple[Any, ...]

    # Shape (n,); NaN before the first sample.
    output: Array


@dataclass(frozen=True)
class FilterChain:
    """Filters one after the other; none at all lets everything pass."""

    filters: tuple[Filter, ...] = ()

    def initial(self, n: int) -> ChainState:
        """Return the state of n channels before the first sample."""
        states = tuple(each.initial(n) for each in self.filters)
        return ChainState(states, np.full(n, np.nan))

    def update(self, state: ChainState, sample: Array) -> ChainState:
        """Return the state after a sample; it holds the output."""
        states = []
        for each, last in zip(self.filters, state.states, strict=True):
            states.append(each.update(last, sample))
            sample = states[-1].output
        return ChainState(tuple(states), sample)


def make_filter_chain(parameters: Mapping[str, Any], where: str) -> FilterChain:
    """Return the chain that parameters configure.

    What belongs to no filter has no effect, as in ROS; `find_unused` finds it.
    """
    filters: list[Filter] = []
    names: list[str] = []
    while True:
        place = f"filter{len(filters) + 1}"
        name, type_ = (parameters.get(f"{place}.{key}") for key in ("name", "type"))
        if name is None and type_ is None:
            break
        for key, value in (("name", name), ("type", type_)):
            if not isinstance(value, str):
                what = "is required but missing"
                if value is not None:
                    what = f"expected str, got {value!r}"
                raise ValueError(f"{where}.{place}.{key}: {what}")
        if name in names:
            raise ValueError(
                f"{where}.{place}.name: another filter of the chain is {name!r}, too"
            )
        if type_ not in FILTERS:
            raise ValueError(
                f"{where}.{place}.type: no filter of numbers {type_!r}; "
                f"{suggest(str(type_), FILTERS)}"
            )
        start = f"{place}.params."
        values = {
            key.removeprefix(start): value
            for key, value in parameters.items()
            if key.startswith(start)
        }
        filters.append(_make_filter(FILTERS[str(type_)], values, f"{where}.{start}"))
        names.append(str(name))
    return FilterChain(tuple(filters))


def find_unused(
    parameters: Mapping[str, Any], known: Mapping[str, Collection[str]] | None = None
) -> dict[str, str]:
    """Return parameters of a chain that belong to none of its filters, and why."""
    if known is None:
        known = {type_: parameters_of(kind) for type_, kind in FILTERS.items()}
    size = 0
    while not {f"filter{size + 1}.{n}" for n in ("name", "type")}.isdisjoint(
        parameters
    ):
        size += 1
    places = [f"filter{number}" for number in range(1, size + 1)]
    found = {}
    for name in parameters:
        place, _, key = name.partition(".")
        start, _, parameter = key.partition(".")
        if place not in places or (start != "params" and key not in ("name", "type")):
            found[name] = (
                "belongs to no filter; they are numbered from filter1 on, and the "
                f"chain has {size}, each with name, type and params"
            )
        elif start == "params":
            own = known.get(str(parameters.get(f"{place}.type")))
            if own is not None and parameter not in own:
                found[name] = (
                    f"the filter has no such parameter; {suggest(parameter, own)}"
                )
    return found


def parameters_of(kind: type) -> tuple[str, ...]:
    """Return the names of a filter's parameters."""
    return tuple(field.name for field in dc.fields(kind) if field.init)


def _make_filter(kind: type, parameters: Mapping[str, Any], where: str) -> Filter:
    """Return a filter of a kind with these parameters."""
    fields = {field.name: field for field in dc.fields(kind) if field.init}
    for name, field in fields.items():
        if field.default is dc.MISSING and name not in parameters:
            raise ValueError(f"{where}{name}: is required but missing")
    hints = typing.get_type_hints(kind)
    values = {
        name: _convert(hints[name], value, f"{where}{name}")
        for name, value in parameters.items()
        if name in fields
    }
    try:
        made: Filter = kind(**values)
    except ValueError as error:
        raise ValueError(f"{where}{error}") from None
    return made


def _convert(expected: Any, value: Any, where: str) -> Any:
    """Return a value as the expected type: int, float, or a list of floats."""
    kind = "a list of float"
    if expected is int:
        if type(value) is int:
            return value
        kind = "int"
    elif expected is float:
        # A bool is an int, too; and rcl has no larger ones.
        if type(value) is float or (type(value) is int and abs(value) < 2**63):
            return float(value)
        kind = "float"
    elif isinstance(value, list | tuple):
        return tuple(_convert(float, each, where) for each in value)
    raise ValueError(f"{where}: expected {kind}, got {value!r}")
