"""Cameras of robots, judged by projection and ray casts by hand."""

import concurrent.futures
import dataclasses as dc
import gc
import io
import itertools
import math
import os
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any, get_args

import numpy as np
import PIL.Image
import pytest
import trimesh
from pydrake.systems.framework import CacheIndex

import arm_drake as ad
from arm_drake.description.perception_sensors import CameraKind, CameraSensor
from arm_drake.errors import InputError
from arm_drake.perception import scenery as scenery_module
from arm_drake.perception.cameras import Camera, topics_of
from arm_drake.perception.images import color_labels, to_array, to_points
from arm_drake.perception.scenery import Scenery
from tests.robots import skip_or_fail
from tests.snippets import ROOT, read_blocks

_URDF = """<robot name="r"><link name="world"/><link name="base">
<inertial><mass value="1"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="1.1 0 0.4"/><geometry><box size="0.2 0.3 0.2"/></geometry>
<material name="red"><color rgba="0.9 0.1 0.1 1"/></material></visual></link>
<link name="eye"/>
<joint name="a" type="fixed"><parent link="world"/><child link="base"/></joint>
<joint name="b" type="fixed"><parent link="base"/><child link="eye"/>
<origin xyz="0 0 0.4"/></joint>
<gazebo reference="eye"><sensor name="front" type="rgbd_camera"><topic>cam</topic>
<camera><horizontal_fov>{fov}</horizontal_fov>
<image><width>{width}</width><height>240</height><format>{pixels}</format></image>
<clip><near>{near}</near><far>10</far></clip></camera></sensor></gazebo></robot>"""
_NUMBERS = {"fov": "1.0", "width": "320", "near": "0.05", "pixels": "R8G8B8"}


def load(**numbers: str) -> ad.Robot:
    return ad.load_robot(_URDF.format(**{**_NUMBERS, **numbers}))


@pytest.fixture(scope="module")
def simulation() -> ad.Simulation:
    return ad.Simulation(ad.build_diagram(load()))


def test_a_camera_is_shown_with_its_topics(simulation: ad.Simulation) -> None:
    camera = simulation.camera("front")

    assert repr(camera) == f"<CameraHandle on {', '.join(camera.topics.values())}>"


def test_a_box_is_where_a_pinhole_projects_it(simulation: ad.Simulation) -> None:
    depth = simulation.camera("front").depth()
    focal = 320 / (2.0 * math.tan(0.5))
    rows, columns = np.nonzero(np.abs(depth - 1.0) < 1e-3)

    # Its face is 0.3 m wide and 0.2 m high, 1 m ahead; the middle is at 159.5, 119.5.
    assert columns.min() - 0.5 == pytest.approx(159.5 - 0.15 * focal, abs=0.5)
    assert columns.max() + 0.5 == pytest.approx(159.5 + 0.15 * focal, abs=0.5)
    assert rows.min() - 0.5 == pytest.approx(119.5 - 0.1 * focal, abs=0.5)
    assert rows.max() + 0.5 == pytest.approx(119.5 + 0.1 * focal, abs=0.5)


def test_depths_are_those_of_rays(simulation: ad.Simulation) -> None:
    camera = simulation.camera("front")
    depth = camera.depth()
    # The ground is 0.4 m below: a ray of slope s meets it at 0.4 / s.
    slopes = (np.arange(240) - camera.info.k[5]) / camera.info.k[4]
    below = np.arange(240) > 180

    np.testing.assert_allclose(depth[below, 5], 0.4 / slopes[below], atol=1e-3)
    assert np.isposinf(depth[0, 0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("near", "told"),
    [(0.9, 1.0), (1.05, -math.inf), (1.15, 1.2), (1.3, -math.inf), (1.4, math.inf)],
)
def test_a_layer_before_the_near_plane_is_too_near_and_what_is_nearer_is_not_there(
    near: float, told: float
) -> None:
    # The box is from 1 to 1.2 m ahead; the layer is a tenth, as in Gazebo Sim.
    simulation = ad.Simulation(ad.build_diagram(load(near=str(near))))
    camera = simulation.camera("front")

    assert camera.depth()[120, 160] == pytest.approx(told, abs=1e-3)
    image = to_array(simulation.topic("/cam/depth_image").value())
    assert image[120, 160] == camera.depth()[120, 160]
    seen = camera.points("optical")
    is_ahead = np.abs(seen[:, :2]).max(axis=1) < 0.05
    assert is_ahead.any() == math.isfinite(told)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("near", "least", "told"),
    [
        (0.9, 0.95, 1.0),
        (0.9, 1.1, -math.inf),
        (1.05, 1.1, 1.2),
        (1.05, 1.25, -math.inf),
    ],
)
def test_with_classics_plugin_what_is_nearer_than_its_least_depth_is_too_near(
    near: float, least: float, told: float
) -> None:
    plugin = (
        '<plugin name="eyes" filename="libgazebo_ros_camera.so">'
        f"<min_depth>{least}</min_depth></plugin></sensor>"
    )
    text = _URDF.format(**{**_NUMBERS, "near": str(near)})
    text = text.replace("rgbd_camera", "depth").replace("</sensor>", plugin)
    simulation = ad.Simulation(ad.build_diagram(ad.load_robot(text)))

    depth = simulation.camera("front").depth()[120, 160]

    # The box is from 1 to 1.2 m ahead; before the near plane it isn't drawn at all.
    assert depth == pytest.approx(told, abs=1e-3)


