"""The command `arm-drake launch`: what a package's launch file starts, without ROS."""

import argparse
import dataclasses as dc
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm_drake.commands.arguments import is_given, read_frames, read_initial
from arm_drake.commands.output import say_report
from arm_drake.commands.sim import (
    choose_motion,
    read_payloads,
    simulate,
    simulation_options,
)
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.launch.launch_files import load_arguments, load_launch, show_arguments
from arm_drake.launch.plan import LaunchPlan
from arm_drake.launch.rviz import read_rviz
from arm_drake.scene import Scene

# Options without a meaning where a robot is only shown.
_OF_SIMULATIONS = (
    *("motion", "set", "duration", "world", "gravity", "active", "inactive", "pose"),
    *("payload", "initial", "rate", "preset", "time_step", "log", "log_contacts"),
    *(
        "log_images",
        "image_format",
        "record",
        "loop",
        "plot",
        "plot_kind",
        "video",
        "paused",
        "trail",
        "contacts",
    ),
    *("wait", "hold", "curve", "display", "keyboard", "image", "inputs"),
    *("ros", "ros_host", "ros_domain", "ros_origin", "ros_reset_clock"),
)


def run_launch(options: argparse.Namespace) -> int:
    """Do what a launch file says; return the exit code."""
    names = [options.robot]
    arguments: dict[str, str] = {}
    for word in options.xacro_args:
        if isinstance(word, str) and ":=" not in word:
            names.append(word)
        else:
            name, value = word.split(":=", 1) if isinstance(word, str) else word
            arguments[name] = value
    if len(names) > 2:
        text = f"expected PACKAGE FILE or FILE, got {' '.join(names)}"
        raise InputError(f"launch: {text}")
    folders = [Path(folder) for folder in options.package_path]
    if options.show_args:
        found = load_arguments(*names, arguments=arguments, package_paths=folders)
        as_json = json.dumps([vars(argument) for argument in found])
        print(as_json if options.json else show_arguments(found))
        return 0
    plan = load_launch(*names, arguments=arguments, package_paths=folders)
    if options.print:
        print(json.dumps(to_json(plan)) if options.json else plan)
        say_report(plan.report, strict=False)
        _check_strict(options, plan)
        return 0
    if not options.json:
        for line in dict.fromkeys(map(str, plan.not_started)):
            print(line, file=sys.stderr)
    _check_strict(options, plan)
    _use_rviz(options, plan)
    plan = _with_loading(options, plan)
    if plan.robots and not plan.is_simulated:
        return _view(options, plan)
    _check_simulated(options, plan)
    plan, initial = _with_place(options, plan)
    options.paused = options.paused or (plan.is_paused and not options.headless)
    scene = plan.load_scene(
        world=options.world,
        options=simulation_options(options),
        initial_positions=initial,
    )
    payloads = read_payloads(options.payload)
    scene = dc.replace(_with_motion(options, scene), payloads=payloads)
    return simulate(options, scene)


def _with_loading(options: argparse.Namespace, plan: LaunchPlan) -> LaunchPlan:
    """Return a plan whose robots are loaded as the command line says."""
    loading = {
        "name": options.name,
        "namespace": options.namespace,
        "controllers": options.controllers,
        "variables": dict(options.var),
        "frames": read_frames(options.add_frame),
        "srdf": options.srdf,
    }
    loading = {name: value for name, value in loading.items() if value}
    words = ("name", "namespace", "controllers", "add_frame", "srdf")
    _check_only_robot(options, plan, *words)
    loading["decompose"] = options.decompose
    loading["max_faces"] = options.max_faces
    loading["distro"] = options.distro
    robots = tuple(dc.replace(robot, loading=loading) for robot in plan.robots)
    return dc.replace(plan, robots=robots)


def _with_place(
    options: argparse.Namespace, plan: LaunchPlan
) -> tuple[LaunchPlan, dict[str, float]]:
    """Return a plan whose robot starts where the command line says, and its joints."""
    _check_only_robot(options, plan, "pose", "initial")
    if options.pose:
        robot = dc.replace(plan.robots[0], pose=tuple(options.pose))
        plan = dc.replace(plan, robots=(robot,))
    return plan, read_initial(options.initial)


def _check_only_robot(
    options: argparse.Namespace, plan: LaunchPlan, *words: str
) -> None:
    """Raise InputError for options of one robot where there isn't just one."""
    for word in words:
        if getattr(options, word) and len(plan.robots) != 1:
            text = f"--{word.replace('_', '-')} is for one robot; it starts "
            raise InputError(f"{text}{len(plan.robots)}", file=plan.file)


def _check_strict(options: argparse.Namespace, plan: LaunchPlan) -> None:
    """Raise InputError for problems and what isn't started, if they are to count."""
    lines = [*map(str, plan.report.problems), *map(str, plan.not_started)]
    if options.strict and lines:
        text = "\n".join(("not everything was taken as written:", *lines))
        raise InputError(text, file=plan.file)


