"""Panels of plots: one for each joint, lines, colours, units, legends."""

import io
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.description.joints import JointLimits
from arm_drake.errors import InputError
from arm_drake.rollout.link_poses import read_joints
from arm_drake.rollout.rollout import Rollout

# Colours that the colour-blind can tell apart, by Okabe and Ito.
MEASURED = "#56b4e9"
LIMIT = "#d55e00"
COMMANDED = ("#000000", "#cc79a7", "#009e73", "#e69f00", "#0072b2")
DASHES = ("--", ":", "-.", (0, (5, 1)), (0, (1, 1)))

# A line has at most about so many points, more than a large picture has pixels.
_MAX_POINTS = 20_000

# Columns of panels over time, and width and height of a panel [inch], up to so many.
_GRIDS = (
    (1, 1, 7.0, 3.2),
    (2, 1, 7.0, 2.3),
    (6, 1, 7.0, 1.5),
    (14, 2, 5.5, 1.4),
    (30, 3, 4.2, 1.3),
)
_LARGEST = (4, 3.6, 1.3)

# Characters of a title, or a legend, to an inch.
_CHARACTERS = 12.0

# At least so much of a quantity is seen, so that noise isn't all that is.
_LEAST = {
    "rad": 0.02,
    "m": 0.002,
    "rad/s": 0.02,
    "m/s": 0.002,
    "N·m": 0.02,
    "N": 0.02,
    "%": 1.0,
}

_RESOLUTION = 120  # dots to an inch


class Picture(Figure):
    """A figure that a notebook shows, also without pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=_RESOLUTION)
        return buffer.getvalue()


class Unit(NamedTuple):
    """A unit, or a part of one."""

    name: str

    # How many of it are one of SI.
    factor: float


def make_picture(width: float, height: float) -> Picture:
    """Return an empty picture of a width and a height [inch]."""
    picture = Picture(figsize=(width, height), layout="constrained", dpi=_RESOLUTION)
    FigureCanvasAgg(picture)
    return picture


def make_time_panels(titles: Sequence[str]) -> tuple[Picture, list[Axes]]:
    """Return a picture with a panel over time for each title, as "joint1 [rad]"."""
    num_columns, width, height = choose_grid(_GRIDS, _LARGEST, len(titles))
    picture, panels = make_panels(titles, num_columns, (width, height), sharex=True)
    num_rows = -(-len(panels) // num_columns)
    for index, panel in enumerate(panels):
        panel.grid(alpha=0.3)
        if index % num_rows == num_rows - 1:
            panel.set_xlabel("time [s]")
        # A last column that is shorter has numbers alone, which need less room.
        if index == len(panels) - 1:
            panel.tick_params(labelbottom=True)
    return picture, panels


def choose_grid(
    grids: Iterable[tuple[int, int, float, float]],
    largest: tuple[int, float, float],
    number: int,
) -> tuple[int, float, float]:
    """Return columns of panels, and width and height of a panel [inch]."""
    return next((grid[1:] for grid in grids if number <= grid[0]), largest)


def make_panels(
    titles: Sequence[str],
    num_columns: int,
    size: tuple[float, float],
    *,
    sharex: bool = False,
) -> tuple[Picture, list[Axes]]:
    """Return a picture with a panel of a size [inch] for each title, in columns."""
    num_rows = max(1, -(-len(titles) // num_columns))
    width, height = size[0] * num_columns, size[1] * num_rows + 0.8
    picture = make_picture(max(width, 4.0), height)
    grid = picture.subplots(num_rows, num_columns, sharex=sharex, squeeze=False)
    panels = list(grid.T.ravel())
    for panel in panels[len(titles) :]:
        panel.set_visible(False)
    panels = panels[: len(titles)]
    for panel, title in zip(panels, titles, strict=True):
        # Names may be longer than a panel is high.
        panel.set_title(shorten(title, size[0]), loc="left", fontsize="small")
        panel.tick_params(labelsize="small")
        panel.yaxis.set_major_locator(MaxNLocator(4))
    return picture, panels


def shorten(text: str, width: float) -> str:
    """Return a text that fits into a width [inch], without its middle if it must."""
    most = int(width * _CHARACTERS)
    if len(text) <= most:
        return text
    end = (most - 1) * 2 // 3
    return f"{text[: most - 1 - end]}…{text[-end:]}"


def draw_line(panel: Axes, x: Array, y: Array, **style: Any) -> Line2D:
    """Draw a line; of very many points those that are seen, of one a dot.

    `x` and `y` have the shape (N,); they aren't finite where there is no point. The
    style is as `Axes.plot` takes it.
    """
    rows = np.union1d(_seen(x), _seen(y))
    x, y = x[rows], y[rows]
    if np.count_nonzero(np.isfinite(x) & np.isfinite(y)) == 1:
        style["marker"] = "o"
    (line,) = panel.plot(x, y, **style)
    return line


def see_least(panel: Axes, unit: str, factor: float = 1.0, *, along: str = "y") -> None:
    """Widen the view of a panel whose lines hardly move: a still joint isn't noise."""
    low, high = panel.get_xlim() if along == "x" else panel.get_ylim()
    least = _LEAST.get(unit, 0.0) * factor
    if high - low < least:
        middle = (low + high) / 2.0
        show = panel.set_xlim if along == "x" else panel.set_ylim
        show(middle - least / 2.0, middle + least / 2.0)


