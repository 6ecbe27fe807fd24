"""Gazebo's joint plugins as controllers of the manager, and the hardware they need.

In Gazebo they act in every step of the physics, beside the controllers of ros2_control.
Here the controller manager runs them, at the rate of Gazebo's steps; all tags of a kind
that moves single joints are one system, for a hundred of them would take their time.
"""

import dataclasses as dc
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from arm_drake import interfaces
from arm_drake.description.base_wheels import first_collision, pose_in_root
from arm_drake.description.claimed_hardware import claimed_joints, make_block
from arm_drake.description.controllers import (
    MANAGER,
    ControllerConfig,
    ControllerManagerConfig,
)
from arm_drake.description.elements import free_name
from arm_drake.description.gazebo_plugins import (
    AckermannSteering,
    ApplyJointForce,
    BaseHolder,
    DiffDrive,
    GazeboRosAckermannDrive,
    GazeboRosDiffDrive,
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    GazeboRosPlanarMove,
    JointController,
    JointPlugin,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
    MecanumDrive,
    OdometryPublisher,
    VelocityControl,
    WheelDrive,
)
from arm_drake.description.joints import (
    WORLD,
    JointInfo,
    JointLimits,
    joints_above,
)
from arm_drake.description.parameters import Parameter
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import HardwareInfo
from arm_drake.description.urdf import RobotDescription, total_mass
from arm_drake.importing import dataclass
from arm_drake.options import GRAVITY

OneOfJoints: TypeAlias = (
    JointPositionController
    | JointController
    | ApplyJointForce
    | JointTrajectoryController
)
Driving: TypeAlias = WheelDrive | GazeboRosDiffDrive | GazeboRosAckermannDrive
Moving: TypeAlias = OneOfJoints | Driving | GazeboRosJointPoseTrajectory

# Plugins that run as controllers.
RunPlugin: TypeAlias = (
    Moving
    | JointStatePublisher
    | GazeboRosJointStatePublisher
    | OdometryPublisher
    | VelocityControl
    | GazeboRosPlanarMove
)


# Of these all tags make one system.
GROUPED = (JointPositionController, JointController, ApplyJointForce)


class PluginTag(NamedTuple):
    """A plugin, and the joints that it moves."""

    plugin: RunPlugin
    joints: tuple[str, ...]


def moving_plugins(description: RobotDescription) -> tuple[JointPlugin, ...]:
    """Return the plugins that move joints."""
    return tuple(p for p in description.joint_plugins if isinstance(p, Moving))


def plugin_joints(description: RobotDescription) -> frozenset[str]:
    """Return the joints that plugins move, and those that these follow.

    Beside a plugin that moves a base, wheels that roll freely are among them, and what
    suspends its wheels; a controller that held these would be a brake, or stiff.
    """
    moved = _commanded_joints(description)
    sprung = suspending_joints(description)
    return moved.union(_rolling_joints(description, moved), sprung)


def suspending_joints(description: RobotDescription) -> tuple[str, ...]:
    """Return the joints that carry wheels which plugins drive, and that none commands.

    Such as the rockers of a rover.
    """
    commanded = _commanded_joints(description)
    movable = {joint.name: joint for joint in description.movable_joints}
    driven = {
        name
        for plugin in description.joint_plugins
        if isinstance(plugin, Driving)
        for name in _joints_of(plugin, movable)
    }
    carriers = {
        carrier.name
        for name in driven & movable.keys()
        for carrier in joints_above(description.joints, movable[name].parent)
    }
    carriers -= commanded
    return tuple(name for name in movable if name in carriers)


def rolling_joints(description: RobotDescription) -> tuple[str, ...]:
    """Return the joints of wheels that roll freely beside a plugin that moves a base.

    A wheel turns without limits, as do the casters that carry it. What carries other
    joints, or hangs from a revolute one, is part of an arm.
    """
    return _rolling_joints(description, _commanded_joints(description))


def _commanded_joints(description: RobotDescription) -> frozenset[str]:
    """Return the joints that plugins command, and those that these follow."""
    movable = {joint.name: joint for joint in description.movable_joints}
    requested = {
        (name, interface_of(plugin, name))
        for plugin in description.joint_plugins
        for name in _joints_of(plugin, movable)
    }
    names = {name for name, _ in requested}
    carriers = {find_carrier(movable, *key) for key in requested}
    return frozenset(names | {name for name in carriers if name is not None})


