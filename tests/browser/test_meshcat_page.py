"""The page of a real robot, as Chromium draws it: as it runs, and saved as a file.

Where the robot must be seen comes from the manufacturer's meshes, the frames of the
links and a pinhole camera, nothing of it from Meshcat or from the converted meshes.
"""

import colorsys
import dataclasses as dc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page
from pydrake.geometry import Meshcat

import arm_drake as ad
from arm_drake.visualization.meshcat import frame_points
from arm_drake.visualization.recording import save_recording
from tests.browser.pictures import (
    VIEWPORT,
    Camera,
    Mask,
    Picture,
    box_around,
    difference,
    grow,
    hide_robot,
    new_context,
    paint_robot,
    picture_at,
    take_picture,
    wait_until_drawn,
)

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# Level with the upright arm and beside it, so that little of its box is empty.
_CAMERA = Camera(eye=(0.1, -1.2, 0.7), target=(0.0, 0.0, 0.7))

# From in front, where the motion's elbow bends.
_CAMERA_OF_MOTION = Camera(eye=(0.1, -1.5, 0.7), target=(0.1, 0.0, 0.7))

# The robot's 14 mesh files, one of which has two colours.
_MESHES = 15

# The colour of most of its parts in these files; red, green and blue of 0 to 1.
_BLUE = (0.1384, 0.188, 0.2384)

# Stands out from Meshcat's grey background, as the robot's own greys may not.
_RED = (1.0, 0.0, 0.0)

# How far a drawn edge may be from where it should be [pixels].
_EDGE = 2

_MOTION = Path(__file__).parents[2] / "configs/doosan_a0912/motions/tutorial.yaml"


StartMeshcat = Callable[[], Meshcat]


@dc.dataclass(frozen=True)
class Scene:
    """The robot in a Meshcat of its own."""

    meshcat: Meshcat
    sim: ad.Simulation

    def surfaces(self) -> dict[str, NDArray[np.float64]]:
        """Return points all over each link, in the world [m], shape (n, 3) each."""
        (robot,) = self.sim.robots.values()
        folder = robot.description.file.parents[1] / "meshes/a0912_blue"
        frames = self.sim.eval_output("frames")
        surfaces = {}
        for link, X_WL in zip(robot.description.links, frames, strict=True):
            files = sorted(folder.glob(f"A0912_{link[-1]}_*.dae"))
            if files:
                meshes = [trimesh.load(file, force="mesh") for file in files]
                millimetres = np.concatenate([mesh.vertices for mesh in meshes])
                surfaces[link] = X_WL.multiply(0.001 * millimetres.T).T
        return surfaces


def make_scene(meshcat: Meshcat, file: Path, camera: Camera) -> Scene:
    meshcat.SetCameraPose(np.array(camera.eye), np.array(camera.target))
    diagram = ad.build_diagram(ad.load_robot(file), meshcat=meshcat)
    return Scene(meshcat, ad.Simulation(diagram))


def project_all(
    camera: Camera, surfaces: dict[str, NDArray[np.float64]]
) -> NDArray[np.int_]:
    return np.concatenate([camera.project(points) for points in surfaces.values()])


def share_inside(pixels: NDArray[np.int_], silhouette: Mask) -> float:
    """Return how many of some pixels are in a silhouette, or at its edge."""
    columns, rows = pixels.T
    return float(grow(silhouette, _EDGE)[rows, columns].mean())


def colour_shares(picture: Picture, silhouette: Mask) -> tuple[float, float]:
    """Return how much of the robot is its blue, and how much a far lighter grey."""
    robot = picture[silhouette] / 255.0
    hue, saturation, _ = np.array([colorsys.rgb_to_hsv(*pixel) for pixel in robot]).T
    expected_hue, _, _ = colorsys.rgb_to_hsv(*_BLUE)
    # Light changes the saturation and the brightness; the hue much less.
    is_blue = (np.abs(hue - expected_hue) < 15.0 / 360.0) & (saturation > 0.1)
    is_grey = saturation < 0.04
    brightness = robot.mean(axis=1)
    blue = brightness[is_blue].mean() if is_blue.any() else np.inf
    # In the files, the greys are 2.1 times as bright and more.
    is_light = brightness > 1.5 * blue
    return float(is_blue.mean()), float((is_grey & is_light).mean())


@dc.dataclass(frozen=True)
class Pictures:
    """One view of the page."""

    robot: Picture
    all_red: Picture
    all_grey: Picture
    empty: Picture

    @property
    def silhouette(self) -> Mask:
        """Which pixels belong to the robot."""
        return difference(self.all_red, self.empty)


@pytest.fixture(scope="module")
def scene(start_meshcat: StartMeshcat, doosan: Path) -> Scene:
    return make_scene(start_meshcat(), doosan, _CAMERA)


