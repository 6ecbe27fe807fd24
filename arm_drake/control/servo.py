"""Gains of the joint servo, from samples of the robot's dynamics.

The joint servo is an ideal drive of bandwidth w0, weighted by the mass matrix, with a
disturbance observer. With z = exp(-w0 h) and the plant's step h, the poles of the
sampled position error are both at z, so a step settles in 5.83 / w0 at every h.
"""

import dataclasses as dc
import math

import numpy as np

from arm_drake.arrays import Array, Indices, Mask
from arm_drake.importing import dataclass

# Correlation of inertias above which joints push each other about.
_COUPLED = 0.02

# Rounds, and excess of an effort, at which the search for accelerations ends.
_ROUNDS = 200
_EXCESS = 1.01


def find_groups(masses: Array) -> Indices:
    """Return the number of the group of each joint, shape (n,).

    Joints of a group push each other about when they accelerate.
    """
    scale = np.sqrt(np.diagonal(masses, axis1=1, axis2=2))
    correlation = np.abs(masses / scale[:, :, None] / scale[:, None, :]).max(axis=0)
    group = np.arange(len(correlation))
    for i, j in np.argwhere(correlation > _COUPLED):
        if group[i] != group[j]:
            group[group == group[j]] = group[i]
    numbers: Indices = np.unique(group, return_inverse=True)[1]
    return numbers


def common_accelerations(masses: Array, spare: Array, largest: Array) -> Array:
    """Return accelerations that all joints can have at once, shape (n,)."""
    inertia = np.diagonal(masses, axis1=1, axis2=2).max(axis=0)
    found, rows = np.minimum(largest, spare / inertia), np.arange(len(spare))
    sizes = np.abs(masses)
    for _ in range(_ROUNDS):
        # What each joint asks of each other one, where that is most.
        totals = sizes @ found
        worst = totals.argmax(axis=0), rows
        excess = np.maximum(totals[worst] / spare, 1.0)
        if (excess < _EXCESS).all():
            break
        share = sizes[worst] * found / totals[worst][:, None]
        found = found * np.exp(-0.5 * (share * np.log(excess)[:, None]).max(axis=0))
    return found


# Share of a disturbance that the observer takes over at each step. Beside joints that
# move freely it is careful: they make a held joint several times lighter than the model
# says.
OBSERVER_GAIN = 0.8
CAREFUL_OBSERVER_GAIN = 0.2

# Speed at which a joint without a velocity limit approaches a position that is far
# away [rad/s] or [m/s]: a turn, or a metre, a second.
_PRISMATIC_SPEED = 1.0
_TURNING_SPEED = 2.0 * math.pi

# Acceleration that a drive gives its own rotor [rad/s^2] or [m/s^2]. A load that it can
# just carry at 0.1 m has 10 times the inertia of such a rotor, which is about what the
# observer bears.
_ROTOR_ACCELERATION = 1000.0

# Part of that inertia below which links are too light to be without.
_LIGHT = 0.1

# Part of what a robot is strong enough for that a joint without an effort limit has.
_UNKNOWN = 0.25

# Effort that stands for "no limit", as a multiple of what holds and accelerates.
_UNLIMITED_ACCELERATION = 100.0  # rad/s^2

# Parts of the acceleration that all joints can have at once, and of the effort beside
# gravity, that braking and steady motion make use of.
_BRAKING = 0.7
_CRUISING = 0.8

# A joint that can't carry its weight and so many times its friction is too weak for the
# others to wait for it.
_MUCH_FRICTION = 1.2


