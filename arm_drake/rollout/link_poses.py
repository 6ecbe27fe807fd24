"""Poses of links in the world, of joint positions and the robot's description.

Sources: robot_state_publisher (`/tf` for joints that move, `/tf_static` for others)
and URDF (order of roll, pitch and yaw).
"""

import functools
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.joints import FREE_TYPES, WORLD, JointInfo, read_joint
from arm_drake.description.report import LoadReport
from arm_drake.errors import InputError, suggest


class RecordedMotion(Protocol):
    """Parts of a Rollout that determine the poses of its links."""

    @property
    def time(self) -> Array:
        """Times [s], shape (N,)."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of J joints."""

    @property
    def position(self) -> Array:
        """Their positions [rad] or [m], shape (N, J)."""

    @property
    def free_poses(self) -> Mapping[str, Array]:
        """Poses in the world of links that nothing holds, shape (N, 7)."""

    @property
    def info(self) -> Mapping[str, Any]:
        """Provenance of the rollout, with the robot's pose."""

    @property
    def description(self) -> str:
        """An expanded URDF."""


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
        """Return x, y, z [m], quaternion w, x, y, z in the parent by joint position."""
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
    """Return where links are in their parents, in the order of the URDF's joints.

    Those that nothing holds are left out. The pose is the robot's: x, y, z [m], roll,
    pitch, yaw [rad].
    """
    return tuple(
        _moved(_transform_of(joint), pose)
        for joint in read_joints(description)
        if joint.type not in FREE_TYPES
    )


def root_links(description: str, transforms: Iterable[LinkTransform]) -> list[str]:
    """Return the links that are in no parent, the world left out."""
    children = {transform.child for transform in transforms}
    return [name for name in _links(description) if name not in children]


def fixed_pose(pose: Sequence[float] | Array) -> tuple[Array, Array]:
    """Return position and quaternion of x, y, z [m], roll, pitch, yaw [rad]."""
    return np.array(pose[:3], dtype=float), _quaternion(pose[3:])


def base_pose(info: Mapping[str, Any]) -> list[float]:
    """Return x, y, z [m], roll, pitch, yaw [rad] of a robot by its rollout's info."""
    pose = info.get("robot", {}).get("pose") or [0.0] * 6
    return [float(number) for number in pose]


def multiply(p: Array, q: Array) -> Array:
    """Return products of quaternions w, x, y, z, each of shape (N, 4)."""
    w, v = p[:, :1], p[:, 1:]
    s, u = q[:, :1], q[:, 1:]
    real = w * s - np.sum(v * u, axis=1, keepdims=True)
    return np.hstack([real, w * u + s * v + np.cross(v, u)])


def rotate(quaternion: Array, vector: Array) -> Array:
    """Return vectors of shape (..., 3), rotated by quaternions w, x, y, z."""
    w, v = quaternion[..., :1], quaternion[..., 1:]
    return vector + 2.0 * np.cross(v, np.cross(v, vector) + w * vector)


@functools.lru_cache(maxsize=1)
def _parse(description: str) -> ET.Element:
    """Return the tree of a URDF that was loaded; nobody changes it."""
    return ET.fromstring(description)  # noqa: S314


@functools.lru_cache(maxsize=1)
def read_joints(description: str) -> tuple[JointInfo, ...]:
    """Return the joints of a URDF that was loaded.

    What is no URDF is an ET.ParseError or a DescriptionError.
    """
    joints = _parse(description).iterfind("joint")
    return tuple(read_joint(each, Path("description"), LoadReport()) for each in joints)


def _links(description: str) -> list[str]:
    names = (link.get("name", "") for link in _parse(description).iterfind("link"))
    return [name for name in names if name != WORLD]


def _transform_of(joint: JointInfo) -> LinkTransform:
    place = fixed_pose((*joint.origin.xyz, *joint.origin.rpy))
    if not joint.is_movable:
        return LinkTransform(joint.parent, joint.child, *place)
    slides = joint.type == "prismatic"
    return LinkTransform(
        joint.parent, joint.child, *place, joint.name, joint.unit_axis, slides
    )


def _moved(transform: LinkTransform, pose: Sequence[float]) -> LinkTransform:
    """Return the pose of a link in the world, with the robot at a pose."""
    if transform.parent != WORLD:
        return transform
    position, rotation = fixed_pose(pose)
    return transform._replace(
        origin=position + rotate(rotation, transform.origin),
        rotation=multiply(rotation[None], transform.rotation[None])[0],
    )


def _quaternion(rpy: Sequence[float] | Array) -> Array:
    """Return the quaternion w, x, y, z of roll, pitch and yaw [rad], as URDF has it."""
    turns = []
    for axis, angle in enumerate(rpy):
        turn = np.zeros((1, 4))
        turn[0, 0], turn[0, 1 + axis] = np.cos(angle / 2.0), np.sin(angle / 2.0)
        turns.append(turn)
    roll, pitch, yaw = turns
    return np.asarray(multiply(multiply(yaw, pitch), roll)[0])


# How frames are called that sit where a tool works.
_TOOL = re.compile(
    r"(^|_)(tool0?|tcp|tip|ee|eef|eff|end_?effector|flange|grasp)(_|$)", re.IGNORECASE
)

