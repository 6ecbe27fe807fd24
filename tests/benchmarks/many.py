"""Many rollouts of the Doosan: one by one, in threads, in processes, by choice.

    python -m tests.benchmarks.many [--quick] [--output DIR]

Each round runs every backend once, in turns, so that what else the machine does meets
all of them; ratios are of one round. Processes are started anew each time, but in the
column "warm". Besides wall time there is CPU time, of all processes together: on a
machine that is busy with other things it tells what wall time can't, that two cores
would take half of it.
"""

import argparse
import json
import os
import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil

import arm_drake as ad
from arm_drake.batch.api import available_cores
from arm_drake.batch.processes import close_server

# Two workers against one: how many times as quick.
GOAL = 1.8
WORKERS = 2

# The last one finds workers' server as an earlier call has left it.
WAYS = ("serial", "threads", "processes", "auto", "warm")


class Case(NamedTuple):
    """Runs that are alike."""

    name: str
    num_runs: int

    # Of each [s].
    duration: float

    # Of the physics [s].
    time_step: float


CASES = (
    Case("the goal", 100, 6.0, 1e-3),
    Case("the goal, 10 ms steps", 100, 6.0, 1e-2),
    Case("short runs", 100, 0.5, 1e-3),
    Case("long runs", 8, 60.0, 1e-3),
    Case("few runs", 4, 6.0, 1e-3),
)


class Measurement(NamedTuple):
    """What running a case in one way took."""

    wall: float
    cpu: float
    load: float
    chosen: str
    why: str


def cpu_time() -> float:
    """Return the CPU time of this process, its children and theirs, so far [s]."""
    me = psutil.Process()
    # Workers have ended; the server that started them may live.
    return sum(
        sum(process.cpu_times()[:4]) for process in (me, *me.children(recursive=True))
    )


def measure(case: Case, way: str) -> tuple[Measurement, bytes]:
    """Run a case in one way; return what it took, and its last positions as bytes."""
    options = ad.SimulationOptions(time_step=case.time_step)
    run = ad.Run(
        robot="doosan_a0912",
        motion="tutorial",
        duration=case.duration,
        options=options,
    )
    close_server()
    if way == "warm":
        start_server()
    start, cpu_before = time.perf_counter(), cpu_time()
    results = ad.run_many(
        [run] * case.num_runs,
        backend="processes" if way == "warm" else way,
        workers=WORKERS,
        progress=False,
    )
    wall, cpu = time.perf_counter() - start, cpu_time() - cpu_before
    load = os.getloadavg()[0]
    taken = Measurement(wall, cpu, load, results.backend, results.why)
    last = [value.rollout.position[-1] for value in results.values]
    return taken, np.array(last).tobytes()


def start_server() -> None:
    """Run what takes no time in processes."""
    ad.run_many([0] * WORKERS, abs, backend="processes", workers=WORKERS)


def measure_case(case: Case, ways: Sequence[str], rounds: int) -> list[dict[str, Any]]:
    """Return a row for each way: medians, and ratios round by round.

    The ratio of the least wall times is beside them: where others work on the machine
    at times, it comes nearest to what the machine does alone.
    """
    found: dict[str, list[Measurement]] = {way: [] for way in ways}
    for _ in range(rounds):
        bits = set()
        for way in ways:
            taken, positions = measure(case, way)
            found[way].append(taken)
            bits.add(positions)
        if len(bits) != 1:
            raise RuntimeError(f"{case.name}: the results differ")
    rows = []
    for way, taken in found.items():
        pairs = list(zip(found["serial"], taken, strict=True))
        quicker = sorted(serial.wall / other.wall for serial, other in pairs)
        rows.append(
            {
                **case._asdict(),
                "way": way,
                "wall_time": statistics.median(m.wall for m in taken),
                "times_as_quick": statistics.median(quicker),
                "times_as_quick_range": [quicker[0], quicker[-1]],
                "least_ratio": min(m.wall for m in found["serial"])
                / min(m.wall for m in taken),
                "cpu_ratio": statistics.median(b.cpu / a.cpu for a, b in pairs),
                "load": statistics.median(m.load for m in taken),
                "chosen": sorted({m.chosen for m in taken}),
                "why": taken[-1].why,
            }
        )
    return rows


def measure_starts(rounds: int) -> dict[str, float]:
    """Return medians of what workers take to start [s], the first and later ones."""
    cold, warm = [], []
    for _ in range(rounds):
        close_server()
        for times in (cold, warm):
            start = time.perf_counter()
            start_server()
            times.append(time.perf_counter() - start)
    close_server()
    return {"cold": statistics.median(cold), "warm": statistics.median(warm)}


def print_rows(rows: Sequence[dict[str, Any]]) -> None:
    """Print one case as a table."""
    first = rows[0]
    print(
        f"\n{first['name']}: {first['num_runs']} runs of {first['duration']:g} s, "
        f"steps of {1e3 * first['time_step']:g} ms"
    )
    print(
        "           wall [s]  x as quick (range)     of the least  CPU / serial  load  "
        "chosen"
    )
    for row in rows:
        low, high = row["times_as_quick_range"]
        print(
            f"{row['way']:10}{row['wall_time']:9.2f}{row['times_as_quick']:10.2f} "
            f"({low:.2f} to {high:.2f}){row['least_ratio']:14.2f}"
            f"{row['cpu_ratio']:14.2f}{row['load']:6.1f}  "
            f"{', '.join(row['chosen'])}"
        )


def main() -> None:
    """Print the tables, and write them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="one round, a tenth of it")
    parser.add_argument("--case", action="append", choices=[c.name for c in CASES])
    parser.add_argument("--way", action="append", choices=WAYS[1:])
    parser.add_argument("--runs", type=int, help="how many, in place of a case's own")
    parser.add_argument("--output", type=Path, metavar="DIR")
    options = parser.parse_args()
    rounds = 1 if options.quick else options.rounds
    # Imports that the first run brings along are nobody's.
    measure(Case("warm-up", 1, 0.1, 1e-3), "serial")
    starts = measure_starts(rounds)
    print(f"{available_cores()} cores, {WORKERS} workers, {rounds} rounds; medians")
    print(f"workers start within {starts['cold']:.2f} s, later {starts['warm']:.2f} s")
    rows = []
    for case in CASES:
        if options.case and case.name not in options.case:
            continue
        if options.quick:
            case = case._replace(num_runs=max(2, case.num_runs // 10))
        if options.runs:
            case = case._replace(num_runs=options.runs)
        ways = ["serial", *(options.way or WAYS[1:])]
        rows.append(measure_case(case, ways, rounds))
        print_rows(rows[-1])
    print(f"\nthe goal of the first: at least {GOAL} x as quick")
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
        data = {
            "cores": available_cores(),
            "workers": WORKERS,
            "rounds": rounds,
            "starts": starts,
            "rows": [row for case_rows in rows for row in case_rows],
        }
        path = options.output / "many.json"
        path.write_text(json.dumps(data, indent=2) + "\n")


if __name__ == "__main__":
    main()
