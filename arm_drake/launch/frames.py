"""Static frames of a launch file: where each is, and what it is fixed to.

Sources: `static_transform_publisher` of tf2_ros (its arguments, its older ones, and the
parameters of its component).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RollPitchYaw

from arm_drake.description.elements import parse_float
from arm_drake.description.links import Pose
from arm_drake.launch.words import value_of

_LENGTHS, _ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
_QUATERNION = ("qx", "qy", "qz", "qw")

# What the parameters of its component are called.
_PARAMETERS = {
    **{f"translation.{axis}": axis for axis in "xyz"},
    **{f"rotation.{axis}": f"q{axis}" for axis in "xyzw"},
}


class StaticFrame(NamedTuple):
    """A frame that is fixed to another."""

    parent: str
    child: str

    # x, y, z [m], roll, pitch, yaw [rad] in the parent.
    pose: Pose


class Placed(NamedTuple):
    """Static frames of one robot, and its pose."""

    # Frames on its links, as `load_robot` takes them.
    frames: Mapping[str, tuple[str, Pose]]

    # Where its base is, None if nothing is said.
    pose: Pose | None


def read_static_frame(
    words: Sequence[str], values: Mapping[str, Any]
) -> tuple[StaticFrame, list[str]]:
    """Return the frame of a publisher's arguments and parameters, and what is wrong."""
    wrong: list[str] = []

    def read(text: str) -> float:
        number = parse_float(text)
        if number is None or not np.isfinite(number):
            wrong.append(text)
        return number or 0.0

    names = {"frame-id": "", "child-frame-id": ""}
    numbers: dict[str, float] = {}
    for key in (*_LENGTHS, *_ANGLES, *_QUATERNION, *names):
        text = value_of(words, f"--{key}")
        if text is not None and key in names:
            names[key] = text
        elif text is not None:
            numbers[key] = read(text)
    if not any(names.values()) and len(words) in (8, 9):
        # The older form: x y z, yaw pitch roll or qx qy qz qw, parent, child.
        *texts, names["frame-id"], names["child-frame-id"] = words
        turns = ("yaw", "pitch", "roll") if len(words) == 8 else _QUATERNION
        numbers = dict(zip((*_LENGTHS, *turns), map(read, texts), strict=True))
    if not any(names.values()):
        numbers = {
            name: float(values[key])
            for key, name in _PARAMETERS.items()
            if isinstance(values.get(key), int | float)
        }
        names["frame-id"] = str(values.get("frame_id", ""))
        names["child-frame-id"] = str(values.get("child_frame_id", ""))
    pose = _pose(numbers)
    return StaticFrame(names["frame-id"], names["child-frame-id"], pose), wrong


def _pose(numbers: Mapping[str, float]) -> Pose:
    x, y, z, roll, pitch, yaw = (numbers.get(key, 0.0) for key in (*_LENGTHS, *_ANGLES))
    qx, qy, qz, qw = (numbers.get(key, 0.0) for key in _QUATERNION)
    if any((qx, qy, qz, qw)):
        quaternion = np.array([qw, qx, qy, qz])
        unit = Quaternion(quaternion / np.linalg.norm(quaternion))
        roll, pitch, yaw = RollPitchYaw(unit).vector()
    x, y, z, roll, pitch, yaw = (
        round(float(each), 6) for each in (x, y, z, roll, pitch, yaw)
    )
    return (x, y, z, roll, pitch, yaw)


def place_frames(
    frames: Iterable[StaticFrame],
    links: Sequence[tuple[str, Mapping[str, str | None]]],
    leave_out: Callable[[StaticFrame, str], None],
) -> list[Placed]:
    """Return what static frames are for each robot, in the order of the robots.

    A frame on a link, or on such a frame, becomes one of the robot's. A root on
    something that is no robot's says where the robot stands. Others are handed to
    `leave_out`, with the reason. `links` has each robot's prefix of frames, and for
    each of its links the link that carries it, None for a root.
    """
    found: list[dict[str, tuple[str, Pose]]] = [{} for _ in links]
    poses: list[Pose | None] = [None for _ in links]

    def owner(name: str) -> int | None:
        for index, (prefix, own) in enumerate(links):
            short = name.removeprefix(prefix)
            if name.startswith(prefix) and (short in own or short in found[index]):
                return index
        return None

    waiting = [frame for frame in frames if frame.parent and frame.child]
    while waiting:
        left: list[StaticFrame] = []
        for parent, child, pose in waiting:
            parent_owner, child_owner = (
                owner(parent.lstrip("/")),
                owner(child.lstrip("/")),
            )
            frame = StaticFrame(parent, child, pose)
            if child_owner is not None:
                prefix, own = links[child_owner]
                name = child.lstrip("/").removeprefix(prefix)
                if parent_owner is None and own.get(name, "") is None:
                    poses[child_owner] = pose
                else:
                    leave_out(frame, "it is a link that has its place")
            elif parent_owner is not None:
                prefix = links[parent_owner][0]
                short = parent.lstrip("/").removeprefix(prefix)
                found[parent_owner][child.lstrip("/").removeprefix(prefix)] = (
                    short,
                    pose,
                )
            else:
                left.append(frame)
        if len(left) == len(waiting):
            for frame in left:
                leave_out(frame, f"{frame.parent!r} is no link of a robot")
            break
        waiting = left
    return [Placed(*each) for each in zip(found, poses, strict=True)]
