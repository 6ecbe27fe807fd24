"""Helpers of the tests of remotes: to find one, to use it, to run with it."""

from typing import Any

import numpy as np

import arm_drake as ad
from arm_drake.visualization.page.widgets import Button, Buttons, Slider
from arm_drake.visualization.teleop.base import Remote
from arm_drake.visualization.teleop.remotes import find_remotes

# How often a remote is called [s], as the viewer does.
PERIOD = 0.1


def simulate(robot: ad.Robot, **options: Any) -> ad.Simulation:
    """Return a simulation of a robot."""
    return ad.Simulation(
        ad.build_diagram(robot, options=ad.SimulationOptions(**options))
    )


def find(simulation: ad.Simulation, controller: str, kind: type[Remote]) -> Any:
    """Return a controller's remote, which is of a kind."""
    by_name = {remote.controller: remote for remote in find_remotes(simulation)}
    assert type(by_name[controller]) is kind
    return by_name[controller]


def leaves(remote: Remote) -> dict[str, Slider | Button]:
    """Return sliders and buttons by the last parts of their ids."""
    found: dict[str, Slider | Button] = {}
    for widget in remote.widgets():
        for leaf in widget.buttons if isinstance(widget, Buttons) else (widget,):
            assert isinstance(leaf, Slider | Button)
            found[leaf.id.removeprefix(f"remote:{remote.controller}:")] = leaf
    return found


def use(remote: Remote, part: str, value: float | None = None) -> None:
    """Move a slider or click a button, as the page tells it."""
    remote.handle(f"remote:{remote.controller}:{part}", value)


def run(simulation: ad.Simulation, duration: float, *remotes: Remote) -> None:
    """Run with remotes that are called ten times a second."""
    for _ in range(round(duration / PERIOD)):
        for remote in remotes:
            remote.tick(simulation.time)
        simulation.run(PERIOD)


def positions(simulation: ad.Simulation, robot: str | None = None) -> dict[str, float]:
    """Return where the joints are."""
    state = simulation.joint_states(robot)
    return dict(zip(state.name, state.position, strict=True))


def nothing_lost(simulation: ad.Simulation) -> bool:
    """Return whether controllers took everything that was sent."""
    return not simulation.rejected and not simulation.failures


def same_bits(first: ad.Rollout, second: ad.Rollout) -> bool:
    """Return whether two rollouts are equal in every bit."""
    names = ("time", "position", "velocity", "effort")
    return all(
        np.array_equal(getattr(first, name), getattr(second, name)) for name in names
    )
