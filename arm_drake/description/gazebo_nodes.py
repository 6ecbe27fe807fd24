"""The Gazebo that a robot's blocks are for, and the ROS nodes of its plugins.

In Gazebo Classic a node is called as its `<plugin>` tag is (gazebo_ros, node.cpp), in
Gazebo Sim always the same (gz_ros2_control_plugin.cpp).
"""

from collections.abc import Iterator
from pathlib import Path

from arm_drake.description.controller_manager_parameters import (
    PLUGIN_NODES,
    PLUGIN_PARAMETERS,
)
from arm_drake.description.elements import parse_bool
from arm_drake.description.gazebo import GazeboPlugin
from arm_drake.description.parameters import Parameter, Parameters
from arm_drake.description.report import LoadReport, Severity
from arm_drake.description.robot import Robot
from arm_drake.description.ros2_control import CLASSIC, SIMULATOR_PLUGINS, HardwareInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import suggest

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


def parse_sdf_bool(text: str) -> bool | None:
    """Return the bool that a text is to SDF, or None."""
    return parse_bool({"1": "true", "0": "false"}.get(text, text))


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
            where = place_of(plugin)
            file = description.file
            report.add("info", "ignored", what, _NO_EFFECT, where=where, file=file)


def place_of(plugin: GazeboPlugin) -> str:
    """Return how a plugin is called in the report."""
    return f"Gazebo plugin {plugin.name or plugin.filename!r}"


def _places(parameters: Parameters) -> set[tuple[str, Path, int]]:
    return {_place(name, parameter) for name, parameter in parameters.items()}


def _place(name: str, parameter: Parameter) -> tuple[str, Path, int]:
    return name, parameter.file, parameter.line
