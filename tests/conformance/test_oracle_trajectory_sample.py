"""Replays the sampled trajectories and wrapped start positions of upstream."""

from typing import Any

import numpy as np
import pytest

from arm_drake.control.trajectory import StateBefore, Trajectory, wrap_state_before
from arm_drake.controllers.joint_trajectory.goals import fill_cubic_spline_velocities
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    Time,
)
from tests.conformance.oracle_files import read_files
from tests.oracle import assert_close, number, oracle_cases

NAMES = ("trajectory_sample", "wraparound_joint")
FILES = read_files(NAMES)
SAMPLES = FILES.get("trajectory_sample", [])
WRAPAROUND = FILES.get("wraparound_joint", [])


def case_ids(cases: list[dict[str, Any]]) -> list[str]:
    return [f"{case['input'].get('tag', 'case')}-{i}" for i, case in enumerate(cases)]


def make_message(trajectory: dict[str, Any]) -> JointTrajectory:
    stamp = trajectory.get("header", {}).get("stamp", {})
    points = tuple(
        JointTrajectoryPoint(
            **{
                field: list(map(number, value)) if isinstance(value, list) else value
                for field, value in point.items()
            }
        )
        for point in trajectory["points"]
    )
    header = Header(stamp=Time.of(stamp))
    return JointTrajectory(header, tuple(trajectory["joint_names"]), points)


def make_state(time_ns: int, point: dict[str, Any]) -> StateBefore:
    fields = ("positions", "velocities", "accelerations", "effort")
    vectors = [np.array(point[f], float) if point.get(f) else None for f in fields]
    return StateBefore(time_ns, *vectors)


def fill(message: JointTrajectory) -> list[list[float]] | None:
    times = np.array([p.time_from_start.to_nanoseconds() for p in message.points])
    positions = np.array([p.positions for p in message.points])
    velocities = fill_cubic_spline_velocities(times / NANOSECONDS, positions)
    return None if velocities is None else velocities.tolist()


@pytest.mark.parametrize("name", NAMES)
def test_a_file_has_cases(name: str) -> None:
    assert oracle_cases(name)


@pytest.mark.parametrize("case", SAMPLES, ids=case_ids(SAMPLES))
def test_samples_are_upstream_s(case: dict[str, Any]) -> None:
    inputs, expected = case["input"], case["output"]
    message = make_message(inputs["trajectory"])
    if inputs.get("fill_cubic_spline"):
        velocities = fill(message)
        assert (velocities is not None) == expected["fill_ok"]
        if velocities is not None:
            assert_close(velocities, expected["filled_velocities"])
            points = [
                JointTrajectoryPoint(p.positions, v, time_from_start=p.time_from_start)
                for p, v in zip(message.points, velocities, strict=True)
            ]
            message = JointTrajectory(message.header, message.joint_names, points)
    wraparound = inputs.get("wraparound")
    trajectory = Trajectory.from_message(
        message,
        make_state(inputs["t_before_ns"], inputs["point_before"]),
        now_ns=inputs["sample_ns"][0],
        interpolation=inputs["interpolation"],
        wraparound=None if wraparound is None else np.array(wraparound),
    )

    assert trajectory.start_ns == expected["start_time_ns"]
    cursor = 0
    for i, time_ns in enumerate(inputs["sample_ns"]):
        sample = trajectory.sample(time_ns, cursor)
        assert (sample is not None) == expected["ok"][i]
        if sample is None:
            continue
        if inputs["monotonic"]:
            cursor = max(cursor, sample.segment_start)
        assert sample.segment_start == expected["segment_start"][i]
        assert sample.segment_end == expected["segment_end"][i]
        for field in ("position", "velocity", "acceleration", "effort"):
            value = getattr(sample, field)
            assert_close([] if value is None else value, expected[field][i])


@pytest.mark.parametrize("case", WRAPAROUND, ids=case_ids(WRAPAROUND))
def test_wrapped_positions_are_upstream_s(case: dict[str, Any]) -> None:
    inputs = case["input"]
    current, target = (np.array(inputs[key], float) for key in ("current", "next"))

    wrapped = wrap_state_before(current, target, np.array(inputs["wraparound"]))

    assert_close(wrapped, case["output"]["current_after"])
