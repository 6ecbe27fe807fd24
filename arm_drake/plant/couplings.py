"""Mimic joints: what moves them in the end, and by how much."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.description.joints import JointInfo
from arm_drake.description.tree import last_master
from arm_drake.description.urdf import RobotDescription
from arm_drake.plant.dynamics_samples import Followers


def find_followers(plant: MultibodyPlant, description: RobotDescription) -> Followers:
    """Return the mimic joints, and what moves them in the end.

    Args:
        plant: A finalized plant of the robot alone.
        description: The robot.
    """

    def at(name: str) -> int:
        return int(plant.GetJointByName(name).position_start())

    joints = {joint.name: joint for joint in description.movable_joints}
    followers = []
    for name, joint in joints.items():
        if joint.mimic is not None:
            master, factor, offset = last_master(joint, joints)
            followers.append((at(name), at(master), factor, offset))
    return followers


def sum_friction(
    plant: MultibodyPlant, description: RobotDescription, joints: Sequence[JointInfo]
) -> np.ndarray:
    """Return the dry friction of joints with that of their mimic joints, shape (n,).

    A follower's friction brakes its master, by virtual work.

    Args:
        plant: A finalized plant of the robot alone.
        description: The robot.
        joints: The n joints.
    """
    own = np.zeros(plant.num_velocities())
    for joint in description.movable_joints:
        own[plant.GetJointByName(joint.name).velocity_start()] = joint.friction
    total: np.ndarray = np.abs(velocity_map(plant, description, joints).T) @ own
    return total


def velocity_map(
    plant: MultibodyPlant, description: RobotDescription, joints: Sequence[JointInfo]
) -> np.ndarray:
    """Return the velocities of all joints per velocity of a commanded joint.

    Args:
        plant: A finalized plant of the robot alone, with m velocities.
        description: The robot.
        joints: The n commanded joints.

    Returns:
        N, shape (m, n): 1 for the joint itself, the multiplier for its mimic joints.
    """
    N = np.zeros((plant.num_velocities(), len(joints)))
    columns = {joint.name: column for column, joint in enumerate(joints)}
    movable = {joint.name: joint for joint in description.movable_joints}
    for name, joint in movable.items():
        master, factor, _ = last_master(joint, movable)
        if master in columns:
            row = plant.GetJointByName(name).velocity_start()
            N[row, columns[master]] = factor
    return N
