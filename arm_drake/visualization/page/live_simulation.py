"""LiveSimulation: a simulation on a page, with all that Gazebo's window has."""

import collections
import dataclasses as dc
import math
import re
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydrake.systems.framework import Diagram

from arm_drake.errors import InputError
from arm_drake.messages import CancelResponse, GoalStatus, SwitchControllerResult
from arm_drake.output_files import find_free_path
from arm_drake.scene import Scene
from arm_drake.simulation.continuation import continue_with
from arm_drake.simulation.mailbox import GoalHandle, SimulationEvent
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.motion_files import MotionSource, find_motion
from arm_drake.simulation.playback import Player
from arm_drake.simulation.recording import History
from arm_drake.simulation.simulation import TICK_TOLERANCE, ResetRequested, Simulation
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Item,
    Page,
    Section,
    Slider,
    Text,
    WidgetEvent,
)
from arm_drake.visualization.page.live_views import LiveViews, Pictures
from arm_drake.visualization.page.motion_planning import MotionPlanning, SimulatedRobots
from arm_drake.visualization.page.panel import (
    AS_FAST_AS_POSSIBLE,
    make_report,
    rate_options,
    rate_text,
    read_rate,
    read_time,
)
from arm_drake.visualization.page.parts import PARTS, Part, make_parts
from arm_drake.visualization.recording import start_recording
from arm_drake.visualization.teleop.base import Remote
from arm_drake.visualization.teleop.remotes import find_remotes
from arm_drake.worlds.things import Thing

if TYPE_CHECKING:
    from arm_drake.wire.server import RosServer

# What was missed of real time for longer than this is given up [s].
_LONGEST_LAG = 0.1

# How long the page may wait for a simulation that is slow [s].
_LONGEST_STEP = 0.05

# The real-time factor is that of so much wall time [s].
_FACTOR_WINDOW = 1.0


class RealtimePacer:
    """Sets how far to simulate, by the wall clock; it stands until `start`."""

    def __init__(self, rate: float) -> None:
        """Create it."""
        if not (math.isfinite(rate) and rate >= 0.0):
            raise InputError(f"real-time rate: expected at least 0, got {rate!r}")
        self.rate = float(rate)
        self._step = _LONGEST_STEP
        self._played = 0.0
        self._is_started = False
        self._since = 0.0
        # Wall times and the simulated times that belong to them [s].
        self._anchor = (0.0, 0.0)
        self._moments = [self._anchor]

    @property
    def factor(self) -> float:
        """Simulated seconds per second in the last second."""
        (first, start), (last, end) = self._moments[0], self._moments[-1]
        return (end - start) / (last - first) if last > first else 0.0

    @property
    def wall_time(self) -> float:
        """Wall time between starts and stops so far [s]."""
        running = time.perf_counter() - self._since if self._is_started else 0.0
        return self._played + running

    def start(self, simulated: float) -> None:
        """Let real time count from now, at a simulated time [s]."""
        now = time.perf_counter()
        self._since, self._is_started = now, True
        self._anchor = (now, simulated)
        self._moments = [self._anchor]

    def stop(self) -> None:
        """Let real time count no more."""
        self._played = self.wall_time
        self._is_started = False

    def continue_from(self, other: "RealtimePacer") -> None:
        """Count the wall time of another pace, which this one replaces."""
        self._played = other.wall_time

    def target(self, simulated: float) -> float:
        """Return the time to simulate up to now [s], from a simulated time [s]."""
        target = math.inf
        if self.rate > 0.0:
            now = time.perf_counter()
            wall, start = self._anchor
            target = start + self.rate * (now - wall)
            if target > simulated + _LONGEST_LAG * self.rate:
                target = simulated + _LONGEST_LAG * self.rate
                self._anchor = (now, target)
        return min(target, simulated + self._step)

    def note(self, simulated: float, step: float, took: float) -> None:
        """Take note of the wall time of a step, the time after it, its length [s]."""
        if step > 0.0:
            # As long as the page may wait, but not all at once.
            longest = step * _LONGEST_STEP / max(took, 1e-6)
            self._step = min(longest, 2.0 * max(step, self._step))
        now = time.perf_counter()
        self._moments.append((now, simulated))
        while len(self._moments) > 2 and self._moments[1][0] < now - _FACTOR_WINDOW:
            self._moments.pop(0)


