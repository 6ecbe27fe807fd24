"""Arguments of the commands, for argparse."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm_drake.errors import InputError, suggest
from arm_drake.output_files import IMAGE_FORMATS, PLOT_KINDS


def pair(separator: str) -> Any:
    """Return what parses NAME<separator>VALUE."""

    def parse(text: str) -> tuple[str, str]:
        name, found, value = text.partition(separator)
        if not found or not name:
            raise argparse.ArgumentTypeError(
                f"expected NAME{separator}VALUE, got {text!r}"
            )
        return name, value

    return parse


def positive(text: str) -> float:
    """Return a number above 0."""
    number = not_negative(text)
    if number == 0.0:
        raise argparse.ArgumentTypeError("expected a positive number, got 0")
    return number


def not_negative(text: str) -> float:
    """Return a number of at least 0."""
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0.0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return number


# Where a page is, and who opens it.
OF_PAGES = ("host", "port", "open")


def is_given(options: argparse.Namespace, option: str) -> bool:
    """Return whether an option is on the command line; it may be 0 there."""
    value = getattr(options, option.replace("-", "_"))
    return not (value is None or value is False or value == [])


def check_pageless(
    options: argparse.Namespace, option: str, words: Sequence[str] = OF_PAGES
) -> None:
    """Raise InputError for words about a page, where an option leaves none."""
    for word in words:
        if is_given(options, word):
            text = f"--{word} is for the page, and with {option} there is none"
            raise InputError(text)


def read_initial(words: Sequence[tuple[str, str]]) -> dict[str, float]:
    """Return the positions of `--initial JOINT=VALUE` [rad or m]."""
    initial = {}
    for name, text in words:
        try:
            initial[name] = float(text)
        except ValueError:
            problem = f"--initial {name}={text}: expected a number [rad or m]"
            raise InputError(problem) from None
    return initial


def read_frames(
    words: Sequence[tuple[str, str]],
) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Return the frames of `--add-frame NAME=LINK,X,Y,Z[,R,P,Y]` [m, rad]."""
    frames = {}
    for name, text in words:
        link, *rest = text.split(",")
        try:
            numbers = tuple(float(number) for number in rest)
        except ValueError:
            numbers = ()
        if len(numbers) not in (3, 6):
            problem = f"--add-frame {name}={text}: expected a link and where it is in "
            raise InputError(f"{problem}it [m, rad]: link6,0,0,0.1 or with angles")
        frames[name] = (link, (*numbers, 0.0, 0.0, 0.0)[:6])
    return frames


def words_of(known: Sequence[str]) -> Any:
    """Return what parses words of a list, with commas between them."""

    def parse(text: str) -> tuple[str, ...]:
        words = tuple(word for word in text.replace(" ", "").split(",") if word)
        for word in words:
            if word not in known:
                raise argparse.ArgumentTypeError(
                    f"unknown {word!r}; {suggest(word, known)}"
                )
        return words

    return parse


# An option that may come several times, and one whose words are added up.
_SEVERAL: Any = {"action": "append", "default": []}
_EXTEND: Any = {"action": "extend", "default": []}

# What a page can show of a robot.
SHOWN = ("visual", "frames", "names", "collision", "inertia", "joint_axes")


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `view`."""
    add_robot_arguments(parser)
    parser.add_argument(
        "--position",
        metavar="V",
        nargs="+",
        **_EXTEND,
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
        **_EXTEND,
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
    add("--host", help="address of the page (localhost)")
    add("--port", type=int, help="port of the page, 0 for any (first free from 7000)")
    add(
        "--open",
        action=argparse.BooleanOptionalAction,
        help="open the page in a browser (on a terminal, where there is a screen)",
    )


def add_plot_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a plot of a rollout."""
    add = parser.add_argument
    add(
        "--plot",
        metavar="FILE.png",
        type=Path,
        help="draw what was measured, one picture of all joints (.png, .svg or .pdf)",
    )
    add(
        "--plot-kind",
        metavar="KIND",
        choices=PLOT_KINDS,
        help=f"what --plot draws instead: {', '.join(PLOT_KINDS[1:])}",
    )


