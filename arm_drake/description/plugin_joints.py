"""Which of Gazebo's plugins moves which joint."""

import dataclasses as dc
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from arm_drake.description.gazebo_fields import JointPlugin
from arm_drake.description.gazebo_joints import (
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription

_OfJoints: TypeAlias = (
    JointPositionController | JointController | JointTrajectoryController
)
_Moving: TypeAlias = _OfJoints | GazeboRosJointPoseTrajectory

# Plugins that run as controllers.
RunPlugin: TypeAlias = _Moving | JointStatePublisher | GazeboRosJointStatePublisher


class PluginTag(NamedTuple):
    """A plugin, and the joints that it moves."""

    plugin: RunPlugin
    joints: tuple[str, ...]


def moving_plugins(description: RobotDescription) -> tuple[JointPlugin, ...]:
    """Return the plugins that move joints."""
    return tuple(p for p in description.joint_plugins if isinstance(p, _Moving))


def plugin_joints(description: RobotDescription) -> frozenset[str]:
    """Return the joints that plugins move, mimic joints included."""
    movable = [joint.name for joint in description.movable_joints]
    return frozenset(
        name
        for plugin in description.joint_plugins
        for name in _joints_of(plugin, movable)
    )


class PluginSorter:
    """Decides which plugin moves which joint."""

    def __init__(
        self,
        movable: Collection[str],
        taken: Mapping[str, str],
        report: LoadReport,
        file: Path,
    ) -> None:
        """Create it.

        Args:
            movable: Names of the movable joints.
            taken: Joints that controllers command, and which controller.
            report: Where joints are recorded that a plugin doesn't get.
            file: File to name there.
        """
        self._movable = movable
        self._taken = taken
        self._report = report
        self._file = file

    def sort(self, plugins: Sequence[RunPlugin]) -> list[PluginTag]:
        """Return the plugins that are left, with the joints that they get."""
        asked = [_joints_of(plugin, self._movable) for plugin in plugins]
        last = {name: at for at, names in enumerate(asked) for name in names}
        tags = []
        for at, (plugin, names) in enumerate(zip(plugins, asked, strict=True)):
            mine = tuple(n for n in names if last[n] == at and n not in self._taken)
            for name in names:
                if name not in mine:
                    self._tell(plugin, name)
            if isinstance(plugin, _OfJoints) and mine:
                tags.append(PluginTag(_with_joints(plugin, names, mine), mine))
            elif mine or not isinstance(plugin, _Moving):
                tags.append(PluginTag(plugin, mine))
        return tags

    def _tell(self, plugin: RunPlugin, name: str) -> None:
        what = f"another Gazebo plugin moves joint {name!r} too"
        done = "the last one does"
        if name in self._taken:
            what = f"controller {self._taken[name]!r} commands joint {name!r} too"
            done = "the plugin leaves it alone"
        self._report.add(
            "warning",
            "ignored",
            what,
            done,
            where=f"Gazebo plugin {type(plugin).__name__}",
            file=self._file,
        )


def _with_joints(
    plugin: _OfJoints, names: Sequence[str], mine: Sequence[str]
) -> RunPlugin:
    """Return a plugin of fewer joints; n-th values stay those of their joint."""
    changes: dict[str, Any] = {"joint_names": tuple(mine)}
    if isinstance(plugin, JointTrajectoryController):
        at = [names.index(name) for name in mine]
        for field in dc.fields(plugin):
            values = getattr(plugin, field.name)
            if field.name != "joint_names" and isinstance(values, tuple):
                # What lies behind the last value that is given has the default.
                changes[field.name] = tuple(values[k] for k in at if k < len(values))
    return dc.replace(plugin, **changes)


def _joints_of(plugin: JointPlugin, movable: Collection[str]) -> list[str]:
    """Return the joints that a plugin asks for."""
    if not isinstance(plugin, _Moving):
        return []
    if isinstance(plugin, GazeboRosJointPoseTrajectory):
        return list(movable)
    names = [name for name in dict.fromkeys(plugin.joint_names) if name in movable]
    if isinstance(plugin, JointTrajectoryController):
        return names or list(movable)
    return names
