"""Live plots on a page: numbers of topics over time, chosen by name."""

import collections
import dataclasses as dc
import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from arm_drake.errors import InputError, check_known, suggest
from arm_drake.messages import Message, Time
from arm_drake.visualization.page.parts import Live, Part
from arm_drake.visualization.page.widgets import Button, Buttons, Choice, Section

# Simulated time between two samples [s], and how many are kept: ten minutes.
PERIOD, CAPACITY = 0.02, 30_000

# So many curves can be told apart.
MOST_CURVES = 12

# So many numbers of an array are offered by name; others can be asked for.
_MOST_OFFERED = 64

# Fields that name the elements of the arrays beside and below them.
_NAMES = ("joint_names", "interface_names", "name")

_STEP = re.compile(r"([^/\[\]]+)(?:\[([^\]]*)\])?(?:/|$)")

_NOTHING = "–"

_Row = list[float | None]


def list_numbers(message: Message) -> list[str]:
    """Return the paths of the numbers in a message, as `find_number` takes them."""
    return list(_walk(message, "", ()))


def find_number(message: Message, path: str) -> float | None:
    """Return a number of a message, such as `position[joint1]` or `twist/linear/x`.

    Elements of arrays are named by the joints or interfaces that the message names, or
    counted from 0. It is None if there is none now, or it isn't finite.
    """
    value = _look_up(message, path)
    if isinstance(value, Time):
        value = value.to_seconds()
    is_number = isinstance(value, int | float) and math.isfinite(value)
    return float(value) if is_number else None


def may_have(message: Message, path: str) -> bool:
    """Return whether there is such a number, or may be in an array that is empty now.

    Before its first tick a controller has told nothing.
    """
    value = _look_up(message, path)
    return value is _NOT_YET or isinstance(value, int | float | Time)


# What an element is of an array that is empty now.
_NOT_YET = object()


def _look_up(message: Message, path: str) -> Any:
    """Return what is at a path of a message, None if there is no such path."""
    value: Any = message
    names: Sequence[str] = ()
    for field, key in _STEP.findall(path):
        names = _names_of(value) or names
        value = getattr(value, field, None)
        if key and value == ():
            return _NOT_YET
        if key:
            value = _element(value, key, names)
    return value


def _element(value: Any, key: str, names: Sequence[str]) -> Any:
    if not isinstance(value, tuple):
        return None
    if key in names and len(names) == len(value):
        return value[names.index(key)]
    return value[int(key)] if key.isdecimal() and int(key) < len(value) else None


def _names_of(value: Any) -> Sequence[str]:
    for field in _NAMES:
        names = getattr(value, field, None)
        if isinstance(names, tuple) and names:
            return names
    return ()


def _walk(value: Any, path: str, names: Sequence[str]) -> Iterator[str]:
    if isinstance(value, int | float | Time):
        yield path
    elif isinstance(value, tuple):
        keys = names if len(names) == len(value) else range(len(value))
        for key, element in list(zip(keys, value, strict=True))[:_MOST_OFFERED]:
            yield from _walk(element, f"{path}[{key}]", names)
    elif dc.is_dataclass(value):
        names = _names_of(value) or names
        for field in dc.fields(value):
            if field.name != "header":
                own = f"{path}/{field.name}" if path else field.name
                yield from _walk(getattr(value, field.name), own, names)


