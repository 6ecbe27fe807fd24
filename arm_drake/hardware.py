"""Command and state interfaces of a robot, between its controllers and the plant.

Stands where ros2_control has the hardware component: it holds the commands that
controllers write, turns them into effort through the joint servo, and reports the state
of every joint.
"""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, MatrixGain, Multiplexer

from arm_drake import interfaces
from arm_drake.command_interfaces import CommandInterfaces
from arm_drake.control.servo import compute_friction_gains, compute_servo_gains
from arm_drake.description.robot import Pose
from arm_drake.description.urdf import JointInfo, RobotDescription
from arm_drake.options import SimulationOptions
from arm_drake.plant import add_robot_model, set_gravity, state_indices
from arm_drake.servo import (
    add_step_inertia,
    make_dry_friction,
    make_joint_servo,
    sample_dynamics,
)


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


def commanded_joints(description: RobotDescription) -> tuple[JointInfo, ...]:
    """Return the joints that have an actuator, in the order of the description.

    They are those with a command interface in `<ros2_control>`; mimic joints follow
    their master. A description without `<ros2_control>` commands all its joints.
    """
    movable = [joint for joint in description.movable_joints if joint.mimic is None]
    if not description.hardware:
        return tuple(movable)
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
    period: float,
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
        period: Period of the controller manager [s].
        options: How to simulate.
    """
    joints = commanded_joints(description)
    names = [joint.name for joint in joints]
    alone = _robot_alone(description, pose, options, plant.time_step())
    q_at, v_at = state_indices(plant, model, names)
    state = plant.get_state_output_port(model)
    commands = builder.AddNamedSystem(
        f"{prefix}command_interfaces",
        CommandInterfaces(
            names,
            claims,
            np.array([initial[name] for name in names]),
            period,
            num_states=state.size(),
            positions_at=q_at,
            servo_plant=alone,
        ),
    )
    builder.Connect(state, commands.GetInputPort("state"))
    effort = None
    if names:
        servo = builder.AddNamedSystem(
            f"{prefix}servo",
            _make_servo(alone, description, joints, (q_at, v_at), options),
        )
        builder.Connect(state, servo.GetInputPort("state"))
        builder.Connect(
            commands.GetOutputPort("command"), servo.GetInputPort("command")
        )
        effort = servo.GetOutputPort("effort")
        builder.Connect(effort, plant.get_actuation_input_port(model))
    all_joints = tuple(joint.name for joint in description.movable_joints)
    joint_states = _add_state_interfaces(
        builder, plant, model, description, names, effort, prefix
    )
    friction = None
    if options.friction:
        friction = _add_friction(
            builder, plant, model, alone, description, prefix, initial
        )
    return Hardware(commands, all_joints, joint_states, friction)


def selection(all_joints: Sequence[str], names: Sequence[str]) -> MatrixGain:
    """Return what picks state interfaces out of the `joint_states` vector.

    Args:
        all_joints: Joints of the vector, J of them.
        names: Interfaces to pick, such as "joint1/position", in the output's order.
    """
    order = interfaces.interface_names(all_joints, interfaces.STATE_INTERFACES)
    D = np.zeros((len(names), len(order)))
    for row, name in enumerate(names):
        D[row, order.index(name)] = 1.0
    return MatrixGain(D)


def _make_servo(
    plant: MultibodyPlant,
    description: RobotDescription,
    joints: Sequence[JointInfo],
    at: tuple[list[int], list[int]],
    options: SimulationOptions,
) -> Diagram:
    """Return the servo of the commanded joints, from a plant of the robot alone."""
    N = velocity_map(plant, description, joints)
    gains = compute_servo_gains(
        sample_dynamics(plant, N),
        np.array(effort_limits(joints)),
        np.array([math.inf if (v := j.limits.velocity) is None else v for j in joints]),
        bandwidth=options.servo_bandwidth,
        time_step=plant.time_step(),
    )
    return make_joint_servo(plant, gains, *at, N)


def _robot_alone(
    description: RobotDescription,
    pose: Pose | None,
    options: SimulationOptions,
    time_step: float,
) -> MultibodyPlant:
    """Return a plant that the servo computes with: no geometry, one robot."""
    plant = MultibodyPlant(time_step)
    set_gravity(plant, options)
    model = add_robot_model(plant, description, "robot", pose, has_geometry=False)
    add_step_inertia(plant, model, time_step)
    plant.Finalize()
    return plant


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
    for joint in description.movable_joints:
        factor, master = 1.0, joint
        while master.mimic is not None:
            factor *= master.mimic.multiplier
            master = description.joint(master.mimic.joint)
        if master.name in columns:
            row = plant.GetJointByName(joint.name).velocity_start()
            N[row, columns[master.name]] = factor
    return N


def _add_friction(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    alone: MultibodyPlant,
    description: RobotDescription,
    prefix: str,
    initial: Mapping[str, float],
) -> OutputPort | None:
    """Add dry friction; return the generalized forces on the robot, if it has any."""
    joints = [
        j for j in description.movable_joints if j.friction > 0.0 and j.mimic is None
    ]
    if not joints:
        return None
    h = plant.time_step()
    N = velocity_map(alone, description, joints)
    system = builder.AddNamedSystem(
        f"{prefix}dry_friction",
        make_dry_friction(
            np.array([joint.friction for joint in joints]),
            compute_friction_gains(sample_dynamics(alone, N), h),
            np.array([initial[joint.name] for joint in joints]),
            plant.num_multibody_states(model),
            *state_indices(plant, model, [joint.name for joint in joints]),
            plant.num_velocities(model),
            h,
        ),
    )
    builder.Connect(plant.get_state_output_port(model), system.get_input_port())
    return system.get_output_port()


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


def _add_state_interfaces(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    description: RobotDescription,
    commanded: Sequence[str],
    effort: OutputPort | None,
    prefix: str,
) -> OutputPort:
    """Add the `joint_states` vector: position, velocity, effort of all J joints."""
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
