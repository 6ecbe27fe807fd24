"""What a program holds of a controller."""

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

from arm_drake import interfaces
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.messages import (
    CancelGoal,
    Float64MultiArray,
    Goal,
    GripperCommand,
    JointTrajectory,
    Message,
    QueryTrajectoryState,
    SendGoal,
    SpeedScalingFactor,
    SwitchController,
    Time,
    TimeLike,
    Twist,
)
from arm_drake.simulation.controller_topics import (
    SPEED_SCALING,
    TOPIC,
    ControllerTopics,
)
from arm_drake.simulation.mailbox import GoalHandle, Mailbox
from arm_drake.simulation.motion import StepMessage


class ControllerHandle:
    """Sends to one controller, and reads it, whether it is active or not."""

    def __init__(
        self,
        mailbox: Mailbox,
        robot: Robot,
        name: str,
        system: ControllerInterface,
        type_: str,
    ) -> None:
        """Create the handle; `Simulation.controller` does that.

        Args:
            mailbox: Of the simulation where the controller runs.
            robot: Whose controller it is.
            name: Name of the controller with its prefix.
            system: The controller.
            type_: Its ros2_control type.
        """
        self.name = name
        self._mailbox, self._robot = mailbox, robot
        self._system, self._type = system, type_
        self._topics = ControllerTopics(name, type_, system)

    def check(self, message: StepMessage) -> None:
        """Raise InputError if the controller takes no such message.

        Args:
            message: What a step of a motion sends.
        """
        if isinstance(message, Float64MultiArray):
            self._topics.make_command(message.data)
        elif isinstance(message, Twist):
            self._topics.make_velocity(message)
        elif isinstance(message, SpeedScalingFactor):
            self._topics.check(SPEED_SCALING)
        elif isinstance(message, JointTrajectory):
            self._topics.check(TOPIC)
        elif message is None:
            self._topics.find_action()
        elif not isinstance(message, SwitchController):
            self._topics.make_goal(message)

    def command(
        self,
        values: Sequence[float],
        *,
        values_dot: Sequence[float] = (),
        where: str = "",
    ) -> None:
        """Send commands, which hold from the controller's next tick on.

        Args:
            values: Command interfaces' values in the order of a forward controller, or
                references of a PidController's degrees of freedom, in their units.
            values_dot: Rates of change of these references, or none.
            where: Where they come from, for messages.

        Raises:
            InputError: If the controller takes none, others, or so many.
        """
        port, message = self._topics.make_command(values, values_dot)
        self._send(port, message, where)

    def send_goal(
        self, goal: Goal | JointTrajectory | GripperCommand, *, where: str = ""
    ) -> GoalHandle:
        """Send a goal to the controller's action; it sees it at its next tick.

        A controller that isn't active rejects it; a gripper's only if it never was.

        Args:
            goal: The goal, or its trajectory or command alone. Any gripper takes a
                GripperCommand.
            where: Where the goal comes from, for messages.

        Raises:
            InputError: If the controller has no such action.
        """
        port, made = self._topics.make_goal(goal)
        request = SendGoal(made)
        handle = GoalHandle(self.name, request, where)
        self._mailbox.add_goal(handle)
        self._send(port, request)
        return handle

    def send_velocity(self, twist: Twist, *, where: str = "") -> None:
        """Tell a base how to move; controllers stop it when no more is heard.

        Args:
            twist: Velocity in the frame of the base [m/s], [rad/s].
            where: Where it comes from, for messages.

        Raises:
            InputError: If the controller takes no velocities.
        """
        port, message = self._topics.make_velocity(twist)
        self._send(port, message, where)

    def send_trajectory(self, trajectory: JointTrajectory, *, where: str = "") -> None:
        """Send a trajectory to the controller's topic.

        Args:
            trajectory: What to follow from the controller's next tick on.
            where: Where it comes from, for messages.

        Raises:
            InputError: If the controller has no such topic.
        """
        self._topics.check(TOPIC)
        # A copy: the same message once more is a new one.
        self._send(TOPIC, dc.replace(trajectory), where)

    def cancel(self) -> None:
        """Cancel the last goal that was sent to the controller, if there is one."""
        goals = [g for g in self._mailbox.goals if g.controller == self.name]
        if goals and not goals[-1].status.is_terminal:
            request = CancelGoal(goals[-1].request)
            self._send(self._topics.find_action(), request)

    def set_speed_scaling(self, factor: float, *, where: str = "") -> None:
        """Let time pass faster or slower along the controller's trajectories.

        Args:
            factor: How fast, at least 0; 1 is real time, 0 pauses.
            where: Where it comes from, for messages.

        Raises:
            InputError: If the factor is none, or the controller has no such topic.
        """
        self._topics.check(SPEED_SCALING)
        message = self._topics.make_speed_scaling(factor)
        self._send(SPEED_SCALING, message, where)

    def set_parameters(self, changes: Mapping[str, Any]) -> None:
        """Change parameters from the controller's next tick on.

        Args:
            changes: New values by name, as {"gains.joint1.p": 2.0} or nested.

        Raises:
            InputError: If the controller's parameters can't change.
            ParameterError: If one of them can't, isn't known, or has a bad value.
        """
        if not self._system.HasInputPort(interfaces.PARAMETERS_PORT):
            raise InputError(
                f"controller {self.name!r} of type {self._type!r}: no parameter can "
                "change while it runs"
            )
        from arm_drake.simulation.parameter_changes import (
            publish_parameters,  # Rarely needed.
        )

        root = self._mailbox.simulator.get_mutable_context()
        context = self._system.GetMyMutableContextFromRoot(root)
        publish_parameters(self._robot, self._system, context, changes)

    def query_state(self, time: TimeLike) -> QueryTrajectoryState:
        """Return what the controller plans for a time: the service `query_state`.

        Args:
            time: When [s].

        Raises:
            InputError: If the controller has no such service, or the time is none.
        """
        query = getattr(self._system, "query_state", None)
        if query is None:
            raise InputError(
                f"controller {self.name!r} of type {self._type!r} has no query_state"
            )
        try:
            moment = Time.of(time)
        except (ValueError, OverflowError) as error:
            raise InputError(f"controller {self.name!r}: time: {error}") from None
        root = self._mailbox.simulator.get_context()
        response: QueryTrajectoryState = query(
            self._system.GetMyContextFromRoot(root), moment
        )
        return response

    def state(self) -> Any:
        """Return the controller's `controller_state` message, as of its last tick.

        Raises:
            InputError: If the controller publishes none.
        """
        if not self._system.HasOutputPort("controller_state"):
            what = f"controller {self.name!r} of type {self._type!r}"
            raise InputError(f"{what} publishes no controller_state")
        return self._mailbox.eval_output(f"{self.name}.controller_state")

    def _send(self, port: str, message: Message, where: str = "") -> None:
        if where:
            self._mailbox.add_message(message, where)
        period = 1.0 / self._system.params.update_rate
        self._mailbox.publish(self._topics.exported_as(port), message, period)
