"""The commands `arm-drake ik` and `arm-drake plan`."""

import argparse
import gc
import json
import math
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from arm_drake import interfaces
from arm_drake.commands.arguments import loading_words
from arm_drake.description.elements import parse_comma_separated, parse_float
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.output_files import (
    check_plot_path,
    check_suffix,
    check_writable,
    writing,
)
from arm_drake.planning.groups import (
    WHOLE_POSE,
    find_group,
    find_position_controller,
    find_receiver,
)
from arm_drake.planning.inverse_kinematics import solve_ik
from arm_drake.planning.motion_planning import Plan, Target, plan
from arm_drake.planning.orientation_constraint import OrientationConstraint


def run_ik(options: argparse.Namespace, robot: Robot) -> int:
    """Print joint positions that put a link at a pose; return the exit code."""
    pose, mask = read_pose(options.target)
    if options.pointing is not None:
        if mask != WHOLE_POSE:
            raise InputError("--pointing: expected --pose X,Y,Z,R,P,Y")
        free = 3 + "xyz".index(options.pointing)
        mask = tuple(row != free for row in range(6))
    # A link that is named may be one that other joints move, too.
    group = options.group
    frame = options.frame or find_group(robot, group).tip
    solution = solve_ik(
        robot,
        frame,
        pose,
        seed=read_positions("--seed", options.seed),
        group=group,
        mask=None if mask == WHOLE_POSE else mask,
        all_solutions=options.all,
    )
    solutions = [solution.positions, *solution.others]
    if options.json:
        content = {
            "robot": robot.name,
            "frame": frame,
            "positions": dict(solution.positions),
            "others": [dict(other) for other in solution.others],
            "tries": solution.tries,
            "position_error": solution.position_error,
            "orientation_error": solution.orientation_error,
        }
        print(json.dumps(content))
        return 0
    for number, positions in enumerate(solutions, start=1):
        if options.all:
            print(f"solution {number}:")
        width = max(map(len, positions))
        for name, position in positions.items():
            type_ = robot.description.joint(name).type
            unit = interfaces.unit(interfaces.POSITION, type_)
            print(f"{name:<{width}}  {position: .6f} {unit}")
    return 0


def run_plan(options: argparse.Namespace, load: Callable[[], Robot]) -> int:
    """Plan a motion and write it as a motion file; return the exit code."""
    _check_files(options)
    targets, masks = zip(*map(read_target, options.to), strict=True)
    counting = {mask for mask in masks if mask is not None}
    if len(counting) > 1:
        raise InputError("--to: poses are all X,Y,Z, or all X,Y,Z,R,P,Y")
    start = read_positions("--start", options.start)
    robot = load()
    if options.output is not None:  # Before what takes long.
        find_receiver(robot, find_group(robot, options.group))
    # Once: of 1.6 s the process's end spares 0.2 s, a search for garbage in all this.
    # What OMPL makes needs that search, see `cli._end_soon`.
    if "ompl" not in sys.modules and not gc.get_freeze_count():
        gc.freeze()
    found = plan(
        robot,
        list(targets),
        group=options.group,
        frame=options.frame,
        world=options.world,
        start=start,
        straight=options.straight,
        mask=next(iter(counting - {WHOLE_POSE}), None),
        path_constraint=read_upright(options.upright),
        velocity_scaling=options.velocity_scaling,
        acceleration_scaling=options.acceleration_scaling,
        padding=options.padding,
        time_limit=options.time_limit,
        seed=options.seed,
    )
    if options.output is not None:
        write_motion(options.output, found, robot)
    if options.plot is not None:
        found.plot(options.plot)
    if options.record is not None:
        found.animate().save(options.record)
    content = {
        "robot": robot.name,
        "group": found.group.name,
        "controller": found.controller,
        "end": found.end,
        "duration": found.duration,
        "clearance": found.clearance,
        "planning_time": found.planning_time,
        "corners": len(found.path),
        "warnings": list(found.warnings),
        "motion": None if options.output is None else str(options.output),
    }
    if options.json:
        print(json.dumps(content))
        return 0
    for warning in found.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(found.describe())
    if options.output is not None:
        print(f"play it: {_play(options, start)}")
    return 0


