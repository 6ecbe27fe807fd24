"""The diagram of a robot without Python: what its own code is measured against.

It has the same plant, servo, friction and logs as ours. Its commands come from Drake's
TrajectorySource and hold from tick to tick, without a delay.
"""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource, VectorLogSink, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

import arm_drake as ad
from arm_drake.hardware.drives import (
    RobotDrive,
    commanded_joints,
    effort_limits,
    make_robot_drive,
)
from arm_drake.hardware.hardware import add_hardware, connect_forces
from arm_drake.plant.joint_ranges import find_gripper_joints
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    filter_self_collision,
    set_initial_positions,
)
from arm_drake.timing import choose_time_step
from arm_drake.worlds.world import add_world

# Names of the system that holds the joints' states, and of the logs of these and of the
# commands.
SAMPLE = "sample"
STATE_LOG, COMMAND_LOG = "log:joint_states", "log:commands"


def build_cpp_only(
    robot: ad.Robot, options: ad.SimulationOptions, commands: NDArray[np.float64]
) -> tuple[Diagram, RobotDrive]:
    """Return the diagram without Python, and the drive that must outlive it.

    Args:
        robot: The robot, with n commanded joints.
        options: How to simulate.
        commands: What its servo is told from each tick on, shape (ticks, 2n or 7n).
    """
    step, (period,) = choose_time_step(
        options.time_step, [robot.controllers.update_rate]
    )
    description, initial = robot.description, robot.initial_positions
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, step, options)
    add_world(plant, "empty")
    model = add_robot_model(plant, description, robot.name, robot.pose)
    joints = commanded_joints(description)
    add_actuators(plant, model, [joint.name for joint in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(initial))
    plant.Finalize()
    filter_self_collision(plant, scene_graph, model)
    drive = make_robot_drive(
        description,
        robot.pose,
        options,
        step,
        grippers={joint.name for joint in find_gripper_joints(robot)},
        period=period,
    )
    hardware = add_hardware(
        builder,
        plant,
        model,
        description,
        prefix="",
        drive=drive,
        initial=initial,
        options=options,
        has_modes=commands.shape[1] > 2 * len(joints),
    )
    assert hardware.command is not None
    ticks = period * np.arange(len(commands) + 1)
    held = PiecewisePolynomial.ZeroOrderHold(
        ticks, np.vstack([commands, commands[-1:]]).T
    )
    source = builder.AddSystem(TrajectorySource(held))
    builder.Connect(source.get_output_port(), hardware.command)
    if hardware.friction is not None:
        connect_forces(builder, plant, {model: hardware.friction})
    # What our broadcaster holds and our rollout records.
    states = hardware.joint_states
    sample = builder.AddNamedSystem(SAMPLE, ZeroOrderHold(period, states.size()))
    builder.Connect(states, sample.get_input_port())
    for name, port in (
        (STATE_LOG, sample.get_output_port()),
        (COMMAND_LOG, source.get_output_port()),
    ):
        log = builder.AddNamedSystem(name, VectorLogSink(port.size(), period))
        builder.Connect(port, log.get_input_port())
    return builder.Build(), drive
