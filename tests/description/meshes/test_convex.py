import time

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from arm_drake.description.meshes import conversion as mut
from arm_drake.description.meshes.conversion import convert_collision
from tests.description.meshes.samples import (
    BOX,
    ONE,
    Converter,
    binary_stl,
    obj_arrays,
    obj_volume,
)

# What a hull may lack, as a part of the diagonal of its box: 0.5 mm of 0.5 m.
ERROR = 1e-3

TURN = Rotation.from_euler("xyz", [0.4, -0.7, 1.1]).as_matrix()


def ball(count=3000):
    points = np.random.default_rng(1).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def prism(sides, height=1.0, top=1.0):
    """Return the corners of a cylinder of many sides, or of a cone cut off."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return np.concatenate([ring, ring * [top, top, 1.0] + [0.0, 0.0, height]])


def lens():
    """Return two caps of a ball that meet in a sharp rim."""
    points = ball(40_000)
    cap = points[points[:, 2] > 0.95] - [0.0, 0.0, 0.95]
    rim = prism(300)[:300] * np.sqrt(1.0 - 0.95**2)
    return np.concatenate([cap, cap * [1.0, 1.0, -1.0], rim])


def shallow():
    """Return two caps, so flat that only the rim is seen from any side."""
    cap = ball() * [1.0, 1.0, 0.01]
    return np.concatenate([cap[np.abs(cap[:, 2]) > 0.005], prism(300)[:300]])


BODIES = {
    "ball": ball(),
    "rugby ball": ball() * [0.1, 0.2, 1.0],
    "coin": ball() * [1.0, 1.0, 0.01],
    "needle": ball() * [0.001, 0.001, 1.0],
    "cylinder": prism(1000),
    "disc": prism(1000, height=0.01),
    "cone": prism(1000, height=3.0, top=0.01),
    "lens": lens(),
    "shallow lens": shallow(),
    "box with round edges": np.concatenate(
        [0.1 * ball(300) + corner for corner in BOX]
    ),
    "tiny": ball() * 1e-6,
    "far away": ball() + 1000.0,
}
BODIES |= {f"turned {name}": points @ TURN.T for name, points in BODIES.items()}


@pytest.fixture(scope="module", params=BODIES)
def hulls(request):
    """Return the corners of a body's hull, and those that are left of them."""
    points = BODIES[request.param]
    corners = points[ConvexHull(points).vertices]
    return corners, mut.thin_hull(corners)


def diagonal(points):
    return np.linalg.norm(points.max(axis=0) - points.min(axis=0))


def distances(points, hull):
    """Return how far points that aren't inside of a hull are from it.

    What is nearest lies on one of the facets that are seen from a point.
    """
    heights = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    point, facet = np.nonzero(heights > 0.0)
    nearest = trimesh.triangles.closest_point(
        hull.points[hull.simplices[facet]], points[point]
    )
    found = np.full(len(points), np.inf)
    np.minimum.at(found, point, np.linalg.norm(nearest - points[point], axis=1))
    return np.where((heights <= 0.0).all(axis=1), 0.0, found)


@pytest.mark.slow
def test_a_thinned_hull_is_near_all_corners(hulls):
    corners, thinned = hulls

    # Of size 1, in the middle, for numbers of one size.
    middle, size = corners.mean(axis=0), diagonal(corners)
    body = ConvexHull((thinned - middle) / size)
    assert distances((corners - middle) / size, body).max() <= ERROR
    assert len(thinned) < 0.6 * len(corners)


def test_distances_are_those_from_a_box():
    points = np.array([[3.0, 0.5, 0.5], [2.0, 3.0, 0.0], [4.0, 5.0, 14.0], [1, 1, 1]])
    box = ConvexHull(
        np.array(np.meshgrid([0.0, 1], [0.0, 1], [0.0, 2])).T.reshape(-1, 3)
    )

    expected = [2.0, np.sqrt(1.0 + 4.0), 13.0, 0.0]
    np.testing.assert_allclose(distances(points, box), expected, atol=1e-12)


@pytest.mark.slow
def test_a_thinned_hull_has_corners_of_the_hull_and_its_box(hulls):
    corners, thinned = hulls

    assert set(map(tuple, thinned)) < set(map(tuple, corners))
    assert len(np.unique(thinned, axis=0)) == len(thinned)
    np.testing.assert_array_equal(thinned.min(axis=0), corners.min(axis=0))
    np.testing.assert_array_equal(thinned.max(axis=0), corners.max(axis=0))


@pytest.mark.slow
def test_a_thinned_hull_has_the_same_corners_every_time(hulls):
    corners, thinned = hulls

    np.testing.assert_array_equal(mut.thin_hull(corners.copy()), thinned)