def add_sim_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `sim`."""
    add_robot_arguments(parser)
    _add_scene_arguments(parser)
    _add_solver_arguments(parser)
    _add_output_arguments(parser)
    _add_shown_arguments(parser)
    text = "draw the commanded positions, too"
    parser.add_argument("--ghost", action="store_true", help=text)
    add_ros_arguments(parser)


def add_ros_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what lets other programs talk to a simulation."""
    add = parser.add_argument
    add(
        "--ros",
        metavar="NAME[:PORT],...",
        nargs="?",
        const="",
        help="let programs that speak ROS 2 in: rosbridge, foxglove, zenoh (by default "
        "rosbridge, and foxglove if it is installed); until Ctrl-C, at real time",
    )
    add("--ros-host", metavar="HOST", help="where to listen (127.0.0.1)")
    add("--ros-domain", metavar="N", type=int, help="ROS_DOMAIN_ID, for zenoh (0)")
    add(
        "--ros-origin",
        metavar="URL",
        **_SEVERAL,
        help="web pages that may connect, besides those of this machine; repeatable",
    )
    text = "after a reset the clock begins at 0 again; else it goes on"
    add("--ros-reset-clock", action="store_true", help=text)
    text = "do again what other programs sent in the run that this log is of"
    add("--inputs", metavar="FILE", type=Path, help=text)


def add_launch_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `launch`."""
    add = parser.add_argument
    add("robot", metavar="[PACKAGE] FILE", help="a launch file, by its package or path")
    add(
        "xacro_args", metavar="NAME:=VALUE", nargs="*", default=[], help="its arguments"
    )
    add("--show-args", action="store_true", help="say which arguments it has")
    add("--print", action="store_true", help="say what it would start")
    add_loading_arguments(parser)
    text = "take warnings of the report as errors"
    add("--strict", action="store_true", help=text)
    add_json(parser)
    text = "; where nothing is simulated"
    add("--position", metavar="V", nargs="+", **_EXTEND, help=f"as for view{text}")
    add("--named-pose", metavar="NAME", help=f"as for view{text}")
    add("--no-watch", action="store_true", help=f"as for view{text}")
    add(
        "--ghost",
        metavar="V",
        nargs="*",
        help=f"draw the commanded positions, too; as for view{text}",
    )
    _add_scene_arguments(parser)
    _add_solver_arguments(parser)
    _add_output_arguments(parser)
    _add_shown_arguments(parser)
    add_ros_arguments(parser)


def _add_shown_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what a page or a recording shows of a simulation."""
    add = parser.add_argument
    add("--paused", action="store_true", help="wait for the page's play button")
    add("--trail", metavar="LINK", help="draw the way of a link's origin")
    add("--contacts", action="store_true", help="draw contact forces")
    add(
        "--curve",
        metavar="TOPIC/FIELD",
        **_SEVERAL,
        help="plot a number on the page, as joint_states/position[joint1]",
    )
    text = "let the page's keyboard drive: arrows a base, digits joints"
    add("--keyboard", action="store_true", help=text)
    add(
        "--display",
        metavar="TOPIC",
        **_SEVERAL,
        help="draw what a topic says: odometry, scan, points, wrench (no forces in "
        "--record)",
    )
    add_page_arguments(parser)


