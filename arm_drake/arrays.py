"""Types of arrays and numbers."""

import math
from numbers import Real

import numpy as np
from numpy.typing import NDArray

# Numbers of any shape; docstrings say which.
Array = NDArray[np.float64]

# What is true of elements, and places of elements.
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


def clamp(values: Array, low: Array, high: Array) -> Array:
    """Return values within limits; numpy's clip does the same, slower."""
    return np.minimum(np.maximum(values, low), high)


def cross(a: Array, b: Array) -> Array:
    """Return a cross product of two vectors; numpy's takes ten times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def is_number(value: object) -> bool:
    """Return whether something is a number, of Python's or numpy's, and no bool."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def is_finite(value: object) -> bool:
    """Return whether something is a number, and finite as a float."""
    try:
        return is_number(value) and math.isfinite(value)  # type: ignore[arg-type]
    except OverflowError:  # An integer that no float is as large as.
        return False
