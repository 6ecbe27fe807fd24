"""``joint_trajectory_controller/JointTrajectoryController``.

Source: ros2_controllers, `joint_trajectory_controller` (version 6.9.0 and jazzy); the
tick itself is `arm_drake.controllers.joint_trajectory.joint_trajectory`.
"""

import functools
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.joint_trajectory import joint_trajectory as control
from arm_drake.controllers.joint_trajectory.joint_trajectory_rules import (
    JointTrajectoryRules,
)
from arm_drake.controllers.joint_trajectory.joint_trajectory_setup import (
    check_change,
    make_rules,
)
from arm_drake.controllers.joint_trajectory.parameters import (
    JointTrajectoryControllerParameters,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
    add_events,
)
from arm_drake.controllers.topics import new_messages, new_parameters
from arm_drake.messages import (
    ActionRequest,
    FollowJointTrajectoryGoal,
    JointTrajectory,
    JointTrajectoryControllerState,
    ParametersRejected,
    QueryTrajectoryState,
    SpeedScalingFactor,
    Time,
    TimeLike,
)


class Inbox(NamedTuple):
    """What came in on the ports of a JointTrajectoryController."""

    # Parameters in effect, and what was made of them.
    parameters: JointTrajectoryControllerParameters
    rules: JointTrajectoryRules

    # What was on the ports at the last tick.
    offered: object = ()
    topics: tuple[JointTrajectory, ...] = ()
    requests: tuple[ActionRequest, ...] = ()
    factors: tuple[SpeedScalingFactor, ...] = ()


class JointTrajectoryControllerSystemState(NamedTuple):
    """State of a JointTrajectoryController between two ticks."""

    inbox: Inbox
    control: JointTrajectoryState