@pytest.fixture(scope="module")
def pictures(browser: Browser, scene: Scene) -> Pictures:
    context = new_context(browser)
    page = context.new_page()
    # Without a ground that its shadow falls on.
    scene.meshcat.SetProperty("/Grid", "visible", False)
    page.goto(scene.meshcat.web_url())
    wait_until_drawn(page, _MESHES, _CAMERA)
    robot = take_picture(page)
    paint_robot(page, _RED)
    all_red = take_picture(page)
    paint_robot(page, (0.5, 0.5, 0.5))
    all_grey = take_picture(page)
    hide_robot(page)
    empty = take_picture(page)
    context.close()
    return Pictures(robot, all_red, all_grey, empty)


def test_the_robot_fills_more_than_a_third_of_its_box(
    scene: Scene, pictures: Pictures
) -> None:
    box = box_around(project_all(_CAMERA, scene.surfaces()))

    changed = difference(pictures.robot, pictures.empty)

    assert changed[box].mean() > 1.0 / 3.0


def test_nothing_of_the_robot_is_outside_of_its_box(
    scene: Scene, pictures: Pictures
) -> None:
    rows, columns = box_around(project_all(_CAMERA, scene.surfaces()))

    outside = pictures.silhouette

    outside[
        rows.start - _EDGE : rows.stop + _EDGE,
        columns.start - _EDGE : columns.stop + _EDGE,
    ] = False
    assert not outside.any()


def test_every_link_is_where_its_frame_is(scene: Scene, pictures: Pictures) -> None:
    surfaces = scene.surfaces()

    shares = {
        link: share_inside(_CAMERA.project(points), pictures.silhouette)
        for link, points in surfaces.items()
    }

    assert list(shares) == ["base_0", *(f"link{i}" for i in range(1, 7))]
    assert min(shares.values()) > 0.99, shares


def test_the_links_have_the_colours_of_their_files(pictures: Pictures) -> None:
    blue, grey = colour_shares(pictures.robot, pictures.silhouette)

    assert blue > 0.5
    assert grey > 0.05


def test_a_grey_robot_would_not_pass_for_the_blue_one(pictures: Pictures) -> None:
    blue, _ = colour_shares(pictures.all_grey, pictures.silhouette)

    assert blue < 0.01


def test_the_camera_is_set_to_see_all_of_the_robot(
    page: Page, start_meshcat: StartMeshcat, doosan: Path
) -> None:
    scene = make_scene(start_meshcat(), doosan, _CAMERA)
    points = np.concatenate(list(scene.surfaces().values()))

    frame_points(scene.meshcat, list(points))

    page.goto(scene.meshcat.web_url())
    wait_until_drawn(page, _MESHES)
    picture = take_picture(page)
    hide_robot(page)
    rows, columns = np.nonzero(difference(picture, take_picture(page)))
    height, width = VIEWPORT["height"], VIEWPORT["width"]
    assert rows.min() > 0
    assert rows.max() < height - 1
    assert columns.min() > 0
    assert columns.max() < width - 1
    assert np.ptp(rows) > 0.5 * height


def test_a_saved_recording_plays_without_a_network(
    browser: Browser, start_meshcat: StartMeshcat, doosan: Path, tmp_path: Path
) -> None:
    scene = make_scene(start_meshcat(), doosan, _CAMERA_OF_MOTION)
    motion = ad.load_motion(_MOTION)
    scene.meshcat.StartRecording()
    # Its first waypoint, straight up, is due at 2 s; the last one at 4 s.
    scene.sim.run(2.0, motion)
    straight = project_all(_CAMERA_OF_MOTION, scene.surfaces())
    scene.sim.run(2.5)
    bent = project_all(_CAMERA_OF_MOTION, scene.surfaces())
    file = tmp_path / "recording.html"

    save_recording(scene.meshcat, file, "doosan")

    context = new_context(browser, offline=True)
    page = context.new_page()
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.on("websocket", lambda websocket: requests.append(websocket.url))
    page.goto(file.as_uri())
    wait_until_drawn(page, _MESHES, _CAMERA_OF_MOTION)
    assert page.evaluate("viewer.animator.duration") == pytest.approx(4.5, abs=1 / 30)
    paint_robot(page, _RED)
    early, late = picture_at(page, 2.0), picture_at(page, 4.5)
    hide_robot(page)
    empty = take_picture(page)
    # The camera comes back from below the ground; y is up here.
    page.evaluate("viewer.camera.position.y = -1.0")
    page.wait_for_function(
        "() => { viewer.controls.update(); return viewer.camera.position.y > 0.019; }"
    )
    context.close()
    box = box_around(np.concatenate([straight, bent]))
    assert difference(early, late)[box].mean() > 0.05
    assert share_inside(straight, difference(early, empty)) > 0.99
    assert share_inside(bent, difference(late, empty)) > 0.99
    assert share_inside(bent, difference(early, empty)) < 0.9
    is_own = ("file:", "data:", "blob:")
    assert [url for url in requests if not url.startswith(is_own)] == []
    assert requests[0] == file.as_uri()


def test_the_page_is_on_this_machine_and_says_what_it_is(
    page: Page, start_meshcat: StartMeshcat
) -> None:
    meshcat = start_meshcat()

    page.goto(meshcat.web_url())

    assert meshcat.web_url() == f"http://localhost:{meshcat.port()}"
    assert page.title() == "Drake MeshCat"
