"""Repair of inertias that no body can have.

If every body that moves can move on its own, the robot's mass matrix is positive
definite. Links fixed to each other are one body, as in Drake. What slides needs a mass,
what turns an inertia: about the joint's axis, or if the axis itself moves, about the
parallel one through the centre of mass.
"""

import dataclasses as dc
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.joints import JointInfo, joints_on_links
from arm_drake.description.links import (
    MOMENTS,
    Geometry,
    InertialInfo,
    LinkInfo,
    Origin,
    ShapeInfo,
    Transform,
)
from arm_drake.description.meshes.surfaces import decode_surface
from arm_drake.description.report import LoadReport, Severity
from arm_drake.errors import quoted
from arm_drake.importing import dataclass

# Other volumes [m^3] are those of no body.
_VOLUMES = (1e-50, 1e50)

# What stands for one mesh, and for several; `decompose` makes parts of one.
_STAND_INS = {
    "collision": ("the convex hull of", "the convex hulls or parts of"),
    "visual": ("the box around", "the boxes around"),
}


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass, centre of mass and inertia of a body in some frame; here of density 1."""

    # [kg]; of a body of density 1, its volume [m^3].
    mass: float

    # Centre of mass [m], shape (3,).
    center: Array

    # About the centre of mass [kg·m^2], shape (3, 3).
    inertia: Array

    def moved(self, X_AB: Transform) -> "Inertial":
        """Return the same inertial, transformed from frame B to frame A."""
        R_AB, p_AB = X_AB.rotation, X_AB.position
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
            (solid, shape.geometry.type == "mesh")
            for shape in shapes
            if (solid := placed_solid(shape)) is not None
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
    # Tetrahedra between the faces and the middle, of signed volume. Far from it moments
    # would be differences of large numbers.
    middle = vertices.mean(axis=0)
    corners = (vertices - middle)[faces]
    volumes = np.linalg.det(corners) / 6.0
    sums = corners.sum(axis=1)
    volume = float(volumes.sum())
    center = volumes @ sums / (4.0 * volume)
    products = np.einsum("t,tki,tkj->ij", volumes, corners, corners)
    products += np.einsum("t,ti,tj->ij", volumes, sums, sums)
    second = products / 20.0 - volume * np.outer(center, center)
    inertia = np.trace(second) * np.eye(3) - second
    return Inertial(volume, center + middle, inertia)


def placed_solid(shape: ShapeInfo) -> Inertial | None:
    """Return a shape as a solid of density 1 in its link; None without a volume."""
    solid = _solid(shape.geometry)
    if solid is None or not _VOLUMES[0] < solid.mass < _VOLUMES[1]:
        return None
    return solid.moved(shape.origin.transform)


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
    content = path.read_bytes()
    if path.suffix == ".obj":
        (surface,) = decode_surface(content)
        return polyhedron(surface.vertices, surface.faces)
    document = json.loads(content)
    primitives = [p for mesh in document["meshes"] for p in mesh["primitives"]]
    places = [document["accessors"][p["attributes"]["POSITION"]] for p in primitives]
    lower = np.min([place["min"] for place in places], axis=0)
    upper = np.max([place["max"] for place in places], axis=0)
    # glTF is y-up; `gltf` turned it.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    place = Transform(turn, turn @ (lower + upper) / 2.0)
    return box(upper - lower).moved(place)


@dataclass(frozen=True, eq=False)
class Body:
    """Links that move as one."""

    # Name of each link, and its pose in the frame of the first one.
    links: list[tuple[str, Transform]]

    # The joint that moves it; None if nothing holds it.
    joint: JointInfo | None

    @property
    def mover(self) -> str:
        """Subject and verb of the body's motion."""
        return "no joint holds" if self.joint is None else "a joint moves"

    @property
    def about(self) -> str:
        """Axes about which it must have inertia."""
        is_free = self.joint is None or self.joint.type == "floating"
        return "every axis" if is_free else "the joint's axis"

    def can_turn(self, inertial: Inertial, tolerance: float) -> bool:
        """Return whether the body has the inertia that its joint needs."""
        if self.joint is None or self.joint.type == "floating":
            moments = np.linalg.eigvalsh(inertial.inertia)
            return bool(moments[0] > tolerance * moments.sum())
        if self.joint.type == "prismatic":
            return True
        is_planar = self.joint.type == "planar"
        inertia = inertial.inertia if is_planar else inertial.about(np.zeros(3))
        axis = self.joint.unit_axis
        return bool(axis @ inertia @ axis > tolerance * np.trace(inertia))


