"""Cameras and lidars in the `<gazebo>` tags of a URDF, of all generations of Gazebo.

What they measure is computed by `arm_drake.perception`.

Sources: SDFormat, sdf/1.11/sensor.sdf, camera.sdf, ray.sdf, noise.sdf; gazebo_ros_pkgs,
branch ros2, gazebo_plugins/src/gazebo_ros_camera.cpp, gazebo_ros_ray_sensor.cpp;
gz-sensors, src/CameraSensor.cc, RgbdCameraSensor.cc, SegmentationCameraSensor.cc;
realsense_gazebo_plugin of PAL Robotics, src/RealSensePlugin.cpp and
gazebo_ros_realsense.cpp; gazebo-classic, gazebo/sensors/DepthCameraSensor.cc.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Final, Literal

from arm_drake.description.elements import (
    ElementReader,
    attribute,
    free_name,
    parse_float,
    parse_sdf_bool,
    text_of,
)
from arm_drake.description.gazebo import (
    GazeboPlugin,
    read_gazebo_plugins,
    read_plugins,
)
from arm_drake.description.gazebo_plugins import Noise
from arm_drake.description.gazebo_sensors import (
    FRAME_TAGS,
    SensorReader,
    read_sensor_pose,
    referred_link,
)
from arm_drake.description.joints import JointInfo
from arm_drake.description.links import Pose
from arm_drake.description.report import LoadReport
from arm_drake.errors import suggest
from arm_drake.importing import dataclass

CameraKind = Literal["color", "depth", "rgbd", "segmentation"]

# Encodings of `sensor_msgs/Image` by the formats of SDF.
FORMATS: Final[Mapping[str, str]] = {
    "R8G8B8": "rgb8",
    "RGB_INT8": "rgb8",
    "B8G8R8": "bgr8",
    "BGR_INT8": "bgr8",
    "L8": "mono8",
    "L_INT8": "mono8",
}

# Other formats of SDF.
_OTHER_FORMATS: Final = (
    *("L16", "L_INT16", "R16G16B16", "RGB_INT16", "RGB_INT32", "R_FLOAT16"),
    *("R_FLOAT32", "RGB_FLOAT16", "RGB_FLOAT32", "BAYER_RGGB8", "BAYER_BGGR8"),
    *("BAYER_GBRG8", "BAYER_GRBG8", "BAYER_RGGR8"),
)

# Classes of messages that Classic's plugin of lidars has; the first is its default.
OUTPUT_TYPES: Final = (
    "sensor_msgs/PointCloud2",
    "sensor_msgs/PointCloud",
    "sensor_msgs/LaserScan",
    "sensor_msgs/Range",
)

# The sensors of a RealSense by the ends of their names, after the plugin's <prefix>,
# and what its tags about each begin with.
_REALSENSE: Final[Mapping[str, str]] = {
    "color": "color",
    "depth": "depth",
    "ired1": "infrared1",
    "ired2": "infrared2",
}

# Its tags about one sensor, and those about all. Upstream's ROS topics have the rates
# of the sensors; its own rates are of Gazebo's topics.
_REALSENSE_TAGS: Final = frozenset(
    f"{start}{end}"
    for start in _REALSENSE.values()
    for end in ("TopicName", "CameraInfoTopicName", "OpticalframeName")
) | {
    *("colorUpdateRate", "depthUpdateRate", "infraredUpdateRate", "prefix"),
    *("rangeMinDepth", "rangeMaxDepth", "robotNamespace"),
    *("pointCloud", "pointCloudTopicName", "pointCloudCutoff", "pointCloudCutoffMax"),
}

# The greatest depth of its points where it names none [m].
_REALSENSE_CUTOFF: Final = 5.0

MOST_PIXELS: Final = 8192

# More than any lidar has.
_MOST_RAYS: Final = 10_000_000

# Sensors that say 0 tell something at every step of Gazebo; here they do at this [Hz].
USUAL_RATE: Final = 30.0


@dataclass(frozen=True)
class PerceptionSensor:
    """Common fields of cameras and lidars."""

    # What makes its system, "module:class": a `SensorSystem` of `arm_drake.perception`
    # that is called with the sensor, its Place and the Scenery.
    system: ClassVar[str]

    # Name in the robot, which no other of them has.
    name: str

    # Link that carries it, and its pose there, x ahead and z up (REP 103): x, y, z [m],
    # roll, pitch, yaw [rad].
    link: str
    pose: Pose = (0.0,) * 6

    # [Hz].
    update_rate: float = USUAL_RATE

    # Frame that its messages name; empty is Gazebo's default.
    frame_id: str = ""

    # Topic that its tag names; empty is Gazebo's default.
    topic: str = ""

    # Plugin of Gazebo Classic that publishes it, if it has one.
    plugin: GazeboPlugin | None = None

    noise: Noise = Noise()

    # Whether it is to be shown.
    visualize: bool = False

    # Name of the tag that is several sensors, if it is one of those.
    group: str = ""


@dataclass(frozen=True)
class CameraSensor(PerceptionSensor):
    """A camera: a pinhole without a shutter."""

    system: ClassVar[str] = "arm_drake.perception.cameras:Camera"

    kind: CameraKind = "color"

    # Angle between the left and the right edge of the picture [rad].
    horizontal_fov: float = 1.047

    # [pixels].
    width: int = 320
    height: int = 240

    # Encoding of its picture, as in `FORMATS`.
    encoding: str = "rgb8"

    # What is nearer or farther along its axis isn't drawn [m].
    near: float = 0.1
    far: float = 100.0

    # Depths that it can tell [m]; what is drawn nearer is -inf, farther +inf (REP 117).
    min_depth: float = 0.1
    max_depth: float = 100.0

    # Encoding of depths: "32FC1" [m], or "16UC1" [mm], 0 where it can't tell.
    depth_encoding: str = "32FC1"

    # Of the depths that it tells those that its depth images and its points have [m].
    image_depths: tuple[float, float] = (0.0, math.inf)
    point_depths: tuple[float, float] = (0.0, math.inf)

    # Distortion k1, k2, p1, p2, k3, as in `sensor_msgs/CameraInfo`, and its centre as
    # parts of width and height.
    distortion: tuple[float, float, float, float, float] = (0.0,) * 5
    distortion_center: tuple[float, float] = (0.5, 0.5)

    # Focal lengths and principal point fx, fy, cx, cy [pixels], if they don't follow
    # from `horizontal_fov`; the first pixel's centre is 0.
    intrinsics: tuple[float, float, float, float] | None = None

    # Frame of its pictures, if not that of its points.
    optical_frame_id: str = ""

    # Topic of its CameraInfo; empty is Gazebo's default.
    info_topic: str = ""

    # All of its topics by what is on them, where its plugin names each.
    plugin_topics: tuple[tuple[str, str], ...] = ()

    # Distance to the right-hand camera of a pair, of which this is the left one [m].
    baseline: float = 0.0

    # Of several cameras of one sensor its own name; `group` is the sensor's.
    part: str = ""

    @property
    def projection(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point fx, fy, cx, cy [pixels]."""
        if self.intrinsics is not None:
            return self.intrinsics
        f = self.width / (2.0 * math.tan(self.horizontal_fov / 2.0))
        # The middle of the picture, where the first pixel's centre is 0.
        return f, f, (self.width - 1) / 2.0, (self.height - 1) / 2.0

    @property
    def has_color(self) -> bool:
        """Whether it takes pictures in colour; a depth camera of Classic does."""
        is_classic_depth = self.kind == "depth" and self.plugin is not None
        return self.kind in ("color", "rgbd") or is_classic_depth

    @property
    def has_depth(self) -> bool:
        """Whether it measures depths."""
        return self.kind in ("depth", "rgbd")


