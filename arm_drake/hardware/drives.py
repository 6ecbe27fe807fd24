"""What drives a robot's joints: the numbers of its servo, and the plant it knows."""

import dataclasses as dc
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.control.servo import (
    CAREFUL_OBSERVER_GAIN,
    OBSERVER_GAIN,
    DriveLimits,
    DynamicsSamples,
    ServoGains,
    compute_rotor_inertia,
    compute_servo_gains,
)
from arm_drake.control.wheel_drive import compute_carried_inertia
from arm_drake.description.drive_gains import DriveGains
from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Pose
from arm_drake.description.summary import reach, total_mass
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.pid import DrivePid
from arm_drake.options import SimulationOptions
from arm_drake.plant.couplings import find_followers, sum_friction, velocity_map
from arm_drake.plant.dynamics_samples import sample_dynamics
from arm_drake.plant.plant import add_actuators, add_robot_model, set_gravity

# Standard gravity [m/s^2].
_GRAVITY = 9.81

# How far fingers are sent to let go of what they hold [m], [rad].
_LET_GO = (1e-3, 1e-2)

# Steps [s] above which a payload on a light joint is more than the servo can bear.
_LONG_STEP = 2e-3


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


@dc.dataclass(frozen=True)
class RobotDrive:
    """What drives a robot's n commanded joints."""

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
        """How far ahead of a moving joint the position is where it would stop [s]."""
        return self.gains.kd / self.gains.kp


def make_robot_drive(
    description: RobotDescription,
    pose: Pose | None,
    options: SimulationOptions,
    time_step: float,
    *,
    stated: Mapping[str, DriveGains] | None = None,
    bare: Collection[str] = (),
    lets_go: bool = False,
    grippers: Collection[str] = (),
    carried: Mapping[str, float] | None = None,
    period: float = 0.0,
) -> RobotDrive:
    """Return what drives a robot's commanded joints.

    Args:
        description: The robot.
        pose: Pose of its base in the world.
        options: How to simulate.
        time_step: Step of the simulated plant [s].
        stated: What the description itself says of drives, by joint.
        bare: Joints that follow nothing but efforts, which get no rotor.
        lets_go: Whether joints may move freely, beside those that are driven.
        grippers: Joints that press against things and let them go again.
        carried: Inertia of what wheels move on the ground [kg·m^2], by their joints.
        period: Period of the commands [s]; 0 if they are of now.
    """
    joints = commanded_joints(description)
    plant = make_servo_plant(description, pose, options, time_step)
    N, n = velocity_map(plant, description, joints), len(joints)
    samples = sample_dynamics(plant, N, find_followers(plant, description))
    limits = drive_limits(joints)
    is_driven = np.array([joint.name not in bare for joint in joints], dtype=bool)
    strength = _strength(description, limits, samples)
    lacking = compute_rotor_inertia(samples, limits, strength, time_step) * is_driven
    is_fast = options.preset == "fast"
    has_rotors = options.reflected_inertia
    if has_rotors is None:
        # Where nothing is unknown, there is no payload to need them.
        has_rotors = time_step > _LONG_STEP and not is_fast
    rotors = lacking if has_rotors else np.zeros(n)
    add_rotors(plant, dict(zip([j.name for j in joints], rotors, strict=True)))
    if not options.gravity_compensation:
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    rows = [(stated or {}).get(joint.name, DriveGains()) for joint in joints]
    pid = DrivePid([r.position_pid for r in rows], [r.velocity_pid for r in rows])
    is_passive = n < len([j for j in description.movable_joints if j.mimic is None])
    is_careful = lets_go or is_passive or pid.is_given or bool(carried)
    observer_gain = CAREFUL_OBSERVER_GAIN if is_careful else OBSERVER_GAIN
    if is_fast or not options.disturbance_observer:
        observer_gain = 0.0
    known = samples.with_rotors(rotors)
    load = np.array([(carried or {}).get(joint.name, 0.0) for joint in joints])
    ground = compute_carried_inertia(
        known.inertia.min(axis=0),
        load,
        bandwidth=options.servo_bandwidth,
        time_step=time_step,
        observer_gain=observer_gain,
    )
    add_rotors(plant, dict(zip([j.name for j in joints], ground, strict=True)))
    gains = compute_servo_gains(
        known.with_rotors(ground),
        limits,
        bandwidth=options.servo_bandwidth,
        time_step=time_step,
        command_period=period,
        carried=load,
        observer_gain=observer_gain,
        friction=sum_friction(plant, description, joints) * options.friction,
        position_rate=np.array([row.position_rate or math.nan for row in rows]),
        is_exact=is_fast,
        is_coordinated=not is_fast,
    )
    if grippers:
        at = tuple(i for i, joint in enumerate(joints) if joint.name in grippers)
        steps = np.where(limits.is_prismatic, *_LET_GO)
        gains = dc.replace(gains, grippers=at, step=steps)
    rated = [j.name for j, row in zip(joints, rows, strict=True) if row.position_rate]
    return RobotDrive(
        joints=joints,
        plant=plant,
        N=N,
        rotor_inertia=rotors,
        lacking_inertia=lacking,
        gains=gains,
        pid=pid if pid.is_given else None,
        min_inertia=known.inertia.min(axis=0),
        rated=tuple(rated),
    )


