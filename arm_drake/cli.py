"""The command `arm-drake`: arguments in, one call, text out."""

import argparse
import contextlib
import functools
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.arguments import make_parser
from arm_drake.errors import ArmDrakeError, InputError

_USAGE_ERROR = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: Words of the command line; by default those of the process.
    """
    options = make_parser().parse_args(arguments)
    try:
        return _COMMANDS[options.command](options)
    except ArmDrakeError as error:
        print(f"arm-drake: {error}", file=sys.stderr)
        return _USAGE_ERROR
    except BrokenPipeError:  # The reader of our output has gone: nothing to say.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("arm-drake: interrupted", file=sys.stderr)
        return 130


def load_robot_of(
    options: argparse.Namespace, positions: Mapping[str, float] | None = None
) -> Any:
    """Load the robot that a command line names.

    Args:
        options: What was parsed.
        positions: Initial positions by joint [rad] or [m], beside those in `options`.
    """
    from arm_drake.loading import load_robot

    initial = dict(positions or {})
    for name, text in getattr(options, "initial", ()):
        try:
            initial[name] = float(text)
        except ValueError:
            raise InputError(
                f"--initial {name}={text}: expected a number [rad or m]"
            ) from None
    return load_robot(
        options.robot,
        controllers=options.controllers,
        xacro_args=dict(options.xacro_args),
        package_paths=options.package_path,
        variables=dict(options.var),
        distro=options.distro,
        name=options.name,
        pose=getattr(options, "pose", None),
        initial_positions=initial,
    )


def _list(options: argparse.Namespace) -> int:
    from arm_drake.bundled import bundled_motions, bundled_robots
    from arm_drake.world import WORLDS

    robots = {name: list(bundled_motions(name)) for name in bundled_robots()}
    if options.json:
        print(json.dumps({"robots": robots, "worlds": sorted(WORLDS)}))
        return 0
    for name, motions in robots.items():
        print(f"{name}\n  motions: {', '.join(motions) or 'none'}")
    print(f"worlds: {', '.join(sorted(WORLDS))}")
    return 0


def _check(options: argparse.Namespace) -> int:
    from arm_drake.manager import load_controllers_of

    robot = load_robot_of(options)
    joints = [joint.name for joint in robot.description.movable_joints]
    controllers, report = load_controllers_of(robot)
    rows = [{"name": c.name, "type": c.type, "state": c.state} for c in controllers]
    if options.json:
        content = {
            "robot": robot.name,
            "joints": joints,
            "controllers": rows,
            "report": report.to_json(),
        }
        print(json.dumps(content))
    else:
        print(f"{robot.name}: {len(joints)} movable joints: {', '.join(joints)}")
        for row in rows:
            print(f"controller {row['name']} ({row['type']}): {row['state']}")
        print(report if len(report) else "nothing to report")
    is_bad = report.errors or (options.strict and len(report))
    return 1 if is_bad else 0


def _sim(options: argparse.Namespace) -> int:
    from arm_drake.sim_command import simulate

    return simulate(options, load_robot_of(options))


def _view(options: argparse.Namespace) -> int:
    from arm_drake.view_command import view

    return view(options, functools.partial(load_robot_of, options))


def _graph(options: argparse.Namespace) -> int:
    from arm_drake.graph_command import run_graph

    return run_graph(options, functools.partial(load_robot_of, options))


def _cache(options: argparse.Namespace) -> int:
    from arm_drake.description.meshes import cache_directory, clear_cache

    folder = cache_directory()
    if options.clear:
        content = {"folder": str(folder), "removed": clear_cache()}
        text = f"{folder}: {content['removed']} files removed"
    else:
        files = [path for path in folder.glob("*") if path.is_file()]
        size = sum(path.stat().st_size for path in files)
        content = {"folder": str(folder), "files": len(files), "bytes": size}
        text = f"{folder}: {len(files)} files, {size / 1e6:.1f} MB"
    print(json.dumps(content) if options.json else text)
    return 0


_COMMANDS: Mapping[str, Callable[[argparse.Namespace], int]] = {
    "list": _list,
    "check": _check,
    "view": _view,
    "sim": _sim,
    "graph": _graph,
    "cache": _cache,
}
