"""Lidars, judged by closed forms of rays and by Drake's distances."""

import dataclasses as dc
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trimesh import creation

import arm_drake as ad
from arm_drake.description.gazebo_plugins import Noise
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.messages import LaserScan, Twist, Vector3
from arm_drake.perception import lidar as lidars
from arm_drake.perception.images import to_points
from arm_drake.worlds.things import Thing, with_things
from arm_drake.worlds.world import load_world
from tests.robots import load_real_robot

_AROUND = (
    "<samples>361</samples><min_angle>-3.141592653589793</min_angle>"
    "<max_angle>3.141592653589793</max_angle>"
)
_RINGS = (
    "<vertical><samples>3</samples><min_angle>-0.5</min_angle>"
    "<max_angle>0.5</max_angle></vertical>"
)


def load(
    shapes: str = "",
    kind: str = "gpu_lidar",
    scan: str = f"<horizontal>{_AROUND}</horizontal>",
    more: str = "",
    limits: str = "<min>0.05</min><max>20</max>",
    noise: str = "",
    turned: str = "0 0 0",
    end: str = "</gazebo></robot>",
) -> ad.Robot:
    return ad.load_robot(
        f"""<robot name="r"><link name="world"/><link name="base">
<inertial><mass value="1"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
{shapes}</link><link name="eye"/>
<joint name="a" type="fixed"><parent link="world"/><child link="base"/>
<origin xyz="0 0 1" rpy="{turned}"/></joint>
<joint name="b" type="fixed"><parent link="base"/><child link="eye"/></joint>
<gazebo reference="eye"><sensor name="front" type="{kind}">{more}
<lidar><scan>{scan}</scan><range>{limits}</range>{noise}</lidar>
</sensor>{end}"""
    )


def one(role: str, geometry: str, xyz: str = "2 0 0", rpy: str = "0 0 0") -> str:
    inside = f'<origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry>'
    return f"<{role}>{inside}</{role}>"


def shape(geometry: str, xyz: str = "2 0 0", rpy: str = "0 0 0") -> str:
    return "".join(one(role, geometry, xyz, rpy) for role in ("visual", "collision"))


def look(robot: ad.Robot) -> ad.LidarHandle:
    return ad.Simulation(ad.build_diagram(robot)).lidar("front")


def _to_circle(angles: np.ndarray, distance: float, radius: float) -> np.ndarray:
    """Return how far rays come that meet a circle ahead; +inf where they pass it."""
    inside = radius**2 - (distance * np.sin(angles)) ** 2
    meets = (inside >= 0.0) & (np.cos(angles) > 0.0)
    far = distance * np.cos(angles) - np.sqrt(np.maximum(inside, 0.0))
    return np.where(meets, far, np.inf)


@pytest.mark.parametrize(
    "geometry", ['<sphere radius="0.5"/>', '<cylinder radius="0.5" length="1"/>']
)
def test_round_things_are_where_rays_meet_a_circle(geometry: str) -> None:
    ranges = look(load(shape(geometry))).ranges()[0]

    expected = _to_circle(np.linspace(-math.pi, math.pi, 361), 2.0, 0.5)
    both = np.isfinite(ranges) & np.isfinite(expected)
    # A ray that only just meets or passes it may be either.
    assert np.sum(np.isfinite(ranges) != np.isfinite(expected)) <= 2
    assert np.sum(both) > 25
    inner = both & (np.abs(np.linspace(-math.pi, math.pi, 361)) < 0.2)
    np.testing.assert_allclose(ranges[inner], expected[inner], atol=1e-3)


def test_a_turned_box_is_a_plane_at_an_angle() -> None:
    turned = 0.3
    box = shape('<box size="0.2 4 1"/>', rpy=f"0 0 {turned}")
    ranges = look(load(box)).ranges()[0]

    angles = np.linspace(-math.pi, math.pi, 361)
    ahead = np.abs(angles) < 0.6
    # The face's normal is turned, and it is 0.1 m before the middle of the box.
    away = 2.0 * math.cos(turned) - 0.1
    expected = away / np.cos(angles - turned)
    np.testing.assert_allclose(ranges[ahead], expected[ahead], atol=1e-5)


