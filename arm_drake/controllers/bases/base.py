"""What controllers of mobile bases publish: odometry, and its frames on /tf.

Source: ros2_controllers (version 6.9.0), diff_drive_controller and
steering_controllers_library; the prefixes of frames, `tf_prefix`.

Limits of one component of a base's velocity, as control_toolbox's RateLimiter.

Source: control_toolbox 6.3.0, and the parameters of diff_drive_controller.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from arm_drake.control.odometry import PlanarPose
from arm_drake.description.parameters import Given, Rule
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


_SIGNS = {
    "max_velocity": 1,
    "min_velocity": -1,
    "max_acceleration": 1,
    "max_deceleration": -1,
    "max_acceleration_reverse": -1,
    "max_deceleration_reverse": 1,
    "max_jerk": 1,
    "min_jerk": -1,
}


@dc.dataclass(frozen=True)
class SpeedLimits:
    """Limits of a velocity along or about an axis [m/s] or [rad/s]; NaN is no limit."""

    # Largest velocity, at least 0, and smallest, at most 0; if that is NaN, it is the
    # opposite of the largest.
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Rate of change forwards: speeding up, at least 0, and slowing down, at most 0.
    max_acceleration: float = math.nan
    max_deceleration: Annotated[float, Rule(since="jazzy")] = math.nan

    # The same backwards: at most 0, and at least 0.
    max_acceleration_reverse: Annotated[float, Rule(since="jazzy")] = math.nan
    max_deceleration_reverse: Annotated[float, Rule(since="jazzy")] = math.nan

    # Rate of change of the acceleration, at least 0 and at most 0.
    max_jerk: float = math.nan
    min_jerk: float = math.nan

    @staticmethod
    def adapt(given: Given) -> None:
        """Take the older min_acceleration, and the deceleration's older sign."""
        names = ["min_acceleration"]
        if not given.is_before("jazzy"):
            names.append("max_deceleration")
        for name in names:
            value = given.get(name, float)
            if value is not None and value > 0.0:
                what = f"must be at most 0, got {value}"
                given.add(name, "warning", "repair", what, f"taken as {-value}")
                given.set(name, -value)
        for name in ("max_velocity", "max_acceleration", "max_jerk"):
            if given.get(name, float) == 0.0:
                what = "0 lets nothing move; .nan is no limit"
                given.add(name, "warning", "invalid", what, "it is taken as it is")
        value = given.get("min_acceleration", float)
        if value is not None:
            given.replace(
                "min_acceleration",
                {"max_deceleration": value, "max_acceleration_reverse": value},
            )

    def __post_init__(self) -> None:
        """Reject limits on the wrong side of 0."""
        for name, sign in _SIGNS.items():
            value = getattr(self, name)
            if sign * value < 0.0:
                allowed = "at least 0" if sign > 0 else "at most 0"
                raise ValueError(f"{name} must be {allowed}, got {value}")
