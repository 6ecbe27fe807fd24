"""`<ros2_control>` blocks of a URDF, read into HardwareInfo.

Names of classes and fields follow `hardware_interface/hardware_info.hpp` of
ros2_control, the rules its `hardware_interface/src/component_parser.cpp`. What makes
that reject a description is a line in the report here, and the element concerned is
left out.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from arm_drake import interfaces
from arm_drake.description.elements import (
    ElementReader,
    attribute,
    parse_number,
    text_of,
)
from arm_drake.description.report import LoadReport
from arm_drake.errors import MISSPELT, did_you_mean, quoted, suggest
from arm_drake.importing import dataclass


@dataclass(frozen=True)
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

    # Type of its value in C++, such as "double", and how many it has.
    data_type: str = "double"
    size: int = 1

    # Whether its limits hold, as `<limits enable>` says.
    enable_limits: bool = True


@dataclass(frozen=True)
class PidGains:
    """Gains that `gazebo_ros2_control/GazeboSystem` gives a joint.

    Upstream's lower limit of the integral is DBL_MIN where none is given, which is the
    smallest positive number and no limit that was meant; here it is -inf.
    """

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    max_integral_error: float = math.inf
    min_integral_error: float = -math.inf


@dataclass(frozen=True)
class ComponentInfo:
    """A `<joint>`, `<sensor>` or `<gpio>` of a hardware block."""

    name: str
    command_interfaces: tuple[InterfaceInfo, ...] = ()
    state_interfaces: tuple[InterfaceInfo, ...] = ()

    # All `<param>` values, as text.
    parameters: dict[str, str] = dc.field(default_factory=dict)

    # Attribute `mimic` of a joint, None where it is not given.
    is_mimic: bool | None = None

    # Whether limits hold for any of its interfaces, as `<limits enable>` says.
    enable_limits: bool = True

    # Gains of joint parameters such as `pos_kp` and `vel_kp`, None without any.
    position_pid: PidGains | None = None
    velocity_pid: PidGains | None = None


@dataclass(frozen=True)
class TransmissionJointInfo:
    """A `<joint>` of a transmission."""

    name: str

    # Such as "joint1".
    role: str

    mechanical_reduction: float = 1.0

    # [rad] or [m].
    offset: float = 0.0

    read_only: bool = False


class ActuatorInfo(TransmissionJointInfo):
    """An `<actuator>` of a transmission."""


@dataclass(frozen=True)
class TransmissionInfo:
    """A `<transmission>` of a hardware block."""

    name: str

    # Plugin class, such as "transmission_interface/SimpleTransmission".
    type: str

    joints: tuple[TransmissionJointInfo, ...] = ()
    actuators: tuple[ActuatorInfo, ...] = ()
    parameters: dict[str, str] = dc.field(default_factory=dict)


@dataclass(frozen=True)
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

    # `<param>` values of `<hardware>`, as text.
    parameters: dict[str, str] = dc.field(default_factory=dict)

    transmissions: tuple[TransmissionInfo, ...] = ()

    # Group of blocks whose errors concern each other.
    group: str = ""

    # Rate of reading and writing [Hz]; 0 is the manager's.
    rw_rate: int = 0

    # How the driver's thread runs.
    is_async: bool = False
    thread_priority: int = 50


_END_ATTRIBUTES = ("name", "role", "read_only")
_END_CHILDREN = ("mechanical_reduction", "offset")


def read_transmissions(
    block: ET.Element, block_type: str, joints: Sequence[str], reader: ElementReader
) -> tuple[TransmissionInfo, ...]:
    """Return the transmissions of a block."""
    found = []
    for element in block.iterfind("transmission"):
        name = attribute(element, "name")
        where = f"transmission {name!r}"
        reader.check(element, ["name"], ["plugin", "joint", "actuator", "param"], where)
        transmission = TransmissionInfo(
            name=name,
            type=text_of(element, "plugin"),
            joints=tuple(
                TransmissionJointInfo(*end) for end in _ends(element, "joint", reader)
            ),
            actuators=tuple(
                ActuatorInfo(*end) for end in _ends(element, "actuator", reader)
            ),
            parameters=reader.parameters(element, where),
        )
        problem = _problem(transmission, block_type, joints)
        if problem is None:
            found.append(transmission)
        else:
            reader.note("warning", "invalid", problem, "it is left out", where)
    return tuple(found)


def _ends(
    element: ET.Element, tag: str, reader: ElementReader
) -> Iterator[tuple[str, str, float, float, bool]]:
    for end in element.iterfind(tag):
        name = attribute(end, "name")
        where = f"transmission {attribute(element, 'name')!r}, {tag} {name!r}"
        reader.check(end, _END_ATTRIBUTES, _END_CHILDREN, where)
        reduction, offset = (
            reader.finite(end.findtext(child), child, where) for child in _END_CHILDREN
        )
        if reduction == 0.0:
            what = "mechanical_reduction: expected a number other than 0"
            reader.note("warning", "invalid", what, "taken as not given", where)
        is_read_only = reader.boolean(end, "read_only", where) or False
        role = attribute(end, "role")
        yield name, role, reduction or 1.0, offset or 0.0, is_read_only


def _problem(
    transmission: TransmissionInfo, block_type: str, joints: Sequence[str]
) -> str | None:
    """Return why ros2_control refuses a transmission, or None."""
    if not transmission.name:
        return "a <transmission> has no name"
    if not transmission.type:
        return "no <plugin>"
    ends = (*transmission.joints, *transmission.actuators)
    if not all(end.name and end.role for end in ends):
        return "each joint and actuator needs a name and a role"
    for end in transmission.joints:
        if end.name not in joints:
            return f"the block has no joint {end.name!r}; {suggest(end.name, joints)}"
    if block_type == "actuator" and len(transmission.joints) != 1:
        return f"an actuator has one joint, got {len(transmission.joints)}"
    return None


_TYPES = ("system", "actuator", "sensor")

_BLOCK_ATTRIBUTES = ("name", "type", "rw_rate", "is_async", "thread_priority")
_BLOCK_CHILDREN = ("hardware", "properties", "joint", "sensor", "gpio", "transmission")
_INTERFACES = ("command_interface", "state_interface")

# Parameters of an interface that are read; drivers have others.
_NUMBERS = ("min", "max", "initial_value")

# Command interfaces of Gazebo Classic, and the names under which it offers them.
_PID_INTERFACES = {"position_pid": "position", "velocity_pid": "velocity"}


def read_hardware(
    root: ET.Element, joint_names: Iterable[str], report: LoadReport, file: Path
) -> tuple[HardwareInfo, ...]:
    """Return the `<ros2_control>` blocks of a URDF."""
    types = {attribute(e, "name"): e.get("type", "") for e in root.iterfind("joint")}
    joints = {name: types.get(name, "") for name in joint_names}
    owners: dict[str, str] = {}
    blocks: list[HardwareInfo] = []
    for element in root.iterfind("ros2_control"):
        reader = _BlockReader(element, joints, owners, report, file)
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
        owners: dict[str, str],
        report: LoadReport,
        file: Path,
    ) -> None:
        """Create the reader."""
        self._block = block
        self._name = attribute(block, "name")
        super().__init__(f"ros2_control {self._name!r}", report, file)
        self._joint_types = joint_types
        self._owners = owners
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
        taken: dict[str, list[str]] = {}
        for element in component.iterfind(tag):
            name = attribute(element, "name")
            if not name:
                what = f"a <{tag}> has no name"
                self.note("error", "invalid", what, "it is left out", where)
                continue
            is_classic = SIMULATOR_PLUGINS.get(self._plugin) == CLASSIC
            if is_classic and tag == "command_interface":
                name = _PID_INTERFACES.get(name, name)
            full = f"{tag} {attribute(component, 'name')}/{name}"
            if full in self._owners:
                taken.setdefault(self._owners[full], []).append(repr(name))
                continue
            self._owners[full] = self._name
            yield self._interface(element, name, component.tag == "joint", where)
        for owner, names in taken.items():
            what = f"block {owner!r} has <{tag}> {', '.join(names)} already"
            done = "it is taken once" if len(names) == 1 else "each is taken once"
            self.note("warning", "invalid", what, done, where)

    def _interface(
        self, element: ET.Element, name: str, is_numeric: bool, where: str
    ) -> InterfaceInfo:
        inside = f"{where}, {element.tag} {name!r}"
        self.check(element, ["name", "data_type", "size"], ["param", "limits"], inside)
        parameters = self.parameters(element, inside)
        others = [key for key in parameters if is_numeric and key not in _NUMBERS]
        for key in others:
            if hint := did_you_mean(key, _NUMBERS, MISSPELT):
                what = f"<param> {key!r}{hint}"
                self.note("warning", "ignored", what, "it has no effect", inside)
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
                parse_number(parameters.get(key, "")) for key in _NUMBERS
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


# The simulator whose blocks give joints PID gains.
CLASSIC = "Gazebo Classic"

# Plugins that are simulators themselves.
SIMULATOR_PLUGINS = {
    "gz_ros2_control/GazeboSimSystem": "Gazebo Sim",
    "ign_ros2_control/IgnitionSystem": "Ignition Gazebo",
    "gazebo_ros2_control/GazeboSystem": CLASSIC,
    "mock_components/GenericSystem": "mock hardware",
    "fake_components/GenericSystem": "mock hardware",
}

# Packages whose hardware, and simulations of it, add to efforts what holds the robot.
_HOLDING = {
    "franka_hardware",
    "franka_gazebo_hardware",
    "franka_ign_ros2_control",
    "lbr_ros2_control",
}

# Parameters of joints that are read.
_READ = {"mimic", "multiplier"}
_READ |= {f"initial_{name}" for name in interfaces.STATE_INTERFACES}
_READ |= {f"{kind}_{f.name}" for kind in ("pos", "vel") for f in dc.fields(PidGains)}

# What a joint can be commanded and can report.
_STANDARD = (*interfaces.STATE_INTERFACES, interfaces.ACCELERATION)


def report_hardware(
    hardware: Sequence[HardwareInfo], report: LoadReport, file: Path
) -> None:
    """Report what the blocks say that has no effect here, a line per sort and block."""
    for block in hardware:
        reader = ElementReader(f"ros2_control {block.name!r}", report, file)
        _report_plugin(block, reader)
        for what, done in _remarks(block):
            reader.note("info", "unsupported", what, done)


def _report_plugin(block: HardwareInfo, reader: ElementReader) -> None:
    done = "the simulator stands in for it"
    if not block.plugin:
        what = "no hardware plugin is named; expected <hardware><plugin>"
        reader.note("warning", "missing", what, done)
        return
    if block.plugin in SIMULATOR_PLUGINS and not block.parameters:
        return  # Another simulator's: no hardware is replaced.
    what = f"hardware plugin {block.plugin!r}"
    if block.plugin in SIMULATOR_PLUGINS:
        what += f" ({SIMULATOR_PLUGINS[block.plugin]})"
    if block.parameters:
        done += f", without its parameters {quoted(block.parameters)}"
    reader.note("info", "ignored", what, done)


def _remarks(block: HardwareInfo) -> Iterable[tuple[str, str]]:
    kept = "kept as plain values, not simulated"
    custom = {
        interface.name
        for joint in block.joints
        for interface in (*joint.command_interfaces, *joint.state_interfaces)
        if interface.name not in _STANDARD
    }
    if custom:
        yield f"interfaces {quoted(sorted(custom))}", kept
    pushed = [
        joint.name
        for joint in block.joints
        if any(i.name == interfaces.EFFORT for i in joint.command_interfaces)
    ]
    if pushed and block.plugin.partition("/")[0] in _HOLDING:
        what = f"efforts of {quoted(pushed)}, to which its hardware adds the robot's "
        yield what + "weight", "they act alone: a controller has to hold it"
    # Of the others `find_sensors` says what becomes of them.
    stored = [
        sensor
        for sensor in block.sensors
        if not any(i.name in interfaces.MEASURED for i in sensor.state_interfaces)
    ]
    for kind, components in (("sensors", stored), ("gpios", block.gpios)):
        if components:
            yield f"{kind} {quoted(c.name for c in components)}", kept
    if block.transmissions:
        names = quoted(transmission.name for transmission in block.transmissions)
        yield f"transmissions {names}", "joints are driven without them"
    gains = [j.name for j in block.joints if j.position_pid or j.velocity_pid]
    # Those of Gazebo Classic drive the joints, see drive_gains.
    if gains and SIMULATOR_PLUGINS.get(block.plugin) != CLASSIC:
        yield f"PID gains of joints {quoted(gains)}", "the joint servo has its own"
    others = {name for joint in block.joints for name in joint.parameters} - _READ
    if others:
        yield f"joint parameters {quoted(sorted(others))}", kept
    usual = HardwareInfo(block.name, block.type, block.plugin)
    timing = ("rw_rate", "is_async", "thread_priority", "group")
    changed = [name for name in timing if getattr(block, name) != getattr(usual, name)]
    if changed:
        done = "the hardware is read and written at every tick of the manager"
        yield ", ".join(changed), done
