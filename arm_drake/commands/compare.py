"""The command `arm-drake compare`: differences of two logs."""

import argparse
import dataclasses as dc
import json
import textwrap
from pathlib import Path
from typing import Any

from arm_drake.output_files import check_plot_path, check_writable
from arm_drake.rollout.comparison import Comparison, compare
from arm_drake.rollout.rollout import TIME, Rollout

# Exit codes.
_EQUAL, _DIFFERENT = 0, 1

# So many quantities are in a picture, and listed.
_MAX_PANELS, _MAX_ROWS = 12, 40

# So many other differences are told in a picture without any.
_MAX_LINES = 6


def run_compare(options: argparse.Namespace) -> int:
    """Compare two logs as the command line says; return the exit code."""
    if options.plot is not None:
        check_plot_path(options.plot)
        check_writable(options.plot)
    a, b = (Rollout.load(file, options.name) for file in (options.a, options.b))
    found = compare(a, b, options.tolerance)
    if options.plot is not None:
        _plot(options.plot, a, b, found)
    if options.json:
        print(json.dumps(to_json(found)))
    else:
        print(to_text(found))
        if options.plot is not None:
            print(f"plot: {options.plot}")
    return _EQUAL if found.is_equal else _DIFFERENT


def to_json(found: Comparison) -> dict[str, Any]:
    """Return a comparison as plain data for JSON."""
    return {
        "equal": found.is_equal,
        "tolerance": found.tolerance,
        "rows": found.num_rows,
        "interpolated": found.is_interpolated,
        "differences": list(found.differences),
        "inputs": list(found.inputs),
        "columns": [dc.asdict(column) for column in found.columns],
    }


def to_text(found: Comparison) -> str:
    """Return a comparison for people."""
    lines = list(found.differences)
    between = ", B interpolated" if found.is_interpolated else ""
    compared = f"{len(found.columns)} quantities in {found.num_rows} rows{between}"
    if different := found.different:
        listed = different[:_MAX_ROWS]
        width = max(len(column.name) for column in listed)
        head = ("largest", "at [s]", "rms", "final", "missing rows")
        lines += ["", f"{'':{width}}  " + "  ".join(f"{h:>12}" for h in head)]
        for column in listed:
            cells = (column.largest, column.at, column.rms, column.final)
            texts = ["-" if cell is None else f"{cell:.6g}" for cell in cells]
            texts.append(str(column.num_missing))
            row = "  ".join(f"{text:>12}" for text in texts)
            lines.append(f"{column.name:{width}}  {row}")
        if len(different) > len(listed):
            lines.append(f"and {len(different) - len(listed)} more")
        lines.append("")
    if found.inputs:
        lines += ["made of different things:", *(f"  {text}" for text in found.inputs)]
    within = f" within {found.tolerance:g}" if found.tolerance else ""
    verdict = f"equal{within}" if found.is_equal else "different"
    return "\n".join([*lines, f"{verdict}: {compared}"])


def _plot(path: Path, a: Rollout, b: Rollout, found: Comparison) -> None:
    """Draw the quantities that differ most."""
    # Not at the top: who draws nothing must not wait for matplotlib.
    from arm_drake.visualization.analysis_plots import plot_comparison

    names = [column.name for column in found.different[:_MAX_PANELS]]
    parts = []
    for rollout in (a, b):
        columns = rollout.columns()
        parts.append((columns[TIME], [columns[name] for name in names]))
    remark = "no difference"
    if found.differences:
        shown = [textwrap.shorten(each, 90) for each in found.differences[:_MAX_LINES]]
        remark = "\n".join(["no quantity that both have differs, but:", *shown])
    plot_comparison(path, names, *parts, remark=remark)