@pytest.mark.slow
def test_a_link_that_is_turned_takes_its_lidar_and_shapes_along() -> None:
    ball = shape('<sphere radius="0.5"/>', xyz="2 0.3 0")
    limits = "<min>0.05</min><max>2.5</max>"
    level = look(load(ball, limits=limits))
    turned = look(load(ball, limits=limits, turned="0.1 -0.2 2.0"))

    assert np.isfinite(level.ranges()).sum() > 20
    # The ground is farther than the lidar tells.
    np.testing.assert_allclose(turned.ranges(), level.ranges(), atol=1e-4)
    centre = turned.pose @ [2.0, 0.3, 0.0]
    away = np.linalg.norm(turned.points() - centre, axis=1)
    np.testing.assert_allclose(away, 0.5, atol=1e-3)


@pytest.mark.parametrize("kind", ["gpu_lidar", "ray"])
def test_a_mesh_is_seen_where_its_triangles_are(kind: str, tmp_path: Path) -> None:
    # Longer in y than in z, and all of it above the frame's origin.
    wall = creation.box((0.2, 4.0, 1.0)).apply_translation((0.0, 0.0, 0.45))
    wall.export(tmp_path / "wall.stl")
    mesh = f'<mesh filename="file://{tmp_path}/wall.stl" scale="2 0.5 1"/>'
    scan = f"<horizontal>{_AROUND}</horizontal>{_RINGS}"
    plugin = '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so"/>'
    more = plugin if kind == "ray" else ""
    robot = load(shape(mesh), kind=kind, scan=scan, more=more)
    box = shape('<box size="0.4 2 1"/>', xyz="2 0 0.45")

    ranges = look(robot).ranges()

    expected = look(load(box, kind=kind, scan=scan, more=more)).ranges()
    assert np.isfinite(expected[1:, 170:190]).any()
    np.testing.assert_allclose(ranges, expected, atol=1e-5)


