"""Gains with which Gazebo would drive joints, as the description and the YAML say.

Each simulator reads what is for the blocks of its own hardware plugin:

- Gazebo Classic (gazebo_ros2_control 0.7.6, gazebo_system.cpp) drives joints by PID
  gains. Those of a joint's `<param>` tags win. Where it has none of `kp`, `ki`, `kd`,
  the parameters `pid_gains` of the plugin's node count if they give all three.
  Upstream, the gains of one joint put all joints of its block under a PID, those
  without gains limp; here these keep the joint servo's gains.
- Gazebo Sim (gz_ros2_control 2.0.1, gz_ros2_control_plugin.cpp) has one gain for all
  positions. Tags of the plugin are the defaults of its node's parameters, so the YAML
  wins. So it does for `hold_joints`, which both simulators have.

In Gazebo Classic a node is called as its `<plugin>` tag is (gazebo_ros, node.cpp), in
Gazebo Sim always the same (gz_ros2_control_plugin.cpp).
"""

import dataclasses as dc
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from arm_drake.description.controllers import (
    PLUGIN_NODES,
    PLUGIN_PARAMETERS,
)
from arm_drake.description.elements import parse_number, parse_sdf_bool
from arm_drake.description.gazebo import GazeboPlugin
from arm_drake.description.parameters import NodeParameters, Parameter, Parameters
from arm_drake.description.report import LoadReport, Severity
from arm_drake.description.robot import Robot
from arm_drake.description.ros2_control import (
    CLASSIC,
    SIMULATOR_PLUGINS,
    ComponentInfo,
    HardwareInfo,
    PidGains,
)
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import ParameterError, suggest
from arm_drake.importing import dataclass
from arm_drake.interfaces import POSITION, VELOCITY

GAZEBO_SIM = "Gazebo Sim"

HOLD_JOINTS, PID_GAINS, POSITION_GAIN = PLUGIN_PARAMETERS

# What each simulator reads of its node's parameters.
_READ = {
    CLASSIC: (HOLD_JOINTS, PID_GAINS),
    GAZEBO_SIM: (HOLD_JOINTS, POSITION_GAIN),
}

_CLASSIC_NODE, _SIM_NODE = PLUGIN_NODES

_NO_EFFECT = "it has no effect"


def gazebo_nodes(description: RobotDescription) -> dict[str, str]:
    """Return the simulators of a robot's blocks by the nodes of their plugins."""
    used = {simulator_of(block) for block in description.hardware}
    nodes = {_SIM_NODE: GAZEBO_SIM} if GAZEBO_SIM in used else {}
    if CLASSIC in used:
        names = [
            plugin.name
            for plugin, simulator in gazebo_plugins(description)
            if simulator == CLASSIC and plugin.name
        ]
        nodes |= dict.fromkeys(names or [_CLASSIC_NODE], CLASSIC)
    return nodes


def simulator_of(block: HardwareInfo) -> str | None:
    """Return the Gazebo that a block is for, None if it is for something else."""
    name = SIMULATOR_PLUGINS.get(block.plugin)
    # This is what Gazebo Sim was called before.
    name = GAZEBO_SIM if name == "Ignition Gazebo" else name
    return name if name in _READ else None


def gazebo_plugins(description: RobotDescription) -> Iterator[tuple[GazeboPlugin, str]]:
    """Yield the plugins that run a controller manager, with their simulators."""
    for plugin in description.gazebo_plugins:
        if plugin.kind == "ros2_control":
            is_classic = "gazebo_ros2_control" in plugin.filename
            yield plugin, CLASSIC if is_classic else GAZEBO_SIM


def gazebo_tags(
    description: RobotDescription, simulator: str, tag: str
) -> Iterator[tuple[GazeboPlugin, str]]:
    """Yield the plugins of a simulator that have a tag, with its first text."""
    for plugin, other in gazebo_plugins(description):
        if other == simulator and plugin.texts(tag):
            yield plugin, plugin.texts(tag)[0]


