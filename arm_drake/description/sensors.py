"""Sensors of a robot: quantities, frames, and Gazebo's sensors as controllers.

A `<sensor>` of `<ros2_control>` has names of values and no place. The place is looked
for where robots' authors write it. Contact sensors ("bumpers") and IMUs of `<gazebo>`
tags are systems of the robot.

Sources: gz-sim, src/systems/contact/Contact.cc, imu/Imu.cc; gz-transport,
src/TopicUtils.cc; gazebo_ros_pkgs, branch ros2,
gazebo_plugins/src/gazebo_ros_bumper.cpp, gazebo_ros_imu_sensor.cpp.
"""

import dataclasses as dc
import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from arm_drake import interfaces
from arm_drake.description.controllers import ControllerConfig, ControllerManagerConfig
from arm_drake.description.elements import free_name
from arm_drake.description.gazebo_plugins import (
    ContactSensorTag,
    ImuSensorTag,
    shape_name,
)
from arm_drake.description.gazebo_sensors import (
    CONTACT,
    IMU,
    GazeboSensor,
    referred_link,
)
from arm_drake.description.links import Pose
from arm_drake.description.report import LoadReport, Severity
from arm_drake.description.ros2_control import ComponentInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import suggest
from arm_drake.importing import dataclass

_ORIGIN: Final[Pose] = (0.0,) * 6

# Parameters of controllers that name a sensor, and those that name its frame.
_NAMES = {
    "sensor_name": "frame_id",
    "ft_sensor.name": "ft_sensor.frame.id",
    **{f"interface_names.{name}": "frame_id" for name in interfaces.FORCES},
}
_POSE_NAME, _POSE_LINK, _POSE_FRAME = "pose_name", "tf.child_frame_id", "frame_id"

# Gazebo's type of a sensor of forces.
_FORCE_TYPE: Final = "force_torque"

# What is put behind the name of a sensor to name its link.
_ENDINGS = ("", "_link", "_frame")

_STORED = "its states keep their initial values"


@dataclass(frozen=True)
class SensorInfo:
    """A sensor that measures something of the physics."""

    name: str

    # Names of its state interfaces that are measured, such as "force.x".
    interfaces: tuple[str, ...]

    # Where it sits: a link, and its pose in that.
    link: str
    pose: Pose = _ORIGIN

    # Joint whose load is measured: the one that carries the link; "" if none does.
    joint: str = ""

    # Whether forces are those of the parent on the child, not the other way round.
    is_on_child: bool = False

    # Link in which positions and orientations are given; "" is the world.
    reference: str = ""


def find_sensors(
    description: RobotDescription, config: ControllerManagerConfig, report: LoadReport
) -> tuple[SensorInfo, ...]:
    """Return the sensors of `<ros2_control>` that measure something.

    A sensor sits, in this order, where the Gazebo sensor of its name does; in the link
    that its `<param name="frame_id">` names; in the frame that a controller gives for
    it (`frame_id` beside `sensor_name`, `tf.child_frame_id` beside `pose_name`,
    `ft_sensor.frame.id`); in the link called as it is, with "_link" or "_frame" behind.
    """
    places = _Places(description, config, report)
    found = []
    for block in description.hardware:
        for sensor in block.sensors:
            names = tuple(
                interface.name
                for interface in sensor.state_interfaces
                if interface.name in interfaces.MEASURED
                and interface.data_type == "double"
            )
            if names and (info := places.place(sensor, names)) is not None:
                found.append(info)
    return tuple(found)


class _Place(NamedTuple):
    """Possible place of a sensor."""

    # Name of a link; not always of one that there is.
    link: str
    pose: Pose = _ORIGIN
    is_on_child: bool = False

    # Who says so, and in which file.
    source: str = ""
    file: str | None = None

    @property
    def problem(self) -> str:
        """Problem of the place, if there is no such link."""
        return f"{self.source} names no link: {self.link!r}"


