"""Dry friction's numbers follow from the robot's dynamics."""

import numpy as np
import pytest

from arm_drake.control.servo import compute_friction_gains
from tests.control.test_servo import SAMPLES, alone


@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_presliding_of_a_single_joint_has_the_pole_of_friction_twice(h: float) -> None:
    inertia, damping, z = 3.0, 7.0, 0.2
    effective = inertia + h * damping

    found = compute_friction_gains(alone(effective, damping), h)

    # Drake's step: (M + h D) (v[+] - v) / h = -kf q - df v - D v.
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
    effective, damping = np.array([2.0, 1.0]), SAMPLES.damping
    np.testing.assert_allclose(
        found.kf, coupling * effective * (1.0 - z) ** 2 / h**2, rtol=1e-12
    )
    np.testing.assert_allclose(
        found.df,
        coupling * (effective - h * damping - effective * z**2) / h,
        rtol=1e-12,
    )
