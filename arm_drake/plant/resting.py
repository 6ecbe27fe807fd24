"""How a base rests on the ground: on the points that carry its centre of mass.

Gazebo drops a robot, and by the time its controllers are loaded it has settled. Here
they drive off at t = 0: a base whose caster is lower than its wheels would be driven by
wheels in the air, and rock.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.solvers import MathematicalProgram, Solve

from arm_drake.arrays import Array

# A base that would have to tilt by more than this slope isn't made to stand like this.
_LARGEST_SLOPE = 0.2

# Slopes that are rounding.
_LEVEL = 1e-6

# Rounds, and change of a slope, at which the search for the ground ends.
_ROUNDS = 20
_SAME = 1e-9


class PlacedShape(NamedTuple):
    """A collision shape of a robot, in the frame of its base."""

    shape: Shape

    # Its pose.
    X_BG: RigidTransform

    # Corners of its hull in its own frame [m], shape (n, 3); of a mesh or box.
    corners: Array


def placed_shape(
    inspector: SceneGraphInspector, geometry: GeometryId, X_BG: RigidTransform
) -> PlacedShape:
    """Return a collision shape with what is needed to find its lowest points.

    Args:
        inspector: What knows the shape.
        geometry: The shape.
        X_BG: Its pose.
    """
    shape = inspector.GetShape(geometry)
    corners = np.empty((0, 3))
    if not isinstance(shape, Sphere | Capsule | Cylinder | Ellipsoid):
        hull = None if isinstance(shape, Box) else inspector.GetConvexHull(geometry)
        box = inspector.GetObbInGeometryFrame(geometry)
        if hull is not None:
            corners = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        elif box is not None:
            signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1)
            corners = box.pose().multiply(box.half_width()[:, None] * signs).T
        else:  # A half space, whose highest points its origin is one of.
            corners = np.zeros((1, 3))
    return PlacedShape(shape, X_BG, corners)


def lowest_points(placed: PlacedShape, up: Array) -> Array:
    """Return points of a shape, the lowest ones among them [m], shape (n, 3).

    Args:
        placed: The shape.
        up: Direction away from the ground, of length 1.
    """
    return np.array([placed.X_BG @ point for point in _points(placed, up)])


def _points(placed: PlacedShape, up: Array) -> Iterator[Array]:
    shape, down = placed.shape, -(placed.X_BG.rotation().matrix().T @ up)
    if isinstance(shape, Sphere):
        yield shape.radius() * down
    elif isinstance(shape, Ellipsoid):
        axes = np.array([shape.a(), shape.b(), shape.c()])
        yield axes**2 * down / np.linalg.norm(axes * down)
    elif isinstance(shape, Capsule | Cylinder):
        axis = np.array([0.0, 0.0, shape.length() / 2.0])
        across = down * [1.0, 1.0, 0.0]
        length = np.linalg.norm(across)
        # Of a cylinder that stands, all points of the rim.
        rim = across / length if length > _LEVEL else np.array([1.0, 0.0, 0.0])
        turned = np.array([-rim[1], rim[0], 0.0])
        is_round = isinstance(shape, Capsule)
        directions = [down] if is_round else [rim, turned, -rim, -turned]
        for end in (-axis, axis):
            for direction in directions:
                yield end + shape.radius() * direction
    else:
        yield from placed.corners


def lowest_height(placed: PlacedShape) -> float:
    """Return the height of a shape's lowest point [m]."""
    return float(lowest_points(placed, np.array([0.0, 0.0, 1.0]))[:, 2].min())


def rest_on_ground(
    shapes: Sequence[PlacedShape], center_of_mass: Array
) -> RigidTransform:
    """Return the pose of a base that rests on the ground z = 0.

    Its joints stand still. Of all planes below the shapes, the ground is the one that
    is highest below the centre of mass; there the base has its least energy. If that
    asks for a large tilt, or the base falls over, it stays level on its lowest point.

    Args:
        shapes: Collision shapes of the robot in the frame of its base.
        center_of_mass: The robot's [m], in the frame of its base.

    Returns:
        Pose of the base: above the world's origin, with a yaw of 0.
    """
    if not shapes:
        return RigidTransform()
    lowest = min(lowest_height(placed) for placed in shapes)
    level = RigidTransform([0.0, 0.0, -lowest])
    plane, foot = np.array([0.0, 0.0, lowest]), center_of_mass[:2]
    points = np.empty((0, 3))
    for _ in range(_ROUNDS):
        up = _normal(plane)
        new = [lowest_points(placed, up) for placed in shapes]
        points = np.vstack([points, *new])
        found = _highest_plane_below(points, foot)
        if found is None:
            return level
        change, plane = np.abs(found - plane).max(), found
        up = _normal(plane)
        height = (center_of_mass - [0.0, 0.0, plane[2]]) @ up
        foot = (center_of_mass - height * up)[:2]
        if change < _SAME:
            break
    else:
        return level
    if np.abs(plane[:2]).max() < _LEVEL:
        return level
    forwards = np.array([1.0, 0.0, 0.0]) - up[0] * up
    forwards /= np.linalg.norm(forwards)
    R_BW = np.column_stack([forwards, np.cross(up, forwards), up])
    return RigidTransform(RotationMatrix(R_BW.T), [0.0, 0.0, -plane[2] * up[2]])


def _normal(plane: Array) -> Array:
    """Return the direction away from a plane z = a x + b y + c, (a, b, c)."""
    normal = np.array([-plane[0], -plane[1], 1.0])
    return normal / np.linalg.norm(normal)


def _highest_plane_below(points: Array, foot: Array) -> Array | None:
    """Return (a, b, c) of the plane z = a x + b y + c below points, highest at a place.

    Args:
        points: Shape (n, 3).
        foot: x and y of the place.

    Returns:
        The plane; None if it would be steeper than the largest slope.
    """
    program = MathematicalProgram()
    plane = program.NewContinuousVariables(3, "plane")
    below = np.column_stack([points[:, :2], np.ones(len(points))])
    program.AddLinearConstraint(
        below, np.full(len(points), -np.inf), points[:, 2], plane
    )
    limits = np.array([_LARGEST_SLOPE] * 2 + [np.inf])
    program.AddBoundingBoxConstraint(-limits, limits, plane)
    program.AddLinearCost(-np.array([*foot, 1.0]), 0.0, plane)
    result = Solve(program)
    found = np.asarray(result.GetSolution(plane))
    is_steep = np.abs(found[:2]).max() > 0.999 * _LARGEST_SLOPE
    return None if is_steep or not result.is_success() else found