class LivePlots(Part):
    """The section that chooses what is plotted; the page draws it below the scene.

    Nothing is read while there is no curve.
    """

    word = "plot"

    def __init__(self, live: Live) -> None:
        """Create it without a curve."""
        self._live = live
        # By name, what reads the topic, and the path in its message.
        self._curves: dict[str, tuple[Callable[[], Message], str]] = {}
        self._rows: collections.deque[_Row] = collections.deque(maxlen=CAPACITY)
        # How many of the last rows the page hasn't got.
        self._num_new = 0
        self._due = -math.inf
        self._topic = ""

    @property
    def curves(self) -> tuple[str, ...]:
        """Names of what is plotted: `<topic>/<field>`, see `find_number`."""
        return tuple(self._curves)

    @property
    def rows(self) -> list[_Row]:
        """Sampled rows: time [s], and a number for each curve, or None."""
        return [list(row) for row in self._rows]

    def topics(self) -> list[str]:
        """Return the names of topics that numbers can be read from.

        The diagram's own `joint_states`, without a slash, are what the joints do.
        """
        simulation = self._live.simulation
        rows = simulation.list_topics()
        many = len(simulation.robots) > 1
        own = [
            f"{n}/joint_states" if many else "joint_states" for n in simulation.robots
        ]
        skipped = ("Image", "CameraInfo", "PointCloud2")
        return own + [
            row.name
            for row in rows
            if row.direction == "output" and row.type not in skipped
        ]

    def add(self, name: str) -> None:
        """Plot a number from now on, as "/joint_states/position[joint1]"."""
        if name in self._curves:
            return
        if len(self._curves) >= MOST_CURVES:
            raise InputError(f"plot: {MOST_CURVES} curves are the most at once")
        topics = self.topics()
        owners = [topic for topic in topics if name.startswith(f"{topic}/")]
        if not owners:
            hint = suggest(name, topics)
            raise InputError(f"plot {name!r}: expected <topic>/<field>; {hint}")
        topic = max(owners, key=len)
        path, read = name[len(topic) + 1 :], self._reader(topic)
        if not may_have(read(), path):
            hint = suggest(path, list_numbers(read()))
            raise InputError(f"plot {name!r}: no number {path!r}; {hint}")
        self._curves[name] = (read, path)
        for row in self._rows:
            row.append(None)
        self._due = -math.inf
        self._refresh()
        self.advance()

    def remove(self, name: str) -> None:
        """Plot a number no more."""
        check_known("curve", name, self._curves, argument="plot")
        at = self.curves.index(name) + 1
        del self._curves[name]
        for row in self._rows:
            del row[at]
        self._refresh()

    def clear(self) -> None:
        """Forget what was plotted so far; the curves go on."""
        self._rows.clear()
        self._due = -math.inf
        self._refresh()

    def close(self) -> None:
        """Plot nothing any more."""
        self._curves.clear()
        self.clear()

    def advance(self) -> float:
        """Take a sample if one is due."""
        if not self._curves:
            return math.inf
        now = self._live.simulation.time
        if now >= self._due:
            if self._rows and self._rows[-1][0] == now:
                self._rows.pop()
                self._num_new = max(self._num_new - 1, 0)
            self._rows.append([now, *self._sample()])
            self._num_new = min(self._num_new + 1, CAPACITY)
            self._due = (math.floor(now / PERIOD + 1e-6) + 1) * PERIOD
        return self._due - now

    def changes(self) -> dict[str, dict[str, Any]]:
        """Send new samples; return present fields of its widgets."""
        if self._num_new:
            self._live.page.add_samples(list(self._rows)[-self._num_new :])
            self._num_new = 0
        return {"plot:topic": {"value": self._topic or _NOTHING}}

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "topic":
            self._choose("" if value == _NOTHING else str(value))
        elif what == "number":
            if value != _NOTHING:
                self.add(f"{self._topic}/{value}")
            self._live.page.patch({"plot:number": {"value": _NOTHING}})
        elif what == "remove":
            self.remove(str(value))
        elif what in ("clear", "close"):
            getattr(self, what)()

    def reset(self) -> None:
        """Begin anew with the simulation."""
        self.clear()

    def take_over(self, other: Part) -> None:
        """Go on with the curves of another one."""
        if isinstance(other, LivePlots):
            self._topic = other._topic
            known = self.topics()
            for name, (_, path) in other._curves.items():
                topic = name[: -len(path) - 1]
                if topic in known:
                    self._curves[name] = (self._reader(topic), path)
            if self.curves == other.curves:
                self._rows = other._rows
            self._refresh()

    def section(self) -> Section:
        """Return its part of the panel."""
        numbers = (_NOTHING, *self._numbers())
        return Section(
            "Plot",
            (
                Choice(
                    "plot:topic",
                    "topic",
                    (_NOTHING, *self.topics()),
                    self._topic or _NOTHING,
                ),
                Choice(
                    "plot:number", "add", numbers, _NOTHING, "a number of the topic"
                ),
                Buttons(
                    (
                        Button("plot:clear", "clear", "forget what was plotted so far"),
                        Button("plot:close", "close", "plot nothing"),
                    )
                ),
            ),
            is_open=False,
        )

    def _choose(self, topic: str) -> None:
        if topic:
            check_known("topic", topic, self.topics(), argument="plot")
        self._topic = topic
        options = [_NOTHING, *self._numbers()]
        self._live.page.patch({"plot:number": {"options": options, "value": _NOTHING}})

    def _numbers(self) -> list[str]:
        return list_numbers(self._reader(self._topic)()) if self._topic else []

    def _reader(self, topic: str) -> Callable[[], Message]:
        """Return what reads the latest message of a topic."""
        simulation = self._live.simulation
        if topic.startswith("/"):
            read: Callable[[], Message] = simulation.topic(topic).value
            return read
        robot = topic.rpartition("/")[0] or next(iter(simulation.robots))
        return lambda: simulation.joint_states(robot)

    def _sample(self) -> Iterator[float | None]:
        """Return the curves' present numbers."""
        for read, path in self._curves.values():
            yield find_number(read(), path)

    def _refresh(self) -> None:
        """Send the page other curves, with all rows."""
        self._num_new = 0
        self._live.page.set_plot(self.curves, self.rows)
