"""Positions that come at a low rate (spec D1: S76 to S80)."""

import numpy as np
import pytest

from arm_drake.controllers.joint_trajectory.goals import (
    fill_cubic_spline_velocities,
    upsample,
)
from arm_drake.messages import Header, JointTrajectory, JointTrajectoryPoint, Time
from tests.control.joint_trajectory_runs import make_goal, make_rules, run

RATE = 30.0


def make_chunk(*positions: float, times: list[float] | None = None) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(
            (q, 2 * q, 0.0), time_from_start=0.0 if times is None else times[i]
        )
        for i, q in enumerate(positions)
    ]
    return JointTrajectory(
        Header(stamp=Time(123, 456)), ("joint1", "joint2", "joint3"), points
    )


def seconds(message: JointTrajectory) -> list[float]:
    return [p.time_from_start.to_seconds() for p in message.points]


def test_points_without_times_come_at_the_given_rate() -> None:  # S76
    message = upsample(make_chunk(0.0, 0.1, 0.2, 0.1, 0.0), RATE)

    assert seconds(message) == pytest.approx([i / RATE for i in range(1, 6)], abs=1e-9)
    assert message.header.stamp == Time(123, 456)


def test_their_velocities_are_those_of_a_spline() -> None:
    message = upsample(make_chunk(0.0, 0.1, 0.2, 0.1, 0.0), RATE)

    positions = np.array([p.positions for p in message.points])
    expected = fill_cubic_spline_velocities(np.array(seconds(message)), positions)
    np.testing.assert_allclose([p.velocities for p in message.points], expected)
    # S74, but for times in whole nanoseconds.
    first = [p.velocities[0] for p in message.points]
    np.testing.assert_allclose(first, [0, 4.5, 0, -4.5, 0], rtol=1e-6, atol=1e-6)


def test_times_that_are_given_stay() -> None:  # S77
    message = upsample(make_chunk(0.0, 0.1, 0.2, times=[0.0, 0.123, 0.246]), RATE)

    assert seconds(message) == [0.0, 0.123, 0.246]
    assert all(point.velocities for point in message.points)


@pytest.mark.parametrize(
    "extra",
    [{"velocities": (0.0, 0.0, 0.0)}, {"accelerations": (0.0, 0.0, 0.0)}],
)
def test_a_point_with_more_than_positions_leaves_all_as_they_are(extra) -> None:  # S78
    chunk = make_chunk(0.0, 0.1, 0.2)
    point = JointTrajectoryPoint((0.0, 0.0, 0.0), **extra)
    message = JointTrajectory(chunk.header, chunk.joint_names, (*chunk.points, point))

    assert upsample(message, RATE) is message


@pytest.mark.parametrize(
    "message",
    [
        make_chunk(),
        make_chunk(0.1, times=[1.0]),
        make_chunk(0.1, 0.2, times=[1.0, 1.0]),
    ],
    ids=["no points", "one point", "times don't increase"],
)
def test_what_has_no_spline_stays_as_it_is(message: JointTrajectory) -> None:
    assert upsample(message, RATE) == message


def test_positions_of_different_sizes_are_left_to_the_validation() -> None:
    points = [
        JointTrajectoryPoint(q, time_from_start=t)
        for t, q in ((1.0, (1.0, 2.0)), (2.0, (1.0,)))
    ]
    message = JointTrajectory(points=points)

    assert upsample(message, RATE) is message


@pytest.mark.parametrize(
    ("frequency", "num_rejected"), [(RATE, 0), (0.0, 1), (None, 1)]
)
def test_a_controller_takes_them_on_its_topic_if_asked(  # S80
    frequency: float | None, num_rejected: int
) -> None:
    rules = make_rules(upsampling_frequency=frequency)
    chunk = make_chunk(0.0, 0.1, 0.2)
    message = JointTrajectory(joint_names=chunk.joint_names, points=chunk.points)

    states = run(rules, 0.2, topic={0.0: message})

    assert len(states[-1].events) == num_rejected
    moved = states[-1].command.tolist() == [0.2, 0.4, 0.0]
    assert moved is (num_rejected == 0)


def test_goals_are_left_as_they_are() -> None:
    chunk = make_chunk(0.0, 0.1, 0.2)
    message = JointTrajectory(joint_names=chunk.joint_names, points=chunk.points)

    states = run(
        make_rules(upsampling_frequency=RATE), 0.1, requests={0.0: make_goal(message)}
    )

    ((_, event),) = states[-1].events
    assert "times must increase" in event.result.error_string
