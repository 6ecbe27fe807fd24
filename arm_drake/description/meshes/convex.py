"""What Drake collides: the convex hull of a mesh, or convex parts of it."""

import importlib.metadata
import importlib.util
import io
import itertools
import subprocess
import sys
from typing import Any

import numpy as np

from arm_drake.description.meshes.surfaces import Array, Surface
from arm_drake.errors import MissingExtraError

# Drake's convex hull needs a volume: a flat mesh gets this thickness [m].
_FLAT_THICKNESS = 1e-4
_FLATNESS = 1e-5  # Thickness as a part of the size; less is flat.

# How far a thinned hull may be from the mesh, as a part of its size: half a millimetre
# of a link of half a metre, less than its hull adds where it is hollow. Drake computes
# hulls again at every load, and contact takes longer with every corner.
TOLERANCE = 1e-3

# What people draw by hand has fewer corners: a cylinder of 64 sides has these.
FEW_CORNERS = 128

# Distances between points and planes that are in memory at a time.
_MAX_DISTANCES = 100_000

# Meshes of torn triangles can keep the decomposition busy for hours.
DECOMPOSITION_TIMEOUT = 300.0  # s

# Contact takes longer with every piece.
_MAX_PIECES = 200

# In a process of its own: the library can't be interrupted, and it prints.
_DECOMPOSE = """
import io, os, sys
import numpy as np
result = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)
import coacd
mesh = np.load(io.BytesIO(sys.stdin.buffer.read()))
coacd.set_log_level("off")
parts = coacd.run_coacd(coacd.Mesh(mesh["vertices"], mesh["faces"]), seed=0)
np.savez(result, *(points for points, _ in parts))
"""


def require_decomposition() -> str:
    """Return the version of the library that decomposes.

    Raises:
        MissingExtraError: It isn't installed.
    """
    if importlib.util.find_spec("coacd") is None:
        raise MissingExtraError("convex decomposition of meshes", "decompose")
    return importlib.metadata.version("coacd")


def split(surfaces: list[Surface]) -> list[Array]:
    """Return the points of each piece of a mesh, each of shape (n, 3).

    Pieces share no corner with each other, as the walls of a house or the legs of a
    table often don't. A mesh of very many pieces is one.
    """
    # Not at the top: most robots are loaded without it, and it takes longest of all.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points, faces = _joined(surfaces)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    edges = coo_array(
        (np.ones(len(ends), dtype=bool), (ends[:, 0], ends[:, 1])),
        shape=(len(points), len(points)),
    )
    _, labels = connected_components(edges, directed=False)
    used = np.unique(labels[faces])
    if len(used) > _MAX_PIECES:
        return [points]
    pieces = [solid_points(points[labels == label])[0] for label in used]
    return [piece for piece in pieces if len(piece)]


def decompose(surfaces: list[Surface]) -> list[Array]:
    """Return the points of convex parts that cover a mesh, each of shape (n, 3).

    Raises:
        ValueError: The mesh can't be decomposed; the message says why.
    """
    points, faces = _joined(surfaces)
    stream = io.BytesIO()
    np.savez(stream, vertices=points, faces=faces)
    try:
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-c", _DECOMPOSE],
            input=stream.getvalue(),
            capture_output=True,
            timeout=DECOMPOSITION_TIMEOUT,
        )
    except subprocess.TimeoutExpired:
        limit = f"{DECOMPOSITION_TIMEOUT:.0f} s"
        raise ValueError(f"its decomposition takes more than {limit}") from None
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise ValueError(f"its decomposition failed ({last or done.returncode})")
    with np.load(io.BytesIO(done.stdout)) as parts:
        found = [solid_points(parts[name])[0] for name in parts.files]
    found = [points for points in found if len(points)]
    if not found:
        raise ValueError("its decomposition gave no parts")
    return found


def _joined(surfaces: list[Surface]) -> tuple[Array, Array]:
    """Return different corners, shape (n, 3), and triangles of them, shape (m, 3)."""
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    counts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [s.faces + first for s, first in zip(surfaces, counts, strict=False)]
    # Surfaces of one body share an edge where its colour changes.
    points, rows = np.unique(vertices, axis=0, return_inverse=True)
    return points.astype(float), rows.ravel()[np.concatenate(faces)]


def solid_points(points: Array) -> tuple[Array, bool]:
    """Return points that span a volume, and whether they had to be made to.

    Args:
        points: [m], shape (n, 3).

    Returns:
        Different points; none if they are on a line. Points in a plane are moved to
        both of its sides, 0.1 mm apart or more.
    """
    points = np.unique(points.astype(float), axis=0)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    # Rows of `axes` are the principal axes, the thinnest last.
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    extents = np.ptp(centred @ axes.T, axis=0)
    if extents[1] <= _FLATNESS * size:
        return np.empty((0, 3)), False
    if extents[2] <= _FLATNESS * size:
        offset = axes[2] * max(_FLAT_THICKNESS, 2.0 * _FLATNESS * size) / 2.0
        return np.concatenate([points - offset, points + offset]), True
    return points, False


