"""``magnetometer_broadcaster/MagnetometerBroadcaster``.

Source: ros2_controllers, `magnetometer_broadcaster` (version 6.9.0).
"""

import dataclasses as dc

from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.validation import check_length, check_not_empty
from arm_drake.messages import Header, Vector3
from arm_drake.messages.sensors import MagneticField


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


class MagnetometerBroadcaster(TickingController[MagneticField]):
    """Publishes a magnetic field.

    .. pydrake_system::

        name: MagnetometerBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - magnetic_field

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads
                                    ``<sensor_name>/magnetic_field.{x,y,z}`` [T]
    command_interfaces  --    --    Tick; it commands nothing
    magnetic_field      --    --    MagneticField of the last tick
    ==================  ====  ====  ==================================================

    The state is what was published last.
    """

    def __init__(
        self,
        parameters: MagnetometerBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        sensor = parameters.sensor_name
        super().__init__(
            params,
            MagneticField(),
            state_interfaces=tuple(f"{sensor}/magnetic_field.{a}" for a in "xyz"),
        )
        self._frame_id = parameters.frame_id
        self._covariance = parameters.static_covariance
        self._declare_topic("magnetic_field", lambda message: message)

    def _update(self, now: Now, state: MagneticField) -> MagneticField:
        del state
        field = Vector3(*self._read(now.context).tolist())
        header = Header.from_nanoseconds(now.time_ns, self._frame_id)
        return MagneticField(header, field, self._covariance)