def _rolling_joints(
    description: RobotDescription, commanded: Collection[str]
) -> tuple[str, ...]:
    """Return the same, where plugins command some joints."""
    if not any(isinstance(p, Driving | BaseHolder) for p in description.joint_plugins):
        return ()
    others = {
        joint.name: joint
        for joint in description.movable_joints
        if joint.name not in commanded
    }
    of_arms = {
        carrier.name
        for joint in others.values()
        if joint.type != "continuous"
        for carrier in joints_above(description.joints, joint.parent)
    }
    return tuple(
        name
        for name, joint in others.items()
        if joint.type == "continuous"
        and name not in of_arms
        and not any(
            carrier.type == "revolute" and carrier.name in others
            for carrier in joints_above(description.joints, joint.parent)
        )
    )


def interface_of(plugin: JointPlugin, joint: str) -> str:
    """Return what a plugin commands of one of its joints."""
    if isinstance(plugin, GazeboRosAckermannDrive):
        is_put = joint in plugin.steering_wheel_joints
        return interfaces.POSITION if is_put else interfaces.EFFORT
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
    """
    joint = movable[name]
    if joint.mimic is not None and interface != interfaces.EFFORT:
        return None
    while joint.mimic is not None:
        if joint.mimic.joint not in movable:
            return None
        joint = movable[joint.mimic.joint]
    return joint.name


@dataclass(frozen=True)
class PluginSorter:
    """Decides which plugin moves which joint."""

    movable: Mapping[str, JointInfo]

    # Joints that controllers command, and which.
    taken: Mapping[str, str]

    report: LoadReport
    file: Path

    def sort(self, plugins: Sequence[RunPlugin]) -> list[PluginTag]:
        """Return the plugins that are left, with the joints that they get.

        A joint follows the last plugin that commands it. A drive follows one system: of
        those that command it the last one gets it, with all its tags.
        """
        requested = [_joints_of(plugin, self.movable) for plugin in plugins]
        last: dict[str, int] = {}
        owner: dict[str, object] = {}
        for at, (plugin, names) in enumerate(zip(plugins, requested, strict=True)):
            for name in names:
                carrier = find_carrier(self.movable, name, interface_of(plugin, name))
                if carrier is not None:
                    last[name], owner[carrier] = at, _system(plugin, at)
        tags = []
        for at, (plugin, names) in enumerate(zip(plugins, requested, strict=True)):
            own_joints = tuple(
                name
                for name in names
                if not (problem := self._find_problem(plugin, at, name, last, owner))
                or self._report(plugin, problem)
            )
            if isinstance(plugin, OneOfJoints) and own_joints:
                tags.append(
                    PluginTag(_with_joints(plugin, names, own_joints), own_joints)
                )
            elif isinstance(plugin, Driving):
                tags += self._with_wheels(plugin, own_joints)
            elif own_joints or not isinstance(plugin, Moving):
                tags.append(PluginTag(plugin, own_joints))
        return tags

    def _with_wheels(
        self, plugin: Driving, own_joints: Sequence[str]
    ) -> list[PluginTag]:
        """Return a plugin of fewer wheels; none and a line if they can't drive."""
        driving = _keep_wheels(plugin, own_joints)
        empty = [
            field.metadata["tags"][0]
            for field in dc.fields(driving)
            if field.metadata.get("joints")
            and driving.needs(field.name)
            and not getattr(driving, field.name)
        ]
        if not empty:
            return [PluginTag(driving, tuple(_moved_by(driving)))]
        what = "no wheels are left on both sides"
        if not isinstance(plugin, DiffDrive | GazeboRosDiffDrive):
            what = f"no joints are left of {', '.join(f'<{tag}>' for tag in empty)}"
        self._report(plugin, (what, "it is left out"))
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
        carrier = find_carrier(self.movable, name, interface_of(plugin, name))
        if carrier is None:
            done = "it moves with the joint that it follows"
            return f"mimic joint {name!r} is commanded", done
        controller = self.taken.get(name) or self.taken.get(carrier)
        if controller:
            what = f"controller {controller!r} commands joint {carrier!r} too"
            return what, f"the plugin leaves {name!r} alone"
        if last[name] != at or owner[carrier] != _system(plugin, at):
            what = f"another Gazebo plugin moves joint {name!r} too"
            return what, "the last one does"
        return None

    def _report(self, plugin: RunPlugin, problem: tuple[str, str]) -> bool:
        what, done = problem
        # That of a trajectory of all joints is no mistake.
        is_of_all = isinstance(plugin, GazeboRosJointPoseTrajectory)
        if not (is_of_all and what.startswith("mimic")):
            where = f"Gazebo plugin {type(plugin).__name__}"
            self.report.add(
                "warning", "ignored", what, done, where=where, file=self.file
            )
        return False