def report_unread(robot: Robot, report: LoadReport) -> None:
    """Report parameters of the plugins' nodes, and tags, that no simulator reads."""
    simulators = gazebo_nodes(robot.description)
    nodes = robot.controllers.plugin_nodes
    # What all nodes get need not be for these.
    common = set.intersection(*(_places(nodes.get(node, {})) for node in PLUGIN_NODES))
    for node, parameters in nodes.items():
        read = _READ.get(simulators.get(node, ""), ())
        unread: dict[str, Parameter] = {}
        for name, parameter in parameters.items():
            head, is_common = name.partition(".")[0], _place(name, parameter) in common
            if head in PLUGIN_PARAMETERS and head not in read and not is_common:
                unread.setdefault(head, parameter)
        for head, parameter in unread.items():
            if node in simulators:
                what = f"{simulators[node]} has no such parameter"
            elif simulators:
                what = f"no plugin has a node of this name; {suggest(node, simulators)}"
            else:
                what = "no <ros2_control> block is for Gazebo"
            severity: Severity = "warning" if simulators else "info"
            where = f"{node}.{head}"
            report.add(severity, "ignored", what, _NO_EFFECT, where=where, at=parameter)
    _report_tags(robot.description, set(simulators.values()), report)


def _report_tags(
    description: RobotDescription, used: set[str], report: LoadReport
) -> None:
    for plugin, simulator in gazebo_plugins(description):
        for tag in (HOLD_JOINTS, POSITION_GAIN):
            texts = plugin.texts(tag)
            if not texts or (simulator in used and tag in _READ[simulator]):
                continue
            if tag == HOLD_JOINTS and parse_sdf_bool(texts[0]) is not False:
                continue  # So it is without the tag.
            what = f"<{tag}>: no <ros2_control> block is for {simulator}"
            if simulator in used:
                what = f"<{tag}>: {simulator} has no such tag"
            where, file = plugin.place, description.file
            report.add("info", "ignored", what, _NO_EFFECT, where=where, file=file)


def _places(parameters: Parameters) -> set[tuple[str, Path, int]]:
    return {_place(name, parameter) for name, parameter in parameters.items()}


def _place(name: str, parameter: Parameter) -> tuple[str, Path, int]:
    return name, parameter.file, parameter.line


# Names of parameters below `pid_gains`, and the command interfaces that they are for.
# Upstream they must equal the interface's name in the description, which is lost here.
_KINDS = {
    "position": POSITION,
    "position_pid": POSITION,
    "velocity": VELOCITY,
    "velocity_pid": VELOCITY,
}
_PREFIXES = {POSITION: "pos_", VELOCITY: "vel_"}
_GAINS = ("kp", "ki", "kd")
_ALL = tuple(field.name for field in dc.fields(PidGains))
_ANTIWINDUP = "antiwindup"
_KNOWN = (*_ALL, _ANTIWINDUP)
_SHAPE = f"{PID_GAINS}.<{'|'.join(_KINDS)}>.<joint>.<{'|'.join(_ALL)}>"

_OWN = "the joint servo has its own gains"
_UNSET = "taken as not given"


@dataclass(frozen=True)
class DriveGains:
    """Gains of a joint's drive in the description; None where it has none."""

    # Gains of efforts on errors of position and of velocity, in Gazebo Classic.
    position_pid: PidGains | None = None
    velocity_pid: PidGains | None = None

    # Velocity per error of position [1/s], in Gazebo Sim: its gain times the manager's
    # update rate. None too for the default gain, which nobody asked for.
    position_rate: float | None = None


def find_drive_gains(robot: Robot, report: LoadReport) -> dict[str, DriveGains]:
    """Return the gains of the joints about which anything is said."""
    return _Finder(robot, report).find_gains()


def holds_joints(robot: Robot, report: LoadReport) -> bool:
    """Return whether joints stand still that no controller commands."""
    return _Finder(robot, report).holds()


