"""The large pieces of the house: each in its own frame, on the floor z = 0."""

import dataclasses as dc
from collections.abc import Iterable, Sequence
from functools import cache
from math import pi
from typing import NamedTuple

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import Box, Cylinder, InMemoryMesh, Mesh, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake.description.meshes.surfaces import (
    Surface,
    encode_gltf,
    to_linear,
    transformed,
)

Vector = tuple[float, float, float]

# Points around a round part, and of the profile of a soft one.
_ROUND = 28

# Parts without a colour have one of their own; this is never seen.
_NO_COLOR = (1.0, 1.0, 1.0, 1.0)


class Part(NamedTuple):
    """A part of a piece, in the piece's frame."""

    surface: Surface
    pose: RigidTransform

    # What collides, None if nothing does.
    shape: Shape | None


Parts = list[Part]


def block(
    size: Vector,
    at: Vector = (0.0, 0.0, 0.0),
    color: str = "ffffff",
    *,
    turn: Vector = (0.0, 0.0, 0.0),
    is_solid: bool = True,
    alpha: float = 1.0,
) -> Part:
    """Return a box; `at` is the middle of its bottom, about which it is turned.

    Args:
        size: Along x, y and z [m].
        at: Middle of its bottom [m].
        color: Red, green and blue, two hexadecimal digits each.
        turn: Roll, pitch and yaw [rad].
        is_solid: Whether it collides.
        alpha: Opacity.
    """
    unit = _unit_box()
    surface = dc.replace(
        unit, vertices=unit.vertices * np.array(size), color=_rgba(color, alpha)
    )
    return Part(surface, _raised(at, turn, size[2]), Box(*size) if is_solid else None)


def cushion(
    size: Vector,
    at: Vector,
    color: str,
    *,
    turn: Vector = (0.0, 0.0, 0.0),
    radius: float = 0.06,
    is_solid: bool = True,
) -> Part:
    """Return a box with round edges; arguments as those of `block`."""
    half = np.array(size) / 2.0
    r = min(radius, *half)
    unit = _unit_ball(2)
    vertices = np.sign(unit.vertices) * (half - r) + r * unit.vertices
    surface = dc.replace(unit, vertices=vertices, color=_rgba(color))
    return Part(surface, _raised(at, turn, size[2]), Box(*size) if is_solid else None)


def post(
    radius: float,
    height: float,
    at: Vector = (0.0, 0.0, 0.0),
    color: str = "ffffff",
    *,
    turn: Vector = (0.0, 0.0, 0.0),
    is_solid: bool = True,
    alpha: float = 1.0,
) -> Part:
    """Return a cylinder; arguments as those of `block`."""
    mesh = trimesh.creation.cylinder(radius, height, sections=_ROUND)
    mesh.unmerge_vertices()
    shape = Cylinder(radius, height) if is_solid else None
    return Part(_surface(mesh, color, alpha), _raised(at, turn, height), shape)


def ball(radius: float, at: Vector, color: str, *, is_solid: bool = True) -> Part:
    """Return a sphere with its centre at a place."""
    unit = _unit_ball(3)
    surface = dc.replace(unit, vertices=unit.vertices * radius, color=_rgba(color))
    shape = Sphere(radius) if is_solid else None
    return Part(surface, RigidTransform(np.array(at)), shape)


def lathed(
    profile: Sequence[tuple[float, float]],
    at: Vector,
    color: str,
    *,
    is_solid: bool = True,
    alpha: float = 1.0,
) -> Part:
    """Return what a profile turned about z makes, such as a vase or a lamp shade.

    Args:
        profile: Radius and height of its points, from below [m].
        at: Its origin [m].
        color: As that of `block`.
        is_solid: Whether the cylinder around it collides.
        alpha: Opacity.
    """
    points = np.array(profile)
    mesh = trimesh.creation.revolve(points, sections=_ROUND)
    mesh.unmerge_vertices()
    radius, height = float(points[:, 0].max()), float(np.ptp(points[:, 1]))
    # The cylinder's frame is in its middle, the profile's is not.
    middle = float(points[:, 1].min() + points[:, 1].max()) / 2.0
    mesh.apply_translation([0.0, 0.0, -middle])
    surface = _surface(mesh, color, alpha)
    pose = RigidTransform([at[0], at[1], at[2] + middle])
    return Part(surface, pose, Cylinder(radius, height) if is_solid else None)