def _system(plugin: RunPlugin, at: int) -> object:
    """Return a key of the system that a plugin belongs to."""
    return type(plugin) if isinstance(plugin, GROUPED) else at


def _with_joints(
    plugin: OneOfJoints, names: Sequence[str], own_joints: Sequence[str]
) -> RunPlugin:
    """Return a plugin of fewer joints; topic and n-th values stay those of theirs."""
    changes: dict[str, Any] = {"joint_names": tuple(own_joints)}
    is_first_left_out = own_joints[0] != names[0]
    if is_first_left_out and isinstance(
        plugin, JointPositionController | JointController
    ):
        end = "pos" if isinstance(plugin, JointPositionController) else "vel"
        default = f"joint/{names[0]}/cmd_{end}"
        changes["sub_topic"] = plugin.sub_topic or default
    if isinstance(plugin, JointTrajectoryController):
        at = [names.index(name) for name in own_joints]
        for field in dc.fields(plugin):
            values = getattr(plugin, field.name)
            if field.name != "joint_names" and isinstance(values, tuple):
                # What lies behind the last value that is given has the default.
                changes[field.name] = tuple(values[k] for k in at if k < len(values))
    return dc.replace(plugin, **changes)


def _keep_wheels(plugin: Driving, own_joints: Collection[str]) -> Driving:
    """Return a plugin with these wheels alone; in Classic they go in pairs."""
    if set(_moved_by(plugin)) <= set(own_joints):
        return plugin
    if not isinstance(plugin, GazeboRosDiffDrive):
        lost = set(_moved_by(plugin)) - set(own_joints)
        changes: dict[str, Any] = {
            field.name: tuple(n for n in getattr(plugin, field.name) if n not in lost)
            for field in dc.fields(plugin)
            if field.metadata.get("joints")
        }
        return dc.replace(plugin, **changes)
    left, right = plugin.left_joints, plugin.right_joints
    pairs = list(enumerate(zip(left, right, strict=True)))
    at = [k for k, pair in pairs if set(pair) <= set(own_joints)]
    return dc.replace(
        plugin,
        left_joints=tuple(left[k] for k in at),
        right_joints=tuple(right[k] for k in at),
        num_wheel_pairs=len(at),
        wheel_separation=tuple(plugin.separations[k] for k in at),
        wheel_diameter=tuple(2.0 * plugin.radii[k] for k in at),
    )


def _moved_by(plugin: Driving) -> list[str]:
    """Return the joints that a drive turns, each once, then those that it steers."""
    moved = [*plugin.driven_joints, *plugin.steered_joints]
    if isinstance(plugin, GazeboRosAckermannDrive):
        moved += plugin.steering_wheel_joints
    return list(dict.fromkeys(moved))


def _joints_of(plugin: JointPlugin, movable: Collection[str]) -> list[str]:
    """Return the joints that a plugin moves."""
    if not isinstance(plugin, Moving):
        return []
    if isinstance(plugin, GazeboRosJointPoseTrajectory):
        return list(movable)
    if isinstance(plugin, Driving):
        return [name for name in _moved_by(plugin) if name in movable]
    names = [name for name in dict.fromkeys(plugin.joint_names) if name in movable]
    if isinstance(plugin, JointTrajectoryController):
        return names or list(movable)
    return names[:1] if isinstance(plugin, ApplyJointForce) else names


