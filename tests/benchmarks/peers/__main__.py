"""Our simulation of robots beside other engines', in one run.

The same robots, motion, held commands, gains and records in every engine, in turns, in
one process, and a converged reference that none of them computed. Engines that aren't
installed are left out; the table says so.

    python -m tests.benchmarks.peers [--quick] [--output DIR] [--page]
"""

import argparse
import dataclasses as dc
import importlib
import json
import operator
import platform
import shutil
import statistics
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tests.benchmarks.peers import plots, report, run, startup

ROOT = Path(__file__).resolve().parents[3]

# The page of the docs, and the line below which it is made anew.
PAGE = ROOT / "docs/measurements.md"
MARK = "<!-- What is below is written by `python -m tests.benchmarks.peers --page`. -->"
PICTURES = {
    "work_precision.png": "Errors against costs, a line for each engine and servo",
    "scaling.png": "Costs against the number of arms, and of joints",
}

PARTS = ("arms", "sizes", "recording", "startup", "ticks")


def main() -> None:
    """Measure, write benchmarks.json, tables and pictures, print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.benchmarks.peers", description=__doc__.partition("\n")[0]
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="shorter, and rougher: a goal's first cycles count for a quarter",
    )
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, help="turns; by default 7, quickly 3")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument(
        "--clock",
        choices=("wall", "cpu"),
        default="wall",
        help="what the tables count; benchmarks.json has both",
    )
    parser.add_argument(
        "--page",
        action="store_true",
        help=f"renew the tables and pictures of {PAGE.relative_to(ROOT)}, too",
    )
    options = parser.parse_args()
    runs = options.runs or (3 if options.quick else 7)
    found = measure(options.only, runs, is_quick=options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    text = write(found, options.clock, options.output)
    print(text)
    if options.page:
        renew_page(text, options.output)


def measure(parts: list[str], runs: int, *, is_quick: bool) -> dict[str, Any]:
    """Return everything that was measured.

    Args:
        parts: What to measure, of PARTS.
        runs: Number of turns.
        is_quick: Whether less is enough.
    """
    peers, missing = run.load_peers()
    start = time.monotonic()
    found: dict[str, Any] = {"missing": missing, "exactness": {}, "results": []}
    if "arms" in parts:
        duration = 1.0 if is_quick else 10.0
        results, found["exactness"] = run.compare_arms(peers, duration, runs)
        found["results"] += results
    if "sizes" in parts:
        duration = 0.5 if is_quick else 2.0
        found["results"] += run.compare_sizes(peers, duration, runs, is_quick=is_quick)
    if "recording" in parts:
        found["results"] += run.compare_records(1.0 if is_quick else 4.0, runs)
    if "startup" in parts:
        few = min(runs, 5)
        found["startup"] = startup.measure_startup(few, engines=list(peers))
    if "ticks" in parts:
        found |= measure_ticks(3 if is_quick else 21)
    found["took"] = time.monotonic() - start
    return found


def measure_ticks(turns: int) -> dict[str, Any]:
    """Return what ticks of controllers take, or why that isn't known."""
    # It knows much of our insides; what it can't do must not stop the rest.
    try:
        ticks = importlib.import_module("tests.benchmarks.ticks")
    except ImportError as error:
        return {"ticks_problem": f"no ticks: {error}"}
    rows = [
        ticks.measure(name, subject, goal, turns)._asdict()
        for name, (subject, goal) in ticks.subjects().items()
    ]
    return {"ticks": rows}


def renew_page(text: str, folder: Path) -> None:
    """Put tables and pictures into the page of the docs.

    Args:
        text: The tables.
        folder: Where the pictures are.
    """
    head, mark, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    pictures = ""
    for name in PICTURES:
        if (folder / name).exists():
            shutil.copyfile(folder / name, PAGE.parent / name)
            pictures += f"![{PICTURES[name]}]({name})\n\n"
    PAGE.write_text(f"{head}{mark}\n{pictures}{text}", encoding="utf-8")


def write(found: dict[str, Any], clock: str, folder: Path) -> str:
    """Write what was found, as numbers, tables and pictures; return the tables.

    Args:
        found: What `measure` returned.
        clock: What counts as time: "wall" or "cpu".
        folder: Where to write.
    """
    results, times = found["results"], operator.attrgetter(clock)
    data = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "versions": {name: _version(name) for name in _PACKAGES},
        **found,
        "results": [dc.asdict(result) for result in results],
    }
    (folder / "benchmarks.json").write_text(json.dumps(data, indent=1) + "\n")
    text = _preface(found, clock) + report.markdown(
        results,
        times,
        startup=found.get("startup"),
        ticks=found.get("ticks", ()),
        missing=found["missing"],
        exactness=found["exactness"],
    )
    (folder / "benchmarks.md").write_text(text)
    if found["exactness"]:
        robots = list(found["exactness"])
        file = folder / "work_precision.png"
        plots.plot_work_precision(results, robots, times, file)
    if any(result.group.endswith("joints") for result in results):
        plots.plot_scaling(results, times, folder / "scaling.png")
    return text


_PACKAGES = ("drake", "mujoco", "dartpy", "pybullet", "pin", "numpy")


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _preface(found: dict[str, Any], clock: str) -> str:
    """Return how much the machine was disturbed: what the wall's clock saw beside."""
    shares = [
        wall / cpu
        for result in found["results"]
        for wall, cpu in zip(result.wall, result.cpu, strict=True)
    ]
    versions = ", ".join(f"{p} {v}" for p in _PACKAGES if (v := _version(p)))
    text = f"{versions}. Times by the {clock} clock; {found['took']:.0f} s in all.\n"
    if "ticks_problem" in found:
        text += f"{found['ticks_problem']}\n"
    if shares:
        median, most = statistics.median(shares), max(shares)
        text += (
            f"The wall's clock saw {median:.2f} times the processor's time (median; "
            f"{most:.2f} at most): more than 1 is what else ran on the machine.\n"
        )
    return text + "\n"


if __name__ == "__main__":
    main()
