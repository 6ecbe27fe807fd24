"""Numbers in the attributes of a URDF."""

from pathlib import Path

from arm_drake.errors import DescriptionError


def numbers(text: str, file: Path, where: str) -> list[float]:
    """Return the numbers of a text, separated by spaces.

    Args:
        text: The text of an attribute.
        file: File to name.
        where: Place to name, such as "joint 'elbow'".

    Raises:
        DescriptionError: If it holds anything else.
    """
    try:
        return [float(number) for number in text.split()]
    except ValueError:
        raise DescriptionError(
            f"expected numbers, got {text!r}", file=file, where=where
        ) from None
