"""`<gazebo>` tags of a URDF: its plugins, and what has no effect here.

Three generations of Gazebo have plugins of their own: Gazebo Classic, Ignition Gazebo
and Gazebo Sim ("gz"). What a plugin is for is told by the name of its library and, from
Ignition on, of its class. The fields of those that concern joints are in
gazebo_joints and gazebo_drives.
"""

import collections
import dataclasses as dc
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Literal, get_args

from arm_drake.description.elements import attribute, text_of
from arm_drake.description.report import LoadReport

GazeboPluginKind = Literal[
    "ros2_control",
    "joint_position_controller",
    "joint_controller",
    "joint_trajectory_controller",
    "joint_state_publisher",
    "diff_drive",
    "gazebo_ros_joint_state_publisher",
    "gazebo_ros_joint_pose_trajectory",
    "gazebo_ros_diff_drive",
    "other",
]

# Libraries, without "lib" and ".so".
_ROS2_CONTROL = re.compile(r"gazebo_ros2_control|(ign|gz)_ros2_control-system")
_SYSTEM = re.compile(r"(gz-sim|ignition-gazebo)\d*-(?P<kind>[a-z-]+)-system")
_CLASS = re.compile(r"(gz::sim|ignition::gazebo)(::v\d+)?::systems::(?P<kind>\w+)")


@dc.dataclass(frozen=True)
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

    @property
    def is_bumper(self) -> bool:
        """Whether it publishes what a contact sensor of Gazebo Classic feels."""
        return self._library == "gazebo_ros_bumper"

    @property
    def _library(self) -> str:
        """Its library without "lib" and ".so"."""
        library = re.split(r"[/\\]", self.filename)[-1]
        return library.removesuffix(".so").removeprefix("lib")

    @property
    def kind(self) -> GazeboPluginKind:
        """What the plugin is for; "other" if it neither moves nor reports joints."""
        library = self._library
        if _ROS2_CONTROL.fullmatch(library):
            return "ros2_control"
        if match := _SYSTEM.fullmatch(library):
            kind = match["kind"].replace("-", "_")
        elif match := _CLASS.fullmatch(self.name):
            kind = re.sub(r"(?<=.)(?=[A-Z])", "_", match["kind"]).lower()
        else:
            kind = library if library.startswith("gazebo_ros_") else "other"
        return next((k for k in get_args(GazeboPluginKind) if k == kind), "other")


def read_gazebo_plugins(root: ET.Element) -> tuple[GazeboPlugin, ...]:
    """Return the plugins in the `<gazebo>` tags of a URDF, those of sensors included.

    Args:
        root: The `<robot>` element.
    """
    return tuple(
        plugin
        for gazebo in root.iterfind("gazebo")
        for plugin in read_plugins(gazebo, attribute(gazebo, "reference"))
    )


def read_plugins(parent: ET.Element, reference: str) -> Iterator[GazeboPlugin]:
    """Yield the plugins below an element.

    Args:
        parent: A `<gazebo>` tag, or a `<sensor>` in one.
        reference: Link or joint that the `<gazebo>` tag refers to.
    """
    for holder, plugin in _plugins(parent, ""):
        yield GazeboPlugin(
            name=attribute(plugin, "name"),
            filename=attribute(plugin, "filename"),
            fields=tuple(_fields(plugin, "")),
            reference=reference,
            holder=holder,
        )


def report_gazebo(
    root: ET.Element,
    report: LoadReport,
    file: Path,
    *,
    simulated: Collection[str] = ("ros2_control",),
    sensors: Collection[str] = (),
) -> None:
    """Report the content of `<gazebo>` tags that has no effect, in two lines.

    Args:
        root: The `<robot>` element.
        report: Where the lines are added.
        file: File to name in them.
        simulated: Kinds of plugins that the simulator stands in for.
        sensors: Names of sensors that measure.
    """
    plugins = collections.Counter(
        repr(plugin.filename or plugin.name)
        for plugin in read_gazebo_plugins(root)
        if plugin.kind not in simulated
        and not (plugin.is_bumper and plugin.holder in map(_holder, sensors))
    )
    tags = collections.Counter(
        f"<{child.tag.rpartition('}')[2]}>" + _sensor_type(child)
        for gazebo in root.iterfind("gazebo")
        for child in gazebo
        if child.tag not in ("plugin", "mu1")  # Friction has an effect.
        and not (child.tag == "sensor" and attribute(child, "name") in sensors)
    )
    for sort, counts in (("Gazebo plugins", plugins), ("<gazebo> tags", tags)):
        names = ", ".join(
            f"{name} ({count} times)" if count > 1 else name
            for name, count in counts.items()
        )
        if names:
            what = f"{sort} {names}"
            report.add("info", "ignored", what, "they have no effect", file=file)


def _holder(sensor: str) -> str:
    """Return what the plugins of a sensor say of their holder."""
    return f"sensor {sensor!r}"


def _sensor_type(element: ET.Element) -> str:
    is_sensor = element.tag == "sensor"
    return f" of type {attribute(element, 'type')!r}" if is_sensor else ""


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
