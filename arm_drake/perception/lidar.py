"""Lidars: systems that cast rays when somebody reads them.

The rays are Embree's. All shapes of a frame are one tree of triangles, and the rays are
brought into the frames: moving robots and things need no new trees. As Gazebo's, lidars
see what is drawn, and Classic's `ray` what collides. A ray begins at the least distance
that the lidar can tell, so that the housing around it isn't seen.

Sources: SDFormat, sdf/1.11/ray.sdf; gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/
gazebo_ros_ray_sensor.cpp; ros_gz_bridge, src/convert/sensor_msgs.cpp; REP 117.
"""

import importlib.util
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Convex,
    GeometryId,
    Mesh,
    QueryObject,
    Role,
    SceneGraphInspector,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from arm_drake.arrays import Array
from arm_drake.controllers.gazebo.plugin import as_topic
from arm_drake.description.gazebo_plugins import Noise
from arm_drake.description.meshes.reading import read_bytes, read_surfaces
from arm_drake.description.meshes.surfaces import decode_gltf, decode_surface
from arm_drake.description.perception_sensors import (
    OUTPUT_TYPES,
    LidarSensor,
    ScanAxis,
)
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.messages import (
    ChannelFloat32,
    LaserScan,
    Message,
    Point32,
    PointCloud,
    PointCloud2,
    Range,
)
from arm_drake.perception.images import make_ray_cloud
from arm_drake.perception.scenery import Scenery, make_surface
from arm_drake.perception.sensors import (
    Place,
    SensorHandle,
    SensorSystem,
    find_classic_topics,
)
from arm_drake.plant.contact import hull_triangles, hull_vertices

# By how much what stands for a circle is off at most [m], and its sides at most: from a
# radius of 1 m on.
_OFF: Final = 1e-4
_FEWEST_SIDES, _MOST_SIDES = 16, 224

# What reads the meshes that were written here, by the ends of their names.
_DECODERS: Final = {".gltf": decode_gltf, ".obj": decode_surface}

# What Classic's plugin tells, by the class of its messages.
_CLASSIC_OUTPUTS: Final[Mapping[str, str]] = dict(
    zip(OUTPUT_TYPES, ("points", "cloud", "scan", "range"), strict=True)
)

# So many faces that are seen from their other side alone a ray passes, and so much
# behind each it goes on [m].
_MOST_BACKS: Final = 16
_BEHIND: Final = 1e-5

# Farther is no hit [m]; Embree says 1e37.
_NO_HIT: Final = 1e30

# Without Embree: pairs of a ray and a triangle that are tried, at most and at once, and
# by how much a ray may pass a triangle, as a part of its sides.
_MOST_PAIRS: Final = 20_000_000
_PAIRS_AT_ONCE: Final = 100_000
_EDGE: Final = 1e-9


def topics_of(lidar: LidarSensor, robot: str, world: str) -> dict[str, str]:
    """Return the topics of a lidar by what is on them.

    They are "scan" and "points", or what Classic's plugin tells: "range" and "cloud",
    the older PointCloud, too.
    """
    plugin = lidar.plugin
    if plugin is not None:
        kind = _CLASSIC_OUTPUTS[lidar.output_type or OUTPUT_TYPES[0]]
        return find_classic_topics(plugin, {kind: f"{plugin.name}/out"})
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

    # Normals of the triangles that are seen from outside alone, zero of all others,
    # shape (n, 3); None if there are none of these.
    normals: Array | None

    def hit(self, begin: Array, ways: Array) -> Array:
        """Return how far rays come [m], more than `_NO_HIT` where they meet nothing."""
        directions = ways.astype(np.float32)
        if self.normals is None:
            starts = begin.astype(np.float32)
            return np.asarray(self.scene.run(starts, directions, query="DISTANCE"))
        far = np.zeros(len(begin))
        going = np.arange(len(begin))
        for _ in range(_MOST_BACKS):
            starts = (begin[going] + far[going, None] * ways[going]).astype(np.float32)
            found = self.scene.run(
                starts, directions[going], query="INTERSECT", output=True
            )
            seen, faces = found["tfar"], found["primID"]
            far[going] += seen
            out = np.einsum("ij,ij->i", self.normals[faces], ways[going])
            is_back = (faces >= 0) & (out > 0.0)
            going = going[is_back]
            if not len(going):
                break
            far[going] += _BEHIND
        far[going] = np.inf
        return far


