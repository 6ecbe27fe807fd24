"""The cost of a page: drawing, memory, a browser that stands still, Ctrl-C.

A Chromium runs in a process of its own, so that the processor time of this one is that
of the simulation, of Meshcat and of the page's server. Runs of one kind and another
take turns; the table has medians.

    python -m tests.benchmarks.page [PART ...]

The parts are drawing, headless, memory, live, stopped and interrupt; all without words.
"""

import argparse
import contextlib
import gc
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
from pydrake.systems.primitives import VectorLogSink

import arm_drake as ad
from arm_drake.description.entry import bundled_motions
from tests import test_interrupt
from tests.test_memory import empty_logs, resident_memory

# Robots and the motions that keep them moving; 6 and 20 joints.
ROBOTS = {"doosan_a0912": "tutorial", "teslabot": "air_curls"}

# How a real-time run may be shown.
KINDS = ("headless", "undrawn", "page", "browser")

# How long a run is [s], and how often it is repeated.
DURATION, RUNS = 6.0, 3

# What we aim at: share of a real-time run, and time from Ctrl-C to the end [s].
GOAL_SHARE, GOAL_INTERRUPT = 0.03, 1.0

# How long memory is watched, simulated and in real time [min].
FAST_MINUTES, LIVE_MINUTES = 20, 3


@contextlib.contextmanager
def open_chromium(url: str) -> Iterator[psutil.Process]:
    """Show a page in a Chromium that is a process of its own, and end it then."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.benchmarks.page", "--browser", url],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    if process.stdout.readline() != "ready\n":
        raise RuntimeError("no Chromium")
    try:
        yield psutil.Process(process.pid)
    finally:
        process.stdin.close()
        process.wait(30.0)


def show_until_told(url: str) -> None:
    """Be that process."""
    from arm_drake.visualization.screenshot import open_browser

    with open_browser() as browser:
        page = browser.new_page()
        page.goto(url)
        page.wait_for_selector("#sections .widget")
        page.wait_for_timeout(2000.0)
        print("ready", flush=True)
        sys.stdin.read()


def simulate(robot: str, **options: Any) -> ad.Simulation:
    """Return a simulation of a bundled robot; options are those of `build_diagram`."""
    settings = ad.SimulationOptions(frame_rate=0.0)
    diagram = ad.build_diagram(ad.load_robot(robot), options=settings, **options)
    return ad.Simulation(diagram)


def motion_of(robot: str) -> ad.Motion:
    """Return the motion that keeps a robot moving."""
    return ad.load_motion(bundled_motions(robot)[ROBOTS[robot]])


def measure_drawing(robot: str) -> dict[str, float]:
    """Return the processor's share [%] of real-time runs, and what a picture takes.

    They are headless, not drawn, drawn on a page, and that with a browser; the first
    in %, the last in ms.
    """
    from arm_drake.visualization.page import Page
    from arm_drake.visualization.page.live_simulation import LiveSimulation

    motion = motion_of(robot)
    shares: dict[str, list[float]] = {kind: [] for kind in KINDS}
    alone = simulate(robot)
    pictures: list[float] = []
    with Page() as page:
        sim = simulate(robot, meshcat=page.meshcat)
        live: Any = LiveSimulation(page, sim, motion=motion)
        draw, tell = live.views.draw, live._tell

        def draw_timed() -> None:
            start = time.perf_counter()
            draw()
            pictures.append(time.perf_counter() - start)

        for _ in range(RUNS):
            alone.reset()
            start = time.process_time()
            alone.run(DURATION, motion, realtime_rate=1.0)
            shares["headless"].append(time.process_time() - start)
            for kind in KINDS[1:]:
                live.reset()
                is_drawn = kind != "undrawn"
                live.views.draw = draw_timed if is_drawn else nothing
                live._tell = tell if is_drawn else nothing
                with contextlib.ExitStack() as stack:
                    if kind == "browser":
                        stack.enter_context(open_chromium(page.url))
                    start = time.process_time()
                    live.run(DURATION)
                    shares[kind].append(time.process_time() - start)
    found = {k: 100.0 * statistics.median(v) / DURATION for k, v in shares.items()}
    return {
        **found,
        "drawing": found["browser"] - found["undrawn"],
        "picture": 1e3 * statistics.median(pictures),
    }


def nothing(*arguments: Any) -> None:
    """Do nothing."""


def time_headless(is_imported: bool) -> float:
    """Return the processor time of a headless run per simulated second [ms]."""
    sim = simulate("doosan_a0912")
    if is_imported:
        pass
    start = time.process_time()
    sim.run(DURATION, motion_of("doosan_a0912"))
    return 1e3 * (time.process_time() - start) / DURATION


def measure_headless() -> dict[str, float]:
    """Return medians of headless runs [ms/s], without and with a page's modules."""
    times: dict[str, list[float]] = {"without": [], "with": []}
    for _ in range(RUNS):
        for kind in times:
            done = subprocess.run(
                [sys.executable, "-m", "tests.benchmarks.page", "--headless", kind],
                capture_output=True,
                text=True,
                check=True,
            )
            times[kind].append(float(done.stdout))
    return {kind: statistics.median(of_kind) for kind, of_kind in times.items()}


