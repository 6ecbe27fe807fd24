"""YAML files of a ros_gz_bridge: which topics of ROS and of Gazebo are one.

Source: ros_gz, branch ros2, ros_gz_bridge (README.md, src/bridge_config.cpp,
ros_gz_bridge/mappings.py); older names are those of ros_ign_bridge.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import yaml

from arm_drake import yaml_files
from arm_drake.description.control_files import files_in_config
from arm_drake.description.entry import Source, configs_folder, listed, text_of
from arm_drake.description.gazebo_plugins import Ros2ControlPlugin
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import suggest
from arm_drake.importing import dataclass

Direction = Literal["ROS_TO_GZ", "GZ_TO_ROS", "BIDIRECTIONAL"]

_DIRECTIONS: Mapping[str, Direction] = {
    "ROS_TO_GZ": "ROS_TO_GZ",
    "GZ_TO_ROS": "GZ_TO_ROS",
    "BIDIRECTIONAL": "BIDIRECTIONAL",
    "ROS_TO_IGN": "ROS_TO_GZ",
    "IGN_TO_ROS": "GZ_TO_ROS",
}

# Types of messages that are carried: of ROS, and of Gazebo without its package.
_TYPES = {
    "std_msgs/msg/Float64": "Double",
    "std_msgs/msg/Float32": "Float",
    "trajectory_msgs/msg/JointTrajectory": "JointTrajectory",
    "sensor_msgs/msg/JointState": "Model",
    "sensor_msgs/msg/Imu": "IMU",
    "sensor_msgs/msg/Image": "Image",
    "sensor_msgs/msg/CameraInfo": "CameraInfo",
    "sensor_msgs/msg/LaserScan": "LaserScan",
    "sensor_msgs/msg/PointCloud2": "PointCloudPacked",
    "std_msgs/msg/Bool": "Boolean",
    "geometry_msgs/msg/Twist": "Twist",
    "geometry_msgs/msg/TwistStamped": "Twist",
    "nav_msgs/msg/Odometry": "Odometry",
    "tf2_msgs/msg/TFMessage": "Pose_V",
}

_NAMES = ("ros_topic_name", "gz_topic_name", "ign_topic_name", "topic_name")
_TYPE_NAMES = ("ros_type_name", "gz_type_name", "ign_type_name")

# How messages are passed on; nothing here depends on it.
_QUIET = (
    "lazy",
    "publisher_queue",
    "subscriber_queue",
    "qos_profile",
    "publish_optical_frame",
    "frame_id",
)
_SERVICE = ("service_name", "gz_req_type_name", "gz_rep_type_name")
_KEYS = (*_NAMES, *_TYPE_NAMES, "direction", *_QUIET, *_SERVICE)

# What every such file has.
_MENTIONS = re.compile(rf"\b({'|'.join((*_NAMES, *_TYPE_NAMES))})\b")

_LEFT_OUT = "the entry is left out"


@dataclass(frozen=True)
class TopicAlias:
    """A topic of ROS that a bridge connects with one of Gazebo."""

    # Full names, with a slash in front; in ROS one without is in the name space of the
    # robot's nodes.
    ros_name: str
    gz_name: str

    direction: Direction
    file: Path
    line: int

    @property
    def place(self) -> str:
        """File and line of the entry, for messages."""
        return f"{self.file}:{self.line}"

    @property
    def is_to_gz(self) -> bool:
        """Whether what is published in ROS reaches Gazebo."""
        return self.direction != "GZ_TO_ROS"

    @property
    def is_to_ros(self) -> bool:
        """Whether what Gazebo publishes can be read in ROS."""
        return self.direction != "ROS_TO_GZ"


def remapped_topics(description: RobotDescription) -> tuple[TopicAlias, ...]:
    """Return what ros2_control's plugin in Gazebo calls topics of controllers.

    Its `<ros>` has remappings such as `base/cmd_vel:=cmd_vel`, with names in the name
    space of the controller manager, or full ones.
    """
    aliases = []
    for plugin in description.joint_plugins:
        if not isinstance(plugin, Ros2ControlPlugin):
            continue
        space = plugin.namespace.strip("/")
        for rule in plugin.remappings:
            source, _, target = (part.strip() for part in rule.partition(":="))
            old, new = source.strip("/"), target.strip("/")
            if space:
                old, new = (n.removeprefix(f"{space}/") for n in (old, new))
            if old and new and old != new and not source.startswith("~"):
                names = f"/{new}", f"/{old}"
                alias = TopicAlias(*names, "BIDIRECTIONAL", description.file, 1)
                aliases.append(alias)
    return tuple(aliases)


def split_bridges(
    sources: Source | Sequence[Source] | None,
) -> tuple[list[Path], list[Path] | None]:
    """Return which of the files that a user names are bridges, and the others.

    Bridges alone leave None: nothing is said of the controllers.
    """
    if sources is None:
        return [], None
    files = listed(sources)
    bridges = [file for file in files if _is_bridge(file)]
    others = [file for file in files if file not in bridges]
    return bridges, others if others or not files else None


def find_bridge_files(
    description: RobotDescription,
    packages: PackageFinder,
    bundled: str | None,
    report: LoadReport,
) -> list[Path]:
    """Return the bridges in the config folder of the description's package."""
    if bundled is not None:
        files = sorted((configs_folder() / bundled).glob("**/*.y*ml"))
    else:
        files = files_in_config(description.file, packages)
    return [path for path in files if _is_bridge(path, report)]


