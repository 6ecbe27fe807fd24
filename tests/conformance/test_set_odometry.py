"""Upstream's scenarios of bases, with `set_odometry` in their middle.

The pose of the request takes the place of that cycle's. Where a base thinks that it is
has no say in how it moves: from there on its path is the one without the request, which
upstream's is compared with elsewhere, moved as a whole.
"""

import cmath
import copy
from typing import Any

import numpy as np
import pytest

from arm_drake.messages import TwistStamped
from tests.conformance.open_loop import OpenLoop
from tests.conformance.oracle_files import read_files

MESSAGES = {"reference": TwistStamped, "cmd_vel": TwistStamped}

FILES = read_files(
    ["controller_diff_drive", "controller_mecanum_omni", "controller_steering"]
)

# One of each family, which turns and drives at the time.
NAMES = (
    "diff_drive_position_jitter",
    "mecanum_jitter",
    "omni_position_jitter",
    "bicycle_position",
    "tricycle_position_jitter",
    "ackermann_position_jitter",
)

CASES = [
    case for cases in FILES.values() for case in cases if case["input"]["name"] in NAMES
]

# The cycle in which the request comes.
CYCLE = 50

REQUEST = {"x": 1.0, "y": -2.0, "yaw": 0.7}


def read_path(case: dict[str, Any]) -> list[tuple[complex, complex]]:
    """Return the odometry's position and heading after each cycle."""
    loop, path = OpenLoop(case["input"], case["output"], messages=MESSAGES), []
    name = "odometry" if "odometry" in case["output"]["published"] else "odom"
    for _ in loop.cycles():
        pose = loop.output(name).pose.pose
        half = complex(pose.orientation.w, pose.orientation.z)
        path.append((complex(pose.position.x, pose.position.y), half * half))
    return path


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["input"]["name"])
def test_the_path_is_moved_as_a_whole(case: dict[str, Any]) -> None:
    changed = copy.deepcopy(case)
    event = {"type": "service", "service": "set_odometry", "request": REQUEST}
    changed["input"].setdefault("events", []).append({"cycle": CYCLE, **event})

    plain, moved = read_path(case), read_path(changed)

    assert moved[:CYCLE] == plain[:CYCLE]
    goal = complex(REQUEST["x"], REQUEST["y"]), cmath.exp(1j * REQUEST["yaw"])
    np.testing.assert_allclose(moved[CYCLE], goal, rtol=1e-12)
    # What the wheels did in that cycle may count in the next one.
    (start, forward), (goal_start, goal_forward) = plain[CYCLE + 1], moved[CYCLE + 1]
    turn = goal_forward / forward
    for cycle in range(CYCLE + 2, len(plain)):
        position, heading = plain[cycle]
        expected = goal_start + turn * (position - start), turn * heading
        what = f"cycle {cycle}"
        np.testing.assert_allclose(
            moved[cycle], expected, rtol=1e-9, atol=1e-12, err_msg=what
        )
    assert abs(plain[-1][0] - start) > 0.003
