"""Measures contestants in turns, in one process."""

import dataclasses as dc
import importlib
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

import arm_drake as ad
from tests.benchmarks.peers import drake_floor, ours
from tests.benchmarks.peers.reference import make_reference
from tests.benchmarks.peers.task import (
    PERIOD,
    STEPS,
    Contestant,
    Recording,
    Runner,
    Task,
    make_chain,
    make_tasks,
)

# Engines that may not be installed: how each is called, its package, our module.
PEERS = {
    "MuJoCo": ("mujoco", "mujoco_peer"),
    "DART": ("dartpy", "dart_peer"),
    "PyBullet": ("pybullet", "bullet_peer"),
    "Pinocchio loop": ("pinocchio", "pinocchio_peer"),
}

NUMBERS_OF_ARMS = (1, 4, 16)
NUMBERS_OF_JOINTS = (6, 12, 24, 36, 60)

# Short runs are repeated until the clock has seen so much [s].
LEAST_TIME = 0.02

# The same diagram with and without Python ends within this [rad].
SAME = 1e-9

# A position that is further away than this isn't the task's any more [rad].
LARGEST = 0.5


@dc.dataclass(frozen=True)
class Result:
    """What a contestant took, and how far off it was."""

    group: str
    engine: str
    setting: str
    law: str
    step: float

    # Time of each turn [ms per simulated second], by the wall's clock and as it was the
    # processor's.
    wall: list[float] = dc.field(default_factory=list)
    cpu: list[float] = dc.field(default_factory=list)

    # Largest distances of a joint [rad]: from the reference, from it with positions
    # moved by half a step forwards and backwards, and from the motion.
    error: float | None = None
    error_ahead: float | None = None
    error_back: float | None = None
    track: float | None = None

    # Why there is nothing.
    problem: str = ""

    @property
    def name(self) -> str:
        """Its name in tables."""
        return f"{self.engine}, {self.setting}, {1e3 * self.step:g} ms"


def load_peers() -> tuple[dict[str, Any], list[str]]:
    """Return the modules of engines that are there, and names of those that aren't."""
    found, missing = {}, []
    for engine, (package, module) in PEERS.items():
        try:
            importlib.import_module(package)
        except ImportError:
            missing.append(engine)
        else:
            place = f"tests.benchmarks.peers.{module}"
            found[engine] = importlib.import_module(place)
    return found, missing


def compare(
    group: str,
    task: Task,
    contestants: Sequence[Contestant],
    references: Mapping[str, Recording],
    runs: int,
) -> list[Result]:
    """Return what contestants take, turn by turn.

    Args:
        group: What the results are of.
        task: What they do.
        contestants: Who does it.
        references: What is right, by law.
        runs: Number of turns.
    """
    results, ready = [], []
    for one in contestants:
        result = Result(group, one.engine, one.setting, one.law, one.step)
        try:
            runner = one.make()
            runner.prepare()
            recording = runner.run()
        except Exception as error:  # Whatever an engine raises is its result.
            reason = " ".join(str(error).split())[:200]
            result = dc.replace(result, problem=f"{type(error).__name__}: {reason}")
        else:
            result = judge(result, task, recording, references.get(one.law))
            if not result.problem:
                ready.append((result, runner))
        results.append(result)
    for _ in range(runs):
        for result, runner in ready:
            wall, cpu = _time(runner)
            result.wall.append(1e3 * wall / task.duration)
            result.cpu.append(1e3 * cpu / task.duration)
    return results


def judge(
    result: Result, task: Task, recording: Recording, reference: Recording | None
) -> Result:
    """Return a result with its errors, or with what is wrong."""
    track = _largest(recording.q - task.wanted())
    if not track < LARGEST:
        return dc.replace(result, problem=f"not the task: off by {track:.1e} rad")
    result = dc.replace(result, track=track)
    if reference is None:
        return result
    half = 0.5 * result.step * recording.v
    errors = [
        _largest(recording.q + sign * half - reference.q) for sign in (0.0, 1.0, -1.0)
    ]
    return dc.replace(
        result, error=errors[0], error_ahead=errors[1], error_back=errors[2]
    )


