"""A camera sees all points, and no closer one would.

Where points appear in the picture is computed here, with a pinhole camera.
"""

import itertools

import numpy as np
import pytest

from arm_drake.visualization.framing import Camera, View

BOX = np.array(list(itertools.product((0.2, 0.5), (-1.0, 1.0), (0.0, 3.0))))


def project(camera: Camera, view: View, points: np.ndarray) -> np.ndarray:
    """Return where points appear, -1 to 1 across and upwards, shape (n, 2)."""
    eye, target = np.array(camera.eye), np.array(camera.target)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    x, y, depth = np.stack([right, up, forward]) @ (points - eye).T
    assert (depth > 0.0).all()
    half_height = np.tan(view.field_of_view / 2.0)
    return (
        np.stack([x / (half_height * view.aspect), y / half_height], axis=1)
        / (depth[:, None])
    )


@pytest.mark.parametrize("aspect", [0.1, 0.5, 1.0, 4.0 / 3.0, 3.0])
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.8, -1.0, 0.45), (0, 1, -3)])
@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_all_points_are_inside_and_reach_the_margin_on_two_opposite_sides(
    aspect, direction, margin
):
    view = View(np.deg2rad(40.0), aspect, margin, direction)

    places = project(view.camera_for(BOX), view, BOX)

    free = 1.0 - 2.0 * margin
    lower, upper = places.min(axis=0), places.max(axis=0)
    assert (np.abs(places) <= free + 1e-9).all()
    fills = (upper > free - 1e-9) & (lower < -free + 1e-9)
    assert fills.any()


def test_the_camera_stands_where_a_square_fills_the_picture():
    square = np.array([[0.0, y, z] for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    view = View(np.deg2rad(90.0), 1.0, 0.0, (1.0, 0.0, 0.0))

    camera = view.camera_for(square)

    # tan(45°) = 1: as far away as the square is high on each side.
    np.testing.assert_allclose(camera.eye, (1.0, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(camera.target, (0.0, 0.0, 0.0), atol=1e-12)
    assert camera.distance == pytest.approx(1.0)


def test_the_camera_looks_from_the_direction():
    view = View(np.deg2rad(40.0), 1.5)

    camera = view.camera_for(BOX)

    to_camera = np.subtract(camera.eye, camera.target)
    expected = np.array(view.direction) / np.linalg.norm(view.direction)
    np.testing.assert_allclose(to_camera / np.linalg.norm(to_camera), expected)


def test_the_farthest_points_along_the_normals_are_all_that_matters():
    points = np.random.default_rng(1).normal(size=(500, 3))
    view = View(np.deg2rad(40.0), 1.5)

    farthest = points[(points @ view.normals().T).argmax(axis=0)]

    assert view.camera_for(farthest) == view.camera_for(points)


def test_size_and_place_of_the_points_move_the_camera_along():
    view = View(np.deg2rad(40.0), 1.5)
    camera = view.camera_for(BOX)

    other = view.camera_for(1000.0 * BOX + [1.0, 2.0, 3.0])

    expected = 1000.0 * np.array(camera.eye) + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(other.eye, expected, atol=0.01)


def test_a_single_point_is_seen_from_in_front_of_it():
    view = View(np.deg2rad(40.0), 1.5, direction=(1.0, 0.0, 0.0))

    camera = view.camera_for(np.array([[1.0, 2.0, 3.0]]))

    np.testing.assert_allclose(camera.target, (1.0, 2.0, 3.0), atol=1e-9)
    assert 0.0 < camera.distance < 0.01