def thin_hull(corners: Array) -> Array:
    """Return some corners of a convex hull, whose own hull is nearly the same.

    The hull of what is returned lies in the given one and has the same bounding box. No
    corner is farther from it than `TOLERANCE` times the diagonal of that box. Up to
    `FEW_CORNERS` corners are returned as they are.

    It begins with the farthest corners in fixed directions. Then each facet takes the
    corner farthest from it, until all that are left are near enough.

    Args:
        corners: All corners of the hull [m], shape (n, 3); they span a volume.
    """
    if len(corners) <= FEW_CORNERS:
        return corners
    # Not at the top: the import takes longer than all hits of the cache together.
    from scipy.spatial import ConvexHull

    tolerance = TOLERANCE * np.linalg.norm(np.ptp(corners, axis=0))
    taken = _first_corners(corners)
    left = np.setdiff1d(np.arange(len(corners)), taken)
    while True:
        points = corners[taken]
        hull: Any = ConvexHull(points)
        nearest, height = _nearest_planes(corners[left], hull.equations)
        distance = _distances(corners[left], points[hull.simplices[nearest]], height)
        # The hull only grows: what is near enough remains so.
        is_far = distance > tolerance
        if not is_far.any():
            return corners[np.sort(taken)]
        left, nearest, distance = left[is_far], nearest[is_far], distance[is_far]
        farthest = np.full(len(hull.equations), -1)
        order = np.argsort(distance, kind="stable")
        farthest[nearest[order]] = left[order]  # Of several, the last one stays.
        added = farthest[farthest >= 0]
        taken = np.concatenate([taken, added])
        left = np.setdiff1d(left, added)


def _first_corners(corners: Array) -> Array:
    """Return rows of corners far apart, which span the bounding box and a volume."""
    directions = np.array(
        [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)]
    )
    rows = (corners @ directions.T).argmax(axis=0).tolist()
    # A simplex as fat as it can be: farthest from a point, then from a line, a plane.
    rest = corners - corners[rows[0]]
    for _ in range(3):
        length = np.linalg.norm(rest, axis=1)
        row = int(length.argmax())
        rows.append(row)
        axis = rest[row] / length[row]
        rest = rest - np.outer(rest @ axis, axis)
    return np.unique(rows)


def _nearest_planes(points: Array, equations: Array) -> tuple[Array, Array]:
    """Return the plane that each point is farthest outside of, and how far."""
    nearest = np.empty(len(points), int)
    height = np.empty(len(points))
    step = max(1, _MAX_DISTANCES // len(equations))
    for start in range(0, len(points), step):
        rows = slice(start, start + step)
        heights = points[rows] @ equations[:, :3].T + equations[:, 3]
        nearest[rows] = heights.argmax(axis=1)
        height[rows] = heights[np.arange(len(heights)), nearest[rows]]
    return nearest, height


def _distances(points: Array, triangles: Array, height: Array) -> Array:
    """Return the distances of points from triangles, one each, 0 below the plane.

    Args:
        points: Shape (n, 3).
        triangles: Their corners, shape (n, 3, 3).
        height: Over the planes of the triangles, shape (n,).
    """
    edges = np.roll(triangles, -1, axis=1) - triangles
    offsets = points[:, None] - triangles
    along = (offsets * edges).sum(axis=2) / (edges * edges).sum(axis=2)
    nearest = along.clip(0.0, 1.0)[..., None] * edges
    to_edges = np.linalg.norm(offsets - nearest, axis=2).min(axis=1)
    normals = np.cross(edges[:, :1], edges[:, 1:2])
    is_above = ((np.cross(edges, offsets) * normals).sum(axis=2) > 0.0).all(axis=1)
    return np.where(height <= 0.0, 0.0, np.where(is_above, height, to_edges))


def encode_hull(points: Array) -> bytes:
    """Return an OBJ file of the convex hull, thinned by `thin_hull`, faces outward.

    Args:
        points: [m], shape (n, 3); must not lie in one plane.
    """
    from scipy.spatial import ConvexHull

    hull: Any = ConvexHull(points)
    corners = points[np.unique(hull.simplices)]
    thinned = thin_hull(corners)
    if len(thinned) < len(corners):
        points, hull = thinned, ConvexHull(thinned)
    faces = hull.simplices
    a, b, c = points[faces.T]
    is_inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces = np.where(is_inward[:, None], faces[:, ::-1], faces)
    used, rows = np.unique(faces, return_inverse=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points[used].tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (rows.reshape(-1, 3) + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()