def count_log(sim: ad.Simulation) -> int:
    """Return how many bytes of samples the logs hold."""
    context = sim.simulator.get_context()
    logs = [
        system.FindLog(context)
        for system in sim.diagram.GetSystems()
        if isinstance(system, VectorLogSink)
    ]
    return sum(log.data().nbytes + log.sample_times().nbytes for log in logs)


def measure_memory(robot: str, *, keeps_log: bool) -> dict[str, float]:
    """Return how memory grows as fast as it goes [MB per simulated 10 min].

    Args:
        robot: The robot.
        keeps_log: Whether the logs grow, as in a user's run.
    """
    from arm_drake.visualization.page import Page
    from arm_drake.visualization.page.live_simulation import LiveSimulation

    with Page() as page:
        sim = simulate(robot, meshcat=page.meshcat)
        live = LiveSimulation(page, sim, realtime_rate=0.0)
        for what in ("ghost", "frames"):
            live.views.show(what)
        live.views.set_trail(
            list(next(iter(sim.robots.values())).description.links)[-1]
        )
        rows = []
        for minute in range(FAST_MINUTES + 1):
            if not keeps_log:
                empty_logs(sim)
            gc.collect()
            rows.append((minute, resident_memory(), count_log(sim)))
            live.run(60.0)
    return slopes(rows)


def measure_live(robot: str) -> dict[str, float]:
    """Return how memory grows in real time with a browser [MB per 10 min]."""
    from arm_drake.visualization.page import Page
    from arm_drake.visualization.page.live_simulation import LiveSimulation

    motion = motion_of(robot)
    with Page() as page:
        sim = simulate(robot, meshcat=page.meshcat)
        live = LiveSimulation(page, sim, motion=motion)
        with open_chromium(page.url):
            rows = []
            for quarter in range(4 * LIVE_MINUTES + 1):
                empty_logs(sim)
                gc.collect()
                rows.append((quarter / 4.0, resident_memory(), count_log(sim)))
                live.run(15.0)
    return slopes(rows)


