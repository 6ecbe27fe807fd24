"""Where `<ros2_control>` lets joints start."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from arm_drake.description.elements import ElementReader
from arm_drake.description.hardware_info import ComponentInfo, HardwareInfo
from arm_drake.description.report import LoadReport

_POSITION = "position"


def initial_values(
    hardware: Sequence[HardwareInfo], report: LoadReport, file: Path
) -> dict[str, float]:
    """Return initial positions [rad] or [m] by joint, where the blocks give one.

    That is `initial_value` of the position's state interface, as Gazebo and
    `mock_components/GenericSystem` read it; else that of its command interface; else
    the joint's parameter `initial_position`, the form up to Galactic.

    Args:
        hardware: Blocks of the description.
        report: Where values are recorded that are not used.
        file: File to name in the report.
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
    """Say that no other quantity has an initial value here."""
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