# Steps of Gazebo's physics per second, where a world doesn't say otherwise.
GAZEBO_RATE = 1000

# A coefficient of friction that no ground exceeds.
_GRIP = 2.0

# A speed that few bases exceed [m/s].
_FAST = 2.0

# What the kinds are called where a controller's type is.
PLUGIN_TYPES: dict[type[RunPlugin], str] = {
    JointPositionController: "gz::sim::systems::JointPositionController",
    JointController: "gz::sim::systems::JointController",
    ApplyJointForce: "gz::sim::systems::ApplyJointForce",
    JointTrajectoryController: "gz::sim::systems::JointTrajectoryController",
    JointStatePublisher: "gz::sim::systems::JointStatePublisher",
    AckermannSteering: "gz::sim::systems::AckermannSteering",
    DiffDrive: "gz::sim::systems::DiffDrive",
    MecanumDrive: "gz::sim::systems::MecanumDrive",
    VelocityControl: "gz::sim::systems::VelocityControl",
    OdometryPublisher: "gz::sim::systems::OdometryPublisher",
    GazeboRosJointPoseTrajectory: "gazebo_plugins/GazeboRosJointPoseTrajectory",
    GazeboRosJointStatePublisher: "gazebo_plugins/GazeboRosJointStatePublisher",
    GazeboRosDiffDrive: "gazebo_plugins/GazeboRosDiffDrive",
    GazeboRosPlanarMove: "gazebo_plugins/GazeboRosPlanarMove",
    GazeboRosAckermannDrive: "gazebo_plugins/GazeboRosAckermannDrive",
}


def add_plugins(
    description: RobotDescription, config: ControllerManagerConfig, report: LoadReport
) -> tuple[RobotDescription, ControllerManagerConfig]:
    """Return a robot whose plugins are controllers, with the interfaces they claim.

    A joint that several plugins move follows the last of them, as in Gazebo; one that a
    controller of the YAML claims is left to it.
    """
    movable = {joint.name: joint for joint in description.movable_joints}
    sorter = PluginSorter(movable, claimed_joints(config), report, description.file)
    plugins = [p for p in description.joint_plugins if isinstance(p, RunPlugin)]
    tags = [_with_links(tag, description) for tag in sorter.sort(plugins)]
    tags = _without_unmeasured(tags, description, report)
    if not tags:
        return description, config
    if any(tag.joints or isinstance(tag.plugin, BaseHolder) for tag in tags):
        config = _at_rate(config, description.file, report)
    names = {controller.name for controller in config.controllers}
    added = tuple(_controllers(tags, names, description.file))
    block = _hardware(description, tags, movable)
    hardware = (*description.hardware, block) if block else description.hardware
    description = dc.replace(description, hardware=hardware)
    description = _with_torques(description, tags, report)
    joints = _without_limits(description, tags, report)
    _report_holders(description, tags, report)
    return (
        dc.replace(description, joints=joints),
        dc.replace(config, controllers=(*config.controllers, *added)),
    )


def _without_limits(
    description: RobotDescription, tags: Sequence[PluginTag], report: LoadReport
) -> tuple[JointInfo, ...]:
    """Return the joints; those that are put in their places know no limit on the way.

    Gazebo Classic sets the positions whatever it takes, also where friction is larger
    than the effort limit.
    """
    placed = {
        name
        for tag in tags
        if isinstance(tag.plugin, GazeboRosJointPoseTrajectory)
        for name in tag.joints
    }
    if placed:
        what = f"gazebo_ros_joint_pose_trajectory sets the positions of {len(placed)}"
        what += " joints, whatever it takes"
        done = "their effort and velocity limits don't hold"
        report.add("info", "ignored", what, done, file=description.file)
    return tuple(
        dc.replace(j, limits=dc.replace(j.limits, effort=None, velocity=None))
        if j.name in placed
        else j
        for j in description.joints
    )


