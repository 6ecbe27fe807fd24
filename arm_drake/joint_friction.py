"""Dry friction of a robot's joints, from its description."""

from collections.abc import Mapping

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.control.friction import compute_friction_gains
from arm_drake.couplings import find_followers, velocity_map
from arm_drake.description.urdf import RobotDescription
from arm_drake.dynamics_samples import sample_dynamics
from arm_drake.plant import state_indices
from arm_drake.servo.friction import make_dry_friction


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
    free = [joint for joint in description.movable_joints if joint.mimic is None]
    # A follower's friction brakes its master, by virtual work.
    N = velocity_map(alone, description, free)
    own = np.zeros(alone.num_velocities())
    for joint in description.movable_joints:
        own[alone.GetJointByName(joint.name).velocity_start()] = joint.friction
    total = np.abs(N.T) @ own
    joints = [joint for joint, f in zip(free, total, strict=True) if f > 0.0]
    if not joints:
        return None
    names = [joint.name for joint in joints]
    N = velocity_map(alone, description, joints)
    samples = sample_dynamics(alone, N, find_followers(alone, description))
    return make_dry_friction(
        total[total > 0.0],
        compute_friction_gains(samples, plant.time_step()),
        np.array([initial[name] for name in names]),
        plant.num_multibody_states(model),
        *state_indices(plant, model, names),
        plant.num_velocities(model),
        plant.time_step(),
    )
