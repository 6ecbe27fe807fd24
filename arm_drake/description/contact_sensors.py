"""Contact sensors ("bumpers") of `<gazebo>` tags as systems of the robot.

Sources: gz-sim, src/systems/contact/Contact.cc; gazebo_ros_pkgs, branch ros2,
gazebo_plugins/src/gazebo_ros_bumper.cpp.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from arm_drake.description.controller_manager import ControllerConfig
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.gazebo_bumpers import ContactSensorTag, shape_name
from arm_drake.description.gazebo_sensors import CONTACT, GazeboSensor, referred_link
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import suggest

# What they are called where a controller's type is.
CLASSIC_TYPE = "gazebo_plugins/GazeboRosBumper"
SIM_TYPE = "gz::sim::systems::Contact"

_WORLD = "world"


def add_contact_sensors(
    description: RobotDescription, config: ControllerManagerConfig, report: LoadReport
) -> ControllerManagerConfig:
    """Return the controllers of a robot, and its contact sensors among them.

    Args:
        description: The robot.
        config: Its controllers.
        report: Where sensors are recorded that have nothing to feel with.
    """
    if not any(sensor.type == CONTACT for sensor in description.gazebo_sensors):
        return config
    shapes = _shapes(description)
    names = {controller.name for controller in config.controllers}
    added = []
    for sensor in description.gazebo_sensors:
        if sensor.type != CONTACT:
            continue
        tag = _make_tag(sensor, shapes, description, report)
        if tag is None:
            continue
        name, number = tag.name, 2
        while name in names:
            name, number = f"{tag.name}_{number}", number + 1
        names.add(name)
        kind = CLASSIC_TYPE if tag.is_classic else SIM_TYPE
        added.append(
            ControllerConfig(name, kind, {}, description.file, 1, plugins=(tag,))
        )
    return dc.replace(config, controllers=(*config.controllers, *added))


def _make_tag(
    sensor: GazeboSensor,
    shapes: Mapping[str, tuple[str, ...]],
    description: RobotDescription,
    report: LoadReport,
) -> ContactSensorTag | None:
    """Return a sensor with the shapes that it feels with, or None."""
    where, file = f"contact sensor {sensor.name!r}", description.file
    link = referred_link(sensor.reference, description.links, description.joints)
    if link not in description.links:
        what = f"its reference is no link, {sensor.reference!r}"
        right = suggest(sensor.reference, description.links)
        report.add(
            "error", "missing", f"{what}; {right}", "left out", where=where, file=file
        )
        return None
    every = {shape: owner for owner, names in shapes.items() for shape in names}
    own = shapes.get(link, ())
    whole = _undivided(description)
    named = [
        shape
        for name in sensor.collisions
        if name in every
        for shape in (shapes[every[name]] if every[name] in whole else (name,))
    ]
    felt = tuple(f"{every[name]}::{name}" for name in named)
    for name in sensor.collisions:
        if name not in every:
            what = f"the robot has no collision shape {name!r}"
            right = f"link {link!r} has {', '.join(own) or 'none'}"
            done = "it feels with these" if not felt else "it feels with the others"
            report.add(
                "warning", "missing", f"{what}; {right}", done, where=where, file=file
            )
    felt = felt or tuple(f"{link}::{name}" for name in own)
    if not felt:
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
        felt,
        sensor.topic,
        plugin is not None,
        "" if frame == _WORLD else frame,
        next(iter(texts("ros/namespace")), ""),
        texts("ros/remapping"),
    )


def _undivided(description: RobotDescription) -> set[str]:
    """Return the links that have one collision shape as written.

    In the plant its mesh may be several convex parts.
    """
    root = ET.fromstring(description.source)  # noqa: S314  parsed before.
    links = root.iterfind("link")
    return {n.get("name", "") for n in links if len(n.findall("collision")) == 1}


def _shapes(description: RobotDescription) -> dict[str, tuple[str, ...]]:
    """Return the names of the collision shapes of all links."""
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    found = {}
    for link in root.iterfind("link"):
        name, count = link.get("name", ""), len(link.findall("collision"))
        found[name] = tuple(shape_name(name, number) for number in range(count))
    return found
