"""Contents of a Meshcat server, from the messages it keeps for browsers."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from arm_drake.description.links import Pose
from arm_drake.description.urdf import RobotDescription
from arm_drake.options import SimulationOptions
from arm_drake.plant.plant import add_plant, add_robot_model
from tests import models

# Extension types of msgpack-lite, which Meshcat uses for arrays.
_ARRAYS = {0x16: "<u4", 0x17: "<f4"}


class Scene(NamedTuple):
    """A robot in a plant."""

    plant: MultibodyPlant
    scene_graph: SceneGraph
    model: ModelInstanceIndex
    description: RobotDescription

    # Owns the plant.
    diagram: Diagram


class Spy:
    """A Meshcat that notes the names of the calls it gets, with their paths."""

    def __init__(self) -> None:
        self.meshcat = start()
        self.calls: list[tuple[str, str]] = []

    def __getattr__(self, name: str) -> Any:
        def call(path: str, *args: Any) -> Any:
            self.calls.append((name, path))
            return getattr(self.meshcat, name)(path, *args)

        return call

    def take(self) -> list[tuple[str, str]]:
        """Return the calls since the last time."""
        calls, self.calls = self.calls, []
        return calls


def start() -> Meshcat:
    """Return a Meshcat on any free port."""
    return Meshcat(MeshcatParams(host="localhost", port=0))


def make_scene(folder: Path, urdf: str, **options: Any) -> Scene:
    """Return a scene with the robot of a URDF text; options are those of `place`."""
    return place(models.load(folder, urdf).description, **options)


def start_plant() -> tuple[DiagramBuilder, tuple[MultibodyPlant, SceneGraph]]:
    """Return a plant that isn't finalized, with its scene graph."""
    builder = DiagramBuilder()
    return builder, add_plant(builder, 1e-3, SimulationOptions())


def place(
    description: RobotDescription,
    *,
    pose: Pose | None = None,
    has_free_base: bool = False,
) -> Scene:
    """Return a scene with a robot that is loaded already; its model is "robot"."""
    builder, (plant, scene_graph) = start_plant()
    model = add_robot_model(
        plant, description, "robot", pose, has_free_base=has_free_base
    )
    plant.Finalize()
    return Scene(plant, scene_graph, model, description, builder.Build())


def context_at(robot: Scene, **positions: float) -> Context:
    """Return a context of the plant with joints at positions."""
    plant, context = robot.plant, robot.plant.CreateDefaultContext()
    q = plant.GetPositions(context).copy()
    for name, position in positions.items():
        q[plant.GetJointByName(name, robot.model).position_start()] = position
    plant.SetPositions(context, q)
    return context


def transform(meshcat: Meshcat, path: str) -> np.ndarray:
    """Return the transform that a path was given, shape (4, 4)."""
    message = unpack(meshcat._GetPackedTransform(path))
    return np.array(message["matrix"]).reshape(4, 4).T


def pose(meshcat: Meshcat, path: str) -> np.ndarray:
    """Return the transform from the root to a path, shape (4, 4)."""
    names = path.strip("/").split("/")
    result = np.eye(4)
    for count in range(1, len(names) + 1):
        prefix = "/" + "/".join(names[:count])
        if meshcat._GetPackedTransform(prefix):
            result = result @ transform(meshcat, prefix)
    return result


def geometry(meshcat: Meshcat, path: str) -> dict[str, Any]:
    """Return the geometry of the object at a path."""
    return _object(meshcat, path)["geometries"][0]


def vertices(meshcat: Meshcat, path: str) -> np.ndarray:
    """Return the vertices of a mesh or a line, shape (n, 3)."""
    attributes = geometry(meshcat, path)["data"]["attributes"]
    return attributes["position"]["array"].reshape(-1, 3)


def faces(meshcat: Meshcat, path: str) -> np.ndarray:
    """Return the faces of a mesh, shape (m, 3)."""
    return geometry(meshcat, path)["data"]["index"]["array"].reshape(-1, 3)


