"""``imu_sensor_broadcaster/IMUSensorBroadcaster``.

Source: ros2_controllers, `imu_sensor_broadcaster` (version 6.9.0).

``range_sensor_broadcaster/RangeSensorBroadcaster``.

Source: ros2_controllers, `range_sensor_broadcaster` (version 6.9.0).

``pose_broadcaster/PoseBroadcaster``.

Source: ros2_controllers, `pose_broadcaster` (version 6.9.0).

``gps_sensor_broadcaster/GPSSensorBroadcaster``.

Source: ros2_controllers, `gps_sensor_broadcaster` (version 6.9.0).

``magnetometer_broadcaster/MagnetometerBroadcaster``.

Source: ros2_controllers, `magnetometer_broadcaster` (version 6.9.0).

``state_interfaces_broadcaster/StateInterfacesBroadcaster``.

Source: ros2_controllers, `state_interfaces_broadcaster` (version 6.9.0).

``vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster``.

Source: ros2_controllers, `vda5050_safety_state_broadcaster` (branch ``master``).
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion as DrakeQuaternion
from pydrake.math import RollPitchYaw

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import Now
from arm_drake.description.parameters import Given, Rule, check_length, check_not_empty
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    Header,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
)
from arm_drake.messages.sensors import (
    Float64Values,
    Imu,
    Keys,
    MagneticField,
    NavSatFix,
    NavSatStatus,
    Range,
    VDA5050SafetyState,
    to_code,
)

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


# How far the squared norm of an orientation on /tf may be off 1.
_NORM_TOLERANCE = 10e-3


@dc.dataclass(frozen=True)
class PoseTf:
    """What goes to /tf."""

    enable: bool = True

    # Frame that has the pose; "" is pose_name.
    child_frame_id: str = ""


@dc.dataclass(frozen=True)
class PoseBroadcasterParameters:
    """Parameters of a PoseBroadcaster."""

    # Frame of the message's header.
    frame_id: str

    # Sensor to read.
    pose_name: str

    tf: PoseTf = PoseTf()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "frame_id", "pose_name")


class PoseBroadcasterState(NamedTuple):
    """What a PoseBroadcaster published last."""

    pose: PoseStamped = PoseStamped()
    tf: TFMessage = TFMessage()


class PoseBroadcaster(TickingController[PoseBroadcasterState]):
    """Publishes a pose, also as a transform.

    .. pydrake_system::

        name: PoseBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - pose
        - tf

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads
                                    ``<pose_name>/position.{x,y,z}`` [m] and
                                    ``<pose_name>/orientation.{x,y,z,w}``
    command_interfaces  --    --    Tick; it commands nothing
    pose                --    --    PoseStamped of the last tick
    tf                  --    --    TFMessage of the last tick with a valid pose; there
                                    only with ``tf.enable``
    ==================  ====  ====  ==================================================

    The state is a PoseBroadcasterState. A pose is valid if all its numbers are finite
    and the squared norm of the orientation is within 0.01 of 1.
    """

    def __init__(
        self,
        parameters: PoseBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        name, tf = parameters.pose_name, parameters.tf
        super().__init__(
            params,
            PoseBroadcasterState(),
            state_interfaces=(
                *(f"{name}/position.{axis}" for axis in "xyz"),
                *(f"{name}/orientation.{axis}" for axis in "xyzw"),
            ),
        )
        self._frame_id = parameters.frame_id
        self._child_frame_id = tf.child_frame_id or name
        self._has_tf = tf.enable
        self._declare_topic("pose", lambda state: state.pose)
        if self._has_tf:
            self._declare_topic("tf", lambda state: state.tf)

    def _update(self, now: Now, state: PoseBroadcasterState) -> PoseBroadcasterState:
        values = self._read(now.context).tolist()
        header = Header.from_nanoseconds(now.time_ns, self._frame_id)
        orientation = Quaternion(*values[3:])
        pose = PoseStamped(header, Pose(Point(*values[:3]), orientation))
        if not (self._has_tf and is_valid(values)):
            return state._replace(pose=pose)
        transform = Transform(Vector3(*values[:3]), orientation)
        tf = TransformStamped(header, self._child_frame_id, transform)
        return PoseBroadcasterState(pose, TFMessage((tf,)))


def is_valid(pose: Sequence[float]) -> bool:
    """Return whether a pose may go to /tf.

    Args:
        pose: Position x, y, z and orientation x, y, z, w, shape (7,).
    """
    squares = sum(value * value for value in pose[3:])
    return all(map(math.isfinite, pose)) and abs(squares - 1.0) <= _NORM_TOLERANCE


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


@dc.dataclass(frozen=True)
class StateInterfacesBroadcasterParameters:
    """Parameters of a StateInterfacesBroadcaster."""

    # Full names of the interfaces to publish, in order; at least one.
    interfaces: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "interfaces")


class StateInterfacesBroadcaster(TickingController[Float64Values]):
    """Publishes the values of any state interfaces.

    .. pydrake_system::

        name: StateInterfacesBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - names
        - values

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads what the
                                    parameter ``interfaces`` lists
    command_interfaces  --    --    Tick; it commands nothing
    names               --    --    Keys: these names, always the same
    values              --    --    Float64Values of the last tick, in their order;
                                    NaN before the first one
    ==================  ====  ====  ==================================================

    The state is what was published last.
    """

    def __init__(
        self,
        parameters: StateInterfacesBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.

        Raises:
            ParameterError: If an interface holds anything but a double; upstream isn't
                activated then.
        """
        names = parameters.interfaces
        others = [name for name in names if name in params.other_types]
        if others:
            raise ParameterError(
                "interfaces: expected state interfaces of type double; "
                f"{', '.join(map(repr, others))} aren't"
            )
        nothing = Float64Values(values=(math.nan,) * len(names))
        super().__init__(params, nothing, state_interfaces=names)
        keys = Keys(keys=names)
        self._declare_topic("names", lambda _: keys)
        self._declare_topic("values", lambda message: message)

    def _update(self, now: Now, state: Float64Values) -> Float64Values:
        del state
        values = tuple(self._read(now.context).tolist())
        return Float64Values(Header.from_nanoseconds(now.time_ns), values)


