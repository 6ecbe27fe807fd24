"""Make the Doosan's meshes: `python models/doosan_a0912/meshes/make_meshes.py`.

One COLLADA file for each link, in metres and in the link's axes, with its colours;
links with paint have one for each paint. Sizes and profiles are those of the published
meshes, measured on them; the shapes are ours: revolved profiles, and bodies that blend
into each other as castings do.
"""

import datetime
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import collada
import numpy as np
import trimesh
from collada import source
from trimesh.transformations import rotation_matrix

FOLDER = Path(__file__).parent

# Diffuse colours. Blue is the published one; white, and the rings on it, are ours.
PAINTS = {
    "blue": {"body": (0.138, 0.188, 0.238), "ring": (0.65, 0.65, 0.65)},
    "white": {"body": (0.8, 0.81, 0.82), "ring": (0.22, 0.23, 0.24)},
}
BARE = {
    "base": (0.4, 0.4, 0.4),
    "ring": (0.65, 0.65, 0.65),
    "steel": (0.2, 0.2, 0.21),
    "dark": (0.1, 0.11, 0.12),
    "mark": (0.8, 0.8, 0.8),
}

# Edges of the cubes in which blended bodies are found [m].
CELL = 0.0105

Point = Sequence[float]
Array = np.ndarray

# Distance from a surface, negative inside: points of shape (n, 3) to (n,) [m].
Distance = Callable[[Array], Array]


class Piece(NamedTuple):
    """Triangles with normals."""

    vertices: Array  # Shape (n, 3) [m].
    faces: Array  # Shape (m, 3).
    normals: Array  # Shape (n, 3).


# Pieces of a link by their colour; those without normals get them from their triangles.
Parts = dict[str, list[Piece | trimesh.Trimesh]]

# Turns a piece that was made along z.
Z_TO_Y = rotation_matrix(-np.pi / 2, [1, 0, 0])
Z_TO_X = rotation_matrix(np.pi / 2, [0, 1, 0])


def revolved(profile: list[tuple[float, float]], sides: int = 48) -> trimesh.Trimesh:
    """Return a closed body around z: rows of z and radius, z increasing."""
    outline = [(0.0, profile[0][0]), *((r, z) for z, r in profile if r > 0.0)]
    return trimesh.creation.revolve([*outline, (0.0, profile[-1][0])], sections=sides)


def moved(
    piece: trimesh.Trimesh, turn: Array | None = None, to: Point = (0.0, 0.0, 0.0)
) -> trimesh.Trimesh:
    """Return a piece, turned about the origin and then moved."""
    if turn is not None:
        piece.apply_transform(turn)
    return piece.apply_translation(to)


def turned(start: Point, end: Point, radii: Point, edge: float) -> Distance:
    """Return a body on the lathe, with rounded edges.

    Args:
        start: Middle of one of its ends.
        end: Of the other one.
        radii: Evenly from the one to the other.
        edge: Radius of its edges.
    """
    a, b = np.array(start, float), np.array(end, float)
    length = np.linalg.norm(b - a)
    axis = (b - a) / length
    places = np.linspace(0.0, length, len(radii))

    def distance(points: Array) -> Array:
        along = (points - a) @ axis
        across = np.linalg.norm(points - a - along[:, None] * axis, axis=1)
        radius = np.interp(along, places, radii)
        over = np.abs(along - length / 2) - length / 2
        out = np.stack([across - radius + edge, over + edge], axis=1)
        outside = np.linalg.norm(np.maximum(out, 0.0), axis=1)
        return outside + np.minimum(out.max(axis=1), 0.0) - edge

    return distance


def below(distance: Distance, point: Point, normal: Point) -> Distance:
    """Return what is left of a body below a plane."""
    return lambda points: np.maximum(
        distance(points), (points - np.array(point)) @ np.array(normal)
    )


def collar(start: float, end: float, radius: float) -> trimesh.Trimesh:
    """Return the crisp end of a barrel along z: blended bodies have none."""
    low, high = sorted((start, end))
    return revolved([(low, radius), (high, radius)])


