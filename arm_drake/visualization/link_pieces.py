"""What is drawn of each link, and where in the link: frames, inertia, axes, hulls."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Cylinder, Ellipsoid, MeshcatCone, Rgba, Role
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia

from arm_drake.arrays import Array
from arm_drake.description.inertia import DENSITY
from arm_drake.visualization.drawn_robot import DrawnRobot
from arm_drake.visualization.solids import Solid, collision_solid

# Length of a triad, as a part of the robot's size, and of the distance to what is near:
# between the fingers of a hand they are shorter than at an arm, yet not too short.
_LONGEST, _SHORTEST = 0.08, 0.03
_OF_DISTANCE = 0.8

# Links that are closer are in the same place, as a part of the robot's size.
_SAME_PLACE = 1e-3

# Length of an arrow in lengths of a triad.
_ARROW = 1.5

# Radius of an axis of a triad, as a part of its length.
_TRIAD_RADIUS = 0.035

# Radii of an arrow's shaft and head, and length of its head, as parts of its length.
_SHAFT_RADIUS, _HEAD_RADIUS, _HEAD = 0.035, 0.1, 0.3

# Semi-axes of an ellipsoid are at least this part of the robot's size: a rod and a
# point of mass are seen, too.
_THINNEST = 2e-3

_AXES = (
    ("x", Rgba(0.95, 0.1, 0.1)),
    ("y", Rgba(0.1, 0.8, 0.1)),
    ("z", Rgba(0.15, 0.25, 1.0)),
)
_COLLISION = Rgba(1.0, 0.45, 0.0, 0.5)
_INERTIA = Rgba(0.6, 0.15, 0.85, 0.5)
_REVOLUTE = Rgba(1.0, 0.8, 0.0)
_PRISMATIC = Rgba(0.0, 0.8, 0.9)


class Piece(NamedTuple):
    """Something that moves with a link."""

    link: str

    # Unique among the pieces of the link and its kind.
    name: str
    solid: Solid
    rgba: Rgba

    # Its pose in the link.
    X_LP: RigidTransform

    # Whether it is seen through the robot, in which it would hide.
    is_on_top: bool = False


def frame_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield a triad for each link: x red, y green, z blue."""
    for link, length in _lengths(robot).items():
        axis = Cylinder(_TRIAD_RADIUS * length, length)
        for index, (name, rgba) in enumerate(_AXES):
            X_LP = _along(np.eye(3)[index], length / 2.0)
            yield Piece(link, name, axis, rgba, X_LP, is_on_top=True)


def collision_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield what of each link collides, see `collision_solid`."""
    inspector = robot.inspector
    for body, link, X_LB in robot.parts:
        for index, geometry in enumerate(robot.shapes(body, Role.kProximity)):
            solid = collision_solid(inspector, geometry)
            if solid is not None:
                X_LP = X_LB @ inspector.GetPoseInFrame(geometry)
                name = f"{body.name()} {index}"
                yield Piece(link, name, solid, _COLLISION, X_LP)


def inertia_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield an ellipsoid for each body with mass, see `equivalent_ellipsoid`."""
    for body, link, X_LB in robot.parts:
        found = equivalent_ellipsoid(body.default_spatial_inertia())
        if found is not None:
            semi_axes, X_BE = found
            semi_axes = np.maximum(semi_axes, _THINNEST * robot.size)
            solid = Ellipsoid(*semi_axes.tolist())
            yield Piece(link, body.name(), solid, _INERTIA, X_LB @ X_BE)


def axis_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield an arrow for each joint of one degree of freedom.

    It starts at the joint's frame, which is that of its child link, and points along
    the axis of the description: yellow for joints that turn, cyan for those that slide.
    """
    lengths = _lengths(robot)
    flip = RigidTransform(RotationMatrix.MakeXRotation(np.pi))
    for info in robot.description.movable_joints:
        length = _ARROW * lengths[info.child]
        shaft_length = (1.0 - _HEAD) * length
        shaft = Cylinder(_SHAFT_RADIUS * length, shaft_length)
        # Its tip is at its origin, and it opens along z.
        head = MeshcatCone(_HEAD * length, *2 * [_HEAD_RADIUS * length])
        joint = robot.plant.GetJointByName(info.name, robot.model)
        slides = isinstance(joint, PrismaticJoint)
        axis = joint.translation_axis() if slides else joint.revolute_axis()
        X_LM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        rgba = _PRISMATIC if slides else _REVOLUTE
        X_LS = X_LM @ _along(axis, shaft_length / 2.0)
        yield Piece(info.child, "shaft", shaft, rgba, X_LS, is_on_top=True)
        X_LH = X_LM @ _along(axis, length) @ flip
        yield Piece(info.child, "head", head, rgba, X_LH, is_on_top=True)


# In the order in which they are offered.
PIECES: dict[str, Callable[[DrawnRobot], Iterator[Piece]]] = {
    "frames": frame_pieces,
    "collision": collision_pieces,
    "inertia": inertia_pieces,
    "joint_axes": axis_pieces,
}


def equivalent_ellipsoid(
    inertia: SpatialInertia,
) -> tuple[Array, RigidTransform] | None:
    """Return the solid ellipsoid of uniform density with a body's mass and inertia.

    An inertia that no body has is shown as a sphere of that mass and of the density of
    water, so that it is seen where the mass is.

    Args:
        inertia: The body's, about its origin.

    Returns:
        Semi-axes [m], shape (3,), and the ellipsoid's pose in the body; None for a body
        without mass, or if mass or centre of mass are no finite numbers.
    """
    mass, center = inertia.get_mass(), inertia.get_com()
    if not (0.0 < mass < np.inf and np.isfinite(center).all()):
        return None
    if inertia.IsPhysicallyValid():
        found = inertia.CalcPrincipalSemiDiametersAndPoseForSolidEllipsoid()
        return np.asarray(found[0]), found[1]
    radius = (mass / (DENSITY * 4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
    return np.full(3, radius), RigidTransform(center)


def _lengths(robot: DrawnRobot) -> dict[str, float]:
    """Return the length of each link's triad [m]."""
    places = np.array([X_WL.translation() for X_WL in robot.link_poses.values()])
    distances = np.linalg.norm(places[:, None] - places, axis=2)
    distances[distances < _SAME_PLACE * robot.size] = np.inf
    lengths = np.clip(
        _OF_DISTANCE * distances.min(axis=1),
        _SHORTEST * robot.size,
        _LONGEST * robot.size,
    )
    return dict(zip(robot.link_poses, lengths.tolist(), strict=True))


def _along(axis: Array, distance: float) -> RigidTransform:
    """Return a pose at a distance along an axis, with its z along the axis."""
    return RigidTransform(
        RotationMatrix.MakeFromOneVector(axis, axis_index=2), distance * axis
    )