@dataclass(frozen=True)
class DynamicsSamples:
    """Dynamics of n joints at k configurations."""

    # Mass matrices [kg·m^2], shape (k, n, n).
    mass_matrix: Array

    # Efforts that hold the robot against gravity [N·m], shape (k, n).
    gravity: Array

    # Viscous damping [N·m·s/rad], shape (n,).
    damping: Array

    @property
    def inertia(self) -> Array:
        """Diagonals of the mass matrices [kg·m^2], shape (k, n)."""
        return np.diagonal(self.mass_matrix, axis1=1, axis2=2)

    @property
    def max_gravity(self) -> Array:
        """Largest effort of gravity [N·m], shape (n,)."""
        return np.abs(self.gravity).max(axis=0)

    def with_rotors(self, inertia: Array) -> "DynamicsSamples":
        """Return the dynamics with more inertia [kg·m^2] at the joints, shape (n,)."""
        mass_matrix = self.mass_matrix + np.diag(inertia)
        return dc.replace(self, mass_matrix=mass_matrix)


@dataclass(frozen=True)
class DriveLimits:
    """Limits of n joints in the description, infinite without an entry."""

    # Efforts [N·m] and velocities [rad/s], shape (n,).
    effort: Array
    velocity: Array

    # Which joints are prismatic, with N and m instead, shape (n,).
    is_prismatic: Mask

    # Positions between their stops [rad], shape (n,).
    lower: Array
    upper: Array

    @property
    def approach_speed(self) -> Array:
        """Largest speed towards a position that is far away [rad/s], shape (n,)."""
        speed = np.where(self.is_prismatic, _PRISMATIC_SPEED, _TURNING_SPEED)
        return np.where(np.isfinite(self.velocity), self.velocity, speed)


@dataclass(frozen=True)
class ServoGains:
    """Numbers of the joint servo for n joints; step h, bandwidth w0. Shapes (n,)."""

    # Proportional gain [1/s^2] and derivative gain [1/s] of a position error.
    kp: Array
    kd: Array

    # Gain of a velocity error [1/s], and the largest velocity that is followed [rad/s].
    kv: float
    velocity_limit: Array

    # What a desired velocity adds to the desired position [s], 2/w0 less (T + h)/2.
    velocity_lead: Array

    # Largest position error that is acted on [rad]: limits the speed of an approach. It
    # counts fully up to the braking error, further out as its square root, so that the
    # joint brakes in time.
    max_approach: Array
    braking_error: Array

    # Largest acceleration that is asked for [rad/s^2].
    max_acceleration: Array

    # Share of a disturbance that is taken over at each step; 0 without an observer.
    observer_gain: float

    # Largest acceleration that the observer adds [rad/s^2].
    max_disturbance: Array

    # Stops of the joints [rad]: what pushes into them is no load to be carried.
    lower: Array
    upper: Array

    # Effort limits, infinite where unset [N·m].
    effort_limit: Array

    # Whether a joint has a limit, and one above its own weight.
    is_strong: Mask

    # Number of the group of joints that a joint is in: those that push each other about
    # and wait for each other.
    group: Indices

    # Part of the command of the step before in what the servo follows. With it a joint
    # is where the ideal drive would be in continuous time, whatever the step.
    last_command: float = 0.0

    # Whether joints wait for each other where efforts are at their limits.
    is_coordinated: bool = True

    # Indices of grippers' joints, and steps of the position from which on a gripper
    # forgets what it pressed against [rad], shape (n,).
    grippers: tuple[int, ...] = ()
    step: Array = dc.field(default_factory=lambda: np.empty(0))

    @property
    def max_error(self) -> Array:
        """Largest sum of position error and lead that is acted on [rad]."""
        return self.velocity_limit * self.kd / self.kp


def velocity_lead(bandwidth: float) -> float:
    """Return what a desired velocity adds to the desired position [s]; w0 [rad/s]."""
    return 2.0 / bandwidth


