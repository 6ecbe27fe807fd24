"""Solids of uniform density: what a link without an inertia is estimated from."""

import dataclasses as dc
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

# Other volumes [m^3] are those of no body.
_VOLUMES = (1e-50, 1e50)

# What stands for one mesh, and for several; `decompose` makes parts of one.
_STAND_INS = {
    "collision": ("the convex hull of", "the convex hulls or parts of"),
    "visual": ("the box around", "the boxes around"),
}


@dc.dataclass(frozen=True, eq=False)
class Inertial:
    """What a body weighs, in some frame; here of density 1."""

    # [kg]; of a body of density 1, its volume [m^3].
    mass: float

    # Centre of mass [m], shape (3,).
    center: Array

    # About the centre of mass [kg·m^2], shape (3, 3).
    inertia: Array

    def moved(self, R_AB: Array, p_AB: Array) -> "Inertial":
        """Return the same, given in frame B, in frame A."""
        return Inertial(
            self.mass, R_AB @ self.center + p_AB, R_AB @ self.inertia @ R_AB.T
        )

    def scaled(self, mass: float) -> "Inertial":
        """Return the same shape with another mass."""
        return Inertial(mass, self.center, mass / self.mass * self.inertia)

    def about(self, p: Array) -> Array:
        """Return the inertia about a point, shape (3, 3)."""
        r = self.center - p
        return np.asarray(
            self.inertia + self.mass * (r @ r * np.eye(3) - np.outer(r, r))
        )


def link_solid(link: ET.Element) -> tuple[Inertial, str] | None:
    """Return a link as a solid of density 1, and what that is.

    That is its collision geometry, else its visual one; None if it has neither. What
    overlaps counts twice. Of meshes, the files that `meshes` wrote are read: the convex
    hull of a collision mesh, as thinned as it is for contact, the box around a visual
    one.
    """
    for tag in ("collision", "visual"):
        known = [
            (solid, element.find("geometry/mesh") is not None)
            for element in link.iterfind(tag)
            if (solid := _placed_solid(element)) is not None
        ]
        if known:
            solids, are_meshes = zip(*known, strict=True)
            return union(solids), _name(tag, are_meshes)
    return None


def _name(tag: str, are_meshes: Sequence[bool]) -> str:
    """Return what a link is estimated from, and what stands for its meshes."""
    of_one, of_all = _STAND_INS[tag]
    if len(are_meshes) == 1 and are_meshes[0]:
        return f"{of_one} its {tag} mesh"
    if all(are_meshes):
        return f"{of_all} its {tag} meshes"
    meshes = f", with {of_all} its meshes" if any(are_meshes) else ""
    return f"its {tag} geometry{meshes}"


def union(solids: Sequence[Inertial]) -> Inertial:
    """Return several bodies as one."""
    mass = sum(solid.mass for solid in solids)
    center = np.asarray(sum(solid.mass * solid.center for solid in solids) / mass)
    inertia = sum(solid.about(center) for solid in solids)
    return Inertial(mass, center, np.asarray(inertia))


def ball(radius: float) -> Inertial:
    """Return a ball about the origin."""
    volume = 4.0 / 3.0 * math.pi * radius**3
    return _round_solid(volume, *(0.4 * volume * radius**2,) * 2)


def cylinder(radius: float, length: float) -> Inertial:
    """Return a cylinder about the origin, along z."""
    volume = math.pi * radius**2 * length
    across = volume * (radius**2 / 4.0 + length**2 / 12.0)
    return _round_solid(volume, across, volume * radius**2 / 2.0)


def capsule(radius: float, length: float) -> Inertial:
    """Return a cylinder along z, with half a ball at each end."""
    tube, caps = cylinder(radius, length), ball(radius)
    # Halves of a ball moved apart: the parallel axis theorem, centre at 3/8 radius.
    apart = caps.mass * (length**2 / 4.0 + 3.0 / 8.0 * length * radius)
    across, _, along = np.diag(tube.inertia + caps.inertia).tolist()
    return _round_solid(tube.mass + caps.mass, across + apart, along)


def _round_solid(volume: float, across: float, along: float) -> Inertial:
    return Inertial(volume, np.zeros(3), np.diag([across, across, along]))


def box(size: Array) -> Inertial:
    """Return a box about the origin."""
    volume = float(np.prod(size))
    square = size**2
    return Inertial(
        volume, np.zeros(3), np.diag(volume / 12.0 * (sum(square) - square))
    )


def polyhedron(vertices: Array, faces: Array) -> Inertial:
    """Return what closed triangles enclose.

    Args:
        vertices: Corners [m], shape (n, 3).
        faces: Rows of `vertices`, counter-clockwise seen from outside, shape (m, 3).
    """
    # Tetrahedra between the faces and the origin, of signed volume.
    corners = vertices[faces]
    volumes = np.linalg.det(corners) / 6.0
    sums = corners.sum(axis=1)
    volume = float(volumes.sum())
    center = volumes @ sums / (4.0 * volume)
    products = np.einsum("t,tki,tkj->ij", volumes, corners, corners)
    products += np.einsum("t,ti,tj->ij", volumes, sums, sums)
    second = products / 20.0 - volume * np.outer(center, center)
    return Inertial(volume, center, np.trace(second) * np.eye(3) - second)


def read_origin(element: ET.Element) -> tuple[Array, Array]:
    """Return rotation, shape (3, 3), and position [m] of an element's `<origin>`."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    xyz, rpy = (_floats(origin.get(name, "0 0 0")) for name in ("xyz", "rpy"))
    (sx, sy, sz), (cx, cy, cz) = np.sin(rpy), np.cos(rpy)
    R = [
        [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz],
        [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz],
        [-sy, sx * cy, cx * cy],
    ]
    return np.array(R), xyz


def _floats(text: str) -> Array:
    return np.array([float(number) for number in text.split()])


def _placed_solid(element: ET.Element) -> Inertial | None:
    geometry = element.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        return None
    solid = _mesh_solid(shape) if shape.tag == "mesh" else _primitive_solid(shape)
    if solid is None or not _VOLUMES[0] < solid.mass < _VOLUMES[1]:
        return None
    return solid.moved(*read_origin(element))


def _primitive_solid(shape: ET.Element) -> Inertial | None:
    if shape.tag == "box":
        return box(_floats(shape.attrib["size"]))
    if shape.tag == "sphere":
        return ball(float(shape.attrib["radius"]))
    if shape.tag in ("cylinder", "capsule"):
        make = cylinder if shape.tag == "cylinder" else capsule
        return make(float(shape.attrib["radius"]), float(shape.attrib["length"]))
    return None


def _mesh_solid(shape: ET.Element) -> Inertial | None:
    url = urlparse(shape.get("filename", ""))
    path = Path(unquote(url.path))
    if url.scheme != "file" or not path.is_file():
        return None
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".obj":
        lines = text.splitlines()
        vertices, faces = (
            np.fromstring(
                " ".join(line[2:] for line in lines if line[:2] == key), sep=" "
            )
            for key in ("v ", "f ")
        )
        return polyhedron(vertices.reshape(-1, 3), faces.astype(int).reshape(-1, 3) - 1)
    document = json.loads(text)
    primitives = [p for mesh in document["meshes"] for p in mesh["primitives"]]
    places = [document["accessors"][p["attributes"]["POSITION"]] for p in primitives]
    lower = np.min([place["min"] for place in places], axis=0)
    upper = np.max([place["max"] for place in places], axis=0)
    # glTF is y-up; `gltf` turned it.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return box(upper - lower).moved(turn, turn @ (lower + upper) / 2.0)