def load_bridges(files: Sequence[Path], report: LoadReport) -> tuple[TopicAlias, ...]:
    """Return the topics that bridges connect, in the order of the files."""
    aliases: dict[tuple[str, ...], TopicAlias] = {}
    for file in files:
        for alias in _Bridge(file, report).aliases():
            # Several files may have the same entry.
            key = (alias.ros_name, alias.gz_name, alias.direction)
            aliases.setdefault(key, alias)
    return tuple(aliases.values())


def _is_bridge(path: Path, report: LoadReport | None = None) -> bool:
    """Return whether a file is a list of bridged topics."""
    text = text_of(path)
    if not _MENTIONS.search(text):
        return False
    try:
        root = yaml_files.compose(text)
    except yaml_files.YamlError as error:
        if report is not None:
            done = "topics that it may bridge have their own names alone"
            what, line = error.problem, error.line
            report.add("warning", "invalid", what, done, file=path, line=line)
        return False
    return isinstance(root, yaml.SequenceNode) and any(
        isinstance(item, yaml.MappingNode) and _MENTIONS.search(str(key.value))
        for item in root.value
        for key, _ in (item.value if isinstance(item, yaml.MappingNode) else ())
    )


class _InvalidEntryError(ValueError):
    """An entry of a bridge can't be used."""

    def __init__(self, problem: str, node: yaml.Node | None = None) -> None:
        super().__init__(problem)
        self.node = node


@dataclass(frozen=True)
class _Bridge:
    """Makes aliases of the entries of one file."""

    file: Path
    report: LoadReport

    def aliases(self) -> list[TopicAlias]:
        root = yaml_files.compose(text_of(self.file))
        assert isinstance(root, yaml.SequenceNode)
        found = []
        for index, node in enumerate(root.value):
            try:
                alias = self._alias(index, node)
            except (_InvalidEntryError, yaml_files.YamlError) as error:
                at = getattr(error, "node", None) or node
                self._add("warning", "invalid", str(error), _LEFT_OUT, index, at)
            else:
                found += [alias] if alias else []
        return found

    def _alias(self, index: int, node: yaml.Node) -> TopicAlias | None:
        """Return the topic of an entry, or None and a line in the report."""
        if not isinstance(node, yaml.MappingNode):
            raise _InvalidEntryError(f"expected a mapping, got a {_kind(node)}")
        values = {str(key.value): value for key, value in yaml_files.items(node)}
        self._report_unknown(index, values)
        if "service_name" in values:
            what = "services can't be bridged"
            self._add("info", "ignored", what, _LEFT_OUT, index, node)
            return None
        texts = {
            key: _text(key, value)
            for key, value in values.items()
            if key in (*_NAMES, *_TYPE_NAMES, "direction")
        }
        ros, gz = _topic_names(texts)
        ros_type = texts.get("ros_type_name", "")
        gz_type = texts.get("gz_type_name") or texts.get("ign_type_name", "")
        if not ros_type or not gz_type:
            raise _InvalidEntryError("expected both ros_type_name and gz_type_name")
        direction = texts.get("direction", "BIDIRECTIONAL")
        if direction not in _DIRECTIONS:
            hint = suggest(direction, ("ROS_TO_GZ", "GZ_TO_ROS", "BIDIRECTIONAL"))
            problem = f"unknown direction {direction!r}; {hint}"
            raise _InvalidEntryError(problem, values["direction"])
        if ros_type not in _TYPES:
            what = f"topics of type {ros_type} are not simulated"
            self._add("info", "ignored", what, _LEFT_OUT, index, node)
            return None
        if re.sub(r"^(gz|ignition)\.msgs\.", "", gz_type) != _TYPES[ros_type]:
            expected = f"gz.msgs.{_TYPES[ros_type]}"
            problem = f"{ros_type} is bridged with {expected}, not with {gz_type}"
            raise _InvalidEntryError(problem)
        line = node.start_mark.line + 1
        return TopicAlias(ros, gz, _DIRECTIONS[direction], self.file, line)

    def _report_unknown(self, index: int, values: Mapping[str, yaml.Node]) -> None:
        for key, value in values.items():
            if key not in _KEYS:
                what = f"unknown key {key!r}; {suggest(key, _KEYS)}"
                self._add("warning", "ignored", what, "it has no effect", index, value)

    def _add(
        self,
        severity: Severity,
        kind: Kind,
        what: str,
        done: str,
        index: int,
        node: yaml.Node,
    ) -> None:
        where, line = f"[{index}]", node.start_mark.line + 1
        self.report.add(
            severity, kind, what, done, where=where, file=self.file, line=line
        )


def _topic_names(texts: Mapping[str, str]) -> tuple[str, str]:
    """Return the full names in ROS and in Gazebo; one that is missing is the other."""
    both, ros = texts.get("topic_name", ""), texts.get("ros_topic_name", "")
    gz = texts.get("gz_topic_name") or texts.get("ign_topic_name", "")
    if both and (ros or gz):
        other = "ros_topic_name" if ros else "gz_topic_name"
        raise _InvalidEntryError(f"topic_name is for both sides; leave {other} out")
    ros, gz = both or ros or gz, both or gz or ros
    if not ros.strip("/"):
        problem = "no topic is named; expected ros_topic_name and gz_topic_name"
        raise _InvalidEntryError(problem)
    return "/" + ros.strip("/"), "/" + gz.strip("/")


def _text(key: str, node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise _InvalidEntryError(f"{key}: expected a text, got a {_kind(node)}", node)
    return str(node.value).strip()


def _kind(node: yaml.Node) -> str:
    """Return what a node is called in a message."""
    names = {yaml.ScalarNode: "value", yaml.SequenceNode: "list"}
    return names.get(type(node), "mapping")
