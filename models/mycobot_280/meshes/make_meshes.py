"""Makes the meshes of the myCobot 280 and of its gripper: `python make_meshes.py`.

One COLLADA file for each link, in metres and in the link's own frame, Z up, with a
material for each colour. The same version of pycollada writes the same bytes. The
dimensions are those of the published meshes' bounding boxes and of the joints between
them (README.md); the shapes are ours.
"""

import datetime as dt
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import collada
import numpy as np
from collada import asset, geometry, material, scene, source
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MM = 1e-3

COLORS = {
    "white": (0.93, 0.94, 0.95),
    "silver": (0.72, 0.74, 0.76),
    "grey": (0.36, 0.38, 0.41),
    "dark": (0.10, 0.10, 0.11),
    "blue": (0.05, 0.35, 0.75),
    "green": (0.10, 0.70, 0.35),
}

# Edges of a round thing, and of a quarter round edge.
AROUND = 32
EDGE = 3

# Faces that meet at less than this are one smooth surface [rad].
SMOOTH = np.radians(40.0)


class Part(NamedTuple):
    """Triangles of one colour [mm]: corners (n, 3), and (m, 3) indices of them."""

    color: str
    points: Array
    faces: NDArray[np.int64]

    def moved(self, xyz: ArrayLike = (0, 0, 0), rpy: ArrayLike = (0, 0, 0)) -> "Part":
        """Return it turned about the fixed axes [degrees], then shifted [mm]."""
        return self._replace(points=self.points @ rotation(rpy).T + np.asarray(xyz))

    def mirrored(self) -> "Part":
        """Return its image in the y-z plane."""
        return self._replace(points=self.points * [-1, 1, 1], faces=self.faces[:, ::-1])