def _with_motion(options: argparse.Namespace, scene: Scene) -> Scene:
    if options.motion is None and not options.set:
        return scene
    # One of several robots is a file's, which calls their controllers in full.
    motion = choose_motion(options.motion, options.set, scene.robots[0])
    name = scene.robots[0].name if len(scene.robots) == 1 else ""
    return dc.replace(scene, motions={} if motion is None else {name: motion})


def _use_rviz(options: argparse.Namespace, plan: LaunchPlan) -> None:
    """Show on the page what the launch file's RViz would show."""
    options.fixed_frame = options.fixed_frame or plan.fixed_frame
    options.is_frame_of_rviz = options.fixed_frame == plan.fixed_frame
    if not isinstance(plan.rviz, Path) or options.headless:
        return
    if not plan.rviz.is_file():
        print(f"warning: {plan.rviz}: no such file", file=sys.stderr)
        return
    view = read_rviz(plan.rviz)
    options.show = options.show or list(view.shown)
    links = {view.fixed_frame}
    options.fixed_frame = options.fixed_frame or view.fixed_frame
    options.is_frame_of_rviz = options.fixed_frame in links
    if view.eye is not None:
        options.camera = (view.eye, view.target)
    if view.missing:
        names = ", ".join(view.missing)
        print(f"info: {plan.rviz}: displays without a page: {names}", file=sys.stderr)


def _check_simulated(options: argparse.Namespace, plan: LaunchPlan) -> None:
    """Raise InputError for options of `view` where something is simulated."""
    for word in ("position", "named_pose", "no_watch"):
        if getattr(options, word):
            text = f"--{word.replace('_', '-')} is for what only shows a robot; this "
            text += "is simulated: --initial JOINT=VALUE says where a joint starts"
            raise InputError(text, file=plan.file)
    if options.ghost:
        text = f"--ghost {options.ghost[0]}: the ghost of what is simulated is what "
        raise InputError(f"{text}is commanded; expected --ghost alone", file=plan.file)
    options.ghost = options.ghost is not None


def _view(options: argparse.Namespace, plan: LaunchPlan) -> int:
    """Show robots that nothing controls, with sliders for their joints."""
    say_report(plan.report, strict=False)
    from arm_drake.commands.view import view, view_scene

    if options.headless:
        text = "it starts no controllers: there is nothing to simulate without a page"
        raise InputError(text, file=plan.file)
    _check_frame(options, plan)
    for word in _OF_SIMULATIONS:
        if is_given(options, word):  # A plain --ros is "".
            text = f"--{word.replace('_', '-')} is for a simulation; this launch file "
            raise InputError(f"{text}only shows its robot", file=plan.file)
    if options.ghost == []:
        text = "--ghost: expected a pose, as --position has it"
        raise InputError(text, file=plan.file)
    options.ghost = options.ghost or []
    if len(plan.robots) > 1:
        _check_only_robot(options, plan, "position", "named_pose")
        return view_scene(options, plan.load_scene())
    (launched,) = plan.robots
    defaults: Mapping[str, Any] = {
        "robot": launched.source,
        "xacro_args": list(launched.xacro_args.items()),
        "controllers": options.controllers or list(launched.controllers) or None,
        "package_path": list(plan.package_paths),
        "no_watch": options.no_watch or isinstance(launched.source, str),
    }
    vars(options).update(defaults)

    def load(positions: Mapping[str, float]) -> Robot:
        return plan.load_robot(launched, launched.chosen_name, positions)

    return view(options, load)


def _check_frame(options: argparse.Namespace, plan: LaunchPlan) -> None:
    """Leave out a fixed frame of RViz that several robots can't have."""
    if getattr(options, "is_frame_of_rviz", False) and len(plan.robots) > 1:
        options.fixed_frame = None


def to_json(plan: LaunchPlan) -> dict[str, Any]:
    """Return a plan as plain data."""
    return {
        "file": str(plan.file),
        "arguments": [vars(argument) for argument in plan.arguments],
        "robots": [
            {
                "name": robot.name,
                "namespace": robot.namespace,
                "description": str(robot.source),
                "xacro_args": dict(robot.xacro_args),
                "controllers_yaml": [str(path) for path in robot.controllers],
                "controllers": dict(robot.spawned),
                "pose": None if robot.pose is None else list(robot.pose),
                "simulator": robot.simulator,
                "srdf": None if robot.srdf is None else str(robot.srdf),
            }
            for robot in plan.robots
        ],
        "world": None if plan.world is None else str(plan.world),
        "simulator": plan.simulator,
        "models": [str(model.file) for model in plan.models],
        "paused": plan.is_paused,
        "rviz": None if plan.rviz is None else str(plan.rviz),
        "bridges": [*map(str, plan.bridges), *plan.named_bridge_files],
        "static_frames": [list(frame) for frame in plan.static_frames],
        "not_started": [each.name for each in plan.not_started],
        "report": plan.report.to_json(),
    }
