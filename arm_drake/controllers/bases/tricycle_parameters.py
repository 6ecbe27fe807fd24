"""Parameters of `tricycle_controller/TricycleController`.

Source: ros2_controllers, `tricycle_controller` (version 6.9.0).
"""

import dataclasses as dc
import math
from typing import Annotated, Any

from arm_drake.description.parameters import Rule
from arm_drake.description.validation import (
    check_above,
    check_at_least,
    check_length,
    check_not_empty,
)


def _check_ranges(limits: Any, *quantities: str) -> None:
    """Raise ValueError where a smallest limit exceeds the largest."""
    for quantity in quantities:
        low, high = (getattr(limits, f"{end}_{quantity}") for end in ("min", "max"))
        if low > high:
            raise ValueError(
                f"min_{quantity} must be at most max_{quantity}, got {low} and {high}"
            )


@dc.dataclass(frozen=True)
class TractionLimits:
    """Limits of the driven wheel, of either direction, at least 0; NaN is no limit."""

    # Velocity [rad/s].
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Speeding up [rad/s^2].
    max_acceleration: float = math.nan
    min_acceleration: float = math.nan

    # Slowing down [rad/s^2].
    max_deceleration: float = math.nan
    min_deceleration: float = math.nan

    # Rate of change of the acceleration [rad/s^3].
    max_jerk: float = math.nan
    min_jerk: float = math.nan

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        for name, value in dc.asdict(self).items():
            if value < 0.0:
                raise ValueError(f"{name} must be at least 0, got {value}")
        _check_ranges(self, "velocity", "acceleration", "deceleration", "jerk")


@dc.dataclass(frozen=True)
class SteeringLimits:
    """Limits of the steered joint; NaN is no limit."""

    # Position [rad]; a smallest one that is NaN is the opposite of the largest.
    max_position: float = math.nan
    min_position: float = math.nan

    # Velocity, of either direction, at least 0 [rad/s].
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Acceleration, of either direction, at least 0 [rad/s^2].
    max_acceleration: float = math.nan
    min_acceleration: float = math.nan

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        for name, value in dc.asdict(self).items():
            if value < 0.0 and not name.endswith("position"):
                raise ValueError(f"{name} must be at least 0, got {value}")
        _check_ranges(self, "position", "velocity", "acceleration")


@dc.dataclass(frozen=True)
class TricycleControllerParameters:
    """Parameters of a TricycleController, whose front wheel drives and steers."""

    # Joints that drive and that steer.
    traction_joint_name: str
    steering_joint_name: str

    # Distance between the front wheel and the rear axle, above 0 [m].
    wheelbase: float = 0.0

    # Radius of the driven wheel, above 0 [m].
    wheel_radius: float = 0.0

    # Frames of the odometry.
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    pose_covariance_diagonal: tuple[float, ...] = (0.0,) * 6
    twist_covariance_diagonal: tuple[float, ...] = (0.0,) * 6

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = False

    # Whether the odometry has no pose.
    odom_only_twist: bool = False

    # Age from which a command counts no more, in milliseconds: upstream's own unit.
    cmd_vel_timeout: int = 500

    # Whether the limited command is published.
    publish_ackermann_command: bool = False

    # How many ticks the odometry's velocity is a mean of, at least 1.
    velocity_rolling_window_size: int = 10

    # Whether commands are TwistStamped, not Twist; later they always are.
    use_stamped_vel: Annotated[
        bool, Rule(until="humble", is_kept=True, is_harmless=True)
    ] = True

    traction: TractionLimits = TractionLimits()
    steering: SteeringLimits = SteeringLimits()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "traction_joint_name", "steering_joint_name")
        check_above(self, 0.0, "wheelbase", "wheel_radius")
        check_at_least(self, 1, "velocity_rolling_window_size")
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")
