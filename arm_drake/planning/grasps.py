"""Grasps: poses of a gripper from which its fingers close on a thing.

They are antipodal: the fingers press on two faces that are opposite to each other. Of a
box these are three pairs, of a cylinder its side at all angles and its ends, of a ball
all of it, of a mesh the facets of its hull that face away from each other.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from arm_drake.errors import InputError
from arm_drake.planning.grippers import Gripper, hull_corners
from arm_drake.plant.contact import hull_vertices

# What can be grasped.
GraspedShape: TypeAlias = Box | Capsule | Convex | Cylinder | Ellipsoid | Mesh | Sphere

# Directions of approach around a closing axis, and closing axes around a cylinder.
_APPROACHES, _TURNS = 16, 16

# Free space on either side of a thing before the fingers close [m], and the least.
_CLEARANCE, _LEAST_CLEARANCE = 5e-3, 1e-3

# How far gripper and what a thing stands on stay apart at least [m].
_ABOVE = 2e-3

# How deep points of the gripper may lie in a thing [m].
_OVERLAP = 5e-4

# How much of the pads' reach has to be on a thing.
_COVERED = 0.35

# Steps by which grasps are moved along the approach [m].
_STEP = 2e-3

# Facets of hulls are opposite if their normals are so nearly [rad]; friction of 0.5
# bears twice as much.
_OPPOSITE = 0.25


# Facets of a hull that are looked at, the largest.
_FACETS = 24


class Grasp(NamedTuple):
    """A pose of a gripper around a thing."""

    # Pose of the gripper's palm in the thing.
    X_OP: RigidTransform

    # Width of the thing between the fingers [m].
    width: float

    # How far the gripper is closed before it closes; 0 is open, 1 is closed.
    pre_grasp: float

    # Unit vector along which the gripper comes, in the frame of the thing, shape (3,).
    approach: np.ndarray

    # The less the better.
    cost: float


class _Pair(NamedTuple):
    """Two faces opposite to each other."""

    # Unit vector from one to the other, shape (3,), and the distance [m].
    axis: np.ndarray
    width: float

    # The middle between them, shape (3,).
    middle: np.ndarray


def find_grasps(
    gripper: Gripper,
    shape: GraspedShape,
    X_WO: RigidTransform,
    *,
    X_OG: RigidTransform | None = None,
) -> list[Grasp]:
    """Return grasps of a thing that stands somewhere, the best first.

    Grasps from above come before those from the side, and those at the thing's middle
    before others. What is around the thing and how far the arm reaches isn't looked at,
    but for the plane that its lowest point stands on.

    Args:
        gripper: The gripper.
        shape: The shape of the thing.
        X_WO: Its pose in the world.
        X_OG: The pose of the shape in the thing; None is the identity.

    Raises:
        InputError: If the shape is none that can be grasped.
    """
    X_OG = RigidTransform() if X_OG is None else X_OG
    corners = _corners(shape)
    pairs = list(_pairs(shape, corners))
    X_WG = X_WO @ X_OG
    heights = (X_WG.rotation().matrix() @ corners.T)[2] + X_WG.translation()[2]
    solid, lowest = _Solid(shape, corners), float(heights.min())
    # Around what is round, all pairs have one width.
    shells: dict[tuple[float, float], _Shell] = {}
    found: list[Grasp] = []
    for pair in pairs:
        key = (pair.width, solid.radius(pair.middle))
        if key not in shells and (shell := _find_shell(gripper, *key)):
            shells[key] = shell
        if key in shells:
            found += _around(gripper, solid, pair, X_WG, lowest, shells[key])
    found.sort(key=lambda grasp: grasp.cost)
    R = X_OG.rotation().matrix()
    return [g._replace(X_OP=X_OG @ g.X_OP, approach=R @ g.approach) for g in found]


def explain_no_grasp(gripper: Gripper, shape: GraspedShape) -> str:
    """Return why a shape can't be grasped, in words."""
    widths = [pair.width for pair in _pairs(shape, _corners(shape))]
    low, high = gripper.stroke
    if not widths:
        return "it has no two faces opposite to each other"
    if min(widths) > high - 2.0 * _LEAST_CLEARANCE:
        return (
            f"it is too large: {1e3 * min(widths):.1f} mm between the faces that are "
            f"closest, and the gripper opens {1e3 * high:.1f} mm"
        )
    if max(widths) < low:
        return (
            f"it is too small: at most {1e3 * max(widths):.1f} mm between two faces, "
            f"and the gripper closes to {1e3 * low:.1f} mm"
        )
    return "wherever the fingers would close, the gripper is in it or below its foot"


class _Shell(NamedTuple):
    """A gripper around things of a width, in the grasp frame [m]."""

    # How far it is closed then, and the pose of its grasp frame in the palm.
    closed: float
    X_PF: RigidTransform

    # Points of it that a thing can come to, shape (n, 3).
    near: np.ndarray

    # Points whose hull is what it sweeps while it closes, shape (m, 3).
    corners: np.ndarray


