"""The files that `arm-drake sim` writes."""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat

from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, OutputError
from arm_drake.manager.state import CommandLimited
from arm_drake.messages import (
    FollowJointTrajectoryResult,
    GoalStatus,
    SwitchControllerResult,
)
from arm_drake.output_files import (
    PLOT_KINDS,
    check_plot_path,
    check_suffix,
    check_writable,
)
from arm_drake.rollout.formats import can_stream, writer_for
from arm_drake.rollout.mcap import load_types
from arm_drake.rollout.rollout import Rollout
from arm_drake.simulation.mailbox import GoalHandle, SimulationEvent
from arm_drake.simulation.motion import TaskOutcome
from arm_drake.simulation.recording import read_rollout
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.recording import save_recording
from arm_drake.visualization.screenshot import (
    SCREENSHOT_SUFFIXES,
    check_installed,
    save_screenshot,
)
from arm_drake.visualization.video import (
    VIDEO_SUFFIXES,
    check_video_installed,
    save_video,
)

# Less isn't told of how long a joint was at its effort limit [s].
_SHORTEST = 0.005


class Speaker:
    """Prints reports: lines on standard output, progress on standard error."""

    def __init__(self, *, is_quiet: bool) -> None:
        """Create it; if quiet, nothing else than JSON is on standard output."""
        self._is_quiet = is_quiet
        self._is_terminal = sys.stderr.isatty()
        self._simulation: Simulation | None = None
        # When errors of goals were printed last [s], what was said of them, and by
        # controller since when they aren't printed.
        self._printed_at = -math.inf
        self._errors = ""
        self._unprinted: dict[str, float] = {}
        self._controllers = ""
        # What ended the simulation before its end, and whether that was Ctrl-C.
        self.failures: list[str] = []
        self.is_stopped = False

    def line(self, text: str) -> None:
        """Print a line, if it isn't empty."""
        if text and not self._is_quiet:
            if self._is_terminal:
                sys.stderr.write("\r\033[K")
            print(text, flush=True)

    def controllers(self, simulation: Simulation) -> None:
        """List the controllers, unless they are as they were last."""
        text = str(simulation.list_controllers())
        if text != self._controllers:
            self.line(text)
        self._controllers = text

    def page(self, text: str) -> None:
        """Print a line about the page: also beside JSON, on standard error."""
        if self._is_quiet:
            print(text, file=sys.stderr, flush=True)
        else:
            self.line(text)

    def watch(self, simulation: Simulation) -> None:
        """Report events of a simulation, and how well its goals are followed."""
        self._simulation = simulation
        simulation.on_event(self.event)

    def progress(self, simulated: float) -> None:
        """Show the simulated time, and the largest errors of goals in the last second.

        It is in place on a terminal, else a line for each second that has an error.
        """
        if self._is_quiet and not self._is_terminal:
            return
        # A simulation that was reset is before what was printed last.
        if not 0.0 <= simulated - self._printed_at < 1.0 - 1e-6:
            self._print_errors(simulated)
        elif self._is_terminal:
            self._show(simulated)

    def _print_errors(self, simulated: float) -> None:
        """Print the largest errors of goals since they were printed last."""
        self._errors = ", ".join(
            f"{name}: tracking error {error}"
            for name, since in self._unprinted.items()
            if (error := self._describe_error(name, since))
        )
        self._unprinted = dict.fromkeys(self._unprinted, simulated)
        self._printed_at = simulated
        if self._is_terminal or self._errors:
            self._show(simulated)

    def _show(self, simulated: float) -> None:
        text = f"{simulated:7.2f} s  {self._errors}"
        start, end = ("\r\033[K", "") if self._is_terminal else ("", "\n")
        print(start, text, sep="", end=end, file=sys.stderr, flush=True)

    def _describe_error(self, controller: str, since: float) -> str:
        """Return a controller's largest error since a time [s], "" if none."""
        assert self._simulation is not None
        mailbox = self._simulation.mailbox
        manager, *_ = self._simulation.directory.find(controller)
        context = mailbox.simulator.get_context()
        rollout = read_rollout(mailbox.diagram, context, manager, since)
        name = controller.removeprefix(manager.prefix)
        if name not in rollout.references:
            return ""
        error = np.abs(rollout.tracking_error(name)[rollout.time > since])
        types = dict(zip(rollout.joint_names, rollout.joint_types, strict=True))
        joints = rollout.references[name].joint_names
        is_sliding = np.array([types[joint] == "prismatic" for joint in joints])
        largest = np.max(error, axis=0, initial=0.0, where=np.isfinite(error))
        parts = ((~is_sliding, "mrad"), (is_sliding, "mm"))
        texts = [f"{1e3 * largest[of].max():.1f} {u}" for of, u in parts if of.any()]
        return " and ".join(text for text in texts if not text.startswith("0.0 "))

    def event(self, event: SimulationEvent) -> None:
        """Report events of goals and switches; failures are reported at the end."""
        if isinstance(event, SwitchControllerResult) and event.ok:
            self._switched(event)
        elif isinstance(event, CommandLimited):
            text = f"commands of joint {event.joint!r} go beyond its limits"
            print(f"warning: {text}; they are held to them", file=sys.stderr)
        elif isinstance(event, GoalHandle):
            self._goal(event)
        elif isinstance(event, TaskOutcome):
            self.line(event.describe())

    def _switched(self, result: SwitchControllerResult) -> None:
        lists = {
            "activate": result.request.activate_controllers,
            "deactivate": result.request.deactivate_controllers,
        }
        requested = "; ".join(f"{k} {', '.join(v)}" for k, v in lists.items() if v)
        self.line(f"switch of controllers: {requested}")
        if result.message:
            print(f"warning: left out: {result.message}", file=sys.stderr)

    def _goal(self, goal: GoalHandle) -> None:
        if goal.status is GoalStatus.EXECUTING:
            if not goal.feedback:
                self.line(f"{goal.controller}: goal accepted")
                if goal.note:
                    print(f"warning: {goal.controller}: {goal.note}", file=sys.stderr)
            elif goal.controller not in self._unprinted:
                self._unprinted[goal.controller] = goal.sent_at
        elif goal.status.is_terminal:
            if goal.controller in self._unprinted and not self._is_quiet:
                assert self._simulation is not None
                self._print_errors(self._simulation.time)
            self._unprinted.pop(goal.controller, None)
            self._errors = ""
            self.line(f"{goal.controller}: {goal.describe()}")


