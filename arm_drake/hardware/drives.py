"""Drives of a robot's joints: the servo's numbers, and the plant it computes with."""

import dataclasses as dc
import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake import interfaces
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.joint_limits import CommandLimits
from arm_drake.control.servo import (
    CAREFUL_OBSERVER_GAIN,
    OBSERVER_GAIN,
    DriveLimits,
    DynamicsSamples,
    ServoGains,
    compute_load_inertia,
    compute_rotor_inertia,
    compute_servo_gains,
)
from arm_drake.description.drive_gains import DriveGains
from arm_drake.description.joint_limits import find_joint_limits
from arm_drake.description.joints import JointInfo, JointLimits
from arm_drake.description.links import Pose
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.urdf import RobotDescription, reach, total_mass
from arm_drake.hardware.servo import DrivePid
from arm_drake.importing import dataclass
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.loaded_controllers import (
    LoadedController,
    command_order,
    enforces_limits,
)
from arm_drake.options import GRAVITY, SimulationOptions
from arm_drake.plant.joint_dynamics import (
    find_followers,
    sample_dynamics,
    sample_gravity,
    sum_friction,
    velocity_map,
)
from arm_drake.plant.plant import (
    fuse_fixed_links,
    make_reduced_plant,
    set_gravity,
    set_initial_positions,
    simple_joints,
    trial_plant,
)

# How far fingers are sent to let go of what they hold [m], [rad].
_LET_GO = (1e-3, 1e-2)

# Steps [s] above which a payload on a light joint is more than the servo can bear.
_LONG_STEP = 2e-3


def commanded_joints(description: RobotDescription) -> tuple[JointInfo, ...]:
    """Return the joints that have an actuator, in the order of the description.

    They are those with a command interface; mimic joints follow their master.
    """
    commanded = {
        component.name
        for block in description.hardware
        for component in block.joints
        if component.command_interfaces
    }
    joints = description.independent_joints
    return tuple(joint for joint in joints if joint.name in commanded)


def effort_limits(joints: Sequence[JointInfo]) -> list[float]:
    """Return effort limits [N·m] or [N], infinite where unset."""
    return [math.inf if (e := joint.limits.effort) is None else e for joint in joints]


@dataclass(frozen=True)
class RobotDrive:
    """Drive of a robot's n commanded joints."""

    # The joints, in the order of the description.
    joints: tuple[JointInfo, ...]

    # Plant that the servo computes with: the robot alone, on a fixed base, with what
    # the step adds to its inertia. It must live as long as the servo.
    plant: MultibodyPlant

    # Velocities of all joints per velocity of a commanded one, see `velocity_map`.
    N: np.ndarray

    # Inertia of the rotors that joints get, and of those that light joints lack
    # [kg·m^2], shape (n,).
    rotor_inertia: np.ndarray
    lacking_inertia: np.ndarray

    gains: ServoGains

    # Gains of joints that follow the law of a PID controller, if there are any.
    pid: DrivePid | None

    # Smallest inertia of each joint in all poses [kg·m^2], shape (n,).
    min_inertia: np.ndarray

    # Joints whose velocity is a rate times their position error.
    rated: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def rest_time(self) -> np.ndarray:
        """Lead of the position at which a moving joint would stop [s]."""
        return self.gains.kd / self.gains.kp


def make_robot_drive(
    description: RobotDescription,
    pose: Pose | None,
    options: SimulationOptions,
    time_step: float,
    *,
    declared_gains: Mapping[str, DriveGains] | None = None,
    effort_only: Collection[str] = (),
    lets_go: bool = False,
    grippers: Collection[str] = (),
    load_inertia: Mapping[str, float] | None = None,
    period: float = 0.0,
    trial: MultibodyPlant | None = None,
) -> RobotDrive:
    """Return what drives a robot's commanded joints.

    `declared_gains` are by joint; `effort_only` joints follow nothing but efforts, and
    get no rotor; `lets_go`: joints may move freely besides; `grippers` press and let
    go; wheels move `load_inertia` [kg·m^2]; `period` [s] is that of commands.
    """
    joints = commanded_joints(description)
    plant = make_servo_plant(description, pose, options, time_step, trial)
    N, n = velocity_map(plant, description, joints), len(joints)
    samples = sample_dynamics(plant, N, find_followers(plant, description))
    limits = drive_limits(joints)
    is_driven = np.array([j.name not in effort_only for j in joints], dtype=bool)
    strength = _strength(description, limits, samples)
    lacking = compute_rotor_inertia(samples, limits, strength, time_step) * is_driven
    rotors = lacking * _gets_rotors(options, time_step)
    add_rotors(plant, dict(zip([j.name for j in joints], rotors, strict=True)))
    if not options.gravity_compensation:
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    rows = [(declared_gains or {}).get(joint.name, DriveGains()) for joint in joints]
    pid = DrivePid([r.position_pid for r in rows], [r.velocity_pid for r in rows])
    is_passive = n < len(description.independent_joints)
    known = samples.with_rotors(rotors)
    gains = _make_gains(
        joints,
        known,
        limits,
        options,
        plant,
        load_inertia=load_inertia or {},
        is_careful=lets_go or is_passive or pid.has_gains or bool(load_inertia),
        command_period=period,
        friction=sum_friction(plant, description, joints) * options.friction,
        rates=[row.position_rate for row in rows],
    )
    rated = (j.name for j, row in zip(joints, rows, strict=True) if row.position_rate)
    return RobotDrive(
        joints=joints,
        plant=plant,
        N=N,
        rotor_inertia=rotors,
        lacking_inertia=lacking,
        gains=_with_grippers(gains, joints, limits, grippers),
        pid=pid if pid.has_gains else None,
        min_inertia=known.inertia.min(axis=0),
        rated=tuple(rated),
    )


