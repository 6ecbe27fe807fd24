"""The command `arm-drake graph`: a picture of what controls a robot."""

import argparse
import dataclasses as dc
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.robot import Robot
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.manager.loading import load_controllers_of
from arm_drake.output_files import check_suffix, check_writable, writing
from arm_drake.visualization.control_graph import (
    ControlGraph,
    ControllerNode,
    HardwareNode,
    make_dot,
)

GRAPH_SUFFIXES = (".svg", ".png", ".pdf", ".dot")


def run_graph(options: argparse.Namespace, load: Callable[[], Robot]) -> int:
    """Draw what controls a robot as the command line says; return the exit code."""
    check_suffix(options.output, "a graph", GRAPH_SUFFIXES)
    check_writable(options.output)
    robot = load()
    controllers, report = load_controllers_of(robot)
    if options.strict:
        report.check()
    for entry in report:
        if entry.severity != "info":
            print(entry, file=sys.stderr)
    graph = make_graph(robot, controllers)
    save_graph(graph, options.output)
    if options.json:
        content = {
            **dc.asdict(graph),
            "robot": robot.name,
            "graph": str(options.output),
            "report": report.to_json(),
        }
        print(json.dumps(content))
    else:
        print(f"graph: {options.output}")
    return 0


def save_graph(graph: ControlGraph, path: Path) -> None:
    """Write a graph as a picture of the type that the suffix says, or for Graphviz."""
    check_suffix(path, "a graph", GRAPH_SUFFIXES)
    if path.suffix == ".dot":
        with writing(path):
            path.write_text(make_dot(graph), encoding="utf-8")
    else:
        # Not at the top: text must not wait for matplotlib.
        from arm_drake.visualization.graph_picture import draw_graph

        draw_graph(graph).save(path)


def make_graph(robot: Robot, controllers: Sequence[LoadedController]) -> ControlGraph:
    """Return the graph of a robot."""
    hardware = _hardware(robot)
    nodes = tuple(_controller(c, hardware, controllers) for c in controllers)
    chains = (
        f"{node.name} commands {', '.join(node.followers)}"
        for node in nodes
        if node.followers
    )
    return ControlGraph(
        robot=robot.title,
        controllers=nodes,
        hardware=hardware,
        notes=(*chains, *_other_joints(robot, hardware)),
    )


def _controller(
    controller: LoadedController,
    hardware: Sequence[HardwareNode],
    others: Sequence[LoadedController],
) -> ControllerNode:
    states = {name for node in hardware for name in node.states}
    commands = {name for node in hardware for name in node.commands}
    system = controller.system
    node = ControllerNode(controller.name, controller.type, controller.state)
    if system is None:
        return node
    return dc.replace(
        node,
        inputs=_topics(system, is_input=True),
        outputs=_topics(system, is_input=False),
        # What is missing is why the controller isn't active, and in the report.
        reads=tuple(name for name in system.state_interfaces if name in states),
        commands=tuple(name for name in system.command_interfaces if name in commands),
        followers=tuple(
            other.name
            for other in others
            if other.system is not None
            and set(other.system.reference_interfaces) & set(system.command_interfaces)
        ),
    )


def _topics(system: ControllerInterface, *, is_input: bool) -> tuple[str, ...]:
    """Return the ports of a controller that are topics."""
    if is_input:
        ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    else:
        ports = [system.get_output_port(i) for i in range(system.num_output_ports())]
    names = [port.get_name() for port in ports]
    return tuple(name for name in names if not interfaces.is_internal(name))


def _hardware(robot: Robot) -> tuple[HardwareNode, ...]:
    nodes = []
    for block in robot.description.hardware:
        components = (*block.joints, *block.sensors, *block.gpios)
        plugin = f"{block.plugin}, " if block.plugin else ""
        nodes.append(
            HardwareNode(
                name=block.name,
                notes=(f"{block.type}: {plugin}simulated by Drake",),
                states=tuple(
                    f"{component.name}/{interface.name}"
                    for component in components
                    for interface in component.state_interfaces
                ),
                commands=tuple(
                    f"{component.name}/{interface.name}"
                    for component in components
                    for interface in component.command_interfaces
                ),
            )
        )
    return tuple(nodes)


def _other_joints(robot: Robot, hardware: Iterable[HardwareNode]) -> Iterator[str]:
    """Yield a line for each movable joint that has no interface."""
    names = [name for node in hardware for name in (*node.states, *node.commands)]
    known = {name.rpartition("/")[0] for name in names}
    for joint in robot.description.movable_joints:
        if joint.name not in known:
            mimic = f", follows {joint.mimic.joint}" if joint.mimic else ""
            yield f"{joint.name}: no interface{mimic}"
