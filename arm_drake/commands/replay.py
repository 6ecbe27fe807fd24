"""The command `arm-drake replay`: a recorded rollout in the browser, or as a file."""

import argparse
import math
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from arm_drake.commands.arguments import OF_PAGES, check_pageless
from arm_drake.commands.output import (
    Speaker,
    check_outputs,
    needs_recording,
    write_outputs,
)
from arm_drake.commands.page import (
    interrupting,
    open_browser,
    remote_hint,
    start_page,
)
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.plant.plant import use_native_logging
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.page import Scene
from arm_drake.visualization.page.replay import Replay, ReplayPage, load_recorded_robot
from arm_drake.visualization.recording import start_recording
from arm_drake.visualization.video import FRAME_RATE

# A recording is of so much at most [s]: it is one animation, all in memory.
_LONGEST = 3600.0


def run_replay(options: argparse.Namespace, load: Callable[[], Robot]) -> int:
    """Show a log as the command line says; return the exit code."""
    for word in ("record", "video", "screenshot", "plot"):
        if getattr(options, word):
            check_pageless(options, f"--{word}", (*OF_PAGES, "rate"))
    check_outputs(options)
    rollout = Rollout.load(options.file, options.name)
    robot = _find_robot(options, rollout, load)
    use_native_logging()
    say = Speaker(is_quiet=False)
    if needs_recording(options) or options.screenshot or options.plot:
        with Scene() as scene:
            replay = Replay(scene.meshcat, rollout, robot)
            if needs_recording(options):
                _record(scene, replay)
            replay.show(replay.end)
            replay.frame()
            write_outputs(rollout, options, scene.meshcat, say, robot)
        return 0
    with start_page(options) as page:
        shown = ReplayPage(
            page, Replay(page.meshcat, rollout, robot), rate=options.rate or 1.0
        )
        say.page(f"page: {page.url} until Ctrl-C")
        say.line(remote_hint(page))
        open_browser(options, page)
        with interrupting(shown.stop):
            shown.run()
    return 0


def _find_robot(
    options: argparse.Namespace, rollout: Rollout, load: Callable[[], Robot]
) -> Robot:
    """Return the robot of a log: the one that is named, or the one in the log."""
    if options.robot is None:
        if options.xacro_args:
            name, value = options.xacro_args[0]
            text = f"{name}:={value} is for a robot's description; give --robot, too"
            raise InputError(text)
        folders = [*options.package_path, *_around(options.file)]
        robot = load_recorded_robot(
            rollout, package_paths=folders, max_faces=options.max_faces
        )
    else:
        robot = load()
        if rollout.description and rollout.description != robot.portable_source:
            text = "the robot's description is another one than that in the log"
            print(f"warning: {text}", file=sys.stderr)
    errors = [e for e in robot.report.grouped() if e.severity == "error"]
    for entry in errors:
        text = str(entry)
        if options.robot is None:  # Its file was made for a moment.
            file = robot.description.file
            text = text.replace(str(file), "the log's robot")
            text = text.replace(f"{file.parent}{os.sep}", "")
        print(text, file=sys.stderr)
    if errors and options.robot is None:
        text = "--package-path FOLDER or --robot FILE says where they are"
        print(text, file=sys.stderr)
    return robot


def _around(file: Path) -> list[Path]:
    """Return where else packages are looked for: beside the log."""
    folder = file.absolute().parent
    # A walk through all of these would take long.
    is_large = folder in (Path.home(), Path(folder.anchor), Path(tempfile.gettempdir()))
    return [] if is_large else [folder]


def _record(scene: Scene, replay: Replay) -> None:
    """Record the replay from its start to its end."""
    duration = replay.end - replay.start
    if duration > _LONGEST:
        text = (
            f"a recording is of one hour at most, got a log of {duration:g} s; without "
            "--record and --video the page shows all of it"
        )
        raise InputError(text)
    start_recording(scene.meshcat, FRAME_RATE)
    count = math.floor(duration * FRAME_RATE + 1e-9)
    for picture in range(count + 1):
        replay.show(replay.start + picture / FRAME_RATE)
        if picture == 0:
            replay.frame()
    replay.show(replay.end)
