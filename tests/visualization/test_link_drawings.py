"""Drawings beside visual shapes: as large, and where, as mechanics has it."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    HalfSpace,
    Mesh,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.geometry import GeometryInstance as Geometry
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction
from pydrake.multibody.tree import SpatialInertia, UnitInertia

from arm_drake.errors import InputError
from arm_drake.plant.plant import add_robot_model
from arm_drake.visualization.link_drawings import (
    KINDS,
    DrawnRobot,
    LinkDrawings,
    collision_pieces,
    collision_solid,
    equivalent_ellipsoid,
    show_visual,
)
from tests import models
from tests.visualization import scene
from tests.visualization.scene import Scene, Spy, make_scene

# Meshcat keeps the vertices of meshes as 32-bit floats.
SINGLE = 1e-6

# A cube of 1 m, of which a corner of one face is pulled in to the cube's middle.
DENTED = """
v -0.5 -0.5 -0.5
v 0.5 -0.5 -0.5
v 0.5 0.5 -0.5
v -0.5 0.5 -0.5
v -0.5 -0.5 0.5
v 0.5 -0.5 0.5
v 0.5 0.5 0.5
v -0.5 0.5 0.5
v 0 0 0
f 1 4 3 2
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
f 5 6 9
f 6 7 9
f 7 8 9
f 8 5 9
"""

CORNERS = {(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)}


def draw(robot: Scene, meshcat: object, name: str = "robot") -> LinkDrawings:
    plant, scene_graph, model, description, _ = robot
    return LinkDrawings(meshcat, plant, scene_graph, {name: model}, {name: description})


def link_poses(robot: Scene, **positions: float) -> dict[str, RigidTransform]:
    context = scene.context_at(robot, **positions)
    bodies = [
        robot.plant.GetBodyByName(link, robot.model) for link in robot.description.links
    ]
    return {
        body.name(): robot.plant.EvalBodyPoseInWorld(context, body) for body in bodies
    }


def robot_of(links: str) -> str:
    return f'<robot name="robot">{links}</robot>'


def inertial(mass: float, tensor: np.ndarray, origin: str) -> str:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    values = tensor[np.triu_indices(3)]
    words = " ".join(
        f'{n}="{v!r}"' for n, v in zip(names, values.tolist(), strict=True)
    )
    return (
        f'<inertial><origin {origin}/><mass value="{mass}"/><inertia {words}/>'
        "</inertial>"
    )


def test_triads_are_where_the_links_are(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, models.TWO_LINKS), scene.start()
    drawings = draw(robot, meshcat)
    drawings.show("frames")

    drawings.update({"robot": link_poses(robot, shoulder=0.3, elbow=0.4)})

    # Both joints turn about y; the arms hang down.
    place = models.LENGTH * np.array([-np.sin(0.3), 0.0, -np.cos(0.3)])
    expected = scene.about_y(0.7, place)
    path = "/drake/frames/robot/lower"
    np.testing.assert_allclose(
        scene.transform(meshcat, path), expected.GetAsMatrix4(), atol=1e-12
    )
    colours = {"x": (242, 26, 26), "y": (26, 204, 26), "z": (38, 64, 255)}
    for index, (axis, colour) in enumerate(colours.items()):
        ends = scene.cylinder_ends(meshcat, f"{path}/{axis}")
        length = np.linalg.norm(ends[1] - ends[0])
        tip = place + length * expected.rotation().col(index)
        np.testing.assert_allclose(ends, [place, tip], atol=1e-12)
        # 255 times the colour, rounded.
        found, _ = scene.colour(meshcat, f"{path}/{axis}")
        np.testing.assert_allclose(found, colour, atol=1)


def test_triads_are_as_large_as_robot_and_gaps_let_them(tmp_path: Path) -> None:
    def length(size: float, gap: float) -> float:
        joints = models.joint("a", "base", "one", xyz=f"{size} 0 0")
        joints += models.joint("b", "one", "two", xyz=f"0 {gap} 0")
        links = '<link name="base"/><link name="one"/><link name="two"/>'
        robot, meshcat = make_scene(tmp_path, robot_of(links + joints)), scene.start()
        draw(robot, meshcat).show("frames")
        assert robot.diagram is not None
        return scene.geometry(meshcat, "/drake/frames/robot/two/x")["height"]

    # The size is the diagonal of the box around the links.
    assert length(3.0, 4.0) == pytest.approx(0.08 * 5.0)
    assert length(0.3, 0.4) == pytest.approx(0.08 * 0.5)
    assert length(3.0, 0.2) == pytest.approx(0.8 * 0.2)
    assert length(3.0, 0.05) == pytest.approx(0.03 * np.hypot(3.0, 0.05))


def test_the_size_is_that_of_the_box_around_links_and_shapes(tmp_path: Path) -> None:
    # Turned by 90 degrees about z, the box is 2 m along y; the ball is on another link.
    turned = '<origin xyz="0 1 0" rpy="0 0 1.5707963267948966"/>'
    box = f'<visual>{turned}<geometry><box size="2 1 1"/></geometry></visual>'
    links = (
        f'<link name="base">{box}</link><link name="tip">{models.sphere(0.5)}</link>'
    )
    joint = models.joint("lift", "base", "tip", xyz="0 0 3")
    robot = make_scene(tmp_path, robot_of(links + joint))

    size = DrawnRobot(*robot[:4]).size

    # From (-0.5, -0.5, -0.5) to (0.5, 2, 3.5).
    assert size == pytest.approx(np.linalg.norm([1.0, 2.5, 4.0]))


def test_meshes_collide_as_their_hulls_and_primitives_as_they_are(
    tmp_path: Path,
) -> None:
    (tmp_path / "dented.obj").write_text(DENTED, encoding="utf-8")
    urdf = robot_of("""
  <link name="base">
    <collision>
      <origin xyz="1 2 3"/><geometry><mesh filename="dented.obj"/></geometry>
    </collision>
    <collision>
      <origin xyz="0 0 4"/><geometry><box size="0.1 0.2 0.3"/></geometry>
    </collision>
  </link>""")
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()

    draw(robot, meshcat).show("collision")

    hull, box = (f"/drake/collision/robot/base/base {index}" for index in (0, 1))
    points = scene.vertices(meshcat, hull)
    triangles = points[scene.faces(meshcat, hull)]
    assert {tuple(p) for p in points.round(5).tolist()} == CORNERS
    # By the divergence theorem, of faces that look outwards: that of the cube.
    volume = np.linalg.det(triangles.astype(float)).sum() / 6.0
    assert volume == pytest.approx(1.0, abs=SINGLE)
    np.testing.assert_allclose(scene.pose(meshcat, hull)[:3, 3], [1.0, 2.0, 3.0])
    # three.js calls the sizes along x, y and z so.
    size = scene.geometry(meshcat, box)
    assert [size[k] for k in ("width", "height", "depth")] == [0.1, 0.2, 0.3]
    np.testing.assert_allclose(scene.pose(meshcat, box)[:3, 3], [0.0, 0.0, 4.0])
    for path in (hull, box):
        (red, green, blue), opacity = scene.colour(meshcat, path)
        assert red > green > blue
        assert 0.0 < opacity < 1.0


def test_a_mesh_that_touches_over_areas_is_drawn_with_its_dent(tmp_path: Path) -> None:
    file = tmp_path / "dented.obj"
    file.write_text(DENTED, encoding="utf-8")
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("source")
    shape = Geometry(RigidTransform(), Mesh(str(file)), "dented")
    geometry = scene_graph.RegisterAnchoredGeometry(source, shape)
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(properties)
    scene_graph.AssignRole(source, geometry, properties)

    solid = collision_solid(scene_graph.model_inspector(), geometry)

    corners = solid.vertices.T[solid.faces.T]
    volume = np.linalg.det(corners).sum() / 6.0
    # The dent is a pyramid of half the height.
    assert volume == pytest.approx(1.0 - 0.5 / 3.0)


def test_half_spaces_are_left_out(tmp_path: Path) -> None:
    description = models.load(tmp_path, robot_of(models.bob("base"))).description
    builder, (plant, scene_graph) = scene.start_plant()
    model = add_robot_model(plant, description, "robot", None)
    body = plant.GetBodyByName("base", model)
    friction = CoulombFriction(1.0, 1.0)
    plant.RegisterCollisionGeometry(
        body, RigidTransform(), HalfSpace(), "plane", friction
    )
    plant.Finalize()
    diagram = builder.Build()

    robot = DrawnRobot(plant, scene_graph, model, description)

    assert len(robot.shapes(body, Role.kProximity)) == 1
    assert list(collision_pieces(robot)) == []
    assert diagram is not None


def test_ellipsoids_have_the_inertia_of_the_links(tmp_path: Path) -> None:
    # A box of 2 kg, turned; its principal axes are not those of the link.
    mass, size = 2.0, np.array([0.3, 0.2, 0.1])
    squares = size**2
    tensor = mass / 12.0 * np.diag(squares.sum() - squares)
    c, s = np.cos(0.6), np.sin(0.6)
    about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    link = inertial(mass, tensor, 'xyz="0.1 0.2 0.3" rpy="0 0 0.6"')
    urdf = robot_of(f'<link name="base">{link}</link>')
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()

    draw(robot, meshcat).show("inertia")

    matrix = scene.object_pose(meshcat, "/drake/inertia/robot/base/base")
    np.testing.assert_allclose(matrix[:3, 3], [0.1, 0.2, 0.3], atol=1e-12)
    # The unit sphere becomes the ellipsoid, whose second moments are m/5 A A^T.
    moments = mass / 5.0 * matrix[:3, :3] @ matrix[:3, :3].T
    found = np.trace(moments) * np.eye(3) - moments
    np.testing.assert_allclose(found, about_z @ tensor @ about_z.T, atol=1e-12)
    # So the semi-axes are sqrt(5/12) of the box's sizes, the longest along its x.
    np.testing.assert_allclose(
        np.sort(np.linalg.norm(matrix[:3, :3], axis=0)),
        np.sqrt(5.0 / 12.0) * np.sort(size),
    )


def test_a_solid_ball_is_drawn_as_itself() -> None:
    inertia = SpatialInertia.SolidSphereWithMass(3.0, 0.25)

    semi_axes, X_BE = equivalent_ellipsoid(inertia.Shift([-0.1, 0.0, 0.0]))

    np.testing.assert_allclose(semi_axes, [0.25] * 3)
    np.testing.assert_allclose(X_BE.translation(), [0.1, 0.0, 0.0], atol=1e-15)


def test_a_point_of_mass_is_large_enough_to_be_seen(tmp_path: Path) -> None:
    point = inertial(1.0, np.zeros((3, 3)), 'xyz="0 0 2"')
    box = '<visual><geometry><box size="3 0.1 4"/></geometry></visual>'
    urdf = robot_of(f'<link name="base">{point}{box}</link>')
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()

    draw(robot, meshcat).show("inertia")

    matrix = scene.object_pose(meshcat, "/drake/inertia/robot/base/base")
    size = np.linalg.norm([3.0, 0.1, 4.0])
    np.testing.assert_allclose(matrix[:3, :3], 2e-3 * size * np.eye(3), atol=1e-12)


def test_links_without_mass_have_no_ellipsoid(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, models.TWO_LINKS), scene.start()

    draw(robot, meshcat).show("inertia")

    assert meshcat.HasPath("/drake/inertia/robot/upper")
    assert not meshcat.HasPath("/drake/inertia/robot/base")


def test_an_inertia_that_no_body_has_is_a_ball_of_water() -> None:
    # One moment is larger than the two others together.
    wrong = UnitInertia(1.0, 1.0, 1.0)
    wrong = SpatialInertia(
        mass=1000.0 * 4.0 / 3.0 * np.pi * 0.1**3,
        p_PScm_E=[0.0, 0.0, 5.0],
        G_SP_E=wrong,
        skip_validity_check=True,
    )
    assert not wrong.IsPhysicallyValid()

    semi_axes, X_BE = equivalent_ellipsoid(wrong)

    np.testing.assert_allclose(semi_axes, [0.1] * 3)
    np.testing.assert_allclose(X_BE.translation(), [0.0, 0.0, 5.0])


def test_an_inertia_without_numbers_is_not_drawn() -> None:
    nowhere = SpatialInertia(
        mass=1.0,
        p_PScm_E=[0.0, 0.0, np.nan],
        G_SP_E=UnitInertia(1.0, 1.0, 1.0),
        skip_validity_check=True,
    )

    assert equivalent_ellipsoid(SpatialInertia.NaN()) is None
    assert equivalent_ellipsoid(nowhere) is None


def test_joint_axes_point_along_the_axes_of_the_description(tmp_path: Path) -> None:
    names = ("base", "one", "two", "three", "four")
    links = "".join(models.bob(name) for name in names)
    joints = models.joint("turn", "base", "one", axis="2 -1 2", xyz="0.1 0.2 0.3")
    joints += models.joint("roll", "one", "two", axis="1 0 0", type="continuous")
    joints += models.joint("slide", "two", "three", axis="0 0 -1", type="prismatic")
    joints += models.joint("glue", "three", "four", type="fixed")
    robot, meshcat = make_scene(tmp_path, robot_of(links + joints)), scene.start()

    draw(robot, meshcat).show("joint_axes")

    path = "/drake/joint_axes/robot"
    axes = {"one": [2 / 3, -1 / 3, 2 / 3], "two": [1, 0, 0], "three": [0, 0, -1]}
    for link, axis in axes.items():
        start, end = scene.cylinder_ends(meshcat, f"{path}/{link}/shaft")
        base, tip = scene.cylinder_ends(meshcat, f"{path}/{link}/head")[::-1]
        np.testing.assert_allclose(start, [0.1, 0.2, 0.3], atol=1e-12)
        np.testing.assert_allclose(end, base, atol=1e-12)
        length = np.linalg.norm(tip - start)
        np.testing.assert_allclose((tip - start) / length, axis, atol=1e-12)
        assert length > np.linalg.norm(end - start) > 0.0
        # The cone ends in a point.
        assert scene.geometry(meshcat, f"{path}/{link}/head")["radiusBottom"] == 0.0
    colours = {link: scene.colour(meshcat, f"{path}/{link}/head")[0] for link in axes}
    assert colours["one"] == colours["two"] != colours["three"]
    assert not meshcat.HasPath(f"{path}/four")
    assert not meshcat.HasPath(f"{path}/base")


def test_what_is_inside_is_seen_and_what_coincides_is_in_front(tmp_path: Path) -> None:
    urdf = robot_of(models.bob("base", geometry=models.sphere(0.1)))
    robot, meshcat = make_scene(tmp_path, urdf), scene.start()
    drawings = draw(robot, meshcat)
    for kind in ("frames", "collision", "inertia"):
        drawings.show(kind)

    def look(path: str, name: str) -> object:
        at = f"/drake/{path}/<object>"
        data = meshcat._GetPackedProperty(at, f"material.{name}")
        return scene.unpack(data)["value"] if data else None

    assert look("frames/robot/base/x", "depthTest") is False
    for path in ("collision/robot/base/base 0", "inertia/robot/base/base"):
        # Negative is closer to the camera.
        assert look(path, "polygonOffset") is True
        assert look(path, "polygonOffsetUnits") < 0.0
        assert look(path, "depthTest") is None


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_degrees_of_freedom_have_no_arrow(
    tmp_path: Path, kind: str
) -> None:
    links = models.bob("base") + models.bob("loose")
    joint = models.joint("free", "base", "loose", type=kind, axis="0 0 1")
    robot, meshcat = make_scene(tmp_path, robot_of(links + joint)), scene.start()

    draw(robot, meshcat).show("joint_axes")

    assert not meshcat.HasPath("/drake/joint_axes/robot")


def test_a_kind_is_sent_once_and_only_moved_while_it_is_shown(tmp_path: Path) -> None:
    robot, spy = make_scene(tmp_path, models.TWO_LINKS), Spy()
    drawings = draw(robot, spy)

    drawings.update({"robot": link_poses(robot, shoulder=0.1)})
    drawings.show("frames", False)
    assert spy.take() == []

    drawings.show("frames")
    sent = spy.take()
    assert {path.split("/")[2] for _, path in sent} == {"frames"}
    assert sum(name == "SetObject" for name, _ in sent) == 9

    drawings.update({"robot": link_poses(robot, shoulder=0.1, elbow=0.2)})
    assert spy.take() == [("SetTransform", "/drake/frames/robot/lower")]

    drawings.show("frames", False)
    drawings.update({"robot": link_poses(robot, elbow=0.3)})
    assert spy.take() == [("SetProperty", "/drake/frames")]
    assert not scene.is_visible(spy.meshcat, "/drake/frames")

    drawings.show("frames")
    sent = spy.take()
    assert {name for name, _ in sent} == {"SetTransform", "SetProperty"}
    assert scene.is_visible(spy.meshcat, "/drake/frames")
    lower = scene.transform(spy.meshcat, "/drake/frames/robot/lower")
    expected = scene.about_y(0.3, [0.0, 0.0, -models.LENGTH])
    np.testing.assert_allclose(lower, expected.GetAsMatrix4(), atol=1e-12)


def test_a_pose_that_is_changed_in_place_is_sent(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, models.TWO_LINKS), scene.start()
    drawings = draw(robot, meshcat)
    drawings.show("frames")
    X_WL = RigidTransform([1.0, 0.0, 0.0])
    drawings.update({"robot": {"lower": X_WL}})

    X_WL.set_translation([2.0, 0.0, 0.0])
    drawings.update({"robot": {"lower": X_WL}})

    matrix = scene.transform(meshcat, "/drake/frames/robot/lower")
    np.testing.assert_allclose(matrix[:3, 3], [2.0, 0.0, 0.0])


def test_what_was_cleared_can_be_shown_again(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, models.TWO_LINKS), scene.start()
    drawings = draw(robot, meshcat)
    drawings.show("frames")
    drawings.show("inertia")

    drawings.clear()

    assert not meshcat.HasPath("/drake/frames")
    assert not meshcat.HasPath("/drake/inertia")
    drawings.show("frames")
    assert meshcat.HasPath("/drake/frames/robot/lower/x")


def test_each_robot_has_paths_of_its_own(tmp_path: Path) -> None:
    description = models.load(tmp_path, models.TWO_LINKS).description
    builder, (plant, scene_graph) = scene.start_plant()
    names = ("left/arm", "right")
    robots = {n: add_robot_model(plant, description, n, None) for n in names}
    plant.Finalize()
    diagram, meshcat = builder.Build(), scene.start()
    descriptions = dict.fromkeys(names, description)
    drawings = LinkDrawings(meshcat, plant, scene_graph, robots, descriptions)

    drawings.show("frames")

    paths = drawings.frame_paths()
    # A slash in a name doesn't make a path of two names.
    assert paths["/drake/frames/left|arm/lower"] == "lower"
    assert sorted(paths.values()) == sorted(2 * ["base", "upper", "lower"])
    assert all(meshcat.HasPath(path) for path in paths)
    assert diagram is not None


def test_a_link_called_world_has_its_frame_at_the_origin(tmp_path: Path) -> None:
    links = '<link name="world"/>' + models.bob("base")
    joint = models.joint("mount", "world", "base", type="fixed", xyz="1 0 0")
    robot, meshcat = make_scene(tmp_path, robot_of(links + joint)), scene.start()

    draw(robot, meshcat).show("frames")

    world = scene.transform(meshcat, "/drake/frames/robot/world")
    base = scene.transform(meshcat, "/drake/frames/robot/base")
    np.testing.assert_array_equal(world, np.eye(4))
    np.testing.assert_allclose(base[:3, 3], [1.0, 0.0, 0.0])


def test_bodies_that_the_description_lacks_move_with_their_carrier(
    tmp_path: Path,
) -> None:
    wheel = models.bob("base:wheel", "0 0 0", models.sphere(0.2))
    described = robot_of(models.bob("base") + models.bob("arm"))
    arm = models.joint("lift", "base", "arm")
    axle = models.joint("axle", "arm", "base:wheel", xyz="0 0.3 0", type="continuous")
    described = described.replace("</robot>", f"{arm}</robot>")
    rolling = described.replace("</robot>", f"{wheel}{axle}</robot>")
    description = models.load(tmp_path, described).description
    robot = scene.place(models.load(tmp_path, rolling).description)
    robot, meshcat = robot._replace(description=description), scene.start()
    drawings = draw(robot, meshcat)
    drawings.show("collision")

    drawings.update({"robot": {"arm": RigidTransform([1.0, 0.0, 0.0])}})

    path = "/drake/collision/robot/arm/base:wheel 0"
    np.testing.assert_allclose(scene.pose(meshcat, path)[:3, 3], [1.0, 0.3, 0.0])


def test_unknown_kinds_are_refused(tmp_path: Path) -> None:
    robot, meshcat = make_scene(tmp_path, models.TWO_LINKS), scene.start()

    with pytest.raises(InputError) as error:
        draw(robot, meshcat).show("frame")

    assert str(error.value) == (
        "no drawing 'frame'; did you mean 'frames'? "
        "known: collision, frames, inertia, joint_axes"
    )
    assert KINDS == ("frames", "collision", "inertia", "joint_axes")


def test_visual_shapes_are_hidden_and_shown() -> None:
    meshcat = scene.start()

    for is_shown in (False, True):
        show_visual(meshcat, is_shown)
        assert scene.is_visible(meshcat, "/drake/visual") is is_shown
