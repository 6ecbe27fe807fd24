"""What joints' actuators applied, against what they can."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.plot_panels import (
    DASHES,
    LIMIT,
    MEASURED,
    WANTED,
    Picture,
    add_legend,
    draw_line,
    make_time_panels,
    peak_of,
    see_least,
    write_note,
)
from arm_drake.visualization.quantities import commanded, unit_of

# A limit is drawn if an effort reached this part of it; else it is said.
_NEAR = 0.2


def plot_effort(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return efforts over time, with their limits and when they were there.

    Args:
        rollout: The rollout.
        joints: Which joints.
    """
    units = [unit_of(rollout, joint, interfaces.EFFORT) for joint in joints]
    titles = [f"{joint} [{unit}]" for joint, unit in zip(joints, units, strict=True)]
    picture, panels = make_time_panels(titles)
    saturation = rollout.effort_saturation()
    for panel, joint, unit in zip(panels, joints, units, strict=True):
        column = rollout.joint_names.index(joint)
        effort = rollout.effort[:, column]
        limit = float(rollout.effort_limit[column])
        draw_line(panel, rollout.time, effort, color=MEASURED, lw=2, label="applied")
        wanted = commanded(rollout, joint, interfaces.EFFORT)
        if wanted is not None:
            style = {"color": WANTED[0], "ls": DASHES[0], "lw": 1.0}
            draw_line(panel, rollout.time, wanted, label="commanded effort", **style)
        see_least(panel, unit)
        note = _draw_limit(panel, peak_of([effort]), limit, unit)
        if joint in saturation:
            _shade(panel, rollout.time, rollout.is_at_limit[:, column])
            note = f"at its limit for {saturation[joint]:.3g} s"
        write_note(panel, note)
    add_legend(picture, panels)
    return picture


def _draw_limit(panel: Axes, peak: float, limit: float, unit: str) -> str:
    """Draw the limit of an effort, if it is near; return what to say of it."""
    if not np.isfinite(limit):
        return "no limit"
    if peak >= _NEAR * limit:
        for bound in (-limit, limit):
            panel.axhline(bound, color=LIMIT, ls="--", lw=1.0, label="limit")
    part = f", {100.0 * peak / limit:.2g} %" if limit else ""
    return f"at most {peak:.3g} of {limit:.4g} {unit}{part}"


def _shade(panel: Axes, time: Array, is_at_limit: NDArray[np.bool_]) -> None:
    """Shade the time of rows, each until the next one."""
    row = float(time[-1] - time[0]) / (len(time) - 1)
    steps = np.diff(np.concatenate([[0], is_at_limit.astype(int), [0]]))
    starts, ends = np.flatnonzero(steps > 0), np.flatnonzero(steps < 0)
    spans = [
        (float(time[start]), float(time[end - 1]) + row - float(time[start]))
        for start, end in zip(starts, ends, strict=True)
    ]
    panel.broken_barh(
        spans,
        (0.0, 1.0),
        transform=panel.get_xaxis_transform(),
        color=LIMIT,
        alpha=0.25,
        lw=0,
        label="at the limit",
    )
