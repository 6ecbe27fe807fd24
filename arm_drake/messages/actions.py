"""What clients ask of actions and topics, and what becomes of it."""

import dataclasses as dc
import enum
from collections.abc import Callable
from typing import TypeAlias, get_args

from arm_drake.messages.base import Message
from arm_drake.messages.checks import check_type
from arm_drake.messages.grippers import (
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
)
from arm_drake.messages.trajectories import (
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    JointTrajectory,
)

Goal: TypeAlias = (
    FollowJointTrajectoryGoal | GripperCommandGoal | ParallelGripperCommandGoal
)
Result: TypeAlias = (
    FollowJointTrajectoryResult | GripperCommandResult | ParallelGripperCommandResult
)


class GoalStatus(enum.Enum):
    """Status of an action goal (`action_msgs/GoalStatus`, and REJECTED)."""

    PENDING = "PENDING"  # sent, not yet seen by the controller
    REJECTED = "REJECTED"
    EXECUTING = "EXECUTING"
    SUCCEEDED = "SUCCEEDED"
    CANCELED = "CANCELED"
    ABORTED = "ABORTED"

    @property
    def is_terminal(self) -> bool:
        """Whether the goal is done, one way or another."""
        return self not in (GoalStatus.PENDING, GoalStatus.EXECUTING)


class ActionRequest(Message):
    """What a client asks on an action port. Each request is one of its own."""


@dc.dataclass(frozen=True, eq=False)
class SendGoal(ActionRequest):
    """Execute a goal."""

    goal: Goal

    def __post_init__(self) -> None:
        """Refuse anything but a goal."""
        hint = ""
        if isinstance(self.goal, JointTrajectory):
            hint = "FollowJointTrajectoryGoal(trajectory) is one"
        elif isinstance(self.goal, GripperCommand):
            hint = "GripperCommandGoal(command) is one"
        check_type(self.goal, get_args(Goal), "goal", hint=hint)


@dc.dataclass(frozen=True, eq=False)
class CancelGoal(ActionRequest):
    """Cancel a goal that was sent before."""

    request: SendGoal

    def __post_init__(self) -> None:
        """Refuse anything but the request that sent the goal."""
        check_type(self.request, SendGoal, "request")


@dc.dataclass(frozen=True, eq=False)
class CancelResponse(Message):
    """Whether a controller takes a CancelGoal; a GoalEvent tells how the goal ends."""

    request: CancelGoal
    accepted: bool

    # Why not; empty if it does.
    reason: str = ""


@dc.dataclass(frozen=True)
class GoalEvent(Message):
    """News of an action goal: its status, its result once there is one, feedback."""

    request: SendGoal
    status: GoalStatus
    result: Result | None = None

    # What of the goal is not taken as written, in words.
    note: str = ""

    # What makes the feedback, if there is any: most of it is never looked at.
    feedback_source: Callable[[], FollowJointTrajectoryFeedback] | None = dc.field(
        default=None, compare=False, repr=False
    )

    @property
    def feedback(self) -> FollowJointTrajectoryFeedback | None:
        """The feedback, if that is the news."""
        return None if self.feedback_source is None else self.feedback_source()


@dc.dataclass(frozen=True)
class TopicRejected(Message):
    """News of a topic message that a controller didn't accept."""

    message: Message
    reason: str
