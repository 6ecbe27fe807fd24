"""Toggles of a page: what they show, and what goes with what."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from arm_drake.errors import InputError
from arm_drake.visualization.page.panel import VIEWS, LinkViews
from tests import models
from tests.visualization import scene
from tests.visualization.scene import about_y, is_visible, transform


class FakePage:
    """A page that notes what it is told."""

    def __init__(self) -> None:
        self.meshcat: Meshcat = scene.start()
        self.patches: list[Any] = []
        self.labels: list[dict[str, str]] = []

    def patch(self, changes: Any) -> None:
        self.patches.append(changes)

    def set_labels(self, labels: Any) -> None:
        self.labels.append(dict(labels))


@pytest.fixture
def page() -> FakePage:
    return FakePage()


def make(page: FakePage, folder: Path, *shown: str) -> LinkViews:
    robot = models.load(folder, models.TWO_LINKS)
    drawn = scene.place(robot.description)
    views = LinkViews(page, shown or ("visual",))  # type: ignore[arg-type]
    put(views, robot, drawn)
    return views


def put(views: LinkViews, robot: Any, drawn: scene.Scene) -> None:
    plant, scene_graph, model, _, _ = drawn
    views.put(plant, scene_graph, {robot.name: model}, [robot])


def seen(page: FakePage) -> set[str]:
    """Return the kinds of drawings that are to be seen."""
    kinds = set(VIEWS) - {"names", "visual"}
    return {
        kind
        for kind in kinds
        if page.meshcat.HasPath(f"/drake/{kind}")
        and is_visible(page.meshcat, f"/drake/{kind}")
    }


@pytest.mark.parametrize("kind", ["frames", "inertia", "joint_axes"])
def test_a_toggle_shows_and_hides_its_kind(
    page: FakePage, tmp_path: Path, kind: str
) -> None:
    views = make(page, tmp_path)
    assert (views.shown, seen(page), views.needs_poses) == (("visual",), set(), False)

    views.show(kind)
    assert views.shown == ("visual", kind)
    assert seen(page) == {kind}
    assert views.needs_poses
    assert page.patches[-1] == {f"show:{kind}": {"value": True}}

    views.show(kind, False)
    assert (views.shown, seen(page), views.needs_poses) == (("visual",), set(), False)
    assert page.patches[-1][f"show:{kind}"] == {"value": False}


def test_visual_shapes_can_be_hidden(page: FakePage, tmp_path: Path) -> None:
    views = make(page, tmp_path)
    assert is_visible(page.meshcat, "/drake/visual")

    views.show("visual", False)

    assert not is_visible(page.meshcat, "/drake/visual")
    assert views.shown == ()


def test_they_may_be_hidden_from_the_start(page: FakePage, tmp_path: Path) -> None:
    views = make(page, tmp_path, "frames", "inertia")

    assert views.shown == ("frames", "inertia")
    assert not is_visible(page.meshcat, "/drake/visual")
    assert seen(page) == {"frames", "inertia"}


def test_names_bring_their_frames_and_go_with_them(
    page: FakePage, tmp_path: Path
) -> None:
    views = make(page, tmp_path)

    views.show("names")
    assert views.shown == ("visual", "frames", "names")
    assert page.patches[-1] == {
        "show:names": {"value": True},
        "show:frames": {"value": True},
    }
    assert page.labels[-1] == {
        f"/drake/frames/two_links/{link}": link for link in ("base", "upper", "lower")
    }
    for path in page.labels[-1]:
        assert page.meshcat.HasPath(path)

    views.show("frames", False)
    assert views.shown == ("visual",)
    assert page.patches[-1] == {
        "show:frames": {"value": False},
        "show:names": {"value": False},
    }
    assert page.labels[-1] == {}


def test_frames_stay_without_their_names(page: FakePage, tmp_path: Path) -> None:
    views = make(page, tmp_path, "names")
    assert views.shown == ("frames", "names")

    views.show("names", False)

    assert views.shown == ("frames",)
    assert (seen(page), page.labels[-1]) == ({"frames"}, {})


def test_what_is_shown_moves_along(page: FakePage, tmp_path: Path) -> None:
    views = make(page, tmp_path, "frames")

    views.update({"two_links": {"upper": about_y(0.5)}})

    at = transform(page.meshcat, "/drake/frames/two_links/upper")
    np.testing.assert_allclose(at, about_y(0.5).GetAsMatrix4(), atol=1e-12)


def test_another_robot_takes_the_place_with_the_same_toggles(
    page: FakePage, tmp_path: Path
) -> None:
    views = make(page, tmp_path, "visual", "names")
    robot = models.load(tmp_path, models.PARTLY_COMMANDED)

    put(views, robot, scene.place(robot.description))

    assert views.shown == ("visual", "frames", "names")
    assert not page.meshcat.HasPath("/drake/frames/two_links")
    assert page.meshcat.HasPath("/drake/frames/partly/three")
    assert set(page.labels[-1].values()) == {"base", "one", "two", "three"}


def test_toggles_say_what_is_shown(page: FakePage, tmp_path: Path) -> None:
    views = make(page, tmp_path, "visual", "inertia")

    toggles = {toggle.id: toggle.value for toggle in views.toggles()}

    assert toggles == {f"show:{what}": what in ("visual", "inertia") for what in VIEWS}


def test_before_there_is_a_robot_toggles_are_only_kept(page: FakePage) -> None:
    views = LinkViews(page)  # type: ignore[arg-type]

    views.show("names")
    views.update({"two_links": {"upper": about_y(0.5)}})

    assert views.shown == ("visual", "frames", "names")
    assert page.labels == [{}]


def test_what_cannot_be_shown_is_said(page: FakePage) -> None:
    message = (
        "nothing called 'frame' can be shown; did you mean 'frames'? known: collision, "
        "frames, inertia, joint_axes, names, visual"
    )

    with pytest.raises(InputError) as caught:
        LinkViews(page, ("frame",))  # type: ignore[arg-type]
    assert str(caught.value) == message
    with pytest.raises(InputError) as caught:
        LinkViews(page).show("frame", False)  # type: ignore[arg-type]
    assert str(caught.value) == message
