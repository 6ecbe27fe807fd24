"""The panel of `arm-drake sim`, and what changes in it."""

import collections
import re
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from arm_drake.clients import GoalHandle
from arm_drake.errors import ArmDrakeError, InputError, SimulationError
from arm_drake.mailbox import News
from arm_drake.messages import CancelResponse, GoalStatus, SwitchControllerResult
from arm_drake.pages.viewer_panel import make_report
from arm_drake.simulation import Simulation
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Event,
    Item,
    Page,
    Section,
    Text,
)

if TYPE_CHECKING:
    from arm_drake.pages.live_simulation import LiveSimulation

# Choices of the real-time rate.
_RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
AS_FAST_AS_POSSIBLE = "as fast as it goes"
_TIMES = " ×"

_NUM_LINES = 50


class LogLines:
    """The last news, as lines."""

    def __init__(self) -> None:
        """Create it without lines."""
        self._lines: collections.deque[str] = collections.deque(maxlen=_NUM_LINES)

    def add(self, simulation: Simulation, news: News) -> None:
        """Take news, if they are worth a line.

        Args:
            simulation: Where they come from.
            news: What happened.
        """
        text = ""
        if isinstance(news, GoalHandle):
            # Feedback comes with the same status.
            if news.status is not GoalStatus.EXECUTING or not news.feedback:
                text = f"{news.controller}: goal {news.describe()}"
        elif isinstance(news, SwitchControllerResult):
            text = _describe_switch(news)
        elif isinstance(news, CancelResponse):
            text = "" if news.accepted else f"cancel refused: {news.reason}"
        else:
            text = str(simulation.mailbox.describe(news))
        if text:
            self._lines.append(f"{simulation.time:.2f} s  {text}")

    def clear(self) -> None:
        """Forget all lines."""
        self._lines.clear()

    def __str__(self) -> str:
        """Return the lines, the newest first."""
        return "\n".join(reversed(self._lines))


def do_latest(page: Page, events: Iterable[Event], do: Callable[[Event], None]) -> None:
    """Do what was clicked, and say on the page what can't be done.

    Args:
        page: The page.
        events: What happened on it, in order.
        do: Does one thing.

    Raises:
        SimulationError: If a simulation can't go on.
    """
    problems = []
    for event in (happened := latest(events)):
        try:
            do(event)
        except SimulationError:
            raise
        except ArmDrakeError as error:
            problems.append(str(error))
    if happened:
        page.say("\n".join(problems), "error")


def latest(events: Iterable[Event]) -> list[Event]:
    """Return events without those whose value is replaced by a later one.

    Of a slider's way the end counts, unless something else was done on the way.

    Args:
        events: What happened, in order.
    """
    kept: list[Event] = []
    for event in events:
        if kept and kept[-1].id == event.id and event.value is not None:
            kept.pop()
        kept.append(event)
    return kept


def make_sections(live: "LiveSimulation") -> list[Section]:
    """Return the panel of a simulation.

    Args:
        live: The simulation.
    """
    simulation = live.simulation
    now = live.realtime_rate
    rate = Choice("rate", "real-time rate", _rate_options(now), _rate_text(now))
    buttons = Buttons(
        (
            Button("play", "pause", "play or pause (space)", key=" "),
            Button("step", "step", "one cycle of the controllers (s)", key="s"),
            Button("reset", "reset", "back to the start"),
        )
    )
    times = (
        Text("time", "simulated time"),
        Text("wall_time", "wall time"),
        Text("factor", "real-time factor"),
    )
    rows = simulation.list_controllers()
    items = tuple(
        Item(f"controller:{row.name}", row.name, _class_name(row.type), row.state)
        for row in rows
    )
    look = Buttons((Button("frame", "look at all", "of the robots"),))
    sections = [
        Section("Simulation", (buttons, rate, *times)),
        Section("Controllers", items),
        *(Section(remote.title, remote.widgets()) for remote in live.remotes),
        Section("Show", (look, *live.views.widgets())),
        Section("News", (Text("log", "the newest first", can_copy=True),)),
        make_report(simulation.report),
    ]
    return [section for section in sections if section.widgets]


def make_changes(live: "LiveSimulation") -> dict[str, dict[str, Any]]:
    """Return the present values of what changes in the panel, by widget.

    Args:
        live: The simulation.
    """
    simulation = live.simulation
    changes: dict[str, dict[str, Any]] = {
        "play": {"label": "pause" if live.is_playing else "play"},
        "rate": {
            "value": _rate_text(live.realtime_rate),
            "options": _rate_options(live.realtime_rate),
        },
        "time": {"value": f"{simulation.time:.2f} s"},
        "wall_time": {"value": f"{live.wall_time:.2f} s"},
        "factor": {"value": f"{live.realtime_factor:.2f}" if live.is_playing else "–"},
        "log": {"value": live.log},
    }
    for row in simulation.list_controllers():
        button = None
        if row.state == "active":
            button = Button(f"deactivate:{row.name}", "deactivate")
        elif row.state == "inactive":
            button = Button(f"activate:{row.name}", "activate")
        changes[f"controller:{row.name}"] = {
            "state": row.state,
            "buttons": [] if button is None else [vars(button)],
        }
    for remote in live.remotes:
        changes |= remote.changes()
    return changes


def read_rate(text: object) -> float:
    """Return the real-time rate of a choice; 0 is as fast as it goes.

    Args:
        text: What was chosen.

    Raises:
        InputError: If it is no choice.
    """
    if text == AS_FAST_AS_POSSIBLE:
        return 0.0
    try:
        return float(str(text).removesuffix(_TIMES))
    except ValueError:
        raise InputError(f"real-time rate: expected a number, got {text!r}") from None


def _class_name(type_: str) -> str:
    return re.split(r"/|::", type_)[-1]


def _rate_options(now: float) -> tuple[str, ...]:
    rates = sorted({*_RATES, now} - {0.0})
    return (*map(_rate_text, rates), AS_FAST_AS_POSSIBLE)


def _rate_text(rate: float) -> str:
    return f"{rate:g}{_TIMES}" if rate else AS_FAST_AS_POSSIBLE


def _describe_switch(news: SwitchControllerResult) -> str:
    parts = [
        f"{verb} {', '.join(names)}"
        for verb, names in (
            ("activated", news.request.activate_controllers),
            ("deactivated", news.request.deactivate_controllers),
        )
        if names
    ]
    text = "; ".join(parts)
    return f"{text}: {news.message}" if news.message else text