@dataclass(frozen=True)
class ScanAxis:
    """Directions of rays about one axis."""

    samples: int = 640

    # Rays that are told, for each that is measured.
    resolution: float = 1.0

    # [rad].
    min_angle: float = 0.0
    max_angle: float = 0.0

    @property
    def count(self) -> int:
        """Number of published rays."""
        return max(1, round(self.samples * self.resolution))


@dataclass(frozen=True)
class LidarSensor(PerceptionSensor):
    """A lidar: rays about the z axis, and about the y axis."""

    system: ClassVar[str] = "arm_drake.perception.lidar:Lidar"

    horizontal: ScanAxis = ScanAxis()
    vertical: ScanAxis = ScanAxis(samples=1)

    # Distances that it can tell [m], and in which steps; 0 is any.
    range_min: float = 0.0
    range_max: float = math.inf
    range_resolution: float = 0.0

    # Whether it sees what collides rather than what is drawn, as Classic's "ray" does.
    sees_collisions: bool = False

    # Class of its messages, one of `OUTPUT_TYPES`; empty is Gazebo's default.
    output_type: str = ""

    # What its rays are, as Classic's plugin names it: "ultrasound" or "infrared".
    radiation: str = "infrared"


def read_perception_sensors(
    root: ET.Element,
    links: Collection[str],
    joints: Sequence[JointInfo],
    report: LoadReport,
    file: Path,
) -> tuple[PerceptionSensor, ...]:
    """Return the cameras and lidars in the `<gazebo>` tags of a URDF."""
    found: dict[str, PerceptionSensor] = {}
    realsenses = _find_realsenses(root, report, file)
    for gazebo in root.iterfind("gazebo"):
        for element in gazebo.iterfind("sensor"):
            read = _READERS.get(attribute(element, "type"))
            if read is None:
                continue
            name = attribute(element, "name")
            reader = _SensorReader(f"sensor {name!r}", report, file)
            reference = attribute(gazebo, "reference")
            link = referred_link(reference, links, joints)
            if link not in links:
                what = f"its reference is no link, {reference!r}; "
                reader.refuse(what + suggest(reference, links), "missing")
                continue
            plugins = tuple(read_plugins(element, reference))
            if name in realsenses:
                plugins = (realsenses[name], *plugins)
            common = reader.read_common(element, link, plugins, links)
            for sensor in read(reader, element, common):
                free = free_name(sensor.name, found.__contains__)
                if free != sensor.name:
                    what = f"another sensor is called {sensor.name!r}"
                    reader.note("info", "repair", what, f"this one is {free!r}")
                found[free] = dc.replace(sensor, name=free)
    return tuple(found.values())


