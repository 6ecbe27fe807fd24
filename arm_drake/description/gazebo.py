"""`<gazebo>` tags of a URDF: plugins, friction, and what has no effect here.

Three generations of Gazebo have plugins of their own: Gazebo Classic, Ignition Gazebo
and Gazebo Sim ("gz"). What a plugin is for is told by the name of its library and, from
Ignition on, of its class. The fields of those that concern joints are in
`gazebo_plugins`, and the sensors in `gazebo_sensors`.
"""

import collections
import dataclasses as dc
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from arm_drake.description.elements import (
    ElementReader,
    attribute,
    parse_number,
    parse_sdf_bool,
    text_of,
)
from arm_drake.description.gazebo_plugins import (
    KINDS,
    AckermannSteering,
    GazeboRosAckermannDrive,
    GazeboRosDiffDrive,
    JointPlugin,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
    MecanumDrive,
    OdometryPublisher,
    VelocityControl,
    WheelDrive,
)
from arm_drake.description.joints import JointInfo, Mimic
from arm_drake.description.report import LoadReport
from arm_drake.errors import MISSPELT, find_close, suggest
from arm_drake.importing import dataclass

# Libraries, without "lib" and ".so".
_ROS2_CONTROL = re.compile(r"gazebo_ros2_control|(ign|gz)_ros2_control-system")
_SYSTEM = re.compile(r"(gz-sim|ignition-gazebo)\d*-(?P<kind>[a-z-]+)-system")
_CLASS = re.compile(r"(gz::sim|ignition::gazebo)(::v\d+)?::systems::(?P<kind>\w+)")

# Systems of a world that let its sensors work: cameras and lidars, or one type.
_SENSORS = re.compile(
    r"(gz-sim|ignition-gazebo)\d*-(?P<kind>sensors|imu|contact)-system"
)

# Libraries that move a robot, and for which nothing stands in.
_MOVING = re.compile(
    r"(gz-sim|ignition-gazebo)\d*-(tracked-vehicle"
    r"|track-controller|trajectory-follower|thruster"
    r"|multicopter-[a-z-]+|apply-link-wrench)-system"
    r"|gazebo_ros_(tricycle_drive|force|hand_of_god)"
)

# Libraries that let a joint follow another one, which Gazebo Classic itself doesn't;
# all copies of roboticsgroup's have its parameters, whatever packages call them.
_MIMIC = re.compile(r"(\w+_)?mimic_joint_plugin")

# Tags of a joint that keep Gazebo from merging the links that it holds together.
KEEPING = ("preserveFixedJoint", "disableFixedJointLumping")

# Tags of a link that say whether gravity acts on it, with what they usually say.
_WEIGHT: Mapping[str, bool] = {"gravity": True, "turnGravityOff": False}

# The plugin of RealSense's maker for its cameras, and Gazebo's own for IMUs.
_REALSENSE = "realsense_gazebo_plugin"
PLAIN_IMU = "gazebo_ros_imu_sensor"

# Libraries of Gazebo Classic that publish what sensors of some sort measure.
_SENSOR_LIBRARIES: Mapping[str, Literal["bumper", "imu", "perception"]] = {
    "gazebo_ros_bumper": "bumper",
    PLAIN_IMU: "imu",
    "gazebo_ros_create_imu": "imu",
    "gazebo_ros_camera": "perception",
    "gazebo_ros_depth_camera": "perception",
    "gazebo_ros_openni_kinect": "perception",
    "gazebo_ros_multicamera": "perception",
    "gazebo_ros_ray_sensor": "perception",
    _REALSENSE: "perception",
}


