"""The law of an admittance: upstream's numbers, closed forms, limit cases."""

import itertools
from typing import Any

import numpy as np
import pytest

from arm_drake.control.admittance import (
    AdmittanceFrames,
    AdmittanceRule,
    AdmittanceState,
)

Array = np.ndarray
EYE = np.eye(3)

# Rounding of some hundred additions of numbers around 1.
ROUNDING = 1e-12


def make_rule(**inputs: Any) -> AdmittanceRule:
    """Return a rule without filter and further damping."""
    fields: dict[str, Any] = {
        "selected_axes": [True] * 6,
        "mass": np.ones(6),
        "damping_ratio": np.full(6, 10.0 / (2.0 * np.sqrt(50.0))),
        "stiffness": np.full(6, 50.0),
        "is_mass_in_control_frame": True,
        "joint_damping": 0.0,
        "alpha": 0.0,
        "filter_coefficient": 1.0,
        "weight": 0.0,
        "center_of_gravity": np.zeros(3),
    }
    return AdmittanceRule(**{**fields, **inputs})


def make_frames(
    displacement: Array | None = None, J: Array | None = None, **rotations: Array
) -> AdmittanceFrames:
    """Return frames that are one, of six joints that move along and about x, y, z."""
    R = {"R_BS": EYE, "R_BC": EYE, "R_BG": EYE, "R_BW": EYE, **rotations}
    return AdmittanceFrames(
        **R,
        displacement=np.zeros(6) if displacement is None else displacement,
        jacobian=np.eye(6) if J is None else J,
    )


def along_x(force: float) -> Array:
    return np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])


