"""The picture of a control graph; Graphviz isn't needed for it.

From the left to the right: what the hardware reports, the controllers that read it, and
what they command. The hardware, below, makes states of commands.
"""

import dataclasses as dc
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence

from arm_drake.visualization.canvas import (
    LINE_HEIGHT,
    Box,
    Canvas,
    Line,
    Place,
    text_width,
)
from arm_drake.visualization.control_graph import ControlGraph, ControllerNode

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


@dc.dataclass(frozen=True)
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
    """Return the picture of a graph.

    Args:
        graph: What to draw.
    """
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
