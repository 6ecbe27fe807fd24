"""Rollers for the wheels of mecanum and omni bases, so that they go sideways.

Descriptions have plain wheels, and simulators go with friction in one direction, which
Drake's contact doesn't know. So in the plant a wheel gets what it has in truth: rollers
at its rim, each of which turns freely. The description, and so joint states and frames,
stays as it is.
"""

import copy
import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.base_wheels import (
    MobileBase,
    add_axle,
    add_turning_link,
    format_vector,
    link_orientation,
    rigid_links,
    unit_axis,
)
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.inertia import link_solid, take_mass
from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription

Array = NDArray[Any]

MECANUM: Final = "mecanum_drive_controller/MecanumDriveController"
OMNI: Final = "omni_wheel_drive_controller/OmniWheelDriveController"

# Parameters with the radius of the wheels [m].
_RADIUS: Final = {MECANUM: "kinematics.wheels_radius", OMNI: "wheel_radius"}

# Of a mecanum wheel that touches the ground with a roller: whether the roller's axis
# points to the right, seen forwards. The order is that of the joints' parameters: front
# left, front right, rear right, rear left.
_TO_THE_RIGHT: Final = (True, False, True, False)

# Rollers of a wheel, and their radius at the middle as part of the wheel's. With these
# the rim is round to 0.1 % of the radius, see `Rollers.semi_axis`.
NUM_ROLLERS: Final = 10
_THICKNESS: Final = 0.25

# A wheel with so many joints of its own has its rollers; one may be an encoder's.
_FEWEST_ROLLERS: Final = 3


@dc.dataclass(frozen=True, eq=False)
class Rollers:
    """The rollers of a wheel."""

    # Link of the wheel, and its radius [m].
    link: str
    radius: float

    # Centre of the wheel [m], in the link. Shape (3,).
    center: Array

    # In the link, of length 1, shapes (3,): the axis of the wheel; down, if the robot
    # stands upright with its joints at 0; the axis of the roller that is down there.
    axis: Array
    down: Array
    roller: Array

    @property
    def wheels(self) -> list[str]:
        """Names of the bodies that turn."""
        return [f"{self.link}:roller{number}" for number in range(NUM_ROLLERS)]

    @property
    def thickness(self) -> float:
        """Radius of a roller at its middle [m]."""
        return _THICKNESS * self.radius

    @property
    def semi_axis(self) -> float:
        """Half the length of a roller, an ellipsoid, along its axis [m].

        It is such that the wheel's centre is as high where two rollers touch the ground
        as where one does with its middle.
        """
        R, r = self.radius, self.thickness
        half = math.pi / NUM_ROLLERS
        # Of the roller's axis, upwards, when the wheel has turned by this angle.
        slope = np.linalg.norm(np.cross(self.roller, self.axis)) * math.sin(half)
        reach = R - (R - r) * math.cos(half)
        return math.sqrt(r**2 + (reach**2 - r**2) / slope**2)


def find_rollers(
    description: RobotDescription,
    config: ControllerManagerConfig,
    bases: Iterable[MobileBase],
) -> list[Rollers]:
    """Return the rollers that the wheels of mecanum and omni bases lack.

    A wheel whose description has three joints of its own has its rollers. The radius is
    that of the wheel's largest cylinder or sphere to collide with, else what the
    controller says.
    """
    types = {controller.name: controller for controller in config.controllers}

    found: list[Rollers] = []
    for base in bases:
        controller = types[base.controller]
        if controller.type not in _RADIUS:
            continue
        parameter = controller.parameters.get(_RADIUS[controller.type])
        radius = parameter.value if parameter is not None else 0.0
        if not isinstance(radius, int | float):
            continue  # The controller doesn't load, and says why.
        is_mecanum = controller.type == MECANUM
        if is_mecanum and len(base.driven) != len(_TO_THE_RIGHT):
            continue
        for joint, is_right in zip(
            base.driven, _TO_THE_RIGHT * len(base.driven), strict=False
        ):
            sideways = (1.0 if is_right else -1.0) if is_mecanum else 0.0
            wheel = description.joint(joint)
            found += _rollers_of(description, base.link, wheel, sideways, float(radius))
    return found


