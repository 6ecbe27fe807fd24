"""Trajectories of joints, and the action that executes them."""

import dataclasses as dc
import enum
from collections.abc import Callable
from typing import TypeAlias, get_args

from arm_drake.importing import dataclass
from arm_drake.messages.base import (
    Duration,
    Header,
    Message,
    check_name,
    check_type,
    take_numbers,
    to_duration,
    to_floats,
    to_message,
    to_messages,
    to_names,
)
from arm_drake.messages.control import (
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
)

# What `arm_drake.messages` has of it.
__all__ = [
    "ActionRequest",
    "CancelGoal",
    "CancelResponse",
    "FollowJointTrajectoryErrorCode",
    "FollowJointTrajectoryFeedback",
    "FollowJointTrajectoryGoal",
    "FollowJointTrajectoryResult",
    "Goal",
    "GoalEvent",
    "GoalStatus",
    "JointTolerance",
    "JointTrajectory",
    "JointTrajectoryControllerState",
    "JointTrajectoryPoint",
    "QueryTrajectoryState",
    "Result",
    "SendGoal",
    "SpeedScalingFactor",
    "TopicRejected",
]

# There is only one empty tuple.
_EMPTY: tuple[float, ...] = ()

_VECTORS = ("positions", "velocities", "accelerations", "effort")


@dataclass(frozen=True)
class JointTrajectoryPoint(Message, ros="trajectory_msgs"):
    """A point of a trajectory; vectors have one element per joint, or none."""

    # [rad] or [m].
    positions: tuple[float, ...] = ()

    # [rad/s] or [m/s].
    velocities: tuple[float, ...] = ()

    # [rad/s^2] or [m/s^2].
    accelerations: tuple[float, ...] = ()

    # [N·m] or [N].
    effort: tuple[float, ...] = ()

    # From the start of the trajectory; seconds are accepted.
    time_from_start: Duration = Duration()

    def __post_init__(self) -> None:
        """Take sequences and seconds as they come."""
        for name in _VECTORS:
            values = getattr(self, name)
            if values is not _EMPTY:
                object.__setattr__(self, name, to_floats(values, name))
        time = self.time_from_start
        if type(time) is not Duration:
            time = to_duration(time, "time_from_start")
            object.__setattr__(self, "time_from_start", time)


@dataclass(frozen=True)
class JointTrajectory(Message, ros="trajectory_msgs"):
    """A motion of a set of joints (`trajectory_msgs/JointTrajectory`)."""

    # A stamp of 0 starts at once.
    header: Header = Header()

    # Order of the vectors of every point.
    joint_names: tuple[str, ...] = ()

    points: tuple[JointTrajectoryPoint, ...] = ()

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        header = to_message(self.header, Header, "header")
        names = to_names(self.joint_names, "joint_names")
        points = to_messages(self.points, JointTrajectoryPoint, "points")
        object.__setattr__(self, "header", header)
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "points", points)


@dataclass(frozen=True)
class JointTolerance(Message, ros="control_msgs"):
    """Tolerance of a joint: 0 takes the controller's default, -1 means any."""

    name: str = ""

    # [rad] or [m].
    position: float = 0.0

    # [rad/s] or [m/s].
    velocity: float = 0.0

    # [rad/s^2] or [m/s^2].
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        check_name(self.name, "name")
        take_numbers(self, "position", "velocity", "acceleration")


@dataclass(frozen=True)
class FollowJointTrajectoryGoal(
    Message, ros="control_msgs/action/FollowJointTrajectory_Goal"
):
    """Goal of the action `control_msgs/FollowJointTrajectory`."""

    trajectory: JointTrajectory = JointTrajectory()

    # Tolerances along the way and at the end.
    path_tolerance: tuple[JointTolerance, ...] = ()
    goal_tolerance: tuple[JointTolerance, ...] = ()

    # How late the goal may be reached; seconds are accepted.
    goal_time_tolerance: Duration = Duration()

    def __post_init__(self) -> None:
        """Take sequences and seconds as they come."""
        check_type(self.trajectory, JointTrajectory, "trajectory")
        for field in ("path_tolerance", "goal_tolerance"):
            tolerances = to_messages(getattr(self, field), JointTolerance, field)
            object.__setattr__(self, field, tolerances)
        late = to_duration(self.goal_time_tolerance, "goal_time_tolerance")
        object.__setattr__(self, "goal_time_tolerance", late)