def rotation(rpy: ArrayLike) -> Array:
    """Return the rotation matrix of roll, pitch and yaw [degrees]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(rpy)), np.sin(np.radians(rpy))
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


def loft(color: str, rings: Sequence[Array]) -> Part:
    """Return a solid between rings of as many points each, closed with fans."""
    count, length = len(rings), len(rings[0])
    points = [*rings, rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]]
    faces = []
    first, last = count * length, count * length + 1
    for j in range(length):
        k = (j + 1) % length
        faces += [(first, k, j), (last, last - 1 - length + j, last - 1 - length + k)]
        for i in range(count - 1):
            a, b = i * length, (i + 1) * length
            faces += [(a + j, a + k, b + k), (a + j, b + k, b + j)]
    return Part(color, np.vstack(points), np.array(faces))


def tube(
    color: str, corners: Iterable[ArrayLike], radius: float, bend: float = 0.0
) -> Part:
    """Return a round tube along a line, whose corners are bent with a radius."""
    nodes = [np.asarray(corner, dtype=float) for corner in corners]
    path = [nodes[0]]
    for before, node, after in zip(nodes, nodes[1:], nodes[2:], strict=False):
        # The bends of the arm are right angles.
        to, away = (before - node), (after - node)
        to, away = to / np.linalg.norm(to), away / np.linalg.norm(away)
        center = node + bend * (to + away)
        for angle in np.linspace(0.0, np.pi / 2, 10):
            path.append(center - bend * (away * np.cos(angle) + to * np.sin(angle)))
    path.append(nodes[-1])
    along = np.gradient(np.array(path), axis=0)
    # The first and last cut are square.
    along[0], along[-1] = path[1] - path[0], path[-1] - path[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # A line in a plane: its normal is across every cut.
    normal = np.cross(along[0], along[len(along) // 2])
    if np.linalg.norm(normal) < 1e-6:
        normal = np.cross(along[0], [1, 0, 0] if abs(along[0][0]) < 0.9 else [0, 1, 0])
    normal /= np.linalg.norm(normal)
    turns = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)[:, None]
    rings = [
        p + radius * (np.cos(turns) * normal + np.sin(turns) * np.cross(t, normal))
        for p, t in zip(path, along, strict=True)
    ]
    return loft(color, rings)


def turned(
    color: str, profile: Iterable[tuple[float, float]], around: int = AROUND
) -> Part:
    """Return what turns about z: radius and height, from below to above."""
    turns = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns), np.zeros(around)], axis=1)
    return loft(color, [circle * r + [0, 0, z] for r, z in profile])


def pillow(
    color: str,
    centers: Sequence[tuple[float, float]],
    radius: float,
    heights: tuple[float, float],
    edge: float = 0.0,
    taper: float = 0.0,
) -> Part:
    """Return a plate with round corners and edges, from one height to another.

    Args:
        color: Its colour.
        centers: Centres of its round corners [mm], counterclockwise; two of them make
            a bar.
        radius: Radius of the corners [mm].
        heights: Where it starts and ends along z [mm].
        edge: Radius of the edges [mm].
        taper: By how much it is smaller at the second height all around [mm].
    """
    nodes = np.asarray(centers, dtype=float)
    sides = np.roll(nodes, -1, axis=0) - nodes
    out = np.degrees(np.arctan2(-sides[:, 0], sides[:, 1]))
    steps = max(4, AROUND // len(nodes) // 2)
    arcs = []
    for index, node in enumerate(nodes):
        start, end = out[index - 1], out[index]
        end = start + (end - start) % 360
        angles = np.radians(np.linspace(start, end, steps))
        arcs += [(node, np.array([np.cos(a), np.sin(a)])) for a in angles]
    low, high = heights
    layers = [(low, 0.0)] if edge == 0.0 else []
    for angle in np.linspace(0.0, np.pi / 2, EDGE) if edge else ():
        layers.append((low + edge * (1 - np.sin(angle)), edge * (1 - np.cos(angle))))
    layers = layers[::-1]
    layers += [(low + high - z, inset) for z, inset in layers[::-1]]
    rings = []
    for z, inset in layers:
        size = radius - inset - taper * (z - low) / (high - low)
        rings.append(np.array([[*(node + size * way), z] for node, way in arcs]))
    return loft(color, rings)


def slab(
    color: str, size: tuple[float, float], radius: float, heights: tuple[float, float],
    edge: float = 0.0, taper: float = 0.0,
) -> Part:  # fmt: skip
    """Return a rectangular plate with round corners; see `pillow`."""
    x, y = size[0] / 2 - radius, size[1] / 2 - radius
    centers = [(x, -y), (x, y), (-x, y), (-x, -y)]
    return pillow(color, centers, radius, heights, edge, taper)


def gear(color: str, radius: float, teeth: int, heights: tuple[float, float]) -> Part:
    """Return a spur gear about z [mm]."""
    turns = np.arange(4 * teeth) * 2 * np.pi / (4 * teeth)
    radii = np.tile([radius - 2, radius - 2, radius, radius], teeth)
    outline = np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1)
    return loft(color, [np.insert(outline, 2, z, axis=1) for z in heights])


def seam(radius: float, xyz: ArrayLike, rpy: ArrayLike = (0, 0, 0)) -> Part:
    """Return the ring that shows where a joint turns."""
    ring = [(radius, -1.1), (radius, 1.1)]
    return turned("silver", ring).moved(xyz, rpy)


def base_link() -> list[Part]:
    """Return the plate with its feet and bolts."""
    feet = [
        turned("dark", [(9, -30), (10, -25)]).moved((x, y, 0))
        for x in (-36, 36)
        for y in (-53, 53)
    ]
    bolts = [
        turned("silver", [(3.2, -4), (3.2, -2), (2.2, -1.2)]).moved((x, y, 0))
        for x in (-43, 43)
        for y in (-60, 60)
    ]
    plate = slab("grey", (105, 140), 14, (-26, -3), edge=3)
    return [plate, *feet, *bolts]


def link1() -> list[Part]:
    """Return the case of the board, and the column on it."""
    # The board's sockets look back, its lamp forward.
    body = slab("white", (80, 116), 14, (-3, 58), edge=6, taper=3).moved((0, -10, 0))
    panel = [
        slab("dark", (48, 27), 3, (0, 1)),
        slab("silver", (12, 11), 1, (0, 2)).moved((-14, -4, 0)),
        slab("silver", (12, 6), 1, (0, 2)).moved((2, -6, 0)),
        turned("grey", [(5, 0), (5, 2.5), (4, 3)]).moved((16, 2, 0)),
    ]
    front = [
        slab("blue", (30, 3.5), 1.7, (0, 0.8)),
        turned("green", [(2.2, 0), (2.2, 0.8)]).moved((0, -10, 0)),
    ]
    # They lean by as much as the body tapers.
    back = [part.moved((0, -66.6, 24), (87, 0, 0)) for part in panel]
    front = [part.moved((0, 46.5, 26), (-87, 0, 0)) for part in front]
    profile = [(33, 55), (33, 58), (30.5, 61.5), (25.5, 63.5), (24.3, 66)]
    turret = turned("white", profile)
    return [body, *back, *front, turret, seam(24.1, (0, 0, 66.6))]


def link2() -> list[Part]:
    """Return the tube that turns on the column."""
    path = [(0, 0, -64), (0, 0, -1), (0, -33, -1)]
    return [tube("white", path, 24, 27), seam(23.6, (0, -33.6, -1), (90, 0, 0))]


def link3() -> list[Part]:
    """Return the upper arm."""
    path = [(0, 0, 34), (0, 0, 61), (-110.4, 0, 61), (-110.4, 0, 34)]
    return [tube("white", path, 23.7, 26), seam(22.3, (-110.4, 0, 33.4))]


def link4() -> list[Part]:
    """Return the forearm."""
    path = [(0, 0, 32.6), (0, 0, -1), (-96, 0, -1), (-96, 0, 30)]
    return [tube("white", path, 21.3, 25), seam(20.2, (-96, 0, 30.2))]


def link5() -> list[Part]:
    """Return the first elbow of the wrist."""
    path = [(0, 0, -30), (0, 0, 0), (0, -35, 0)]
    return [tube("white", path, 19.4, 21.5), seam(19.0, (0, -35.6, 0), (90, 0, 0))]


def link6() -> list[Part]:
    """Return the head with the screen."""
    # The Atom with its screen of 5 x 5 lamps sits in the back end.
    neck = tube("white", [(0, 0, -37), (0, 0, 2)], 19.2)
    profile = [(17.2, -21.6), (18.6, -20.9), (19.2, -19.4), (19.2, 33.6)]
    barrel = turned("white", profile).moved(rpy=(-90, 0, 0))
    frame = slab("silver", (26, 26), 3, (0, 0.9), edge=0.4)
    screen = slab("dark", (22.5, 22.5), 2, (0, 1.3))
    lamps = [
        turned(
            "blue" if abs(x) + abs(y) == 4 else "grey", [(0.8, 0), (0.8, 1.5)], around=8
        ).moved((x * 2, -21.6, y * 2), (90, 0, 0))
        for x in range(-4, 5, 2)
        for y in range(-4, 5, 2)
    ]
    front = [part.moved((0, -21.6, 0), (90, 0, 0)) for part in (frame, screen)]
    return [neck, barrel, *front, *lamps]


def link6_flange() -> list[Part]:
    """Return what the gripper is screwed to."""
    return [
        turned("silver", [(19.0, -12), (19.0, -3.5)]),
        turned("white", [(19.2, -3.5), (19.2, 0.9), (18.5, 1.7)]),
    ]


def gripper_base() -> list[Part]:
    """Return the gripper's case."""
    # Two shells with the bars between them, joined behind; the motor is on top.
    right = [(24, -27), (24, -6), (19, 4), (10, 10.5)]
    front = [*right, (0, 12.5), *((-x, y) for x, y in right[::-1])]
    rear = [(25, -28), (25, -14), (-25, -14), (-25, -28)]
    disc = [(16, -14), (16, 2), (9, 15), (-9, 15), (-16, 2), (-16, -14)]
    top = pillow("white", front, 5, (3, 16), edge=3)
    spine = pillow("white", rear, 4, (-13, 15), edge=2)
    bottom = pillow("white", disc, 13, (-13, -4.5), edge=2.5)
    motor = slab("white", (38, 19.5), 4, (14, 37.7), edge=2.5, taper=1)
    screws = [
        turned("grey", [(2.2, 0), (2.2, 0.5)]).moved((x, -31.8, z), (90, 0, 0))
        for x in (-22, 22)
        for z in (-8, 10)
    ]
    pins = [
        turned("grey", [(2.4, -14), (2.4, 4)]).moved((x, y, 0))
        for x, y in ((-12, 5), (12, 5), (-5, 27), (5, 27))
    ]
    return [top, spine, bottom, motor.moved((-8, -2.5, 0)), *screws, *pins]


