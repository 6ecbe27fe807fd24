"""Interfaces and a mass to push, shared by the tests of Gazebo's plugins."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np

from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.messages import Float64
from tests.controllers.driving import Driven, make_params


def make_surroundings(
    *joints: str, rate: int = 1000, **more: Any
) -> ControllerInterfaceParams:
    """Return surroundings of a robot called "arm"."""
    params = make_params(joints, rate=rate)
    return dc.replace(params, **{"robot_name": "arm", **more})


def send(driven: Driven, topic: str, *values: float, **how: Any) -> dict[str, float]:
    """Run a cycle with numbers on a topic, and return what is commanded then."""
    driven.run({topic: tuple(map(Float64, values))}, **how)
    return commands(driven)


def commands(driven: Driven) -> dict[str, float]:
    """Return what the command interfaces hold."""
    names = driven.system.command_interfaces
    return dict(zip(names, driven.command_values.tolist(), strict=True))


def push(
    driven: Driven,
    duration: float,
    *,
    mass: float = 1.0,
    load: float = 0.0,
    stop: Callable[[float], bool] = lambda velocity: False,
) -> np.ndarray:
    """Let the only joint's force and a load move a mass from rest at 0.

    Args:
        driven: The controller.
        duration: How long [s].
        mass: The mass [kg].
        load: A constant force [N].
        stop: Whether to end at a velocity [m/s].

    Returns:
        Position and velocity at every tick, shape (N, 2); exact, for the force is
        constant from tick to tick.
    """
    dt = driven.system.params.period
    q, v, rows = 0.0, 0.0, []
    for _ in range(round(duration / dt)):
        rows.append((q, v))
        driven.measure([q, v])
        (force,) = driven.run().command
        a = (force + load) / mass
        q, v = q + v * dt + a * dt**2 / 2.0, v + a * dt
        if stop(v):
            break
    return np.array([*rows, (q, v)])
