"""``parallel_gripper_action_controller/GripperActionController``.

Source: ros2_controllers, `parallel_gripper_controller` (version 6.9.0); the tick itself
is `arm_drake.control.gripper`.
"""

import dataclasses as dc
import functools
import math

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.gripper import Ending, GripperRules, GripperState, Target
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.gripper_controller_base import (
    GripperControllerBase,
    make_rules,
)
from arm_drake.description.validation import check_at_least, check_not_empty
from arm_drake.messages import (
    JointState,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
    SendGoal,
)


@dc.dataclass(frozen=True)
class ParallelGripperActionControllerParameters:
    """Parameters of a GripperActionController with limits of effort and velocity."""

    # Joint to command.
    joint: str

    # Rate of results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # Interfaces to read of the joint.
    state_interfaces: tuple[str, ...] = ("position", "velocity")

    # Distance at which a goal is reached, at least 0 [rad] or [m].
    goal_tolerance: float = 0.01

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool = False

    # Speed below which the gripper stalls [rad/s] or [m/s], and after how long [s], at
    # least 0.
    stall_velocity_threshold: float = 0.001
    stall_timeout: float = 1.0

    # Full name of the interface that takes the limit of the effort; "" is none.
    max_effort_interface: str = ""

    # Effort where a goal has none, at least 0 [N·m] or [N].
    max_effort: float = 10.0

    # Full name of the interface that takes the limit of the velocity; "" is none.
    max_velocity_interface: str = ""

    # Velocity where a goal has none, at least 0 [rad/s] or [m/s].
    max_velocity: float = 0.1

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(
            self, 0.0, "goal_tolerance", "stall_timeout", "max_effort", "max_velocity"
        )
        limits = [self.max_effort_interface, self.max_velocity_interface]
        for name in filter(None, limits):
            if name == f"{self.joint}/{interfaces.POSITION}" or limits.count(name) > 1:
                raise ValueError(
                    "max_effort_interface and max_velocity_interface must be two "
                    f"interfaces beside the position, got {limits}"
                )


class ParallelGripperActionController(GripperControllerBase):
    """Moves a joint to the position of a ParallelGripperCommand goal.

    .. pydrake_system::

        name: ParallelGripperActionController
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
    gripper_cmd         --    --       SendGoal of a ParallelGripperCommandGoal, or
                                       CancelGoal
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       where it is known what that is
    command_interfaces  --    --       Tick; its command is the position, then as there
                                       are such interfaces the largest effort and the
                                       largest velocity
    events              --    --       tuple of the latest (number, event), the newest
                                       last; an event is a GoalEvent, a CancelResponse
                                       or a TopicRejected
    ==================  ====  =======  =================================================

    The state is a GripperControllerState. A goal names no joint that counts; where it
    gives no effort or velocity, the parameters do. The largest effort and velocity go
    to `max_effort_interface` and `max_velocity_interface`, and hold for the joint's
    drive here, whether its description has such interfaces or not; 0 is no limit.
    """

    goal_type = ParallelGripperCommandGoal

    def __init__(
        self,
        parameters: ParallelGripperActionControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        effort, velocity = (
            parameters.max_effort_interface,
            parameters.max_velocity_interface,
        )
        self._has_effort, self._has_velocity = bool(effort), bool(velocity)
        limits = tuple(filter(None, (effort, velocity)))
        super().__init__(
            make_rules(
                parameters,
                read_goal=functools.partial(
                    _read_goal, has_effort=bool(effort), has_velocity=bool(velocity)
                ),
                make_result=_make_result,
                max_velocity=parameters.max_velocity,
            ),
            params,
            joint=parameters.joint,
            claims=(f"{parameters.joint}/{interfaces.POSITION}", *limits),
            limits={
                name: kind
                for name, kind in (
                    (effort, interfaces.EFFORT),
                    (velocity, interfaces.VELOCITY),
                )
                if name
            },
        )

    def _write(self, state: GripperState) -> Array:
        target = state.target
        assert target is not None
        values = [target.position]
        if self._has_effort:
            values.append(target.max_effort)
        if self._has_velocity:
            values.append(target.max_velocity)
        return np.array(values)


def _read_goal(
    rules: GripperRules, request: SendGoal, *, has_effort: bool, has_velocity: bool
) -> Target | str:
    goal = request.goal
    if not isinstance(goal, ParallelGripperCommandGoal):
        return f"expected a ParallelGripperCommandGoal, got a {type(goal).__name__}"
    command = goal.command
    if len(command.position) != 1:
        return f"command.position must have 1 value, got {len(command.position)}"
    for field in ("position", "velocity", "effort"):
        for value in getattr(command, field):
            if not math.isfinite(value):
                return f"command.{field} must be finite, got {value}"
    effort, velocity = command.effort, command.velocity
    return Target(
        command.position[0],
        effort[0] if has_effort and effort else rules.max_effort,
        velocity[0] if has_velocity and velocity else rules.max_velocity,
    )


def _make_result(ending: Ending | None) -> ParallelGripperCommandResult:
    if ending is None:
        return ParallelGripperCommandResult()
    state = JointState(position=(ending.position,))
    is_stalled = ending.is_stalled
    return ParallelGripperCommandResult(state, is_stalled, not is_stalled)
