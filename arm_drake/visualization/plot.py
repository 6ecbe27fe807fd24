"""Pictures of a rollout, with matplotlib."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.output_files import check_suffix, writing

Array = NDArray[np.float64]

PLOT_SUFFIXES = (".png", ".svg", ".pdf")

# Beyond this many joints, two columns.
_JOINTS_PER_COLUMN = 6

_PANEL = (7.0, 1.5)  # inches


def check_plot_path(path: Path) -> None:
    """Raise OutputError if a picture can't be of this type."""
    check_suffix(path, "a picture", PLOT_SUFFIXES)


def plot_tracking(
    path: Path,
    *,
    time: Array,
    names: Sequence[str],
    types: Sequence[str],
    position: Array,
    references: Mapping[str, tuple[Sequence[str], Array]],
) -> None:
    """Draw reference and measured position, a panel per joint.

    Args:
        path: Picture to write.
        time: Times [s], shape (N,).
        names: The J joints.
        types: Their URDF types.
        position: Measured positions [rad] or [m], shape (N, J).
        references: Joints and wanted positions, shape (N, k), by controller.

    Raises:
        OutputError: If the picture can't be written.
    """
    check_plot_path(path)
    # Not at the top: a simulation without pictures must not wait for matplotlib.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    num_columns = 1 if len(names) <= _JOINTS_PER_COLUMN else 2
    num_rows = max(1, -(-len(names) // num_columns))
    width, height = _PANEL[0] * num_columns, _PANEL[1] * num_rows + 0.8
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(num_rows, num_columns, sharex=True, squeeze=False)
    panels = axes.T.ravel()
    for index, (name, joint_type) in enumerate(zip(names, types, strict=True)):
        panel = panels[index]
        panel.plot(time, position[:, index], color="C0", lw=3, label="measured")
        for controller, (joints, wanted) in references.items():
            if name in joints:
                column = list(joints).index(name)
                label = f"reference ({controller})"
                panel.plot(time, wanted[:, column], "k--", lw=1, label=label)
        unit = interfaces.unit(interfaces.POSITION, joint_type)
        # Names may be longer than a panel is high.
        panel.set_title(f"{name} [{unit}]", loc="left", fontsize="small")
        panel.grid(alpha=0.3)
        if (
            len(time) and np.ptp(position[:, index]) < 1e-3
        ):  # A still joint isn't noise.
            middle = float(position[:, index].mean())
            panel.set_ylim(middle - 0.05, middle + 0.05)
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    for column in range(num_columns):
        axes[-1, column].set_xlabel("time [s]")
    lines = {
        label: handle
        for panel in panels
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        lines.values(), lines.keys(), loc="outside upper center", ncols=len(lines)
    )
    with writing(path):
        figure.savefig(path, dpi=120)
