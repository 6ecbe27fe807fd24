"""Joints that feel each other's acceleration through the mass matrix."""

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array

# Correlation of inertias above which joints push each other about.
_COUPLED = 0.02

# Rounds, and excess of an effort, at which the search for accelerations ends.
_ROUNDS = 200
_EXCESS = 1.01


def find_groups(masses: Array) -> NDArray[np.intp]:
    """Return the number of the group of each joint, shape (n,).

    Joints of a group push each other about when they accelerate.

    Args:
        masses: Mass matrices, shape (k, n, n).
    """
    scale = np.sqrt(np.diagonal(masses, axis1=1, axis2=2))
    correlation = np.abs(masses / scale[:, :, None] / scale[:, None, :]).max(axis=0)
    group = np.arange(len(correlation))
    for i, j in np.argwhere(correlation > _COUPLED):
        group[group == group[j]] = group[i]
    numbers: NDArray[np.intp] = np.unique(group, return_inverse=True)[1]
    return numbers


def common_accelerations(masses: Array, spare: Array, largest: Array) -> Array:
    """Return accelerations that all joints can have at once, shape (n,).

    Args:
        masses: Mass matrices, shape (k, n, n).
        spare: Efforts that are left beside gravity, infinite where unlimited.
        largest: Accelerations that none is to exceed.
    """
    inertia = np.diagonal(masses, axis1=1, axis2=2).max(axis=0)
    found, rows = np.minimum(largest, spare / inertia), np.arange(len(spare))
    for _ in range(_ROUNDS):
        # What each joint asks of each other one, where that is most.
        parts = np.abs(masses) * found
        totals = parts.sum(axis=2)
        worst = totals.argmax(axis=0), rows
        excess = np.maximum(totals[worst] / spare, 1.0)
        if (excess < _EXCESS).all():
            break
        share = parts[worst] / totals[worst][:, None]
        found = found * np.exp(-0.5 * (share * np.log(excess)[:, None]).max(axis=0))
    return found
