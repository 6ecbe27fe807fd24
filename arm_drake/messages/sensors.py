"""Sensor messages (`sensor_msgs`), and values of named interfaces.

Numbers that are of single precision in ROS keep the digits that they have here.
"""

import dataclasses as dc
import math
from typing import Final

from arm_drake.importing import dataclass
from arm_drake.messages.base import Header, Message
from arm_drake.messages.geometry import Point32, Quaternion, Vector3, Wrench

# What `arm_drake.messages` has of it.
__all__ = [
    "BatteryState",
    "BatteryStateArray",
    "CameraInfo",
    "ChannelFloat32",
    "CompressedImage",
    "Float64Values",
    "Image",
    "Imu",
    "Keys",
    "LaserScan",
    "MagneticField",
    "NavSatFix",
    "NavSatStatus",
    "PointCloud",
    "PointCloud2",
    "PointField",
    "Range",
    "RegionOfInterest",
]

_NO_COVARIANCE: Final = (0.0,) * 9
_ZERO: Final = Vector3()
_UPRIGHT: Final = Quaternion()


@dataclass(frozen=True)
class Imu(Message, ros="sensor_msgs"):
    """Measurement of an inertial measurement unit (`sensor_msgs`)."""

    header: Header = Header()

    # Of the header's frame in a fixed one.
    orientation: Quaternion = _UPRIGHT

    # [rad^2], row by row, shape (9,).
    orientation_covariance: tuple[float, ...] = _NO_COVARIANCE

    # [rad/s], in the header's frame.
    angular_velocity: Vector3 = _ZERO

    # [rad^2/s^2], row by row, shape (9,).
    angular_velocity_covariance: tuple[float, ...] = _NO_COVARIANCE

    # [m/s^2], in the header's frame.
    linear_acceleration: Vector3 = _ZERO

    # [m^2/s^4], row by row, shape (9,).
    linear_acceleration_covariance: tuple[float, ...] = _NO_COVARIANCE


@dataclass(frozen=True)
class Range(Message, ros="sensor_msgs"):
    """A distance (`sensor_msgs`)."""

    header: Header = Header()

    # 0 is ultrasound, 1 is infrared.
    radiation_type: int = 0

    # Width of the beam [rad].
    field_of_view: float = 0.0

    # Smallest and largest distance that the sensor can tell [m].
    min_range: float = 0.0
    max_range: float = 0.0

    # The distance [m]; it may be beyond these.
    range: float = 0.0

    # [m^2]; 0 is unknown.
    variance: float = 0.0


@dataclass(frozen=True)
class NavSatStatus(Message, ros="sensor_msgs"):
    """Quality of a satellite fix (`sensor_msgs`)."""

    # -2 is unknown, -1 no fix, 0 a fix, 1 one with satellite-based and 2 one with
    # ground-based augmentation.
    status: int = -2

    # Sum of 1 GPS, 2 GLONASS, 4 COMPASS and 8 GALILEO; 0 is unknown.
    service: int = 0


@dataclass(frozen=True)
class NavSatFix(Message, ros="sensor_msgs"):
    """A place on earth (`sensor_msgs`)."""

    header: Header = Header()
    status: NavSatStatus = NavSatStatus()

    # [degrees], positive north and east.
    latitude: float = 0.0
    longitude: float = 0.0

    # Above the WGS 84 ellipsoid [m].
    altitude: float = 0.0

    # [m^2] of east, north and up, row by row, shape (9,).
    position_covariance: tuple[float, ...] = _NO_COVARIANCE

    # 0 is unknown, 1 an approximation, 2 a known diagonal, 3 known.
    position_covariance_type: int = 0


@dataclass(frozen=True)
class MagneticField(Message, ros="sensor_msgs"):
    """A magnetic field (`sensor_msgs`)."""

    header: Header = Header()

    # [T], in the header's frame.
    magnetic_field: Vector3 = _ZERO

    # [T^2], row by row, shape (9,).
    magnetic_field_covariance: tuple[float, ...] = _NO_COVARIANCE


