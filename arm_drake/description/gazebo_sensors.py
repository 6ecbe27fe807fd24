"""Sensors in `<gazebo>` tags of a URDF; cameras and lidars in `perception_sensors`.

Sources of the sensors' fields: SDFormat, sdf/1.11/sensor.sdf, contact.sdf, imu.sdf,
noise.sdf, forcetorque.sdf; gz-sensors, src/ImuSensor.cc; gazebo_ros_pkgs, branch ros2,
gazebo_plugins/src/gazebo_ros_bumper.cpp, gazebo_ros_imu_sensor.cpp.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Final

from arm_drake.description.elements import (
    ElementReader,
    attribute,
    parse_sdf_bool,
    parse_sdf_pose,
    text_of,
)
from arm_drake.description.gazebo import KEEPING, PLAIN_IMU, GazeboPlugin, read_plugins
from arm_drake.description.gazebo_plugins import ImuSensorTag, Noise
from arm_drake.description.joints import WORLD, JointInfo
from arm_drake.description.links import Pose
from arm_drake.description.report import LoadReport
from arm_drake.errors import suggest
from arm_drake.importing import dataclass

CONTACT: Final = "contact"
IMU: Final = "imu"
_FORCE: Final = "force_torque"

# Types of SDF, older names too, that are known without being simulated.
_KNOWN: Final = (
    *("air_pressure", "air_speed", "altimeter", "boundingbox", "boundingbox_camera"),
    *("custom", "dvl", "gps", "logical_camera", "magnetometer", "navsat", "rfid"),
    *("rfidtag", "sonar", "thermal", "thermal_camera", "wideanglecamera"),
    *("wide_angle_camera", "wireless_receiver", "wireless_transmitter"),
)


@dataclass(frozen=True)
class GazeboSensor:
    """A `<sensor>` tag below `<gazebo>`."""

    name: str

    # Such as "imu", "contact", "force_torque".
    type: str

    # Link or joint that the `<gazebo>` tag refers to.
    reference: str

    # Link that this one is part of in Gazebo, see `merged_link`.
    merged: str

    # Pose in the link that is referred to: x, y, z [m], roll, pitch, yaw [rad].
    pose: Pose = (0.0,) * 6

    # Topic that it names; empty is Gazebo's default.
    topic: str = ""

    # Collision shapes that a contact sensor feels with.
    collisions: tuple[str, ...] = ()

    # Whether a force is what the parent does to the child, not the other way round.
    is_on_child: bool = False

    # Whether forces are along the axes of the sensor, not of the child link.
    is_in_sensor: bool = False

    # What an IMU's tag says of it.
    imu: ImuSensorTag | None = None

    plugins: tuple[GazeboPlugin, ...] = ()

    @property
    def bumper(self) -> GazeboPlugin | None:
        """The plugin of Gazebo Classic that publishes contacts, if it has one."""
        return next((p for p in self.plugins if p.sensor == "bumper"), None)


def read_gazebo_sensors(
    root: ET.Element, joints: Sequence[JointInfo], report: LoadReport, file: Path
) -> tuple[GazeboSensor, ...]:
    """Return the sensors in the `<gazebo>` tags of a URDF."""
    return tuple(
        GazeboSensor(
            name=attribute(element, "name"),
            type=attribute(element, "type"),
            reference=attribute(gazebo, "reference"),
            merged=merged_link(root, attribute(gazebo, "reference"), joints),
            pose=read_sensor_pose(element, report, file),
            topic=text_of(element, "topic")
            or text_of(element.find("contact"), "topic"),
            collisions=tuple(
                text_of(collision)
                for collision in element.iterfind("contact/collision")
            ),
            is_on_child=_has_text(element, "measure_direction", "parent_to_child"),
            is_in_sensor=_has_text(element, "frame", "sensor"),
            imu=_read_imu(element, attribute(gazebo, "reference"), report, file),
            plugins=tuple(read_plugins(element, attribute(gazebo, "reference"))),
        )
        for gazebo in root.iterfind("gazebo")
        for element in gazebo.iterfind("sensor")
    )


def report_unsimulated(
    sensors: Iterable[GazeboSensor],
    components: Collection[str],
    seeing: Collection[str],
    report: LoadReport,
    file: Path,
) -> None:
    """Report sensors of which nothing is simulated.

    Those of `<ros2_control>`, which `components` names, may have a tag for their place.
    `seeing` are the types of cameras and lidars.
    """
    simulated = (CONTACT, IMU, _FORCE, *seeing)
    for sensor in sensors:
        kind, done = sensor.type, "nothing is published"
        is_component = sensor.name in components
        if kind in simulated and (is_component or kind != _FORCE):
            continue
        if is_component and kind in ("", *_KNOWN):
            continue
        if kind == _FORCE:
            what = f"of type {kind!r}, without a <sensor> of its name in <ros2_control>"
        elif kind in _KNOWN:
            what = f"sensors of type {kind!r} are not simulated"
        elif kind:
            what = f"unknown type {kind!r}; {suggest(kind, simulated)}"
        else:
            what = f"it has no type; known: {', '.join(sorted(simulated))}"
        where = f"sensor {sensor.name!r}"
        report.add("warning", "unsupported", what, done, where=where, file=file)


# Frames of messages, by the tags of the generations of Gazebo.
FRAME_TAGS: Final = ("gz_frame_id", "ignition_frame_id", "frame_id")

_NOISES: Final = ("gaussian", "gaussian_quantized", "none")


class SensorReader(ElementReader):
    """Reads what tags of sensors have in common."""

    # What to say of some tags that aren't read.
    unread: ClassVar[Mapping[str, str]] = {}

    def frame(self, element: ET.Element) -> str:
        """Return the frame that a sensor's messages name, "" if it says none."""
        return next(filter(None, (text_of(element, tag) for tag in FRAME_TAGS)), "")

    def check_tags(self, parent: ET.Element, known: Collection[str], at: str) -> None:
        """Report what has no effect below an element."""
        for child in parent:
            path = f"{at}{child.tag}"
            if path not in known:
                done = self.unread.get(path, "it has no effect")
                self.note("info", "ignored", f"<{path}>", done)
            elif child.tag not in ("plugin", "pose"):
                self.check_tags(child, known, f"{path}/")

    def value(
        self,
        element: ET.Element | None,
        path: str,
        default: float,
        *,
        least: float = -math.inf,
        where: str = "",
    ) -> float:
        """Return the finite number in a child, the default if it gives none."""
        found = None if element is None else element.find(path)
        if found is None:
            return default
        number = self.finite(text_of(found), path, where)
        if number is not None and number < least:
            self.expected(path, f"at least {least:g}", text_of(found), where)
            number = None
        return default if number is None else number

    def noise(self, element: ET.Element | None, where: str = "") -> Noise:
        """Return what a `<noise>` says; without one there is none."""
        if element is None:
            return Noise()
        kind = attribute(element, "type") or text_of(element, "type") or "none"
        if kind not in _NOISES:
            expected = "gaussian, gaussian_quantized or none"
            self.expected("noise type", expected, kind, where)
        if kind not in ("gaussian", "gaussian_quantized"):
            return Noise()
        values = {
            field.name: self.value(
                element,
                field.name,
                0.0,
                # A mean may have any sign.
                least=-math.inf if field.name.endswith("mean") else 0.0,
                where=where,
            )
            for field in dc.fields(Noise)
        }
        return Noise(**values)


