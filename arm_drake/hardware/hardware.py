"""Command and state interfaces of a robot, between its controllers and the plant.

Stands where ros2_control has the hardware component: it turns the commands that
controllers hold into effort through the joint servo, and reports the state of every
joint.
"""

import dataclasses as dc
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import Adder, ConstantVectorSource, Multiplexer

from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.sensors import SensorInfo, accelerating_joints, imu_tags
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.drives import RobotDrive, add_rotors
from arm_drake.hardware.joint_friction import (
    DryFriction,
    find_dry_friction,
    make_dry_friction,
)
from arm_drake.hardware.servo import make_joint_servo, make_push
from arm_drake.hardware.wiring import Wiring
from arm_drake.importing import dataclass
from arm_drake.interfaces import IMU as IMU_INTERFACES
from arm_drake.options import SimulationOptions
from arm_drake.plant.plant import state_indices
from arm_drake.plant.sensor_readings import ContactReadings, SensorReadings


@dataclass(frozen=True)
class Hardware:
    """Ports and data of a robot's hardware for the rest of a diagram."""

    # Joints with an actuator, n of them.
    commanded: tuple[str, ...]

    # What they are told, see DriveCommands; None if there are none.
    command: InputPort | None

    # Positions, velocities and efforts of all J movable joints, size 3J, in the order
    # of the description.
    joint_states: OutputPort

    # The same without the efforts, size 2J.
    joint_motions: OutputPort

    # Dry friction as generalized forces, if there is any.
    friction: OutputPort | None

    # What drives the commanded joints; it must live as long as the diagram.
    drive: RobotDrive | None

    # What sensors measure, if there are any.
    readings: OutputPort | None = None

    # What touches the robot, if the physics tells.
    contacts: OutputPort | None = None

    # What the IMUs of `<gazebo>` tags measure, by the names of their controllers.
    imus: Mapping[str, OutputPort] = dc.field(default_factory=dict)

    # Everything that can be read, if that is known here.
    everything: OutputPort | None = None

    # Values of all command interfaces, and which of them are claimed, if it is told.
    values: InputPort | None = None
    claimed: InputPort | None = None

    # As joint_states, without noise and delay; None if those have neither.
    true_states: OutputPort | None = None

    @property
    def recorded(self) -> OutputPort:
        """Joint states as they are, for logs."""
        return self.joint_states if self.true_states is None else self.true_states


def add_hardware(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    description: RobotDescription,
    *,
    prefix: str,
    drive: RobotDrive,
    initial: Mapping[str, float],
    options: SimulationOptions,
    has_modes: bool = False,
    has_limits: bool = False,
    only_pushes: bool = False,
) -> Hardware:
    """Add a robot's servo, friction and state interfaces, and connect the plant.

    `has_modes` says that joints may follow anything else than positions, `has_limits`
    that effort and velocity may be limited at run time, `only_pushes` that no joint
    ever follows anything but an effort.
    """
    names, alone = drive.names, drive.plant
    add_rotors(plant, dict(zip(names, drive.rotor_inertia, strict=True)), model)
    state = plant.get_state_output_port(model)
    dry = find_dry_friction(alone, description, initial) if options.friction else None
    effort = command = friction = None
    # What reads the state of the robot alone, and tells dry friction.
    reader: Diagram | None = None
    if names:
        if only_pushes:
            servo = make_push(drive.gains.effort_limit)
        else:
            reader = servo = _make_servo(
                drive, initial, dry, options, has_modes, has_limits
            )
        builder.AddNamedSystem(f"{prefix}servo", servo)
        effort, command = servo.GetOutputPort("effort"), servo.GetInputPort("command")
        builder.Connect(effort, plant.get_actuation_input_port(model))
    if dry is not None and reader is None:
        reader = make_dry_friction(dry, alone.num_multibody_states(), alone.time_step())
        builder.AddNamedSystem(f"{prefix}dry_friction", reader)
    if reader is not None:
        D = _reduced_state(plant, model, alone, description)
        reduced = Wiring(builder).times(f"{prefix}servo_state", D, state)
        builder.Connect(reduced, reader.GetInputPort("state"))
        if dry is not None:
            D = _picked_velocities(plant, model, dry.names).T
            tau = reader.GetOutputPort("friction")
            friction = Wiring(builder).times(f"{prefix}friction_forces", D, tau)
    motions, joint_states = add_state_interfaces(
        builder, plant, model, description, names, effort, prefix
    )
    return Hardware(names, command, joint_states, motions, friction, drive)


def _make_servo(
    drive: RobotDrive,
    initial: Mapping[str, float],
    dry: DryFriction | None,
    options: SimulationOptions,
    has_modes: bool,
    has_limits: bool,
) -> Diagram:
    """Return the servo of a robot's commanded joints, with its joints' friction."""
    names, alone = drive.names, drive.plant
    braked = None
    if dry is not None and options.friction_compensation:
        braked = np.array([[float(n == m) for m in dry.names] for n in names])
    return make_joint_servo(
        alone,
        drive.gains,
        *state_indices(alone, alone.GetModelInstanceByName("robot"), names),
        drive.N,
        has_modes=has_modes,
        has_limits=has_limits,
        dry=dry,
        braked=braked,
        pid=drive.pid,
        start=np.array([initial[name] for name in names]),
    )


