"""Picture of a control graph.

From the left to the right: what the hardware reports, the controllers that read it, and
what they command. The hardware, below, makes states of commands.
"""

import functools
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import FancyArrowPatch, Rectangle
from matplotlib.path import Path as Curve
from matplotlib.textpath import text_to_path

from arm_drake.importing import dataclass
from arm_drake.output_files import writing
from arm_drake.visualization.control_graph import ControlGraph, ControllerNode

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


@dataclass(frozen=True)
class Line:
    """A line of text in a box, with a part at its left and one at its right end."""

    left: str
    right: str = ""
    is_bold: bool = False
    colour: str = "black"

    @property
    def width(self) -> float:
        """Width of the line [pt]."""
        gap = 2.0 * PADDING if self.left and self.right else 0.0
        return gap + sum(text_width(t, self.is_bold) for t in (self.left, self.right))


@dataclass(frozen=True)
class Box:
    """Lines of text with a frame around them."""

    lines: tuple[Line, ...]
    colour: str = "black"
    is_dashed: bool = False

    @property
    def width(self) -> float:
        """Least width of the box [pt]."""
        return max(line.width for line in self.lines) + 2.0 * PADDING

    @property
    def height(self) -> float:
        """Height of the box [pt]."""
        return LINE_HEIGHT * len(self.lines) + PADDING


@dataclass(frozen=True)
class Place:
    """Place of a drawn box."""

    left: float
    right: float

    # y of its lines.
    rows: tuple[float, ...]


@functools.cache
def text_width(text: str, is_bold: bool = False) -> float:
    """Return the width of a text [pt]."""
    if not text:
        return 0.0
    font = FontProperties(
        family=_FONTS[:1], weight="bold" if is_bold else "normal", size=_FONT_SIZE
    )
    width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    return float(width)


class Canvas:
    """A picture of some size [pt]."""

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
        """Write the picture; the suffix says of which type it is."""
        date = {".svg": "Date", ".pdf": "CreationDate"}.get(path.suffix)
        metadata = {date: None} if date else {}
        with matplotlib.rc_context(_SETTINGS), writing(path):
            self.figure.savefig(path, dpi=144, metadata=metadata)

    def _arrow(self, path: Curve, colour: str, width: float, head: float) -> None:
        arrow = FancyArrowPatch(path=path, arrowstyle="-|>", mutation_scale=head)
        arrow.set(color=colour, linewidth=width, zorder=1)
        self._axes.add_patch(arrow)


# All sizes are in points.
_BORDER = 14.0

# Between boxes, between columns, and above the hardware.
_GAP = 18.0
_CHANNEL = 120.0
_ARROW = 34.0

_COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b")
_IDLE = "#888888"
_NOTE = "grey: no active controller uses it"
_TO = "\N{RIGHTWARDS ARROW}"


@dataclass(frozen=True)
class _Column:
    """Boxes one below the other, with a title above them."""

    title: str
    boxes: tuple[Box, ...]

    @property
    def width(self) -> float:
        return max([text_width(self.title), *(box.width for box in self.boxes)])

    @property
    def height(self) -> float:
        gaps = _GAP * max(len(self.boxes) - 1, 0)
        return gaps + sum(box.height for box in self.boxes)


