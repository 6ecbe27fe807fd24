"""Gazebo plugin tags to the dataclasses of gazebo_joints and gazebo_drives."""

import dataclasses as dc
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.description.elements import ElementReader, parse_bool, parse_number
from arm_drake.description.gazebo import GazeboPlugin, GazeboPluginKind
from arm_drake.description.gazebo_drives import DiffDrive, GazeboRosDiffDrive
from arm_drake.description.gazebo_joints import (
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
    Ros2ControlPlugin,
)
from arm_drake.description.report import LoadReport
from arm_drake.errors import suggest

JointPlugin = (
    Ros2ControlPlugin
    | JointPositionController
    | JointController
    | JointTrajectoryController
    | JointStatePublisher
    | DiffDrive
    | GazeboRosJointStatePublisher
    | GazeboRosJointPoseTrajectory
    | GazeboRosDiffDrive
)

_CLASSES: Mapping[GazeboPluginKind, type[JointPlugin]] = {
    "ros2_control": Ros2ControlPlugin,
    "joint_position_controller": JointPositionController,
    "joint_controller": JointController,
    "joint_trajectory_controller": JointTrajectoryController,
    "joint_state_publisher": JointStatePublisher,
    "diff_drive": DiffDrive,
    "gazebo_ros_joint_state_publisher": GazeboRosJointStatePublisher,
    "gazebo_ros_joint_pose_trajectory": GazeboRosJointPoseTrajectory,
    "gazebo_ros_diff_drive": GazeboRosDiffDrive,
}

# Kinds that the simulator stands in for.
SIMULATED: frozenset[GazeboPluginKind] = frozenset(_CLASSES)

# Those that take all joints where they name none.
_ALL_BY_DEFAULT = (JointTrajectoryController, JointStatePublisher)


def read_joint_plugins(
    plugins: Collection[GazeboPlugin],
    joint_names: Collection[str],
    report: LoadReport,
    file: Path,
) -> tuple[JointPlugin, ...]:
    """Return the plugins that move or report joints, in their order.

    Args:
        plugins: All plugins of a description.
        joint_names: Joints of the robot.
        report: Where fields that can't be used are recorded, and plugins left out.
        file: File to name in the report.
    """
    found = []
    for plugin in plugins:
        if plugin.kind != "other":
            place = f"Gazebo plugin {plugin.name or plugin.filename!r}"
            reader = _FieldReader(place, report, file)
            if (typed := reader.read(plugin, joint_names)) is not None:
                found.append(typed)
    return tuple(found)


class _FieldReader(ElementReader):
    """Reads the fields of one plugin."""

    def read(
        self, plugin: GazeboPlugin, joint_names: Collection[str]
    ) -> JointPlugin | None:
        """Return a plugin with its fields, or None and a line in the report."""
        fields = dc.fields(_CLASSES[plugin.kind])
        values: dict[str, Any] = {}
        known: set[str] = set()
        for field in fields:
            tags = field.metadata.get("tags", (field.name,))
            known.update(tags)
            given = [(tag, text) for tag in tags for text in plugin.texts(tag)]
            if given:
                values[field.name] = self._value(field, given)
            if field.metadata.get("joints"):
                values[field.name] = self._joints(
                    values.get(field.name, ()), joint_names
                )
        unread = sorted({name for name, _ in plugin.fields} - known)
        if unread:
            what = f"unknown tags: {', '.join(unread)}"
            self.note("info", "ignored", what, "they have no effect")
        typed = _CLASSES[plugin.kind](
            **{name: value for name, value in values.items() if value is not None}
        )
        problem = self._problem(plugin, typed)
        if problem is not None:
            self.note("error", "invalid", problem, "the plugin is left out")
            return None
        return typed

    def _value(self, field: dc.Field[Any], given: list[tuple[str, str]]) -> Any:
        """Return the value of a field, or None if its text is none."""
        if field.type == tuple[str, ...]:
            # Of these names, the old form takes a list.
            return tuple(
                name
                for tag, text in given
                for name in (text.split() if tag == "joint_names" else [text])
            )
        if field.type == tuple[float, ...]:
            numbers = [
                self.number(part, tag) for tag, text in given for part in text.split()
            ]
            return None if None in numbers else tuple(numbers)
        tag, text = given[0]
        if field.type is str:
            return text
        if field.type is float:
            return self.number(text, tag)
        if field.type is int:
            number = parse_number(text)
            if number is not None and number.is_integer():
                return int(number)
            return self.expected(tag, "an integer", text)
        value = parse_bool({"1": "true", "0": "false"}.get(text, text))
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
            tags = field.metadata["tags"]
            is_given = any(plugin.texts(tag) for tag in tags)
            if is_given:
                names = [name for tag in tags for name in plugin.texts(tag)]
                return f"the robot has none of its joints: {', '.join(names)}"
            if not isinstance(typed, _ALL_BY_DEFAULT):
                return f"no joint; expected <{tags[0]}>"
        if isinstance(typed, JointPositionController) and typed.joint_index:
            return f"joint_index {typed.joint_index}: a joint has one axis, of index 0"
        if isinstance(typed, DiffDrive):
            return _measure_problem((typed.wheel_separation,), (typed.wheel_radius,))
        if isinstance(typed, GazeboRosDiffDrive):
            return _classic_problem(plugin, typed)
        return None


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
        given = typed.max_wheel_acceleration
        return f"max_wheel_acceleration: expected at least 0, got {given:g}"
    diameters = tuple(2.0 * radius for radius in typed.radii)
    return _measure_problem(typed.separations, diameters, "wheel_diameter")


def _measure_problem(
    separations: Sequence[float], sizes: Sequence[float], noun: str = "wheel_radius"
) -> str | None:
    """Return why a base with such wheels can't drive, or None."""
    for name, values in (("wheel_separation", separations), (noun, sizes)):
        for value in values:
            if not 0.0 < value < math.inf:
                return f"{name}: expected a length above 0 m, got {value:g}"
    return None
