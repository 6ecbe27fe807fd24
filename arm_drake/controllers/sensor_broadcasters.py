"""Broadcasters of sensors: each publishes what it has read in a tick as a message.

Sources: ros2_controllers (version 6.9.0), `imu_sensor_broadcaster`,
`range_sensor_broadcaster`, `pose_broadcaster`, `gps_sensor_broadcaster`,
`magnetometer_broadcaster` and `state_interfaces_broadcaster`; of branch ``master``,
`vda5050_safety_state_broadcaster`.
"""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion as DrakeQuaternion
from pydrake.math import RollPitchYaw

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import SteadyTicks, UpdateResult
from arm_drake.controllers.topics import SensorBroadcaster, SteadyBroadcast
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_length,
    check_not_empty,
)
from arm_drake.errors import ParameterError
from arm_drake.importing import dataclass
from arm_drake.interfaces import ACCELERATIONS, ORIENTATIONS, POSITIONS, RATES
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


@dataclass(frozen=True)
class SensorParameters:
    """Parameters that broadcasters of one sensor have."""

    # Sensor to read.
    sensor_name: str

    # Frame of the message's header.
    frame_id: str

    def __post_init__(self) -> None:
        check_not_empty(self, "sensor_name", "frame_id")


@dataclass(frozen=True)
class RotationOffset:
    """Rotation from the sensor's frame to the published one [rad]."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0


@dataclass(frozen=True)
class IMUSensorBroadcasterParameters(SensorParameters):
    """Parameters of an IMUSensorBroadcaster."""

    # Covariances, 3 x 3 by rows.
    static_covariance_orientation: tuple[float, ...] = (0.0,) * 9
    static_covariance_angular_velocity: tuple[float, ...] = (0.0,) * 9
    static_covariance_linear_acceleration: tuple[float, ...] = (0.0,) * 9

    rotation_offset: Annotated[RotationOffset, Rule(since="kilted")] = RotationOffset()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_length(
            self,
            9,
            "static_covariance_orientation",
            "static_covariance_angular_velocity",
            "static_covariance_linear_acceleration",
        )


class IMUSensorBroadcaster(SensorBroadcaster[Imu]):
    """Publishes what an inertial measurement unit measures.

    The state is what was published last. With r the rotation of the parameter
    ``rotation_offset`` (yaw, then pitch, then roll, about the axes as they turn),
    R its matrix, and q, w, a what is measured::

        orientation = q r^-1,  angular_velocity = R w,  linear_acceleration = R a

    Covariances C of velocity and acceleration become R C R^T; that of the orientation
    is of the fixed frame and stays.
    """

    message = Imu
    names = (*ORIENTATIONS, *RATES, *ACCELERATIONS)
    reads = (
        "``orientation.{x,y,z,w}``, ``angular_velocity.{x,y,z}`` [rad/s] and "
        "``linear_acceleration.{x,y,z}`` [m/s^2] of ``<sensor_name>``"
    )
    exports = (
        "(10,): what the last tick published, in this order, as "
        "``<name>/<sensor_name>/orientation.x`` and so on; not in humble"
    )
    topics: ClassVar = {"imu": "Imu of the last tick"}

    def __init__(
        self,
        parameters: IMUSensorBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        super().__init__(parameters, params)
        offset = parameters.rotation_offset
        turn = RollPitchYaw(offset.roll, offset.pitch, offset.yaw)
        # A rotation of nothing would spread NaN from one axis to the others.
        self._is_turned = offset != RotationOffset()
        self._rotation: Array = turn.ToRotationMatrix().matrix()
        self._inverse = turn.ToQuaternion().inverse()
        self._velocity_covariance = self._turn_covariance(
            parameters.static_covariance_angular_velocity
        )
        self._acceleration_covariance = self._turn_covariance(
            parameters.static_covariance_linear_acceleration
        )

    def _turn_covariance(self, covariance: tuple[float, ...]) -> tuple[float, ...]:
        """Return a covariance in the published frame, row by row, shape (9,)."""
        if not self._is_turned:
            return covariance
        turned = self._rotation @ np.reshape(covariance, (3, 3)) @ self._rotation.T
        return tuple(turned.ravel().tolist())

    def _make(self, header: Header, values: Array, last: Imu) -> Imu:
        orientation, velocity, acceleration = values[:4], values[4:7], values[7:]
        if self._is_turned:
            orientation = multiply(orientation, self._inverse)
            velocity = self._rotation @ velocity
            acceleration = self._rotation @ acceleration
        return Imu(
            header,
            Quaternion(*orientation.tolist()),
            self._parameters.static_covariance_orientation,
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

    `left` shape (4,).
    """
    v, w = left[:3], left[3]
    u, s = right.xyz(), right.w()
    return np.append(w * u + s * v + np.cross(v, u), w * s - v @ u)


