"""Reference motions of the task, whoever simulates them: Pinocchio and SciPy.

Two laws::

    pd:     M(q) v' + h(q, v) + D v = kp (q_d - q) + kd (v_d - v) + g(q)
    servo:  v' = w0^2 (q_d + lead v_d - q) - 2 w0 v

The PD servo holds the robot's weight; the ideal servo computes with the whole dynamics,
so its efforts are N' ID(q, v, N v') and its motion, if none reaches a limit, is linear.
It is integrated through the dynamics all the same: what they contain has to cancel.
Mimic joints are no joints of their own here: N takes velocities of the commanded joints
to those of all. Every period is integrated from its start, for commands jump there.
"""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from tests.benchmarks.peers.commands import commands_of
from tests.benchmarks.peers.robots import damping_of
from tests.benchmarks.peers.task import (
    BANDWIDTH,
    PERIOD,
    Array,
    Commands,
    Recording,
    Task,
    command_lead,
)

# Rate of change of positions and velocities, of these and a command.
Dynamics = Callable[[Array, Array, Array, Array], Array]


class ReducedModel:
    """The dynamics of a robot's n commanded joints, by Pinocchio."""

    def __init__(self, task: Task) -> None:
        """Read the robot.

        Args:
            task: Whose robot it is.
        """
        self.model = pin.buildModelFromXML(task.urdf)
        self.data = self.model.createData()
        self.names = list(self.model.names)[1:]
        if self.model.nq != len(self.names):
            raise ValueError("joints of several coordinates")
        self.N = np.zeros((self.model.nv, len(task.joints)))
        self.offset = np.zeros(self.model.nq)
        for column, name in enumerate(task.joints):
            self.N[self.names.index(name), column] = 1.0
        for mimic in task.mimics:
            row = self.names.index(mimic.follower)
            master = self.names.index(mimic.master)
            self.N[row] = mimic.factor * self.N[master]
            self.offset[row] = mimic.offset
        damping = damping_of(task.urdf)
        D = np.diag([damping[name] for name in self.names])
        self.damping = self.N.T @ D @ self.N

    def mass_matrix(self, q: Array) -> Array:
        """Return the mass matrix of the commanded joints, shape (n, n)."""
        M = pin.crba(self.model, self.data, self.N @ q + self.offset)
        M = np.triu(M) + np.triu(M, 1).T
        return self.N.T @ M @ self.N

    def bias(self, q: Array, v: Array, *, gravity: bool) -> Array:
        """Return what moves without efforts: C v, the damping's, and -g, shape (n,)."""
        full, rates = self.N @ q + self.offset, self.N @ v
        h = pin.nonLinearEffects(self.model, self.data, full, rates)
        if not gravity:
            h = h - pin.computeGeneralizedGravity(self.model, self.data, full)
        return self.N.T @ h + self.damping @ v


def pd_dynamics(task: Task, robot: ReducedModel) -> Dynamics:
    """Return v' under the PD law, with the weight held."""

    def rate(q: Array, v: Array, q_d: Array, v_d: Array) -> Array:
        effort = task.kp * (q_d - q) + task.kd * (v_d - v)
        M = robot.mass_matrix(q)
        return np.linalg.solve(M, effort - robot.bias(q, v, gravity=False))

    return rate


def servo_dynamics(robot: ReducedModel) -> Dynamics:
    """Return v' under the ideal servo."""
    w0, lead = BANDWIDTH, command_lead()

    def rate(q: Array, v: Array, q_d: Array, v_d: Array) -> Array:
        u = w0**2 * (q_d + lead * v_d - q) - 2.0 * w0 * v
        bias = robot.bias(q, v, gravity=True)
        effort = robot.mass_matrix(q) @ u + bias
        return np.linalg.solve(robot.mass_matrix(q), effort - bias)

    return rate


def integrate(
    rate: Dynamics,
    commands: Commands,
    *,
    is_stiff: bool,
    rtol: float,
) -> Recording:
    """Return what joints do that start at rest at 0.

    Args:
        rate: Their dynamics.
        commands: Positions and velocities that hold from each tick, shape (N, n).
        is_stiff: Whether to use Radau's method instead of DOP853.
        rtol: Relative tolerance of the integrator; positions are of the order of 1.
    """
    n = commands.q.shape[1]
    state, rows = np.zeros(2 * n), []
    for q_d, v_d in zip(*commands, strict=True):
        rows.append(state)

        def f(_: float, x: Array, q_d: Array = q_d, v_d: Array = v_d) -> Array:
            return np.concatenate([x[n:], rate(x[:n], x[n:], q_d, v_d)])

        found = solve_ivp(
            f,
            (0.0, PERIOD),
            state,
            method="Radau" if is_stiff else "DOP853",
            rtol=rtol,
            atol=1e-2 * rtol,
        )
        if not found.success:
            raise RuntimeError(found.message)
        state = found.y[:, -1]
    q, v = np.split(np.array(rows), 2, axis=1)
    return Recording(q, v)


def make_reference(task: Task, law: str, rtol: float = 1e-6) -> Recording:
    """Return what the task's joints do under a law, "pd" or "servo"."""
    robot = ReducedModel(task)
    if law == "servo":
        return integrate(
            servo_dynamics(robot), commands_of(task), is_stiff=False, rtol=1e-6 * rtol
        )
    return integrate(
        pd_dynamics(task, robot), commands_of(task), is_stiff=True, rtol=rtol
    )


def servo_response_to(commands: Commands) -> Recording:
    """Return what joints do under the ideal servo, by the closed form.

    From a distance e = q - c with velocity v, a critically damped servo has
    q(t) = c + (e + (v + w0 e) t) exp(-w0 t).

    Args:
        commands: What holds from each tick on, for joints that start at rest at 0.
    """
    w0, T = BANDWIDTH, PERIOD
    q = v = np.zeros(commands.q.shape[1])
    rows = []
    for c in commands.folded(command_lead()):
        rows.append((q, v))
        e, slope = q - c, v + w0 * (q - c)
        fall = np.exp(-w0 * T)
        q = c + (e + slope * T) * fall
        v = (slope - w0 * (e + slope * T)) * fall
    return Recording(*(np.array(part) for part in zip(*rows, strict=True)))