@dataclass(frozen=True)
class BatteryState(Message, ros="sensor_msgs"):
    """State of a battery, or of several in one (`sensor_msgs`); NaN is unknown."""

    header: Header = Header()

    # [V].
    voltage: float = 0.0

    # [degrees Celsius].
    temperature: float = 0.0

    # [A], negative when it is discharged.
    current: float = 0.0

    # What is left, what it can hold, and what it could when new [A·h].
    charge: float = 0.0
    capacity: float = 0.0
    design_capacity: float = 0.0

    # What is left, as the sensor tells it; [percent] if it is told by the voltage.
    percentage: float = 0.0

    # POWER_SUPPLY_STATUS, _HEALTH and _TECHNOLOGY of the message; 0 is unknown.
    power_supply_status: int = 0
    power_supply_health: int = 0
    power_supply_technology: int = 0

    present: bool = False

    # [V] and [degrees Celsius] of each cell; () is unknown.
    cell_voltage: tuple[float, ...] = ()
    cell_temperature: tuple[float, ...] = ()

    # Where it is, and its number.
    location: str = ""
    serial_number: str = ""


@dataclass(frozen=True)
class BatteryStateArray(Message, ros="control_msgs"):
    """States of batteries (`control_msgs`)."""

    battery_states: tuple[BatteryState, ...] = ()


@dataclass(frozen=True)
class Keys(Message, ros="control_msgs"):
    """Names of values (`control_msgs`)."""

    header: Header = Header()
    keys: tuple[str, ...] = ()


@dataclass(frozen=True)
class Float64Values(Message, ros="control_msgs"):
    """Values, in the order of their Keys (`control_msgs`)."""

    header: Header = Header()
    values: tuple[float, ...] = ()


def to_code(value: float, unknown: int) -> int:
    """Return the integer of a message that a state interface holds as a number.

    Its fraction is cut off, as C++ does; `unknown` stands for one that isn't finite.
    """
    return int(value) if math.isfinite(value) else unknown


@dataclass(frozen=True)
class VDA5050SafetyState(Message, ros="control_msgs"):
    """Safety state of the standard VDA 5050 (`control_msgs`)."""

    # "none", "manual", "remote" or "autoAck": how an emergency stop has to be ended.
    e_stop: str = "none"

    # Whether something is in a safety field.
    field_violation: bool = False


_NOTHING: Final = Wrench()


@dataclass(frozen=True)
class ContactState(Message, ros="gazebo_msgs"):
    """Contact of two shapes, and the forces on the first one."""

    # In words.
    info: str = ""

    # "<robot>::<link>::<shape>" of both.
    collision1_name: str = ""
    collision2_name: str = ""

    # On the first shape at each point, about that point, and their sum about the first
    # shape's link [N], [N·m].
    wrenches: tuple[Wrench, ...] = ()
    total_wrench: Wrench = _NOTHING

    # The points [m]; the direction in which the first shape is pressed; how deep the
    # shapes are in each other [m].
    contact_positions: tuple[Vector3, ...] = ()
    contact_normals: tuple[Vector3, ...] = ()
    depths: tuple[float, ...] = ()


@dataclass(frozen=True)
class ContactsState(Message, ros="gazebo_msgs"):
    """All contacts of a sensor; none while nothing touches."""

    header: Header = Header()
    states: tuple[ContactState, ...] = ()


@dataclass(frozen=True)
class RegionOfInterest(Message):
    """Part of a picture (`sensor_msgs`); of size 0 it is the whole picture."""

    # [pixels].
    x_offset: int = 0
    y_offset: int = 0
    height: int = 0
    width: int = 0

    do_rectify: bool = False


