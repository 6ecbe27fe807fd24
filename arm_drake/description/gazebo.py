"""`<gazebo>` tags of a URDF: its plugins, and what has no effect here.

Three generations of Gazebo have plugins of their own: Gazebo Classic, Ignition Gazebo
and Gazebo Sim ("gz"). What a plugin is for is told by the name of its library and, from
Ignition on, of its class. The fields of those that concern joints are in
gazebo_joints.
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
    def kind(self) -> GazeboPluginKind:
        """What the plugin is for; "other" if it neither moves nor reports joints."""
        library = re.split(r"[/\\]", self.filename)[-1]
        library = library.removesuffix(".so").removeprefix("lib")
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
        GazeboPlugin(
            name=attribute(plugin, "name"),
            filename=attribute(plugin, "filename"),
            fields=tuple(_fields(plugin, "")),
            reference=attribute(gazebo, "reference"),
            holder=holder,
        )
        for gazebo in root.iterfind("gazebo")
        for holder, plugin in _plugins(gazebo, "")
    )


def report_gazebo(
    root: ET.Element,
    report: LoadReport,
    file: Path,
    *,
    simulated: Collection[str] = ("ros2_control",),
) -> None:
    """Report the content of `<gazebo>` tags that has no effect, in two lines.

    Args:
        root: The `<robot>` element.
        report: Where the lines are added.
        file: File to name in them.
        simulated: Kinds of plugins that the simulator stands in for.
    """
    plugins = collections.Counter(
        repr(plugin.filename or plugin.name)
        for plugin in read_gazebo_plugins(root)
        if plugin.kind not in simulated
    )
    tags = collections.Counter(
        f"<{child.tag.rpartition('}')[2]}>" + _sensor_type(child)
        for gazebo in root.iterfind("gazebo")
        for child in gazebo
        if child.tag != "plugin"
    )
    for sort, counts in (("Gazebo plugins", plugins), ("<gazebo> tags", tags)):
        names = ", ".join(
            f"{name} ({count} times)" if count > 1 else name
            for name, count in counts.items()
        )
        if names:
            what = f"{sort} {names}"
            report.add("info", "ignored", what, "they have no effect", file=file)


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
