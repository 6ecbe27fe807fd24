"""Drawings of topics: paths, scans, clouds, wrenches, contacts."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import (
    Header,
    LaserScan,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Vector3,
    Wrench,
    WrenchStamped,
)
from arm_drake.messages.sensors import ContactsState, ContactState
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.camera_pictures import CameraPictures
from arm_drake.visualization.page.displays import (
    Cloud,
    Contacts,
    Displays,
    OdometryPath,
    Scan,
    WrenchArrow,
)
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.parts import find_part
from tests import carts
from tests.perception.test_lidar import load_two
from tests.visualization.scene import is_visible, transform

OPTIONS = ad.SimulationOptions(frame_rate=0.0)
QUARTER = Quaternion(z=math.sqrt(0.5), w=math.sqrt(0.5))


@pytest.fixture(scope="module")
def cart() -> ad.Robot:
    robot = ad.load_robot(carts.cart(carts.diff_drive()), pose=(1, 2, 0, 0, 0, 0))
    # It looks straight down from 1 m, in front of the cart.
    down = (3.0, 0.0, 1.0, 0.0, math.pi / 2.0, 0.0)
    return ad.add_camera(robot, "world", down, name="eye", width=32, height=24)


@pytest.fixture
def live(cart: ad.Robot) -> Iterator[LiveSimulation]:
    with Page() as page:
        diagram = ad.build_diagram(cart, options=OPTIONS, meshcat=page.meshcat)
        yield LiveSimulation(page, Simulation(diagram), realtime_rate=0.0)


def displays_of(live: LiveSimulation) -> Displays:
    return find_part(live.parts, Displays)


@pytest.mark.slow
def test_topics_are_found_by_their_messages(live: LiveSimulation) -> None:
    kinds = {topic: kind.kind for topic, kind in displays_of(live).topics.items()}

    assert sorted(kinds.values()) == ["path", "points"]
    assert kinds["/eye/points"] == "points"


def test_a_path_goes_on_from_where_the_base_is(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    points: list[np.ndarray] = []
    display = OdometryPath(live, "/odom", "/drake/displays/odom")
    monkeypatch.setattr(
        display._trail, "append", lambda time, point, **_: points.append(point.copy())
    )
    start = live.simulation.link_poses()["base_link"].translation()

    # It takes itself to be turned by 90 degrees, and goes 2 m ahead.
    for y in (0.0, 2.0):
        pose = Pose(Point(5.0, y, 0.0), QUARTER)
        display.draw(Odometry(Header(), "base_link", PoseWithCovariance(pose)))

    assert points[0] == pytest.approx(start)
    # Ahead is along the base's x axis, which is the world's.
    assert points[1] - points[0] == pytest.approx([2.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.slow
def test_a_path_is_drawn_of_a_base_that_drives(live: LiveSimulation) -> None:
    [topic] = [t for t, k in displays_of(live).topics.items() if k is OdometryPath]
    live.handle([WidgetEvent(f"display:{topic}", True)])
    path = f"/drake/displays/{topic.strip('/').replace('/', '|')}"

    live.remotes[0].handle(f"remote:{live.remotes[0].controller}:forward", 0.4)
    for _ in range(10):
        live.run(0.1)

    assert live.page.meshcat.HasPath(path)
    live.handle([WidgetEvent(f"display:{topic}", False)])
    assert not live.page.meshcat.HasPath(path)


def test_dots_of_a_scan_are_where_its_rays_end(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    scan = Scan(live, "/scan", "/drake/displays/scan")
    monkeypatch.setattr(scan, "_show", lambda points, *rest: drawn.append(points))

    header = Header(frame_id="base_link")
    quarter = math.pi / 2.0
    ranges = (1.0, 2.0, math.inf)
    scan.draw(LaserScan(header, angle_increment=quarter, ranges=ranges))

    assert drawn[0] == pytest.approx(np.array([[1, 0, 0], [0, 2, 0]]), abs=1e-9)
    X = transform(live.page.meshcat, "/drake/displays/scan")
    base = live.simulation.link_poses()["base_link"].GetAsMatrix4()
    assert pytest.approx(base) == X


def test_sensors_are_shown_from_the_start_where_their_tags_say_so() -> None:
    camera = "<camera><image><width>32</width><height>24</height></image></camera>"
    sensors = "".join(
        f'<sensor name="{kind}_{seen}" type="{kind}"><visualize>{seen}</visualize>'
        f"<topic>{kind}_{seen}</topic>{inside}</sensor>"
        for kind, inside in (("camera", camera), ("gpu_lidar", "<lidar/>"))
        for seen in ("true", "false")
    )
    robot = ad.load_robot(
        '<robot name="r"><link name="world"/>'
        f'<gazebo reference="world">{sensors}</gazebo></robot>'
    )
    with Page() as page:
        diagram = ad.build_diagram(robot, options=OPTIONS, meshcat=page.meshcat)
        live = LiveSimulation(page, Simulation(diagram), realtime_rate=0.0)
        live.run(0.05)

        assert displays_of(live).shown == ("/gpu_lidar_true",)
        assert find_part(live.parts, CameraPictures).has_frusta
        assert page.meshcat.HasPath("/drake/camera_frusta/camera_true")
        assert not page.meshcat.HasPath("/drake/camera_frusta/camera_false")


@pytest.mark.slow
def test_each_lidar_of_a_topic_has_its_dots() -> None:
    with Page() as page:
        diagram = ad.build_diagram(load_two(), options=OPTIONS, meshcat=page.meshcat)
        live = LiveSimulation(page, Simulation(diagram), realtime_rate=0.0)
        paths = ["/drake/displays/scan", "/drake/displays/scan|2"]

        displays_of(live).show("/scan")
        yaws = [math.atan2(*transform(page.meshcat, path)[[1, 0], 0]) for path in paths]
        displays_of(live).show("/scan", False)

        assert yaws == pytest.approx([0.0, math.pi], abs=1e-6)
        assert not any(map(page.meshcat.HasPath, paths))


@pytest.mark.slow
def test_a_cloud_lies_on_what_the_camera_sees(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    cloud = Cloud(live, "/eye/points", "/drake/displays/eye")
    monkeypatch.setattr(
        cloud, "_show", lambda points, colors, size: drawn.append(points)
    )
    topic = live.simulation.topic("/eye/points")
    cloud.see(topic.sensors)

    cloud.draw(topic.value())

    X = transform(live.page.meshcat, "/drake/displays/eye")
    points = drawn[0] @ X[:3, :3].T + X[:3, 3]
    # The ground, around the point below the camera.
    assert points[:, 2] == pytest.approx(0.0, abs=2e-3)
    assert points.mean(axis=0) == pytest.approx([3.0, 0.0, 0.0], abs=0.03)


@pytest.mark.parametrize("kind", [WrenchArrow, Contacts])
def test_a_force_is_drawn_at_its_place_in_the_world(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch, kind: type
) -> None:
    drawn: list[tuple[np.ndarray, np.ndarray]] = []
    display = kind(live, "/force", "/drake/displays/force")
    monkeypatch.setattr(display._arrows, "draw", drawn.extend)
    X_WB = live.simulation.link_poses()["base_link"]
    header = Header(frame_id="base_link")
    wrench = Wrench(Vector3(0.0, 3.0, 0.0))

    if kind is WrenchArrow:
        display.draw(WrenchStamped(header, wrench))
        place = X_WB.translation()
    else:
        at = Vector3(0.1, 0.0, 0.2)
        state = ContactState(wrenches=(wrench,), contact_positions=(at,))
        display.draw(ContactsState(header, (state,)))
        place = X_WB @ np.array([0.1, 0.0, 0.2])

    [(point, force)] = drawn
    assert point == pytest.approx(place)
    along = X_WB.rotation() @ np.array([0.0, 3.0, 0.0])
    assert force == pytest.approx(along)


def test_forces_would_stand_still_in_a_recording_and_are_left_out(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    displays = displays_of(live)
    force = WrenchArrow(live, "/force", "/drake/displays/force")
    monkeypatch.setitem(displays._shown, "/force", force)
    message = WrenchStamped(Header(frame_id="base_link"), Wrench(Vector3(0.0, 3.0)))
    arrow = "/drake/contact_forces/force/0"

    force.draw(message)
    force.clear()
    force.draw(message)
    assert is_visible(live.page.meshcat, arrow)
    displays.end_recording()

    assert not is_visible(live.page.meshcat, arrow)


def test_a_topic_that_nothing_draws_is_said(live: LiveSimulation) -> None:
    with pytest.raises(InputError, match="nothing draws a topic '/eye/point'; did"):
        displays_of(live).show("/eye/point")


def test_a_frame_that_is_not_there_is_said(live: LiveSimulation) -> None:
    wrench = WrenchStamped(Header(frame_id="bas_link"), Wrench())

    with pytest.raises(InputError, match="no link 'bas_link'; did you mean 'base_link"):
        WrenchArrow(live, "/force", "/drake/displays/force").draw(wrench)
