import copy
from collections.abc import Sequence
from math import inf, nan, pi, sqrt
from typing import Any

import numpy as np
import pytest

from arm_drake.control.trajectory import (
    StateBefore,
    Trajectory,
    shortest_angular_distance,
    wrap_state_before,
)
from arm_drake.controllers.joint_trajectory.goals import fill_cubic_spline_velocities
from arm_drake.messages import Header, JointTrajectory, JointTrajectoryPoint, Time

S = 1_000_000_000
LEAD = (0, 0)


def ns(seconds: float) -> int:
    return round(seconds * S)


def make_message(*points: tuple[float, dict[str, Any]], stamp: float = 0.0):
    """Return a message; a point is its time [s] and its fields, single numbers too."""
    return JointTrajectory(
        header=Header(stamp=Time.of(stamp)),
        points=tuple(
            JointTrajectoryPoint(
                **{field: np.atleast_1d(value) for field, value in fields.items()},
                time_from_start=time,
            )
            for time, fields in points
        ),
    )


def make_state(time: float = 0.0, **fields: float | Sequence[float]) -> StateBefore:
    arrays = {field: np.atleast_1d(value) * 1.0 for field, value in fields.items()}
    return StateBefore(ns(time), **{"positions": None, **arrays})


def make_trajectory(*points: tuple[float, dict[str, Any]], **before: Any) -> Trajectory:
    return Trajectory.from_message(
        make_message(*points), make_state(**before), now_ns=0
    )


def positions(*times_and_positions: tuple[float, float]) -> Any:
    return [(t, {"positions": q}) for t, q in times_and_positions]


LINES = positions((1, 1), (2, 2), (3, 3))
VELOCITIES = [(t, {"velocities": v}) for t, v in ((1, 1), (2, 2), (3, 1))]
ACCELERATIONS = [(t, {"accelerations": a}) for t, a in ((1, 1), (2, 2), (3, 1))]
ZERO = {"positions": 0.0}
REST = {"positions": 0.0, "velocities": 0.0}
# With a lead-in of no time, the only segment runs from 1 s to 3 s.
CUBIC = [
    (1, {"positions": 0, "velocities": -2}),
    (3, {"positions": 4, "velocities": 10, "accelerations": 0}),
]
QUINTIC = [
    (1, {"positions": 0, "velocities": 24, "accelerations": -100}),
    (3, {"positions": 0, "velocities": 4, "accelerations": 0}),
]
REST_TO_REST = [
    (t, {"positions": t, "velocities": 0, "accelerations": 0}) for t in (1, 2)
]
MIXED = [(1, {"positions": 1, "velocities": 1}), (2, {"positions": 2})]
REST_THEN_LINE = [(1, {"positions": 1, "velocities": 0}), (2, {"positions": 2})]