@dataclass(frozen=True)
class GazeboPlugin:
    """A `<plugin>` tag below `<gazebo>`."""

    name: str
    filename: str

    # Texts of its children by tag, in order; a tag may occur several times. Those of
    # children's children are called like "ros/namespace", attributes "tag@attribute".
    fields: tuple[tuple[str, str], ...] = ()

    # Link or joint that the `<gazebo>` tag refers to.
    reference: str = ""

    # Element that holds the plugin, such as "sensor 'camera'", if not `<gazebo>`.
    holder: str = ""

    def texts(self, tag: str) -> tuple[str, ...]:
        """Return the texts of all children with this tag."""
        return tuple(text for name, text in self.fields if name == tag)

    def text(self, tag: str) -> str:
        """Return the first text of a child with this tag that isn't empty, else ""."""
        return next(filter(None, self.texts(tag)), "")

    @property
    def place(self) -> str:
        """Name in the report."""
        return f"Gazebo plugin {self.name or self.filename!r}"

    @property
    def sensor(self) -> Literal["bumper", "imu", "perception", ""]:
        """The sort of Gazebo Classic's sensors that it publishes, "" if none.

        Perception is what cameras and lidars see.
        """
        return _SENSOR_LIBRARIES.get(self.stem, "")

    @property
    def is_realsense(self) -> bool:
        """Whether it publishes what the sensors of a RealSense see, by their names."""
        return self.stem == _REALSENSE

    @property
    def is_moving(self) -> bool:
        """Whether it would move the robot, but nothing stands in for it."""
        return _MOVING.fullmatch(self.stem) is not None

    @property
    def is_mimic(self) -> bool:
        """Whether it lets a joint follow another one."""
        return _MIMIC.fullmatch(self.stem) is not None

    @property
    def sensor_system(self) -> str:
        """The sensors of a world that it lets work, which they do without it.

        That is "sensors", which are cameras and lidars, or a type; "" is none.
        """
        match = _SENSORS.fullmatch(self.stem)
        return match["kind"] if match else ""

    @property
    def stem(self) -> str:
        """Name of its library, without "lib" and ".so"."""
        library = re.split(r"[/\\]", self.filename)[-1]
        return library.removesuffix(".so").removeprefix("lib")

    @property
    def kind(self) -> str:
        """Its key in `KINDS`; "other" if it neither moves nor reports joints."""
        stem = self.stem
        if _ROS2_CONTROL.fullmatch(stem):
            return "ros2_control"
        if match := _SYSTEM.fullmatch(stem):
            kind = match["kind"].replace("-", "_")
        elif match := _CLASS.fullmatch(self.name):
            kind = re.sub(r"(?<=.)(?=[A-Z])", "_", match["kind"]).lower()
        else:
            kind = stem if stem.startswith("gazebo_ros_") else "other"
        other = "ros2_control" if self.is_like_ros2_control else "other"
        return kind if kind in KINDS else other

    @property
    def is_like_ros2_control(self) -> bool:
        """Whether it has a controllers YAML as ros2_control's own, but another name."""
        return _ROS2_CONTROL.fullmatch(self.stem) is None and any(
            name.endswith((".yaml", ".yml")) for name in self.texts("parameters")
        )


def read_gazebo_plugins(root: ET.Element) -> tuple[GazeboPlugin, ...]:
    """Return the plugins in `<gazebo>` tags of a URDF, also those of sensors."""
    return tuple(
        plugin
        for gazebo in root.iterfind("gazebo")
        for plugin in read_plugins(gazebo, attribute(gazebo, "reference"))
    )


def read_plugins(parent: ET.Element, reference: str) -> Iterator[GazeboPlugin]:
    """Yield the plugins below an element."""
    for holder, plugin in _plugins(parent, ""):
        yield GazeboPlugin(
            name=attribute(plugin, "name"),
            filename=attribute(plugin, "filename"),
            fields=tuple(_fields(plugin, "")),
            reference=reference,
            holder=holder,
        )


