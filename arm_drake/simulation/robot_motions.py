"""The motions of a robot: bundled ones by name, others by file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm_drake.bundled import bundled_motions
from arm_drake.description.robot import Robot
from arm_drake.errors import MotionError, suggest
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.motion_files import load_motion

# How long to simulate without a motion, and what follows one [s].
_WITHOUT_MOTION = 10.0
_AFTER_MOTION = 1.0


def default_duration(motion: Motion | None) -> float:
    """Return how long to simulate where nobody says it [s].

    Args:
        motion: What is played, if anything; of one that repeats it is one round.
    """
    return _WITHOUT_MOTION if motion is None else motion.duration + _AFTER_MOTION


def find_motion(
    name: str | Path, robot: Robot, parameters: Mapping[str, Any] | None = None
) -> Motion:
    """Return the motion of a name or a file.

    Args:
        name: Name of a motion that comes with a bundled robot, or a file.
        robot: The robot.
        parameters: Values of its parameters, in place of their defaults.

    Raises:
        MotionError: If there is no such motion, or its file can't be used.
    """
    known = bundled_motions(robot.bundled) if robot.bundled else {}
    if str(name) in known:
        return load_motion(known[str(name)], parameters)
    if not Path(name).suffix and not Path(name).is_file():
        owner = robot.bundled or robot.name
        hint = suggest(str(name), known) if known else "give the file of a motion"
        text = f"no motion {str(name)!r} of {owner!r}, and no such file; {hint}"
        raise MotionError(text)
    return load_motion(name, parameters)
