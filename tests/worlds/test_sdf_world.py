"""SDF worlds: what stands, what moves, what is found, what is reported."""

import struct
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import FrameIndex

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.worlds.world import load_world
from tests import carts, models
from tests.worlds.sdf import (
    BALL,
    TABLE,
    TABLE_HEIGHT,
    box,
    frame_pose,
    make_plant,
    model,
    shapes,
    write,
    write_model,
)

INCLUDED = model("inner", box("1 1 1"))


def simulate(folder: Path, world: Path, **options: object) -> ad.Simulation:
    robot = models.load(folder, models.FALLING_BALL)
    settings = ad.SimulationOptions(**options)  # type: ignore[arg-type]
    return ad.Simulation(ad.build_diagram(robot, world=world, options=settings))


def lines(path: Path) -> list[str]:
    return [
        f"{e.severity} {e.line} {e.where}: {e.what}; {e.done}"
        for e in load_world(path).report
    ]


@pytest.mark.slow
def test_a_robot_lands_on_a_table_that_stands(tmp_path: Path) -> None:
    simulation = simulate(tmp_path, write(tmp_path, TABLE))

    simulation.advance_to(2.0)

    # From 1 m to its radius of 0.1 m above the table, and 20 um into it.
    (fallen,) = simulation.joint_states().position
    assert fallen == pytest.approx(TABLE_HEIGHT + 0.1 - 1.0, abs=1e-3)


@pytest.mark.slow
def test_a_ball_rests_on_the_table_of_its_world(tmp_path: Path) -> None:
    simulation = simulate(tmp_path, write(tmp_path, TABLE + BALL))
    plant = simulation.diagram.GetSubsystemByName("plant")
    ball = plant.GetBodyByName("link")

    simulation.advance_to(1.0)

    context = plant.GetMyContextFromRoot(simulation.simulator.get_context())
    height = plant.EvalBodyPoseInWorld(context, ball).translation()[2]
    # Its facets of 1 cm lie up to 0.01^2 / (8 * 0.05) m below the sphere, and its
    # weight W presses it in by sqrt(W / (pi * 1e8 Pa)) = 0.06 mm.
    assert TABLE_HEIGHT + 0.05 - 3.1e-4 < height < TABLE_HEIGHT + 0.05
    assert (
        np.abs(plant.EvalBodySpatialVelocityInWorld(context, ball).rotational()).max()
        < 0.05
    )


def test_what_stands_adds_no_bodies(tmp_path: Path) -> None:
    plant, _ = make_plant(write(tmp_path, TABLE))

    assert plant.num_bodies() == 1


def test_what_is_part_of_something_that_stands_stands_too(tmp_path: Path) -> None:
    write_model(tmp_path, "loose", model("inner", box("1 1 1"), static=False))
    include = "<include><uri>model://loose</uri></include>"
    wrapped = '<model name="m"><static>true</static>' + include + "</model>"

    standing, _ = make_plant(write(tmp_path, wrapped))
    moving, _ = make_plant(write(tmp_path, include))

    assert (standing.num_bodies(), moving.num_bodies()) == (1, 2)


def test_only_a_world_with_something_that_moves_has_things_to_hold(
    tmp_path: Path,
) -> None:
    assert not load_world(write(tmp_path, TABLE)).has_things
    assert load_world(write(tmp_path, TABLE + BALL)).has_things


def test_joints_of_things_have_no_actuators(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """<model name="door"><link name="frame"/><link name="leaf"/>
        <joint name="f" type="fixed"><parent>world</parent><child>frame</child></joint>
        <joint name="hinge" type="revolute"><parent>frame</parent><child>leaf</child>
        <axis><xyz>0 0 1</xyz><limit><effort>5</effort></limit></axis></joint>
        </model>""",
    )

    plant, _ = make_plant(path)

    assert plant.GetJointByName("hinge").num_positions() == 1
    assert plant.num_actuators() == 0