def blended(width: float, *distances: Distance) -> Distance:
    """Return the union of bodies, with fillets about as wide as ``width``."""

    def distance(points: Array) -> Array:
        result = distances[0](points)
        for other in distances[1:]:
            d = other(points)
            close = np.maximum(width - np.abs(result - d), 0.0)
            result = np.minimum(result, d) - close**2 / (4.0 * width)
        return result

    return distance


def surface(distance: Distance, low: Point, high: Point) -> Piece:
    """Return the surface of a body within a box: surface nets, then pulled onto it."""
    axes = [
        np.arange(a - CELL, b + 2 * CELL, CELL) for a, b in zip(low, high, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    shape = grid.shape[:3]
    value = distance(grid.reshape(-1, 3)).reshape(shape)
    inside = value < 0.0

    # A vertex in each cube that the surface crosses.
    corners = [
        inside[x : x + shape[0] - 1, y : y + shape[1] - 1, z : z + shape[2] - 1]
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
    ]
    count = np.sum(corners, axis=0)
    crossed = (count > 0) & (count < 8)
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(crossed.sum())
    vertices = grid[:-1, :-1, :-1][crossed] + CELL / 2

    # A square across each edge of the grid that the surface crosses.
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        first = np.take(inside, range(shape[axis] - 1), axis)
        second = np.take(inside, range(1, shape[axis]), axis)
        for at in np.argwhere(first != second):
            if at[u] == 0 or at[v] == 0:
                continue
            square = []
            for du, dv in ((1, 1), (0, 1), (0, 0), (1, 0)):
                cube = at.copy()
                cube[u] -= du
                cube[v] -= dv
                square.append(number[tuple(cube)])
            if not inside[tuple(at)]:
                square.reverse()
            a, b, c, d = square
            faces += [[a, b, c], [a, c, d]]

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    edges = mesh.edges_unique
    neighbors = np.bincount(edges.ravel(), minlength=len(vertices))[:, None]
    for turn in range(12):
        if turn < 8:  # Even triangles, before the last ones make them exact.
            total = np.zeros_like(vertices)
            np.add.at(total, edges[:, 0], vertices[edges[:, 1]])
            np.add.at(total, edges[:, 1], vertices[edges[:, 0]])
            vertices += 0.5 * (total / neighbors - vertices)
        slope = gradient(distance, vertices)
        size = np.maximum((slope**2).sum(axis=1), 0.25)
        vertices -= (0.8 * distance(vertices) / size)[:, None] * slope
    normals = gradient(distance, vertices)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Piece(vertices, mesh.faces, normals)


def gradient(distance: Distance, points: Array) -> Array:
    """Return how a distance changes with the points, shape (n, 3)."""
    steps = 1e-4 * np.eye(3)
    return np.stack(
        [(distance(points + d) - distance(points - d)) / 2e-4 for d in steps], axis=1
    )


def shaded(mesh: trimesh.Trimesh, sharp: float = 0.65) -> Piece:
    """Return a mesh with normals: smooth but at edges sharper than an angle [rad]."""
    normals, corners = mesh.face_normals, mesh.face_angles
    around = mesh.vertex_faces
    result = np.zeros((len(mesh.faces), 3, 3))
    for face, vertices in enumerate(mesh.faces):
        for corner, vertex in enumerate(vertices):
            others = around[vertex][around[vertex] >= 0]
            close = others[normals[others] @ normals[face] > np.cos(sharp)]
            weights = (corners * (mesh.faces == vertex))[close].sum(axis=1)
            result[face, corner] = weights @ normals[close]
    result /= np.linalg.norm(result, axis=2, keepdims=True)
    rows = np.hstack([mesh.triangles.reshape(-1, 3), result.reshape(-1, 3)])
    rows, faces = np.unique(rows.round(6), axis=0, return_inverse=True)
    return Piece(rows[:, :3], faces.reshape(-1, 3), rows[:, 3:])


def swept(rows: list[tuple[float, float, float]], sides: int = 32) -> trimesh.Trimesh:
    """Return a bent tube in the y-z plane: rows of z, y and radius, z increasing."""
    z, y, radius = np.array(rows).T
    slope = np.gradient(y, z)
    across = np.stack([np.ones_like(slope), -slope], axis=1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    u, v = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    ring = np.stack(
        [u, y[:, None] + v * across[:, :1], z[:, None] + v * across[:, 1:]], axis=2
    )
    return closed(ring)


def closed(rings: Array) -> trimesh.Trimesh:
    """Return the body through rings of points, shape (rings, sides, 3), from below."""
    count, sides, _ = rings.shape
    ends = [rings[0].mean(axis=0), rings[-1].mean(axis=0)]
    here = np.arange(sides)
    there = (here + 1) % sides
    faces = []
    for low in range(0, (count - 1) * sides, sides):
        high = low + sides
        faces += [np.stack([low + here, low + there, high + there], axis=1)]
        faces += [np.stack([low + here, high + there, high + here], axis=1)]
    bottom, last = np.full(sides, count * sides), (count - 1) * sides
    faces += [np.stack([bottom, there, here], axis=1)]
    faces += [np.stack([bottom + 1, last + here, last + there], axis=1)]
    return trimesh.Trimesh(np.vstack([rings.reshape(-1, 3), ends]), np.vstack(faces))


def base_0() -> Parts:
    """Return the foot: a bolted plate that rises into a column, the cable's plug."""
    rows = [  # z, radius to the sides and to the corners.
        (0.003, 0.0800, 0.1180),
        (0.004, 0.0810, 0.1190),
        (0.011, 0.0810, 0.1190),
        (0.013, 0.0815, 0.1165),
        (0.017, 0.0818, 0.1030),
        (0.023, 0.0815, 0.0920),
        (0.032, 0.0808, 0.0850),
        (0.045, 0.0802, 0.0815),
        (0.060, 0.0797, 0.0800),
        (0.085, 0.0788, 0.0788),
        (0.112, 0.0777, 0.0777),
        (0.114, 0.0760, 0.0760),
    ]
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)

    def outline(z: float, side: float, corner: float) -> Array:
        radius = side + (corner - side) * np.sin(2.0 * angle) ** 2
        return np.stack(
            [radius * np.cos(angle), radius * np.sin(angle), np.full(72, z)], axis=1
        )

    foot = closed(np.array([outline(*row) for row in rows]))
    pad = closed(np.array([outline(z, 0.0810, 0.1190) for z in (0.0, 0.0035)]))
    socket = revolved([(-0.088, 0.0160), (-0.086, 0.0175), (-0.07, 0.0175)], 24)
    plug = revolved([(-0.1105, 0.0110), (-0.109, 0.0125), (-0.08, 0.0125)], 24)
    bolts = [
        moved(
            revolved([(0.008, 0.0070), (0.0165, 0.0070), (0.0175, 0.0060)], 16), to=to
        )
        for x in (-0.0745, 0.0745)
        for y in (-0.0745, 0.0745)
        for to in [(x, y, 0.0)]
    ]
    return {
        "base": [foot, moved(socket, Z_TO_Y, (0.0, 0.0, 0.06))],
        "ring": [moved(plug, Z_TO_Y, (0.0, 0.0, 0.06))],
        "dark": [pad, *bolts],
    }


def link1() -> Parts:
    """Return the shoulder: a column under a slanted cap, and joint 2 to the side."""
    up = np.array([0.0, -np.sin(0.29), np.cos(0.29)])
    middle = np.array([0.0, -0.01, 0.112])
    slanted = rotation_matrix(0.29, [1, 0, 0])
    column = turned(
        (0, 0, -0.077), (0, 0, 0.062), (0.0790, 0.0790, 0.0785, 0.0765), 0.012
    )
    neck = turned(
        middle - 0.07 * up, middle + 0.02 * up, (0.0680, 0.0705, 0.0650, 0.0555), 0.010
    )
    casting = blended(
        0.035,
        blended(0.02, column, below(neck, middle + 0.012 * up, up)),
        turned((0, 0, 0), (0, 0.0815, 0), (0.0770, 0.0780), 0.010),
    )
    ring = revolved(
        [(-0.004, 0.0630), (-0.003, 0.0645), (0.007, 0.0645), (0.0085, 0.063)]
    )
    cap = revolved(
        [(0.006, 0.0595), (0.015, 0.0590), (0.018, 0.056), (0.020, 0.048), (0.021, 0.0)]
    )
    flange = revolved(
        [(0.080, 0.077), (0.0835, 0.0779), (0.0985, 0.0779), (0.0995, 0.077)]
    )
    return {
        "body": [
            surface(casting, (-0.083, -0.083, -0.079), (0.083, 0.084, 0.135)),
            collar(-0.080, -0.062, 0.0795),
            moved(collar(0.0700, 0.0835, 0.0784), Z_TO_Y),
            moved(cap, slanted, middle),
        ],
        "ring": [moved(ring, slanted, middle), moved(flange, Z_TO_Y)],
    }


def link2() -> Parts:
    """Return the upper arm: along x, beside the shoulder in z."""
    z = 0.1415
    lower = blended(
        0.022,
        turned((0, 0, 0.0630), (0, 0, 0.202), (0.0780, 0.0793, 0.0780), 0.010),
        turned((0, 0, z), (0.100, 0, z), (0.0730, 0.0750, 0.0760), 0.010),
    )
    lower_lid = revolved(
        [
            (0.196, 0.0755),
            (0.201, 0.0755),
            (0.203, 0.0743),
            (0.220, 0.0718),
            (0.233, 0.0695),
            (0.245, 0.0658),
            (0.255, 0.0600),
            (0.264, 0.0500),
            (0.271, 0.0370),
            (0.276, 0.0200),
            (0.279, 0.0),
        ]
    )
    tube = revolved(
        [
            (0.0835, 0.0765),
            (0.0850, 0.0780),
            (0.0950, 0.0770),
            (0.1050, 0.0735),
            (0.1150, 0.0690),
            (0.1250, 0.0640),
            (0.1350, 0.0590),
            (0.1450, 0.0550),
            (0.1550, 0.0520),
            (0.1680, 0.0503),
            (0.1850, 0.0500),
            (0.4150, 0.0500),
            (0.4350, 0.0506),
            (0.4500, 0.0525),
            (0.4650, 0.0555),
            (0.4780, 0.0578),
            (0.4945, 0.0590),
            (0.4960, 0.0580),
        ]
    )
    upper = blended(
        0.018,
        turned((0.56, 0, 0.082), (0.56, 0, 0.191), (0.0590, 0.0607, 0.0590), 0.010),
        turned((0.480, 0, z), (0.56, 0, z), (0.0578, 0.0575, 0.0560), 0.010),
    )
    upper_lid = revolved(
        [
            (0.186, 0.0585),
            (0.191, 0.0585),
            (0.193, 0.0573),
            (0.205, 0.0556),
            (0.215, 0.0535),
            (0.225, 0.0500),
            (0.234, 0.0445),
            (0.242, 0.0350),
            (0.248, 0.0200),
            (0.2509, 0.0),
        ]
    )
    return {
        "body": [
            surface(lower, (-0.084, -0.086, 0.06), (0.104, 0.086, 0.23)),
            collar(0.0615, 0.078, 0.0784),
            lower_lid,
            moved(tube, Z_TO_X, (0.0, 0.0, z)),
            surface(upper, (0.476, -0.066, 0.079), (0.626, 0.066, 0.215)),
            moved(collar(0.0805, 0.094, 0.0595), to=(0.56, 0.0, 0.0)),
            moved(upper_lid, to=(0.56, 0.0, 0.0)),
        ],
        "mark": [mark(z)],
    }


def mark(z: float) -> trimesh.Trimesh:
    """Return a light stripe along the tube where the maker's name stands."""
    across, along = np.linspace(-0.15, 0.15, 7), (0.3075, 0.3095, 0.4205, 0.4225)
    rings = []
    for x in along:
        wide = across * (0.7 if x in (along[0], along[-1]) else 1.0) - np.pi / 2
        outer = [(x, 0.0506 * np.sin(t), z + 0.0506 * np.cos(t)) for t in wide]
        inner = [(x, 0.0490 * np.sin(t), z + 0.0490 * np.cos(t)) for t in wide[::-1]]
        rings.append(outer + inner)
    return closed(np.array(rings)[:, ::-1])


def lid(rows: list[tuple[float, float]]) -> trimesh.Trimesh:
    """Return a cap that closes a barrel along y."""
    return moved(revolved(rows, 40), Z_TO_Y)


def link3() -> Parts:
    """Return the elbow: joint 3 to one side, joint 4 below, a cap on top."""
    casting = blended(
        0.03,
        turned((0, -0.0570, 0), (0, 0.0585, 0), (0.0465, 0.0490, 0.0480), 0.010),
        turned((0, 0, 0.010), (0, 0, 0.0620), (0.0540, 0.0572), 0.010),
    )
    cap = [
        (0.055, 0.0475),
        (0.061, 0.0475),
        (0.063, 0.0465),
        (0.072, 0.0438),
        (0.080, 0.0400),
        (0.087, 0.0345),
        (0.093, 0.0255),
        (0.0984, 0.0),
    ]
    ring = revolved(
        [(0.0615, 0.0575), (0.063, 0.0587), (0.0785, 0.0587), (0.0795, 0.0575)]
    )
    return {
        "body": [
            surface(casting, (-0.062, -0.062, -0.054), (0.062, 0.064, 0.066)),
            collar(0.040, 0.064, 0.0577),
            lid(cap),
        ],
        "ring": [ring],
    }


def link4() -> Parts:
    """Return the forearm: an S from the elbow, on the z axis, to beside the wrist."""
    bend = swept(
        [  # z, y, radius.
            (-0.4573, 0.0000, 0.0440),
            (-0.4560, 0.0000, 0.0452),
            (-0.4350, 0.0000, 0.0424),
            (-0.4150, 0.0008, 0.0408),
            (-0.3950, 0.0030, 0.0402),
            (-0.3750, 0.0072, 0.0397),
            (-0.3550, 0.0133, 0.0393),
            (-0.3350, 0.0209, 0.0391),
            (-0.3150, 0.0299, 0.0388),
            (-0.2950, 0.0396, 0.0384),
            (-0.2750, 0.0497, 0.0380),
            (-0.2550, 0.0598, 0.0375),
            (-0.2350, 0.0700, 0.0370),
            (-0.2150, 0.0803, 0.0363),
            (-0.1950, 0.0901, 0.0355),
            (-0.1750, 0.1000, 0.0349),
            (-0.1550, 0.1088, 0.0347),
            (-0.1350, 0.1153, 0.0355),
            (-0.1150, 0.1195, 0.0373),
            (-0.0950, 0.1218, 0.0396),
            (-0.0750, 0.1224, 0.0421),
            (-0.0550, 0.1222, 0.0450),
            (-0.0500, 0.1222, 0.0445),
        ]
    )
    wrist = blended(
        0.022,
        turned((0, 0.0655, 0), (0, 0.1685, 0), (0.0450, 0.0500, 0.0490), 0.010),
        turned((0, 0.1222, -0.070), (0, 0.1222, 0), (0.0420, 0.0460, 0.0450), 0.010),
    )
    cap = [
        (0.160, 0.0482),
        (0.167, 0.0482),
        (0.169, 0.0470),
        (0.180, 0.0453),
        (0.190, 0.0428),
        (0.200, 0.0385),
        (0.208, 0.0320),
        (0.215, 0.0210),
        (0.2191, 0.0),
    ]
    return {
        "body": [
            bend,
            surface(wrist, (-0.057, 0.062, -0.075), (0.057, 0.173, 0.057)),
            moved(revolved([(0.0640, 0.0462), (0.0820, 0.0480)]), Z_TO_Y),
            lid(cap),
        ]
    }


def link5() -> Parts:
    """Return the wrist: joint 5 to one side, joint 6 below, a cap on top."""
    casting = blended(
        0.025,
        turned((0, -0.0565, 0), (0, 0.0510, 0), (0.0445, 0.0495, 0.0490), 0.010),
        turned((0, 0, 0.010), (0, 0, 0.0500), (0.0450, 0.0453), 0.010),
    )
    cap = [
        (0.042, 0.0485),
        (0.049, 0.0485),
        (0.051, 0.0473),
        (0.062, 0.0450),
        (0.072, 0.0420),
        (0.081, 0.0375),
        (0.088, 0.0315),
        (0.094, 0.0210),
        (0.0978, 0.0),
    ]
    ring = revolved(
        [(0.0500, 0.0440), (0.0512, 0.0450), (0.0622, 0.0450), (0.063, 0.0440)]
    )
    return {
        "body": [
            surface(casting, (-0.055, -0.062, -0.055), (0.055, 0.056, 0.057)),
            collar(0.035, 0.0512, 0.0458),
            moved(collar(-0.058, -0.045, 0.0450), Z_TO_Y),
            lid(cap),
        ],
        "ring": [ring],
    }


def link6() -> Parts:
    """Return the tool flange: its face is the plane z = 0."""
    body = revolved(
        [
            (-0.0650, 0.0420),
            (-0.0640, 0.0432),
            (-0.0480, 0.0428),
            (-0.0450, 0.0412),
            (-0.0410, 0.0375),
            (-0.0380, 0.0362),
            (-0.0080, 0.0355),
            (-0.0065, 0.0345),
        ]
    )
    face = revolved([(-0.0080, 0.0315), (-0.0008, 0.0315), (0.0000, 0.0305)])
    groove = revolved(
        [(-0.029, 0.0350), (-0.028, 0.0366), (-0.025, 0.0366), (-0.024, 0.035)]
    )
    button = trimesh.creation.box([0.018, 0.005, 0.008])
    holes = [
        moved(revolved([(-0.004, 0.0035), (0.0, 0.0035)], 12), to=(x, y, 0.00005))
        for x, y in ((0.025, 0.0), (0.0, 0.025), (-0.025, 0.0), (0.0, -0.025))
    ]
    return {
        "ring": [body],
        "steel": [face],
        "dark": [groove, moved(button, to=(0.0, 0.0408, -0.055)), *holes],
    }


def encode(
    parts: Parts, colors: dict[str, tuple[float, float, float]]
) -> collada.Collada:
    """Return a COLLADA document: one geometry and one material for each colour."""
    document = collada.Collada()
    document.assetInfo.unitname, document.assetInfo.unitmeter = "meter", 1.0
    document.assetInfo.upaxis = collada.asset.UP_AXIS.Z_UP
    # The same bytes each time.
    day = datetime.datetime(2026, 1, 1)
    document.assetInfo.created = document.assetInfo.modified = day
    nodes = []
    for name, pieces in parts.items():
        effect = collada.material.Effect(
            f"{name}_effect", [], "lambert", diffuse=(*colors[name], 1.0)
        )
        material = collada.material.Material(f"{name}_material", name, effect)
        document.effects.append(effect)
        document.materials.append(material)

        ready = [p if isinstance(p, Piece) else shaded(p) for p in pieces]
        starts = np.cumsum([0, *(len(piece.vertices) for piece in ready)])
        faces = np.vstack([p.faces + n for p, n in zip(ready, starts, strict=False)])
        values = {
            "positions": np.vstack([piece.vertices for piece in ready]).round(5),
            "normals": np.vstack([piece.normals for piece in ready]).round(3),
        }
        sources = [
            source.FloatSource(f"{name}_{key}", value.ravel() + 0.0, ("X", "Y", "Z"))
            for key, value in values.items()
        ]
        geometry = collada.geometry.Geometry(document, name, name, sources)
        # Both have the same numbers, so one list of them does.
        inputs = source.InputList()
        inputs.addInput(0, "VERTEX", f"#{name}_positions")
        inputs.addInput(0, "NORMAL", f"#{name}_normals")
        triangles = geometry.createTriangleSet(faces.ravel(), inputs, name)
        geometry.primitives.append(triangles)
        document.geometries.append(geometry)
        bound = collada.scene.MaterialNode(name, material, inputs=[])
        nodes.append(collada.scene.GeometryNode(geometry, [bound]))
    root = collada.scene.Node("link", children=nodes)
    scene = collada.scene.Scene("scene", [root])
    document.scenes.append(scene)
    document.scene = scene
    return document


def documents() -> dict[str, collada.Collada]:
    """Return all meshes by their files."""
    links = {"link1": link1, "link2": link2, "link3": link3, "link4": link4}
    painted = {name: make() for name, make in (links | {"link5": link5}).items()}
    return {
        "base_0.dae": encode(base_0(), BARE),
        "link6.dae": encode(link6(), BARE),
        **{
            f"{paint}/{name}.dae": encode(parts, BARE | colors)
            for paint, colors in PAINTS.items()
            for name, parts in painted.items()
        },
    }


def main() -> None:
    """Write all meshes."""
    for name, document in documents().items():
        path = FOLDER / name
        path.parent.mkdir(exist_ok=True)
        document.write(str(path))
        print(f"{name}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