def legs(
    across: float, along: float, height: float, color: str, *, width: float = 0.05
) -> Parts:
    """Return four legs that stand in the corners of a rectangle.

    Args:
        across: From the middle of a leg to that of the next one along x [m].
        along: The same along y [m].
        height: Of the legs [m].
        color: As that of `block`.
        width: Of a leg [m].
    """
    return [
        block((width, width, height), (x * across / 2.0, y * along / 2.0, 0.0), color)
        for x in (-1.0, 1.0)
        for y in (-1.0, 1.0)
    ]


def moved(parts: Iterable[Part], by: Vector, yaw: float = 0.0) -> Parts:
    """Return parts turned about z and then moved [m]."""
    X = RigidTransform(RollPitchYaw(0.0, 0.0, yaw), np.array(by))
    return [part._replace(pose=X @ part.pose) for part in parts]


def drawing(parts: Sequence[Part], name: str) -> Mesh:
    """Return what is seen of parts, as one mesh.

    Args:
        parts: At least one part.
        name: What messages call it.
    """
    surfaces = [transformed(part.surface, part.pose.GetAsMatrix34()) for part in parts]
    content = encode_gltf(_together(surfaces), _NO_COLOR)
    file = MemoryFile(contents=content, extension=".gltf", filename_hint=name)
    return Mesh(InMemoryMesh(mesh_file=file))


def _together(surfaces: Sequence[Surface]) -> list[Surface]:
    """Return one surface for each colour: a page draws few large ones faster."""
    by_color: dict[object, list[Surface]] = {}
    for surface in surfaces:
        by_color.setdefault(surface.color, []).append(surface)
    joined = []
    for group in by_color.values():
        counts = np.cumsum([0, *(len(s.vertices) for s in group)])
        joined.append(
            Surface(
                np.concatenate([s.vertices for s in group]),
                np.concatenate(
                    [s.faces + first for s, first in zip(group, counts, strict=False)]
                ),
                color=group[0].color,
                normals=np.concatenate([_normals(s) for s in group]),
            )
        )
    return joined


def _normals(surface: Surface) -> np.ndarray:
    assert surface.normals is not None
    return surface.normals


def _surface(mesh: trimesh.Trimesh, color: str, alpha: float) -> Surface:
    """Return a mesh whose faces are flat, as a surface."""
    normals = np.repeat(mesh.face_normals, 3, axis=0)
    by_vertex = np.empty_like(normals)
    by_vertex[mesh.faces.ravel()] = normals
    return Surface(
        np.array(mesh.vertices),
        np.array(mesh.faces),
        color=_rgba(color, alpha),
        normals=by_vertex,
    )


def _raised(at: Vector, turn: Vector, height: float) -> RigidTransform:
    X = RigidTransform(RollPitchYaw(*turn), np.array(at))
    return X @ RigidTransform([0.0, 0.0, height / 2.0])


@cache
def _unit_box() -> Surface:
    mesh = trimesh.creation.box((1.0, 1.0, 1.0))
    mesh.unmerge_vertices()
    return _surface(mesh, "ffffff", 1.0)


@cache
def _unit_ball(subdivisions: int) -> Surface:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices = np.array(mesh.vertices)
    return Surface(vertices, np.array(mesh.faces), normals=vertices)


@cache
def _rgba(color: str, alpha: float = 1.0) -> tuple[float, float, float, float]:
    red, green, blue = (int(color[i : i + 2], 16) / 255.0 for i in (0, 2, 4))
    return to_linear((red, green, blue, alpha))


OAK, WALNUT, WHITE, IVORY = "c89b6a", "6e4a33", "f2f1ee", "e6dfd2"
STEEL, DARK, BLACK = "b9bec4", "3c4046", "1c1d20"
TEAL, RUST, MUSTARD, SAGE, NAVY = "3f7f84", "b8573a", "d9a441", "8fa58b", "33475b"


def bed() -> Parts:
    """Return a double bed, its head at +y."""
    pillows = [
        cushion((0.62, 0.36, 0.16), (x, 0.74, 0.55), WHITE, turn=(0.35, 0, 0))
        for x in (-0.42, 0.42)
    ]
    return [
        block((1.9, 0.08, 1.05), (0, 1.04, 0), WALNUT),
        block((1.84, 2.06, 0.22), (0, -0.02, 0.1), WALNUT),
        *moved(legs(1.6, 1.8, 0.1, DARK), (0, -0.02, 0)),
        cushion((1.76, 2.0, 0.24), (0, -0.02, 0.31), IVORY, radius=0.08),
        cushion((1.84, 1.36, 0.14), (0, -0.36, 0.45), TEAL, radius=0.07),
        cushion((1.86, 0.34, 0.15), (0, 0.26, 0.455), "dfe8e6", radius=0.07),
        *pillows,
        cushion((0.46, 0.2, 0.3), (0, 0.5, 0.56), MUSTARD, turn=(-0.5, 0, 0)),
    ]


