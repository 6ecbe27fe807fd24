"""Messages of cameras and lidars, in rollouts and in their files."""

import io
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import CameraInfo, Image, LaserScan, PointCloud2
from arm_drake.perception.images import to_array
from tests.perception.test_lidar import load, shape

RATE = 20.0


@pytest.fixture(scope="module")
def simulation() -> ad.Simulation:
    """Return 0.2 s of an arm that nods before a camera, and has a lidar."""
    sphere = shape('<sphere radius="0.5"/>')
    robot = load(sphere, more=f"<update_rate>{RATE:g}</update_rate><topic>scan</topic>")
    robot = ad.add_camera(
        robot, "eye", name="cam", width=64, height=48, update_rate=RATE, noise=0.02
    )
    robot = ad.add_camera(robot, "eye", name="other", width=64, height=48)
    options = ad.SimulationOptions(log_images=("cam", "front"))
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.21)
    return simulation


@pytest.mark.slow
def test_messages_come_at_the_update_rate(simulation: ad.Simulation) -> None:
    logged = simulation.rollout().sensor_messages

    topics = {"image", "depth_image", "points", "camera_info"}
    assert set(logged) == {"/scan", "/scan/points"} | {f"/cam/{t}" for t in topics}
    for messages in logged.values():
        times = [message.header.stamp.to_seconds() for message in messages]
        np.testing.assert_allclose(times, np.arange(5) / RATE, atol=1e-9)
    types = {type(messages[0]) for messages in logged.values()}
    assert types == {Image, CameraInfo, PointCloud2, LaserScan}


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1e9, 1e4])
def test_no_sensor_is_read_more_often_than_the_physics_steps(rate: float) -> None:
    robot = ad.add_camera(
        load(), "eye", name="cam", kind="color", width=32, height=24, update_rate=rate
    )
    options = ad.SimulationOptions(log_images=("cam",), time_step=0.002)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.009)

    messages = simulation.rollout().sensor_messages["/cam/image"]

    [line] = [e for e in simulation.report if "update_rate" in e.what]
    assert str(line).endswith(
        f"sensor 'cam': update_rate {rate:g} Hz, more often than anything moves; "
        "it is 500 Hz, once in each step"
    )
    times = [message.header.stamp.to_seconds() for message in messages]
    np.testing.assert_allclose(times, np.arange(5) * 0.002, atol=1e-9)


def test_without_physics_sensors_see_what_each_cycle_moves() -> None:
    robot = ad.add_camera(
        load(), "eye", name="cam", kind="color", width=32, height=24, update_rate=1e4
    )
    options = ad.SimulationOptions("kinematic", log_images=("cam",))
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    (manager,) = simulation.directory.managers.values()
    period = manager.period

    simulation.advance_to(2.5 * period)

    messages = simulation.rollout().sensor_messages["/cam/image"]
    times = [message.header.stamp.to_seconds() for message in messages]
    np.testing.assert_allclose(times, np.arange(3) * period, atol=1e-9)
    [line] = [e for e in simulation.report if "update_rate" in e.what]
    assert line.done == f"it is {1.0 / period:g} Hz, once in each step"


def test_a_rate_of_the_physics_is_taken_as_it_is() -> None:
    robot = ad.add_camera(load(), "eye", name="cam", update_rate=1.0 / 0.003)
    options = ad.SimulationOptions(time_step=0.003)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))

    assert not [e for e in simulation.report if "update_rate" in e.what]
    assert simulation.camera("cam").sensor.update_rate == 1.0 / 0.003


@pytest.mark.slow
def test_a_logged_picture_is_the_one_of_its_time(simulation: ad.Simulation) -> None:
    robot = next(iter(simulation.robots.values()))
    fresh = ad.Simulation(ad.build_diagram(robot))
    fresh.advance_to(0.05)

    picture = simulation.rollout().sensor_messages["/cam/image"][1]

    # Noise depends on the time alone.
    np.testing.assert_array_equal(to_array(picture), fresh.camera("cam").color())


@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_files_have_them(
    suffix: str, simulation: ad.Simulation, tmp_path: Path
) -> None:
    rollout = simulation.rollout()
    rollout.save(tmp_path / f"run{suffix}")
    read = ad.Rollout.load(tmp_path / f"run{suffix}").sensor_messages

    assert read.keys() == rollout.sensor_messages.keys()
    for topic in ("/cam/image", "/cam/depth_image", "/cam/points", "/scan/points"):
        assert read[topic] == rollout.sensor_messages[topic]
    scan, written = read["/scan"][2], rollout.sensor_messages["/scan"][2]
    np.testing.assert_allclose(scan.ranges, written.ranges, rtol=1e-6)
    info, wanted = read["/cam/camera_info"][0], rollout.sensor_messages
    np.testing.assert_allclose(info.k, wanted["/cam/camera_info"][0].k, rtol=1e-12)