# Axes of what an IMU measures, and the tags that are read.
_IMU_AXES: Final = tuple(
    f"{quantity}/{axis}"
    for quantity in ("angular_velocity", "linear_acceleration")
    for axis in "xyz"
)
_FRAME: Final = "orientation_reference_frame"
_IMU_TAGS: Final = frozenset(
    {"always_on", "update_rate", "topic", "visualize", "pose", "plugin", *FRAME_TAGS}
    | {"enable_metrics", "imu", "imu/enable_orientation", f"imu/{_FRAME}"}
    | {f"imu/{_FRAME}/{tag}" for tag in ("localization", "custom_rpy", "grav_dir_x")}
    | {f"imu/{axis.partition('/')[0]}" for axis in _IMU_AXES}
    | {f"imu/{axis}{end}" for axis in _IMU_AXES for end in ("", "/noise")}
    | {
        f"imu/{axis}/noise/{tag}"
        for axis in _IMU_AXES
        for tag in ("type", *(field.name for field in dc.fields(Noise)))
    }
)

# Tags of the plugin of Gazebo Classic.
_IMU_PLUGIN_TAGS: Final = (
    *("ros/namespace", "ros/remapping", "ros/argument", "frame_name"),
    "initial_orientation_as_reference",
)

# Frames in which IMUs tell orientations: roll, pitch, yaw in the world [rad], whose x
# axis points east and its y axis north.
_LOCALIZATIONS: Final = {
    "ENU": (0.0, 0.0, 0.0),
    "NED": (math.pi, 0.0, math.pi / 2.0),
    "NWU": (0.0, 0.0, math.pi / 2.0),
}
_CUSTOM, _GRAVITY = "CUSTOM", ("GRAV_UP", "GRAV_DOWN")
_AS_AT_START: Final = "its orientations are relative to that at the start"