@dataclass(frozen=True)
class Image(Message, ros="sensor_msgs"):
    """A picture (`sensor_msgs`); `arm_drake.perception.images` makes it an array."""

    header: Header = Header()

    # [pixels].
    height: int = 0
    width: int = 0

    # Such as "rgb8", "mono8", "32FC1" [m], "16UC1" [mm].
    encoding: str = "rgb8"

    is_bigendian: int = 0

    # Length of a row [bytes].
    step: int = 0

    # Row by row, from the top left, shape (height * step,).
    data: bytes = dc.field(default=b"", repr=False)


@dataclass(frozen=True)
class CompressedImage(Message, ros="sensor_msgs"):
    """A picture as a file (`sensor_msgs`)."""

    header: Header = Header()

    # As image_transport has it, such as "rgb8; jpeg compressed bgr8".
    format: str = ""

    # A JPEG or PNG file.
    data: bytes = dc.field(default=b"", repr=False)


@dataclass(frozen=True)
class CameraInfo(Message, ros="sensor_msgs"):
    """Projection of a camera (`sensor_msgs`), in its optical frame: z ahead, y down."""

    header: Header = Header()

    # [pixels].
    height: int = 0
    width: int = 0

    distortion_model: str = "plumb_bob"

    # Distortion k1, k2, t1, t2, k3.
    d: tuple[float, ...] = ()

    # Camera matrix [pixels], row by row, shape (9,). A pixel's centre has whole numbers
    # as coordinates, the first one 0.
    k: tuple[float, ...] = _NO_COVARIANCE

    # Rectification, row by row, shape (9,).
    r: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

    # Projection [pixels], row by row, shape (12,).
    p: tuple[float, ...] = (0.0,) * 12

    binning_x: int = 0
    binning_y: int = 0
    roi: RegionOfInterest = RegionOfInterest()


@dataclass(frozen=True)
class PointField(Message):
    """One number of a point of a PointCloud2 (`sensor_msgs`)."""

    name: str = ""

    # From the start of the point [bytes].
    offset: int = 0

    # 1 int8, 2 uint8, 3 int16, 4 uint16, 5 int32, 6 uint32, 7 float32, 8 float64.
    datatype: int = 7

    count: int = 1


@dataclass(frozen=True)
class PointCloud2(Message, ros="sensor_msgs"):
    """Points in the header's frame (`sensor_msgs`)."""

    header: Header = Header()

    # Of a cloud without an order the height is 1.
    height: int = 0
    width: int = 0

    fields: tuple[PointField, ...] = ()
    is_bigendian: bool = False

    # [bytes].
    point_step: int = 0
    row_step: int = 0
    data: bytes = dc.field(default=b"", repr=False)

    # Whether all points are finite.
    is_dense: bool = True


@dataclass(frozen=True)
class ChannelFloat32(Message, ros="sensor_msgs"):
    """A number of each point of a PointCloud (`sensor_msgs`)."""

    name: str = ""
    values: tuple[float, ...] = dc.field(default=(), repr=False)


@dataclass(frozen=True)
class PointCloud(Message, ros="sensor_msgs"):
    """Points in the header's frame, one by one (`sensor_msgs`)."""

    header: Header = Header()
    points: tuple[Point32, ...] = dc.field(default=(), repr=False)
    channels: tuple[ChannelFloat32, ...] = ()


@dataclass(frozen=True)
class LaserScan(Message, ros="sensor_msgs"):
    """Distances in a plane, counterclockwise about z (`sensor_msgs`)."""

    header: Header = Header()

    # Of the first and the last ray, and between two of them [rad].
    angle_min: float = 0.0
    angle_max: float = 0.0
    angle_increment: float = 0.0

    # Between two rays, and between two scans [s].
    time_increment: float = 0.0
    scan_time: float = 0.0

    # What the sensor can tell [m]; nearer is -inf, farther +inf.
    range_min: float = 0.0
    range_max: float = 0.0

    # [m], shape (n,).
    ranges: tuple[float, ...] = dc.field(default=(), repr=False)

    # Empty if it tells none.
    intensities: tuple[float, ...] = dc.field(default=(), repr=False)
