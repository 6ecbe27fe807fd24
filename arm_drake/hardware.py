"""Command and state interfaces of a robot, between its controllers and the plant.

Stands where ros2_control has the hardware component: it holds the commands that
controllers write, turns them into effort through the joint servo, and reports the state
of every joint.
"""

import dataclasses as dc
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain, Multiplexer

from arm_drake.command_interfaces import CommandInterfaces
from arm_drake.description.robot import Pose
from arm_drake.description.urdf import RobotDescription
from arm_drake.drives import (
    commanded_joints,
    make_robot_friction,
    make_robot_servo,
    make_servo_plant,
)
from arm_drake.options import SimulationOptions
from arm_drake.plant import state_indices


@dc.dataclass(frozen=True)
class Hardware:
    """What the rest of a diagram needs of a robot's hardware."""

    # Holds the commands; has an input for each active controller.
    command_interfaces: CommandInterfaces

    # Every movable joint, in the order of the description; J of them.
    joints: tuple[str, ...]

    # Positions, velocities and efforts of the joints, size 3J.
    joint_states: OutputPort

    # Dry friction as generalized forces, if there is any.
    friction: OutputPort | None


def add_hardware(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    description: RobotDescription,
    claims: Mapping[str, Sequence[str]],
    *,
    prefix: str,
    pose: Pose | None,
    initial: Mapping[str, float],
    options: SimulationOptions,
) -> Hardware:
    """Add a robot's command interfaces, servo and friction, and connect the plant.

    Args:
        builder: Where to add them.
        plant: The finalized plant, already in the builder.
        model: The robot's model instance.
        description: The robot.
        claims: Command interfaces of each active controller.
        prefix: Start of the names of the systems.
        pose: Pose of the base in the world.
        initial: Initial positions [rad] by joint.
        options: How to simulate.
    """
    joints = commanded_joints(description)
    names = [joint.name for joint in joints]
    alone = make_servo_plant(description, pose, options, plant.time_step())
    q_at, v_at = state_indices(plant, model, names)
    state = plant.get_state_output_port(model)
    commands = builder.AddNamedSystem(
        f"{prefix}command_interfaces",
        CommandInterfaces(
            names,
            claims,
            np.array([initial[name] for name in names]),
            servo_plant=alone,
        ),
    )
    effort = None
    if names:
        servo = builder.AddNamedSystem(
            f"{prefix}servo",
            make_robot_servo(alone, description, joints, (q_at, v_at), options),
        )
        builder.Connect(state, servo.GetInputPort("state"))
        builder.Connect(
            commands.GetOutputPort("command"), servo.GetInputPort("command")
        )
        effort = servo.GetOutputPort("effort")
        builder.Connect(effort, plant.get_actuation_input_port(model))
    all_joints = tuple(joint.name for joint in description.movable_joints)
    joint_states = add_state_interfaces(
        builder, plant, model, description, names, effort, prefix
    )
    forces = None
    if options.friction:
        friction = make_robot_friction(plant, model, alone, description, initial)
        if friction is not None:
            builder.AddNamedSystem(f"{prefix}dry_friction", friction)
            builder.Connect(state, friction.get_input_port())
            forces = friction.get_output_port()
    return Hardware(commands, all_joints, joint_states, forces)


def connect_forces(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    forces: Mapping[ModelInstanceIndex, OutputPort],
) -> None:
    """Connect generalized forces on the robots to the plant.

    Args:
        builder: Where the plant is.
        plant: The finalized plant.
        forces: Generalized forces on a model instance, in the order of its velocities.
    """
    if not forces:
        return
    total = builder.AddNamedSystem(
        "generalized_forces", Adder(len(forces), plant.num_velocities())
    )
    for index, (model, port) in enumerate(forces.items()):
        D = np.zeros((plant.num_velocities(), port.size()))
        for column in range(port.size()):
            unit = np.zeros(port.size())
            unit[column] = 1.0
            v = np.zeros(plant.num_velocities())
            plant.SetVelocitiesInArray(model, unit, v)
            D[:, column] = v
        scatter = builder.AddNamedSystem(
            f"{plant.GetModelInstanceName(model)}_forces", MatrixGain(D)
        )
        builder.Connect(port, scatter.get_input_port())
        builder.Connect(scatter.get_output_port(), total.get_input_port(index))
    builder.Connect(
        total.get_output_port(), plant.get_applied_generalized_force_input_port()
    )


def add_state_interfaces(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    description: RobotDescription,
    commanded: Sequence[str],
    effort: OutputPort | None,
    prefix: str,
) -> OutputPort:
    """Add the `joint_states` vector: position, velocity, effort of all J joints.

    Args:
        builder: Where the plant is.
        plant: The finalized plant.
        model: The robot's model instance.
        description: The robot.
        commanded: Joints that have an actuator.
        effort: What their actuators apply; None if there are none.
        prefix: Start of the names of the systems.
    """
    names = [joint.name for joint in description.movable_joints]
    num_states, J = plant.num_multibody_states(model), len(names)
    q_at, v_at = state_indices(plant, model, names)
    D = np.zeros((3 * J, num_states + len(commanded)))
    for row, name in enumerate(names):
        D[row, q_at[row]] = 1.0
        D[J + row, v_at[row]] = 1.0
        if name in commanded:
            D[2 * J + row, num_states + commanded.index(name)] = 1.0
    sizes = [num_states, len(commanded)] if commanded else [num_states]
    signals = builder.AddNamedSystem(f"{prefix}measurements", Multiplexer(sizes))
    states = builder.AddNamedSystem(f"{prefix}state_interfaces", MatrixGain(D))
    builder.Connect(plant.get_state_output_port(model), signals.get_input_port(0))
    if effort is not None:
        builder.Connect(effort, signals.get_input_port(1))
    builder.Connect(signals.get_output_port(), states.get_input_port())
    return states.get_output_port()
