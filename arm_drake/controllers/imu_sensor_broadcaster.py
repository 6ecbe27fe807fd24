"""``imu_sensor_broadcaster/IMUSensorBroadcaster``.

Source: ros2_controllers, `imu_sensor_broadcaster` (version 6.9.0). Parameters only.
"""

import dataclasses as dc
from typing import Annotated

from arm_drake.controllers.validation import check_length, check_not_empty
from arm_drake.description.parameters import Rule


@dc.dataclass(frozen=True)
class RotationOffset:
    """Rotation from the sensor's frame to the published one [rad]."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0


@dc.dataclass(frozen=True)
class IMUSensorBroadcasterParameters:
    """Parameters of an IMUSensorBroadcaster."""

    # Sensor to read.
    sensor_name: str

    # Frame of the message's header.
    frame_id: str

    # Covariances, 3 x 3 by rows.
    static_covariance_orientation: tuple[float, ...] = (0.0,) * 9
    static_covariance_angular_velocity: tuple[float, ...] = (0.0,) * 9
    static_covariance_linear_acceleration: tuple[float, ...] = (0.0,) * 9

    rotation_offset: Annotated[RotationOffset, Rule(since="kilted")] = RotationOffset()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "sensor_name", "frame_id")
        check_length(
            self,
            9,
            "static_covariance_orientation",
            "static_covariance_angular_velocity",
            "static_covariance_linear_acceleration",
        )
