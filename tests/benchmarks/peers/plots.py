"""Pictures of the results: errors against costs, and costs against sizes."""

import statistics
from collections.abc import Sequence
from pathlib import Path

import matplotlib

from tests.benchmarks.peers.ratios import Times, best_error
from tests.benchmarks.peers.run import Result

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure


def plot_work_precision(
    results: Sequence[Result], robots: Sequence[str], times: Times, file: Path
) -> None:
    """Draw the error of each engine over its cost, a line per servo.

    Args:
        results: What was measured.
        robots: Robots that have errors.
        times: What counts as the times of a result [ms per simulated second].
        file: Picture to write.
    """
    figure, axes = plt.subplots(
        1,
        len(robots),
        figsize=(5 * len(robots), 6),
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    shown = [r for r in results if not r.problem and r.error and r.law != "own"]
    names = list(dict.fromkeys((r.engine, r.setting) for r in shown))
    for axis, robot in zip(axes[0], robots, strict=True):
        for number, name in enumerate(names):
            line = [
                r for r in shown if (r.group, r.engine, r.setting) == (robot, *name)
            ]
            if not line:
                continue
            cost = [statistics.median(times(r)) for r in line]
            color = f"C{number}"
            # A servo that is exact would squeeze all others into a corner.
            errors = [max(r.error or 0.0, 1e-6) for r in line]
            axis.loglog(cost, errors, "o-", color=color, label=", ".join(name))
            best = [max(best_error(r), 1e-6) for r in line]
            axis.loglog(cost, best, ".:", color=color, alpha=0.6)
        axis.set_title(f"{robot}; dotted: half a step corrected")
        axis.set_xlabel("ms per simulated second")
        axis.grid(visible=True, which="both", alpha=0.3)
    axes[0][0].set_ylabel("largest error [rad] (1e-6: or less)")
    _finish(figure, file)


def plot_scaling(results: Sequence[Result], times: Times, file: Path) -> None:
    """Draw the cost of each engine over the number of arms, and of joints.

    Args:
        results: What was measured.
        times: What counts as the times of a result [ms per simulated second].
        file: Picture to write.
    """
    figure, axes = plt.subplots(1, 2, figsize=(12, 6), layout="constrained")
    for axis, what in zip(axes, ("arm", "joints"), strict=True):
        rows = [r for r in results if _size(r, what) is not None and not r.problem]
        for name in dict.fromkeys(r.name for r in rows):
            line = [r for r in rows if r.name == name]
            sizes = [_size(r, what) or 0 for r in line]
            cost = [statistics.median(times(r)) for r in line]
            style = "o-" if line[0].step < 0.005 else "s--"
            axis.loglog(sizes, cost, style, label=name)
        axis.set_xlabel(f"number of {what.rstrip('s')}s")
        axis.set_ylabel("ms per simulated second")
        axis.set_xticks(ticks := sorted({_size(r, what) for r in rows}), ticks)
        axis.minorticks_off()
        axis.grid(visible=True, which="both", alpha=0.3)
    _finish(figure, file)


def _finish(figure: Figure, file: Path) -> None:
    """Add one legend for all, and write the picture."""
    lines = {}
    for axis in figure.axes:
        handles, labels = axis.get_legend_handles_labels()
        lines |= dict(zip(labels, handles, strict=True))
    figure.legend(lines.values(), lines, loc="outside lower center", ncols=3)
    figure.savefig(file, dpi=80)
    plt.close(figure)


def _size(result: Result, what: str) -> int | None:
    """Return the number of a group's name, as in "4 arms", if it is of that kind."""
    number, _, kind = result.group.partition(" ")
    return int(number) if kind.startswith(what) and number.isdigit() else None