# Pictures, and updates of the panel, per second of wall time [s].
_FRAME_PERIOD = 1.0 / 30.0
_PANEL_PERIOD = 0.1

# How long programs outside wait for an answer while it is paused [s].
_EXCHANGE_PERIOD = 0.01

# Velocities of bases are sent anew after so much simulated time [s].
_REPEAT_PERIOD = 0.1

_NUM_LINES = 50

Progress = Callable[[float], None]


class LiveSimulation:
    """Runs a simulation on a page: play, pause, step, reset, goals, controllers.

    All that can be clicked on its page is a method, too. It is used in the thread that
    made its page. What it does between two clicks is bit for bit what `Simulation.run`
    does.
    """

    # Whether `run` returns when the motion's tasks are done.
    ends = False

    # For programs outside: its page goes on while it is paused, and it can be reset.
    is_waiting, can_reset = False, True

    def __init__(
        self,
        page: Page,
        simulation: Simulation,
        *,
        motion: MotionSource | None = None,
        realtime_rate: float = 1.0,
        is_paused: bool = False,
        shown: Iterable[str] = ("visual",),
        frame_rate: float | None = None,
        history: float = math.inf,
        scene: Scene | None = None,
        ros: str | None = None,
        build: Callable[[Scene], Diagram] | None = None,
    ) -> None:
        """Show a simulation; `run` lets it go.

        Args:
            page: Where to show it.
            simulation: What to run. Its diagram draws on the page's Meshcat, with the
                option `frame_rate=0`: this one says when.
            motion: What to send to the controllers, as that of `Simulation.run`.
            realtime_rate: Simulated seconds per second; 0 is as fast as it goes.
            is_paused: Whether it waits for `play`.
            shown: What is shown at first, as `show` calls it.
            frame_rate: Pictures per simulated second for a recording [Hz]; None if
                nothing is recorded.
            history: How much of the past the rollout has at least [s]; from twice as
                much on, the rest is forgotten.
            scene: What is simulated, for a button that saves it as it is now.
            ros: How programs that speak ROS 2 get in; see `RosServer`.
            build: Makes the diagram of a scene on the same page, to insert things.

        Raises:
            InputError: If there is nothing called as in ``shown``.
            MotionError: As `Simulation.run`.
        """
        self.simulation, self.scene, self._build = simulation, scene, build
        recorded = frame_rate is not None
        self.views = LiveViews(page, simulation, tuple(shown), is_recorded=recorded)
        self.remotes: list[Remote] = find_remotes(simulation)
        self.page, self._motion = page, self._find(motion)
        self._pacer = RealtimePacer(realtime_rate)
        self._is_playing, self._duration = not is_paused, math.inf
        self._frame_rate, self._is_stopped, self.is_ended = frame_rate, False, False
        self._history = History(simulation.mailbox, history)
        if frame_rate is not None:
            start_recording(page.meshcat, frame_rate)
        self._pictures, self._longest, self._log = Pictures(), history, LogLines()
        self._drawn = math.nan  # The time that is drawn [s]; NaN is to be drawn anew.
        # The past time that is shown, and since when in wall time it is replayed [s].
        self._shown_time: float | None = None
        self._replayed_at: float | None = None
        simulation.on_event(lambda event: self._log.add(simulation, event))
        self.planning = MotionPlanning(page, SimulatedRobots(self))
        self.parts: list[Part] = make_parts(self, PARTS)
        self._start()
        self._report_depth()
        self.ros = self._serve(ros)
        page.set_panel(self._title(), make_sections(self))

    def _report_depth(self) -> None:
        """Report how to put a robot on the ground that stands in it."""
        depth = self.views.depth
        if depth > 0.0:
            names = list(self.simulation.robots)
            who = f"{names[0]} reaches" if len(names) == 1 else "the robots reach"
            self.note(
                f"{who} {1e3 * depth:.3g} mm below the ground; to stand on it: --pose "
                f"x y z roll pitch yaw, with z larger by {depth:.3g}"
            )

    def _find(self, motion: MotionSource | None) -> Motion | None:
        robot = next(iter(self.simulation.robots.values()))
        return None if motion is None else find_motion(motion, robot)

    def _serve(self, ros: str | None) -> "RosServer | None":
        if ros is None:
            return None
        # Not at the top: nothing of it is needed else.
        from arm_drake.wire.server import RosServer

        return RosServer(self.simulation, ros, controls=self).start()

    @property
    def is_playing(self) -> bool:
        """Whether simulated time passes."""
        return self._is_playing

    @property
    def realtime_rate(self) -> float:
        """Simulated seconds per second that are wanted; 0 is as fast as it goes."""
        return self._pacer.rate

    @property
    def realtime_factor(self) -> float:
        """Simulated seconds per second in the last second."""
        return self._pacer.factor

    @property
    def wall_time(self) -> float:
        """Wall time of playing since the start or the last reset [s]."""
        return self._pacer.wall_time

    @property
    def log(self) -> str:
        """The last news of goals, switches and controllers."""
        return str(self._log)

    @property
    def shown_time(self) -> float:
        """The time that is shown [s]: now, or a past one after `seek` or `replay`."""
        return self.simulation.time if self._shown_time is None else self._shown_time

    @property
    def first_time(self) -> float:
        """The earliest time that can be shown [s]."""
        return min([*self._pictures.times[:1], self.simulation.time])

    def seek(self, time: float) -> None:
        """Pause, and show how it was at a time [s]; what goes on goes on from now."""
        if not math.isfinite(time):
            raise InputError(f"time: expected a number [s], got {time!r}")
        self.pause()
        self._replayed_at = None
        is_past = self._pictures.times and time < self.simulation.time
        self._shown_time = max(time, self._pictures.times[0]) if is_past else None

    def replay(self) -> None:
        """Pause, and show what was so far, at the real-time rate."""
        self.seek(-1.0)
        self._replayed_at = time.perf_counter()

    def play(self) -> None:
        """Let time pass, from now on."""
        self._shown_time = self._replayed_at = None
        if not self._is_playing:
            self._is_playing = True
            self._pacer.start(self.simulation.time)

    def pause(self) -> None:
        """Let time stand."""
        if self._is_playing:
            self._is_playing = False
            self._pacer.stop()

    def step(self, cycles: int = 1) -> None:
        """Pause, and simulate up to the next cycle of the controller manager.

        Args:
            cycles: How many cycles to go.
        """
        self.pause()
        self._shown_time = self._replayed_at = None
        period = self.simulation.period
        cycle = math.floor(self.simulation.time / period + TICK_TOLERANCE) + cycles
        self._advance_to(cycle * period)

    def reset(self) -> None:
        """Go back to the start: time 0, initial positions, the motion from its start.

        It goes on playing if it was.
        """
        self.simulation.reset()
        for remote in self.remotes:
            remote.reset()
        for part in self.parts:
            part.reset()
        self.planning.clear()
        if self._frame_rate is not None:
            start_recording(self.page.meshcat, self._frame_rate)
        self._log.clear()
        self._pictures.clear()
        self._shown_time = self._replayed_at = None
        self._end = self.simulation.time + self._duration
        self._start()
        self.views.draw()

    def set_realtime_rate(self, rate: float) -> None:
        """Set how fast time passes.

        Args:
            rate: Simulated seconds per second; 0 is as fast as it goes.

        Raises:
            InputError: If it is negative, or no number.
        """
        pacer = RealtimePacer(rate)
        pacer.continue_from(self._pacer)
        self._pacer = pacer
        if self._is_playing:
            pacer.start(self.simulation.time)

    def run(
        self, duration: float | None = None, progress: Progress | None = None
    ) -> None:
        """Do what is clicked, and simulate while it is playing.

        Args:
            duration: Simulated time after which it returns [s], counted anew from a
                reset; None is until `stop`.
            progress: Called with the simulated time [s], ten times a second.

        Raises:
            SimulationError: If the simulation can't go on, or Meshcat has ended.
        """
        with self.page.drawing():
            self._run(duration, progress)

    def _run(self, duration: float | None, progress: Progress | None) -> None:
        self._duration = math.inf if duration is None else duration
        self._end = self.simulation.time + self._duration
        if self._is_playing:
            self._pacer.start(self.simulation.time)
        next_picture = next_panel = time.perf_counter()
        self._drawn = math.nan
        while not self._is_stopped and self.simulation.time < self._end:
            wait = min(next_picture, next_panel) - time.perf_counter()
            # As fast as it goes: no waiting, but for what is clicked.
            is_busy = self._is_playing and self.realtime_rate == 0.0
            if self.ros is not None:
                wait = min(wait, _EXCHANGE_PERIOD)
            self.handle(self.page.events(0.0 if is_busy else max(wait, 0.0)))
            try:
                if self._is_playing:
                    self._advance()
                elif self.ros is not None:
                    self.ros.idle()
            except ResetRequested:
                self.reset()
            now = time.perf_counter()
            if now >= next_picture:
                self._go_on_replaying(now)
                if self._shown_time is None:
                    self.planning.tick()
                # A recording has the pictures that its own times ask for, no others.
                is_due = self._frame_rate is None or not self._is_playing
                if is_due and self._drawn != self.shown_time:
                    self._draw()
                next_picture = max(next_picture + _FRAME_PERIOD, now)
            if now >= next_panel:
                self._history.trim()
                self._pictures.trim(self.simulation.time - 2.0 * self._longest)
                self._tell(progress)
                next_panel = now + _PANEL_PERIOD
        if self._is_playing:
            self._pacer.stop()
        self._is_stopped = False
        self._shown_time = self._replayed_at = None
        self._draw()
        self._tell(progress)

    def _go_on_replaying(self, now: float) -> None:
        if self._shown_time is not None and self._replayed_at is not None:
            passed = (now - self._replayed_at) * (self.realtime_rate or 1.0)
            self._shown_time, self._replayed_at = self._shown_time + passed, now
            if self._shown_time >= self.simulation.time:
                self._shown_time = self._replayed_at = None

    def _draw(self) -> None:
        if self._shown_time is None:
            self.views.draw()
            self._pictures.add(self.simulation.time, self.views.positions())
            for part in self.parts:
                part.draw()
        else:
            self.views.draw_past(self._pictures.at(self._shown_time))
        self._drawn = self.shown_time

    def save_scene(self) -> Path:
        """Write the scene as it is now to a new file in the working folder.

        Raises:
            InputError: If there is no scene, or it can't be written.
        """
        if self.scene is None:
            raise InputError("no scene was given that could be saved")
        path = find_free_path("scene")
        self.scene.at(self.simulation).save(path)
        self.note(f"scene saved: {path}")
        return path

    @property
    def can_insert(self) -> bool:
        """Whether things can be inserted while it runs."""
        has_scene = self._build is not None and self.scene is not None
        return has_scene and self.views.has_physics

    def insert(self, thing: Thing) -> None:
        """Put a thing into the scene; all else goes on as it is.

        After a reset it is there from the start. The time bar begins anew.

        Raises:
            InputError: If its name is taken, or the simulation takes no things.
        """
        if self._build is None or self.scene is None:
            raise InputError("no scene was given that a thing could be put into")
        if self.ros is not None or self._frame_rate is not None:
            text = "nothing is inserted while a program outside is served, or recorded"
            raise InputError(text)
        scene = dc.replace(self.scene, things=(*self.scene.things, thing))
        continue_with(self.simulation, self._build(scene))
        self.scene = scene
        self.views.look_anew()
        self.remotes = find_remotes(self.simulation)
        self.planning.clear()
        self.planning = MotionPlanning(self.page, SimulatedRobots(self))
        self.parts = make_parts(self, PARTS, self.parts)
        self._pictures.clear()
        self._shown_time = self._replayed_at = None
        self._drawn = math.nan
        self.page.set_panel(self._title(), make_sections(self))
        self.note(f"{thing.name} inserted")

    def note(self, text: str) -> None:
        """Add a line to the news."""
        self._log.note(self.simulation, text)

    def wait_for_browser(self) -> None:
        """Wait until a browser shows the page, doing what is clicked, or `stop`."""
        with self.page.drawing():
            self._draw()
            while not (self._is_stopped or self.page.num_browsers):
                self.handle(self.page.events(_PANEL_PERIOD))
            self._tell(None)

    def give_up(self) -> None:
        """Report tasks of the motion that weren't ended or begun: none goes on."""
        self._player.give_up()

    def close(self) -> None:
        """Give up, and end the connections of external programs."""
        self.give_up()
        if self.ros is not None:
            self.ros.stop()

    def end(self) -> None:
        """End `run` for good: whoever runs it is to end, too."""
        self.is_ended = True
        self.stop()

    def stop(self) -> None:
        """End `run`, or the next one, within a twentieth of a second."""
        self._is_stopped = True
        self.page.call(lambda: None)  # It may wait for a click.

    def handle(self, events: Iterable[WidgetEvent]) -> None:
        """Do what was clicked.

        Args:
            events: What happened on the page, in order.
        """
        waiting = list(events)
        while waiting:  # Of clicks during the search for a plan there may be more.
            self.page.handle(waiting, lambda event: self._do(event.id, event.value))
            waiting = self.planning.waiting_events()

    def _do(self, name: str, value: Any) -> None:
        kind, _, what = name.partition(":")
        if kind == "play":
            self.pause() if self._is_playing else self.play()
        elif kind in ("replay", "end", "save_scene"):
            getattr(self, kind)()
        elif kind == "seek":
            self.seek(read_time(value))
        elif kind in ("step", "reset", "frame"):
            getattr(self.views if kind == "frame" else self, kind)()
        elif kind == "rate":
            self.set_realtime_rate(read_rate(value))
        elif kind == "activate":
            self.simulation.switch_controllers(activate=[what])
        elif kind == "deactivate":
            self.simulation.switch_controllers(deactivate=[what])
        elif kind == "remote":
            owners = (
                remote
                for remote in self.remotes
                if name.startswith(f"remote:{remote.controller}:")
            )
            # A controller may be called as the start of another.
            owner = max(owners, key=lambda one: len(one.controller), default=None)
            if owner is not None:
                taken = owner.handle(name, value)
                part = name.removeprefix(f"remote:{owner.controller}:")
                text = f"{owner.controller}: {part.replace(':', ' ')}"
                if taken is not None:
                    text += f" {taken:.4g}"
                self._log.note(self.simulation, f"{text} by the panel", source=name)
        elif not self.planning.handle(name, value) and not any(
            part.handle(name, value) for part in self.parts
        ):
            self.views.handle(name, value)
            self._drawn = math.nan

    def _title(self) -> str:
        return ", ".join(robot.title for robot in self.simulation.robots.values())

    def _start(self) -> None:
        """Begin at the present time of the simulation."""
        tolerance = TICK_TOLERANCE * self.simulation.period
        self._player = Player(self.simulation, self._motion, tolerance)
        self._repeat_at = self._picture_at = self.simulation.time
        self._pacer = RealtimePacer(self._pacer.rate)
        if self._is_playing:
            self._pacer.start(self.simulation.time)

    def _advance(self) -> None:
        """Simulate as far as real time has come."""
        start, before = time.perf_counter(), self.simulation.time
        target = min(self._pacer.target(before), self._end)
        if target > before:
            self._advance_to(target)
        took = time.perf_counter() - start
        self._pacer.note(self.simulation.time, target - before, took)

    def _advance_to(self, target: float) -> None:
        """Simulate up to a time, and do what is due on the way."""
        while self.simulation.time < target:
            due = [target]
            if self._frame_rate is not None:
                due.append(self._picture_at)
            due.append(self._repeat_at)
            due += [self.simulation.time + part.advance() for part in self.parts]
            self._player.play(min(due) - self.simulation.time, ends=self.ends)
            now = self.simulation.time
            if self.ends and self._player.is_over:
                target, self._end, self.ends = now, now, False
            if now >= self._repeat_at:
                for remote in self.remotes:
                    remote.tick(now)
                self._repeat_at = now + _REPEAT_PERIOD
            if self._frame_rate is not None and now >= self._picture_at:
                self._draw()
                self._picture_at = now + 1.0 / self._frame_rate

    def _tell(self, progress: Progress | None) -> None:
        self.page.patch(make_changes(self))
        if self._shown_time is None:
            self.views.refresh()
        if progress is not None:
            progress(self.simulation.time)


