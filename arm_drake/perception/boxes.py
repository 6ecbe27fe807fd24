"""Boxes in point clouds: the plane that they stand on, clusters above it, their poses.

A camera sees two or three faces of a box. What it doesn't see follows from what it
stands on, and from the faces opposite; what doesn't follow is said, not guessed.
"""

import dataclasses as dc
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform, RotationMatrix

from arm_drake.arrays import Array, is_number
from arm_drake.errors import InputError
from arm_drake.importing import dataclass

# How many planes are looked at, and the least part of all points on one.
_PLANES, _LEAST_ON_PLANE = 4, 0.03

# Triples of points that a plane is tried through, and points that are then counted.
_TRIPLES, _COUNTED = 300, 4000

# How far a plane may be from level [rad].
_LEVEL = math.radians(15.0)

# How many points may be outside of a box, on each side.
_OUTSIDE: Final = 0.01

# Steps of yaw in a quarter of a turn [rad], coarse and fine.
_COARSE, _FINE = math.radians(1.0), math.radians(0.05)

# Points within this many times the noise are on a face or a plane.
_ON: Final = 3.0

# Points farther off than so many times the noise are of something else.
_ASIDE: Final = 4.0

# Points on the sides of what is round are by this nearer to a can or a ball.
_ROUNDER: Final = 0.85

# Fewer points than these on a face don't tell where it is.
_LEAST_ON_FACE: Final = 10


@dataclass(frozen=True)
class FoundBox:
    """Box found in a point cloud, or why none was found."""

    # Whether there is one, with pose and size.
    success: bool

    # Why not, in words.
    reason: str = ""

    # Pose of its middle in the frame of the points: z is the plane's normal, x is along
    # the longer side.
    pose: RigidTransform | None = None

    # Lengths along its x, y and z [m], shape (3,).
    size: NDArray[np.float64] | None = None

    # The plane that it stands on, n.p = d: unit vector n and d [m], shape (4,).
    plane: NDArray[np.float64] | None = None

    # How far its points are from its faces, root of the mean square [m].
    residual: float = 0.0

    # How many points are on it.
    count: int = 0

    # Other boxes in the cloud, the one with most points first.
    others: tuple["FoundBox", ...] = ()

    def __bool__(self) -> bool:
        """Return whether a box was found."""
        return self.success


class _Plane(NamedTuple):
    """A plane n.p = d, and which points are on it."""

    normal: Array
    distance: float
    is_on: NDArray[np.bool_]


class _Settings(NamedTuple):
    """Checked arguments of `find_box`."""

    up: Array | None
    noise: float
    gap: float
    largest: float
    least: int


def find_box(
    points: ArrayLike,
    *,
    up: Sequence[float] | None = (0.0, 0.0, 1.0),
    near: ArrayLike | None = None,
    size: ArrayLike | None = None,
    region: tuple[Sequence[float], Sequence[float]] | None = None,
    noise: float = 1e-3,
    gap: float = 0.015,
    largest: float = 0.4,
    least: int = 50,
    seed: int = 0,
) -> FoundBox:
    """Return the box that stands on a plane in a point cloud, or why none is found.

    Planes are found by RANSAC; what is above one and hangs together is taken for a box
    if it stands on the plane and its points lie on faces of one. Of several boxes it is
    the one with most points, unless `near` or `size` says which.

    Args:
        points: Points [m], shape (n, 3), as `CameraHandle.points` returns them; what
            isn't finite is left out. Pose and plane are in their frame.
        up: What is up in their frame; of "optical" points take None: the plane is the
            largest that is seen, whichever way it leans, and up is the camera's side.
        near: A point [m]; the box whose middle is nearest to it is wanted.
        size: Lengths of the three sides [m] in any order; the box that is likest to it
            is wanted.
        region: Least and largest x, y, z [m]; what is outside is left out.
        noise: Standard deviation of the points [m].
        gap: Points that are farther apart are of two things [m].
        largest: The longest side that a box may have [m].
        least: The least number of points on it.
        seed: Of RANSAC's random triples.

    Raises:
        InputError: If an argument is none of these.
    """
    settings = _check(up, noise, gap, largest, least)
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed: expected an integer of at least 0, got {seed!r}")
    near = None if near is None else _vector(near, "near")
    size = None if size is None else _vector(size, "size")
    cloud = _check_points(points, region)
    if len(cloud) < least:
        text = f"the cloud has {len(cloud)} finite points"
        return FoundBox(False, text + (" in the region" if region is not None else ""))
    found: list[FoundBox] = []
    reasons: list[str] = []
    random = np.random.default_rng(seed)
    for plane in _find_planes(cloud, settings, random):
        boxes, problems = _boxes_on(cloud, plane, settings)
        found += boxes
        if found and near is None and size is None:
            break
        reasons += problems or ["nothing is above the plane"]
    if not found:
        text = "no plane that anything could stand on"
        return FoundBox(False, "; ".join(dict.fromkeys(reasons)) or text)
    chosen, *others = sorted(found, key=lambda box: _rank(box, near, size))
    return dc.replace(chosen, others=tuple(others))


