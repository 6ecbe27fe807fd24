import numpy as np
import pytest

from arm_drake.controllers.gazebo.joint_trajectory import (
    Following,
    Targets,
    advance,
    take_targets,
)
from arm_drake.messages import NANOSECONDS, JointTrajectory, JointTrajectoryPoint

START = 7 * NANOSECONDS


def follow(*times: float, point: int | None = None) -> Following:
    points = tuple(JointTrajectoryPoint(time_from_start=time) for time in times)
    return Following(JointTrajectory(joint_names=("j",), points=points), START, point)


@pytest.mark.parametrize(
    ("elapsed_ns", "point"),
    [
        (-1, None),
        (0, 0),
        (NANOSECONDS, 0),
        (NANOSECONDS + 1, 1),
        (2 * NANOSECONDS, 1),
        (2 * NANOSECONDS + 1, 2),
        (99 * NANOSECONDS, 2),
    ],
)
def test_a_point_is_the_target_after_the_time_of_the_one_before(
    elapsed_ns: int, point: int | None
) -> None:
    following = advance(follow(1.0, 2.0, 3.0), START + elapsed_ns)

    assert following.point == point


def test_points_whose_time_is_over_are_passed_over() -> None:
    # The times of a trajectory need not increase.
    assert advance(follow(0.5, 0.2, 2.0, 1.0), START + NANOSECONDS).point == 2


def test_a_trajectory_does_not_go_back() -> None:
    following = follow(1.0, 2.0, 3.0, point=1)

    assert advance(following, START) is following


def test_progress_counts_the_target() -> None:
    parts = [follow(1.0, 2.0, 3.0, 4.0, point=k).progress for k in (None, 0, 2, 3)]

    assert parts == [0.0, 0.25, 0.75, 1.0]


def test_targets_that_a_point_lacks_stay() -> None:
    before = Targets(*(np.array([1.0, 2.0, 3.0]) * k for k in (1, 10, 100)))
    point = JointTrajectoryPoint(positions=(-1.0, -2.0, -3.0), effort=(-5.0,))

    after = take_targets(before, point, ("c", "x", "a"), {"a": 0, "b": 1, "c": 2})

    assert after.position.tolist() == [-3.0, 2.0, -1.0]
    assert after.velocity.tolist() == [10.0, 20.0, 30.0]
    assert after.effort.tolist() == [100.0, 200.0, -5.0]
    assert before.position.tolist() == [1.0, 2.0, 3.0]