def _add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what happens, where it does, and how it starts."""
    add = parser.add_argument
    add("--motion", metavar="NAME|FILE", help="what to send (arm-drake list)")
    add(
        "--set",
        metavar="NAME=VALUE",
        **_SEVERAL,
        type=pair("="),
        help="value of a motion's parameter, as in YAML; repeatable",
    )
    add("--duration", metavar="S", type=positive, help="how long to simulate [s]")
    add(
        "--world",
        metavar="NAME|FILE",
        help="built-in world (empty), or a .world or .sdf file",
    )
    add(
        "--gravity",
        choices=("on", "off"),
        help="gravity of 9.81 m/s^2 (that of the world)",
    )
    add(
        "--active",
        metavar="NAME",
        **_SEVERAL,
        help="controller to start before the others; repeatable",
    )
    add(
        "--inactive",
        metavar="NAME",
        **_SEVERAL,
        help="controller not to start; repeatable",
    )
    add(
        "--pose",
        metavar=("X", "Y", "Z", "R", "P", "Y"),
        nargs=6,
        type=float,
        help="pose of the base [m, rad]",
    )
    add(
        "--payload",
        metavar="LINK=KG[,X,Y,Z]",
        **_SEVERAL,
        type=pair("="),
        help="mass on a link, and where it is in the link's frame [m]; repeatable",
    )
    add(
        "--initial",
        metavar="JOINT=VALUE",
        **_SEVERAL,
        type=pair("="),
        help="initial position [rad or m]; repeatable",
    )


def _add_solver_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how time passes, and the physics' step."""
    add = parser.add_argument
    add("--headless", action="store_true", help="no browser")
    add(
        "--wait",
        action=argparse.BooleanOptionalAction,
        help="start a motion when a browser shows the page (on a terminal)",
    )
    add(
        "--hold",
        action=argparse.BooleanOptionalAction,
        help="keep the page, with all that was, until Ctrl-C (on a terminal)",
    )
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
        help="accurate (the default), fast: arms that touch nothing, in large steps; "
        "or kinematic: joints are where their commands say, without physics",
    )
    add(
        "--time-step",
        metavar="S",
        type=positive,
        help="largest step [s] (0.001; fast: 0.01)",
    )


def _add_output_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the files that are written."""
    add = parser.add_argument
    add("--log", metavar="FILE", type=Path, help="write the rollout: .npz, .csv, .mcap")
    add("--log-contacts", action="store_true", help="contact forces in the log, too")
    add(
        "--log-images",
        metavar="SENSOR",
        **_SEVERAL,
        help="what a camera or lidar publishes in the log, too (repeatable)",
    )
    add(
        "--image-format",
        choices=IMAGE_FORMATS,
        help="of colours in the log (raw)",
    )
    add("--record", metavar="FILE.html", type=Path, help="write an animated page")
    add("--loop", action="store_true", help="the page of --record plays for ever")
    add_plot_arguments(parser)
    add("--screenshot", metavar="FILE.png", type=Path, help="take a picture at the end")
    add(
        "--image",
        metavar="CAMERA=FILE.png",
        **_SEVERAL,
        help="what a camera of the robot sees at the end (repeatable)",
    )
    add("--video", metavar="FILE.mp4", type=Path, help="film the simulation")


_LOG = "a log: .npz, .csv or .mcap"


def add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
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
    add_json(parser)


def add_replay_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `replay`."""
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
        **_SEVERAL,
        help="folder to search for the packages of its meshes; repeatable",
    )
    add("--rate", metavar="R", type=positive, help="speed of the page (1)")
    add("--record", metavar="FILE.html", type=Path, help="write an animated page")
    add("--loop", action="store_true", help="the page of --record plays for ever")
    add_plot_arguments(parser)
    add("--screenshot", metavar="FILE.png", type=Path, help="take a picture of the end")
    add("--video", metavar="FILE.mp4", type=Path, help="film it")
    add_server_arguments(parser)
    # What a robot is loaded with besides, and files that this command doesn't write.
    parser.set_defaults(
        controllers=None,
        var=[],
        distro="jazzy",
        namespace=None,
        decompose=False,
        log=None,
        json=False,
        add_frame=[],
        srdf=None,
    )


XACRO = ":="


