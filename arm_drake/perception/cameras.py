"""Cameras: systems that take pictures when somebody reads them.

Conventions: REP 103 (optical frames: z ahead, x right, y down), REP 117 (depths that
can't be told), REP 118 (depth images). Topics and frames are those of the generation of
Gazebo that a tag is for; see `arm_drake.description.perception_sensors`.

A pinhole's picture is drawn, larger where the lens sees more, and the lens bends it.
What is nearer than a camera's near plane isn't drawn, what is behind it is; of depths a
layer before that plane reads as too near.

Sources: Brown, "Decentering distortion of lenses", 1966, with terms and their order as
in `sensor_msgs/CameraInfo`, "plumb_bob"; gz-rendering, src/ogre2/
Ogre2DistortionPass.cc; unlike there no border is cropped, for CameraInfo couldn't tell;
Ogre2DepthCamera.cc for the near plane.
"""

import dataclasses as dc
import math
import zlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Final, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    RenderCameraCore,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context

from arm_drake.arrays import Array, is_number
from arm_drake.controllers.gazebo.plugin import as_topic
from arm_drake.description.gazebo import GazeboPlugin
from arm_drake.description.gazebo_plugins import Noise
from arm_drake.description.links import Pose
from arm_drake.description.perception_sensors import (
    MOST_PIXELS,
    CameraKind,
    CameraSensor,
    find_camera_problem,
)
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, check_known, suggest
from arm_drake.messages import CameraInfo, Image, Message, PointCloud2
from arm_drake.perception.images import (
    color_depths,
    color_labels,
    make_cloud,
    make_image,
    project,
    to_png,
)
from arm_drake.perception.scenery import RENDERER, Scenery
from arm_drake.perception.sensors import (
    Place,
    SensorHandle,
    SensorSystem,
    find_classic_topics,
)

# From the frame of a sensor, x ahead and z up, to its optical frame.
R_SENSOR_OPTICAL: Final = RotationMatrix(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
)


# Steps of Newton's method, and the error that is left at most, at a depth of 1.
_STEPS: Final = 20
_EXACT: Final = 1e-6

# What is nearer than a camera can tell is drawn from this part of its near plane on, as
# Gazebo Sim has it.
_NEARER: Final = 0.9

# Neighbours whose depths differ by a larger part are of two things.
_EDGE: Final = 0.02


# By kind of camera: how its topic ends in Gazebo Sim, and for each of its messages what
# follows that end. The CameraInfo is beside a topic that has an end, else below it.
_TOPICS: Final[Mapping[CameraKind, tuple[str, Mapping[str, str]]]] = {
    "color": ("/image", {"image": ""}),
    "depth": ("/depth_image", {"depth_image": "", "points": "/points"}),
    "rgbd": (
        "",
        {"image": "/image", "depth_image": "/depth_image", "points": "/points"},
    ),
    "segmentation": (
        "/segmentation",
        {"labels_map": "/labels_map", "colored_map": "/colored_map"},
    ),
}


def topics_of(camera: CameraSensor, robot: str, world: str) -> dict[str, str]:
    """Return the topics of a camera by what is on them.

    They are "image", "depth_image", "points", "camera_info", "depth_camera_info",
    "labels_map" and "colored_map".
    """
    if camera.plugin is not None:
        return _classic_topics(camera, camera.plugin)
    place = f"world/{world}/model/{robot}/link/{camera.link}/sensor"
    place += f"/{camera.group or camera.name}"
    if camera.part:
        place += f"/{camera.part}"
    own = camera.topic
    if camera.part and own:
        own = f"{own}/{camera.part}/image"
    end, parts = _TOPICS[camera.kind]
    base = own or f"{place}{end}"
    topics = {name: f"{base}{part}" for name, part in parts.items()}
    folder = base.rpartition("/")[0] if end else base
    topics["camera_info"] = f"{folder}/camera_info"
    if camera.info_topic:
        topics["camera_info"] = camera.info_topic
    return {name: as_topic(topic) for name, topic in topics.items()}


