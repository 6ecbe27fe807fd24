"""Trajectories that replace one that is being followed (spec C1.10, D4: C31 to C37)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from arm_drake.control.trajectory import (
    Replacement,
    StateBefore,
    Trajectory,
    blend,
    in_joint_order,
    positions_or,
)
from arm_drake.messages import GoalStatus, JointTrajectory, JointTrajectoryPoint
from tests.control.joint_trajectory_runs import (
    JOINTS,
    START,
    commands,
    feedback,
    make_goal,
    make_message,
    make_rules,
    news,
    references,
    run,
)

S = 1_000_000_000
PAIR = ("a", "b")
BLENDS = {"allow_replacement": True}

# Moves a from 0 to 1 in the first second, to 3 in the next; b does twice as much.
OLD = Trajectory.from_message(
    make_message((1.0, (1.0, 2.0)), (2.0, (3.0, 6.0)), joints=PAIR),
    StateBefore(0, np.zeros(2)),
    now_ns=0,
)


def blended(
    *points: tuple[float, Sequence[float]],
    joints: tuple[str, ...] = PAIR,
    at: float = 0.5,
    delay: float = 0.0,
    **fields: Any,
) -> Replacement | None:
    return blend(
        make_message(*points, joints=joints, **fields),
        OLD,
        PAIR,
        np.array([-1.0, -2.0]),
        cursor_ns=round(at * S),
        delay_ns=round(delay * S),
        cursor=0,
        seen=0,
    )


def rows(replacement: Replacement | None) -> list[tuple[float, tuple[float, ...]]]:
    assert replacement is not None
    points = replacement.message.points
    return [(p.time_from_start.to_seconds(), p.positions) for p in points]


def test_a_new_trajectory_starts_with_a_bridge() -> None:
    replacement = blended((1.0, (5.0, 5.0)))

    assert rows(replacement) == [(0.0, (0.5, 1.0)), (1.0, (5.0, 5.0))]
    assert replacement is not None
    assert replacement.num_prefix == 1
    assert replacement.message.points[0].velocities == (1.0, 2.0)
    assert replacement.message.points[0].accelerations == (0.0, 0.0)


def test_a_first_point_that_is_due_at_once_needs_no_bridge() -> None:
    replacement = blended((0.0, (5.0, 5.0)), (1.0, (6.0, 6.0)))

    assert rows(replacement) == [(0.0, (5.0, 5.0)), (1.0, (6.0, 6.0))]


def test_until_the_handoff_the_old_points_stay() -> None:
    replacement = blended((1.0, (5.0, 5.0)), delay=1.0)

    # The old point at 1 s, and a bridge at 1.5 s.
    assert rows(replacement) == [
        (0.5, (1.0, 2.0)),
        (1.0, (2.0, 4.0)),
        (2.0, (5.0, 5.0)),
    ]
    assert replacement is not None
    assert replacement.num_prefix == 2


def test_joints_that_are_left_out_follow_the_old_trajectory_to_its_end() -> None:
    replacement = blended((0.5, (9.0,)), joints=("b",))

    assert rows(replacement) == [
        (0.0, (0.5, 1.0)),
        (0.5, (1.0, 9.0)),
        (1.5, (3.0, 9.0)),
    ]


def test_joints_that_are_left_out_need_positions_at_the_end() -> None:
    point = JointTrajectoryPoint(velocities=(1.0,), time_from_start=1.0)
    message = JointTrajectory(joint_names=("b",), points=(point,))

    none = blend(
        message, OLD, PAIR, np.zeros(2), cursor_ns=0, delay_ns=0, cursor=0, seen=0
    )

    assert none is None


def test_points_are_put_in_the_order_of_the_controller() -> None:
    message = make_message((1.0, (5.0, 6.0)), joints=("b", "a"), velocities=(1.0, 2.0))

    ordered = in_joint_order(message, PAIR, np.zeros(2))

    assert ordered.joint_names == PAIR
    assert ordered.points[0].positions == (6.0, 5.0)
    assert ordered.points[0].velocities == (2.0, 1.0)


def test_joints_that_are_left_out_stay_without_blending() -> None:
    message = make_message((1.0, (5.0,)), joints=("b",), velocities=(1.0,))

    ordered = in_joint_order(message, PAIR, np.array([7.0, 8.0]))

    assert ordered.points[0].positions == (7.0, 5.0)
    assert ordered.points[0].velocities == (0.0, 1.0)
    assert ordered.points[0].accelerations == ()


def test_where_nothing_is_commanded_the_measured_position_counts() -> None:
    measured = np.array([1.0, 2.0])

    assert positions_or(None, measured) is measured
    merged = positions_or(np.array([np.nan, 5.0]), measured)
    assert merged.tolist() == [1.0, 5.0]


def test_a_motion_goes_on_without_a_jump_under_scaling() -> None:  # C31
    old = make_message((1.0, (11.1, 12.1, 13.1)), (2.0, (21.1, 22.1, 23.1)))
    new = make_message((1.0, (5.0, 6.0, 7.0)))

    states = run(
        make_rules(**BLENDS), 2.0, topic={0.0: old, 1.0: new}, factors={0.0: 0.5}
    )

    steps = np.abs(np.diff(references(states)[95:105], axis=0))
    assert steps.max() < 0.3
    assert states[-1].plan.num_prefix > 0


def test_until_a_stamp_in_the_future_the_old_trajectory_goes_on() -> None:  # C32
    old = make_message((0.5, (10.0, 10.0, 10.0)), (1.0, (0.0, 0.0, 0.0)))
    new = make_message((0.5, (-5.0, -5.0, -5.0)), stamp=1.5)

    states = run(make_rules(**BLENDS), 2.2, topic={0.0: old, 0.05: new})

    assert commands(states)[:140, 0].max() > 8.0
    assert commands(states)[-1].tolist() == [-5.0] * 3


def test_joints_of_a_partial_goal_keep_moving() -> None:  # C33
    rules = make_rules(allow=["partial_joints_goal"], **BLENDS)
    old = make_message((1.5, (11.1, 12.1, 13.1)), (3.0, (21.1, 22.1, 23.1)))
    new = make_message((0.9, (1.0, 2.0)), joints=JOINTS[:2])

    states = run(rules, 3.5, topic={0.0: old, 0.5: new})

    assert np.ptp(references(states)[140:200, 2]) > 0.5
    assert commands(states)[-1] == pytest.approx([1.0, 2.0, 23.1], rel=1e-9)


def test_without_blending_the_joints_of_a_partial_goal_stay() -> None:
    rules = make_rules(allow=["partial_joints_goal"])
    old = make_message((1.5, (11.1, 12.1, 13.1)), (3.0, (21.1, 22.1, 23.1)))
    new = make_message((0.9, (1.0, 2.0)), joints=JOINTS[:2])

    states = run(rules, 3.5, topic={0.0: old, 0.5: new})

    assert commands(states)[-1, 2] == pytest.approx(commands(states)[49, 2], rel=1e-9)


def test_a_far_handoff_of_a_partial_goal_lets_the_old_one_peak() -> None:  # C34
    rules = make_rules(allow=["partial_joints_goal"], **BLENDS)
    old = make_message((1.0, (5.0,) * 3), (2.0, (50.0,) * 3))
    new = make_message((3.0, (-5.0, -5.0)), joints=JOINTS[:2], stamp=1.5)

    states = run(rules, 5.0, topic={0.0: old, 0.1: new})

    assert commands(states)[:, 0].max() == pytest.approx(27.5, abs=2.0)
    assert commands(states)[-1].tolist() == [-5.0, -5.0, 50.0]


@pytest.mark.parametrize("allow_replacement", [True, False])
def test_a_trajectory_of_one_point_is_replaced_at_once(allow_replacement: bool) -> None:
    old, new = make_message((1.0, (2.0, 3.0, 4.0))), make_message((1.0, START))

    states = run(
        make_rules(allow_replacement=allow_replacement), 1.0, topic={0.0: old, 0.5: new}
    )

    assert states[-1].plan.num_prefix == 0
    assert len(states[-1].plan.trajectory.times_ns) == 1


def test_indices_of_feedback_count_the_points_of_the_goal() -> None:  # A13
    old = make_goal(make_message((0.3, (2.0, 3.0, 4.0)), (0.6, (3.0, 4.0, 5.0))))
    new = make_goal(make_message((0.2, START), (0.4, (2.0, 3.0, 4.0))))

    states = run(make_rules(**BLENDS), 1.0, requests={0.0: old, 0.12: new})

    assert news(states, old)[-1][1] is GoalStatus.ABORTED
    assert news(states, new)[-1][1] is GoalStatus.SUCCEEDED
    assert states[20].plan.num_prefix == 1
    assert [f.index for k, f in feedback(states) if k > 12] == [0, 0, 0, 0, 1, 1, 1]


def test_a_handoff_in_the_future_comes_on_scaled_time() -> None:
    old = make_message((0.5, (2.0, 3.0, 4.0)), (1.0, (3.0, 4.0, 5.0)))
    new = make_message((1.0, START), stamp=0.5)

    states = run(
        make_rules(**BLENDS), 0.2, topic={0.0: old, 0.2: new}, factors={0.0: 0.5}
    )

    # At 0.19 s the old trajectory is at 0.095 s; 0.3 s are 0.15 s on it.
    points = states[-1].plan.trajectory.message.points
    times = [p.time_from_start.to_seconds() for p in points]
    assert times == pytest.approx([0.15, 1.15], abs=1e-9)


def test_points_that_were_not_reached_are_integrated_anew() -> None:
    points = [
        JointTrajectoryPoint(velocities=(v, v), time_from_start=t)
        for t, v in ((1.0, 1.0), (2.0, 1.0), (3.0, 1.0))
    ]
    message = JointTrajectory(joint_names=PAIR, points=points)
    old = Trajectory.from_message(
        message, StateBefore(0, np.zeros(2), np.zeros(2)), now_ns=0
    )

    replacement = blend(
        make_message((1.0, (9.0, 9.0)), joints=PAIR),
        old,
        PAIR,
        np.zeros(2),
        cursor_ns=round(0.5 * S),
        delay_ns=2 * S,
        cursor=0,
        seen=0,
    )

    assert replacement is not None
    prefix = replacement.message.points[: replacement.num_prefix]
    assert [p.positions for p in prefix[:2]] == [(0.5, 0.5), ()]


@pytest.mark.parametrize(
    ("last", "velocities"),
    [({"velocities": (1.0, 1.0)}, (0.0, 0.0)), ({"positions": (2.0, 2.0)}, ())],
)
def test_a_point_before_the_handoff_that_an_integration_completes_stays_so(
    last: dict[str, Any], velocities: tuple[float, ...]
) -> None:
    points = [
        JointTrajectoryPoint(positions=(1.0, 1.0), time_from_start=0.5),
        JointTrajectoryPoint(positions=(1.0, 1.0), time_from_start=1.0),
        JointTrajectoryPoint(**last, time_from_start=2.0),
    ]
    message = JointTrajectory(joint_names=PAIR, points=points)
    old = Trajectory.from_message(message, StateBefore(0, np.zeros(2)), now_ns=0)

    replacement = blend(
        make_message((1.0, (9.0, 9.0)), joints=PAIR),
        old,
        PAIR,
        np.zeros(2),
        cursor_ns=round(0.2 * S),
        delay_ns=round(0.9 * S),
        cursor=0,
        seen=0,
    )

    assert replacement is not None
    prefix = replacement.message.points[: replacement.num_prefix]
    assert [p.velocities for p in prefix[:2]] == [(), velocities]