@pytest.mark.parametrize(
    ("points", "before", "time", "q", "v", "a", "segment"),
    [
        (LINES, ZERO, 0, 0, 1, 0, LEAD),
        (LINES, ZERO, 0.5, 0.5, 1, 0, LEAD),
        (LINES, ZERO, 1, 1, 1, 0, (0, 1)),
        (LINES, ZERO, 1.5, 1.5, 1, 0, (0, 1)),
        (LINES, ZERO, 2.5, 2.5, 1, 0, (1, 2)),
        (LINES, ZERO, 3, 3, 0, 0, (2, 3)),
        (LINES, ZERO, 3.125, 3, 0, 0, (2, 3)),
        (LINES, ZERO, 30, 3, 0, 0, (2, 3)),
        (VELOCITIES, REST, 0, 0, 0, 1, LEAD),
        (VELOCITIES, REST, 0.5, 0.125, 0.5, 1, LEAD),
        (VELOCITIES, REST, 1, 0.5, 1, 1, (0, 1)),
        (VELOCITIES, REST, 1.5, 1.125, 1.5, 1, (0, 1)),
        (VELOCITIES, REST, 2, 2, 2, -1, (1, 2)),
        (VELOCITIES, REST, 2.5, 2.875, 1.5, -1, (1, 2)),
        (VELOCITIES, REST, 3, 3.5, 1, 0, (2, 3)),
        (VELOCITIES, REST, 3.125, 3.5, 1, 0, (2, 3)),
        (VELOCITIES, ZERO, 0, 0, 0, 1, LEAD),
        (VELOCITIES, ZERO, 0.5, 0.125, 0.5, 1, LEAD),
        (VELOCITIES, ZERO, 1, 0.5, 1, 1, (0, 1)),
        (ACCELERATIONS, REST, 0, 0, 0, 0, LEAD),
        (ACCELERATIONS, REST, 0.5, 0.0625, 0.28125, 0.5, LEAD),
        (ACCELERATIONS, REST, 1, 0.25, 0.5, 1, (0, 1)),
        (ACCELERATIONS, REST, 2, 1.5, 2, 2, (1, 2)),
        (ACCELERATIONS, REST, 3, 4.25, 3.5, 1, (2, 3)),
        (ACCELERATIONS, REST, 3.125, 4.25, 3.5, 1, (2, 3)),
        (CUBIC, ZERO, 1, 0, -2, 0, (0, 1)),
        (CUBIC, ZERO, 1.5, -0.875, -1.25, 3, (0, 1)),
        (CUBIC, ZERO, 2, -1, 1, 6, (0, 1)),
        (CUBIC, ZERO, 1 + sqrt(2), 0, 4, 8.48528137, (0, 1)),
        (QUINTIC, ZERO, 1, 0, 24, -100, (0, 1)),
        (QUINTIC, ZERO, 1.5, 3.28125, -4.4375, -22.5, (0, 1)),
        (QUINTIC, ZERO, 2, 0, -6, 10, (0, 1)),
        (QUINTIC, ZERO, 2.5, -1.40625, 0.5625, 12.5, (0, 1)),
        (REST_TO_REST, ZERO, 0, 0, 0, 0, LEAD),
        (REST_TO_REST, ZERO, 0.25, 0.103515625, 1.0546875, 5.625, LEAD),
        (REST_TO_REST, ZERO, 0.5, 0.5, 1.875, 0, LEAD),
        (MIXED, REST | {"velocities": 1.0}, 0.5, 0.5, 1, 0, LEAD),
        (MIXED, REST, 1.25, 1.25, 1, 0, (0, 1)),
        (REST_THEN_LINE, REST, 0.5, 0.5, 1.5, 0, LEAD),
        (REST_THEN_LINE, REST, 1.25, 1.25, 1, 0, (0, 1)),
    ],
)
def test_samples_follow_the_documented_curves(points, before, time, q, v, a, segment):
    trajectory = make_trajectory(*points, **before)

    sample = trajectory.sample(ns(time))

    tolerance = 1e-8
    assert sample.position == pytest.approx([q], abs=tolerance)
    assert sample.velocity == pytest.approx([v], abs=tolerance)
    assert sample.acceleration == pytest.approx([a], abs=tolerance)
    assert (sample.segment_start, sample.segment_end) == segment


@pytest.mark.parametrize(
    ("points", "q", "v", "a"), [(CUBIC, 4, 10, 12), (QUINTIC, 0, 4, 0)]
)
def test_a_curve_ends_in_its_second_point(points, q, v, a):
    trajectory = make_trajectory(*points, **ZERO)

    sample = trajectory.sample(ns(3) - 1)

    # In 1 ns the numbers change by less than this.
    tolerance = 1e-6
    assert sample.position == pytest.approx([q], abs=tolerance)
    assert sample.velocity == pytest.approx([v], abs=tolerance)
    assert sample.acceleration == pytest.approx([a], abs=tolerance)


@pytest.mark.parametrize(
    ("time", "q", "segment"),
    [(0, 0, LEAD), (0.5, 0, LEAD), (1, 2, (0, 1)), (1.5, 2, (0, 1)), (2.5, 3, (1, 2))],
)
def test_without_interpolation_a_sample_is_the_next_point(time, q, segment):
    trajectory = Trajectory.from_message(
        make_message(*LINES), make_state(**ZERO), now_ns=0, interpolation="none"
    )

    sample = trajectory.sample(ns(time))

    assert sample.position == [q]
    assert (sample.velocity, sample.acceleration, sample.effort) == (None, None, None)
    assert (sample.segment_start, sample.segment_end) == segment


