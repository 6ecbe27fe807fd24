"""Links that move together, and what inertia their joint needs.

Links fixed to each other are one body, as in Drake. What slides needs a mass, what
turns an inertia: about the joint's axis, or if the axis itself moves, about the
parallel one through the centre of mass.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.solids import Inertial, read_origin

Array = NDArray[Any]

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
        """Return whether the body has the inertia that its joint needs.

        Args:
            inertial: The links together, in the frame of the first one.
            tolerance: What part of the whole inertia is none.
        """
        if self._type == "prismatic":
            return True
        if self._type == "floating":
            moments = np.linalg.eigvalsh(inertial.inertia)
            return bool(moments[0] > tolerance * moments.sum())
        is_free = self._type == "planar"
        inertia = inertial.inertia if is_free else inertial.about(np.zeros(3))
        axis = _axis(self.joint)
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
                R_weld, p_weld = read_origin(weld)
                body.append((child, R @ R_weld, R @ p_weld + p))
    return body


def _axis(joint: ET.Element | None) -> Array:
    element = None if joint is None else joint.find("axis")
    text = "1 0 0" if element is None else element.get("xyz", "1 0 0")
    axis = np.array([float(number) for number in text.split()])
    return np.asarray(axis / (np.linalg.norm(axis) or 1.0))
