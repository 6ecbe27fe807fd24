"""A pose as text to copy: YAML, or words of a command line.

Numbers have six significant digits. Where that would put a joint beyond the end of its
range, which it has reached, they have as many as are needed to stay within.
"""

import functools
import math
import re
import shlex
from collections.abc import Iterable, Mapping

import yaml

from arm_drake.errors import InputError
from arm_drake.plant.joint_ranges import JointRange

_DIGITS = 6

# As many tell any two numbers apart.
_MOST_DIGITS = 17

# Names that are texts without quotes in every YAML: 1.1, 1.2 and ROS's. All others are
# quoted, `yes`, `null` and `1e3` among them.
_PLAIN = re.compile(
    r"(?!(y|yes|n|no|on|off|true|false|null)$)[a-z_][\w/.-]*", re.ASCII | re.IGNORECASE
)


def pose_yaml(positions: Mapping[str, float], ranges: Iterable[JointRange]) -> str:
    """Return a pose as YAML: a line `joint: value` for each independent joint.

    Args:
        positions: Positions [rad] or [m] by joint; others than the independent joints
            are left out.
        ranges: Ranges of the joints, in the order of the lines.

    Raises:
        InputError: If an independent joint has no finite position.
    """
    texts = _texts(positions, ranges)
    return "".join(f"{_key(name)}: {number}\n" for name, number in texts.items())


def pose_words(positions: Mapping[str, float], ranges: Iterable[JointRange]) -> str:
    """Return a pose as words for a shell: `--position joint=value ...`.

    `arm-drake view` takes them.

    Args:
        positions: Positions [rad] or [m] by joint; others than the independent joints
            are left out.
        ranges: Ranges of the joints, in the order of the words.

    Returns:
        The words; "" for a robot without an independent joint.

    Raises:
        InputError: If an independent joint has no finite position.
    """
    texts = _texts(positions, ranges)
    words = [shlex.quote(f"{name}={number}") for name, number in texts.items()]
    return " ".join(["--position", *words]) if words else ""


def _texts(
    positions: Mapping[str, float], ranges: Iterable[JointRange]
) -> dict[str, str]:
    """Return the numbers of the independent joints."""
    texts = {}
    for joint in ranges:
        if joint.follows is None:
            position = positions.get(joint.name)
            if position is None or not math.isfinite(position):
                problem = f"expected a finite position, got {position!r}"
                raise InputError(problem, where=f"joint {joint.name!r}")
            texts[joint.name] = _number(float(position), joint)
    return texts


def _number(position: float, joint: JointRange) -> str:
    is_inside = joint.lower <= position <= joint.upper
    for digits in range(_DIGITS, _MOST_DIGITS + 1):
        # Adding 0.0 makes 0.0 of -0.0.
        rounded = float(f"{position:.{digits}g}") + 0.0
        if not is_inside or joint.lower <= rounded <= joint.upper:
            break
    mantissa, letter, exponent = repr(rounded).partition("e")
    # YAML 1.1 takes 1e-05 for a text.
    return f"{mantissa if '.' in mantissa else f'{mantissa}.0'}{letter}{exponent}"


@functools.lru_cache(maxsize=10_000)
def _key(name: str) -> str:
    if _PLAIN.fullmatch(name):
        return name
    text: str = yaml.safe_dump(
        name, default_style='"', allow_unicode=True, width=math.inf
    )
    return text.removesuffix("\n")