@pytest.mark.parametrize("time", [3, 3.125])
def test_without_interpolation_the_end_is_complete(time):
    trajectory = Trajectory.from_message(
        make_message(*LINES), make_state(**ZERO), now_ns=0, interpolation="none"
    )

    sample = trajectory.sample(ns(time))

    values = (sample.position, sample.velocity, sample.acceleration, sample.effort)
    assert values == ([3], [0], [0], [0])
    assert (sample.segment_start, sample.segment_end) == (2, 3)


def test_without_interpolation_the_last_position_is_integrated():
    trajectory = Trajectory.from_message(
        make_message((1, {"positions": 1, "velocities": 1}), (3, {"velocities": 2})),
        make_state(**ZERO),
        now_ns=0,
        interpolation="none",
    )

    sample = trajectory.sample(ns(3))

    assert sample.position == [1 + (1 + 2) / 2 * 2]


def test_without_interpolation_an_unknown_position_is_no_sample():
    trajectory = Trajectory.from_message(
        make_message(*VELOCITIES), make_state(**ZERO), now_ns=0, interpolation="none"
    )

    assert [trajectory.sample(ns(t)) for t in (1.5, 3)] == [None, None]


def test_without_interpolation_a_single_position_is_not_integrated():
    trajectory = Trajectory.from_message(
        make_message((1, {"velocities": 1})),
        make_state(**ZERO),
        now_ns=0,
        interpolation="none",
    )

    assert trajectory.sample(ns(1)) is None


@pytest.mark.parametrize("points", [LINES, VELOCITIES, ACCELERATIONS])
def test_nothing_is_sampled_before_the_start_state(points):
    trajectory = make_trajectory(*points, **ZERO)

    assert trajectory.sample(ns(-0.5)) is None


def test_without_interpolation_nothing_is_sampled_before_the_start_state():
    trajectory = Trajectory.from_message(
        make_message(*LINES), make_state(**ZERO), now_ns=0, interpolation="none"
    )

    assert trajectory.sample(ns(-0.5)) is None


def test_without_points_nothing_is_sampled():
    trajectory = make_trajectory(**ZERO)

    assert trajectory.sample(0) is None


@pytest.mark.parametrize(
    ("stamp", "start_ns"), [(2.000000002, 2_000_000_002), (0.0, 17)]
)
def test_a_stamp_of_zero_starts_at_the_first_sample(stamp, start_ns):
    message = make_message(stamp=stamp)

    trajectory = Trajectory.from_message(message, make_state(**ZERO), now_ns=17)

    assert trajectory.start_ns == start_ns


def test_a_lead_in_fills_the_wait_for_a_stamp_in_the_future():
    message = make_message((1, {"positions": 3}), stamp=5.0)
    trajectory = Trajectory.from_message(message, make_state(3, **ZERO), now_ns=ns(3))

    sample = trajectory.sample(ns(4))

    assert sample.position == pytest.approx([1])


def test_a_stamp_in_the_past_starts_in_the_middle():
    message = make_message(*LINES, stamp=5.0)
    trajectory = Trajectory.from_message(message, make_state(7.5, **ZERO), now_ns=0)

    sample = trajectory.sample(ns(7.5))

    assert sample.position == pytest.approx([2.5])


def test_a_last_segment_between_two_samples_still_counts():
    trajectory = make_trajectory(
        (1, {"positions": 0, "velocities": 1}),
        (2, {"velocities": 1}),
        (2.001, {"velocities": 1}),
        **ZERO,
    )

    samples = [trajectory.sample(ns(t)) for t in (0, 1.5, 2, 3)]

    # By 1 s at a velocity of 1, and 1 ms more.
    q = [sample.position.item() for sample in samples]
    assert q == pytest.approx([0.0, 0.5, 1.0, 1.001])


def test_velocities_without_any_position_are_no_trajectory():
    trajectory = make_trajectory(
        (0.001, {"velocities": 1}), (0.002, {"velocities": 1}), velocities=0.0
    )

    assert [trajectory.sample(ns(t)) for t in (0, 0.001, 10)] == [None, None, None]


