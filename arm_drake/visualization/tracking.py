"""What joints were to do, and what they did; and how far one was from the other."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from arm_drake.arrays import Array
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.plot_panels import (
    DASHES,
    LIMIT,
    MEASURED,
    WANTED,
    Picture,
    Unit,
    add_legend,
    choose_unit,
    draw_line,
    make_time_panels,
    peak_of,
    say_below,
    see_least,
    write_note,
)
from arm_drake.visualization.quantities import Tracked, track

# A tolerance farther away than so many of the largest errors is said, not drawn.
_FAR = 4.0


class Tolerance(NamedTuple):
    """How far off a joint was allowed to be, by a goal."""

    # From when to when [s]; both are the same at the end of a goal.
    start: float
    end: float

    # [rad] or [m].
    value: float


def plot_tracking(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return reference and measurement over time, a panel for each joint.

    Args:
        rollout: The rollout.
        joints: Which joints.
    """
    tracked = track(rollout, joints)
    picture, panels = make_time_panels([f"{t.joint} [{t.unit}]" for t in tracked])
    styles = _Styles(tracked)
    for panel, each in zip(panels, tracked, strict=True):
        style: dict[str, Any] = {"color": MEASURED, "lw": 3, "label": "measured"}
        draw_line(panel, rollout.time, each.measured, **style)
        for label, wanted in each.wanted.items():
            style = {"color": styles.colour(label), "ls": styles.dashes(label)}
            draw_line(panel, rollout.time, wanted, lw=1.2, label=label, **style)
        see_least(panel, each.unit)
    add_legend(picture, panels)
    return picture


def plot_error(rollout: Rollout, joints: Sequence[str]) -> Picture:
    """Return reference less measurement over time, with tolerances of goals.

    A joint of which nothing was wanted has no panel. All angles are in one unit, and so
    are all lengths.

    Args:
        rollout: The rollout.
        joints: Which joints.
    """
    tracked = track(rollout, joints)
    followers = [each for each in tracked if each.wanted]
    units = _common_units(followers)
    picture, panels = make_time_panels(
        [f"{each.joint} [{units[each.unit].name}]" for each in followers]
    )
    styles = _Styles(followers)
    for panel, each in zip(panels, followers, strict=True):
        unit = units[each.unit]
        panel.axhline(0.0, color="0.6", lw=0.8)
        for label, wanted in each.wanted.items():
            error = unit.factor * (wanted - each.measured)
            style = {"color": styles.colour(label), "label": f"{label} − measured"}
            draw_line(panel, rollout.time, error, lw=1.2, **style)
        see_least(panel, each.unit, 1e-4 * unit.factor)
        if not each.unit.endswith("/s"):
            _draw_tolerances(panel, _tolerances(rollout, each.joint), unit)
    idle = [each.joint for each in tracked if not each.wanted]
    if idle:
        say_below(picture, "nothing was wanted of", idle)
    add_legend(picture, panels)
    return picture


def _common_units(tracked: Sequence[Tracked]) -> dict[str, Unit]:
    errors: dict[str, list[Array]] = {}
    for each in tracked:
        found = errors.setdefault(each.unit, [])
        found += [wanted - each.measured for wanted in each.wanted.values()]
    return {unit: choose_unit(unit, peak_of(found)) for unit, found in errors.items()}


class _Styles:
    """Lines look alike that have the same label."""

    def __init__(self, tracked: Sequence[Tracked]) -> None:
        labels = dict.fromkeys(label for each in tracked for label in each.wanted)
        self._numbers = {label: number for number, label in enumerate(labels)}

    def colour(self, label: str) -> str:
        return WANTED[self._numbers[label] % len(WANTED)]

    def dashes(self, label: str) -> Any:
        return DASHES[self._numbers[label] % len(DASHES)]


def _tolerances(rollout: Rollout, joint: str) -> Iterator[Tolerance]:
    """Yield how far off goals allowed a joint to be, where they say so themselves."""
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
                    yield Tolerance(start, end, value)


def _draw_tolerances(panel: Axes, found: Iterator[Tolerance], unit: Unit) -> None:
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