def add_graph_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `graph`."""
    add_robot_arguments(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        required=True,
        help="picture to write: .svg, .png, .pdf, or .dot for Graphviz",
    )


def add_ik_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ik`."""
    add_robot_arguments(parser)
    add = parser.add_argument
    _add_group(parser)
    add(
        "--pose",
        dest="target",
        metavar="X,Y,Z[,R,P,Y]",
        required=True,
        help="where it should be in the world [m, rad]; without R, P, Y it may turn as "
        "it likes; --pose=-0.1,0,0.3 where the first is negative",
    )
    add(
        "--seed",
        metavar="JOINT=VALUE",
        **_SEVERAL,
        type=pair("="),
        help="position to start from [rad or m]; repeatable",
    )
    add(
        "--pointing",
        metavar="AXIS",
        choices=("x", "y", "z"),
        help="the link may turn about this axis of its own",
    )
    add("--all", action="store_true", help="the other solutions, too")


def add_plan_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    add_robot_arguments(parser)
    _add_group(parser)
    add = parser.add_argument
    add(
        "--to",
        metavar="GOAL",
        action="append",
        required=True,
        help="a state of the group, JOINT=VALUE,... or X,Y,Z[,R,P,Y] of the link [m, "
        "rad] (--to=-0.1,0,0.3 where the first is negative); repeatable: way points",
    )
    text, metavar = "position at the start", "JOINT=VALUE"
    add("--start", metavar=metavar, **_SEVERAL, type=pair("="), help=text)
    add("--straight", action="store_true", help="on a straight line of the link")
    add(
        "--upright",
        metavar="LINK=ANGLE",
        type=pair("="),
        help="how far a link may tilt from where it is at the start [rad]",
    )
    add("--world", metavar="NAME|FILE", default="empty", help="as for sim (empty)")
    scaling = "up to 1 (that of joint_limits.yaml, else 1)"
    add("--velocity-scaling", metavar="S", type=positive, help=scaling)
    add("--acceleration-scaling", metavar="S", type=positive, help="the same")
    add(
        "--padding",
        metavar="M",
        type=not_negative,
        default=0.005,
        help="distance to keep [m] (0.005)",
    )
    add(
        "--time-limit",
        metavar="S",
        type=positive,
        help="how long to look for a way [s] (a number of iterations)",
    )
    add("--seed", metavar="N", type=int, default=0, help="of the random search (0)")
    add("-o", "--output", metavar="FILE.yaml", type=Path, help="motion to write")
    add("--plot", metavar="FILE.png", type=Path, help="picture of it to write")
    add("--record", metavar="FILE.html", type=Path, help="page to write that plays it")


def add_analyze_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `analyze`."""
    add_robot_arguments(parser)
    add = parser.add_argument
    add(
        "--at",
        metavar="STATE",
        help="where it is: a state of the SRDF as home, or JOINT=VALUE,... [rad, m]",
    )
    add(
        "--no-friction",
        action="store_true",
        help="without dry friction, in which joints at rest stick",
    )
    for name, what in (("state", "states are read"), ("command", "commands act")):
        text = f"so many cycles of the controller manager later {what} (0)"
        add(f"--{name}-delay", metavar="N", type=int, default=0, help=text)
    add("--preset", metavar="NAME", help="as for sim (accurate)")
    add("--time-step", metavar="S", type=positive, help="largest step [s] (0.001)")
    add("--plot", metavar="FILE.png", type=Path, help="draw Bode plots")


def add_tune_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tune`."""
    add_robot_arguments(parser)
    add = parser.add_argument
    add("--controller", metavar="NAME", help="whose PIDs (all of the robot)")
    add("--joint", metavar="NAME", **_EXTEND, nargs=1, help="a joint, repeatable (all)")
    add("--settle", metavar="S", type=positive, default=0.3, help="in which time (0.3)")
    add(
        "--overshoot",
        metavar="PART",
        type=positive,
        default=0.02,
        help="how far beyond a step's end, of the step (0.02)",
    )
    add(
        "--payload",
        metavar="LINK=LEAST,LARGEST",
        type=pair("="),
        **_SEVERAL,
        help="masses that it is to bear [kg]; LINK may be payload, for the last one",
    )
    add("--moves", metavar="N", type=count, default=4, help="moves of each trial (4)")
    add("--seed", metavar="N", type=int, default=0, help="of the poses (0)")
    add("--time-step", metavar="S", type=positive, help="largest step [s] (0.001)")
    add(
        "-o", "--output", metavar="FILE", type=Path, help="write YAML, or plugins' tags"
    )
    add("--plot", metavar="FILE.png", type=Path, help="draw a move before and after")


