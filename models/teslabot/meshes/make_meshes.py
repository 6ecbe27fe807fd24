"""Make the Tesla Bot's meshes: `python models/teslabot/meshes/make_meshes.py`.

Each is a few closed pieces that overlap, in metres and in the axes of its link. The
sizes are those of the boxes around the CAD parts, the shapes are ours.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from scipy.interpolate import PchipInterpolator
from trimesh.creation import cylinder, uv_sphere

Point = Sequence[float]

FOLDER = Path(__file__).parent

# Rows of a loft: z, half of the width in x and y, middle in x and y [m].
Rows = list[tuple[float, float, float, float, float]]

# Axes of a link for a piece made along z: down the arm is -y.
DOWN_Y = trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
ALONG_X = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])


def loft(
    rows: Rows, roundness: float = 2.0, rings: int = 24, sides: int = 32
) -> trimesh.Trimesh:
    """Return a body with smooth sides through cross-sections, closed at both ends.

    Args:
        rows: Cross-sections, z increasing.
        roundness: Exponent of their outline: 2 is an ellipse, 4 nearly a box.
        rings: Number of cross-sections that are made.
        sides: Corners of each.
    """
    table = np.array(rows)
    # A parameter in which rows are equally far, so that ends can be rounded off.
    at = np.linspace(0, len(table) - 1, rings)
    z, a, b, x, y = PchipInterpolator(np.arange(len(table)), table)(at).T
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    cos, sin = np.cos(angle), np.sin(angle)
    u = np.sign(cos) * np.abs(cos) ** (2 / roundness)
    v = np.sign(sin) * np.abs(sin) ** (2 / roundness)
    ring = np.stack(
        [
            x[:, None] + a[:, None] * u,
            y[:, None] + b[:, None] * v,
            np.broadcast_to(z[:, None], (rings, sides)),
        ],
        axis=2,
    )
    ends = [[x[0], y[0], z[0]], [x[-1], y[-1], z[-1]]]
    vertices = np.vstack([ring.reshape(-1, 3), ends])
    here = np.arange(sides)
    there = (here + 1) % sides
    faces = []
    for row in range(rings - 1):
        low, high = row * sides, (row + 1) * sides
        faces += [
            [low + i, low + j, high + j] for i, j in zip(here, there, strict=True)
        ]
        faces += [
            [low + i, high + j, high + i] for i, j in zip(here, there, strict=True)
        ]
    bottom, top, last = rings * sides, rings * sides + 1, (rings - 1) * sides
    faces += [[bottom, j, i] for i, j in zip(here, there, strict=True)]
    faces += [[top, last + i, last + j] for i, j in zip(here, there, strict=True)]
    return trimesh.Trimesh(vertices, faces)


def rod(radius: float, start: Point, end: Point) -> trimesh.Trimesh:
    """Return a cylinder from one point to another."""
    return cylinder(radius=radius, segment=[start, end], sections=24)


def ball(radius: float, center: Point) -> trimesh.Trimesh:
    """Return a sphere."""
    piece = uv_sphere(radius=radius, count=[12, 24])
    return piece.apply_translation(center)


def drum(radius: float, length: float, edge: float) -> trimesh.Trimesh:
    """Return a cylinder along z around the origin with rounded edges."""
    h = length / 2
    top = [
        (radius - edge + edge * np.cos(t), h - edge + edge * np.sin(t))
        for t in np.linspace(0, np.pi / 2, 5)
    ]
    bottom = [(r, -z) for r, z in reversed(top)]
    return trimesh.creation.revolve([(0, -h), *bottom, *top, (0, h)], sections=32)


def head() -> trimesh.Trimesh:
    """Return head and neck: a narrow chin, a smooth face to the front (+y)."""
    skull = loft(
        [
            (0.128, 0.022, 0.028, 0.0, 0.062),
            (0.133, 0.036, 0.042, 0.0, 0.056),
            (0.150, 0.049, 0.060, 0.0, 0.047),
            (0.185, 0.064, 0.083, 0.0, 0.033),
            (0.235, 0.075, 0.099, 0.0, 0.022),
            (0.285, 0.076, 0.101, 0.0, 0.018),
            (0.325, 0.063, 0.085, 0.0, 0.016),
            (0.345, 0.041, 0.056, 0.0, 0.015),
            (0.352, 0.014, 0.020, 0.0, 0.015),
        ],
        roundness=2.2,
        rings=26,
    )
    neck = loft(
        [
            (0.060, 0.066, 0.062, 0.0, 0.008),
            (0.090, 0.053, 0.053, 0.0, 0.010),
            (0.130, 0.047, 0.050, 0.0, 0.013),
            (0.200, 0.047, 0.050, 0.0, 0.020),
        ],
        rings=10,
        sides=24,
    )
    ears = rod(0.024, [-0.079, 0.012, 0.235], [0.079, 0.012, 0.235])
    return trimesh.util.concatenate([skull, neck, ears])


def collar() -> trimesh.Trimesh:
    """Return what slopes from the shoulders to the neck."""
    return loft(
        [
            (0.000, 0.147, 0.109, 0.0, 0.027),
            (0.012, 0.147, 0.109, 0.0, 0.026),
            (0.035, 0.133, 0.094, 0.0, 0.024),
            (0.060, 0.098, 0.078, 0.0, 0.016),
            (0.078, 0.070, 0.064, 0.0, 0.010),
            (0.083, 0.060, 0.056, 0.0, 0.010),
        ],
        roundness=2.6,
        rings=16,
    )


def body() -> trimesh.Trimesh:
    """Return the chest, with a shield in front, and the hips."""
    chest = loft(
        [
            (-0.232, 0.092, 0.066, 0.0, 0.024),
            (-0.226, 0.108, 0.082, 0.0, 0.026),
            (-0.190, 0.124, 0.101, 0.0, 0.026),
            (-0.130, 0.142, 0.117, 0.0, 0.028),
            (-0.070, 0.152, 0.122, 0.0, 0.028),
            (-0.022, 0.153, 0.117, 0.0, 0.027),
            (-0.006, 0.149, 0.110, 0.0, 0.027),
            (-0.001, 0.140, 0.101, 0.0, 0.027),
        ],
        roundness=2.9,
    )
    shield = loft(
        [
            (-0.185, 0.048, 0.010, 0.0, 0.119),
            (-0.180, 0.066, 0.014, 0.0, 0.119),
            (-0.130, 0.102, 0.020, 0.0, 0.127),
            (-0.075, 0.119, 0.025, 0.0, 0.131),
            (-0.030, 0.116, 0.023, 0.0, 0.129),
            (-0.024, 0.100, 0.016, 0.0, 0.128),
        ],
        roundness=3.0,
        rings=14,
        sides=24,
    )
    hips = loft(
        [
            (-0.4365, 0.060, 0.050, 0.0, 0.016),
            (-0.4300, 0.076, 0.066, 0.0, 0.016),
            (-0.3950, 0.104, 0.082, 0.0, 0.018),
            (-0.3550, 0.120, 0.090, 0.0, 0.020),
            (-0.3300, 0.118, 0.088, 0.0, 0.020),
            (-0.3230, 0.104, 0.076, 0.0, 0.020),
        ],
        roundness=2.6,
        rings=14,
    )
    return trimesh.util.concatenate([chest, shield, hips])


def waist() -> trimesh.Trimesh:
    """Return the belly between chest and hips, in four ribs."""
    ribs = []
    for low in (-0.330, -0.303, -0.276, -0.249):
        ribs.append(
            loft(
                [
                    (low, 0.092, 0.068, 0.0, 0.021),
                    (low + 0.005, 0.101, 0.077, 0.0, 0.021),
                    (low + 0.021, 0.102, 0.078, 0.0, 0.022),
                    (low + 0.027, 0.092, 0.068, 0.0, 0.022),
                ],
                roundness=2.5,
                rings=6,
            )
        )
    return trimesh.util.concatenate(ribs)


def shoulder() -> trimesh.Trimesh:
    """Return the drum about the arm's axis (z), and its axle to the body (-x)."""
    axle = rod(0.034, [-0.0686, 0, 0], [0, 0, 0])
    flange = rod(0.041, [-0.0600, 0, 0], [-0.048, 0, 0])
    hub = rod(0.030, [0, 0, -0.0635], [0, 0, 0.0635])
    return trimesh.util.concatenate([drum(0.0508, 0.118, 0.014), axle, flange, hub])