def test_positions_are_known_from_the_first_point_that_has_them():
    trajectory = make_trajectory(*positions((1, 1), (2, 3)), velocities=0.0)

    assert trajectory.sample(ns(0.5)) is None
    assert trajectory.sample(ns(1.5)).position == pytest.approx([2])


def test_accelerations_without_velocities_give_zeros_as_upstream():
    points = [(t, {"positions": 5, "accelerations": 1}) for t in (1, 2)]
    trajectory = make_trajectory(*points, **ZERO)

    sample = trajectory.sample(ns(1.5))

    assert (sample.position, sample.velocity, sample.acceleration) == ([0], [0], [0])


def test_integrating_an_acceleration_starts_it_at_zero():
    trajectory = make_trajectory(
        (1, {"positions": 0, "velocities": 0}), (2, {"accelerations": 2}), **ZERO
    )

    sample = trajectory.sample(ns(1.5))

    # Twice the first segment of ACCELERATIONS; a cubic would have a velocity of 0.5.
    assert sample.position == pytest.approx([0.125])
    assert sample.velocity == pytest.approx([0.5625])


def test_integration_starts_at_the_start_state_when_point_0_is_past():
    points = [(t, {"velocities": 1}) for t in (1, 3)]
    trajectory = Trajectory.from_message(
        make_message(*points, stamp=10.0), make_state(12, **ZERO), now_ns=0
    )

    sample = trajectory.sample(ns(12))

    assert sample.position == pytest.approx([1])


def test_integrating_a_segment_completes_its_start_for_that_segment_only():
    trajectory = make_trajectory(
        (1, {"positions": 0, "velocities": 0}),
        (2, {"positions": 1}),
        (3, {"velocities": 2}),
        **ZERO,
    )

    before, after = (trajectory.sample(ns(t)) for t in (1.25, 2.5))

    # A straight line, though the point at its end now has a velocity of 0, and then
    # v = 2 tau from there.
    assert before.position == pytest.approx([0.25])
    assert after.position == pytest.approx([1.25])
    assert after.velocity == pytest.approx([1])


def test_who_comes_back_finds_what_an_integration_has_completed():
    trajectory = make_trajectory(
        (1, {"positions": 0, "velocities": 0}),
        (2, {"positions": 1}),
        (3, {"velocities": 2}),
        **ZERO,
    )

    after = trajectory.sample(ns(2.5))
    before = trajectory.sample(ns(1.25), seen=after.segment_end)

    # 3 s^2 - 2 s^3, for the point at its end now has a velocity of 0.
    assert before.position == pytest.approx([0.15625])
    assert (before.segment_start, before.segment_end) == (0, 1)


@pytest.mark.parametrize("value", [nan, inf])
@pytest.mark.parametrize("field", ["velocities", "accelerations"])
def test_what_a_segment_does_not_use_may_be_anything(field, value):
    start = {"positions": 1.0, "velocities": 0.0, field: value}
    points = [(1, {"positions": 2})]
    if field == "accelerations":
        points = [(1, {"positions": 2, "velocities": 0})]
    trajectory = make_trajectory(*points, **start)

    sample = trajectory.sample(ns(0.5))

    assert sample.position == pytest.approx([1.5])
    assert np.isfinite([sample.velocity, sample.acceleration]).all()


@pytest.mark.parametrize(
    ("inputs", "time", "effort"),
    [
        ((-4, 2, 6), 0.5, -1),
        ((None, 2, 6), 0.5, 1),
        ((-4, None, 6), 0.25, -3),
        ((-4, None, 6), 1.5, 3),
        ((-4, 2, None), 1.5, 1),
        ((-4, 2, 6), 2, 6),
        ((-4, 2, None), 2, 0),
    ],
)
def test_effort_runs_linearly_and_is_0_where_missing(inputs, time, effort):
    before, *later = ({} if u is None else {"effort": u} for u in inputs)
    points = [(t, ZERO | fields) for t, fields in zip((1, 2), later, strict=True)]
    trajectory = make_trajectory(*points, **ZERO, **before)

    sample = trajectory.sample(ns(time))

    assert sample.effort == pytest.approx([effort])


THREE_JOINTS = [
    (0.25, {"positions": (3.3, 4.4, 5.5), "velocities": (0.01,) * 3}),
    (0.5, {"positions": (7.7, 8.8, 9.9), "velocities": (0.05,) * 3}),
    (0.75, {"positions": (10.10, 11.11, 12.12), "velocities": (0.06,) * 3}),
]


