"""What the words of `arm-drake sim` mean: options, motion, duration."""

import argparse
from collections.abc import Sequence
from typing import Any

from arm_drake import yaml_files
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.options import SimulationOptions
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.robot_motions import default_duration, find_motion


def simulation_options(options: argparse.Namespace) -> SimulationOptions:
    """Return how to simulate.

    Args:
        options: Arguments of `arm-drake sim`.
    """
    return SimulationOptions(
        preset=options.preset,
        time_step=options.time_step,
        gravity=None if options.gravity is None else options.gravity == "on",
        active=tuple(options.active),
        inactive=tuple(options.inactive),
        log_contacts=options.log_contacts,
        # It is drawn when it is told to.
        frame_rate=0.0,
    )


def choose_motion(
    name: str | None, given: Sequence[tuple[str, str]], robot: Robot
) -> Motion | None:
    """Return the motion of a name or a file, with values of its parameters.

    Args:
        name: Its name or file; None is no motion.
        given: Names and values of parameters.
        robot: The robot.

    Raises:
        InputError: If there is no such motion, or its parameters are others.
    """
    if name is None:
        if given:
            raise InputError("--set is for a parameter of a motion; give --motion, too")
        return None
    return find_motion(name, robot, _read_parameters(given))


def _read_parameters(given: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return the values of `--set`, read as YAML."""
    parameters = {}
    for name, text in given:
        try:
            parameters[name] = yaml_files.parse(text)
        except yaml_files.YamlError as error:
            raise InputError(f"--set {name}={text}: {error.problem}") from None
    return parameters


def choose_duration(options: argparse.Namespace, motion: Motion | None) -> float | None:
    """Return how long to simulate [s]; None is until Ctrl-C.

    Args:
        options: Arguments of `arm-drake sim`.
        motion: What is played, if anything.
    """
    if options.duration is not None:
        return float(options.duration)
    has_end = motion is not None and not motion.repeats
    return default_duration(motion) if options.headless or has_end else None
