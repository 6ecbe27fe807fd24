"""The configurations at which a robot's dynamics is sampled."""

import itertools

import numpy as np

from arm_drake.plant.joint_dynamics import draw


def test_what_is_drawn_is_numpys() -> None:
    found = list(itertools.islice(draw(), 10_000))

    assert found == np.random.default_rng(20_260_101).random(10_000).tolist()
