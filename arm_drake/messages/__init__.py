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
    Goal,
    GoalEvent,
    GoalStatus,
    Result,
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
from arm_drake.messages.grippers import (
    Float32,
    Float64,
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
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
    "Float32",
    "Float64",
    "Float64MultiArray",
    "FollowJointTrajectoryErrorCode",
    "FollowJointTrajectoryFeedback",
    "FollowJointTrajectoryGoal",
    "FollowJointTrajectoryResult",
    "Goal",
    "GoalEvent",
    "GoalStatus",
    "GripperCommand",
    "GripperCommandGoal",
    "GripperCommandResult",
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
    "ParallelGripperCommandGoal",
    "ParallelGripperCommandResult",
    "ParametersRejected",
    "QueryTrajectoryState",
    "Result",
    "SendGoal",
    "SpeedScalingFactor",
    "Strictness",
    "SwitchController",
    "SwitchControllerResult",
    "Time",
    "TimeLike",
    "TopicRejected",
]
