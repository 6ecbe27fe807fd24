"""``range_sensor_broadcaster/RangeSensorBroadcaster``.

Source: ros2_controllers, `range_sensor_broadcaster` (version 6.9.0).
"""

import dataclasses as dc

from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.validation import check_not_empty
from arm_drake.messages import Header
from arm_drake.messages.sensors import Range


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


class RangeSensorBroadcaster(TickingController[Range]):
    """Publishes a distance.

    .. pydrake_system::

        name: RangeSensorBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - range

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads
                                    ``<sensor_name>/range`` [m]
    command_interfaces  --    --    Tick; it commands nothing
    range               --    --    Range of the last tick
    ==================  ====  ====  ==================================================

    The state is what was published last. The distance is published as it is, also
    beyond ``min_range`` and ``max_range``.
    """

    def __init__(
        self,
        parameters: RangeSensorBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        super().__init__(
            params, Range(), state_interfaces=(f"{parameters.sensor_name}/range",)
        )
        self._frame_id = parameters.frame_id
        self._constant = Range(
            radiation_type=parameters.radiation_type,
            field_of_view=parameters.field_of_view,
            min_range=parameters.min_range,
            max_range=parameters.max_range,
            variance=parameters.variance,
        )
        self._declare_topic("range", lambda message: message)

    def _update(self, now: Now, state: Range) -> Range:
        del state
        (distance,) = self._read(now.context).tolist()
        header = Header.from_nanoseconds(now.time_ns, self._frame_id)
        return dc.replace(self._constant, header=header, range=distance)
