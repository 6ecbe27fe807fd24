"""The task of all engines: joints go there and back, with commands held at 100 Hz."""

import dataclasses as dc
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.peers import robots

Array = NDArray[np.float64]

# Period of the commands, and of what is recorded [s].
PERIOD = 1.0 / robots.RATE

# Largest speed on the way there and back [rad/s].
SPEED = 0.45

# Bandwidth of the ideal servo [rad/s].
BANDWIDTH = 40.0

# Steps that an engine is measured with [s].
STEPS = (0.001, 0.002, 0.005, 0.01)


class Commands(NamedTuple):
    """What joints are told: it holds from each of the N ticks to the next one."""

    # Positions [rad] and velocities [rad/s], shape (N, n).
    q: Array
    v: Array

    def folded(self, time: Array | float) -> Array:
        """Return the positions that stand for both: q + time v, shape (N, n).

        Args:
            time: Gain of the velocity by that of the position [s], shape (n,).
        """
        return self.q + time * self.v


class Recording(NamedTuple):
    """What the n commanded joints did, at the N ticks."""

    # Positions [rad] and velocities [rad/s] right before each tick, shape (N, n).
    q: Array
    v: Array


@dc.dataclass(frozen=True, eq=False)
class Task:
    """A robot with n commanded joints, and where they go."""

    name: str

    urdf: str

    # Gains of the usual PD servo [N·m/rad], [N·m·s/rad], shape (n,).
    kp: Array
    kd: Array

    # How far joints go, where SPEED and the duration allow 1, shape (n,).
    way: Array

    # How long [s].
    duration: float

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the commanded joints."""
        return robots.joints_of(self.urdf)

    @property
    def mimics(self) -> tuple[robots.Mimic, ...]:
        """Joints that follow others."""
        return robots.mimics_of(self.urdf)

    @property
    def num_ticks(self) -> int:
        """Number of ticks N."""
        return round(self.duration / PERIOD)

    @property
    def waypoint(self) -> Array:
        """Where joints turn round [rad], shape (n,)."""
        return self.way * SPEED * self.duration / 3.0

    def motion(self, time: Array) -> tuple[Array, Array]:
        """Return where joints are to be, and how fast: two cubics.

        Args:
            time: When [s], shape (k,).

        Returns:
            Positions [rad] and velocities [rad/s], each of shape (k, n).
        """
        half = self.duration / 2.0
        s = 1.0 - np.abs(np.clip(time, 0.0, self.duration) / half - 1.0)
        rate = np.where(time < half, 1.0, -1.0) / half
        rate = rate * ((time > 0.0) & (time < self.duration))
        position = (3.0 * s**2 - 2.0 * s**3)[:, None] * self.waypoint
        velocity = (6.0 * (s - s**2) * rate)[:, None] * self.waypoint
        return position, velocity

    def wanted(self) -> Array:
        """Return where joints are to be at each tick [rad], shape (N, n)."""
        ticks = PERIOD * np.arange(self.num_ticks)
        return self.motion(ticks)[0]


class Contestant(NamedTuple):
    """A way to do the task."""

    # Whose engine it is, and how it is used.
    engine: str
    setting: str

    # What its joints follow: "pd", "servo", or "own" for a law that only it has.
    law: str

    # Step of the physics [s].
    step: float

    # Makes what does the task from the start each time that it is prepared.
    make: Callable[[], "Runner"]

    @property
    def name(self) -> str:
        """Its name in tables."""
        return f"{self.engine}, {self.setting}, {1e3 * self.step:g} ms"


class Runner(NamedTuple):
    """A contestant that is ready."""

    # Goes back to the start; isn't timed.
    prepare: Callable[[], None]

    # Does the task and returns what was recorded; is timed.
    run: Callable[[], Recording]


def make_tasks(duration: float) -> tuple[Task, ...]:
    """Return the tasks: an arm without damping, one with a lot, and mimic joints."""
    return (
        Task(
            "ur5e_like",
            robots.ur5e_like(),
            np.full(6, 1e4),
            np.full(6, 400.0),
            np.array([0.6, -0.8, 0.9, -0.5, 0.7, 1.0]),
            duration,
        ),
        Task(
            "doosan_a0912",
            robots.bundled("doosan_a0912"),
            np.full(6, 1e4),
            np.full(6, 200.0),
            np.array([0.6, -0.5, 0.9, -0.5, 0.7, 1.0]),
            duration,
        ),
        Task(
            "mycobot_280",
            robots.bundled("mycobot_280"),
            np.full(7, 200.0),
            np.full(7, 5.0),
            np.array([0.6, -0.5, 0.9, -0.5, 0.7, 1.0, -0.3]),
            duration,
        ),
    )


def make_chain(num_joints: int, duration: float) -> Task:
    """Return the task of a chain; joints go less far, the more there are."""
    return Task(
        f"chain of {num_joints}",
        robots.chain(num_joints),
        np.full(num_joints, 1e3),
        np.full(num_joints, 100.0),
        np.resize([0.3, -0.4, 0.5, 0.2], num_joints) * 6.0 / num_joints,
        duration,
    )


def command_lead(bandwidth: float = BANDWIDTH) -> float:
    """Return what a velocity adds to a position that is held for a period [s]."""
    return 2.0 / bandwidth - PERIOD / 2.0


def substeps(step: float) -> int:
    """Return how many steps a period has.

    Raises:
        ValueError: If they don't fit.
    """
    number = round(PERIOD / step)
    if not math.isclose(number * step, PERIOD):
        raise ValueError(f"steps of {step} s don't fit into {PERIOD} s")
    return number