def test_a_model_that_stands_may_have_joints(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """<model name="door"><static> true </static><link name="frame"/>
        <link name="leaf"><pose>1 0 0 0 0 0</pose></link>
        <joint name="hinge" type="revolute"><parent>frame</parent><child>leaf</child>
        <axis><xyz>0 0 1</xyz></axis></joint></model>""",
    )

    plant, _ = make_plant(path)

    pose = frame_pose(plant, "door", "leaf")
    np.testing.assert_allclose(pose.translation(), [1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [(None, (0.0, 0.0, -1.62)), (True, (0.0, 0.0, -9.81)), (False, (0.0, 0.0, 0.0))],
)
def test_gravity_of_the_file_counts_unless_the_options_say_otherwise(
    tmp_path: Path, inputs: bool | None, expected: tuple[float, ...]
) -> None:
    world = write(tmp_path, "<gravity>0 0 -1.62</gravity>")
    simulation = simulate(tmp_path, world, gravity=inputs)

    simulation.advance_to(0.5)

    plant = simulation.diagram.GetSubsystemByName("plant")
    assert tuple(plant.gravity_field().gravity_vector()) == expected
    # Drake's step: v[+] = v - g h, then q[+] = q + h v[+].
    fallen = expected[2] * 1e-6 * 500 * 501 / 2.0
    np.testing.assert_allclose(simulation.joint_states().position, [fallen], rtol=1e-9)


def test_the_servo_holds_a_robot_against_the_gravity_of_the_file(
    tmp_path: Path,
) -> None:
    robot = models.load(tmp_path, models.pendulum(), initial_positions={"swing": 1.0})
    sideways = write(tmp_path, "<gravity>3 0 0</gravity>")
    simulation = ad.Simulation(ad.build_diagram(robot, world=sideways))

    simulation.advance_to(0.5)

    state = simulation.joint_states()
    # The bob of 1 kg hangs along -z from an axis along y, at a distance of 0.5 m.
    assert state.position == pytest.approx((1.0,), abs=1e-6)
    assert abs(state.effort[0]) == pytest.approx(3.0 * 0.5 * np.cos(1.0), rel=1e-3)


def test_gravity_of_old_files_is_part_of_the_physics(tmp_path: Path) -> None:
    path = write(
        tmp_path, "<physics><gravity>0 0 -2</gravity></physics>", version="1.4"
    )

    assert load_world(path).gravity == (0.0, 0.0, -2.0)


def test_inclusions_are_found_and_placed(tmp_path: Path) -> None:
    write_model(tmp_path / "models", "cupboard", INCLUDED)
    path = write(
        tmp_path,
        """<include><uri>model://cupboard</uri><pose>1 2 3 0 0 0.5</pose></include>
        <include><uri>model://cupboard</uri><name>other</name></include>
        <model name="wrapped"><static> 1 </static>
          <include><uri>model://cupboard</uri></include><pose>4 5 6 0 0 0</pose>
        </model>""",
    )

    plant, scene_graph = make_plant(path)

    expected = RigidTransform(RollPitchYaw(0.0, 0.0, 0.5), np.array([1.0, 2.0, 3.0]))
    assert frame_pose(plant, "inner").IsNearlyEqualTo(expected, 1e-12)
    np.testing.assert_allclose(frame_pose(plant, "other").translation(), 0.0)
    wrapped = frame_pose(plant, "wrapped::inner").translation()
    np.testing.assert_allclose(wrapped, [4.0, 5.0, 6.0])
    at = shapes(scene_graph)["wrapped::inner::link::collision"]
    np.testing.assert_allclose(at, [4.0, 5.0, 6.0])
    assert lines(path) == []


@pytest.mark.slow
@pytest.mark.parametrize("variable", ["GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH"])
def test_models_are_found_where_gazebos_variables_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    write_model(tmp_path / "elsewhere", "cupboard", INCLUDED)
    (tmp_path / "here").mkdir()
    path = write(tmp_path / "here", "<include><uri>model://cupboard</uri></include>")
    assert len(lines(path)) == 1
    monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'elsewhere'}")

    plant, _ = make_plant(path)

    assert plant.HasModelInstanceNamed("inner")