@pytest.mark.parametrize(
    ("time", "q", "v"),
    [
        (0.01, (1.11027456, 2.11074176, 3.11120896), (2.026768, 2.118928, 2.211088)),
        (0.1, (1.87416, 2.90936, 3.94456), (12.6688, 13.2448, 13.8208)),
        (0.125, (2.1996875, 3.2496875, 4.2996875), (13.1975, 13.7975, 14.3975)),
        (0.24, (3.28962944, 4.38916224, 5.48869504), (2.035968, 2.128128, 2.220288)),
        (0.25, (3.3, 4.4, 5.5), (0.01,) * 3),
        (0.375, (5.49875, 6.59875, 7.69875), (26.385,) * 3),
        (0.625, (8.8996875, 9.9546875, 11.0096875), (14.3725, 13.8325, 13.2925)),
        (0.75, (10.10, 11.11, 12.12), (0.06,) * 3),
        (9.0, (10.10, 11.11, 12.12), (0.06,) * 3),
    ],
)
def test_joints_move_together(time, q, v):
    trajectory = make_trajectory(*THREE_JOINTS, positions=(1.1, 2.1, 3.1))

    sample = trajectory.sample(ns(time))

    assert sample.position == pytest.approx(q, rel=1e-9)
    assert sample.velocity == pytest.approx(v, rel=1e-9)


@pytest.mark.parametrize(
    ("time", "cursor", "q"),
    [
        (1.5, 0, 1.5),
        (2.5, 1, 2.5),  # in the cursor's own segment
        (1.5, 1, 3),  # in an earlier one: finished
        (2.5, 2, 3),
        (0.5, 2, 0.5),  # the lead-in isn't searched for
    ],
)
def test_the_search_starts_at_the_cursor(time, cursor, q):
    trajectory = make_trajectory(*LINES, **ZERO)

    sample = trajectory.sample(ns(time), cursor)

    assert sample.position == pytest.approx([q])


def test_a_point_that_repeats_a_time_is_jumped_to():
    trajectory = make_trajectory(*positions((1, 1), (1, 5), (2, 6)), **ZERO)

    samples = [trajectory.sample(t) for t in (S - 1, S)]

    assert samples[0].position == pytest.approx([1])
    assert samples[1].position == pytest.approx([5])
    assert (samples[1].segment_start, samples[1].segment_end) == (1, 2)


def test_a_continuous_joint_starts_next_to_the_first_point():
    trajectory = Trajectory.from_message(
        make_message((1, {"positions": (1.5 * pi, 1.5 * pi)})),
        make_state(positions=(0.0, 0.0)),
        now_ns=0,
        wraparound=np.array([True, False]),
    )

    sample = trajectory.sample(0)

    assert sample.position == pytest.approx([2 * pi, 0])


def test_a_first_point_without_positions_leaves_a_continuous_joint_alone():
    trajectory = Trajectory.from_message(
        make_message((1, {"velocities": 2})),
        make_state(positions=7.0),
        now_ns=0,
        wraparound=np.array([True]),
    )

    sample = trajectory.sample(0)

    assert sample.position == pytest.approx([7])


@pytest.mark.parametrize(
    ("current", "target", "wraparound", "expected"),
    [
        ([0], [1.5 * pi], [False], [0]),
        ([0], [1.5 * pi], [True], [2 * pi]),
        ([0, 0, 0], [1.5 * pi] * 3, [True, False, False], [2 * pi, 0, 0]),
        ([1.5 * pi], [1.5 * pi], [True], [1.5 * pi]),
        ([0], [pi], [True], [0]),
        ([pi], [0], [True], [pi]),
    ],
)
def test_wrapping_moves_by_the_full_turns_documented(
    current, target, wraparound, expected
):
    wrapped = wrap_state_before(
        np.array(current, float), np.array(target, float), np.array(wraparound)
    )

    assert wrapped == pytest.approx(expected)


