"""`<ros2_control>` blocks and Gazebo plugin tags, as frozen dataclasses.

Field names follow `hardware_interface/hardware_info.hpp` of ros2_control.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from arm_drake.description.report import LoadReport


@dc.dataclass(frozen=True)
class InterfaceInfo:
    """A command or state interface of a component."""

    # Such as "position".
    name: str

    # Limits of a command interface, in the unit of the interface.
    min: float | None = None
    max: float | None = None

    # Value at the start.
    initial_value: float | None = None

    # All `<param>` values, as text.
    parameters: dict[str, str] = dc.field(default_factory=dict)


@dc.dataclass(frozen=True)
class ComponentInfo:
    """A `<joint>`, `<sensor>` or `<gpio>` of a hardware block."""

    name: str
    command_interfaces: tuple[InterfaceInfo, ...] = ()
    state_interfaces: tuple[InterfaceInfo, ...] = ()
    parameters: dict[str, str] = dc.field(default_factory=dict)

    def has_command_interface(self, name: str) -> bool:
        """Return whether the component accepts this quantity."""
        return any(interface.name == name for interface in self.command_interfaces)


@dc.dataclass(frozen=True)
class HardwareInfo:
    """A `<ros2_control>` block."""

    name: str

    # "system", "actuator" or "sensor".
    type: str

    # Plugin class of the real or simulated driver; the simulator stands in for it.
    plugin: str

    joints: tuple[ComponentInfo, ...] = ()
    sensors: tuple[ComponentInfo, ...] = ()
    gpios: tuple[ComponentInfo, ...] = ()
    parameters: dict[str, str] = dc.field(default_factory=dict)


@dc.dataclass(frozen=True)
class GazeboPlugin:
    """A `<plugin>` tag below `<gazebo>`."""

    name: str
    filename: str

    # Texts of its children by tag, in order; a tag may occur several times.
    fields: tuple[tuple[str, str], ...] = ()

    def texts(self, tag: str) -> tuple[str, ...]:
        """Return the texts of all children with this tag."""
        return tuple(text for name, text in self.fields if name == tag)


def read_hardware(
    root: ET.Element, joint_names: Iterable[str], report: LoadReport, file: Path
) -> tuple[HardwareInfo, ...]:
    """Return the `<ros2_control>` blocks of a URDF.

    Args:
        root: The `<robot>` element.
        joint_names: Joints of the robot.
        report: Where joints that the robot lacks are reported.
        file: File to name in the report.
    """
    blocks = []
    known = set(joint_names)
    for block in root.iterfind("ros2_control"):
        name = _attribute(block, "name")
        hardware = block.find("hardware")
        joints = []
        for joint in (_component(element) for element in block.iterfind("joint")):
            if joint.name in known:
                _report_numbers(joint, name, report, file)
                joints.append(joint)
                continue
            report.add(
                "error",
                "missing",
                f"the robot has no joint {joint.name!r}",
                "the joint's interfaces are left out",
                where=f"ros2_control {name!r}",
                file=file,
            )
        blocks.append(
            HardwareInfo(
                name=name,
                type=_attribute(block, "type").lower(),
                plugin=(hardware.findtext("plugin") or "").strip()
                if hardware is not None
                else "",
                joints=tuple(joints),
                sensors=tuple(map(_component, block.iterfind("sensor"))),
                gpios=tuple(map(_component, block.iterfind("gpio"))),
                parameters={} if hardware is None else _parameters(hardware),
            )
        )
    return tuple(blocks)


def read_gazebo_plugins(root: ET.Element) -> tuple[GazeboPlugin, ...]:
    """Return the plugins in the `<gazebo>` tags of a URDF."""
    return tuple(
        GazeboPlugin(
            name=_attribute(plugin, "name"),
            filename=_attribute(plugin, "filename"),
            fields=tuple(
                (child.tag, (child.text or "").strip())
                for child in plugin
                if isinstance(child.tag, str)
            ),
        )
        for gazebo in root.iterfind("gazebo")
        for plugin in gazebo.iterfind("plugin")
    )


def _report_numbers(
    joint: ComponentInfo, block: str, report: LoadReport, file: Path
) -> None:
    for interface in (*joint.command_interfaces, *joint.state_interfaces):
        for name in ("min", "max", "initial_value"):
            text = interface.parameters.get(name)
            if text is not None and getattr(interface, name) is None:
                report.add(
                    "warning",
                    "invalid",
                    f"{interface.name}, {name}: expected a number, got {text!r}",
                    "taken as not given",
                    where=f"ros2_control {block!r}, joint {joint.name!r}",
                    file=file,
                )


def _component(element: ET.Element) -> ComponentInfo:
    return ComponentInfo(
        name=_attribute(element, "name"),
        command_interfaces=tuple(
            map(_interface, element.iterfind("command_interface"))
        ),
        state_interfaces=tuple(map(_interface, element.iterfind("state_interface"))),
        parameters=_parameters(element),
    )


def _interface(element: ET.Element) -> InterfaceInfo:
    parameters = _parameters(element)
    return InterfaceInfo(
        name=_attribute(element, "name"),
        min=_number(parameters.get("min")),
        max=_number(parameters.get("max")),
        initial_value=_number(parameters.get("initial_value")),
        parameters=parameters,
    )


def _parameters(element: ET.Element) -> dict[str, str]:
    return {
        _attribute(param, "name"): (param.text or "").strip()
        for param in element.iterfind("param")
    }


def _attribute(element: ET.Element, name: str) -> str:
    return (element.get(name) or "").strip()


def _number(text: str | None) -> float | None:
    try:
        number = math.nan if text is None else float(text)
    except ValueError:
        return None
    return None if math.isnan(number) else number
