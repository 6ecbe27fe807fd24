"""Parameters of a MecanumDriveController.

Source: ros2_controllers, `mecanum_drive_controller` (version 6.9.0).
"""

import dataclasses as dc
from typing import Annotated

from arm_drake.control.odometry import PlanarPose
from arm_drake.control.rate_limiter import RateLimiter
from arm_drake.controllers.bases.mecanum import MecanumKinematics
from arm_drake.controllers.bases.speed_limits import SpeedLimits
from arm_drake.description.parameters import Rule
from arm_drake.description.validation import (
    check_above,
    check_duration,
    check_length,
    check_not_empty,
)
from arm_drake.errors import ParameterError


@dc.dataclass(frozen=True)
class BaseFrameOffset:
    """Pose of the wheels' centre in the base frame [m], [rad]."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0


@dc.dataclass(frozen=True)
class MecanumKinematicsParameters:
    """Measures of the base."""

    base_frame_offset: BaseFrameOffset = BaseFrameOffset()

    # Radius of the wheels, above 0 [m].
    wheels_radius: float = 0.0

    # Distances of the wheels from the centre, along x plus along y [m].
    sum_of_robot_center_projection_on_X_Y_axis: float = 0.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_above(self, 0.0, "wheels_radius")


@dc.dataclass(frozen=True)
class MecanumLinear:
    """Limits of the velocity forwards and sideways."""

    x: SpeedLimits = dc.field(default=SpeedLimits())
    y: SpeedLimits = dc.field(default=SpeedLimits())


@dc.dataclass(frozen=True)
class MecanumAngular:
    """Limits of the velocity of turning."""

    z: SpeedLimits = dc.field(default=SpeedLimits())


@dc.dataclass(frozen=True)
class MecanumDriveControllerParameters:
    """Parameters of a MecanumDriveController."""

    # Joints of the wheels.
    front_left_wheel_command_joint_name: str
    front_right_wheel_command_joint_name: str
    rear_right_wheel_command_joint_name: str
    rear_left_wheel_command_joint_name: str

    # Joints to read in their places; "" is the same.
    front_left_wheel_state_joint_name: str = ""
    front_right_wheel_state_joint_name: str = ""
    rear_right_wheel_state_joint_name: str = ""
    rear_left_wheel_state_joint_name: str = ""

    # Age from which a command counts no more [s]; 0 uses each one once.
    reference_timeout: float = 0.0

    kinematics: MecanumKinematicsParameters = dc.field(kw_only=True)

    # Frames of the odometry, and what goes before their names.
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""
    base_frame_id: str = "base_link"
    odom_frame_id: str = "odom"

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    twist_covariance_diagonal: tuple[float, ...] = (0.1,) * 6
    pose_covariance_diagonal: tuple[float, ...] = (0.1,) * 6

    linear: Annotated[MecanumLinear, Rule(since="rolling")] = MecanumLinear()
    angular: Annotated[MecanumAngular, Rule(since="rolling")] = MecanumAngular()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(
            self,
            "front_left_wheel_command_joint_name",
            "front_right_wheel_command_joint_name",
            "rear_right_wheel_command_joint_name",
            "rear_left_wheel_command_joint_name",
        )
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")
        check_duration(self, "reference_timeout")


def make_kinematics(parameters: MecanumDriveControllerParameters) -> MecanumKinematics:
    """Return the kinematics of a base.

    Raises:
        ParameterError: If its wheels can't tell how it turns.
    """
    given = parameters.kinematics
    reach = given.sum_of_robot_center_projection_on_X_Y_axis
    if not reach:
        raise ParameterError(
            "kinematics.sum_of_robot_center_projection_on_X_Y_axis must not be 0; it "
            "is half the wheelbase plus half the distance of left and right wheels [m]"
        )
    offset = given.base_frame_offset
    return MecanumKinematics(
        given.wheels_radius, reach, PlanarPose(offset.x, offset.y, offset.theta)
    )


def make_limiters(parameters: MecanumDriveControllerParameters) -> list[RateLimiter]:
    """Return the limits of the velocity along x and y and about z."""
    linear, angular = parameters.linear, parameters.angular
    return [
        RateLimiter(
            min_value=limits.min_velocity,
            max_value=limits.max_velocity,
            min_first_derivative_neg=limits.max_acceleration_reverse,
            max_first_derivative_pos=limits.max_acceleration,
            min_first_derivative_pos=limits.max_deceleration,
            max_first_derivative_neg=limits.max_deceleration_reverse,
            min_second_derivative=limits.min_jerk,
            max_second_derivative=limits.max_jerk,
        )
        for limits in (linear.x, linear.y, angular.z)
    ]
