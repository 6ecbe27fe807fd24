"""What a program holds of a controller and of a goal that it sent."""

import dataclasses as dc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.errors import InputError
from arm_drake.messages import (
    ActionRequest,
    CancelGoal,
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GoalEvent,
    GoalStatus,
    JointTrajectory,
    Message,
    SendGoal,
)

if TYPE_CHECKING:
    from arm_drake.simulation import Simulation

ACTION = "follow_joint_trajectory"
TOPIC = "joint_trajectory"


class GoalHandle:
    """A goal that was sent to a controller: what an action client sees of it."""

    def __init__(self, controller: str, request: SendGoal, where: str) -> None:
        """Create the handle; `ControllerHandle.send_goal` does that.

        Args:
            controller: Name of the controller.
            request: What was sent.
            where: Where the goal comes from, for messages; empty if from a program.
        """
        self.controller = controller
        self.request = request
        self.where = where
        self.status = GoalStatus.PENDING
        self.result: FollowJointTrajectoryResult | None = None

        # What of the goal was not taken as written.
        self.note = ""

        self._feedback: list[FollowJointTrajectoryFeedback] = []
        self._sources: list[Callable[[], FollowJointTrajectoryFeedback]] = []

    def update(self, event: GoalEvent) -> None:
        """Take the controller's news of this goal."""
        self.status = event.status
        self.result = event.result or self.result
        self.note = event.note or self.note
        if event.feedback_source is not None:
            self._sources.append(event.feedback_source)

    @property
    def feedback(self) -> list[FollowJointTrajectoryFeedback]:
        """All feedback so far, the newest last."""
        self._feedback += [make() for make in self._sources]
        self._sources.clear()
        return self._feedback

    def __repr__(self) -> str:
        """Return controller, status and result."""
        return f"GoalHandle({self.controller!r}, {self.status.value}, {self.result})"


class ControllerHandle:
    """Sends to one controller, and reads it."""

    def __init__(
        self,
        simulation: "Simulation",
        name: str,
        system: ControllerInterface,
        type_: str,
    ) -> None:
        """Create the handle; `Simulation.controller` does that.

        Args:
            simulation: Where the controller runs.
            name: Name of the controller with its prefix.
            system: The controller.
            type_: Its ros2_control type.
        """
        self.name = name
        self._simulation = simulation
        self._system = system
        self._type = type_

    def check(self, message: Message | None) -> None:
        """Raise InputError if the controller takes no messages of this kind."""
        port = TOPIC if isinstance(message, JointTrajectory) else ACTION
        if not self._system.HasInputPort(port):
            raise InputError(
                f"controller {self.name!r} of type {self._type!r} has no {port}"
            )

    def send_goal(
        self, goal: FollowJointTrajectoryGoal | JointTrajectory, *, where: str = ""
    ) -> GoalHandle:
        """Send a goal to the controller's action; it sees it at its next tick.

        Args:
            goal: The goal, or its trajectory alone.
            where: Where the goal comes from, for messages.

        Raises:
            InputError: If the controller has no such action.
        """
        if isinstance(goal, JointTrajectory):
            goal = FollowJointTrajectoryGoal(trajectory=goal)
        self.check(goal)
        request = SendGoal(goal)
        handle = GoalHandle(self.name, request, where)
        self._simulation.add_goal(handle)
        self._send(ACTION, request)
        return handle

    def send_trajectory(self, trajectory: JointTrajectory, *, where: str = "") -> None:
        """Send a trajectory to the controller's topic.

        Args:
            trajectory: What to follow from the controller's next tick on.
            where: Where it comes from, for messages.

        Raises:
            InputError: If the controller has no such topic.
        """
        self.check(trajectory)
        # A copy: the same message once more is a new one.
        message = dc.replace(trajectory)
        if where:
            self._simulation.add_message(message, where)
        self._send(TOPIC, message)

    def cancel(self) -> None:
        """Cancel the last goal that was sent to the controller, if there is one."""
        goals = [g for g in self._simulation.goals if g.controller == self.name]
        if goals and not goals[-1].status.is_terminal:
            self._send(ACTION, CancelGoal(goals[-1].request))

    def state(self) -> Any:
        """Return the controller's `controller_state` message, as of its last tick."""
        return self._simulation.eval_output(f"{self.name}.controller_state")

    def _send(self, port: str, message: JointTrajectory | ActionRequest) -> None:
        period = 1.0 / self._system.params.update_rate
        self._simulation.publish(f"{self.name}.{port}", message, period)