def test_who_draws_on_a_picture_has_one_of_his_own(simulation: ad.Simulation) -> None:
    camera = simulation.camera("front")
    for take in (camera.color, camera.depth):
        before = take()
        take()[:] = 0
        np.testing.assert_array_equal(take(), before)


def test_points_are_on_what_is_seen(simulation: ad.Simulation) -> None:
    points = simulation.camera("front").points()
    face = points[np.abs(points[:, 0] - 1.0) < 1e-3]

    assert np.ptp(face[:, 1]) == pytest.approx(0.3, abs=0.01)
    assert np.abs(points[points[:, 0] > 1.3, 2]).max() < 1e-3


def test_topics_have_pictures_and_points(simulation: ad.Simulation) -> None:
    image = simulation.topic("/cam/image").value()
    cloud = simulation.topic("/cam/points").value()

    assert to_array(image).shape == (240, 320, 3)
    assert image.header.frame_id == "r/eye/front"
    # Gazebo Sim's points are x ahead.
    assert to_points(cloud)[120, 160, 0] == pytest.approx(1.0, abs=1e-3)


def test_labels_are_names_of_links(simulation: ad.Simulation) -> None:
    camera = simulation.camera("front")

    assert camera.label_names[camera.labels()[120, 160]] == "r::base"


def test_colours_of_labels_are_told_apart(simulation: ad.Simulation) -> None:
    camera = simulation.camera("front")
    picture, labels = camera.image("labels"), camera.labels()
    base = camera.label_names.index("r::base")

    colors = color_labels(np.arange(31))
    pairs = itertools.combinations(colors.astype(int), 2)
    apart = [np.abs(a - b).sum() for a, b in pairs]

    # Of 30 things and nothing no two differ by less than 50 levels in all.
    assert min(apart) >= 50
    assert camera.label_colors["nothing"] == (0, 0, 0)
    assert set(camera.label_colors) == {"nothing", "ground", "r::base"}
    seen = np.unique(picture[labels == base], axis=0)
    assert seen.tolist() == [list(camera.label_colors["r::base"])]


def test_in_a_notebook_a_camera_is_its_picture(simulation: ad.Simulation) -> None:
    camera = simulation.camera("front")

    with PIL.Image.open(io.BytesIO(camera._repr_png_())) as picture:
        shown = np.asarray(picture)

    np.testing.assert_array_equal(shown, camera.color())


@pytest.mark.parametrize(
    "pose",
    ["abc", 3.0, None, (1, 2, 3), (0, 0, 0, 0, 0, math.nan), [[1] * 6], "123456"],
)
def test_a_pose_that_is_none_is_reported_in_one_message(pose: Any) -> None:
    with pytest.raises(InputError) as error:
        ad.add_camera(load(), "eye", pose, name="other")

    assert str(error.value) == (
        "camera 'other': pose: expected x, y, z [m], roll, pitch, yaw [rad], got "
        f"{pose!r}"
    )


