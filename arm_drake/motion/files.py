"""A motion from its file, or from a list as in one."""

from pathlib import Path
from typing import Any

from arm_drake import yaml_files
from arm_drake.errors import MotionError
from arm_drake.motion.steps import parse_step
from arm_drake.motion.timeline import Motion


def load_motion(path: str | Path) -> Motion:
    """Return the motion of a YAML file.

    Raises:
        MotionError: If the file can't be used.
    """
    path = Path(path)
    try:
        data = yaml_files.load(path)
    except yaml_files.YamlError as error:
        raise MotionError(error.problem, file=path, line=error.line) from None
    return parse_motion(data, path)


def parse_motion(data: Any, file: Path | None = None) -> Motion:
    """Return the motion of a list of steps, as in a motion file.

    A step that this version doesn't know is an error, not nothing.

    Args:
        data: The list.
        file: File it came from, for messages.

    Raises:
        MotionError: If a step is malformed.
    """
    if not isinstance(data, list):
        raise MotionError(
            f"expected a list of steps, got {type(data).__name__}", file=file
        )
    steps = [
        step
        for index, item in enumerate(data)
        for step in parse_step(item, index, file)
    ]
    return Motion(file, tuple(sorted(steps, key=lambda step: step.at)))
