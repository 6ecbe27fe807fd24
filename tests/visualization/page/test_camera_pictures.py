"""Pictures on the page are what cameras see, taken when somebody looks."""

import base64
import io
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.camera_pictures import CameraPictures, _frustum
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.parts import find_part
from tests.visualization.scene import transform

pytestmark = pytest.mark.slow

HEIGHT, FOV = 0.5, math.radians(60.0)

# Half a metre above the ground, it looks straight down.
DOWN = (2.0, 0.0, HEIGHT, 0.0, math.pi / 2.0, 0.0)


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    robot = ad.load_robot("lab5_arm")
    return ad.add_camera(
        robot, "world", DOWN, name="eye", width=64, height=48, horizontal_fov=FOV
    )


@pytest.fixture
def live(robot: ad.Robot, monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveSimulation]:
    monkeypatch.setattr(Page, "num_browsers", 1)
    with Page() as page:
        options = ad.SimulationOptions(frame_rate=0.0)
        diagram = ad.build_diagram(robot, options=options, meshcat=page.meshcat)
        yield LiveSimulation(page, Simulation(diagram))


def pictures_of(live: LiveSimulation) -> CameraPictures:
    return find_part(live.parts, CameraPictures)


def shown(live: LiveSimulation) -> dict[str, Any]:
    return pictures_of(live).changes()["cameras:picture"]


def read(source: str) -> np.ndarray:
    data = base64.b64decode(source.removeprefix("data:image/jpeg;base64,"))
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def test_a_picture_is_what_the_camera_sees(live: LiveSimulation) -> None:
    assert shown(live)["source"] == ""

    live.handle([WidgetEvent("cameras:shown", "eye color")])

    picture = read(shown(live)["source"])
    seen = live.simulation.camera("eye").color().astype(int)
    assert picture.shape == seen.shape
    assert np.abs(picture - seen).mean() < 4.0  # JPEG isn't exact.


def test_depths_have_a_scale(live: LiveSimulation) -> None:
    pictures_of(live).show("eye depth")

    fields = shown(live)

    # The plane is as far everywhere along the axis.
    assert (fields["lower"], fields["upper"]) == ("0.5 m", "0.5 m")
    assert read(fields["source"]).shape[0] > 48


def test_a_picture_is_taken_once_a_time_and_not_without_a_browser(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    part, taken = pictures_of(live), []
    monkeypatch.setattr(part, "_take", lambda: taken.append(live.simulation.time))

    monkeypatch.setattr(Page, "num_browsers", 0)
    part.show("eye")
    part.changes()
    assert taken == []
    monkeypatch.setattr(Page, "num_browsers", 1)
    for _ in range(3):
        part.changes()
    assert taken == [0.0]
    live.step()
    part.changes()
    part.show("nothing")
    live.step()
    part.changes()
    assert len(taken) == 2


def test_a_pyramid_has_the_camera_s_field_of_view(live: LiveSimulation) -> None:
    camera = live.simulation.camera("eye")
    start, end = _frustum(camera)

    right, lower = end[:, :4].max(axis=1)[:2] / end[2, 0]
    assert right == pytest.approx(math.tan(FOV / 2.0), rel=1e-3)
    assert lower == pytest.approx(right * 48.0 / 64.0, rel=1e-3)
    assert not start[:, :4].any()

    live.handle([WidgetEvent("cameras:frusta", True)])

    X = transform(live.page.meshcat, "/drake/camera_frusta/eye")
    assert X[:3, 3] == pytest.approx(DOWN[:3])
    assert X[:3, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
    live.handle([WidgetEvent("cameras:frusta", False)])
    assert not live.page.meshcat.HasPath("/drake/camera_frusta/eye")


def test_an_unknown_picture_is_said(live: LiveSimulation) -> None:
    with pytest.raises(InputError, match="camera picture: no 'eye colour'; did you"):
        pictures_of(live).show("eye colour")