# A finger has at most so many joints that move it, and what it is on at least so many.
_FINGER, _ARM = 4, 3


def read_link_poses(rollout: RecordedMotion, link: str) -> Array:
    """Return x, y, z [m], quaternion w, x, y, z of a link in the world, shape (N, 7).

    They are NaN where positions are. Raises InputError if there is no description, no
    such link, or where it was is recorded nowhere.
    """
    transforms = _transforms(rollout)
    parents = (transform.parent for transform in transforms.values())
    links = {*transforms, *parents, *_links(rollout.description)}
    if link not in links | {WORLD}:
        raise InputError(f"no link {link!r} in the description; {suggest(link, links)}")
    chain = list(_chain(transforms, link))
    root = chain[-1].parent if chain else link
    poses = _root_poses(rollout, root)
    for transform in reversed(chain):
        position = np.zeros(len(rollout.time))
        if transform.joint:
            position = rollout.position[:, rollout.joint_names.index(transform.joint)]
        poses = _compose(poses, transform.poses(position))
    return poses


def find_tip(rollout: RecordedMotion) -> str:
    """Return the link to trace: the end effector, or a moving base.

    It is at the end of the chain with the most joints that move by themselves. A hand
    with fingers counts as a whole, and of what is fixed there a frame that is called
    like a tool is taken, else the last one. A base that moves freely stands for
    itself if it carries no arm. Raises InputError if there is no description.
    """
    transforms = _transforms(rollout)
    following = {j.name for j in read_joints(rollout.description) if j.mimic}
    names = _links(rollout.description)
    moving = {link: _num_joints(transforms, link, following) for link in names}
    deepest = max(names, key=lambda link: moving[link])
    free = next((link for link in names if link in rollout.free_poses), None)
    if free is not None and moving[deepest] < _ARM:
        return free
    body = _without_fingers(transforms, deepest, moving)
    fixed = [link for link in names if _body(transforms, link) == body]
    has_fingers = body != _body(transforms, deepest)
    tools = [link for link in fixed if _TOOL.search(link)]
    candidates = tools or ([body] if has_fingers else fixed)
    return max(candidates, key=lambda link: sum(1 for _ in _chain(transforms, link)))


def _transforms(rollout: RecordedMotion) -> dict[str, LinkTransform]:
    """Return where links are in their parents, by their names."""
    if not rollout.description:
        raise InputError(
            "the rollout has no description of its robot, so where links were is "
            "unknown; .npz and .mcap files keep it, .csv files don't"
        )
    pose = base_pose(rollout.info)
    try:
        transforms = read_transforms(rollout.description, pose)
    except (ET.ParseError, ValueError) as error:
        raise InputError(f"the rollout's description is no URDF ({error})") from None
    return {transform.child: transform for transform in transforms}


def _chain(
    transforms: Mapping[str, LinkTransform], link: str
) -> Iterator[LinkTransform]:
    """Yield the poses of a link, its parent and so on, each in its parent."""
    while link in transforms:
        yield transforms[link]
        link = transforms[link].parent


def _num_joints(
    transforms: Mapping[str, LinkTransform], link: str, following: set[str]
) -> int:
    joints = {t.joint for t in _chain(transforms, link)} - {""}
    return len(joints - following)


def _body(transforms: Mapping[str, LinkTransform], link: str) -> str:
    """Return the link that is moved by a joint, and to which another one is fixed."""
    while link in transforms and not transforms[link].joint:
        link = transforms[link].parent
    return link


def _without_fingers(
    transforms: Mapping[str, LinkTransform], tip: str, moving: Mapping[str, int]
) -> str:
    """Return the body that carries the fingers of which one ends in a link, or its own.

    `moving` is the number of joints that move each link.
    """
    moved = [t for t in transforms.values() if t.joint]
    for above in _chain(transforms, tip):
        body = _body(transforms, above.parent)
        depth = moving.get(body, 0)
        if moving[tip] - depth > _FINGER or depth < _ARM:
            break
        branches = [t.child for t in moved if _body(transforms, t.parent) == body]
        if above.joint and len(branches) > 1:
            return body
    return _body(transforms, tip)


def _root_poses(rollout: RecordedMotion, root: str) -> Array:
    """Return the poses of a link without a parent, shape (N, 7)."""
    num = len(rollout.time)
    if root in rollout.free_poses:
        return rollout.free_poses[root].copy()
    for joint in read_joints(rollout.description):
        if joint.child == root:
            raise InputError(
                f"joint {joint.name!r} is {joint.type}, and how it moved isn't "
                f"recorded, so where {root!r} was is unknown"
            )
    pose = [0.0] * 6 if root == WORLD else base_pose(rollout.info)
    return np.tile(np.hstack(fixed_pose(pose)), (num, 1))


def _compose(X_WA: Array, X_AB: Array) -> Array:
    """Return poses of B in W, of A in W and of B in A, each of shape (N, 7)."""
    q, p = X_WA[:, 3:], X_AB[:, :3]
    return np.hstack([X_WA[:, :3] + rotate(q, p), multiply(q, X_AB[:, 3:])])
