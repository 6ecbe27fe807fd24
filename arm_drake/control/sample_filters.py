"""Filters of the last few samples, n channels at a time.

The rules are those of the filters of numbers in ROS's package `filters` (branch
``ros2``: ``mean.hpp``, ``median.hpp``, ``transfer_function.hpp``): each channel is a
filter of its own. Samples are finite.
"""

import dataclasses as dc
import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array


class WindowState(NamedTuple):
    """The latest samples of n channels, the oldest first, and what came out."""

    # Each of shape (n,), never changed.
    samples: tuple[Array, ...]
    output: Array


@dc.dataclass(frozen=True)
class WindowFilter(ABC):
    """Says something of the last samples, of fewer as long as there are no more."""

    # Of how many samples; at least one.
    number_of_observations: int

    def __post_init__(self) -> None:
        """Check the parameter.

        Raises:
            ValueError: If it is out of range.
        """
        n = self.number_of_observations
        if n < 1:
            raise ValueError(f"number_of_observations must be at least 1, got {n}")

    @staticmethod
    def initial(n: int) -> WindowState:
        """Return the state of n channels before the first sample."""
        return WindowState((), np.full(n, np.nan))

    def update(self, state: WindowState, sample: Array) -> WindowState:
        """Return the state after a sample; it holds the output.

        Args:
            state: The state so far.
            sample: What is measured, shape (n,).
        """
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
    """What a digital filter of n channels remembers, the latest first."""

    # Each of shape (n,), never changed.
    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]

    # What came out, shape (n,).
    output: Array


@dc.dataclass(frozen=True)
class TransferFunctionFilter:
    """A digital filter, at rest before its first sample.

    With x the samples and y the outputs::

        a_0 y_k = b_0 x_k + b_1 x_(k-1) + .. - a_1 y_(k-1) - a_2 y_(k-2) - ..
    """

    # Coefficients of outputs and samples, at least one each; the first of a isn't 0.
    a: tuple[float, ...]
    b: tuple[float, ...]

    def __post_init__(self) -> None:
        """Divide by the first coefficient.

        Raises:
            ValueError: If a coefficient is missing or out of range.
        """
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
        """Return the state after a sample; it holds the output.

        Args:
            state: The state so far.
            sample: What is measured, shape (n,).
        """
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
