"""Inertia that the servo of a wheel counts with."""

import math

import numpy as np

from arm_drake.arrays import Array


def compute_carried_inertia(
    wheels: Array,
    carried: Array,
    *,
    bandwidth: float,
    time_step: float,
    observer_gain: float,
) -> Array:
    """Return what the servo of wheels adds to their inertia [kg·m^2], shape (n,).

    A wheel on the ground moves the base, and one in the air, or one that slips, only
    itself. The servo must be stable with both. Where the true inertia is r times the
    one it counts with, its error e and h times its observer's state J change by ::

        e[+] = (1 - c/r) e - J/r              c = 1 - z, z = exp(-w0 h)
        J[+] = (1 - b/r) J + b (1 - 1/r) c e

    with the observer's gain b. The determinant is 1 - (c + b - b c)/r. It is 0 at
    r = c + b - b c, where the roots are 0 and 1 - b c/r: so far the servo goes for a
    wheel alone, half way to where that one would be unstable. At 1 ms and b = 0.2 it
    counts with 4.3 times the wheel's inertia, and a base that is 15 times as heavy as
    its wheels follows with a damping of 0.7, not 0.35.

    Args:
        wheels: Inertia of the wheels alone, of n joints [kg·m^2].
        carried: Inertia of what each of them moves on the ground besides; 0 for joints
            that drive no base.
        bandwidth: w0 [rad/s].
        time_step: Step of the plant h [s].
        observer_gain: Share of a disturbance that is taken over at each step, b.
    """
    c, b = 1.0 - math.exp(-bandwidth * time_step), observer_gain
    least = c + b - b * c
    return np.minimum(carried, (1.0 / least - 1.0) * wheels)
