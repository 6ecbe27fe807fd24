"""Kinds of plots of a rollout and the files they are in, known without matplotlib."""

from pathlib import Path

from arm_drake.output_files import check_suffix

# What a plot of a rollout can show; the first is the default.
PLOT_KINDS = ("overview", "tracking", "error", "effort", "phase", "path")

PLOT_SUFFIXES = (".png", ".svg", ".pdf")


def check_plot_path(path: Path) -> None:
    """Raise OutputError if a picture can't be of this type."""
    check_suffix(path, "a picture", PLOT_SUFFIXES)
