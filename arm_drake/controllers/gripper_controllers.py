"""``GripperActionController`` of `position_controllers` and `effort_controllers`.

Source: ros2_controllers, `gripper_controllers` (jazzy); the tick itself is
`arm_drake.control.gripper`.
"""

import dataclasses as dc
import math
from typing import Literal

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.gripper import Ending, GripperRules, GripperState, Target
from arm_drake.control.pid import Pid
from arm_drake.control.pid_gains import PidGains
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.gripper_controller_base import (
    GripperControllerBase,
    make_rules,
)
from arm_drake.description.parameters import per_element_of
from arm_drake.description.validation import (
    check_at_least,
    check_finite,
    check_not_empty,
)
from arm_drake.messages import GripperCommandGoal, GripperCommandResult, SendGoal


@dc.dataclass(frozen=True)
class GripperActionControllerParameters:
    """Parameters of a GripperActionController that commands a position."""

    # Joint to command.
    joint: str

    # Rate of results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # Distance at which a goal is reached, at least 0 [rad] or [m].
    goal_tolerance: float = 0.01

    # Largest effort of a hold, at least 0 [N·m] or [N].
    max_effort: float = 0.0

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool = False

    # Speed below which the gripper stalls [rad/s] or [m/s], and after how long [s].
    stall_velocity_threshold: float = 0.001
    stall_timeout: float = 1.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(self, 0.0, "goal_tolerance", "max_effort")


@dc.dataclass(frozen=True)
class GripperPidGains:
    """PID of a gripper's joint."""

    # Proportional gain, of the error.
    p: float = 0.0

    # Integral gain, of the error's integral over time.
    i: float = 0.0

    # Derivative gain, of the error's rate.
    d: float = 0.0

    # Limit of the integral term, on both sides; 0 switches it off.
    i_clamp: float = 0.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_finite(self, "p", "i", "d")
        check_at_least(self, 0.0, "i_clamp")


@dc.dataclass(frozen=True)
class GripperGains:
    """PIDs by joint."""

    joint: dict[str, GripperPidGains] = per_element_of("joint")


@dc.dataclass(frozen=True)
class EffortGripperActionControllerParameters(GripperActionControllerParameters):
    """Parameters of a GripperActionController that commands an effort."""

    gains: GripperGains = GripperGains()


class GripperActionController(GripperControllerBase):
    """Moves a joint to the position of a GripperCommand goal.

    .. pydrake_system::

        name: GripperActionController
        input_ports:
        - controller_manager
        - state_interfaces
        - gripper_cmd
        - gripper_command
        output_ports:
        - command_interfaces
        - events

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad,     measured positions, then velocities, of all J
                              rad/s    joints of the robot
    gripper_cmd         --    --       SendGoal of a GripperCommandGoal, or CancelGoal
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       where it is known what that is
    command_interfaces  --    --       Tick; its command is (1,): the position, or with
                                       gains the effort
    events              --    --       tuple of the latest (number, event), the newest
                                       last; an event is a GoalEvent, a CancelResponse
                                       or a TopicRejected
    ==================  ====  =======  =================================================

    The state is a GripperControllerState. With the goal's position p and the measured
    position q, a tick commands p, or in `effort_controllers`::

        effort = clamp(pid(p - q, -v), ±max_effort)

    so that a goal without max_effort has no effort at all; upstream takes the time of
    the clock on the wall there, here it is the controller's period. A position command
    knows no max_effort, and reports it as the effort of its result.
    """

    goal_type = GripperCommandGoal

    def __init__(
        self,
        parameters: GripperActionControllerParameters,
        params: ControllerInterfaceParams,
        *,
        interface: Literal["position", "effort"] = "position",
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
            interface: What it commands.
        """
        self._commands_effort = is_effort = interface == interfaces.EFFORT
        super().__init__(
            make_rules(
                parameters,
                read_goal=_read_goal,
                make_result=_make_result,
                pid=_make_pid(parameters) if is_effort else None,
            ),
            params,
            joint=parameters.joint,
            claims=(f"{parameters.joint}/{interface}",),
        )

    def _write(self, state: GripperState) -> Array:
        assert state.target is not None
        is_effort = self._commands_effort
        return np.array([state.effort if is_effort else state.target.position])


def _read_goal(rules: GripperRules, request: SendGoal) -> Target | str:
    del rules
    goal = request.goal
    if not isinstance(goal, GripperCommandGoal):
        return f"expected a GripperCommandGoal, got a {type(goal).__name__}"
    command = goal.command
    for field in ("position", "max_effort"):
        value = getattr(command, field)
        if not math.isfinite(value):
            return f"command.{field} must be finite, got {value}"
    return Target(command.position, command.max_effort)


def _make_result(ending: Ending | None) -> GripperCommandResult:
    if ending is None:
        return GripperCommandResult()
    position, effort, is_stalled = ending
    return GripperCommandResult(position, effort, is_stalled, not is_stalled)


def _make_pid(parameters: GripperActionControllerParameters) -> Pid:
    assert isinstance(parameters, EffortGripperActionControllerParameters)
    gains = parameters.gains.joint.get(parameters.joint, GripperPidGains())
    limit = gains.i_clamp
    return Pid.from_gains(
        [PidGains(gains.p, gains.i, gains.d, i_clamp_max=limit, i_clamp_min=-limit)]
    )
