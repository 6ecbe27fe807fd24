"""The cost of the joint servo per step of the plant, beside what is usual in Drake.

All rows simulate the same robot, with its commanded joints near their initial positions
on slow sinusoids of commands held at 100 Hz; they take turns in one process, and time
is the processor's. There is no Python in any of them:

* the plant alone, moving freely: what no servo can do without;
* explicit PD: Drake's PidController, InverseDynamics that holds the robot's weight, and
  Saturation; all others are compared with it;
* lean PD: the same law of gains and adders, for PidController has an integral, hence
  the Simulator an integrator to run, even if its gain is zero;
* implicit PD: gains of Drake's JointActuators, and InverseDynamics that holds the
  weight;
* the servo, and what its options add or save.

A servo that isn't within 0.1 rad of its commands ends a table, and so does a free robot
that gains energy. The PD controllers only say how far they were away: their gains are
what is stable, and a robot whose joints are coupled by masses follows those loosely.

Dry friction acts in the rows that say so. Gravity doesn't act where nothing holds the
robot; Drake computes it all the same. Joints stay away from their limits, for Drake's
solver works there.

    python -m tests.benchmarks.servo [--robots NAME ...] [--runs 7] [--json FILE]
"""

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import InverseDynamics, PidController
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    MatrixGain,
    Saturation,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial

import arm_drake as ad
from arm_drake.control.drive_commands import NUM_PARTS, NUM_PARTS_OF_POSITIONS
from arm_drake.description.joints import last_master
from arm_drake.hardware.drives import (
    RobotDrive,
    add_rotors,
    effort_limits,
    make_robot_drive,
)
from arm_drake.hardware.hardware import add_hardware, connect_forces
from arm_drake.plant.joint_dynamics import find_followers, sample_dynamics
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    set_initial_positions,
    state_indices,
)
from tests.benchmarks.loading import find_entries

# The first one is bundled; those that aren't there are left out.
ROBOTS = ("doosan_a0912", "xarm6", "mycobot_280", "so100_brukg")

TIME_STEPS = (0.001, 0.01)

# Steps before the clock starts, and those that it counts in a turn.
WARM_UP, STEPS = 100, 1000

# Period of the commands, and of the sinusoids that they follow [s].
TICK, PERIOD = 0.01, 5.0

# Joints move by half of this about a place that is this far from their initial
# position, if their limits allow it [rad] or [m].
REACH = 0.2

# Our servo's joints are never further from their commands [rad].
LARGEST_ERROR = 0.1

# What no force acts on keeps its energy, but for what the steps make of it.
LARGEST_GAIN = 1.001

# The row that others are compared with.
PEER = "explicit PD"


class Case(NamedTuple):
    """A robot that is to be driven, and how."""

    robot: ad.Robot
    options: ad.SimulationOptions

    # What drives it; all rows have its rotors.
    drive: RobotDrive

    # Where the n commanded joints start, and how far they go from there [rad], (n,).
    start: np.ndarray
    reach: np.ndarray

    # Gains of a PD controller of the n joints [N·m/rad], [N·m·s/rad], shape (n,).
    kp: np.ndarray
    kd: np.ndarray

    # Commands are known for so long [s].
    duration: float

    def command(self, time: np.ndarray) -> np.ndarray:
        """Return positions and velocities of the n joints, shape (2n, len(time))."""
        w0 = 2.0 * math.pi / PERIOD
        q = self.start[:, None] + 0.5 * self.reach[:, None] * np.sin(w0 * time)
        v = 0.5 * self.reach[:, None] * w0 * np.cos(w0 * time)
        return np.vstack([q, v])


class Parts(NamedTuple):
    """What a controller is connected to."""

    builder: DiagramBuilder
    plant: MultibodyPlant
    model: ModelInstanceIndex
    case: Case


class Subject(NamedTuple):
    """What is measured."""

    diagram: Diagram
    plant: MultibodyPlant
    case: Case

    # Whether anything drives the joints, and whether that is our servo.
    is_driven: bool
    has_servo: bool


