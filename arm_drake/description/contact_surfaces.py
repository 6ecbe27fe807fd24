"""Surfaces of links in contact: their friction, and their meshes instead of hulls.

Gazebo takes the smaller one of the two coefficients of what touches (ODE and DART
alike). Drake takes their harmonic mean, and what states nothing, the ground too, has
a coefficient of 1. So a link that states mu gets mu / (2 - mu) here: with anything that
has 1 this makes min(mu, 1), as in Gazebo. Between two links that both state less it is
a bit more than the smaller one.

A hull fills the room between the pads of an L-shaped jaw and makes a wedge of it. So
fingers collide as their meshes are where there is something to be held; elsewhere hulls
do, and contact takes less time.
"""

import copy
import dataclasses as dc
from collections.abc import Collection
from pathlib import Path

from arm_drake.description.meshes.conversion import convert_surface
from arm_drake.description.repairs import SOURCE, SOURCE_SCALE
from arm_drake.description.urdf import RobotDescription


def for_drake(mu: float) -> float:
    """Return what makes mu with a coefficient of 1, by Drake's harmonic mean."""
    return mu / (2.0 - mu)


def with_surfaces(
    description: RobotDescription, links: Collection[str]
) -> RobotDescription:
    """Return a description whose collision meshes are surfaces, not hulls."""
    root = copy.deepcopy(description.root)
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
    return dc.replace(description, root=root)