def test_nobody_reads_nothing_is_loaded() -> None:
    simulation = ad.Simulation(ad.build_diagram(load()))
    simulation.advance_to(0.1)
    [camera] = simulation.directory.manager(None).sensors

    assert not camera.scenery.is_loaded


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
@pytest.mark.parametrize(
    "hidden", [{"__EGL_VENDOR_LIBRARY_DIRS": "/none"}, {"LIBGL_DRIVERS_PATH": "/none"}]
)
def test_where_nothing_draws_one_message_names_the_packages(
    hidden: dict[str, str], tmp_path: Path
) -> None:
    robot = tmp_path / "robot.urdf"
    robot.write_text(_URDF.format(**_NUMBERS))
    command = (
        *f"-m arm_drake sim {robot} --headless --duration 0.1".split(),
        "--image",
    )
    image = tmp_path / "front.png"

    run = subprocess.run(
        (sys.executable, *command, f"front={image}"),
        env={**os.environ, **hidden},
        capture_output=True,
        text=True,
    )

    last = run.stderr.splitlines()[-1]
    if run.returncode == 0 and "LIBGL_DRIVERS_PATH" in hidden:
        skip_or_fail("this Mesa has its drivers elsewhere")
    assert run.returncode == 2
    assert last.startswith("arm-drake: pictures of cameras need OpenGL by EGL: ")
    assert last.endswith("apt-get install libegl1 libgl1-mesa-dri")
    assert not image.exists()


def test_steps_tell_cameras_little() -> None:
    simulation = ad.Simulation(ad.build_diagram(load()))
    [camera] = simulation.directory.manager(None).sensors
    entries = [
        camera.get_cache_entry(CacheIndex(i)) for i in range(_num_entries(camera))
    ]
    of_ports = [entry for entry in entries if "output port" in entry.description()]
    measured = [entry for entry in entries if entry.description() == "measured"]

    assert len(of_ports) == camera.num_output_ports() == 4
    assert all(entry.is_disabled_by_default() for entry in of_ports)
    for entry in (*of_ports, *measured):
        assert entry.prerequisites() == {camera.GetInputPort("geometry_query").ticket()}
    assert camera.GetInputPort("geometry_query").ticket() != camera.time_ticket()


def _num_entries(camera: Camera) -> int:
    return camera._measured + 1 + camera.num_output_ports()


@pytest.mark.slow
def test_a_simulation_that_is_gone_goes_with_the_first_picture_of_the_next() -> None:
    gc.disable()
    try:
        first = ad.Simulation(ad.build_diagram(load()))
        first.camera("front").color()
        gone = weakref.ref(first.diagram)
        del first

        second = ad.Simulation(ad.build_diagram(load()))
        second.camera("front").color()

        assert gone() is None
        assert second.camera("front").depth().shape == (240, 320)
        # A Meshcat among what is gone would end the process in another thread.
        gone = weakref.ref(second.diagram)
        del second
        third = ad.Simulation(ad.build_diagram(load()))
        with concurrent.futures.ThreadPoolExecutor(1) as other:
            other.submit(third.camera("front").color).result()
        assert gone() is not None
    finally:
        gc.enable()


@pytest.mark.slow
def test_what_is_read_is_of_its_time_and_poses() -> None:
    # Also where no step of the plant lies between two times.
    robot = ad.load_robot("mycobot_280")
    robot = ad.add_camera(robot, "gripper_base", name="hand", width=32, height=24)
    sim = ad.Simulation(ad.build_diagram(robot))
    stamps, pictures = [], []
    root = sim.simulator.get_mutable_context()
    plant = sim.diagram.GetSubsystemByName("plant")
    port = sim.diagram.GetOutputPort("/hand/image")

    for time, angle in ((0.0, None), (0.0, None), (0.0, 0.5), (1e-4, None)):
        root.SetTime(time)
        if angle is not None:
            joint = plant.GetJointByName("link1_to_link2")
            joint.set_angle(plant.GetMyMutableContextFromRoot(root), angle)
        pictures.append(port.Eval(root))
        stamps.append(pictures[-1].header.stamp.nanosec)

    assert pictures[1] is pictures[0]
    assert pictures[2].data != pictures[0].data
    assert pictures[3].data == pictures[2].data
    assert stamps == [0, 0, 0, 100_000]


@pytest.mark.slow
def test_threads_take_pictures_in_turns(capfd: pytest.CaptureFixture[str]) -> None:
    def shoot(sim: ad.Simulation) -> list[Any]:
        camera = sim.camera("camera")
        return [camera.color(), camera.depth(), camera.labels()]

    where = (1.5, 0.0, 1.0, 0.0, 0.4, 3.14)
    robot = ad.add_camera(ad.load_robot("doosan_a0912"), "world", where, width=64)
    sims = [ad.Simulation(ad.build_diagram(robot)) for _ in range(2)]
    expected = shoot(sims[0])
    with concurrent.futures.ThreadPoolExecutor(1) as other:
        # The thread stays while the main one draws.
        found = other.submit(shoot, sims[1]).result()
        for sim in sims:
            sim.advance_to(0.1)
        later = shoot(sims[1])
        again = shoot(sims[0])

    for one, two in zip([*expected, *again], [*found, *later], strict=True):
        np.testing.assert_array_equal(one, two)
    assert len(np.unique(later[2])) > 3
    assert "eglMakeCurrent" not in capfd.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("shape", ['<box size="1 1 1"/>', '<mesh filename="{}"/>'])
