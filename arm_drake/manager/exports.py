"""The topics of controllers as ports of the diagram."""

from collections.abc import Mapping

from pydrake.systems.framework import DiagramBuilder

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.report import LoadReport


def exported_name(port: str, controller: str) -> str:
    """Return what a port is called in the diagram, without its robot's prefix.

    A name with a slash in front, as Gazebo's topics have, is its own.

    Args:
        port: Name of a controller's port.
        controller: Name of the controller.

    Returns:
        The name; empty if the port is no topic.
    """
    if interfaces.is_internal(port):
        return ""
    return port if port.startswith("/") else f"{controller}.{port}"


def with_prefix(prefix: str, name: str) -> str:
    """Return an exported name with that of its robot in front, if there are several."""
    return f"{prefix}{name.removeprefix('/')}" if prefix else name


def export_topics(
    builder: DiagramBuilder,
    systems: Mapping[str, ControllerInterface],
    prefix: str,
    report: LoadReport,
) -> None:
    """Export the ports of controllers that are topics: all but their interfaces.

    A topic with a name of its own may have several readers, and one publisher.
    """
    readers: set[str] = set()
    publishers: dict[str, str] = {}
    for name, system in systems.items():
        for index in range(system.num_input_ports()):
            port = system.get_input_port(index)
            topic = exported_name(port.get_name(), name)
            if topic in readers:
                builder.ConnectInput(with_prefix(prefix, topic), port)
            elif topic:
                builder.ExportInput(port, with_prefix(prefix, topic))
                readers.add(topic)
        for index in range(system.num_output_ports()):
            output = system.get_output_port(index)
            topic = exported_name(output.get_name(), name)
            first = publishers.setdefault(topic, name) if topic else name
            if first != name:
                what = f"{first!r} and {name!r} publish on the topic {topic!r}"
                done = f"what {first!r} publishes is there"
                report.add("warning", "unsupported", what, done)
            elif topic:
                builder.ExportOutput(output, with_prefix(prefix, topic))
