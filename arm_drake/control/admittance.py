"""The law of an admittance, by which an arm gives way to a wrench, and its integration.

The rules are those of ros2_controllers' admittance_controller
(``admittance_rule_impl.hpp``, version 6.9.0). n is the number of joints. Frames: B is
the base of the chain, S that of the sensor, C that in which the arm gives way, G that
of the centre of gravity of what the sensor carries, W that in which gravity points
along -z. Vectors of six are along, then about x, y and z.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.importing import dataclass
from arm_drake.messages import Message


class ChainKinematics(Protocol):
    """Kinematics of the links of a robot when n joints move, seen from a base."""

    def pose(self, q: Array, link: str) -> Array:
        """Return the pose of a link in the base, shape (4, 4).

        `q` [rad] or [m], shape (n,).
        """

    def jacobian(self, q: Array, link: str) -> Array:
        """Return what joint velocities move a link by, in the base, shape (6, n).

        `q` [rad] or [m], shape (n,).
        """

    def joints_to(self, link: str) -> tuple[str, ...]:
        """Return the movable joints between the base and a link."""


class AdmittanceFrames(NamedTuple):
    """Orientations and offsets of frames in the base, at the measured positions."""

    # Rotations, each of shape (3, 3).
    R_BS: Array
    R_BC: Array
    R_BG: Array
    R_BW: Array

    # From the sensor's pose at the references to the one that is measured [m], and the
    # axis of the rotation times its angle [rad], shape (6,), in B.
    displacement: Array

    # Jacobian of the sensor's frame, shape (6, n), in B.
    jacobian: Array


class AdmittanceState(NamedTuple):
    """State that is kept from tick to tick."""

    # Wrench that acts, filtered, in W and in B [N], [N·m], shape (6,).
    wrench_W: Array
    wrench_B: Array

    # What joints are moved by beside their references, shape (n,).
    position: Array
    velocity: Array
    acceleration: Array

    # The same of the sensor's frame in B, shape (6,).
    twist: Array
    twist_rate: Array

    @classmethod
    def initial(cls, n: int) -> Self:
        """Return the state at rest, of n joints."""
        return cls(*np.zeros((2, 6)), *np.zeros((3, n)), *np.zeros((2, 6)))


@dataclass(frozen=True, eq=False)
class AdmittanceRule(Message):
    """Admittance of an arm; arrays are of six values, but for the last one."""

    # Axes of C along and about which the wrench counts.
    selected_axes: Sequence[bool]

    # Mass [kg], [kg·m^2], relative damping, and stiffness [N/m], [N·m/rad].
    mass: Array
    damping_ratio: Array
    stiffness: Array

    # Whether the mass is given along and about the axes of C, too, not of B.
    is_mass_in_control_frame: bool

    # Damping of the joints' own velocities [1/s].
    joint_damping: float

    # Damping of the inverse of the Jacobian.
    alpha: float

    # Weight of a new measurement.
    filter_coefficient: float

    # Weight of what the sensor carries [N], and where its centre is in G [m], (3,).
    weight: float
    center_of_gravity: Array

    @property
    def damping(self) -> Array:
        """Damping [N·s/m], [N·m·s/rad], shape (6,)."""
        return 2.0 * np.array(self.damping_ratio) * np.sqrt(self.mass * self.stiffness)

    def step(
        self,
        state: AdmittanceState,
        frames: AdmittanceFrames,
        wrench_S: Array,
        period: float,
    ) -> AdmittanceState:
        """Return the state after a tick: filter, law, semi-implicit Euler step.

        With X the displacement, F the filtered wrench and s the selected axes, all in
        C, and J+ the damped inverse of the Jacobian J::

            M X'' = s F - D X' - K X,    q'' = J+ X'' - joint_damping q'

        Where the mass isn't given in C, the first equation is turned into B before it
        is divided by M.

        An admittance that is too stiff for its period grows until nothing of it is
        finite.

        `wrench_S` is what is measured, in S [N], [N·m], shape (6,); `period` [s].
        """
        with np.errstate(over="ignore", invalid="ignore"):
            wrench_W = self._filter(state.wrench_W, frames, wrench_S)
            wrench_B = _rotate(frames.R_BW, wrench_W)
            R_BC, J = frames.R_BC, frames.jacobian
            F = np.where(self.selected_axes, _rotate(R_BC.T, wrench_B), 0.0)
            X, X_dot = (_rotate(R_BC.T, x) for x in (frames.displacement, state.twist))
            force = F - self.damping * X_dot - self.stiffness * X
            if self.is_mass_in_control_frame:
                twist_rate = _rotate(R_BC, force / self.mass)
            else:
                twist_rate = _rotate(R_BC, force) / self.mass
            requested = self._invert(J, twist_rate)
            acceleration = requested - self.joint_damping * state.velocity
            velocity = state.velocity + acceleration * period
            position = state.position + velocity * period
            return AdmittanceState(
                wrench_W,
                wrench_B,
                position,
                velocity,
                acceleration,
                J @ velocity,
                J @ acceleration,
            )

    def _filter(
        self, last_W: Array, frames: AdmittanceFrames, wrench_S: Array
    ) -> Array:
        """Return the wrench without what gravity does, filtered, in W."""
        R_WB = frames.R_BW.T
        wrench = _rotate(R_WB @ frames.R_BS, wrench_S)
        weight = np.array([0.0, 0.0, -self.weight])
        arm = R_WB @ frames.R_BG @ self.center_of_gravity
        wrench -= np.concatenate([weight, np.cross(arm, weight)])
        return self.filter_coefficient * wrench + (1.0 - self.filter_coefficient) * (
            last_W
        )

    def _invert(self, J: Array, a: Array) -> Array:
        """Return the x with the least |J x - a|^2 + alpha |x|^2, shape (n,)."""
        n = J.shape[1]
        if not np.isfinite(a).all():
            return np.full(n, np.nan)
        rows = np.vstack([J, np.sqrt(self.alpha) * np.eye(n)])
        return np.linalg.lstsq(rows, np.append(a, np.zeros(n)), rcond=None)[0]


def _rotate(R: Array, x: Array) -> Array:
    """Return both halves of a vector of six, rotated."""
    return (x.reshape(2, 3) @ R.T).ravel()