def add_mimics(
    joints: Sequence[JointInfo],
    plugins: Collection[GazeboPlugin],
    report: LoadReport,
    file: Path,
) -> tuple[JointInfo, ...]:
    """Return the joints, with a mimic where a plugin alone lets them follow."""
    found = {joint.name: joint for joint in joints}
    following = {joint.name for joint in joints if joint.mimic is not None}
    for plugin in (each for each in plugins if each.is_mimic):
        reader = ElementReader(f"Gazebo plugin {plugin.name!r}", report, file)
        master, name = plugin.text("joint"), plugin.text("mimicJoint")
        if name not in found:
            what = f"<mimicJoint> {name!r}, which doesn't exist; {suggest(name, found)}"
            reader.note("warning", "invalid", what, "the plugin is left out")
            continue
        factor = reader.finite(plugin.text("multiplier") or "1", "multiplier")
        offset = reader.finite(plugin.text("offset") or "0", "offset")
        mimic = Mimic(master, 1.0 if factor is None else factor, offset or 0.0)
        stated = found[name].mimic
        if stated is None:
            found[name] = dc.replace(found[name], mimic=mimic)
            what = f"lets it follow {master!r}; the URDF doesn't"
            where = f"joint {name!r}"
            reader.note("info", "repair", what, "taken as its <mimic>", where)
        elif stated != mimic:
            first = "the URDF" if name in following else "a plugin before it"
            what = f"{name} = {mimic.multiplier:g} {master} + {mimic.offset:g}, in "
            what += f"{first} {stated.multiplier:g} {stated.joint} + {stated.offset:g}"
            reader.note("warning", "invalid", what, f"{first} counts")
    return tuple(found.values())


def report_gazebo(
    root: ET.Element,
    report: LoadReport,
    file: Path,
    *,
    sensors: Collection[str] = (),
    systems: Collection[str] = (),
    sees: bool = False,
) -> None:
    """Report the content of `<gazebo>` tags that has no effect, in two lines.

    Plugins that would move the robot have a line of their own, a warning. Friction of
    what is no link, which would have one, has a line of its own.
    `sensors` are those that measure, `systems` those of a world that they need in
    Gazebo; `sees` says whether some are cameras or lidars.
    """
    holders = {f"sensor {name!r}" for name in sensors}
    found = read_gazebo_plugins(root)
    _report_moving(found, report, file)
    alike = [each for each in found if each.is_like_ros2_control]
    if alike:
        names = ", ".join(repr(each.filename or each.name) for each in alike)
        what = f"Gazebo plugins {names}, with a controllers YAML in <parameters>"
        done = "taken as ros2_control's own"
        report.add("info", "repair", what, done, file=file)
    plugins = collections.Counter(
        repr(plugin.filename or plugin.name)
        for plugin in found
        if plugin.kind == "other"
        and not (plugin.is_moving or plugin.is_mimic)
        and not (plugin.holder in holders and plugin.sensor)
        and plugin.sensor_system not in systems
        and not (plugin.is_realsense and sees)
    )
    tags = collections.Counter(
        f"<{child.tag.rpartition('}')[2]}>"
        for gazebo in root.iterfind("gazebo")
        for child in gazebo
        # Friction and links that stay apart have an effect, sensors their own lines.
        if child.tag not in ("plugin", "mu1", "sensor", *KEEPING, *_WEIGHT)
        and not _states_friction(child)
    )
    for sort, counts in (("Gazebo plugins", plugins), ("<gazebo> tags", tags)):
        names = ", ".join(
            f"{name} ({count} times)" if count > 1 else name
            for name, count in counts.items()
        )
        if names:
            what = f"{sort} {names}"
            report.add("info", "ignored", what, "they have no effect", file=file)
    _report_friction(root, report, file)
    _report_weight(root, report, file)


def _report_moving(
    plugins: Sequence[GazeboPlugin], report: LoadReport, file: Path
) -> None:
    """Report plugins that would move the robot, but nothing stands in for them."""
    moving = dict.fromkeys(repr(each.filename) for each in plugins if each.is_moving)
    if moving:
        what = f"Gazebo plugins {', '.join(moving)} move the robot; "
        what += "they aren't simulated"
        done = "controllers and the plugins that are simulated move it alone"
        report.add("warning", "unsupported", what, done, file=file)


def _states_friction(child: ET.Element) -> bool:
    """Return whether a tag below `<gazebo>` has a friction that is read."""
    holder = ET.Element("gazebo")
    holder.append(child)
    return holder.find(_FRICTION) is not None


