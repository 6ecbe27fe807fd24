"""Pictures of a study with matplotlib: histograms, scatter, parallel coordinates."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake.output_files import writing
from arm_drake.visualization.plot import check_plot_path

# So much of what is varied and measured is drawn.
_MOST = 5

_PANEL = 2.6  # inches

_SKIPPED = ("run", "success", "seconds", "error")


def plot_study(
    path: Path, table: Sequence[Mapping[str, Any]], measures: Sequence[str]
) -> None:
    """Draw the rows of a study: measures over what is varied, and each one's values.

    A row of panels for each measure: its histogram, then it over each number that is
    varied; below, a line for each run through all of them, coloured by the first
    measure. It may raise OutputError.
    """
    check_plot_path(path)
    # Not at the top: a study without a picture must not wait for matplotlib.
    from arm_drake.visualization.plot_panels import make_picture

    varied = [
        name
        for name, value in table[0].items()
        if name not in (*_SKIPPED, *measures) and isinstance(value, int | float)
    ][:_MOST]
    shown = list(measures or ["success"])[:_MOST]
    columns, rows = 1 + len(varied), len(shown) + 1
    picture = make_picture(max(6.0, _PANEL * columns), _PANEL * rows)
    grid = picture.add_gridspec(rows, columns)
    numbers = {
        name: np.array([row[name] for row in table], dtype=float)
        for name in (*varied, *shown)
    }
    for k, measure in enumerate(shown):
        values = numbers[measure]
        is_known = np.isfinite(values)
        panel = picture.add_subplot(grid[k, 0])
        panel.hist(values[is_known], bins=min(30, 5 + len(table) // 10))
        panel.set_xlabel(measure, fontsize="small")
        panel.set_ylabel("runs", fontsize="small")
        for column, name in enumerate(varied, start=1):
            panel = picture.add_subplot(grid[k, column])
            panel.plot(numbers[name], values, ".", ms=3)
            panel.set_xlabel(name, fontsize="small")
            panel.set_ylabel(measure, fontsize="small")
            panel.locator_params(axis="x", nbins=3)
    _draw_parallel(picture.add_subplot(grid[-1, :]), numbers, shown[0])
    with writing(path):
        picture.savefig(path)


def _draw_parallel(panel: Any, numbers: Mapping[str, Any], first: str) -> None:
    """Draw a line for each run, each axis from its least to its largest number."""
    from matplotlib import colormaps

    parts = {}
    for name, values in numbers.items():
        known = values[np.isfinite(values)]
        low, high = (known.min(), known.max()) if known.size else (0.0, 1.0)
        parts[name] = (values - low) / (high - low if high > low else 1.0)
    lines = np.array(list(parts.values()))
    colors = colormaps["viridis"](np.nan_to_num(parts[first]))
    for line, color in zip(lines.T, colors, strict=True):
        panel.plot(line, color=color, lw=0.6, alpha=0.6)
    ends = [f"{name}\n{_ends(numbers[name])}" for name in parts]
    panel.set_xticks(range(len(parts)), ends, fontsize="small")
    panel.set_yticks([])


def _ends(values: Any) -> str:
    """Return the least and the largest number in words."""
    known = values[np.isfinite(values)]
    return f"{known.min():.3g} to {known.max():.3g}" if known.size else ""
