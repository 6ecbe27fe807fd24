"""Parameters of ``diff_drive_controller/DiffDriveController``.

Source: ros2_controllers, `diff_drive_controller` (version 6.9.0; defaults of jazzy, and
by rule those of other distros).
"""

import dataclasses as dc
import math
from typing import Annotated

from arm_drake.controllers.bases.speed_limits import SpeedLimits
from arm_drake.description.given import Given
from arm_drake.description.parameters import Rule
from arm_drake.description.validation import (
    check_above,
    check_at_least,
    check_duration,
    check_length,
    check_not_empty,
    check_not_zero,
)

_DECELERATIONS = (
    "max_deceleration",
    "max_acceleration_reverse",
    "max_deceleration_reverse",
)
_LIMITS = {
    "velocity": ("max_velocity", "min_velocity"),
    "acceleration": ("max_acceleration", "min_acceleration"),
    "jerk": ("max_jerk", "min_jerk"),
}


@dc.dataclass(frozen=True)
class DiffDriveSpeedLimits(SpeedLimits):
    """Limits of a velocity, which humble's has_*_limits switch on."""

    @staticmethod
    def adapt(given: Given) -> None:
        """Take has_*_limits: a limit is off by it, and in humble without it.

        Source: ros2_controllers, pull request 1315, which only makes them deprecated.
        """
        for kind, names in _LIMITS.items():
            gate = f"has_{kind}_limits"
            is_on = given.get(gate, bool)
            limits = [n for n in names if _is_number(given.get(n, float))]
            if is_on and given.is_before("kilted") and names[0] not in limits:
                given.reject(gate, f"needs {names[0]}, which is not given")
            is_humble = given.distro == "humble"
            if kind == "acceleration" and not is_humble:
                later = (n for n in _DECELERATIONS if _is_number(given.get(n, float)))
                limits += later
            is_off = not is_on if is_humble else is_on is False
            if is_off and given.is_before("rolling"):
                for name in limits:
                    what = f"{gate} is not true"
                    given.add(name, "warning", "ignored", what, "the limit is off")
                    given.drop(name)
            elif not is_humble and is_on is not None:
                given.add(
                    gate,
                    "warning" if limits and not is_on else "info",
                    "ignored",
                    "a parameter of humble",
                    f"a limit that is given acts: {', '.join(limits) or 'none'}",
                )
            if is_on is not None:
                given.drop(gate)
        SpeedLimits.adapt(given)


def _is_number(value: float | None) -> bool:
    return value is not None and not math.isnan(value)


@dc.dataclass(frozen=True)
class DiffDriveLinear:
    """Limits of the velocity forwards."""

    x: DiffDriveSpeedLimits = DiffDriveSpeedLimits()


@dc.dataclass(frozen=True)
class DiffDriveAngular:
    """Limits of the velocity of turning."""

    z: DiffDriveSpeedLimits = DiffDriveSpeedLimits()


@dc.dataclass(frozen=True)
class DiffDriveControllerParameters:
    """Parameters of a DiffDriveController."""

    # Joints of the wheels of each side, at least one and as many on both.
    left_wheel_names: tuple[str, ...]
    right_wheel_names: tuple[str, ...]

    # Distance between left and right wheels, above 0 [m], and its correction.
    wheel_separation: float = 0.0
    wheel_separation_multiplier: float = 1.0

    # Radius of the wheels, above 0 [m], and its corrections.
    wheel_radius: float = 0.0
    left_wheel_radius_multiplier: float = 1.0
    right_wheel_radius_multiplier: float = 1.0

    # Wheels on a side; no later distro asks for it.
    wheels_per_side: Annotated[int, Rule(until="humble", is_harmless=True)] = 0

    # Frames of the odometry, and what goes before their names.
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    pose_covariance_diagonal: tuple[float, ...] = (0.0,) * 6
    twist_covariance_diagonal: tuple[float, ...] = (0.0,) * 6

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether the wheels' positions are read, not their velocities.
    position_feedback: bool = True

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Age from which a command counts no more [s].
    cmd_vel_timeout: float = 0.5

    # Whether the limited velocity is published.
    publish_limited_velocity: bool = False

    # How many ticks the odometry's velocity is a mean of.
    velocity_rolling_window_size: int = 10

    # Whether commands are TwistStamped, not Twist; later they always are.
    use_stamped_vel: Annotated[
        bool, Rule(until="humble", is_kept=True, is_harmless=True)
    ] = True

    # Rate of the odometry [Hz]; later it is published at every tick.
    publish_rate: Annotated[float, Rule(until="kilted", is_harmless=True)] = 50.0

    linear: DiffDriveLinear = DiffDriveLinear()
    angular: DiffDriveAngular = DiffDriveAngular()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "left_wheel_names", "right_wheel_names")
        if len(self.left_wheel_names) != len(self.right_wheel_names):
            raise ValueError(
                f"right_wheel_names must be as many as left_wheel_names, got "
                f"{list(self.right_wheel_names)} and {list(self.left_wheel_names)}"
            )
        check_above(self, 0.0, "wheel_separation", "wheel_radius")
        check_at_least(self, 1, "velocity_rolling_window_size")
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")
        check_duration(self, "cmd_vel_timeout")
        check_not_zero(
            self,
            "wheel_separation_multiplier",
            "left_wheel_radius_multiplier",
            "right_wheel_radius_multiplier",
        )
