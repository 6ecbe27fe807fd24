"""The command line `arm-drake`: arguments, process, and the start of its commands."""

import argparse
import atexit
import contextlib
import errno
import functools
import gc
import io
import json
import os
import re
import signal
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

from arm_drake.commands.arguments import (
    XACRO,
    add_analyze_arguments,
    add_cache_arguments,
    add_compare_arguments,
    add_graph_arguments,
    add_ik_arguments,
    add_json,
    add_launch_arguments,
    add_many_arguments,
    add_plan_arguments,
    add_replay_arguments,
    add_robot_arguments,
    add_sim_arguments,
    add_tune_arguments,
    add_view_arguments,
    pair,
    read_frames,
    read_initial,
)
from arm_drake.errors import ArmDrakeError, InputError, find_close
from arm_drake.importing import without_collection
from arm_drake.output_files import unbroken

# Options of several values.
_SEVERAL = ("position", "ghost")


def parse_arguments(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what a command line says, or by default that of the process.

    `command` is the name of the command. Xacro arguments may stand anywhere after
    ROBOT. Ends the process with exit code 2 for words that can't be used.
    """
    parser = make_parser()
    # Argparse takes positional words from one place only and leaves the others.
    options, words = parser.parse_known_args(arguments)
    if hasattr(options, "xacro_args"):
        # An option of several values takes whatever follows.
        for several in (getattr(options, name, None) for name in _SEVERAL):
            if isinstance(several, list):
                words = [*(word for word in several if XACRO in word), *words]
                several[:] = [word for word in several if XACRO not in word]
        xacro = [w for w in words if XACRO in w and not w.startswith("-")]
        words = [word for word in words if word not in xacro]
        try:
            parsed = [pair(XACRO)(word) for word in xacro]
        except argparse.ArgumentTypeError as error:
            parser.error(str(error))
        options.xacro_args = [*options.xacro_args, *parsed]
    if words:
        _refuse(words, options)
    return options


class _Parser(argparse.ArgumentParser):
    """A parser that says in one line what can't be used, as all else is said."""

    def error(self, message: str) -> NoReturn:
        """End the process with a message."""
        text = f"arm-drake: {message}; `{self.prog} --help` tells more\n"
        self.exit(_USAGE_ERROR, text)


def _refuse(words: Sequence[str], options: argparse.Namespace) -> NoReturn:
    """End the process for words that a command doesn't take."""
    parser = _Parser(prog=f"arm-drake {options.command}")
    _COMMANDS[options.command].add_arguments(parser)
    word, hint = words[0], ""
    if word.startswith("-"):
        known = re.findall(r"--([a-z-]+)", parser.format_help())
        close = find_close(word.partition("=")[0].lstrip("-"), known, _ALIKE)
        hint = f"; did you mean '--{close}'?" if close else ""
    elif "=" in word and hasattr(options, "xacro_args"):
        hint = f"; did you mean {word.replace('=', XACRO, 1)!r}?"
    parser.error(f"unrecognized arguments: {' '.join(words)}{hint}")


class _Version(argparse.Action):
    """Prints the version, which takes modules that nothing else needs at its start."""

    def __call__(self, parser: argparse.ArgumentParser, *_args: Any) -> None:
        import importlib.metadata

        print(f"arm-drake {importlib.metadata.version('arm-drake')}")
        parser.exit()


def make_parser() -> argparse.ArgumentParser:
    """Return what parses the command line, but for xacro arguments after options."""
    parser = _Parser(
        prog="arm-drake",
        description="ROS 2 robot packages in Drake: the same files, no ROS.",
    )
    parser.add_argument(
        "--version",
        action=_Version,
        nargs=0,
        help="show program's version number and exit",
    )
    commands = parser.add_subparsers(metavar="COMMAND", dest="command", required=True)
    for name, command in _COMMANDS.items():
        description = command.description
        command.add_arguments(
            commands.add_parser(name, help=command.help, description=description)
        )
    return parser


_USAGE_ERROR = 2

# So much alike are an option and the one that was meant: "foo" and "loop" are not.
_ALIKE = 0.6


def _end_soon() -> None:
    """Exclude all objects from Python's garbage collection at exit.

    `arm-drake sim doosan_a0912 --headless --duration 0.1` takes 1.4 s of processor time
    in place of 1.6 s. OMPL takes what isn't found for leaks, and says so.
    """
    if "ompl" not in sys.modules:
        gc.freeze()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    By default its arguments are those of the process.
    """
    for stream in (sys.stdout, sys.stderr):
        # Units such as "N·m" must not end in an error where only ASCII is understood.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    options = parse_arguments(arguments)
    atexit.unregister(_end_soon)
    atexit.register(_end_soon)
    try:
        check_process()
        with terminating(), _expanding_ahead(options):
            return _run(options)
    except ArmDrakeError as error:
        print(f"arm-drake: {error}", file=sys.stderr)
        return _USAGE_ERROR
    except BrokenPipeError:  # The reader of our output has gone: nothing to say.
        drop_output()
        return 0
    except OSError as error:
        if (reason := shortage(error)) is None:
            raise
        drop_output()
        print(f"arm-drake: {reason}", file=sys.stderr)
        return _USAGE_ERROR
    except KeyboardInterrupt:
        print("arm-drake: interrupted", file=sys.stderr)
        return 130


def _run(options: argparse.Namespace) -> int:
    with unbroken():  # numpy would make an ImportError of Ctrl-C.
        import numpy as np

    # Numbers beyond all bounds are a user's: what comes of them is said by us.
    with np.errstate(all="ignore"):
        code = _COMMANDS[options.command].run(options)
        sys.stdout.flush()
        return code


def _expanding_ahead(
    options: argparse.Namespace,
) -> contextlib.AbstractContextManager[None]:
    """Let xacro begin while this process imports what a command needs."""
    source = getattr(options, "robot", None)
    if source is None or is_scene(source) or not hasattr(options, "controllers"):
        return contextlib.nullcontext()
    from arm_drake.description.entry import find_entry
    from arm_drake.description.xacro import expanding_ahead

    # What is wrong is told where the robot is loaded, and a folder is searched there.
    with contextlib.suppress(ArmDrakeError):
        if not os.path.isdir(source):
            return expanding_ahead(find_entry(source)[0], dict(options.xacro_args))
    return contextlib.nullcontext()


def load_robot_of(
    options: argparse.Namespace,
    positions: Mapping[str, float] | None = None,
    *,
    strict: bool = False,
) -> Any:
    """Load the robot of a command line, with initial positions besides [rad, m]."""
    if is_scene(options.robot):
        text = f"{options.command} takes a robot; a scene is for sim and view"
        raise InputError(text, file=options.robot)
    with unbroken(), without_collection():  # Drake would make an ImportError of Ctrl-C.
        from arm_drake.loading import import_trial, load_robot

        import_trial()
    initial = {**(positions or {}), **read_initial(getattr(options, "initial", ()))}
    return load_robot(
        options.robot,
        controllers=options.controllers,
        xacro_args=dict(options.xacro_args),
        package_paths=options.package_path,
        variables=dict(options.var),
        distro=options.distro,
        name=options.name,
        pose=getattr(options, "pose", None),
        namespace=options.namespace,
        initial_positions=initial,
        strict=strict,
        decompose=options.decompose,
        max_faces=getattr(options, "max_faces", None),
        frames=read_frames(options.add_frame),
        srdf=options.srdf,
    )


def is_scene(name: str) -> bool:
    """Return whether what a command line names is a scene, not a robot."""
    return name.lower().endswith((".yaml", ".yml"))


def _list(options: argparse.Namespace) -> int:
    from arm_drake.description.entry import (
        EXAMPLE,
        bundled_motions,
        bundled_robots,
        example_robots,
    )
    from arm_drake.simulation.motion import Needs
    from arm_drake.simulation.motion_files import load_motion
    from arm_drake.worlds.world import WORLDS

    robots = {name: list(bundled_motions(name)) for name in bundled_robots()}
    commands = {
        robot: {
            motion: load_motion(file).needs.command(robot, motion)
            for motion, file in bundled_motions(robot).items()
        }
        for robot in robots
    }
    examples = [f"{EXAMPLE}{name}" for name in example_robots()]
    worlds = sorted(WORLDS)
    if options.json:
        listed = {"robots": robots, "commands": commands}
        print(json.dumps({**listed, "worlds": worlds, "examples": examples}))
        return 0
    for name, motions in robots.items():
        text = f"motions: {', '.join(motions) or 'none'}"
        print(name, textwrap.indent(textwrap.fill(text, width=84), "  "), sep="\n")
        for motion, command in commands[name].items():
            if command != Needs().command(name, motion):
                print(f"    {motion} needs more: {command}")
    print(f"worlds: {', '.join(worlds)}")
    names = ", ".join(examples or ["none (pip install 'arm-drake[robots]')"])
    print(textwrap.fill(f"examples: {names}", width=88, subsequent_indent="  "))
    return 0


def _check(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.check import check

    robot = load_robot_of(options)
    return check(robot, strict=options.strict, as_json=options.json)


def _sim(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.sim import load_scene_of, simulate

    if is_scene(options.robot):
        return simulate(options, load_scene_of(options))
    return simulate(options, load_robot_of(options))


def _view(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.view import view, view_scene

    if is_scene(options.robot):
        from arm_drake.commands.sim import read_scene_of

        return view_scene(options, read_scene_of(options))
    return view(options, functools.partial(load_robot_of, options))


def _launch(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.launch import run_launch

    return run_launch(options)


def _graph(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.graph import run_graph

    return run_graph(options, functools.partial(load_robot_of, options))


def _replay(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.replay import run_replay

    return run_replay(options, functools.partial(load_robot_of, options))


def _compare(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.compare import run_compare

    return run_compare(options)


def _ik(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.planning import run_ik

    return run_ik(options, load_robot_of(options, strict=options.strict))


def _plan(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.planning import run_plan

    load = functools.partial(load_robot_of, options, strict=options.strict)
    return run_plan(options, load)


def _analyze(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.analyze import run_analyze

    return run_analyze(options, load_robot_of(options, strict=options.strict))


def _tune(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.tune import run_tune

    return run_tune(options, load_robot_of(options, strict=options.strict))


def _many(options: argparse.Namespace) -> int:
    with unbroken(), without_collection():
        from arm_drake.commands.many import run_study

    return run_study(options)


def _cache(options: argparse.Namespace) -> int:
    from arm_drake.description.meshes.conversion import cache_directory, clear_cache

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


class _Command(NamedTuple):
    """A command: what `--help` says of it, its arguments, and what runs it."""

    help: str
    description: str | None
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


_COMMANDS: Mapping[str, _Command] = {
    "list": _Command("bundled robots, worlds and motions", None, add_json, _list),
    "check": _Command(
        "load a robot and print what was not taken as written",
        "Exits with 0 if the robot can be used, 1 if the report has an error: a "
        "controller, a sensor or a collision shape is lost (a mesh that isn't drawn "
        "is a warning; with --strict warnings count, too), 2 if it can't be loaded.",
        add_robot_arguments,
        _check,
    ),
    "view": _Command(
        "look at a robot, without physics",
        "Shows the robot in the browser until Ctrl-C, with sliders for its "
        "joints, and again when its files change. With --screenshot it takes a "
        "picture of all of the robot instead, which needs Chromium and "
        "`pip install 'arm-drake[browser]'`.",
        add_view_arguments,
        _view,
    ),
    "sim": _Command(
        "simulate a robot with its controllers",
        "Exits with 0 if it ran, 1 if a goal or a controller failed, or "
        "if a message or a switch was refused, 2 if something can't be used, found "
        "before the simulation starts.",
        add_sim_arguments,
        _sim,
    ),
    "launch": _Command(
        "do what a package's launch file says, as `ros2 launch` does",
        "Runs the launch file, which is a program if it is in Python, and simulates "
        "or shows the robots that it starts, with their controllers, their world and "
        "their poses. What is not run is told. Launch files are run only when you ask "
        "for it here; don't run those that you don't trust.",
        add_launch_arguments,
        _launch,
    ),
    "graph": _Command(
        "draw topics, controllers, interfaces and hardware",
        "Draws which controllers read and command which interfaces. "
        "Every system and port of Drake's own diagram is in "
        "build_diagram(robot).GetGraphvizString().",
        add_graph_arguments,
        _graph,
    ),
    "replay": _Command(
        "show a log in the browser",
        "Shows a recorded rollout until Ctrl-C: play, pause, speed, a "
        "slider for the time. With --record, --video, --screenshot or --plot it writes "
        "these files instead.",
        add_replay_arguments,
        _replay,
    ),
    "compare": _Command(
        "say where two logs differ",
        "Exits with 0 if the rollouts are equal within the tolerance, 1 if "
        "they differ, 2 if a file can't be used.",
        add_compare_arguments,
        _compare,
    ),
    "ik": _Command(
        "joint positions that put a link at a pose",
        "Exits with 0 if there is a solution within the joints' limits, else with 2.",
        add_ik_arguments,
        _ik,
    ),
    "plan": _Command(
        "a motion of an arm that collides with nothing",
        "Writes a motion that `sim --motion` plays, or says how long it would take. "
        "A way around something needs `pip install 'arm-drake[planning]'`.",
        add_plan_arguments,
        _plan,
    ),
    "analyze": _Command(
        "poles, bandwidths and margins of a robot with its controllers",
        "Linearizes the robot, its servo and its controllers where they rest, by "
        "differences of the simulation. Exits with 0 if the loop is stable, else with "
        "1.",
        add_analyze_arguments,
        _analyze,
    ),
    "tune": _Command(
        "gains of a robot's PIDs, for its inertia, limits and payloads",
        "Finds gains from the mass matrix, tries them in many poses, writes them as "
        "YAML or as plugins' tags, and says what they promise. Exits with 0 if that "
        "is what was asked for, else with 1.",
        add_tune_arguments,
        _tune,
    ),
    "many": _Command(
        "many runs of a robot: grids, random draws, measures",
        "Runs a study, here or on a cluster of dask, and writes results, a table and "
        "a picture; after a break the same command goes on. Exits with 0 if all runs "
        "could be run, else with 1.",
        add_many_arguments,
        _many,
    ),
    "cache": _Command(
        "where converted meshes are kept",
        "Prints the folder of converted meshes, and how much is in it.",
        add_cache_arguments,
        _cache,
    ),
}


# Files that may be open at once: a page with some browsers needs so many.
_FILES = 64

# What the machine has run out of.
_SHORTAGES = (errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.EIO)
_OF_FILES = (errno.EMFILE, errno.ENFILE)


def check_process() -> None:
    """Raise InputError if this process lacks what Drake can't do without."""
    try:
        os.getcwd()
    except OSError:
        text = "the working directory is not there any more; change to another"
        raise InputError(text) from None
    if sys.getfilesystemencoding() == "ascii":
        text = "Drake can't be used with ASCII; set PYTHONUTF8=1, or LC_ALL=C.UTF-8"
        raise InputError(text)
    if sys.platform != "win32":
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        if limit != resource.RLIM_INFINITY and limit < _FILES:
            text = f"no more than {limit} files may be open; expected {_FILES} at least"
            raise InputError(f"{text}: ulimit -n {_FILES}")


@contextlib.contextmanager
def terminating() -> Iterator[None]:
    """Take SIGTERM, which `timeout` and containers send, as Ctrl-C."""
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def interrupt(number: int, frame: Any) -> None:
        handler = signal.getsignal(signal.SIGINT)
        if callable(handler):
            handler(signal.SIGINT, frame)
        else:  # Shells have jobs in the background ignore Ctrl-C, but not this.
            raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def shortage(error: OSError) -> str | None:
    """Return what the machine has run out of, or None if it is something else."""
    if error.errno not in _SHORTAGES:
        return None
    place = error.filename
    if place is None and error.errno not in _OF_FILES:
        place = "standard output"
    return f"{place}: {error.strerror}" if place else str(error.strerror)


def drop_output() -> None:
    """Write nothing more to standard output, also not what is still on its way."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
