"""Boxes of text, and arrows between them, drawn with matplotlib."""

import dataclasses as dc
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import FancyArrowPatch, Rectangle
from matplotlib.path import Path as Curve
from matplotlib.textpath import TextPath

from arm_drake.output_files import writing

# All sizes are in points; y grows downwards.
LINE_HEIGHT = 14.0
PADDING = 8.0
_FONT_SIZE = 9.0

# The first one comes with matplotlib.
_FONTS = ["DejaVu Sans", "sans-serif"]

_SETTINGS: Any = {
    "font.family": _FONTS,
    "font.size": _FONT_SIZE,
    # Text stays text: it can be searched for.
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    # The same picture gives the same file.
    "svg.hashsalt": "arm_drake",
}

Point = tuple[float, float]


@dc.dataclass(frozen=True)
class Line:
    """A line of text in a box, with a part at its left and one at its right end."""

    left: str
    right: str = ""
    is_bold: bool = False
    colour: str = "black"

    @property
    def width(self) -> float:
        """What it takes [pt]."""
        gap = 2.0 * PADDING if self.left and self.right else 0.0
        return gap + sum(text_width(t, self.is_bold) for t in (self.left, self.right))


@dc.dataclass(frozen=True)
class Box:
    """Lines of text with a frame around them."""

    lines: tuple[Line, ...]
    colour: str = "black"
    is_dashed: bool = False

    @property
    def width(self) -> float:
        """What it takes at least [pt]."""
        return max(line.width for line in self.lines) + 2.0 * PADDING

    @property
    def height(self) -> float:
        """What it takes [pt]."""
        return LINE_HEIGHT * len(self.lines) + PADDING


@dc.dataclass(frozen=True)
class Place:
    """Where a box has been drawn."""

    left: float
    right: float

    # y of its lines.
    rows: tuple[float, ...]


def text_width(text: str, is_bold: bool = False) -> float:
    """Return the width of a text [pt]."""
    if not text:
        return 0.0
    font = FontProperties(family=_FONTS[:1], weight="bold" if is_bold else "normal")
    return float(TextPath((0.0, 0.0), text, _FONT_SIZE, font).get_extents().x1)


class Canvas:
    """A picture of a given size [pt]."""

    def __init__(self, width: float, height: float) -> None:
        """Create an empty picture."""
        self.figure = Figure(figsize=(width / 72.0, height / 72.0))
        FigureCanvasAgg(self.figure)
        self._axes: Axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self._axes.set(xlim=(0.0, width), ylim=(height, 0.0))
        self._axes.set_axis_off()

    def text(
        self,
        place: Point,
        text: str,
        *,
        align: str = "left",
        is_bold: bool = False,
        colour: str = "black",
    ) -> None:
        """Draw a line of text; it is aligned to its place, and as high as it."""
        if not text:
            return
        weight = "bold" if is_bold else "normal"
        with matplotlib.rc_context(_SETTINGS):
            drawn = self._axes.text(*place, text, color=colour, weight=weight, zorder=3)
        drawn.set(horizontalalignment=align, verticalalignment="center_baseline")
        drawn.set_parse_math(False)  # Names are no mathematics.

    def box(self, box: Box, left: float, top: float, width: float) -> Place:
        """Draw a box and return where it is."""
        frame = Rectangle((left, top), width, box.height, zorder=2)
        frame.set(facecolor="white", edgecolor=box.colour)
        frame.set_linestyle("--" if box.is_dashed else "-")
        self._axes.add_patch(frame)
        right = left + width
        rows = tuple(
            top + PADDING / 2.0 + LINE_HEIGHT * (number + 0.5)
            for number in range(len(box.lines))
        )
        for y, line in zip(rows, box.lines, strict=True):
            bold, colour = line.is_bold, line.colour
            self.text((left + PADDING, y), line.left, is_bold=bold, colour=colour)
            self.text(
                (right - PADDING, y),
                line.right,
                align="right",
                is_bold=bold,
                colour=colour,
            )
        return Place(left, right, rows)

    def arrow(self, start: Point, end: Point) -> None:
        """Draw a straight arrow."""
        self._arrow(Curve([start, end]), "black", 1.0, 12.0)

    def curve(self, start: Point, end: Point, colour: str) -> None:
        """Draw an arrow that leaves and arrives horizontally."""
        middle = (start[0] + end[0]) / 2.0
        points = [start, (middle, start[1]), (middle, end[1]), end]
        codes = [Curve.MOVETO, Curve.CURVE4, Curve.CURVE4, Curve.CURVE4]
        self._arrow(Curve(points, codes), colour, 0.7, 6.0)

    def save(self, path: Path) -> None:
        """Write the picture; the suffix says of which type it is.

        Raises:
            OutputError: If the file can't be written.
        """
        date = {".svg": "Date", ".pdf": "CreationDate"}.get(path.suffix)
        metadata = {date: None} if date else {}
        with matplotlib.rc_context(_SETTINGS), writing(path):
            self.figure.savefig(path, dpi=144, metadata=metadata)

    def _arrow(self, path: Curve, colour: str, width: float, head: float) -> None:
        arrow = FancyArrowPatch(path=path, arrowstyle="-|>", mutation_scale=head)
        arrow.set(color=colour, linewidth=width, zorder=1)
        self._axes.add_patch(arrow)