def _rollers_of(
    description: RobotDescription,
    base: str,
    mover: JointInfo,
    sideways: float,
    radius: float,
) -> Iterator[Rollers]:
    """Yield the rollers of the wheel on a joint, if it lacks them."""
    link = mover.child
    parts = rigid_links(description, link)
    below = [j for j in description.joints if j.parent in parts]
    if sum(j.type != "fixed" for j in below) >= _FEWEST_ROLLERS:
        return
    rim = _find_rim(description, parts, radius)
    if rim is None:
        return
    name, center, radius = rim
    stand = link_orientation(description, base)
    # Of the wheel, in the base.
    R_BW = stand.T @ link_orientation(description, name)
    R_BL = stand.T @ link_orientation(description, link)
    axis = R_BL @ unit_axis(mover)
    left = axis * (-1.0 if axis[1] < 0.0 else 1.0)
    up = np.array([0.0, 0.0, 1.0])
    forward = np.cross(left, up)
    if radius <= 0.0 or np.linalg.norm(forward) < 0.5:
        return
    roller = forward / np.linalg.norm(forward) - sideways * left
    roller /= np.linalg.norm(roller)
    yield Rollers(name, radius, center, R_BW.T @ axis, R_BW.T @ -up, R_BW.T @ roller)


def _find_rim(
    description: RobotDescription, parts: Sequence[str], radius: float
) -> tuple[str, Array, float] | None:
    """Return link, centre [m] and radius [m] of a wheel's largest shape.

    That is a cylinder or sphere; else, with the radius that is given, the middle of
    what its link collides with.
    """
    found: tuple[str, Array, float] | None = None
    for name in parts:
        for shape in description.link(name).collisions:
            own = shape.wheel_radius
            if own > 0.0 and (found is None or own > found[2]):
                found = (name, shape.origin.position, own)
    if found is not None:
        return found
    for name in parts:
        link = description.link(name)
        solid = link_solid(link)
        if link.collisions and solid is not None:
            return name, solid[0].center, radius
    return None


# Part of the wheel's mass that its rollers have.
_PART: Final = 0.25

# Mass of the rollers of a wheel without mass [kg].
_SMALL: Final = 1e-2

# URDF has no ellipsoid; Drake has one.
_DRAKE: Final = "http://drake.mit.edu"
ET.register_namespace("drake", _DRAKE)


def with_rollers(
    description: RobotDescription, rollers: Sequence[Rollers]
) -> RobotDescription:
    """Return a description whose URDF has the rollers of wheels.

    Only the URDF has them: the links and joints that it tells of are those of before.
    The wheels' own shapes to collide with are left out.
    """
    if not rollers:
        return description
    root = copy.deepcopy(description.root)
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    for wheel in rollers:
        for name in rigid_links(description, wheel.link):
            for collision in links[name].findall("collision"):
                links[name].remove(collision)
        mass = (take_mass(links[wheel.link], _PART) or _SMALL) / NUM_ROLLERS
        for number, body in enumerate(wheel.wheels):
            angle = 2.0 * math.pi * number / NUM_ROLLERS
            _add_roller(root, wheel, body, angle, mass)
    return dc.replace(description, root=root)


def _add_roller(
    root: ET.Element, wheel: Rollers, name: str, angle: float, mass: float
) -> None:
    """Add a roller where it is when the wheel has turned by an angle."""
    turn = _rotation(wheel.axis, angle)
    axis, out = turn @ wheel.roller, turn @ wheel.down
    place = wheel.center + (wheel.radius - wheel.thickness) * out
    long, thick = wheel.semi_axis, wheel.thickness
    collision = ET.Element("collision")
    geometry = ET.SubElement(collision, "geometry")
    sizes = {"a": repr(long), "b": repr(thick), "c": repr(thick)}
    ET.SubElement(geometry, f"{{{_DRAKE}}}ellipsoid", sizes)
    along, across = 0.4 * mass * thick**2, 0.2 * mass * (thick**2 + long**2)
    # The ellipsoid's long axis is x.
    yaw, pitch = math.atan2(axis[1], axis[0]), math.asin(-max(-1.0, min(1.0, axis[2])))
    add_turning_link(root, name, collision, mass, np.diag([along, across, across]))
    origin = {"xyz": format_vector(place), "rpy": f"0 {pitch!r} {yaw!r}"}
    add_axle(root, f"{name}:axle", (wheel.link, name), origin, "1 0 0")


def report_rollers(
    description: RobotDescription, rollers: Sequence[Rollers], report: LoadReport
) -> None:
    """Record wheels that get rollers."""
    what = "a wheel of a base that goes sideways, without rollers"
    done = f"in the physics it has {NUM_ROLLERS} that turn freely"
    for wheel in rollers:
        where, file = f"link {wheel.link!r}", description.file
        report.add("info", "repair", what, done, where=where, file=file)


def _rotation(axis: Array, angle: float) -> Array:
    """Return the matrix of a turn about an axis of length 1."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Array = np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
    return turn