class LogLines:
    """The last news, as lines."""

    def __init__(self) -> None:
        """Create it without lines."""
        self._lines: collections.deque[str] = collections.deque(maxlen=_NUM_LINES)
        self._source = ""

    def add(self, simulation: Simulation, event: SimulationEvent) -> None:
        """Take news, if they are worth a line."""
        text = ""
        if isinstance(event, GoalHandle):
            # Feedback comes with the same status.
            if event.status is not GoalStatus.EXECUTING or not event.feedback:
                text = f"{event.controller}: goal {event.describe()}"
        elif isinstance(event, SwitchControllerResult):
            text = _describe_switch(event)
        elif isinstance(event, CancelResponse):
            text = "" if event.accepted else f"cancel refused: {event.reason}"
        else:
            text = str(simulation.mailbox.describe(event))
        if text:
            self.note(simulation, text)

    def note(self, simulation: Simulation, text: str, source: str = "") -> None:
        """Take a line as it is; of one source that goes on, the last one alone."""
        if source and source == self._source:
            self._lines.pop()
        self._source = source
        self._lines.append(f"{simulation.time:.2f} s  {text}")

    def clear(self) -> None:
        """Forget all lines."""
        self._lines.clear()
        self._source = ""

    def __str__(self) -> str:
        """Return the lines, the newest first."""
        return "\n".join(reversed(self._lines))