def choose_unit(unit: str, peak: float) -> Unit:
    """Return the unit in which a small quantity is read well."""
    if peak >= 0.1:
        return Unit(unit, 1.0)
    if peak >= 1e-4:
        return Unit(f"m{unit}", 1e3)
    return Unit(f"µ{unit}", 1e6)


def peak_of(values: Iterable[Array]) -> float:
    """Return the largest absolute value of all that are finite; 0 if none is."""
    peaks = [np.max(np.abs(v[np.isfinite(v)]), initial=0.0) for v in values]
    return float(max(peaks, default=0.0))


def write_note(panel: Axes, text: str) -> None:
    """Write a remark into the upper right corner of a panel."""
    if text:
        panel.annotate(
            text,
            (1.0, 1.0),
            xytext=(-3, -3),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize="x-small",
            bbox={
                "boxstyle": "square,pad=0.15",
                "fc": "white",
                "ec": "none",
                "alpha": 0.8,
            },
        )


def add_legend(picture: Picture, panels: Iterable[Axes]) -> None:
    """Add a legend of all that is drawn, each label once."""
    lines = {
        label: handle
        for panel in panels
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    if lines:
        each = max(map(len, lines)) + 6
        most = int(picture.get_figwidth() * _CHARACTERS / each)
        picture.legend(
            lines.values(),
            lines.keys(),
            loc="outside upper center",
            ncols=max(1, min(most, len(lines))),
            fontsize="small",
        )


def say_below(picture: Picture, text: str, names: Sequence[str] = ()) -> None:
    """Write a remark below all panels, with as many names as fit."""
    room = int((picture.get_figwidth() - 1.5) * _CHARACTERS * 1.4) - len(text)
    shown: list[str] = []
    for name in names:
        room -= len(name) + 2
        if room < 0 and shown:
            break
        shown.append(name)
    rest = len(names) - len(shown)
    more = f" and {rest} more" if rest else ""
    remark = f"{text} {', '.join(shown)}{more}".rstrip()
    picture.supxlabel(remark, fontsize="x-small", color="0.35")


def say_if_empty(picture: Picture, num_rows: int) -> None:
    """Write a remark in an empty picture."""
    panels = [panel for panel in picture.axes if panel.get_visible()]
    if num_rows and panels:
        return
    text = "nothing to show" if num_rows else "no rows were recorded"
    picture.text(0.5, 0.5, text, ha="center", va="center", color="0.35")


def _seen(values: Array) -> NDArray[np.int64]:
    """Return rows that show all peaks of a line, in order: of few points all."""
    num = len(values)
    if num <= _MAX_POINTS:
        return np.arange(num)
    # Of each of many pieces the lowest and the highest point.
    length = math.ceil(4 * num / _MAX_POINTS)
    num_pieces = math.ceil(num / length)
    padded = np.full(num_pieces * length, np.nan)
    padded[:num] = values
    pieces = padded.reshape(num_pieces, length)
    starts = length * np.arange(num_pieces)
    low = starts + np.argmin(np.where(np.isnan(pieces), np.inf, pieces), axis=1)
    high = starts + np.argmax(np.where(np.isnan(pieces), -np.inf, pieces), axis=1)
    ends = np.array([0, num - 1])
    return np.unique(np.concatenate([ends, low, high]))


class Tracked(NamedTuple):
    """References of a joint, and its measurement."""

    joint: str

    # Unit of SI.
    unit: str

    # Shape (N,).
    measured: Array

    # Each of shape (N,), by what it is called in a legend; NaN where nothing was
    # wanted. Without any nothing ever was.
    references: Mapping[str, Array]


def track(rollout: Rollout, joints: Sequence[str]) -> list[Tracked]:
    """Return what joints were to follow: positions, or velocities if there are none.

    A joint that is told velocities alone, such as that of a wheel, shows these.
    """
    return [_track_joint(rollout, joint) for joint in joints]


def commanded(rollout: Rollout, joint: str, interface: str) -> Array | None:
    """Return the values of a joint's command interface, shape (N,).

    It is None if there is no such interface, or it was never told anything.
    """
    name = f"{joint}/{interface}"
    if name not in rollout.command_names:
        return None
    values = rollout.command[:, rollout.command_names.index(name)]
    return values if np.isfinite(values).any() else None


def unit_of(rollout: Rollout, joint: str, interface: str) -> str:
    """Return the unit of a state of a joint."""
    joint_type = rollout.joint_types[rollout.joint_names.index(joint)]
    return interfaces.unit(interface, joint_type)


def read_limits(description: str) -> dict[str, JointLimits]:
    """Return what a description allows its joints; of none, nothing."""
    try:
        return {joint.name: joint.limits for joint in read_joints(description)}
    except (ET.ParseError, InputError):
        return {}


def _track_joint(rollout: Rollout, joint: str) -> Tracked:
    column = rollout.joint_names.index(joint)
    position = {}
    for controller, reference in rollout.references.items():
        if joint in reference.joint_names:
            values = reference.position[:, reference.joint_names.index(joint)]
            if np.isfinite(values).any():
                position[f"reference ({controller})"] = values
    velocity = commanded(rollout, joint, interfaces.VELOCITY)
    if velocity is not None and not position:
        unit = unit_of(rollout, joint, interfaces.VELOCITY)
        references = {"commanded velocity": velocity}
        return Tracked(joint, unit, rollout.velocity[:, column], references)
    unit = unit_of(rollout, joint, interfaces.POSITION)
    return Tracked(joint, unit, rollout.position[:, column], position)
