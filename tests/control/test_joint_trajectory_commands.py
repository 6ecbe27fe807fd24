"""Commands besides positions (spec D4: C6 to C9, C11, C39)."""

import dataclasses as dc
import types
from collections.abc import Sequence
from math import nan, pi
from typing import Any

import numpy as np
import pytest

from arm_drake.control.pid import Pid
from arm_drake.controllers.joint_trajectory.controller import activate, deactivate, tick
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryRules,
    JointTrajectoryState,
    TickInputs,
    make_controller_state,
)
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint
from tests.control.joint_trajectory_runs import (
    JOINTS,
    PERIOD_NS,
    START,
    commands,
    make_message,
    make_rules,
    references,
    run,
    stick,
)

AT_REST = (0.0, 0.0, 0.0)

# Upstream's own test: three points without velocities, with efforts.
POINTS = ((0.3, (3.3, 4.4, 6.6)), (0.6, (7.7, 8.8, 9.9)), (0.9, (10.1, 11.11, 12.12)))
EFFORTS = ((0.3, 0.4, 0.6), (1.7, 1.8, 1.9), (2.1, 2.2, 2.3))


def make_pid(p: float = 10.0, i: float = 0.0, d: float = 0.0, n: int = 3) -> Pid:
    gains = types.SimpleNamespace(
        p=p,
        i=i,
        d=d,
        u_clamp_max=np.inf,
        u_clamp_min=-np.inf,
        i_clamp_max=np.inf,
        i_clamp_min=-np.inf,
        error_deadband=0.0,
        tracking_time_constant=0.0,
        antiwindup_strategy="none",
        antiwindup=False,
    )
    return Pid.from_gains([gains] * n)


def pid_rules(interface: str, *, scale: float = 0.0, **changes: Any) -> Any:
    return make_rules(
        command_interfaces=(interface,),
        pid=make_pid(),
        ff_velocity_scale=np.full(3, scale),
        **changes,
    )


def with_efforts() -> JointTrajectory:
    points = [
        JointTrajectoryPoint(q, effort=u, time_from_start=t)
        for (t, q), u in zip(POINTS, EFFORTS, strict=True)
    ]
    return JointTrajectory(joint_names=JOINTS, points=points)


def make_rules_with_efforts(rules: JointTrajectoryRules) -> JointTrajectoryRules:
    allowed = dc.replace(rules.allowed, has_effort_command=True)
    return dc.replace(rules, allowed=allowed)


def run_pid(rules: JointTrajectoryRules, message: JointTrajectory) -> Any:
    return run(rules, 0.3, plant=stick, velocity=AT_REST, topic={0.0: message})


def test_a_pid_of_velocities_acts_on_the_error() -> None:  # C6
    states = run_pid(pid_rules("velocity"), make_message(*POINTS))

    assert commands(states)[-1] == pytest.approx([22.0, 23.0, 35.0], rel=1e-9)


def test_a_pid_of_continuous_joints_takes_the_short_way() -> None:  # C7
    rules = pid_rules("velocity", wraparound=np.array([False, False, True]))

    states = run_pid(rules, make_message(*POINTS))

    # The start of joint3 moved by a turn, so that the reference gets there.
    assert states[-1].error == pytest.approx([2.2, 2.3, 3.5 - 2 * pi], rel=1e-9)
    assert commands(states)[-1][2] == pytest.approx(10.0 * (3.5 - 2 * pi), rel=1e-9)


def test_velocities_ahead_are_added_to_a_pid_of_velocities() -> None:
    rules = pid_rules("velocity", scale=2.0)

    states = run_pid(rules, make_message(*POINTS))

    # At 0.3 s the look-ahead is in the second segment.
    rates = (np.array([7.7, 8.8, 9.9]) - [3.3, 4.4, 6.6]) / 0.3
    expected = np.array([22.0, 23.0, 35.0]) + 2.0 * rates
    np.testing.assert_allclose(commands(states)[-1], expected, rtol=1e-9)


def test_efforts_ahead_are_added_to_a_pid_of_efforts() -> None:  # C8
    rules = make_rules_with_efforts(pid_rules("effort"))

    states = run_pid(rules, with_efforts())

    ahead = np.array(EFFORTS[0]) + (np.array(EFFORTS[1]) - EFFORTS[0]) / 30
    expected = np.array([22.0, 23.0, 35.0]) + ahead
    np.testing.assert_allclose(commands(states)[-1], expected, rtol=1e-9)


def test_efforts_beside_positions_are_those_of_the_present() -> None:  # C9
    rules = make_rules_with_efforts(
        make_rules(command_interfaces=("position", "effort"))
    )

    states = run_pid(rules, with_efforts())

    present = np.concatenate([references(states)[-1], EFFORTS[0]])
    assert commands(states)[-1][3:] == pytest.approx(present[3:], rel=1e-9)
    # Positions are those of the next tick.
    way = (np.array([7.7, 8.8, 9.9]) - [3.3, 4.4, 6.6]) / 30
    np.testing.assert_allclose(commands(states)[-1][:3], present[:3] + way, rtol=1e-9)