class _Finder:
    """Finds what is said of one robot's joints."""

    def __init__(self, robot: Robot, report: LoadReport) -> None:
        self._robot = robot
        self._report = report
        self._simulators = gazebo_nodes(robot.description)
        self._nodes = [
            NodeParameters(parameters, name, Path(), report, robot.distro)
            for name, parameters in robot.controllers.plugin_nodes.items()
        ]
        self._joints = {joint.name: joint for joint in robot.description.movable_joints}
        self._found: dict[str, DriveGains] = {}

        # Where gains are given, by joint and command interface.
        self._sources: dict[tuple[str, str], str] = {}

    def find_gains(self) -> dict[str, DriveGains]:
        for block, component in self._components(CLASSIC):
            for interface in _PREFIXES:
                self._add_tags(block, component, interface)
        for node in self._nodes_of(CLASSIC):
            for (kind, joint), names in self._groups(node).items():
                self._add_group(node, kind, joint, names)
        gain = self._position_gain()
        for _, component in self._components(GAZEBO_SIM):
            name = component.name
            if gain is not None and not self._obstacle(name, POSITION, GAZEBO_SIM):
                rate = gain * self._robot.controllers.update_rate
                self._set(name, "position_rate", rate)
        report_unread(self._robot, self._report)
        return {name: self._found[name] for name in self._joints if name in self._found}

    def holds(self) -> bool:
        return all(self._holds(simulator) for simulator in self._simulators.values())

    def _holds(self, simulator: str) -> bool:
        for node in self._nodes_of(simulator):
            value = self._value(node, HOLD_JOINTS, bool)
            if value is not None:
                return bool(value)
        for _, text in gazebo_tags(self._robot.description, simulator, HOLD_JOINTS):
            # What is no bool is in the load report.
            return parse_sdf_bool(text) is not False
        return True

    def _position_gain(self) -> float | None:
        """Return the gain of positions in Gazebo Sim, None unless it is set."""
        if GAZEBO_SIM not in self._simulators.values():
            return None
        description = self._robot.description
        expected = "expected a finite number above 0, got"
        for node in self._nodes_of(GAZEBO_SIM):
            value = self._value(node, POSITION_GAIN, float)
            if value is not None and 0.0 < value < math.inf:
                return float(value)
            if value is not None:
                what = f"{expected} {value}"
                node.add(POSITION_GAIN, "warning", "invalid", what, _UNSET)
        for plugin, text in gazebo_tags(description, GAZEBO_SIM, POSITION_GAIN):
            number = parse_number(text)
            if number is not None and 0.0 < number < math.inf:
                return number
            if number is not None:  # Else it is in the load report.
                what = f"{POSITION_GAIN}: {expected} {number}"
                self._note(what, _UNSET, plugin.place)
        return None

    def _add_tags(
        self, block: HardwareInfo, component: ComponentInfo, interface: str
    ) -> None:
        """Take the gains of a joint's `<param>` tags for one command interface."""
        prefix, field = _PREFIXES[interface], f"{interface}_pid"
        if not any(prefix + gain in component.parameters for gain in _GAINS):
            return
        self._sources[component.name, interface] = "its <param> tags"
        gains: PidGains | None = getattr(component, field)
        if gains is None:
            return  # One is no number, says the load report.
        obstacle = self._obstacle(component.name, interface, CLASSIC)
        problem = f"{prefix}*: {obstacle}" if obstacle else _find_fault(gains, prefix)
        if problem:
            where = f"ros2_control {block.name!r}, joint {component.name!r}"
            self._note(problem, _OWN, where)
        else:
            self._set(component.name, field, gains)

    def _groups(self, node: NodeParameters) -> dict[tuple[str, str], list[str]]:
        """Return the names of gains that a node gives, by kind and joint."""
        groups: dict[tuple[str, str], list[str]] = {}
        for key in node.by_name:
            head, _, path = key.partition(".")
            kind, _, rest = path.partition(".")
            joint, _, gain = rest.rpartition(".")
            if head == PID_GAINS and kind in _KINDS and joint:
                groups.setdefault((kind, joint), []).append(gain)
            elif head == PID_GAINS:
                node.add(key, "warning", "invalid", f"expected {_SHAPE}", _NO_EFFECT)
        return groups

    def _add_group(
        self, node: NodeParameters, kind: str, joint: str, names: Sequence[str]
    ) -> None:
        """Take the gains that a node gives a joint for one command interface."""
        interface, group = _KINDS[kind], f"{PID_GAINS}.{kind}.{joint}"
        where, first = f"{node.name}.{group}", node.by_name[f"{group}.{names[0]}"]
        for name in [n for n in names if n not in _KNOWN]:
            what = f"unknown parameter; {suggest(name, _KNOWN)}"
            node.add(f"{group}.{name}", "warning", "ignored", what, _NO_EFFECT)
        if obstacle := self._obstacle(joint, interface, CLASSIC):
            self._note(obstacle, _NO_EFFECT, where, first)
            return
        source = self._sources.setdefault((joint, interface), where)
        if source != where:
            self._note(f"{source} give these gains too", "those count", where, first)
            return
        present = [name for name in _ALL if name in names]
        if not set(_GAINS) <= set(present):
            what = f"expected {', '.join(_GAINS)}, got {', '.join(present) or 'none'}"
            self._note(what, _OWN, where, first)
            return
        if self._value(node, f"{group}.{_ANTIWINDUP}", bool):
            what = "it limits the integral itself, here its term is limited"
            key = f"{group}.{_ANTIWINDUP}"
            node.add(key, "warning", "unsupported", what, _NO_EFFECT)
        values = {n: self._value(node, f"{group}.{n}", float, _OWN) for n in present}
        if None in values.values():
            return
        gains = PidGains(**values)
        if fault := _find_fault(gains):
            self._note(fault, _OWN, where, first)
        else:
            self._set(joint, f"{interface}_pid", gains)

    def _obstacle(self, joint: str, interface: str, simulator: str) -> str | None:
        """Return why a joint can't have gains for a command interface, or None."""
        commands: dict[str, list[str]] = {}
        for _, component in self._components(simulator):
            names = [command.name for command in component.command_interfaces]
            commands.setdefault(component.name, []).extend(names)
        if joint not in commands:
            return f"{simulator} drives no joint {joint!r}; {suggest(joint, commands)}"
        mimic = self._joints[joint].mimic
        if mimic is not None:
            return f"joint {joint!r} follows {mimic.joint!r}"
        if interface not in commands[joint]:
            return f"no command interface {interface!r}; it has {commands[joint]}"
        return None

    def _components(
        self, simulator: str
    ) -> Iterator[tuple[HardwareInfo, ComponentInfo]]:
        """Yield the movable joints in the blocks of a simulator."""
        for block in self._robot.description.hardware:
            if simulator_of(block) == simulator:
                for component in block.joints:
                    if component.name in self._joints:
                        yield block, component

    def _nodes_of(self, simulator: str) -> Iterator[NodeParameters]:
        return (n for n in self._nodes if self._simulators.get(n.name) == simulator)

    def _value(
        self, node: NodeParameters, key: str, kind: type, done: str = _UNSET
    ) -> Any:
        """Return a parameter; None if it is unset, or of another type (a line)."""
        parameter = node.by_name.get(key)
        try:
            return None if parameter is None else node.convert(kind, parameter, key)
        except ParameterError as error:
            node.add(key, "warning", "invalid", error.problem, done)
            return None

    def _set(self, joint: str, field: str, value: Any) -> None:
        found = self._found.get(joint, DriveGains())
        self._found[joint] = dc.replace(found, **{field: value})

    def _note(
        self, what: str, done: str, where: str, parameter: Parameter | None = None
    ) -> None:
        """Add a line about a place in the description, or about a parameter."""
        file = self._robot.description.file
        self._report.add(
            "warning", "invalid", what, done, where=where, file=file, at=parameter
        )


def _find_fault(gains: PidGains, prefix: str = "") -> str | None:
    """Return what is wrong with gains, or None.

    The limits of the integral are those that control_toolbox's Pid takes.
    """
    for name in _GAINS:
        gain = getattr(gains, name)
        if not 0.0 <= gain < math.inf:
            return f"{prefix}{name}: expected a finite number from 0 on, got {gain}"
    low, high = gains.min_integral_error, gains.max_integral_error
    if not low <= 0.0 <= high:
        rule = f"{prefix}min_integral_error <= 0 <= {prefix}max_integral_error"
        return f"expected {rule}, got {low} and {high}"
    return None
