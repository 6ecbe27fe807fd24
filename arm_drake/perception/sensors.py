"""The sensors of robots as systems of a diagram: a row for each kind of sensor."""

import dataclasses as dc
import importlib
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple, get_args

from pydrake.geometry import SceneGraph
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from arm_drake.description.perception_sensors import (
    CameraKind,
    CameraSensor,
    LidarSensor,
    Noise,
    PerceptionSensor,
    find_camera_problem,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Pose, Robot
from arm_drake.errors import InputError, suggest
from arm_drake.manager.connections import with_prefix
from arm_drake.perception.scenery import Scenery


class Place(NamedTuple):
    """Where a sensor is, and what it is called by others."""

    # Names of the robot's model in Gazebo, of that in the plant, and of the world.
    robot: str
    model: str
    world: str

    # Seed of its noise.
    seed: int = 0


class SensorParams(NamedTuple):
    """What topics want to know of who publishes them."""

    controller_name: str

    # [Hz].
    update_rate: float


# What makes the system of a sensor, "module:class". It is called with the sensor, its
# Place and the Scenery, has an input port "geometry_query", an output port for each of
# its `topics`, the classes of their messages in `output_types`, and `params`.
SENSORS: Final[Mapping[type[PerceptionSensor], str]] = {
    CameraSensor: "arm_drake.perception.cameras:Camera",
    LidarSensor: "arm_drake.perception.lidar:Lidar",
}


def add_sensors(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    robot: Robot,
    place: Place,
    scenery: Scenery,
    prefix: str,
    report: LoadReport,
) -> tuple[LeafSystem, ...]:
    """Add the cameras and lidars of a robot, and export their topics.

    A topic has one publisher. They compute nothing that nobody reads.
    """
    systems: list[LeafSystem] = []
    publishers: dict[str, str] = {}
    query = scene_graph.GetOutputPort("query")
    for sensor in robot.description.perception_sensors:
        if type(sensor) not in SENSORS:
            continue
        module, _, name = SENSORS[type(sensor)].partition(":")
        make: Any = getattr(importlib.import_module(module), name)
        system = make(sensor, place, scenery)
        builder.AddNamedSystem(f"{prefix}sensor:{sensor.name}", system)
        builder.Connect(query, system.GetInputPort("geometry_query"))
        for topic in system.output_types:
            exported = with_prefix(prefix, topic)
            first = publishers.setdefault(topic, sensor.name)
            if first == sensor.name:
                builder.ExportOutput(system.GetOutputPort(topic), exported)
                continue
            what = f"{first!r} and {sensor.name!r} publish on the topic {topic!r}"
            done = f"what {first!r} publishes is there"
            report.add("warning", "unsupported", what, done, where="sensors")
        systems.append(system)
    return tuple(systems)


def add_camera(
    robot: Robot,
    link: str,
    pose: Sequence[float] = (0.0,) * 6,
    *,
    name: str = "camera",
    kind: CameraKind = "rgbd",
    width: int = 640,
    height: int = 480,
    horizontal_fov: float = math.radians(69.0),
    near: float = 0.05,
    far: float = 20.0,
    update_rate: float = 30.0,
    noise: float = 0.0,
) -> Robot:
    """Return a robot with one more camera.

    Its topics are `/<name>/image`, `/<name>/depth_image`, `/<name>/points` and
    `/<name>/camera_info`, as far as it has them.

    Args:
        robot: The robot, which stays as it is.
        link: Link that carries the camera; "world" is one that stands still.
        pose: Where it is in the link, x ahead, y left and z up: x, y, z [m], roll,
            pitch, yaw [rad].
        name: Name of the camera, which no other of the robot has.
        kind: "color", "depth", "rgbd" or "segmentation".
        width: Width of its pictures [pixels].
        height: Height of its pictures [pixels].
        horizontal_fov: Angle between their left and right edges [rad].
        near: What is nearer isn't seen [m].
        far: What is farther isn't seen [m].
        update_rate: Pictures per second [Hz].
        noise: Standard deviation of its colours, which go from 0 to 1; of a depth
            camera that of its depths [m].

    Raises:
        InputError: If there is no such link, the name is taken, or a number is wrong.
    """
    X_LS = _check_camera(robot, link, pose, name, kind)
    end = {"color": "/image", "depth": "/depth_image"}.get(kind, "")
    camera = CameraSensor(
        name=name,
        link=link,
        pose=X_LS,
        update_rate=update_rate,
        topic=f"{name}{end}",
        noise=Noise(stddev=noise),
        kind=kind,
        horizontal_fov=horizontal_fov,
        width=width,
        height=height,
        near=near,
        far=far,
        min_depth=near,
        max_depth=far,
    )
    _check_numbers(camera)
    return _with_sensor(robot, camera)


def _with_sensor(robot: Robot, sensor: PerceptionSensor) -> Robot:
    sensors = (*robot.description.perception_sensors, sensor)
    description = dc.replace(robot.description, perception_sensors=sensors)
    return dc.replace(robot, description=description)


def _check_numbers(camera: CameraSensor) -> None:
    """Raise InputError if a number of a camera is wrong."""
    size = (camera.width, camera.height)
    problem = find_camera_problem(camera.horizontal_fov, size, camera.near, camera.far)
    if not 0.0 < camera.update_rate < math.inf:
        problem = f"update_rate: expected more than 0 Hz, got {camera.update_rate:g}"
    if not 0.0 <= camera.noise.stddev < math.inf:
        problem = f"noise: expected at least 0, got {camera.noise.stddev:g}"
    if problem:
        raise InputError(problem, where=f"camera {camera.name!r}")


def _check_camera(
    robot: Robot, link: str, pose: Sequence[float], name: str, kind: str
) -> Pose:
    """Return a camera's pose, or raise InputError."""
    where = f"camera {name!r}"
    description = robot.description
    known = [*description.links, "world"]
    if link not in known:
        raise InputError(f"no link {link!r}; {suggest(link, known)}", where=where)
    if not name or name in [s.name for s in description.perception_sensors]:
        problem = "a sensor is called so already" if name else "expected a name"
        raise InputError(problem, where=where)
    if kind not in (kinds := get_args(CameraKind)):
        raise InputError(f"kind {kind!r}; {suggest(str(kind), kinds)}", where=where)
    numbers = [float(number) for number in pose]
    if len(numbers) != 6 or not all(map(math.isfinite, numbers)):
        problem = f"pose: expected x, y, z [m], roll, pitch, yaw [rad], got {pose}"
        raise InputError(problem, where=where)
    x, y, z, roll, pitch, yaw = numbers
    return (x, y, z, roll, pitch, yaw)