def _report_friction(root: ET.Element, report: LoadReport, file: Path) -> None:
    """Report the friction of what is no link."""
    links = [attribute(link, "name") for link in root.iterfind("link")]
    joints = {attribute(joint, "name") for joint in root.iterfind("joint")}
    for gazebo in root.iterfind("gazebo"):
        reference, where = attribute(gazebo, "reference"), ""
        if gazebo.find("mu1") is not None and reference not in links:
            what = "<mu1> in a tag without reference, that is, of no link"
            if reference in joints:
                where, what = f"joint {reference!r}", "<mu1> of a joint"
            elif reference:
                what = f"<mu1> of {reference!r}, which is no link; "
                what += suggest(reference, links)
            done = "it has no effect"
            report.add("warning", "ignored", what, done, where=where, file=file)


def _report_weight(root: ET.Element, report: LoadReport, file: Path) -> None:
    """Report links on which gravity doesn't act in Gazebo."""
    links = [attribute(link, "name") for link in root.iterfind("link")]
    for gazebo in root.iterfind("gazebo"):
        reference = attribute(gazebo, "reference")
        where = f"link {reference!r}"
        said = {e.tag: _value(e) for e in gazebo if e.tag in _WEIGHT}
        for tag, text in said.items():
            if reference not in links:
                what, done = f"<{tag}> of no link", "it has no effect"
                report.add("info", "ignored", what, done, file=file)
            elif (text.lower() in ("true", "yes", "1")) != _WEIGHT[tag]:
                what, done = f"<{tag}> is {text!r}", "it has its weight here"
                report.add("warning", "unsupported", what, done, where=where, file=file)


def _value(element: ET.Element) -> str:
    """Return the value of a tag below `<gazebo>`, an attribute or a text."""
    return attribute(element, "value") or text_of(element)


def _plugins(parent: ET.Element, holder: str) -> Iterator[tuple[str, ET.Element]]:
    for child in parent:
        if child.tag == "plugin":
            yield holder, child
        else:
            yield from _plugins(child, f"{child.tag} {attribute(child, 'name')!r}")


def _fields(parent: ET.Element, path: str) -> Iterator[tuple[str, str]]:
    for child in parent:
        name = path + child.tag
        text = text_of(child)
        if text or not len(child):
            yield name, text
        for key, value in child.items():
            yield f"{name}@{key}", value.strip()
        yield from _fields(child, f"{name}/")


# Those that take all joints where they name none.
_ALL_BY_DEFAULT = (JointTrajectoryController, JointStatePublisher)


def read_joint_plugins(
    plugins: Collection[GazeboPlugin],
    joint_names: Collection[str],
    report: LoadReport,
    file: Path,
) -> tuple[JointPlugin, ...]:
    """Return the plugins that move or report joints, in their order."""
    found = []
    for plugin in plugins:
        if plugin.kind != "other":
            reader = _FieldReader(plugin.place, report, file)
            if (typed := reader.read(plugin, joint_names)) is not None:
                found.append(typed)
    return tuple(found)


