"""The servo's and the friction's numbers follow from the robot's dynamics."""

import math

import numpy as np
import pytest

from arm_drake.control.servo import (
    DynamicsSamples,
    ServoGains,
    compute_friction_gains,
    compute_servo_gains,
)

W0 = 40.0

# Two joints at two configurations, all numbers different.
SAMPLES = DynamicsSamples(
    mass_matrix=np.array([[[4.0, 0.5], [0.5, 1.0]], [[2.0, 0.25], [0.25, 1.5]]]),
    gravity=np.array([[-30.0, 2.0], [10.0, -5.0]]),
    damping=np.array([100.0, 0.0]),
)


def gains(
    time_step: float = 1e-3,
    effort: tuple[float, float] = (100.0, 20.0),
    velocity: tuple[float, float] = (3.0, math.inf),
) -> ServoGains:
    return compute_servo_gains(
        SAMPLES,
        np.array(effort),
        np.array(velocity),
        bandwidth=W0,
        time_step=time_step,
    )


@pytest.mark.parametrize("h", [1e-3, 2e-3, 5e-3, 1e-2])
def test_both_poles_of_the_sampled_error_are_those_of_the_bandwidth(h: float) -> None:
    found = gains(h)

    # One step of the plant: v[+] = v - h (kp q + kd v), then q[+] = q + h v[+].
    step = np.array(
        [
            [1.0 - h**2 * found.kp, h * (1.0 - h * found.kd)],
            [-h * found.kp, 1.0 - h * found.kd],
        ]
    )
    z = math.exp(-W0 * h)
    # Trace and determinant, for a double eigenvalue itself is ill-conditioned.
    assert np.trace(step) == pytest.approx(2.0 * z, rel=1e-12)
    assert np.linalg.det(step) == pytest.approx(z**2, rel=1e-12)


def test_gains_at_small_steps_are_those_of_a_critically_damped_drive() -> None:
    found = gains(1e-6)

    assert found.kp == pytest.approx(W0**2, rel=1e-4)
    assert found.kd == pytest.approx(2.0 * W0, rel=1e-4)


def test_velocity_lead_is_twice_the_time_constant() -> None:
    assert gains().velocity_lead == pytest.approx(2.0 / W0, rel=1e-15)


def test_error_is_limited_by_the_speed_that_it_would_cause() -> None:
    np.testing.assert_allclose(gains().max_error, [2.0 / W0 * 3.0, math.inf])


def test_acceleration_is_limited_by_what_gravity_leaves_of_the_effort() -> None:
    found = gains(time_step=1e-2)

    # (effort - max |gravity|) / (max inertia + h D)
    expected = [(100.0 - 30.0) / (4.0 + 1e-2 * 100.0), (20.0 - 5.0) / 1.5]
    np.testing.assert_allclose(found.max_acceleration, expected, rtol=1e-15)


def test_a_tenth_of_the_effort_accelerates_where_gravity_leaves_less() -> None:
    found = gains(time_step=1e-2, effort=(32.0, 4.0))

    expected = [0.1 * 32.0 / (4.0 + 1e-2 * 100.0), 0.1 * 4.0 / 1.5]
    np.testing.assert_allclose(found.max_acceleration, expected, rtol=1e-15)


def test_observer_is_limited_by_twice_the_effort_at_the_least_inertia() -> None:
    expected = [2.0 * 100.0 / 2.0, 2.0 * 20.0 / 1.0]
    np.testing.assert_allclose(gains().max_disturbance, expected, rtol=1e-15)


def test_effort_limits_are_as_given() -> None:
    np.testing.assert_array_equal(gains().effort_limit, [100.0, 20.0])


def test_unset_effort_limit_holds_and_accelerates_the_joint_twice() -> None:
    found = gains(effort=(math.inf, 20.0))

    # 2 (max |gravity| + 100 rad/s^2 max inertia)
    np.testing.assert_allclose(
        found.effort_limit, [2.0 * (30.0 + 100.0 * 4.0), 20.0], rtol=1e-15
    )


@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_presliding_of_a_single_joint_has_the_pole_of_friction_twice(h: float) -> None:
    inertia, damping, z = 3.0, 7.0, 0.2
    alone = DynamicsSamples(
        np.array([[[inertia]]]), np.array([[0.0]]), np.array([damping])
    )

    found = compute_friction_gains(alone, h)

    # Drake's step: (M + h D) (v[+] - v) / h = -kf q - df v - D v.
    effective = inertia + h * damping
    a21 = -h * found.kf[0] / effective
    a22 = 1.0 - h * (found.df[0] + damping) / effective
    step = np.array([[1.0 + h * a21, h * a22], [a21, a22]])
    assert np.trace(step) == pytest.approx(2.0 * z, rel=1e-9)
    assert np.linalg.det(step) == pytest.approx(z**2, rel=1e-9)


def test_friction_is_softer_where_joints_are_coupled() -> None:
    h, z = 1e-3, 0.2

    found = compute_friction_gains(SAMPLES, h)

    # Correlations are 0.5 / sqrt(4) = 0.25 and 0.25 / sqrt(3); the larger one counts.
    coupling = 1.0 - 0.25
    min_inertia, damping = np.array([2.0, 1.0]), SAMPLES.damping
    reach = coupling * (min_inertia + h * damping)
    np.testing.assert_allclose(found.kf, reach * (1.0 - z) ** 2 / h**2, rtol=1e-12)
    np.testing.assert_allclose(
        found.df, (coupling * min_inertia - reach * z**2) / h, rtol=1e-12
    )
