"""Where links are in their parents, of a description and the positions of its joints.

As robot_state_publisher tells it: `/tf` for joints that move, `/tf_static` for others.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.joints import FREE_TYPES, WORLD


class LinkTransform(NamedTuple):
    """Pose of a link in its parent."""

    parent: str
    child: str

    # Position of the joint's origin in the parent, shape (3,) [m], and its orientation
    # there as a quaternion w, x, y, z, shape (4,).
    origin: Array
    rotation: Array

    # Name of the joint that moves it; empty if none does.
    joint: str = ""

    # Axis of the joint, a unit vector, shape (3,), and whether it slides along it.
    axis: Array = np.zeros(3)
    is_prismatic: bool = False

    def poses(self, position: Array) -> Array:
        """Return x, y, z [m] and quaternion w, x, y, z in the parent, shape (N, 7).

        Args:
            position: Positions of the joint [rad] or [m], shape (N,).
        """
        moved = np.tile(self.origin, (len(position), 1))
        turned = np.tile(self.rotation, (len(position), 1))
        if self.joint and self.is_prismatic:
            axis = rotate(self.rotation, self.axis)
            moved = moved + position[:, None] * axis
        elif self.joint:
            half = position[:, None] / 2.0
            turn = np.hstack([np.cos(half), np.sin(half) * self.axis])
            turned = multiply(turned, turn)
        return np.hstack([moved, turned])


def read_transforms(
    description: str, pose: Sequence[float] = (0.0,) * 6
) -> tuple[LinkTransform, ...]:
    """Return the poses of links in their parents, but for those that nothing holds.

    Args:
        description: An expanded URDF.
        pose: Where the robot stands: x, y, z [m], roll, pitch, yaw [rad].
    """
    return tuple(
        _moved(_read_joint(joint), pose)
        for joint in ET.fromstring(description).iterfind("joint")  # noqa: S314
        if joint.get("type") not in FREE_TYPES
    )


def root_links(description: str, transforms: Iterable[LinkTransform]) -> list[str]:
    """Return the links that are in no parent, the world left out.

    Args:
        description: An expanded URDF.
        transforms: The poses of its links.
    """
    held = {transform.child for transform in transforms}
    root = ET.fromstring(description)  # noqa: S314  what was loaded.
    names = [link.get("name", "") for link in root.iterfind("link")]
    return [name for name in names if name not in held and name != WORLD]


def fixed_pose(pose: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return position and quaternion of x, y, z [m], roll, pitch, yaw [rad]."""
    return np.array(pose[:3], dtype=float), _quaternion(pose[3:])


def base_pose(info: Mapping[str, Any]) -> list[float]:
    """Return where a robot stands: x, y, z [m], roll, pitch, yaw [rad].

    Args:
        info: What made its rollout.
    """
    pose = info.get("robot", {}).get("pose") or [0.0] * 6
    return [float(number) for number in pose]


def multiply(p: Array, q: Array) -> Array:
    """Return products of quaternions w, x, y, z, each of shape (N, 4)."""
    w, v = p[:, :1], p[:, 1:]
    s, u = q[:, :1], q[:, 1:]
    real = w * s - np.sum(v * u, axis=1, keepdims=True)
    return np.hstack([real, w * u + s * v + np.cross(v, u)])


def rotate(quaternion: Array, vector: Array) -> Array:
    """Return a vector of shape (3,), rotated by a quaternion w, x, y, z."""
    w, v = quaternion[0], quaternion[1:]
    return vector + 2.0 * np.cross(v, np.cross(v, vector) + w * vector)


def _read_joint(joint: ET.Element) -> LinkTransform:
    parent, child, origin = (joint.find(n) for n in ("parent", "child", "origin"))
    place = np.zeros(6)
    if origin is not None:
        place[:3] = _numbers(origin.get("xyz"))
        place[3:] = _numbers(origin.get("rpy"))
    position, rotation = fixed_pose(place)
    names = ["" if e is None else e.get("link", "") for e in (parent, child)]
    if joint.get("type") == "fixed":
        return LinkTransform(names[0], names[1], position, rotation)
    given = joint.find("axis")
    axis = np.array([1.0, 0.0, 0.0])
    if given is not None and given.get("xyz"):
        axis = np.array(_numbers(given.get("xyz")))
    return LinkTransform(
        names[0],
        names[1],
        position,
        rotation,
        joint.get("name", ""),
        axis / (np.linalg.norm(axis) or 1.0),
        joint.get("type") == "prismatic",
    )


def _moved(transform: LinkTransform, pose: Sequence[float]) -> LinkTransform:
    """Return the pose of a link in the world, where the robot stands there."""
    if transform.parent != WORLD:
        return transform
    position, rotation = fixed_pose(pose)
    return transform._replace(
        origin=position + rotate(rotation, transform.origin),
        rotation=multiply(rotation[None], transform.rotation[None])[0],
    )


def _numbers(text: str | None) -> list[float]:
    return [float(word) for word in text.split()] if text else [0.0, 0.0, 0.0]


def _quaternion(rpy: Sequence[float] | Array) -> Array:
    """Return the quaternion w, x, y, z of roll, pitch and yaw [rad], as URDF has it."""
    turns = []
    for axis, angle in enumerate(rpy):
        turn = np.zeros((1, 4))
        turn[0, 0], turn[0, 1 + axis] = np.cos(angle / 2.0), np.sin(angle / 2.0)
        turns.append(turn)
    roll, pitch, yaw = turns
    return np.asarray(multiply(multiply(yaw, pitch), roll)[0])