def compute_rotor_inertia(
    samples: DynamicsSamples, limits: DriveLimits, strength: Array, time_step: float
) -> Array:
    """Return the inertia that the drives of light joints have themselves [kg·m^2].

    A description gives the inertia of links; that of rotors behind gears, which is the
    larger part in a light wrist, it leaves out. Without it a payload is far from what
    the servo knows, and the wrist drops it. Joints that have less than a tenth of it
    become as heavy as a drive of their effort that gives its own rotor 1000 rad/s^2.

    `strength` are efforts that are enough for anything the robot does [N·m], shape
    (n,): hundreds on a toy are placeholders. `time_step` is h [s]. Where the links are
    heavy enough the inertia is 0.
    """
    unknown = _UNKNOWN * strength
    effort = np.minimum(limits.effort, strength)
    effort = np.where(np.isfinite(limits.effort), effort, unknown)
    needed = effort / _ROTOR_ACCELERATION
    links = samples.inertia.min(axis=0) - time_step * samples.damping
    return np.where(links < _LIGHT * needed, needed - links, 0.0)


def compute_servo_gains(
    samples: DynamicsSamples,
    limits: DriveLimits,
    *,
    bandwidth: float,
    time_step: float,
    observer_gain: float = OBSERVER_GAIN,
    position_rate: Array | None = None,
    command_period: float = 0.0,
    load_inertia: Array | float = 0.0,
    friction: Array | float = 0.0,
    is_exact: bool = False,
    is_coordinated: bool = True,
) -> ServoGains:
    """Return the servo's numbers; one rule for every robot.

    `samples` have the step's damping h D and rotors in their inertia; `bandwidth` is w0
    [rad/s], `time_step` h [s], `command_period` T that at whose end a command is to be
    met [s], 0 is at once. `position_rate` is a velocity per position error to have
    instead [1/s], NaN is none; `load_inertia` the inertia of what wheels move on the
    ground [kg·m^2]; `friction` is dry [N·m]. Exact joints are where the ideal drive
    would be in continuous time, others up to half a step ahead; coordinated ones wait
    for each other at their effort limits, others have accelerations that all can have
    at once.
    """
    h, z = time_step, math.exp(-bandwidth * time_step)
    max_inertia, min_inertia = samples.inertia.max(axis=0), samples.inertia.min(axis=0)
    unlimited = _UNLIMITED_ACCELERATION * (max_inertia + load_inertia)
    effort, spare, is_strong, is_stuck = _find_efforts(
        limits.effort, unlimited, samples.max_gravity, friction
    )
    liveliest = 2.0 * bandwidth * limits.approach_speed
    with np.errstate(divide="ignore"):
        speed = np.minimum(limits.approach_speed, _CRUISING * spare / samples.damping)
    last = z * (z - 1.0 + bandwidth * h) / (1.0 - z) ** 2 if is_exact else 0.0
    ahead = _find_ahead(command_period, h, is_exact)
    lead = np.full(len(spare), velocity_lead(bandwidth) - ahead)
    kp, kd, lead, largest = _follow_rate(h, z, lead, liveliest, position_rate)
    together = common_accelerations(samples.mass_matrix, spare, liveliest)
    # The strong wait for each other, as the effort law makes them.
    most = np.where(is_strong, largest, np.minimum(spare / max_inertia, largest))
    return ServoGains(
        kp=kp,
        kd=kd,
        kv=(1.0 - z) / h,
        velocity_limit=limits.velocity,
        velocity_lead=lead,
        max_approach=speed * kd / kp,
        braking_error=_BRAKING * together * (kd / kp) ** 2,
        max_acceleration=most if is_coordinated else together,
        observer_gain=observer_gain,
        max_disturbance=np.where(is_stuck, 0.0, 2.0 * effort / min_inertia),
        effort_limit=limits.effort,
        is_strong=is_strong & np.isfinite(limits.effort),
        group=find_groups(samples.mass_matrix),
        lower=limits.lower,
        upper=limits.upper,
        last_command=last,
        is_coordinated=is_coordinated,
    )


def _find_efforts(
    limit: Array, unlimited: Array, gravity: Array, friction: Array | float
) -> tuple[Array, Array, Mask, Mask]:
    """Return the greatest efforts, and those that are left beside gravity, (n,) each.

    Also whether they overcome gravity and friction well, and whether not even friction:
    then there is no observer, which would learn of it without end. `unlimited` is of
    joints without a limit.
    """
    is_stuck = limit <= friction
    spare = np.maximum(limit - gravity, 0.1 * limit)
    return (
        np.where(np.isfinite(limit), limit, 2.0 * (gravity + unlimited)),
        np.where(is_stuck, 0.1 * limit, spare),
        limit > gravity + _MUCH_FRICTION * friction,
        is_stuck,
    )


