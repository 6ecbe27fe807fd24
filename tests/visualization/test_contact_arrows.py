"""Forces are rods of the right length and direction, from where they act."""

import numpy as np
import pytest

from arm_drake.messages.geometry import Vector3, Wrench
from arm_drake.messages.sensors import ContactsState, ContactState
from arm_drake.visualization.contact_arrows import ContactArrows
from tests.visualization import scene
from tests.visualization.scene import Spy, cylinder_ends, is_visible, object_pose

# A force that is drawn with a length [N], [m].
FORCE, LENGTH = 20.0, 0.5

PATH = "/drake/contact_forces/arm"


def contacts(*forces: tuple[tuple[float, ...], tuple[float, ...]]) -> ContactsState:
    """Return contacts at points, with forces; two to a pair of shapes."""
    pairs = [forces[at : at + 2] for at in range(0, len(forces), 2)]
    return ContactsState(
        states=tuple(
            ContactState(
                contact_positions=tuple(Vector3(*point) for point, _ in pair),
                wrenches=tuple(Wrench(force=Vector3(*force)) for _, force in pair),
            )
            for pair in pairs
        )
    )


@pytest.mark.parametrize(
    "force",
    [
        (0.0, 0.0, 40.0),
        (0.0, 0.0, -5.0),
        (30.0, 0.0, 0.0),
        (0.0, -7.0, 0.0),
        (3.0, -4.0, 12.0),
        (1e-9, 0.0, 20.0),
    ],
)
def test_a_rod_goes_from_its_point_along_the_force(force: tuple[float, ...]) -> None:
    meshcat, point = scene.start(), np.array([0.1, -0.2, 0.3])
    arrows = ContactArrows(meshcat, "arm", force=FORCE, length=LENGTH)

    arrows.show(contacts((tuple(point), force)))

    ends = cylinder_ends(meshcat, f"{PATH}/0/rod")
    tip = point + np.array(force) * LENGTH / FORCE
    # Either end of a cylinder may be the tip.
    if np.linalg.norm(ends[0] - point) > np.linalg.norm(ends[1] - point):
        ends = ends[::-1]
    np.testing.assert_allclose(ends, [point, tip], atol=1e-9)
    ball = object_pose(meshcat, f"{PATH}/0/point")
    np.testing.assert_allclose(ball[:3, 3], point, atol=1e-12)
    X = scene.pose(meshcat, f"{PATH}/0/rod")
    # Stretched along itself alone, and no mirror.
    assert np.linalg.det(X[:3, :3]) == pytest.approx(
        np.linalg.norm(force) * LENGTH / FORCE, rel=1e-9
    )


def test_each_point_of_each_pair_has_its_rod() -> None:
    meshcat = scene.start()
    arrows = ContactArrows(meshcat, "arm", force=FORCE, length=LENGTH)
    points = [(float(k), 0.0, 0.0) for k in range(5)]

    arrows.show(contacts(*((point, (0.0, 0.0, 1.0)) for point in points)))

    for index, point in enumerate(points):
        place = object_pose(meshcat, f"{PATH}/{index}/point")[:3, 3]
        np.testing.assert_allclose(place, point, atol=1e-12)
    assert not meshcat.HasPath(f"{PATH}/5")


def test_rods_of_contacts_that_ended_are_hidden_and_come_again() -> None:
    meshcat = scene.start()
    arrows = ContactArrows(meshcat, "arm", force=FORCE, length=LENGTH)
    one, other = ((0.0, 0.0, 0.0), (0.0, 0.0, 9.0)), ((1.0, 0.0, 0.0), (9.0, 0.0, 0.0))

    def visible() -> list[bool]:
        return [is_visible(meshcat, f"{PATH}/{index}") for index in (0, 1)]

    arrows.show(contacts(one, other))
    assert visible() == [True, True]
    arrows.show(contacts(other))
    assert visible() == [True, False]
    np.testing.assert_allclose(
        object_pose(meshcat, f"{PATH}/0/point")[:3, 3], other[0], atol=1e-12
    )
    arrows.hide()
    assert visible() == [False, False]
    arrows.show(contacts(one, other))
    assert visible() == [True, True]


def test_a_force_that_is_next_to_nothing_has_no_rod() -> None:
    meshcat = scene.start()
    arrows = ContactArrows(meshcat, "arm", force=FORCE, length=LENGTH)

    # A thousandth of what sets the scale is the least.
    arrows.show(
        contacts(
            ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            ((1.0, 0.0, 0.0), (0.0, 0.0, 0.9e-3 * FORCE)),
            ((2.0, 0.0, 0.0), (0.0, 0.0, 1.1e-3 * FORCE)),
        )
    )

    assert object_pose(meshcat, f"{PATH}/0/point")[0, 3] == 2.0
    assert not meshcat.HasPath(f"{PATH}/1")


def test_shapes_are_sent_once_however_long_it_runs() -> None:
    spy = Spy()
    arrows = ContactArrows(spy, "arm", force=FORCE, length=LENGTH)  # type: ignore[arg-type]

    for step in range(100):
        arrows.show(contacts(((0.0, 0.0, 0.0), (0.0, 0.0, 1.0 + step))))

    names = [name for name, _ in spy.take()]
    assert names.count("SetObject") == 2
    assert names.count("SetProperty") == 1


def test_a_robots_name_is_one_step_of_the_path() -> None:
    meshcat = scene.start()
    arrows = ContactArrows(meshcat, "left/arm", force=FORCE, length=LENGTH)

    arrows.show(contacts(((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))))

    assert meshcat.HasPath("/drake/contact_forces/left|arm/0/rod")


def test_nothing_is_sent_while_nothing_touches() -> None:
    spy = Spy()
    arrows = ContactArrows(spy, "arm", force=FORCE, length=LENGTH)  # type: ignore[arg-type]

    arrows.show(contacts())
    arrows.hide()

    assert spy.take() == []
