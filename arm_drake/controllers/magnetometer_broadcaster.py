"""``magnetometer_broadcaster/MagnetometerBroadcaster``.

Source: ros2_controllers, `magnetometer_broadcaster` (version 6.9.0). Parameters only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_length, check_not_empty


@dc.dataclass(frozen=True)
class MagnetometerBroadcasterParameters:
    """Parameters of a MagnetometerBroadcaster."""

    # Sensor to read.
    sensor_name: str

    # Frame of the message's header.
    frame_id: str

    # Covariance [T^2], 3 x 3 by rows.
    static_covariance: tuple[float, ...] = (0.0,) * 9

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "sensor_name", "frame_id")
        check_length(self, 9, "static_covariance")