def _find_realsenses(
    root: ET.Element, report: LoadReport, file: Path
) -> dict[str, GazeboPlugin]:
    """Return RealSense's plugins by the names of their sensors."""
    found: dict[str, GazeboPlugin] = {}
    known = [attribute(e, "name") for e in root.iterfind("gazebo/sensor")]
    for plugin in filter(lambda p: p.is_realsense, read_gazebo_plugins(root)):
        reader = ElementReader(f"plugin {plugin.name!r}", report, file)
        for tag in dict.fromkeys(name for name, _ in plugin.fields):
            if tag not in _REALSENSE_TAGS:
                what = f"<{tag}>; {suggest(tag, _REALSENSE_TAGS)}"
                reader.note("warning", "ignored", what, "it has no effect")
        prefix = plugin.text("prefix")
        for end in _REALSENSE:
            name = f"{prefix}{end}"
            found.setdefault(name, plugin)
            if name not in known:
                hint = suggest(name, known) if known else "there are no sensors"
                what = f"no sensor {name!r}, <prefix> and {end!r}; {hint}"
                reader.note("warning", "missing", what, "its topics are not there")
    return found


class _SensorReader(SensorReader):
    """Reads the fields of one sensor."""

    def refuse(
        self, what: str, kind: Literal["missing", "invalid"] = "invalid"
    ) -> None:
        """Report why the sensor is left out."""
        self.note("error", kind, what, "the sensor is left out")

    def read_common(
        self,
        element: ET.Element,
        link: str,
        plugins: Sequence[GazeboPlugin],
        links: Collection[str],
    ) -> PerceptionSensor:
        """Return what all sensors have."""
        plugin = next((p for p in plugins if p.sensor == "perception"), None)
        for other in plugins:
            if other is not plugin:
                what = f"plugin {other.filename or other.name!r}"
                self.note("info", "ignored", what, "it has no effect")
        rate = self.value(element, "update_rate", 0.0, least=0.0)
        frame = self.frame(element)
        name = attribute(element, "name")
        if plugin is not None:
            tag = "frame_name"
            if plugin.is_realsense:
                tag = f"{_realsense_tags(plugin, name)}OpticalframeName"
            frame = plugin.text(tag)
        for each in (frame, text_of(element, "camera/optical_frame_id")):
            if each and each not in links and each != "world":
                what = f"its frame {each!r} is no link; {suggest(each, links)}"
                done = "its messages name it all the same"
                self.note("warning", "missing", what, done)
        kind = attribute(element, "type")
        known = _TAGS | (_CAMERA_TAGS if kind in _CAMERA_KINDS else _LIDAR_TAGS)
        self.check_tags(
            element, known | ({"camera/pose"} if kind == "multicamera" else set()), ""
        )
        return PerceptionSensor(
            name=name or link,
            link=link,
            pose=read_sensor_pose(element, self._report, self._file),
            update_rate=rate or USUAL_RATE,
            frame_id=frame,
            topic=text_of(element, "topic"),
            plugin=plugin,
            noise=self._noise(element),
            visualize=parse_sdf_bool(text_of(element, "visualize")) is True,
        )

    def raw(self, element: ET.Element | None, path: str, default: float) -> float:
        """Return the number in a child, which may be infinite or NaN."""
        number = parse_float(text_of(element, path))
        return self.value(element, path, default) if number is None else number

    def _noise(self, element: ET.Element) -> Noise:
        tags = [element.find(f"{top}/noise") for top in ("camera", "lidar", "ray")]
        noise = self.noise(next((tag for tag in tags if tag is not None), None))
        if attribute(element, "type") in _CAMERA_KINDS:
            return Noise(noise.mean, noise.stddev)
        return noise

    def cameras(
        self, element: ET.Element, common: PerceptionSensor
    ) -> Iterator[PerceptionSensor]:
        """Yield the camera of a sensor, or several of them."""
        kind = _CAMERA_KINDS[attribute(element, "type")]
        tags = element.findall("camera")
        if not tags:
            self.refuse("it has no <camera>", "missing")
        is_several = attribute(element, "type") == "multicamera"
        if len(tags) > 1 and not is_several:
            what = f"{len(tags)} <camera> in one sensor"
            self.note("warning", "ignored", what, "the first one is taken")
            tags = tags[:1]
        for camera in tags:
            part = attribute(camera, "name") if is_several else ""
            sensor = self._camera(camera, common, kind, part)
            if sensor is not None:
                yield sensor

    def _camera(
        self, tag: ET.Element, common: PerceptionSensor, kind: CameraKind, part: str
    ) -> CameraSensor | None:
        """Return one camera, or None and a line in the report."""
        encoding = self._encoding(tag, kind)
        size = [
            self.raw(tag, f"image/{name}", default)
            for name, default in (("width", 320), ("height", 240))
        ]
        near = self.raw(tag, "clip/near", 0.1)
        far = self.raw(tag, "clip/far", 100.0)
        fov = self.raw(tag, "horizontal_fov", 1.047)
        problem = find_camera_problem(fov, size, near, far)
        if encoding is None or problem:
            if problem:
                self.refuse(problem)
            return None
        depths = _depth_range(self, tag, common.plugin, near, far)
        distortion, center = self._distortion(tag)
        fields = {f.name: getattr(common, f.name) for f in dc.fields(common)}
        if part:
            fields |= {"name": f"{common.name}_{part}", "part": part}
            fields |= {"group": common.name, "pose": self._pose(tag, common.pose)}
        plugin = common.plugin
        if plugin is not None and kind == "depth" and common.noise != Noise():
            what = "noise of a depth camera of Gazebo Classic"
            self.note("info", "ignored", what, "its depths are exact, as there")
            fields["noise"] = Noise()
        sensor = CameraSensor(
            **fields,
            kind=kind,
            horizontal_fov=fov,
            width=int(size[0]),
            height=int(size[1]),
            encoding=encoding,
            near=near,
            far=far,
            min_depth=depths[0],
            max_depth=depths[1],
            distortion=distortion,
            distortion_center=center,
            intrinsics=self._intrinsics(tag, int(size[0]), int(size[1])),
            optical_frame_id=text_of(tag, "optical_frame_id"),
            info_topic=text_of(tag, "camera_info_topic"),
            baseline=self._plugin_number(plugin, "hack_baseline", 0.0),
        )
        if plugin is not None and plugin.is_realsense:
            return self._as_realsense(sensor, plugin)
        return sensor

    def _as_realsense(self, sensor: CameraSensor, plugin: GazeboPlugin) -> CameraSensor:
        """Return a camera as RealSense's plugin publishes it."""
        start = _realsense_tags(plugin, sensor.name)
        prefix, topic = plugin.text("prefix"), plugin.text(f"{start}TopicName")
        image = "depth_image" if sensor.has_depth else "image"
        info = f"{topic.rpartition('/')[0]}/camera_info".lstrip("/")
        topics = {image: topic, "camera_info": info}
        wanted = plugin.text(f"{start}CameraInfoTopicName")
        if wanted not in ("", info):
            what = f"{start}CameraInfoTopicName {wanted!r}"
            done = f"it is {info!r}, beside the picture, as upstream's"
            self.note("info", "ignored", what, done)
        if sensor.has_depth and parse_sdf_bool(plugin.text("pointCloud")):
            topics["points"] = plugin.text("pointCloudTopicName")
        for key, name in topics.items():
            if not name:
                self.expected(f"{start}TopicName", f"a topic for {key}", name)
        named = {key: f"{prefix}/{name}" for key, name in topics.items() if name}
        is_mono = sensor.encoding == "mono8"
        return dc.replace(
            sensor,
            plugin_topics=tuple(named.items()),
            encoding="8UC1" if is_mono else sensor.encoding,
            depth_encoding="16UC1",
            image_depths=self._plugin_range(
                plugin, ("rangeMinDepth", "rangeMaxDepth"), (0.0, math.inf)
            ),
            point_depths=self._plugin_range(
                plugin,
                ("pointCloudCutoff", "pointCloudCutoffMax"),
                (0.0, _REALSENSE_CUTOFF),
            ),
        )

    def _plugin_range(
        self, plugin: GazeboPlugin, tags: tuple[str, str], default: tuple[float, float]
    ) -> tuple[float, float]:
        """Return two depths of a plugin [m], the default if they make no sense."""
        low, high = (
            self._plugin_number(plugin, tag, number)
            for tag, number in zip(tags, default, strict=True)
        )
        if low < high:
            return low, high
        expected = f"less than {tags[1]}, {high:g} m"
        self.expected(tags[0], expected, f"{low:g} m")
        return default

    def _pose(self, tag: ET.Element, pose: Pose) -> Pose:
        """Return the pose of one of several cameras."""
        if tag.find("pose") is None:
            return pose
        if any(pose):
            what, done = "<pose> of sensor and of camera", "the camera's is taken"
            self.note("warning", "unsupported", what, done)
        return read_sensor_pose(tag, self._report, self._file)

    def _encoding(self, tag: ET.Element, kind: CameraKind) -> str | None:
        text = text_of(tag, "image/format") or "R8G8B8"
        if text in FORMATS:
            return FORMATS[text]
        if kind == "depth" and text == "R_FLOAT32":  # That of all depths.
            return "rgb8"
        if text in _OTHER_FORMATS:
            what, done = f"pixel format {text}", "its picture is R8G8B8"
            self.note("warning", "unsupported", what, done)
            return "rgb8"
        known = ", ".join((*FORMATS, *_OTHER_FORMATS))
        self.refuse(f"unknown pixel format {text!r}; known: {known}")
        return None

    def _distortion(
        self, tag: ET.Element
    ) -> tuple[tuple[float, float, float, float, float], tuple[float, float]]:
        """Return the coefficients and the centre of a camera's distortion."""
        found = tag.find("distortion")
        k1, k2, p1, p2, k3 = (
            self.value(found, name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")
        )
        center = (0.5, 0.5)
        text = text_of(found, "center") if found is not None else ""
        if text:
            numbers = [self.number(word, "distortion center") for word in text.split()]
            known = [float(n) for n in numbers if n is not None and math.isfinite(n)]
            if len(known) == len(numbers) == 2:
                center = (known[0], known[1])
            elif None not in numbers:
                self.expected("distortion center", "2 numbers", text)
        if center != (0.5, 0.5) and any((k1, k2, p1, p2, k3)):
            what = f"distortion center {text!r}"
            done = "the picture has it; camera_info can't tell it"
            self.note("info", "unsupported", what, done)
        return (k1, k2, p1, p2, k3), center

    def _intrinsics(
        self, tag: ET.Element, width: int, height: int
    ) -> tuple[float, float, float, float] | None:
        """Return what `<lens>` says of the projection, if it does."""
        kind = text_of(tag, "lens/type")
        if kind not in ("", "gnomonical"):
            what, done = f"lens type {kind!r}", "it is a pinhole"
            self.note("warning", "unsupported", what, done)
        found = tag.find("lens/intrinsics")
        if found is None:
            return None
        names = ("fx", "fy", "cx", "cy")
        fx, fy, cx, cy = (self.value(found, name, math.nan) for name in names)
        is_inside = -0.5 < cx < width - 0.5 and -0.5 < cy < height - 0.5
        if not (fx > 0.0 and fy > 0.0 and is_inside):
            got = ", ".join(f"{n} {text_of(found, n) or 'nothing'}" for n in names)
            expected = "fx and fy more than 0, and cx and cy inside the picture"
            self.expected("lens intrinsics", expected, got)
            return None
        if self.value(found, "s", 0.0):
            what, done = f"lens skew s {text_of(found, 's')}", "it has none"
            self.note("warning", "unsupported", what, done)
        return fx, fy, cx, cy

    def _plugin_number(
        self, plugin: GazeboPlugin | None, tag: str, default: float
    ) -> float:
        texts = () if plugin is None else plugin.texts(tag)
        number = self.number(texts[0], tag) if texts else None
        return default if number is None else number

    def lidars(
        self, element: ET.Element, common: PerceptionSensor
    ) -> Iterator[PerceptionSensor]:
        """Yield the lidar of a sensor."""
        tag = element.find("lidar")
        tag = element.find("ray") if tag is None else tag
        if tag is None:
            self.refuse("it has no <lidar> and no <ray>", "missing")
            return
        horizontal = self._axis(tag, "horizontal", 640)
        vertical = self._axis(tag, "vertical", 1)
        low = self.raw(tag, "range/min", 0.0)
        high = self.raw(tag, "range/max", math.inf)
        if horizontal is None or vertical is None:
            return
        rays = horizontal.count * vertical.count
        if rays > _MOST_RAYS:
            self.refuse(f"{rays} rays; expected at most {_MOST_RAYS}")
        elif not 0.0 <= low < high:
            expected = "expected 0 <= min < max"
            self.refuse(f"range: {expected}, got {low:g} and {high:g} m")
        else:
            plugin, fields = common.plugin, dc.fields(common)
            step = self.value(tag, "range/resolution", 0.0, least=0.0)
            if step:
                what = f"distances in steps of {step:g} m"
                self.note("info", "unsupported", what, "distances are told exactly")
            yield LidarSensor(
                **{f.name: getattr(common, f.name) for f in fields},
                horizontal=horizontal,
                vertical=vertical,
                range_min=low,
                range_max=high,
                range_resolution=step,
                sees_collisions=plugin is not None
                and attribute(element, "type") == "ray",
                output_type=self._choice(plugin, "output_type", OUTPUT_TYPES),
                radiation=self._choice(
                    plugin, "radiation_type", ("infrared", "ultrasound")
                ),
            )

    def _choice(
        self, plugin: GazeboPlugin | None, tag: str, known: Sequence[str]
    ) -> str:
        """Return a text of a plugin, the first one that is known by default."""
        texts = () if plugin is None else plugin.texts(tag)
        if texts and texts[0] not in known:
            self.expected(tag, f"one of {', '.join(known)}", texts[0])
        return texts[0] if texts and texts[0] in known else known[0]

    def _axis(self, tag: ET.Element, name: str, default: int) -> ScanAxis | None:
        found = tag.find(f"scan/{name}")
        samples = self.raw(found, "samples", default)
        low = self.raw(found, "min_angle", 0.0)
        high = self.raw(found, "max_angle", 0.0)
        if not 1.0 <= samples <= _MOST_RAYS:
            self.refuse(f"{name} samples: expected 1 to {_MOST_RAYS}, got {samples:g}")
        elif not low <= high or math.isinf(high - low):
            expected = "expected min_angle <= max_angle"
            self.refuse(f"{name}: {expected}, got {low:g} and {high:g} rad")
        else:
            if samples != int(samples):
                what = f"{name} samples: expected an integer, got {samples:g}"
                self.note("warning", "invalid", what, f"there are {int(samples)}")
            resolution = self.value(found, "resolution", 1.0, least=0.0)
            return ScanAxis(int(samples), resolution, low, high)
        return None


def find_camera_problem(
    fov: float, size: Sequence[float], near: float, far: float
) -> str:
    """Return what is wrong with a camera's numbers, in words; empty if nothing."""
    if not 0.0 < fov < math.pi:
        return f"horizontal_fov: expected more than 0 and less than pi, got {fov:g} rad"
    for name, pixels in zip(("width", "height"), size, strict=True):
        if not 1 <= pixels <= MOST_PIXELS or int(pixels) != pixels:
            expected = f"expected 1 to {MOST_PIXELS} pixels"
            return f"image {name}: {expected}, got {pixels:g}"
    if not 0.0 < near < far < math.inf:
        return f"clip: expected 0 < near < far, got {near:g} and {far:g} m"
    return ""


def _realsense_tags(plugin: GazeboPlugin, sensor: str) -> str:
    """Return what the tags of a RealSense about one of its sensors begin with."""
    return _REALSENSE[sensor.removeprefix(plugin.text("prefix"))]


def _depth_range(
    reader: _SensorReader,
    tag: ET.Element,
    plugin: GazeboPlugin | None,
    near: float,
    far: float,
) -> tuple[float, float]:
    """Return the range of a camera's depths [m]."""
    if plugin is not None and plugin.is_realsense:
        return near, far
    if plugin is not None:
        texts = {name: plugin.texts(name) for name in ("min_depth", "max_depth")}
        low, high = (
            reader.number(texts[name][0], name) if texts[name] else None
            for name in texts
        )
        # Classic's plugin has these defaults.
        low, high = 0.4 if low is None else low, far if high is None else high
    else:
        low = reader.value(tag, "depth_camera/clip/near", near)
        high = reader.value(tag, "depth_camera/clip/far", far)
    low, high = max(low, near), min(high, far)
    if low < high:
        return low, high
    what = f"depths from {low:g} to {high:g} m"
    done = f"it tells those from {near:g} to {far:g} m"
    reader.note("warning", "invalid", what, done)
    return near, far


_CAMERA_KINDS: Final[Mapping[str, CameraKind]] = {
    "camera": "color",
    "multicamera": "color",
    "depth": "depth",
    "depth_camera": "depth",
    "rgbd": "rgbd",
    "rgbd_camera": "rgbd",
    "segmentation": "segmentation",
    "segmentation_camera": "segmentation",
}

_Read = Callable[
    [_SensorReader, ET.Element, PerceptionSensor], Iterator[PerceptionSensor]
]

# Tags that are read, or whose default is what is done here.
_TAGS: Final = frozenset(
    {"always_on", "update_rate", "topic", "visualize", "pose", "plugin", *FRAME_TAGS}
)


def _paths(top: str, children: Mapping[str, str]) -> set[str]:
    """Return the paths of tags below one, from the names of children by path."""
    below = [f"{k}/{name}" for k, names in children.items() for name in names.split()]
    return {top} | {f"{top}/{path.strip('/')}" for path in below}


_CAMERA_TAGS: Final = _paths(
    "camera",
    {
        "": "horizontal_fov image clip noise distortion lens depth_camera",
        "image": "width height format",
        "clip": "near far",
        "noise": "type mean stddev",
        "distortion": "k1 k2 k3 p1 p2 center",
        **{"lens": "type intrinsics", "lens/intrinsics": "fx fy cx cy s"},
        **{"depth_camera": "clip", "depth_camera/clip": "near far"},
    },
) | {f"camera/{name}" for name in ("optical_frame_id", "camera_info_topic")}
_AXIS: Final = "samples resolution min_angle max_angle"
_RAYS: Final = {
    "": "scan range noise",
    "scan": "horizontal vertical",
    **{"scan/horizontal": _AXIS, "scan/vertical": _AXIS},
    "range": "min max resolution",
    "noise": "type mean stddev bias_mean bias_stddev precision",
}
_LIDAR_TAGS: Final = _paths("lidar", _RAYS) | _paths("ray", _RAYS)

# What reads a `<sensor>`, by its type.
_READERS: Final[Mapping[str, _Read]] = {
    **dict.fromkeys(_CAMERA_KINDS, _SensorReader.cameras),
    **dict.fromkeys(("ray", "gpu_ray", "lidar", "gpu_lidar"), _SensorReader.lidars),
}

TYPES: Final = tuple(_READERS)
