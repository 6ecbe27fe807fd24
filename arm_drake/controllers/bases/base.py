"""What controllers of mobile bases publish: odometry, and its frames on /tf.

Source: ros2_controllers (version 6.9.0), diff_drive_controller and
steering_controllers_library; the prefixes of frames, `tf_prefix`.
"""

from collections.abc import Sequence
from typing import NamedTuple

from arm_drake.control.odometry import PlanarPose
from arm_drake.messages import (
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
)


class BaseFrames(NamedTuple):
    """Names of the frames of an odometry, with their prefix."""

    odom: str
    base: str


def resolve_frames(
    odom: str,
    base: str,
    *,
    prefix: str,
    namespace: str = "",
    is_enabled: bool = True,
    is_lyrical: bool = False,
) -> BaseFrames:
    """Return the names of the frames with what goes before them.

    Args:
        odom: Name of the frame of the odometry.
        base: Name of the frame of the base.
        prefix: Parameter `tf_frame_prefix`; "~" stands for the namespace.
        namespace: Namespace of the controller's node.
        is_enabled: Parameter `tf_frame_prefix_enable` of older versions.
        is_lyrical: Whether an empty prefix is none, not the namespace.
    """
    if not is_enabled:
        prefix = ""
    elif prefix == "~" or (not prefix and not is_lyrical):
        prefix = namespace
    prefix = prefix.removeprefix("/")
    if prefix and not prefix.endswith("/"):
        prefix += "/"
    return BaseFrames(prefix + odom, prefix + base)


def diagonal(variances: Sequence[float]) -> tuple[float, ...]:
    """Return the covariance, shape (36,), with these variances, shape (6,)."""
    values = [0.0] * 36
    values[::7] = variances
    return tuple(values)


def make_odometry(
    time_ns: int | None,
    frames: BaseFrames,
    pose: PlanarPose,
    velocity: tuple[float, float, float],
    covariances: tuple[tuple[float, ...], tuple[float, ...]],
) -> Odometry:
    """Return the message of an odometry.

    Args:
        time_ns: Time of the tick [ns]; None before the first one, the message is empty.
        frames: Names of the frames.
        pose: Where the base stands.
        velocity: Forwards and to the left [m/s], and of turning [rad/s].
        covariances: Of the pose and of the twist, shape (36,) each.
    """
    if time_ns is None:
        return Odometry()
    vx, vy, wz = velocity
    return Odometry(
        Header.from_nanoseconds(time_ns, frames.odom),
        frames.base,
        PoseWithCovariance(
            Pose(Point(pose.x, pose.y, 0.0), Quaternion.from_yaw(pose.heading)),
            covariances[0],
        ),
        TwistWithCovariance(
            Twist(Vector3(vx, vy, 0.0), Vector3(0.0, 0.0, wz)), covariances[1]
        ),
    )


def make_transform(odometry: Odometry) -> TFMessage:
    """Return the message of /tf for an odometry; an empty one before its first."""
    if not odometry.child_frame_id:
        return TFMessage()
    pose = odometry.pose.pose
    where = Vector3(pose.position.x, pose.position.y, pose.position.z)
    return TFMessage(
        (
            TransformStamped(
                odometry.header,
                odometry.child_frame_id,
                Transform(where, pose.orientation),
            ),
        )
    )
