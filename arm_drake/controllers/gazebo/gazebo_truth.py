"""Where links really are, as Gazebo Classic publishes it."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake.controllers.bases.base import BaseFrames
from arm_drake.messages import (
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
)


def describe_base(
    time_ns: int,
    frames: BaseFrames,
    poses: tuple[RigidTransform, RigidTransform],
    dt: float,
    covariance: tuple[float, ...],
) -> Odometry:
    """Return the odometry of a base whose pose is known.

    Args:
        time_ns: The time [ns].
        frames: Names of the frames.
        poses: Where the base was the last time in the world, and where it is.
        dt: Time since then [s]; without any, the velocity is 0.
        covariance: Of pose and twist alike, shape (36,).
    """
    last, pose = poses
    x, y, wz = 0.0, 0.0, 0.0
    if dt > 0.0:
        x, y = (pose.translation() - last.translation())[:2] / dt
        turn = pose.rotation().multiply(last.rotation().inverse()).ToAngleAxis()
        wz = turn.angle() * turn.axis()[2] / dt
    yaw = RollPitchYaw(pose.rotation()).yaw_angle()
    c, s = np.cos(yaw), np.sin(yaw)
    linear = Vector3(c * x + s * y, c * y - s * x, 0.0)
    where = _to_transform(pose)
    at = where.translation
    return Odometry(
        Header.from_nanoseconds(time_ns, frames.odom),
        frames.base,
        PoseWithCovariance(Pose(Point(at.x, at.y, at.z), where.rotation), covariance),
        TwistWithCovariance(Twist(linear, Vector3(0.0, 0.0, wz)), covariance),
    )


def describe_wheels(
    time_ns: int,
    base: RigidTransform,
    links: Sequence[tuple[str, str]],
    poses: Sequence[RigidTransform],
) -> tuple[TransformStamped, ...]:
    """Return the frames of wheels.

    Args:
        time_ns: The time [ns].
        base: Pose of the base in the world.
        links: Parent and child of each wheel's joint.
        poses: Poses of the children in the world.
    """
    return tuple(
        TransformStamped(
            Header.from_nanoseconds(time_ns, parent),
            child,
            _to_transform(base.inverse() @ pose),
        )
        for (parent, child), pose in zip(links, poses, strict=True)
    )


def _to_transform(pose: RigidTransform) -> Transform:
    w, x, y, z = pose.rotation().ToQuaternion().wxyz().tolist()
    return Transform(Vector3(*pose.translation().tolist()), Quaternion(x, y, z, w))
