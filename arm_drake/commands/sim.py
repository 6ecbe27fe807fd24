"""The command `arm-drake sim`: a robot with its controllers, as Gazebo runs it."""

import argparse
import contextlib
import dataclasses as dc
import importlib.util
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from arm_drake import yaml_files
from arm_drake.commands.arguments import OF_PAGES, check_pageless, is_given
from arm_drake.commands.output import (
    Speaker,
    camera_images,
    check_outputs,
    check_outputs_of_several,
    find_saturation,
    history_of,
    needs_recording,
    plot_of,
    print_summary,
    report_of,
    say_report,
    start_log,
    summarize,
    warn_of_pictures,
    write_images,
    write_outputs,
)
from arm_drake.description.elements import parse_comma_separated
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.diagram import build_diagram
from arm_drake.errors import ArmDrakeWarning, InputError, SimulationError
from arm_drake.options import SimulationOptions
from arm_drake.output_files import PLOT_KINDS
from arm_drake.plant.payloads import Payload
from arm_drake.plant.plant import use_native_logging
from arm_drake.rollout.rollout import ClientInput, Rollout
from arm_drake.scene import Scene, load_scene
from arm_drake.simulation.motion import Motion, default_duration
from arm_drake.simulation.motion_files import find_motion
from arm_drake.simulation.playback import (
    check_motion,
    check_trajectories,
    list_beyond_limits,
)
from arm_drake.simulation.recording import (
    find_build_info,
    list_failures,
    list_unfinished,
)
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.drawing import run_drawing
from arm_drake.visualization.recording import start_recording
from arm_drake.visualization.video import FRAME_RATE
from arm_drake.worlds.world import load_world

if TYPE_CHECKING:
    from arm_drake.visualization.page import Scene as MeshcatScene
    from arm_drake.visualization.page.live_simulation import LiveSimulation
    from arm_drake.visualization.page.live_views import LiveViews
    from arm_drake.wire.server import RosServer

# Longer than anybody waits [s].
_ENDLESS = 1e8


def simulation_options(options: argparse.Namespace) -> SimulationOptions:
    """Return how to simulate."""
    return SimulationOptions(
        preset=options.preset or "accurate",
        time_step=options.time_step,
        gravity=None if options.gravity is None else options.gravity == "on",
        active=tuple(options.active),
        inactive=tuple(options.inactive),
        log_contacts=options.log_contacts,
        log_images=tuple(options.log_images),
        log_image_format=options.image_format or "raw",
        # It is drawn when it is told to.
        frame_rate=0.0,
    )


def choose_motion(
    name: str | None, parameters: Sequence[tuple[str, str]], robot: Robot
) -> Motion | None:
    """Return the motion of a name or a file, with texts of parameters as in YAML."""
    if name is None:
        if parameters:
            raise InputError("--set is for a parameter of a motion; give --motion, too")
        return None
    return find_motion(name, robot, _read_parameters(parameters))


