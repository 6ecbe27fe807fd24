"""The ROS messages that controllers exchange, as frozen dataclasses.

Names and fields are those of the messages of the same name in `builtin_interfaces`,
`std_msgs`, `sensor_msgs`, `trajectory_msgs`, `control_msgs` and
`controller_manager_msgs`. Sequences become tuples; a time may be given as seconds. A
message never changes and copies as itself, for a Drake Context copies its abstract
values often. What a user sends is checked where it is made and raises ValueError; what
controllers tell at every tick is taken as it is.
"""

from arm_drake.messages.actions import (
    ActionRequest,
    CancelGoal,
    CancelResponse,
    GoalEvent,
    GoalStatus,
    SendGoal,
    TopicRejected,
)
from arm_drake.messages.base import (
    NANOSECONDS,
    Duration,
    Header,
    JointState,
    Message,
    Time,
    TimeLike,
)
from arm_drake.messages.controllers import (
    DynamicJointState,
    Float64MultiArray,
    InterfaceValue,
    MultiDOFCommand,
    MultiDOFState,
    MultiDOFStateStamped,
    ParametersRejected,
    Strictness,
    SwitchController,
    SwitchControllerResult,
)
from arm_drake.messages.trajectories import (
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    QueryTrajectoryState,
    SpeedScalingFactor,
)

__all__ = [
    "NANOSECONDS",
    "ActionRequest",
    "CancelGoal",
    "CancelResponse",
    "Duration",
    "DynamicJointState",
    "Float64MultiArray",
    "FollowJointTrajectoryErrorCode",
    "FollowJointTrajectoryFeedback",
    "FollowJointTrajectoryGoal",
    "FollowJointTrajectoryResult",
    "GoalEvent",
    "GoalStatus",
    "Header",
    "InterfaceValue",
    "JointState",
    "JointTolerance",
    "JointTrajectory",
    "JointTrajectoryControllerState",
    "JointTrajectoryPoint",
    "Message",
    "MultiDOFCommand",
    "MultiDOFState",
    "MultiDOFStateStamped",
    "ParametersRejected",
    "QueryTrajectoryState",
    "SendGoal",
    "SpeedScalingFactor",
    "Strictness",
    "SwitchController",
    "SwitchControllerResult",
    "Time",
    "TimeLike",
    "TopicRejected",
]