def _report_holders(
    description: RobotDescription, tags: Sequence[PluginTag], report: LoadReport
) -> None:
    """Record how plugins that set the velocity of the base are simulated."""
    for plugin in (tag.plugin for tag in tags):
        if not isinstance(plugin, VelocityControl | GazeboRosPlanarMove):
            continue
        what = f"{type(plugin).__name__} sets the velocity of link {plugin.base_link!r}"
        done = "a force without a limit does it, in every step"
        if isinstance(plugin, GazeboRosPlanarMove) and plugin.update_rate > 0.0:
            done = f"a force without a limit does it, {plugin.update_rate:g} times per "
            done += "second; in between, what rubs on the ground brakes it"
        report.add("info", "repair", what, done, file=description.file)


def _with_links(tag: PluginTag, description: RobotDescription) -> PluginTag:
    """Return a tag that knows the links whose poses it publishes."""
    plugin = tag.plugin
    if not isinstance(plugin, Driving | BaseHolder | OdometryPublisher):
        return tag
    # One that hangs from the world has no root.
    base = next(link for link in description.links if link != WORLD)
    if description.roots:
        base = description.base
    plugin = dc.replace(plugin, base_link=base)
    if isinstance(plugin, GazeboRosAckermannDrive):
        return tag._replace(plugin=_with_measures(plugin, description))
    if not isinstance(plugin, GazeboRosDiffDrive):
        return tag._replace(plugin=plugin)
    ends = {joint.name: (joint.parent, joint.child) for joint in description.joints}
    pairs = zip(plugin.right_joints, plugin.left_joints, strict=True)
    links = tuple(ends[name] for pair in pairs for name in pair)
    return tag._replace(plugin=dc.replace(plugin, wheel_links=links))


def _with_measures(
    plugin: GazeboRosAckermannDrive, description: RobotDescription
) -> GazeboRosAckermannDrive:
    """Return a plugin that knows its wheels, by the first shape that each has.

    Where one has none, or is neither a cylinder nor a sphere, the radius stays 0.
    """
    joints = {joint.name: joint for joint in description.joints}
    ends = tuple((joints[n].parent, joints[n].child) for n in plugin.all_joints)
    plugin = dc.replace(plugin, wheel_links=ends)
    centers, radii = [], []
    for _, link in ends[:4]:
        found = first_collision(description, link)
        if found is None:
            return plugin
        owner, shape = found
        placed = pose_in_root(description, owner, shape.origin.transform)
        centers.append(placed.position)
        radii.append(shape.wheel_radius)
    front_right, front_left, rear_right, rear_left = centers
    axles = (front_left + front_right) / 2.0 - (rear_left + rear_right) / 2.0
    return dc.replace(
        plugin,
        wheel_radius=radii[2],
        wheel_separation=float(np.linalg.norm(front_left - front_right)),
        wheel_base=float(np.linalg.norm(axles)),
    )


def _without_unmeasured(
    tags: Sequence[PluginTag], description: RobotDescription, report: LoadReport
) -> list[PluginTag]:
    """Return the plugins whose wheels have measures, and record the others."""
    kept = []
    for tag in tags:
        plugin = tag.plugin
        if isinstance(plugin, GazeboRosAckermannDrive):
            sizes = (plugin.wheel_radius, plugin.wheel_separation, plugin.wheel_base)
            if not all(size > 0.0 for size in sizes):
                what = (
                    "its wheels lack <collision>, a cylinder or a sphere, or are all "
                )
                what += "in one place: no radius, wheel separation or wheel base"
                where, file = f"Gazebo plugin {type(plugin).__name__}", description.file
                done = "it is left out"
                report.add("error", "invalid", what, done, where=where, file=file)
                continue
        kept.append(tag)
    return kept


