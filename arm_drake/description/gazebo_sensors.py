"""`<sensor>` tags in `<gazebo>` tags of a URDF: what is measured, and where.

Sources of the fields: SDFormat, sdf/1.11/sensor.sdf, contact.sdf, forcetorque.sdf;
gazebo_ros_pkgs, branch ros2, gazebo_plugins/src/gazebo_ros_bumper.cpp.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Final

from arm_drake.description.elements import attribute, parse_bool, parse_number, text_of
from arm_drake.description.gazebo import GazeboPlugin, read_plugins
from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport

CONTACT: Final = "contact"


@dc.dataclass(frozen=True)
class GazeboSensor:
    """A `<sensor>` tag below `<gazebo>`."""

    name: str

    # Such as "imu", "contact", "force_torque".
    type: str

    # Link or joint that the `<gazebo>` tag refers to.
    reference: str

    # Pose in that link: x, y, z [m], roll, pitch, yaw [rad].
    pose: tuple[float, float, float, float, float, float] = (0.0,) * 6

    # Topic that it names; empty is Gazebo's default.
    topic: str = ""

    # Collision shapes that a contact sensor feels with.
    collisions: tuple[str, ...] = ()

    # Whether a force is what the parent does to the child, not the other way round.
    is_on_child: bool = False

    # Whether forces are along the axes of the sensor, not of the child link.
    is_in_sensor: bool = False

    plugins: tuple[GazeboPlugin, ...] = ()

    @property
    def bumper(self) -> GazeboPlugin | None:
        """The plugin of Gazebo Classic that publishes contacts, if it has one."""
        return next((p for p in self.plugins if p.is_bumper), None)


def read_gazebo_sensors(
    root: ET.Element, report: LoadReport, file: Path
) -> tuple[GazeboSensor, ...]:
    """Return the sensors in the `<gazebo>` tags of a URDF.

    Args:
        root: The `<robot>` element.
        report: Where poses that can't be read are recorded.
        file: File to name there.
    """
    return tuple(
        GazeboSensor(
            name=attribute(element, "name"),
            type=attribute(element, "type"),
            reference=attribute(gazebo, "reference"),
            pose=_pose(element, report, file),
            topic=text_of(element, "topic")
            or text_of(element.find("contact"), "topic"),
            collisions=tuple(
                text_of(collision)
                for collision in element.iterfind("contact/collision")
            ),
            is_on_child=_says(element, "measure_direction", "parent_to_child"),
            is_in_sensor=_says(element, "frame", "sensor"),
            plugins=tuple(read_plugins(element, attribute(gazebo, "reference"))),
        )
        for gazebo in root.iterfind("gazebo")
        for element in gazebo.iterfind("sensor")
    )


def referred_link(
    reference: str, links: Collection[str], joints: Iterable[JointInfo]
) -> str:
    """Return the link that a `<gazebo>` tag refers to: of a joint its child.

    Args:
        reference: Name of a link or joint, links before joints; else it is returned.
        links: Links of the robot.
        joints: Its joints.
    """
    if reference in links:
        return reference
    return {joint.name: joint.child for joint in joints}.get(reference, reference)


def _says(element: ET.Element, tag: str, value: str) -> bool:
    """Return whether a sensor of forces has a tag with this text."""
    return text_of(element.find("force_torque"), tag) == value


def _pose(
    element: ET.Element, report: LoadReport, file: Path
) -> tuple[float, float, float, float, float, float]:
    tag = element.find("pose")
    text = text_of(element, "pose")
    numbers = [parse_number(part) for part in text.split()]
    known = [n for n in numbers if n is not None and math.isfinite(n)]
    if not text:
        known = [0.0] * 6
    elif len(numbers) != 6 or len(known) != 6:
        what = f"pose: expected x, y, z, roll, pitch, yaw, got {text!r}"
        where = f"sensor {attribute(element, 'name')!r}"
        done = "it is where its link is"
        report.add("warning", "invalid", what, done, where=where, file=file)
        known = [0.0] * 6
    if tag is not None and attribute(tag, "relative_to"):
        what = f"pose: relative_to {attribute(tag, 'relative_to')!r}"
        where = f"sensor {attribute(element, 'name')!r}"
        done = "it is taken as relative to the link"
        report.add("warning", "ignored", what, done, where=where, file=file)
    if tag is not None and parse_bool(attribute(tag, "degrees")):
        known[3:] = map(math.radians, known[3:])
    x, y, z, roll, pitch, yaw = known
    return (x, y, z, roll, pitch, yaw)
