"""The command `arm-drake view`: RViz's place. A robot in a pose, without physics."""

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder

from arm_drake.description.robot import Robot
from arm_drake.description.urdf import RobotDescription
from arm_drake.drake_log import use_native_logging
from arm_drake.errors import InputError, suggest
from arm_drake.options import SimulationOptions
from arm_drake.output_files import check_suffix, check_writable
from arm_drake.placement import place_free_links
from arm_drake.plant import (
    add_plant,
    add_robot_model,
    set_initial_positions,
)
from arm_drake.visualization.meshcat import add_visualizer, frame_shapes, start_meshcat
from arm_drake.visualization.screenshot import SCREENSHOT_SUFFIXES, save_screenshot

# Nothing moves, but only discrete plants know joints that follow others.
_TIME_STEP = 0.001

LoadRobot = Callable[[Mapping[str, float]], Robot]


def view(options: argparse.Namespace, load: LoadRobot) -> int:
    """Show a robot as the command line says; return the exit code.

    Args:
        options: Arguments of `arm-drake view`.
        load: Loads the robot with initial positions by joint [rad] or [m].
    """
    if options.screenshot is not None:
        check_suffix(options.screenshot, "a screenshot", SCREENSHOT_SUFFIXES)
        check_writable(options.screenshot)
    robot = load({})
    if options.position:
        robot = load(read_positions(options.position, robot.description))
    if options.strict and len(robot.report):
        raise InputError(f"not everything was taken as written:\n{robot.report}")
    for entry in robot.report.grouped():
        if entry.severity != "info":
            print(entry, file=sys.stderr)
    use_native_logging()
    meshcat = start_meshcat()
    show_robot(meshcat, robot)
    if options.screenshot is not None:
        save_screenshot(meshcat, options.screenshot)
        if options.json:
            print(json.dumps(_summary(robot, screenshot=str(options.screenshot))))
        else:
            print(f"screenshot: {options.screenshot}")
        return 0
    with contextlib.suppress(KeyboardInterrupt):
        if options.json:
            print(json.dumps(_summary(robot, page=meshcat.web_url())), flush=True)
        else:
            print(f"page: {meshcat.web_url()}, until Ctrl-C", flush=True)
        while True:
            time.sleep(1.0)
    return 0


def show_robot(meshcat: Meshcat, robot: Robot) -> None:
    """Draw a robot in its initial positions, and point the camera at it.

    Args:
        meshcat: Where to draw it.
        robot: The robot.
    """
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, _TIME_STEP, SimulationOptions())
    model = add_robot_model(
        plant,
        robot.description,
        robot.name,
        robot.pose,
        has_free_base=robot.has_free_base,
    )
    set_initial_positions(plant, model, dict(robot.initial_positions))
    plant.Finalize()
    place_free_links(plant, scene_graph, model, robot)
    add_visualizer(builder, scene_graph, meshcat)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.ForcedPublish(context)
    query = scene_graph.get_query_output_port().Eval(
        scene_graph.GetMyContextFromRoot(context)
    )
    frame_shapes(meshcat, query)


def read_positions(
    words: Sequence[str], description: RobotDescription
) -> dict[str, float]:
    """Return initial positions [rad] or [m] by joint, as a command line gives them.

    Args:
        words: JOINT=VALUE, or a value for each movable joint that follows no other, in
            the order of the description.
        description: The robot.

    Raises:
        InputError: If they are something else.
    """
    followed = {
        joint.name: joint.mimic.joint if joint.mimic else None
        for joint in description.movable_joints
    }
    own = [name for name, other in followed.items() if other is None]
    if all("=" not in word for word in words):
        if len(words) != len(own):
            raise InputError(
                f"--position: expected JOINT=VALUE, or {len(own)} values, of "
                f"{', '.join(own)}; got {len(words)} values"
            )
        words = [f"{name}={word}" for name, word in zip(own, words, strict=True)]
    positions = {}
    for word in words:
        name, found, value = word.partition("=")
        if not found:
            raise InputError(
                f"--position {word}: expected JOINT=VALUE, as for the other joints"
            )
        if name not in followed:
            raise InputError(
                f"--position {word}: no joint {name!r}; {suggest(name, own)}"
            )
        if followed[name] is not None:
            raise InputError(
                f"--position {word}: {name!r} follows {followed[name]!r}; give that one"
            )
        if name in positions:
            raise InputError(f"--position {word}: {name!r} has a value already")
        try:
            positions[name] = float(value)
        except ValueError:
            raise InputError(
                f"--position {word}: expected a number [rad or m]"
            ) from None
    return positions


def _summary(robot: Robot, **place: str) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "positions": dict(robot.initial_positions),
        **place,
        "report": robot.report.to_json(),
    }