def _classic_topics(camera: CameraSensor, plugin: GazeboPlugin) -> dict[str, str]:
    """Return the topics of a camera of Gazebo Classic's plugin."""
    if camera.plugin_topics:
        return find_classic_topics(plugin, dict(camera.plugin_topics))
    name = plugin.text("camera_name") or camera.group or camera.name
    names = {"image": "image_raw", "camera_info": "camera_info"}
    if camera.part:
        names = {key: f"{camera.part}/{end}" for key, end in names.items()}
    if camera.has_depth:
        names |= {"depth_image": "depth/image_raw", "points": "points"}
        names |= {"depth_camera_info": "depth/camera_info"}
    names = {key: f"{name}/{end}" for key, end in names.items()}
    return find_classic_topics(plugin, names)


class _Bent(NamedTuple):
    """Positions of a distorted picture's pixels in the one that is drawn."""

    # Pixel up and left of each, in a picture made flat, and that next to it.
    corners: NDArray[np.int64]
    nearest: NDArray[np.int64]

    # How far it is from that pixel to the right and down, shape (height, width).
    right: NDArray[np.float32]
    down: NDArray[np.float32]

    # Whether the lens shows anything there.
    is_seen: NDArray[np.bool_]


class Lens:
    """Directions of a camera's pixels, and the picture that is drawn for it."""

    def __init__(self, sensor: CameraSensor) -> None:
        """Reckon it once."""
        fx, fy, cx, cy = self.drawn = sensor.projection
        self.width, self.height = sensor.width, sensor.height
        x = ((np.arange(self.width) - cx) / fx)[None, :]
        y = ((np.arange(self.height) - cy) / fy)[:, None]
        self._bent: _Bent | None = None
        if any(sensor.distortion):
            middle = [
                (part * size - 0.5 - c) / f if part != 0.5 else 0.0
                for part, size, c, f in zip(
                    sensor.distortion_center,
                    (self.width, self.height),
                    (cx, cy),
                    (fx, fy),
                    strict=True,
                )
            ]
            bent_x, bent_y = np.broadcast_arrays(x - middle[0], y - middle[1])
            x, y = undistort(bent_x, bent_y, sensor.distortion)
            x, y = x + middle[0], y + middle[1]
            self._bent = self._reckon(x, y)
        # x and y of where pixels look, at a depth of 1, shapes that make (height,
        # width) together; NaN where a lens shows nothing.
        self.rays = (x.astype(np.float32), y.astype(np.float32))

    def _reckon(self, x: Array, y: Array) -> _Bent:
        """Return how a picture is bent, and have one drawn that is large enough."""
        fx, fy, cx, cy = self.drawn
        u, v = fx * x + cx, fy * y + cy
        # It isn't larger than three times what is seen, or than a camera may have.
        low_u, high_u = _bounds(u, self.width)
        low_v, high_v = _bounds(v, self.height)
        self.width, self.height = high_u - low_u + 1, high_v - low_v + 1
        self.drawn = (fx, fy, cx - low_u, cy - low_v)
        u, v = u - low_u, v - low_v
        with np.errstate(invalid="ignore"):
            is_seen = (u >= 0) & (v >= 0) & (u <= self.width - 1)
            is_seen &= v <= self.height - 1
        u, v = np.where(is_seen, u, 0.0), np.where(is_seen, v, 0.0)
        left = np.minimum(u.astype(np.int64), self.width - 2)
        top = np.minimum(v.astype(np.int64), self.height - 2)
        nearest = np.rint(v).astype(np.int64) * self.width + np.rint(u).astype(np.int64)
        right, down = (u - left).astype(np.float32), (v - top).astype(np.float32)
        return _Bent(top * self.width + left, nearest, right, down, is_seen)

    def bend_colors(self, picture: Array) -> Array:
        """Return a picture as it is seen, shape (height, width, 3), uint8."""
        if self._bent is None:
            return picture
        flat = picture.reshape(-1, 3).astype(np.float32)
        seen = np.round(self._mix(flat)).astype(np.uint8)
        seen[~self._bent.is_seen] = 0
        return np.asarray(seen)

    def bend_depths(self, depths: Array) -> Array:
        """Return depths as they are seen [m], shape (height, width).

        They are NaN where the lens shows nothing.
        """
        bent = self._bent
        if bent is None:
            return depths
        flat = depths.reshape(-1)
        around = np.stack([flat[bent.corners + step] for step in self._steps])
        low, high = around.min(axis=0), around.max(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            is_one = np.isfinite(low) & np.isfinite(high) & (high < (1 + _EDGE) * low)
            # On a plane the inverse of a depth is linear in a picture.
            mixed = 1.0 / self._mix(1.0 / flat[:, None])[..., 0]
        seen = np.where(is_one, mixed, flat[bent.nearest])
        seen[~bent.is_seen] = np.nan
        return np.asarray(seen)

    def bend_labels(self, labels: Array) -> Array:
        """Return labels as they are seen, shape (height, width)."""
        if self._bent is None:
            return labels
        seen = labels.reshape(-1)[self._bent.nearest]
        return np.asarray(np.where(self._bent.is_seen, seen, 0).astype(labels.dtype))

    @property
    def _steps(self) -> tuple[int, int, int, int]:
        return 0, 1, self.width, self.width + 1

    def _mix(self, flat: NDArray[Any]) -> NDArray[Any]:
        """Return the mean of the four pixels around, by how near they are."""
        assert self._bent is not None
        corners, right, down = self._bent.corners, self._bent.right, self._bent.down
        a, b, c, d = (flat[corners + step] for step in self._steps)
        right, down = right[..., None], down[..., None]
        above = a + right * (b - a)
        return np.asarray(above + down * (c + right * (d - c) - above))


def _bounds(pixels: Array, size: int) -> tuple[int, int]:
    """Return the first and the last pixel that are drawn along an axis."""
    extra = min(size, (MOST_PIXELS - size) // 2)
    low = max(math.floor(np.nanmin(pixels, initial=0.0)), -extra)
    high = min(math.ceil(np.nanmax(pixels, initial=size - 1.0)), size - 1 + extra)
    return low, max(high, low + 1)


def distort(x: Array, y: Array, d: Sequence[float]) -> tuple[Array, Array]:
    """Return where a lens shows what a pinhole has at x, y, at a depth of 1.

    x and y are to the right of the distortion's centre and below it, any shape; `d` are
    the coefficients k1, k2, p1, p2, k3.
    """
    k1, k2, p1, p2, k3 = d
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    across = 2.0 * x * y
    return (
        x * radial + p1 * across + p2 * (r2 + 2.0 * x * x),
        y * radial + p2 * across + p1 * (r2 + 2.0 * y * y),
    )


def undistort(x: Array, y: Array, d: Sequence[float]) -> tuple[Array, Array]:
    """Return what a pinhole has where a lens shows x, y; the inverse of `distort`.

    Where there is nothing that a lens would show there it is NaN: a barrel folds what
    is too far out.
    """
    k1, k2, p1, p2, k3 = d
    at_x, at_y = x.astype(float), y.astype(float)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            r2 = at_x * at_x + at_y * at_y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
            xx = radial + at_x * at_x * slope + 2.0 * p1 * at_y + 6.0 * p2 * at_x
            yy = radial + at_y * at_y * slope + 2.0 * p2 * at_x + 6.0 * p1 * at_y
            xy = at_x * at_y * slope + 2.0 * (p1 * at_x + p2 * at_y)
            distorted_x, distorted_y = distort(at_x, at_y, d)
            miss_x, miss_y = distorted_x - x, distorted_y - y
            det = xx * yy - xy * xy
            step_x = (yy * miss_x - xy * miss_y) / det
            step_y = (xx * miss_y - xy * miss_x) / det
            at_x, at_y = at_x - step_x, at_y - step_y
            if np.nanmax(np.hypot(miss_x, miss_y), initial=0.0) < _EXACT / 100.0:
                break
        is_right = np.hypot(miss_x, miss_y) < _EXACT
        is_right &= np.hypot(at_x, at_y) < _fold(d)
    return np.where(is_right, at_x, np.nan), np.where(is_right, at_y, np.nan)


def _fold(d: Sequence[float]) -> float:
    """Return how far from the centre a lens begins to fold what it shows."""
    k1, k2, _, _, k3 = d
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    squares = [r.real for r in roots if abs(r.imag) < 1e-12 and r.real > 0.0]
    return math.sqrt(min(squares, default=math.inf))


class Camera(SensorSystem):
    """Takes pictures of what is around a robot.

    .. pydrake_system::

        name: Camera
        input_ports:
        - geometry_query
        output_ports:
        - /<camera>/image
        - /<camera>/depth_image
        - /<camera>/points
        - /<camera>/camera_info

    =====================  ====  ====================================================
    port                   size  meaning
    =====================  ====  ====================================================
    geometry_query         --    where all shapes are, as the scene graph tells it
    /<camera>/image        --    Image
    /<camera>/depth_image  --    Image
    /<camera>/points       --    PointCloud2
    /<camera>/camera_info  --    CameraInfo
    =====================  ====  ====================================================

    These are the ports of an RGB-D camera; others lack some, and a segmentation camera
    has labels as messages. ``topics`` tells what they are called.

    It has no state: whenever it is asked, it tells what is to be seen then. Pictures
    that nobody reads are not taken.
    """

    pictures = ("image", "colored_map")

    def __init__(self, sensor: CameraSensor, place: Place, scenery: Scenery) -> None:
        """Create the system."""
        topics = topics_of(sensor, place.robot, place.world)
        super().__init__(sensor, place, scenery, topics, R_SENSOR_OPTICAL)
        self.sensor = sensor
        self._image_frame = sensor.optical_frame_id or self.frame_id
        self._takers = {"color": self._take_color} if sensor.has_color else {}
        if sensor.has_depth:
            self._takers["depth"] = self._take_depth
        self._takers["labels"] = self._take_labels
        self._declare_topics()

    @property
    def kinds(self) -> tuple[str, ...]:
        """The pictures that it takes, of "color", "depth" and "labels"."""
        return tuple(self._takers)

    def take(self, context: Context, kind: str) -> NDArray[Any]:
        """Return a picture of one of its `kinds`, by its own context.

        Colours have the shape (height, width, 3), uint8; depths [m] (height, width);
        labels, places of names in `label_names`, (height, width), uint16.
        """
        pixels: NDArray[Any] = self._measure(context, kind, self._takers[kind])
        return pixels

    @property
    def _makers(self) -> Mapping[str, tuple[type[Message], Any]]:
        """Functions that make the messages of topics."""
        encoding = self.sensor.depth_encoding

        def image(kind: str, encoding: str) -> Any:
            return lambda context: self._image(context, kind, encoding)

        return {
            "image": (Image, image("color", self.sensor.encoding)),
            "depth_image": (Image, image("depth", encoding)),
            "labels_map": (Image, image("labels", "16UC1")),
            "colored_map": (Image, self._make_colored_map),
            "camera_info": (CameraInfo, self._make_info),
            "depth_camera_info": (CameraInfo, self._make_info),
            "points": (PointCloud2, self._make_points),
        }

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of what labels mean, in a picture that was taken before."""
        return tuple(self.scenery.label_names)

    @cached_property
    def info(self) -> CameraInfo:
        """Projection of the camera, without a header."""
        sensor = self.sensor
        fx, fy, cx, cy = sensor.projection
        return CameraInfo(
            height=sensor.height,
            width=sensor.width,
            d=sensor.distortion,
            k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
            p=(fx, 0, cx, -fx * sensor.baseline, 0, fy, cy, 0, 0, 0, 1, 0),
        )

    @cached_property
    def lens(self) -> Lens:
        """Distortion of its pictures, and directions of its pixels."""
        return Lens(self.sensor)

    def _core(self, nearer: float = 1.0) -> RenderCameraCore:
        """Return how it is drawn, from a part of its near plane on."""
        from pydrake.systems import sensors

        sensor, lens = self.sensor, self.lens
        fx, fy, cx, cy = lens.drawn
        intrinsics = sensors.CameraInfo(
            width=lens.width,
            height=lens.height,
            focal_x=fx,
            focal_y=fy,
            # Drake's first pixel has its centre at 0.5, that of a CameraInfo at 0.
            center_x=cx + 0.5,
            center_y=cy + 0.5,
        )
        clipping = ClippingRange(nearer * sensor.near, sensor.far)
        return RenderCameraCore(RENDERER, intrinsics, clipping, RigidTransform())

    def _take_color(self, context: Context) -> Array:
        camera = ColorRenderCamera(self._core(), show_window=False)
        query = self._query.Eval(context)
        picture = self.scenery.color(query, camera, self.pose(context))
        picture = self.lens.bend_colors(picture)
        noise = self.sensor.noise
        if noise.stddev or noise.mean:
            added = self._noise(context, "color", picture.shape) * 255.0
            noisy = np.clip(np.round(picture + added), 0.0, 255.0)
            picture = noisy.astype(np.uint8)
        return picture

    def _take_depth(self, context: Context) -> Array:
        sensor = self.sensor
        depths = DepthRange(sensor.min_depth, sensor.max_depth)
        nearer = _NEARER if sensor.plugin is None else 1.0
        camera = DepthRenderCamera(self._core(nearer), depths)
        query = self._query.Eval(context)
        picture = self.scenery.depth(query, camera, self.pose(context))
        picture = self.lens.bend_depths(picture)
        noise = sensor.noise
        # Of other cameras the noise is one of colours.
        if sensor.kind == "depth" and (noise.stddev or noise.mean):
            picture = picture + self._noise(context, "depth", picture.shape)
        return picture.astype(np.float32, copy=False)

    def _take_labels(self, context: Context) -> Array:
        camera = ColorRenderCamera(self._core(), show_window=False)
        query = self._query.Eval(context)
        labels = self.scenery.labels(query, camera, self.pose(context))
        return self.lens.bend_labels(labels)

    def _noise(self, context: Context, what: str, shape: tuple[int, ...]) -> Array:
        """Return the noise of a picture; at one time it is always the same."""
        noise = self.sensor.noise
        random = self._random(context, zlib.crc32(what.encode()))
        return random.normal(noise.mean, noise.stddev, shape)

    def _image(self, context: Context, kind: str, encoding: str) -> Image:
        pixels = self.take(context, kind)
        if kind == "depth":
            pixels = _limit(pixels, self.sensor.image_depths)
        header = self._header(context, self._image_frame)
        return make_image(header, pixels, encoding)

    def _make_colored_map(self, context: Context) -> Image:
        labels = self.take(context, "labels")
        header = self._header(context, self._image_frame)
        return make_image(header, color_labels(labels), "rgb8")

    def _make_info(self, context: Context) -> CameraInfo:
        header = self._header(context, self._image_frame)
        return CameraInfo(
            header,
            **{n: getattr(self.info, n) for n in ("height", "width", "d", "k", "p")},
        )

    def _make_points(self, context: Context) -> PointCloud2:
        depths = _limit(self.take(context, "depth"), self.sensor.point_depths)
        points = project(depths, self.lens.rays)
        frame = self._image_frame
        if self.sensor.plugin is None:
            # Gazebo Sim's points are in the frame of the sensor, x ahead.
            points = points @ R_SENSOR_OPTICAL.matrix().T.astype(np.float32)
            frame = self.frame_id
        colors = self.take(context, "color") if self.sensor.has_color else None
        return make_cloud(self._header(context, frame), points, colors)


def _limit(depths: Array, limits: tuple[float, float]) -> Array:
    """Return depths [m] with -inf and +inf for what is nearer and farther than limits.

    Without limits these are the depths themselves.
    """
    low, high = limits
    if low > 0.0:
        depths = np.where(depths < low, -np.inf, depths)
    if high < math.inf:
        depths = np.where(depths > high, np.inf, depths)
    return depths


class CameraHandle(SensorHandle[Camera]):
    """Present pictures of a camera; `Simulation.camera` makes it."""

    @property
    def sensor(self) -> CameraSensor:
        """The camera as described."""
        return self._system.sensor

    @property
    def info(self) -> CameraInfo:
        """Projection of the camera."""
        return self._system.info

    def color(self) -> NDArray[np.uint8]:
        """Return a picture, red, green and blue, shape (height, width, 3).

        Raises:
            InputError: If the camera takes none.
            ArmDrakeError: If the renderer's libraries are missing.
        """
        pixels: NDArray[np.uint8] = self._take("color")
        return pixels.copy()

    def depth(self) -> NDArray[np.float32]:
        """Return depths along the axis [m], shape (height, width).

        What is farther than the camera can tell is +inf, and a layer before its near
        plane -inf; what is nearer still isn't drawn. Where its lens shows nothing it is
        NaN.

        Raises:
            InputError: If the camera measures none.
            ArmDrakeError: As `color`.
        """
        depths: NDArray[np.float32] = self._take("depth")
        return depths.copy()

    @property
    def kinds(self) -> tuple[str, ...]:
        """The pictures that it takes, of "color", "depth" and "labels"."""
        return self._system.kinds

    def has(self, what: str) -> bool:
        """Return whether it takes pictures of a kind."""
        return what in self.kinds

    def labels(self) -> NDArray[np.uint16]:
        """Return what each pixel shows, shape (height, width), as `label_names` says.

        Raises:
            ArmDrakeError: As `color`.
        """
        labels: NDArray[np.uint16] = self._take("labels")
        return labels.copy()

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of what labels mean: links, "<robot>::<link>", and things."""
        self.labels()
        return self._system.label_names

    @property
    def label_colors(self) -> dict[str, tuple[int, int, int]]:
        """Colours of what is seen in its picture of "labels", by name.

        Raises:
            ArmDrakeError: As `color`.
        """
        seen = np.unique(self.labels())
        names = self._system.label_names
        colors = color_labels(seen).tolist()
        return {names[n]: (r, g, b) for n, (r, g, b) in zip(seen, colors, strict=True)}

    def points(self, frame: str = "world") -> NDArray[np.float64]:
        """Return the points that are seen [m], shape (n, 3), row by row.

        Args:
            frame: "world", or "optical": the camera's, z ahead and y down.

        Raises:
            InputError: If the camera measures no depths, or there is no such frame.
            ArmDrakeError: As `color`.
        """
        points = project(self.depth(), self._system.lens.rays).reshape(-1, 3)
        seen = points[np.isfinite(points[:, 2])].astype(np.float64)
        if frame == "optical":
            return seen
        if frame != "world":
            raise InputError(f"frame: expected 'world' or 'optical', got {frame!r}")
        return self._in_world(seen)

    def image(self, what: str = "") -> NDArray[np.uint8]:
        """Return what to show of it, shape (height, width, 3).

        Args:
            what: "color", "depth" or "labels"; by default the first one that it has.

        Raises:
            InputError: If it has no such picture.
            ArmDrakeError: As `color`.
        """
        pixels = self._take(what or self.kinds[0])
        if pixels.ndim == 3:
            return pixels
        return (
            color_labels(pixels) if pixels.dtype == np.uint16 else color_depths(pixels)
        )

    def _repr_png_(self) -> bytes:
        """Return what notebooks show of it."""
        return to_png(self.image())

    def _take(self, kind: str) -> Any:
        if not self.has(kind):
            raise InputError(
                f"camera {self.sensor.name!r} is a {self.sensor.kind} camera and has "
                f"no {kind}; it has {', '.join(self.kinds)}"
            )
        return self._system.take(self._own_context(), kind)


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

    Its topics are `image`, `depth_image`, `points`, `segmentation/labels_map`,
    `segmentation/colored_map` and `camera_info` below `/<name>`, as far as it has them.

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
        near: What is nearer isn't seen, but what is behind it [m].
        far: What is farther isn't seen [m].
        update_rate: Pictures per second [Hz].
        noise: Standard deviation of its colours, which go from 0 to 1; of a depth
            camera that of its depths [m].

    Raises:
        InputError: If there is no such link, the name is taken, or an argument is
            wrong.
    """
    X_LS = _check_camera(robot, link, pose, name, kind)
    camera = CameraSensor(
        name=name,
        link=link,
        pose=X_LS,
        update_rate=update_rate,
        topic=f"{name}{_TOPICS[kind][0]}",
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
    sensors = (*robot.description.perception_sensors, _checked(camera))
    description = dc.replace(robot.description, perception_sensors=sensors)
    return dc.replace(robot, description=description)


def _checked(camera: CameraSensor) -> CameraSensor:
    """Return a camera, or raise InputError if a number is wrong, or is none."""
    where = f"camera {camera.name!r}"
    names = ("width", "height", "horizontal_fov", "near", "far", "update_rate")
    numbers = {name: getattr(camera, name) for name in names}
    for name, value in (numbers | {"noise": camera.noise.stddev}).items():
        if not is_number(value):
            raise InputError(f"{name}: expected a number, got {value!r}", where=where)
    size = (camera.width, camera.height)
    problem = find_camera_problem(camera.horizontal_fov, size, camera.near, camera.far)
    if not 0.0 < camera.update_rate < math.inf:
        rate = f"{camera.update_rate:g}"
        problem = f"update_rate: expected a finite number above 0 Hz, got {rate}"
    if not 0.0 <= camera.noise.stddev < math.inf:
        noise = f"{camera.noise.stddev:g}"
        problem = f"noise: expected a finite number of at least 0, got {noise}"
    if problem:
        raise InputError(problem, where=where)
    return dc.replace(camera, width=int(camera.width), height=int(camera.height))


def _check_camera(
    robot: Robot, link: str, pose: Sequence[float], name: str, kind: str
) -> Pose:
    """Return a camera's pose, or raise InputError."""
    if not isinstance(robot, Robot):
        expected = "expected a robot of arm_drake.load_robot"
        raise InputError(f"robot: {expected}, got {robot!r}")
    for what, text in (("link", link), ("name", name), ("kind", kind)):
        if not isinstance(text, str):
            raise InputError(f"{what}: expected a text, got {text!r}")
    where = f"camera {name!r}"
    description = robot.description
    known = [*description.links, "world"]
    check_known("link", link, known, where=where)
    if not name or name in [s.name for s in description.perception_sensors]:
        problem = "a sensor is called so already" if name else "expected a name"
        raise InputError(problem, where=where)
    if kind not in (kinds := get_args(CameraKind)):
        raise InputError(f"kind {kind!r}; {suggest(kind, kinds)}", where=where)
    try:
        numbers = [] if isinstance(pose, str) else [float(number) for number in pose]
    except (TypeError, ValueError, OverflowError):
        numbers = []
    if len(numbers) != 6 or not all(map(math.isfinite, numbers)):
        problem = f"pose: expected x, y, z [m], roll, pitch, yaw [rad], got {pose!r}"
        raise InputError(problem, where=where)
    x, y, z, roll, pitch, yaw = numbers
    return (x, y, z, roll, pitch, yaw)
