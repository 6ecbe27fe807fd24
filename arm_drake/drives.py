"""What moves and brakes a robot's joints: the numbers of its servo and friction."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.control.servo import compute_friction_gains, compute_servo_gains
from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Pose, Robot
from arm_drake.description.tree import last_master
from arm_drake.description.urdf import RobotDescription
from arm_drake.dynamics_samples import Followers, sample_dynamics, sample_gravity
from arm_drake.options import SimulationOptions
from arm_drake.plant import (
    add_robot_model,
    set_gravity,
    set_initial_positions,
    state_indices,
)
from arm_drake.servo import add_step_inertia, make_dry_friction, make_joint_servo

# Poses in which a joint's effort limit is compared with gravity.
_NUM_POSES = 200


def commanded_joints(description: RobotDescription) -> tuple[JointInfo, ...]:
    """Return the joints that have an actuator, in the order of the description.

    They are those with a command interface; mimic joints follow their master.
    """
    movable = [joint for joint in description.movable_joints if joint.mimic is None]
    commanded = {
        component.name
        for block in description.hardware
        for component in block.joints
        if component.command_interfaces
    }
    return tuple(joint for joint in movable if joint.name in commanded)


def effort_limits(joints: Sequence[JointInfo]) -> list[float]:
    """Return effort limits [N·m] or [N], infinite where unset."""
    return [math.inf if (e := joint.limits.effort) is None else e for joint in joints]


def make_servo_plant(
    description: RobotDescription,
    pose: Pose | None,
    options: SimulationOptions,
    time_step: float,
    report: LoadReport | None = None,
) -> MultibodyPlant:
    """Return a plant that a servo computes with: one robot on a fixed base.

    Args:
        description: The robot.
        pose: Pose of its base in the world.
        options: How to simulate.
        time_step: Step of the simulated plant [s].
        report: Where Drake's warnings about the description are recorded.
    """
    plant = MultibodyPlant(time_step)
    set_gravity(plant, options)
    model = add_robot_model(
        plant, description, "robot", pose, is_reduced=True, report=report
    )
    add_step_inertia(plant, model, time_step)
    plant.Finalize()
    return plant


def make_robot_servo(
    plant: MultibodyPlant,
    description: RobotDescription,
    joints: Sequence[JointInfo],
    at: tuple[list[int], list[int]],
    options: SimulationOptions,
    *,
    has_modes: bool = False,
) -> Diagram:
    """Return the servo of a robot's commanded joints.

    Args:
        plant: Plant of `make_servo_plant`; it must live as long as the servo.
        description: The robot.
        joints: The commanded joints.
        at: Indices of their positions and velocities in the state of ``plant``.
        options: How to simulate.
        has_modes: Whether joints may follow velocities or efforts.
    """
    N = velocity_map(plant, description, joints)
    gains = compute_servo_gains(
        sample_dynamics(plant, N, find_followers(plant, description)),
        np.array(effort_limits(joints)),
        np.array([math.inf if (v := j.limits.velocity) is None else v for j in joints]),
        bandwidth=options.servo_bandwidth,
        time_step=plant.time_step(),
    )
    return make_joint_servo(plant, gains, *at, N, has_modes=has_modes)


def check_model(robot: Robot) -> None:
    """Build a robot's model on trial, and record what is the matter with it.

    That is what Drake warns about, and joints whose effort limit is less than what
    gravity asks for: in the initial pose, or in random ones within the limits.

    Raises:
        DescriptionError: If Drake refuses the description.
    """
    description, options = robot.description, SimulationOptions()
    joints = commanded_joints(description)
    plant = make_servo_plant(
        description, robot.pose, options, options.time_step, robot.report
    )
    model = plant.GetModelInstanceByName("robot")
    set_initial_positions(plant, model, dict(robot.initial_positions))
    N = velocity_map(plant, description, joints)
    at = find_followers(plant, description)
    efforts = np.abs(sample_gravity(plant, N, _NUM_POSES, at))
    limits = effort_limits(joints)
    for joint, at_start, anywhere, limit in zip(
        joints, efforts[0], efforts.max(axis=0), limits, strict=True
    ):
        if anywhere <= limit:
            continue
        sinks = at_start > limit
        unit = "N" if joint.type == "prismatic" else "N·m"
        where = "at the start" if sinks else "in some poses"
        effort = at_start if sinks else anywhere
        robot.report.add(
            "warning",
            "invalid",
            f"gravity asks for {effort:.2g} {unit} {where}, the effort limit is "
            f"{limit:.3g} {unit}",
            "the joint sinks" if sinks else "it can't hold those poses",
            where=f"joint {joint.name!r}",
            file=description.file,
        )


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
