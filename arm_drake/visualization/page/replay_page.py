"""A replay on a page: play, pause, speed, and a slider for the time."""

import time
from collections.abc import Iterable

from arm_drake.errors import InputError
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Event,
    Page,
    Section,
    Slider,
    Text,
)
from arm_drake.visualization.page.live_simulation import do_latest, read_rate
from arm_drake.visualization.page.replay import Replay

_FRAME_PERIOD = 1.0 / 30.0

_RATES = ("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "5 ×", "10 ×")


class ReplayPage:
    """Plays a replay by the wall clock.

    All that can be clicked is a method, too. It is used in the thread of its page.
    """

    def __init__(self, page: Page, replay: Replay, *, rate: float = 1.0) -> None:
        """Show a replay; `run` lets it go.

        Args:
            page: Where to show it.
            replay: What to play.
            rate: Recorded seconds per second.
        """
        self.page, self.replay = page, replay
        self.is_playing = True
        self.time = replay.start
        self._rate = rate
        self._is_stopped = False
        replay.frame()
        page.set_panel(replay.robot.name, self._sections())

    @property
    def rate(self) -> float:
        """Recorded seconds per second."""
        return self._rate

    def play(self) -> None:
        """Let time pass; at the end, from the start."""
        if self.time >= self.replay.end:
            self.time = self.replay.start
        self.is_playing = True

    def pause(self) -> None:
        """Let time stand."""
        self.is_playing = False

    def seek(self, time: float) -> None:
        """Go to a time.

        Args:
            time: When [s]; what is beyond the log is taken as its end.
        """
        self.time = min(max(time, self.replay.start), self.replay.end)

    def set_rate(self, rate: float) -> None:
        """Set how fast time passes.

        Args:
            rate: Recorded seconds per second, above 0.

        Raises:
            InputError: If it is something else.
        """
        if not 0.0 < rate < float("inf"):
            raise InputError(f"speed: expected a positive number, got {rate!r}")
        self._rate = rate

    def run(self) -> None:
        """Do what is clicked, and play, until `stop`."""
        last, drawn_at = time.perf_counter(), None
        while not self._is_stopped:
            self.handle(self.page.events(_FRAME_PERIOD))
            now = time.perf_counter()
            if self.is_playing:
                self.seek(self.time + self._rate * (now - last))
                self.is_playing = self.time < self.replay.end
            last = now
            if self.time != drawn_at:
                self.replay.show(self.time)
                drawn_at = self.time
            self._tell()
        self._is_stopped = False

    def stop(self) -> None:
        """End `run`, also one that is still to come."""
        self._is_stopped = True
        self.page.call(lambda: None)  # It may wait for a click.

    def handle(self, events: Iterable[Event]) -> None:
        """Do what was clicked.

        Args:
            events: What happened on the page, in order.
        """
        do_latest(self.page, events, self._do)

    def _do(self, event: Event) -> None:
        if event.id == "play":
            self.pause() if self.is_playing else self.play()
        elif event.id == "restart":
            self.seek(self.replay.start)
        elif event.id == "frame":
            self.replay.frame()
        elif event.id == "rate":
            self.set_rate(read_rate(event.value))
        elif event.id == "time":
            try:
                self.seek(float(event.value))
            except (TypeError, ValueError):
                problem = f"time: expected a number [s], got {event.value!r}"
                raise InputError(problem) from None

    def _sections(self) -> list[Section]:
        replay, rollout = self.replay, self.replay.rollout
        now = f"{self._rate:g} ×"
        rates = _RATES if now in _RATES else (*_RATES, now)
        buttons = (
            Button("play", "pause", "play or pause (space)", key=" "),
            Button("restart", "restart", "back to the start"),
            Button("frame", "look at all", "of the robot"),
        )
        goals = "\n".join(
            f"{goal.sent_at:.2f} s  {goal.controller}: {goal.status} "
            f"{goal.error_string}".strip()
            for goal in rollout.goals
        )
        sections = [
            Section(
                "Replay",
                (
                    Buttons(buttons),
                    Slider("time", "time", replay.start, replay.end, self.time, "s"),
                    Choice("rate", "speed", rates, now),
                ),
            )
        ]
        if goals:
            sections.append(Section("Goals", (Text("goals", "goals", goals, True),)))
        return sections

    def _tell(self) -> None:
        label = "pause" if self.is_playing else "play"
        self.page.patch({"play": {"label": label}, "time": {"value": self.time}})