@pytest.mark.parametrize("kind", ["gpu_lidar", "ray"])
def test_meshes_that_were_written_here_need_no_library_to_be_read(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    creation.box((0.2, 4.0, 1.0)).export(tmp_path / "wall.stl")
    mesh = f'<mesh filename="file://{tmp_path}/wall.stl"/>'
    plugin = '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so"/>'
    lidar = look(load(shape(mesh), kind=kind, more=plugin if kind == "ray" else ""))
    monkeypatch.setattr(lidars, "read_surfaces", lambda *_: [])

    assert lidar.ranges()[0, 180] == pytest.approx(1.9, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radius", "most"), [(0.02, 1_100), (0.1, 6_000), (0.5, 30_000), (4.0, 51_000)]
)
def test_balls_have_triangles_as_their_size_needs(
    radius: float, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    make = lidars._make_tree

    def count(place: int, triangles: np.ndarray, culled: np.ndarray) -> Any:
        made.append(len(triangles))
        return make(place, triangles, culled)

    monkeypatch.setattr(lidars, "_make_tree", count)
    limits = "<min>0.05</min><max>4</max>"
    away = radius + 0.5
    ball = shape(f'<sphere radius="{radius}"/>', xyz=f"{away} 0 0")
    ranges = look(load(ball, limits=limits)).ranges()[0]

    angles = np.linspace(-math.pi, math.pi, 361)
    ahead = np.abs(np.sin(angles)) < 0.7 * radius / away
    expected = _to_circle(angles, away, radius)
    ahead &= np.isfinite(expected)
    assert ahead.any()
    # Where a ray is slanted it goes on by more than the faces are off.
    largest = 1e-4 if radius <= 1.0 else 1e-3
    np.testing.assert_allclose(ranges[ahead], expected[ahead], atol=3.0 * largest)
    assert max(made) <= most


def test_rings_that_look_down_see_the_ground() -> None:
    scan = f"<horizontal>{_AROUND}</horizontal>{_RINGS}"
    lidar = look(load(scan=scan))
    ranges = lidar.ranges()

    assert ranges.shape == (3, 361)
    np.testing.assert_allclose(ranges[0], 1.0 / math.sin(0.5), atol=1e-4)
    assert np.isposinf(ranges[1:]).all()
    points = lidar.points()
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-4)
    np.testing.assert_allclose(lidar.points("sensor")[:, 2], -1.0, atol=1e-4)
    with pytest.raises(InputError, match="expected 'world' or 'sensor'"):
        lidar.points("eye")


def test_a_ray_ends_where_drake_says_that_the_shape_is() -> None:
    capsule = '<capsule radius="0.3" length="0.6"/>'
    simulation = ad.Simulation(
        ad.build_diagram(load(shape(capsule, xyz="1.5 0.2 0.1", rpy="0.4 0.9 0.2")))
    )
    points = simulation.lidar("front").points()
    graph = simulation.diagram.GetSubsystemByName("scene_graph")
    context = graph.GetMyContextFromRoot(simulation.context)
    query = graph.get_query_output_port().Eval(context)

    assert len(points) > 10
    for point in points:
        nearest = query.ComputeSignedDistanceToPoint(point)
        assert min(abs(found.distance) for found in nearest) < 1e-3


def test_topics_are_those_of_gazebo() -> None:
    robot = load(shape('<sphere radius="0.5"/>'), more="<topic>scan</topic>")
    simulation = ad.Simulation(ad.build_diagram(robot))
    lidar = simulation.lidar("front")
    scan = simulation.topic("/scan").value()
    cloud = simulation.topic("/scan/points").value()

    assert lidar.topics == {"scan": "/scan", "points": "/scan/points"}
    assert scan.header.frame_id == "r/eye/front"
    assert (scan.range_min, scan.range_max) == (0.05, 20.0)
    assert scan.angle_increment == pytest.approx(2.0 * math.pi / 360)
    assert scan.ranges[180] == pytest.approx(1.5, abs=1e-4)
    assert (cloud.height, cloud.width) == (1, 361)
    np.testing.assert_allclose(to_points(cloud)[0, 180], [1.5, 0.0, 0.0], atol=1e-4)


_REAR = """<sensor name="rear" type="gpu_lidar"><pose>0 0 0 0 0 3.14159265</pose>
<topic>scan</topic><lidar><scan><horizontal><samples>3</samples></horizontal></scan>
<range><min>0.05</min><max>20</max></range></lidar></sensor></gazebo></robot>"""


def load_two(topic: str = "scan") -> ad.Robot:
    """Return a robot whose two lidars look to both sides, and publish on a topic."""
    shapes = shape('<sphere radius="0.5"/>') + shape('<sphere radius="1"/>', "-2 0 0")
    more = "<update_rate>10</update_rate>"
    return load(shapes, more=f"<topic>{topic}</topic>{more}", end=_REAR)


@pytest.mark.slow
def test_a_bridge_gives_a_scan_its_name_in_ros(tmp_path: Path) -> None:
    bridge = tmp_path / "bridge.yaml"
    bridge.write_text(
        "- {ros_topic_name: front/scan, gz_topic_name: /gz/scan,\n"
        "   ros_type_name: sensor_msgs/msg/LaserScan,\n"
        "   gz_type_name: gz.msgs.LaserScan, direction: GZ_TO_ROS}\n"
    )
    source = load(more="<topic>gz/scan</topic>").description.source
    robot = ad.load_robot(source, controllers=bridge)
    simulation = ad.Simulation(ad.build_diagram(robot))

    told = simulation.topic("/front/scan").value()

    assert isinstance(told, LaserScan)
    assert told == simulation.topic("/gz/scan").value()


@pytest.mark.slow
def test_all_that_share_a_topic_publish_on_it() -> None:
    options = ad.SimulationOptions(log_images=("front", "rear"))
    robot = load_two()
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.05)

    front, rear = simulation.topic("/scan").values()
    port = simulation.diagram.GetOutputPort("/scan:rear")
    logged = simulation.rollout().sensor_messages["/scan"]

    assert list(simulation.report) == []
    assert [m.header.frame_id for m in (front, rear)] == ["r/eye/front", "r/eye/rear"]
    assert front.ranges[180] == pytest.approx(1.5, abs=1e-4)
    assert rear.ranges[1] == pytest.approx(1.0, abs=1e-3)
    assert simulation.topic("/scan").value() == front
    assert port.Eval(simulation.simulator.get_context()) == rear
    # One at 10 Hz, the other at the usual 30 Hz, in the order of time.
    stamps = [m.header.stamp.to_nanoseconds() for m in logged]
    assert [m.header.frame_id[6:] for m in logged] == ["front", "rear", "rear"]
    assert stamps == sorted(stamps)


