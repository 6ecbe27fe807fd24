"""``joint_trajectory_controller/JointTrajectoryController``.

Source: ros2_controllers, `joint_trajectory_controller` (version 6.9.0, defaults of
jazzy); the tick itself is `arm_drake.control.joint_trajectory`.
"""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.control.joint_trajectory import tick
from arm_drake.control.joint_trajectory_state import (
    JointTrajectoryRules,
    JointTrajectoryState,
    TickInputs,
    commanded_positions,
    make_error,
    make_point,
)
from arm_drake.control.tolerances import make_default_tolerances
from arm_drake.control.trajectory_validation import TrajectoryRules
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
    message_on,
)
from arm_drake.controllers.joint_trajectory_parameters import (
    JointConstraints,
    JointTrajectoryControllerParameters,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    Header,
    JointTrajectory,
    JointTrajectoryControllerState,
    Time,
)


class JointTrajectoryController(TickingController[JointTrajectoryState]):
    """Moves joints along trajectories, from a topic or as goals of an action.

    .. pydrake_system::

        name: JointTrajectoryController
        input_ports:
        - state_interfaces
        - joint_trajectory
        - follow_joint_trajectory
        output_ports:
        - command_interfaces
        - controller_state
        - events

    With n = len(joints), vectors in the order of ``joints``:

    =======================  ====  ======  ===========================================
    port                     size  unit    meaning
    =======================  ====  ======  ===========================================
    state_interfaces         2J    rad,    measured positions, then velocities, of
                                   rad/s   all J joints of the robot
    joint_trajectory         --    --      JointTrajectory to follow from now on
    follow_joint_trajectory  --    --      SendGoal or CancelGoal: a goal to reach
    command_interfaces       2n    rad,    commanded positions and their rates of
                                   rad/s   change
    controller_state         --    --      JointTrajectoryControllerState
    events                   --    --      tuple of the latest (number, event), the
                                           newest last; an event is a GoalEvent or a
                                           TopicRejected
    =======================  ====  ======  ===========================================

    The state is a JointTrajectoryState. At every tick, with period T, trajectory s and
    measured positions q::

        command_interfaces = s(t + T)          error = s(t) - q

    An error beyond a path tolerance, or beyond a goal tolerance for longer than
    goal_time after the end, stops the motion and aborts the goal.
    """

    def __init__(
        self,
        parameters: JointTrajectoryControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.

        Raises:
            ParameterError: If other joints are to be commanded than are measured.
        """
        joints = parameters.joints
        if parameters.command_joints not in ((), joints):
            raise ParameterError(
                f"command_joints other than joints are not acted on yet, "
                f"got {list(parameters.command_joints)}"
            )
        n = len(joints)
        super().__init__(
            params,
            JointTrajectoryState(),
            state_interfaces=interfaces.interface_names(
                joints, parameters.state_interfaces
            ),
            command_interfaces=interfaces.interface_names(
                joints, parameters.command_interfaces
            ),
        )
        self._rules = _make_rules(parameters, params)
        order = parameters.state_interfaces
        at = {name: slice(n * k, n * (k + 1)) for k, name in enumerate(order)}
        self._position_at = at[interfaces.POSITION]
        self._velocity_at = at.get(interfaces.VELOCITY)

        # Any Python object: None is none to newer versions of Drake.
        nothing = AbstractValue.Make(())
        self._topic = self.DeclareAbstractInputPort("joint_trajectory", nothing)
        self._action = self.DeclareAbstractInputPort("follow_joint_trajectory", nothing)

        self._nothing = np.full(n, np.nan)
        for name, calc in {
            "controller_state": self._calc_controller_state,
            "events": self._calc_events,
        }.items():
            self.DeclareAbstractOutputPort(
                name,
                lambda: AbstractValue.Make(()),
                calc,
                prerequisites_of_calc={self.xa_ticket()},
            )

    def _tick(
        self,
        context: Context,
        state: JointTrajectoryState,
        time_ns: int,
        period_ns: int,
    ) -> JointTrajectoryState:
        measured = self._read(context)
        inputs = TickInputs(
            time_ns,
            period_ns,
            measured[self._position_at],
            None if self._velocity_at is None else measured[self._velocity_at],
            message_on(self._topic, context, JointTrajectory),
            message_on(self._action, context, ActionRequest),
        )
        return tick(self._rules, state, inputs)

    def _command(self, state: JointTrajectoryState) -> np.ndarray:
        return commanded_positions(state.commanded, self._nothing)

    def _calc_events(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._state(context).events)

    def _calc_controller_state(self, context: Context, output: AbstractValue) -> None:
        seen = self._state(context).snapshot
        joints = self._rules.allowed.joints
        if seen is None:
            output.set_value(JointTrajectoryControllerState(joint_names=joints))
            return
        reference, from_start = seen.desired, seen.desired_from_start_ns
        output.set_value(
            JointTrajectoryControllerState(
                header=Header(stamp=Time.from_nanoseconds(seen.time_ns)),
                joint_names=joints,
                reference=make_point(
                    reference.position,
                    reference.velocity,
                    reference.acceleration,
                    from_start,
                ),
                feedback=make_point(seen.position, seen.velocity, None, from_start),
                error=make_error(seen),
                output=make_point(seen.command, None, None, 0),
            )
        )


def _make_rules(
    parameters: JointTrajectoryControllerParameters, params: ControllerInterfaceParams
) -> JointTrajectoryRules:
    joints, constraints = parameters.joints, parameters.constraints
    by_joint = [constraints.joint.get(joint, JointConstraints()) for joint in joints]
    endless = np.array([params.joint_types.get(j) == "continuous" for j in joints])
    timeout = parameters.cmd_timeout
    return JointTrajectoryRules(
        allowed=TrajectoryRules(
            joints=joints,
            allow_partial_joints_goal=parameters.allow_partial_joints_goal,
            allow_nonzero_velocity_at_trajectory_end=(
                parameters.allow_nonzero_velocity_at_trajectory_end
            ),
            allow_integration_in_goal_trajectories=(
                parameters.allow_integration_in_goal_trajectories
            ),
        ),
        tolerances=make_default_tolerances(
            [constraint.trajectory for constraint in by_joint],
            [constraint.goal for constraint in by_joint],
            stopped_velocity_tolerance=constraints.stopped_velocity_tolerance,
            goal_time=constraints.goal_time,
        ),
        look_ahead_ns=NANOSECONDS // params.update_rate,
        monitor_period_ns=int(NANOSECONDS / parameters.action_monitor_rate),
        interpolation=parameters.interpolation_method,
        interpolate_from_desired_state=(
            parameters.interpolate_from_desired_state or parameters.open_loop_control
        ),
        cmd_timeout=timeout if timeout > constraints.goal_time else 0.0,
        wraparound=endless if endless.any() else None,
    )
