"""A ghost stands where its joint positions put it."""

from pathlib import Path

import numpy as np
import pinocchio
import pytest
from pydrake.geometry import GeometryInstance as Geometry
from pydrake.geometry import Mesh, SceneGraph
from pydrake.math import RigidTransform

import arm_drake as ad
from arm_drake.description.meshes.surfaces import Surface, encode_gltf
from arm_drake.errors import InputError
from arm_drake.visualization.ghost import Ghost
from arm_drake.visualization.link_drawings import visual_solid
from tests import models
from tests.visualization import scene
from tests.visualization.scene import Scene, Spy, make_scene

BOX = '<visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual>'
PATH = "/drake/ghost/goal"


def arm(inside: str = BOX) -> str:
    """Return the arm of two links with visual shapes."""
    return models.TWO_LINKS.replace("</inertial>", f"</inertial>{inside}")


def ghost_of(robot: Scene, meshcat: object, **options: object) -> Ghost:
    plant, scene_graph, model, description, _ = robot
    return Ghost(meshcat, plant, scene_graph, model, "goal", description, **options)


def place(meshcat: object, link: str) -> np.ndarray:
    return scene.transform(meshcat, f"{PATH}/{link}")


def test_it_stands_where_its_joints_put_it(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, arm()), scene.start()
    ghost = ghost_of(robot, meshcat)

    ghost.show({"shoulder": 0.3, "elbow": 0.4})

    upper, lower = scene.about_y(0.3), scene.about_y(0.7)
    elbow = upper @ [0.0, 0.0, -models.LENGTH]
    np.testing.assert_allclose(
        place(meshcat, "upper"), upper.GetAsMatrix4(), atol=1e-12
    )
    np.testing.assert_allclose(
        place(meshcat, "lower"), (RigidTransform(elbow) @ lower).GetAsMatrix4()
    )
    assert scene.is_visible(meshcat, PATH)


def test_a_real_arm_stands_where_pinocchio_has_it() -> None:
    description = ad.load_robot("doosan_a0912").description
    robot, meshcat = scene.place(description), scene.start()
    names = [joint.name for joint in description.movable_joints]
    positions = dict(zip(names, np.linspace(-1.0, 1.5, len(names)), strict=True))

    ghost_of(robot, meshcat).show(positions)

    model = pinocchio.buildModelFromXML(description.urdf)
    data = model.createData()
    q = pinocchio.neutral(model)
    for name, position in positions.items():
        q[model.joints[model.getJointId(name)].idx_q] = position
    pinocchio.framesForwardKinematics(model, data, q)
    drawn = [n for n in description.links if meshcat.HasPath(f"{PATH}/{n}")]
    assert len(drawn) > 5
    for link in drawn:
        expected = data.oMf[model.getFrameId(link)].homogeneous
        # Angles and lengths are written with up to 17 digits.
        np.testing.assert_allclose(place(meshcat, link), expected, atol=1e-9)


def test_joints_that_are_left_out_stay_as_in_the_base_context(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, arm()), scene.start()
    base = scene.context_at(robot, shoulder=0.3, elbow=0.4)
    ghost = ghost_of(robot, meshcat, base_context=base)
    # Its positions are those of the creation.
    robot.plant.SetPositions(base, [1.0, 1.0])

    ghost.show({"elbow": 0.1})

    expected = scene.about_y(0.4, scene.about_y(0.3) @ [0.0, 0.0, -models.LENGTH])
    np.testing.assert_allclose(
        place(meshcat, "lower"), expected.GetAsMatrix4(), atol=1e-12
    )


@pytest.mark.parametrize(
    ("positions", "angle"),
    [
        # -0.5 times the master's angle plus 0.1.
        ({"finger": 0.4}, -0.1),
        ({"finger": 0.4, "follower": 0.7}, 0.7),
        # The master says nothing: as in the base context.
        ({}, 0.0),
    ],
)
def test_a_mimic_joint_follows_unless_it_is_given(
    tmp_path: Path, positions: dict[str, float], angle: float
) -> None:
    urdf = models.GRIPPER.replace("</inertial>", f"</inertial>{BOX}")
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()

    ghost_of(robot, meshcat).show(positions)

    expected = scene.about_y(angle, [0.0, 1.0, 0.0]).GetAsMatrix4()
    np.testing.assert_allclose(place(meshcat, "right"), expected, atol=1e-12)


@pytest.mark.parametrize("has_free_base", [True, False])
def test_the_base_pose_moves_what_the_base_carries(
    tmp_path: Path, has_free_base: bool
) -> None:
    pose = (0.5, 0.6, 0.7, 0.0, 0.1, 0.0)
    robot = make_scene(tmp_path, arm(), pose=pose, has_free_base=has_free_base)
    context, meshcat = scene.context_at(robot), scene.start()
    if has_free_base:
        base = robot.plant.GetBodyByName("base", robot.model)
        robot.plant.SetFreeBodyPose(context, base, scene.about_y(0.1, pose[:3]))
    ghost = ghost_of(robot, meshcat, base_context=context)
    X_WB = scene.about_y(0.2, [1.0, 2.0, 3.0])

    ghost.show({"shoulder": 0.3})
    without = place(meshcat, "upper")
    ghost.show({"shoulder": 0.3}, base_pose=X_WB)

    expected = scene.about_y(0.1 + 0.3, pose[:3]).GetAsMatrix4()
    np.testing.assert_allclose(without, expected, atol=1e-12)
    expected = scene.about_y(0.2 + 0.3, [1.0, 2.0, 3.0]).GetAsMatrix4()
    np.testing.assert_allclose(place(meshcat, "upper"), expected, atol=1e-12)


