"""Beams of distance sensors."""

from collections.abc import Collection

import numpy as np
from pydrake.geometry import Mesh, QueryObject

from arm_drake.arrays import Array

# A beam that meets nothing on this way meets nothing at all [m].
_LONGEST = 100.0

# What is nearer than this is met [m].
_TOUCH = 1e-6

# Steps along a beam. Along a mesh they get short.
_MAX_STEPS = 1000


def find_range(
    query: QueryObject, start: Array, along: Array, own: Collection[int]
) -> float:
    """Return how far a beam goes to the first shape [m]; infinite if it meets none.

    Drake casts no rays. But it knows how far a shape is from a point of the beam, and
    in which direction; so far the beam is free from there. NaN is a beam so close along
    a mesh that this takes too long.

    Args:
        query: Where the shapes are.
        start: Start of the beam in the world [m], shape (3,).
        along: Its direction, of length 1, shape (3,).
        own: Numbers of the shapes that it passes through.
    """
    inspector, way = query.inspector(), 0.0
    for _ in range(_MAX_STEPS):
        free = np.inf
        for near in query.ComputeSignedDistanceToPoint(
            start + way * along, _LONGEST - way
        ):
            if near.id_G.get_value() in own:
                continue
            if near.distance < _TOUCH:
                return way
            if isinstance(inspector.GetShape(near.id_G), Mesh):
                free = min(free, near.distance)
            elif (nearing := -float(near.grad_W @ along)) > 0.0:
                # What is convex lies behind the plane in front of its nearest point.
                free = min(free, near.distance / nearing)
        way += free
        if way > _LONGEST:
            return np.inf
    return np.nan