@pytest.mark.slow
def test_a_topic_has_messages_of_one_type() -> None:
    robot = ad.add_camera(load_two("/cam/image"), "eye", name="cam")
    simulation = ad.Simulation(ad.build_diagram(robot))

    told = simulation.topic("/cam/image").values()

    [line] = simulation.report
    assert str(line).endswith(
        "'front' and 'cam' publish messages of two types on the topic '/cam/image'; "
        "what 'front' publishes is there"
    )
    assert list(map(type, told)) == [LaserScan]
    assert simulation.diagram.HasOutputPort("/cam/image:cam")


def test_what_is_out_of_range_is_not_seen() -> None:
    far = load(shape('<sphere radius="0.5"/>'), limits="<min>0.1</min><max>1.4</max>")
    inside = load(
        shape('<sphere radius="0.5"/>', xyz="0 0 0"),
        limits="<min>0.6</min><max>9</max>",
    )

    assert np.isposinf(look(far).ranges()).all()
    # It begins outside of its own housing.
    assert np.isposinf(look(inside).ranges()).all()


@pytest.mark.parametrize("kind", ["gpu_lidar", "ray"])
def test_what_is_behind_something_too_near_is_seen(kind: str) -> None:
    plugin = '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so"/>'
    plate = shape('<box size="0.01 0.2 0.2"/>', xyz="0.2 0 0")
    robot = load(
        plate + shape('<sphere radius="0.5"/>'),
        kind=kind,
        more=plugin if kind == "ray" else "",
        limits="<min>0.3</min><max>9</max>",
    )

    ranges = look(robot).ranges()[0]

    assert ranges[180] == pytest.approx(1.5, abs=1e-4)
    # Beside the ball, 20 degrees to the left, there is the plate alone.
    assert np.isposinf(ranges[200])


def test_noise_is_the_same_with_the_same_seed() -> None:
    noise = "<noise><type>gaussian</type><mean>0.02</mean><stddev>0.01</stddev></noise>"
    box = shape('<box size="0.2 40 4"/>')
    exact = look(load(box)).ranges()
    noisy, again = (look(load(box, noise=noise)).ranges() for _ in range(2))

    np.testing.assert_array_equal(noisy, again)
    seen = np.isfinite(exact)
    off = noisy[seen] - exact[seen]
    count = len(off)
    assert off.mean() == pytest.approx(0.02, abs=4 * 0.01 / math.sqrt(count))
    assert off.std() == pytest.approx(0.01, abs=4 * 0.01 / math.sqrt(2 * count))


@pytest.mark.slow
def test_a_bias_is_the_same_all_the_time_and_a_precision_rounds() -> None:
    noise = "<noise type='gaussian'><bias_mean>{}</bias_mean><precision>{}</precision>"
    robot = load(
        shape('<sphere radius="0.5"/>'), noise=noise.format(0.2, 0.05) + "</noise>"
    )
    simulation = ad.Simulation(ad.build_diagram(robot))
    first = simulation.lidar("front").ranges()
    simulation.advance_to(0.1)
    later = simulation.lidar("front").ranges()

    seen = first[np.isfinite(first)]
    assert first[0, 180] in (pytest.approx(1.7), pytest.approx(1.3))
    np.testing.assert_array_equal(first, later)
    np.testing.assert_allclose(seen / 0.05, np.round(seen / 0.05), atol=1e-9)
    biased = {
        round(
            ad.Simulation(
                ad.build_diagram(robot, options=ad.SimulationOptions(seed=seed))
            )
            .lidar("front")
            .ranges()[0, 180],
            3,
        )
        for seed in range(8)
    }
    assert biased == {1.3, 1.7}


