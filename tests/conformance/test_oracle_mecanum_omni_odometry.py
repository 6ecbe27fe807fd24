"""Replays upstream's odometries of bases with mecanum and with omni wheels."""

from typing import Any

import numpy as np
import pytest

from arm_drake.control.odometry import MecanumKinematics, MecanumWheels, PlanarPose
from arm_drake.controllers.bases.mecanum_drive_controller import (
    MecanumOdometry,
)
from arm_drake.controllers.bases.omni_wheel_drive_controller import (
    OmniWheelKinematics,
    OmniWheelOdometry,
)
from tests.conformance.open_loop import numbers
from tests.conformance.oracle_files import read_files
from tests.oracle import assert_close

FILES = read_files(("mecanum_odometry", "omni_wheel_odometry"))


@pytest.mark.parametrize("case", FILES.get("mecanum_odometry", ()))
def test_mecanum_odometry_is_upstream_s(case: dict[str, Any]) -> None:
    inputs, expected = numbers(case["input"]), numbers(case["output"]["rows"])
    offset = PlanarPose(*inputs["base_offset"])
    kinematics = MecanumKinematics(inputs["radius"], inputs["sum_lxy"], offset)
    odometry, rows = MecanumOdometry(), []

    for front_left, rear_left, rear_right, front_right, dt in inputs["steps"]:
        wheels = MecanumWheels(front_left, front_right, rear_right, rear_left)
        old, odometry = odometry, odometry.update(kinematics, wheels, dt)
        rows.append([odometry is not old, *odometry.pose, *odometry.velocity])

    assert [row[0] for row in rows] == [row[0] for row in expected]
    assert_close([row[1:] for row in rows], [row[1:] for row in expected])


@pytest.mark.parametrize("case", FILES.get("omni_wheel_odometry", ()))
def test_omni_wheel_odometry_is_upstream_s(case: dict[str, Any]) -> None:
    inputs, expected = numbers(case["input"]), numbers(case["output"]["rows"])
    n = inputs["wheels"]
    kinematics = OmniWheelKinematics(
        n, inputs["wheel_offset"], inputs["robot_radius"], inputs["wheel_radius"]
    )
    odometry, rows = OmniWheelOdometry((0.0,) * n), []

    for *values, dt in inputs["steps"]:
        old = odometry
        if inputs["mode"] == "open_loop":
            vx, vy, w = values
            odometry = old.move((vx, vy, w), dt)
        elif inputs["mode"] == "position":
            odometry = old.from_positions(kinematics, values, dt)
        else:
            odometry = old.from_velocities(kinematics, np.array(values), dt)
        rows.append([odometry is not old, *odometry.pose, *odometry.velocity])

    assert [row[0] for row in rows] == [row[0] for row in expected]
    assert_close([row[1:] for row in rows], [row[1:] for row in expected])
