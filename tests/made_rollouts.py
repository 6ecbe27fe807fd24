"""Rollouts made by hand, with what a test is about."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.rollout.rollout import Rollout


def make_described(
    description: str,
    joints: Mapping[str, str],
    position: NDArray[np.float64] | None,
    **changes: Any,
) -> Rollout:
    """Return a rollout of a robot with a description, at rest, a row each 0.1 s.

    Args:
        description: Its URDF.
        joints: Types of its joints by their names.
        position: Positions [rad] or [m], shape (N, J); None is one row of zeros.
        changes: Fields that are different.
    """
    position = np.zeros((1, len(joints))) if position is None else position
    still = np.zeros_like(position)
    values = {
        "time": 0.1 * np.arange(len(position)),
        "joint_names": tuple(joints),
        "joint_types": tuple(joints.values()),
        "position": position,
        "velocity": still,
        "effort": still,
        "effort_limit": np.full(len(joints), np.inf),
        "references": {},
        "description": description,
    }
    return Rollout(**(values | changes))
