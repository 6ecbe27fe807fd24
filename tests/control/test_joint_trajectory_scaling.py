"""The speed of time along trajectories (spec C1.14, D4: C23 to C25)."""

from math import inf, nan

import numpy as np
import pytest

from arm_drake.control.trajectory import scaled
from arm_drake.controllers.joint_trajectory.controller import tick
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
)
from arm_drake.messages import (
    GoalStatus,
    JointTrajectory,
    JointTrajectoryPoint,
    SpeedScalingFactor,
    TopicRejected,
)
from tests.control.joint_trajectory_runs import (
    PERIOD_NS,
    START,
    make_goal,
    make_message,
    make_rules,
    news,
    references,
    run,
)


@pytest.mark.parametrize("factor", [0.25, 0.87, 1.0, 2.0])
def test_a_reference_is_that_of_the_scaled_time(factor: float) -> None:  # C25
    message = make_message((0.1, (4.0, 5.0, 6.0)), (0.2, (7.0, 8.0, 9.0)))

    states = run(make_rules(), 1.0, topic={0.0: message}, factors={0.0: factor})

    t = (np.arange(101) * factor / 100)[:, None]
    first = START + (np.array([4.0, 5.0, 6.0]) - START) * t / 0.1
    second = np.array([4.0, 5.0, 6.0]) + 3.0 * ((t - 0.1) / 0.1).clip(0.0, 1.0)
    expected = np.where(t < 0.1, first, second)
    # Time is cut to whole nanoseconds in every tick.
    np.testing.assert_allclose(references(states), expected, rtol=0, atol=1e-5)


def test_a_scaled_goal_succeeds_later() -> None:
    goal = make_goal(make_message((0.1, (4.0, 5.0, 6.0))))

    states = run(make_rules(), 1.0, requests={0.0: goal}, factors={0.0: 0.25})

    # The look-ahead, which isn't scaled, sees the end 10 ms of the trajectory early.
    done = next(k for k, s in enumerate(states) if s.goal and s.goal.outcome)
    assert done == 36
    assert news(states, goal)[-1][:2] == (40, GoalStatus.SUCCEEDED)


def test_a_factor_of_0_pauses() -> None:
    message = make_message((0.5, (2.1, 3.1, 4.1)))

    states = run(make_rules(), 0.5, topic={0.0: message}, factors={0.2: 0.0, 0.4: 1.0})

    # The tick that gets the factor is the first that pauses.
    assert np.ptp(references(states)[19:40], axis=0).tolist() == [0.0] * 3
    np.testing.assert_allclose(references(states)[-1], np.add(START, 0.6), rtol=1e-9)


@pytest.mark.parametrize("factor", [-0.12, nan, inf])
def test_a_bad_factor_is_refused(factor: float) -> None:  # C23
    states = run(make_rules(), 0.3, factors={0.1: 0.45, 0.2: factor})

    ((_, event),) = states[-1].events
    assert isinstance(event, TopicRejected)
    assert event.reason == (
        f"factor is {factor}; expected at least 0, 1 being full speed"
    )
    assert states[-1].scaling_factor == 0.45


def test_speed_is_scaled_where_positions_alone_are_commanded() -> None:
    rules = make_rules(
        command_interfaces=("position", "velocity"), initial_scaling_factor=0.5
    )

    states = run(rules, 0.2, factors={0.1: 0.45})

    ((_, event),) = states[-1].events
    assert event.reason == (
        "speed is scaled where positions alone are commanded, not "
        "['position', 'velocity']"
    )
    assert states[-1].scaling_factor == 1.0


def test_the_state_interface_has_the_last_word() -> None:  # C24
    rules = make_rules(
        initial_scaling_factor=0.123, has_scaling_state=True, has_scaling_command=True
    )
    state = JointTrajectoryState()
    seen = []
    for k, servo_input in enumerate([1.0, 0.123, nan, 0.5]):
        inputs = TickInputs(
            k * PERIOD_NS,
            PERIOD_NS,
            np.array(START),
            scaling_factors=(SpeedScalingFactor(0.8),) if k == 2 else (),
            scaling_state=servo_input,
        )
        state = tick(rules, state, inputs)
        seen.append((state.scaling_factor, state.speed_scaling_command))

    assert seen == [(1.0, 0.123), (0.123, 0.123), (0.123, 0.8), (0.5, 0.8)]


def test_a_slow_reference_sees_what_the_look_ahead_has_integrated() -> None:
    points = [
        JointTrajectoryPoint((0.3,), (0.5,), time_from_start=0.05),
        JointTrajectoryPoint((0.5,), time_from_start=0.1),
        JointTrajectoryPoint(velocities=(0.0,), time_from_start=0.2),
    ]
    message = JointTrajectory(joint_names=("a",), points=points)
    rules = make_rules(("a",), allow=["integration_in_goal_trajectories"])

    states = run(rules, 0.5, start=[0.3], topic={0.0: message}, factors={0.0: 0.3})

    # From 0.093 s on the look-ahead of the tick before has been beyond 0.1 s: the point
    # there has a velocity of 0 since.
    t = np.arange(17, 34) * 0.003
    s = (t - 0.05) / 0.05
    line, curve = 0.3 + 0.2 * s, 0.3 + 0.025 * s + 0.55 * s**2 - 0.375 * s**3
    expected = np.where(t < 0.0935, line, curve)[:, None]
    # Time is cut to whole nanoseconds in every tick.
    np.testing.assert_allclose(references(states)[17:34], expected, rtol=0, atol=1e-5)


def test_a_tick_without_a_reference_reads_the_state_all_the_same() -> None:
    rules = make_rules(("a",), has_scaling_state=True)
    state = JointTrajectoryState()
    for k, (position, velocity) in enumerate([(0.1, 1.0), (0.2, 2.0)]):
        inputs = TickInputs(
            k * PERIOD_NS,
            PERIOD_NS,
            np.array([position]),
            np.array([velocity]),
            np.array([3.0 * velocity]),
            # Time runs back to before the start.
            scaling_state=1.0 if k == 0 else -1.0,
        )
        state = tick(rules, state, inputs)

    assert (state.time_ns, state.clock_ns) == (PERIOD_NS, -PERIOD_NS)
    assert (state.position, state.velocity, state.acceleration) == (0.2, 2.0, 6.0)


@pytest.mark.parametrize(
    ("duration", "factor", "expected"),
    [
        (10_000_000, 1.0, 10_000_000),
        (10_000_000, 0.5, 5_000_000),
        # The float 0.3 is less than 3/10, and 0.7 less than 7/10.
        (10_000_000, 0.3, 2_999_999),
        (10_000_000, 0.7, 6_999_999),
        (10_000_000, 0.1, 1_000_000),
        (10_000_000, 0.0, 0),
        (1, 0.999, 0),
        # Towards zero.
        (10_000_000, -0.3, -2_999_999),
    ],
)
def test_scaled_time_is_cut_to_whole_nanoseconds(
    duration: int, factor: float, expected: int
) -> None:
    assert scaled(duration, factor) == expected
