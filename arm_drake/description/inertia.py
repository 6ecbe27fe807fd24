"""Repair of inertias that no body can have.

If every body that moves can move on its own, the robot's mass matrix is positive
definite. Links fixed to each other are one body, as in Drake. What slides needs a mass,
what turns an inertia: about the joint's axis, or if the axis itself moves, about the
parallel one through the centre of mass.
"""

import dataclasses as dc
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.links import (
    Geometry,
    LinkInfo,
    ShapeInfo,
    read_axis,
    read_link,
    read_origin,
)
from arm_drake.description.report import LoadReport, Severity
from arm_drake.errors import quoted

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


def link_solid(link: LinkInfo) -> tuple[Inertial, str] | None:
    """Return a link as a solid of density 1, and what that is.

    That is its collision geometry, else its visual one; None if it has neither. What
    overlaps counts twice. Of meshes, the files that `meshes` wrote are read: the convex
    hull of a collision mesh, as thinned as it is for contact, the box around a visual
    one.
    """
    for tag, shapes in (("collision", link.collisions), ("visual", link.visuals)):
        known = [
            (solid, shape.geometry is not None and shape.geometry.type == "mesh")
            for shape in shapes
            if (solid := _placed_solid(shape)) is not None
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
    """Return what closed triangles enclose."""
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


def _placed_solid(shape: ShapeInfo) -> Inertial | None:
    if shape.geometry is None:
        return None
    solid = _solid(shape.geometry)
    if solid is None or not _VOLUMES[0] < solid.mass < _VOLUMES[1]:
        return None
    return solid.moved(shape.origin.rotation, shape.origin.position)


def _solid(geometry: Geometry) -> Inertial | None:
    match geometry.type:
        case "mesh":
            return _mesh_solid(geometry.filename)
        case "box":
            return box(np.array(geometry.size))
        case "sphere":
            return ball(geometry.radius)
        case "cylinder":
            return cylinder(geometry.radius, geometry.length)
        case "capsule":
            return capsule(geometry.radius, geometry.length)
    return None


def _mesh_solid(filename: str) -> Inertial | None:
    url = urlparse(filename)
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


# Parent link -> joint, child link.
_Children = Mapping[str, Sequence[tuple[ET.Element, str]]]


@dc.dataclass(frozen=True, eq=False)
class Body:
    """Links that move as one."""

    # Name of each link, its rotation and position in the frame of the first one.
    links: list[tuple[str, Array, Array]]

    # The joint that moves it; None if nothing holds it.
    joint: ET.Element | None

    @property
    def _type(self) -> str:
        return "floating" if self.joint is None else self.joint.get("type", "")

    @property
    def mover(self) -> str:
        """What moves the body, with the verb."""
        return "no joint holds" if self.joint is None else "a joint moves"

    @property
    def about(self) -> str:
        """What it must have inertia about."""
        return "every axis" if self._type == "floating" else "the joint's axis"

    def can_turn(self, inertial: Inertial, tolerance: float) -> bool:
        """Return whether the body has the inertia that its joint needs."""
        if self._type == "prismatic":
            return True
        if self._type == "floating":
            moments = np.linalg.eigvalsh(inertial.inertia)
            return bool(moments[0] > tolerance * moments.sum())
        is_free = self._type == "planar"
        inertia = inertial.inertia if is_free else inertial.about(np.zeros(3))
        assert self.joint is not None
        axis = np.array(read_axis(self.joint))
        axis /= np.linalg.norm(axis) or 1.0
        return bool(axis @ inertia @ axis > tolerance * np.trace(inertia))


def moving_bodies(root: ET.Element) -> Iterator[Body]:
    """Yield the body of each movable joint of a `<robot>` element."""
    links = {link.get("name", "") for link in root.iterfind("link")}
    children = _children(root, links)
    for pairs in children.values():
        for joint, first in pairs:
            if joint.get("type") != "fixed":
                yield Body(_welded(first, children), joint)


def free_body(root: ET.Element, link: str) -> Body:
    """Return the body of a link that no joint holds."""
    links = {link.get("name", "") for link in root.iterfind("link")}
    return Body(_welded(link, _children(root, links)), None)


def _children(root: ET.Element, links: set[str]) -> _Children:
    children: dict[str, list[tuple[ET.Element, str]]] = {}
    for joint in root.iterfind("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None and child.get("link") in links:
            pair = joint, child.get("link", "")
            children.setdefault(parent.get("link", ""), []).append(pair)
    return children


def _welded(first: str, children: _Children) -> list[tuple[str, Array, Array]]:
    body = [(first, np.eye(3), np.zeros(3))]
    for name, R, p in body:
        for weld, child in children.get(name, []):
            if weld.get("type") == "fixed":
                origin = read_origin(weld)
                at = R @ origin.position + p
                body.append((child, R @ origin.rotation, at))
    return body


# Links without an inertia are taken as solids of this density [kg/m^3].
DENSITY = 1000.0

# A moving body without mass and geometry gets this part of the robot's mass, but at
# least so much [kg], as a solid ball of this radius [m].
SMALL_PART = 1e-3
SMALL_MASS = 1e-3
SMALL_RADIUS = 0.05

# A link that weighs less [kg] is massless: moments of inertia may be no numbers.
LEAST_MASS = 1e-60

# A repaired tensor is that of no thinner body: its second moments are at least this
# part of its largest moment. A rod that is 50 times as long as thick has 1e-3.
_MARGIN = 1e-3

# Smaller negative second moments, as a part of the trace, are rounding: Drake, which
# stops between 7e-16 and 2.5e-15, takes them too.
_ROUNDING = 5e-16

# A body has no inertia about an axis if that is at most this part of its whole.
_NOTHING = 1e-9

_PLACES = (
    ("ixx", 0, 0),
    ("ixy", 0, 1),
    ("ixz", 0, 2),
    ("iyy", 1, 1),
    ("iyz", 1, 2),
    ("izz", 2, 2),
)


def is_physical(inertia: Array) -> bool:
    """Return whether some body has this inertia about its centre of mass.

    Its principal moments must not be negative, and none larger than the two others
    together.
    """
    moments = np.linalg.eigvalsh(inertia)
    trace = moments.sum()
    return bool(trace >= 0.0 and trace / 2.0 - moments[2] >= -_ROUNDING * trace)


def nearest_physical(mass: float, inertia: Array) -> Array:
    """Return the inertia of a body that is nearest in the Frobenius norm.

    A body has second moments s = (a + b + c) / 2 - (a, b, c) >= 0, where a <= b <= c
    are its principal moments. Here s >= m, with m a thousandth of the largest absolute
    moment: a cone with its apex moved to (2m, 2m, 2m). An inertia with s >= 0 stays.

    The cone of all such tensors is invariant under rotation, so the nearest one has the
    same principal axes (Hoffman-Wielandt) and the moments nearest to (a, b, c). These
    are, from the apex, a + d, b + d, c - d with d = (c - a - b) / 3, the foot of the
    perpendicular on a + b = c. It is outside if a + d < 0; the nearest edge, a = 0,
    b = c, has its foot at (b + c) / 2, or at 0 if that is negative.
    """
    inertia = np.asarray(inertia, dtype=float)
    if inertia.shape != (3, 3) or not np.isfinite(inertia).all():
        raise ValueError(f"inertia: expected 3 x 3 finite numbers, got {inertia}")
    if not 0.0 < mass < math.inf:
        raise ValueError(f"mass: expected a positive number, got {mass}")
    if not np.array_equal(inertia, inertia.T):
        raise ValueError(f"inertia: expected a symmetric tensor, got {inertia}")
    return inertia if is_physical(inertia) else _project(inertia)


def _project(inertia: Array) -> Array:
    """Return the nearest tensor that keeps the margin."""
    moments, axes = np.linalg.eigh(inertia)
    apex = 2.0 * _MARGIN * np.abs(moments).max()
    a, b, c = moments - apex
    d = (c - a - b) / 3.0
    nearest = np.array([a + d, b + d, c - d])
    if nearest[0] < 0.0:
        nearest = max(0.0, (b + c) / 2.0) * np.array([0.0, 1.0, 1.0])
    projected = axes * (nearest + apex) @ axes.T
    return np.asarray((projected + projected.T) / 2.0)


def repair_inertials(root: ET.Element, report: LoadReport, file: Path) -> None:
    """Give what joints move a mass and inertia that it can move with."""
    _repair(root, moving_bodies(root), report, file)


def repair_free_base(
    root: ET.Element, base: str, report: LoadReport, file: Path
) -> None:
    """Give a base that moves freely a mass and inertia that it can move with."""
    _repair(root, [free_body(root, base)], report, file)


def _repair(
    root: ET.Element, bodies: Iterable[Body], report: LoadReport, file: Path
) -> None:
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    repair = _Repair(report, file)
    inertials = {name: repair.read(name, link) for name, link in links.items()}
    total = sum(inertial.mass for inertial in inertials.values())
    for body in bodies:
        parts = [(name, links[name]) for name, _, _ in body.links]
        if all(inertials[name].mass == 0.0 for name, _ in parts):
            repair.add_mass(parts, total, f"no mass, but {body.mover} it")
            inertials |= {name: repair.read(name, link) for name, link in parts}
        placed = [inertials[name].moved(R, p) for name, R, p in body.links]
        if not body.can_turn(union(placed), _NOTHING):
            for name, _, _ in body.links:
                what = f"no inertia about {body.about}"
                repair.thicken(name, links[name], inertials[name], what)


@dc.dataclass(frozen=True)
class _Repair:
    """What is done to one robot."""

    report: LoadReport
    file: Path

    def read(self, name: str, link: ET.Element) -> Inertial:
        """Return a link's inertial in its frame, mended if no body can have it."""
        nothing = Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
        element = link.find("inertial")
        if element is None:
            return nothing
        mass_element = element.find("mass")
        text = "0" if mass_element is None else mass_element.get("value", "0")
        mass = float(text)
        inertia = _read_tensor(element)
        if not LEAST_MASS <= mass < math.inf:
            link.remove(element)
            if mass != 0.0:
                # As Gazebo's conversion takes it; what is below 0 was meant otherwise.
                what, done = f"a mass of {text} kg", "it is taken as massless"
                severity: Severity = "warning" if 0.0 < mass < math.inf else "error"
                self._add(name, what, done, severity)
            elif inertia.any():
                what = "an inertia without mass"
                self._add(name, what, "it is taken as massless")
            return nothing
        given = element.find("inertia")
        lacking = [n for n, _, _ in _PLACES if given is None or n not in given.attrib]
        if lacking:
            part = "" if given is None else f" {quoted(lacking)} of its"
            what = f"no{part} <inertia>, without which ROS takes no mass"
            self._add(name, what, "taken as 0")
        if not np.isfinite(inertia).all():
            inertia = self._estimate(name, link, element, mass, "no finite inertia")
        elif not is_physical(inertia):
            old, inertia = inertia, nearest_physical(mass, inertia)
            what = f"no body has the principal moments {_moments(old)}"
            self._replace(name, element, inertia, what, "the nearest possible ones")
        origin = read_origin(element)
        inertial = Inertial(mass, np.zeros(3), inertia)
        return inertial.moved(origin.rotation, origin.position)

    def add_mass(
        self, body: list[tuple[str, ET.Element]], total: float, what: str
    ) -> None:
        """Give a mass to a moving body that has none: links, the first at the joint."""
        solids = [(name, link, link_solid(read_link(link))) for name, link in body]
        for name, link, found in solids:
            if found is not None:
                solid, source = found
                inertial = solid.scaled(DENSITY * solid.mass)
                done = f"{DENSITY:g} kg/m^3 times the volume of {source}"
                self._set(name, link, inertial, what, done)
        if all(found is None for _, _, found in solids):
            name, link = body[0]
            inertial = ball(SMALL_RADIUS).scaled(max(SMALL_MASS, SMALL_PART * total))
            done = "it has no geometry to estimate from"
            self._set(name, link, inertial, what, done)

    def thicken(
        self, name: str, link: ET.Element, inertial: Inertial, what: str
    ) -> None:
        """Give inertia about all axes to a link that is a point or a line of mass."""
        element = link.find("inertial")
        if element is None:
            return
        inertia = _read_tensor(element)
        what += f", principal moments {_moments(inertia)}"
        if inertia.any():
            done = "the nearest ones of a body that is no line"
            self._replace(name, element, _project(inertia), what, done)
        else:
            self._estimate(name, link, element, inertial.mass, what)

    def _estimate(
        self, name: str, link: ET.Element, element: ET.Element, mass: float, what: str
    ) -> Array:
        """Set and return the tensor that a link's mass has in the link's shape."""
        found = link_solid(read_link(link))
        if found is None:
            radius = (mass / (DENSITY * 4.0 / 3.0 * math.pi)) ** (1.0 / 3.0)
            solid, done = ball(radius), f"those of a ball of {DENSITY:g} kg/m^3"
        else:
            solid, source = found
            done = f"those of {source}"
        R = read_origin(element).rotation
        inertia = R.T @ solid.scaled(mass).inertia @ R
        inertia = np.asarray((inertia + inertia.T) / 2.0)
        self._replace(name, element, inertia, what, done)
        return inertia

    def _set(
        self, name: str, link: ET.Element, inertial: Inertial, what: str, done: str
    ) -> None:
        write_inertial(link, inertial.mass, inertial.inertia, inertial.center)
        moments = _moments(inertial.inertia)
        done = f"it gets {inertial.mass:.3g} kg and the moments {moments}, {done}"
        self._add(name, what, done)

    def _replace(
        self, name: str, element: ET.Element, inertia: Array, what: str, done: str
    ) -> None:
        _set_tensor(element, inertia)
        self._add(name, what, f"the moments are now {_moments(inertia)}, {done}")

    def _add(
        self, name: str, what: str, done: str, severity: Severity = "warning"
    ) -> None:
        where = f"link {name!r}"
        self.report.add(severity, "repair", what, done, where=where, file=self.file)


def _read_tensor(inertial: ET.Element) -> Array:
    element = inertial.find("inertia")
    tensor = np.zeros((3, 3))
    if element is not None:
        for name, row, column in _PLACES:
            tensor[row, column] = tensor[column, row] = float(element.get(name, "0"))
    return tensor


def write_inertial(
    link: ET.Element, mass: float, inertia: Array, center: Array | None = None
) -> None:
    """Give a link that has none an `<inertial>` [kg], [kg·m^2], [m] in its axes."""
    element = ET.SubElement(link, "inertial")
    if center is not None:
        xyz = " ".join(repr(x) for x in center.tolist())
        ET.SubElement(element, "origin", xyz=xyz)
    ET.SubElement(element, "mass", value=repr(float(mass)))
    _set_tensor(element, inertia)


def take_mass(link: ET.Element, part: float) -> float:
    """Take a part of its mass and inertia from a link; return the mass [kg]."""
    inertial, mass = link.find("inertial"), link.find("inertial/mass")
    if inertial is None or mass is None:
        return 0.0
    whole, rest = float(mass.get("value", "0")), 1.0 - part
    mass.set("value", repr(rest * whole))
    for inertia in inertial.iterfind("inertia"):
        for name, value in inertia.items():
            inertia.set(name, repr(rest * float(value)))
    return part * whole


def _set_tensor(inertial: ET.Element, tensor: Array) -> None:
    for element in inertial.findall("inertia"):
        inertial.remove(element)
    texts = {name: repr(float(tensor[row, column])) for name, row, column in _PLACES}
    ET.SubElement(inertial, "inertia", texts)


def _moments(inertia: Array) -> str:
    moments = ", ".join(f"{m:.3g}" for m in np.linalg.eigvalsh(inertia))
    return f"({moments}) kg·m^2"