def slopes(rows: list[tuple[float, int, int]]) -> dict[str, float]:
    """Return what grows, from minutes, resident memory and logs in bytes.

    The first fifth doesn't count: there everything is allocated once.
    """
    late = rows[len(rows) // 5 :]
    minutes, resident, logs = zip(*late, strict=True)
    return {
        "resident": 10.0 * statistics.linear_regression(minutes, resident).slope / 1e6,
        "logs": 10.0 * statistics.linear_regression(minutes, logs).slope / 1e6,
        "first": rows[0][1] / 1e6,
        "last": rows[-1][1] / 1e6,
    }


def measure_stopped(robot: str) -> dict[str, float]:
    """Return simulated seconds per second while a browser runs, and stands still."""
    from arm_drake.visualization.page import Page
    from arm_drake.visualization.page.live_simulation import LiveSimulation

    factors = {}
    with Page() as page:
        sim = simulate(robot, meshcat=page.meshcat)
        live = LiveSimulation(page, sim, motion=motion_of(robot))
        live.views.show("ghost")
        with open_chromium(page.url) as owner:
            browser = [p for p in owner.children(recursive=True) if p.is_running()]
            for kind in ("running", "stopped"):
                if kind == "stopped":
                    for process in browser:
                        process.suspend()
                start, before = time.perf_counter(), sim.time
                live.run(30.0)
                factors[kind] = (sim.time - before) / (time.perf_counter() - start)
            factors["browsers"] = page.num_browsers
            for process in browser:
                process.resume()
    return factors


def measure_in_own_process(function: str, *arguments: Any) -> dict[str, float]:
    """Return what a function of this module says in a fresh process."""
    call = json.dumps([function, *arguments])
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.page", "--call", call],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def print_drawing() -> None:
    """Print what drawing costs."""
    print("processor's share of a real-time run [%], and a picture [ms]")
    print("robot          headless  undrawn   page  browser  drawing  picture")
    for robot in ROBOTS:
        row = measure_in_own_process("drawing", robot)
        print(
            f"{robot:13s} {row['headless']:9.2f} {row['undrawn']:8.2f} "
            f"{row['page']:6.2f} {row['browser']:8.2f} "
            f"{row['drawing']:8.2f} {row['picture']:8.2f}"
        )
    print(f"goal: drawing at most {100.0 * GOAL_SHARE:.0f} %", flush=True)


def print_headless() -> None:
    """Print what the page's modules cost a headless run."""
    row = measure_headless()
    print(
        f"headless run [ms/s]: {row['without']:.1f} without the page's modules, "
        f"{row['with']:.1f} with them",
        flush=True,
    )


def print_memory() -> None:
    """Print how memory grows as fast as it goes."""
    print("memory [MB per 10 min]        resident    logs    from     to [MB]")
    for robot in ROBOTS:
        for kind in ("empty", "kept"):
            print_slopes(f"{robot}, logs {kind}", "memory", robot, kind)


def print_live() -> None:
    """Print how memory grows in real time, with a browser."""
    print_slopes("doosan_a0912, browser", "live", "doosan_a0912")


def print_slopes(title: str, *call: Any) -> None:
    """Print a row of slopes."""
    row = measure_in_own_process(*call)
    print(
        f"{title:28s} {row['resident']:9.2f} {row['logs']:7.2f} "
        f"{row['first']:7.1f} {row['last']:6.1f}",
        flush=True,
    )


def print_stopped() -> None:
    """Print the real-time factor with a browser that stands still."""
    row = measure_in_own_process("stopped", "doosan_a0912")
    print(
        f"real-time factor: {row['running']:.3f} with a browser, {row['stopped']:.3f} "
        f"while it stands still; {row['browsers']} left after 30 s",
        flush=True,
    )


def print_interrupt() -> None:
    """Print how long it takes to end."""
    print("from Ctrl-C to the end [s]")
    for name in test_interrupt.STATES:
        with tempfile.TemporaryDirectory() as folder:
            ended = test_interrupt.interrupt(name, Path(folder))
        print(f"{name:20s} {ended.took:6.2f}  exit code {ended.code}", flush=True)
    print(f"goal: at most {GOAL_INTERRUPT:.0f} s, but for files")


PARTS = {
    "drawing": print_drawing,
    "headless": print_headless,
    "memory": print_memory,
    "live": print_live,
    "stopped": print_stopped,
    "interrupt": print_interrupt,
}


def call(function: str, *arguments: str) -> dict[str, float]:
    """Measure in this process."""
    if function == "memory":
        robot, kind = arguments
        return measure_memory(robot, keeps_log=kind == "kept")
    functions = {
        "drawing": measure_drawing,
        "live": measure_live,
        "stopped": measure_stopped,
    }
    return functions[function](*arguments)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    for own in ("--browser", "--headless", "--call"):
        parser.add_argument(own, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.browser:
        show_until_told(options.browser)
    elif options.headless:
        print(time_headless(options.headless == "with"))
    elif options.call:
        print(json.dumps(call(*json.loads(options.call))))
    else:
        for part in options.parts or PARTS:
            PARTS[part]()


if __name__ == "__main__":
    main()