class RayScene:
    """The shapes of a diagram, for rays."""

    def __init__(self, inspector: SceneGraphInspector, role: Role) -> None:
        """Make the trees."""
        self._trees: list[_Tree] = []
        for place, frame in enumerate(inspector.GetAllFrameIds()):
            ids = inspector.GetGeometries(frame, role)
            found = [_triangles(inspector, geometry) for geometry in ids]
            # Of what collides a mesh is seen from outside alone, as ODE has it: else a
            # lidar that is in its robot's base would see that alone.
            is_mesh = [
                np.full(len(part), isinstance(inspector.GetShape(geometry), Mesh))
                for part, geometry in zip(found, ids, strict=True)
            ]
            if sum(map(len, found)):
                culled = np.concatenate(is_mesh) & (role == Role.kProximity)
                self._trees.append(_make_tree(place, np.concatenate(found), culled))

    def cast(
        self,
        query: QueryObject,
        origin: Array,
        ways: Array,
        shortest: float,
        longest: float,
    ) -> Array:
        """Return how far rays come [m], shape (n,); +inf where they meet nothing.

        They begin at a point of the world and go along unit vectors, shape (n, 3).
        What is nearer than `shortest` isn't met, and they go as far as `longest` [m].
        """
        nearest = np.full(len(ways), np.inf)
        if not self._trees:
            return nearest
        frames = query.inspector().GetAllFrameIds()
        poses = [query.GetPoseInWorld(frames[tree.place]) for tree in self._trees]
        X_WF = np.stack([pose.GetAsMatrix34() for pose in poses])
        centers = np.stack([tree.center for tree in self._trees])
        radii = np.array([tree.radius for tree in self._trees])
        to_center = np.einsum("tij,tj->ti", X_WF[..., :3], centers)
        to_center += X_WF[..., 3] - origin
        distance = np.linalg.norm(to_center, axis=1)
        is_inside = distance <= radii
        tangent = np.sqrt(np.where(is_inside, 0.0, distance**2 - radii**2))
        along = to_center @ ways.T
        for number in np.flatnonzero(is_inside | (distance - radii <= longest)):
            tree = self._trees[number]
            meets: Any = slice(None)
            if not is_inside[number]:
                # A ray that passes a sphere beside or behind meets nothing in it.
                meets = np.flatnonzero(along[number] >= tangent[number])
                if not len(meets):
                    continue
            R_WF, p_WF = X_WF[number, :, :3], X_WF[number, :, 3]
            # Embree reckons in single precision: from near the shapes it is exact.
            ahead = np.maximum(along[number, meets] - 1.01 * tree.radius, shortest)
            seen = ways[meets] @ R_WF
            begin = R_WF.T @ (origin - p_WF) + ahead[:, None] * seen
            hits = tree.hit(begin, seen)
            distances = np.where(hits < _NO_HIT, hits + ahead, np.inf)
            nearest[meets] = np.minimum(nearest[meets], distances)
        nearest[nearest > longest] = np.inf
        return nearest


class _SlowScene:
    """Replacement of Embree, with its interface: each ray is tried with each triangle.

    Source: Moller and Trumbore, "Fast, minimum storage ray/triangle intersection",
    1997.
    """

    def __init__(self, triangles: Array) -> None:
        """Take the triangles, shape (n, 3, 3) [m]."""
        self._first = triangles[:, 0]
        self._sides = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - self._first

    def run(
        self, starts: Array, ways: Array, *, query: str, output: bool = False
    ) -> Any:
        """Return how far rays come [m], and which triangles they meet with `output`.

        ArmDrakeError if there are too many of them.
        """
        count = len(self._first)
        if len(starts) * count > _MOST_PAIRS:
            raise ArmDrakeError(
                f"{len(starts)} rays at {count} triangles need Embree, and the package "
                "embreex isn't there; it comes with the extra: "
                "pip install 'arm-drake[lidar]'"
            )
        far = np.full(len(starts), 10.0 * _NO_HIT)
        faces = np.full(len(starts), -1)
        for some in np.array_split(
            np.arange(len(starts)), 1 + len(starts) * count // _PAIRS_AT_ONCE
        ):
            if len(some) and count:
                distances = self._meet(starts[some, None], ways[some, None])
                faces[some] = distances.argmin(axis=1)
                far[some] = distances.min(axis=1)
        faces[far > _NO_HIT] = -1
        return {"tfar": far, "primID": faces} if output else far

    def _meet(self, start: Array, way: Array) -> Array:
        """Return how far rays, shape (n, 1, 3), come to each triangle [m]."""
        one, two = self._sides
        across = np.cross(way, two)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / np.sum(across * one, axis=-1)
            away = start - self._first
            u = inverse * np.sum(away * across, axis=-1)
            beside = np.cross(away, one)
            v = inverse * np.sum(way * beside, axis=-1)
            far = inverse * np.sum(two * beside, axis=-1)
            # An edge belongs to both of its triangles.
            meets = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE) & (far > 0)
        return np.where(meets, far, 10.0 * _NO_HIT)