def arm_upper() -> trimesh.Trimesh:
    """Return the upper arm: -y from the shoulder to a fork about the elbow (x)."""
    sleeve = loft(
        [
            (0.030, 0.030, 0.030, 0.0, 0.0),
            (0.055, 0.045, 0.045, 0.0, 0.0),
            (0.110, 0.0475, 0.0475, 0.0, 0.0),
            (0.180, 0.044, 0.046, 0.0, 0.0),
            (0.250, 0.041, 0.040, 0.0, 0.0),
            (0.296, 0.041, 0.034, 0.0, 0.0),
            (0.306, 0.037, 0.026, 0.0, 0.0),
        ],
        roundness=2.3,
        rings=18,
        sides=28,
    ).apply_transform(DOWN_Y)
    pieces = [sleeve, ball(0.047, [0, 0, 0])]
    for sign in (-1, 1):
        inner, outer = sign * 0.030, sign * 0.043
        pieces.append(rod(0.028, [inner, -0.358, 0], [outer, -0.358, 0]))
        pieces.append(rod(0.015, [outer, -0.358, 0], [sign * 0.048, -0.358, 0]))
        cheek = loft(
            [
                (0.285, 0.0065, 0.034, sign * 0.0365, 0.0),
                (0.305, 0.0065, 0.034, sign * 0.0365, 0.0),
                (0.330, 0.0065, 0.027, sign * 0.0365, 0.0),
                (0.358, 0.0065, 0.027, sign * 0.0365, 0.0),
            ],
            roundness=8.0,
            rings=6,
            sides=16,
        )
        pieces.append(cheek.apply_transform(DOWN_Y))
    return trimesh.util.concatenate(pieces)


