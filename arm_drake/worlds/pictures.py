"""Framed pictures, painted with a few rectangles."""

from arm_drake.worlds.furniture import IVORY, NAVY, OAK, WALNUT
from arm_drake.worlds.furniture_parts import Parts, block, moved


def picture(width: float, height: float, *colors: str, frame: str = WALNUT) -> Parts:
    """Return a framed picture that is seen from -y, its bottom at 0.

    Args:
        width: Of the frame [m].
        height: Of the frame [m].
        colors: Of the paper, and of what is painted on it.
        frame: Colour of the frame.
    """
    paper, *paints = colors
    w, h = width * 0.84, height * 0.84
    parts = [
        block((width, 0.03, height), (0, 0, 0), frame),
        block((w, 0.01, h), (0, -0.013, 0.08 * height), paper, is_solid=False),
    ]
    for i, paint in enumerate(paints):
        size = (w * (0.62 - 0.17 * i), 0.004, h * (0.24 + 0.1 * i))
        at = (w * (0.16 - 0.17 * i), -0.02 - 0.002 * i, height * (0.16 + 0.17 * i))
        parts.append(block(size, at, paint, is_solid=False))
    return parts


def desk_picture(color: str, frame: str = OAK) -> Parts:
    """Return a picture that stands, seen from -y, its middle at 0."""
    return moved(picture(0.15, 0.2, IVORY, color, NAVY, frame=frame), (0, 0, -0.09))
