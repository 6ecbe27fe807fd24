"""A robot's model, built on trial: what is the matter with it."""

import numpy as np

from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.hardware.drives import commanded_joints, effort_limits, make_servo_plant
from arm_drake.options import SimulationOptions
from arm_drake.plant.couplings import find_followers, sum_friction, velocity_map
from arm_drake.plant.dynamics_samples import sample_gravity
from arm_drake.plant.plant import set_initial_positions

# Poses in which a joint's effort limit is compared with gravity.
_NUM_POSES = 200


def check_model(robot: Robot) -> None:
    """Build a robot's model on trial, and record what is the matter with it.

    That is what Drake warns about, and joints whose effort limit is less than what
    gravity and dry friction ask for: in the initial pose, or in random ones within the
    limits.

    Raises:
        DescriptionError: If Drake refuses the description.
    """
    description, options = robot.description, SimulationOptions()
    joints = commanded_joints(description)
    efforts, frictions = _loads(robot, options, robot.report)
    for joint, at_start, anywhere, friction, limit in zip(
        joints,
        efforts[0],
        efforts.max(axis=0),
        frictions,
        effort_limits(joints),
        strict=True,
    ):
        unit = "N" if joint.type == "prismatic" else "N·m"
        if anywhere <= limit < anywhere + friction:
            robot.report.add(
                "warning",
                "invalid",
                f"gravity asks for up to {anywhere:.2g} {unit} and dry friction for "
                f"{friction:.2g} {unit}, the effort limit is {limit:.3g} {unit}",
                "the joint may stick",
                where=f"joint {joint.name!r}",
                file=description.file,
            )
        if anywhere <= limit:
            continue
        sinks = at_start > limit
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


def can_move(robot: Robot, options: SimulationOptions) -> bool:
    """Return whether effort limits exceed weight and friction in all poses.

    Args:
        robot: The robot.
        options: How to simulate: with what gravity, and whether with friction.
    """
    limits = effort_limits(commanded_joints(robot.description))
    efforts, frictions = _loads(robot, options)
    return bool((efforts.max(axis=0) + frictions <= np.array(limits)).all())


def _loads(
    robot: Robot, options: SimulationOptions, report: LoadReport | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return what holds n joints in some poses, the first one first, and friction.

    Both are of the commanded joints [N·m], of shapes (poses, n) and (n,).
    """
    description = robot.description
    joints = commanded_joints(description)
    plant = make_servo_plant(
        description, robot.pose, options, options.largest_step, report
    )
    model = plant.GetModelInstanceByName("robot")
    set_initial_positions(plant, model, dict(robot.initial_positions))
    N = velocity_map(plant, description, joints)
    at = find_followers(plant, description)
    friction = sum_friction(plant, description, joints) * options.friction
    return np.abs(sample_gravity(plant, N, _NUM_POSES, at)), friction