@pytest.mark.parametrize("world", ["empty", "void"])
def test_classics_ray_sees_what_collides(world: str) -> None:
    sphere = '<sphere radius="0.5"/>'
    shapes = one("visual", sphere, xyz="1 0 0") + one("collision", sphere)
    plugin = (
        '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so"><ros>'
        "<namespace>/arm</namespace><remapping>~/out:=scan</remapping></ros>"
        "<output_type>sensor_msgs/LaserScan</output_type>"
        "<frame_name>eye</frame_name></plugin>"
    )
    robot = load(shapes, kind="ray", more=plugin)
    simulation = ad.Simulation(ad.build_diagram(robot, world=world))
    lidar = simulation.lidar("front")

    assert lidar.topics == {"scan": "/arm/scan"}
    assert lidar.ranges()[0, 180] == pytest.approx(1.5, abs=1e-4)
    assert simulation.topic("/arm/scan").value().header.frame_id == "eye"


@pytest.mark.slow
def test_without_embree_small_scans_are_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    creation.torus(0.4, 0.15, 16, 8).export(tmp_path / "ring.stl")
    mesh = f'<mesh filename="file://{tmp_path}/ring.stl"/>'
    shapes = shape(mesh, xyz="1 0 0", rpy="0.3 1.2 0") + shape(mesh, xyz="0 0 0")
    scan = f"<horizontal>{_AROUND}</horizontal>{_RINGS}"
    plugin = '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so"/>'
    robot = load(shapes, kind="ray", scan=scan, more=plugin)

    expected = look(robot).ranges()
    monkeypatch.setattr(lidars.importlib.util, "find_spec", lambda name: None)
    ranges = look(robot).ranges()

    # A ray along an edge may be on either side of it.
    differ = ~np.isclose(ranges, expected, rtol=0.0, atol=1e-4)
    assert differ.sum() <= 2
    assert (expected < 0.9).sum() > 20

    monkeypatch.setattr(lidars, "_MOST_PAIRS", 10_000)
    with pytest.raises(ArmDrakeError, match=r"pip install 'arm-drake\[lidar\]'"):
        look(robot).ranges()


def test_wrong_names_are_reported() -> None:
    alone = ad.Simulation(ad.build_diagram(load()))
    both = ad.Simulation(ad.build_diagram(ad.add_camera(load(), "eye", name="cam")))
    lidar = "'front' is a lidar, no camera; "
    found = []

    for find, name in (
        (alone.lidar, "rear"),
        (alone.camera, "front"),
        (both.camera, "front"),
        (both.lidar, "cam"),
        (alone.camera, "rear"),
        (alone.camera, 3),
        (both.camera, None),
    ):
        with pytest.raises(InputError) as error:
            find(name)  # type: ignore[arg-type]
        found.append(str(error.value))

    none = "the robots have no camera; arm_drake.add_camera adds one"
    assert found == [
        "no lidar 'rear'; known: front",
        f"{lidar}{none}",
        f"{lidar}known: cam",
        "'cam' is a camera, no lidar; known: front",
        f"no camera 'rear'; {none}",
        "expected the name of a camera, got 3; the robots have none; "
        "arm_drake.add_camera adds one",
        "expected the name of a camera, got None; known: cam",
    ]


@pytest.mark.parametrize("kind", ["Range", "PointCloud", "PointCloud2"])
def test_classics_plugin_tells_what_its_tag_asks_for(kind: str) -> None:
    plugin = (
        '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so">'
        f"<output_type>sensor_msgs/{kind}</output_type>"
        "<radiation_type>ultrasound</radiation_type><frame_name>eye</frame_name>"
        "</plugin>"
    )
    sphere = shape('<sphere radius="0.5"/>')
    simulation = ad.Simulation(ad.build_diagram(load(sphere, "ray", more=plugin)))
    message = simulation.topic("/eyes/out").value()

    assert type(message).__name__ == kind
    assert message.header.frame_id == "eye"
    if kind == "Range":
        assert message.range == pytest.approx(1.5, abs=1e-4)
        assert (message.min_range, message.max_range) == (0.05, 20.0)
        assert message.field_of_view == pytest.approx(2.0 * math.pi)
        assert message.radiation_type == 0
    elif kind == "PointCloud":
        seen = np.array([[p.x, p.y, p.z] for p in message.points])
        away = np.linalg.norm(seen - [2.0, 0.0, 0.0], axis=1)
        assert len(seen) > 25
        np.testing.assert_allclose(away, 0.5, atol=1e-3)
        assert len(message.channels[0].values) == len(seen)
    else:
        assert [f.name for f in message.fields] == ["x", "y", "z", "intensity"]


