"""What Drake collides: the convex hull of a mesh, or convex parts of it."""

import importlib.metadata
import importlib.util
import io
import subprocess
import sys
from typing import Any

import numpy as np

from arm_drake.description.report import ReportEntry
from arm_drake.description.surfaces import Array, Surface
from arm_drake.errors import MissingExtraError

# Drake's convex hull needs a volume: a flat mesh gets this thickness [m].
_FLAT_THICKNESS = 1e-4
_FLATNESS = 1e-5  # Thickness as a part of the size; less is flat.

# More corners than this make contact slow, and no robot needs them.
_MANY_CORNERS = 20_000

# Meshes of torn triangles can keep the decomposition busy for hours.
DECOMPOSITION_TIMEOUT = 300.0  # s

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


def decompose(surfaces: list[Surface]) -> list[Array]:
    """Return the points of convex parts that cover a mesh, each of shape (n, 3).

    Raises:
        ValueError: The mesh can't be decomposed; the message says why.
    """
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    counts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [s.faces + first for s, first in zip(surfaces, counts, strict=False)]
    # Surfaces of one body share an edge where its colour changes.
    points, rows = np.unique(vertices, axis=0, return_inverse=True)
    mesh = {"vertices": points.astype(float), "faces": rows[np.concatenate(faces)]}
    stream = io.BytesIO()
    np.savez(stream, **mesh)
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


def encode_hull(points: Array, notes: list[ReportEntry]) -> bytes:
    """Return an OBJ file of the convex hull, faces outward.

    Args:
        points: [m], shape (n, 3); must not lie in one plane.
        notes: Receives that the hull has very many corners.
    """
    # Not at the top: the import takes longer than all hits of the cache together.
    from scipy.spatial import ConvexHull

    hull: Any = ConvexHull(points)
    faces = hull.simplices
    a, b, c = points[faces.T]
    is_inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces = np.where(is_inward[:, None], faces[:, ::-1], faces)
    used, rows = np.unique(faces, return_inverse=True)
    if len(used) > _MANY_CORNERS:
        what = f"its convex hull has {len(used)} corners"
        done = f"used; more than {_MANY_CORNERS} make contact slow"
        notes.append(ReportEntry("info", "unsupported", what, done))
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points[used].tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (rows.reshape(-1, 3) + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()
