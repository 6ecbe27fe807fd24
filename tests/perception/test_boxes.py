"""Boxes found in clouds, judged by the boxes that the clouds were made of."""

import math
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.worlds.things import Thing, with_things
from arm_drake.worlds.world import load_world

_NOISE = 1e-3

# Where a face isn't seen, the top's last points tell where it is: by some noise.
_NEAR = 1.5e-3
_EYE = (0.6, 0.1, 0.4)


def rotate(yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def spread(low: list[float], high: list[float], seed: int = 1) -> np.ndarray:
    """Return points on a rectangle, one for each 2 mm²."""
    extent = np.subtract(high, low)
    count = int(np.prod(extent[extent > 0.0]) / 2e-6)
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def make_box(
    size: tuple[float, ...], middle: tuple[float, ...], yaw: float, eye: Any = _EYE
) -> np.ndarray:
    """Return points on the faces of a box that an eye sees."""
    half, R, faces = 0.5 * np.array(size), rotate(yaw), []
    e = R.T @ (np.array(eye) - middle)
    for axis in range(3):
        if abs(e[axis]) > half[axis]:
            low, high = -half, half.copy()
            low[axis] = high[axis] = np.sign(e[axis]) * half[axis]
            faces.append(spread(list(low), list(high)) @ R.T + middle)
    return np.vstack(faces)


def make_table(height: float = 0.0, half: float = 0.25) -> np.ndarray:
    return spread([-half, -half, height], [half, half, height])


def blur(*parts: np.ndarray) -> np.ndarray:
    cloud = np.vstack(parts)
    return cloud + np.random.default_rng(2).normal(0.0, _NOISE, cloud.shape)


def turned_by(box: ad.FoundBox, yaw: float) -> float:
    """Return by how much a box is turned from a yaw, but for half turns [rad]."""
    assert box.pose is not None
    R = rotate(yaw).T @ box.pose.rotation().matrix()
    angle = math.atan2(R[1, 0], R[0, 0])
    return abs((angle + math.pi / 2) % math.pi - math.pi / 2)


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.785, -1.2])
@pytest.mark.parametrize("height", [0.02, 0.06])
def test_a_box_seen_from_one_side_is_found_whole(yaw: float, height: float) -> None:
    size, middle = (0.08, 0.05, height), (0.05, -0.02, 0.5 * height)

    found = ad.find_box(blur(make_table(), make_box(size, middle, yaw)))

    assert found, found.reason
    assert found.pose is not None
    np.testing.assert_allclose(found.pose.translation(), middle, atol=_NEAR)
    np.testing.assert_allclose(found.size, size, atol=2e-3)
    assert turned_by(found, yaw) < math.radians(1.5)
    np.testing.assert_allclose(found.plane, [0.0, 0.0, 1.0, 0.0], atol=2e-3)


@pytest.mark.slow
def test_an_eye_below_the_top_sees_two_sides_and_they_suffice() -> None:
    size, middle, eye = (0.08, 0.05, 0.1), (0.0, 0.0, 0.05), (0.5, 0.3, 0.08)

    found = ad.find_box(blur(make_table(), make_box(size, middle, 0.2, eye)))

    assert found, found.reason
    assert found.pose is not None
    np.testing.assert_allclose(found.pose.translation(), middle, atol=2e-3)
    np.testing.assert_allclose(found.size, size, atol=3e-3)


def test_of_one_face_the_depth_is_not_guessed() -> None:
    face = make_box((0.08, 0.05, 0.1), (0.0, 0.0, 0.05), 0.0, (0.5, 0.0, 0.08))

    found = ad.find_box(blur(make_table(), face))

    assert not found
    assert found.reason.endswith("one face of it is seen; how deep it is can't be told")


@pytest.mark.slow
def test_it_is_found_in_any_frame() -> None:
    size, middle = (0.08, 0.05, 0.04), (0.05, -0.02, 0.02)
    cloud = blur(make_table(), make_box(size, middle, 0.3))
    # An optical frame: z ahead, from the eye to the middle.
    z = np.subtract(middle, _EYE) / np.linalg.norm(np.subtract(middle, _EYE))
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R_WC = np.column_stack([x, np.cross(z, x), z])

    found = ad.find_box((cloud - _EYE) @ R_WC, up=None)

    assert found, found.reason
    assert found.pose is not None
    back = R_WC @ found.pose.translation() + _EYE
    np.testing.assert_allclose(back, middle, atol=_NEAR)
    np.testing.assert_allclose(R_WC @ found.pose.rotation().matrix()[:, 2], [0, 0, 1],
                               atol=1e-2)  # fmt: skip


