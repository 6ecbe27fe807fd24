"""`<transmission>` tags of a `<ros2_control>` block."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from arm_drake.description.elements import ElementReader, attribute, text_of
from arm_drake.description.hardware_info import (
    ActuatorInfo,
    TransmissionInfo,
    TransmissionJointInfo,
)
from arm_drake.errors import suggest

_END_ATTRIBUTES = ("name", "role", "read_only")
_END_CHILDREN = ("mechanical_reduction", "offset")


def read_transmissions(
    block: ET.Element, block_type: str, joints: Sequence[str], reader: ElementReader
) -> tuple[TransmissionInfo, ...]:
    """Return the transmissions of a block.

    Args:
        block: The `<ros2_control>` element.
        block_type: "system", "actuator" or "sensor".
        joints: Joints of the block.
        reader: What reports transmissions that are left out.
    """
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
        yield (
            name,
            attribute(end, "role"),
            reduction or 1.0,
            offset or 0.0,
            is_read_only,
        )


def _problem(
    transmission: TransmissionInfo, block_type: str, joints: Sequence[str]
) -> str | None:
    """Return why ros2_control refuses a transmission, or None."""
    if not transmission.name:
        return "a <transmission> has no name"
    if not transmission.type:
        return "no <plugin>"
    names = [(end.name, end.role) for end in transmission.joints]
    names += [(end.name, end.role) for end in transmission.actuators]
    if not all(name and role for name, role in names):
        return "each joint and actuator needs a name and a role"
    for end in transmission.joints:
        if end.name not in joints:
            return f"the block has no joint {end.name!r}; {suggest(end.name, joints)}"
    if block_type == "actuator" and len(transmission.joints) != 1:
        return f"an actuator has one joint, got {len(transmission.joints)}"
    return None
