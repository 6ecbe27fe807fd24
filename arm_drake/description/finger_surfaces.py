"""Collision meshes of fingers as they are, where something is to be held by them.

A hull fills the room between the pads of an L-shaped jaw and makes a wedge of it. Where
nothing can be held, hulls do, and contact takes less time.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

from arm_drake.description.geometry import SOURCE, SOURCE_SCALE
from arm_drake.description.meshes.conversion import convert_surface
from arm_drake.description.urdf import RobotDescription


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
