"""Dry friction of a robot's joints, as a Drake system in C++."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.symbolic import Expression, Variable
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.arrays import Array
from arm_drake.control.servo import FrictionGains, compute_friction_gains
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.servo import clamp
from arm_drake.plant.joint_dynamics import (
    find_followers,
    sample_dynamics,
    sum_friction,
    velocity_map,
)
from arm_drake.plant.plant import state_indices


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


class JointFriction(NamedTuple):
    """Dry friction of k joints."""

    names: tuple[str, ...]

    # [N·m], shape (k,).
    friction: np.ndarray

    # What holds them.
    gains: FrictionGains

    @property
    def deflection(self) -> np.ndarray:
        """How far joints give way before their friction is all there [rad], (k,)."""
        return self.friction / self.gains.kf


def make_robot_friction(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    alone: MultibodyPlant,
    description: RobotDescription,
    initial: Mapping[str, float],
) -> SymbolicVectorSystem | None:
    """Return the dry friction of a robot's joints, or None if there is none.

    `alone` is the plant of `make_servo_plant`.
    """
    found = find_friction(alone, description)
    if not found.names:
        return None
    return make_dry_friction(
        found.friction,
        found.gains,
        np.array([initial[name] for name in found.names]),
        plant.num_multibody_states(model),
        *state_indices(plant, model, found.names),
        plant.num_velocities(model),
        plant.time_step(),
    )


def find_friction(
    alone: MultibodyPlant, description: RobotDescription
) -> JointFriction:
    """Return the joints that have dry friction, and how it holds them.

    `alone` is the plant of `make_servo_plant`, with the simulation's step.
    """
    free = [joint for joint in description.movable_joints if joint.mimic is None]
    total = sum_friction(alone, description, free)
    joints = [joint for joint, f in zip(free, total, strict=True) if f > 0.0]
    if not joints:
        return JointFriction((), np.zeros(0), FrictionGains(np.zeros(0), np.zeros(0)))
    N = velocity_map(alone, description, joints)
    samples = sample_dynamics(alone, N, find_followers(alone, description))
    return JointFriction(
        tuple(joint.name for joint in joints),
        total[total > 0.0],
        compute_friction_gains(samples, alone.time_step()),
    )