class _FieldReader(ElementReader):
    """Reads the fields of one plugin."""

    def read(
        self, plugin: GazeboPlugin, joint_names: Collection[str]
    ) -> JointPlugin | None:
        """Return a plugin with its fields, or None and a line in the report."""
        make: Any = KINDS[plugin.kind]
        values: dict[str, Any] = {}
        known: set[str] = set()
        for field in dc.fields(make):
            tags = field.metadata.get("tags", (field.name,))
            known.update(tags)
            entries = [(tag, text) for tag in tags for text in plugin.texts(tag)]
            if entries:
                values[field.name] = self._value(field, entries)
            if field.metadata.get("joints"):
                names = values.get(field.name, field.default)
                if entries:
                    names = self._joints(names, joint_names)
                values[field.name] = tuple(n for n in names if n in joint_names)
        # An empty one that may hold others, such as <ros/>, says nothing.
        holders = {name.rpartition("/")[0] for name in known}
        unread = sorted({name for name, _ in plugin.fields} - known - holders)
        if unread:
            names = ", ".join(name + _hint(name, known) for name in unread)
            what = f"unknown tags: {names}"
            self.note("info", "ignored", what, "they have no effect")
        typed: JointPlugin = make(**{n: v for n, v in values.items() if v is not None})
        problem = self._problem(plugin, typed)
        if problem is not None:
            self.note("error", "invalid", problem, "the plugin is left out")
            return None
        if isinstance(typed, WheelDrive):
            self._report_crossed(typed)
        return typed

    def _report_crossed(self, typed: WheelDrive) -> None:
        """Report the limits of a drive whose minimum is above their maximum."""
        for kind in ("velocity", "acceleration", "jerk"):
            for name in (kind, f"linear_{kind}", f"angular_{kind}"):
                low = getattr(typed, f"min_{name}", math.nan)
                high = getattr(typed, f"max_{name}", math.nan)
                if low > high:
                    what = f"min_{name}: expected at most max_{name}, {high:g}, "
                    what += f"got {low:g}"
                    self.note("warning", "invalid", what, "the minimum holds")

    def _value(self, field: dc.Field[Any], entries: list[tuple[str, str]]) -> Any:
        """Return the value of a field, or None if its text is none."""
        if field.type == tuple[str, ...]:
            # Of these names, the old form takes a list.
            return tuple(
                name
                for tag, text in entries
                for name in (text.split() if tag == "joint_names" else [text])
            )
        if field.type == tuple[float, ...]:
            numbers = [
                self.number(part, tag) for tag, text in entries for part in text.split()
            ]
            return None if None in numbers else tuple(numbers)
        tag, text = entries[0]
        if field.type is str:
            return text
        if field.type is float:
            return self.number(text, tag)
        if field.type is int:
            number = parse_number(text)
            if number is not None and number.is_integer():
                return int(number)
            return self.expected(tag, "an integer", text)
        value = parse_sdf_bool(text)
        if value is None:
            self.expected(tag, "true or false", text)
        return value

    def _joints(
        self, names: tuple[str, ...], joint_names: Collection[str]
    ) -> tuple[str, ...]:
        for name in names:
            if name not in joint_names:
                what = f"the robot has no joint {name!r}; {suggest(name, joint_names)}"
                self.note("error", "missing", what, "the joint is left out")
        return tuple(name for name in names if name in joint_names)

    def _problem(self, plugin: GazeboPlugin, typed: JointPlugin) -> str | None:
        """Return why Gazebo refuses a plugin, or None."""
        for field in dc.fields(typed):
            if not field.metadata.get("joints") or getattr(typed, field.name):
                continue
            if not typed.needs(field.name):
                continue
            tags = field.metadata["tags"]
            is_present = any(plugin.texts(tag) for tag in tags)
            if is_present:
                names = [name for tag in tags for name in plugin.texts(tag)]
                return f"the robot has none of its joints: {', '.join(names)}"
            if not isinstance(typed, _ALL_BY_DEFAULT):
                return f"no joint; expected <{tags[0]}>"
        if isinstance(typed, JointPositionController) and typed.joint_index:
            return f"joint_index {typed.joint_index}: a joint has one axis, of index 0"
        if isinstance(typed, VelocityControl):
            return _vector_problem(typed, "initial_linear", "initial_angular")
        if isinstance(typed, OdometryPublisher):
            return _odometry_problem(typed)
        if isinstance(typed, WheelDrive):
            return _drive_problem(typed)
        if isinstance(typed, GazeboRosDiffDrive):
            return _classic_problem(plugin, typed)
        if isinstance(typed, GazeboRosAckermannDrive):
            return _ackermann_problem(typed)
        return None


def _hint(tag: str, known: Collection[str]) -> str:
    """Return what a tag that isn't known may have meant, in brackets, or ""."""
    close = find_close(tag, known, MISSPELT)
    return f" (did you mean {close!r}?)" if close else ""


def _odometry_problem(typed: OdometryPublisher) -> str | None:
    if typed.dimensions not in (2, 3):
        return f"dimensions: expected 2 or 3, got {typed.dimensions}"
    problem = _vector_problem(typed, "xyz_offset", "rpy_offset")
    return problem or _topics_problem(typed)


def _vector_problem(typed: JointPlugin, *names: str) -> str | None:
    for name in names:
        if len(numbers := getattr(typed, name)) not in (0, 3):
            return f"{name}: expected three numbers, got {len(numbers)}"
        for number in numbers:
            if not math.isfinite(number):
                return f"{name}: expected finite numbers, got {number:g}"
    return None