def night_stand() -> Parts:
    """Return a night stand with two drawers and a lamp, its front at -y."""
    return [
        block((0.52, 0.42, 0.5), (0, 0, 0.1), OAK),
        *legs(0.44, 0.34, 0.1, DARK, width=0.04),
        *(block((0.48, 0.02, 0.22), (0, -0.215, z), "d9b184") for z in (0.12, 0.36)),
        *(ball(0.018, (0, -0.235, z), STEEL, is_solid=False) for z in (0.23, 0.47)),
        post(0.07, 0.02, (0.13, 0.06, 0.6), DARK),
        post(0.014, 0.22, (0.13, 0.06, 0.6), DARK),
        lathed([(0.13, 0), (0.08, 0.18)], (0.13, 0.06, 0.78), "f6e3b4"),
    ]


def wardrobe() -> Parts:
    """Return a wardrobe with two doors, its front at -y."""
    doors = [
        block((0.385, 0.02, 1.92), (x, -0.11, 0.1), "efe9df") for x in (0.01, -0.405)
    ]
    return [
        block((0.79, 0.6, 2.0), (-0.2, 0.2, 0.06), IVORY),
        block((0.75, 0.56, 0.06), (-0.2, 0.2, 0), DARK),
        *doors,
        *(block((0.02, 0.03, 0.3), (x, -0.13, 0.95), STEEL) for x in (-0.16, -0.24)),
    ]


def dining_chair() -> Parts:
    """Return a wooden chair; who sits on it looks to -x."""
    return [
        *legs(0.38, 0.38, 0.43, OAK, width=0.04),
        block((0.44, 0.44, 0.035), (0, 0, 0.43), OAK),
        cushion((0.41, 0.41, 0.05), (-0.01, 0, 0.455), RUST, radius=0.025),
        *(block((0.035, 0.04, 0.5), (0.2, y, 0.44), OAK) for y in (-0.19, 0.19)),
        *(block((0.025, 0.36, 0.09), (0.2, 0, z), OAK) for z in (0.62, 0.83)),
    ]


def armchair() -> Parts:
    """Return an armchair; who sits on it looks to +x."""
    return [
        *legs(0.46, 0.46, 0.14, WALNUT, width=0.045),
        cushion((0.62, 0.6, 0.26), (0, 0, 0.14), SAGE),
        cushion((0.5, 0.46, 0.12), (0.05, 0, 0.38), "a9bba4", radius=0.05),
        cushion((0.16, 0.62, 0.62), (-0.27, 0, 0.22), SAGE, turn=(0, -0.15, 0)),
        *(cushion((0.56, 0.11, 0.36), (0.01, y, 0.2), SAGE) for y in (-0.3, 0.3)),
    ]


def sofa() -> Parts:
    """Return a sofa for three, 2.3 m wide along x, its front at -y."""
    seats = [
        cushion((0.64, 0.62, 0.18), (x, -0.07, 0.3), "55718a") for x in (-0.66, 0, 0.66)
    ]
    backs = [
        cushion((0.64, 0.2, 0.44), (x, 0.27, 0.42), "55718a", turn=(-0.18, 0, 0))
        for x in (-0.66, 0, 0.66)
    ]
    throw = [
        cushion((0.4, 0.14, 0.4), (-0.78, 0.06, 0.46), MUSTARD, turn=(-0.35, 0, 0.2)),
        cushion((0.4, 0.14, 0.4), (0.8, 0.06, 0.46), RUST, turn=(-0.35, 0, -0.2)),
    ]
    parts = [
        *legs(2.0, 0.66, 0.08, WALNUT),
        cushion((2.3, 0.84, 0.26), (0, 0, 0.06), NAVY),
        cushion((2.3, 0.2, 0.68), (0, 0.36, 0.1), NAVY),
        *(cushion((0.18, 0.84, 0.52), (x, 0, 0.08), NAVY) for x in (-1.07, 1.07)),
        *seats,
        *backs,
        *throw,
    ]
    # Its pose is 66 mm above the floor, and robots stand near its other end.
    return moved(parts, (-0.45, 0, -0.066))


