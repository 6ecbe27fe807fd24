"""Joints driven by PID gains of their description, as under Gazebo Classic."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.symbolic import Expression, Variable, if_then_else
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.description.hardware_info import PidGains
from arm_drake.hardware.signals import Command, Layout, is_set, variables


@dc.dataclass(frozen=True)
class DrivePid:
    """Gains of n joints on errors of position and of velocity, None where none."""

    position: Sequence[PidGains | None]
    velocity: Sequence[PidGains | None]

    @property
    def is_given(self) -> bool:
        """Whether any joint has gains."""
        return any(gains is not None for gains in (*self.position, *self.velocity))


def pid_law(pid: DrivePid, layout: Layout, h: float) -> SymbolicVectorSystem:
    """Return what makes commanded efforts of commands that PID gains are to follow.

    The law is that of gazebo_ros2_control, with control_toolbox's Pid at every step:
    the error's integral counts with this step, its term is held within limits, and its
    derivative is the change since the last step. What isn't followed starts anew.

    Args:
        pid: The gains.
        layout: The joints; with modes.
        h: Step of the plant [s].

    Returns:
        A system from state and command to a command.
    """
    x, command = variables("x", layout.num_states), Command(layout)
    told = [Expression(c) for c in command.variables]
    index = {c.get_id(): k for k, c in enumerate(command.variables)}
    states: list[Variable] = []
    updates: list[Expression] = []
    for i in range(layout.num_joints):
        q, v = x[layout.positions_at[i]], x[layout.velocities_at[i]]
        others = command.is_v[i] + command.is_a[i] + command.is_tau[i]
        for gains, acts, error in (
            (pid.position[i], 1.0 - others, command.q_d[i] - q),
            (pid.velocity[i], Expression(command.is_v[i]), command.v_d[i] - v),
        ):
            if gains is None:
                continue
            integral, last = variables(f"pid{len(states)}_", 2)
            summed = integral + h * error
            effort = gains.kp * error + gains.kd / h * (error - last)
            effort = effort + _integral_term(gains, summed)
            for part, value in (
                (command.tau_d, effort),
                (command.is_tau, Expression(1.0)),
                (command.is_v, Expression(0.0)),
            ):
                at = index[part[i].get_id()]
                told[at] = if_then_else(is_set(acts), value, told[at])
            states += [integral, last]
            updates += [acts * summed, acts * error]
    return SymbolicVectorSystem(
        state=np.array(states),
        input=np.array([*x, *command.variables]),
        dynamics=np.array(updates),
        output=np.array(told),
        time_period=h,
    )


def _integral_term(gains: PidGains, summed: Expression) -> Expression:
    term = gains.ki * summed
    if np.isfinite(gains.max_integral_error):
        term = min_(term, gains.max_integral_error)
    if np.isfinite(gains.min_integral_error):
        term = max_(term, gains.min_integral_error)
    return term
