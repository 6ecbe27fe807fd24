"""Which joints follow others: `<mimic>` of the URDF and what `<ros2_control>` says.

Newer ros2_control takes the URDF's `<mimic>`, unless the joint in the block has
`mimic="false"`. Up to Humble, a block's joint had the parameters `mimic` and
`multiplier` instead. Either way a joint that follows takes no commands.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from arm_drake.description.elements import ElementReader, attribute
from arm_drake.description.hardware_info import ComponentInfo, HardwareInfo
from arm_drake.description.joints import MOVABLE_TYPES, JointInfo, Mimic
from arm_drake.description.report import LoadReport
from arm_drake.errors import suggest


def find_mimics(
    joints: Sequence[JointInfo],
    hardware: Sequence[HardwareInfo],
    report: LoadReport,
    file: Path,
) -> tuple[JointInfo, ...]:
    """Return the joints with the mimic that holds.

    Args:
        joints: Joints of the URDF, whose `<mimic>` relations make no circle.
        hardware: Blocks of the description.
        report: Where relations are recorded that differ from what is written.
        file: File to name in the report.
    """
    found = {joint.name: joint for joint in joints}
    components = [
        (component, block)
        for block in hardware
        for component in block.joints
        if component.name in found
    ]
    for component, _ in components:
        if component.is_mimic is False:
            found[component.name] = dc.replace(found[component.name], mimic=None)
    for component, block in components:
        finder = _Finder(f"ros2_control {block.name!r}", report, file)
        joint = found[component.name]
        mimic = finder.find(joint, component, block, found)
        found[component.name] = dc.replace(joint, mimic=mimic)
    return tuple(found.values())


def write_mimics(root: ET.Element, joints: Sequence[JointInfo]) -> None:
    """Give the joints of a URDF the `<mimic>` that holds.

    Args:
        root: The `<robot>` element, changed in place.
        joints: Joints with the mimic that holds.
    """
    found = {joint.name: joint.mimic for joint in joints}
    for element in root.iterfind("joint"):
        for mimic in element.findall("mimic"):
            element.remove(mimic)
        relation = found.get(attribute(element, "name"))
        if relation is not None:
            ET.SubElement(
                element,
                "mimic",
                joint=relation.joint,
                multiplier=repr(relation.multiplier),
                offset=repr(relation.offset),
            )


class _Finder(ElementReader):
    """Finds the mimic relation of one joint of a block."""

    def find(
        self,
        joint: JointInfo,
        component: ComponentInfo,
        block: HardwareInfo,
        joints: Mapping[str, JointInfo],
    ) -> Mimic | None:
        """Return the relation that holds, with lines about what is overridden."""
        where = f"joint {joint.name!r}"
        mimic, old = joint.mimic, component.parameters.get("mimic")
        if component.is_mimic is False:
            if old:
                what = f"mimic=\"false\", but <param> 'mimic' is {old!r}"
                self.note("warning", "invalid", what, "it moves on its own", where)
            return None
        if mimic is None and old:
            mimic = self._from_parameters(joint, component, joints, where)
        elif mimic is not None and old:
            self._compare(mimic, component, where)
        elif mimic is None and component.is_mimic:
            what = 'mimic="true", but the URDF\'s joint has no <mimic>'
            self.note("error", "invalid", what, "it moves on its own", where)
        if mimic is None:
            return None
        if component.command_interfaces:
            names = [interface.name for interface in component.command_interfaces]
            what = f"command interfaces {names} of a mimic joint"
            done = f"what they get has no effect; it follows {mimic.joint!r}"
            self.note("warning", "invalid", what, done, where)
        if all(other.name != mimic.joint for other in block.joints):
            what = f"the block lacks {mimic.joint!r}, which the joint mimics"
            self.note("warning", "missing", what, "it follows all the same", where)
        return mimic

    def _from_parameters(
        self,
        joint: JointInfo,
        component: ComponentInfo,
        joints: Mapping[str, JointInfo],
        where: str,
    ) -> Mimic | None:
        """Return the relation in the old form, or None if it is impossible."""
        master, multiplier = self._parameters(component, where)
        problem, is_fixed = None, joint.type == "fixed"
        if not joint.is_movable:
            problem = f"mimics {master!r}, but is {joint.type}"
        elif master not in joints:
            problem = f"mimics {master!r}, which doesn't exist; "
            problem += suggest(master, joints)
        elif not joints[master].is_movable:
            kind, expected = joints[master].type, ", ".join(MOVABLE_TYPES)
            problem = f"mimics {master!r}, which is {kind}; expected one of {expected}"
        elif component.name in _masters(master, joints):
            problem = f"mimics itself, through {master!r}"
        if problem is not None:
            done = "it is fixed" if is_fixed else "it moves on its own"
            self.note("error", "invalid", problem, done, where)
            return None
        what = f"<param> 'mimic', which is the form up to Humble, names {master!r}"
        self.note("info", "repair", what, "taken as the URDF's <mimic>", where)
        return Mimic(master, multiplier)

    def _compare(self, mimic: Mimic, component: ComponentInfo, where: str) -> None:
        """Say if the old form contradicts the URDF's `<mimic>`."""
        master, multiplier = self._parameters(component, where)
        if (master, multiplier) != (mimic.joint, mimic.multiplier):
            what = (
                f"<param> 'mimic' says {multiplier} * {master!r}, "
                f"the URDF's <mimic> {mimic.multiplier} * {mimic.joint!r}"
            )
            self.note("warning", "invalid", what, "the URDF counts", where)

    def _parameters(self, component: ComponentInfo, where: str) -> tuple[str, float]:
        text = component.parameters.get("multiplier")
        multiplier = self.finite(text, "multiplier", where)
        return component.parameters["mimic"], 1.0 if multiplier is None else multiplier


def _masters(name: str, joints: Mapping[str, JointInfo]) -> list[str]:
    """Return a joint and those that it follows, the nearest first."""
    found = [name]
    while (mimic := joints[found[-1]].mimic) is not None:
        found.append(mimic.joint)
    return found