def add_many_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `many`."""
    add = parser.add_argument
    add("study", metavar="STUDY.yaml", type=Path, help="what is varied and measured")
    add("-o", "--output", metavar="DIR", type=Path, help="folder (<study>_results)")
    add("--workers", metavar="N", type=count, help="how many runs at a time (cores)")
    add("--cluster", metavar="ADDRESS", help="scheduler of dask, as tcp://head:8786")
    add("--run", metavar="N", type=int, help="only show this run of the study")
    add("--plot", metavar="FILE.png", type=Path, help="with --run: draw it")
    add("--log", metavar="FILE", type=Path, help="with --run: .npz, .csv or .mcap")
    add_json(parser)


def count(text: str) -> int:
    """Return an integer of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected an integer above 0, got {text!r}")
    return int(text)


def _add_group(parser: argparse.ArgumentParser) -> None:
    """Add which joints move, and which link is meant."""
    add = parser.add_argument
    add("--group", metavar="NAME", help="planning group (the one of most joints)")
    add("--frame", metavar="LINK", help="the link to be placed (the group's last)")


def add_cache_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `cache`."""
    parser.add_argument("--clear", action="store_true", help="remove them")
    add_json(parser)


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which robot to load, and how."""
    add = parser.add_argument
    add(
        "robot",
        metavar="ROBOT",
        help="a bundled robot, a .urdf, .xacro or .sdf file, a folder; for sim and "
        "view a scene, too: a .yaml file",
    )
    add(
        "xacro_args",
        metavar="NAME:=VALUE",
        nargs="*",
        default=[],
        type=pair(XACRO),
        help="xacro arguments",
    )
    add_loading_arguments(parser)
    text = "take warnings of the report as errors"
    add("--strict", action="store_true", help=text)
    add_json(parser)


def add_loading_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what a robot is loaded with, besides its description."""
    add = parser.add_argument
    add(
        "--controllers",
        metavar="YAML",
        action="append",
        help="controllers YAML; repeatable",
    )
    text = "folder to search for packages; repeatable"
    add("--package-path", metavar="DIR", **_SEVERAL, help=text)
    text = "value of $(var NAME) in the YAML; repeatable"
    add("--var", metavar="NAME=VALUE", **_SEVERAL, type=pair("="), help=text)
    text = "collide with several convex parts of a mesh, not with its convex hull"
    add("--decompose", action="store_true", help=text)
    text = "frame fixed to a link [m, rad], such as the point of a tool; repeatable"
    metavar = "NAME=LINK,X,Y,Z[,R,P,Y]"
    add("--add-frame", metavar=metavar, **_SEVERAL, type=pair("="), help=text)
    text = "SRDF of MoveIt (those with the robot's name around it); repeatable"
    add("--srdf", metavar="FILE", action="append", help=text)
    add("--distro", default="jazzy", help="ROS distribution (jazzy)")
    add("--name", help="name of the robot")
    text = "name space of its controller manager, and so of its topics"
    add("--namespace", metavar="NAME", help=text)


def loading_words(options: argparse.Namespace) -> list[str]:
    """Return the words that load the same robot, as `add_robot_arguments` has them."""
    words = [options.robot, *(f"{n}{XACRO}{value}" for n, value in options.xacro_args)]
    for name in ("controllers", "package_path", "var", "add_frame", "srdf"):
        for value in getattr(options, name) or ():
            text = value if isinstance(value, str) else "=".join(value)
            words.append(f"--{name.replace('_', '-')}={text}")
    words += ["--decompose"] if options.decompose else []
    words += [] if options.distro == "jazzy" else [f"--distro={options.distro}"]
    for name in ("name", "namespace"):
        value = getattr(options, name)
        words += [] if value is None else [f"--{name}={value}"]
    return words


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option for machines."""
    parser.add_argument("--json", action="store_true", help="print one JSON object")
