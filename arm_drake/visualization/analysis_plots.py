"""Plots of linear models, of two rollouts and of studies.

This module imports matplotlib: import it only where something is drawn.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps

from arm_drake.arrays import Array
from arm_drake.output_files import check_plot_path, writing
from arm_drake.visualization.plot_panels import (
    LIMIT,
    MEASURED,
    add_legend,
    draw_line,
    make_picture,
    shorten,
)

_BODE_SIZE = (11.0, 6.5)  # inches


def plot_bode(
    path: Path, frequencies: Array, responses: Mapping[str, Mapping[str, Array]]
) -> None:
    """Draw responses, a column for each kind of them, a line for each joint.

    `frequencies` [rad/s], shape (k,); `responses` are complex, shape (k,), by the title
    of the column and the name of the joint. It may raise OutputError.
    """
    check_plot_path(path)
    picture = make_picture(*_BODE_SIZE)
    panels = picture.subplots(2, len(responses), sharex=True, squeeze=False)
    hertz = frequencies / (2.0 * np.pi)
    for column, (title, lines) in enumerate(responses.items()):
        gain, phase = panels[:, column]
        gain.set_title(title, fontsize="medium")
        for name, response in lines.items():
            gain.loglog(hertz, np.abs(response), lw=1.3, label=name)
            degrees = np.degrees(np.unwrap(np.angle(response)))
            phase.semilogx(hertz, degrees, lw=1.3)
        gain.set_ylabel("gain")
        phase.set_ylabel("phase [°]")
        phase.set_xlabel("frequency [Hz]")
        for panel in (gain, phase):
            panel.grid(which="both", alpha=0.25)
    if responses:
        panels[0, -1].legend(fontsize="small")
    with writing(path):
        picture.savefig(path)


_COMPARISON_PANEL = (5.5, 1.6)  # inches


def plot_comparison(
    path: Path,
    names: Sequence[str],
    a: tuple[Array, Sequence[Array]],
    b: tuple[Array, Sequence[Array]],
    *,
    remark: str = "no difference",
) -> None:
    """Draw quantities of two rollouts: each with both, and what B has more than A.

    `names` have units. `a` and `b` are times [s], shape (N,), and values of each
    quantity; `remark` stands there if nothing is drawn. It may raise OutputError.
    """
    check_plot_path(path)
    rows = max(1, len(names))
    picture = make_picture(
        2.0 * _COMPARISON_PANEL[0], _COMPARISON_PANEL[1] * rows + 0.8
    )
    if not names:
        picture.text(0.5, 0.5, remark, ha="center", va="center", wrap=True)
    else:
        panels = picture.subplots(rows, 2, sharex=True, squeeze=False)
        time = a[0][(a[0] >= b[0][0]) & (a[0] <= b[0][-1])]
        for index, name in enumerate(names):
            both, apart = panels[index]
            draw_line(both, a[0], a[1][index], color=MEASURED, lw=3, label="A")
            draw_line(both, b[0], b[1][index], color="k", ls="--", lw=1, label="B")
            title = shorten(name, _COMPARISON_PANEL[0])
            both.set_title(title, loc="left", fontsize="small")
            first, second = (np.interp(time, t, v[index]) for t, v in (a, b))
            draw_line(apart, time, second - first, color=LIMIT, lw=1.2, label="B − A")
            both.grid(alpha=0.3)
            apart.grid(alpha=0.3)
        add_legend(picture, panels[0])
        for panel in panels[-1]:
            panel.set_xlabel("time [s]")
    with writing(path):
        picture.savefig(path)


# So much of what is varied and measured is drawn.
_MOST = 5

_STUDY_PANEL = 2.6  # inches

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
    varied = [
        name
        for name, value in table[0].items()
        if name not in (*_SKIPPED, *measures) and isinstance(value, int | float)
    ][:_MOST]
    shown = list(measures or ["success"])[:_MOST]
    columns, rows = 1 + len(varied), len(shown) + 1
    picture = make_picture(max(6.0, _STUDY_PANEL * columns), _STUDY_PANEL * rows)
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