def test_models_are_found_below_package_paths(tmp_path: Path) -> None:
    write_model(tmp_path / "a/b/c", "cupboard", INCLUDED)
    (tmp_path / "here").mkdir()
    path = write(tmp_path / "here", "<include><uri>model://cupboard</uri></include>")

    assert len(load_world(path, [tmp_path / "a"]).report) == 0


def test_the_newest_file_of_a_model_is_taken(tmp_path: Path) -> None:
    folder = write_model(tmp_path, "cupboard", INCLUDED).parent
    (folder / "new.sdf").write_text(f'<sdf version="1.10">{model("new", "")}</sdf>')
    (folder / "model.config").write_text(
        '<model><sdf version="1.10">new.sdf</sdf><sdf version="1.9">model.sdf</sdf>'
        "</model>"
    )

    plant, _ = make_plant(
        write(tmp_path, "<include><uri>model://cupboard</uri></include>")
    )

    assert plant.HasModelInstanceNamed("new")


@pytest.mark.slow
def test_models_that_are_not_there_are_one_line_and_the_rest_stands(
    tmp_path: Path,
) -> None:
    path = write(
        tmp_path,
        TABLE + "<include><uri>model://chair</uri></include>"
        '<model name="m"><include><uri>https://fuel.gazebosim.org/1.0/a/models/Lamp'
        "</uri></include></model><include><uri>model://chair</uri></include>",
    )

    plant, _ = make_plant(path)

    assert plant.HasModelInstanceNamed("table")
    (line,) = lines(path)
    assert line == (
        "error 7 : 2 models aren't there: 'Lamp', 'chair'; left out, nothing is "
        "downloaded; --package-path or GAZEBO_MODEL_PATH can name a folder that "
        "holds models"
    )


def test_sun_and_ground_plane_are_built_in(tmp_path: Path) -> None:
    fuel = "https://fuel.gazebosim.org/1.0/OpenRobotics/models"
    path = write(
        tmp_path,
        f"""<include><uri> {fuel}/Sun </uri></include>
        <include><uri>
        {fuel}/Ground Plane
        </uri></include>
        <include><uri>model://ground_plane</uri><name>roof</name>
        <pose>0 0 5 0 0 0</pose></include>""",
    )

    _, scene_graph = make_plant(path)

    found = shapes(scene_graph)
    # Only the plane z = 0 is the ground; both are boxes below their planes.
    np.testing.assert_allclose(found["ground_plane::link::ground"], [0.0, 0.0, -0.5])
    np.testing.assert_allclose(found["roof::link::collision"], [0.0, 0.0, 4.5])


PLANE = """
    <model name="lawn"><static>true</static><pose>1 0 0 0 0 0</pose><link name="link">
      <visual name="v"><pose>0 2 0 0 0 0</pose>
        <geometry><plane><size>6 4</size></plane></geometry>
        <material>{}</material></visual></link></model>"""
GREEN = "<diffuse>0.2 0.7 0.3 1</diffuse>"
TEXTURE = "<pbr><metal><albedo_map>{}</albedo_map></metal></pbr>"


def test_the_ground_looks_as_its_file_says(tmp_path: Path) -> None:
    (tmp_path / "tiles.png").write_bytes(b"")

    green = load_world(write(tmp_path, PLANE.format(GREEN))).ground
    tiled = load_world(write(tmp_path, PLANE.format(TEXTURE.format("tiles.png"))))

    assert green is not None
    assert (green.size, green.color, green.texture) == (
        (6, 4),
        (0.2, 0.7, 0.3, 1),
        None,
    )
    np.testing.assert_allclose(green.X_WG.translation(), [1.0, 2.0, 0.0])
    assert tiled.ground is not None
    assert tiled.ground.texture == tmp_path / "tiles.png"
    assert not list(tiled.report)
    # Higher up it is a thing like any other.
    above = PLANE.format(GREEN).replace("1 0 0 0 0 0", "1 0 1 0 0 0")
    assert load_world(write(tmp_path, above)).ground is None