def moving_bodies(joints: Sequence[JointInfo]) -> Iterator[Body]:
    """Yield the body of each movable joint."""
    children = joints_on_links(joints)
    for below in children.values():
        for joint in below:
            if joint.type != "fixed":
                yield Body(_welded(joint.child, children), joint)


def free_body(joints: Sequence[JointInfo], link: str) -> Body:
    """Return the body of a link that no joint holds."""
    return Body(_welded(link, joints_on_links(joints)), None)


def _welded(
    first: str, children: Mapping[str, Sequence[JointInfo]]
) -> list[tuple[str, Transform]]:
    body = [(first, Transform())]
    for name, X in body:
        for weld in children.get(name, []):
            if weld.type == "fixed":
                body.append((weld.child, X @ weld.origin.transform))
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


def repair_inertials(
    links: Sequence[LinkInfo],
    joints: Sequence[JointInfo],
    report: LoadReport,
    file: Path,
) -> tuple[LinkInfo, ...]:
    """Return links with a mass and inertia with which joints can move them.

    Moments that are missing are nan here.
    """
    return _Repair(links, report, file).move(moving_bodies(joints))


def repair_free_base(
    links: Sequence[LinkInfo],
    joints: Sequence[JointInfo],
    base: str,
    report: LoadReport,
    file: Path,
) -> tuple[LinkInfo, ...]:
    """Return links whose base has a mass and inertia with which it moves freely."""
    return _Repair(links, report, file).move([free_body(joints, base)])