def summarize(
    simulation: Simulation,
    saturation: Mapping[str, float],
    wall_time: float,
    failures: Sequence[str],
) -> dict[str, Any]:
    """Return what `--json` prints.

    `saturation` is how long joints were at their effort limit [s], `wall_time` how long
    the simulation took [s], `failures` say what failed.
    """
    final: dict[str, float] = {}
    for name, manager in simulation.directory.managers.items():
        states = simulation.joint_states(name)
        joints = [f"{manager.prefix}{joint}" for joint in states.name]
        final |= zip(joints, states.position, strict=True)
    return {
        "robot": ", ".join(simulation.robots),
        "joints": list(final),
        "duration": simulation.time,
        "wall_time": wall_time,
        "real_time_factor": simulation.time / wall_time if wall_time else None,
        "controllers": [row._asdict() for row in simulation.list_controllers()],
        "goals": [
            {
                "controller": goal.controller,
                "status": goal.status.value,
                **_describe_result(goal),
            }
            for goal in simulation.goals
        ],
        "tasks": [outcome.to_json() for outcome in simulation.tasks],
        "failures": list(failures),
        "effort_saturation": dict(saturation),
        "final": final,
        "report": report_of(simulation).to_json(),
    }


def report_of(simulation: Simulation) -> LoadReport:
    """Return the load reports of all robots as one."""
    managers = simulation.directory.managers.values()
    return LoadReport(dict.fromkeys(e for m in managers for e in m.report))


