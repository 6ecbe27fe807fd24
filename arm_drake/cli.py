"""The command `arm-drake`: arguments in, one call, text out."""

import argparse
import contextlib
import importlib.metadata
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm_drake.errors import ArmDrakeError, InputError

_USAGE_ERROR = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: Words of the command line; by default those of the process.
    """
    options = _make_parser().parse_args(arguments)
    try:
        return int(options.run(options))
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


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="arm-drake",
        description="ROS 2 robot packages in Drake: the same files, no ROS.",
    )
    version = f"arm-drake {importlib.metadata.version('arm-drake')}"
    parser.add_argument("--version", action="version", version=version)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    listing = commands.add_parser("list", help="bundled robots, worlds and motions")
    listing.add_argument("--json", action="store_true", help="print one JSON object")
    listing.set_defaults(run=_list)

    check = commands.add_parser(
        "check",
        help="load a robot and print what was not taken as written",
        description="Exits with 0 if the robot can be used, 1 if something is lost "
        "(with --strict: if there is anything to report), 2 if it can't be loaded.",
    )
    _add_robot_arguments(check)
    check.set_defaults(run=_check)

    sim = commands.add_parser(
        "sim",
        help="simulate a robot with its controllers",
        description="Exits with 0 if it ran, 1 if a goal failed or a message was "
        "refused, 2 if something can't be used, found before the simulation starts.",
    )
    _add_robot_arguments(sim)
    _add_sim_arguments(sim)
    sim.set_defaults(run=_sim)
    return parser


def _add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        help="a bundled robot, a .urdf or .xacro file, a folder",
    )
    parser.add_argument(
        "xacro_args",
        metavar="NAME:=VALUE",
        nargs="*",
        type=_pair(":="),
        help="xacro arguments",
    )
    parser.add_argument(
        "--controllers",
        metavar="YAML",
        action="append",
        help="controllers YAML; repeatable",
    )
    parser.add_argument(
        "--package-path",
        metavar="DIR",
        action="append",
        default=[],
        help="folder to search for packages; repeatable",
    )
    parser.add_argument(
        "--var",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        type=_pair("="),
        help="value of $(var NAME) in the YAML; repeatable",
    )
    parser.add_argument("--distro", default="jazzy", help="ROS distribution (jazzy)")
    parser.add_argument("--name", help="name of the robot")
    parser.add_argument(
        "--strict",
        action="store_true",
        help="take every line of the report as an error",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _add_sim_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--motion", metavar="NAME|FILE", help="what to send to the controllers")
    add("--duration", metavar="S", type=_positive, help="how long to simulate [s]")
    add("--world", metavar="NAME", default="empty", help="built-in world (empty)")
    add(
        "--pose",
        metavar=("X", "Y", "Z", "R", "P", "Y"),
        nargs=6,
        type=float,
        help="pose of the base [m, rad]",
    )
    add("--gravity", choices=("on", "off"), default="on", help="gravity (on)")
    add(
        "--initial",
        metavar="JOINT=VALUE",
        action="append",
        default=[],
        type=_pair("="),
        help="initial position [rad or m]; repeatable",
    )
    add("--active", metavar="NAME", action="append", default=[], help="start first")
    add("--inactive", metavar="NAME", action="append", default=[], help="don't start")
    add("--headless", action="store_true", help="no browser")
    add("--hold", action="store_true", help="keep the page until Ctrl-C")
    add(
        "--rate",
        metavar="R",
        type=_not_negative,
        help="simulated seconds per second; 0 is as fast as it goes "
        "(1 with the browser, 0 headless)",
    )
    add("--time-step", metavar="S", type=_positive, help="largest step [s] (0.001)")
    add("--log", metavar="FILE", type=Path, help="write the rollout: .npz or .csv")
    add("--record", metavar="FILE.html", type=Path, help="write an animated page")
    add("--plot", metavar="FILE.png", type=Path, help="draw reference and measurement")
    add("--host", default="localhost", help="address of the page (localhost)")
    add("--port", type=int, help="port of the page (first free from 7000)")


def _pair(separator: str) -> Any:
    """Return what parses NAME<separator>VALUE."""

    def parse(text: str) -> tuple[str, str]:
        name, found, value = text.partition(separator)
        if not found or not name:
            raise argparse.ArgumentTypeError(
                f"expected NAME{separator}VALUE, got {text!r}"
            )
        return name, value

    return parse


def _positive(text: str) -> float:
    number = _not_negative(text)
    if number == 0.0:
        raise argparse.ArgumentTypeError("expected a positive number, got 0")
    return number


def _not_negative(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0.0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return number


def load_robot_of(options: argparse.Namespace) -> Any:
    """Load the robot that a command line names."""
    from arm_drake.loading import load_robot

    initial = {}
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
