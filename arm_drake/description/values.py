"""Numbers in the attributes of a URDF."""

import re
from pathlib import Path

from arm_drake.errors import DescriptionError

# Drake reads a number as far as it can: 1_0 as 1, 0x10 as 0. Python reads 1_0 as 10,
# and the digits of all scripts.
_NUMBER = re.compile(
    r"[+-]?(([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?|inf(inity)?|nan)",
    re.IGNORECASE | re.ASCII,
)
_SPACES = " \t\r\n"


def parse_number(text: str) -> float | None:
    """Return the decimal number, inf or nan that a text is, or None."""
    text = text.strip(_SPACES)
    return float(text) if _NUMBER.fullmatch(text) else None


def numbers(text: str, file: Path, where: str) -> list[float]:
    """Return the numbers of a text, separated by spaces.

    Args:
        text: The text of an attribute.
        file: File to name.
        where: Place to name, such as "joint 'elbow'".

    Raises:
        DescriptionError: If it holds anything else.
    """
    found = []
    for word in re.findall(f"[^{_SPACES}]+", text):
        number = parse_number(word)
        if number is None:
            problem = f"expected numbers, got {text!r}"
            raise DescriptionError(problem, file=file, where=where)
        found.append(number)
    return found