def gripper_left1() -> list[Part]:
    """Return the left finger."""
    heel = pillow("silver", [(0, 0), (7, 21), (4, 22)], 4.7, (-13, -3.4), edge=0.8)
    hub = turned("silver", [(4.9, -18), (4.9, 1.6)]).moved((7, 22, 0))
    arm = pillow("silver", [(7, 22), (11, 31), (9, 32)], 4, (-13, -3.4), edge=0.8)
    pad = slab("white", (9.5, 26), 2.5, (-18.4, 2.0), edge=1.2).moved((10.9, 40, 0))
    rubber = slab("dark", (4, 24), 1.2, (-16.5, 0.2), edge=0.8).moved((16.7, 40, 0))
    inside = slab("grey", (3, 13), 1, (-14, -2.4), edge=0.4).moved((6.2, 40, 0))
    return [heel, hub, arm, pad, rubber, inside, pin((0, 0), -2.9), pin((7, 22), 2.0)]


def gripper_left2() -> list[Part]:
    """Return the outer bar of the left finger."""
    bar = [(0, 0), (-28, 15.6)]
    high = pillow("silver", bar, 3.8, (-3.2, 1.2), edge=0.6)
    low = pillow("silver", bar, 3.8, (-17.6, -13.4), edge=0.6)
    ends = [
        turned("silver", [(4.6, z), (4.6, z + 5)]).moved((x, y, 0))
        for x, y in bar
        for z in (-18.2, -3.2)
    ]
    post = slab("silver", (3.5, 4), 1, (-14, -3)).moved((-15.5, 8.6, 0), (0, 0, -29))
    return [high, low, *ends, post, pin((0, 0), 2.2), pin((-28, 15.6), 2.2)]


