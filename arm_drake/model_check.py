"""A robot's model, built on trial: what is the matter with it."""

import numpy as np

from arm_drake.couplings import find_followers, velocity_map
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.drives import commanded_joints, effort_limits, make_servo_plant
from arm_drake.dynamics_samples import sample_gravity
from arm_drake.options import SimulationOptions
from arm_drake.plant import set_initial_positions

# Poses in which a joint's effort limit is compared with gravity.
_NUM_POSES = 200


def check_model(robot: Robot) -> None:
    """Build a robot's model on trial, and record what is the matter with it.

    That is what Drake warns about, and joints whose effort limit is less than what
    gravity asks for: in the initial pose, or in random ones within the limits.

    Raises:
        DescriptionError: If Drake refuses the description.
    """
    description, options = robot.description, SimulationOptions()
    joints = commanded_joints(description)
    efforts = _weights(robot, options, robot.report)
    for joint, at_start, anywhere, limit in zip(
        joints, efforts[0], efforts.max(axis=0), effort_limits(joints), strict=True
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


def bears_weight(robot: Robot, options: SimulationOptions) -> bool:
    """Return whether a robot's effort limits bear its weight in all poses.

    Args:
        robot: The robot.
        options: How to simulate: with what gravity.
    """
    limits = effort_limits(commanded_joints(robot.description))
    return bool((_weights(robot, options).max(axis=0) <= np.array(limits)).all())


def _weights(
    robot: Robot, options: SimulationOptions, report: LoadReport | None = None
) -> np.ndarray:
    """Return what holds commanded joints in some poses [N·m], the first one first."""
    description = robot.description
    joints = commanded_joints(description)
    plant = make_servo_plant(
        description, robot.pose, options, options.largest_step, report
    )
    model = plant.GetModelInstanceByName("robot")
    set_initial_positions(plant, model, dict(robot.initial_positions))
    N = velocity_map(plant, description, joints)
    at = find_followers(plant, description)
    return np.abs(sample_gravity(plant, N, _NUM_POSES, at))
