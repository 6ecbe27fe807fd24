"""The words of `arm-drake view` and `arm-drake sim`."""

import argparse
from pathlib import Path

from arm_drake.argument_types import not_negative, pair, positive, words_of
from arm_drake.visualization.plot import PLOT_KINDS

# What a page can show of a robot.
SHOWN = ("visual", "frames", "names", "collision", "inertia", "joint_axes")


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `view`."""
    parser.add_argument(
        "--position",
        metavar="V",
        nargs="+",
        action="extend",
        default=[],
        help="JOINT=VALUE, or a value for each movable joint that follows no other "
        "[rad or m]",
    )
    parser.add_argument(
        "--named-pose",
        metavar="NAME",
        help="a pose that the SRDF names, as NAME or 'GROUP: NAME'",
    )
    parser.add_argument(
        "--ghost",
        metavar="V",
        nargs="+",
        action="extend",
        default=[],
        help="pose of a transparent copy, as --position",
    )
    parser.add_argument(
        "--no-watch",
        action="store_true",
        help="do not reload the robot when its files change",
    )
    parser.add_argument(
        "--screenshot", metavar="FILE.png", type=Path, help="picture to write"
    )
    add_page_arguments(parser)


def add_page_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what a page in the browser shows, and where it is."""
    add = parser.add_argument
    add(
        "--show",
        metavar="WHAT",
        action="extend",
        default=[],
        type=words_of(SHOWN),
        help=f"what to draw, with commas between: {', '.join(SHOWN)} (visual)",
    )
    add_server_arguments(parser)
    add("--fixed-frame", metavar="LINK", help="link that stays where it is (the world)")


def add_server_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where a page is, and how much of meshes is sent to it."""
    add = parser.add_argument
    add(
        "--max-faces",
        metavar="N",
        type=int,
        help="draw meshes with at most so many triangles, for smaller recordings",
    )
    add("--host", default="localhost", help="address of the page (localhost)")
    add("--port", type=int, help="port of the page (first free from 7000)")


def add_plot_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a plot of a rollout."""
    add = parser.add_argument
    add("--plot", metavar="FILE.png", type=Path, help="draw reference and measurement")
    add(
        "--plot-kind",
        metavar="KIND",
        choices=PLOT_KINDS,
        help=f"what --plot draws instead: {', '.join(PLOT_KINDS[1:])}",
    )


def add_sim_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `sim`."""
    add = parser.add_argument
    add("--motion", metavar="NAME|FILE", help="what to send to the controllers")
    add(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        type=pair("="),
        help="value of a motion's parameter, as in YAML; repeatable",
    )
    add("--duration", metavar="S", type=positive, help="how long to simulate [s]")
    add(
        "--world",
        metavar="NAME|FILE",
        default="empty",
        help="built-in world (empty), or a .world or .sdf file",
    )
    add(
        "--pose",
        metavar=("X", "Y", "Z", "R", "P", "Y"),
        nargs=6,
        type=float,
        help="pose of the base [m, rad]",
    )
    add(
        "--gravity",
        choices=("on", "off"),
        help="gravity of 9.81 m/s^2 (that of the world)",
    )
    add(
        "--initial",
        metavar="JOINT=VALUE",
        action="append",
        default=[],
        type=pair("="),
        help="initial position [rad or m]; repeatable",
    )
    add(
        "--active",
        metavar="NAME",
        action="append",
        default=[],
        help="controller to start before the others; repeatable",
    )
    add(
        "--inactive",
        metavar="NAME",
        action="append",
        default=[],
        help="controller not to start; repeatable",
    )
    add("--headless", action="store_true", help="no browser")
    add("--hold", action="store_true", help="keep the page until Ctrl-C")
    add(
        "--rate",
        metavar="R",
        type=not_negative,
        help="simulated seconds per second; 0 is as fast as it goes "
        "(1 with the browser, 0 headless)",
    )
    add(
        "--preset",
        metavar="NAME",
        default="accurate",
        help="accurate (the default), fast: arms that touch nothing, in large steps; "
        "or kinematic: joints are where their commands say, without physics",
    )
    add(
        "--time-step",
        metavar="S",
        type=positive,
        help="largest step [s] (0.001; fast: 0.01)",
    )
    add("--log", metavar="FILE", type=Path, help="write the rollout: .npz, .csv, .mcap")
    add("--log-contacts", action="store_true", help="contact forces in the log, too")
    add("--record", metavar="FILE.html", type=Path, help="write an animated page")
    add_plot_arguments(parser)
    add("--screenshot", metavar="FILE.png", type=Path, help="take a picture at the end")
    add("--video", metavar="FILE.mp4", type=Path, help="film the simulation")
    add("--paused", action="store_true", help="wait for the page's play button")
    add("--ghost", action="store_true", help="draw the commanded positions, too")
    add("--trail", metavar="LINK", help="draw the way of a link's origin")
    add("--contacts", action="store_true", help="draw contact forces")
    add_page_arguments(parser)
