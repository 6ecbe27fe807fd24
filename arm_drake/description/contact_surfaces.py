"""Friction of links as their `<gazebo>` tags state it.

Gazebo takes the smaller one of the two coefficients of what touches (ODE and DART
alike). Drake takes their harmonic mean, and what states nothing, the ground too, has
a coefficient of 1. So a link that states mu gets mu / (2 - mu) here: with anything that
has 1 this makes min(mu, 1), as in Gazebo. Between two links that both state less it is
a bit more than the smaller one.

Collision meshes of fingers as they are, where something is to be held by them.

A hull fills the room between the pads of an L-shaped jaw and makes a wedge of it. Where
nothing can be held, hulls do, and contact takes less time.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from pathlib import Path

from arm_drake.description.elements import attribute, parse_number, text_of
from arm_drake.description.geometry import SOURCE, SOURCE_SCALE
from arm_drake.description.meshes.conversion import convert_surface
from arm_drake.description.urdf import RobotDescription

# What states no friction, or more, has this coefficient.
_USUAL = 1.0


def find_friction(description: RobotDescription) -> dict[str, float]:
    """Return the friction coefficients that links state, at most 1.

    The last of several tags counts. Numbers below 0, or none, are left out.

    Args:
        description: The robot.
    """
    root = ET.fromstring(description.source)  # noqa: S314  parsed before.
    found = {}
    for gazebo in root.iterfind("gazebo"):
        link = attribute(gazebo, "reference")
        for element in _coefficients(gazebo):
            mu = parse_number(text_of(element))
            if mu is not None and mu >= 0.0 and link in description.links:
                found[link] = min(mu, _USUAL)
    return found


def _coefficients(gazebo: ET.Element) -> Iterator[ET.Element]:
    yield from gazebo.iterfind("mu1")
    yield from gazebo.iterfind(".//surface/friction/ode/mu")


def for_drake(mu: float) -> float:
    """Return the coefficient that makes mu with what has 1, by Drake's harmonic mean.

    Args:
        mu: From 0 to 1.
    """
    return mu / (2.0 - mu)


def with_surfaces(
    description: RobotDescription, links: Collection[str]
) -> RobotDescription:
    """Return a description whose collision meshes are surfaces, not hulls.

    Args:
        description: The robot.
        links: Links whose meshes these are.

    Raises:
        OutputError: Neither the cache nor a temporary folder can be written.
    """
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    for link in root.iterfind("link"):
        if link.get("name") not in links:
            continue
        for mesh in link.iterfind("collision/geometry/mesh"):
            if mesh.get(SOURCE) is None:
                continue
            x, y, z = map(float, mesh.attrib[SOURCE_SCALE].split())
            surface = convert_surface(Path(mesh.attrib[SOURCE]), (x, y, z))
            if surface is not None:
                mesh.set("filename", surface.as_uri())
    return dc.replace(description, urdf=ET.tostring(root, encoding="unicode"))
