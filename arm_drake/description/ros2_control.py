"""`<ros2_control>` blocks of a URDF to HardwareInfo.

Follows `hardware_interface/src/component_parser.cpp` of ros2_control. What makes it
reject a description is a line in the report here, and the element concerned is left
out.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from arm_drake.description.elements import (
    ElementReader,
    attribute,
    parse_number,
    text_of,
)
from arm_drake.description.hardware_info import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
    PidGains,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.transmissions import read_transmissions

_TYPES = ("system", "actuator", "sensor")

_BLOCK_ATTRIBUTES = ("name", "type", "rw_rate", "is_async", "thread_priority")
_BLOCK_CHILDREN = (
    "hardware",
    "properties",
    "joint",
    "sensor",
    "gpio",
    "transmission",
)
_INTERFACES = ("command_interface", "state_interface")

# Command interfaces of Gazebo Classic, and the names under which it offers them.
_CLASSIC = "gazebo_ros2_control/GazeboSystem"
_PID_INTERFACES = {"position_pid": "position", "velocity_pid": "velocity"}


def read_hardware(
    root: ET.Element, joint_names: Iterable[str], report: LoadReport, file: Path
) -> tuple[HardwareInfo, ...]:
    """Return the `<ros2_control>` blocks of a URDF.

    Args:
        root: The `<robot>` element.
        joint_names: Joints of the robot.
        report: Where everything that is not taken as written is recorded.
        file: File to name in the report.
    """
    types = {attribute(e, "name"): e.get("type", "") for e in root.iterfind("joint")}
    joints = {name: types.get(name, "") for name in joint_names}
    offered: dict[str, str] = {}
    blocks: list[HardwareInfo] = []
    for element in root.iterfind("ros2_control"):
        reader = _BlockReader(element, joints, offered, report, file)
        block = reader.read()
        if any(other.name == block.name for other in blocks):
            what = "another block has this name; expected distinct names"
            reader.note("warning", "invalid", what, "both are kept")
        blocks.append(block)
    return tuple(blocks)


class _BlockReader(ElementReader):
    """Reads one block."""

    def __init__(
        self,
        block: ET.Element,
        joint_types: Mapping[str, str],
        offered: dict[str, str],
        report: LoadReport,
        file: Path,
    ) -> None:
        """Create the reader.

        Args:
            block: The `<ros2_control>` element.
            joint_types: URDF types of the robot's joints.
            offered: Blocks by the interfaces that they offer; is added to.
            report: Where lines are added.
            file: File to name in them.
        """
        self._block = block
        self._name = attribute(block, "name")
        super().__init__(f"ros2_control {self._name!r}", report, file)
        self._joint_types = joint_types
        self._offered = offered
        self._plugin = text_of(block.find("hardware"), "plugin")

    def read(self) -> HardwareInfo:
        """Return what the block says."""
        block, hardware = self._block, ET.Element("hardware")
        self.check(block, _BLOCK_ATTRIBUTES, _BLOCK_CHILDREN)
        if not self._name:
            self.note("warning", "missing", "the block has no name", "it is kept")
        for index, element in enumerate(block.iterfind("hardware")):
            if index:
                self.note("warning", "invalid", "a second <hardware>", "left out")
                continue
            hardware = element
            self.check(hardware, [], ["plugin", "group", "param"])
        if block.find("properties") is not None:
            what = "<properties> of the driver's thread"
            self.note("info", "ignored", what, "the simulator has no such thread")
        block_type = self._type()
        joints = tuple(self._components("joint"))
        if block_type == "actuator" and len(joints) != 1:
            what = f"an actuator has one joint, got {len(joints)}"
            self.note("warning", "invalid", what, "they are kept")
        priority = self.integer(block, "thread_priority", 1)
        return HardwareInfo(
            name=self._name,
            type=block_type,
            plugin=self._plugin,
            joints=joints,
            sensors=tuple(self._components("sensor")),
            gpios=tuple(self._components("gpio")),
            parameters=self.parameters(hardware),
            transmissions=read_transmissions(
                block, block_type, [joint.name for joint in joints], self
            ),
            group=text_of(hardware, "group"),
            rw_rate=self.integer(block, "rw_rate", 0) or 0,
            is_async=self.boolean(block, "is_async") or False,
            thread_priority=50 if priority is None else priority,
        )

    def _type(self) -> str:
        text = attribute(self._block, "type")
        found = text.lower() if text.lower() in _TYPES else _TYPES[0]
        if text != found:
            what = f"type {text!r}; expected one of {', '.join(_TYPES)}"
            self.note("warning", "invalid", what, f"taken as {found!r}")
        return found

    def _components(self, tag: str) -> Iterator[ComponentInfo]:
        for element in self._block.iterfind(tag):
            name = attribute(element, "name")
            if not name:
                problem, done = f"a <{tag}> has no name", "its interfaces are left out"
                self.note("error", "invalid", problem, done)
                continue
            # Drivers of arms keep such values of their own as joints.
            done = "its interfaces are kept as plain values"
            if tag == "joint" and name not in self._joint_types:
                problem = f"the robot has no joint {name!r}"
                self.note("warning", "missing", problem, done)
            elif tag == "joint" and self._joint_types[name] == "fixed":
                problem = f"joint {name!r} is fixed; expected one that moves"
                self.note("warning", "invalid", problem, done)
            yield self._component(element, name)

    def _component(self, element: ET.Element, name: str) -> ComponentInfo:
        where = f"{element.tag} {name!r}"
        is_joint, is_gpio = element.tag == "joint", element.tag == "gpio"
        self.check(
            element,
            ["name", "mimic"] if is_joint else ["name"],
            [*_INTERFACES, "param"] if is_gpio else [*_INTERFACES, "limits", "param"],
            where,
        )
        parameters = self.parameters(element, where)
        commands, states = (
            tuple(self._interfaces(element, tag, where)) for tag in _INTERFACES
        )
        return ComponentInfo(
            name=name,
            command_interfaces=commands,
            state_interfaces=states,
            parameters=parameters,
            is_mimic=self.boolean(element, "mimic", where) if is_joint else None,
            enable_limits=self._enables_limits(element, where),
            position_pid=self._gains(parameters, "pos_", where),
            velocity_pid=self._gains(parameters, "vel_", where),
        )

    def _interfaces(
        self, component: ET.Element, tag: str, where: str
    ) -> Iterator[InterfaceInfo]:
        for element in component.iterfind(tag):
            name = attribute(element, "name")
            if not name:
                what = f"a <{tag}> has no name"
                self.note("error", "invalid", what, "it is left out", where)
                continue
            if self._plugin == _CLASSIC and tag == "command_interface":
                name = _PID_INTERFACES.get(name, name)
            full = f"{tag} {attribute(component, 'name')}/{name}"
            if full in self._offered:
                what = f"block {self._offered[full]!r} has <{tag}> {name!r} already"
                self.note("warning", "invalid", what, "it is taken once", where)
                continue
            self._offered[full] = self._name
            yield self._interface(element, name, component.tag == "joint", where)

    def _interface(
        self, element: ET.Element, name: str, is_numeric: bool, where: str
    ) -> InterfaceInfo:
        inside = f"{where}, {element.tag} {name!r}"
        self.check(element, ["name", "data_type", "size"], ["param", "limits"], inside)
        parameters = self.parameters(element, inside)
        if is_numeric:
            low, high = (
                self.number(parameters.get(key), f"{name}, {key}", where)
                for key in ("min", "max")
            )
            initial = self.finite(
                parameters.get("initial_value"), f"{name}, initial_value", where
            )
        else:
            low, high, initial = (
                parse_number(parameters.get(key, ""))
                for key in ("min", "max", "initial_value")
            )
        if low is not None and high is not None and low > high:
            what = f"{name}: min {low} is above max {high}"
            self.note("warning", "invalid", what, "taken as not given", where)
            low = high = None
        return InterfaceInfo(
            name=name,
            min=low,
            max=high,
            initial_value=initial,
            parameters=parameters,
            data_type=attribute(element, "data_type") or "double",
            size=self.integer(element, "size", 1, inside) or 1,
            enable_limits=self._enables_limits(element, inside),
        )

    def _enables_limits(self, element: ET.Element, where: str) -> bool:
        limits = element.find("limits")
        if limits is None:
            return True
        self.check(limits, ["enable"], [], where)
        if limits.get("enable") is None:
            what = 'expected <limits enable="...">'
            self.note("warning", "missing", what, "the limits hold", where)
        return self.boolean(limits, "enable", where) is not False

    def _gains(
        self, parameters: Mapping[str, str], prefix: str, where: str
    ) -> PidGains | None:
        names = [field.name for field in dc.fields(PidGains)]
        if not any(prefix + name in parameters for name in names[:3]):
            return None
        values = {}
        for name in (n for n in names if prefix + n in parameters):
            text = parameters[prefix + name]
            number = parse_number(text)
            if number is None:
                # Without one of its gains, a PID could do anything.
                what = f"{prefix}{name}: expected a number, got {text!r}"
                done = "the joint servo has its own gains"
                self.note("warning", "invalid", what, done, where)
                return None
            values[name] = number
        return PidGains(**values)