def test_what_the_sun_shines_on_has_the_colour_that_it_was_given(
    shape: str, tmp_path: Path
) -> None:
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "box.stl")
    geometry = shape.format(f"file://{tmp_path}/box.stl")
    robot = ad.load_robot(f"""<robot name="r"><link name="world"/><link name="box">
<visual><geometry>{geometry}</geometry><material name="red">
<color rgba="0.8 0.2 0.2 1"/></material></visual></link><joint name="a" type="fixed">
<parent link="world"/><child link="box"/></joint></robot>""")
    above = (0.0, 0.0, 2.0, 0.0, math.pi / 2.0, 0.0)
    robot = ad.add_camera(robot, "world", above, name="eye", width=32, height=24)

    seen = ad.Simulation(ad.build_diagram(robot)).camera("eye").color()[12, 16]

    # A surface shines a little, whatever its colour is.
    np.testing.assert_allclose(seen, np.array([0.8, 0.2, 0.2]) * 255.0, atol=30.0)


@pytest.mark.slow
def test_noise_is_that_of_its_seed() -> None:
    def look(seed: int) -> np.ndarray:
        robot = ad.add_camera(load(), "eye", name="noisy", width=32, noise=0.1)
        options = ad.SimulationOptions(seed=seed)
        diagram = ad.build_diagram(robot, options=options)
        return ad.Simulation(diagram).camera("noisy").color()

    first = look(1)

    np.testing.assert_array_equal(first, look(1))
    assert (first != look(2)).any()


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ({"fov": "0"}, "horizontal_fov: expected more than 0 and less than pi"),
        ({"fov": "3.2"}, "horizontal_fov: expected more than 0 and less than pi"),
        ({"fov": "nan"}, "horizontal_fov: expected more than 0 and less than pi"),
        ({"fov": "inf"}, "horizontal_fov: expected more than 0 and less than pi"),
        ({"width": "nan"}, "image width: expected 1 to 8192 pixels, got nan"),
        ({"width": "0"}, "image width: expected 1 to 8192 pixels, got 0"),
        ({"width": "9000"}, "image width: expected 1 to 8192 pixels, got 9000"),
        ({"near": "10"}, "clip: expected 0 < near < far, got 10 and 10 m"),
        ({"pixels": "RGB9"}, "unknown pixel format 'RGB9'; known: R8G8B8"),
    ],
)
def test_what_is_no_camera_is_reported(numbers: dict[str, str], told: str) -> None:
    robot = load(**numbers)

    assert not robot.description.perception_sensors
    assert [e for e in robot.report.errors if e.what.startswith(told)]


@pytest.mark.parametrize(
    ("argument", "value", "told"),
    [
        ("robot", "r", "robot: expected a robot of arm_drake.load_robot, got 'r'"),
        ("link", None, "link: expected a text, got None"),
        ("name", 3, "name: expected a text, got 3"),
        ("kind", 3, "kind: expected a text, got 3"),
        ("width", "x", "camera 'c': width: expected a number, got 'x'"),
        ("width", True, "camera 'c': width: expected a number, got True"),
        ("width", 0, "camera 'c': image width: expected 1 to 8192 pixels, got 0"),
        ("height", 0, "camera 'c': image height: expected 1 to 8192 pixels, got 0"),
        (
            "horizontal_fov",
            "x",
            "camera 'c': horizontal_fov: expected a number, got 'x'",
        ),
        (
            "horizontal_fov",
            math.nan,
            "camera 'c': horizontal_fov: expected more than 0 and less than pi, "
            "got nan rad",
        ),
        ("near", None, "camera 'c': near: expected a number, got None"),
        ("noise", "x", "camera 'c': noise: expected a number, got 'x'"),
        ("update_rate", "x", "camera 'c': update_rate: expected a number, got 'x'"),
        *(
            (
                "update_rate",
                rate,
                f"camera 'c': update_rate: expected a finite number above 0 Hz, "
                f"got {rate:g}",
            )
            for rate in (math.inf, math.nan, -1.0, 0)
        ),
    ],
)
def test_what_add_camera_cannot_use_is_reported_in_one_message(
    argument: str, value: Any, told: str
) -> None:
    arguments = {"robot": load(), "link": "eye", "name": "c", argument: value}
    with pytest.raises(InputError) as error:
        ad.add_camera(**arguments)

    assert str(error.value) == told


