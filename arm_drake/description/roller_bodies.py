"""The bodies of rollers, in the text that the plant is made of."""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.base_wheels import rigid_links
from arm_drake.description.link_tree import format_vector
from arm_drake.description.report import LoadReport
from arm_drake.description.rollers import NUM_ROLLERS, Rollers
from arm_drake.description.urdf import RobotDescription

Array = NDArray[Any]

# Part of the wheel's mass that its rollers have.
_PART: Final = 0.25

# Mass of the rollers of a wheel without mass [kg].
_SMALL: Final = 1e-2

_MOMENTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# URDF has no ellipsoid; Drake has one.
_DRAKE: Final = "http://drake.mit.edu"
ET.register_namespace("drake", _DRAKE)


def with_rollers(
    description: RobotDescription, rollers: Sequence[Rollers]
) -> RobotDescription:
    """Return a description whose text has the rollers of wheels.

    Only the text has them: the links and joints that it tells of are those of before.
    The wheels' own shapes to collide with are left out.

    Args:
        description: The robot.
        rollers: What `find_rollers` returns.
    """
    if not rollers:
        return description
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    for wheel in rollers:
        for name in rigid_links(description, wheel.link):
            for collision in links[name].findall("collision"):
                links[name].remove(collision)
        mass = _take(links[wheel.link]) / NUM_ROLLERS
        for number, body in enumerate(wheel.wheels):
            angle = 2.0 * math.pi * number / NUM_ROLLERS
            _add_roller(root, wheel, body, angle, mass)
    return dc.replace(description, urdf=ET.tostring(root, encoding="unicode"))


def _add_roller(
    root: ET.Element, wheel: Rollers, name: str, angle: float, mass: float
) -> None:
    """Add a roller where it is when the wheel has turned by an angle."""
    turn = _rotation(wheel.axis, angle)
    axis, out = turn @ wheel.roller, turn @ wheel.down
    place = wheel.center + (wheel.radius - wheel.thickness) * out
    long, thick = wheel.semi_axis, wheel.thickness
    link = ET.SubElement(root, "link", name=name)
    collision = ET.SubElement(link, "collision")
    geometry = ET.SubElement(collision, "geometry")
    sizes = {"a": repr(long), "b": repr(thick), "c": repr(thick)}
    ET.SubElement(geometry, f"{{{_DRAKE}}}ellipsoid", sizes)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=repr(mass))
    along, across = 0.4 * mass * thick**2, 0.2 * mass * (thick**2 + long**2)
    moments = {"ixx": along, "iyy": across, "izz": across}
    values = {name: repr(moments.get(name, 0.0)) for name in _MOMENTS}
    ET.SubElement(inertial, "inertia", values)
    joint = ET.SubElement(root, "joint", name=f"{name}:axle", type="continuous")
    ET.SubElement(joint, "parent", link=wheel.link)
    ET.SubElement(joint, "child", link=name)
    # The ellipsoid's long axis is x.
    yaw, pitch = math.atan2(axis[1], axis[0]), math.asin(-max(-1.0, min(1.0, axis[2])))
    rpy = f"0 {pitch!r} {yaw!r}"
    ET.SubElement(joint, "origin", xyz=format_vector(place), rpy=rpy)
    ET.SubElement(joint, "axis", xyz="1 0 0")


def report_rollers(
    description: RobotDescription, rollers: Sequence[Rollers], report: LoadReport
) -> None:
    """Record wheels that get rollers.

    Args:
        description: The robot.
        rollers: What `find_rollers` returns.
        report: Where they are recorded.
    """
    for wheel in rollers:
        report.add(
            "info",
            "repair",
            "a wheel of a base that goes sideways, without rollers",
            f"in the physics it has {NUM_ROLLERS} that turn freely",
            where=f"link {wheel.link!r}",
            file=description.file,
        )


def _take(link: ET.Element) -> float:
    """Take the rollers' part from a wheel's mass and inertia; return it [kg]."""
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return _SMALL
    whole = float(mass.get("value", "0"))
    mass.set("value", repr((1.0 - _PART) * whole))
    for inertia in inertial.iterfind("inertia"):
        for name, value in inertia.items():
            inertia.set(name, repr((1.0 - _PART) * float(value)))
    return _PART * whole or _SMALL


def _rotation(axis: Array, angle: float) -> Array:
    """Return the matrix of a turn about an axis of length 1."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Array = np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
    return turn
