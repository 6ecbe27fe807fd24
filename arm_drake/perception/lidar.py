"""Lidars: systems that cast rays when somebody reads them.

The rays are Embree's. All shapes of a frame are one tree of triangles, and the rays are
brought into the frames: moving robots and things need no new trees. As Gazebo's, lidars
see what is drawn, and Classic's `ray` what collides. A ray begins at the least distance
that the lidar can tell, so that the housing around it isn't seen.

Sources: SDFormat, sdf/1.11/ray.sdf; gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/
gazebo_ros_ray_sensor.cpp; ros_gz_bridge, src/convert/sensor_msgs.cpp; REP 117.
"""

import importlib.util
import itertools
import zlib
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    QueryObject,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, OutputPort

from arm_drake.arrays import Array
from arm_drake.controllers.gazebo.plugin import as_topic, ros_topic
from arm_drake.description.meshes.reading import read_bytes, read_surfaces
from arm_drake.description.perception_sensors import LidarSensor, ScanAxis
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.messages import Header, LaserScan, Message, PointCloud2
from arm_drake.perception.images import make_cloud
from arm_drake.perception.scenery import Scenery
from arm_drake.perception.sensors import Place, SensorParams
from arm_drake.plant.plant import transform_of
from arm_drake.python_system import PythonSystem

if TYPE_CHECKING:
    import trimesh

# Sides of what stands for a circle: of a radius of 1 m it is 0.1 mm off at most.
_SIDES: Final = 224

# A sphere of 20,480 triangles; they are 0.2 mm off at most, of a radius of 1 m.
_SUBDIVISIONS: Final = 5

# Half of the side of the square that stands for a plane without an end [m].
_HORIZON: Final = 1000.0

# Farther is no hit [m]; Embree says 1e37.
_NO_HIT: Final = 1e30


def topics_of(lidar: LidarSensor, robot: str, world: str) -> dict[str, str]:
    """Return the topics of a lidar by what is on them: "scan" and "points"."""
    plugin = lidar.plugin
    if plugin is not None:
        namespace = next(iter(plugin.texts("ros/namespace")), "")
        # A rule's ~ is the plugin's node.
        node = f"{namespace}/{plugin.name}"
        rules = [text.replace("~", node, 1) for text in plugin.texts("ros/remapping")]
        rules = [rule.replace(":=~", f":={node}", 1) for rule in rules]
        is_scan = lidar.output_type.endswith("LaserScan")
        topic = ros_topic(f"{plugin.name}/out", namespace, rules)
        return {"scan" if is_scan else "points": topic}
    place = f"world/{world}/model/{robot}/link/{lidar.link}/sensor/{lidar.name}/scan"
    topic = as_topic(lidar.topic or place)
    return {"scan": topic, "points": f"{topic}/points"}


def directions_of(lidar: LidarSensor) -> Array:
    """Return the unit vectors of the rays, x ahead, shape (vertical, horizontal, 3)."""
    across, up = _angles(lidar.horizontal), _angles(lidar.vertical)[:, None]
    x, y = np.cos(up) * np.cos(across), np.cos(up) * np.sin(across)
    return np.stack([x, y, np.broadcast_to(np.sin(up), x.shape)], axis=-1)


def _angles(axis: ScanAxis) -> Array:
    return np.linspace(axis.min_angle, axis.max_angle, axis.count)


class _Tree(NamedTuple):
    """The shapes of a frame."""

    # Place of the frame among all of the diagram.
    place: int

    scene: Any

    # A sphere that holds all of them, in the frame [m].
    center: Array
    radius: float