def test_a_texture_that_cannot_be_drawn_is_reported(tmp_path: Path) -> None:
    (tmp_path / "tiles.tif").write_bytes(b"")
    found = [
        lines(write(tmp_path, PLANE.format(TEXTURE.format(name))))
        for name in ("tiles.tif", "none.png")
    ]

    place = "warning 5 model 'lawn', link 'link', visual 'v': texture "
    assert found == [
        [f"{place}'tiles.tif': no .png or .jpg or .jpeg; drawn without it"],
        [f"{place}'none.png': no such file; drawn without it"],
    ]


@pytest.mark.slow
def test_a_base_stands_on_the_ground_plane_of_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, "<include><uri>model://ground_plane</uri></include>")
    raised = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)
    reports = []
    for pose in (None, raised):
        robot = carts.load(tmp_path, carts.cart(carts.diff_drive()), pose=pose)
        simulation = ad.Simulation(ad.build_diagram(robot, world=path))
        reports.append(str(simulation.report))

    on_the_ground, above_it = reports

    assert "ground;" not in on_the_ground.replace("plane of the ground;", "")
    assert "above the ground; it falls" in above_it


def test_a_plane_is_a_box_behind_it(tmp_path: Path) -> None:
    wall = """<collision name="c"><pose degrees="true">1 0 0 0 0 90</pose><geometry>
      <plane><normal>1 0 0</normal><size>4 2</size></plane></geometry></collision>"""

    _, scene_graph = make_plant(write(tmp_path, model("wall", wall), version="1.9"))

    # Its normal is +y of the world.
    np.testing.assert_allclose(
        shapes(scene_graph)["wall::link::c"], [1.0, -0.5, 0.0], atol=1e-12
    )
    (geometry,) = scene_graph.model_inspector().GetAllGeometryIds()
    shape = scene_graph.model_inspector().GetShape(geometry)
    assert isinstance(shape, Box)
    np.testing.assert_allclose(shape.size(), [100.0, 100.0, 1.0])


def test_a_plane_that_collides_has_no_end(tmp_path: Path) -> None:
    ground = """<collision name="c"><geometry>
      <plane><size>1 1</size></plane></geometry></collision>"""

    _, scene_graph = make_plant(write(tmp_path, model("ground", ground)))

    (geometry,) = scene_graph.model_inspector().GetAllGeometryIds()
    shape = scene_graph.model_inspector().GetShape(geometry)
    assert isinstance(shape, Box)
    # As far as the built-in ground.
    np.testing.assert_allclose(shape.size(), [100.0, 100.0, 1.0])


@pytest.mark.slow
def test_meshes_are_converted(tmp_path: Path) -> None:
    folder = write_model(
        tmp_path,
        "block",
        model(
            "block",
            """<collision name="c"><geometry><mesh>
            <uri>model://block/meshes/B.STL</uri><scale>2 2 1</scale></mesh></geometry>
            </collision><visual name="v"><geometry><mesh><uri>meshes/B.STL</uri></mesh>
            </geometry><material><diffuse>1 0 0 1</diffuse></material></visual>""",
        ),
    ).parent
    (folder / "meshes").mkdir()
    # A pyramid, its tip 0.3 m high.
    corners = np.array([[1, 0, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, 0.3]])
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    content = struct.pack("<80xI", len(faces))
    for face in faces:
        content += struct.pack("<12f2x", 0, 0, 0, *corners[list(face)].ravel())
    (folder / "meshes/B.STL").write_bytes(content)
    path = write(tmp_path, "<include><uri>model://block</uri></include>")
    simulation = simulate(tmp_path, path)

    simulation.advance_to(1.5)

    assert lines(path) == []
    (fallen,) = simulation.joint_states().position
    # On the tip, which the hull has too.
    assert fallen == pytest.approx(0.3 + 0.1 - 1.0, abs=2e-3)


