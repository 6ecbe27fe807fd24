"""What a joint_trajectory_controller commands, given a trajectory and its errors.

The rules are those of ros2_controllers' joint_trajectory_controller (`update`,
version 6.9.0). n is the number of joints, k that of command interfaces.
"""

import math

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.pid import PidState
from arm_drake.control.trajectory import Sample
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
)
from arm_drake.messages import NANOSECONDS


def errors_of(
    rules: JointTrajectoryRules, inputs: TickInputs, desired: Sample, error: Array
) -> tuple[Array, Array | None, Array | None]:
    """Return reference minus measurement, each of shape (n,); None isn't compared.

    Velocities are compared if they are measured, and velocities or efforts commanded;
    accelerations if both are.

    Args:
        rules: Numbers of the controller.
        inputs: What is measured.
        desired: The reference.
        error: Errors of the positions, shape (n,).
    """
    velocity = acceleration = None
    if rules.has_velocity_error and inputs.velocity is not None:
        reference = desired.velocity
        velocity = None if reference is None else reference - inputs.velocity
    if rules.has_acceleration_error and inputs.acceleration is not None:
        reference = desired.acceleration
        acceleration = None if reference is None else reference - inputs.acceleration
    return error, velocity, acceleration


def make_command(
    rules: JointTrajectoryRules,
    state: JointTrajectoryState,
    inputs: TickInputs,
    desired: Sample,
    ahead: Sample,
    error: Array,
) -> tuple[Array, PidState | None]:
    """Return the values of all command interfaces, shape (k,), and what PIDs remember.

    Efforts beside positions are those of the present, all others are one period ahead.
    What a PID commands is, with the velocities v and efforts u one period ahead::

        ff_velocity_scale v + u + PID(error, error of the velocity)

    where velocities are commanded, without u.

    Args:
        rules: Numbers of the controller.
        state: State after the last tick.
        inputs: What the tick reads.
        desired: The trajectory at present.
        ahead: The trajectory one period ahead.
        error: Errors of the positions, shape (n,).
    """
    pid = state.pid
    if rules.pid is not None:
        last = rules.pid.initial() if pid is None else pid
        _, rate, _ = errors_of(rules, inputs, desired, error)
        pid = rules.pid.step(last, error, inputs.period_ns / NANOSECONDS, rate)
        output = pid.command
        if rules.ff_velocity_scale is not None and ahead.velocity is not None:
            output = rules.ff_velocity_scale * ahead.velocity + output
        if rules.command_interfaces == ("effort",) and ahead.effort is not None:
            output = output + ahead.effort
        vectors: list[Array | None] = [output]
    else:
        vectors = [
            _open_loop(name, desired, ahead) for name in rules.command_interfaces
        ]
    n = len(rules.joints)
    values = [np.full(n, math.nan) if v is None else v for v in vectors]
    if rules.commanded_joints is not None:
        at = list(rules.commanded_joints)
        values = [vector[at] for vector in values]
    return (values[0] if len(values) == 1 else np.concatenate(values)), pid


def _open_loop(interface: str, desired: Sample, ahead: Sample) -> Array | None:
    match interface:
        case "position":
            return ahead.position
        case "velocity":
            return ahead.velocity
        case "acceleration":
            return ahead.acceleration
    return desired.effort
