"""Replays upstream's odometry of bases with differential drive, step by step."""

from typing import Any

import pytest

from arm_drake.control.odometry import (
    DiffDriveKinematics,
    RollingMean,
    WheelOdometryState,
    from_commands,
)
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("diff_drive_odometry")


@pytest.mark.parametrize("case", CASES)
def test_odometry_equals_upstream(case: dict[str, Any]) -> None:
    inputs = case["input"]
    kinematics = DiffDriveKinematics(
        inputs["separation"], inputs["left_radius"], inputs["right_radius"]
    )
    move = {
        "open_loop": from_commands,
        "position": kinematics.from_positions,
        "velocity": kinematics.from_velocities,
    }[inputs["mode"]]
    state = WheelOdometryState(RollingMean(inputs["window"]))

    for step, (ok, *expected) in zip(
        inputs["steps"], case["output"]["rows"], strict=True
    ):
        old, state = state, move(state, *step)

        assert_close([*state.pose, *state.velocity], expected)
        if inputs["mode"] != "open_loop":
            assert (state is not old) == ok
