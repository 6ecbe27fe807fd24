"""The servo's and the friction's numbers follow from the robot's dynamics."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from arm_drake.control.servo import (
    DriveLimits,
    DynamicsSamples,
    ServoGains,
    compute_rotor_inertia,
    compute_servo_gains,
)

W0 = 40.0

# Two joints at two configurations, all numbers different.
SAMPLES = DynamicsSamples(
    mass_matrix=np.array([[[4.0, 0.5], [0.5, 1.0]], [[2.0, 0.25], [0.25, 1.5]]]),
    gravity=np.array([[-30.0, 2.0], [10.0, -5.0]]),
    damping=np.array([100.0, 0.0]),
)


def alone(
    inertia: float, damping: float = 0.0, gravity: float = 0.0
) -> DynamicsSamples:
    """Return the dynamics of a single joint."""
    return DynamicsSamples(
        np.array([[[inertia]]]), np.array([[gravity]]), np.array([damping])
    )


def make_limits(
    effort: Sequence[float], velocity: Sequence[float], *, prismatic: bool = False
) -> DriveLimits:
    n = len(effort)
    return DriveLimits(
        np.array(effort),
        np.array(velocity),
        np.full(n, prismatic),
        np.full(n, -math.inf),
        np.full(n, math.inf),
    )


def gains(
    time_step: float = 1e-3,
    effort: tuple[float, float] = (100.0, 20.0),
    velocity: tuple[float, float] = (3.0, math.inf),
    **options: Any,
) -> ServoGains:
    return compute_servo_gains(
        SAMPLES,
        make_limits(effort, velocity),
        bandwidth=W0,
        time_step=time_step,
        **options,
    )


def gains_of(
    samples: DynamicsSamples, effort: float, velocity: float, h: float = 1e-3
) -> ServoGains:
    """Return the gains of a single joint."""
    limits = make_limits([effort], [velocity])
    return compute_servo_gains(samples, limits, bandwidth=W0, time_step=h)


@pytest.mark.parametrize("h", [1e-3, 2e-3, 5e-3, 1e-2])
def test_both_poles_of_the_sampled_error_are_those_of_the_bandwidth(h: float) -> None:
    found = gains(h)

    # One step of the plant: v[+] = v - h (kp q + kd v), then q[+] = q + h v[+].
    step = np.array(
        [
            [1.0 - h**2 * found.kp[0], h * (1.0 - h * found.kd[0])],
            [-h * found.kp[0], 1.0 - h * found.kd[0]],
        ]
    )
    z = math.exp(-W0 * h)
    # Trace and determinant, for a double eigenvalue itself is ill-conditioned.
    assert np.trace(step) == pytest.approx(2.0 * z, rel=1e-12)
    assert np.linalg.det(step) == pytest.approx(z**2, rel=1e-12)


def test_gains_at_small_steps_are_those_of_a_critically_damped_drive() -> None:
    found = gains(1e-6)

    np.testing.assert_allclose(found.kp, W0**2, rtol=1e-4)
    np.testing.assert_allclose(found.kd, 2.0 * W0, rtol=1e-4)


def test_velocity_lead_is_twice_the_time_constant() -> None:
    np.testing.assert_allclose(gains().velocity_lead, 2.0 / W0, rtol=1e-15)


def test_error_is_limited_by_the_speed_that_it_would_cause() -> None:
    found = gains(time_step=1e-2)

    # Where nothing accelerates, kp error = kd v.
    speeds = found.max_error * found.kp / found.kd
    np.testing.assert_allclose(speeds, [3.0, math.inf], rtol=1e-15)


def test_what_is_far_away_is_approached_at_the_speed_of_the_joint() -> None:
    found = gains_of(alone(1.0), 100.0, 3.0)

    assert found.max_approach * found.kp / found.kd == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize(
    ("is_prismatic", "expected"), [(False, 2.0 * math.pi), (True, 1.0)]
)
def test_without_a_velocity_limit_it_is_a_turn_or_a_metre_a_second(
    is_prismatic: bool, expected: float
) -> None:
    limits = make_limits([100.0], [math.inf], prismatic=is_prismatic)

    found = compute_servo_gains(alone(1.0), limits, bandwidth=W0, time_step=1e-3)

    speed = found.max_approach * found.kp / found.kd
    assert speed == pytest.approx(expected, rel=1e-12)
    # A trajectory may be faster.
    assert found.max_error == math.inf


def test_damping_leaves_an_approach_effort_to_spare() -> None:
    found = gains_of(alone(1.0, damping=50.0, gravity=20.0), 100.0, 3.0)

    # At the speed at which damping takes 0.8 of what gravity leaves of the effort.
    speed = found.max_approach * found.kp / found.kd
    assert speed == pytest.approx(0.8 * (100.0 - 20.0) / 50.0, rel=1e-12)


def test_joints_that_bear_themselves_wait_for_each_other() -> None:
    # Their efforts limit them together, in the effort law; here it is the largest
    # position error, from rest kp (2/w0) v_max, which is 2 w0 v_max for small steps.
    found = gains(velocity=(3.0, 5.0))

    expected = [2.0 * W0 * 3.0, 2.0 * W0 * 5.0]
    np.testing.assert_allclose(found.max_acceleration, expected, rtol=1e-15)
    assert found.is_strong.tolist() == [True, True]


def test_joints_that_do_not_feel_each_other_do_not_wait() -> None:
    # Of four joints the first and the last are coupled, 0.5 of what they can be.
    M = np.diag([4.0, 2.0, 1.0, 1.0])
    M[0, 3] = M[3, 0] = 1.0
    M[1, 2] = M[2, 1] = 0.01
    samples = DynamicsSamples(M[None], np.zeros((1, 4)), np.zeros(4))

    found = compute_servo_gains(
        samples,
        make_limits([100.0] * 4, [3.0] * 4),
        bandwidth=W0,
        time_step=H,
    )

    a, b, c, d = found.group.tolist()
    assert a == d
    assert len({a, b, c}) == 3
    assert found.group.max() == 2


def test_a_joint_too_weak_for_itself_asks_for_a_tenth_of_its_effort() -> None:
    found = gains(effort=(29.0, 4.0))

    expected = [0.1 * 29.0 / 4.0, 0.1 * 4.0 / 1.5]
    np.testing.assert_allclose(found.max_acceleration, expected, rtol=1e-15)
    assert found.is_strong.tolist() == [False, False]


def test_acceleration_without_an_effort_limit_is_that_of_the_largest_error() -> None:
    found = gains_of(alone(1.0), math.inf, 3.0)

    # From rest kp (2/w0) v_max, which is 2 w0 v_max for small steps.
    assert found.max_acceleration == pytest.approx(2.0 * W0 * 3.0, rel=1e-12)


def test_braking_takes_less_than_a_joint_alone_can_do() -> None:
    found = gains_of(alone(2.0, gravity=-30.0), 100.0, 3.0)

    # On the straight part of the law v = (kp/kd) e, at its end a = (kp/kd)^2 e.
    largest = found.braking_error * (found.kp / found.kd) ** 2
    assert largest == pytest.approx(0.7 * (100.0 - 30.0) / 2.0, rel=1e-12)


def test_joints_that_brake_together_stay_within_their_efforts() -> None:
    found = gains(velocity=(100.0, 100.0))

    together = found.braking_error * (found.kp / found.kd) ** 2 / 0.7
    efforts = np.abs(SAMPLES.mass_matrix) @ together
    assert (efforts <= 1.02 * np.array([100.0 - 30.0, 20.0 - 5.0])).all()
    # And neither waits for the other more than it must.
    assert (efforts.max(axis=0) >= 0.5 * np.array([70.0, 15.0])).all()


def test_observer_is_limited_by_twice_the_effort_at_the_least_inertia() -> None:
    expected = [2.0 * 100.0 / 2.0, 2.0 * 20.0 / 1.0]
    np.testing.assert_allclose(gains().max_disturbance, expected, rtol=1e-15)


def test_observer_without_an_effort_limit_takes_one_that_accelerates_well() -> None:
    found = gains(effort=(math.inf, 20.0))

    # 2 (max |gravity| + 100 rad/s^2 max inertia)
    effort = 2.0 * (30.0 + 100.0 * 4.0)
    assert found.max_disturbance[0] == pytest.approx(2.0 * effort / 2.0, rel=1e-15)


def test_the_observer_can_be_left_out() -> None:
    assert gains().observer_gain > 0.0
    assert gains(observer_gain=0.0).observer_gain == 0.0


def test_effort_limits_are_as_given_also_none() -> None:
    np.testing.assert_array_equal(gains().effort_limit, [100.0, 20.0])
    np.testing.assert_array_equal(
        gains(effort=(math.inf, 20.0)).effort_limit, [math.inf, 20.0]
    )


def test_a_stated_rate_makes_a_velocity_of_the_error_within_a_step() -> None:
    h = 2e-3

    found = gains(h, position_rate=np.array([10.0, math.nan]))

    # v[+] = v + h (kp e - kd v) = 10 e
    assert 1.0 - h * found.kd[0] == pytest.approx(0.0, abs=1e-15)
    assert h * found.kp[0] == pytest.approx(10.0, rel=1e-15)
    assert found.velocity_lead[0] == 0.0
    other = gains(h)
    assert (found.kp[1], found.kd[1]) == (other.kp[1], other.kd[1])


def rotors(
    samples: DynamicsSamples, effort: Sequence[float], strength: Sequence[float]
) -> np.ndarray:
    limits = make_limits(effort, [3.0] * len(effort))
    return compute_rotor_inertia(samples, limits, np.array(strength), H)


# Step of the plant [s].
H = 1e-3


def test_light_joints_get_the_rotor_of_their_effort() -> None:
    samples = DynamicsSamples(
        np.array([np.diag([4.0, 0.002]), np.diag([5.0, 0.02])]),
        np.zeros((2, 2)),
        np.zeros(2),
    )

    found = rotors(samples, [100.0, 28.0], [500.0, 500.0])

    # The drive that gives itself 1000 rad/s^2, less what the links have.
    np.testing.assert_allclose(found, [0.0, 28.0 / 1000.0 - 0.002], rtol=1e-12)


def test_links_of_a_tenth_of_that_are_heavy_enough() -> None:
    lighter, heavier = (
        rotors(alone(28.0 / 1e4 * part), [28.0], [500.0]) for part in (0.99, 1.01)
    )

    assert lighter == pytest.approx(28.0 / 1000.0 * (1.0 - 0.099), rel=1e-12)
    assert heavier == 0.0


def test_a_rotor_is_the_same_at_every_step() -> None:
    links, damping = 1e-3, 2.0
    limits = make_limits([28.0], [3.0])

    found = [
        compute_rotor_inertia(
            alone(links + h * damping, damping), limits, np.array([500.0]), h
        )
        for h in (1e-3, 1e-2)
    ]

    np.testing.assert_allclose(found, 28.0 / 1000.0 - links, rtol=1e-12)


def test_an_effort_that_the_robot_does_not_need_makes_no_large_rotor() -> None:
    found = rotors(alone(1e-4), [1e4], [2.0])

    np.testing.assert_allclose(found, 2.0 / 1000.0 - 1e-4, rtol=1e-12)


def test_without_an_effort_limit_a_quarter_of_what_is_enough_is_taken() -> None:
    found = rotors(alone(1e-5), [math.inf], [2.0])

    np.testing.assert_allclose(found, 0.25 * 2.0 / 1000.0 - 1e-5, rtol=1e-12)


def test_rotors_add_to_the_diagonal_of_the_mass_matrices() -> None:
    found = SAMPLES.with_rotors(np.array([0.5, 0.25]))

    added = found.mass_matrix - SAMPLES.mass_matrix
    np.testing.assert_allclose(added, [np.diag([0.5, 0.25])] * 2, rtol=1e-15)
    np.testing.assert_array_equal(found.gravity, SAMPLES.gravity)
