"""The words of `arm-drake compare` and `arm-drake replay`."""

import argparse
from pathlib import Path
from typing import Any

from arm_drake.argument_types import not_negative, pair, positive
from arm_drake.command_arguments import add_plot_arguments, add_server_arguments

_LOG = "a log: .npz, .csv or .mcap"


def add_compare(commands: Any) -> argparse.ArgumentParser:
    """Add the command `compare`, and return its parser.

    Args:
        commands: Where commands are added.
    """
    parser: argparse.ArgumentParser = commands.add_parser(
        "compare",
        help="say where two logs differ",
        description="Exits with 0 if the rollouts are equal within the tolerance, 1 if "
        "they differ, 2 if a file can't be used.",
    )
    parser.add_argument("a", metavar="A", type=Path, help=_LOG)
    parser.add_argument("b", metavar="B", type=Path, help="another one")
    parser.add_argument(
        "--tolerance",
        metavar="T",
        type=not_negative,
        default=0.0,
        help="what counts as equal, in the unit of each quantity (0)",
    )
    parser.add_argument(
        "--plot", metavar="FILE.png", type=Path, help="draw what differs most"
    )
    parser.add_argument("--name", help="robot to compare, in logs of several")
    return parser


def add_replay(commands: Any) -> None:
    """Add the command `replay`.

    Args:
        commands: Where commands are added.
    """
    parser: argparse.ArgumentParser = commands.add_parser(
        "replay",
        help="show a log in the browser",
        description="Shows a recorded rollout until Ctrl-C: play, pause, speed, a "
        "slider for the time. With --record, --video, --screenshot or --plot it writes "
        "these files instead.",
    )
    add = parser.add_argument
    add("file", metavar="FILE", type=Path, help=_LOG)
    add(
        "xacro_args",
        metavar="NAME:=VALUE",
        nargs="*",
        default=[],
        type=pair(":="),
        help="xacro arguments of --robot",
    )
    add("--robot", help="the robot, as for sim (the description in the log)")
    add("--name", help="robot to show, in logs of several")
    add(
        "--package-path",
        metavar="DIR",
        action="append",
        default=[],
        help="folder to search for the packages of its meshes; repeatable",
    )
    add("--rate", metavar="R", type=positive, default=1.0, help="speed (1)")
    add("--record", metavar="FILE.html", type=Path, help="write an animated page")
    add_plot_arguments(parser)
    add("--screenshot", metavar="FILE.png", type=Path, help="take a picture of the end")
    add("--video", metavar="FILE.mp4", type=Path, help="film it")
    add_server_arguments(parser)
    # What a robot is loaded with besides, and files that this command doesn't write.
    parser.set_defaults(
        controllers=None, var=[], distro="jazzy", decompose=False, log=None, json=False
    )
