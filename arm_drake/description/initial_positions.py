"""Initial positions of joints, as `<ros2_control>` and the user give them."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from arm_drake.arrays import is_finite
from arm_drake.description.elements import ElementReader
from arm_drake.description.joints import last_master
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import ComponentInfo, HardwareInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError, suggest

_POSITION = "position"

# Positions nearer to each other are the same [rad] or [m].
_TOLERANCE = 1e-6


def initial_values(
    hardware: Sequence[HardwareInfo], report: LoadReport, file: Path
) -> dict[str, float]:
    """Return initial positions [rad] or [m] by joint, where the blocks give one.

    That is `initial_value` of the position's state interface, as Gazebo and
    `mock_components/GenericSystem` read it; else that of its command interface; else
    the joint's parameter `initial_position`, the form up to Galactic.
    """
    values: dict[str, float] = {}
    for block in hardware:
        for joint in block.joints:
            reader = ElementReader(f"ros2_control {block.name!r}", report, file)
            where = f"joint {joint.name!r}"
            for place, value in _positions(joint, reader, where):
                used = values.setdefault(joint.name, value)
                if value != used:
                    what = f"{place} is {value}, but another place says {used}"
                    reader.note(
                        "warning", "invalid", what, f"it starts at {used}", where
                    )
            _report_others(joint, reader, where)
    return values


def _positions(
    joint: ComponentInfo, reader: ElementReader, where: str
) -> Iterator[tuple[str, float]]:
    """Yield places that give an initial position, and what they say; first counts."""
    for kind, interfaces in (
        ("state", joint.state_interfaces),
        ("command", joint.command_interfaces),
    ):
        for interface in interfaces:
            if interface.name == _POSITION and interface.initial_value is not None:
                yield f"initial_value of the {kind} interface", interface.initial_value
    text = joint.parameters.get("initial_position")
    value = reader.finite(text, "initial_position", where)
    if value is not None:
        yield "<param> 'initial_position'", value


def _report_others(joint: ComponentInfo, reader: ElementReader, where: str) -> None:
    """Report that no other quantity has an initial value here."""
    interfaces = (*joint.state_interfaces, *joint.command_interfaces)
    found = {
        f"initial_value of {interface.name!r}": interface.initial_value
        for interface in interfaces
        if interface.name != _POSITION and interface.initial_value
    }
    for name in {interface.name for interface in interfaces} - {_POSITION}:
        key = f"initial_{name}"
        value = reader.finite(joint.parameters.get(key), key, where)
        if value:
            found[f"<param> {key!r}"] = value
    for place, value in sorted(found.items()):
        what = f"{place} is {value}"
        reader.note("info", "unsupported", what, "the robot starts at rest", where)


def find_initial_positions(
    description: RobotDescription, requested: dict[str, float], report: LoadReport
) -> dict[str, float]:
    """Return where the joints start [rad] or [m]: within their limits."""
    movable = {joint.name: joint for joint in description.movable_joints}
    for name in requested:
        if name not in movable:
            raise InputError(
                f"initial position of joint {name!r}: the robot has no such joint; "
                f"{suggest(name, movable)}"
            )
    values = initial_values(description.hardware, report, description.file)
    positions: dict[str, float] = {}
    for name, joint in movable.items():
        position = requested.get(name, values.get(name, 0.0))
        if not is_finite(position):
            problem = f"expected a finite number, got {position!r}"
            raise InputError(problem, where=f"joint {name!r}")
        if joint.mimic is None:
            lower, upper = joint.limits.range
            positions[name] = min(max(position, lower), upper)
            if positions[name] != position:
                what = f"initial position {position} is outside [{lower}, {upper}]"
                done, where = f"it starts at {positions[name]}", f"joint {name!r}"
                report.add(
                    "warning", "repair", what, done, where=where, file=description.file
                )
    for name, joint in movable.items():
        if joint.mimic is None:
            continue
        master, factor, offset = last_master(joint, movable)
        position = positions[name] = factor * positions[master] + offset
        what = f"the joint follows {joint.mimic.joint!r}, which puts it at {position}"
        if abs(requested.get(name, position) - position) > _TOLERANCE:
            problem = f"{what}, not at {requested[name]}; give {master!r} a position"
            raise InputError(problem, where=f"joint {name!r}")
        if abs(values.get(name, position) - position) > _TOLERANCE:
            done = f"its initial value {values[name]} is left out"
            where, file = f"joint {name!r}", description.file
            report.add("warning", "invalid", what, done, where=where, file=file)
    return {name: positions[name] for name in movable}