def say_report(report: LoadReport, *, strict: bool) -> None:
    """Print errors and warnings, or raise InputError for them if `strict`."""
    if strict:
        report.check()
    for entry in report.grouped():
        if entry.severity != "info":
            print(entry, file=sys.stderr)


def print_summary(
    simulation: Simulation,
    saturation: Mapping[str, float],
    wall_time: float,
    say: Speaker,
) -> None:
    """Print how a simulation ended."""
    factor = simulation.time / wall_time if wall_time else 0.0
    say.line(
        f"simulated {simulation.time:.2f} s in {wall_time:.2f} s "
        f"({factor:.1f} x real time)"
    )
    for goal in simulation.goals:
        if not goal.status.is_terminal:
            say.line(f"{goal.controller}: goal is still {goal.status.value}")
    for name, seconds in saturation.items():
        if seconds >= _SHORTEST:
            say.line(f"{name} was at its effort limit for {seconds:.2f} s")


def _describe_result(goal: GoalHandle) -> dict[str, Any]:
    """Return what `--json` says of how a goal ended."""
    result = goal.result
    if isinstance(result, FollowJointTrajectoryResult):
        code, text = int(result.error_code), result.error_string
        return {"error_code": code, "error_string": text}
    description: dict[str, Any] = {"error_code": None, "error_string": goal.note}
    if result is not None:
        description |= {"stalled": result.stalled, "reached_goal": result.reached_goal}
    return description


# How much is kept of what nobody asked to be written [s].
_HISTORY = 300.0

# And beside a log that is written on the way [s].
_HISTORY_WITH_LOG = 60.0

# Where nothing can be shown in place, so much of a film is between two lines.
_SHARE = 0.25


def check_outputs(options: argparse.Namespace) -> None:
    """Find out before the simulation what can't be written after it."""
    if options.log is not None:
        writer_for(options.log)
        if options.log.suffix == ".mcap":
            load_types()
    if options.plot is not None:
        check_plot_path(options.plot)
    elif options.plot_kind is not None:
        raise InputError("--plot-kind says what --plot draws; give --plot, too")
    if options.loop and options.record is None:
        raise InputError("--loop says how --record plays; give --record, too")
    if options.record is not None and options.record.suffix != ".html":
        raise OutputError("expected a .html file to record to", file=options.record)
    if options.screenshot is not None:
        check_installed()
        check_suffix(options.screenshot, "a screenshot", SCREENSHOT_SUFFIXES)
    if options.video is not None:
        check_video_installed()
        check_suffix(options.video, "a film", VIDEO_SUFFIXES)
    images = [path for _, path in camera_images(options)]
    files = (options.log, options.plot, options.record, options.screenshot, *images)
    for path in (*files, options.video):
        if path is not None:
            check_writable(path)


def write_outputs(
    rollout: Rollout,
    options: argparse.Namespace,
    meshcat: Meshcat | None,
    say: Speaker,
    *robots: Robot,
) -> None:
    """Write the requested outputs; pictures are of all the robots."""
    if options.log is not None:
        # Others are written already.
        if not can_stream(options.log):
            rollout.save(options.log)
        say.line(f"log: {options.log} ({_size(options.log)})")
    if options.plot is not None:
        rollout.plot(options.plot, options.plot_kind or PLOT_KINDS[0])
        say.line(f"plot: {options.plot}")
    if options.record is not None and meshcat is not None:
        names = ", ".join(robot.title for robot in robots)
        save_recording(meshcat, options.record, names, loop=options.loop)
        say.line(f"recording: {options.record} ({_size(options.record)})")
    # A house around the robot would be all that is seen of it.
    seen = [f"drake/visual/{robot.name}" for robot in robots]
    if options.screenshot is not None and meshcat is not None:
        save_screenshot(meshcat, options.screenshot, paths=seen)
        say.line(f"screenshot: {options.screenshot}")
    if options.video is not None and meshcat is not None:
        meshcat.StopRecording()
        meshcat.PublishRecording()
        progress = _Progress(say, is_quiet=options.json)
        try:
            film = save_video(
                meshcat, options.video, paths=seen, progress=progress.show
            )
        except KeyboardInterrupt:
            if progress.taken:
                say.line(f"video: {options.video} ends where it was interrupted")
            raise
        of = f"{film.duration:.1f} s, {_size(options.video)}"
        say.line(f"video: {options.video} ({of})")