def colour(meshcat: Meshcat, path: str) -> tuple[tuple[int, ...], float]:
    """Return red, green and blue from 0 to 255, and the opacity."""
    material = _object(meshcat, path)["materials"][0]
    return tuple(material["color"].to_bytes(3)), material.get("opacity", 1.0)


def object_pose(meshcat: Meshcat, path: str) -> np.ndarray:
    """Return what places the points of a path's geometry in the world."""
    matrix = _object(meshcat, path)["object"]["matrix"]
    return pose(meshcat, path) @ np.array(matrix).reshape(4, 4).T


def cylinder_ends(meshcat: Meshcat, path: str) -> np.ndarray:
    """Return the centres of a cylinder's bottom and top in the world, shape (2, 3).

    three.js has them at -y and y.
    """
    half = geometry(meshcat, path)["height"] / 2.0
    ends = np.array([[0.0, -half, 0.0, 1.0], [0.0, half, 0.0, 1.0]])
    return (object_pose(meshcat, path) @ ends.T)[:3].T


def is_visible(meshcat: Meshcat, path: str) -> bool:
    """Return the property "visible" of a path."""
    return unpack(meshcat._GetPackedProperty(path, "visible"))["value"]


def about_y(angle: float, place: Sequence[float] = (0.0, 0.0, 0.0)) -> RigidTransform:
    """Return a pose that is turned about y."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    matrix[:3, 3] = place
    return RigidTransform(matrix)


def unpack(data: bytes) -> Any:
    """Return what a MessagePack text says, of the types that Meshcat uses."""
    value, end = _unpack(data, 0)
    assert end == len(data)
    return value


def _object(meshcat: Meshcat, path: str) -> dict[str, Any]:
    return unpack(meshcat._GetPackedObject(path))["object"]


def _unpack(data: bytes, at: int) -> tuple[Any, int]:
    code, at = data[at], at + 1
    if code < 0x80:
        return code, at
    if code < 0x90:
        return _unpack_map(data, at, code & 0x0F)
    if code < 0xA0:
        return _unpack_list(data, at, code & 0x0F)
    if code < 0xC0:
        return _unpack_text(data, at, code & 0x1F)
    if code in (0xC0, 0xC2, 0xC3):
        return {0xC0: None, 0xC2: False, 0xC3: True}[code], at
    if code in _NUMBERS:
        size = struct.calcsize(_NUMBERS[code])
        return struct.unpack_from(_NUMBERS[code], data, at)[0], at + size
    count, at = _count(data, at, code)
    if code in (0xD9, 0xDA, 0xDB):
        return _unpack_text(data, at, count)
    if code in (0xDC, 0xDD):
        return _unpack_list(data, at, count)
    if code in (0xDE, 0xDF):
        return _unpack_map(data, at, count)
    assert code in (0xC7, 0xC8, 0xC9)
    values = np.frombuffer(data, _ARRAYS[data[at]], offset=at + 1, count=count // 4)
    return values, at + 1 + count


# From 0xCA on.
_NUMBERS = dict(enumerate((">f", ">d", *(f">{c}" for c in "BHIQbhiq")), 0xCA))
_COUNTS = {
    **dict.fromkeys((0xC7, 0xD9), ">B"),
    **dict.fromkeys((0xC8, 0xDA, 0xDC, 0xDE), ">H"),
    **dict.fromkeys((0xC9, 0xDB, 0xDD, 0xDF), ">I"),
}


def _count(data: bytes, at: int, code: int) -> tuple[int, int]:
    kind = _COUNTS[code]
    return struct.unpack_from(kind, data, at)[0], at + struct.calcsize(kind)


def _unpack_text(data: bytes, at: int, count: int) -> tuple[str, int]:
    return data[at : at + count].decode(), at + count


def _unpack_list(data: bytes, at: int, count: int) -> tuple[list[Any], int]:
    values = []
    for _ in range(count):
        value, at = _unpack(data, at)
        values.append(value)
    return values, at


def _unpack_map(data: bytes, at: int, count: int) -> tuple[dict[Any, Any], int]:
    pairs, at = _unpack_list(data, at, 2 * count)
    return dict(zip(pairs[::2], pairs[1::2], strict=True)), at
