"""The command `arm-drake view`: a robot in a pose, without physics, as in RViz."""

import argparse
import dataclasses as dc
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.commands.arguments import check_pageless
from arm_drake.commands.output import report_of, say_report
from arm_drake.commands.page import (
    interrupting,
    open_browser,
    place_camera,
    remote_hint,
    start_page,
)
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.description.source_files import files_of_failed
from arm_drake.description.srdf import find_group_states
from arm_drake.description.urdf import RobotDescription
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError, suggest
from arm_drake.options import SimulationOptions
from arm_drake.output_files import check_suffix, check_writable
from arm_drake.plant.plant import use_native_logging
from arm_drake.scene import Scene
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page import Page
from arm_drake.visualization.page import Scene as Scene3D
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.live_views import LiveViews
from arm_drake.visualization.page.panel import find_pose
from arm_drake.visualization.page.robot_viewer import RobotViewer
from arm_drake.visualization.screenshot import SCREENSHOT_SUFFIXES, save_screenshot

LoadRobot = Callable[[Mapping[str, float]], Robot]


def view(options: argparse.Namespace, load: LoadRobot) -> int:
    """Show a robot as the command line says; return the exit code."""
    if options.screenshot is not None:
        check_pageless(options, "--screenshot")
        if "names" in options.show:
            print("warning: names of frames are on the page only", file=sys.stderr)
        check_suffix(options.screenshot, "a screenshot", SCREENSHOT_SUFFIXES)
        check_writable(options.screenshot)
    robot = load({})
    positions = _find_positions(options, robot)
    if positions:
        robot = load(positions)
    ghost = read_positions(options.ghost, robot.description, "--ghost")
    say_report(robot.report, strict=options.strict)
    use_native_logging()
    # What was loaded is shown; only when files change it is loaded again.
    loaded = [robot]
    scene = Scene3D() if options.screenshot is not None else start_page(options)
    with scene:
        viewer = RobotViewer(
            scene,
            # The viewer knows where joints are.
            lambda: loaded.pop() if loaded else load({}),
            shown=options.show or ("visual",),
            fixed_frame=options.fixed_frame or WORLD,
            is_watching=not (options.no_watch or options.screenshot),
            find_files=lambda error: files_of_failed(
                options.robot,
                error,
                controllers=options.controllers,
                xacro_args=dict(options.xacro_args),
                package_paths=options.package_path,
            ),
            tell=lambda text: print(text, file=sys.stderr, flush=True),
        )
        place_camera(options, scene)
        if ghost:
            viewer.show_ghost(ghost)
        if options.screenshot is not None:
            save_screenshot(scene.meshcat, options.screenshot, paths=["drake"])
        _say(options, viewer, scene)
        if isinstance(scene, Page):
            open_browser(options, scene)
            with interrupting(viewer.stop):
                viewer.run()
            if not options.json:
                print(f"\n{viewer.pose_yaml()}", end="")
    return 0


def view_scene(options: argparse.Namespace, scene: Scene) -> int:
    """Show a scene without physics; sliders are its controllers'."""
    if options.ghost:
        text = "--ghost is for one robot; a scene has several"
        raise InputError(text, file=options.robot)
    if options.screenshot is not None:
        check_pageless(options, "--screenshot")
        check_suffix(options.screenshot, "a screenshot", SCREENSHOT_SUFFIXES)
        check_writable(options.screenshot)
    use_native_logging()
    kinematic = SimulationOptions(preset="kinematic", frame_rate=0.0)
    still = dc.replace(scene, payloads={})
    page = Scene3D() if options.screenshot is not None else start_page(options)
    with page:
        diagram = build_diagram(still, options=kinematic, meshcat=page.meshcat)
        simulation = Simulation(diagram)
        report = report_of(simulation)
        say_report(report, strict=options.strict)
        summary = {"robot": ", ".join(simulation.robots), "report": report.to_json()}
        shown = options.show or ("visual",)
        if not isinstance(page, Page):
            views = LiveViews(page, simulation, shown, is_recorded=False)
            views.set_fixed_frame(options.fixed_frame or WORLD)
            with page.drawing():
                views.draw()
            # A house around the robots would be all that is seen of them.
            paths = [
                f"drake/{kind}/{name}" for kind in shown for name in simulation.robots
            ]
            drawn = [path for path in paths if page.meshcat.HasPath(f"/{path}")]
            paths = drawn or ["drake"]
            save_screenshot(page.meshcat, options.screenshot, paths=paths)
            place = {"screenshot": str(options.screenshot)}
            text = f"screenshot: {options.screenshot}"
            print(json.dumps(summary | place) if options.json else text)
            return 0
        live = LiveSimulation(page, simulation, shown=shown, scene=scene)
        live.views.set_fixed_frame(options.fixed_frame or WORLD)
        place_camera(options, page)
        text = f"page: {page.url} until Ctrl-C"
        whole = summary | {"page": page.url}
        print(json.dumps(whole) if options.json else text, flush=True)
        open_browser(options, page)
        with interrupting(live.stop):
            live.run()
    return 0


def read_positions(
    words: Sequence[str], description: RobotDescription, option: str = "--position"
) -> dict[str, float]:
    """Return positions [rad] or [m] by joint, as a command line gives them.

    Words are JOINT=VALUE, or a value for each movable joint that follows no other, in
    the order of the description; none for no position at all.
    """
    if not words:
        return {}
    followed = {
        joint.name: joint.mimic.joint if joint.mimic else None
        for joint in description.movable_joints
    }
    own = [name for name, other in followed.items() if other is None]
    if all("=" not in word for word in words):
        if len(words) != len(own):
            raise InputError(
                f"{option}: expected JOINT=VALUE, or {len(own)} values, of "
                f"{', '.join(own)}; got {len(words)} values"
            )
        words = [f"{name}={word}" for name, word in zip(own, words, strict=True)]
    positions = {}
    for word in words:
        name, found, value = word.partition("=")
        if not found:
            raise InputError(
                f"{option} {word}: expected JOINT=VALUE, as for the other joints"
            )
        if name not in followed:
            raise InputError(
                f"{option} {word}: no joint {name!r}; {suggest(name, own)}"
            )
        if followed[name] is not None:
            raise InputError(
                f"{option} {word}: {name!r} follows {followed[name]!r}; give that one"
            )
        if name in positions:
            raise InputError(f"{option} {word}: {name!r} has a value already")
        try:
            positions[name] = float(value)
        except ValueError:
            raise InputError(f"{option} {word}: expected a number [rad or m]") from None
    return positions


def _find_positions(options: argparse.Namespace, robot: Robot) -> dict[str, float]:
    """Return the positions set on the command line."""
    positions: dict[str, float] = {}
    if options.named_pose is not None:
        state = find_pose(find_group_states(robot), options.named_pose)
        positions.update(state.positions)
    return positions | read_positions(options.position, robot.description)


def _say(options: argparse.Namespace, viewer: RobotViewer, scene: Scene3D) -> None:
    """Print the address of the page or the file of the picture."""
    robot = viewer.robot
    if options.json:
        place = {"screenshot": str(options.screenshot)}
        if isinstance(scene, Page):
            place = {"page": scene.url}
        summary: dict[str, Any] = {
            "robot": robot.name,
            "positions": viewer.positions,
            **place,
            "report": robot.report.to_json(),
        }
        print(json.dumps(summary), flush=True)
    elif not isinstance(scene, Page):
        print(f"screenshot: {options.screenshot}")
    else:
        print(f"page: {scene.url} until Ctrl-C", flush=True)
        if hint := remote_hint(scene):
            print(hint, flush=True)
