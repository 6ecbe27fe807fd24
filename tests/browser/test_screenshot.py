"""Screenshots: all of the robot is in the picture, whatever its size."""

import contextlib
import dataclasses as dc
import io
import json
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser
from pydrake.geometry import Meshcat

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import OutputError
from arm_drake.visualization.screenshot import (
    FIELD_OF_VIEW,
    BrowserError,
    Photographer,
    save_screenshot,
)
from tests.browser.pictures import difference, grow
from tests.models import GRIPPER, LENGTH, bob
from tests.robots import skip_or_fail
from tests.shown import show_robot
from tests.waiting import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow]

StartMeshcat = Callable[[], Meshcat]
Picture = NDArray[np.int16]

# Of most pictures here: drawn on the processor, each pixel costs.
SIZE = WIDTH, HEIGHT = 640, 480

# Where only large parts of it are looked at.
SMALL = 320, 240

# Share of the picture that stays free on each side.
MARGIN = 0.06

# Edges of what is drawn are smoothed [pixels].
EDGE = 3


def magenta_arm(scale: float) -> str:
    """Return an arm of magenta boxes, as high in metres as the scale says."""

    def visual(size: str, xyz: str) -> str:
        return (
            f'<visual><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry>'
            '<material name="magenta"><color rgba="1 0 1 1"/></material></visual>'
        )

    half, width = 0.5 * scale, 0.1 * scale
    part = visual(f"{width} {width} {half}", f"0 0 {half / 2.0}")
    foot = visual(f"{3 * width} {2 * width} {0.2 * width}", f"0 0 {0.1 * width}")
    return f"""
<robot name="magenta">
  {bob("lower", "0 0 0", foot + part)}{bob("upper", "0 0 0", part)}
  <joint name="elbow" type="revolute">
    <origin xyz="0 0 {half}"/><axis xyz="0 1 0"/>
    <parent link="lower"/><child link="upper"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
</robot>"""


def read(data: bytes | Path) -> Picture:
    """Return a picture, shape (height, width, 3), 0 to 255."""
    with Image.open(io.BytesIO(data) if isinstance(data, bytes) else data) as image:
        return np.asarray(image.convert("RGB")).astype(np.int16)