@dataclass(frozen=True)
class _Places:
    """Finds out where sensors are."""

    description: RobotDescription
    config: ControllerManagerConfig
    report: LoadReport

    @functools.cached_property
    def _carriers(self) -> Mapping[str, str]:
        """The joints that carry links, by these."""
        joints = self.description.joints
        return {j.child: j.name for j in joints if j.type != "floating"}

    def place(self, sensor: ComponentInfo, names: tuple[str, ...]) -> SensorInfo | None:
        """Return a sensor with its place, or None and a line in the report."""
        where = f"sensor {sensor.name!r}"
        links, file = self.description.links, str(self.description.file)
        wrong: list[_Place] = []
        for place in self._candidates(sensor):
            if place.link in links:
                break
            wrong.append(place)
        else:
            severity: Severity = "error" if wrong else "warning"
            what, first = "nothing says which link it is on", sensor.name
            if wrong:
                what, first = wrong[0].problem, wrong[0].link
                file = wrong[0].file or file
            what += (
                '; expected a <gazebo> sensor of its name, <param name="frame_id">, or '
                f"the frame_id of a controller that reads it; {suggest(first, links)}"
            )
            self.report.add(severity, "missing", what, _STORED, where=where, file=file)
            return None
        for other in wrong:
            done = f"it is measured in {place.link!r}, as {place.source} has it"
            at, what = other.file or file, other.problem
            self.report.add("warning", "invalid", what, done, where=where, file=at)
        joint = self._carriers.get(place.link, "")
        if not joint and any(name in interfaces.FORCES for name in names):
            what = f"link {place.link!r} is held by no joint that carries a load"
            at = place.file or file
            self.report.add("error", "invalid", what, _STORED, where=where, file=at)
            return None
        return SensorInfo(
            sensor.name,
            names,
            place.link,
            place.pose,
            joint,
            is_on_child=place.is_on_child,
            reference=self._reference(sensor.name, names),
        )

    def _candidates(self, sensor: ComponentInfo) -> Iterator[_Place]:
        """Yield where a sensor may be, the surest place first."""
        name, links = sensor.name, self.description.links
        for tag in self.description.gazebo_sensors:
            if tag.name == name and _measures_like(tag, sensor):
                yield self._of_tag(tag)
        if frame := sensor.parameters.get("frame_id", ""):
            yield _Place(frame, source="its parameter frame_id")
        for controller in self.config.controllers:
            yield from _frames(controller, name)
        for ending in _ENDINGS:
            if name + ending in links:
                yield _Place(name + ending, source="its name")

    def _of_tag(self, tag: GazeboSensor) -> _Place:
        # Classic's sensors of forces refer to a joint.
        robot = self.description
        link = referred_link(tag.reference, robot.links, robot.joints)
        pose = tag.pose
        if tag.type == _FORCE_TYPE:
            # At the joint, along the axes of the child or of the sensor.
            pose = (0.0, 0.0, 0.0, *pose[3:]) if tag.is_in_sensor else _ORIGIN
        source = "the reference of its <gazebo> tag"
        return _Place(link, pose, tag.is_on_child, source)

    def _reference(self, name: str, names: Sequence[str]) -> str:
        """Return the reference link of a pose."""
        if not any(n in interfaces.POSITIONS for n in names):
            return ""
        for controller in self.config.controllers:
            values = _values(controller)
            frame = values.get(_POSE_FRAME, "")
            if values.get(_POSE_NAME) == name and frame in self.description.links:
                return frame
        return ""


def _measures_like(tag: GazeboSensor, sensor: ComponentInfo) -> bool:
    """Return whether a Gazebo sensor may be the same as one of `<ros2_control>`."""
    names = {interface.name for interface in sensor.state_interfaces}
    rows = interfaces.SENSORS.items()
    expected = [types for row, types in rows if types and row[0] in names]
    return not expected or not tag.type or any(tag.type in types for types in expected)