# Names of before, by those of now.
_OLDER = {
    "field_violation": ("fieldViolation_interfaces", "interfaces.fieldViolation"),
    "e_stop.manual": ("eStop_manual_interfaces", "interfaces.eStop.manual"),
    "e_stop.remote": ("eStop_remote_interfaces", "interfaces.eStop.remote"),
    "e_stop.autoack": ("eStop_autoack_interfaces", "interfaces.eStop.autoack"),
}


@dc.dataclass(frozen=True)
class EStopInterfaces:
    """Full names of interfaces that tell emergency stops, by how they end."""

    manual: tuple[str, ...] = ()
    remote: tuple[str, ...] = ()
    autoack: tuple[str, ...] = ()


@dc.dataclass(frozen=True)
class SafetyInterfaces:
    """Full names of the interfaces to read."""

    # Those that tell that something is in a safety field.
    field_violation: tuple[str, ...] = ()

    e_stop: EStopInterfaces = EStopInterfaces()


@dc.dataclass(frozen=True)
class Vda5050SafetyStateBroadcasterParameters:
    """Parameters of a Vda5050SafetyStateBroadcaster."""

    interfaces: SafetyInterfaces = SafetyInterfaces()

    @staticmethod
    def adapt(given: Given) -> None:
        """Take the names of before."""
        for name, older in _OLDER.items():
            for old in older:
                given.rename(old, f"interfaces.{name}")

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        if self.interfaces == SafetyInterfaces():
            raise ValueError("interfaces must name at least one, got none")


class Vda5050SafetyStateBroadcaster(TickingController[VDA5050SafetyState]):
    """Publishes whether a safety field is violated, and which emergency stop holds.

    .. pydrake_system::

        name: Vda5050SafetyStateBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - vda5050_safety_state

    ====================  ====  ====  ================================================
    port                  size  unit  meaning
    ====================  ====  ====  ================================================
    controller_manager    --    --    Cycle: when to tick
    state_interfaces      m     --    everything that is measured; it reads what the
                                      parameter ``interfaces`` lists
    command_interfaces    --    --    Tick; it commands nothing
    vda5050_safety_state  --    --    VDA5050SafetyState of the last tick
    ====================  ====  ====  ================================================

    The state is what was published last. An interface tells something unless it is 0 or
    NaN. Of several emergency stops a manual one comes first, then a remote one.
    """

    def __init__(
        self,
        parameters: Vda5050SafetyStateBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        names, stops = parameters.interfaces, parameters.interfaces.e_stop
        groups = (names.field_violation, stops.manual, stops.remote, stops.autoack)
        super().__init__(
            params, VDA5050SafetyState(), state_interfaces=tuple(sum(groups, ()))
        )
        # Of each interface: what it tells.
        kinds = ("", "manual", "remote", "autoAck")
        self._kinds = [k for k, g in zip(kinds, groups, strict=True) for _ in g]
        self._declare_topic("vda5050_safety_state", lambda message: message)

    def _update(self, now: Now, state: VDA5050SafetyState) -> VDA5050SafetyState:
        del state
        values = self._read(now.context).tolist()
        told = [
            kind
            for kind, value in zip(self._kinds, values, strict=True)
            if value and not math.isnan(value)
        ]
        stops = [kind for kind in told if kind]
        return VDA5050SafetyState(stops[0] if stops else "none", "" in told)
