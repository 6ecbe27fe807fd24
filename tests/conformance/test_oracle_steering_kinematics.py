"""Replays what upstream's class SteeringOdometry did: odometry and wheel commands."""

from typing import Any

import pytest

from arm_drake.control.odometry import (
    RollingMean,
    SteeringGeometry,
    SteeringOdometry,
    to_wheel_commands,
)
from tests.oracle import assert_close, oracle_cases

CASES = oracle_cases("steering_kinematics")

# Driven and steered wheels by `config`: bicycle, tricycle, ackermann.
WHEELS = ((1, 1), (2, 1), (2, 2))


def make_geometry(inputs: dict[str, Any]) -> SteeringGeometry:
    radius, wheelbase, *widths = inputs["geometry"]
    # Of four, the steered wheels' comes first.
    return SteeringGeometry(
        wheelbase,
        radius,
        *WHEELS[inputs["config"]],
        traction_track_width=widths[-1],
        steering_track_width=widths[0],
    )


def replay(inputs: dict[str, Any]) -> list[list[float]]:
    """Return a row for each step: whether the means are new, pose, velocity."""
    geometry = make_geometry(inputs)
    odometry = SteeringOdometry(RollingMean(inputs["window"]))
    rows = []
    n = geometry.num_driven
    for *values, dt in inputs["steps"]:
        before, wheels, angles = odometry, tuple(values[:n]), tuple(values[n:])
        if inputs["mode"] == "open_loop":
            v, w = values
            odometry = odometry.follow(v, w, dt)
        elif inputs["mode"] == "position":
            odometry = odometry.measure_positions(geometry, wheels, angles, dt)
        else:
            odometry = odometry.measure_velocities(geometry, wheels, angles, dt)
        is_new = odometry.means.samples is not before.means.samples
        is_ok = is_new or inputs["mode"] == "open_loop"
        rows.append([is_ok, *odometry.pose, *odometry.velocity])
    return rows


@pytest.mark.parametrize("case", [c for c in CASES if c["input"]["mode"] != "ik"])
def test_odometry_is_upstream_s(case: dict[str, Any]) -> None:
    rows = replay(case["input"])

    assert_close(rows, case["output"]["rows"])


@pytest.mark.parametrize("case", [c for c in CASES if c["input"]["mode"] == "ik"])
def test_commands_are_upstream_s(case: dict[str, Any]) -> None:
    inputs, rows = case["input"], case["output"]["rows"]
    geometry = make_geometry(inputs)
    odometry = SteeringOdometry(RollingMean(inputs["window"]))
    follow = inputs.get("follow")

    for step, (v, w, dt) in enumerate(inputs["steps"]):
        expected = rows[step]
        commands = to_wheel_commands(
            geometry,
            v,
            w,
            measured=None if inputs["open_loop"] else odometry.steering,
            slows_down=inputs["reduce"],
        )
        assert_close(commands.traction, expected["traction"], f"step {step}")
        assert_close(commands.steering, expected["steering"], f"step {step}")
        if follow is not None:
            angles = tuple(follow * angle for angle in commands.steering)
            odometry = odometry.measure_velocities(
                geometry, commands.traction, angles, dt
            )
