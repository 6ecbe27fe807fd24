"""State and inputs of a joint_trajectory_controller, see `joint_trajectory`.

n is the number of joints and k that of command interfaces, see
`joint_trajectory_rules`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.action_goals import ActiveGoal
from arm_drake.control.pid import PidState
from arm_drake.control.tolerances import Tolerances
from arm_drake.control.trajectory import Sample, Trajectory
from arm_drake.control.trajectory_segments import StateBefore
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.messages import (
    ActionRequest,
    CancelResponse,
    GoalEvent,
    JointTrajectory,
    JointTrajectoryPoint,
    ParametersRejected,
    SpeedScalingFactor,
    TopicRejected,
)
from arm_drake.messages.news import add_news

# News of a controller.
Event = GoalEvent | CancelResponse | TopicRejected | ParametersRejected


class Plan(NamedTuple):
    """What seldom changes from tick to tick."""

    # Rules of the last tick; messages are judged by them.
    rules: JointTrajectoryRules | None = None

    is_active: bool = False

    trajectory: Trajectory | None = None

    # How many points a replacement put before those of its message.
    num_prefix: int = 0

    # What replaces the trajectory at the next tick.
    pending: JointTrajectory | None = None

    # Whether trajectory and pending message are the controller's one hold message.
    is_hold_installed: bool = False
    is_hold_pending: bool = False

    # Whether the trajectory holds the joints where they stopped.
    is_holding: bool = False

    # The point of the hold message.
    hold: JointTrajectoryPoint = JointTrajectoryPoint()

    # Points that the longest braking trajectory had so far.
    num_stop_points: int = 0

    # Tolerances of the last goal; None before the first activation.
    tolerances: Tolerances | None = None

    cmd_timeout: float = 0.0

    # How fast time is to pass; None before the first activation.
    requested_scaling: float | None = None

    # The latest news, numbered, the newest last.
    events: tuple[tuple[int, Event], ...] = ()

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class JointTrajectoryState(NamedTuple):
    """State of the controller; None where nothing has happened yet.

    A tuple, for it is made anew at every tick. Arrays are never changed.
    """

    plan: Plan = Plan()
    goal: ActiveGoal | None = None

    # Time of the last tick, and how far trajectories are followed [ns].
    time_ns: int = 0
    clock_ns: int = 0

    # Segment that the last sample was in.
    cursor: int = 0

    # Measured in the last tick, shape (n,). After an activation this is what was
    # commanded before it, if that counts.
    position: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None

    # Reference of the last tick, and reference minus measurement, shape (n,).
    desired: Sample | None = None
    error: Array | None = None

    # The point that the last tick commanded, for the time after it [ns].
    ahead_ns: int = -1
    ahead: Sample | None = None

    # The last commanded point, and when it was commanded [ns].
    commanded: Sample | StateBefore | None = None
    commanded_ns: int = 0

    # Values of the command interfaces, shape (k,); NaN is not written. The second is
    # what is reported: the last values that were all finite.
    command: Array | None = None
    output: Array | None = None

    pid: PidState | None = None

    # How fast time passes: 1 as it does, 0 not at all.
    scaling_factor: float = 1.0

    @property
    def seen(self) -> int:
        """Last segment of the trajectory that was sampled; -1 if none was."""
        return -1 if self.ahead is None else self.ahead.segment_end

    @property
    def events(self) -> tuple[tuple[int, Event], ...]:
        """The latest news, numbered, the newest last."""
        return self.plan.events

    @property
    def speed_scaling_command(self) -> float:
        """What the command interface of speed scaling is told, if there is one."""
        requested = self.plan.requested_scaling
        return 1.0 if requested is None else requested

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class TickInputs(NamedTuple):
    """What a tick reads. Nobody changes the arrays afterwards."""

    time_ns: int

    # Time since the last tick [ns].
    period_ns: int

    # Measured, shape (n,); None without such state interfaces.
    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None

    # Returns the present values of the command interfaces, shape (k,); NaN where
    # nothing was commanded so far. None stands for NaN everywhere.
    commands: Callable[[], Array] | None = None

    # What has come since the last tick, in order.
    topics: tuple[JointTrajectory, ...] = ()
    requests: tuple[ActionRequest, ...] = ()
    scaling_factors: tuple[SpeedScalingFactor, ...] = ()

    # What the state interface of speed scaling says.
    scaling_state: float | None = None


def present_commands(rules: JointTrajectoryRules, inputs: TickInputs) -> Array:
    """Return the present values of the command interfaces, shape (k,)."""
    if inputs.commands is not None:
        return inputs.commands()
    joints = rules.joints if rules.commanded_joints is None else rules.commanded_joints
    return np.full(len(joints) * len(rules.command_interfaces), math.nan)


def add_events(state: JointTrajectoryState, *news: Event) -> JointTrajectoryState:
    """Return the state with news."""
    events = add_news(state.plan.events, news)
    return state._replace(plan=state.plan._replace(events=events))
