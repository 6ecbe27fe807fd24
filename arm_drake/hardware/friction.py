"""Dry friction that sticks, as a Drake system in C++."""

import numpy as np
from pydrake.symbolic import Expression, Variable
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.arrays import Array
from arm_drake.control.friction import FrictionGains
from arm_drake.hardware.signals import clamp


def make_dry_friction(
    friction: Array,
    gains: FrictionGains,
    initial: Array,
    num_states: int,
    positions_at: list[int],
    velocities_at: list[int],
    num_velocities: int,
    h: float,
) -> SymbolicVectorSystem:
    """Return elastoplastic dry friction with true sticking.

    The joint is held at an anchor a by a PD law that gives way at the friction f::

        tau  = clamp(kf (a - q) - df v, ±f)         a[+] = q + (tau + df v) / kf

    The input is the robot's state, the output the generalized forces on the robot's
    velocities. The state is a less the initial positions, so that it starts at zero.

    Args:
        friction: f of the k joints that have friction [N·m], shape (k,).
        gains: kf and df.
        initial: Initial positions of those joints [rad], shape (k,).
        num_states: Size of the robot's state [q; v].
        positions_at: Indices of the joints' positions in the state.
        velocities_at: Indices of their velocities in the state.
        num_velocities: Size of v.
        h: Step of the plant [s].
    """
    x = [Variable(f"x{i}") for i in range(num_states)]
    a = [Variable(f"a{i}") for i in range(len(friction))]
    forces = [Expression(0.0)] * num_velocities
    updates = []
    for i, f in enumerate(friction):
        q, v = x[positions_at[i]] - initial[i], x[velocities_at[i]]
        tau = clamp(gains.kf[i] * (a[i] - q) - gains.df[i] * v, float(f))
        forces[velocities_at[i] - (num_states - num_velocities)] = tau
        updates.append(q + (tau + gains.df[i] * v) / gains.kf[i])
    return SymbolicVectorSystem(
        state=np.array(a),
        input=np.array(x),
        dynamics=np.array(updates),
        output=np.array(forces),
        time_period=h,
    )