def turn(axis: Array, angle: float) -> Array:
    """Return a rotation by Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return EYE + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


TURNED = turn(np.array([1.0, 2.0, -0.5]), 0.7)


def push(
    rule: AdmittanceRule, wrench: Array, num_steps: int, period: float, **how: Array
) -> list[AdmittanceState]:
    """Return the states of joints that are at once where they are commanded to be."""
    states = [AdmittanceState.initial(6)]
    for _ in range(num_steps):
        frames = make_frames(states[-1].position, **how)
        states.append(rule.step(states[-1], frames, wrench, period))
    return states


def test_damping_is_relative_to_the_critical_one() -> None:  # AD1
    rule = make_rule(damping_ratio=np.full(6, np.sqrt(0.5)))

    assert rule.damping == pytest.approx(np.full(6, 10.0), rel=1e-15)


def test_the_first_two_ticks_are_upstreams() -> None:  # AD2, AD3
    _, first, second = push(make_rule(), along_x(5.0), 2, 0.01)

    for state, numbers in (
        (first, (5.0, 0.05, 0.0005)),
        (second, (4.475, 0.09475, 0.0014475)),
    ):
        found = (state.acceleration[0], state.velocity[0], state.position[0])
        assert found == pytest.approx(numbers, rel=1e-14)
        assert not state.position[1:].any()


def test_a_larger_mass_moves_less() -> None:  # AD4
    light, heavy = (
        push(make_rule(mass=np.full(6, mass)), along_x(5.0), 10, 0.01)[-1]
        for mass in (1.0, 100.0)
    )

    assert 0.0 < heavy.position[0] < 0.1 * light.position[0]


def respond(
    t: Array, force: float, mass: float, damping: float, stiffness: float
) -> list[Array]:
    """Return x, x', x'', x''' and x'''' of M x'' + D x' + K x = F, from rest."""
    s, r = np.roots([mass, damping, stiffness]).astype(complex)
    scale = force / stiffness / (s - r)
    terms = [
        scale * (r * s**k * np.exp(s * t) - s * r**k * np.exp(r * t)) for k in range(5)
    ]
    x = [term.real for term in terms]
    return [force / stiffness + x[0], *x[1:]]


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.2, 0.7, 1.5])
@pytest.mark.parametrize("period", [0.01, 0.001])
def test_a_step_of_force_is_answered_as_by_mass_damper_and_spring(
    ratio: float, period: float
) -> None:
    M, K, F = 2.0, 200.0, 10.0
    D = 2.0 * ratio * np.sqrt(M * K)
    count = round(2.0 / period)
    rule = make_rule(
        mass=np.full(6, M), stiffness=np.full(6, K), damping_ratio=np.full(6, ratio)
    )

    found = np.array([s.position[0] for s in push(rule, along_x(F), count, period)])

    # The semi-implicit step is the recurrence x_{k+1} = a x_k - b x_{k-1} + h^2 F / M,
    # of which the exact answer leaves the residual r; its error is then at most what
    # r, and the error after the first step, make of it by the recurrence's own
    # impulse response g.
    h = period
    a, b = 2.0 - h * D / M - h * h * K / M, 1.0 - h * D / M
    g = [0.0, 1.0]
    for _ in range(count):
        g.append(a * g[-1] - b * g[-2])
    exact = respond(h * np.arange(count + 1), F, M, D, K)
    largest = [np.abs(x).max() for x in respond(np.linspace(0, 2, 4001), F, M, D, K)]
    # The largest values are found on a grid, hence a little more.
    residual = 1.01 * (h**3 * D / (2.0 * M) * largest[2] + h**4 / 12.0 * largest[4])
    first = 1.01 * (h * h * F / (2.0 * M) + h**3 / 6.0 * largest[3])
    bound = first * np.abs(g[:-1]) + residual * np.cumsum(np.abs(g[:-1]))
    error = np.abs(found - exact[0])
    assert (error <= bound + ROUNDING).all()
    # And the bound is no empty one.
    assert bound[-1] < 0.2 * F / K


@pytest.mark.slow
def test_the_error_of_the_integration_is_proportional_to_the_period() -> None:
    rule = make_rule(stiffness=np.full(6, 200.0))
    D = float(rule.damping[0])
    exact = respond(np.array([0.3]), 10.0, 1.0, D, 200.0)[0][0]

    errors = [
        push(rule, along_x(10.0), round(0.3 / h), h)[-1].position[0] - exact
        for h in (1e-3, 5e-4, 2.5e-4)
    ]

    # Of first order: halving the period halves the error, up to a part of the fastest
    # rate, 14 1/s, times the period.
    for larger, smaller in itertools.pairwise(errors):
        assert larger / smaller == pytest.approx(2.0, rel=0.02)


@pytest.mark.slow
def test_at_rest_the_spring_bears_the_force_in_the_control_frame() -> None:
    stiffness = np.array([100.0, 200.0, 400.0, 10.0, 20.0, 40.0])
    rule = make_rule(stiffness=stiffness, damping_ratio=np.ones(6))
    wrench = np.array([10.0, -5.0, 3.0, 0.5, 1.0, -1.0])

    last = push(rule, wrench, 4000, 0.005, R_BC=TURNED)[-1]

    R = np.kron(np.eye(2), TURNED)
    expected = R @ np.diag(1.0 / stiffness) @ R.T @ wrench
    # The slowest mode, of 10 N·m/rad, decays as exp(-sqrt(10) 20 s), below 1e-24.
    assert last.position == pytest.approx(expected, abs=ROUNDING)


def test_the_mass_is_that_of_the_control_frame() -> None:
    mass = np.array([1.0, 2.0, 4.0, 0.1, 0.2, 0.4])
    wrench = np.array([10.0, -5.0, 3.0, 0.5, 1.0, -1.0])

    state = push(make_rule(mass=mass), wrench, 1, 0.01, R_BC=TURNED)[-1]

    R = np.kron(np.eye(2), TURNED)
    expected = np.linalg.solve(R @ np.diag(mass) @ R.T, wrench)
    assert state.acceleration == pytest.approx(expected, abs=ROUNDING)


def test_the_mass_may_be_that_of_the_base() -> None:
    mass = np.array([1.0, 2.0, 4.0, 0.1, 0.2, 0.4])
    wrench = np.array([10.0, -5.0, 3.0, 0.5, 1.0, -1.0])
    rule = make_rule(mass=mass, is_mass_in_control_frame=False)

    state = push(rule, wrench, 1, 0.01, R_BC=TURNED)[-1]

    assert state.acceleration == pytest.approx(wrench / mass, abs=ROUNDING)


def test_along_other_axes_than_the_selected_ones_a_wrench_does_nothing() -> None:
    rule = make_rule(selected_axes=[True, False, True, False, True, False])
    wrench = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])

    state = push(rule, wrench, 1, 0.01)[-1]

    assert state.acceleration.tolist() == [1.0, 0.0, 3.0, 0.0, 5.0, 0.0]


def test_where_the_wrench_does_nothing_the_spring_still_pulls() -> None:
    rule = make_rule(selected_axes=[False] * 6)
    frames = make_frames(along_x(0.1))

    state = rule.step(AdmittanceState.initial(6), frames, along_x(7.0), 0.01)

    assert state.acceleration[0] == pytest.approx(-5.0)


def test_a_wrench_that_does_not_vary_is_approached_by_the_filter() -> None:
    rule = make_rule(filter_coefficient=0.05)
    wrench = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])

    states = push(rule, wrench, 30, 0.01)

    for k, state in enumerate(states):
        expected = wrench * (1.0 - 0.95**k)
        assert state.wrench_W == pytest.approx(expected, abs=ROUNDING)


def test_the_weight_of_the_tool_is_no_push() -> None:
    R_BW, R_BS = turn(np.array([0.0, 1.0, 1.0]), 0.4), TURNED
    R_BG = turn(np.array([3.0, 1.0, 0.0]), -1.1)
    center_G, weight = np.array([0.1, -0.2, 0.3]), 23.0
    rule = make_rule(weight=weight, center_of_gravity=center_G)
    # What the sensor feels of it, in its own axes.
    gravity_B = R_BW @ np.array([0.0, 0.0, -weight])
    torque_B = np.cross(R_BG @ center_G, gravity_B)
    wrench_S = np.append(R_BS.T @ gravity_B, R_BS.T @ torque_B)

    frames = make_frames(R_BS=R_BS, R_BG=R_BG, R_BW=R_BW)
    state = rule.step(AdmittanceState.initial(6), frames, wrench_S, 0.01)

    assert np.linalg.norm(wrench_S) > weight
    assert state.wrench_B == pytest.approx(np.zeros(6), abs=ROUNDING)


def test_a_wrench_is_turned_from_the_sensor_to_the_base() -> None:
    wrench_S = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])
    frames = make_frames(R_BS=TURNED, R_BW=turn(np.array([0.0, 1.0, 0.0]), 0.3))

    state = make_rule().step(AdmittanceState.initial(6), frames, wrench_S, 0.01)

    expected = np.append(TURNED @ wrench_S[:3], TURNED @ wrench_S[3:])
    assert state.wrench_B == pytest.approx(expected, abs=ROUNDING)


def test_joints_are_moved_by_the_damped_inverse() -> None:
    alpha = 0.01
    J = np.random.default_rng(1).normal(size=(6, 7))
    wrench = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])
    initial = AdmittanceState.initial(7)

    state = make_rule(alpha=alpha).step(initial, make_frames(J=J), wrench, 0.01)

    # As KDL's plugin has it.
    expected = np.linalg.solve(J.T @ J + alpha * np.eye(7), J.T @ wrench)
    assert state.acceleration == pytest.approx(expected, abs=1e-10)
    assert state.twist_rate == pytest.approx(J @ expected, abs=1e-10)
    assert state.twist == pytest.approx(0.01 * J @ expected, abs=1e-10)


def test_without_damping_a_singular_arm_moves_as_far_as_it_can() -> None:
    J = np.zeros((6, 2))
    J[0] = [1.0, 1.0]
    initial = AdmittanceState.initial(2)

    state = make_rule().step(initial, make_frames(J=J), along_x(6.0), 0.01)

    assert state.acceleration == pytest.approx([3.0, 3.0])


def test_damping_of_the_joints_is_of_their_own_velocity() -> None:
    rule = make_rule(joint_damping=5.0, stiffness=np.zeros(6))

    velocities = [s.velocity[0] for s in push(rule, along_x(2.0), 500, 0.01)]

    # v' = F / M - c v, whose rest is F / (M c); each step keeps 1 - c h of the way.
    expected = 0.4 * (1.0 - 0.95 ** np.arange(501))
    assert velocities == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.filterwarnings("error")
def test_what_is_too_stiff_for_its_period_ends_in_numbers_that_are_none() -> None:
    rule = make_rule(mass=np.full(6, 1e-4), stiffness=np.full(6, 1e8))

    last = push(rule, along_x(1.0), 100, 0.01)[-1]

    assert not np.isfinite(last.position[0])
