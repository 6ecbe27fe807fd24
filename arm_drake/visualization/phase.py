"""Velocity over position of each joint."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from arm_drake import interfaces
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.plot_panels import (
    LIMIT,
    WANTED,
    Picture,
    add_legend,
    choose_grid,
    draw_line,
    make_panels,
    see_least,
    write_note,
)
from arm_drake.visualization.quantities import JointLimits, read_limits, unit_of

_LINE = "#0072b2"

# Columns, and width and height of a panel [inch], up to so many panels.
_GRIDS = (
    (1, 1, 5.0, 4.2),
    (2, 2, 4.2, 3.6),
    (6, 3, 3.4, 2.8),
    (12, 4, 3.0, 2.4),
    (30, 5, 2.8, 2.2),
)
_LARGEST = (7, 2.6, 2.0)

# The view grows by at most this part of its size for a limit to be seen.
_NEAR = 0.5


def plot_phase(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return velocity over position, a panel for each joint, with its limits.

    Args:
        rollout: The rollout; limits of position and velocity are of its description.
        joints: Which joints.
    """
    num_columns, width, height = choose_grid(_GRIDS, _LARGEST, len(joints))
    limits = read_limits(rollout.description)
    units = [
        [
            unit_of(rollout, joint, of)
            for of in (interfaces.POSITION, interfaces.VELOCITY)
        ]
        for joint in joints
    ]
    # Of a few that slide the unit stands above the panel, not to repeat all others.
    is_mixed = len({unit for unit, _ in units}) > 1
    titles = [
        f"{joint} [{', '.join(unit)}]" if is_mixed and unit[0] == "m" else joint
        for joint, unit in zip(joints, units, strict=True)
    ]
    picture, panels = make_panels(titles, num_columns, (width, height))
    for panel, joint, (q_unit, v_unit) in zip(panels, joints, units, strict=True):
        column = rollout.joint_names.index(joint)
        q, v = rollout.position[:, column], rollout.velocity[:, column]
        panel.grid(alpha=0.3)
        panel.xaxis.set_major_locator(MaxNLocator(4))
        draw_line(panel, q, v, color=_LINE, lw=1.2, label="measured")
        rows = np.flatnonzero(np.isfinite(q) & np.isfinite(v))
        for at, marker, label in ((0, "o", "start"), (-1, "s", "end")):
            if len(rows):
                point = [q[rows[at]]], [v[rows[at]]]
                style: dict[str, Any] = {
                    "color": WANTED[0],
                    "mfc": "white",
                    "ls": "",
                    "ms": 6,
                }
                panel.plot(*point, marker=marker, label=label, **style)
        see_least(panel, q_unit, along="x")
        see_least(panel, v_unit)
        write_note(panel, _draw_limits(panel, limits.get(joint, JointLimits())))
    if panels:
        q_unit, v_unit = next((unit for unit in units if unit[0] == "rad"), units[0])
        picture.supxlabel(f"position [{q_unit}]", fontsize="medium")
        picture.supylabel(f"velocity [{v_unit}]", fontsize="medium")
    add_legend(picture, panels)
    return picture


def _draw_limits(panel: Axes, limits: JointLimits) -> str:
    """Draw the limits that are near; return the others as a text."""
    left, right = panel.get_xlim()
    bottom, top = panel.get_ylim()
    far = []
    if not _draw_near(panel.axvline, panel.set_xlim, (left, right), limits[:2]):
        far.append(f"{limits.lower:.3g} … {limits.upper:.3g}")
    bounds = (-limits.velocity, limits.velocity)
    if not _draw_near(panel.axhline, panel.set_ylim, (bottom, top), bounds):
        far.append(f"±{limits.velocity:.3g}")
    return f"limits {', '.join(far)}" if far else ""


def _draw_near(
    draw: Callable[..., object],
    show: Callable[[float, float], object],
    view: tuple[float, float],
    bounds: Sequence[float],
) -> bool:
    """Draw those of two bounds that are near a view; return whether all are drawn."""
    low, high = view
    room = _NEAR * (high - low)
    near = [bound for bound in bounds if low - room <= bound <= high + room]
    for bound in near:
        draw(bound, color=LIMIT, ls="--", lw=1.0, label="limit")
    margin = 0.05 * (high - low)
    show(
        min([low, *(bound - margin for bound in near)]),
        max([high, *(bound + margin for bound in near)]),
    )
    return len(near) == sum(map(math.isfinite, bounds))
