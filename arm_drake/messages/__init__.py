"""The ROS messages that controllers exchange, as frozen dataclasses.

Names and fields are those of the messages of the same name in `builtin_interfaces`,
`std_msgs`, `geometry_msgs`, `nav_msgs`, `sensor_msgs`, `trajectory_msgs`,
`control_msgs` and `controller_manager_msgs`. Sequences become tuples; a time may be
given as seconds. A message never changes and copies as itself, for a Drake Context
copies its abstract values often. What a user sends is checked where it is made and
raises ValueError; what controllers tell at every tick is taken as it is.
"""

# One statement for each module.
# ruff: isort: skip_file

import types

from arm_drake.messages.base import (
    NANOSECONDS as NANOSECONDS,
    Duration as Duration,
    Header as Header,
    JointState as JointState,
    Message as Message,
    Time as Time,
    TimeLike as TimeLike,
)
from arm_drake.messages.control import (
    AckermannDrive as AckermannDrive,
    AdmittanceControllerState as AdmittanceControllerState,
    Bool as Bool,
    DynamicInterfaceGroupValues as DynamicInterfaceGroupValues,
    DynamicJointState as DynamicJointState,
    Float32 as Float32,
    Float64 as Float64,
    Float64MultiArray as Float64MultiArray,
    GripperCommand as GripperCommand,
    GripperCommandGoal as GripperCommandGoal,
    GripperCommandResult as GripperCommandResult,
    Int8MultiArray as Int8MultiArray,
    InterfaceValue as InterfaceValue,
    MecanumDriveControllerState as MecanumDriveControllerState,
    MultiDOFCommand as MultiDOFCommand,
    MultiDOFState as MultiDOFState,
    MultiDOFStateStamped as MultiDOFStateStamped,
    ParallelGripperCommandGoal as ParallelGripperCommandGoal,
    ParallelGripperCommandResult as ParallelGripperCommandResult,
    ParametersRejected as ParametersRejected,
    ResetOdometry as ResetOdometry,
    SteeringControllerStatus as SteeringControllerStatus,
    Strictness as Strictness,
    String as String,
    SwitchController as SwitchController,
    SwitchControllerResult as SwitchControllerResult,
)
from arm_drake.messages.geometry import (
    Odometry as Odometry,
    Point as Point,
    Pose as Pose,
    PoseStamped as PoseStamped,
    PoseWithCovariance as PoseWithCovariance,
    Quaternion as Quaternion,
    SetOdometry as SetOdometry,
    TFMessage as TFMessage,
    Transform as Transform,
    TransformStamped as TransformStamped,
    Twist as Twist,
    TwistStamped as TwistStamped,
    TwistWithCovariance as TwistWithCovariance,
    Vector3 as Vector3,
    Wrench as Wrench,
    WrenchStamped as WrenchStamped,
)
from arm_drake.messages.sensors import (
    BatteryState as BatteryState,
    BatteryStateArray as BatteryStateArray,
    CameraInfo as CameraInfo,
    Float64Values as Float64Values,
    Image as Image,
    Imu as Imu,
    Keys as Keys,
    LaserScan as LaserScan,
    MagneticField as MagneticField,
    NavSatFix as NavSatFix,
    NavSatStatus as NavSatStatus,
    PointCloud2 as PointCloud2,
    PointField as PointField,
    Range as Range,
    RegionOfInterest as RegionOfInterest,
)
from arm_drake.messages.trajectories import (
    ActionRequest as ActionRequest,
    CancelGoal as CancelGoal,
    CancelResponse as CancelResponse,
    FollowJointTrajectoryErrorCode as FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryFeedback as FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal as FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult as FollowJointTrajectoryResult,
    Goal as Goal,
    GoalEvent as GoalEvent,
    GoalStatus as GoalStatus,
    JointTolerance as JointTolerance,
    JointTrajectory as JointTrajectory,
    JointTrajectoryControllerState as JointTrajectoryControllerState,
    JointTrajectoryPoint as JointTrajectoryPoint,
    QueryTrajectoryState as QueryTrajectoryState,
    Result as Result,
    SendGoal as SendGoal,
    SpeedScalingFactor as SpeedScalingFactor,
    TopicRejected as TopicRejected,
)

# All of these, and not the modules that they come from.
__all__ = sorted(
    name
    for name, value in globals().items()
    if not name.startswith("_") and not isinstance(value, types.ModuleType)
)
