"""Inertias that Drake can simulate with, in place of those that no body can have.

If every body that moves can move on its own, the robot's mass matrix is positive
definite; `bodies` says what that takes.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.bodies import Body, free_body, moving_bodies
from arm_drake.description.report import LoadReport
from arm_drake.description.solids import Inertial, ball, link_solid, read_origin, union

Array = NDArray[Any]

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

    Args:
        mass: Mass of the body [kg].
        inertia: Symmetric tensor about the centre of mass [kg·m^2], shape (3, 3).

    Raises:
        ValueError: If a number isn't finite, the mass not positive, or the tensor not
            symmetric.
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
    """Give what joints move a mass and inertia that it can move with.

    Args:
        root: The `<robot>` element, its numbers checked, its meshes converted.
        report: Where each repair is recorded.
        file: The file that the robot came from.
    """
    _repair(root, moving_bodies(root), report, file)


def repair_free_base(urdf: str, base: str, report: LoadReport, file: Path) -> str:
    """Return a robot's URDF with a base that can move freely.

    Args:
        urdf: The description as `repair_inertials` left it.
        base: The link that moves freely.
        report: Where each repair is recorded.
        file: The file that the robot came from.
    """
    root = ET.fromstring(urdf)  # noqa: S314  our own text.
    _repair(root, [free_body(root, base)], report, file)
    return ET.tostring(root, encoding="unicode")


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
                self._add(name, f"a mass of {text} kg", "it is taken as massless")
            elif inertia.any():
                what = "an inertia without mass"
                self._add(name, what, "it is taken as massless")
            return nothing
        if not np.isfinite(inertia).all():
            inertia = self._estimate(name, link, element, mass, "no finite inertia")
        elif not is_physical(inertia):
            old, inertia = inertia, nearest_physical(mass, inertia)
            what = f"no body has the principal moments {_moments(old)}"
            self._replace(name, element, inertia, what, "the nearest possible ones")
        R, p = read_origin(element)
        return Inertial(mass, np.zeros(3), inertia).moved(R, p)

    def add_mass(
        self, body: list[tuple[str, ET.Element]], total: float, what: str
    ) -> None:
        """Give a mass to a moving body that has none: links, the first at the joint."""
        solids = [(name, link, link_solid(link)) for name, link in body]
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
        found = link_solid(link)
        if found is None:
            radius = (mass / (DENSITY * 4.0 / 3.0 * math.pi)) ** (1.0 / 3.0)
            solid, done = ball(radius), f"those of a ball of {DENSITY:g} kg/m^3"
        else:
            solid, source = found
            done = f"those of {source}"
        R, _ = read_origin(element)
        inertia = R.T @ solid.scaled(mass).inertia @ R
        inertia = np.asarray((inertia + inertia.T) / 2.0)
        self._replace(name, element, inertia, what, done)
        return inertia

    def _set(
        self, name: str, link: ET.Element, inertial: Inertial, what: str, done: str
    ) -> None:
        element = ET.SubElement(link, "inertial")
        xyz = " ".join(repr(x) for x in inertial.center.tolist())
        ET.SubElement(element, "origin", xyz=xyz)
        ET.SubElement(element, "mass", value=repr(float(inertial.mass)))
        _set_tensor(element, inertial.inertia)
        moments = _moments(inertial.inertia)
        done = f"it gets {inertial.mass:.3g} kg and the moments {moments}, {done}"
        self._add(name, what, done)

    def _replace(
        self, name: str, element: ET.Element, inertia: Array, what: str, done: str
    ) -> None:
        _set_tensor(element, inertia)
        self._add(name, what, f"the moments are now {_moments(inertia)}, {done}")

    def _add(self, name: str, what: str, done: str) -> None:
        where = f"link {name!r}"
        self.report.add("warning", "repair", what, done, where=where, file=self.file)


def _read_tensor(inertial: ET.Element) -> Array:
    element = inertial.find("inertia")
    tensor = np.zeros((3, 3))
    if element is not None:
        for name, row, column in _PLACES:
            tensor[row, column] = tensor[column, row] = float(element.get(name, "0"))
    return tensor


def _set_tensor(inertial: ET.Element, tensor: Array) -> None:
    for element in inertial.findall("inertia"):
        inertial.remove(element)
    texts = {name: repr(float(tensor[row, column])) for name, row, column in _PLACES}
    ET.SubElement(inertial, "inertia", texts)


def _moments(inertia: Array) -> str:
    moments = ", ".join(f"{m:.3g}" for m in np.linalg.eigvalsh(inertia))
    return f"({moments}) kg·m^2"