def arm_lower() -> trimesh.Trimesh:
    """Return the forearm: -y from a hub about the elbow (z) to the wrist."""
    sleeve = loft(
        [
            (0.016, 0.022, 0.025, 0.0, 0.0),
            (0.034, 0.031, 0.030, 0.0, 0.0),
            (0.060, 0.036, 0.034, 0.0, 0.0),
            (0.100, 0.038, 0.037, 0.0, 0.0),
            (0.170, 0.035, 0.035, 0.0, 0.0),
            (0.250, 0.030, 0.031, 0.0, 0.0),
            (0.300, 0.027, 0.029, 0.0, 0.0),
            (0.306, 0.023, 0.025, 0.0, 0.0),
        ],
        roundness=2.4,
        rings=18,
        sides=28,
    ).apply_transform(DOWN_Y)
    hub = rod(0.0265, [0, 0, -0.029], [0, 0, 0.029])
    wrist = rod(0.019, [0, -0.300, 0], [0, -0.330, 0])
    cuff = rod(0.026, [0, -0.326, 0], [0, -0.339, 0])
    return trimesh.util.concatenate([sleeve, hub, wrist, cuff])


def bone(start: Point, end: Point, radius: float) -> list[trimesh.Trimesh]:
    """Return a piece of a finger, and the knuckle at its end."""
    knuckle = uv_sphere(radius=radius * 1.05, count=[5, 10])
    return [
        cylinder(radius=radius, segment=[start, end], sections=10),
        knuckle.apply_translation(end),
    ]


def finger(y: float, z: float, lengths: tuple[float, ...]) -> list[trimesh.Trimesh]:
    """Return three phalanges from the palm's edge, bent a little to the palm (-x)."""
    pieces, at, bend = [], np.array([0.0, y, z]), 0.15
    for length, radius in zip(lengths, (0.0092, 0.0086, 0.0078), strict=True):
        end = at + length * np.array([-np.sin(bend), 0.0, np.cos(bend)])
        pieces += bone(at, end, radius)
        at, bend = end, bend + 0.35
    return pieces


def hand(side: int) -> trimesh.Trimesh:
    """Return a hand along z, palm to -x, thumb to the side (1 is +y, -1 is -y)."""
    palm = loft(
        [
            (0.000, 0.020, 0.023, 0.0, 0.0),
            (0.010, 0.021, 0.025, 0.0, 0.0),
            (0.030, 0.017, 0.032, 0.0, 0.004),
            (0.060, 0.015, 0.039, 0.0, 0.008),
            (0.080, 0.014, 0.040, 0.0, 0.008),
            (0.086, 0.009, 0.036, 0.0, 0.008),
        ],
        roundness=3.0,
        rings=14,
        sides=24,
    )
    pieces = [palm]
    pieces += finger(-0.0225, 0.080, (0.026, 0.017, 0.014))
    pieces += finger(-0.0025, 0.082, (0.031, 0.021, 0.017))
    pieces += finger(0.0180, 0.083, (0.033, 0.023, 0.018))
    pieces += finger(0.0385, 0.080, (0.030, 0.020, 0.016))
    thumb = [
        (0.000, 0.024, 0.026),
        (-0.014, 0.047, 0.052),
        (-0.026, 0.056, 0.077),
        (-0.034, 0.058, 0.099),
    ]
    for (start, end), radius in zip(
        itertools.pairwise(thumb), (0.013, 0.011, 0.009), strict=True
    ):
        pieces += bone(start, end, radius)
    mesh = trimesh.util.concatenate(pieces)
    if side < 0:
        mesh.apply_transform(np.diag([1.0, -1.0, 1.0, 1.0]))
    return mesh


def main() -> None:
    """Write all meshes."""
    meshes = {
        "head": head(),
        "collar": collar(),
        "body": body(),
        "waist": waist(),
        "shoulder": shoulder(),
        "arm_upper": arm_upper(),
        "arm_lower": arm_lower(),
        "hand_right": hand(-1),
        "hand_left": hand(1),
    }
    for name, mesh in meshes.items():
        path = FOLDER / f"{name}.STL"
        path.write_bytes(trimesh.exchange.stl.export_stl(mesh))
        print(f"{path.name}: {len(mesh.faces)} triangles")


if __name__ == "__main__":
    main()