def magenta_of(picture: Picture) -> NDArray[np.bool_]:
    """Return which pixels are magenta, which neither the axes nor the ground are."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    return np.minimum(red, blue) > green + 40


def assert_framed(mask: NDArray[np.bool_]) -> None:
    """Check that something is inside the margin and reaches it on opposite sides."""
    height, width = mask.shape
    rows, columns = np.nonzero(mask)
    free = {
        "top": rows.min() - MARGIN * height,
        "bottom": (1.0 - MARGIN) * height - 1 - rows.max(),
        "left": columns.min() - MARGIN * width,
        "right": (1.0 - MARGIN) * width - 1 - columns.max(),
    }
    assert min(free.values()) >= -EDGE, free
    reaches = {side for side, distance in free.items() if distance <= EDGE}
    assert {"top", "bottom"} <= reaches or {"left", "right"} <= reaches, free


@pytest.fixture(scope="module")
def photographer() -> Iterator[Photographer]:
    try:
        photographer = Photographer().__enter__()
    except BrowserError as error:
        skip_or_fail(str(error))
    yield photographer
    photographer.__exit__()


def load(folder: Path, urdf: str) -> ad.Robot:
    file = folder / "robot.urdf"
    file.write_text(urdf, encoding="utf-8")
    return ad.load_robot(file, controllers=[])


# A robot, and one 1000 times as large [m].
SCALES = (0.01, 10.0)


@pytest.fixture(scope="module")
def of_any_size(
    photographer: Photographer,
    start_meshcat: StartMeshcat,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[float, Picture]:
    """Return a picture of each robot of SCALES."""
    pictures = {}
    for scale in SCALES:
        meshcat = start_meshcat()
        show_robot(meshcat, load(tmp_path_factory.mktemp("arm"), magenta_arm(scale)))
        pictures[scale] = read(photographer.take_picture(meshcat, size=SIZE)[0])
    return pictures


@pytest.mark.parametrize("scale", SCALES)
def test_a_robot_of_any_size_fills_the_picture(
    of_any_size: dict[float, Picture], scale: float
) -> None:
    picture = of_any_size[scale]

    assert picture.shape == (HEIGHT, WIDTH, 3)
    magenta = magenta_of(picture)
    assert_framed(magenta)
    assert magenta.mean() > 0.03
    # Neither in the dark nor in glaring light.
    assert 120 < picture[magenta][:, 0].mean() < 250


def test_size_makes_no_difference_to_the_picture(
    of_any_size: dict[float, Picture],
) -> None:
    # 1000 times as large: the same light, the same grid.
    assert difference(*of_any_size.values()).mean() < 0.002


@pytest.mark.parametrize(
    ("scale", "axis_scale"), [(0.01, 0.01), (1.0, 1.0), (5.0, 1.0)]
)
def test_the_worlds_axes_are_at_its_origin(
    photographer: Photographer,
    start_meshcat: StartMeshcat,
    tmp_path: Path,
    scale: float,
    axis_scale: float,
) -> None:
    # To the left of the origin, as the camera sees it.
    beside = (-0.24 * scale, -0.19 * scale, 0.0, 0.0, 0.0, 0.0)
    file = tmp_path / "robot.urdf"
    file.write_text(magenta_arm(scale), encoding="utf-8")
    meshcat = start_meshcat()
    show_robot(meshcat, ad.load_robot(file, controllers=[], pose=beside))

    data, camera = photographer.take_picture(meshcat, size=SIZE)

    picture = read(data)
    forward = np.subtract(camera.target, camera.eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    sides = np.stack([right, -np.cross(right, forward), forward])
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    focal = HEIGHT / 2.0 / np.tan(FIELD_OF_VIEW / 2.0)
    for axis, along in enumerate(axis_scale * np.eye(3)):
        # On the axis, and where it goes on no more.
        for length, is_drawn in ((0.2, True), (0.4, True), (0.6, False)):
            x, y, depth = sides @ (length * along - camera.eye)
            column = round(WIDTH / 2.0 + focal * x / depth)
            row = round(HEIGHT / 2.0 + focal * y / depth)
            around = picture[row - 2 : row + 3, column - 2 : column + 3]
            others = np.delete(around, axis, axis=2).max(axis=2)
            assert (around[:, :, axis] > others + 30).any() == is_drawn


def test_a_bundled_robot_fills_the_picture(
    photographer: Photographer, start_meshcat: StartMeshcat
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, ad.load_robot("doosan_a0912"))
    for ground in ("/Grid", "/Axes"):
        meshcat.SetProperty(ground, "visible", False)

    data, _ = photographer.take_picture(meshcat)

    # Without a ground and axes the background has one colour in each row.
    picture = read(data)
    assert picture.shape == (960, 1280, 3)
    background = np.median(picture, axis=1, keepdims=True)
    differs = np.abs(picture - background).max(axis=2) > 20
    robot = grow(~grow(~differs, 2), 2)
    assert_framed(robot)
    assert robot.mean() > 0.03


def test_the_ground_shows_metres_and_the_robots_shadow(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    pictures = []
    for has_shadow in (True, False):
        meshcat = start_meshcat()
        show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))
        if not has_shadow:
            light = "/Lights/FillLight/<object>"
            meshcat.SetProperty(light, "castShadow", False)
        pictures.append(read(photographer.take_picture(meshcat, size=SIZE)[0]))

    magenta = grow(magenta_of(pictures[0]), 5)
    darker = (pictures[1] - pictures[0]).mean(axis=2)
    # Behind the arm, below the horizon.
    assert 0.005 < (darker[~magenta] > 8).mean() < 0.2
    assert not (darker[: HEIGHT // 10] > 8).any()
    # The ground is brighter than its lines.
    bottom = pictures[1][-HEIGHT // 5 :].mean(axis=2)
    assert 0.02 < (bottom < np.median(bottom) - 10).mean() < 0.3


# The arm of `magenta_arm` in a scene.
MAGENTA = "drake/visual/magenta"


def darkened_by_shadows(photographer: Photographer, meshcat: Meshcat) -> Picture:
    """Return how much darker a picture is because of shadows."""

    def take() -> Picture:
        return read(photographer.take_picture(meshcat, size=SMALL, paths=[MAGENTA])[0])

    with_shadows = take()
    meshcat.SetProperty("/Lights/FillLight/<object>", "castShadow", False)
    return take() - with_shadows


def test_a_robot_in_the_house_casts_a_shadow_on_the_floor(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    diagram = ad.build_diagram(
        load(tmp_path, magenta_arm(1.0)), world="house", meshcat=meshcat
    )
    diagram.ForcedPublish(diagram.CreateDefaultContext())

    darker = darkened_by_shadows(photographer, meshcat).mean(axis=2)

    # What is darker is on one side of the arm, as in the empty world: not the room.
    shadow, (width, height) = darker > 3, SMALL
    assert 0.01 < shadow[:, width // 2 :].mean() < 0.2
    assert shadow[: height // 2, : width // 3].mean() < 0.005


def test_the_ground_has_the_colours_of_its_file(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    # In the picture's upper half is what has a greater y.
    Image.fromarray(
        np.repeat(np.uint8([[[0, 0, 255]]] * 32 + [[[0, 255, 0]]] * 32), 64, axis=1)
    ).save(tmp_path / "two.png")
    plane = (
        "<geometry><plane><size>4 4</size></plane></geometry><material>{}</material>"
    )
    material = "<pbr><metal><albedo_map>two.png</albedo_map></metal></pbr>"
    world = tmp_path / "two.sdf"
    world.write_text(
        '<sdf version="1.7"><world name="w"><scene><grid>false</grid></scene>'
        '<model name="g"><static>true</static><link name="l"><visual name="v">'
        f"{plane.format(material)}</visual></link></model></world></sdf>"
    )
    meshcat = start_meshcat()
    diagram = ad.build_diagram(
        load(tmp_path, magenta_arm(1.0)), world=world, meshcat=meshcat
    )
    diagram.ForcedPublish(diagram.CreateDefaultContext())
    above, _ = photographer.take_picture(
        meshcat, size=SIZE, paths=[MAGENTA], direction=(0.0, -0.3, 1.0)
    )

    picture = read(above)[:, : WIDTH // 8]
    _, green, blue = np.moveaxis(picture, 2, 0)
    # Seen from where y is small: green in front, blue behind.
    assert (green > blue + 40)[-HEIGHT // 40 :].all()
    assert (blue > green + 40)[: HEIGHT // 4].all()


# Draws as soon as the page hears of shadows, as a page now and then does.
DRAW_WITH_SHADOWS = """
let viewer;
Object.defineProperty(window, "viewer", {
    get: () => viewer,
    set: (made) => {
        viewer = made;
        const {set_property} = made;
        made.set_property = function (path, name, value) {
            set_property.call(this, path, name, value);
            if (name === "castShadow") this.renderer.render(this.scene, this.camera);
        };
    },
});
"""

SHADOW_MAP = """() => {
    const {shadow} = viewer.scene_tree.find(["Lights", "FillLight", "<object>"]).object;
    return [shadow.map && shadow.map.width, shadow.mapSize.width];
}"""


def test_the_map_of_shadows_has_its_size_before_it_is_drawn(
    browser: Browser, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))
    page = browser.new_page()
    page.add_init_script(DRAW_WITH_SHADOWS)
    page.goto(meshcat.web_url())

    # three.js would draw the whole ground in the shadow otherwise.
    page.wait_for_function(f"() => ({SHADOW_MAP})()[0]")
    drawn, told = page.evaluate(SHADOW_MAP)
    page.close()
    assert drawn == told == 2048


def test_a_picture_is_as_large_as_asked_for_and_the_robot_inside(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))

    data, _ = photographer.take_picture(meshcat, size=(200, 600))

    picture = read(data)
    assert picture.shape == (600, 200, 3)
    assert_framed(magenta_of(picture))


def test_a_joint_that_follows_is_drawn_where_it_belongs(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    radius = 0.01
    ball = f'<visual><origin xyz="0 0 {-LENGTH}"/><geometry><sphere radius="{radius}"/>'
    ball += "</geometry></visual>"
    file = tmp_path / "robot.urdf"
    file.write_text(GRIPPER.replace(bob("right"), bob("right", geometry=ball)))
    robot = ad.load_robot(file, controllers=[], initial_positions={"finger": 2.0})
    meshcat = start_meshcat()
    show_robot(meshcat, robot)

    _, camera = photographer.take_picture(meshcat, size=SIZE)

    # -0.5 * 2.0 + 0.1, about y; a camera that sees but the ball looks at its middle.
    angle = -0.9
    middle = [-LENGTH * np.sin(angle), 1.0, -LENGTH * np.cos(angle)]
    np.testing.assert_allclose(camera.target, middle, atol=0.1 * radius)


def test_only_some_of_the_scene_may_be_framed(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))

    paths = ["drake/visual/magenta/upper"]
    _, camera = photographer.take_picture(meshcat, size=SIZE, paths=paths)

    # The upper half, a box from 0.5 m to 1 m.
    np.testing.assert_allclose(camera.target, (0.0, 0.0, 0.75), atol=0.03)


def test_a_robot_without_anything_to_be_seen_is_said(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, GRIPPER))

    with pytest.raises(BrowserError) as caught:
        photographer.take_picture(meshcat, size=SIZE)

    assert str(caught.value) == "no picture: nothing of the robot is to be seen"


def test_the_camera_of_the_page_stays_where_it_is(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))
    before = meshcat._GetPackedProperty("/Cameras/default/rotated/<object>", "position")

    photographer.take_picture(meshcat, size=SIZE)

    after = meshcat._GetPackedProperty("/Cameras/default/rotated/<object>", "position")
    assert before == after


def test_the_command_takes_a_picture_in_the_given_position(
    start_meshcat: StartMeshcat,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot, picture = tmp_path / "robot.urdf", tmp_path / "robot.png"
    robot.write_text(magenta_arm(1.0), encoding="utf-8")
    words = ["view", str(robot), "--position", "1.5708", "--screenshot", str(picture)]

    code = main([*words, "--json"])

    content = json.loads(capsys.readouterr().out)
    assert code == 0
    assert content["robot"] == "magenta"
    assert content["positions"] == {"elbow": 1.5708}
    assert content["screenshot"] == str(picture)
    magenta = magenta_of(read(picture))
    assert_framed(magenta)
    # Half of the arm lies flat: the robot is wider than high, and it was not.
    rows, columns = np.nonzero(magenta)
    assert np.ptp(columns) > np.ptp(rows)


def test_a_simulation_ends_with_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "robot.png"

    words = ["sim", "doosan_a0912", "--headless", "--duration", "0.1"]
    code = main([*words, "--screenshot", str(picture)])

    assert code == 0
    assert f"screenshot: {picture}\n" in capsys.readouterr().out
    colours = {tuple(colour) for colour in read(picture).reshape(-1, 3)}
    assert len(colours) > 500


def test_a_picture_that_cannot_be_written_names_the_file(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))
    file = tmp_path / "missing" / "robot.png"

    with pytest.raises(OutputError) as caught:
        save_screenshot(meshcat, file, size=SIZE, photographer=photographer)

    assert str(caught.value) == (
        f"{file}: can't be written: the folder {str(file.parent)!r} doesn't exist"
    )


@dc.dataclass(frozen=True)
class Silent:
    """Stands in for a Meshcat that says nothing more to its page."""

    url: str

    def web_url(self) -> str:
        return self.url

    def Delete(self, path: str) -> None:
        del path


def test_a_page_that_does_not_get_the_scene_is_said(
    photographer: Photographer,
    start_meshcat: StartMeshcat,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("arm_drake.visualization.screenshot._TIMEOUT", 0.5)
    url = start_meshcat().web_url()

    with pytest.raises(BrowserError) as caught:
        photographer.take_picture(Silent(url), size=SIZE)

    assert str(caught.value) == (
        f"{url}/: the page does not get the scene within 0.5 s"
    )


def test_a_page_that_does_not_exist_is_said(
    photographer: Photographer, start_meshcat: StartMeshcat
) -> None:
    url = f"{start_meshcat().web_url()}0/"

    with pytest.raises(BrowserError) as caught:
        photographer.take_picture(Silent(url), size=SIZE)

    assert str(caught.value).startswith(f"the browser can't draw {url}: ")
    assert "\n" not in str(caught.value)


def _programs() -> set[int]:
    """Return the processes below this one, but for those that browsers split off.

    A browser that runs before and after starts and ends such as it likes.
    """
    found = set()
    for process in psutil.Process(os.getpid()).children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            if not any(word.startswith("--type=") for word in process.cmdline()):
                found.add(process.pid)
    return found


def test_the_browser_is_gone_afterwards(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    show_robot(meshcat, load(tmp_path, magenta_arm(1.0)))
    before = _programs()
    threads = set(threading.enumerate())

    save_screenshot(meshcat, tmp_path / "robot.png", size=SIZE)

    wait_until(lambda: _programs() <= before, "the browser has ended")
    # asyncio tells its own threads to end, and doesn't wait for them.
    for thread in set(threading.enumerate()) - threads:
        thread.join(10.0)
    assert set(threading.enumerate()) <= threads
