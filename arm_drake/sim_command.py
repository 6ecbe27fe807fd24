"""The command `arm-drake sim`: Gazebo's place."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydrake.geometry import Meshcat

from arm_drake import yaml_files
from arm_drake.bundled import bundled_motions
from arm_drake.description.robot import Robot
from arm_drake.diagram import build_diagram
from arm_drake.drake_log import use_native_logging
from arm_drake.errors import InputError, MotionError, OutputError, suggest
from arm_drake.motion import Motion, load_motion
from arm_drake.options import SimulationOptions
from arm_drake.output_files import check_suffix, check_writable
from arm_drake.playback import check_motion
from arm_drake.rollout import Rollout, writer_for
from arm_drake.sim_output import Speaker, list_failures, print_summary, summarize
from arm_drake.simulation import Simulation
from arm_drake.visualization.browser import check_installed
from arm_drake.visualization.meshcat import frame_points, save_html, start_meshcat
from arm_drake.visualization.plot import check_plot_path
from arm_drake.visualization.screenshot import SCREENSHOT_SUFFIXES, save_screenshot
from arm_drake.world import load_world

# How long a simulation without a motion lasts, headless [s].
_HEADLESS_DURATION = 10.0

# What follows a motion [s].
_AFTER_MOTION = 1.0

# Longer than anybody waits [s].
_ENDLESS = 1e9


def simulate(options: argparse.Namespace, robot: Robot) -> int:
    """Simulate a robot as the command line says; return the exit code.

    Args:
        options: Arguments of `arm-drake sim`.
        robot: The robot.
    """
    # What Drake says of its file is kept, which native logging wouldn't.
    world = load_world(options.world, robot.package_paths)
    use_native_logging()
    say = Speaker(is_quiet=options.json)
    if options.hold and options.headless:
        raise InputError("--hold keeps the page, and with --headless there is none")
    _check_outputs(options)
    motion = _find_motion(options.motion, options.set, robot)
    meshcat = None
    if not options.headless or options.record or options.screenshot:
        meshcat = start_meshcat(host=options.host, port=options.port)
    simulation = Simulation(
        build_diagram(
            robot,
            world=world,
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
    if motion is not None:
        check_motion(simulation, motion)
    if meshcat is not None:
        points = [pose.translation() for pose in simulation.link_poses().values()]
        frame_points(meshcat, points)
    if meshcat is not None and not options.headless:
        say.page(f"page: {meshcat.web_url()}")
        if options.host != "localhost":
            say.page("whoever reaches this machine can open the page")
    controllers = simulation.list_controllers()
    say.line(str(controllers))
    simulation.on_event(say.event)
    duration = _choose_duration(options, motion)
    wall_time = _run(simulation, duration, motion, options, meshcat, say)
    rollout = simulation.rollout()
    _write(rollout, options, meshcat, say, robot)
    failures = list_failures(simulation)
    if options.json:
        print(json.dumps(summarize(simulation, robot, rollout, wall_time)))
    else:
        print_summary(simulation, rollout, wall_time, say)
        if simulation.list_controllers() != controllers:
            say.line(str(simulation.list_controllers()))
    for failure in failures:
        print(f"arm-drake: {failure}", file=sys.stderr)
    if options.hold and meshcat is not None and not options.headless:
        _hold(meshcat, say)
    return 1 if failures else 0


def _simulation_options(options: argparse.Namespace) -> SimulationOptions:
    defaults = SimulationOptions()
    return SimulationOptions(
        preset=options.preset,
        time_step=options.time_step or defaults.time_step,
        gravity=None if options.gravity is None else options.gravity == "on",
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


def _find_motion(
    name: str | None, given: Sequence[tuple[str, str]], robot: Robot
) -> Motion | None:
    """Return the motion of a name or a file, with values of its parameters."""
    if name is None:
        if given:
            raise InputError("--set is for a parameter of a motion; give --motion, too")
        return None
    parameters = _read_parameters(given)
    known = bundled_motions(robot.bundled) if robot.bundled else {}
    if name in known:
        return load_motion(known[name], parameters)
    if not Path(name).suffix and not Path(name).is_file():
        owner = robot.bundled or robot.name
        hint = suggest(name, known) if known else "give the file of a motion"
        raise MotionError(f"no motion {name!r} of {owner!r}, and no such file; {hint}")
    return load_motion(name, parameters)


def _read_parameters(given: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return the values of `--set`, read as YAML."""
    parameters = {}
    for name, text in given:
        try:
            parameters[name] = yaml_files.parse(text)
        except yaml_files.YamlError as error:
            raise InputError(f"--set {name}={text}: {error.problem}") from None
    return parameters


def _choose_duration(
    options: argparse.Namespace, motion: Motion | None
) -> float | None:
    """Return how long to simulate [s]; None is until Ctrl-C."""
    if options.duration is not None:
        return float(options.duration)
    if motion is not None:
        if motion.repeats and not options.headless:
            return None
        return motion.duration + _AFTER_MOTION
    return _HEADLESS_DURATION if options.headless else None


def _run(
    simulation: Simulation,
    duration: float | None,
    motion: Motion | None,
    options: argparse.Namespace,
    meshcat: Meshcat | None,
    say: Speaker,
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
            duration = _ENDLESS
        simulation.run(duration, motion, rate, say.progress)
    except KeyboardInterrupt:  # What was simulated is kept.
        say.line(f"stopped at {simulation.time:.2f} s")
    return time.perf_counter() - start


def _write(
    rollout: Rollout,
    options: argparse.Namespace,
    meshcat: Meshcat | None,
    say: Speaker,
    robot: Robot,
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
        # A house around the robot would be all that is seen of it.
        path = f"drake/visual/{robot.name}"
        save_screenshot(meshcat, options.screenshot, paths=[path])
        say.line(f"screenshot: {options.screenshot}")


def _hold(meshcat: Meshcat, say: Speaker) -> None:
    """Keep the page until Ctrl-C."""
    say.page(f"the page stays at {meshcat.web_url()} until Ctrl-C")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return