def _with_torques(
    description: RobotDescription, tags: Sequence[PluginTag], report: LoadReport
) -> RobotDescription:
    """Return a robot whose wheels have the torques that Gazebo gives them.

    In Classic a motor of its own turns each, which knows neither limit of the joint.
    In Gazebo Sim one without an effort limit has all the torque that it takes: here
    what slips on any ground, and what turns the joint itself.
    """
    joints = {joint.name: joint for joint in description.joints}
    limits: dict[str, JointLimits] = {}
    for tag in tags:
        plugin = tag.plugin
        if isinstance(plugin, GazeboRosDiffDrive):
            found, torque = list(tag.joints), plugin.max_wheel_torque
            what, more = "gazebo_ros_diff_drive turns", "; they have no velocity limit"
        elif isinstance(plugin, WheelDrive):
            found = [n for n in tag.joints if joints[n].limits.effort is None]
            weight = GRAVITY * total_mass(description)
            own = max((_own_torque(joints[n], plugin) for n in found), default=0.0)
            torque, more = _GRIP * weight * plugin.wheel_radius + own, ""
            parts = "joints" if plugin.steered_joints else "wheels"
            what = f"{type(plugin).__name__} has {parts} without an effort limit:"
        else:
            continue
        for name in found:
            old = joints[name].limits
            velocity = None if more else old.velocity
            limits[name] = dc.replace(old, effort=torque, velocity=velocity)
        if found:
            what = f"{what} {', '.join(found)}"
            done = f"the limit is {torque:.3g} N·m{more}"
            report.add("info", "repair", what, done, file=description.file)
    changed = tuple(
        dc.replace(joint, limits=limits.get(joint.name, joint.limits))
        for joint in description.joints
    )
    return dc.replace(description, joints=changed)


def _own_torque(joint: JointInfo, plugin: WheelDrive) -> float:
    """Return what friction and damping of a wheel's joint take at full speed [N·m]."""
    fastest = min(plugin.max_velocity, _FAST) / plugin.wheel_radius
    if joint.limits.velocity is not None:
        fastest = joint.limits.velocity
    return joint.friction + joint.damping * fastest


def _controllers(
    tags: Sequence[PluginTag], names: set[str], file: Path
) -> Iterator[ControllerConfig]:
    """Yield the controllers that plugins are, named apart."""
    groups: list[tuple[PluginTag, ...]] = [
        tuple(tag for tag in tags if isinstance(tag.plugin, kind)) for kind in GROUPED
    ]
    groups += [(tag,) for tag in tags if not isinstance(tag.plugin, GROUPED)]
    for group in filter(None, groups):
        kind: type[RunPlugin] = type(group[0].plugin)
        name = free_name(kind.__name__, names.__contains__)
        names.add(name)
        plugins = tuple(tag.plugin for tag in group)
        joints = frozenset(n for tag in group for n in tag.joints)
        yield ControllerConfig(
            name, PLUGIN_TYPES[kind], {}, file, 1, plugins=plugins, plugin_joints=joints
        )


def _hardware(
    description: RobotDescription,
    tags: Sequence[PluginTag],
    movable: Mapping[str, JointInfo],
) -> HardwareInfo | None:
    """Return a block with the interfaces that plugins claim and no other block has."""
    known = {
        f"{component.name}/{interface.name}"
        for block in description.hardware
        for component in block.joints
        for interface in component.command_interfaces
    }
    claims: dict[str, dict[str, None]] = {}
    for tag in tags:
        for name in tag.joints:
            interface = interface_of(tag.plugin, name)
            carrier = find_carrier(movable, name, interface)
            if carrier is not None and f"{carrier}/{interface}" not in known:
                claims.setdefault(carrier, {})[interface] = None
    if not claims:
        return None
    moved = plugin_joints(description)
    claims |= {n: {} for n in movable if n not in claims and n in moved}
    return make_block("Gazebo plugins", claims)


def _at_rate(
    config: ControllerManagerConfig, file: Path, report: LoadReport
) -> ControllerManagerConfig:
    """Return a manager that runs at the rate of Gazebo's steps, or near it.

    Its controllers keep theirs.
    """
    old = config.update_rate
    if not config.controllers:
        return dc.replace(config, update_rate=GAZEBO_RATE)
    factor = max(1, round(GAZEBO_RATE / old))
    if factor == 1:
        return config
    what = f"update_rate {old} Hz beside Gazebo's plugins, which act in every step"
    new = old * factor
    done = f"the manager runs at {new} Hz, controllers at {old} Hz or their own"
    first = next(iter(config.files), file)
    report.add("info", "repair", what, done, where=MANAGER, file=first)
    rate = Parameter(old, file, 1)
    controllers = tuple(
        c
        if c.parameters.get("update_rate", Parameter(0, file, 1)).value
        else dc.replace(c, parameters={**c.parameters, "update_rate": rate})
        for c in config.controllers
    )
    return dc.replace(config, update_rate=new, controllers=controllers)
