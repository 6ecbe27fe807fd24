"""The ROS messages that controllers exchange, as frozen dataclasses.

Names and fields are those of the messages of the same name in `builtin_interfaces`,
`std_msgs`, `geometry_msgs`, `nav_msgs`, `sensor_msgs`, `trajectory_msgs`,
`control_msgs` and `controller_manager_msgs`. Sequences become tuples; a time may be
given as seconds. A message never changes and copies as itself, for a Drake Context
copies its abstract values often. What a user sends is checked where it is made and
raises ValueError; what controllers tell at every tick is taken as it is.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arm_drake.messages.base import NANOSECONDS as NANOSECONDS
    from arm_drake.messages.base import Duration as Duration
    from arm_drake.messages.base import Header as Header
    from arm_drake.messages.base import JointState as JointState
    from arm_drake.messages.base import Message as Message
    from arm_drake.messages.base import Time as Time
    from arm_drake.messages.base import TimeLike as TimeLike
    from arm_drake.messages.control import AckermannDrive as AckermannDrive
    from arm_drake.messages.control import (
        AdmittanceControllerState as AdmittanceControllerState,
    )
    from arm_drake.messages.control import Bool as Bool
    from arm_drake.messages.control import (
        DynamicInterfaceGroupValues as DynamicInterfaceGroupValues,
    )
    from arm_drake.messages.control import DynamicJointState as DynamicJointState
    from arm_drake.messages.control import Float32 as Float32
    from arm_drake.messages.control import Float64 as Float64
    from arm_drake.messages.control import Float64MultiArray as Float64MultiArray
    from arm_drake.messages.control import GripperCommand as GripperCommand
    from arm_drake.messages.control import GripperCommandGoal as GripperCommandGoal
    from arm_drake.messages.control import GripperCommandResult as GripperCommandResult
    from arm_drake.messages.control import Int8MultiArray as Int8MultiArray
    from arm_drake.messages.control import InterfaceValue as InterfaceValue
    from arm_drake.messages.control import (
        MecanumDriveControllerState as MecanumDriveControllerState,
    )
    from arm_drake.messages.control import MultiDOFCommand as MultiDOFCommand
    from arm_drake.messages.control import MultiDOFState as MultiDOFState
    from arm_drake.messages.control import MultiDOFStateStamped as MultiDOFStateStamped
    from arm_drake.messages.control import (
        ParallelGripperCommandGoal as ParallelGripperCommandGoal,
    )
    from arm_drake.messages.control import (
        ParallelGripperCommandResult as ParallelGripperCommandResult,
    )
    from arm_drake.messages.control import ParametersRejected as ParametersRejected
    from arm_drake.messages.control import ResetOdometry as ResetOdometry
    from arm_drake.messages.control import (
        SteeringControllerStatus as SteeringControllerStatus,
    )
    from arm_drake.messages.control import Strictness as Strictness
    from arm_drake.messages.control import String as String
    from arm_drake.messages.control import SwitchController as SwitchController
    from arm_drake.messages.control import (
        SwitchControllerResult as SwitchControllerResult,
    )
    from arm_drake.messages.geometry import Odometry as Odometry
    from arm_drake.messages.geometry import Point as Point
    from arm_drake.messages.geometry import Pose as Pose
    from arm_drake.messages.geometry import PoseStamped as PoseStamped
    from arm_drake.messages.geometry import PoseWithCovariance as PoseWithCovariance
    from arm_drake.messages.geometry import Quaternion as Quaternion
    from arm_drake.messages.geometry import SetOdometry as SetOdometry
    from arm_drake.messages.geometry import TFMessage as TFMessage
    from arm_drake.messages.geometry import Transform as Transform
    from arm_drake.messages.geometry import TransformStamped as TransformStamped
    from arm_drake.messages.geometry import Twist as Twist
    from arm_drake.messages.geometry import TwistStamped as TwistStamped
    from arm_drake.messages.geometry import TwistWithCovariance as TwistWithCovariance
    from arm_drake.messages.geometry import Vector3 as Vector3
    from arm_drake.messages.geometry import Wrench as Wrench
    from arm_drake.messages.geometry import WrenchStamped as WrenchStamped
    from arm_drake.messages.sensors import BatteryState as BatteryState
    from arm_drake.messages.sensors import BatteryStateArray as BatteryStateArray
    from arm_drake.messages.sensors import Float64Values as Float64Values
    from arm_drake.messages.sensors import Imu as Imu
    from arm_drake.messages.sensors import Keys as Keys
    from arm_drake.messages.sensors import MagneticField as MagneticField
    from arm_drake.messages.sensors import NavSatFix as NavSatFix
    from arm_drake.messages.sensors import NavSatStatus as NavSatStatus
    from arm_drake.messages.sensors import Range as Range
    from arm_drake.messages.trajectories import ActionRequest as ActionRequest
    from arm_drake.messages.trajectories import CancelGoal as CancelGoal
    from arm_drake.messages.trajectories import CancelResponse as CancelResponse
    from arm_drake.messages.trajectories import (
        FollowJointTrajectoryErrorCode as FollowJointTrajectoryErrorCode,
    )
    from arm_drake.messages.trajectories import (
        FollowJointTrajectoryFeedback as FollowJointTrajectoryFeedback,
    )
    from arm_drake.messages.trajectories import (
        FollowJointTrajectoryGoal as FollowJointTrajectoryGoal,
    )
    from arm_drake.messages.trajectories import (
        FollowJointTrajectoryResult as FollowJointTrajectoryResult,
    )
    from arm_drake.messages.trajectories import Goal as Goal
    from arm_drake.messages.trajectories import GoalEvent as GoalEvent
    from arm_drake.messages.trajectories import GoalStatus as GoalStatus
    from arm_drake.messages.trajectories import JointTolerance as JointTolerance
    from arm_drake.messages.trajectories import JointTrajectory as JointTrajectory
    from arm_drake.messages.trajectories import (
        JointTrajectoryControllerState as JointTrajectoryControllerState,
    )
    from arm_drake.messages.trajectories import (
        JointTrajectoryPoint as JointTrajectoryPoint,
    )
    from arm_drake.messages.trajectories import (
        QueryTrajectoryState as QueryTrajectoryState,
    )
    from arm_drake.messages.trajectories import Result as Result
    from arm_drake.messages.trajectories import SendGoal as SendGoal
    from arm_drake.messages.trajectories import SpeedScalingFactor as SpeedScalingFactor
    from arm_drake.messages.trajectories import TopicRejected as TopicRejected

# Where each is defined. A module is imported when one of its names is first used: a
# robot needs few, and classes take a while to make.
_MODULES = {
    "AckermannDrive": "control",
    "ActionRequest": "trajectories",
    "AdmittanceControllerState": "control",
    "BatteryState": "sensors",
    "BatteryStateArray": "sensors",
    "Bool": "control",
    "CancelGoal": "trajectories",
    "CancelResponse": "trajectories",
    "Duration": "base",
    "DynamicInterfaceGroupValues": "control",
    "DynamicJointState": "control",
    "Float32": "control",
    "Float64": "control",
    "Float64MultiArray": "control",
    "Float64Values": "sensors",
    "FollowJointTrajectoryErrorCode": "trajectories",
    "FollowJointTrajectoryFeedback": "trajectories",
    "FollowJointTrajectoryGoal": "trajectories",
    "FollowJointTrajectoryResult": "trajectories",
    "Goal": "trajectories",
    "GoalEvent": "trajectories",
    "GoalStatus": "trajectories",
    "GripperCommand": "control",
    "GripperCommandGoal": "control",
    "GripperCommandResult": "control",
    "Header": "base",
    "Imu": "sensors",
    "Int8MultiArray": "control",
    "InterfaceValue": "control",
    "JointState": "base",
    "JointTolerance": "trajectories",
    "JointTrajectory": "trajectories",
    "JointTrajectoryControllerState": "trajectories",
    "JointTrajectoryPoint": "trajectories",
    "Keys": "sensors",
    "MagneticField": "sensors",
    "MecanumDriveControllerState": "control",
    "Message": "base",
    "MultiDOFCommand": "control",
    "MultiDOFState": "control",
    "MultiDOFStateStamped": "control",
    "NANOSECONDS": "base",
    "NavSatFix": "sensors",
    "NavSatStatus": "sensors",
    "Odometry": "geometry",
    "ParallelGripperCommandGoal": "control",
    "ParallelGripperCommandResult": "control",
    "ParametersRejected": "control",
    "Point": "geometry",
    "Pose": "geometry",
    "PoseStamped": "geometry",
    "PoseWithCovariance": "geometry",
    "Quaternion": "geometry",
    "QueryTrajectoryState": "trajectories",
    "Range": "sensors",
    "ResetOdometry": "control",
    "Result": "trajectories",
    "SendGoal": "trajectories",
    "SetOdometry": "geometry",
    "SpeedScalingFactor": "trajectories",
    "SteeringControllerStatus": "control",
    "Strictness": "control",
    "String": "control",
    "SwitchController": "control",
    "SwitchControllerResult": "control",
    "TFMessage": "geometry",
    "Time": "base",
    "TimeLike": "base",
    "TopicRejected": "trajectories",
    "Transform": "geometry",
    "TransformStamped": "geometry",
    "Twist": "geometry",
    "TwistStamped": "geometry",
    "TwistWithCovariance": "geometry",
    "Vector3": "geometry",
    "Wrench": "geometry",
    "WrenchStamped": "geometry",
}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a message when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_MODULES[name]}")
    value = getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names of the messages."""
    return __all__