def test_a_point_of_a_cloud_tells_its_ring() -> None:
    scan = f"<horizontal>{_AROUND}</horizontal>{_RINGS}"
    robot = load(scan=scan, more="<topic>scan</topic>")
    cloud = ad.Simulation(ad.build_diagram(robot)).topic("/scan/points").value()

    kinds = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4"}
    layout = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [kinds[field.datatype] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    points = np.frombuffer(cloud.data, layout).reshape(cloud.height, cloud.width)
    assert layout.names == ("x", "y", "z", "intensity", "ring")
    assert (points["ring"] == np.arange(3)[:, None]).all()
    np.testing.assert_allclose(points["z"][0], -1.0, atol=1e-4)
    assert (points["intensity"] == 0.0).all()


def test_what_a_lidar_does_not_do_is_in_the_load_report() -> None:
    plugin = (
        '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so">'
        "<output_type>sensor_msgs/Scan</output_type></plugin>"
    )
    limits = "<min>0.1</min><max>9</max><resolution>0.01</resolution>"
    report = str(load(kind="ray", more=plugin, limits=limits).report)

    assert "distances in steps of 0.01 m" in report
    assert "output_type: expected one of sensor_msgs/PointCloud2, " in report


def test_classics_ray_looks_out_of_a_mesh_that_it_is_in(tmp_path: Path) -> None:
    creation.icosphere(radius=0.3).export(tmp_path / "base.stl")
    housing = f'<mesh filename="file://{tmp_path}/base.stl"/>'
    shapes = one("collision", housing, xyz="0 0 0") + shape('<sphere radius="0.5"/>')
    plugin = '<plugin name="eyes" filename="libgazebo_ros_ray_sensor.so"/>'

    inside = look(load(shapes, kind="ray", more=plugin)).ranges()[0]

    expected = _to_circle(np.linspace(-math.pi, math.pi, 361), 2.0, 0.5)
    assert np.isposinf(inside[:140]).all()
    np.testing.assert_allclose(inside[170:191], expected[170:191], atol=1e-3)


@pytest.mark.slow
def test_a_public_base_that_drives_sees_the_walls_where_they_are() -> None:
    robot = load_real_robot("pmb2")
    # Its laser has a noise of some centimetres.
    [laser] = [s for s in robot.description.perception_sensors if "laser" in s.name]
    exact = dc.replace(laser, noise=Noise())
    description = dc.replace(robot.description, perception_sensors=(exact,))
    places = [(3.1, 0.0), (-3.1, 0.0), (0.0, 2.1), (0.0, -2.1)]
    walls = [
        Thing(
            f"wall_{index}",
            "box",
            (0.2, 4.0, 1.0) if x else (6.0, 0.2, 1.0),
            fixed=True,
            pose=(x, y, 0.5, 0.0, 0.0, 0.0),
        )
        for index, (x, y) in enumerate(places)
    ]
    simulation = ad.Simulation(
        ad.build_diagram(
            dc.replace(robot, description=description),
            world=with_things(load_world("empty"), walls),
        )
    )
    lidar = simulation.lidar(laser.name)
    start = lidar.pose
    for _ in range(10):
        twist = Twist(Vector3(x=0.4), Vector3(z=0.8))
        simulation.controller("mobile_base_controller").send_velocity(twist)
        simulation.run(0.1)

    points = lidar.points()

    moved = start.inverse() @ lidar.pose
    assert np.linalg.norm(moved.translation()) > 0.1
    assert moved.rotation().ToAngleAxis().angle() > 0.1
    off = np.abs(np.abs(points[:, :2]) - [3.0, 2.0]).min(axis=1)
    assert len(points) > 600
    np.testing.assert_allclose(off, 0.0, atol=1e-3)