def _make_tree(place: int, triangles: Array, culled: NDArray[np.bool_]) -> _Tree:
    scene: Any = _SlowScene(triangles)
    if importlib.util.find_spec("embreex") is not None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        scene = EmbreeScene(robust=True)
        TriangleMesh(scene, triangles.astype(np.float32))
    corners = triangles.reshape(-1, 3)
    center = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(corners - center, axis=1).max())
    normals = None
    if culled.any():
        a, b, c = triangles.transpose(1, 0, 2)
        normals = np.where(culled[:, None], np.cross(b - a, c - a), 0.0)
    return _Tree(place, scene, center, radius, normals)


def _triangles(inspector: SceneGraphInspector, geometry: GeometryId) -> Array:
    """Return the triangles of a shape in its frame [m], shape (n, 3, 3).

    A mesh is seen as it is, as in Gazebo, though in contact it is its hull here.
    """
    shape = inspector.GetShape(geometry)
    X_FG = RigidTransform(inspector.GetPoseInFrame(geometry))
    if isinstance(shape, Convex):
        hull = inspector.GetConvexHull(geometry)
        triangles = hull_vertices(hull)[hull_triangles(hull)]
    elif isinstance(shape, Mesh):
        triangles = _read_mesh(shape)
    else:
        surface = make_surface(shape, _count_sides(shape))
        triangles = surface.vertices[surface.faces]
    placed = triangles @ X_FG.rotation().matrix().T + X_FG.translation()
    return np.asarray(placed)


def _count_sides(shape: Shape) -> int:
    """Return the sides of what stands for a circle of a shape."""
    lengths = [getattr(shape, name, float) for name in ("radius", "a", "b", "c")]
    radius = max(length() for length in lengths)
    sides = math.pi / math.acos(1.0 - _OFF / max(radius, 2.0 * _OFF))
    return min(max(4 * math.ceil(sides / 4.0), _FEWEST_SIDES), _MOST_SIDES)


def _read_mesh(shape: Mesh) -> Array:
    """Return the triangles of a mesh's file."""
    path, scale = Path(str(shape.source().path())), tuple(shape.scale3())
    content, surfaces = read_bytes(path), []
    if scale == (1.0, 1.0, 1.0) and path.suffix in _DECODERS:
        surfaces = _DECODERS[path.suffix](content)
    # What reads the meshes of others takes a second to be imported.
    surfaces = surfaces or read_surfaces(path, content, scale, [])
    found = [surface.vertices[surface.faces] for surface in surfaces]
    return np.concatenate([np.zeros((0, 3, 3)), *found])


