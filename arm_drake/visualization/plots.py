"""Plots of a rollout and of a plan, one function for each kind.

They import matplotlib, so that who draws nothing must not import them; `output_files`
has what is known without it. None uses pyplot: a picture needs no window.
"""

import dataclasses as dc
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.description.joints import JointLimits
from arm_drake.errors import InputError, suggest
from arm_drake.output_files import PLOT_KINDS, check_plot_path, writing
from arm_drake.planning.inverse_kinematics import forward_kinematics
from arm_drake.planning.motion_planning import Plan
from arm_drake.planning.timing import motion_limits
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.plot_panels import (
    COMMANDED,
    DASHES,
    LIMIT,
    MEASURED,
    Picture,
    Tracked,
    Unit,
    add_legend,
    choose_grid,
    choose_unit,
    commanded,
    draw_line,
    make_panels,
    make_picture,
    make_time_panels,
    peak_of,
    read_limits,
    say_below,
    say_if_empty,
    see_least,
    shorten,
    track,
    unit_of,
    write_note,
)

# A limit is drawn if an effort reached this part of it; else it is said.
_NEAR_LIMIT = 0.2


def plot_effort(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return efforts over time, with their limits and when they were reached."""
    units = [unit_of(rollout, joint, interfaces.EFFORT) for joint in joints]
    titles = [f"{joint} [{unit}]" for joint, unit in zip(joints, units, strict=True)]
    picture, panels = make_time_panels(titles)
    saturation = rollout.effort_saturation()
    for panel, joint, unit in zip(panels, joints, units, strict=True):
        column = rollout.joint_names.index(joint)
        effort = rollout.effort[:, column]
        limit = float(rollout.effort_limit[column])
        draw_line(panel, rollout.time, effort, color=MEASURED, lw=2, label="applied")
        reference = commanded(rollout, joint, interfaces.EFFORT)
        if reference is not None:
            style = {"color": COMMANDED[0], "ls": DASHES[0], "lw": 1.0}
            draw_line(panel, rollout.time, reference, label="commanded effort", **style)
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
    if peak >= _NEAR_LIMIT * limit:
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


_PATH_SIZE = (10.0, 5.4)  # inches

# A way that rises by less than this part of its extent is seen from above.
_FLAT = 0.02

# The smallest extent of what is seen [m], and as a part of the largest one.
_LEAST = 0.01
_SLIM = 0.4

_MEASURED: dict[str, Any] = {"color": MEASURED, "lw": 3, "label": "measured"}
_REFERENCE_LINE: dict[str, Any] = {
    "color": COMMANDED[0],
    "ls": DASHES[0],
    "lw": 1.2,
    "label": "reference",
}


def plot_path(rollout: Rollout, link: str | None) -> Picture:
    """Return the way of a link's origin in the world, in space and over time.

    None is the end effector. Where joints had references, it shows where these would
    have had it. Without a description, or such a link, it is an InputError.
    """
    link = rollout.find_tip() if link is None else link
    way, reference = find_way(rollout, link)
    picture = make_picture(*_PATH_SIZE)
    grid = picture.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    draw_way(picture, grid[:, 0], way, reference, link)
    first = picture.add_subplot(grid[0, 1])
    panels = [first, *(picture.add_subplot(grid[k, 1], sharex=first) for k in (1, 2))]
    for column, (panel, name) in enumerate(zip(panels, "xyz", strict=True)):
        panel.grid(alpha=0.3)
        panel.set_ylabel(f"{name} [m]")
        draw_line(panel, rollout.time, way[:, column], **_MEASURED)
        if reference is not None:
            draw_line(panel, rollout.time, reference[:, column], **_REFERENCE_LINE)
        see_least(panel, "m")
        panel.tick_params(labelbottom=column == 2, labelsize="small")
    panels[-1].set_xlabel("time [s]")
    if reference is not None:
        apart = np.linalg.norm(reference - way, axis=1)
        peak = peak_of([apart])
        unit = choose_unit("m", peak)
        text = f"at most {peak * unit.factor:.3g} {unit.name} from its reference"
        panels[0].set_title(text, loc="right", fontsize="small")
    add_legend(picture, [picture.axes[0]])
    return picture


def find_way(rollout: Rollout, link: str) -> tuple[Array, Array | None]:
    """Return where a link was, and where references would have had it."""
    way = rollout.link_poses(link)[:, :3]
    position = rollout.position.copy()
    has_reference = np.zeros(len(position), dtype=bool)
    for name, values in _references(rollout):
        column = rollout.joint_names.index(name)
        is_finite = np.isfinite(values)
        position[is_finite, column] = values[is_finite]
        has_reference |= is_finite
    reference = dc.replace(rollout, position=position).link_poses(link)[:, :3]
    reference[~has_reference] = np.nan
    differs = np.any(np.abs(reference - way) > 0.0)
    return way, reference if differs else None


def draw_way(
    picture: Picture, place: SubplotSpec, way: Array, reference: Array | None, link: str
) -> Axes:
    """Draw a way in space, or from above if it is flat; return the panel."""
    is_finite = way[np.isfinite(way).all(axis=1)]
    extent = np.ptp(is_finite, axis=0) if len(is_finite) else np.zeros(3)
    is_flat = bool(extent[2] < _FLAT * max(extent[:2].max(), _LEAST))
    num_axes = 2 if is_flat else 3
    title = shorten(f"way of {link}" + (", from above" if is_flat else ""), 4.5)
    panel = picture.add_subplot(place, projection=None if is_flat else "3d")
    panel.set_title(title, loc="left", fontsize="small")
    panel.plot(*way[:, :num_axes].T, **_MEASURED)
    if reference is not None:
        panel.plot(*reference[:, :num_axes].T, **_REFERENCE_LINE)
    if len(is_finite):
        point: dict[str, Any] = {"ls": "", "ms": 6, "mfc": "white", "color": LIMIT}
        ends = is_finite[:, :num_axes]
        panel.plot(*ends[:1].T, marker="o", label="start", **point)
        panel.plot(*ends[-1:].T, marker="s", label="end", **point)
    panel.tick_params(labelsize="small")
    panel.set_xlabel("x [m]")
    panel.set_ylabel("y [m]")
    _frame(
        panel, is_finite[:, :num_axes] if len(is_finite) else np.zeros((1, num_axes))
    )
    return panel


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
    """Yield joints and the positions that they were to have, each of shape (N,)."""
    for reference in rollout.references.values():
        names: Sequence[str] = reference.joint_names
        for column, name in enumerate(names):
            if name in rollout.joint_names:
                yield name, reference.position[:, column]


_OVERVIEW_SIZE = (13.0, 7.5)  # inches

# Joints that stand out have colours and are named; the others are grey.
_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#000000",
)
_NAMED = 5
_GREY = "0.8"

# A joint with less than this part of the largest peak doesn't stand out.
_TELLING = 0.01


def plot_overview(rollout: Rollout, joints: Sequence[str], link: str | None) -> Picture:
    """Return positions, errors, efforts and the end effector's way on one page.

    In each panel the joints that stand out most are named. Where goals were aborted or
    rejected, there are marks.
    """
    picture = make_picture(*_OVERVIEW_SIZE)
    grid = picture.add_gridspec(2, 2)
    first = picture.add_subplot(grid[0, 0])
    panels = [first, *(picture.add_subplot(grid[k], sharex=first) for k in (1, 2))]
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.set_xlabel("time [s]")
        panel.tick_params(labelsize="small")
    tracked = track(rollout, joints)
    # Joints that nobody commands, such as those of casters, are in the way.
    followers = [each for each in tracked if each.references] or tracked
    measured = {each.joint: each.measured for each in followers}
    ranges = {joint: values - values[:1] for joint, values in measured.items()}
    pen = _Pen(rollout.time)
    references = {each.joint: [*each.references.values()] for each in followers}
    pen.draw(panels[0], measured, ranges, references)
    what = "measured and reference" if any(references.values()) else "measured"
    panels[0].set_title(f"{what} [{_units(followers)}]")
    for each in followers:
        see_least(panels[0], each.unit)
    errors = {
        each.joint: _largest([w - each.measured for w in each.references.values()])
        for each in followers
        if each.references
    }
    unit = choose_unit("", peak_of(errors.values()))
    errors = {joint: unit.factor * error for joint, error in errors.items()}
    pen.draw(panels[1], errors)
    name = f"reference − measured [{_units(followers, unit.name)}]"
    panels[1].set_title(name if errors else "no references")
    for each in followers:  # Errors of some 1e-6 tell something.
        see_least(panels[1], each.unit, 1e-4 * unit.factor)
    _draw_efforts(panels[2], pen, rollout, joints)
    for panel in panels:
        _mark_failed_goals(panel, rollout)
        _add_legend_beside(panel)
    try:
        tip = rollout.find_tip() if link is None else link
        draw_way(picture, grid[1, 1], *find_way(rollout, tip), tip)
    except InputError as error:
        if link is not None:
            raise
        say_below(picture, f"no way of the end effector: {error}")
    return picture


# How goals that failed are marked, by their status.
_MARKS = {"ABORTED": "x", "REJECTED": "v"}


def _mark_failed_goals(panel: Axes, rollout: Rollout) -> None:
    """Draw a line, with a mark at its top, where goals were aborted or rejected."""
    for goal in rollout.goals:
        if goal.status in _MARKS and goal.ended_at is not None:
            panel.axvline(goal.ended_at, color=LIMIT, ls=":", lw=1.2, zorder=1.0)
            panel.plot(
                [goal.ended_at],
                [0.97],
                transform=panel.get_xaxis_transform(),
                color=LIMIT,
                marker=_MARKS[goal.status],
                ms=7,
                mew=2,
                ls="",
                label=f"goal {goal.status.lower()}",
            )


def _add_legend_beside(panel: Axes) -> None:
    """Add a legend to the right of a panel, each label once."""
    handles, labels = panel.get_legend_handles_labels()
    lines = dict(zip(labels, handles, strict=True))
    if lines:
        panel.legend(
            lines.values(),
            lines.keys(),
            fontsize="x-small",
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.2,
            frameon=False,
        )


def _draw_efforts(
    panel: Axes, pen: "_Pen", rollout: Rollout, joints: Sequence[str]
) -> None:
    """Draw efforts as parts of their limits; where no joint has one, as they are."""
    columns = {joint: rollout.joint_names.index(joint) for joint in joints}
    limits = {joint: rollout.effort_limit[column] for joint, column in columns.items()}
    shares = {
        joint: 100.0 * rollout.effort[:, columns[joint]] / limit
        for joint, limit in limits.items()
        if 0.0 < limit < np.inf
    }
    if shares:
        pen.draw(panel, shares)
        panel.set_title("effort [% of its limit]")
        see_least(panel, "%")
        if peak_of(shares.values()) > 50.0:
            for bound in (-100.0, 100.0):
                panel.axhline(bound, color=LIMIT, ls="--", lw=1.0)
        return
    pen.draw(panel, {joint: rollout.effort[:, c] for joint, c in columns.items()})
    units = {joint: unit_of(rollout, joint, interfaces.EFFORT) for joint in joints}
    panel.set_title(f"effort [{', '.join(sorted(set(units.values())))}], no limits")
    for unit in set(units.values()):
        see_least(panel, unit)


class _Pen:
    """Draws lines of joints; a joint has the same look in all panels."""

    def __init__(self, time: Array) -> None:
        """Take the times of the rows [s], shape (N,)."""
        self._time = time
        self._looks: dict[str, dict[str, Any]] = {}

    def draw(
        self,
        panel: Axes,
        lines: Mapping[str, Array],
        ranks: Mapping[str, Array] | None = None,
        references: Mapping[str, Sequence[Array]] | None = None,
    ) -> None:
        """Draw lines, those that stand out in colour and with their names.

        References of these are dashed, over lines that are wide and pale.
        """
        wanted = references or {}
        peaks = {name: peak_of([v]) for name, v in (ranks or lines).items()}
        ranked = sorted(lines, key=lambda name: -peaks[name])
        least = _TELLING * max(peaks.values(), default=0.0)
        telling = [name for name in ranked if peaks[name] > least]
        # All of a few.
        is_few = len(lines) <= len(_COLOURS)
        named = telling if is_few else telling[:_NAMED]
        others = [name for name in lines if name not in named]
        for name in others:
            draw_line(panel, self._time, lines[name], color=_GREY, lw=0.8)
        for name in named:
            for values in wanted.get(name, ()):
                # One entry of the legend, below, is for all.
                dashes = {"color": self._look(name)["color"], "ls": (0, (4, 2))}
                dashes |= {"lw": 1.2, "zorder": 3.0, "label": f"_reference {name}"}
                draw_line(panel, self._time, values, **dashes)
        for name in named:
            look = {"lw": 1.4, "label": shorten(name, 1.7), **self._look(name)}
            look |= {"lw": 3.5, "alpha": 0.45} if wanted.get(name) else {}
            draw_line(panel, self._time, lines[name], **look)
        if any(wanted.get(name) for name in named):
            panel.plot([], [], color="0.3", ls=(0, (4, 2)), lw=1.2, label="reference")
        if others:
            what = "other" if named else "joint"
            text = f"{len(others)} {what}{'s' if len(others) > 1 else ''}"
            panel.plot([], [], color=_GREY, label=text)

    def _look(self, name: str) -> dict[str, Any]:
        number, colour = divmod(len(self._looks), len(_COLOURS))
        look = {"color": _COLOURS[colour], "ls": "--" if number % 2 else "-"}
        return self._looks.setdefault(name, look)


def _largest(errors: Sequence[Array]) -> Array:
    """Return the error with the largest absolute value in each row, shape (N,)."""
    stacked = np.array(errors)
    size = np.where(np.isfinite(stacked), np.abs(stacked), -1.0)
    return np.asarray(np.take_along_axis(stacked, size.argmax(axis=0)[None], axis=0)[0])


def _units(tracked: Sequence[Tracked], prefix: str = "") -> str:
    return ", ".join(sorted({f"{prefix}{each.unit}" for each in tracked}, reverse=True))


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
_MAX_GROWTH = 0.5


def plot_phase(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return velocity over position, a panel for each joint, with its limits."""
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
                    "color": COMMANDED[0],
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
    far, (lower, upper) = [], limits.range
    if not _draw_near(panel.axvline, panel.set_xlim, (left, right), (lower, upper)):
        far.append(f"{lower:.3g} … {upper:.3g}")
    speed = math.inf if limits.velocity is None else limits.velocity
    if not _draw_near(panel.axhline, panel.set_ylim, (bottom, top), (-speed, speed)):
        far.append(f"±{speed:.3g}")
    return f"limits {', '.join(far)}" if far else ""


def _draw_near(
    draw: Callable[..., object],
    show: Callable[[float, float], object],
    view: tuple[float, float],
    bounds: Sequence[float],
) -> bool:
    """Draw those of two bounds that are near a view; return whether all are drawn."""
    low, high = view
    room = _MAX_GROWTH * (high - low)
    near = [bound for bound in bounds if low - room <= bound <= high + room]
    for bound in near:
        draw(bound, color=LIMIT, ls="--", lw=1.0, label="limit")
    margin = 0.05 * (high - low)
    show(
        min([low, *(bound - margin for bound in near)]),
        max([high, *(bound + margin for bound in near)]),
    )
    return len(near) == sum(map(math.isfinite, bounds))


# A tolerance farther away than so many of the largest errors is said, not drawn.
_FAR = 4.0


def plot_tracking(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return reference and measurement over time, a panel for each joint."""
    tracked = track(rollout, joints)
    picture, panels = make_time_panels([f"{t.joint} [{t.unit}]" for t in tracked])
    styles = _styles(tracked)
    for panel, each in zip(panels, tracked, strict=True):
        draw_line(panel, rollout.time, each.measured, **_MEASURED)
        for label, reference in each.references.items():
            style = {"lw": 1.2, "label": label, **styles[label]}
            draw_line(panel, rollout.time, reference, **style)
        see_least(panel, each.unit)
    add_legend(picture, panels)
    return picture


def plot_error(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return reference less measurement over time, with tolerances of goals.

    A joint without references has no panel. All angles are in one unit, and so
    are all lengths.
    """
    tracked = track(rollout, joints)
    followers = [each for each in tracked if each.references]
    units = _common_units(followers)
    picture, panels = make_time_panels(
        [f"{each.joint} [{units[each.unit].name}]" for each in followers]
    )
    styles = _styles(followers)
    for panel, each in zip(panels, followers, strict=True):
        unit = units[each.unit]
        panel.axhline(0.0, color="0.6", lw=0.8)
        for label, reference in each.references.items():
            error = unit.factor * (reference - each.measured)
            style = {"color": styles[label]["color"], "label": f"{label} − measured"}
            draw_line(panel, rollout.time, error, lw=1.2, **style)
        see_least(panel, each.unit, 1e-4 * unit.factor)
        if not each.unit.endswith("/s"):
            _draw_tolerances(panel, _tolerances(rollout, each.joint), unit)
    idle = [each.joint for each in tracked if not each.references]
    if idle:
        say_below(picture, "nothing was wanted of", idle)
    add_legend(picture, panels)
    return picture


def _common_units(tracked: Sequence[Tracked]) -> dict[str, Unit]:
    errors: dict[str, list[Array]] = {}
    for each in tracked:
        found = errors.setdefault(each.unit, [])
        found += [reference - each.measured for reference in each.references.values()]
    return {unit: choose_unit(unit, peak_of(found)) for unit, found in errors.items()}


def _styles(tracked: Sequence[Tracked]) -> dict[str, dict[str, Any]]:
    """Return how references look, by their labels: those of one label are alike."""
    labels = dict.fromkeys(label for each in tracked for label in each.references)
    looks = zip(itertools.cycle(COMMANDED), itertools.cycle(DASHES), strict=False)
    return {
        label: {"color": color, "ls": dashes}
        for label, (color, dashes) in zip(labels, looks, strict=False)
    }


def _tolerances(rollout: Rollout, joint: str) -> Iterator[tuple[float, float, float]]:
    """Yield how far off goals allowed a joint to be, where they say so themselves.

    From when to when [s], both the same at a goal's end, and how far [rad] or [m].
    """
    last = float(rollout.time[-1]) if len(rollout.time) else 0.0
    for record in rollout.goals:
        end = last if record.ended_at is None else record.ended_at
        for field, start in (
            ("path_tolerance", record.sent_at),
            ("goal_tolerance", end),
        ):
            for tolerance in record.goal.get(field) or ():
                value = float(tolerance.get("position", 0.0))
                # 0 is the controller's own, less is none.
                if tolerance.get("name") == joint and 0.0 < value < np.inf:
                    yield start, end, value


def _draw_tolerances(
    panel: Axes, found: Iterator[tuple[float, float, float]], unit: Unit
) -> None:
    """Draw tolerances: lines along the way, a bar at the end of a goal."""
    low, high = panel.get_ylim()
    largest = max(abs(low), abs(high))
    far = set()
    for start, end, value in found:
        allowed = unit.factor * value
        is_end = start == end
        name = "goal tolerance" if is_end else "path tolerance"
        if allowed > _FAR * largest:
            far.add(f"{name} ±{allowed:.3g} {unit.name}")
        elif is_end:
            style: dict[str, Any] = {"color": LIMIT, "marker": "_", "ms": 8, "lw": 1.0}
            panel.plot([end, end], [-allowed, allowed], label=name, **style)
        else:
            for bound in (-allowed, allowed):
                panel.plot(
                    [start, end],
                    [bound, bound],
                    color=LIMIT,
                    ls="--",
                    lw=1.0,
                    label=name,
                )
    write_note(panel, "\n".join(sorted(far)))


def plot_plan(plan: Plan) -> Picture:
    """Return a plan's joints over time, with limits, and the way of its link."""
    trajectory, limits = plan.trajectory, motion_limits(plan.robot)
    names, points = trajectory.joint_names, trajectory.points
    time = np.array([point.time_from_start.to_seconds() for point in points])
    most = np.array([limits[name] for name in names])
    position = np.array([point.positions for point in points])
    velocity = np.array([point.velocities for point in points]) / most[:, 0]
    acceleration = np.array([point.accelerations for point in points]) / most[:, 1]
    poses = [
        forward_kinematics(plan.robot, plan.positions_at(index), plan.frame)
        for index in range(len(points))
    ]
    picture = make_picture(*_OVERVIEW_SIZE)
    grid = picture.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    way = np.array([X.translation() for X in poses])
    draw_way(picture, grid[:, 0], way, None, plan.frame)
    rows = (
        ("position [rad or m]", position),
        ("velocity [% of its limit]", 100.0 * velocity),
        ("acceleration [% of its limit]", 100.0 * acceleration),
    )
    panels: list[Axes] = []
    for row, (title, values) in enumerate(rows):
        panel = picture.add_subplot(grid[row, 1], sharex=panels[0] if panels else None)
        panel.set_title(title, loc="left", fontsize="small")
        panel.grid(alpha=0.3)
        panel.tick_params(labelbottom=row == len(rows) - 1, labelsize="small")
        for column, name in enumerate(names):
            color = _COLOURS[column % len(_COLOURS)]
            draw_line(panel, time, values[:, column], color=color, lw=1.2, label=name)
        panels.append(panel)
    panels[-1].set_xlabel("time [s]")
    panels[0].legend(fontsize="x-small", ncols=2)
    title = f"{plan.duration:.2f} s, {1e3 * plan.clearance:.0f} mm from everything"
    picture.suptitle(title, fontsize="medium")
    return picture


def draw_rollout(
    rollout: Rollout,
    path: Path | None = None,
    *,
    kind: str = "overview",
    joints: Sequence[str] | None = None,
    link: str | None = None,
) -> Figure:
    """Return a picture of a rollout, of one of PLOT_KINDS; see `Rollout.plot`."""
    if kind not in PLOT_KINDS:
        raise InputError(
            f"unknown kind {kind!r} of a plot; {suggest(kind, PLOT_KINDS)}"
        )
    if link is not None and kind not in ("path", "overview"):
        raise InputError(f"a {kind} plot has no link; it is for path and overview")
    chosen = rollout.joint_names if joints is None else tuple(joints)
    for name in chosen:
        if name not in rollout.joint_names:
            hint = suggest(name, rollout.joint_names)
            raise InputError(f"no joint {name!r} in the rollout; {hint}")
    if path is not None:
        check_plot_path(path)
    picture = _draw(rollout, kind, chosen, link)
    if path is not None:
        with writing(path):
            picture.savefig(path)
    return picture


def draw_plan(plan: Plan, path: Path | None = None) -> Figure:
    """Return a picture of a plan: its joints over time, and the way of its link."""
    if path is not None:
        check_plot_path(path)
    picture = plot_plan(plan)
    if path is not None:
        with writing(path):
            picture.savefig(path)
    return picture


def _draw(
    rollout: Rollout, kind: str, joints: Sequence[str], link: str | None
) -> Figure:
    """Return a picture of a kind, which says so if there is nothing in it."""
    by_joint = {
        "tracking": plot_tracking,
        "error": plot_error,
        "effort": plot_effort,
        "phase": plot_phase,
    }
    if kind == "path":
        picture = plot_path(rollout, link)
    elif kind == "overview":
        picture = plot_overview(rollout, joints, link)
    else:
        picture = by_joint[kind](rollout, joints)
    say_if_empty(picture, len(rollout.time))
    return picture