def make_sections(live: LiveSimulation) -> list[Section]:
    """Return the panel of a simulation."""
    simulation = live.simulation
    rate = Choice("rate", "real-time rate", **_rate(live.realtime_rate))
    buttons = Buttons(
        (
            Button("play", "pause", "play or pause (space)", key=" "),
            Button("step", "step", "one cycle of the controllers (s)", key="s"),
            Button("reset", "reset", "back to the start"),
            Button("replay", "replay", "what was so far"),
            Button("end", "end", "end the program, as Ctrl-C does", question="end it?"),
        )
    )
    if live.scene is not None:
        hint = "robots and things as they are now, as a file that sim takes"
        save = Button("save_scene", "save scene", hint)
        buttons = Buttons((*buttons.buttons, save))
    bar = Slider("seek", "time shown", 0.0, simulation.time, simulation.time, "s")
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
        Section("Simulation", (buttons, bar, rate, *times)),
        Section("Controllers", items),
        *(Section(remote.title, remote.widgets()) for remote in live.remotes),
        live.planning.section(),
        *(part.section() for part in live.parts),
        live.views.readout.section(),
        Section("Show", (look, *live.views.widgets())),
        Section("News", (Text("log", "the newest first", can_copy=True),)),
        make_report(simulation.report),
    ]
    return [section for section in sections if section.widgets]


def make_changes(live: LiveSimulation) -> dict[str, dict[str, Any]]:
    """Return the present values of what changes in the panel, by widget."""
    simulation = live.simulation
    changes: dict[str, dict[str, Any]] = {
        "play": {"label": "pause" if live.is_playing else "play"},
        "rate": _rate(live.realtime_rate),
        "seek": {
            "value": live.shown_time,
            "lower": live.first_time,
            "upper": simulation.time,
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
    changes |= live.planning.changes()
    for part in live.parts:
        changes |= {name: dict(fields) for name, fields in part.changes().items()}
    return changes


def _class_name(type_: str) -> str:
    return re.split(r"/|::", type_)[-1]


def _rate(now: float) -> dict[str, Any]:
    """Return the fields of the choice of the real-time rate."""
    options = (*rate_options(now), AS_FAST_AS_POSSIBLE)
    return {"options": options, "value": rate_text(now)}


def _describe_switch(result: SwitchControllerResult) -> str:
    parts = [
        f"{verb} {', '.join(names)}"
        for verb, names in (
            ("activated", result.request.activate_controllers),
            ("deactivated", result.request.deactivate_controllers),
        )
        if names
    ]
    text = "; ".join(parts)
    return f"{text}: {result.message}" if result.message else text
