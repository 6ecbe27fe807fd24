"""The words of the command line `arm-drake`."""

import argparse
import importlib.metadata
from collections.abc import Sequence
from pathlib import Path

from arm_drake.argument_types import pair
from arm_drake.command_arguments import add_sim_arguments, add_view_arguments
from arm_drake.log_arguments import add_compare, add_replay

_XACRO = ":="

# Options of several values.
_SEVERAL = ("position", "ghost")


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what a command line says; `command` is the name of the command.

    Xacro arguments may stand anywhere after ROBOT. Ends the process with exit code 2
    for words that can't be used.

    Args:
        arguments: Words of the command line; by default those of the process.
    """
    parser = make_parser()
    # Argparse takes positional words from one place only and leaves the others.
    options, words = parser.parse_known_args(arguments)
    if hasattr(options, "xacro_args"):
        # An option of several values takes whatever follows.
        for several in (getattr(options, name, None) for name in _SEVERAL):
            if isinstance(several, list):
                words = [*(word for word in several if _XACRO in word), *words]
                several[:] = [word for word in several if _XACRO not in word]
        xacro = [w for w in words if _XACRO in w and not w.startswith("-")]
        words = [word for word in words if word not in xacro]
        try:
            parsed = [pair(_XACRO)(word) for word in xacro]
        except argparse.ArgumentTypeError as error:
            parser.error(str(error))
        options.xacro_args = [*options.xacro_args, *parsed]
    if words:
        parser.error(f"unrecognized arguments: {' '.join(words)}")
    return options


def make_parser() -> argparse.ArgumentParser:
    """Return what parses the command line, but for xacro arguments after options."""
    parser = argparse.ArgumentParser(
        prog="arm-drake",
        description="ROS 2 robot packages in Drake: the same files, no ROS.",
    )
    version = f"arm-drake {importlib.metadata.version('arm-drake')}"
    parser.add_argument("--version", action="version", version=version)
    commands = parser.add_subparsers(metavar="COMMAND", dest="command", required=True)

    listing = commands.add_parser("list", help="bundled robots, worlds and motions")
    _add_json(listing)

    check = commands.add_parser(
        "check",
        help="load a robot and print what was not taken as written",
        description="Exits with 0 if the robot can be used, 1 if something is lost "
        "(with --strict: if there is anything to report), 2 if it can't be loaded.",
    )
    _add_robot_arguments(check)

    view = commands.add_parser(
        "view",
        help="look at a robot, without physics",
        description="Shows the robot in the browser until Ctrl-C, with sliders for its "
        "joints, and again when its files change. With --screenshot it takes a "
        "picture of all of the robot instead, which needs Chromium and "
        "`pip install 'arm-drake[browser]'`.",
    )
    _add_robot_arguments(view)
    add_view_arguments(view)

    sim = commands.add_parser(
        "sim",
        help="simulate a robot with its controllers",
        description="Exits with 0 if it ran, 1 if a goal or a controller failed, or "
        "if a message or a switch was refused, 2 if something can't be used, found "
        "before the simulation starts.",
    )
    _add_robot_arguments(sim)
    add_sim_arguments(sim)

    graph = commands.add_parser(
        "graph",
        help="draw topics, controllers, interfaces and hardware",
        description="Draws which controllers read and command which interfaces. "
        "Every system and port of Drake's own diagram is in "
        "build_diagram(robot).GetGraphvizString().",
    )
    _add_robot_arguments(graph)
    graph.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        required=True,
        help="picture to write: .svg, .png, .pdf, or .dot for Graphviz",
    )

    add_replay(commands)
    _add_json(add_compare(commands))

    cache = commands.add_parser(
        "cache",
        help="where converted meshes are kept",
        description="Prints the folder of converted meshes, and how much is in it.",
    )
    cache.add_argument("--clear", action="store_true", help="remove them")
    _add_json(cache)
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
        default=[],
        type=pair(_XACRO),
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
        type=pair("="),
        help="value of $(var NAME) in the YAML; repeatable",
    )
    parser.add_argument(
        "--decompose",
        action="store_true",
        help="collide with several convex parts of a mesh, not with its convex hull",
    )
    parser.add_argument("--distro", default="jazzy", help="ROS distribution (jazzy)")
    parser.add_argument("--name", help="name of the robot")
    parser.add_argument(
        "--strict",
        action="store_true",
        help="take every line of the report as an error",
    )
    _add_json(parser)


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")