def _make_gains(
    joints: Sequence[JointInfo],
    known: DynamicsSamples,
    limits: DriveLimits,
    options: SimulationOptions,
    plant: MultibodyPlant,
    *,
    load_inertia: Mapping[str, float],
    is_careful: bool,
    command_period: float,
    friction: np.ndarray,
    rates: Sequence[float | None],
) -> ServoGains:
    """Return the numbers of a servo; what wheels carry becomes rotors of its plant."""
    time_step, is_fast = plant.time_step(), options.preset == "fast"
    observer_gain = CAREFUL_OBSERVER_GAIN if is_careful else OBSERVER_GAIN
    if is_fast or not options.disturbance_observer:
        observer_gain = 0.0
    load = np.array([load_inertia.get(joint.name, 0.0) for joint in joints])
    ground = compute_load_inertia(
        known.inertia.min(axis=0),
        load,
        bandwidth=options.servo_bandwidth,
        time_step=time_step,
        observer_gain=observer_gain,
    )
    add_rotors(plant, dict(zip([j.name for j in joints], ground, strict=True)))
    return compute_servo_gains(
        known.with_rotors(ground),
        limits,
        bandwidth=options.servo_bandwidth,
        time_step=time_step,
        command_period=command_period,
        load_inertia=load,
        observer_gain=observer_gain,
        friction=friction,
        position_rate=np.array([rate or math.nan for rate in rates]),
        is_exact=is_fast,
        is_coordinated=not is_fast,
    )


def _gets_rotors(options: SimulationOptions, time_step: float) -> bool:
    """Return whether light joints get rotors of their own."""
    if options.reflected_inertia is not None:
        return options.reflected_inertia
    # Where nothing is unknown, there is no payload to need them.
    return time_step > _LONG_STEP and options.preset != "fast"


def _with_grippers(
    gains: ServoGains,
    joints: Sequence[JointInfo],
    limits: DriveLimits,
    grippers: Collection[str],
) -> ServoGains:
    """Return gains that know which joints press against things."""
    if not grippers:
        return gains
    at = tuple(i for i, joint in enumerate(joints) if joint.name in grippers)
    steps = np.where(limits.is_prismatic, *_LET_GO)
    return dc.replace(gains, grippers=at, step=steps)


def drive_limits(joints: Sequence[JointInfo]) -> DriveLimits:
    """Return what joints are allowed."""
    velocities = [joint.limits.velocity for joint in joints]
    endless = JointLimits()
    ranges = [
        (endless if joint.type == "continuous" else joint.limits).range
        for joint in joints
    ]
    return DriveLimits(
        np.array(effort_limits(joints)),
        np.array([math.inf if v is None else v for v in velocities]),
        np.array([joint.type == "prismatic" for joint in joints], dtype=bool),
        *np.array(ranges).reshape(-1, 2).T.copy(),
    )


def _strength(
    description: RobotDescription, limits: DriveLimits, samples: DynamicsSamples
) -> np.ndarray:
    """Return efforts that lift twice the whole robot [N], at arm's length [N·m]."""
    weight = GRAVITY * total_mass(description)
    largest = samples.max_gravity[~limits.is_prismatic].max(initial=0.0)
    torque = max(weight * reach(description), largest)
    return np.where(limits.is_prismatic, 2.0 * weight, 2.0 * torque)


def make_servo_plant(
    description: RobotDescription,
    pose: Pose | None,
    options: SimulationOptions,
    time_step: float,
    trial: MultibodyPlant | None = None,
) -> MultibodyPlant:
    """Return a plant that a servo computes with: one robot on a fixed base.

    It is made of the robot's plant on trial, if that has the same step. What is fixed
    to a link is a part of it: nobody asks this plant for links. Drake's discrete step
    treats damping D implicitly, that is, it moves M + h D: each joint has the inertia
    h D besides.
    """
    if trial is not None and trial.time_step() == time_step:
        plant = fuse_fixed_links(trial) or trial.Clone()
    else:
        whole = make_reduced_plant(description, pose, time_step)
        plant = fuse_fixed_links(whole) or whole
    set_gravity(plant, options)
    damping = {
        joint.name(): time_step * joint.default_damping_vector()[0]
        for joint in simple_joints(plant)
    }
    add_rotors(plant, damping)
    return plant