def _read_imu(
    element: ET.Element, reference: str, report: LoadReport, file: Path
) -> ImuSensorTag | None:
    """Return what the tag of an IMU says, without its place; None of another one."""
    if attribute(element, "type") != IMU:
        return None
    name = attribute(element, "name")
    reader = _ImuReader(f"IMU {name!r}", report, file)
    return reader.read(element, name, tuple(read_plugins(element, reference)))


class _ImuReader(SensorReader):
    """Reads the fields of one IMU."""

    unread: ClassVar[Mapping[str, str]] = {
        "imu/noise": "Gazebo doesn't read it in a URDF either; expected <noise> in "
        "<x>, <y> and <z> of <angular_velocity> and <linear_acceleration>"
    }

    def read(
        self, element: ET.Element, name: str, plugins: Sequence[GazeboPlugin]
    ) -> ImuSensorTag:
        """Return the IMU."""
        imu = element.find("imu")
        self.check_tags(element, _IMU_TAGS, "")
        enabled = self._boolean(
            "enable_orientation", text_of(imu, "enable_orientation")
        )
        tag = ImuSensorTag(
            name,
            "",
            update_rate=self.value(element, "update_rate", 0.0, least=0.0),
            topic=text_of(element, "topic"),
            frame_id=self.frame(element),
            noise=tuple(
                self.noise(None if imu is None else imu.find(f"{axis}/noise"), axis)
                for axis in _IMU_AXES
            ),
            has_orientation=enabled is not False,
            reference=self._reference(imu),
        )
        plugin = next((p for p in plugins if p.sensor == "imu"), None)
        return tag if plugin is None else self._of_classic(tag, plugin)

    def _of_classic(self, tag: ImuSensorTag, plugin: GazeboPlugin) -> ImuSensorTag:
        """Return an IMU as the plugin of Gazebo Classic publishes it."""
        if plugin.stem != PLAIN_IMU:
            what = f"plugin {plugin.filename!r}"
            done = "run as libgazebo_ros_imu_sensor.so, whose accelerations are less "
            done += "that of free fall: 9.81 upwards at rest"
            self.note("info", "repair", what, done)
        unread = sorted({name for name, _ in plugin.fields} - {*_IMU_PLUGIN_TAGS})
        if unread:
            what = f"unknown tags of its plugin: {', '.join(unread)}"
            self.note("info", "ignored", what, "they have no effect")
        key = "initial_orientation_as_reference"
        is_relative = self._boolean(key, plugin.text(key))
        return dc.replace(
            tag,
            frame_id=plugin.text("frame_name"),
            has_orientation=True,
            reference=tag.reference if is_relative else _LOCALIZATIONS["ENU"],
            is_classic=True,
            node=plugin.name,
            namespace=plugin.text("ros/namespace"),
            remappings=plugin.texts("ros/remapping") + plugin.texts("ros/argument"),
        )

    def _boolean(self, name: str, text: str) -> bool | None:
        """Return the bool that a text is, None if it is missing."""
        value = parse_sdf_bool(text)
        if text and value is None:
            self.expected(name, "true or false", text)
        return value

    def _reference(self, imu: ET.Element | None) -> tuple[float, float, float] | None:
        """Return the frame of orientations, None for that at the start."""
        frame = None if imu is None else imu.find(_FRAME)
        if frame is None:
            return None
        kind = text_of(frame, "localization") or _CUSTOM
        if kind in _LOCALIZATIONS:
            return _LOCALIZATIONS[kind]
        if kind in _GRAVITY:
            what = f"localization {kind}, which Gazebo Sim doesn't know either"
            self.note("warning", "unsupported", what, _AS_AT_START)
        elif kind != _CUSTOM:
            known = (*_LOCALIZATIONS, _CUSTOM)
            what = f"unknown localization {kind!r}; {suggest(kind, known)}"
            self.note("warning", "invalid", what, _AS_AT_START)
        elif (custom := frame.find("custom_rpy")) is not None:
            return self._custom(custom)
        return None

    def _custom(self, custom: ET.Element) -> tuple[float, float, float] | None:
        """Return the frame that a `<custom_rpy>` gives."""
        parent = attribute(custom, "parent_frame")
        if parent != WORLD:
            what = f"custom_rpy: expected parent_frame {WORLD!r}, the only one that "
            what += f"Gazebo Sim knows, got {parent!r}"
            self.note("warning", "unsupported", what, _AS_AT_START)
            return None
        known = [self.finite(part, "custom_rpy") for part in text_of(custom).split()]
        angles = [angle for angle in known if angle is not None]
        if len(known) == len(angles) == 3:
            return (angles[0], angles[1], angles[2])
        if len(known) == len(angles):
            what = f"custom_rpy: expected roll, pitch, yaw, got {text_of(custom)!r}"
            self.note("warning", "invalid", what, _AS_AT_START)
        return None


