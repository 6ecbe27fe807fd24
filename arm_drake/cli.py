"""The command `arm-drake`: arguments in, one call, text out."""

import argparse
import contextlib
import functools
import io
import json
import os
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.arguments import parse_arguments
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.importing import without_collection
from arm_drake.interrupts import unbroken

_USAGE_ERROR = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: Words of the command line; by default those of the process.
    """
    for stream in (sys.stdout, sys.stderr):
        # Units such as "N·m" must not end in an error where only ASCII is understood.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    options = parse_arguments(arguments)
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
    with unbroken(), without_collection():  # Drake would make an ImportError of Ctrl-C.
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
        decompose=options.decompose,
        max_faces=getattr(options, "max_faces", None),
    )


def _list(options: argparse.Namespace) -> int:
    from arm_drake.bundled import bundled_motions, bundled_robots
    from arm_drake.description.examples import EXAMPLE, example_robots
    from arm_drake.worlds.world import WORLDS

    robots = {name: list(bundled_motions(name)) for name in bundled_robots()}
    examples = [f"{EXAMPLE}{name}" for name in example_robots()]
    worlds = sorted(WORLDS)
    if options.json:
        print(json.dumps({"robots": robots, "worlds": worlds, "examples": examples}))
        return 0
    for name, motions in robots.items():
        print(f"{name}\n  motions: {', '.join(motions) or 'none'}")
    print(f"worlds: {', '.join(worlds)}")
    names = ", ".join(examples or ["none (pip install 'arm-drake[robots]')"])
    print(textwrap.fill(f"examples: {names}", width=88, subsequent_indent="  "))
    return 0


def _check(options: argparse.Namespace) -> int:
    from arm_drake.commands.check import check

    robot = load_robot_of(options)
    return check(robot, strict=options.strict, as_json=options.json)


def _sim(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.sim import simulate

    return simulate(options, load_robot_of(options))


def _view(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.view import view

    return view(options, functools.partial(load_robot_of, options))


def _graph(options: argparse.Namespace) -> int:
    from arm_drake.commands.graph import run_graph

    return run_graph(options, functools.partial(load_robot_of, options))


def _replay(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.replay import run_replay

    return run_replay(options, functools.partial(load_robot_of, options))


def _compare(options: argparse.Namespace) -> int:
    from arm_drake.commands.compare import run_compare

    return run_compare(options)


def _cache(options: argparse.Namespace) -> int:
    from arm_drake.description.meshes.cache import cache_directory, clear_cache

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
    "replay": _replay,
    "compare": _compare,
    "cache": _cache,
}
