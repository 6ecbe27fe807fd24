"""What pieces of furniture are made of: parts that are drawn, and mostly collide."""

import dataclasses as dc
from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import Box, Cylinder, InMemoryMesh, Mesh, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake.description.meshes.gltf import encode_gltf
from arm_drake.description.meshes.surfaces import Surface, to_linear, transformed

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