@dataclass(frozen=True)
class RangeSensorBroadcasterParameters(SensorParameters):
    """Parameters of a RangeSensorBroadcaster."""

    # 0 is ultrasound, 1 is infrared.
    radiation_type: int = 0

    # Width of the beam [rad].
    field_of_view: float = 0.52

    # Smallest and largest distance [m].
    min_range: float = 0.52
    max_range: float = 4.0

    # Variance of the distance [m^2].
    variance: float = 0.0


class RangeSensorBroadcaster(SensorBroadcaster[Range]):
    """Publishes a distance.

    The state is what was published last. The distance is published as it is, also
    beyond ``min_range`` and ``max_range``.
    """

    message = Range
    names = ("range",)
    reads = "``<sensor_name>/range`` [m]"
    topics: ClassVar = {"range": "Range of the last tick"}

    def _make(self, header: Header, values: Array, last: Range) -> Range:
        known: RangeSensorBroadcasterParameters = self._parameters
        return Range(
            header,
            known.radiation_type,
            known.field_of_view,
            known.min_range,
            known.max_range,
            float(values[0]),
            known.variance,
        )


# How far the squared norm of an orientation on /tf may be off 1.
_NORM_TOLERANCE = 10e-3


@dataclass(frozen=True)
class PoseTf:
    """Parameters of the transform on /tf."""

    enable: bool = True

    # Frame that has the pose; "" is pose_name.
    child_frame_id: str = ""


@dataclass(frozen=True)
class PoseBroadcasterParameters:
    """Parameters of a PoseBroadcaster."""

    # Frame of the message's header.
    frame_id: str

    # Sensor to read.
    pose_name: str

    tf: PoseTf = PoseTf()

    def __post_init__(self) -> None:
        check_not_empty(self, "frame_id", "pose_name")


class PoseBroadcasterState(NamedTuple):
    """Messages that a PoseBroadcaster published last."""

    pose: PoseStamped = PoseStamped()
    tf: TFMessage = TFMessage()