class RayScene:
    """The shapes of a diagram, for rays."""

    def __init__(self, inspector: SceneGraphInspector, role: Role) -> None:
        """Make the trees.

        Raises:
            ArmDrakeError: If Embree is missing.
        """
        if importlib.util.find_spec("embreex") is None:
            raise ArmDrakeError(
                "lidars need Embree, and the package embreex isn't there; it comes "
                "with the extra: pip install 'arm-drake[lidar]'"
            )
        self._trees: list[_Tree] = []
        for place, frame in enumerate(inspector.GetAllFrameIds()):
            ids = inspector.GetGeometries(frame, role)
            found = [_triangles(inspector, geometry) for geometry in ids]
            triangles = np.concatenate([np.zeros((0, 3, 3)), *found])
            if len(triangles):
                self._trees.append(_make_tree(place, triangles))

    def cast(
        self, query: QueryObject, origins: Array, directions: Array, longest: float
    ) -> Array:
        """Return how far rays come [m], shape (n,); +inf where they meet nothing.

        Args:
            query: Tells where the frames are.
            origins: Where the rays begin in the world [m], shape (n, 3).
            directions: Their unit vectors in the world, shape (n, 3).
            longest: How far they go at most [m].
        """
        frames = query.inspector().GetAllFrameIds()
        nearest = np.full(len(origins), np.inf)
        for tree in self._trees:
            X_FW = query.GetPoseInWorld(frames[tree.place]).inverse()
            R = X_FW.rotation().matrix().T
            starts = origins @ R + X_FW.translation()
            way = directions @ R
            to_center = tree.center - starts
            along = np.einsum("ij,ij->i", to_center, way)
            beside = np.einsum("ij,ij->i", to_center, to_center) - along**2
            meets = beside <= tree.radius**2
            meets &= (along >= -tree.radius) & (along <= longest + tree.radius)
            if not meets.any():
                continue
            # Embree reckons in single precision: from near the shapes it is exact.
            ahead = np.maximum(along[meets] - 1.01 * tree.radius, 0.0)
            ways = way[meets]
            begin = starts[meets] + ahead[:, None] * ways
            hits = tree.scene.run(
                begin.astype(np.float32), ways.astype(np.float32), query="DISTANCE"
            )
            distances = np.where(hits < _NO_HIT, hits + ahead, np.inf)
            nearest[meets] = np.minimum(nearest[meets], distances)
        nearest[nearest > longest] = np.inf
        return nearest


def _make_tree(place: int, triangles: Array) -> _Tree:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, triangles.astype(np.float32))
    corners = triangles.reshape(-1, 3)
    center = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(corners - center, axis=1).max())
    return _Tree(place, scene, center, radius)


def _triangles(inspector: SceneGraphInspector, geometry: GeometryId) -> Array:
    """Return the triangles of a shape in its frame [m], shape (n, 3, 3)."""
    shape = inspector.GetShape(geometry)
    X_FG = RigidTransform(inspector.GetPoseInFrame(geometry))
    if isinstance(shape, Mesh | Convex) and _has_hull(inspector, geometry, shape):
        hull = inspector.GetConvexHull(geometry)
        corners = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        faces = []
        for index in range(hull.num_elements()):
            face = hull.element(index)
            ring = [face.vertex(i) for i in range(face.num_vertices())]
            faces += [(ring[0], a, b) for a, b in itertools.pairwise(ring[1:])]
        triangles = corners[np.array(faces)]
    elif isinstance(shape, Mesh):
        triangles = _read_mesh(shape)
    else:
        triangles = np.array(_make_mesh(shape).triangles)
    placed = triangles @ X_FG.rotation().matrix().T + X_FG.translation()
    return np.asarray(placed)


def _has_hull(
    inspector: SceneGraphInspector, geometry: GeometryId, shape: Shape
) -> bool:
    """Return whether a shape is its hull: what is there for contact only."""
    is_contact = inspector.GetProximityProperties(geometry) is not None
    return isinstance(shape, Convex) or is_contact


def _read_mesh(shape: Mesh) -> Array:
    """Return the triangles of a mesh's file; a glTF's y axis is Drake's z axis."""
    path = Path(str(shape.source().path()))
    scale = tuple(float(factor) for factor in shape.scale3())
    surfaces = read_surfaces(path, read_bytes(path), (1.0, 1.0, 1.0), [])
    triangles = np.concatenate(
        [
            np.zeros((0, 3, 3)),
            *(surface.vertices[surface.faces] for surface in surfaces),
        ]
    )
    if path.suffix.lower() in (".gltf", ".glb"):
        x, y, z = np.moveaxis(triangles, -1, 0)
        triangles = np.stack([x, -z, y], axis=-1)
    return np.asarray(triangles * scale)


