"""A motion from its file, or from a list as in one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm_drake import yaml_files
from arm_drake.errors import MotionError
from arm_drake.simulation.fields import Fields
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.parameters import fill_in
from arm_drake.simulation.steps import REPEAT, parse_step


def load_motion(
    path: str | Path, parameters: Mapping[str, Any] | None = None
) -> Motion:
    """Return the motion of a YAML file.

    Args:
        path: The file.
        parameters: Values of its parameters, in place of their defaults.

    Raises:
        MotionError: If the file can't be used.
    """
    path = Path(path)
    try:
        data = yaml_files.load(path)
    except yaml_files.YamlError as error:
        raise MotionError(error.problem, file=path, line=error.line) from None
    return parse_motion(data, path, parameters)


def parse_motion(
    data: Any, file: Path | None = None, parameters: Mapping[str, Any] | None = None
) -> Motion:
    """Return the motion of a list of steps, as in a motion file.

    A step that this version doesn't know is an error, not nothing.

    Args:
        data: The list; or a mapping of `parameters`, with defaults, and `steps`.
        file: File it came from, for messages.
        parameters: Values of its parameters, in place of their defaults.

    Raises:
        MotionError: If a step is malformed.
    """
    data = fill_in(data, parameters or {}, file)
    if not isinstance(data, list):
        raise MotionError(
            f"expected a list of steps, got {type(data).__name__}", file=file
        )
    repeats = bool(data) and _is_repeat(data[-1])
    steps = [
        step
        for index, item in enumerate(data[:-1] if repeats else data)
        for step in parse_step(item, index, file)
    ]
    in_order = tuple(sorted(steps, key=lambda step: step.at))
    motion = Motion(file, in_order, repeats, dict(parameters or {}))
    if repeats:
        _check_repeat(data[-1], motion, Fields(f"[{len(data) - 1}]", file))
    return motion


def _is_repeat(item: Any) -> bool:
    return isinstance(item, Mapping) and REPEAT in item


def _check_repeat(item: Mapping[str, Any], motion: Motion, fields: Fields) -> None:
    """Raise MotionError if a motion can't start over as its last item says."""
    fields.mapping(item, "", (REPEAT,))
    if item[REPEAT] is not True:
        raise fields.error(REPEAT, f"expected true, got {item[REPEAT]!r}")
    if motion.duration == 0.0:
        problem = "a round takes no time; `every` and `count` of a step give it some"
        raise fields.error(REPEAT, problem)
    last = motion.steps[-1]
    if last.at >= motion.duration:
        problem = (
            f"the next round starts with the last message, at {last.at:g} s, and takes "
            f"its place; `every` and `count` of {last.where} give it time"
        )
        raise fields.error(REPEAT, problem)