def draw_graph(graph: ControlGraph) -> Canvas:
    """Return the picture of a graph."""
    colours = {
        node.name: colour if node.state == "active" else _IDLE
        for node, colour in zip(graph.controllers, itertools.cycle(_COLOURS))
    }
    columns = _columns(graph, colours)
    hardware = _hardware_box(graph)
    widths = [column.width for column in columns]
    inner = max(
        sum(widths) + 2.0 * _CHANNEL, hardware.width, text_width(graph.robot, True)
    )
    channel = (inner - sum(widths)) / 2.0
    width = inner + 2.0 * _BORDER
    top = _BORDER + 3.0 * LINE_HEIGHT
    end = top + max(column.height for column in columns)
    bottom = end + _ARROW
    height = bottom + hardware.height + LINE_HEIGHT + _BORDER

    canvas = Canvas(width, height)
    title = (width / 2.0, _BORDER + LINE_HEIGHT / 2.0)
    canvas.text(title, graph.robot, align="center", is_bold=True)
    left = _BORDER
    places = []
    for column in columns:
        places.append(tuple(_draw_column(canvas, column, left, top, end)))
        left += column.width + channel
    states, controllers, commands = places
    if states:
        x = _BORDER + columns[0].width / 2.0
        canvas.arrow((x, bottom), (x, (end + top + columns[0].height) / 2.0))
    if commands:
        x = width - _BORDER - columns[2].width / 2.0
        canvas.arrow((x, (end + top + columns[2].height) / 2.0), (x, bottom))
    canvas.box(hardware, _BORDER, bottom, inner)
    canvas.text((_BORDER, height - _BORDER), _NOTE, colour=_IDLE)

    state_rows = _rows((block.states for block in graph.hardware), states)
    command_rows = _rows((block.commands for block in graph.hardware), commands)
    for node, place in zip(graph.controllers, controllers, strict=True):
        y, colour = place.rows[0], colours[node.name]
        for name in node.reads:
            box, row = state_rows[name]
            canvas.curve((box.right, row), (place.left, y), colour)
        for name in node.commands:
            box, row = command_rows[name]
            canvas.curve((place.right, y), (box.left, row), colour)
    return canvas


def _columns(graph: ControlGraph, colours: Mapping[str, str]) -> tuple[_Column, ...]:
    active = [node for node in graph.controllers if node.state == "active"]
    read = {name for node in active for name in node.reads}
    claimed = {name for node in active for name in node.commands}
    states = [
        _interfaces_box(b.name, b.states, read) for b in graph.hardware if b.states
    ]
    commands = [
        _interfaces_box(b.name, b.commands, claimed)
        for b in graph.hardware
        if b.commands
    ]
    controllers = [_controller_box(n, colours[n.name]) for n in graph.controllers]
    return (
        _Column("state interfaces", tuple(states)),
        _Column("controllers", tuple(controllers)),
        _Column("command interfaces", tuple(commands)),
    )


def _interfaces_box(name: str, interfaces: Sequence[str], used: Iterable[str]) -> Box:
    rows = [Line(i, colour="black" if i in used else _IDLE) for i in interfaces]
    return Box((Line(name, is_bold=True), *rows))


def _controller_box(node: ControllerNode, colour: str) -> Box:
    inputs = [f"{_TO} {name}" for name in node.inputs]
    outputs = [f"{name} {_TO}" for name in node.outputs]
    topics = itertools.zip_longest(inputs, outputs, fillvalue="")
    rows = [Line(left, right) for left, right in topics]
    name = Line(node.name, node.state, is_bold=True, colour=colour)
    is_dashed = node.state != "active"
    return Box((name, Line(node.type), *rows), colour, is_dashed)


def _hardware_box(graph: ControlGraph) -> Box:
    lines = []
    for block in graph.hardware:
        lines.append(Line(block.name, is_bold=True))
        lines += [Line(note) for note in block.notes]
    return Box((*lines, *(Line(note) for note in graph.notes)))


def _draw_column(
    canvas: Canvas, column: _Column, left: float, top: float, end: float
) -> Iterator[Place]:
    """Draw a column in the middle between top and end; yield where its boxes are."""
    heading = (left + column.width / 2.0, top - LINE_HEIGHT)
    canvas.text(heading, column.title, align="center")
    y = (top + end - column.height) / 2.0
    for box in column.boxes:
        yield canvas.box(box, left, y, column.width)
        y += box.height + _GAP


def _rows(
    interfaces: Iterable[Sequence[str]], places: Iterable[Place]
) -> dict[str, tuple[Place, float]]:
    """Return the box and the y of each interface; in a box, a name stands first."""
    return {
        name: (place, y)
        for names, place in zip(filter(None, interfaces), places, strict=True)
        for name, y in zip(names, place.rows[1:], strict=True)
    }
