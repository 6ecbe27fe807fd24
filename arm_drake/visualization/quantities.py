"""What of a rollout is drawn: what joints did, and what was wanted of them."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.rollout.rollout import Rollout


class Tracked(NamedTuple):
    """What a joint is to follow, and how it did."""

    joint: str

    # Unit of SI.
    unit: str

    # Shape (N,).
    measured: Array

    # Each of shape (N,), by what it is called in a legend; NaN where nothing was
    # wanted. Without any nothing ever was.
    wanted: Mapping[str, Array]


class JointLimits(NamedTuple):
    """What a description allows a joint; infinite where it says nothing."""

    # [rad] or [m].
    lower: float = -math.inf
    upper: float = math.inf

    # [rad/s] or [m/s].
    velocity: float = math.inf


def track(rollout: Rollout, joints: Sequence[str]) -> list[Tracked]:
    """Return what joints were to follow: positions, or velocities if there are none.

    A joint that is told velocities alone, such as that of a wheel, shows these.

    Args:
        rollout: The rollout.
        joints: Which joints.
    """
    return [_track_joint(rollout, joint) for joint in joints]


def commanded(rollout: Rollout, joint: str, interface: str) -> Array | None:
    """Return what a command interface of a joint was told, shape (N,).

    It is None if there is no such interface, or it was never told anything.
    """
    name = f"{joint}/{interface}"
    if name not in rollout.command_names:
        return None
    values = rollout.command[:, rollout.command_names.index(name)]
    return values if np.isfinite(values).any() else None


def unit_of(rollout: Rollout, joint: str, interface: str) -> str:
    """Return the unit of a state of a joint."""
    joint_type = rollout.joint_types[rollout.joint_names.index(joint)]
    return interfaces.unit(interface, joint_type)


def read_limits(description: str) -> dict[str, JointLimits]:
    """Return what a description allows its joints; of none, nothing.

    Args:
        description: An expanded URDF, or "".
    """
    try:
        root = ET.fromstring(description)  # noqa: S314  what was loaded.
    except ET.ParseError:
        return {}
    joints = root.iterfind("joint")
    return {joint.get("name", ""): _read_joint(joint) for joint in joints}


def _track_joint(rollout: Rollout, joint: str) -> Tracked:
    column = rollout.joint_names.index(joint)
    position = {}
    for controller, reference in rollout.references.items():
        if joint in reference.joint_names:
            values = reference.position[:, reference.joint_names.index(joint)]
            if np.isfinite(values).any():
                position[f"reference ({controller})"] = values
    velocity = commanded(rollout, joint, interfaces.VELOCITY)
    if velocity is not None and not position:
        unit = unit_of(rollout, joint, interfaces.VELOCITY)
        wanted = {"commanded velocity": velocity}
        return Tracked(joint, unit, rollout.velocity[:, column], wanted)
    unit = unit_of(rollout, joint, interfaces.POSITION)
    return Tracked(joint, unit, rollout.position[:, column], position)


def _read_joint(joint: ET.Element) -> JointLimits:
    limit = joint.find("limit")
    if limit is None:
        return JointLimits()
    lower, upper, velocity = (
        _number(limit.get(name)) for name in ("lower", "upper", "velocity")
    )
    # A URDF says 0 where it says nothing.
    has_range = joint.get("type") in ("revolute", "prismatic")
    return JointLimits(
        (lower or 0.0) if has_range else -math.inf,
        (upper or 0.0) if has_range else math.inf,
        velocity or math.inf,
    )


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