@pytest.mark.slow
def test_pieces_of_a_mesh_have_hulls_of_their_own(tmp_path: Path) -> None:
    # Two walls, 1 m high, beside the ball, which falls between them.
    corners = [(x, y, z) for x in (0, 0.1) for y in (-1, 1) for z in (0, 1)]
    lines_of_obj = [f"v {x + at} {y} {z}" for at in (-0.5, 0.4) for x, y, z in corners]
    for first in (1, 9):
        for face in ("132", "243", "567", "687", "125", "265", "347", "487"):
            numbers = " ".join(str(int(digit) + first - 1) for digit in face)
            lines_of_obj.append(f"f {numbers}")
    (tmp_path / "walls.obj").write_text("\n".join(lines_of_obj))
    shape = """<collision name="c"><geometry><mesh><uri>walls.obj</uri></mesh>
      </geometry></collision>"""
    floor = model("floor", box("4 4 0.2", pose="0 0 -0.1 0 0 0"))
    path = write(tmp_path, model("walls", shape) + floor)
    simulation = simulate(tmp_path, path)

    simulation.advance_to(1.0)

    _, scene_graph = make_plant(path)
    assert len(shapes(scene_graph)) == 3
    (fallen,) = simulation.joint_states().position
    assert fallen == pytest.approx(-0.9, abs=1e-3)


def test_rough_surfaces_are_as_rough_as_the_built_in_ground(tmp_path: Path) -> None:
    shape = box("1 1 1").replace(
        "</collision>",
        "<surface><friction><ode><mu>100</mu><mu2>50</mu2></ode></friction></surface>"
        "</collision>",
    )
    path = write(tmp_path, model("rough", shape))

    _, scene_graph = make_plant(path)

    inspector = scene_graph.model_inspector()
    (geometry,) = inspector.GetAllGeometryIds()
    properties = inspector.GetProximityProperties(geometry)
    friction = properties.GetProperty("material", "coulomb_friction")
    assert (friction.static_friction(), friction.dynamic_friction()) == (1.0, 1.0)
    (line,) = lines(path)
    assert line.endswith("collision 'collision': friction 100 and 50; 1 is used")


def test_colours_of_materials_are_drawn(tmp_path: Path) -> None:
    def visual(name: str, material: str) -> str:
        shape = box("1 1 1", tag="visual").replace('name="visual"', f'name="{name}"')
        return shape.replace("</visual>", f"<material>{material}</material></visual>")

    link = visual("a", "<diffuse>0.1 0.2 0.3 0.5</diffuse>") + visual(
        "b", "<script><name>Gazebo/Red</name></script>"
    )

    _, scene_graph = make_plant(write(tmp_path, model("m", link)))

    inspector = scene_graph.model_inspector()
    colors = {
        inspector.GetName(g)[-1]: inspector.GetIllustrationProperties(g).GetProperty(
            "phong", "diffuse"
        )
        for g in inspector.GetAllGeometryIds()
    }
    rgba = {name: (c.r(), c.g(), c.b(), c.a()) for name, c in colors.items()}
    assert rgba["a"] == pytest.approx((0.1, 0.2, 0.3, 0.5))
    assert rgba["b"] == pytest.approx((1.0, 0.0, 0.0, 1.0))


def test_saved_states_place_their_models(tmp_path: Path) -> None:
    state = """<state world_name="lab"><model name="table"><pose>7 0 0 0 0 0</pose>
      </model></state>"""

    plant, _ = make_plant(write(tmp_path, TABLE + state))

    np.testing.assert_allclose(
        frame_pose(plant, "table").translation(), [7.0, 0.0, 0.0]
    )


def test_a_model_may_be_placed_relative_to_another_one(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        '<frame name="corner"><pose>1 2 0 0 0 0</pose></frame>'
        + model("m", "", inside='<pose relative_to="corner">0 0 3 0 0 0</pose>'),
        version="1.9",
    )

    plant, _ = make_plant(path)

    np.testing.assert_allclose(frame_pose(plant, "m").translation(), [1.0, 2.0, 3.0])


