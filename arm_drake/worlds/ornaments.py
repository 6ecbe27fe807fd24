"""The small pieces of the house: what hangs, lies and stands about in it."""

from math import pi

from arm_drake.worlds.furniture import (
    BLACK,
    DARK,
    MUSTARD,
    NAVY,
    OAK,
    RUST,
    SAGE,
    STEEL,
    TEAL,
    WALNUT,
    WHITE,
)
from arm_drake.worlds.furniture_parts import (
    Part,
    Parts,
    ball,
    block,
    cushion,
    lathed,
    moved,
    post,
)


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