def test_integrals_grow_while_gains_change() -> None:
    old = pid_rules("effort")
    new = make_rules(command_interfaces=("effort",), pid=make_pid(p=0.0, i=5.0))
    measured, at_rest = np.array(START), np.zeros(3)
    message = make_message((0.0, tuple(q + 1.0 for q in START)))

    state = tick(
        new,
        JointTrajectoryState(),
        TickInputs(0, PERIOD_NS, measured, at_rest, topics=(message,)),
    )
    for k in range(1, 4):
        rules = old if k == 3 else new
        state = tick(
            rules, state, TickInputs(k * PERIOD_NS, PERIOD_NS, measured, at_rest)
        )

    # Three ticks of 5 * 1 * 0.01, then 10 * 1 on top.
    np.testing.assert_allclose(state.command, 3 * 0.05 + 10.0, rtol=1e-9)


@pytest.mark.parametrize(
    ("interfaces", "columns"),
    [
        (("position", "velocity"), ["q", "v"]),
        (("velocity", "position"), ["v", "q"]),
        (("position", "velocity", "acceleration"), ["q", "v", "a"]),
    ],
)
def test_commands_come_interface_by_interface(
    interfaces: tuple[str, ...], columns: list[str]
) -> None:
    rules = make_rules(command_interfaces=interfaces)
    message = make_message((1.0, (2.1, 3.1, 4.1)), velocities=AT_REST)

    states = run(rules, 0.2, velocity=AT_REST, topic={0.0: message})

    s = 0.21
    expected = {
        "q": np.array(START) + 3 * s**2 - 2 * s**3,
        "v": np.full(3, 6 * s - 6 * s**2),
        "a": np.full(3, 6 - 12 * s),
    }
    row = np.concatenate([expected[name] for name in columns])
    np.testing.assert_allclose(commands(states)[-1], row, rtol=1e-9)


def test_only_some_joints_are_commanded() -> None:
    rules = make_rules(commanded_joints=(2, 0))
    message = make_message((0.1, (2.0, 3.0, 4.0)))

    states = run(rules, 0.2, plant=stick, topic={0.0: message})

    assert commands(states)[-1].tolist() == [4.0, 2.0]
    output = make_controller_state(rules, states[-1]).output.positions
    np.testing.assert_array_equal(output, [2.0, nan, 4.0])


def test_output_stays_what_it_was_while_a_command_is_not_finite() -> None:
    rules = pid_rules("velocity")
    states = run(rules, 0.1, plant=stick, velocity=AT_REST)
    lost = TickInputs(11 * PERIOD_NS, PERIOD_NS, np.array([nan, 2.1, 3.1]), np.zeros(3))

    state = tick(rules, states[-1], lost)

    assert np.isnan(state.command[0])
    assert make_controller_state(rules, state).output.velocities == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("interfaces", "expected"),
    [
        (("position",), [nan] * 3),
        (("position", "velocity"), [nan] * 3 + [0.0] * 3),
        (("effort",), [0.0] * 3),
    ],
)
def test_a_deactivation_stops_all_but_positions(
    interfaces: tuple[str, ...], expected: Sequence[float]
) -> None:
    rules = make_rules(command_interfaces=interfaces)
    inputs = TickInputs(0, PERIOD_NS, np.array(START), np.zeros(3))
    state = activate(rules, JointTrajectoryState(), inputs)

    state = deactivate(rules, state)

    np.testing.assert_array_equal(state.command, expected)


@pytest.mark.parametrize(
    ("present", "position", "velocity"),
    [
        ([3.1, 4.1, 5.1, 0.25, 1.25, 2.25], (3.1, 4.1, 5.1), (0.25, 1.25, 2.25)),
        ([3.1, nan, 5.1, 0.25, 1.25, 2.25], START, (0.25, 1.25, 2.25)),
        ([3.1, 4.1, 5.1, 0.25, nan, 2.25], (3.1, 4.1, 5.1), (0.1, 0.2, 0.3)),
    ],
)
def test_an_activation_goes_on_from_commands_that_are_all_known(  # C20, C21
    present: list[float], position: Sequence[float], velocity: Sequence[float]
) -> None:
    rules = make_rules(command_interfaces=("position", "velocity"))
    measured = np.array([0.1, 0.2, 0.3])
    inputs = TickInputs(
        0, PERIOD_NS, np.array(START), measured, commands=lambda: np.array(present)
    )

    state = activate(rules, JointTrajectoryState(), inputs)

    assert tuple(state.commanded.positions) == tuple(position)
    assert tuple(state.commanded.velocities) == tuple(velocity)
    assert state.plan.pending.points[0].positions == tuple(position)
    assert state.plan.pending.points[0].velocities == AT_REST


def test_an_activation_starts_from_what_is_measured_if_asked() -> None:  # C22
    rules = make_rules(starts_from_commands=False)
    inputs = TickInputs(0, PERIOD_NS, np.array(START), commands=lambda: np.zeros(3))

    state = tick(rules, JointTrajectoryState(), inputs)

    assert state.command.tolist() == list(START)