class FollowJointTrajectoryErrorCode(enum.IntEnum):
    """`error_code` of a FollowJointTrajectory result."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dataclass(frozen=True)
class FollowJointTrajectoryResult(Message):
    """Result of the action `control_msgs/FollowJointTrajectory`."""

    # One of FollowJointTrajectoryErrorCode.
    error_code: int = 0

    # Why, in words; empty when there is nothing to say.
    error_string: str = ""


@dataclass(frozen=True)
class FollowJointTrajectoryFeedback(Message):
    """Feedback of the action `control_msgs/FollowJointTrajectory`."""

    header: Header = Header()
    joint_names: tuple[str, ...] = ()
    desired: JointTrajectoryPoint = JointTrajectoryPoint()
    actual: JointTrajectoryPoint = JointTrajectoryPoint()
    error: JointTrajectoryPoint = JointTrajectoryPoint()

    # Index of the point that the motion is heading for.
    index: int = 0


@dataclass(frozen=True)
class JointTrajectoryControllerState(Message, ros="control_msgs"):
    """State of a trajectory controller (`control_msgs`, same name)."""

    header: Header = Header()
    joint_names: tuple[str, ...] = ()
    reference: JointTrajectoryPoint = JointTrajectoryPoint()
    feedback: JointTrajectoryPoint = JointTrajectoryPoint()
    error: JointTrajectoryPoint = JointTrajectoryPoint()
    output: JointTrajectoryPoint = JointTrajectoryPoint()
    speed_scaling_factor: float = 1.0


@dataclass(frozen=True, eq=False)
class SpeedScalingFactor(Message, ros="control_msgs"):
    """Scaling factor of time along trajectories; 0 pauses (`control_msgs`)."""

    factor: float = 1.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        take_numbers(self, "factor")


@dataclass(frozen=True)
class QueryTrajectoryState(Message):
    """Response of the service `control_msgs/QueryTrajectoryState`, n joints.

    Without success, the vectors are the last point or what was measured last.
    """

    success: bool = False
    message: str = ""
    name: tuple[str, ...] = ()

    # [rad] or [m], then per second and per second squared; shape (n,) or ().
    position: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    acceleration: tuple[float, ...] = ()


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
    """Request of a client on an action port. Each request is one of its own."""


@dataclass(frozen=True, eq=False)
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


@dataclass(frozen=True, eq=False)
class CancelGoal(ActionRequest):
    """Cancel a goal that was sent before."""

    request: SendGoal

    def __post_init__(self) -> None:
        """Refuse anything but the request that sent the goal."""
        check_type(self.request, SendGoal, "request")


@dataclass(frozen=True, eq=False)
class CancelResponse(Message):
    """Response of a controller to a CancelGoal; a GoalEvent has the goal's end."""

    request: CancelGoal
    accepted: bool

    # Why not; empty if it does.
    reason: str = ""


@dataclass(frozen=True)
class GoalEvent(Message):
    """Event of an action goal: its status, its result once there is one, feedback."""

    request: SendGoal
    status: GoalStatus
    result: Result | None = None

    # What of the goal is not taken as written, in words.
    note: str = ""

    # What the result doesn't tell, such as the joint that violates its tolerance.
    detail: str = dc.field(default="", compare=False)

    # What makes the feedback, if there is any: most of it is never looked at.
    feedback_source: Callable[[], FollowJointTrajectoryFeedback] | None = dc.field(
        default=None, compare=False, repr=False
    )

    @property
    def feedback(self) -> FollowJointTrajectoryFeedback | None:
        """The feedback, if that is the event."""
        return None if self.feedback_source is None else self.feedback_source()


@dataclass(frozen=True)
class TopicRejected(Message):
    """Event: a controller didn't accept a topic message."""

    message: Message
    reason: str