def drive_limits(joints: Sequence[JointInfo]) -> DriveLimits:
    """Return what joints are allowed."""
    velocities = [joint.limits.velocity for joint in joints]
    return DriveLimits(
        np.array(effort_limits(joints)),
        np.array([math.inf if v is None else v for v in velocities]),
        np.array([joint.type == "prismatic" for joint in joints], dtype=bool),
        *(np.array(ends) for ends in _ranges(joints)),
    )


def _ranges(joints: Sequence[JointInfo]) -> tuple[list[float], list[float]]:
    """Return where joints have their stops, infinite where none."""
    lower, upper = [], []
    for joint in joints:
        has_stops = joint.type != "continuous"
        low, high = joint.limits.lower, joint.limits.upper
        lower.append(low if has_stops and low is not None else -math.inf)
        upper.append(high if has_stops and high is not None else math.inf)
    return lower, upper


def _strength(
    description: RobotDescription, limits: DriveLimits, samples: DynamicsSamples
) -> np.ndarray:
    """Return efforts that lift twice the whole robot [N], at arm's length [N·m]."""
    weight = _GRAVITY * total_mass(description)
    largest = samples.max_gravity[~limits.is_prismatic].max(initial=0.0)
    torque = max(weight * reach(description), largest)
    return np.where(limits.is_prismatic, 2.0 * weight, 2.0 * torque)


def make_servo_plant(
    description: RobotDescription,
    pose: Pose | None,
    options: SimulationOptions,
    time_step: float,
    report: LoadReport | None = None,
) -> MultibodyPlant:
    """Return a plant that a servo computes with: one robot on a fixed base.

    Drake's discrete step treats damping D implicitly, that is, it moves M + h D: each
    joint has the inertia h D besides.

    Args:
        description: The robot.
        pose: Pose of its base in the world.
        options: How to simulate.
        time_step: Step of the simulated plant h [s].
        report: Where Drake's warnings about the description are recorded.
    """
    plant = MultibodyPlant(time_step)
    set_gravity(plant, options)
    model = add_robot_model(
        plant, description, "robot", pose, is_reduced=True, report=report
    )
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(model)]
    movable = [joint for joint in joints if joint.num_velocities() == 1]
    names = [joint.name() for joint in movable]
    add_actuators(plant, model, names, [math.inf] * len(names))
    plant.Finalize()
    damping = [time_step * joint.default_damping_vector()[0] for joint in movable]
    add_rotors(plant, dict(zip(names, damping, strict=True)))
    return plant


def add_rotors(
    plant: MultibodyPlant,
    inertias: Mapping[str, float],
    model: ModelInstanceIndex | None = None,
) -> None:
    """Give actuators more rotor inertia, as seen behind their gears.

    Args:
        plant: A plant with the actuators.
        inertias: Inertia about the joint [kg·m^2], by actuator.
        model: Model instance of the actuators, if there are several.
    """
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
