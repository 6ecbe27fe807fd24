"""Views of cameras and lidars, on the page of a simulation and in its recording."""

import base64
import concurrent.futures
import io
import itertools
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page
from scipy.spatial import KDTree

import arm_drake as ad
from arm_drake.visualization.page import Page as ScenePage
from arm_drake.visualization.page.camera_pictures import CameraPictures
from arm_drake.visualization.page.displays import Displays
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.parts import find_part
from tests.browser.pages import Program, Screen, box, green, look_at, red
from tests.browser.pictures import Camera, picture_at
from tests.models import joint, ros2_control, trajectory_controllers
from tests.waiting import PATIENCE

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# A green sphere of this radius, and a lidar and a camera before it, all so high [m].
RADIUS, DISTANCE, HEIGHT = 0.3, 1.0, 0.5

ROBOT = f"""<robot name="r"><link name="world"/><link name="ball"><visual><geometry>
<sphere radius="{RADIUS}"/></geometry><material name="g"><color rgba="0 1 0 1"/>
</material></visual></link><link name="eye"/>
<joint name="a" type="fixed"><parent link="world"/><child link="ball"/>
<origin xyz="0 0 {HEIGHT}"/></joint>
<joint name="b" type="fixed"><parent link="world"/><child link="eye"/>
<origin xyz="{-DISTANCE} 0 {HEIGHT}"/></joint>
<gazebo reference="eye"><sensor name="laser" type="gpu_lidar"><topic>scan</topic>
<lidar><scan><horizontal><samples>41</samples><min_angle>-0.5</min_angle>
<max_angle>0.5</max_angle></horizontal></scan><range><min>0.05</min><max>9</max>
</range></lidar></sensor>
<sensor name="eye" type="rgbd_camera"><topic>eye</topic><camera>
<horizontal_fov>1.0</horizontal_fov><image><width>160</width><height>120</height>
</image><clip><near>0.05</near><far>9</far></clip></camera></sensor>
</gazebo></robot>"""

# From behind the lidar, to its side and above, so that what it hits is in sight.
CAMERA = Camera(eye=(-0.9, -0.7, 1.0), target=(-0.2, 0.0, HEIGHT))

Live = Program[LiveSimulation]


def simulate(page: ScenePage) -> LiveSimulation:
    options = ad.SimulationOptions(frame_rate=0.0)
    diagram = ad.build_diagram(
        ad.load_robot(ROBOT), options=options, meshcat=page.meshcat
    )
    return LiveSimulation(page, ad.Simulation(diagram), is_paused=True)


@pytest.fixture(scope="module")
def program(
    program_thread: concurrent.futures.ThreadPoolExecutor,
) -> Iterator[Live]:
    program: Live = Program(program_thread, simulate)
    try:
        program.look_from(CAMERA)
        yield program
    finally:
        program.end()


@pytest.fixture
def screen(browser: Browser, program: Live) -> Iterator[Screen]:
    with look_at(browser, program.page.url) as screen:
        yield screen


def show(program: Live, topic: str, is_shown: bool = True) -> int:
    displays = find_part(program.subject.parts, Displays)
    program.ask(lambda: displays.show(topic, is_shown))
    return program.mark()


def test_a_scan_is_dots_where_its_rays_end(program: Live, screen: Screen) -> None:
    before = screen.picture(program.mark())
    picture = screen.picture(show(program, "/scan"))
    without = screen.picture(show(program, "/scan", False))

    # Rays at these angles meet the circle that the sphere is at its height.
    angles = np.linspace(-0.5, 0.5, 41)
    angles = angles[np.abs(np.sin(angles)) < RADIUS / DISTANCE]
    across = DISTANCE * np.sin(angles)
    ranges = DISTANCE * np.cos(angles) - np.sqrt(RADIUS**2 - across**2)
    points = np.stack(
        [
            ranges * np.cos(angles) - DISTANCE,
            ranges * np.sin(angles),
            np.full(len(angles), HEIGHT),
        ],
        axis=1,
    )
    # Those on the near side are in sight.
    to_eye = np.array(CAMERA.eye) - points
    normal = points - [0.0, 0.0, HEIGHT]
    near = np.einsum("ij,ij->i", to_eye, normal) > 0.02
    expected = CAMERA.project(points[near])
    assert len(expected) > 10
    assert not red(before).any()
    assert not red(without).any()
    dots = np.argwhere(red(picture))[:, ::-1]
    to_dot, _ = KDTree(dots).query(expected)
    to_ray, _ = KDTree(CAMERA.project(points)).query(dots)
    assert to_dot.max() < 4.0
    assert to_ray.max() < 16.0  # The radius of a dot is 10 mm.


def test_a_cloud_is_points_where_the_camera_sees_them(
    program: Live, screen: Screen
) -> None:
    meshcat = program.page.meshcat
    program.ask(lambda: meshcat.SetProperty("/drake/visual", "visible", False))
    before = screen.picture(program.mark())
    picture = screen.picture(show(program, "/eye/points"))
    points = program.ask(lambda: program.subject.simulation.camera("eye").points())
    show(program, "/eye/points", False)
    program.ask(lambda: meshcat.SetProperty("/drake/visual", "visible", True))

    # In the colour that the camera saw: those on the ball are green, and no others.
    assert not green(before).any()
    on_ball = np.linalg.norm(points - [0.0, 0.0, HEIGHT], axis=1) < RADIUS + 1e-3
    assert on_ball.sum() > 1000
    expected = CAMERA.project(points[on_ball])
    drawn = np.argwhere(green(picture))[:, ::-1]
    to_point, _ = KDTree(expected).query(drawn)
    assert len(drawn) > 1000
    assert to_point.max() < 8.0
    to_drawn, _ = KDTree(drawn).query(expected)
    assert np.percentile(to_drawn, 95.0) < 8.0


