"""Tables and pictures of the results."""

import math
import statistics
from collections.abc import Iterable, Sequence
from typing import Any

from tests.benchmarks.peers.ratios import (
    Choice,
    Ratio,
    Times,
    best_error,
    cheapest,
    correction,
    goals,
    most_exact,
    ratio,
)
from tests.benchmarks.peers.run import Result

# The row that the others of a table are compared with.
ANCHOR = Choice("MuJoCo", "position actuators, implicitfast", (0.001,))

# What is and what isn't the same for all, for those who read the tables.
NOTES = """\
* One URDF per robot, read by every engine; nothing is drawn, links of one robot pass
  through each other, joints have the URDF's damping and no dry friction.
* All are told what our JointTrajectoryController tells our drive, at 100 Hz and held;
  positions and velocities are recorded at 100 Hz. Two cubics, there and back.
* `error` is the largest distance from a converged reference of the same law (Radau on
  Pinocchio's dynamics for PD, DOP853 for the ideal servo); `with half a step` is that
  of q + (h/2) v or q - (h/2) v where it is less; `tracking` is the distance from the
  motion. Engines with a law of their own have no reference.
* The weight is held: by inverse dynamics in our servo and in those written in Python,
  by `gravcomp` in MuJoCo; DART and PyBullet have no gravity, which costs them least.
* Ours has effort and velocity limits, an observer, a controller manager and a
  broadcaster besides, and so has the diagram in C++ alone its limits and observer; the
  peers have none of them. PD servos have no effort limits.
* Mimic joints are constraints in ours, MuJoCo and PyBullet (a gear, which its solver
  meets roughly), and no joints of their own in DART. There is no contact.
* `fast` has no contact and no observer; it isn't there for robots with mimic joints,
  which it leaves to `accurate`.
* MuJoCo and Pinocchio with our servo have its law in Python, at every step.
"""

# Errors and times at which engines are compared.
LIMITS = (1e-3, 2.3e-4, 1e-4)
PRICES = (2.0, 5.0, 10.0, 20.0)


def markdown(
    results: Sequence[Result],
    times: Times,
    *,
    startup: dict[str, Any] | None = None,
    ticks: Sequence[dict[str, Any]] = (),
    missing: Sequence[str] = (),
    exactness: dict[str, float] | None = None,
) -> str:
    """Return all tables as Markdown.

    Args:
        results: What was measured.
        times: What counts as the times of a result [ms per simulated second].
        startup: What `measure_startup` found.
        ticks: Rows of the controllers' ticks.
        missing: Engines that aren't installed.
        exactness: How exact the references are [rad], by robot.
    """
    groups = list(dict.fromkeys(result.group for result in results))
    robots = [group for group in groups if exactness and group in exactness]
    parts = [NOTES, *(f"{name}: not installed." for name in missing)]
    for group in robots:
        own = [result for result in results if result.group == group]
        parts += [
            f"## {group}",
            f"Reference exact to {exactness[group]:.0e} rad." if exactness else "",
            _contest(own, times),
            _equal_errors(own, times),
            _equal_prices(own, times),
            _goals(own, times),
        ]
    rest = [result for result in results if result.group not in robots]
    if rest:
        parts += ["## Size and recording", _sizes(rest, times)]
    if startup:
        parts += ["## Start and memory", _startup(startup)]
    if ticks:
        parts += ["## Ticks of controllers", _ticks(ticks)]
    return "\n\n".join(filter(None, parts)) + "\n"


def _contest(results: Sequence[Result], times: Times) -> str:
    anchor = next((r for r in results if ANCHOR.fits(r)), None)
    rows = []
    for result in sorted(results, key=lambda r: (r.engine, r.setting, r.step)):
        name = [result.engine, result.setting, f"{1e3 * result.step:g}"]
        if result.problem:
            rows.append([*name, result.problem, *[""] * 5])
            continue
        has_error = result.error is not None and result.law != "own"
        rows.append(
            [
                *name,
                _median(times(result)),
                _spread(times(result)),
                f"{result.error:.1e}" if has_error else "other law",
                f"{best_error(result):.1e} {correction(result)}" if has_error else "",
                f"{result.track:.1e}",
                str(ratio(times(result), times(anchor))) if anchor else "",
            ]
        )
    head = [
        "engine",
        "servo",
        "step [ms]",
        "ms per simulated s",
        "range",
        "error [rad]",
        "with half a step",
        "tracking [rad]",
        "x MuJoCo 1 ms",
    ]
    return _table(head, rows)


