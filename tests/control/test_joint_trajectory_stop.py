"""Joints that are held or braked (spec C1.11, D4: C27 to C30)."""

import numpy as np
import pytest

from arm_drake.controllers.joint_trajectory.controller import tick
from arm_drake.controllers.joint_trajectory.goals import min_stop_points
from arm_drake.controllers.joint_trajectory.state import (
    Deceleration,
    JointTrajectoryState,
    TickInputs,
)
from arm_drake.messages import CancelGoal, GoalStatus
from tests.control.joint_trajectory_runs import (
    PERIOD_NS,
    START,
    commands,
    follow,
    make_goal,
    make_message,
    make_rules,
    news,
    run,
    stick,
)

BRAKES = Deceleration(np.array([10.0, 10.0, 10.0]), 2)


def cancel(rules, velocity, *, until: float = 0.4):
    """Return the states of joints that are cancelled at 0.1 s, and the goal."""
    goal = make_goal(make_message((1.0, (2.0, 3.0, 4.0))))
    return run(
        rules,
        until,
        plant=stick,
        velocity=velocity,
        requests={0.0: goal, 0.1: CancelGoal(goal)},
    ), goal


@pytest.mark.parametrize(
    ("velocity", "moved"),
    [
        ((0.2, 0.2, 0.2), (0.002, 0.002, 0.002)),
        ((-0.2, -0.2, -0.2), (-0.002, -0.002, -0.002)),
        ((0.2, -0.1, 0.0), (0.002, -0.0005, 0.0)),
    ],
)
def test_joints_stop_where_their_deceleration_takes_them(velocity, moved) -> None:
    states, goal = cancel(make_rules(deceleration=BRAKES), velocity)

    end = np.add(START, moved)
    np.testing.assert_allclose(commands(states)[-1], end, rtol=1e-12)
    assert news(states, goal)[-1][1] is GoalStatus.CANCELED
    assert states[-1].desired.velocity.tolist() == [0.0, 0.0, 0.0]


def test_a_braking_trajectory_has_a_point_per_period() -> None:  # C27
    states, _ = cancel(make_rules(deceleration=BRAKES), (0.2, 0.2, 0.2))

    points = states[-1].plan.trajectory.message.points
    first = [(p.positions[0], p.velocities[0], p.accelerations[0]) for p in points]
    expected = [(1.1, 0.2, -10.0), (1.1015, 0.1, -10.0), (1.102, 0.0, 0.0)]
    np.testing.assert_allclose(first, expected, rtol=1e-12, atol=1e-12)
    times = [p.time_from_start.to_nanoseconds() for p in points]
    assert times == [0, PERIOD_NS, 2 * PERIOD_NS]


def test_slower_joints_wait_for_the_slowest() -> None:
    states, _ = cancel(make_rules(deceleration=BRAKES), (0.4, -0.1, 0.0))

    points = states[-1].plan.trajectory.message.points
    assert [p.velocities[1] for p in points] == pytest.approx([-0.1, 0, 0, 0, 0])
    assert len(points) == 5


def test_a_braking_trajectory_is_never_shorter_than_those_before() -> None:
    rules = make_rules(deceleration=BRAKES)
    fast, slow = (make_goal(make_message((1.0, (2.0, 3.0, 4.0)))) for _ in range(2))
    state = JointTrajectoryState()
    sizes = []
    for k, (request, speed) in enumerate(
        [(fast, 0.9), (CancelGoal(fast), 0.1), (slow, 0.1), (CancelGoal(slow), 0.1)]
    ):
        inputs = TickInputs(
            k * PERIOD_NS,
            PERIOD_NS,
            np.array(START),
            np.full(3, speed),
            requests=(request,),
        )
        state = tick(rules, state, inputs)
        sizes.append(len(state.plan.trajectory.times_ns))

    # Each cancel brakes from what was measured in the tick before.
    assert sizes == [1, 10, 1, 10]