@pytest.mark.slow
def test_a_table_is_not_taken_for_the_ground_nor_for_a_box() -> None:
    size, middle = (0.06, 0.04, 0.05), (0.0, 0.0, 0.425)
    ground = spread([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0])
    table, box = make_table(0.4), make_box(size, middle, 0.5)

    found = ad.find_box(blur(ground[::4], table, box), largest=0.3)

    assert found, found.reason
    assert found.pose is not None
    np.testing.assert_allclose(found.pose.translation(), middle, atol=_NEAR)


@pytest.mark.slow
def test_of_several_the_one_is_returned_that_is_meant() -> None:
    large = ((0.08, 0.06, 0.05), (0.1, 0.1, 0.025))
    small = ((0.03, 0.02, 0.03), (-0.1, -0.1, 0.015))
    cloud = blur(make_table(), *(make_box(*each, 0.4) for each in (large, small)))

    by_count = ad.find_box(cloud)
    by_place = ad.find_box(cloud, near=(-0.1, -0.1, 0.0))
    by_size = ad.find_box(cloud, size=(0.02, 0.03, 0.03))

    for found, (size, _) in ((by_count, large), (by_place, small), (by_size, small)):
        np.testing.assert_allclose(found.size, size, atol=2e-3)
        assert len(found.others) == 1


def test_what_strays_from_the_table_beside_a_small_box_does_not_count() -> None:
    size, middle, yaw = (0.025, 0.025, 0.025), (0.03, -0.05, 0.0125), 0.4
    # Of the table's hundred thousand points two dozen are so far off.
    beside = [[0.022, y, 3.5 * _NOISE - 0.0125] for y in (-0.009, 0.0, 0.009)]
    strays = np.array(beside) @ rotate(yaw).T + middle
    cloud = blur(make_table(), make_box(size, middle, yaw))

    found = ad.find_box(np.vstack([cloud, strays]))

    assert found.pose is not None, found.reason
    np.testing.assert_allclose(found.pose.translation(), middle, atol=_NEAR)


@pytest.mark.slow
def test_the_one_that_is_meant_may_stand_on_a_smaller_plane() -> None:
    ground = spread([-1.0, -1.0, 0.0], [1.0, 1.0, 0.0])
    size, middle = (0.06, 0.04, 0.05), (0.0, 0.0, 0.425)
    large = make_box((0.2, 0.2, 0.2), (-0.8, 0.0, 0.1), 0.0)
    table = make_table(0.4, 0.15)
    cloud = blur(ground[::20], large, table, make_box(size, middle, 0.5))

    by_place = ad.find_box(cloud, near=middle, largest=0.25)
    by_size = ad.find_box(cloud, size=size, largest=0.25)

    for found in (by_place, by_size):
        assert found.pose is not None, found.reason
        np.testing.assert_allclose(found.pose.translation(), middle, atol=_NEAR)


@pytest.mark.slow
def test_what_is_no_box_is_not_called_one() -> None:
    angles = np.random.default_rng(0).uniform(0.0, math.pi, (3000, 2))
    ball = 0.04 * np.stack(
        [
            np.sin(angles[:, 0]) * np.cos(angles[:, 1]),
            np.sin(angles[:, 0]) * np.sin(angles[:, 1]),
            1.0 + np.cos(angles[:, 0]),
        ],
        axis=1,
    )

    found = ad.find_box(blur(make_table(), ball))

    assert not found
    assert "off the faces of a box" in found.reason


def make_can(radius: float, height: float) -> np.ndarray:
    """Return points on the side of a can that the eye sees, and on its top."""
    random = np.random.default_rng(1)
    middle = math.atan2(_EYE[1], _EYE[0])
    count = int(math.pi * radius * height / 2e-6)
    angle = middle + random.uniform(-0.5 * math.pi, 0.5 * math.pi, count)
    z, on_top = random.uniform(0.0, height, count), int(radius * count / height)
    around = random.uniform(0.0, 2.0 * math.pi, on_top)
    r = radius * np.sqrt(random.uniform(0.0, 1.0, on_top))
    side = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    top = [r * np.cos(around), r * np.sin(around), np.full(on_top, height)]
    return np.vstack([side, np.column_stack(top)])


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.01, 0.015, 0.03])
def test_a_can_is_not_called_a_box(radius: float) -> None:
    noisy = ad.find_box(blur(make_table(), make_can(radius, 0.05)))
    exact = ad.find_box(np.vstack([make_table(), make_can(radius, 0.05)]))

    assert not noisy
    assert not exact


