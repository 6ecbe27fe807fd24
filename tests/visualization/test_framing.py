"""A camera sees all points, and no closer one would.

Where points appear in the picture is computed here, with a pinhole camera.
"""

import itertools
import re

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

import arm_drake as ad
from arm_drake.visualization.drawing import frame_robots
from arm_drake.visualization.meshcat import Camera, View, frame_shapes
from tests.visualization.scene import is_visible, start

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


HOUSE = """
<robot name="house"><link name="walls"><visual><geometry><box size="8 8 8"/></geometry>
</visual></link></robot>"""


def two_links(size: float) -> str:
    """Return a robot of two cubes, one length beside the other."""
    cube = f'<visual><geometry><box size="{size} {size} {size}"/></geometry></visual>'
    return f"""
<robot name="arm"><link name="one">{cube}</link><link name="two">{cube}</link>
  <joint name="bond" type="fixed"><origin xyz="{2.0 * size} 0 0"/>
    <parent link="one"/><child link="two"/></joint></robot>"""


class Recorder:
    """Stands in for a Meshcat, and keeps what it is told."""

    def __init__(self) -> None:
        self.properties: dict[str, float] = {}
        self.scales: dict[str, float] = {}

    def Delete(self, path: str) -> None:
        self.properties = {
            name: value
            for name, value in self.properties.items()
            if not name.startswith((f"{path}.", f"{path}/"))
        }

    def SetCameraPose(self, eye: np.ndarray, target: np.ndarray) -> None:
        self.camera = Camera(tuple(eye), tuple(target))

    def SetProperty(self, path: str, name: str, value: float) -> None:
        self.properties[f"{path}.{name}"] = value

    def SetTransform(self, path: str, matrix: np.ndarray) -> None:
        self.scales[path] = matrix[0, 0]


def framed(*urdfs: str, models: list[str] | None = None) -> Recorder:
    """Return what Meshcat is told to frame some robots at the origin."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    for urdf in urdfs:
        (model,) = Parser(plant).AddModelsFromString(urdf, "urdf")
        plant.WeldFrames(
            plant.world_frame(),
            plant.get_body(plant.GetBodyIndices(model)[0]).body_frame(),
        )
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(
        scene_graph.GetMyContextFromRoot(context)
    )
    recorder = Recorder()
    frame_shapes(recorder, query, models=models)
    return recorder


@pytest.mark.parametrize("size", [0.017, 0.3, 1.0])
def test_a_robot_of_any_size_is_seen_with_meshcats_own_camera(size: float) -> None:
    reported = framed(two_links(size))

    corners = size * np.array(
        list(itertools.product((-0.5, 2.5), (-0.5, 0.5), (-0.5, 0.5)))
    )
    places = project(reported.camera, View(np.deg2rad(75.0), 1.0), corners)
    # 0.15 of the page stays free on each side.
    assert np.abs(places).max() == pytest.approx(0.7, abs=1e-6)
    # Nothing of it is nearer than what the page draws.
    eye, target = np.array(reported.camera.eye), np.array(reported.camera.target)
    forward = (target - eye) / np.linalg.norm(target - eye)
    near = reported.properties["/Cameras/default/rotated/<object>.near"]
    assert ((corners - eye) @ forward).min() > 5.0 * near
    assert near <= 0.01


def test_the_grid_has_cells_that_are_smaller_than_the_robot() -> None:
    # Cells of 0.1 m by default, for what is longer than 0.2 m.
    assert framed(two_links(1.0)).scales["/Grid"] == 1.0
    # The diagonal of 3 x 1 x 1 cubes of 17 mm is 56 mm: cells of 10 mm.
    assert framed(two_links(0.017)).scales["/Grid"] == pytest.approx(0.1)


@pytest.mark.slow
def test_a_robot_stands_on_a_ground_unless_it_reaches_below() -> None:
    meshcat = start()
    for height, has_ground in ((0.0, True), (-0.2, False)):
        robot = ad.load_robot("lab5_arm", pose=[0, 0, height, 0, 0, 0])
        sim = ad.Simulation(ad.build_diagram(robot, meshcat=meshcat))
        depth = frame_robots(sim, meshcat)

        assert depth == pytest.approx(0.0 if has_ground else 0.2, abs=1e-3)
        assert meshcat.HasPath("/Grid/ground/plane")
        assert is_visible(meshcat, "/Grid/ground/plane") == has_ground


@pytest.mark.slow
def test_a_house_has_a_ground_of_its_own() -> None:
    meshcat = start()
    ad.build_diagram(ad.load_robot("lab5_arm"), world="house", meshcat=meshcat)

    assert not meshcat.HasPath("/Grid/ground/plane")


def test_a_house_around_a_robot_does_not_count() -> None:
    alone = framed(two_links(0.1)).camera

    assert framed(two_links(0.1), HOUSE, models=["arm"]).camera == alone
    assert framed(two_links(0.1), HOUSE).camera.distance > 10.0 * alone.distance


def test_a_robot_without_shapes_is_framed_by_its_links() -> None:
    bare = re.sub("<visual>.*?</visual>", "", two_links(1.0))

    reported = framed(bare)

    np.testing.assert_allclose(reported.camera.target, (1.0, 0.0, 0.0), atol=1e-12)
