"""``imu_sensor_broadcaster/IMUSensorBroadcaster``.

Source: ros2_controllers, `imu_sensor_broadcaster` (version 6.9.0).
"""

import dataclasses as dc
from typing import Annotated

import numpy as np
from pydrake.common.eigen_geometry import Quaternion as DrakeQuaternion
from pydrake.math import RollPitchYaw

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.parameters import Rule
from arm_drake.description.validation import check_length, check_not_empty
from arm_drake.messages import Header, Quaternion, Vector3
from arm_drake.messages.sensors import Imu

_INTERFACES = (
    *(f"orientation.{axis}" for axis in "xyzw"),
    *(f"angular_velocity.{axis}" for axis in "xyz"),
    *(f"linear_acceleration.{axis}" for axis in "xyz"),
)


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


class IMUSensorBroadcaster(TickingController[Imu]):
    """Publishes what an inertial measurement unit measures.

    .. pydrake_system::

        name: IMUSensorBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - exported_state_interfaces
        - imu

    =========================  ====  =================================================
    port                       size  meaning
    =========================  ====  =================================================
    controller_manager         --    Cycle: when to tick
    state_interfaces           m     everything that is measured; it reads
                                     ``orientation.{x,y,z,w}``,
                                     ``angular_velocity.{x,y,z}`` [rad/s] and
                                     ``linear_acceleration.{x,y,z}`` [m/s^2] of
                                     ``<sensor_name>``
    command_interfaces         --    Tick; it commands nothing
    exported_state_interfaces  10    what the last tick published, in this order, as
                                     ``<name>/<sensor_name>/orientation.x`` and so on;
                                     not in humble
    imu                        --    Imu of the last tick
    =========================  ====  =================================================

    The state is what was published last. With r the rotation of the parameter
    ``rotation_offset`` (yaw, then pitch, then roll, about the axes as they turn),
    R its matrix, and q, w, a what is measured::

        orientation = q r^-1,  angular_velocity = R w,  linear_acceleration = R a

    Covariances C of velocity and acceleration become R C R^T; that of the orientation
    is of the fixed frame and stays.
    """

    def __init__(
        self,
        parameters: IMUSensorBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        sensor, offset = parameters.sensor_name, parameters.rotation_offset
        read = tuple(f"{sensor}/{name}" for name in _INTERFACES)
        exported = tuple(f"{params.controller_name}/{name}" for name in read)
        super().__init__(
            params,
            Imu(),
            state_interfaces=read,
            exported_interfaces=() if params.distro == "humble" else exported,
        )
        self._frame_id = parameters.frame_id
        turn = RollPitchYaw(offset.roll, offset.pitch, offset.yaw)
        # A rotation of nothing would spread NaN from one axis to the others.
        self._is_turned = offset != RotationOffset()
        self._rotation: Array = turn.ToRotationMatrix().matrix()
        self._inverse = turn.ToQuaternion().inverse()
        self._orientation_covariance = parameters.static_covariance_orientation
        self._velocity_covariance = self._turn_covariance(
            parameters.static_covariance_angular_velocity
        )
        self._acceleration_covariance = self._turn_covariance(
            parameters.static_covariance_linear_acceleration
        )
        self._declare_topic("imu", lambda message: message)

    def _turn_covariance(self, covariance: tuple[float, ...]) -> tuple[float, ...]:
        """Return a covariance in the published frame, row by row, shape (9,)."""
        if not self._is_turned:
            return covariance
        turned = self._rotation @ np.reshape(covariance, (3, 3)) @ self._rotation.T
        return tuple(turned.ravel().tolist())

    def _update(self, now: Now, state: Imu) -> Imu:
        del state
        values = self._read(now.context)
        orientation, velocity, acceleration = values[:4], values[4:7], values[7:]
        if self._is_turned:
            orientation = multiply(orientation, self._inverse)
            velocity = self._rotation @ velocity
            acceleration = self._rotation @ acceleration
        return Imu(
            Header.from_nanoseconds(now.time_ns, self._frame_id),
            Quaternion(*orientation.tolist()),
            self._orientation_covariance,
            Vector3(*velocity.tolist()),
            self._velocity_covariance,
            Vector3(*acceleration.tolist()),
            self._acceleration_covariance,
        )

    def _export(self, state: Imu) -> Array:
        q, w, a = state.orientation, state.angular_velocity, state.linear_acceleration
        return np.array([q.x, q.y, q.z, q.w, w.x, w.y, w.z, a.x, a.y, a.z])


def multiply(left: Array, right: DrakeQuaternion) -> Array:
    """Return the product of two quaternions as x, y, z, w, shape (4,).

    Args:
        left: The first one as x, y, z, w, shape (4,); it needn't be of length 1, as
            Drake's must.
        right: The second one.
    """
    v, w = left[:3], left[3]
    u, s = right.xyz(), right.w()
    return np.append(w * u + s * v + np.cross(v, u), w * s - v @ u)