@pytest.mark.slow
@pytest.mark.parametrize(("x", "height"), [(-0.055, 0.01), (0.07, 0.035)])
def test_two_boxes_that_touch_are_not_measured_as_one(x: float, height: float) -> None:
    tall = make_box((0.08, 0.05, 0.05), (0.0, 0.0, 0.025), 0.0)
    low = make_box((0.03 if x < 0 else 0.06, 0.05, height), (x, 0.0, 0.5 * height), 0.0)

    found = ad.find_box(blur(make_table(), tall, low))

    assert not found
    assert "off the faces of a box" in found.reason


@pytest.mark.parametrize(
    ("cloud", "reason"),
    [
        (np.zeros((0, 3)), "the cloud has 0 finite points"),
        (np.full((99, 3), np.nan), "the cloud has 0 finite points"),
        (make_table(), "nothing is above the plane"),
        (make_table() @ np.diag([0, 1, 1]) + [[0, 0, 0.3]], "no plane that anything"),
    ],
)
def test_why_nothing_is_found_is_said(cloud: np.ndarray, reason: str) -> None:
    upright = cloud[:, [2, 1, 0]] if "no plane" in reason else cloud

    found = ad.find_box(upright)

    assert not found
    assert found.reason.startswith(reason)
    assert found.pose is None


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        ([[0.0, 0.0]], {}, "points: expected the shape (n, 3), got (1, 2)"),
        ([[0.0] * 3], {"noise": 0.0}, "noise: expected a length [m] above 0, got 0.0"),
        ("cloud", {}, "points: expected the shape (n, 3), got ()"),
        ([[0.0] * 3], {"gap": "5"}, "gap: expected a length [m] above 0, got '5'"),
        ([[0.0] * 3], {"up": "z"}, "up: expected 3 finite numbers, got 'z'"),
        ([[0.0] * 3], {"up": (0, 0, 0)}, "up: expected a direction, got (0, 0, 0)"),
        ([[0.0] * 3], {"least": 3}, "least: expected at least 10 points, got 3"),
        (
            [[0.0] * 3],
            {"near": (1.0,)},
            "near: expected 3 finite numbers, got (1.0,)",
        ),
        (
            [[0.0] * 3],
            {"seed": -1},
            "seed: expected an integer of at least 0, got -1",
        ),
        (
            [[0.0] * 3],
            {"seed": "x"},
            "seed: expected an integer of at least 0, got 'x'",
        ),
        (
            [[0.0] * 3],
            {"region": (1.0,)},
            "region: expected least and largest x, y, z, got (1.0,)",
        ),
    ],
)
def test_wrong_arguments_are_named(
    points: Any, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as error:
        ad.find_box(points, **options)

    assert str(error.value) == message


@pytest.mark.slow
def test_a_box_beside_a_robot_is_found_in_a_picture() -> None:
    robot = ad.add_camera(
        ad.load_robot("mycobot_280"), "world", (0.6, 0, 0.4, 0, 0.6, math.pi)
    )
    pose = (0.2, 0.05, 0.02, 0.0, 0.0, 0.4)
    box = Thing("box", "box", (0.05, 0.03, 0.04), mass=0.05, pose=pose)
    world = with_things(load_world("empty"), [box])
    camera = ad.Simulation(ad.build_diagram(robot, world=world)).camera("camera")

    found = ad.find_box(camera.points())
    again = ad.find_box(camera.points("optical"), up=None)

    assert found, found.reason
    assert found.pose is not None
    assert again.pose is not None
    # A pixel is 1.2 mm wide there.
    np.testing.assert_allclose(found.pose.translation(), pose[:3], atol=6e-4)
    np.testing.assert_allclose(found.size, box.size, atol=6e-4)
    assert turned_by(found, 0.4) < math.radians(0.2)
    X_WC = camera.pose
    there = (X_WC @ again.pose).translation()
    np.testing.assert_allclose(there, pose[:3], atol=6e-4)
