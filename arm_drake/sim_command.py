"""The command `arm-drake sim`: Gazebo's place."""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from pydrake.geometry import Meshcat

from arm_drake.bundled import bundled_motions
from arm_drake.clients import GoalHandle
from arm_drake.description.robot import Robot
from arm_drake.diagram import build_diagram
from arm_drake.drake_log import use_native_logging
from arm_drake.errors import InputError, MotionError, OutputError, suggest
from arm_drake.messages import GoalStatus, TopicRejected
from arm_drake.motion import Motion, load_motion
from arm_drake.options import SimulationOptions
from arm_drake.output_files import check_suffix, check_writable
from arm_drake.rollout import Rollout, writer_for
from arm_drake.simulation import Simulation
from arm_drake.visualization.browser import check_installed
from arm_drake.visualization.meshcat import frame_points, save_html, start_meshcat
from arm_drake.visualization.plot import check_plot_path
from arm_drake.visualization.screenshot import SCREENSHOT_SUFFIXES, save_screenshot

# How long a simulation without a motion lasts, headless [s].
_HEADLESS_DURATION = 10.0

# What follows a motion [s].
_AFTER_MOTION = 1.0

_FAILED = (GoalStatus.REJECTED, GoalStatus.ABORTED)


def simulate(options: argparse.Namespace, robot: Robot) -> int:
    """Simulate a robot as the command line says; return the exit code.

    Args:
        options: Arguments of `arm-drake sim`.
        robot: The robot.
    """
    use_native_logging()
    say = _Speaker(is_quiet=options.json)
    if options.hold and options.headless:
        raise InputError("--hold keeps the page, and with --headless there is none")
    _check_outputs(options)
    motion = _find_motion(options.motion, robot)
    meshcat = None
    if not options.headless or options.record or options.screenshot:
        meshcat = start_meshcat(host=options.host, port=options.port)
    simulation = Simulation(
        build_diagram(
            robot,
            world=options.world,
            options=_simulation_options(options),
            meshcat=meshcat,
        )
    )
    report = simulation.report
    if options.strict and len(report):
        raise InputError(f"not everything was taken as written:\n{report}")
    for entry in report:
        if entry.severity != "info":
            print(entry, file=sys.stderr)
    simulation.check_motion(motion)
    if meshcat is not None:
        points = [pose.translation() for pose in simulation.link_poses().values()]
        frame_points(meshcat, points)
    if meshcat is not None and not options.headless:
        say.page(f"page: {meshcat.web_url()}")
        if options.host != "localhost":
            say.page("whoever reaches this machine can open the page")
    simulation.on_event(say.event)
    duration = _choose_duration(options, motion)
    wall_time = _run(simulation, duration, motion, options, meshcat, say)
    rollout = simulation.rollout()
    _write(rollout, options, meshcat, say)
    failures = _failures(simulation)
    if options.json:
        print(json.dumps(_summary(simulation, robot, rollout, wall_time)))
    else:
        _print_summary(simulation, rollout, wall_time, say)
    for failure in failures:
        print(f"arm-drake: {failure}", file=sys.stderr)
    if options.hold and meshcat is not None and not options.headless:
        _hold(meshcat, say)
    return 1 if failures else 0


class _Speaker:
    """Says how it goes: lines on standard output, progress on standard error."""

    def __init__(self, *, is_quiet: bool) -> None:
        self._is_quiet = is_quiet
        self._is_terminal = sys.stderr.isatty()
        self._next_report = 0.0
        self._news = ""

    def line(self, text: str) -> None:
        if not self._is_quiet:
            if self._is_terminal:
                sys.stderr.write("\r\033[K")
            print(text, flush=True)

    def page(self, text: str) -> None:
        """Say something about the page: also beside JSON, on standard error."""
        if self._is_quiet:
            print(text, file=sys.stderr, flush=True)
        else:
            self.line(text)

    def progress(self, simulated: float) -> None:
        """Show the simulated time: in place on a terminal, else once a second."""
        text = f"{simulated:7.2f} s  {self._news}"
        if self._is_terminal:
            sys.stderr.write(f"\r\033[K{text}")
            sys.stderr.flush()
        elif simulated >= self._next_report and not self._is_quiet:
            print(text, file=sys.stderr, flush=True)
            self._next_report = simulated + 1.0 - 1e-6

    def event(self, news: GoalHandle | TopicRejected) -> None:
        if isinstance(news, TopicRejected):
            return
        if news.status is GoalStatus.EXECUTING:
            if news.feedback:
                errors = news.feedback[-1].error.positions
                largest = max((abs(error) for error in errors), default=0.0)
                self._news = f"{news.controller}: error {1e3 * largest:.1f} mrad"
            else:
                self.line(f"{news.controller}: goal accepted")
                if news.note:
                    print(f"warning: {news.controller}: {news.note}", file=sys.stderr)
        elif news.result is not None:
            self._news = ""
            text = f"{news.status.value}, error code {int(news.result.error_code)}"
            if news.result.error_string:
                text += f": {news.result.error_string}"
            self.line(f"{news.controller}: {text}")


def _simulation_options(options: argparse.Namespace) -> SimulationOptions:
    defaults = SimulationOptions()
    return SimulationOptions(
        time_step=options.time_step or defaults.time_step,
        gravity=options.gravity == "on",
        active=tuple(options.active),
        inactive=tuple(options.inactive),
    )


