"""Dry friction of a robot's joints, as Drake systems in C++."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, AffineSystem, Saturation, ZeroOrderHold

from arm_drake.arrays import Array
from arm_drake.control.servo import FrictionGains, compute_friction_gains
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.wiring import Source, Wiring
from arm_drake.plant.joint_dynamics import (
    find_followers,
    sample_dynamics,
    sum_friction,
    velocity_map,
)
from arm_drake.plant.plant import state_indices


def make_dry_friction(
    friction: Array,
    gains: FrictionGains,
    initial: Array,
    num_states: int,
    positions_at: list[int],
    velocities_at: list[int],
    num_velocities: int,
    h: float,
) -> Diagram:
    """Return elastoplastic dry friction of n joints, with true sticking.

    The joint is held at an anchor a by a PD law that gives way at the friction f::

        tau  = clamp(kf (a - q) - df v, ±f)         a[+] = q + (tau + df v) / kf

    The input is the robot's state, the output the generalized forces on the robot's
    velocities. The state is a less the initial positions, so that it starts at zero,
    and zeros for the velocities.
    """
    n = len(friction)
    one, zero = np.eye(n), np.zeros((n, n))
    kf, df = np.diag(gains.kf), np.diag(gains.df)
    # The positions turn round, for anchors are added to them.
    picked = np.eye(num_states)[[*positions_at, *velocities_at]]
    picked[:n] *= -1.0
    start = np.concatenate([initial, np.zeros(n)])
    D = np.zeros((num_velocities, n))
    D[np.array(velocities_at) - (num_states - num_velocities), np.arange(n)] = 1.0
    wiring = Wiring(DiagramBuilder())
    builder = wiring.builder
    hold = builder.AddNamedSystem("a", ZeroOrderHold(h, 2 * n))
    back = wiring.add("back", _affine(picked, start), Source("state", num_states))
    # Differences of positions are taken first: these are small.
    gap = builder.AddNamedSystem("gap", Adder(2, 2 * n))
    for index, port in enumerate((back, hold.get_output_port())):
        builder.Connect(port, gap.get_input_port(index))
    pull = wiring.times("pull", np.hstack([kf, -df]), gap.get_output_port())
    limits = Saturation(min_value=-friction, max_value=friction)
    tau = wiring.add("tau", limits, pull)
    inverse = np.diag(1.0 / gains.kf)
    anchor = np.block([[-one, inverse @ df, inverse], [zero, zero, zero]])
    moved = wiring.times("moved", anchor, back, tau)
    builder.Connect(moved, hold.get_input_port())
    builder.ExportOutput(wiring.times("forces", D, tau), "forces")
    return builder.Build()


def _affine(D: Array, y0: Array) -> AffineSystem:
    """Return what computes D u + y0 of its input u."""
    none = np.zeros((0, 0))
    return AffineSystem(
        A=none,
        B=np.zeros((0, D.shape[1])),
        f0=np.zeros(0),
        C=np.zeros((len(D), 0)),
        D=D,
        y0=y0,
    )


class JointFriction(NamedTuple):
    """Dry friction of k joints."""

    names: tuple[str, ...]

    # [N·m], shape (k,).
    friction: np.ndarray

    # What holds them.
    gains: FrictionGains

    @property
    def deflection(self) -> np.ndarray:
        """Deflection of joints at full friction [rad], (k,)."""
        return self.friction / self.gains.kf


def make_robot_friction(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    alone: MultibodyPlant,
    description: RobotDescription,
    initial: Mapping[str, float],
) -> Diagram | None:
    """Return the dry friction of a robot's joints, or None if there is none.

    `alone` is the plant of `make_servo_plant`.
    """
    found = find_friction(alone, description)
    if not found.names:
        return None
    return make_dry_friction(
        found.friction,
        found.gains,
        np.array([initial[name] for name in found.names]),
        plant.num_multibody_states(model),
        *state_indices(plant, model, found.names),
        plant.num_velocities(model),
        plant.time_step(),
    )


def find_friction(
    alone: MultibodyPlant, description: RobotDescription
) -> JointFriction:
    """Return the joints that have dry friction, and how it holds them.

    `alone` is the plant of `make_servo_plant`, with the simulation's step.
    """
    free = description.independent_joints
    total = sum_friction(alone, description, free)
    joints = [joint for joint, f in zip(free, total, strict=True) if f > 0.0]
    if not joints:
        return JointFriction((), np.zeros(0), FrictionGains(np.zeros(0), np.zeros(0)))
    N = velocity_map(alone, description, joints)
    samples = sample_dynamics(alone, N, find_followers(alone, description))
    return JointFriction(
        tuple(joint.name for joint in joints),
        total[total > 0.0],
        compute_friction_gains(samples, alone.time_step()),
    )
