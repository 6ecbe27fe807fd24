"""Gains of the joint servo and of dry friction, from samples of the robot's dynamics.

The joint servo is an ideal drive of bandwidth w0, weighted by the mass matrix, with a
disturbance observer. With z = exp(-w0 h) and the plant's step h, the poles of the
sampled position error are both at z, so a step settles in 5.83 / w0 at every h.
"""

import dataclasses as dc
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Share of a disturbance that the observer takes over at each step.
OBSERVER_GAIN = 0.2

# Pole of the presliding motion of dry friction.
_FRICTION_POLE = 0.2

# Effort that stands for "no limit", as a multiple of what holds and accelerates.
_UNLIMITED_ACCELERATION = 100.0  # rad/s^2


@dc.dataclass(frozen=True)
class DynamicsSamples:
    """Dynamics of n joints at k configurations."""

    # Mass matrices [kg·m^2], shape (k, n, n).
    mass_matrix: Array

    # Efforts that hold the robot against gravity [N·m], shape (k, n).
    gravity: Array

    # Viscous damping [N·m·s/rad], shape (n,).
    damping: Array


@dc.dataclass(frozen=True)
class ServoGains:
    """Numbers of the joint servo for n joints; step h, bandwidth w0."""

    # Proportional gain [1/s^2] and derivative gain [1/s].
    kp: float
    kd: float

    # Gain of a velocity error [1/s], and the largest velocity that is followed [rad/s],
    # shape (n,).
    kv: float
    velocity_limit: Array

    # What a desired velocity adds to the desired position, 2/w0 [s].
    velocity_lead: float

    # Largest position error that is acted on [rad], shape (n,): limits the speed.
    max_error: Array

    # Largest acceleration that is asked for [rad/s^2], shape (n,).
    max_acceleration: Array

    # Largest acceleration that the observer adds [rad/s^2], shape (n,).
    max_disturbance: Array

    # Effort limits, finite [N·m], shape (n,).
    effort_limit: Array


def velocity_lead(bandwidth: float) -> float:
    """Return what a desired velocity adds to the desired position [s].

    Args:
        bandwidth: w0 [rad/s].
    """
    return 2.0 / bandwidth


def compute_servo_gains(
    samples: DynamicsSamples,
    effort_limit: Array,
    velocity_limit: Array,
    *,
    bandwidth: float,
    time_step: float,
) -> ServoGains:
    """Return the servo's numbers; one rule for every robot.

    Args:
        samples: Dynamics of the commanded joints.
        effort_limit: Effort limits [N·m], infinite where unset, shape (n,).
        velocity_limit: Velocity limits [rad/s], infinite where unset, shape (n,).
        bandwidth: w0 [rad/s].
        time_step: Step of the plant h [s].
    """
    inertia = np.diagonal(samples.mass_matrix, axis1=1, axis2=2)
    max_inertia, min_inertia = inertia.max(axis=0), inertia.min(axis=0)
    max_gravity = np.abs(samples.gravity).max(axis=0)
    unlimited = 2.0 * (max_gravity + _UNLIMITED_ACCELERATION * max_inertia)
    effort = np.where(np.isfinite(effort_limit), effort_limit, unlimited)
    spare = np.maximum(effort - max_gravity, 0.1 * effort)
    z = math.exp(-bandwidth * time_step)
    return ServoGains(
        kp=(1.0 - z) ** 2 / time_step**2,
        kd=(1.0 - z**2) / time_step,
        kv=(1.0 - z) / time_step,
        velocity_limit=velocity_limit,
        velocity_lead=velocity_lead(bandwidth),
        max_error=2.0 / bandwidth * velocity_limit,
        max_acceleration=spare / (max_inertia + time_step * samples.damping),
        max_disturbance=2.0 * effort / min_inertia,
        effort_limit=effort,
    )


@dc.dataclass(frozen=True)
class FrictionGains:
    """Numbers of elastoplastic dry friction for n joints."""

    # Stiffness [N·m/rad] and damping [N·m·s/rad] of the presliding, shape (n,).
    kf: Array
    df: Array


def compute_friction_gains(samples: DynamicsSamples, time_step: float) -> FrictionGains:
    """Return the numbers of a friction that sticks and is stable at any step.

    Args:
        samples: Dynamics of all the joints that have friction.
        time_step: Step of the plant h [s].
    """
    diagonal = np.diagonal(samples.mass_matrix, axis1=1, axis2=2)
    scale = np.sqrt(diagonal)
    correlation = samples.mass_matrix / scale[:, :, None] / scale[:, None, :]
    coupling = float(np.linalg.eigvalsh(correlation).min())
    min_inertia = diagonal.min(axis=0)
    z = _FRICTION_POLE
    reach = coupling * (min_inertia + time_step * samples.damping)
    return FrictionGains(
        kf=reach * (1.0 - z) ** 2 / time_step**2,
        df=(coupling * min_inertia - reach * z**2) / time_step,
    )
