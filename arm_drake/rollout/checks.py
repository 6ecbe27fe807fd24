"""Whether what a file says of a rollout fits together."""

from collections.abc import Mapping
from typing import Any

import numpy as np

# Longer than any simulation [s]: about a century.
_MAX_TIME = 3.2e9


def check_fields(fields: Mapping[str, Any]) -> None:
    """Raise ValueError if fields of a Rollout don't fit together.

    Args:
        fields: They, by name; references are joints and positions.
    """
    time, joints = np.asarray(fields["time"]), fields["joint_names"]
    if time.ndim != 1 or not np.all(np.abs(time) <= _MAX_TIME):
        raise ValueError("times are no numbers of seconds")
    if np.any(np.diff(time) <= 0.0):
        raise ValueError("times don't rise")
    num_rows, num_joints = len(time), len(joints)
    names = fields.get("command_names", ())
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
        name: (fields[name], (num_rows, num_joints))
        for name in ("position", "velocity", "effort")
    }
    shapes["effort_limit"] = fields["effort_limit"], (num_joints,)
    if names:
        shapes["command"] = fields["command"], (num_rows, len(names))
    if fields.get("controllers"):
        shapes["active"] = fields["active"], (num_rows, len(fields["controllers"]))
    for link, poses in fields.get("free_poses", {}).items():
        shapes[f"pose of {link!r}"] = poses, (num_rows, 7)
    for link, forces in fields.get("contact_forces", {}).items():
        shapes[f"contact force of {link!r}"] = forces, (num_rows, 3)
    for controller, (wanted, position) in fields["references"].items():
        what = f"reference of {controller!r}"
        shapes[what] = position, (num_rows, len(wanted))
    for name, (values, shape) in shapes.items():
        found = np.shape(values)
        if found != shape:
            raise ValueError(f"{name} has shape {found}, expected {shape}")
    if len(fields["joint_types"]) != num_joints:
        raise ValueError(f"{len(fields['joint_types'])} types of {num_joints} joints")
    info = fields.get("info", {})
    if not isinstance(info, Mapping) or not isinstance(info.get("robot", {}), Mapping):
        raise ValueError("info is no mapping with a mapping of the robot")