def _find_shell(gripper: Gripper, width: float, radius: float) -> _Shell | None:
    """Return a gripper around things of a width and radius, if they are for it."""
    low, high = gripper.stroke
    clearance = min(_CLEARANCE, 0.5 * (high - width))
    if clearance < _LEAST_CLEARANCE or width < low:
        return None
    closed = gripper.at(width + 2.0 * clearance).closed
    X_PF = gripper.pose(width, clearance)
    X_FP = X_PF.inverse().GetAsMatrix34()
    opened, gripping = (
        gripper.points(part) @ X_FP[:, :3].T + X_FP[:, 3]
        for part in (closed, gripper.at(width).closed)
    )
    # It is moved back as long as the pads are on the thing.
    near = np.linalg.norm(opened, axis=1) < radius + _most_shift(gripper, radius) + 1e-6
    # Fingers on an arc reach further when they have closed.
    corners = hull_corners(np.vstack([opened, gripping]))
    return _Shell(closed, X_PF, opened[near], corners)


def _most_shift(gripper: Gripper, depth: float) -> float:
    """Return how far back the pads still are on a thing of a depth [m]."""
    reach = gripper.pad[0]
    return max(0.0, reach + depth - 2.0 * reach * _COVERED)


def _around(
    gripper: Gripper,
    solid: "_Solid",
    pair: _Pair,
    X_WG: RigidTransform,
    floor: float,
    shell: _Shell,
) -> Iterator[Grasp]:
    """Yield the grasps of two faces."""
    x = pair.axis
    down = X_WG.rotation().matrix().T @ np.array([0.0, 0.0, -1.0])
    u = down - x * (x @ down)
    if np.linalg.norm(u) < 1e-6:
        u = np.eye(3)[int(np.argmin(np.abs(x)))]
        u = u - x * (x @ u)
    u /= np.linalg.norm(u)
    v = np.cross(x, u)
    for number in range(_APPROACHES):
        angle = 2.0 * math.pi * number / _APPROACHES
        z = math.cos(angle) * u + math.sin(angle) * v
        shift = _shift(gripper, solid, pair, z, X_WG, shell, floor)
        if shift is None:
            continue
        from_above = math.acos(np.clip(z @ down, -1.0, 1.0))
        cost = from_above + 20.0 * shift
        for sign in (1.0, -1.0):
            R = np.column_stack([sign * x, np.cross(z, sign * x), z])
            X_GF = RigidTransform(RotationMatrix(R), pair.middle - shift * z)
            X_GP = X_GF @ shell.X_PF.inverse()
            yield Grasp(X_GP, pair.width, shell.closed, z, cost)


def _shift(
    gripper: Gripper,
    solid: "_Solid",
    pair: _Pair,
    z: np.ndarray,
    X_WG: RigidTransform,
    shell: _Shell,
    floor: float,
) -> float | None:
    """Return how far back a grasp has to be for the gripper to be nowhere else [m].

    None if the pads would be too little on the thing then.
    """
    x = pair.axis
    R = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    X_GF = RigidTransform(R, pair.middle)
    at_middle = shell.near @ R.matrix().T + pair.middle
    z_W = X_WG.rotation().matrix() @ z
    up = (X_WG @ X_GF).GetAsMatrix34()[2]
    lowest, shift = float((shell.corners @ up[:3]).min() + up[3]), 0.0
    if lowest < floor + _ABOVE:
        if z_W[2] > -0.2:
            return None  # Further back isn't higher.
        shift = (floor + _ABOVE - lowest) / -z_W[2]
    reach, depth = gripper.pad[0], solid.depth(z, pair.middle)
    while 2.0 * reach * _COVERED <= reach + depth - shift:
        if not solid.contains(at_middle - shift * z).any():
            # From below, further back is lower.
            is_above = lowest - shift * z_W[2] > floor + _ABOVE - 1e-9
            return float(shift) if is_above else None
        shift += _STEP
    return None