# Adds what drives a robot.
AddController = Callable[[Parts], None]


def make_case(robot: ad.Robot, options: ad.SimulationOptions, duration: float) -> Case:
    """Return what is common to all rows of a robot at one step.

    Args:
        robot: The robot.
        options: How to simulate.
        duration: How long [s].
    """
    description, step = robot.description, options.time_step
    drive = make_robot_drive(description, robot.pose, options, step)
    start, reach = [], []
    for joint in drive.joints:
        q, limits = robot.initial_positions[joint.name], joint.limits
        below = math.inf if limits.lower is None else q - limits.lower
        above = math.inf if limits.upper is None else limits.upper - q
        way = min(REACH, max(below, above) / 2.0) * (1.0 if above >= below else -1.0)
        start.append(q + way)
        reach.append(way)
    samples = sample_dynamics(
        drive.plant, drive.N, find_followers(drive.plant, description)
    ).with_rotors(drive.rotor_inertia)
    # Diagonal gains are stable at any step if they are less than what the mass matrix
    # would make of them: by as much as joints are coupled.
    scale = np.sqrt(samples.inertia)
    coupling = samples.mass_matrix / scale[:, :, None] / scale[:, None, :]
    inertia = samples.inertia.min(axis=0) * np.linalg.eigvalsh(coupling).min()
    w0, damping = options.servo_bandwidth, samples.damping
    kp = np.maximum(w0**2 * inertia, w0 * damping)
    return Case(
        robot=robot,
        options=options,
        drive=drive,
        start=np.array(start),
        reach=np.array(reach),
        kp=kp,
        kd=np.maximum(2.0 * np.sqrt(kp * inertia) - damping, 0.0),
        duration=duration,
    )


def make_subject(
    case: Case,
    add_controller: AddController | None,
    *,
    is_implicit: bool = False,
    has_servo: bool = False,
) -> Subject:
    """Return a robot with what drives it, if anything.

    Args:
        case: The robot.
        add_controller: Adds that.
        is_implicit: Whether its actuators have the PD gains.
        has_servo: Whether it is our servo.
    """
    description, options, drive = case.robot.description, case.options, case.drive
    builder = DiagramBuilder()
    plant, _ = add_plant(builder, options.time_step, options)
    model = add_robot_model(
        plant, description, "robot", case.robot.pose, is_reduced=True
    )
    limits = effort_limits(drive.joints)
    actuators = add_actuators(plant, model, drive.names, limits)
    if is_implicit:
        for actuator, kp, kd in zip(actuators, case.kp, case.kd, strict=True):
            actuator.set_controller_gains(PdControllerGains(p=kp, d=kd))
    set_initial_positions(plant, model, positions_at_start(case))
    plant.Finalize()
    if not has_servo:
        # Hardware adds them itself.
        rotors = zip(drive.names, drive.rotor_inertia, strict=True)
        add_rotors(plant, dict(rotors), model)
    if add_controller is None:
        nothing = builder.AddSystem(ConstantVectorSource(np.zeros(len(limits))))
        builder.Connect(nothing.get_output_port(), plant.get_actuation_input_port())
    else:
        add_controller(Parts(builder, plant, model, case))
    return Subject(builder.Build(), plant, case, add_controller is not None, has_servo)


def positions_at_start(case: Case) -> dict[str, float]:
    """Return where all joints start, by name."""
    positions = dict(case.robot.initial_positions)
    positions |= zip(case.drive.names, case.start.tolist(), strict=True)
    joints = {joint.name: joint for joint in case.robot.description.movable_joints}
    for joint in joints.values():
        if joint.mimic is not None:
            master, factor, offset = last_master(joint, joints)
            positions[joint.name] = factor * positions[master] + offset
    return positions