def _choices(results: Iterable[Result]) -> list[Choice]:
    """Return the ways to use engines that have an error, corrected if that helps."""
    helped: dict[tuple[str, str], bool] = {}
    for result in results:
        if result.law != "own" and result.error is not None:
            name = result.engine, result.setting
            helped[name] = helped.get(name, False) or bool(correction(result))
    return [
        Choice(*name, is_corrected=is_corrected)
        for name, is_helped in helped.items()
        for is_corrected in ((False, True) if is_helped else (False,))
    ]


def _equal_errors(results: Sequence[Result], times: Times) -> str:
    """Return a table of costs at equal error."""
    rows = []
    for choice in _choices(results):
        found = [cheapest(results, choice, limit, times) for limit in LIMITS]
        cells = [
            f"{_median(times(r))} ({1e3 * r.step:g} ms)" if r else "-" for r in found
        ]
        rows.append([_name(choice), *cells])
    heads = [f"error <= {limit:g} rad" for limit in LIMITS]
    return _table(["cost at equal error: ms per simulated s", *heads], rows)


def _equal_prices(results: Sequence[Result], times: Times) -> str:
    """Return a table of errors at equal cost."""
    rows = []
    for choice in _choices(results):
        found = [most_exact(results, choice, price, times) for price in PRICES]
        cells = [
            f"{choice.error(r):.1e} ({1e3 * r.step:g})" if r else "-" for r in found
        ]
        rows.append([_name(choice), *cells])
    heads = [f"<= {price:g} ms/s" for price in PRICES]
    return _table(["error at equal cost: rad (step in ms)", *heads], rows)


def _name(choice: Choice) -> str:
    corrected = ", half a step corrected" if choice.is_corrected else ""
    return f"{choice.engine}, {choice.setting}{corrected}"


def _goals(results: Sequence[Result], times: Times) -> str:
    rows = []
    for goal in goals():
        found = goal.measure(results, times)
        is_met = isinstance(found, Ratio) and found.median <= goal.most
        has_goal = not math.isnan(goal.most)
        verdict = "yes" if is_met else "no" if isinstance(found, Ratio) else ""
        rows.append(
            [
                goal.what,
                str(found),
                f"{goal.most:g}" if has_goal else "",
                verdict if has_goal else "",
            ]
        )
    return _table(["ratio of times", "median (range)", "goal", "met"], rows)


def _sizes(results: Sequence[Result], times: Times) -> str:
    rows = [
        [
            result.group,
            result.name,
            result.problem or _median(times(result)),
            _spread(times(result)) if times(result) else "",
            f"{result.track:.1e}" if result.track is not None else "",
        ]
        for result in results
    ]
    head = ["", "engine", "ms per simulated s", "range", "tracking [rad]"]
    return _table(head, rows)


def _startup(found: dict[str, Any]) -> str:
    rows = [
        [name, *(f"{row[key]:.0f}" if key in row else "" for key in keys)]
        for keys in [("import", "load", "build", "step", "total", "memory")]
        for name, row in found["medians"].items()
    ]
    more = f"{found['memory per further diagram']:.1f}"
    rows.append(["doosan_a0912, each further diagram", *[""] * 5, more])
    head = ["", "import", "load", "build", "first step", "total [ms]", "memory [MB]"]
    return f"{_table(head, rows)}\n\n{_startup_goals(found)}"


def _startup_goals(found: dict[str, Any]) -> str:
    medians = found["medians"]
    warm = medians["doosan_a0912, warm"]
    sim = medians["arm-drake sim lab5_arm, warm"]["total"]
    rows = [
        ("import to first step, warm [ms]", warm["total"], 350.0),
        ("arm-drake sim, 0.1 s, warm [ms]", sim, 500.0),
        ("memory at the first step [MB]", warm["memory"], 140.0),
        ("memory per further diagram [MB]", found["memory per further diagram"], 1.0),
    ]
    cells = [
        [what, f"{value:.1f}", f"{most:g}", "yes" if value <= most else "no"]
        for what, value, most in rows
    ]
    return _table(["", "median", "goal", "met"], cells)


def _ticks(rows: Sequence[dict[str, Any]]) -> str:
    cells = [
        [
            row["name"],
            f"{row['median']:.1f}",
            f"{row['least']:.1f} to {row['most']:.1f}",
            f"{row['net']:.1f}",
        ]
        for row in rows
    ]
    return _table(["tick [us]", "median", "range", "without reading"], cells)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _median(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.2f}"


def _spread(values: Sequence[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f}"