def _frames(controller: ControllerConfig, name: str) -> Iterator[_Place]:
    """Yield the frame that a controller gives for a sensor that it reads."""
    values = _values(controller)
    for parameter, frame in _NAMES.items():
        frame_id = values.get(parameter, "")
        if parameter.startswith("interface_names"):
            frame_id = frame_id.rpartition("/")[0]
        if frame_id == name and values.get(frame):
            yield _place_from_parameter(controller, frame)
    if values.get(_POSE_NAME) == name and values.get(_POSE_LINK):
        yield _place_from_parameter(controller, _POSE_LINK)


def _place_from_parameter(controller: ControllerConfig, parameter: str) -> _Place:
    value = controller.parameters[parameter]
    source = f"{parameter} of controller {controller.name!r}"
    return _Place(value.value, source=source, file=str(value.file))


def _values(controller: ControllerConfig) -> Mapping[str, str]:
    """Return the parameters of a controller that are texts."""
    parameters = controller.parameters.items()
    return {n: p.value for n, p in parameters if isinstance(p.value, str)}


def accelerating_joints(description: RobotDescription) -> tuple[str, ...]:
    """Return the movable joints that report an acceleration."""
    names = {
        joint.name
        for block in description.hardware
        for joint in block.joints
        if any(i.name == interfaces.ACCELERATION for i in joint.state_interfaces)
    }
    return tuple(j.name for j in description.movable_joints if j.name in names)


def sensed_names(
    sensors: Sequence[SensorInfo], accelerations: Sequence[str]
) -> tuple[str, ...]:
    """Return the names of what sensors measure, "<sensor>/<interface>"."""
    names = [
        f"{sensor.name}/{name}" for sensor in sensors for name in sensor.interfaces
    ]
    joints = interfaces.interface_names(accelerations, [interfaces.ACCELERATION])
    return (*names, *joints)


# What they are called where a controller's type is, in Gazebo Sim and Classic.
_TYPES: Final[Mapping[type, tuple[str, str]]] = {
    ContactSensorTag: ("gz::sim::systems::Contact", "gazebo_plugins/GazeboRosBumper"),
    ImuSensorTag: ("gz::sim::systems::Imu", "gazebo_plugins/GazeboRosImuSensor"),
}

_WORLD = "world"

# What a topic of Gazebo Sim can't have in its name.
_NOT_IN_TOPICS = re.compile(" |@|~|//|:=")


def add_gazebo_sensors(
    description: RobotDescription, config: ControllerManagerConfig, report: LoadReport
) -> ControllerManagerConfig:
    """Return the controllers of a robot; its contact sensors and IMUs among them."""
    if not any(each.type in (CONTACT, IMU) for each in description.gazebo_sensors):
        return config
    shapes = {
        link.name: tuple(shape_name(link.name, n) for n in range(len(link.collisions)))
        for link in description.link_infos
    }
    names = {controller.name for controller in config.controllers}
    added = []
    for sensor in description.gazebo_sensors:
        tag: ContactSensorTag | ImuSensorTag | None = None
        if sensor.type == CONTACT:
            tag = _make_contact_sensor(sensor, shapes, description, report)
        elif sensor.imu is not None:
            tag = _make_imu(sensor, sensor.imu, description, config, report)
        if tag is None:
            continue
        name = free_name(tag.name, names.__contains__)
        names.add(name)
        kind = _TYPES[type(tag)][tag.is_classic]
        added.append(
            ControllerConfig(name, kind, {}, description.file, 1, plugins=(tag,))
        )
    return dc.replace(config, controllers=(*config.controllers, *added))


def _find_link(
    sensor: GazeboSensor, noun: str, description: RobotDescription, report: LoadReport
) -> str:
    """Return the link that a sensor's tag refers to, or "" and a line in the report."""
    link = referred_link(sensor.reference, description.links, description.joints)
    if link in description.links:
        return link
    where, file = f"{noun} {sensor.name!r}", description.file
    what = f"its reference is no link, {sensor.reference!r}; "
    what += suggest(sensor.reference, description.links)
    report.add("error", "missing", what, "left out", where=where, file=file)
    return ""


