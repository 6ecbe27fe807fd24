"""The way of a link through the world."""

import dataclasses as dc
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.gridspec import SubplotSpec

from arm_drake.arrays import Array
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.plot_panels import (
    DASHES,
    LIMIT,
    MEASURED,
    WANTED,
    Picture,
    add_legend,
    choose_unit,
    draw_line,
    make_picture,
    peak_of,
    see_least,
    shorten,
)

_SIZE = (10.0, 5.4)  # inches

# A way that rises by less than this part of its extent is seen from above.
_FLAT = 0.02

# The smallest extent of what is seen [m], and as a part of the largest one.
_LEAST = 0.01
_SLIM = 0.4

_MEASURED: dict[str, Any] = {"color": MEASURED, "lw": 3, "label": "measured"}
_WANTED: dict[str, Any] = {
    "color": WANTED[0],
    "ls": DASHES[0],
    "lw": 1.2,
    "label": "reference",
}


def plot_path(rollout: Rollout, link: str | None) -> Picture:
    """Return the way of a link's origin in the world, in space and over time.

    Where joints had references, it shows where these would have had it.

    Args:
        rollout: A rollout with a description.
        link: The link; None is the end effector.

    Raises:
        InputError: If the rollout has no description, or there is no such link.
    """
    link = rollout.find_tip() if link is None else link
    way, wanted = find_way(rollout, link)
    picture = make_picture(*_SIZE)
    grid = picture.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    draw_way(picture, grid[:, 0], way, wanted, link)
    first = picture.add_subplot(grid[0, 1])
    panels = [first, *(picture.add_subplot(grid[k, 1], sharex=first) for k in (1, 2))]
    for column, (panel, name) in enumerate(zip(panels, "xyz", strict=True)):
        panel.grid(alpha=0.3)
        panel.set_ylabel(f"{name} [m]")
        draw_line(panel, rollout.time, way[:, column], **_MEASURED)
        if wanted is not None:
            draw_line(panel, rollout.time, wanted[:, column], **_WANTED)
        see_least(panel, "m")
        panel.tick_params(labelbottom=column == 2, labelsize="small")
    panels[-1].set_xlabel("time [s]")
    if wanted is not None:
        apart = np.linalg.norm(wanted - way, axis=1)
        peak = peak_of([apart])
        unit = choose_unit("m", peak)
        text = f"at most {peak * unit.factor:.3g} {unit.name} from its reference"
        panels[0].set_title(text, loc="right", fontsize="small")
    add_legend(picture, [picture.axes[0]])
    return picture


def find_way(rollout: Rollout, link: str) -> tuple[Array, Array | None]:
    """Return where a link was, and where references would have had it.

    Args:
        rollout: A rollout with a description.
        link: Name of the link.

    Returns:
        x, y, z [m], shape (N, 3), each; no second one if references don't change it.
    """
    way = rollout.link_poses(link)[:, :3]
    position = rollout.position.copy()
    is_wanted = np.zeros(len(position), dtype=bool)
    for name, values in _references(rollout):
        column = rollout.joint_names.index(name)
        there = np.isfinite(values)
        position[there, column] = values[there]
        is_wanted |= there
    wanted = dc.replace(rollout, position=position).link_poses(link)[:, :3]
    wanted[~is_wanted] = np.nan
    differs = np.any(np.abs(wanted - way) > 0.0)
    return way, wanted if differs else None


def draw_way(
    picture: Picture, place: SubplotSpec, way: Array, wanted: Array | None, link: str
) -> Axes:
    """Draw a way in space, or from above if it is flat; return the panel.

    Args:
        picture: Where to draw.
        place: Its place there.
        way: x, y, z [m], shape (N, 3).
        wanted: The same of what was wanted, if anything was.
        link: Whose way it is.
    """
    there = way[np.isfinite(way).all(axis=1)]
    extent = np.ptp(there, axis=0) if len(there) else np.zeros(3)
    is_flat = bool(extent[2] < _FLAT * max(extent[:2].max(), _LEAST))
    num_axes = 2 if is_flat else 3
    title = shorten(f"way of {link}" + (", from above" if is_flat else ""), 4.5)
    panel = picture.add_subplot(place, projection=None if is_flat else "3d")
    panel.set_title(title, loc="left", fontsize="small")
    draw = _drawer(panel)
    draw(way[:, :num_axes], **_MEASURED)
    if wanted is not None:
        draw(wanted[:, :num_axes], **_WANTED)
    if len(there):
        point: dict[str, Any] = {"ls": "", "ms": 6, "mfc": "white", "color": LIMIT}
        draw(there[:1, :num_axes], marker="o", label="start", **point)
        draw(there[-1:, :num_axes], marker="s", label="end", **point)
    panel.tick_params(labelsize="small")
    panel.set_xlabel("x [m]")
    panel.set_ylabel("y [m]")
    _frame(panel, there[:, :num_axes] if len(there) else np.zeros((1, num_axes)))
    return panel


def _drawer(panel: Axes) -> Any:
    """Return what draws points of shape (N, 2) or (N, 3) as a line."""

    def draw(points: Array, **style: Any) -> None:
        panel.plot(*points.T, **style)

    return draw


def _frame(panel: Any, points: Array) -> None:
    """Show all points to scale, in a panel with two or three axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.55 * np.maximum(high - low, max(_LEAST, _SLIM * (high - low).max()))
    middle = (low + high) / 2.0
    panel.set_xlim(middle[0] - half[0], middle[0] + half[0])
    panel.set_ylim(middle[1] - half[1], middle[1] + half[1])
    if len(half) == 2:
        panel.set_aspect("equal", adjustable="box")
        panel.grid(alpha=0.3)
        return
    panel.set_zlim(middle[2] - half[2], middle[2] + half[2])
    panel.set_zlabel("z [m]")
    # Smaller than its place, which has to hold its labels, too.
    panel.set_box_aspect(tuple(half), zoom=0.85)
    panel.locator_params(nbins=4)


def _references(rollout: Rollout) -> Iterator[tuple[str, Array]]:
    """Yield joints and the positions that were wanted of them, each of shape (N,)."""
    for reference in rollout.references.values():
        names: Sequence[str] = reference.joint_names
        for column, name in enumerate(names):
            if name in rollout.joint_names:
                yield name, reference.position[:, column]
