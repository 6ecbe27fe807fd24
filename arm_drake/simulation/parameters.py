"""Parameters of motion files: `$(name)` in the steps, with defaults above them."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm_drake.errors import MotionError, suggest

# Keys of a motion with parameters.
PARAMETERS, STEPS = "parameters", "steps"

_REFERENCE = re.compile(r"\$\(\s*([^()]*?)\s*\)")


def fill_in(data: Any, given: Mapping[str, Any], file: Path | None) -> Any:
    """Return the list of a motion's steps, with the values of its parameters.

    A text that is nothing but `$(name)` becomes the value, whatever it is; inside a
    text the value's own text stands.

    Args:
        data: A list of steps, or a mapping of `parameters` and `steps`.
        given: Values that take the place of the defaults.
        file: File it came from, for messages.

    Raises:
        MotionError: If a parameter isn't declared.
    """
    declared: Mapping[str, Any] = {}
    steps = data
    if isinstance(data, Mapping):
        for key in data:
            if key not in (PARAMETERS, STEPS):
                hint = suggest(str(key), (PARAMETERS, STEPS))
                raise MotionError(f"unknown key {key!r}; {hint}", file=file)
        declared, steps = data.get(PARAMETERS) or {}, data.get(STEPS)
        if not isinstance(declared, Mapping):
            problem = f"expected names with defaults, got {declared!r}"
            raise MotionError(problem, file=file, where=PARAMETERS)
        for name in declared:
            if not isinstance(name, str):
                problem = f"expected names, got {name!r}"
                raise MotionError(problem, file=file, where=PARAMETERS)
        if not isinstance(steps, list):
            problem = f"expected a list of steps, got {type(steps).__name__}"
            raise MotionError(problem, file=file, where=STEPS)
    for name in given:
        if name not in declared:
            raise _unknown(name, declared, file)
    values = {**declared, **given}
    if not isinstance(steps, list):
        return steps
    return [_filled(step, values, f"[{n}]", file) for n, step in enumerate(steps)]


def _filled(
    value: Any, values: Mapping[str, Any], where: str, file: Path | None
) -> Any:
    """Return a part of a step with the values of parameters."""
    if isinstance(value, list):
        return [_filled(v, values, f"{where}[{n}]", file) for n, v in enumerate(value)]
    if isinstance(value, Mapping):
        return {
            key: _filled(item, values, f"{where}.{key}", file)
            for key, item in value.items()
        }
    if not isinstance(value, str):
        return value
    for name in _REFERENCE.findall(value):
        if name not in values:
            raise _unknown(name, values, file, where)
    whole = _REFERENCE.fullmatch(value)
    if whole:
        return values[whole[1]]
    return _REFERENCE.sub(lambda match: str(values[match[1]]), value)


def _unknown(
    name: str, known: Mapping[str, Any], file: Path | None, where: str = ""
) -> MotionError:
    hint = suggest(name, known) if known else "the motion declares none"
    return MotionError(f"no parameter {name!r}; {hint}", file=file, where=where)
