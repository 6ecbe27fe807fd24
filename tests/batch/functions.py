"""Functions that tests let workers run, which import them from here."""

import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES


def square(x: float) -> float:
    return x * x


def wait_and_square(x: float) -> float:
    # The first ones take longest.
    time.sleep(0.05 / (1.0 + x))
    return x * x


def wait_for_a_generator(x: int) -> Iterator[int]:
    """Return what can't be pickled, the first time so late that processes pay."""
    time.sleep(2.2 if x == 0 else 0.05)
    return (y for y in (x,))


def fail_at_three(x: int) -> int:
    if x == 3:
        raise ValueError("three is too many")
    return x


def end_at(how: str) -> str:
    if how == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "exit":
        os._exit(7)
    if how == "sys.exit":
        raise SystemExit(3)
    if how == "interrupt":
        raise KeyboardInterrupt
    if how == "no text":
        raise NoTextError
    if how == "own error":
        raise TwoArgumentsError("one", "two")
    if how == "no pickle":
        return (x for x in how)  # type: ignore[return-value]
    if how == "unreadable":
        return Unreadable()  # type: ignore[return-value]
    return how


class Unreadable:
    """It can be written only."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (int, ("no number",))


class NoTextError(Exception):
    """It fails when it is told."""

    def __str__(self) -> str:
        raise RuntimeError


class TwoArgumentsError(Exception):
    """It doesn't come through a pickle."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(f"{one} and {two}")


def leave_behind(megabytes: int) -> int:
    """Keep memory for ever; return the id of the process."""
    KEPT.append(np.ones(megabytes * 2**17))
    return os.getpid()


KEPT: list[np.ndarray] = []


def process_id(_: Any) -> int:
    return os.getpid()


def run_nested(x: int) -> tuple[str, list[float]]:
    results = ad.run_many([x, x + 1], square)
    return results.backend, results.values


def run_processes_in_a_process(x: int) -> list[float]:
    return ad.run_many([x, x + 1], square, backend="processes", workers=2).values


def random_number(_: Any) -> float:
    return float(np.random.random())  # noqa: NPY002  As users may have it.


def see_surroundings(name: str) -> tuple[str | None, str]:
    return os.environ.get(name), os.getcwd()


def note_and_sleep(folder: str) -> None:
    if not folder:
        return
    (Path(folder) / f"{os.getpid()}").touch()
    time.sleep(60.0)


def meet(folder: str) -> int:
    """Wait for another process that does so."""
    (Path(folder) / f"{os.getpid()}").touch()
    deadline = time.monotonic() + 60.0
    while len(list(Path(folder).iterdir())) < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    return os.getpid()


def start_sleep(folder: str) -> None:
    """Start another process, as functions do that call programs."""
    if folder:
        process = subprocess.Popen(["sleep", "60"])
        (Path(folder) / f"{process.pid}").touch()
        process.wait()


def die_answering(folder: str) -> str:
    """Die in the midst of the answer, and leave a process behind that lives longer."""
    if not folder:
        return folder
    child = os.fork()
    if child == 0:
        time.sleep(60.0)
        os._exit(0)
    (Path(folder) / f"{child}").touch()

    def send_half(connection: Connection, data: bytes) -> None:
        connection._send(struct.pack("!i", len(data)) + bytes(data[:5]))  # type: ignore[attr-defined]
        os.kill(os.getpid(), signal.SIGKILL)

    Connection._send_bytes = send_half  # type: ignore[attr-defined]
    return folder


def close_output(x: int) -> int:
    sys.stdout = None if x == 1 else sys.stdout
    return x


def final_position(simulation: ad.Simulation) -> np.ndarray:
    return simulation.rollout().position[-1]


def add_a_post(plant: MultibodyPlant) -> None:
    """Add another post each time."""
    posts = NUM_POSTS[os.getpid()] = NUM_POSTS.get(os.getpid(), 0) + 1
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 1.0)
    plant.AddRigidBody(f"post{posts}", inertia)


NUM_POSTS: dict[int, int] = {}


def has_second_post(simulation: ad.Simulation) -> bool:
    plant = simulation.diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return plant.HasBodyNamed("post2")


def turn_gravity_off(simulation: ad.Simulation) -> float:
    """Return how strong it was [m/s^2]."""
    plant = simulation.diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    field = plant.mutable_gravity_field()
    before = float(field.gravity_vector()[2])
    field.set_gravity_vector([0.0, 0.0, 0.0])
    return before


def simulate_an_arm(speed: float) -> np.ndarray:
    """Return the positions of a simulation that a user wrote."""
    simulation = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
    simulation.run(speed)
    return simulation.rollout().position


def knows_type(name: str) -> bool:
    return name in CONTROLLER_TYPES
