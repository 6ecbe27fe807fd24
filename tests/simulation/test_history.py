"""The history of a simulation without an end."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.simulation.recording import History
from tests.models import load, pendulum


@pytest.mark.slow
def test_the_last_part_is_kept_as_it_was(tmp_path: Path) -> None:
    robot = load(tmp_path, pendulum())
    alone = ad.Simulation(ad.build_diagram(robot))
    alone.run(7.0)
    simulation = ad.Simulation(ad.build_diagram(robot))
    history = History(simulation.mailbox, 1.0)

    longest = 0.0
    for _ in range(70):
        simulation.run(0.1)
        history.trim()
        time = simulation.rollout().time
        longest = max(longest, time[-1] - time[0])
    kept = simulation.rollout()

    whole = alone.rollout()
    start = np.searchsorted(whole.time, kept.time[0])
    assert longest <= 2.0 + 1e-9
    assert kept.time[-1] - kept.time[0] >= 1.0 - 0.02
    assert np.array_equal(kept.time, whole.time[start:])
    assert np.array_equal(kept.position, whole.position[start:])
    assert np.array_equal(kept.effort, whole.effort[start:])


@pytest.mark.slow
def test_after_a_reset_it_counts_anew(tmp_path: Path) -> None:
    simulation = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum())))
    history = History(simulation.mailbox, 1.0)
    simulation.run(2.5)
    history.trim()

    simulation.reset()
    history.trim()
    simulation.run(1.5)
    history.trim()

    assert simulation.rollout().time[0] == 0.0


@pytest.mark.slow
def test_without_an_end_of_its_patience_all_is_kept(tmp_path: Path) -> None:
    simulation = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum())))
    history = History(simulation.mailbox, np.inf)

    simulation.run(3.0)
    history.trim()

    assert simulation.rollout().time[0] == 0.0
