"""One page with what tells most of a rollout."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.errors import InputError
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.path import draw_way, find_way
from arm_drake.visualization.plot_panels import (
    LIMIT,
    Picture,
    choose_unit,
    draw_line,
    make_picture,
    peak_of,
    say_below,
    see_least,
    shorten,
)
from arm_drake.visualization.quantities import Tracked, track, unit_of

_SIZE = (12.0, 7.5)  # inches

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

    In each panel the joints that stand out most are named.

    Args:
        rollout: The rollout.
        joints: Which joints.
        link: Whose way is drawn; None is the end effector.

    Raises:
        InputError: If there is no such link.
    """
    picture = make_picture(*_SIZE)
    grid = picture.add_gridspec(2, 2)
    first = picture.add_subplot(grid[0, 0])
    panels = [first, *(picture.add_subplot(grid[k], sharex=first) for k in (1, 2))]
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.set_xlabel("time [s]")
        panel.tick_params(labelsize="small")
    tracked = track(rollout, joints)
    # Joints that nobody commands, such as those of casters, are in the way.
    followers = [each for each in tracked if each.wanted] or tracked
    measured = {each.joint: each.measured for each in followers}
    ranges = {joint: values - values[:1] for joint, values in measured.items()}
    pen = _Pen(rollout.time)
    pen.draw(panels[0], measured, ranges)
    panels[0].set_title(f"measured [{_units(followers)}]")
    for each in followers:
        see_least(panels[0], each.unit)
    errors = {
        each.joint: _largest([w - each.measured for w in each.wanted.values()])
        for each in followers
        if each.wanted
    }
    unit = choose_unit("", peak_of(errors.values()))
    errors = {joint: unit.factor * error for joint, error in errors.items()}
    pen.draw(panels[1], errors)
    name = f"reference − measured [{_units(followers, unit.name)}]"
    panels[1].set_title(name if errors else "no references")
    for each in followers:  # Errors of some 1e-6 tell something.
        see_least(panels[1], each.unit, 1e-4 * unit.factor)
    _draw_efforts(panels[2], pen, rollout, joints)
    try:
        tip = rollout.find_tip() if link is None else link
        draw_way(picture, grid[1, 1], *find_way(rollout, tip), tip)
    except InputError as error:
        if link is not None:
            raise
        say_below(picture, f"no way of the end effector: {error}")
    return picture


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
    ) -> None:
        """Draw lines, those that stand out in colour and with their names.

        Args:
            panel: Where to draw.
            lines: What to draw by joint, each of shape (N,).
            ranks: Those with the largest peaks here stand out; None is the lines.
        """
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
            look = {"lw": 1.4, "label": shorten(name, 2.5), **self._look(name)}
            draw_line(panel, self._time, lines[name], **look)
        if others:
            what = "other" if named else "joint"
            text = f"{len(others)} {what}{'s' if len(others) > 1 else ''}"
            panel.plot([], [], color=_GREY, label=text)
        if lines:
            panel.legend(fontsize="x-small", loc="best")

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