class JointTrajectoryController(
    TickingController[JointTrajectoryControllerSystemState]
):
    """Moves joints along trajectories, from a topic or as goals of an action.

    .. pydrake_system::

        name: JointTrajectoryController
        input_ports:
        - controller_manager
        - state_interfaces
        - joint_trajectory
        - follow_joint_trajectory
        - speed_scaling_input
        - parameters
        output_ports:
        - command_interfaces
        - controller_state
        - events

    With n = len(joints), m = len(command_joints) or n, and vectors in their order:

    =======================  ====  ======  ===========================================
    port                     size  unit    meaning
    =======================  ====  ======  ===========================================
    controller_manager       --    --      Cycle: when to tick
    state_interfaces         2J    rad,    measured positions, then velocities, of
                                   rad/s   all J joints of the robot, or more
    joint_trajectory         --    --      JointTrajectory to follow from now on
    follow_joint_trajectory  --    --      SendGoal or CancelGoal: a goal to reach
    speed_scaling_input      --    --      SpeedScalingFactor; there only where
                                           positions alone are commanded
    parameters               --    --      JointTrajectoryControllerParameters to go
                                           on with
    command_interfaces       --    --      Tick; its command has m values of each of
                                           ``command_interfaces``, one after the
                                           other, and the speed scaling factor if
                                           there is an interface for it
    controller_state         --    --      JointTrajectoryControllerState
    events                   --    --      tuple of the latest (number, event), the
                                           newest last; an event is a GoalEvent, a
                                           CancelResponse, a TopicRejected or a
                                           ParametersRejected
    =======================  ====  ======  ===========================================

    Each port of messages takes one, or a tuple of them in order; those of the topic
    come before those of the action.

    The state is a JointTrajectoryControllerSystemState. At every tick, with period T,
    trajectory s and measured positions q::

        command = s(t + T)          error = s(t) - q

    where velocities or efforts alone are commanded, a PID makes the command of the
    error. An error beyond a path tolerance, or beyond a goal tolerance for longer than
    goal_time after the end, stops the motion and aborts the goal.
    """

    goal_type = FollowJointTrajectoryGoal
    reads_by_now = True

    def __init__(
        self,
        parameters: JointTrajectoryControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        joints, scaling = parameters.joints, parameters.speed_scaling
        states = interfaces.interface_names(joints, parameters.state_interfaces)
        commands = interfaces.interface_names(
            parameters.command_joints or joints, parameters.command_interfaces
        )
        self._num_commands = len(commands)
        self._make_rules = functools.partial(
            make_rules,
            update_rate=params.update_rate,
            joint_types=params.joint_types,
            velocity_limits=params.velocity_limits,
            distro=params.distro,
        )
        rules = self._make_rules(parameters)
        self._has_scaling_state = bool(scaling.state_interface)  # rules may ignore it
        self._has_scaling_command = rules.has_scaling_command
        super().__init__(
            params,
            JointTrajectoryControllerSystemState(
                Inbox(parameters, rules), JointTrajectoryState()
            ),
            state_interfaces=(*states, scaling.state_interface)
            if self._has_scaling_state
            else states,
            command_interfaces=(*commands, scaling.command_interface)
            if self._has_scaling_command
            else commands,
        )
        n, order = len(joints), parameters.state_interfaces
        at = {name: slice(n * k, n * (k + 1)) for k, name in enumerate(order)}
        self._position_at = at[interfaces.POSITION]
        self._velocity_at = at.get(interfaces.VELOCITY)
        self._acceleration_at = at.get(interfaces.ACCELERATION)
        self._topic = self._declare_input("joint_trajectory")
        self._action = self._declare_input("follow_joint_trajectory")
        self._scaling = (
            self._declare_input("speed_scaling_input")
            if rules.is_position_only
            else None
        )
        self._parameters = self._declare_input(interfaces.PARAMETERS_PORT)
        self._declare_topic("controller_state", self._describe)
        self._declare_topic("events", lambda state: state.control.events)
        self._unknown = np.full(self._num_commands, np.nan)

    def query_state(self, context: Context, time: TimeLike) -> QueryTrajectoryState:
        """Return what is planned for a time: the service `query_state`.

        Args:
            context: Context of the system.
            time: When, in the time of the controller's ticks.
        """
        inbox, state = self._state(context)
        return control.query(inbox.rules, state, Time.of(time).to_nanoseconds())

    def _declare_input(self, name: str) -> InputPort:
        return self.DeclareAbstractInputPort(name, AbstractValue.Make(()))

    def _update(
        self, now: Now, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        inbox, inputs, last = self._receive(now, state)
        new = control.tick(inbox.rules, last, inputs)
        return JointTrajectoryControllerSystemState(inbox, new)

    def _idle(
        self, now: Now, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        inbox, inputs, last = self._receive(now, state)
        new = control.idle(inbox.rules, last, inputs)
        return JointTrajectoryControllerSystemState(inbox, new)

    def rests(self, state: JointTrajectoryControllerSystemState) -> bool:
        """Return whether only a message can change the state while inactive."""
        return state.control.goal is None  # Else its result is due.

    def _activate(
        self, now: Now, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        inbox, last = self._take_parameters(now, state.inbox, state.control)
        new = control.activate(inbox.rules, last, self._sense(now))
        return JointTrajectoryControllerSystemState(inbox, new)

    def _deactivate(
        self, now: Now, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerSystemState:
        new = control.deactivate(state.inbox.rules, state.control, self._sense(now))
        return state._replace(control=new)

    def _receive(
        self, now: Now, state: JointTrajectoryControllerSystemState
    ) -> tuple[Inbox, TickInputs, JointTrajectoryState]:
        """Return what has come in, the inputs of the tick, and the state before it."""
        if now.is_quiet:
            return state.inbox, self._sense(now), state.control
        inbox, last = self._take_parameters(now, state.inbox, state.control)
        context = now.context
        topics, seen_topics = new_messages(
            self._topic, context, JointTrajectory, inbox.topics
        )
        requests, seen_requests = new_messages(
            self._action, context, ActionRequest, inbox.requests
        )
        factors: tuple[SpeedScalingFactor, ...] = ()
        seen_factors = inbox.factors
        if self._scaling is not None:
            factors, seen_factors = new_messages(
                self._scaling, context, SpeedScalingFactor, seen_factors
            )
        inputs = self._sense(now)
        if topics or requests or factors:
            inputs = inputs._replace(
                topics=topics, requests=requests, scaling_factors=factors
            )
        inbox = inbox._replace(
            topics=seen_topics, requests=seen_requests, factors=seen_factors
        )
        return inbox, inputs, last

    def _take_parameters(
        self, now: Now, inbox: Inbox, last: JointTrajectoryState
    ) -> tuple[Inbox, JointTrajectoryState]:
        """Return the inbox with what is offered, and the state that tells a fault."""
        offered = new_parameters(self._parameters, now.context, inbox.offered)
        if offered is inbox.offered:
            return inbox, last
        parameters, rules = inbox.parameters, inbox.rules
        if offered != ():
            try:
                parameters = check_change(parameters, offered)
                rules = self._make_rules(parameters)
            except ValueError as error:
                last = add_events(last, ParametersRejected(str(error)))
        return inbox._replace(parameters=parameters, rules=rules, offered=offered), last

    def _sense(self, now: Now) -> TickInputs:
        """Return what the tick reads besides messages."""
        measured = self._measured_now(now)
        velocity_at, acceleration_at = self._velocity_at, self._acceleration_at
        return TickInputs(
            now.time_ns,
            now.period_ns,
            measured[self._position_at],
            None if velocity_at is None else measured[velocity_at],
            None if acceleration_at is None else measured[acceleration_at],
            lambda: self._read_commands(now)[: self._num_commands],
            scaling_state=float(measured[-1]) if self._has_scaling_state else None,
        )

    def _command(self, state: JointTrajectoryControllerSystemState) -> Array:
        command = state.control.command
        if command is None:
            command = self._unknown
        if not self._has_scaling_command:
            return command
        return np.append(command, state.control.speed_scaling_command)

    def _describe(
        self, state: JointTrajectoryControllerSystemState
    ) -> JointTrajectoryControllerState:
        return control.make_controller_state(state.inbox.rules, state.control)