def gripper_left3() -> list[Part]:
    """Return the geared bar of the left finger."""
    bar = pillow("silver", [(0, 0), (-27, 16)], 4.6, (-3.1, 1.7), edge=0.6)
    teeth = gear("silver", 14.4, 20, (-3.2, 1.8))
    return [teeth, bar, pin((0, 0), 2.4), pin((-27, 16), 2.4)]


def pin(xy: tuple[float, float], top: float) -> Part:
    """Return the head of an axle [mm]."""
    return turned("grey", [(2.1, top - 1), (2.1, top)]).moved((*xy, 0))


def mirrored(parts: Iterable[Part]) -> list[Part]:
    """Return the right finger's parts, given the left one's."""
    return [part.mirrored() for part in parts]


def links() -> dict[str, list[Part]]:
    """Return the parts of each link by its name."""
    left = {
        "gripper_left1": gripper_left1(),
        "gripper_left2": gripper_left2(),
        "gripper_left3": gripper_left3(),
    }
    arm = (base_link, link1, link2, link3, link4, link5, link6, link6_flange)
    return {
        **{make.__name__: make() for make in (*arm, gripper_base)},
        **left,
        **{k.replace("left", "right"): mirrored(parts) for k, parts in left.items()},
    }


def corner_normals(part: Part) -> Array:
    """Return a unit normal for each corner of each face, shape (m, 3, 3)."""
    corners = part.points[part.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(area, axis=1, keepdims=True)
    unit = area / np.where(size > 0, size, 1)
    around: list[list[int]] = [[] for _ in part.points]
    for face, indices in enumerate(part.faces):
        for index in indices:
            around[index].append(face)
    found = np.empty_like(corners)
    for face, indices in enumerate(part.faces):
        for at, index in enumerate(indices):
            near = np.array(around[index])
            near = near[unit[near] @ unit[face] > np.cos(SMOOTH)]
            total = area[near].sum(axis=0) if len(near) else unit[face]
            found[face, at] = total / max(np.linalg.norm(total), 1e-12)
    return found


def document(name: str, parts: Sequence[Part]) -> collada.Collada:
    """Return a COLLADA document with a geometry for each colour."""
    dae = collada.Collada()
    dae.assetInfo.upaxis = asset.UP_AXIS.Z_UP
    dae.assetInfo.unitname, dae.assetInfo.unitmeter = "meter", 1.0
    # The day is no fact of the mesh.
    dae.assetInfo.created = dae.assetInfo.modified = dt.datetime(2024, 1, 1)
    children = []
    for color in COLORS:
        mine = [part for part in parts if part.color == color]
        if not mine:
            continue
        rgba = (*COLORS[color], 1.0)
        gloss = (0.15, 0.15, 0.15, 1.0)
        effect = material.Effect(
            f"{color}_effect", [], "phong", diffuse=rgba, specular=gloss, shininess=30.0
        )
        paint = material.Material(color, color, effect)
        dae.effects.append(effect)
        dae.materials.append(paint)
        corners = np.concatenate([part.points[part.faces] for part in mine])
        points, where = rows(corners * MM, 5)
        normals, which = rows(np.concatenate([corner_normals(p) for p in mine]), 2)
        keys = ("position", "normal")
        ids = [f"{name}_{color}_{key}" for key in keys]
        sources = [
            source.FloatSource(key, values.ravel(), ("X", "Y", "Z"))
            for key, values in zip(ids, (points, normals), strict=True)
        ]
        shape = geometry.Geometry(dae, f"{name}_{color}", f"{name}_{color}", sources)
        inputs = source.InputList()
        inputs.addInput(0, "VERTEX", f"#{ids[0]}")
        inputs.addInput(1, "NORMAL", f"#{ids[1]}")
        indices = np.stack([where, which], axis=1).ravel()
        shape.primitives.append(shape.createTriangleSet(indices, inputs, color))
        dae.geometries.append(shape)
        used = scene.MaterialNode(color, paint, inputs=[])
        children.append(scene.GeometryNode(shape, [used]))
    node = scene.Node(name, children=children)
    dae.scenes.append(scene.Scene("scene", [node]))
    dae.scene = dae.scenes[0]
    return dae


def rows(values: Array, digits: int) -> tuple[Array, NDArray[np.int64]]:
    """Return the rounded rows that differ, and which one each of the values is."""
    # Adding zero takes the sign from -0.
    rounded = np.round(values.reshape(-1, 3), digits) + 0.0
    found, which = np.unique(rounded, axis=0, return_inverse=True)
    return found, which.ravel()


def main() -> None:
    """Write the files beside this one."""
    for name, parts in links().items():
        document(name, parts).write(Path(__file__).parent / f"{name}.dae")


if __name__ == "__main__":
    main()
