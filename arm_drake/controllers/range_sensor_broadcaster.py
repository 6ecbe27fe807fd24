"""``range_sensor_broadcaster/RangeSensorBroadcaster``.

Source: ros2_controllers, `range_sensor_broadcaster` (version 6.9.0). Parameters only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_not_empty


@dc.dataclass(frozen=True)
class RangeSensorBroadcasterParameters:
    """Parameters of a RangeSensorBroadcaster."""

    # Sensor to read.
    sensor_name: str

    # Frame of the message's header.
    frame_id: str

    # 0 is ultrasound, 1 is infrared.
    radiation_type: int = 0

    # Width of the beam [rad].
    field_of_view: float = 0.52

    # Smallest and largest distance [m].
    min_range: float = 0.52
    max_range: float = 4.0

    # Variance of the distance [m^2].
    variance: float = 0.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "sensor_name", "frame_id")