def coffee_table() -> Parts:
    """Return a low table with a shelf."""
    return [
        *legs(1.14, 0.6, 0.33, WALNUT),
        block((1.26, 0.72, 0.03), (0, 0, 0.328), OAK),
        block((1.16, 0.62, 0.02), (0, 0, 0.0), OAK),
    ]


def kitchen_table() -> Parts:
    """Return a dining table, 1.7 m long along y."""
    return [
        *legs(0.74, 1.5, 0.74, WALNUT, width=0.07),
        block((0.9, 1.7, 0.04), (0, 0, 0.74), OAK),
        block((0.3, 1.7, 0.004), (0, 0, 0.78), RUST, is_solid=False),
    ]


def reading_desk() -> Parts:
    """Return a desk with drawers, books and a lamp; who works at it sits at +x."""
    colors = (RUST, NAVY, MUSTARD, SAGE, TEAL)
    books = [
        block((0.16, 0.035, 0.2 + 0.02 * (i % 3)), (-0.2, 0.3 + 0.04 * i, 0.74), color)
        for i, color in enumerate(colors)
    ]
    return [
        *legs(0.6, 1.3, 0.7, WALNUT),
        block((0.7, 1.4, 0.04), (0, 0, 0.7), OAK),
        block((0.6, 0.4, 0.5), (0, 0.46, 0.2), IVORY),
        *(
            block((0.02, 0.36, 0.14), (0.31, 0.46, z), WHITE)
            for z in (0.22, 0.38, 0.54)
        ),
        *books,
        post(0.08, 0.02, (-0.2, -0.45, 0.74), BLACK),
        post(0.012, 0.34, (-0.2, -0.45, 0.74), BLACK, turn=(0, 0.25, 0)),
        lathed([(0.09, 0), (0.03, 0.1)], (-0.1, -0.45, 1.03), MUSTARD),
        block((0.24, 0.34, 0.015), (0.06, -0.1, 0.74), STEEL),
        block((0.015, 0.34, 0.22), (-0.07, -0.1, 0.75), DARK, turn=(0, -0.2, 0)),
    ]


def balcony_table() -> Parts:
    """Return a round table."""
    return [
        post(0.22, 0.03, (0, 0, 0), BLACK),
        post(0.035, 0.68, (0, 0, 0.02), BLACK),
        post(0.42, 0.03, (0, 0, 0.69), "d8d3c8"),
        lathed([(0.05, 0), (0.08, 0.1), (0.06, 0.16)], (0.05, 0.1, 0.72), RUST),
        *(
            ball(0.09, (0.05 + x, 0.1 + y, 0.95 + z), "4f7a4a", is_solid=False)
            for x, y, z in (
                (0, 0, 0.05),
                (0.07, 0.02, 0),
                (-0.06, 0.04, 0),
                (0, -0.07, -0.02),
            )
        ),
    ]


def kitchen_cabinet() -> Parts:
    """Return counters around a corner; x and y point away from their front."""
    east = [
        block((0.6, 3.06, 0.78), (1.1, -0.1, 0.1), WHITE),
        block((0.54, 3.0, 0.1), (1.13, -0.1, 0), DARK),
        block((0.65, 3.1, 0.04), (1.08, -0.1, 0.86), "4a4d52"),
        *(
            block((0.02, 0.56, 0.7), (0.79, y, 0.14), "8ea08f")
            for y in (-0.75, -0.15, 0.45, 1.05)
        ),
        *(
            block((0.03, 0.2, 0.02), (0.77, y, 0.76), STEEL)
            for y in (-0.75, -0.15, 0.45, 1.05)
        ),
    ]
    south = [
        block((1.75, 0.6, 0.78), (-0.1, -1.35, 0.1), WHITE),
        block((1.7, 0.54, 0.1), (-0.1, -1.38, 0), DARK),
        block((1.78, 0.65, 0.04), (-0.1, -1.33, 0.86), "4a4d52"),
        *(
            block((0.54, 0.02, 0.7), (x, -1.04, 0.14), "8ea08f")
            for x in (-0.68, -0.1, 0.48)
        ),
        *(
            block((0.2, 0.03, 0.02), (x, -1.02, 0.76), STEEL)
            for x in (-0.68, -0.1, 0.48)
        ),
        block((0.5, 0.4, 0.006), (-0.1, -1.34, 0.9), STEEL, is_solid=False),
        block((0.44, 0.34, 0.004), (-0.1, -1.34, 0.905), "7d848b", is_solid=False),
        post(0.016, 0.28, (-0.1, -1.58, 0.9), STEEL),
        block((0.03, 0.2, 0.03), (-0.1, -1.49, 1.16), STEEL),
        block((1.75, 0.34, 0.66), (-0.1, -1.48, 1.5), WHITE),
        *(
            block((0.54, 0.02, 0.6), (x, -1.3, 1.53), "8ea08f")
            for x in (-0.68, -0.1, 0.48)
        ),
    ]
    # The frame is turned by 180 degrees: its -x points east, its +y south.
    return moved([*east, *south], (0, 0, -0.012), pi)


