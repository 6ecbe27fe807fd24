"""Twists, wrenches and poses: made of mappings, checked where they are made."""

import numpy as np
import pytest

from arm_drake.control.odometry import PlanarPose, RollingMean, integrate_arc
from arm_drake.controllers.bases.base import (
    diagonal,
    make_odometry,
    make_transform,
    resolve_frames,
)
from arm_drake.messages import Quaternion, Twist, TwistStamped, Vector3, WrenchStamped


def test_twist_takes_mappings() -> None:
    twist = TwistStamped(twist={"linear": {"x": 1}, "angular": {"z": np.float64(2)}})

    assert twist.twist == Twist(Vector3(1.0), Vector3(0.0, 0.0, 2.0))
    assert type(twist.twist.linear.x) is float


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"twist": {"linear": {"x": "fast"}}}, "twist.linear.x: expected a number"),
        ({"twist": {"liner": {}}}, "a Twist has no field liner; it has linear, angul"),
        ({"twist": 1.0}, "twist: expected a Twist, got 1.0; or a mapping"),
        ({"header": {"stamp": "now"}}, "header.stamp: expected seconds"),
    ],
)
def test_bad_twist_is_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TwistStamped(**fields)


def test_wrench_takes_mappings() -> None:
    wrench = WrenchStamped(wrench={"force": {"z": -9.81}})

    assert wrench.wrench.force == Vector3(0.0, 0.0, -9.81)


def test_messages_with_the_same_fields_are_two() -> None:
    assert TwistStamped() != TwistStamped()


def test_quaternion_of_a_yaw() -> None:
    quaternion = Quaternion.from_yaw(np.pi / 2.0)

    assert quaternion.z == pytest.approx(np.sqrt(0.5))
    assert quaternion.w == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize(
    ("prefix", "namespace", "inputs", "odom"),
    [
        ("test_prefix", "", {}, "test_prefix/odom"),
        ("/test_prefix/", "", {}, "test_prefix/odom"),
        ("~", "/space", {}, "space/odom"),
        ("", "/space", {}, "space/odom"),
        ("", "/space", {"is_lyrical": True}, "odom"),
        ("", "/", {}, "odom"),
        ("test_prefix", "/space", {"is_enabled": False}, "odom"),
    ],
)
def test_prefix_of_frames(
    prefix: str, namespace: str, inputs: dict[str, bool], odom: str
) -> None:
    frames = resolve_frames(
        "odom", "base_link", prefix=prefix, namespace=namespace, **inputs
    )

    assert frames.odom == odom
    assert frames.base == odom.replace("odom", "base_link")


def test_odometry_says_the_same_as_its_transform() -> None:
    covariance = diagonal((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    frames = resolve_frames("odom", "base", prefix="")

    odometry = make_odometry(
        1_500_000_000,
        frames,
        PlanarPose(1.0, 2.0, np.pi),
        (0.1, 0.2, 0.3),
        (covariance, covariance),
    )
    (transform,) = make_transform(odometry).transforms

    np.testing.assert_array_equal(
        np.reshape(odometry.pose.covariance, (6, 6)), np.diag(range(1, 7))
    )
    assert odometry.header.stamp.to_seconds() == 1.5
    assert odometry.twist.twist == Twist(Vector3(0.1, 0.2), Vector3(0.0, 0.0, 0.3))
    assert transform.transform.translation == Vector3(1.0, 2.0, 0.0)
    assert transform.transform.rotation == odometry.pose.pose.orientation
    assert (transform.header, transform.child_frame_id) == (odometry.header, "base")


def test_rolling_mean_forgets_the_oldest() -> None:
    mean = RollingMean(2)
    for value in (1.0, 2.0, 6.0):
        mean = mean.add(value, -value)

    assert mean.means(2) == (4.0, -4.0)
    assert mean.clear().means(2) == (0.0, 0.0)


def test_quarter_of_a_circle() -> None:
    # Radius 2 about (0, 2): a quarter ends at (2, 2).
    pose = integrate_arc(PlanarPose(), 2.0, 1.0, np.pi / 2.0)

    assert pose == pytest.approx((2.0, 2.0, np.pi / 2.0))
