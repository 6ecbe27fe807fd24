"""A trail is the way of a point, sent piece by piece."""

import itertools

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from arm_drake.visualization.trail import Trail
from tests.visualization import scene
from tests.visualization.scene import Spy

# Points of a line are kept as 32-bit floats.
SINGLE = 1e-6


def helix(count: int) -> np.ndarray:
    """Return points about 0.1 m apart, shape (n, 3)."""
    angles = 0.1 * np.arange(count)
    return np.stack([np.cos(angles), np.sin(angles), 0.01 * angles], axis=1)


def pieces(meshcat: Meshcat, path: str = "/drake/trail") -> list[np.ndarray]:
    """Return the points of every piece that is seen, the oldest first."""
    paths = (f"{path}/{number}" for number in range(4000))
    return [scene.vertices(meshcat, p) for p in paths if meshcat.HasPath(p)]


def test_its_pieces_make_one_line_through_all_points() -> None:
    meshcat = scene.start()
    trail, points = Trail(meshcat), helix(180)

    for time, point in zip(np.arange(180) * 0.01, points, strict=True):
        trail.append(time, point)

    found = pieces(meshcat)
    assert len(found) > 2
    for one, other in itertools.pairwise(found):
        np.testing.assert_array_equal(one[-1], other[0])
    joined = np.concatenate([found[0], *(piece[1:] for piece in found[1:])])
    np.testing.assert_allclose(joined, points, atol=SINGLE)


def test_only_the_last_piece_is_sent_again() -> None:
    spy = Spy()
    trail, points = Trail(spy), helix(300)

    for time, point in zip(np.arange(300) * 0.002, points, strict=True):
        trail.append(time, point)

    paths = [path for _, path in spy.take()]
    # Each piece starts with a point of the one before it, so it is sent 49 times.
    assert [paths.count(path) for path in dict.fromkeys(paths)] == [49] * 6 + [5]
    assert paths == sorted(paths, key=lambda path: int(path.rpartition("/")[2]))


def test_points_close_to_the_last_one_are_left_out() -> None:
    meshcat = scene.start()
    trail = Trail(meshcat, min_distance=0.5)

    for time, x in enumerate([0.0, 0.4, 0.6, 0.9, 1.2]):
        trail.append(0.1 * time, [x, 0.0, 0.0])

    (points,) = pieces(meshcat)
    np.testing.assert_allclose(points[:, 0], [0.0, 0.6, 1.2], atol=SINGLE)


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.01, 0.5])
def test_what_is_old_is_deleted_so_that_memory_stays_flat(period: float) -> None:
    meshcat = scene.start()
    trail, counts = Trail(meshcat, duration=2.0), []

    for step in range(3000):
        # 1 m/s: as many metres as seconds.
        trail.append(period * step, [period * step, 0.0, 0.0])
        if step % 500 == 499:
            counts.append(len(pieces(meshcat)))
            oldest = pieces(meshcat)[0][0, 0]
            age = period * step - oldest
            # The oldest piece goes as a whole, once its end is old; it is as long as
            # 0.1 s, or one step. Rounding may leave one step more.
            assert min(period * step, 2.0) <= age + period
            assert age <= 2.0 + 0.1 + 2.0 * period

    # 2 s of pieces that a further step would have made longer than 0.1 s, or of steps;
    # the first and the last one are cut.
    assert max(counts) <= 2.0 / max(0.1 - period, period) + 2


def test_the_way_of_a_point_that_stands_still_fades() -> None:
    meshcat = scene.start()
    trail = Trail(meshcat, duration=2.0)
    for step in range(20):
        trail.append(0.01 * step, [step, 0.0, 0.0])
    assert pieces(meshcat)

    for time in np.arange(0.2, 2.6, 0.05):
        trail.append(time, [19.0, 0.0, 0.0])

    assert not pieces(meshcat)
    trail.append(2.7, [20.0, 0.0, 0.0])
    (points,) = pieces(meshcat)
    np.testing.assert_array_equal(points[:, 0], [19.0, 20.0])


def test_a_new_line_begins_when_time_goes_back() -> None:
    meshcat = scene.start()
    trail = Trail(meshcat)
    for time in (0.0, 0.1, 0.2):
        trail.append(time, [time, 0.0, 0.0])

    for time in (0.0, 0.1):
        trail.append(time, [5.0 + time, 0.0, 0.0])

    (points,) = pieces(meshcat)
    np.testing.assert_allclose(points[:, 0], [5.0, 5.1], atol=SINGLE)


def test_a_point_that_is_changed_in_place_is_another_point() -> None:
    meshcat = scene.start()
    trail, point = Trail(meshcat), np.zeros(3)

    for time in range(3):
        point[0] = time
        trail.append(0.1 * time, point)

    (points,) = pieces(meshcat)
    np.testing.assert_array_equal(points[:, 0], [0.0, 1.0, 2.0])


def test_clear_deletes_it() -> None:
    meshcat = scene.start()
    trail = Trail(meshcat, "/drake/trail/left")
    for time in (0.0, 0.1):
        trail.append(time, [time, 0.0, 0.0])
    assert meshcat.HasPath("/drake/trail/left")

    trail.clear()

    assert not meshcat.HasPath("/drake/trail/left")