class _Solid:
    """The room that a shape takes."""

    def __init__(self, shape: GraspedShape, corners: np.ndarray) -> None:
        self._corners = corners
        self._planes: np.ndarray | None = None
        self._round: GraspedShape | None = None
        if isinstance(shape, Sphere | Cylinder | Capsule | Ellipsoid):
            self._round = shape
        else:
            from scipy.spatial import ConvexHull

            self._planes = np.unique(ConvexHull(corners).equations.round(9), axis=0)

    def depth(self, z: np.ndarray, middle: np.ndarray) -> float:
        """Return how far it reaches from its middle towards where a gripper comes."""
        return float(np.max(-(self._corners - middle) @ z))

    def radius(self, middle: np.ndarray) -> float:
        """Return how far it reaches from its middle in any direction."""
        return float(np.linalg.norm(self._corners - middle, axis=1).max())

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return which points are in it, shape (n,)."""
        shape = self._round
        if self._planes is not None:
            heights = points @ self._planes[:, :3].T + self._planes[:, 3]
            return np.asarray(heights.max(axis=1) < -_OVERLAP)
        radial = np.hypot(points[:, 0], points[:, 1])
        if isinstance(shape, Sphere):
            return np.linalg.norm(points, axis=1) < shape.radius() - _OVERLAP
        if isinstance(shape, Ellipsoid):
            axes = np.array([shape.a(), shape.b(), shape.c()]) - _OVERLAP
            return np.linalg.norm(points / axes, axis=1) < 1.0
        assert isinstance(shape, Cylinder | Capsule)
        half = 0.5 * shape.length()
        if isinstance(shape, Cylinder):
            inside = np.abs(points[:, 2]) < half - _OVERLAP
            return inside & (radial < shape.radius() - _OVERLAP)
        past = np.maximum(np.abs(points[:, 2]) - half, 0.0)
        return np.hypot(radial, past) < shape.radius() - _OVERLAP


def _corners(shape: GraspedShape) -> np.ndarray:
    """Return points whose hull is about the shape, in its frame [m], shape (n, 3)."""
    if isinstance(shape, Box):
        signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
        return signs * np.array(shape.size())
    if isinstance(shape, Mesh | Convex):
        hull = shape.GetConvexHull()
        return hull_vertices(hull)
    ball = np.array(
        [
            [
                math.cos(2.0 * math.pi * i / 32) * math.sin(math.pi * j / 16),
                math.sin(2.0 * math.pi * i / 32) * math.sin(math.pi * j / 16),
                math.cos(math.pi * j / 16),
            ]
            for i in range(32)
            for j in range(17)
        ]
    )
    if isinstance(shape, Sphere):
        return shape.radius() * ball
    if isinstance(shape, Ellipsoid):
        return ball * np.array([shape.a(), shape.b(), shape.c()])
    if isinstance(shape, Capsule):
        ends = 0.5 * shape.length() * np.sign(ball[:, 2:].round(9))
        return shape.radius() * ball + ends * [0.0, 0.0, 1.0]
    if isinstance(shape, Cylinder):
        ring = shape.radius() * ball[8::17]
        up = np.array([0.0, 0.0, 0.5 * shape.length()])
        return np.vstack([ring + up, ring - up])
    raise InputError(f"no grasp of a {type(shape).__name__}; it is no body")


def _pairs(shape: GraspedShape, corners: np.ndarray) -> Iterator[_Pair]:
    """Yield the pairs of faces that are opposite to each other."""
    origin = np.zeros(3)
    if isinstance(shape, Box):
        for axis, width in zip(np.eye(3), shape.size(), strict=True):
            yield _Pair(axis, float(width), origin)
    elif isinstance(shape, Cylinder | Capsule | Sphere):
        turns = [math.pi * k / _TURNS for k in range(_TURNS)]
        for angle in turns:
            axis = np.array([math.cos(angle), math.sin(angle), 0.0])
            yield _Pair(axis, 2.0 * shape.radius(), origin)
        if isinstance(shape, Cylinder):
            yield _Pair(np.array([0.0, 0.0, 1.0]), shape.length(), origin)
    elif isinstance(shape, Ellipsoid):
        for axis, radius in zip(
            np.eye(3), (shape.a(), shape.b(), shape.c()), strict=True
        ):
            yield _Pair(axis, 2.0 * float(radius), origin)
    else:
        yield from _pairs_of_hull(corners)


def _pairs_of_hull(corners: np.ndarray) -> Iterator[_Pair]:
    """Yield the pairs of facets of a hull that face away from each other."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    normals, inverse = np.unique(
        hull.equations[:, :3].round(3), axis=0, return_inverse=True
    )
    a, b, c = (corners[hull.simplices[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    centers = (a + b + c) / 3.0
    flat = inverse.ravel()
    total = np.bincount(flat, areas)
    middles = np.column_stack(
        [np.bincount(flat, areas * centers[:, k]) / total for k in range(3)]
    )
    large = np.argsort(-total, kind="stable")[:_FACETS].tolist()
    for one in large:
        for other in large:
            if one < other and normals[one] @ normals[other] < -math.cos(_OPPOSITE):
                axis = normals[one] - normals[other]
                axis /= np.linalg.norm(axis)
                width = float(axis @ (middles[one] - middles[other]))
                aside = middles[one] - middles[other] - width * axis
                if width > 0.0 and np.linalg.norm(aside) < 0.5 * width + 0.005:
                    middle = 0.5 * (middles[one] + middles[other])
                    yield _Pair(axis, width, middle)
