"""Dynamics of a robot's commanded joints, which their mimic joints follow.

Gravity, inertia, damping and friction of all joints are added up at the joints that are
commanded, by virtual work.
"""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from arm_drake.arrays import Array
from arm_drake.control.servo import DynamicsSamples
from arm_drake.description.joints import JointInfo, last_master
from arm_drake.description.urdf import RobotDescription

# Configurations at which the dynamics is sampled. Of more joints than any robot has
# there are fewer, for a mass matrix has their square.
_NUM_SAMPLES = 100
_LEAST_SAMPLES = 10
_MANY_JOINTS = 100

# What picks them: NumPy's PCG64 of the seed 20260101, its first state and increment.
# To import NumPy's takes a hundredth of a start's instructions and 2.2 MB.
_FIRST = 0x57350C51801F1CF4E3B30DDFCF764493
_INCREMENT = 0x7E4FFFFAB14E3E3BE0452F35133326EB
_FACTOR = 0x2360ED051FC65DA44385DF649FCCF645
_64_BITS, _128_BITS = (1 << 64) - 1, (1 << 128) - 1

# Continuous joints, and joints with several turns, are sampled within one turn.
_TURN = np.pi


# Mimic joints: index of the position, of its last master's, factor, offset.
Followers = Sequence[tuple[int, int, float, float]]


def sample_gravity(
    plant: MultibodyPlant, N: Array, num_samples: int, followers: Followers = ()
) -> Array:
    """Return the efforts that hold the commanded joints against gravity.

    They are [N·m] or [N], shape (num_samples, n), of a finalized plant of this robot
    alone; the first row is of the default configuration. N is that of `velocity_map`.
    """
    return np.array(
        [
            -N.T @ plant.CalcGravityGeneralizedForces(context)
            for context in _poses(plant, num_samples, followers)
        ]
    )


def _poses(
    plant: MultibodyPlant, num_samples: int, followers: Followers
) -> Iterator[Context]:
    """Yield a context in the default configuration, then in random ones."""
    context, draws = plant.CreateDefaultContext(), draw()
    limits = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    lower, upper = _sampled_ranges(*limits)
    for sample in range(num_samples):
        if sample:
            parts = list(itertools.islice(draws, len(lower)))
            q = lower + (upper - lower) * parts
            for follower, master, factor, offset in followers:
                q[follower] = factor * q[master] + offset
            plant.SetPositions(context, q)
        yield context


def draw() -> Iterator[float]:
    """Yield numbers of at least 0 and less than 1, always the same."""
    state = _FIRST
    while True:
        state = (state * _FACTOR + _INCREMENT) & _128_BITS
        word, turn = (state >> 64) ^ (state & _64_BITS), state >> 122
        word = (word >> turn | word << (64 - turn)) & _64_BITS
        yield (word >> 11) * 2.0**-53


def _sampled_ranges(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the limits, but for ranges of more than a turn: the turn in the middle."""
    low = np.where(np.isfinite(lower), lower, np.minimum(-_TURN, upper - 2.0 * _TURN))
    high = np.where(np.isfinite(upper), upper, np.maximum(_TURN, lower + 2.0 * _TURN))
    low = np.where(np.isfinite(low), low, -_TURN)
    high = np.where(np.isfinite(high), high, _TURN)
    middle, half = (low + high) / 2.0, np.minimum((high - low) / 2.0, _TURN)
    return middle - half, middle + half


def sample_dynamics(
    plant: MultibodyPlant, N: Array, followers: Followers = ()
) -> DynamicsSamples:
    """Return the dynamics of the commanded joints at random configurations.

    The finalized plant holds this robot alone; N is that of `velocity_map`.
    """
    masses, gravities = [], []
    fewer = int(_NUM_SAMPLES * (_MANY_JOINTS / max(N.shape[0], 1)) ** 2)
    num_samples = min(max(fewer, _LEAST_SAMPLES), _NUM_SAMPLES)
    # Where nothing follows, N only picks joints: of many, products take a second.
    picks = bool(
        (np.count_nonzero(N, axis=0) == 1).all() and (N[N != 0.0] == 1.0).all()
    )
    rows = np.nonzero(N.T)[1]
    for context in _poses(plant, num_samples, followers):
        mass = plant.CalcMassMatrix(context)
        masses.append(mass[np.ix_(rows, rows)] if picks else N.T @ mass @ N)
        gravities.append(-N.T @ plant.CalcGravityGeneralizedForces(context))
    damping = np.zeros(plant.num_velocities())
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        for k in range(joint.num_velocities()):
            damping[joint.velocity_start() + k] = joint.default_damping_vector()[k]
    return DynamicsSamples(
        np.array(masses), np.array(gravities), np.square(N.T) @ damping
    )


def find_followers(plant: MultibodyPlant, description: RobotDescription) -> Followers:
    """Return the mimic joints, and what moves them in the end."""

    def at(name: str) -> int:
        return int(plant.GetJointByName(name).position_start())

    joints = {joint.name: joint for joint in description.movable_joints}
    followers = []
    for name, joint in joints.items():
        if joint.mimic is not None:
            master, factor, offset = last_master(joint, joints)
            followers.append((at(name), at(master), factor, offset))
    return followers


def sum_friction(
    plant: MultibodyPlant, description: RobotDescription, joints: Sequence[JointInfo]
) -> np.ndarray:
    """Return the dry friction of joints with that of their mimic joints, shape (n,).

    A follower's friction brakes its master, by virtual work.
    """
    own = np.zeros(plant.num_velocities())
    for joint in description.movable_joints:
        own[plant.GetJointByName(joint.name).velocity_start()] = joint.friction
    total: np.ndarray = np.abs(velocity_map(plant, description, joints).T) @ own
    return total


def velocity_map(
    plant: MultibodyPlant, description: RobotDescription, joints: Sequence[JointInfo]
) -> np.ndarray:
    """Return the velocities of all joints per velocity of a commanded joint: N.

    Its shape is (m, n), for a finalized plant of the robot alone with m velocities and
    n commanded joints: 1 for the joint itself, the multiplier for its mimic joints.
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
