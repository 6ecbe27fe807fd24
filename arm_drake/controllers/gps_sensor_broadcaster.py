"""``gps_sensor_broadcaster/GPSSensorBroadcaster``.

Source: ros2_controllers, `gps_sensor_broadcaster` (version 6.9.0).
"""

import dataclasses as dc

from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.validation import check_length, check_not_empty
from arm_drake.messages import Header
from arm_drake.messages.sensors import NavSatFix, NavSatStatus, to_code

_PLACE = ("latitude", "longitude", "altitude")

# Types of a covariance in NavSatFix.
_DIAGONAL_KNOWN = 2
_KNOWN = 3

# NavSatStatus of a sensor that tells none.
_UNKNOWN = NavSatStatus()


@dc.dataclass(frozen=True)
class GPSSensorBroadcasterParameters:
    """Parameters of a GPSSensorBroadcaster."""

    # Sensor to read.
    sensor_name: str

    # Frame of the message's header.
    frame_id: str

    # Covariance of the position [m^2], 3 x 3 by rows.
    static_position_covariance: tuple[float, ...] = (0.0,) * 9

    # Whether the sensor tells the covariance.
    read_covariance_from_interface: bool = False

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "sensor_name", "frame_id")
        check_length(self, 9, "static_position_covariance")


class GPSSensorBroadcaster(TickingController[NavSatFix]):
    """Publishes a place on earth.

    .. pydrake_system::

        name: GPSSensorBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - gps/fix

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads ``status``,
                                    ``service``, ``latitude``, ``longitude`` and
                                    ``altitude`` of ``<sensor_name>``, with
                                    ``read_covariance_from_interface`` also
                                    ``latitude_covariance`` and so on
    command_interfaces  --    --    Tick; it commands nothing
    gps/fix             --    --    NavSatFix of the last tick
    ==================  ====  ====  ==================================================

    The state is what was published last. Covariances that are read are the diagonal of
    the message's matrix, in the order of their interfaces, as upstream has it.
    """

    def __init__(
        self,
        parameters: GPSSensorBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        names = ["status", "service", *_PLACE]
        if parameters.read_covariance_from_interface:
            names += [f"{name}_covariance" for name in _PLACE]
        sensor = parameters.sensor_name
        super().__init__(
            params,
            NavSatFix(),
            state_interfaces=tuple(f"{sensor}/{name}" for name in names),
        )
        self._frame_id = parameters.frame_id
        self._covariance = parameters.static_position_covariance
        self._declare_topic("gps/fix", lambda message: message)

    def _update(self, now: Now, state: NavSatFix) -> NavSatFix:
        del state
        values = self._read(now.context).tolist()
        status, service, latitude, longitude, altitude, *diagonal = values
        covariance, kind = self._covariance, _KNOWN
        if diagonal:
            x, y, z = diagonal
            covariance = (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z)
            kind = _DIAGONAL_KNOWN
        return NavSatFix(
            Header.from_nanoseconds(now.time_ns, self._frame_id),
            NavSatStatus(
                to_code(status, _UNKNOWN.status), to_code(service, _UNKNOWN.service)
            ),
            latitude,
            longitude,
            altitude,
            covariance,
            kind,
        )
