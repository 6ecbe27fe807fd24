"""Dry friction of a robot's joints, as Drake systems in C++."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import LinearSystem, MatrixGain, Saturation

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


class DryFriction:
    """Elastoplastic dry friction of k joints, with true sticking, in two systems.

    A joint is held at an anchor a by a PD law that gives way at the friction f::

        tau  = clamp(kf (a - q) - df v, ±f)         a[+] = q + (tau + df v) / kf

    From step to step kf a is kept, which is tau + kf q + df v: sums of what it is read
    from, so that it can stand in one system with what else is kept.
    """

    def __init__(
        self,
        found: JointFriction,
        start: Sequence[float],
        num_states: int,
        positions_at: Sequence[int],
        velocities_at: Sequence[int],
    ) -> None:
        """Create it for joints at indices of a robot's state; they start at rest."""
        self.names, self._limit = found.names, found.friction
        kf, df = np.diag(found.gains.kf), np.diag(found.gains.df)
        picked = np.eye(num_states)[[*positions_at, *velocities_at]]
        self._K = np.hstack([kf, df]) @ picked
        self.kept_at_start = found.gains.kf * start

    @property
    def num_joints(self) -> int:
        """Number of joints k."""
        return len(self.names)

    def add(self, wiring: Wiring, read: OutputPort) -> OutputPort:
        """Add the output of what computes tau of the state, then of what is kept."""
        pull = MatrixGain(np.hstack([-self._K, np.eye(self.num_joints)]))
        limits = Saturation(min_value=-self._limit, max_value=self._limit)
        tau = wiring.add("friction", limits, wiring.add("pull", pull, read))
        wiring.builder.ExportOutput(tau, "friction")
        return tau

    def keep(self) -> Array:
        """Return what makes of the state, then tau, what is kept."""
        return np.hstack([self._K, np.eye(self.num_joints)])


def make_memory(made_of: Array, start: Array, h: float) -> LinearSystem:
    """Return a system that shows at each step what it was given in the last one.

    It keeps a matrix times its input. A system that keeps something makes all that
    hangs on it out of date at each step, so what is kept is best in one.
    """
    none, one = np.zeros((len(made_of), len(made_of))), np.eye(len(made_of))
    memory = LinearSystem(A=none, B=made_of, C=one, D=0.0 * made_of, time_period=h)
    memory.configure_default_state(start)
    return memory


def make_dry_friction(dry: DryFriction, num_states: int, h: float) -> Diagram:
    """Return dry friction on its own: its input is the robot's state."""
    wiring = Wiring(DiagramBuilder())
    state = Source("state", num_states)
    memory = make_memory(dry.keep(), dry.kept_at_start, h)
    kept = wiring.builder.AddNamedSystem("memory", memory).get_output_port()
    tau = dry.add(wiring, wiring.join("inputs", [state, kept]))
    found = wiring.join("memory:inputs", [state, tau])
    wiring.builder.Connect(found, memory.get_input_port())
    return wiring.build("dry_friction")


def find_dry_friction(
    alone: MultibodyPlant, description: RobotDescription, initial: Mapping[str, float]
) -> DryFriction | None:
    """Return the dry friction of a robot's joints, or None if there is none.

    `alone` is the plant of `make_servo_plant`, whose state it reads; `initial` are the
    positions of joints by their names.
    """
    found = find_friction(alone, description)
    if not found.names:
        return None
    return DryFriction(
        found,
        [initial[name] for name in found.names],
        alone.num_multibody_states(),
        *state_indices(alone, alone.GetModelInstanceByName("robot"), found.names),
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