def _check(
    up: Sequence[float] | None, noise: float, gap: float, largest: float, least: int
) -> _Settings:
    for name, value in (("noise", noise), ("gap", gap), ("largest", largest)):
        if not is_number(value) or not 0.0 < value < math.inf:
            raise InputError(f"{name}: expected a length [m] above 0, got {value!r}")
    if not is_number(least) or not least >= 10:
        raise InputError(f"least: expected at least 10 points, got {least!r}")
    if up is None:
        return _Settings(None, noise, gap, largest, least)
    normal = _vector(up, "up")
    if not np.linalg.norm(normal) > 0.0:
        raise InputError(f"up: expected a direction, got {up!r}")
    return _Settings(normal / np.linalg.norm(normal), noise, gap, largest, least)


def _array(value: Any) -> Array:
    """Return an array; what is none is NaN, of no shape."""
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        return np.array(math.nan)


def _vector(value: Any, name: str) -> Array:
    vector = _array(value)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{name}: expected 3 finite numbers, got {value!r}")
    return vector


def _check_points(points: ArrayLike, region: Any) -> Array:
    cloud = _array(points)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise InputError(f"points: expected the shape (n, 3), got {cloud.shape}")
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if region is not None:
        if not isinstance(region, tuple | list) or len(region) != 2:
            text = f"expected least and largest x, y, z, got {region!r}"
            raise InputError(f"region: {text}")
        low, high = (_vector(each, "region") for each in region)
        cloud = cloud[((cloud >= low) & (cloud <= high)).all(axis=1)]
    return cloud


def _rank(box: FoundBox, near: Array | None, size: Array | None) -> tuple[float, int]:
    """Return how little a box is the one that is wanted."""
    assert box.pose is not None
    assert box.size is not None
    unlike = 0.0
    if near is not None:
        away = box.pose.translation() - near
        unlike += float(np.linalg.norm(away))
    if size is not None:
        unlike += float(np.linalg.norm(np.sort(box.size) - np.sort(size)))
    return unlike, -box.count


def _find_planes(
    cloud: Array, settings: _Settings, random: np.random.Generator
) -> Iterator[_Plane]:
    """Yield planes that things may stand on, the one with most points first."""
    left = np.arange(len(cloud))
    for _ in range(_PLANES):
        if len(left) < max(settings.least, _LEAST_ON_PLANE * len(cloud)):
            return
        guess = _guess_plane(
            cloud[random.permutation(left)[:_COUNTED]], settings, random
        )
        if guess is None:
            return
        plane = _refine(cloud, *guess, settings)
        if plane.is_on.sum() < _LEAST_ON_PLANE * len(cloud):
            return
        yield plane
        left = left[~plane.is_on[left]]


