"""Walls, windows and the floor of the house."""

from math import atan2, hypot

from arm_drake.worlds.furniture import WHITE
from arm_drake.worlds.furniture_parts import Parts, block, moved

# Height of the walls; there is no ceiling, so that one can look in [m].
HEIGHT = 2.6

# Thickness of outer and of inner walls [m].
_OUTER, _INNER = 0.16, 0.22

# Windows: width, lower and upper edge [m].
_WIDTH, _SILL, _TOP = 1.7, 0.5, 2.1

# Doors: width and height [m].
_DOOR, _LINTEL = 1.0, 2.16

_PAINT, _BASE = "d9cfbc", "fbfaf7"

Point = tuple[float, float]

# An opening: its middle along the wall, width, lower and upper edge [m].
Opening = tuple[float, float, float, float]


def walls() -> Parts:
    """Return the walls, in the frame of the house."""
    left, right, south, north = -9.5, 9.5, -5.62, 3.2
    west, east, balcony = -2.48, 4.8, 5.68

    def windows(*places: float) -> list[Opening]:
        return [(place, _WIDTH, _SILL, _TOP) for place in places]

    def doors(*places: float) -> list[Opening]:
        return [(place, _DOOR, 0.0, _LINTEL) for place in places]

    outer = [
        ((left, south), (left, north), windows(-0.026 - south, -2.374 - south)),
        ((right, south), (right, north), windows(-3.374 - south, 0.969 - south)),
        ((left, south), (right, south), [(6.0 - left, 1.04, 0.0, 2.12)]),
        ((left, north), (west, north), []),
        ((east, north), (right, north), []),
        ((west, north), (west, balcony), windows(4.388 - north)),
        ((east, north), (east, balcony), windows(4.47 - north)),
        (
            (west, balcony),
            (east, balcony),
            windows(*(x - west for x in (3.489, 1.141, -1.199))),
        ),
    ]
    inner = [
        ((-2.58, south), (-2.58, north), doors(1.844 - south, -4.053 - south)),
        ((4.78, south), (4.78, north), doors(2.465 - south, -4.85 - south)),
    ]
    return [
        *(part for wall in outer for part in _wall(*wall, _OUTER)),
        *(part for wall in inner for part in _wall(*wall, _INNER)),
    ]


def room_wall() -> Parts:
    """Return a wall along x that parts a room, with a way around both its ends."""
    return [
        block((4.6, 0.14, HEIGHT - 0.03), (0, 0, -0.028), "9fb1a8"),
        block((4.64, 0.18, 0.1), (0, 0, -0.028), _BASE),
    ]


def window() -> Parts:
    """Return a window with two panes along y, its lower edge at 0."""
    height = _TOP - _SILL
    bars = [block((0.1, 0.06, height), (0, y, 0), WHITE) for y in (-0.82, 0, 0.82)]
    return [
        *bars,
        *(block((0.1, _WIDTH, 0.06), (0, 0, z), WHITE) for z in (0.0, height - 0.06)),
        block((0.012, 1.6, height - 0.1), (0, 0, 0.05), "a9d4e6", alpha=0.35),
        block((0.26, 1.8, 0.04), (0, 0, -0.03), WHITE),
    ]


def floor() -> Parts:
    """Return boards, tiles in the kitchen, and a terrace; the ground carries them."""
    tones = ("ab7c4c", "a27345", "b38553", "996b3f")
    boards = [
        block(
            (14.2, 0.29, 0.01),
            (-2.35, -5.46 + 0.3 * i, -0.011),
            tones[(3 * i) % 4],
            is_solid=False,
        )
        for i in range(29)
    ]
    terrace = [
        block(
            (7.16, 0.29, 0.01),
            (1.16, 3.24 + 0.285 * i, -0.011),
            tones[(3 * i + 1) % 4],
            is_solid=False,
        )
        for i in range(9)
    ]
    tiles = [
        block(
            (0.73, 0.71, 0.01),
            (5.26 + 0.75 * i, -5.25 + 0.735 * k, -0.011),
            "b4b8b3" if (i + k) % 2 else "868f93",
            is_solid=False,
        )
        for i in range(6)
        for k in range(12)
    ]
    under = [
        block((19.1, 8.9, 0.02), (0, -1.21, -0.04), "6f6a62", is_solid=False),
        block((7.4, 2.6, 0.02), (1.16, 4.4, -0.04), "6f6a62", is_solid=False),
    ]
    return [*under, *boards, *terrace, *tiles]


def _wall(start: Point, end: Point, openings: list[Opening], thickness: float) -> Parts:
    """Return a wall from one point to another one, with openings in it."""
    across, along = end[0] - start[0], end[1] - start[1]
    length = hypot(across, along)
    parts: Parts = []

    def fill(left: float, right: float, bottom: float, top: float) -> None:
        if right - left > 1e-6 and top - bottom > 1e-6:
            size = (right - left, thickness, top - bottom)
            parts.append(block(size, ((left + right) / 2.0, 0.0, bottom), _PAINT))

    done = -thickness / 2.0
    for middle, width, bottom, top in sorted(openings):
        fill(done, middle - width / 2.0, 0.0, HEIGHT)
        fill(middle - width / 2.0, middle + width / 2.0, 0.0, bottom)
        fill(middle - width / 2.0, middle + width / 2.0, top, HEIGHT)
        done = middle + width / 2.0
    fill(done, length + thickness / 2.0, 0.0, HEIGHT)
    return moved(parts, (*start, 0.0), atan2(along, across))
