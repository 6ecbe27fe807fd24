"""Rollers for the wheels of mecanum and omni bases, so that they go sideways.

Descriptions have plain wheels, and simulators go with friction in one direction, which
Drake's contact doesn't know. So in the plant a wheel gets what it has in truth: rollers
at its rim, each of which turns freely. The description, and so joint states and frames,
stays as it is.
"""

import dataclasses as dc
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.base_wheels import MobileBase, rigid_links
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.link_tree import LinkTree
from arm_drake.description.solids import link_solid, read_origin
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

    Args:
        description: The robot.
        config: What the YAML configures.
        bases: What its controllers drive.
    """
    types = {controller.name: controller for controller in config.controllers}
    tree = _Tree(description)
    found: list[Rollers] = []
    for base in bases:
        controller = types[base.controller]
        if controller.type not in _RADIUS:
            continue
        given = controller.parameters.get(_RADIUS[controller.type])
        radius = given.value if given is not None else 0.0
        if not isinstance(radius, int | float):
            continue  # The controller doesn't load, and says why.
        is_mecanum = controller.type == MECANUM
        if is_mecanum and len(base.driven) != len(_TO_THE_RIGHT):
            continue
        for joint, is_right in zip(
            base.driven, _TO_THE_RIGHT * len(base.driven), strict=False
        ):
            sideways = (1.0 if is_right else -1.0) if is_mecanum else 0.0
            found += tree.rollers_of(base.link, joint, sideways, float(radius))
    return found


class _Tree:
    """Finds the wheels of a robot that lack rollers."""

    def __init__(self, description: RobotDescription) -> None:
        self._description = description
        self._tree = LinkTree(description)

    def rollers_of(
        self, base: str, joint: str, sideways: float, radius: float
    ) -> Iterator[Rollers]:
        """Yield the rollers of the wheel on a joint, if it lacks them.

        Args:
            base: The base link.
            joint: The joint.
            sideways: How far the roller's axis points to the right per unit forwards.
            radius: Radius of the wheel if its shape doesn't say [m].
        """
        link = self._description.joint(joint).child
        parts = rigid_links(self._description, link)
        below = [j for j in self._description.joints if j.parent in parts]
        if sum(j.type != "fixed" for j in below) >= _FEWEST_ROLLERS:
            return
        rim = self._find_rim(parts, radius)
        if rim is None:
            return
        name, center, radius = rim
        stand = self._tree.orientation(base)
        # Of the wheel, in the base.
        R_BW = stand.T @ self._tree.orientation(name)
        axis = stand.T @ self._tree.orientation(link) @ self._tree.axis(joint)
        left = axis * (-1.0 if axis[1] < 0.0 else 1.0)
        up = np.array([0.0, 0.0, 1.0])
        forward = np.cross(left, up)
        if radius <= 0.0 or np.linalg.norm(forward) < 0.5:
            return
        roller = forward / np.linalg.norm(forward) - sideways * left
        roller /= np.linalg.norm(roller)
        yield Rollers(
            name, radius, center, R_BW.T @ axis, R_BW.T @ -up, R_BW.T @ roller
        )

    def _find_rim(
        self, parts: Sequence[str], radius: float
    ) -> tuple[str, Array, float] | None:
        """Return link, centre [m] and radius [m] of a wheel's largest shape.

        That is a cylinder or sphere; else, with the radius that is given, the middle of
        what its link collides with.
        """
        found: tuple[str, Array, float] | None = None
        for name in parts:
            for shape in self._tree.links[name].iterfind("collision"):
                for tag in ("cylinder", "sphere"):
                    element = shape.find(f"geometry/{tag}")
                    own = 0.0 if element is None else float(element.get("radius", "0"))
                    if own > 0.0 and (found is None or own > found[2]):
                        found = (name, read_origin(shape)[1], own)
        if found is not None:
            return found
        for name in parts:
            solid = link_solid(self._tree.links[name])
            if (
                self._tree.links[name].find("collision") is not None
                and solid is not None
            ):
                return name, solid[0].center, radius
        return None
