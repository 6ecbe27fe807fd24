"""The ROS messages that controllers exchange, as frozen dataclasses.

Names and fields are those of the messages of the same name in `builtin_interfaces`,
`std_msgs`, `sensor_msgs`, `trajectory_msgs` and `control_msgs`. Sequences become
tuples; a time may be given as seconds. A message never changes and copies as itself,
for a Drake Context copies its abstract values often.
"""

import dataclasses as dc
import enum
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

NANOSECONDS = 1_000_000_000


def _floats(values: Sequence[Any], field: str) -> tuple[float, ...]:
    numbers = tuple(values)
    if all(type(number) is float for number in numbers):
        return numbers
    if any(isinstance(v, bool | str) for v in numbers):
        raise ValueError(f"{field}: expected numbers, got {list(numbers)!r}")
    return tuple(float(v) for v in numbers)


class Message:
    """A message: immutable, so that a copy is the message itself."""

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


@dc.dataclass(frozen=True, order=True)
class Time(Message):
    """A point in time, or a duration: sec + nanosec, nanosec in [0, 1e9)."""

    # Whole seconds; negative before the origin.
    sec: int = 0

    # The rest [ns].
    nanosec: int = 0

    @classmethod
    def of(cls, value: "TimeLike") -> Self:
        """Return the time that a number of seconds, a mapping or a Time stands for.

        Raises:
            ValueError: If the value isn't a finite time.
        """
        if type(value) is cls:
            return value
        if isinstance(value, Time):
            return cls(value.sec, value.nanosec)
        if isinstance(value, Mapping):
            unknown = set(value) - {"sec", "nanosec"}
            parts = [value.get("sec", 0), value.get("nanosec", 0)]
            if unknown or any(type(part) is not int for part in parts):
                raise ValueError(
                    "expected seconds or {sec: int, nanosec: int}, "
                    f"got {dict(value)!r}"
                )
            return cls.from_nanoseconds(parts[0] * NANOSECONDS + parts[1])
        is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise ValueError(
                f"expected seconds or {{sec: int, nanosec: int}}, got {value!r}"
            )
        return cls.from_nanoseconds(round(float(value) * NANOSECONDS))

    @classmethod
    def from_nanoseconds(cls, nanoseconds: int) -> Self:
        """Return the time of this many nanoseconds."""
        return cls(*divmod(nanoseconds, NANOSECONDS))

    def to_nanoseconds(self) -> int:
        """Return the time in nanoseconds."""
        return self.sec * NANOSECONDS + self.nanosec

    def to_seconds(self) -> float:
        """Return the time in seconds."""
        return self.to_nanoseconds() / NANOSECONDS


class Duration(Time):
    """A length of time."""


TimeLike = Time | float | Mapping[str, int]


@dc.dataclass(frozen=True)
class Header(Message):
    """When and in which frame a message holds."""

    # Time of validity; 0 means "now" where a command is concerned.
    stamp: Time = Time()

    frame_id: str = ""


@dc.dataclass(frozen=True)
class JointState(Message):
    """State of a set of joints, N of them (`sensor_msgs/JointState`)."""

    header: Header = Header()

    name: tuple[str, ...] = ()

    # [rad] or [m], shape (N,); NaN where a joint has no such interface.
    position: tuple[float, ...] = ()

    # [rad/s] or [m/s], shape (N,).
    velocity: tuple[float, ...] = ()

    # [N·m] or [N], shape (N,).
    effort: tuple[float, ...] = ()


@dc.dataclass(frozen=True)
class JointTrajectoryPoint(Message):
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
        for field in ("positions", "velocities", "accelerations", "effort"):
            object.__setattr__(self, field, _floats(getattr(self, field), field))
        object.__setattr__(self, "time_from_start", Duration.of(self.time_from_start))


@dc.dataclass(frozen=True)
class JointTrajectory(Message):
    """A motion of a set of joints (`trajectory_msgs/JointTrajectory`)."""

    # A stamp of 0 starts at once.
    header: Header = Header()

    # Order of the vectors of every point.
    joint_names: tuple[str, ...] = ()

    points: tuple[JointTrajectoryPoint, ...] = ()

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        object.__setattr__(self, "points", tuple(self.points))


@dc.dataclass(frozen=True)
class JointTolerance(Message):
    """How far a joint may be off: 0 takes the controller's default, -1 means any."""

    name: str = ""

    # [rad] or [m].
    position: float = 0.0

    # [rad/s] or [m/s].
    velocity: float = 0.0

    # [rad/s^2] or [m/s^2].
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        for field in ("position", "velocity", "acceleration"):
            (number,) = _floats([getattr(self, field)], field)
            object.__setattr__(self, field, number)


@dc.dataclass(frozen=True)
class FollowJointTrajectoryGoal(Message):
    """Goal of the action `control_msgs/FollowJointTrajectory`."""

    trajectory: JointTrajectory = JointTrajectory()

    # Tolerances along the way and at the end.
    path_tolerance: tuple[JointTolerance, ...] = ()
    goal_tolerance: tuple[JointTolerance, ...] = ()

    # How late the goal may be reached; seconds are accepted.
    goal_time_tolerance: Duration = Duration()

    def __post_init__(self) -> None:
        """Take sequences and seconds as they come."""
        object.__setattr__(self, "path_tolerance", tuple(self.path_tolerance))
        object.__setattr__(self, "goal_tolerance", tuple(self.goal_tolerance))
        tolerance = Duration.of(self.goal_time_tolerance)
        object.__setattr__(self, "goal_time_tolerance", tolerance)


class FollowJointTrajectoryErrorCode(enum.IntEnum):
    """`error_code` of a FollowJointTrajectory result."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dc.dataclass(frozen=True)
class FollowJointTrajectoryResult(Message):
    """Result of the action `control_msgs/FollowJointTrajectory`."""

    # One of FollowJointTrajectoryErrorCode.
    error_code: int = 0

    # Why, in words; empty when there is nothing to say.
    error_string: str = ""


@dc.dataclass(frozen=True)
class FollowJointTrajectoryFeedback(Message):
    """Feedback of the action `control_msgs/FollowJointTrajectory`."""

    header: Header = Header()
    joint_names: tuple[str, ...] = ()
    desired: JointTrajectoryPoint = JointTrajectoryPoint()
    actual: JointTrajectoryPoint = JointTrajectoryPoint()
    error: JointTrajectoryPoint = JointTrajectoryPoint()

    # Index of the point that the motion is heading for.
    index: int = 0


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

    goal: FollowJointTrajectoryGoal


@dc.dataclass(frozen=True, eq=False)
class CancelGoal(ActionRequest):
    """Cancel a goal that was sent before."""

    request: SendGoal


@dc.dataclass(frozen=True)
class GoalEvent(Message):
    """News of an action goal: its status, its result once there is one, feedback."""

    request: SendGoal
    status: GoalStatus
    result: FollowJointTrajectoryResult | None = None

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


@dc.dataclass(frozen=True)
class JointTrajectoryControllerState(Message):
    """What a trajectory controller is doing (`control_msgs`, same name)."""

    header: Header = Header()
    joint_names: tuple[str, ...] = ()
    reference: JointTrajectoryPoint = JointTrajectoryPoint()
    feedback: JointTrajectoryPoint = JointTrajectoryPoint()
    error: JointTrajectoryPoint = JointTrajectoryPoint()
    output: JointTrajectoryPoint = JointTrajectoryPoint()
    speed_scaling_factor: float = 1.0
