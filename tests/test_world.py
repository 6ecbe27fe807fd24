"""Built-in worlds: a ground to stand on, or nothing at all."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from tests import models


def falling_ball(folder: Path, world: str) -> ad.Simulation:
    robot = models.load(folder, models.FALLING_BALL)
    return ad.Simulation(ad.build_diagram(robot, world=world))


def test_the_ground_of_the_empty_world_is_at_height_0(tmp_path: Path) -> None:
    simulation = falling_ball(tmp_path, "empty")

    simulation.advance_to(2.0)

    (fallen,) = simulation.joint_states().position
    # From 1 m to its radius of 0.1 m, and 20 um into the compliant ground.
    assert fallen == pytest.approx(-0.9, abs=1e-3)
    assert simulation.joint_states().velocity == pytest.approx((0.0,), abs=1e-5)


def test_in_the_void_everything_falls_for_ever(tmp_path: Path) -> None:
    simulation = falling_ball(tmp_path, "void")

    simulation.advance_to(0.8)

    # Drake's step: v[+] = v - g h, then q[+] = q + h v[+].
    h, n = 1e-3, 800
    expected = -models.GRAVITY * h**2 * n * (n + 1) / 2.0
    np.testing.assert_allclose(
        simulation.joint_states().position, [expected], rtol=1e-9
    )


def test_an_unknown_world_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        falling_ball(tmp_path, "emty")

    assert str(caught.value) == (
        "unknown world 'emty'; did you mean 'empty'? known: empty, void"
    )