def test_what_another_root_carries_stays(tmp_path: Path) -> None:
    stand = f'<link name="stand">{BOX}</link>'
    urdf = arm().replace('<link name="base"/>', f'<link name="base"/>{stand}')
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()

    ghost_of(robot, meshcat).show({}, base_pose=RigidTransform([1.0, 2.0, 3.0]))

    np.testing.assert_array_equal(place(meshcat, "stand"), np.eye(4))


def test_each_pose_is_one_of_its_own(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, arm()), scene.start()
    ghost = ghost_of(robot, meshcat)
    ghost.show({"elbow": 0.4})

    ghost.show({"shoulder": 0.3})

    expected = scene.about_y(0.3, scene.about_y(0.3) @ [0.0, 0.0, -models.LENGTH])
    np.testing.assert_allclose(
        place(meshcat, "lower"), expected.GetAsMatrix4(), atol=1e-12
    )


def test_a_robot_on_the_world_is_moved_from_the_origin(tmp_path: Path) -> None:
    urdf = arm().replace('<link name="base"/>', '<link name="world"/>')
    urdf = urdf.replace('link="base"', 'link="world"')
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()

    ghost_of(robot, meshcat).show({}, base_pose=RigidTransform([1.0, 2.0, 3.0]))

    np.testing.assert_allclose(place(meshcat, "upper")[:3, 3], [1.0, 2.0, 3.0])


def test_shapes_are_sent_once_and_only_what_moved_afterwards(tmp_path: Path) -> None:
    robot, spy = make_scene(tmp_path, arm()), Spy()
    ghost = ghost_of(robot, spy)
    assert spy.take() == []
    ghost.show({"elbow": 0.5})
    assert ("SetObject", f"{PATH}/lower/0") in spy.take()

    ghost.show({"elbow": 0.6})
    assert spy.take() == [("SetTransform", f"{PATH}/lower")]

    ghost.hide()
    assert spy.take() == [("SetProperty", PATH)]
    assert not scene.is_visible(spy.meshcat, PATH)

    ghost.show({"elbow": 0.6})
    assert spy.take() == [("SetProperty", PATH)]
    assert scene.is_visible(spy.meshcat, PATH)


def test_meshes_get_the_colour_too_and_keep_their_place(tmp_path: Path) -> None:
    # No symmetry of a turned or mirrored tetrahedron is hidden by its points.
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0)]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
    file = tmp_path / "part.obj"
    file.write_text(f"{text}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", encoding="utf-8")
    mesh = '<mesh filename="part.obj" scale="1 1 2"/>'
    visual = f'<visual><origin xyz="1 0 0"/><geometry>{mesh}</geometry></visual>'
    robot, meshcat = make_scene(tmp_path, arm(visual)), scene.start()

    ghost_of(robot, meshcat, color=(1.0, 0.0, 0.0)).show({})

    path = f"{PATH}/upper/0"
    found = {tuple(p) for p in scene.vertices(meshcat, path).tolist()}
    assert found == {(x, y, 2.0 * z) for x, y, z in points}
    np.testing.assert_allclose(scene.pose(meshcat, path)[:3, 3], [1.0, 0.0, 0.0])
    colour, opacity = scene.colour(meshcat, path)
    assert colour == (255, 0, 0)
    assert opacity == pytest.approx(0.35)


def test_all_parts_of_a_mesh_are_drawn_in_its_scale(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    parts = [corners, np.add(corners, [0.0, 0.0, 1.0])]
    surfaces = [
        Surface(part, np.array([[0, 1, 2]]), color=(shade, shade, shade, 1.0))
        for part, shade in zip(parts, (0.1, 0.9), strict=True)
    ]
    file = tmp_path / "parts.gltf"
    file.write_bytes(encode_gltf(surfaces, (1.0, 1.0, 1.0, 1.0)))
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("source")
    shape = Geometry(RigidTransform(), Mesh(str(file), [1.0, 2.0, 3.0]), "parts")
    geometry = scene_graph.RegisterAnchoredGeometry(source, shape)

    solid = visual_solid(scene_graph.model_inspector(), geometry)

    triangles = sorted(solid.vertices.T[solid.faces.T].tolist())
    expected = sorted((np.array(parts) * [1.0, 2.0, 3.0]).tolist())
    np.testing.assert_allclose(triangles, expected)


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (
            {"elbo": 1.0},
            "ghost 'goal': no joint 'elbo'; did you mean 'elbow'? "
            "known: elbow, shoulder",
        ),
        (
            {"elbow": float("nan")},
            "ghost 'goal': joint 'elbow': expected a finite number [rad or m], got nan",
        ),
    ],
)
def test_positions_that_can_not_be_are_refused(
    tmp_path: Path, positions: dict[str, float], message: str
) -> None:
    robot, meshcat = make_scene(tmp_path, arm()), scene.start()

    with pytest.raises(InputError) as error:
        ghost_of(robot, meshcat).show(positions)

    assert str(error.value) == message
    assert not meshcat.HasPath(PATH)