def _check_outputs(options: argparse.Namespace) -> None:
    """Find out before the simulation what can't be written after it."""
    if options.log is not None:
        writer_for(options.log)
    if options.plot is not None:
        check_plot_path(options.plot)
    if options.record is not None and options.record.suffix != ".html":
        raise OutputError("expected a .html file to record to", file=options.record)
    if options.screenshot is not None:
        check_installed()
        check_suffix(options.screenshot, "a screenshot", SCREENSHOT_SUFFIXES)
    for path in (options.log, options.plot, options.record, options.screenshot):
        if path is not None:
            check_writable(path)


def _find_motion(name: str | None, robot: Robot) -> Motion | None:
    """Return the motion of a name or a file."""
    if name is None:
        return None
    known = bundled_motions(robot.bundled) if robot.bundled else {}
    if name in known:
        return load_motion(known[name])
    if not Path(name).suffix and not Path(name).is_file():
        owner = robot.bundled or robot.name
        hint = suggest(name, known) if known else "give the file of a motion"
        raise MotionError(f"no motion {name!r} of {owner!r}, and no such file; {hint}")
    return load_motion(name)


def _choose_duration(
    options: argparse.Namespace, motion: Motion | None
) -> float | None:
    """Return how long to simulate [s]; None is until Ctrl-C."""
    if options.duration is not None:
        return float(options.duration)
    if motion is not None:
        return motion.duration + _AFTER_MOTION
    return _HEADLESS_DURATION if options.headless else None


def _run(
    simulation: Simulation,
    duration: float | None,
    motion: Motion | None,
    options: argparse.Namespace,
    meshcat: Meshcat | None,
    say: _Speaker,
) -> float:
    """Run the simulation; return the wall time that it took [s]."""
    rate = options.rate
    if rate is None:
        rate = 0.0 if options.headless else 1.0
    if meshcat is not None and options.record:
        meshcat.StartRecording(set_visualizations_while_recording=True)
    start = time.perf_counter()
    try:
        if duration is None:
            say.line("simulating until Ctrl-C")
            while True:
                simulation.run(1.0, realtime_rate=rate, progress=say.progress)
        simulation.run(duration, motion, rate, say.progress)
    except KeyboardInterrupt:  # What was simulated is kept.
        say.line(f"stopped at {simulation.time:.2f} s")
    return time.perf_counter() - start


def _write(
    rollout: Rollout,
    options: argparse.Namespace,
    meshcat: Meshcat | None,
    say: _Speaker,
) -> None:
    """Write what the command line asks for."""
    if options.log is not None:
        rollout.save(options.log)
        say.line(f"log: {options.log}")
    if options.plot is not None:
        rollout.plot(options.plot)
        say.line(f"plot: {options.plot}")
    if options.record is not None and meshcat is not None:
        meshcat.StopRecording()
        meshcat.PublishRecording()
        save_html(meshcat, options.record)
        size = options.record.stat().st_size / 1e6
        say.line(f"recording: {options.record} ({size:.1f} MB)")
    if options.screenshot is not None and meshcat is not None:
        save_screenshot(meshcat, options.screenshot)
        say.line(f"screenshot: {options.screenshot}")


def _failures(simulation: Simulation) -> list[str]:
    """Return a line for each goal and message that failed."""
    lines = []
    for goal in simulation.goals:
        if goal.status in _FAILED and goal.result is not None:
            place = f"{goal.where}: " if goal.where else ""
            lines.append(
                f"{place}{goal.controller}: goal {goal.status.value}, "
                f"error code {int(goal.result.error_code)}: {goal.result.error_string}"
            )
    for rejected in simulation.rejected:
        where = simulation.source_of(rejected)
        place = f"{where}: " if where else ""
        lines.append(f"{place}trajectory refused: {rejected.reason}")
    return lines


def _summary(
    simulation: Simulation, robot: Robot, rollout: Rollout, wall_time: float
) -> dict[str, Any]:
    final = simulation.joint_states()
    return {
        "robot": robot.name,
        "joints": list(rollout.joint_names),
        "duration": simulation.time,
        "wall_time": wall_time,
        "real_time_factor": simulation.time / wall_time if wall_time else None,
        "controllers": [row._asdict() for row in simulation.list_controllers()],
        "goals": [
            {
                "controller": goal.controller,
                "status": goal.status.value,
                "error_code": None if goal.result is None else goal.result.error_code,
                "error_string": "" if goal.result is None else goal.result.error_string,
            }
            for goal in simulation.goals
        ],
        "effort_saturation": rollout.effort_saturation(),
        "final": dict(zip(final.name, final.position, strict=True)),
        "report": simulation.report.to_json(),
    }


def _print_summary(
    simulation: Simulation, rollout: Rollout, wall_time: float, say: _Speaker
) -> None:
    factor = simulation.time / wall_time if wall_time else 0.0
    say.line(
        f"simulated {simulation.time:.2f} s in {wall_time:.2f} s "
        f"({factor:.1f} x real time)"
    )
    for goal in simulation.goals:
        if not goal.status.is_terminal:
            say.line(f"{goal.controller}: goal is still {goal.status.value}")
    for name, seconds in rollout.effort_saturation().items():
        say.line(f"{name} was at its effort limit for {seconds:.2f} s")


def _hold(meshcat: Meshcat, say: _Speaker) -> None:
    """Keep the page until Ctrl-C."""
    say.page(f"the page stays at {meshcat.web_url()} until Ctrl-C")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return