def _picked_velocities(
    plant: MultibodyPlant, model: ModelInstanceIndex, names: Sequence[str]
) -> np.ndarray:
    """Return what picks joints out of the robot's generalized forces."""
    rows = np.array(state_indices(plant, model, names)[1]) - plant.num_positions(model)
    picked: np.ndarray = np.eye(plant.num_velocities(model))[rows]
    return picked


def _reduced_state(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    alone: MultibodyPlant,
    description: RobotDescription,
) -> np.ndarray:
    """Return what picks the state of ``alone`` from that of the robot.

    The robot may have a free base and joints of several degrees of freedom besides.
    """
    names = [joint.name for joint in description.movable_joints]
    rows = state_indices(alone, alone.GetModelInstanceByName("robot"), names)
    columns = state_indices(plant, model, names)
    D = np.zeros((alone.num_multibody_states(), plant.num_multibody_states(model)))
    D[np.concatenate(rows), np.concatenate(columns)] = 1.0
    return D


def connect_forces(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    forces: Mapping[ModelInstanceIndex, OutputPort],
) -> None:
    """Connect to the plant generalized forces on models, in their velocities' order."""
    ports = []
    for model, port in forces.items():
        D = np.zeros((plant.num_velocities(), port.size()))
        for column, unit in enumerate(np.eye(port.size())):
            v = np.zeros(plant.num_velocities())
            plant.SetVelocitiesInArray(model, unit, v)
            D[:, column] = v
        name = f"{plant.GetModelInstanceName(model)}:forces"
        ports.append(Wiring(builder).times(name, D, port))
    if ports:
        total = add_up(builder, "plant:generalized_forces", ports)
        builder.Connect(total, plant.get_applied_generalized_force_input_port())


def add_up(
    builder: DiagramBuilder, name: str, ports: Sequence[OutputPort]
) -> OutputPort:
    """Return the sum of ports of one size, one at least."""
    if len(ports) == 1:
        return ports[0]
    total = builder.AddNamedSystem(name, Adder(len(ports), ports[0].size()))
    for index, port in enumerate(ports):
        builder.Connect(port, total.get_input_port(index))
    return total.get_output_port()


def add_state_interfaces(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    description: RobotDescription,
    commanded: Sequence[str],
    effort: OutputPort | None,
    prefix: str,
) -> tuple[OutputPort, OutputPort]:
    """Add the measured quantities of all J joints, in the order of the description."""
    names = [joint.name for joint in description.movable_joints]
    num_states, J = plant.num_multibody_states(model), len(names)
    q_at, v_at = state_indices(plant, model, names)
    D = np.zeros((2 * J, num_states))
    for row in range(J):
        D[row, q_at[row]] = D[J + row, v_at[row]] = 1.0
    state = plant.get_state_output_port(model)
    motions = Wiring(builder).times(f"{prefix}joint_motions", D, state)
    states = builder.AddNamedSystem(f"{prefix}joint_states", Multiplexer([2 * J, J]))
    builder.Connect(motions, states.get_input_port(0))
    if effort is None:
        nothing = ConstantVectorSource(np.zeros(J))
        efforts = Wiring(builder).add(f"{prefix}joint_efforts", nothing)
    else:
        E = np.zeros((J, len(commanded)))
        for column, name in enumerate(commanded):
            E[names.index(name), column] = 1.0
        efforts = Wiring(builder).times(f"{prefix}joint_efforts", E, effort)
    builder.Connect(efforts, states.get_input_port(1))
    return motions, states.get_output_port()


def add_sensors(
    hardware: Hardware,
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    robot: Robot,
    prefix: str,
) -> Hardware:
    """Add a robot's sensors, export its contacts, and return the hardware with them."""
    readings = ContactReadings(plant, scene_graph, model, robot.description.links)
    builder.AddNamedSystem(f"{prefix}contacts", readings)
    readings.connect(builder)
    contacts = readings.get_output_port()
    # It costs nothing until somebody asks.
    builder.ExportOutput(contacts, f"{prefix}contacts")
    imus = {}
    for name, tag in imu_tags(robot.controllers).items():
        sensor = SensorInfo(name, IMU_INTERFACES, tag.link, tag.pose)
        readings = SensorReadings(plant, scene_graph, model, [sensor])
        builder.AddNamedSystem(f"{prefix}imu:{name}", readings)
        readings.connect(builder)
        imus[name] = readings.get_output_port()
    hardware = dc.replace(hardware, contacts=contacts, imus=imus)
    joints = accelerating_joints(robot.description)
    if not robot.sensors and not joints:
        return hardware
    readings = SensorReadings(plant, scene_graph, model, robot.sensors, joints)
    builder.AddNamedSystem(f"{prefix}sensors", readings)
    readings.connect(builder)
    return dc.replace(hardware, readings=readings.get_output_port())


def report_blind(robot: Robot, report: LoadReport) -> None:
    """Record the sensors of a robot that has no physics to measure."""
    file = robot.description.file
    for sensor in robot.sensors:
        what = f"sensor {sensor.name!r} measures nothing without physics"
        done = "its states keep their initial values, or follow their commands"
        report.add("info", "unsupported", what, done, file=file)
    for name in imu_tags(robot.controllers):
        what = f"IMU {name!r} measures nothing without physics"
        report.add("info", "unsupported", what, "its topic stays silent", file=file)