def add_commands(parts: Parts, num_parts: int) -> OutputPort:
    """Add the commands: positions, velocities, and zeros for what else may be told."""
    ticks = TICK * np.arange(math.ceil(parts.case.duration / TICK) + 2)
    commands = parts.case.command(ticks)
    zeros = np.zeros(((num_parts - 2) * len(parts.case.start), len(ticks)))
    held = PiecewisePolynomial.ZeroOrderHold(ticks, np.vstack([commands, zeros]))
    return parts.builder.AddSystem(TrajectorySource(held)).get_output_port()


def add_weight(parts: Parts) -> OutputPort:
    """Add the efforts that hold the robot against gravity."""
    builder, plant, N = parts.builder, parts.plant, parts.case.drive.N
    mode = InverseDynamics.InverseDynamicsMode.kGravityCompensation
    weight = builder.AddSystem(InverseDynamics(plant, mode))
    state = plant.get_state_output_port(parts.model)
    builder.Connect(state, weight.get_input_port_estimated_state())
    efforts = weight.get_output_port_generalized_force()
    if np.array_equal(N, np.eye(len(N))):
        return efforts
    gather = builder.AddSystem(MatrixGain(N.T))
    builder.Connect(efforts, gather.get_input_port())
    return gather.get_output_port()


def pick_joints(parts: Parts) -> np.ndarray:
    """Return what picks [q; v] of the commanded joints from the robot's state."""
    at = state_indices(parts.plant, parts.model, parts.case.drive.names)
    return np.eye(parts.plant.num_multibody_states(parts.model))[np.concatenate(at)]


def add_saturated_sum(parts: Parts, *ports: OutputPort) -> None:
    """Let a sum of efforts act, each within its limit."""
    builder = parts.builder
    total = builder.AddSystem(Adder(len(ports), ports[0].size()))
    for index, port in enumerate(ports):
        builder.Connect(port, total.get_input_port(index))
    limits = np.array(effort_limits(parts.case.drive.joints))
    saturation = builder.AddSystem(Saturation(-limits, limits))
    builder.Connect(total.get_output_port(), saturation.get_input_port())
    actuation = parts.plant.get_actuation_input_port(parts.model)
    builder.Connect(saturation.get_output_port(), actuation)


def add_explicit_pd(parts: Parts) -> None:
    """Add Drake's PidController, which also holds the robot's weight."""
    builder, case = parts.builder, parts.case
    pid = builder.AddSystem(
        PidController(pick_joints(parts), case.kp, np.zeros_like(case.kp), case.kd)
    )
    state = parts.plant.get_state_output_port(parts.model)
    builder.Connect(state, pid.get_input_port_estimated_state())
    commands = add_commands(parts, NUM_PARTS_OF_POSITIONS)
    builder.Connect(commands, pid.get_input_port_desired_state())
    add_saturated_sum(parts, pid.get_output_port_control(), add_weight(parts))


def add_lean_pd(parts: Parts) -> None:
    """Add the same PD law, of gains."""
    builder, case = parts.builder, parts.case
    K = np.hstack([np.diag(case.kp), np.diag(case.kd)])
    requested, there = (
        builder.AddSystem(MatrixGain(D)) for D in (K, -K @ pick_joints(parts))
    )
    commands = add_commands(parts, NUM_PARTS_OF_POSITIONS)
    state = parts.plant.get_state_output_port(parts.model)
    builder.Connect(commands, requested.get_input_port())
    builder.Connect(state, there.get_input_port())
    add_saturated_sum(
        parts, requested.get_output_port(), there.get_output_port(), add_weight(parts)
    )


def add_implicit_pd(parts: Parts) -> None:
    """Tell the actuators what is desired, and hold the robot's weight."""
    plant, model = parts.plant, parts.model
    commands = add_commands(parts, NUM_PARTS_OF_POSITIONS)
    parts.builder.Connect(commands, plant.get_desired_state_input_port(model))
    actuation = plant.get_actuation_input_port(model)
    parts.builder.Connect(add_weight(parts), actuation)