def _make_mesh(shape: Shape) -> "trimesh.Trimesh":
    """Return the surface of a shape that has no file."""
    import trimesh
    from trimesh import creation

    if isinstance(shape, Box):
        return creation.box(shape.size())
    if isinstance(shape, HalfSpace):
        size = 2.0 * _HORIZON
        plane = creation.box((size, size, size))
        return plane.apply_translation((0.0, 0.0, -_HORIZON))
    if isinstance(shape, Cylinder):
        radius, length = shape.radius(), shape.length()
        return creation.cylinder(radius, length, sections=_SIDES)
    if isinstance(shape, Capsule):
        counts = (_SIDES, _SIDES)
        radius, length = shape.radius(), shape.length()
        capsule = creation.capsule(length, radius, count=counts)
        middle = capsule.bounds.mean(axis=0)
        return capsule.apply_translation(-middle)
    ball = creation.icosphere(_SUBDIVISIONS)
    if isinstance(shape, Sphere):
        return ball.apply_scale(shape.radius())
    if isinstance(shape, Ellipsoid):
        return ball.apply_scale((shape.a(), shape.b(), shape.c()))
    return trimesh.Trimesh()


class Lidar(PythonSystem):
    """Measures how far what is around a robot is.

    .. pydrake_system::

        name: Lidar
        input_ports:
        - geometry_query
        output_ports:
        - ranges
        - /<lidar>
        - /<lidar>/points

    ================  ====  =======================================================
    port              size  meaning
    ================  ====  =======================================================
    geometry_query    --    where all shapes are, as the scene graph tells it
    ranges            --    distances [m], shape (vertical, horizontal); +inf where
                            there is nothing
    /<lidar>          --    LaserScan, the ring in the middle
    /<lidar>/points   --    PointCloud2, a row for each ring
    ================  ====  =======================================================

    A lidar of Gazebo Classic has one of the topics; ``topics`` tells what they are
    called. It has no state: whenever it is asked, it measures what is there then. What
    nobody reads is not measured.
    """

    def __init__(self, sensor: LidarSensor, place: Place, scenery: Scenery) -> None:
        """Create the system."""
        super().__init__()
        self.sensor, self.scenery = sensor, scenery
        self.params = SensorParams(sensor.name, sensor.update_rate)
        self.topics = topics_of(sensor, place.robot, place.world)
        default = f"{place.robot}/{sensor.link}/{sensor.name}"
        if sensor.plugin is not None:
            default = sensor.link
        self.frame_id = sensor.frame_id or default
        is_world = sensor.link == "world"
        self.link = "world" if is_world else f"{place.model}::{sensor.link}"
        self._seed = (place.seed, zlib.crc32(f"{place.robot}/{sensor.name}".encode()))
        self._X_LS = transform_of(sensor.pose)
        self._query = self.DeclareAbstractInputPort(
            "geometry_query", AbstractValue.Make(QueryObject())
        )
        self._ranges = self._declare("ranges", self._calc_ranges)
        makers: dict[str, tuple[type[Message], Any]] = {
            "scan": (LaserScan, self._make_scan),
            "points": (PointCloud2, self._make_points),
        }
        self.output_types: dict[str, type[Message]] = {}
        for key, topic in self.topics.items():
            self.output_types[topic], make = makers[key]
            self._declare(topic, make)

    def _declare(self, name: str, make: Any) -> OutputPort:
        def calc(context: Context, output: AbstractValue) -> None:
            output.set_value(make(context))

        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(()),
            calc,
            prerequisites_of_calc={self._query.ticket(), self.time_ticket()},
        )

    @cached_property
    def directions(self) -> Array:
        """Unit vectors of the rays, x ahead, shape (vertical, horizontal, 3)."""
        return directions_of(self.sensor)

    def pose(self, context: Context) -> RigidTransform:
        """Return the pose in the world, x ahead and z up, by its own context."""
        query = self._query.Eval(context)
        return self.scenery.pose_of(query, self.link) @ self._X_LS

    def _calc_ranges(self, context: Context) -> Array:
        sensor, query = self.sensor, self._query.Eval(context)
        role = Role.kProximity if sensor.sees_collisions else Role.kPerception
        scenes = self.scenery.ray_scenes
        if role not in scenes:
            scenes[role] = RayScene(query.inspector(), role)
        X_WS, shape = self.pose(context), self.directions.shape[:2]
        ways = self.directions.reshape(-1, 3) @ X_WS.rotation().matrix().T
        begin = X_WS.translation() + sensor.range_min * ways
        longest = sensor.range_max - sensor.range_min
        ranges = scenes[role].cast(query, begin, ways, longest) + sensor.range_min
        noise = sensor.noise
        if noise.stddev or noise.mean:
            time = round(context.get_time() * 1e9)
            random = np.random.default_rng([*self._seed, time])
            # What isn't there has no noise.
            noisy = ranges + random.normal(noise.mean, noise.stddev, ranges.shape)
            limited = np.clip(noisy, sensor.range_min, sensor.range_max)
            ranges = np.where(np.isfinite(ranges), limited, ranges)
        return ranges.reshape(shape)

    def _header(self, context: Context) -> Header:
        time = round(context.get_time() * 1e9)
        return Header.from_nanoseconds(time, self.frame_id)

    def _make_scan(self, context: Context) -> LaserScan:
        ranges, sensor = self._ranges.Eval(context), self.sensor
        axis = sensor.horizontal
        step = (axis.max_angle - axis.min_angle) / max(1, axis.count - 1)
        return LaserScan(
            self._header(context),
            angle_min=axis.min_angle,
            angle_max=axis.max_angle,
            angle_increment=step,
            range_min=sensor.range_min,
            range_max=sensor.range_max,
            ranges=tuple(ranges[len(ranges) // 2].tolist()),
        )

    def points(self, context: Context) -> Array:
        """Return where the rays end, x ahead [m], shape (vertical, horizontal, 3).

        Rays that meet nothing are +inf or -inf, and NaN where they are along an axis.
        """
        with np.errstate(invalid="ignore"):
            return np.asarray(self._ranges.Eval(context)[..., None] * self.directions)

    def _make_points(self, context: Context) -> PointCloud2:
        return make_cloud(self._header(context), self.points(context), None)


class LidarHandle:
    """What a lidar measures now; `Simulation.lidar` makes it."""

    def __init__(self, lidar: Lidar, find_context: Callable[[], Context]) -> None:
        """Create it; the function returns the diagram's context, as it is then."""
        self._lidar = lidar
        self._find_context = find_context

    @property
    def sensor(self) -> LidarSensor:
        """The lidar as described."""
        return self._lidar.sensor

    @property
    def topics(self) -> dict[str, str]:
        """Its topics, by what is on them: "scan" and "points"."""
        return dict(self._lidar.topics)

    @property
    def pose(self) -> RigidTransform:
        """Pose in the world, x ahead and z up."""
        return self._lidar.pose(self._own_context())

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors of the rays, x ahead, shape (vertical, horizontal, 3)."""
        return self._lidar.directions.copy()

    def ranges(self) -> NDArray[np.float64]:
        """Return distances [m], shape (vertical, horizontal).

        They are +inf where there is nothing between its least and greatest range.

        Raises:
            ArmDrakeError: If the package embreex is missing.
        """
        ranges: NDArray[np.float64] = self._eval()
        return ranges.copy()

    def points(self, frame: str = "world") -> NDArray[np.float64]:
        """Return the points that are seen [m], shape (n, 3), ring by ring.

        Args:
            frame: "world", or "sensor": the lidar's, x ahead and z up.

        Raises:
            InputError: If there is no such frame.
            ArmDrakeError: As `ranges`.
        """
        if frame not in ("world", "sensor"):
            raise InputError(f"frame: expected 'world' or 'sensor', got {frame!r}")
        ranges = self._eval()
        seen = np.isfinite(ranges)
        points = ranges[seen][:, None] * self._lidar.directions[seen]
        if frame == "sensor":
            return np.asarray(points)
        X_WS = self.pose
        return np.asarray(points @ X_WS.rotation().matrix().T + X_WS.translation())

    def _own_context(self) -> Context:
        return self._lidar.GetMyContextFromRoot(self._find_context())

    def _eval(self) -> Any:
        return self._lidar.GetOutputPort("ranges").Eval(self._own_context())