def refrigerator() -> Parts:
    """Return a refrigerator with a freezer below, its front at -y."""
    return [
        block((0.86, 0.64, 1.84), (0, 0.32, 0.04), "8f969c"),
        block((0.8, 0.6, 0.04), (0, 0.32, 0), BLACK),
        block((0.85, 0.05, 1.14), (0, -0.03, 0.74), "a9b0b6"),
        block((0.85, 0.05, 0.66), (0, -0.03, 0.06), "a9b0b6"),
        block((0.03, 0.05, 0.7), (-0.36, -0.075, 0.92), "70767c"),
        block((0.6, 0.05, 0.03), (0, -0.075, 0.62), "70767c"),
        block((0.16, 0.006, 0.24), (0.1, -0.058, 1.4), BLACK, is_solid=False),
    ]


def tv_cabinet() -> Parts:
    """Return a low cabinet, 2.8 m wide along y, its front at +x."""
    gaps = [block((0.02, 0.62, 0.3), (0.21, y, 0.12), "efe9df") for y in (-1.02, 1.02)]
    return [
        block((0.42, 2.8, 0.04), (0, 0, 0.46), WALNUT),
        block((0.42, 2.8, 0.06), (0, 0, 0.04), WALNUT),
        *(
            block((0.4, 0.04, 0.4), (0, y, 0.08), WALNUT)
            for y in (-1.38, -0.68, 0, 0.68, 1.38)
        ),
        block((0.02, 2.76, 0.4), (-0.19, 0, 0.08), WALNUT),
        *gaps,
    ]


def television() -> Parts:
    """Return a flat screen, 1.5 m wide along y, its front at -x."""
    return [
        block((0.05, 1.5, 0.86), (0.03, 0, 0), BLACK),
        block((0.006, 1.44, 0.8), (0.002, 0, 0.03), "22384d", is_solid=False),
        block((0.004, 1.0, 0.02), (0.0, 0.1, 0.35), "4f7fa0", is_solid=False),
        block((0.08, 0.4, 0.3), (0.07, 0, 0.25), BLACK),
    ]


def shoe_rack() -> Parts:
    """Return a rack with shoes, its front at +y."""
    shoes = [
        cushion((0.09, 0.24, 0.09), (-0.32 + 0.13 * i, 0.01, z), color, is_solid=False)
        for z, row in (
            (0.1, (RUST, RUST, NAVY, NAVY, BLACK, BLACK)),
            (0.34, (WHITE, WHITE, SAGE, SAGE)),
        )
        for i, color in enumerate(row)
    ]
    return [
        *(block((0.03, 0.3, 0.62), (x, 0, 0), OAK) for x in (-0.42, 0.42)),
        *(block((0.84, 0.3, 0.02), (0, 0, z), OAK) for z in (0.08, 0.32, 0.6)),
        *shoes,
    ]


def fitness_equipment() -> Parts:
    """Return a treadmill; who runs on it looks to +y."""
    return [
        block((0.72, 1.6, 0.16), (0, 0, 0), DARK),
        block((0.48, 1.5, 0.01), (0, -0.02, 0.16), BLACK),
        *(
            block((0.06, 0.06, 1.15), (x, 0.66, 0.1), STEEL, turn=(-0.12, 0, 0))
            for x in (-0.33, 0.33)
        ),
        *(block((0.05, 0.5, 0.05), (x, 0.5, 0.95), BLACK) for x in (-0.33, 0.33)),
        block((0.72, 0.08, 0.26), (0, 0.78, 1.14), DARK, turn=(-0.5, 0, 0)),
        block(
            (0.4, 0.01, 0.18), (0, 0.745, 1.19), TEAL, turn=(-0.5, 0, 0), is_solid=False
        ),
    ]