def add_servo(parts: Parts, *, has_modes: bool = False) -> None:
    """Add our servo, and dry friction if it acts."""
    builder, plant, model, case = parts
    hardware = add_hardware(
        builder,
        plant,
        model,
        case.robot.description,
        prefix="",
        drive=case.drive,
        initial=positions_at_start(case),
        options=case.options,
        has_modes=has_modes,
    )
    assert hardware.command is not None
    num_parts = NUM_PARTS if has_modes else NUM_PARTS_OF_POSITIONS
    builder.Connect(add_commands(parts, num_parts), hardware.command)
    if hardware.friction is not None:
        connect_forces(builder, plant, {model: hardware.friction})


def make_subjects(
    robot: ad.Robot, time_step: float, duration: float
) -> dict[str, Subject]:
    """Return what is measured, by its name."""

    def case(**settings: Any) -> Case:
        options = ad.SimulationOptions(time_step=time_step, **settings)
        return make_case(robot, options, duration)

    def servo(case: Case, *, has_modes: bool = False) -> Subject:
        add = partial(add_servo, has_modes=has_modes)
        return make_subject(case, add, has_servo=True)

    plain = case(friction=False)
    subjects = {
        "plant alone": make_subject(case(friction=False, gravity=False), None),
        PEER: make_subject(plain, add_explicit_pd),
        "lean PD": make_subject(plain, add_lean_pd),
        "implicit PD": make_subject(plain, add_implicit_pd, is_implicit=True),
        "servo": servo(plain),
        "servo, modes": servo(plain, has_modes=True),
    }
    if any(joint.friction for joint in robot.description.movable_joints):
        rubbed = case()
        subjects["servo, friction"] = servo(rubbed)
        subjects["servo, modes, friction"] = servo(rubbed, has_modes=True)
    ignorant = case(
        friction=False,
        gravity=False,
        gravity_compensation=False,
        friction_compensation=False,
        disturbance_observer=False,
    )
    subjects["servo, all options off"] = servo(ignorant)
    return subjects


def start(subject: Subject) -> Simulator:
    """Return a simulator that has done the first steps of a subject."""
    simulator = Simulator(subject.diagram)
    simulator.Initialize()
    simulator.AdvanceTo(WARM_UP * subject.case.options.time_step)
    return simulator


class Turn(NamedTuple):
    """What was measured in one turn."""

    # What a step takes [us].
    cost: float

    # How far the driven joints are from their commands at its end [rad].
    error: float


def time_steps(subject: Subject, simulator: Simulator) -> Turn:
    """Return what a step takes.

    Raises:
        RuntimeError: If what was simulated isn't what is to be measured.
    """
    duration = STEPS * subject.case.options.time_step
    if not subject.is_driven:
        set_moving(subject, simulator, duration)
    before = kinetic_energy(subject, simulator)
    end = simulator.get_context().get_time() + duration
    # Of the processor: what else runs on the machine doesn't count.
    begin = time.process_time()
    simulator.AdvanceTo(end)
    cost = 1e6 * (time.process_time() - begin) / STEPS
    if not subject.is_driven:
        gain = kinetic_energy(subject, simulator) / before
        if not gain <= LARGEST_GAIN:
            raise RuntimeError(f"a free robot has {gain:.4f} times its energy")
        return Turn(cost, 0.0)
    errors = position_errors(subject, simulator)
    if not np.isfinite(errors).all():
        raise RuntimeError("joints are nowhere")
    if subject.has_servo and not (errors <= LARGEST_ERROR).all():
        raise RuntimeError(f"joints are {errors} away from where they should be")
    return Turn(cost, errors.max())


def set_moving(subject: Subject, simulator: Simulator, duration: float) -> None:
    """Let joints move slowly, for at rest Drake has less to solve."""
    plant, drive = subject.plant, subject.case.drive
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, plant.GetPositions(plant.CreateDefaultContext()))
    plant.SetVelocities(context, drive.N @ (0.5 * subject.case.reach / duration))


