"""Parameters of an OmniWheelDriveController.

Source: ros2_controllers, `omni_wheel_drive_controller` (version 6.9.0).
"""

import dataclasses as dc

from arm_drake.description.validation import check_above, check_duration, check_length


@dc.dataclass(frozen=True)
class DiagonalCovariance:
    """Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw."""

    pose: tuple[float, ...] = (0.0,) * 6
    twist: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_length(self, 6, "pose", "twist")


@dc.dataclass(frozen=True)
class OmniWheelDriveControllerParameters:
    """Parameters of an OmniWheelDriveController."""

    # Joints of the wheels, anticlockwise from the first; at least three.
    wheel_names: tuple[str, ...]

    # Angle of the first wheel from the x axis [rad].
    wheel_offset: float

    # Distance of the wheels from the centre, above 0 [m].
    robot_radius: float

    # Radius of the wheels, above 0 [m].
    wheel_radius: float

    # Frames of the odometry, and what goes before their names.
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"

    diagonal_covariance: DiagonalCovariance = DiagonalCovariance()

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether the wheels' positions are read, not their velocities.
    position_feedback: bool = True

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Age from which a command counts no more [s].
    cmd_vel_timeout: float = 0.5

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        if len(self.wheel_names) < 3:
            raise ValueError(
                f"wheel_names must have at least 3 elements, "
                f"got {list(self.wheel_names)}"
            )
        check_above(self, 0.0, "robot_radius", "wheel_radius")
        check_duration(self, "cmd_vel_timeout")