@pytest.mark.parametrize("kind", ["color", "depth"])
def test_a_picture_is_what_the_camera_takes(
    kind: str, program: Live, screen: Screen
) -> None:
    pictures = find_part(program.subject.parts, CameraPictures)
    image = screen.page.locator('[data-id="cameras:picture"] img')
    before = image.get_attribute("src")
    section = screen.page.locator("details", has=image)
    if section.get_attribute("open") is None:
        section.locator("summary").click()
    program.ask(lambda: pictures.show(f"eye {kind}"))
    screen.until(lambda: image.get_attribute("src") not in (before, ""), "a picture")

    screen.until(image.is_visible, "the picture")
    data = (image.get_attribute("src") or "").partition(",")[2]
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(data)))).astype(int)
    taken = program.ask(lambda: program.subject.simulation.camera("eye").image(kind))
    program.ask(lambda: pictures.show("nothing"))
    # JPEG blurs edges; depths have their scale below them.
    assert np.abs(shown[:120] - taken).mean() < 4.0
    assert shown.shape[0] == (120 if kind == "color" else 140)
    if kind == "depth":
        scale = shown[130]
        assert scale[0].argmax() == 0  # Near is red.
        assert scale[-1].argmax() == 2  # Far is blue.


def test_cameras_are_shown_as_pyramids(program: Live, screen: Screen) -> None:
    before = screen.picture(program.mark())
    toggle = screen.widget("cameras:frusta")
    section = screen.page.locator("details", has=toggle)
    if section.get_attribute("open") is None:
        section.locator("summary").click()

    part = find_part(program.subject.parts, CameraPictures)
    screen.click("cameras:frusta")
    screen.until(lambda: part.has_frusta, "the pyramids")
    picture = screen.picture(program.mark())
    screen.click("cameras:frusta")
    screen.until(lambda: not part.has_frusta, "no pyramids")
    without = screen.picture(program.mark())

    # From the camera, which looks along x, to the corners of its picture 0.15 m ahead,
    # 1 rad apart from left to right; a quarter less up and down.
    depth, half = 0.15, 0.15 * math.tan(0.5)
    apex = np.array([-DISTANCE, 0.0, HEIGHT])
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    corners = [apex + np.array([depth, y * half, z * 0.75 * half]) for y, z in signs]
    edges = [(apex, corner) for corner in corners]
    edges += list(itertools.pairwise([*corners, corners[0]]))
    share = np.linspace(0.0, 1.0, 60)[:, None]
    expected = np.concatenate([a + share * (b - a) for a, b in edges])
    # Above the upper edge a mark shows where up is.
    top = (corners[0] + corners[1]) / 2.0
    mark = top + share * [0.0, 0.0, 0.3 * 0.75 * half]
    changed = np.argwhere(np.abs(picture.astype(int) - before).max(axis=2) > 30)
    drawn = changed[:, ::-1]
    assert not (np.abs(without.astype(int) - before).max(axis=2) > 30).any()
    pixels = CAMERA.project(expected)
    pixels = pixels[pixels[:, 0] >= 0]  # One corner is beside the picture.
    assert len(pixels) > 0.7 * len(expected)
    to_drawn, _ = KDTree(drawn).query(pixels)
    assert to_drawn.max() < 4.0
    lines = CAMERA.project(np.concatenate([expected, mark]))
    to_line, _ = KDTree(lines).query(drawn)
    assert to_line.max() < 4.0


def test_a_recording_has_scans_of_its_times(page: Page, tmp_path: Path) -> None:
    laser = """<link name="laser"/><joint name="l" type="fixed"><parent link="base"/>
<child link="laser"/><origin xyz="0.5 0 0.8" rpy="0 0 3.14159"/></joint>
<gazebo reference="laser"><sensor name="laser" type="gpu_lidar"><topic>scan</topic>
<lidar><scan><horizontal><samples>91</samples><min_angle>-0.3</min_angle>
<max_angle>0.3</max_angle></horizontal></scan><range><min>0.05</min><max>9</max></range>
</lidar></sensor></gazebo>"""
    robot = f"""<robot name="arm"><link name="base"/><link name="upper">
{box("0.08 0.08 0.4", 0.2, "0 1 0")}</link>
{joint("elbow", "base", "upper", xyz="0 0 0.5")}
{ros2_control("elbow")}{laser}</robot>"""
    goal = f"joint_names: [elbow], points: [{{positions: [{math.pi / 2}]"
    motion = (
        f"- {{at: 0.2, controller: arm, goal: {{{goal}, time_from_start: 0.5}}]}}}}"
    )
    files = {
        "arm.urdf": robot,
        "controllers.yaml": trajectory_controllers({"arm": ["elbow"]}),
        "motion.yaml": motion,
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    words = ["sim", "arm.urdf", "--controllers", "controllers.yaml", "--headless"]
    words += ["--motion", "motion.yaml", "--duration", "1", "--display", "/scan"]
    words += ["--record", "film.html"]
    subprocess.run(
        [sys.executable, "-m", "arm_drake", *words],
        cwd=tmp_path,
        check=True,
        timeout=PATIENCE,
    )
    page.goto((tmp_path / "film.html").as_uri())
    first, last, again = (red(picture_at(page, time)) for time in (0.0, 0.9, 0.1))

    # The arm is level then, below the rays.
    assert first.sum() > 20
    assert not last.any()
    assert again.sum() == first.sum()