class _Repair:
    """Repair of one robot."""

    def __init__(
        self, links: Sequence[LinkInfo], report: LoadReport, file: Path
    ) -> None:
        """Mend what no body can have."""
        self._report = report
        self._file = file
        self._links = {link.name: link for link in links}
        for link in links:
            if link.inertial is not None:
                self._mend(link, link.inertial)

    def move(self, bodies: Iterable[Body]) -> tuple[LinkInfo, ...]:
        """Return the links, changed so that these bodies can move."""
        total = sum(link.mass for link in self._links.values())
        for body in bodies:
            names = [name for name, _ in body.links]
            if all(self._links[name].mass == 0.0 for name in names):
                self._add_mass(names, total, f"no mass, but {body.mover} it")
            placed = [self._inertial(name).moved(X) for name, X in body.links]
            if not body.can_turn(union(placed), _NOTHING):
                for name in names:
                    self._thicken(name, f"no inertia about {body.about}")
        return tuple(self._links.values())

    def _inertial(self, name: str) -> Inertial:
        """Return a link's inertial in its frame."""
        info = self._links[name].inertial
        if info is None:
            return Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
        inertial = Inertial(info.mass, np.zeros(3), info.tensor)
        return inertial.moved(info.origin.transform)

    def _mend(self, link: LinkInfo, info: InertialInfo) -> None:
        """Mend a link's inertial if no body can have it."""
        name, mass = link.name, info.mass
        if mass < LEAST_MASS:
            self._links[name] = dc.replace(link, inertial=None)
            if mass != 0.0:
                # As Gazebo's conversion takes it; what is below 0 was meant otherwise.
                text, done = repr(mass).removesuffix(".0"), "it is taken as massless"
                what = f"a mass of {text} kg"
                self._add(name, what, done, "warning" if mass > 0.0 else "error")
            elif np.nan_to_num(info.moments).any():
                what = "an inertia without mass"
                self._add(name, what, "it is taken as massless")
            return
        lacking = [n for n, m in zip(MOMENTS, info.moments, strict=True) if m != m]
        if lacking:
            part = "" if len(lacking) == len(MOMENTS) else f" {quoted(lacking)} of its"
            what = f"no{part} <inertia>, without which ROS takes no mass"
            self._add(name, what, "taken as 0")
        inertia = np.nan_to_num(info.tensor)
        self._links[name] = dc.replace(link, inertial=info.with_tensor(inertia))
        self._make_physical(name)

    def _make_physical(self, name: str) -> None:
        """Mend moments that no body has."""
        info = self._links[name].inertial
        if info is not None and not is_physical(info.tensor):
            what = f"no body has the principal moments {_moments(info.tensor)}"
            inertia = nearest_physical(info.mass, info.tensor)
            self._replace(name, inertia, what, "the nearest possible ones")

    def _add_mass(self, names: Sequence[str], total: float, what: str) -> None:
        """Give a mass to a moving body that has none: links, the first at the joint."""
        solids = {name: link_solid(self._links[name]) for name in names}
        for name, found in solids.items():
            if found is not None:
                solid, source = found
                inertial = solid.scaled(DENSITY * solid.mass)
                done = f"{DENSITY:g} kg/m^3 times the volume of {source}"
                self._set(name, inertial, what, done)
        if not any(solids.values()):
            inertial = ball(SMALL_RADIUS).scaled(max(SMALL_MASS, SMALL_PART * total))
            done = "it has no geometry to estimate from"
            self._set(names[0], inertial, what, done)

    def _thicken(self, name: str, what: str) -> None:
        """Give inertia about all axes to a link that is a point or a line of mass."""
        info = self._links[name].inertial
        if info is None:
            return
        what += f", principal moments {_moments(info.tensor)}"
        if info.tensor.any():
            done = "the nearest ones of a body that is no line"
            self._replace(name, _project(info.tensor), what, done)
        else:
            self._estimate(name, info, what)

    def _estimate(self, name: str, info: InertialInfo, what: str) -> None:
        """Give a link's mass the moments that it has in the link's shape."""
        found = link_solid(self._links[name])
        if found is None:
            radius = (info.mass / (DENSITY * 4.0 / 3.0 * math.pi)) ** (1.0 / 3.0)
            solid, done = ball(radius), f"those of a ball of {DENSITY:g} kg/m^3"
        else:
            solid, source = found
            done = f"those of {source}"
        R = info.origin.rotation
        inertia = R.T @ solid.scaled(info.mass).inertia @ R
        self._replace(name, np.asarray((inertia + inertia.T) / 2.0), what, done)

    def _set(self, name: str, inertial: Inertial, what: str, done: str) -> None:
        info = in_link_axes(inertial.mass, inertial.inertia, inertial.center)
        self._links[name] = dc.replace(self._links[name], inertial=info)
        moments = _moments(inertial.inertia)
        done = f"it gets {inertial.mass:.3g} kg and the moments {moments}, {done}"
        self._add(name, what, done)
        self._make_physical(name)

    def _replace(self, name: str, inertia: Array, what: str, done: str) -> None:
        link = self._links[name]
        assert link.inertial is not None
        info = link.inertial.with_tensor(inertia)
        self._links[name] = dc.replace(link, inertial=info)
        self._add(name, what, f"the moments are now {_moments(inertia)}, {done}")

    def _add(
        self, name: str, what: str, done: str, severity: Severity = "warning"
    ) -> None:
        where = f"link {name!r}"
        self._report.add(severity, "repair", what, done, where=where, file=self._file)


def in_link_axes(
    mass: float, inertia: Array, center: Sequence[float] | Array = (0.0, 0.0, 0.0)
) -> InertialInfo:
    """Return what a link weighs, in axes that are the link's [kg], [kg·m^2], [m]."""
    x, y, z = map(float, center)
    return InertialInfo(float(mass), Origin((x, y, z))).with_tensor(inertia)


def take_mass(link: LinkInfo, part: float) -> tuple[LinkInfo, float]:
    """Return a link with less mass and inertia by a part, and what it loses [kg]."""
    info = link.inertial
    if info is None:
        return link, 0.0
    rest = 1.0 - part
    less = dc.replace(info, mass=rest * info.mass).with_tensor(rest * info.tensor)
    return dc.replace(link, inertial=less), part * info.mass


def _moments(inertia: Array) -> str:
    moments = ", ".join(f"{m:.3g}" for m in np.linalg.eigvalsh(inertia))
    return f"({moments}) kg·m^2"