class Lidar(SensorSystem):
    """Measures how far what is around a robot is.

    .. pydrake_system::

        name: Lidar
        input_ports:
        - geometry_query
        output_ports:
        - /<lidar>
        - /<lidar>/points

    ================  ====  =======================================================
    port              size  meaning
    ================  ====  =======================================================
    geometry_query    --    where all shapes are, as the scene graph tells it
    /<lidar>          --    LaserScan, the ring in the middle
    /<lidar>/points   --    PointCloud2, a row for each ring
    ================  ====  =======================================================

    A lidar of Gazebo Classic has one topic, which may be a Range, the least distance,
    or a PointCloud, too; ``topics`` tells what they are called. It has no state:
    whenever it is asked, it measures what is there then. What nobody reads is not
    measured.
    """

    def __init__(self, sensor: LidarSensor, place: Place, scenery: Scenery) -> None:
        """Create the system."""
        topics = topics_of(sensor, place.robot, place.world)
        super().__init__(sensor, place, scenery, topics)
        self.sensor = sensor
        self._declare_topics()

    @property
    def _makers(self) -> Mapping[str, tuple[type[Message], Any]]:
        """Functions that make the messages of topics."""
        return {
            "scan": (LaserScan, self._make_scan),
            "points": (PointCloud2, self._make_points),
            "cloud": (PointCloud, self._make_cloud),
            "range": (Range, self._make_range),
        }

    @cached_property
    def directions(self) -> Array:
        """Unit vectors of the rays, x ahead, shape (vertical, horizontal, 3)."""
        return directions_of(self.sensor)

    def ranges(self, context: Context) -> Array:
        """Return distances [m], shape (vertical, horizontal), by its own context.

        They are +inf where there is nothing.
        """
        ranges: Array = self._measure(context, "ranges", self._cast)
        return ranges

    def _cast(self, context: Context) -> Array:
        sensor, query = self.sensor, self._query.Eval(context)
        role = Role.kProximity if sensor.sees_collisions else Role.kPerception
        scenes = self.scenery.ray_scenes
        if role not in scenes:
            scenes[role] = RayScene(query.inspector(), role)
        X_WS, shape = self.pose(context), self.directions.shape[:2]
        ways = self.directions.reshape(-1, 3) @ X_WS.rotation().matrix().T
        ranges = scenes[role].cast(
            query, X_WS.translation(), ways, sensor.range_min, sensor.range_max
        )
        if sensor.noise != Noise():
            # What isn't there has no noise.
            noisy = self._add_noise(context, ranges)
            limited = np.clip(noisy, sensor.range_min, sensor.range_max)
            ranges = np.where(np.isfinite(ranges), limited, ranges)
        return ranges.reshape(shape)

    def _add_noise(self, context: Context, ranges: Array) -> Array:
        """Return distances [m] as Gazebo's `GaussianNoiseModel` has them."""
        noise, random = self.sensor.noise, self._random(context)
        fixed = np.random.default_rng(self._seed)
        bias = fixed.normal(noise.bias_mean, noise.bias_stddev) * fixed.choice((-1, 1))
        noisy = ranges + random.normal(noise.mean, noise.stddev, ranges.shape) + bias
        if noise.precision:
            with np.errstate(invalid="ignore"):
                noisy = np.round(noisy / noise.precision) * noise.precision
        return np.asarray(noisy)

    def _make_scan(self, context: Context) -> LaserScan:
        ranges, sensor = self.ranges(context), self.sensor
        axis = sensor.horizontal
        step = (axis.max_angle - axis.min_angle) / max(1, axis.count - 1)
        return LaserScan(
            self._header(context, self.frame_id),
            angle_min=axis.min_angle,
            angle_max=axis.max_angle,
            angle_increment=step,
            range_min=sensor.range_min,
            range_max=sensor.range_max,
            ranges=tuple(ranges[len(ranges) // 2].tolist()),
            intensities=(0.0,) * axis.count,
        )

    def _make_range(self, context: Context) -> Range:
        sensor = self.sensor
        axes = (sensor.horizontal, sensor.vertical)
        return Range(
            self._header(context, self.frame_id),
            radiation_type=int(sensor.radiation == "infrared"),
            field_of_view=max(axis.max_angle - axis.min_angle for axis in axes),
            min_range=sensor.range_min,
            max_range=sensor.range_max,
            range=float(self.ranges(context).min()),
        )

    def points(self, context: Context) -> Array:
        """Return where the rays end, x ahead [m], shape (vertical, horizontal, 3).

        Rays that meet nothing are +inf or -inf, and NaN where they are along an axis.
        """
        with np.errstate(invalid="ignore"):
            return np.asarray(self.ranges(context)[..., None] * self.directions)

    def _make_points(self, context: Context) -> PointCloud2:
        header, points = self._header(context, self.frame_id), self.points(context)
        return make_ray_cloud(header, points, has_rings=self.sensor.plugin is None)

    def _make_cloud(self, context: Context) -> PointCloud:
        ranges, header = (
            self.ranges(context),
            self._header(context, self.frame_id),
        )
        points = self.points(context)[np.isfinite(ranges)]
        return PointCloud(
            header,
            tuple(Point32(*point) for point in points.tolist()),
            (ChannelFloat32("intensity", (0.0,) * len(points)),),
        )


class LidarHandle(SensorHandle[Lidar]):
    """Present measurement of a lidar; `Simulation.lidar` makes it."""

    @property
    def sensor(self) -> LidarSensor:
        """The lidar as described."""
        return self._system.sensor

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors of the rays, x ahead, shape (vertical, horizontal, 3)."""
        return self._system.directions.copy()

    def ranges(self) -> NDArray[np.float64]:
        """Return distances [m], shape (vertical, horizontal).

        They are +inf where there is nothing between its least and greatest range.

        Raises:
            ArmDrakeError: If the package embreex is missing, and there are many rays.
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
        points = ranges[seen][:, None] * self._system.directions[seen]
        return self._in_world(points) if frame == "world" else np.asarray(points)

    def _eval(self) -> Any:
        return self._system.ranges(self._own_context())
