"""Which of Gazebo's plugins moves which joint."""

import dataclasses as dc
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from arm_drake import interfaces
from arm_drake.description.gazebo_drives import DiffDrive, GazeboRosDiffDrive
from arm_drake.description.gazebo_fields import JointPlugin
from arm_drake.description.gazebo_joints import (
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
)
from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription

OneOfJoints: TypeAlias = (
    JointPositionController | JointController | JointTrajectoryController
)
Driving: TypeAlias = DiffDrive | GazeboRosDiffDrive
Moving: TypeAlias = OneOfJoints | Driving | GazeboRosJointPoseTrajectory

# Plugins that run as controllers.
RunPlugin: TypeAlias = Moving | JointStatePublisher | GazeboRosJointStatePublisher


# Of these all tags make one system.
GROUPED = (JointPositionController, JointController)


class PluginTag(NamedTuple):
    """A plugin, and the joints that it moves."""

    plugin: RunPlugin
    joints: tuple[str, ...]


def moving_plugins(description: RobotDescription) -> tuple[JointPlugin, ...]:
    """Return the plugins that move joints."""
    return tuple(p for p in description.joint_plugins if isinstance(p, Moving))


def plugin_joints(description: RobotDescription) -> frozenset[str]:
    """Return the joints that plugins move, and those that these follow."""
    movable = {joint.name: joint for joint in description.movable_joints}
    asked = {
        (name, interface_of(plugin))
        for plugin in description.joint_plugins
        for name in _joints_of(plugin, movable)
    }
    names = {name for name, _ in asked}
    carriers = {find_carrier(movable, *key) for key in asked}
    return frozenset(names | {name for name in carriers if name is not None})


def interface_of(plugin: JointPlugin) -> str:
    """Return what a plugin commands of its joints."""
    if isinstance(plugin, JointPositionController) and plugin.use_velocity_commands:
        return interfaces.VELOCITY
    if isinstance(plugin, JointController) and not plugin.use_force_commands:
        return interfaces.VELOCITY
    if isinstance(plugin, Driving):
        return interfaces.VELOCITY
    if isinstance(plugin, GazeboRosJointPoseTrajectory):
        return interfaces.POSITION
    return interfaces.EFFORT


def find_carrier(
    movable: Mapping[str, JointInfo], name: str, interface: str
) -> str | None:
    """Return the joint whose drive does what is commanded of a joint, or None.

    The force of a mimic joint acts on the one that it follows; positions and velocities
    it has from that.

    Args:
        movable: The movable joints, by name.
        name: The joint.
        interface: What is commanded of it.
    """
    joint = movable[name]
    if joint.mimic is not None and interface != interfaces.EFFORT:
        return None
    while joint.mimic is not None:
        if joint.mimic.joint not in movable:
            return None
        joint = movable[joint.mimic.joint]
    return joint.name