def test_two_models_of_one_name_both_stand(tmp_path: Path) -> None:
    path = write(tmp_path, TABLE + TABLE)

    plant, _ = make_plant(path)

    assert plant.HasModelInstanceNamed("table_2")
    assert lines(path) == [
        "warning 8 : a second model is called 'table'; called 'table_2'"
    ]


def test_what_drake_refuses_is_left_out_and_the_rest_stands(tmp_path: Path) -> None:
    path = write(tmp_path, TABLE + model("bad", "<inertial><mass>-1</mass></inertial>"))

    plant, _ = make_plant(path)

    names = {plant.get_frame(FrameIndex(i)).name() for i in range(plant.num_frames())}
    assert names >= {"link"}
    assert plant.HasModelInstanceNamed("table")
    assert not plant.HasModelInstanceNamed("bad")
    (line,) = lines(path)
    # The reason is missing where a test before has let Drake log without Python.
    assert line.startswith("error 8 model 'bad': Drake refuses it: ")
    assert line.endswith("; left out")


def test_what_has_no_effect_is_reported_once(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """<plugin filename="gz-sim-physics-system" name="a"/>
        <plugin filename="libignition-gazebo-imu-system.so" name="a"/>
        <plugin filename="libmystery.so" name="b"/>
        <plugin filename="libmystery.so" name="b"/>
        <physics type="ode"><max_step_size>0.002</max_step_size></physics>
        <light name="lamp" type="point"/><light name="sun" type="directional"/>
        <gui><camera name="c"/></gui><scene><grid>false</grid><ambient>1 1 1</ambient>
        <background>0.5 0.6 0.7</background></scene>
        <actor name="walker"/><wind/>"""
        + model("m", '<sensor name="s" type="camera"/>'),
    )

    world = load_world(path)

    assert sorted(
        f"{e.severity} {e.where}: {e.what}; {e.done}" for e in world.report
    ) == [
        "info : <gui>; the page has its own camera",
        "info : <physics>, max_step_size 0.002 s; "
        "the step of the physics is the option time_step",
        "info : <scene>: ambient; the page has its own light",
        "info : <wind>; there is none",
        "info : lights 'lamp', 'sun'; cameras see by them; the page has its own",
        "info : plugin 'gz-sim-physics-system'; what it does is there without it",
        "info : plugin 'libignition-gazebo-imu-system.so'; what it does is there "
        "without it",
        "warning : actor 'walker'; it isn't shown",
        "warning : plugin 'libmystery.so'; it has no effect",
        "warning model 'm', link 'link': <sensor> 's'; it has no effect",
    ]
    assert not world.has_grid
    assert world.background == (0.5, 0.6, 0.7)


@pytest.mark.slow
def test_the_report_of_the_world_is_in_that_of_the_simulation(tmp_path: Path) -> None:
    path = write(tmp_path, "<include><uri>model://chair</uri></include>")

    simulation = simulate(tmp_path, path)

    (entry,) = simulation.report.errors
    assert entry.what == "no model 'chair'"
    assert (entry.file, entry.line) == (str(path), 3)


def test_without_physics_a_world_stands_too(tmp_path: Path) -> None:
    simulation = simulate(tmp_path, write(tmp_path, TABLE), preset="kinematic")

    simulation.advance_to(0.1)

    plant = simulation.diagram.GetSubsystemByName("plant")
    assert simulation.joint_states().position == (0.0,)
    assert plant is not None


def test_a_file_with_a_model_and_no_world_is_a_world_with_it(tmp_path: Path) -> None:
    path = tmp_path / "table.sdf"
    path.write_text(f'<sdf version="1.6">{TABLE}</sdf>')

    plant, _ = make_plant(path)

    assert plant.HasModelInstanceNamed("table")


def test_a_gravity_beyond_all_measure_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "<gravity>0 0 -1e20</gravity>")

    with pytest.raises(InputError) as caught:
        load_world(path)

    assert "<gravity>: expected at most 1e+06 m/s^2, got '0 0 -1e20'" in str(
        caught.value
    )