def check_same_work(results: Sequence[Result]) -> list[Result]:
    """Return results, with a problem where C++ alone did not do what ours did."""
    done = {r.step: r.error for r in results if (r.engine, r.setting) == ours.ACCURATE}
    return [
        dc.replace(r, problem=f"other work than ours: errors {r.error}, {done[r.step]}")
        if (r.engine, r.setting) == ours.SAME
        and not r.problem
        and not abs((r.error or 0.0) - (done[r.step] or 0.0)) < SAME
        else r
        for r in results
    ]


def _largest(distances: np.ndarray) -> float:
    return float(np.abs(distances).max())


def _time(runner: Runner) -> tuple[float, float]:
    """Return what a run takes, by the wall's clock and of the processor [s]."""
    wall = cpu = 0.0
    number = 0
    while wall < LEAST_TIME:
        runner.prepare()
        start = time.perf_counter(), time.process_time()
        runner.run()
        wall += time.perf_counter() - start[0]
        cpu += time.process_time() - start[1]
        number += 1
    return wall / number, cpu / number


def compare_arms(
    peers: Mapping[str, Any], duration: float, runs: int
) -> tuple[list[Result], dict[str, float]]:
    """Return all contestants on single arms, and how exact references are [rad]."""
    results, exactness = [], {}
    for task in make_tasks(duration):
        references = {law: make_reference(task, law) for law in ("pd", "servo")}
        # That of the servo has a closed form, which a test compares it with.
        rougher = make_reference(task, "pd", 1e-4)
        exactness[task.name] = _largest(rougher.q - references["pd"].q)
        contestants = ours.make_contestants(task) + drake_floor.make_contestants(task)
        for module in peers.values():
            contestants += module.make_contestants(task)
        found = compare(task.name, task, contestants, references, runs)
        results += check_same_work(found)
    return results, exactness


def compare_sizes(
    peers: Mapping[str, Any], duration: float, runs: int, *, is_quick: bool
) -> list[Result]:
    """Return how engines bear more arms, and longer chains."""
    results = []
    last = 1 if is_quick else None
    for number in NUMBERS_OF_ARMS[: 2 if is_quick else None]:
        task = make_tasks(duration)[0]
        group = f"{number} arms" if number > 1 else "1 arm"
        results += _compare_usual(peers, group, task, number, runs)
    for number in NUMBERS_OF_JOINTS[:last]:
        task = make_chain(number, duration)
        results += _compare_usual(peers, f"{number} joints", task, 1, runs)
    return results


def _compare_usual(
    peers: Mapping[str, Any], group: str, task: Task, number: int, runs: int
) -> list[Result]:
    """Return what engines take as usual, with a short and with a long step."""
    contestants = [
        one
        for one in ours.make_contestants(task, num_arms=number)
        if one.law == "servo"
    ]
    for module in peers.values():
        usual = getattr(module, "USUAL", None)
        contestants += [
            one
            for one in module.make_contestants(task, num_arms=number)
            if one.setting == usual
        ]
    ends = (STEPS[0], STEPS[-1])
    chosen = [one for one in contestants if one.step in ends]
    return compare(group, task, chosen, {}, runs)


def compare_records(duration: float, runs: int) -> list[Result]:
    """Return what recording more, and drawing, costs us."""
    task, step = make_tasks(duration)[1], STEPS[0]
    plain = ad.SimulationOptions(time_step=step)
    dense = ad.SimulationOptions(time_step=step, log_rate=1.0 / step)
    settings = {
        f"log at {1.0 / PERIOD:g} Hz": partial(ours.make_ours, task, plain),
        f"log at {1.0 / step:g} Hz": partial(ours.make_ours, task, dense),
        "drawn at 30 Hz, no browser": partial(
            ours.make_ours, task, plain, is_drawn=True
        ),
    }
    contestants = [
        Contestant(ours.ENGINE, name, "own", step, make)
        for name, make in settings.items()
    ]
    return compare("recording", task, contestants, {}, runs)