class PluginSorter:
    """Decides which plugin moves which joint."""

    def __init__(
        self,
        movable: Mapping[str, JointInfo],
        taken: Mapping[str, str],
        report: LoadReport,
        file: Path,
    ) -> None:
        """Create it.

        Args:
            movable: The movable joints, by name.
            taken: Joints that controllers command, and which controller.
            report: Where joints are recorded that a plugin doesn't get.
            file: File to name there.
        """
        self._movable = movable
        self._taken = taken
        self._report = report
        self._file = file

    def sort(self, plugins: Sequence[RunPlugin]) -> list[PluginTag]:
        """Return the plugins that are left, with the joints that they get.

        A joint follows the last plugin that commands it. A drive follows one system: of
        those that command it the last one gets it, with all its tags.
        """
        asked = [_joints_of(plugin, self._movable) for plugin in plugins]
        last: dict[str, int] = {}
        owner: dict[str, object] = {}
        for at, (plugin, names) in enumerate(zip(plugins, asked, strict=True)):
            for name in names:
                carrier = find_carrier(self._movable, name, interface_of(plugin))
                if carrier is not None:
                    last[name], owner[carrier] = at, _system(plugin, at)
        tags = []
        for at, (plugin, names) in enumerate(zip(plugins, asked, strict=True)):
            mine = tuple(
                name
                for name in names
                if not (problem := self._find_problem(plugin, at, name, last, owner))
                or self._tell(plugin, problem)
            )
            if isinstance(plugin, OneOfJoints) and mine:
                tags.append(PluginTag(_with_joints(plugin, names, mine), mine))
            elif isinstance(plugin, Driving):
                tags += self._with_wheels(plugin, mine)
            elif mine or not isinstance(plugin, Moving):
                tags.append(PluginTag(plugin, mine))
        return tags

    def _with_wheels(self, plugin: Driving, mine: Sequence[str]) -> list[PluginTag]:
        """Return a plugin of fewer wheels; none and a line if they can't drive."""
        driving = _keep_wheels(plugin, mine)
        if driving.left_joints and driving.right_joints:
            wheels = dict.fromkeys((*driving.left_joints, *driving.right_joints))
            return [PluginTag(driving, tuple(wheels))]
        self._tell(plugin, ("no wheels are left on both sides", "it is left out"))
        return []

    def _find_problem(
        self,
        plugin: RunPlugin,
        at: int,
        name: str,
        last: Mapping[str, int],
        owner: Mapping[str, object],
    ) -> tuple[str, str] | None:
        """Return why a plugin doesn't get a joint, and what happens instead."""
        carrier = find_carrier(self._movable, name, interface_of(plugin))
        if carrier is None:
            done = "it moves with the joint that it follows"
            return f"mimic joint {name!r} is commanded", done
        controller = self._taken.get(name) or self._taken.get(carrier)
        if controller:
            what = f"controller {controller!r} commands joint {carrier!r} too"
            return what, f"the plugin leaves {name!r} alone"
        if last[name] != at or owner[carrier] != _system(plugin, at):
            what = f"another Gazebo plugin moves joint {name!r} too"
            return what, "the last one does"
        return None

    def _tell(self, plugin: RunPlugin, problem: tuple[str, str]) -> bool:
        what, done = problem
        # That of a trajectory of all joints is no mistake.
        is_of_all = isinstance(plugin, GazeboRosJointPoseTrajectory)
        if not (is_of_all and what.startswith("mimic")):
            self._report.add(
                "warning",
                "ignored",
                what,
                done,
                where=f"Gazebo plugin {type(plugin).__name__}",
                file=self._file,
            )
        return False


def _system(plugin: RunPlugin, at: int) -> object:
    """Return what tells the systems of plugins apart."""
    return type(plugin) if isinstance(plugin, GROUPED) else at


def _with_joints(
    plugin: OneOfJoints, names: Sequence[str], mine: Sequence[str]
) -> RunPlugin:
    """Return a plugin of fewer joints; topic and n-th values stay those of theirs."""
    changes: dict[str, Any] = {"joint_names": tuple(mine)}
    is_first_left_out = mine[0] != names[0]
    if is_first_left_out and not isinstance(plugin, JointTrajectoryController):
        end = "pos" if isinstance(plugin, JointPositionController) else "vel"
        default = f"joint/{names[0]}/cmd_{end}"
        changes["sub_topic"] = plugin.sub_topic or default
    if isinstance(plugin, JointTrajectoryController):
        at = [names.index(name) for name in mine]
        for field in dc.fields(plugin):
            values = getattr(plugin, field.name)
            if field.name != "joint_names" and isinstance(values, tuple):
                # What lies behind the last value that is given has the default.
                changes[field.name] = tuple(values[k] for k in at if k < len(values))
    return dc.replace(plugin, **changes)


def _keep_wheels(plugin: Driving, mine: Collection[str]) -> Driving:
    """Return a plugin with these wheels alone; in Classic they go in pairs."""
    left, right = plugin.left_joints, plugin.right_joints
    if set(left + right) <= set(mine):
        return plugin
    if isinstance(plugin, DiffDrive):
        left, right = (tuple(n for n in side if n in mine) for side in (left, right))
        return dc.replace(plugin, left_joints=left, right_joints=right)
    pairs = list(enumerate(zip(left, right, strict=True)))
    at = [k for k, pair in pairs if set(pair) <= set(mine)]
    return dc.replace(
        plugin,
        left_joints=tuple(left[k] for k in at),
        right_joints=tuple(right[k] for k in at),
        num_wheel_pairs=len(at),
        wheel_separation=tuple(plugin.separations[k] for k in at),
        wheel_diameter=tuple(2.0 * plugin.radii[k] for k in at),
    )


def _joints_of(plugin: JointPlugin, movable: Collection[str]) -> list[str]:
    """Return the joints that a plugin asks for."""
    if not isinstance(plugin, Moving):
        return []
    if isinstance(plugin, GazeboRosJointPoseTrajectory):
        return list(movable)
    if isinstance(plugin, Driving):
        wheels = dict.fromkeys((*plugin.left_joints, *plugin.right_joints))
        return [name for name in wheels if name in movable]
    names = [name for name in dict.fromkeys(plugin.joint_names) if name in movable]
    if isinstance(plugin, JointTrajectoryController):
        return names or list(movable)
    return names