def _guess_plane(
    points: Array, settings: _Settings, random: np.random.Generator
) -> tuple[Array, float] | None:
    """Return normal and distance of the plane with most points, by RANSAC."""
    from scipy.spatial import cKDTree

    # Triples of near points are more often on one plane than any.
    tree, most, best = cKDTree(points), 0, None
    for first in random.integers(len(points), size=_TRIPLES):
        close = tree.query_ball_point(points[first], 5.0 * settings.gap)
        if len(close) < 3:
            continue
        a, b, c = points[random.choice(close, 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-12:
            continue
        normal /= length
        if settings.up is not None and abs(normal @ settings.up) < math.cos(_LEVEL):
            continue
        on = np.abs(points @ normal - a @ normal) < _ON * settings.noise
        if on.sum() > most:
            most, best = int(on.sum()), (normal, float(a @ normal))
    return best


def _refine(
    cloud: Array, normal: Array, distance: float, settings: _Settings
) -> _Plane:
    """Return the plane of least squares through the points that are on one."""
    on = np.abs(cloud @ normal - distance) < 2.0 * _ON * settings.noise
    for _ in range(4):
        middle = cloud[on].mean(axis=0)
        centred = cloud[on] - middle
        normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
        # The camera is above what it sees; of its own points it is the origin.
        is_down = normal @ middle > 0.0
        if settings.up is not None:
            is_down = normal @ settings.up < 0.0
        normal = -normal if is_down else normal
        distance = float(normal @ middle)
        on = np.abs(cloud @ normal - distance) < _ON * settings.noise
        if on.sum() < 3:
            break
    return _Plane(normal, distance, on)


def _boxes_on(
    cloud: Array, plane: _Plane, settings: _Settings
) -> tuple[list[FoundBox], list[str]]:
    """Return the boxes on a plane, and problems of the others."""
    heights = cloud @ plane.normal - plane.distance
    # What is nearer can't be told from the plane: of its many points some are off by
    # more than those that are on it, and three beside a small box make it a larger one.
    above = heights > _ASIDE * settings.noise
    boxes, problems = [], []
    R_FP = _level(plane.normal)
    is_under = (heights < -_ASIDE * settings.noise) & (heights > -settings.gap)
    under = cloud[is_under] @ R_FP - [0.0, 0.0, plane.distance]
    for index in _clusters(cloud[above], settings):
        points = cloud[above][index] @ R_FP - [0.0, 0.0, plane.distance]
        box = _fit(points, settings)
        if isinstance(box, str):
            problems.append(f"{_describe(points, R_FP, plane)}: {box}")
            continue
        X_PB, size, residual = box
        # What stands on a plane doesn't go on below it.
        local = X_PB.inverse() @ (under.T)
        near = 0.5 * size[:2, np.newaxis] + _ASIDE * settings.noise
        if (np.abs(local[:2]) < near).all(axis=0).sum() >= _LEAST_ON_FACE:
            problems.append(f"{_describe(points, R_FP, plane)}: it goes on below it")
            continue
        origin = RigidTransform(RotationMatrix(R_FP), plane.distance * plane.normal)
        equation = np.append(plane.normal, plane.distance)
        boxes.append(
            FoundBox(True, "", origin @ X_PB, size, equation, residual, len(points))
        )
    return boxes, problems


def _level(normal: Array) -> Array:
    """Return axes of which z is a plane's normal, as columns, shape (3, 3)."""
    across = np.zeros(3)
    across[np.argmin(np.abs(normal))] = 1.0
    x = np.cross(across, normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _describe(points: Array, R_FP: Array, plane: _Plane) -> str:
    """Return what a cluster is called in a reason."""
    middle = R_FP @ points.mean(axis=0) + plane.distance * plane.normal
    text = ", ".join(f"{value:.3f}" for value in middle)
    return f"a cluster of {len(points)} points at ({text})"


def _clusters(points: Array, settings: _Settings) -> list[NDArray[np.int64]]:
    """Return which points hang together, the most first; small ones are left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if len(points) == 0:
        return []
    # Cells instead of points: a cloud that is dense has as few of them.
    cells = np.floor(points / (settings.gap / 3.0)).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    pairs = cKDTree(points[first]).query_pairs(settings.gap, output_type="ndarray")
    count = len(first)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
    labels = connected_components(graph, directed=False)[1][cell.reshape(-1)]
    sizes = np.bincount(labels)
    order = np.argsort(-sizes, kind="stable")
    return [np.nonzero(labels == n)[0] for n in order if sizes[n] >= settings.least]


def _fit(
    points: Array, settings: _Settings
) -> tuple[RigidTransform, Array, float] | str:
    """Return pose, size and residual of a box on the plane z = 0, or what is wrong."""
    noise, heights = settings.noise, points[:, 2]
    if heights.min() > settings.gap:
        return f"it is {heights.min():.3f} m above the plane"
    if np.ptp(points, axis=0).max() > math.sqrt(3.0) * settings.largest:
        return f"it is larger than {settings.largest} m"
    top = float(np.percentile(heights, 100.0 * (1.0 - _OUTSIDE)))
    on_top = heights > top - 2.0 * _ON * noise
    # An edge of a side is as high as the top, and has few points.
    has_top = on_top.sum() > 0.1 * len(points) and _covers(points[on_top], noise)
    if has_top:
        top = float(np.median(heights[heights > top - _ON * noise]))
        on_top = np.abs(heights - top) < _ON * noise
    sides = points[~on_top, :2] if has_top else points[:, :2]
    yaw = _find_yaw(points[:, :2], sides, noise)
    turned = points[:, :2] @ _turn(yaw)
    low, high, is_seen = _edges(turned, sides @ _turn(yaw), noise)
    lengths = high - low
    is_thin = lengths.min() < 2.0 * _ON * noise
    if not has_top and (is_thin or not is_seen.any(axis=1).all()):
        return "one face of it is seen; how deep it is can't be told"
    if is_thin:
        return "it is thinner than the noise"
    size = np.array([*lengths, top])
    if size.max() > settings.largest:
        return f"it is larger than {settings.largest} m"
    middle = np.array([*(_turn(yaw) @ (0.5 * (low + high))), 0.5 * top])
    if size[0] < size[1]:
        size, yaw = size[[1, 0, 2]], yaw + 0.5 * math.pi
    X_PB = RigidTransform(RotationMatrix.MakeZRotation(yaw), middle)
    away = _distances((points - middle) @ X_PB.rotation().matrix(), size)
    residual = _rms(away)
    if residual > 3.0 * noise:
        return f"its points are {residual:.4f} m off the faces of a box"
    aside = float(np.mean(np.abs(away) > _ASIDE * noise))
    if aside > _OUTSIDE:
        text = "it is no box, or touches something"
        return f"{100.0 * aside:.0f} % of its points are off the faces of a box: {text}"
    beside = ~on_top if has_top else np.ones(len(points), bool)
    if beside.sum() >= _LEAST_ON_FACE and _off_round(points[beside], size) < (
        _ROUNDER * _rms(away[beside])
    ):
        return "it is round"
    return X_PB, size, residual


def _rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _off_round(sides: Array, size: Array) -> float:
    """Return how far points of sides are from an upright can, or a ball [m]."""
    found = math.inf
    for count in (2, 3):
        # |p|^2 = 2 c.p + r^2 - |c|^2 is linear in the middle c and the last two.
        p = sides[:, :count] - sides[:, :count].mean(axis=0)
        A = np.column_stack([2.0 * p, np.ones(len(p))])
        *c, rest = np.linalg.lstsq(A, np.square(p).sum(axis=1), rcond=None)[0]
        radius = math.sqrt(max(rest + np.square(c).sum(), 0.0))
        if radius < size[:count].max():
            found = min(found, _rms(np.linalg.norm(p - c, axis=1) - radius))
    return found


def _covers(points: Array, noise: float) -> bool:
    """Return whether points cover an area, not a line or a corner alone."""
    covariance = np.cov(points[:, :2].T)
    return bool(np.sqrt(12.0 * np.linalg.eigvalsh(covariance)[0]) > 2.5 * _ON * noise)


def _turn(yaw: float) -> Array:
    """Return the axes of a box that is turned, as columns, shape (2, 2)."""
    return np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])


def _find_yaw(points: Array, sides: Array, noise: float) -> float:
    """Return how a box is turned [rad]: points of sides are on edges of a rectangle.

    As rectangles are fitted to scans of lidars by closeness (Zhang, Xu, Dong and Dolan,
    2017), and where no side is seen, by area.
    """
    random = np.random.default_rng(0)
    all_ = points if len(points) <= 3000 else random.choice(points, 3000, axis=0)
    some = sides if len(sides) <= 2000 else random.choice(sides, 2000, axis=0)
    by_sides = len(sides) >= max(3 * _LEAST_ON_FACE, 0.03 * len(points))

    def cost(yaw: float) -> float:
        turn = _turn(yaw)
        low, high = _bounds(all_ @ turn)
        if not by_sides:
            return float(np.prod(high - low))
        near = some @ turn
        away = np.minimum(np.abs(near - low), np.abs(near - high)).min(axis=1)
        return float(np.minimum(away, 10.0 * noise).mean()) + 1e-3 * float(
            np.sum(high - low)
        )

    yaws = np.arange(0.0, 0.5 * math.pi, _COARSE)
    best = min(yaws, key=cost)
    fine = np.arange(best - _COARSE, best + _COARSE, _FINE)
    return float(min(fine, key=cost))


def _bounds(points: Array) -> tuple[Array, Array]:
    """Return where points begin and end along each axis, but for a few."""
    share = 100.0 * _OUTSIDE
    low, high = np.percentile(points, [0.3 * share, 100.0 - 0.3 * share], axis=0)
    return np.asarray(low), np.asarray(high)


def _edges(
    points: Array, sides: Array, noise: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the sides of a rectangle, each shape (2,), and which are seen, (2, 2).

    Where points are on a face it is in their middle; the others end with the top.
    """
    low, high = _bounds(points)
    edges, is_seen = [low.copy(), high.copy()], np.zeros((2, 2), bool)
    for axis in range(2):
        for end, edge in enumerate(edges):
            on = np.abs(sides[:, axis] - edge[axis]) < _ON * noise
            across = sides[on, 1 - axis]
            width = (high - low)[1 - axis]
            # The end of another face is a narrow strip.
            if on.sum() < _LEAST_ON_FACE or np.ptp(across) < 0.5 * width:
                continue
            is_seen[axis, end] = True
            edge[axis] = np.median(sides[on, axis])
    return edges[0], edges[1], is_seen


def _distances(points: Array, size: Array) -> Array:
    """Return how far points are from a box around the origin, its bottom left out."""
    beyond = np.abs(points) - 0.5 * size
    beyond[:, 2] = points[:, 2] - 0.5 * size[2]
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))