def _make_imu(
    sensor: GazeboSensor,
    imu: ImuSensorTag,
    description: RobotDescription,
    config: ControllerManagerConfig,
    report: LoadReport,
) -> ImuSensorTag | None:
    """Return an IMU in its place, or None; what it can't be is reported."""
    link = _find_link(sensor, "IMU", description, report)
    if not link:
        return None
    where, file, links = f"IMU {sensor.name!r}", description.file, description.links
    if imu.frame_id and imu.frame_id not in (*links, _WORLD):
        what = f"its frame {imu.frame_id!r} is no link; {suggest(imu.frame_id, links)}"
        done = "its messages name it all the same"
        report.add("warning", "missing", what, done, where=where, file=file)
    if not imu.is_classic and _NOT_IN_TOPICS.search(imu.topic):
        what = f"topic {imu.topic!r}: expected one without spaces, @, ~, // and :="
        done = "they are taken out of its name, as by Gazebo"
        report.add("warning", "invalid", what, done, where=where, file=file)
    if imu.update_rate > config.update_rate:
        what = f"update_rate {imu.update_rate:g} Hz, above the controller manager's"
        done = f"it measures at {config.update_rate} Hz, in each of its cycles"
        report.add("warning", "unsupported", what, done, where=where, file=file)
    name = sensor.name or link
    return dc.replace(imu, name=name, link=link, pose=sensor.pose, merged=sensor.merged)


def imu_tags(config: ControllerManagerConfig) -> dict[str, ImuSensorTag]:
    """Return the IMUs of `<gazebo>` tags by the names of their controllers."""
    return {
        controller.name: tag
        for controller in config.controllers
        for tag in controller.plugins
        if isinstance(tag, ImuSensorTag)
    }


def _make_contact_sensor(
    sensor: GazeboSensor,
    shapes: Mapping[str, tuple[str, ...]],
    description: RobotDescription,
    report: LoadReport,
) -> ContactSensorTag | None:
    """Return a sensor with the shapes that it feels with, or None."""
    where, file = f"contact sensor {sensor.name!r}", description.file
    link = _find_link(sensor, "contact sensor", description, report)
    if not link:
        return None
    every = {shape: owner for owner, names in shapes.items() for shape in names}
    own = shapes.get(link, ())
    named: list[str] = []
    for name in filter(every.__contains__, sensor.collisions):
        is_whole = every[name] in description.undivided
        named += shapes[every[name]] if is_whole else (name,)
    used = tuple(f"{every[name]}::{name}" for name in named)
    for name in sensor.collisions:
        if name not in every:
            what = f"the robot has no collision shape {name!r}; "
            what += f"link {link!r} has {', '.join(own) or 'none'}"
            done = "it feels with these" if not used else "it feels with the others"
            report.add("warning", "missing", what, done, where=where, file=file)
    used = used or tuple(f"{link}::{name}" for name in own)
    if not used:
        what = f"link {link!r} has no <collision>; it has nothing to feel with"
        report.add("error", "invalid", what, "left out", where=where, file=file)
        return None
    plugin = sensor.bumper

    def texts(tag: str) -> tuple[str, ...]:
        return () if plugin is None else plugin.texts(tag)

    frame = next(iter(texts("frame_name")), "")
    if frame and frame != _WORLD and frame not in description.links:
        what = f"frame_name: no link {frame!r}; {suggest(frame, description.links)}"
        done = "contacts are told in the world's frame"
        report.add("warning", "missing", what, done, where=where, file=file)
        frame = ""
    return ContactSensorTag(
        sensor.name or link,
        link,
        used,
        sensor.topic,
        plugin is not None,
        "" if frame == _WORLD else frame,
        next(iter(texts("ros/namespace")), ""),
        texts("ros/remapping"),
    )