@pytest.mark.slow
def test_a_size_may_be_a_number_of_numpy() -> None:
    robot = ad.add_camera(load(), "eye", name="c", width=np.int64(32), height=24.0)  # type: ignore[arg-type]

    sensor = robot.description.perception_sensors[-1]

    assert isinstance(sensor, CameraSensor)
    assert (type(sensor.width), type(sensor.height)) == (int, int)
    assert ad.Simulation(ad.build_diagram(robot)).camera("c").color().shape[1] == 32


@pytest.mark.parametrize("kind", get_args(CameraKind))
def test_the_topics_of_an_added_camera_begin_with_its_name(kind: CameraKind) -> None:
    robot = ad.add_camera(load(), "eye", name="left", kind=kind)
    camera = robot.description.perception_sensors[-1]
    assert isinstance(camera, CameraSensor)

    topics = topics_of(camera, "r", "default")

    assert topics["camera_info"] == "/left/camera_info"
    assert all(topic.startswith("/left/") for topic in topics.values())


def test_a_camera_needs_a_link() -> None:
    with pytest.raises(InputError, match="no link 'ey'"):
        ad.add_camera(load(), "ey")


def test_the_other_robot_stays_as_it_is() -> None:
    robot = load()
    changed = ad.add_camera(robot, "eye", name="second")

    assert len(robot.description.perception_sensors) == 1
    assert len(changed.description.perception_sensors) == 2
    assert dc.is_dataclass(changed)


@pytest.mark.slow
def test_the_page_of_cameras_is_right() -> None:
    blocks = read_blocks(ROOT / "docs" / "cameras.md")
    text = "\n".join(b.text for b in blocks if b.language == "python")
    names: dict[str, Any] = {}

    exec(text, names)  # noqa: S102

    camera = names["camera"]
    # There is none; all that stands on the ground is the robot.
    assert not names["found"]
    assert camera.color().shape == (480, 640, 3)
    assert any("mycobot" in name for name in camera.label_names)


_ROOM = """<sdf version="1.11"><world name="room"><model name="m"><static>1</static>
<link name="l">{visuals}</link></model></world></sdf>"""


@pytest.mark.slow
def test_meshes_that_move_together_are_drawn_as_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    visuals = ""
    for index, (color, size) in enumerate(
        (("1 0.2 0.1 1", 0.3), ("0.1 0.3 1 0.4", 0.2), ("0.1 0.8 0.2 1", 0.2))
    ):
        name = f"{index}.ply"
        trimesh.creation.box((size,) * 3).export(tmp_path / name)
        visuals += f"""<visual name="v{index}"><pose>0.{index} 0.{2 + 3 * index} 0.4
        0.2 0.3 0.5</pose><geometry><mesh><uri>{name}</uri><scale>1 1.5 0.5</scale>
        </mesh></geometry><material><diffuse>{color}</diffuse></material></visual>"""
    world = tmp_path / "room.sdf"
    world.write_text(_ROOM.format(visuals=visuals))

    def shoot() -> tuple[Scenery, Any, Any, Any]:
        robot = ad.add_camera(load(), "world", (-1.0, 0.1, 0.5, 0, 0, 0), name="all")
        camera = ad.Simulation(ad.build_diagram(robot, world=world)).camera("all")
        scenery = camera._system.scenery
        return scenery, camera.color(), camera.depth(), camera.labels()

    scenery, *joined = shoot()
    join = scenery_module._join
    monkeypatch.setattr(
        scenery_module, "_join", lambda copies: [join([c])[0] for c in copies]
    )
    apart, *expected = shoot()

    # The red and the green one, the blue one, and the box of `load`.
    counts = [
        each._loaded[False].scene_graph.model_inspector().num_geometries()
        for each in (scenery, apart)
    ]
    assert counts == [3, 4]
    color, depth, labels = joined
    names = {scenery.label_names[number] for number in np.unique(labels)}
    assert names == {"nothing", "m::l", "r::base"}
    np.testing.assert_array_equal(labels, expected[2])
    np.testing.assert_allclose(depth, expected[1], atol=1e-4)
    # Edges that VTK rounds otherwise may differ.
    differences = np.abs(color.astype(int) - expected[0]).max(axis=2)
    assert (differences > 2).sum() < 20