class PoseBroadcaster(SensorBroadcaster[PoseBroadcasterState]):
    """Publishes a pose, also as a transform.

    The state is a PoseBroadcasterState. A pose is valid if all its numbers are finite
    and the squared norm of the orientation is within 0.01 of 1.
    """

    message = PoseBroadcasterState
    names = (*POSITIONS, *ORIENTATIONS)
    sensor = "pose_name"
    reads = (
        "``<pose_name>/position.{x,y,z}`` [m] and ``<pose_name>/orientation.{x,y,z,w}``"
    )
    topics: ClassVar = {
        "pose": "PoseStamped of the last tick",
        "tf": (
            "TFMessage of the last tick with a valid pose; there only with "
            "``tf.enable``"
        ),
    }

    def __init__(
        self,
        parameters: PoseBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        tf = parameters.tf
        super().__init__(parameters, params, without=() if tf.enable else ("tf",))
        self._child_frame_id = tf.child_frame_id or parameters.pose_name

    def _make(
        self, header: Header, values: Array, last: PoseBroadcasterState
    ) -> PoseBroadcasterState:
        numbers = values.tolist()
        orientation = Quaternion(*numbers[3:])
        pose = PoseStamped(header, Pose(Point(*numbers[:3]), orientation))
        if not (self._parameters.tf.enable and is_valid(numbers)):
            return last._replace(pose=pose)
        transform = Transform(Vector3(*numbers[:3]), orientation)
        tf = TransformStamped(header, self._child_frame_id, transform)
        return PoseBroadcasterState(pose, TFMessage((tf,)))

    def steady(
        self, last: UpdateResult[PoseBroadcasterState], time_ns: int
    ) -> SteadyTicks[PoseBroadcasterState] | None:
        """Return what makes a message while poses are valid, or don't go to /tf."""
        if not self._parameters.tf.enable:
            return super().steady(last, time_ns)
        return _SteadyPose(self, last.state)


class _SteadyPose(SteadyBroadcast[PoseBroadcasterState]):
    """Steady ticks with poses that go to /tf."""

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> Sequence[float] | None:
        """Return no values; None where what went to /tf before stays."""
        return () if is_valid(self._values(motions).tolist()) else None

    def commands_ahead(self, times_ns: Sequence[int]) -> None:
        """Return None, for the pose counts."""
        return None


def is_valid(pose: Sequence[float]) -> bool:
    """Return whether a pose may go to /tf; `pose` shape (7,)."""
    squares = sum(value * value for value in pose[3:])
    return all(map(math.isfinite, pose)) and abs(squares - 1.0) <= _NORM_TOLERANCE


_PLACE = ("latitude", "longitude", "altitude")

# Types of a covariance in NavSatFix.
_DIAGONAL_KNOWN = 2
_KNOWN = 3

# NavSatStatus of a sensor that tells none.
_UNKNOWN = NavSatStatus()


@dataclass(frozen=True)
class GPSSensorBroadcasterParameters(SensorParameters):
    """Parameters of a GPSSensorBroadcaster."""

    # Covariance of the position [m^2], 3 x 3 by rows.
    static_position_covariance: tuple[float, ...] = (0.0,) * 9

    # Whether the sensor tells the covariance.
    read_covariance_from_interface: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_length(self, 9, "static_position_covariance")


class GPSSensorBroadcaster(SensorBroadcaster[NavSatFix]):
    """Publishes a place on earth.

    The state is what was published last. Covariances that are read are the diagonal of
    the message's matrix, in the order of their interfaces, as upstream has it.
    """

    message = NavSatFix
    reads = (
        "``status``, ``service``, ``latitude``, ``longitude`` and ``altitude`` of "
        "``<sensor_name>``, with ``read_covariance_from_interface`` also "
        "``latitude_covariance`` and so on"
    )
    topics: ClassVar = {"gps/fix": "NavSatFix of the last tick"}

    def __init__(
        self,
        parameters: GPSSensorBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        names = ["status", "service", *_PLACE]
        if parameters.read_covariance_from_interface:
            names += [f"{name}_covariance" for name in _PLACE]
        sensor = parameters.sensor_name
        super().__init__(
            parameters,
            params,
            state_interfaces=tuple(f"{sensor}/{name}" for name in names),
        )

    def _make(self, header: Header, values: Array, last: NavSatFix) -> NavSatFix:
        status, service, latitude, longitude, altitude, *diagonal = values.tolist()
        covariance, kind = self._parameters.static_position_covariance, _KNOWN
        if diagonal:
            x, y, z = diagonal
            covariance = (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z)
            kind = _DIAGONAL_KNOWN
        return NavSatFix(
            header,
            NavSatStatus(
                to_code(status, _UNKNOWN.status), to_code(service, _UNKNOWN.service)
            ),
            latitude,
            longitude,
            altitude,
            covariance,
            kind,
        )


@dataclass(frozen=True)
class MagnetometerBroadcasterParameters(SensorParameters):
    """Parameters of a MagnetometerBroadcaster."""

    # Covariance [T^2], 3 x 3 by rows.
    static_covariance: tuple[float, ...] = (0.0,) * 9

    def __post_init__(self) -> None:
        super().__post_init__()
        check_length(self, 9, "static_covariance")


class MagnetometerBroadcaster(SensorBroadcaster[MagneticField]):
    """Publishes a magnetic field.

    The state is what was published last.
    """

    message = MagneticField
    names = tuple(f"magnetic_field.{axis}" for axis in "xyz")
    reads = "``<sensor_name>/magnetic_field.{x,y,z}`` [T]"
    topics: ClassVar = {"magnetic_field": "MagneticField of the last tick"}

    def _make(
        self, header: Header, values: Array, last: MagneticField
    ) -> MagneticField:
        field = Vector3(*values.tolist())
        return MagneticField(header, field, self._parameters.static_covariance)


@dataclass(frozen=True)
class StateInterfacesBroadcasterParameters:
    """Parameters of a StateInterfacesBroadcaster."""

    # Full names of the interfaces to publish, in order; at least one.
    interfaces: tuple[str, ...]

    def __post_init__(self) -> None:
        check_not_empty(self, "interfaces")


class NamedValues(NamedTuple):
    """Messages of a StateInterfacesBroadcaster."""

    names: Keys
    values: Float64Values


class StateInterfacesBroadcaster(SensorBroadcaster[NamedValues]):
    """Publishes the values of any state interfaces.

    The state is what was published last.
    """

    reads = "what the parameter ``interfaces`` lists"
    topics: ClassVar = {
        "names": "Keys: these names, always the same",
        "values": (
            "Float64Values of the last tick, in their order; NaN before the first one"
        ),
    }

    def __init__(
        self,
        parameters: StateInterfacesBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        names = parameters.interfaces
        others = [name for name in names if name in params.other_types]
        if others:
            raise ParameterError(
                "interfaces: expected state interfaces of type double; "
                f"{', '.join(map(repr, others))} aren't"
            )
        nothing = Float64Values(values=(math.nan,) * len(names))
        initial = NamedValues(Keys(keys=names), nothing)
        super().__init__(parameters, params, initial, state_interfaces=names)

    def _make(self, header: Header, values: Array, last: NamedValues) -> NamedValues:
        return NamedValues(last.names, Float64Values(header, tuple(values.tolist())))


# Names of before, by those of now.
_OLDER = {
    "field_violation": ("fieldViolation_interfaces", "interfaces.fieldViolation"),
    "e_stop.manual": ("eStop_manual_interfaces", "interfaces.eStop.manual"),
    "e_stop.remote": ("eStop_remote_interfaces", "interfaces.eStop.remote"),
    "e_stop.autoack": ("eStop_autoack_interfaces", "interfaces.eStop.autoack"),
}


@dataclass(frozen=True)
class EStopInterfaces:
    """Full names of interfaces of emergency stops, by how they end."""

    manual: tuple[str, ...] = ()
    remote: tuple[str, ...] = ()
    autoack: tuple[str, ...] = ()


@dataclass(frozen=True)
class SafetyInterfaces:
    """Full names of the interfaces to read."""

    # Those that tell that something is in a safety field.
    field_violation: tuple[str, ...] = ()

    e_stop: EStopInterfaces = EStopInterfaces()


@dataclass(frozen=True)
class Vda5050SafetyStateBroadcasterParameters:
    """Parameters of a Vda5050SafetyStateBroadcaster."""

    interfaces: SafetyInterfaces = SafetyInterfaces()

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take the names of before."""
        for name, older in _OLDER.items():
            for old in older:
                params.rename(old, f"interfaces.{name}")

    def __post_init__(self) -> None:
        if self.interfaces == SafetyInterfaces():
            raise ValueError("interfaces must name at least one, got none")


class Vda5050SafetyStateBroadcaster(SensorBroadcaster[VDA5050SafetyState]):
    """Publishes whether a safety field is violated, and which emergency stop holds.

    The state is what was published last. An interface tells something unless it is 0 or
    NaN. Of several emergency stops a manual one comes first, then a remote one.
    """

    message = VDA5050SafetyState
    reads = "what the parameter ``interfaces`` lists"
    topics: ClassVar = {"vda5050_safety_state": "VDA5050SafetyState of the last tick"}

    def __init__(
        self,
        parameters: Vda5050SafetyStateBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        names, stops = parameters.interfaces, parameters.interfaces.e_stop
        groups = (names.field_violation, stops.manual, stops.remote, stops.autoack)
        read: tuple[str, ...] = sum(groups, ())
        super().__init__(parameters, params, state_interfaces=read)
        # Of each interface: what it tells.
        kinds = ("", "manual", "remote", "autoAck")
        self._kinds = [k for k, g in zip(kinds, groups, strict=True) for _ in g]

    def _make(
        self, header: Header, values: Array, last: VDA5050SafetyState
    ) -> VDA5050SafetyState:
        stop_kinds = [
            kind
            for kind, value in zip(self._kinds, values.tolist(), strict=True)
            if value and not math.isnan(value)
        ]
        stops = [kind for kind in stop_kinds if kind]
        return VDA5050SafetyState(stops[0] if stops else "none", "" in stop_kinds)
