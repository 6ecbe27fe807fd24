"""Rules of a joint_trajectory_controller, see `joint_trajectory`.

n is the number of joints, m that of commanded joints and k that of claimed command
interfaces: all commanded joints of the first, then all of the second, and so on.
"""

import dataclasses as dc
import math
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.pid import Pid
from arm_drake.control.tolerances import Mask, Tolerances
from arm_drake.control.trajectory import Interpolation
from arm_drake.controllers.joint_trajectory.trajectory_validation import TrajectoryRules
from arm_drake.messages import GoalStatus, Message


class Deceleration(NamedTuple):
    """How joints brake, instead of stopping at once."""

    # Of each joint [rad/s^2] or [m/s^2], above 0, shape (n,).
    decelerations: Array

    # Points that a braking trajectory has at least.
    num_points: int


@dc.dataclass(frozen=True, eq=False)
class JointTrajectoryRules(Message):
    """Numbers of a controller of n joints. New ones may hold from any tick on."""

    # What is allowed in a trajectory, and the joints.
    allowed: TrajectoryRules

    # Tolerances where a goal asks for none.
    tolerances: Tolerances

    # How far ahead commands are sampled: a period of the controller [ns].
    look_ahead_ns: int

    # Period in which goals give feedback and results [ns].
    monitor_period_ns: int

    # What is commanded of each commanded joint.
    command_interfaces: tuple[str, ...] = ("position",)

    # Index of each commanded joint, m of them; None commands all in their order.
    commanded_joints: tuple[int, ...] | None = None

    interpolation: Interpolation = "splines"

    # Whether trajectories start from the last command instead of the measured state.
    interpolate_from_desired_state: bool = False

    # How long the last point is held before the joints stop where they are [s]; 0 is
    # for ever.
    cmd_timeout: float = 0.0

    # Which joints turn without end, shape (n,); None if none does.
    wraparound: Mask | None = None

    # PIDs of all joints, and how much of the velocity is added to their output, (n,).
    pid: Pid | None = None
    ff_velocity_scale: Array | None = None

    # Whether the last command counts from its own time, not from the new trajectory's.
    starts_at_last_command: bool = True

    # Whether trajectories lead from the last commanded efforts to those of points.
    carries_effort: bool = True

    # Whether it starts from what was commanded before its activation.
    starts_from_commands: bool = True

    # How joints brake when a goal is cancelled or fails; None stops them at once.
    deceleration: Deceleration | None = None

    # Whether a new trajectory is blended with the one that runs.
    allow_replacement: bool = False

    # Rate of positions without times [Hz], 0 for none; None leaves trajectories alone.
    upsampling_frequency: float | None = None

    # How fast time passes, to start with, and whether interfaces tell or are told it.
    initial_scaling_factor: float = 1.0
    has_scaling_state: bool = False
    has_scaling_command: bool = False

    # Whether a look-ahead that sees the end also ends the search for the next sample.
    is_cursor_pinned: bool = False

    # How a goal ends that another one preempts.
    preempted_status: GoalStatus = GoalStatus.ABORTED
    preempted_text: str = "Current goal preempted by new incoming action."

    # Names of the joints.
    joints: tuple[str, ...] = dc.field(init=False)

    # Whether positions are commanded and nothing else; of all joints in their order.
    is_position_only: bool = dc.field(init=False)
    is_plain: bool = dc.field(init=False)

    # Whether velocities and accelerations have errors, if they are measured.
    has_velocity_error: bool = dc.field(init=False)
    has_acceleration_error: bool = dc.field(init=False)

    def __post_init__(self) -> None:
        """Prepare what every tick would find out anew."""
        commands = self.command_interfaces
        is_position_only = commands == ("position",)
        derived = {
            "joints": self.allowed.joints,
            "is_position_only": is_position_only,
            "is_plain": is_position_only and self.commanded_joints is None,
            "has_velocity_error": "velocity" in commands or "effort" in commands,
            "has_acceleration_error": "acceleration" in commands,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def command_of(self, commands: Array, interface: str) -> Array | None:
        """Return the values of one interface by joint, shape (n,).

        Args:
            commands: Values of all command interfaces, shape (k,).
            interface: Which of `command_interfaces`; None is returned for others.
                A joint that isn't commanded has NaN.
        """
        if interface not in self.command_interfaces:
            return None
        m = len(commands) // len(self.command_interfaces)
        first = m * self.command_interfaces.index(interface)
        values = commands[first : first + m]
        if self.commanded_joints is None:
            return values
        by_joint = np.full(len(self.joints), math.nan)
        by_joint[list(self.commanded_joints)] = values
        return by_joint