def _find_ahead(command_period: float, time_step: float, is_exact: bool) -> float:
    """Return how far a position is ahead of the motion [s].

    While it is held it is T/2 ahead, on average; the sampled drive is h/2 ahead of the
    ideal one.
    """
    early = 0.0 if is_exact else time_step
    return (command_period + early) / 2.0 if command_period else 0.0


def _follow_rate(
    h: float, z: float, lead: Array, largest: Array, position_rate: Array | None
) -> tuple[Array, Array, Array, Array]:
    """Return kp, kd, velocity leads and greatest accelerations, by position rate."""
    n = len(lead)
    kp, kd = np.full(n, (1.0 - z) ** 2 / h**2), np.full(n, (1.0 - z**2) / h)
    if position_rate is not None:
        # The velocity becomes rate times error within a step, as in Gazebo.
        has_rate = np.isfinite(position_rate)
        kd[has_rate], lead[has_rate] = 1.0 / h, 0.0
        kp[has_rate] = position_rate[has_rate] / h
        largest = np.where(has_rate, math.inf, largest)
    return kp, kd, lead, largest


# Pole of the presliding motion.
_POLE = 0.2


@dataclass(frozen=True)
class FrictionGains:
    """Numbers of elastoplastic dry friction for n joints."""

    # Stiffness [N·m/rad] and damping [N·m·s/rad] of the presliding, shape (n,).
    kf: Array
    df: Array


def compute_friction_gains(samples: DynamicsSamples, time_step: float) -> FrictionGains:
    """Return the numbers of a friction that sticks and is stable at any step h [s].

    `samples` of all joints with friction have the step's damping h D in their inertia.
    """
    diagonal = samples.inertia
    scale = np.sqrt(diagonal)
    correlation = samples.mass_matrix / scale[:, :, None] / scale[:, None, :]
    coupling = float(np.linalg.eigvalsh(correlation).min())
    min_inertia = diagonal.min(axis=0)
    z = _POLE
    reach = coupling * min_inertia
    own = reach - coupling * time_step * samples.damping
    return FrictionGains(
        kf=reach * (1.0 - z) ** 2 / time_step**2,
        df=(own - reach * z**2) / time_step,
    )


def compute_load_inertia(
    wheels: Array,
    load_inertia: Array,
    *,
    bandwidth: float,
    time_step: float,
    observer_gain: float,
) -> Array:
    """Return what the servo of wheels adds to their inertia [kg·m^2], shape (n,).

    A wheel on the ground moves the base, and one in the air, or one that slips, only
    itself. The servo must be stable with both. Where the true inertia is r times the
    one it counts with, its error e and h times its observer's state J change by ::

        e[+] = (1 - c/r) e - J/r              c = 1 - z, z = exp(-w0 h)
        J[+] = (1 - b/r) J + b (1 - 1/r) c e

    with the observer's gain b. The determinant is 1 - (c + b - b c)/r. It is 0 at
    r = c + b - b c, where the roots are 0 and 1 - b c/r: so far the servo goes for a
    wheel alone, half way to where that one would be unstable. At 1 ms and b = 0.2 it
    counts with 4.3 times the wheel's inertia, and a base that is 15 times as heavy as
    its wheels follows with a damping of 0.7, not 0.35.

    `wheels` is the inertia of n wheels alone, `load_inertia` that of what each of them
    moves on the ground besides, 0 for joints that drive no base [kg·m^2]; `bandwidth`
    is w0 [rad/s], `time_step` h [s].
    """
    c, b = 1.0 - math.exp(-bandwidth * time_step), observer_gain
    least = c + b - b * c
    return np.minimum(load_inertia, (1.0 / least - 1.0) * wheels)