def camera_images(options: argparse.Namespace) -> list[tuple[str, Path]]:
    """Return cameras and the files of their pictures, or raise InputError."""
    found = []
    for text in getattr(options, "image", ()):
        name, equals, file = text.partition("=")
        if not (name and equals and file):
            raise InputError(f"--image: expected CAMERA=FILE.png, got {text!r}")
        check_suffix(Path(file), "a picture", SCREENSHOT_SUFFIXES)
        found.append((name, Path(file)))
    return found


def write_images(
    simulation: Simulation, options: argparse.Namespace, say: Speaker
) -> None:
    """Write the requested camera images."""
    for name, path in camera_images(options):
        # Not at the top: a simulation without cameras needs none of it.
        from arm_drake.perception.images import save_image

        save_image(simulation.camera(name).image(), path)
        say.line(f"image: {path}")


def needs_recording(options: argparse.Namespace) -> bool:
    """Return whether what is drawn has to be recorded during the simulation."""
    return options.record is not None or options.video is not None


def history_of(options: argparse.Namespace) -> float:
    """Return how much of the past is kept for what is to be written [s]."""
    is_whole = options.log is not None and not can_stream(options.log)
    return math.inf if is_whole or options.plot else _HISTORY


def start_log(options: argparse.Namespace, simulation: Simulation) -> None:
    """Write the log while the simulation runs, if it is of a type that can grow."""
    if options.log is not None and can_stream(options.log):
        # A page keeps its own history.
        is_endless = options.plot is not None or not options.headless
        history = math.inf if is_endless else _HISTORY_WITH_LOG
        simulation.record_to(options.log, history=history)


def find_saturation(
    simulation: Simulation, rollouts: Mapping[str, Rollout]
) -> dict[str, float]:
    """Return how long joints were at their effort limit [s], and end the log."""
    recorder = simulation.recorders[0] if simulation.recorders else None
    if recorder is not None:  # That of the log.
        recorder.close()
    managers = simulation.directory.managers
    return {
        f"{managers[name].prefix}{joint}": time
        for name, rollout in rollouts.items()
        for joint, time in (
            rollout.effort_saturation()
            if recorder is None
            else recorder.effort_saturation(name)
        ).items()
    }


def check_outputs_of_several(options: argparse.Namespace) -> None:
    """Raise OutputError for a log that is of one robot."""
    if options.log is not None and options.log.suffix != ".mcap":
        text = f"a {options.log.suffix} file is of one robot; expected .mcap"
        raise OutputError(text, file=options.log)


def plot_of(path: Path, robot: str) -> Path:
    """Return the file of one robot's plot, where there are several robots."""
    return path.with_name(f"{path.stem}_{robot}{path.suffix}")


def warn_of_pictures(options: argparse.Namespace) -> None:
    """Warn of views that are shown on pages only."""
    if "names" in options.show:
        text = "names of frames are on the page only, not in pictures and recordings"
        print(f"warning: {text}", file=sys.stderr)
    if options.contacts and needs_recording(options):
        print("warning: contact forces are not in recordings", file=sys.stderr)


def _size(path: Path) -> str:
    return f"{path.stat().st_size / 1e6:.1f} MB"


class _Progress:
    """Shows how far a film is: in place, or in a few lines."""

    def __init__(self, say: Speaker, *, is_quiet: bool) -> None:
        self._say = say
        self._is_quiet = is_quiet
        self._printed_at = 0.0
        self.taken = 0

    def show(self, taken: int, total: int) -> None:
        self.taken = taken
        text = f"video: {taken} of {total} pictures"
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\033[K{text}")
            sys.stderr.flush()
        elif not self._is_quiet and self._printed_at + _SHARE * total <= taken < total:
            self._printed_at = taken
            self._say.line(text)