def _play(options: argparse.Namespace, start: Mapping[str, float]) -> str:
    """Return the command that plays a plan from where it begins."""
    words = [*loading_words(options), "--motion", str(options.output)]
    words += [] if options.world == "empty" else ["--world", options.world]
    for joint, value in start.items():
        words += ["--initial", f"{joint}={value!r}"]
    return f"arm-drake sim {shlex.join(words)}"


def _check_files(options: argparse.Namespace) -> None:
    """Raise OutputError if a requested output can't be written."""
    if options.output is not None:
        check_suffix(options.output, "a motion", (".yaml", ".yml"))
    if options.plot is not None:
        check_plot_path(options.plot)
    if options.record is not None:
        check_suffix(options.record, "a recording", (".html",))
    for path in (options.output, options.plot, options.record):
        if path is not None:
            check_writable(path)


def write_motion(path: Path, found: Plan, robot: Robot) -> None:
    """Write a plan as a motion file for the controller of its group.

    It is a goal of a trajectory controller; one that takes positions gets them one
    after the other.
    """
    if found.controller is None:
        steps = _list_commands(found, robot)
    else:
        steps = [{"at": 0.0, "controller": found.controller, "goal": _goal_of(found)}]
    text = yaml.safe_dump(steps, sort_keys=False, default_flow_style=None, width=1000)
    with writing(path):
        path.write_text(f"# Planned by arm-drake plan.\n{text}", encoding="utf-8")


def _list_commands(found: Plan, robot: Robot) -> list[dict[str, Any]]:
    """Return the steps of a controller that takes positions, in its own order."""
    forward = find_position_controller(robot, found.group)
    assert forward is not None
    name, joints = forward
    at = [found.trajectory.joint_names.index(joint) for joint in joints]
    return [
        {
            "at": point.time_from_start.to_seconds(),
            "controller": name,
            "commands": [float(point.positions[i]) for i in at],
        }
        for point in found.trajectory.points
    ]


def _goal_of(found: Plan) -> dict[str, Any]:
    """Return the goal of a trajectory controller."""
    points = [
        {
            "positions": list(point.positions),
            "velocities": list(point.velocities),
            "accelerations": list(point.accelerations),
            "time_from_start": point.time_from_start.to_seconds(),
        }
        for point in found.trajectory.points
    ]
    return {"joint_names": list(found.trajectory.joint_names), "points": points}


def read_target(text: str) -> tuple[Target, tuple[bool, ...] | None]:
    """Return a goal in words, and what of it counts; None if it is no pose."""
    if "=" in text:
        pairs = [word.partition("=") for word in text.split(",")]
        words = [(joint.strip(), value) for joint, _, value in pairs]
        return read_positions("--to", words), None
    if "," in text:
        return read_pose(text, "--to")
    return text, None


def read_pose(
    text: str, option: str = "--pose"
) -> tuple[Sequence[float], tuple[bool, ...]]:
    """Return a pose in words, and what of it counts: its position, or all of it."""
    values = parse_comma_separated(text)
    if len(values) not in (3, 6) or not all(map(math.isfinite, values)):
        raise InputError(
            f"{option} {text}: expected finite numbers X,Y,Z [m] or X,Y,Z,R,P,Y [m, "
            "rad] with commas"
        )
    if len(values) == 3:
        return [*values, 0.0, 0.0, 0.0], (*WHOLE_POSE[:3], False, False, False)
    return values, WHOLE_POSE


def read_upright(words: tuple[str, str] | None) -> OrientationConstraint | None:
    """Return the constraint of LINK=ANGLE, or raise InputError."""
    if words is None:
        return None
    link, text = words
    angle = parse_float(text)
    if angle is None:
        raise InputError(f"--upright {link}={text}: expected an angle [rad]")
    try:
        return OrientationConstraint(link, angle)
    except InputError as error:
        raise InputError(f"--upright {link}={text}: {error}") from None


def read_positions(option: str, words: Sequence[tuple[str, str]]) -> dict[str, float]:
    """Return positions of JOINT=VALUE."""
    positions = {}
    for joint, text in words:
        value = parse_float(text)
        if value is None:
            raise InputError(f"{option} {joint}={text}: expected a number [rad or m]")
        if joint in positions:
            raise InputError(f"{option} {joint}={text}: joint {joint!r} is named twice")
        positions[joint] = value
    return positions