def test_a_bag_has_the_types_that_others_read(
    simulation: ad.Simulation, tmp_path: Path
) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    simulation.rollout().save(tmp_path / "run.mcap")

    with highlevel.AnyReader([tmp_path / "run.mcap"]) as reader:
        types = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
        (connection,) = (c for c in reader.connections if c.topic == "/cam/image")
        _, _, data = next(reader.messages([connection]))
        picture = reader.deserialize(data, connection.msgtype)

    assert types["/cam/image"] == ("sensor_msgs/msg/Image", 5)
    assert types["/cam/camera_info"] == ("sensor_msgs/msg/CameraInfo", 5)
    assert types["/cam/points"] == ("sensor_msgs/msg/PointCloud2", 5)
    assert types["/scan"] == ("sensor_msgs/msg/LaserScan", 5)
    assert (picture.height, picture.width, picture.encoding) == (48, 64, "rgb8")
    first = simulation.rollout().sensor_messages["/cam/image"][0]
    assert picture.data.tobytes() == first.data


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "largest"), [("jpeg", 12), ("png", 0)])
def test_pictures_in_a_bag_are_files_where_asked(
    kind: str, largest: int, tmp_path: Path
) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    robot = ad.add_camera(load(), "eye", name="cam", width=64, height=48)
    options = ad.SimulationOptions(log_images=("cam",), log_image_format=kind)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.04)
    simulation.rollout().save(tmp_path / "run.mcap")

    with highlevel.AnyReader([tmp_path / "run.mcap"]) as reader:
        types = {c.topic: c.msgtype for c in reader.connections if "/cam" in c.topic}
        (connection,) = (c for c in reader.connections if "compressed" in c.topic)
        messages = [
            reader.deserialize(data, connection.msgtype)
            for _, _, data in reader.messages([connection])
        ]
    read = ad.Rollout.load(tmp_path / "run.mcap").sensor_messages

    assert types == {
        "/cam/image/compressed": "sensor_msgs/msg/CompressedImage",
        "/cam/depth_image": "sensor_msgs/msg/Image",
        "/cam/points": "sensor_msgs/msg/PointCloud2",
        "/cam/camera_info": "sensor_msgs/msg/CameraInfo",
    }
    assert len(messages) == 2
    assert messages[1].format == f"rgb8; {kind} compressed bgr8"
    file = PIL.Image.open(io.BytesIO(messages[1].data.tobytes()))
    assert file.format == kind.upper()
    differences = np.asarray(file).astype(int) - simulation.camera("cam").color()
    assert np.abs(differences).max() <= largest
    assert read == simulation.rollout().sensor_messages


def test_formats_that_are_none_are_reported() -> None:
    with pytest.raises(InputError) as error:
        ad.SimulationOptions(log_image_format="jpg")

    expected = "log_image_format 'jpg'; did you mean 'jpeg'? known: jpeg, png, raw"
    assert str(error.value) == expected


@pytest.mark.slow
def test_a_recorder_writes_each_once(tmp_path: Path) -> None:
    robot = load(more=f"<update_rate>{RATE:g}</update_rate><topic>scan</topic>")
    options = ad.SimulationOptions(log_images=("front",))
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.12)
    with simulation.record_to(tmp_path / "run.mcap", history=0.5):
        simulation.advance_to(3.01)
    read = ad.Rollout.load(tmp_path / "run.mcap").sensor_messages["/scan"]

    times = [message.header.stamp.to_seconds() for message in read]
    np.testing.assert_allclose(times, np.arange(3, 61) / RATE, atol=1e-9)
    # What is written doesn't stay for ever.
    assert len(simulation.rollout().sensor_messages["/scan"]) < len(times)
    simulation.reset()
    assert not any(simulation.rollout().sensor_messages.values())


def test_nobody_asks_nothing_is_kept(simulation: ad.Simulation) -> None:
    robot = next(iter(simulation.robots.values()))
    plain = ad.Simulation(ad.build_diagram(robot))
    plain.advance_to(0.1)

    assert plain.rollout().sensor_messages == {}
    with pytest.raises(InputError, match=r"no camera or lidar 'can'.*'cam'"):
        ad.build_diagram(robot, options=ad.SimulationOptions(log_images=("can",)))
    with pytest.raises(InputError, match="expected names of cameras and lidars"):
        ad.SimulationOptions(log_images="cam")
