"""The links and joints of a description's text, and how links stand at rest."""

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.solids import read_origin
from arm_drake.description.urdf import RobotDescription

Array = NDArray[Any]


class LinkTree:
    """The elements of a robot by name; directions with all joints at 0."""

    def __init__(self, description: RobotDescription) -> None:
        """Create it.

        Args:
            description: The robot.
        """
        root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
        self.links = {link.get("name", ""): link for link in root.iterfind("link")}
        self._joints = {j.get("name", ""): j for j in root.iterfind("joint")}
        self._carriers = {joint.child: joint for joint in description.joints}

    def orientation(self, link: str) -> Array:
        """Return the orientation of a link in its root, shape (3, 3)."""
        R = np.eye(3)
        while link in self._carriers:
            carrier = self._carriers[link]
            R = read_origin(self._joints[carrier.name])[0] @ R
            link = carrier.parent
        return R

    def axis(self, joint: str) -> Array:
        """Return the axis of a joint in its child link, of length 1, shape (3,)."""
        element = self._joints[joint].find("axis")
        xyz = "1 0 0" if element is None else element.get("xyz", "1 0 0")
        direction = np.array([float(x) for x in xyz.split()])
        return np.asarray(direction / np.linalg.norm(direction))


def format_vector(vector: Array) -> str:
    """Return a vector as URDF writes it, digit for digit."""
    return " ".join(repr(float(x)) for x in vector)
