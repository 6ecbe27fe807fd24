"""Velocities, poses and forces in space (`geometry_msgs`), and where a base is.

What a user sends, twists and wrenches, may be given as mappings of their fields.
"""

import math

from arm_drake.arrays import Array
from arm_drake.importing import dataclass
from arm_drake.messages.base import Header, Message, take_numbers, to_message

# What `arm_drake.messages` has of it.
__all__ = [
    "Odometry",
    "Point",
    "Point32",
    "Pose",
    "PoseStamped",
    "PoseWithCovariance",
    "Quaternion",
    "SetOdometry",
    "TFMessage",
    "Transform",
    "TransformStamped",
    "Twist",
    "TwistStamped",
    "TwistWithCovariance",
    "Vector3",
    "Wrench",
    "WrenchStamped",
]


def _take_parts(message: Message, kinds: dict[str, type]) -> None:
    for field, kind in kinds.items():
        value = getattr(message, field)
        if type(value) is not kind:
            object.__setattr__(message, field, to_message(value, kind, field))


@dataclass(frozen=True)
class Vector3(Message, ros="geometry_msgs"):
    """A vector, in the unit of what it is a vector of."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        take_numbers(self, "x", "y", "z")


@dataclass(frozen=True)
class Point(Vector3, ros="geometry_msgs"):
    """A position [m]."""


@dataclass(frozen=True)
class Point32(Message, ros="geometry_msgs"):
    """A position [m], of single precision in ROS."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(frozen=True)
class Quaternion(Message, ros="geometry_msgs"):
    """An orientation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0

    @staticmethod
    def from_yaw(yaw: float) -> "Quaternion":
        """Return the rotation about z by an angle [rad]."""
        return Quaternion(0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))

    @staticmethod
    def from_wxyz(wxyz: Array) -> "Quaternion":
        """Return the quaternion of numbers in Drake's order, shape (4,)."""
        w, x, y, z = wxyz.tolist()
        return Quaternion(x, y, z, w)


@dataclass(frozen=True)
class Twist(Message, ros="geometry_msgs"):
    """A velocity, in the frame of what moves."""

    # [m/s].
    linear: Vector3 = Vector3()

    # [rad/s].
    angular: Vector3 = Vector3()

    def __post_init__(self) -> None:
        """Take mappings as they come."""
        _take_parts(self, {"linear": Vector3, "angular": Vector3})


@dataclass(frozen=True, eq=False)
class TwistStamped(Message, ros="geometry_msgs"):
    """A velocity as of a time; each message is one of its own."""

    # A stamp of 0 means "now".
    header: Header = Header()

    twist: Twist = Twist()

    def __post_init__(self) -> None:
        """Take mappings as they come."""
        _take_parts(self, {"header": Header, "twist": Twist})


@dataclass(frozen=True)
class Pose(Message, ros="geometry_msgs"):
    """A position and an orientation."""

    position: Point = Point()
    orientation: Quaternion = Quaternion()


@dataclass(frozen=True)
class PoseStamped(Message, ros="geometry_msgs"):
    """A pose as of a time, in the frame of the header."""

    header: Header = Header()
    pose: Pose = Pose()


@dataclass(frozen=True)
class Transform(Message, ros="geometry_msgs"):
    """Pose of a frame in another one."""

    # [m].
    translation: Vector3 = Vector3()

    rotation: Quaternion = Quaternion()


@dataclass(frozen=True)
class TransformStamped(Message, ros="geometry_msgs"):
    """Pose of a frame in the frame of the header, as of a time."""

    header: Header = Header()
    child_frame_id: str = ""
    transform: Transform = Transform()


@dataclass(frozen=True)
class TFMessage(Message, ros="tf2_msgs"):
    """Poses of frames (`tf2_msgs`)."""

    transforms: tuple[TransformStamped, ...] = ()


@dataclass(frozen=True)
class Wrench(Message, ros="geometry_msgs"):
    """A force and a torque."""

    # [N].
    force: Vector3 = Vector3()

    # [N·m].
    torque: Vector3 = Vector3()

    def __post_init__(self) -> None:
        """Take mappings as they come."""
        _take_parts(self, {"force": Vector3, "torque": Vector3})


@dataclass(frozen=True, eq=False)
class WrenchStamped(Message, ros="geometry_msgs"):
    """A wrench as of a time, in the frame of the header; each is one of its own."""

    header: Header = Header()
    wrench: Wrench = Wrench()

    def __post_init__(self) -> None:
        """Take mappings as they come."""
        _take_parts(self, {"header": Header, "wrench": Wrench})


@dataclass(frozen=True)
class PoseWithCovariance(Message, ros="geometry_msgs"):
    """A pose and how certain it is."""

    pose: Pose = Pose()

    # Row by row of x, y, z [m] and the rotations about them [rad], shape (36,).
    covariance: tuple[float, ...] = (0.0,) * 36


@dataclass(frozen=True)
class TwistWithCovariance(Message, ros="geometry_msgs"):
    """A velocity and how certain it is."""

    twist: Twist = Twist()

    # Row by row of x, y, z [m/s] and the rotations about them [rad/s], shape (36,).
    covariance: tuple[float, ...] = (0.0,) * 36


@dataclass(frozen=True)
class Odometry(Message, ros="nav_msgs"):
    """Estimated pose and velocity of a base (`nav_msgs`)."""

    header: Header = Header()

    # Frame of the twist.
    child_frame_id: str = ""

    # In the frame of the header.
    pose: PoseWithCovariance = PoseWithCovariance()

    twist: TwistWithCovariance = TwistWithCovariance()


@dataclass(frozen=True, eq=False)
class SetOdometry(Message):
    """Request of the service `control_msgs/SetOdometry`: where a base is."""

    # [m].
    x: float = 0.0
    y: float = 0.0

    # [rad].
    yaw: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        take_numbers(self, "x", "y", "yaw")