def kinetic_energy(subject: Subject, simulator: Simulator) -> float:
    """Return the robot's kinetic energy [J]."""
    plant, root = subject.plant, simulator.get_context()
    energy: float = plant.CalcKineticEnergy(plant.GetMyContextFromRoot(root))
    return energy


def position_errors(subject: Subject, simulator: Simulator) -> np.ndarray:
    """Return how far the n joints are from their commands [rad], shape (n,)."""
    plant, case, root = subject.plant, subject.case, simulator.get_context()
    q = plant.GetPositions(plant.GetMyContextFromRoot(root))
    names = case.drive.names
    at = [plant.GetJointByName(name).position_start() for name in names]
    now = np.array([root.get_time()])
    errors: np.ndarray = np.abs(q[at] - case.command(now)[: len(names), 0])
    return errors


def measure(name: str, robot: ad.Robot, time_step: float, runs: int) -> dict[str, Any]:
    """Return what a step of each subject takes, in turns."""
    duration = time_step * (WARM_UP + (runs + 1) * STEPS)
    subjects = make_subjects(robot, time_step, duration)
    simulators = {key: start(subject) for key, subject in subjects.items()}
    # The first turn warms up.
    turns = [
        {key: time_steps(subjects[key], simulators[key]) for key in subjects}
        for _ in range(runs + 1)
    ][1:]
    rows = []
    for key in subjects:
        times = [turn[key].cost for turn in turns]
        ratios = [turn[key].cost / turn[PEER].cost for turn in turns]
        median = statistics.median(times)
        rows.append(
            {
                "name": key,
                "median": median,
                "least": min(times),
                "most": max(times),
                "real_time_factor": 1e6 * time_step / median,
                "ratio": statistics.median(ratios),
                "ratio_min": min(ratios),
                "ratio_max": max(ratios),
                "error": max(turn[key].error for turn in turns),
            }
        )
    case = subjects[PEER].case
    joints = len(case.drive.N), len(case.start)
    return {"robot": name, "joints": joints, "time_step": time_step, "rows": rows}


def format_table(found: dict[str, Any]) -> str:
    """Return the rows of a robot at one step."""
    joints, driven = found["joints"]
    title = f"{found['robot']}, {1e3 * found['time_step']:.0f} ms"
    of_joints = f"{driven} of {joints} joints driven"
    lines = [
        f"{title}, {of_joints}",
        f"{'':24s} us per step (range)    x real time    x {PEER} (range)    error",
    ]
    for row in found["rows"]:
        span = f"({row['least']:.1f} to {row['most']:.1f})"
        ratios = f"({row['ratio_min']:.2f} to {row['ratio_max']:.2f})"
        lines.append(
            f"{row['name']:24s} {row['median']:6.1f} {span:17s}"
            f"{row['real_time_factor']:10.1f}{row['ratio']:12.2f} "
            f"{ratios:22s}{row['error']:.0e}"
        )
    return "\n".join(lines)


def find_robots(names: list[str] | None) -> Mapping[str, dict[str, Any]]:
    """Return how to load the robots that are there, by name.

    Raises:
        KeyError: If one that was asked for isn't.
    """
    entries = {entry["name"]: entry["options"] for entry in find_entries()}
    if names is None:
        names = [name for name in ROBOTS if name in entries]
    return {name: entries[name] for name in names}


def main() -> None:
    """Print the tables, and write them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robots", nargs="+", metavar="NAME")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    try:
        robots = find_robots(options.robots)
    except KeyError as error:
        parser.error(f"no robot {error}")
    tables, problems = [], []
    for name, settings in robots.items():
        robot = ad.load_robot(**settings)
        for time_step in TIME_STEPS:
            try:
                tables.append(measure(name, robot, time_step, options.runs))
            except RuntimeError as error:  # The others are to be measured all the same.
                problems.append(f"{name}, {1e3 * time_step:g} ms: {error}")
                continue
            print(format_table(tables[-1]), end="\n\n", flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps(tables, indent=2) + "\n")
    if problems:
        sys.exit("\n".join(problems))


if __name__ == "__main__":
    main()