def merged_link(root: ET.Element, reference: str, joints: Sequence[JointInfo]) -> str:
    """Return the link in Gazebo of what a `<gazebo>` tag refers to.

    Where a fixed joint holds a link, Gazebo makes it part of the one that carries it,
    unless that is the world, and calls both as this one.

    Source: SDFormat, src/parser_urdf.cc, `ReduceFixedJoints`.
    """
    kept = {
        attribute(gazebo, "reference")
        for gazebo in root.iterfind("gazebo")
        for tag in KEEPING
        if text_of(gazebo, tag).lower() in ("true", "yes", "1")
    }
    parents = {
        joint.child: joint.parent
        for joint in joints
        if joint.type == "fixed" and joint.name not in kept and joint.parent != WORLD
    }
    links = [attribute(link, "name") for link in root.iterfind("link")]
    link = referred_link(reference, links, joints)
    passed: list[str] = []
    while link in parents and link not in passed:
        passed.append(link)
        link = parents[link]
    return link


def referred_link(
    reference: str, links: Collection[str], joints: Iterable[JointInfo]
) -> str:
    """Return the link that a `<gazebo>` tag refers to: of a joint its child."""
    if reference in links:
        return reference
    return {joint.name: joint.child for joint in joints}.get(reference, reference)


def _has_text(element: ET.Element, tag: str, value: str) -> bool:
    """Return whether a sensor of forces has a tag with this text."""
    return text_of(element.find("force_torque"), tag) == value


def read_sensor_pose(element: ET.Element, report: LoadReport, file: Path) -> Pose:
    """Return the pose that a sensor states, in its link."""
    tag, text = element.find("pose"), text_of(element, "pose")
    if tag is None:
        return (0.0,) * 6
    numbers = parse_sdf_pose(tag)
    where = f"sensor {attribute(element, 'name')!r}"
    if numbers is None or len(numbers) != 6:
        numbers = (0.0,) * 6
        if text:
            what = f"pose: expected x, y, z, roll, pitch, yaw, got {text!r}"
            done = "it is where its link is"
            report.add("warning", "invalid", what, done, where=where, file=file)
    if other := attribute(tag, "relative_to"):
        what = f"pose: relative_to {other!r}"
        done = "it is taken as relative to the link"
        report.add("warning", "ignored", what, done, where=where, file=file)
    x, y, z, roll, pitch, yaw = numbers
    return (x, y, z, roll, pitch, yaw)
