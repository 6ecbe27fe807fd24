"""The house of the tutorials' worlds: our own furniture where theirs stands.

Names and poses are those of the models in automaticaddison's house.world, which has
AWS RoboMaker's residential furniture in it; shapes are our own.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from math import atan2, hypot, pi
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Mesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame

from arm_drake.plant.contact import GROUND_FRICTION, add_ground
from arm_drake.worlds import furniture
from arm_drake.worlds.furniture import (
    BLACK,
    DARK,
    IVORY,
    MUSTARD,
    NAVY,
    OAK,
    RUST,
    SAGE,
    STEEL,
    TEAL,
    WALNUT,
    WHITE,
    Part,
    Parts,
    ball,
    block,
    cushion,
    drawing,
    lathed,
    moved,
    post,
)

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


def air_conditioner() -> Parts:
    """Return one that hangs on a wall at -x."""
    return [
        cushion((0.24, 0.95, 0.3), (-0.08, 0, 0), WHITE, radius=0.05),
        block((0.02, 0.8, 0.03), (0.03, 0, 0.05), STEEL, is_solid=False),
    ]


def standing_air_conditioner() -> Parts:
    """Return one that stands on the floor."""
    return [
        post(0.2, 1.7, (0, 0, 0), WHITE),
        block((0.06, 0.18, 0.7), (0.17, 0.0, 0.85), DARK, is_solid=False),
        post(0.21, 0.04, (0, 0, 0), STEEL),
    ]


def gym_ball() -> Parts:
    """Return a large ball, its centre at 0."""
    return [ball(0.315, (0, 0, 0), TEAL)]


def board() -> Parts:
    """Return a shelf on a wall."""
    return [
        block((1.1, 0.24, 0.025), (0.02, 0, 0), OAK),
        *(block((0.02, 0.2, 0.1), (x, -0.01, -0.1), BLACK) for x in (-0.4, 0.44)),
    ]


def chandelier() -> Parts:
    """Return a lamp that hangs on a cord."""
    arms = [
        part
        for i in range(5)
        for part in moved(
            [
                block((0.34, 0.02, 0.02), (0.19, 0, 0.2), MUSTARD, is_solid=False),
                post(0.02, 0.07, (0.36, 0, 0.2), MUSTARD, is_solid=False),
                ball(0.065, (0.36, 0, 0.32), "fff3d0"),
            ],
            (0, 0, 0),
            0.4 * pi * i,
        )
    ]
    return [post(0.03, 0.16, (0, 0, 0.14), MUSTARD), *arms, _cord(0.3, 0.85)]


def carpet() -> Parts:
    """Return a carpet, 3.6 m by 2.4 m, thin enough to stand on."""
    return [
        block((3.6, 2.4, 0.004), (0, 0, -0.001), "8a3b2e", is_solid=False),
        block((3.36, 2.16, 0.002), (0, 0, 0.003), "d9c7a3", is_solid=False),
        block((3.2, 2.0, 0.002), (0, 0, 0.005), "9c4a3a", is_solid=False),
        *(
            block(
                (0.5, 0.5, 0.002),
                (x, y, 0.007),
                "d9c7a3",
                turn=(0, 0, pi / 4),
                is_solid=False,
            )
            for x in (-1.1, 0, 1.1)
            for y in (-0.45, 0.45)
        ),
    ]


def security_camera() -> Parts:
    """Return a camera on a foot, looking to +y."""
    return [
        post(0.05, 0.015, (0, 0, 0), WHITE),
        ball(0.045, (0, 0, 0.06), WHITE),
        post(0.02, 0.01, (0, 0.038, 0.06), BLACK, turn=(-pi / 2, 0, 0), is_solid=False),
    ]


def cooking_bench() -> Parts:
    """Return a stove top with a pot, in a counter."""
    rings = [
        post(0.09, 0.008, (x, y, 0.012), "55595e", is_solid=False)
        for x in (-0.13, 0.13)
        for y in (-0.17, 0.17)
    ]
    return [
        block((0.5, 0.7, 0.012), (0, 0, 0), BLACK),
        *rings,
        lathed([(0, 0), (0.1, 0), (0.105, 0.13)], (-0.13, 0.17, 0.02), RUST),
        post(0.108, 0.012, (-0.13, 0.17, 0.15), STEEL, is_solid=False),
        ball(0.018, (-0.13, 0.17, 0.175), BLACK, is_solid=False),
    ]


def curtain() -> Parts:
    """Return drawn-back curtains on a rod along y."""
    folds = [
        post(0.045, 2.2, (0.0, y, 0.12), "b9cdc9" if i % 2 else "a6bfba")
        for side in (-1, 1)
        for i, y in enumerate(side * (1.05 + 0.06 * k) - 0.23 for k in range(6))
    ]
    rod = post(0.015, 3.0, (0, -1.73, 2.35), DARK, turn=(-pi / 2, 0, 0))
    return [*folds, rod]


def front_door() -> Parts:
    """Return a closed door in a frame, along x."""
    return [
        block((0.9, 0.06, 2.05), (0, 0, 0), WALNUT),
        *(
            block((0.6, 0.07, h), (0, 0, z), "7d5a42", is_solid=False)
            for h, z in ((0.8, 0.15), (0.9, 1.05))
        ),
        *(block((0.07, 0.14, 2.12), (x, 0, 0), WHITE) for x in (-0.485, 0.485)),
        block((1.04, 0.14, 0.07), (0, 0, 2.05), WHITE),
    ]


def folding_door() -> Parts:
    """Return a doorway along y, its door folded away."""
    leaves = [
        block(
            (0.32, 0.03, 2.0),
            (0.15 * k, 0.4 + 0.04 * k, 0.0),
            "cdb28d",
            turn=(0, 0, 0.1 - 0.2 * k),
        )
        for k in (0, 1)
    ]
    return [
        *(block((0.28, 0.06, 2.1), (-0.12, y, 0), OAK) for y in (-0.47, 0.47)),
        block((0.28, 1.0, 0.06), (-0.12, 0, 2.1), OAK),
        *moved(leaves, (-0.05, 0, 0)),
    ]


def handle() -> Parts:
    """Return the handle of a door, seen from -y."""
    return [
        block((0.05, 0.01, 0.2), (0, 0, -0.1), STEEL),
        block((0.15, 0.02, 0.02), (-0.05, -0.04, 0), STEEL),
    ]


def dumbbells() -> Parts:
    """Return a pair of dumbbells on the floor."""
    one: Parts = [
        post(0.015, 0.3, (0, -0.15, 0.08), STEEL, turn=(-pi / 2, 0, 0)),
        *(
            post(0.08, 0.08, (0, y, 0.08), DARK, turn=(-pi / 2, 0, 0))
            for y in (-0.16, 0.08)
        ),
    ]
    return [*moved(one, (-0.12, 0, 0)), *moved(one, (0.12, 0.03, 0), 0.2)]


def tablet() -> Parts:
    """Return a tablet computer that lies on a table."""
    return [
        block((0.18, 0.25, 0.01), (0, 0, -0.002), BLACK),
        block((0.16, 0.22, 0.001), (0, 0, 0.008), "4f7fa0", is_solid=False),
    ]


def kitchen_utensils() -> Parts:
    """Return spoons and ladles that hang on a rail, at a wall at +x."""
    tools = [
        part
        for i, color in enumerate((STEEL, OAK, STEEL, RUST))
        for part in (
            block((0.012, 0.02, 0.26), (0, 0.1 * i - 0.15, -0.06), color),
            cushion(
                (0.02, 0.06, 0.09), (0, 0.1 * i - 0.15, -0.12), color, is_solid=False
            ),
        )
    ]
    return [*tools, block((0.02, 0.5, 0.02), (0.02, 0, 0.2), DARK)]


def wall_lamp() -> Parts:
    """Return a lamp on a wall at -y."""
    return [
        block((0.1, 0.03, 0.16), (0, -0.02, -0.08), MUSTARD),
        block((0.02, 0.14, 0.02), (0, 0.05, -0.02), MUSTARD),
        lathed([(0.1, 0), (0.06, 0.16)], (0, 0.12, -0.03), "f6e3b4"),
    ]


def range_hood() -> Parts:
    """Return a hood above a stove."""
    return [
        lathed([(0.42, 0), (0.42, 0.05), (0.14, 0.24), (0.14, 0.3)], (0, 0, 0), STEEL),
        block((0.26, 0.26, 0.8), (0, 0, 0.28), STEEL),
    ]


def seasoning_box() -> Parts:
    """Return a row of jars."""
    jars = [
        part
        for i, color in enumerate((RUST, MUSTARD, SAGE))
        for part in (
            post(0.03, 0.09, (0, 0.08 * i - 0.08, 0.01), color),
            post(0.031, 0.02, (0, 0.08 * i - 0.08, 0.1), WHITE),
        )
    ]
    return [block((0.1, 0.28, 0.012), (0, 0, 0), OAK), *jars]


def tableware() -> Parts:
    """Return plates, glasses and a bowl of fruit on a table, its top 35 mm below."""
    places = [
        part
        for x, y in ((-0.04, -0.3), (-0.12, 0.25), (-0.9, -0.3), (-1.08, 0.25))
        for part in (
            lathed([(0, 0), (0.07, 0), (0.12, 0.018)], (x, y, 0), WHITE),
            lathed(
                [(0.0, 0), (0.03, 0), (0.035, 0.12)],
                (x + 0.16, 0.6 * y, 0),
                "bfe0ea",
                alpha=0.5,
            ),
        )
    ]
    fruit = [
        ball(0.04, (-0.6 + x, -0.03 + y, 0.08), color, is_solid=False)
        for x, y, color in (
            (0, 0.04, "c8402f"),
            (0.05, -0.03, "e08a2c"),
            (-0.05, -0.02, "7fa83c"),
        )
    ]
    bowl = lathed([(0, 0), (0.07, 0), (0.15, 0.08)], (-0.6, -0.03, 0), TEAL)
    # They stand along the table, whatever the yaw of 1.025 rad of the piece.
    return moved([*places, bowl, *fruit], (0, 0, -0.029), -1.025)


def trash() -> Parts:
    """Return a waste bin."""
    return [
        lathed([(0, 0), (0.12, 0), (0.15, 0.34)], (0, 0, -0.01), STEEL),
        post(0.152, 0.02, (0, 0, 0.32), DARK),
    ]


def vase() -> Parts:
    """Return a vase with flowers."""
    flowers = [
        part
        for x, y, color in (
            (0, 0, RUST),
            (0.05, 0.02, MUSTARD),
            (-0.05, 0.02, "f0e6ef"),
        )
        for part in (
            post(0.006, 0.2, (x / 2, y / 2, 0.16), "4f7a4a", is_solid=False),
            ball(0.035, (x, y, 0.37), color, is_solid=False),
        )
    ]
    profile = [(0, 0), (0.04, 0), (0.07, 0.08), (0.03, 0.17), (0.04, 0.2)]
    return [lathed(profile, (0, 0, 0), NAVY), *flowers]


def _cord(z: float, height: float) -> Part:
    return post(0.006, height, (0, 0, z), BLACK, is_solid=False)


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


# Model instance of the pieces' frames.
HOUSE = "house"

# Where the pieces are: x, y, z [m], roll, pitch, yaw [rad]; zeros at the end left out.
PLACES: Mapping[str, Sequence[tuple[float, ...]]] = {
    "HouseWallB_01": [(0, 0)],
    "AirconditionerA_01": [(-9.19941, 2.41123, 2.084544)],
    "AirconditionerB_01": [(-2.004656, -5.22661, 0.003485)],
    "Ball_01": [(3.295503, 4.225674, 0.318684), (-6.945503, -4.22174, 0.318684)],
    "Bed_01": [(-6.165067, 2.03056, -1e-05)],
    "NightStand_01": [
        (-7.72551, 2.86042, 0.005258, -2e-06),
        (-4.407341, 2.86042, 0.005256, 0, 2e-06),
    ],
    "Board_01": [(2.779073, -5.392703, 1.538173)],
    "ChairA_01": [
        (7.11516, 0.209028, 0.024685, 1e-06, 0, -1.55607),
        (6.25506, 0.219468, 0.011308, 0, 0, -1.50414),
        (6.06678, 1.68075, 0.01, 0, 0, 1.56986),
        (7.00277, 1.67074, 0, 0, 0, 1.52363),
        (-8.27094, 1.91665, 0.03665),
    ],
    "ChairD_01": [
        (-1.380775, 4.104456),
        (0.325214, 4.104456, 0, 0, 0, -3.138741),
        (-8.270775, -4.504456, 0, 0, 0, 0.869673),
    ],
    "Chandelier_01": [
        (1.221061, 4.15574, 1.295),
        (-6.451061, -0.69204, 1.81),
        (7.824061, -1.59, 1.751),
        (1.221061, -1.59204, 1.7873),
    ],
    "Carpet_01": [(0.78505, -1.106647, 0.001106), (2.85405, 3.45, 0.000585)],
    "SecurityCamera_01": [(0.842134, -4.996294, 0.495067, 0, 0, -2.841039)],
    "CoffeeTable_01": [(1.512301, -1.733438, 0.041983, 0, 0, 0.01)],
    "CookingBench_01": [(9.038383, -3.35114, 0.90361, 0, 0, 3.137133)],
    "Curtain_01": [(-9.172642, 0.20376)],
    "KitchenTable_01": [(6.55269, 0.951173, -6e-06, 0, 0, -1.56413)],
    "ReadingDesk_01": [(-8.987262, 2.057058, 0, 0, 0, -0.004638)],
    "BalconyTable_01": [(-0.55624, 4.111241)],
    "Door_01": [(6.001449, -5.549002)],
    "Dumbbell_01": [(2.512849, 2.717787, 0.002183)],
    "Tablet_01": [(1.57283, -1.775857, 0.40179, -0.020625, -8e-05, -0.006317)],
    "FitnessEquipment_01": [(3.48472, 3.169104, 0.003168)],
    "FoldingDoor_01": [
        (-2.461096, 1.844219, 0.041881),
        (-2.461096, -4.05332, 0.041881),
    ],
    "Handle_01": [(5.724, -5.523, 0.9938, 0, 0, -3.1415)],
    "FoldingDoor_02": [(4.674231, 2.46451, 0, 0, 0, 3.14159), (4.8912, -4.84968)],
    "KitchenCabinet_01": [(8.002009, -3.836509, 0.012068, 0, 0, -3.140001)],
    "KitchenUtensils_01": [(9.285478, -5.021261, 1.141805)],
    "LightC_01": [(1.769567, -5.444371, 2.0), (-0.138245, -5.444371, 2.0)],
    "PortraitA_01": [(-2.71236, -4.817539, 1.0, 0, 0, 1.566796)],
    "PortraitB_01": [(-1.279683, -5.42963, 0, -0.076901, 0, -3.116718)],
    "PortraitB_02": [(5.737017, 3.08031, 0.3)],
    "PortraitB_03": [(3.07138, -5.349366, 0.005494, -0.168428, 0, 3.104232)],
    "PortraitA_02": [(7.937017, 3.08031, 0.3, 0, 0, 3.14)],
    "PortraitC_01": [(-9.294904, -4.526084, 1.0, 0, 0, 1.554734)],
    "PortraitD_01": [(0.789763, -5.478725, 1.8, 0, 0, 3.138531)],
    "PortraitD_02": [(6.870181, 3.08031, 1.488439)],
    "PortraitE_01": [(-5.773094, -5.492466, 1.0, 0, 0, 3.132627)],
    "PortraitE_02": [(-6.193025, -1.590208, 0.3, 0, 0, 0.00429)],
    "DeskPortraitA_01": [(-0.036864, -5.110156, 0.49866, 0, 0, 2.927784)],
    "DeskPortraitA_02": [
        (2.046082, -1.892926, 0.070388, -0.018328, -0.000441, 1.576216)
    ],
    "DeskPortraitC_01": [
        (-7.746377, 2.731075, 0.69462, 0.000488, -0.000359, -0.055499)
    ],
    "DeskPortraitC_02": [
        (0.964613, -1.586951, 0.127676, 0.001614, -0.000545, -1.578699)
    ],
    "DeskPortraitD_01": [(2.64556, -5.376225, 1.573738, 0, 0, -3.112826)],
    "DeskPortraitD_02": [
        (-0.589211, -5.10989, 0.192145, -1.5e-05, -0.000174, -3.112544)
    ],
    "DeskPortraitD_03": [(1.826729, -1.464881, 0.126208, 1e-05, 6e-06, -3.11438)],
    "DeskPortraitD_04": [(4.302132, -5.176568, 0.202496, 0.007118, -1e-06, 3.046683)],
    "DeskPortraitB_01": [(3.547376, -5.083898, -0.01266, -0.336622, -1e-06, 3.046741)],
    "DeskPortraitB_02": [(2.48627, -5.102525, -0.01266, -0.336621, 0, 3.046798)],
    "Rangehood_01": [(9.019794, -3.36994, 1.507605)],
    "Refrigerator_01": [(8.702731, -1.032031, 0, 0, 0, -1.563499)],
    "SeasoningBox_01": [(9.107968, -2.651726, 0.902458, -6e-06, 3.4e-05, 0.00129)],
    "ShoeRack_01": [(4.297978, -5.173566)],
    "SofaC_01": [(0.330699, -1.902792, 0.065992, 0, 0, 1.571733)],
    "Tableware_01": [(7.15317, 0.982767, 0.817812, -0.001238, -0.000976, 1.02476)],
    "Trash_01": [(-8.704151, 1.00058, 0.011)],
    "TV_01": [(0.824259, -5.382968, 0.676282, 0, 0, -1.561744)],
    "TV_02": [(-6.197322, -1.388739, 0.676282, 0, 0, -1.561744)],
    "TVCabinet_01": [(0.615509, -5.105954, -0.011049, 0, 0, 1.57)],
    "Vase_01": [(3.055663, -5.41308, 1.574958, 3e-06, 0.0017, 0.00084)],
    "RoomWall_01": [(-6.09755, -1.49618, 0.028124)],
    "FloorB_01": [(0, 0)],
    "Wardrobe_01": [(-3.14671, 2.476204, 0.000704, 0, 0, -1.569673)],
    "RoomWindow_01": [
        (-9.4186, -0.026285, 0.502739),
        (-9.4186, -2.37409, 0.502739),
        (9.422616, -3.373981, 0.502739, 0, 0, -3.136099),
        (9.422558, 0.96852, 0.496581, 0, 0, -3.136099),
        (4.722317, 4.470281, 0.502739, 0, 0, -3.136099),
        (3.48852, 5.600688, 0.502739, 0, 0, -1.566274),
        (1.140949, 5.600688, 0.502739, 0, 0, -1.566274),
        (-1.19934, 5.600688, 0.502739, 0, 0, -1.566274),
        (-2.396624, 4.387607, 0.502739),
    ],
}

_PIECES: Mapping[str, Callable[[], Parts]] = {
    "AirconditionerA_01": air_conditioner,
    "AirconditionerB_01": standing_air_conditioner,
    "BalconyTable_01": furniture.balcony_table,
    "Ball_01": gym_ball,
    "Bed_01": furniture.bed,
    "Board_01": board,
    "Carpet_01": carpet,
    "ChairA_01": furniture.dining_chair,
    "ChairD_01": furniture.armchair,
    "Chandelier_01": chandelier,
    "CoffeeTable_01": furniture.coffee_table,
    "CookingBench_01": cooking_bench,
    "Curtain_01": curtain,
    "DeskPortraitA_01": partial(desk_picture, RUST),
    "DeskPortraitA_02": partial(desk_picture, TEAL),
    "DeskPortraitB_01": partial(picture, 0.5, 0.7, IVORY, SAGE, RUST, NAVY),
    "DeskPortraitB_02": partial(picture, 0.5, 0.7, IVORY, MUSTARD, TEAL, frame=BLACK),
    "DeskPortraitC_01": partial(desk_picture, SAGE, BLACK),
    "DeskPortraitC_02": partial(desk_picture, MUSTARD, BLACK),
    "DeskPortraitD_01": partial(desk_picture, NAVY),
    "DeskPortraitD_02": partial(desk_picture, RUST, BLACK),
    "DeskPortraitD_03": partial(desk_picture, TEAL, BLACK),
    "DeskPortraitD_04": partial(desk_picture, SAGE),
    "Door_01": front_door,
    "Dumbbell_01": dumbbells,
    "FitnessEquipment_01": furniture.fitness_equipment,
    "FloorB_01": floor,
    "FoldingDoor_01": folding_door,
    "FoldingDoor_02": folding_door,
    "Handle_01": handle,
    "HouseWallB_01": walls,
    "KitchenCabinet_01": furniture.kitchen_cabinet,
    "KitchenTable_01": furniture.kitchen_table,
    "KitchenUtensils_01": kitchen_utensils,
    "LightC_01": wall_lamp,
    "NightStand_01": furniture.night_stand,
    "PortraitA_01": partial(picture, 0.4, 0.6, IVORY, NAVY, MUSTARD),
    "PortraitA_02": partial(picture, 0.6, 0.9, IVORY, RUST, TEAL),
    "PortraitB_01": partial(picture, 0.7, 1.0, IVORY, TEAL, MUSTARD, RUST),
    "PortraitB_02": partial(picture, 0.6, 0.9, IVORY, NAVY, SAGE),
    "PortraitB_03": partial(picture, 0.6, 0.8, IVORY, RUST, MUSTARD, frame=BLACK),
    "PortraitC_01": partial(picture, 0.8, 1.0, IVORY, SAGE, NAVY, MUSTARD),
    "PortraitD_01": partial(picture, 1.2, 0.6, IVORY, TEAL, NAVY, RUST),
    "PortraitD_02": partial(picture, 0.9, 0.6, IVORY, MUSTARD, RUST, frame=BLACK),
    "PortraitE_01": partial(picture, 1.4, 0.8, IVORY, NAVY, TEAL, MUSTARD),
    "PortraitE_02": partial(picture, 0.7, 1.0, IVORY, RUST, SAGE),
    "Rangehood_01": range_hood,
    "ReadingDesk_01": furniture.reading_desk,
    "Refrigerator_01": furniture.refrigerator,
    "RoomWall_01": room_wall,
    "RoomWindow_01": window,
    "SeasoningBox_01": seasoning_box,
    "SecurityCamera_01": security_camera,
    "ShoeRack_01": furniture.shoe_rack,
    "SofaC_01": furniture.sofa,
    "TV_01": furniture.television,
    "TV_02": furniture.television,
    "TVCabinet_01": furniture.tv_cabinet,
    "Tablet_01": tablet,
    "Tableware_01": tableware,
    "Trash_01": trash,
    "Vase_01": vase,
    "Wardrobe_01": furniture.wardrobe,
}


class Piece(NamedTuple):
    """A piece of the house, and where it is."""

    name: str
    kind: str
    pose: RigidTransform


def add_house(plant: MultibodyPlant) -> None:
    """Add the ground, and the house on it.

    All of it is part of the world body, with a frame for each piece, such as
    "Bed_01_001", in the model instance "house": a body that is welded to the world
    would cost time in every step.

    Args:
        plant: A plant that isn't finalized.
    """
    add_ground(plant)
    body, instance = plant.world_body(), plant.AddModelInstance(HOUSE)
    friction = CoulombFriction(GROUND_FRICTION, GROUND_FRICTION)
    for name, kind, X_WP in list_pieces():
        plant.AddFrame(FixedOffsetFrame(name, plant.world_frame(), X_WP, instance))
        parts, mesh = _make_piece(kind)
        label = f"{HOUSE}::{name}"
        plant.RegisterVisualGeometry(body, X_WP, mesh, label, np.ones(4))
        for i, part in enumerate(parts):
            if part.shape is not None:
                plant.RegisterCollisionGeometry(
                    body, X_WP @ part.pose, part.shape, f"{label}::{i}", friction
                )


def list_pieces() -> list[Piece]:
    """Return all pieces of the house; those of a kind are numbered."""
    pieces = []
    for kind, places in PLACES.items():
        for number, place in enumerate(places, start=1):
            x, y, z, roll, pitch, yaw = (*place, *([0.0] * (6 - len(place))))
            X_WP = RigidTransform(RollPitchYaw(roll, pitch, yaw), np.array([x, y, z]))
            pieces.append(Piece(f"{kind}_{number:03d}", kind, X_WP))
    return pieces


@cache
def _make_piece(kind: str) -> tuple[Parts, Mesh]:
    parts = _PIECES[kind]()
    return parts, drawing(parts, kind)