def _drive_problem(typed: WheelDrive) -> str | None:
    lengths = {"wheel_separation": (typed.wheel_separation,)}
    if isinstance(typed, MecanumDrive):
        lengths["wheelbase"] = (typed.wheelbase,)
    if isinstance(typed, AckermannSteering):
        lengths["wheel_base"] = (typed.wheel_base,)
        lengths["kingpin_width"] = (typed.kingpin_width,)
        if not 0.0 < typed.steering_limit < math.pi / 2.0:
            expected = "expected an angle above 0 and below a quarter of a turn"
            return f"steering_limit: {expected}, got {typed.steering_limit:g}"
    lengths["wheel_radius"] = (typed.wheel_radius,)
    return _measure_problem(lengths) or _topics_problem(typed)


def _topics_problem(typed: OdometryPublisher | WheelDrive) -> str | None:
    """Return what is wrong with the names of topics of two types."""
    odom, tf = (name.strip("/") for name in (typed.odom_topic, typed.tf_topic))
    return f"odom_topic and tf_topic are both {odom!r}" if odom and odom == tf else None


def _classic_problem(plugin: GazeboPlugin, typed: GazeboRosDiffDrive) -> str | None:
    pairs = max(1, typed.num_wheel_pairs)
    left, right = (len(plugin.texts(tag)) for tag in ("left_joint", "right_joint"))
    if {left, right} != {pairs}:
        expected = f"expected {pairs} left and {pairs} right joints"
        return f"{expected}, got {left} and {right}"
    if {len(typed.left_joints), len(typed.right_joints)} != {pairs}:
        return "the robot lacks one of its joints"
    if typed.odometry_source not in (0, 1):
        expected = "expected 0 (encoder) or 1 (world)"
        return f"odometry_source: {expected}, got {typed.odometry_source}"
    if not typed.max_wheel_torque > 0.0:
        return f"max_wheel_torque: expected more than 0, got {typed.max_wheel_torque:g}"
    if not typed.max_wheel_acceleration >= 0.0:
        acceleration = typed.max_wheel_acceleration
        return f"max_wheel_acceleration: expected at least 0, got {acceleration:g}"
    diameters = tuple(2.0 * radius for radius in typed.radii)
    return _measure_problem(
        {"wheel_separation": typed.separations, "wheel_diameter": diameters}
    )


def _ackermann_problem(typed: GazeboRosAckermannDrive) -> str | None:
    for part in ("right_steering", "left_steering", "linear_velocity"):
        for name, number in ((f"{part}_pid_gain", 3), (f"{part}_i_range", 2)):
            if len(numbers := getattr(typed, name)) not in (0, number):
                word = "three" if number == 3 else "two"
                return f"{name}: expected {word} numbers, got {len(numbers)}"
    for name in ("max_speed", "max_steer", "max_steering_angle"):
        if not 0.0 < (value := getattr(typed, name)) < math.inf:
            return f"{name}: expected a number above 0, got {value:g}"
    return None


def _measure_problem(lengths: Mapping[str, Sequence[float]]) -> str | None:
    """Return why a base with such measures can't drive, or None."""
    for name, values in lengths.items():
        for value in values:
            if not 0.0 < value < math.inf:
                return f"{name}: expected a length above 0 m, got {value:g}"
    return None


# Where it stands as SDF has it.
_FRICTION = ".//surface/friction/ode/mu"

# A link that states no friction, or more, has this coefficient.
_USUAL_FRICTION = 1.0


def read_friction(root: ET.Element, links: Collection[str]) -> dict[str, float]:
    """Return the friction coefficients that links state, at most 1.

    The last of several tags counts. Numbers below 0, or none, are left out.
    """
    found = {}
    for gazebo in root.iterfind("gazebo"):
        link = attribute(gazebo, "reference")
        for path in ("mu1", _FRICTION):
            for element in gazebo.iterfind(path):
                mu = parse_number(_value(element))
                if mu is not None and mu >= 0.0 and link in links:
                    found[link] = min(mu, _USUAL_FRICTION)
    return found