@pytest.mark.parametrize(
    ("start", "end", "turn"),
    [
        (0, 1, 1),
        (1, 0, -1),
        (0, 1.5 * pi, -pi / 2),
        (0, -1.5 * pi, pi / 2),
        (0, pi, pi),
        (0, -pi, pi),
        (0.5, 0.5 + 6 * pi, 0),
    ],
)
def test_the_shortest_turn_is_at_most_half_a_turn(start, end, turn):
    distance = shortest_angular_distance(np.array([start]), np.array([end]))

    assert distance == pytest.approx([turn])


@pytest.mark.parametrize(
    ("times", "q", "velocities"),
    [
        ((0, 0.1, 0.2), (0, 0.1, 0.3), (0, 2.25, 0)),
        ((0, 0.1), (0, 0.5), (0, 0)),
        (np.arange(1, 6) / 30, (0, 0.1, 0.2, 0.1, 0), (0, 4.5, 0, -4.5, 0)),
        (
            np.arange(7) / 10,
            0.1 + 0.4 * np.sin(pi * np.arange(7) / 10),
            (0, 1.53126546, 0.92836120, 0.75528974, 0.40973502, -0.10243376, 0),
        ),
    ],
)
def test_spline_velocities_are_the_documented_ones(times, q, velocities):
    filled = fill_cubic_spline_velocities(np.array(times), np.array(q, float)[:, None])

    np.testing.assert_allclose(filled[:, 0], velocities, atol=5e-9)


def test_spline_velocities_make_accelerations_continuous():
    times = np.array([0.5, 0.7, 1.3, 1.4, 2.0])
    q = np.array([[0, 1], [2, -1], [1, 1], [3, 0], [0, 0]], float)
    velocities = fill_cubic_spline_velocities(times, q)
    points = [
        (float(t), {"positions": q_i, "velocities": v_i})
        for t, q_i, v_i in zip(times, q, velocities, strict=True)
    ]
    trajectory = make_trajectory(*points, positions=(0.0, 0.0))

    for time in times[1:-1]:
        left, right = (trajectory.sample(ns(time) + d) for d in (-1, 0))
        jump = right.acceleration - left.acceleration
        np.testing.assert_allclose(jump, 0, atol=1e-4)  # 1 ns of jerk


def test_a_spline_through_a_sine_has_continuous_accelerations():
    times = np.arange(7) / 10
    q = (0.1 + 0.4 * np.sin(pi * times))[:, None]
    v = fill_cubic_spline_velocities(times, q)

    # Of the cubic from A to B: 2 (3 (q_B - q_A) / h - 2 v_A - v_B) / h at A, and
    # alike at B.
    h, rise = 0.1, np.diff(q, axis=0) / 0.1
    at_start = 2.0 / h * (3.0 * rise - 2.0 * v[:-1] - v[1:])
    at_end = 2.0 / h * (v[:-1] + 2.0 * v[1:] - 3.0 * rise)

    np.testing.assert_allclose(at_end[:-1], at_start[1:], atol=1e-6)


@pytest.mark.parametrize(
    "times", [(), (1.0,), (0.0, 0.0, 0.0), (0.0, 0.2, 0.1)], ids=str
)
def test_spline_velocities_need_two_increasing_times(times):
    filled = fill_cubic_spline_velocities(np.array(times), np.ones((len(times), 1)))

    assert filled is None


def test_a_trajectory_can_not_change():
    trajectory = make_trajectory(*LINES, **ZERO)

    for time in (0.5, 3):
        with pytest.raises(ValueError, match="read-only"):
            trajectory.sample(ns(time)).position[0] = 1.0


def test_a_start_state_may_change_afterwards():
    state = make_state(**ZERO)
    trajectory = Trajectory.from_message(make_message(*LINES), state, now_ns=0)

    state.positions[0] = 9.0

    assert trajectory.sample(0).position == [0]


def test_a_copy_is_the_trajectory_itself():
    trajectory = make_trajectory(*LINES, **ZERO)

    assert copy.deepcopy(trajectory) is trajectory


def test_the_largest_numbers_are_no_warning():
    # Warnings are errors here.
    end = 1e-6, {"positions": 1e308, "velocities": 1e308}

    trajectory = make_trajectory(end, positions=0.0, velocities=0.0)

    assert trajectory.sample(ns(1)).position == pytest.approx([1e308])
