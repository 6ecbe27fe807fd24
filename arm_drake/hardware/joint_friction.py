"""Dry friction of a robot's joints, from its description."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.control.friction import FrictionGains, compute_friction_gains
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.friction import make_dry_friction
from arm_drake.plant.couplings import find_followers, sum_friction, velocity_map
from arm_drake.plant.dynamics_samples import sample_dynamics
from arm_drake.plant.plant import state_indices


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

    Args:
        plant: The finalized plant of the simulation.
        model: The robot's model instance in it.
        alone: Plant of `make_servo_plant`.
        description: The robot.
        initial: Initial positions [rad] by joint.
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

    Args:
        alone: Plant of `make_servo_plant`, with the simulation's step.
        description: The robot.
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