def add_rotors(
    plant: MultibodyPlant,
    inertias: Mapping[str, float],
    model: ModelInstanceIndex | None = None,
) -> None:
    """Give actuators more rotor inertia about their joint [kg·m^2], behind gears."""
    for name, inertia in inertias.items():
        actuator = (
            plant.GetJointActuatorByName(name)
            if model is None
            else plant.GetJointActuatorByName(name, model)
        )
        actuator.set_default_gear_ratio(1.0)
        actuator.set_default_rotor_inertia(
            actuator.default_rotor_inertia() + float(inertia)
        )


def find_effort_only_joints(
    robot: Robot, controllers: Iterable[LoadedController]
) -> frozenset[str]:
    """Return the joints that follow efforts and nothing else."""
    claimed = claimed_interfaces(robot, controllers)
    parts = [name.rpartition("/") for name in claimed]
    moved = {joint for joint, _, interface in parts if interface != interfaces.EFFORT}
    return frozenset(joint for joint, _, _ in parts) - moved


def are_all_pushed(robot: Robot, effort_only: Collection[str]) -> bool:
    """Return whether Gazebo's own plugins push all joints: then nobody holds them.

    `effort_only` are the joints that follow efforts and nothing else.
    """
    joints = {joint.name for joint in commanded_joints(robot.description)}
    is_all = bool(joints) and joints <= set(effort_only)
    return is_all and all(c.plugins for c in robot.controllers.controllers)


def may_let_go(robot: Robot, controllers: Iterable[LoadedController]) -> bool:
    """Return whether a joint may be commanded nothing but an effort."""
    return any(
        find_effort_only_joints(robot, [controller]) for controller in controllers
    )


def make_drive_commands(
    robot: Robot,
    hardware_interfaces: HardwareInterfaces,
    controllers: Sequence[LoadedController],
    drive: RobotDrive,
    *,
    holds: bool = True,
) -> DriveCommands:
    """Return the map from commands of controllers to commands of the servo."""
    positions = set(interfaces.interface_names(drive.names, [interfaces.POSITION]))
    return DriveCommands(
        drive.names,
        command_order(hardware_interfaces, controllers),
        velocity_lead=drive.rest_time,
        has_modes=not (
            holds
            and drive.pid is None
            and claimed_interfaces(robot, controllers) <= positions
        ),
        has_limits=any(c.system and c.system.limit_interfaces for c in controllers),
        holds=holds,
        stops=(drive.gains.lower, drive.gains.upper),
    )


def claimed_interfaces(
    robot: Robot, controllers: Iterable[LoadedController]
) -> set[str]:
    """Return the command interfaces by which controllers move driven joints."""
    joints = {joint.name for joint in commanded_joints(robot.description)}
    return {
        name
        for controller in controllers
        if controller.system is not None
        for name in controller.system.command_interfaces
        if name.rpartition("/")[0] in joints
        and name not in controller.system.limit_interfaces
    }


def make_command_limits(
    robot: Robot,
    hardware_interfaces: HardwareInterfaces,
    controllers: Iterable[LoadedController],
    report: LoadReport,
) -> CommandLimits | None:
    """Return what commands are held to, or None if they aren't."""
    if not enforces_limits(robot):
        return None
    return CommandLimits(
        find_joint_limits(robot.description, report),
        command_order(hardware_interfaces, controllers),
        hardware_interfaces.measured,
    )


# Poses in which a joint's effort limit is compared with gravity.
_NUM_POSES = 200


def check_model(robot: Robot) -> None:
    """Build a robot's model on trial, and record what is the matter with it.

    That is what Drake warns about, and joints whose effort limit is less than what
    gravity and dry friction ask for: in the initial pose, or in random ones within the
    limits.
    """
    description, options = robot.description, SimulationOptions()
    joints = commanded_joints(description)
    trial_plant(robot, robot.report)
    efforts, frictions = _loads(robot, options)
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
    """Return whether effort limits exceed weight and friction in all poses."""
    limits = effort_limits(commanded_joints(robot.description))
    efforts, frictions = _loads(robot, options)
    return bool((efforts.max(axis=0) + frictions <= np.array(limits)).all())


def _loads(robot: Robot, options: SimulationOptions) -> tuple[np.ndarray, np.ndarray]:
    """Return what holds n joints in some poses, the first one first, and friction.

    Both are of the commanded joints [N·m], of shapes (poses, n) and (n,).
    """
    description = robot.description
    joints = commanded_joints(description)
    plant = trial_plant(robot).Clone()
    set_gravity(plant, options)
    model = plant.GetModelInstanceByName("robot")
    set_initial_positions(plant, model, dict(robot.initial_positions))
    N = velocity_map(plant, description, joints)
    at = find_followers(plant, description)
    friction = sum_friction(plant, description, joints) * options.friction
    return np.abs(sample_gravity(plant, N, _NUM_POSES, at)), friction
