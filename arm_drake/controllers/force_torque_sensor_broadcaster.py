"""``force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster``.

Source: ros2_controllers, `force_torque_sensor_broadcaster` (version 6.9.0). Parameters
only.
"""

import dataclasses as dc
from typing import Annotated, Any

from arm_drake.controllers.validation import check_not_empty
from arm_drake.description.parameters import Rule


@dc.dataclass(frozen=True)
class AxisNames:
    """Full names of the interfaces along x, y and z; "" is none."""

    x: str = ""
    y: str = ""
    z: str = ""


@dc.dataclass(frozen=True)
class InterfaceNames:
    """Full names of the interfaces of a wrench."""

    force: AxisNames = AxisNames()
    torque: AxisNames = AxisNames()


@dc.dataclass(frozen=True)
class AxisOffsets:
    """What is added along x, y and z."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dc.dataclass(frozen=True)
class Offset:
    """What is added to a measured wrench [N], [N·m]."""

    force: AxisOffsets = AxisOffsets()
    torque: AxisOffsets = AxisOffsets()


@dc.dataclass(frozen=True)
class AxisMultipliers:
    """Factors along x, y and z."""

    x: float = 1.0
    y: float = 1.0
    z: float = 1.0


@dc.dataclass(frozen=True)
class Multiplier:
    """Factors of a wrench after its offset."""

    force: AxisMultipliers = AxisMultipliers()
    torque: AxisMultipliers = AxisMultipliers()


@dc.dataclass(frozen=True)
class ForceTorqueSensorBroadcasterParameters:
    """Parameters of a ForceTorqueSensorBroadcaster."""

    # Frame of the message's header.
    frame_id: str

    # Sensor to read, or else the interfaces.
    sensor_name: str = ""
    interface_names: InterfaceNames = InterfaceNames()

    offset: Annotated[Offset, Rule(since="jazzy")] = Offset()
    multiplier: Annotated[Multiplier, Rule(since="jazzy")] = Multiplier()

    # Parameters of filters by name, such as "filter1.type".
    sensor_filter_chain: Annotated[dict[str, Any], Rule(since="jazzy")] = dc.field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "frame_id")
        has_names = self.interface_names != InterfaceNames()
        if bool(self.sensor_name) == has_names:
            got = "both" if has_names else "neither"
            raise ValueError(
                f"expected either sensor_name or interface_names, got {got}"
            )