@pytest.mark.parametrize(
    ("rules", "velocity"),
    [
        (make_rules(deceleration=BRAKES), None),
        (make_rules(deceleration=BRAKES), (0.2, float("nan"), 0.2)),
        (make_rules(), (0.2, 0.2, 0.2)),
    ],
    ids=["velocities are not measured", "one is not known", "no decelerations"],
)
def test_joints_that_can_not_brake_are_held(rules, velocity) -> None:  # C30
    states, _ = cancel(rules, velocity)

    assert commands(states)[-1].tolist() == list(START)
    assert len(states[-1].plan.trajectory.times_ns) == 1


def test_a_path_that_is_left_is_braked_from_what_is_measured_then() -> None:
    rules = make_rules(deceleration=BRAKES, path=0.01)
    goal = make_goal(make_message((1.0, (2.1, 3.1, 4.1))))

    states = run(
        rules, 0.4, plant=stick, velocity=(0.2, 0.0, 0.0), requests={0.0: goal}
    )

    assert news(states, goal)[-1][1] is GoalStatus.ABORTED
    np.testing.assert_allclose(commands(states)[-1], [1.102, 2.1, 3.1], rtol=1e-12)


def test_the_longest_stop_sets_the_number_of_points() -> None:
    # 2 / 4 = 0.5 s, 2 / 8 = 0.25 s.
    decelerations, limits = np.array([4.0, 8.0]), np.array([2.0, 2.0])

    assert min_stop_points(decelerations, limits, PERIOD_NS) == 51


def test_after_a_success_holds_repeat_its_last_velocities() -> None:
    rules = make_rules(
        allow=["nonzero_velocity_at_trajectory_end"],
        command_interfaces=("position", "velocity"),
    )
    done = make_goal(make_message((0.1, START), velocities=(1.0, 2.0, 3.0)))
    stopped = make_goal(make_message((1.0, START), velocities=(0.0, 0.0, 0.0)))

    states = run(
        rules,
        0.5,
        plant=stick,
        requests={0.0: done, 0.2: stopped, 0.3: CancelGoal(stopped)},
    )

    assert news(states, stopped)[-1][1] is GoalStatus.CANCELED
    assert commands(states)[-1].tolist() == [*START, 1.0, 2.0, 3.0]


def test_a_hold_that_is_followed_already_has_no_new_start() -> None:
    goal = make_goal(make_message((1.0, (2.0, 3.0, 4.0))))
    rules, state = make_rules(), JointTrajectoryState()
    moved = np.array(START)
    for k in range(10):
        requests = (goal, CancelGoal(goal)) if k == 5 else ()
        inputs = TickInputs(k * PERIOD_NS, PERIOD_NS, moved, requests=requests)
        state = tick(rules, state, inputs)
        moved = moved + 0.01

    assert state.plan.trajectory.start_ns == 0
    # Held where the tick before the cancel saw the joints.
    np.testing.assert_allclose(state.command, np.add(START, 0.04), rtol=1e-12)


def test_a_braking_trajectory_gives_way_to_a_new_one() -> None:
    rules = make_rules(deceleration=BRAKES, allow_replacement=True)
    goal = make_goal(make_message((1.0, (2.0, 3.0, 4.0))))
    message = make_message((0.5, (2.0, 3.0, 4.0)))

    states = run(
        rules,
        0.8,
        plant=follow,
        velocity=(0.2, 0.2, 0.2),
        requests={0.0: goal, 0.1: CancelGoal(goal)},
        topic={0.11: message},
    )

    assert commands(states)[-1].tolist() == [2.0, 3.0, 4.0]
    assert states[-1].plan.is_holding is False


def test_a_braking_trajectory_is_not_blended() -> None:
    rules = make_rules(deceleration=BRAKES, allow_replacement=True)
    goal = make_goal(make_message((0.5, (2.0, 3.0, 4.0)), (1.0, (3.0, 4.0, 5.0))))

    states = run(
        rules,
        0.12,
        velocity=(0.2, 0.2, 0.2),
        requests={0.0: goal, 0.1: CancelGoal(goal)},
    )

    assert states[-1].plan.num_prefix == 0
    assert len(states[-1].plan.trajectory.times_ns) == 3


def test_a_braking_trajectory_has_points_for_the_greatest_velocities() -> None:
    braking = BRAKES._replace(num_points=51)

    states, _ = cancel(make_rules(deceleration=braking), (0.2, 0.2, 0.2))

    assert len(states[-1].plan.trajectory.times_ns) == 51