def _read_parameters(assignments: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return the values of `--set`, read as YAML."""
    parameters = {}
    for name, text in assignments:
        try:
            parameters[name] = yaml_files.parse(text)
        except yaml_files.YamlError as error:
            raise InputError(f"--set {name}={text}: {error.problem}") from None
    return parameters


def read_payloads(words: Sequence[tuple[str, str]]) -> dict[str, Payload]:
    """Return the payloads of `--payload LINK=KG[,X,Y,Z]`."""
    payloads = {}
    for link, text in words:
        values = parse_comma_separated(text)
        if len(values) not in (1, 4):
            expected = (
                "expected a mass [kg], or a mass and where it is [m]: 2.0,0,0,0.1"
            )
            raise InputError(f"--payload {link}={text}: {expected}")
        try:
            payloads[link] = Payload(values[0], tuple(values[1:]) or (0.0, 0.0, 0.0))
        except InputError as error:
            raise InputError(f"--payload {link}={text}: {error.problem}") from None
    return payloads


def choose_duration(options: argparse.Namespace, motion: Motion | None) -> float | None:
    """Return how long to simulate [s]; None is until Ctrl-C."""
    if options.duration is not None:
        return float(options.duration)
    if options.ros is not None:
        return None
    has_end = motion is not None and not motion.repeats
    return default_duration(motion) if options.headless or has_end else None


# Words of the command line that a scene has its own of.
_OF_SCENES = (
    "xacro_args",
    "controllers",
    "package_path",
    "var",
    "name",
    "namespace",
    "decompose",
    "max_faces",
    "add_frame",
    "srdf",
    "pose",
    "initial",
    "payload",
    "world",
    "motion",
    "set",
    "position",
    "named_pose",
)


def scene_of(options: argparse.Namespace, robot: Robot) -> Scene:
    """Return the scene of a command line that names a robot."""
    motion = choose_motion(options.motion, options.set, robot)
    return Scene(
        robots=(robot,),
        world=options.world or "empty",
        options=simulation_options(options),
        payloads=read_payloads(options.payload),
        motions={} if motion is None else {robot.name: motion},
    )


def read_scene_of(options: argparse.Namespace) -> Scene:
    """Return the scene whose file a command line names; words for robots are wrong."""
    for name in _OF_SCENES:
        if getattr(options, name, None):
            word = "NAME:=VALUE" if name == "xacro_args" else f"--{name}"
            text = f"{word.replace('_', '-')} is for one robot; a scene has its own"
            raise InputError(text, file=options.robot)
    scene = load_scene(options.robot)
    if not scene.robots:
        text = "a scene without robots is for build_diagram; expected one at least"
        raise InputError(text, file=options.robot)
    return scene


def load_scene_of(options: argparse.Namespace) -> Scene:
    """Return the scene whose file a command line names, with its other options."""
    scene = read_scene_of(options)
    chosen, defaults = simulation_options(options), SimulationOptions()
    changes = {
        field.name: value
        for field in dc.fields(SimulationOptions)
        if (value := getattr(chosen, field.name)) != getattr(defaults, field.name)
    }
    if options.preset is not None:
        changes["preset"] = options.preset
    return dc.replace(scene, options=dc.replace(scene.options, **changes))


def simulate(options: argparse.Namespace, scene: Scene | Robot) -> int:
    """Simulate a scene as the command line says; return the exit code."""
    with warnings.catch_warnings():
        # What players warn of is said before anything moves.
        warnings.simplefilter("ignore", ArmDrakeWarning)
        return _simulate(options, scene)


def _simulate(options: argparse.Namespace, scene: Scene | Robot) -> int:
    if isinstance(scene, Robot):
        # What is wrong with the world is told first.
        load_world(options.world or "empty", scene.package_paths)
        use_native_logging()
        _check_words(options)
        scene = scene_of(options, scene)
    else:
        use_native_logging()
        _check_words(options)
    if len(scene.robots) > 1:
        check_outputs_of_several(options)
    say = Speaker(is_quiet=options.json)
    if not options.headless:
        return _simulate_live(options, scene, say)
    return _simulate_headless(options, scene, say)


def _check_words(options: argparse.Namespace) -> None:
    """Raise InputError for what doesn't go together, or can't be written."""
    if options.headless:
        words = (*OF_PAGES, "wait", "hold", "paused", "curve", "keyboard")
        check_pageless(options, "--headless", words)
    for word in ("ros-host", "ros-domain", "ros-origin", "ros-reset-clock"):
        if options.ros is None and is_given(options, word):
            raise InputError(f"--{word} is of what --ros lets in; give that, too")
    if options.log_images and (options.log is None or options.log.suffix == ".csv"):
        text = "--log-images says what else --log holds: give a .npz or .mcap file"
        raise InputError(text)
    if options.image_format is not None and not options.log_images:
        raise InputError("--image-format is of what --log-images logs; give that, too")
    check_outputs(options)
    if options.headless or needs_recording(options):
        warn_of_pictures(options)


class _Pictured(NamedTuple):
    """Scene, simulation and views of displays that draw without a page."""

    page: "MeshcatScene"
    simulation: Simulation
    views: "LiveViews"


def _simulate_headless(
    options: argparse.Namespace,
    scene: Scene,
    say: Speaker,
) -> int:
    """Simulate without a page; return the exit code."""
    motion = scene.motion
    rate, duration = options.rate or 0.0, options.duration
    if options.ros is not None or options.inputs is not None:
        chosen = choose_duration(options, motion)
        return _simulate_served(options, scene, chosen, say)
    if not (needs_recording(options) or options.screenshot):
        _check_nothing_shown(options)
        simulation = _prepare(options, scene, None, say)
        wall_time = _measure(
            lambda: simulation.run(duration, motion, rate, say.progress),
            simulation,
            say,
        )
        return _finish(options, simulation, wall_time, None, say)
    # Not at the top: a simulation without pictures needs no Meshcat.
    from arm_drake.visualization.page import Scene as MeshcatScene
    from arm_drake.visualization.page.displays import make_displays
    from arm_drake.visualization.page.live_views import LiveViews

    with MeshcatScene() as page:
        meshcat = page.meshcat
        simulation = _prepare(options, scene, meshcat, say)
        is_recorded = needs_recording(options)
        shown = options.show or ("visual",)
        views = LiveViews(page, simulation, shown, is_recorded=is_recorded)
        if is_recorded:
            start_recording(meshcat, FRAME_RATE)
        _show(options, views)
        displays = make_displays(_Pictured(page, simulation, views))
        for topic in options.display:
            displays.show(topic)

        def draw() -> None:
            views.draw()
            displays.draw()

        def run() -> None:
            with page.drawing():
                run_drawing(
                    simulation,
                    duration,
                    motion,
                    draw=draw,
                    frame_rate=FRAME_RATE,
                    realtime_rate=rate,
                    progress=say.progress,
                )
                views.end_recording()
                displays.end_recording()

        wall_time = _measure(run, simulation, say)
        alive = meshcat if page.is_alive else None
        return _finish(options, simulation, wall_time, alive, say)


def _simulate_served(
    options: argparse.Namespace, scene: Scene, duration: float | None, say: Speaker
) -> int:
    """Simulate without a page, for programs outside; return the exit code."""
    if needs_recording(options) or options.screenshot:
        text = "--record, --video and --screenshot are for runs without --ros"
        raise InputError(f"{text} or --inputs, or with a page")
    _check_nothing_shown(options)
    simulation = _prepare(options, scene, None, say)
    with _serve(options, simulation, say) as server:
        wall_time = _measure(
            lambda: _run_served(options, server, duration, scene.motion, say),
            simulation,
            say,
        )
    return _finish(options, simulation, wall_time, None, say)


def _serve(
    options: argparse.Namespace,
    simulation: Simulation,
    say: Speaker,
    live: "LiveSimulation | None" = None,
) -> "RosServer":
    """Return what lets others in, and say where."""
    # Not at the top: nothing of it is needed else.
    from arm_drake.wire.server import LOOPBACK, RosServer

    inputs, host = _read_inputs(options.inputs), options.ros_host or "127.0.0.1"
    server = RosServer(
        simulation,
        () if options.ros is None else options.ros or _default_transports(),
        host=host,
        domain=options.ros_domain or 0,
        origins=options.ros_origin,
        controls=live,
        keep_clock=not options.ros_reset_clock,
        # A page keeps its own history.
        history=None if live is not None else history_of(options),
        inputs=inputs,
    ).start()
    if options.ros is not None and host not in LOOPBACK:
        text = "whoever reaches this machine can move the robot"
        print(f"warning: --ros-host {host}: {text}", file=sys.stderr)
    for line in server.addresses:
        say.page(line)
    for name in server.graph.left_out:
        text = "no message of ROS can tell it; it is left out"
        print(f"warning: topic {name!r}: {text}", file=sys.stderr)
    return server


def _default_transports() -> str:
    """Return the transports of a plain `--ros`."""
    has_foxglove = importlib.util.find_spec("foxglove") is not None
    return "rosbridge,foxglove" if has_foxglove else "rosbridge"


def _read_inputs(path: Path | None) -> Iterable[ClientInput]:
    if path is None:
        return ()
    inputs = Rollout.load(path).inputs
    if not inputs:
        text = "no program outside sent anything in this run; expected a log of --ros"
        raise InputError(text, file=path)
    return inputs


def _length_of(rollout: Rollout, motion: Motion | None) -> float:
    """Return how long a run was [s], with what came in last."""
    ends = [float(rollout.time[-1]), *(each.time for each in rollout.inputs)]
    if motion is not None and not motion.tasks:
        ends.append(default_duration(motion))
    return max(ends)


def _run_served(
    options: argparse.Namespace,
    server: "RosServer",
    duration: float | None,
    motion: Motion | None,
    say: Speaker,
) -> None:
    """Simulate as the command line says, until Ctrl-C if it says no end."""
    from arm_drake.wire.server import run

    if options.ros is not None:
        rate = 1.0 if options.rate is None else options.rate
    else:
        rate = options.rate or 0.0
    if duration is None:
        say.line("simulating until Ctrl-C")
    elif options.ros is None and options.duration is None:
        # As long as the run was.
        duration = _length_of(Rollout.load(options.inputs), motion)
        duration += server.simulation.period
    run(
        server,
        _ENDLESS if duration is None else duration,
        motion=motion,
        realtime_rate=rate,
        progress=say.progress,
    )


def _check_nothing_shown(options: argparse.Namespace) -> None:
    """Raise InputError if something is to be shown where nothing is to be seen."""
    words = ("show", "ghost", "trail", "contacts", "display", "max_faces")
    # What a launch file says for RViz, nobody asks for here.
    is_of_rviz = getattr(options, "is_frame_of_rviz", False)
    for name in words if is_of_rviz else ("fixed_frame", *words):
        if getattr(options, name):
            word = f"--{name.replace('_', '-')}"
            raise InputError(
                f"{word} is for a page or a recording, and with --headless there is "
                "none; give --record, --video or --screenshot, too"
            )


def _show(options: argparse.Namespace, views: "LiveViews") -> None:
    """Show the requested views."""
    from arm_drake.commands.page import place_camera

    views.set_fixed_frame(options.fixed_frame or WORLD)
    place_camera(options, views.scene)
    views.set_trail(options.trail)
    if options.contacts and needs_recording(options):
        print("warning: contact forces are not in recordings", file=sys.stderr)
    for what in ("ghost", "contacts"):
        if getattr(options, what):
            views.show(what)


def _show_live(options: argparse.Namespace, live: "LiveSimulation") -> None:
    """Show the requested parts beside the robots, on a page."""
    from arm_drake.visualization.page.displays import Displays
    from arm_drake.visualization.page.keyboard import Keyboard
    from arm_drake.visualization.page.live_plots import LivePlots
    from arm_drake.visualization.page.parts import find_part

    for name in options.curve:
        find_part(live.parts, LivePlots).add(name)
    if options.keyboard:
        keyboards = [part for part in live.parts if isinstance(part, Keyboard)]
        if not keyboards:
            text = (
                "no controller here takes velocities of a base or positions of joints"
            )
            raise InputError(f"--keyboard: {text}")
        keyboards[0].handle("keys:on", True)
    for topic in options.display:
        find_part(live.parts, Displays).show(topic)


def _end_run(live: "LiveSimulation") -> None:
    """Report tasks that aren't done; leave out what would stand still in a film."""
    live.give_up()
    if live.page.is_alive:
        live.views.end_recording()
        for part in live.parts:
            part.end_recording()


def _measure(run: Callable[[], None], simulation: Simulation, say: Speaker) -> float:
    """Run a simulation up to its end or Ctrl-C; return the wall time it took [s]."""
    start = time.perf_counter()
    try:
        run()
    except KeyboardInterrupt:  # What was simulated is kept.
        say.line(f"stopped at {simulation.time:.2f} s")
        say.is_stopped = True
    except SimulationError as error:  # So it is.
        say.failures.append(str(error))
    return time.perf_counter() - start


def _simulate_live(options: argparse.Namespace, scene: Scene, say: Speaker) -> int:
    """Simulate on a page; return the exit code."""
    # Not at the top: a headless simulation must not wait for a web server.
    from arm_drake.commands.page import (
        interrupting,
        is_watched,
        open_browser,
        remote_hint,
        start_page,
    )
    from arm_drake.visualization.page.live_simulation import LiveSimulation

    with start_page(options) as page, contextlib.ExitStack() as stack:
        motion = scene.motion
        simulation = _prepare(options, scene, page.meshcat, say)
        live = LiveSimulation(
            page,
            simulation,
            motion=motion,
            realtime_rate=1.0 if options.rate is None else options.rate,
            is_paused=options.paused,
            shown=options.show or ("visual",),
            frame_rate=FRAME_RATE if needs_recording(options) else None,
            history=history_of(options),
            scene=scene,
            build=lambda scene: _build(scene, page.meshcat),
        )
        _show(options, live.views)
        _show_live(options, live)
        _let_in(options, say, live, stack)
        say.page(f"page: {page.url}")
        say.line(remote_hint(page))
        open_browser(options, page)
        duration = choose_duration(options, motion)
        is_show = motion is not None and is_watched()

        def run() -> None:
            if options.wait or (options.wait is None and is_show and live.is_playing):
                say.page("waiting for a browser to open the page (--no-wait starts)")
                live.wait_for_browser()
            if duration is None:
                say.line("simulating until Ctrl-C")
            live.ends = options.duration is None
            live.run(duration, say.progress)

        with interrupting(live.stop) as is_interrupted:
            _measure(run, simulation, say)
        _end_run(live)
        alive = page.meshcat if page.is_alive else None
        if is_over := is_interrupted() or live.is_ended:
            say.line(f"stopped at {simulation.time:.2f} s")
        code = _finish(options, simulation, live.wall_time, alive, say)
        is_over = is_over or bool(say.failures)
        if (is_show if options.hold is None else options.hold) and not is_over:
            say.page(f"the page stays at {page.url} until Ctrl-C, or its button 'end'")
            live.pause()
            with interrupting(live.stop):
                live.run()
        return code


def _let_in(
    options: argparse.Namespace,
    say: Speaker,
    live: "LiveSimulation",
    stack: contextlib.ExitStack,
) -> None:
    """Let programs outside in, if they may."""
    if options.ros is not None or options.inputs is not None:
        live.ros = stack.enter_context(_serve(options, live.simulation, say, live))


def _build(scene: Scene, meshcat: Meshcat | None) -> Diagram:
    """Return the diagram of a scene; it is drawn on request only."""
    drawn = dc.replace(scene.options, frame_rate=0.0)
    return build_diagram(scene, options=drawn, meshcat=meshcat)


def _prepare(
    options: argparse.Namespace, scene: Scene, meshcat: Meshcat | None, say: Speaker
) -> Simulation:
    """Return the simulation, and say what was not taken as written."""
    simulation, motion = Simulation(_build(scene, meshcat)), scene.motion
    say_report(report_of(simulation), strict=options.strict)
    if motion is not None:
        check_motion(simulation, motion)
        if options.ros is None and options.inputs is None:  # Nobody else changes rules.
            check_trajectories(simulation, motion)
        for line in list_beyond_limits(simulation, motion):
            print(f"warning: {line}", file=sys.stderr)
    for link, payload in scene.payloads.items():
        mass = payload if isinstance(payload, float | int) else payload.mass
        com = (0.0, 0.0, 0.0) if isinstance(payload, float | int) else payload.com
        place = "its origin" if not any(com) else f"{list(com)} m from its origin"
        say.line(f"payload: {mass:g} kg on {link}, at {place}")
    build = find_build_info(simulation.diagram)
    if build is not None and build.options.leaves_out:
        say.line(f"preset {build.options.preset}: {build.options.leaves_out}")
    for name, _ in camera_images(options):
        simulation.camera(name)
    say.controllers(simulation)
    say.watch(simulation)
    start_log(options, simulation)
    return simulation


def _finish(
    options: argparse.Namespace,
    simulation: Simulation,
    wall_time: float,
    meshcat: Meshcat | None,
    say: Speaker,
) -> int:
    """Write and say what came of it; return the exit code."""
    robots = simulation.robots
    rollouts = {name: simulation.rollout(name) for name in robots}
    saturation = find_saturation(simulation, rollouts)
    for name, rollout in rollouts.items():
        if options.plot is not None and len(robots) > 1:
            path = plot_of(options.plot, name)
            rollout.plot(path, options.plot_kind or PLOT_KINDS[0])
            say.line(f"plot: {path}")
    if len(robots) > 1:
        options = argparse.Namespace(**{**vars(options), "plot": None})
    rollout = next(iter(rollouts.values()))
    write_outputs(rollout, options, meshcat, say, *robots.values())
    write_images(simulation, options, say)
    failures = [*list_failures(simulation.mailbox), *say.failures]
    is_cut = options.duration is not None or options.inputs is not None
    if options.headless and not (is_cut or say.is_stopped):
        failures += list_unfinished(simulation.mailbox)
    if options.json:
        print(
            json.dumps(summarize(simulation, saturation, wall_time, failures)),
            flush=True,
        )
    else:
        print_summary(simulation, saturation, wall_time, say)
        say.controllers(simulation)
    for failure in failures:
        print(f"arm-drake: {failure}", file=sys.stderr)
    return 1 if failures else 0