@pytest.mark.parametrize(
    "corners",
    [BOX, BOX[[0, 1, 2, 4]], prism(64), prism(64, height=50.0), ball(128)],
    ids=["box", "tetrahedron", "cylinder", "rod", "ball of 128 corners"],
)
def test_a_hull_of_few_corners_stays_as_it_is(corners):
    np.testing.assert_array_equal(mut.thin_hull(corners), corners)


@pytest.mark.slow
def test_a_ball_of_many_corners_is_thinned_in_bounded_time():
    corners = ball(100_000)

    start = time.perf_counter()
    thinned = mut.thin_hull(corners)
    seconds = time.perf_counter() - start

    # Of a ball, the farthest point lies over the middle of the nearest facet. Facets
    # of this error are triangles of circumradius sqrt(2 e), so that a ball takes about
    # 4 pi / (3/4 sqrt(3) (2 e)) of them at best, half as many corners.
    allowed = ERROR * np.sqrt(12.0)
    whole, inner = (-ConvexHull(p).equations[:, 3].max() for p in (corners, thinned))
    assert whole - inner <= allowed
    assert len(thinned) < 4 * 2.0 * np.pi / (1.3 * 2.0 * allowed)
    # One second on a machine with nothing else to do.
    assert seconds < 18.0


@pytest.fixture
def converter(tmp_path):
    return Converter(tmp_path)


def triangles(corners):
    """Return an STL file of a convex body."""
    return binary_stl(corners, ConvexHull(corners).simplices)


@pytest.mark.slow
def test_a_collision_mesh_is_the_thinned_hull_of_its_file(converter):
    source = converter.write("ball.stl", triangles(ball()))

    path = converter.collision(source)

    points, faces = obj_arrays(path)
    assert len(points) < 1600
    # The OBJ file has nine digits, the STL file seven.
    left = np.abs(points[:, None] - ball().astype("<f4")).max(axis=2).min(axis=1)
    assert left.max() < 1e-8
    # A shell as thick as the error at most, all faces outward.
    volume = ConvexHull(ball()).volume
    assert obj_volume(path) == pytest.approx(ConvexHull(points).volume)
    assert volume - 4.0 * np.pi * ERROR * np.sqrt(12.0) < obj_volume(path) < volume
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    assert sorted(edges) == sorted([b, a] for a, b in edges)
    assert converter.lines == []


@pytest.mark.slow
def test_the_order_of_triangles_does_not_matter(converter):
    simplices = ConvexHull(ball()).simplices
    first = converter.write("a.stl", binary_stl(ball(), simplices))
    second = converter.write("b.stl", binary_stl(ball(), simplices[::-1]))

    paths = [converter.collision(first), converter.collision(second)]

    assert paths[0] != paths[1]
    assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.slow
def test_parts_of_a_decomposition_are_thinned(converter, monkeypatch):
    monkeypatch.setattr(mut, "decompose", lambda surfaces: [ball(), prism(1000)])
    source = converter.write("box.stl", binary_stl())

    paths = convert_collision(
        source,
        ONE,
        converter.report,
        where="",
        cache_dir=converter.cache,
        decompose=True,
    )

    for path, body in zip(paths, (ball(), prism(1000)), strict=True):
        assert len(obj_arrays(path)[0]) < 0.6 * len(body)
        assert obj_volume(path) == pytest.approx(ConvexHull(body).volume, rel=0.01)


def test_a_flat_mesh_of_many_corners_is_thinned_with_its_thickness(converter):
    ring = prism(1000)[:1000]
    faces = np.array([(0, i, i + 1) for i in range(1, 999)])
    source = converter.write("disc.stl", binary_stl(ring @ TURN.T, faces))

    points, _ = obj_arrays(converter.collision(source))

    assert len(points) < 1000
    local = points @ TURN
    np.testing.assert_allclose(np.abs(local[:, 2]), 0.5e-4, atol=1e-6)
    # Sides of a polygon that is short of the circle by the error.
    assert np.pi * (1.0 - 2.0 * ERROR * np.sqrt(8.0)) < ConvexHull(local[:, :2]).volume


@pytest.mark.parametrize("thickness", [1.1e-5, 1e-4])
def test_hulls_that_are_almost_flat_are_thinned(thickness):
    body = prism(1000, height=thickness * np.sqrt(8.0)) @ TURN.T
    points, is_flat = mut.solid_points(body)

    thinned = mut.thin_hull(points)

    assert not is_flat
    assert len(thinned) < 1000
    assert np.ptp(thinned @ TURN[:, 2]) == pytest.approx(np.ptp(points @ TURN[:, 2]))
