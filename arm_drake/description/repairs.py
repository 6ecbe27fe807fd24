"""Change a URDF into what Drake takes, and record what is changed or lost.

Drake stops at meshes it can't read, at duplicate transmissions, at moving bodies
without mass; it takes an effort limit of 0 literally and ends the process at a
primitive of size 0. What robots' authors got away with under ROS is mended here.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from arm_drake.description.cleaning import clean
from arm_drake.description.geometry import repair_geometry
from arm_drake.description.inertia import repair_inertials
from arm_drake.description.materials import repair_materials
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.values import numbers
from arm_drake.errors import DescriptionError

# How many numbers the attributes of these elements hold.
_COUNTS = {
    ("origin", "xyz"): 3,
    ("origin", "rpy"): 3,
    ("axis", "xyz"): 3,
    ("mass", "value"): 1,
    **{("inertia", name): 1 for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")},
}


def normalise(
    root: ET.Element,
    file: Path,
    packages: PackageFinder,
    report: LoadReport,
    *,
    decompose: bool = False,
) -> None:
    """Change a URDF in place into what Drake takes.

    Args:
        root: The `<robot>` element.
        file: File it came from; relative mesh paths start in its folder.
        packages: What resolves package URIs.
        report: Where every change is recorded.
        decompose: Whether a collision mesh becomes several convex parts, not one hull.

    Raises:
        DescriptionError: If a number is malformed.
        MissingExtraError: If ``decompose`` needs what isn't installed.
    """
    clean(root, file, report)
    for tag in ("link", "joint"):
        for element in root.iterfind(tag):
            _check_numbers(element, file, f"{tag} {element.get('name')!r}")
    for joint in root.iterfind("joint"):
        _repair_joint(joint, file, report)
    repair_materials(root, file, packages, report)
    repair_geometry(root, file, packages, report, decompose=decompose)
    repair_inertials(root, report, file)


def _check_numbers(parent: ET.Element, file: Path, where: str) -> None:
    for element in parent.iter():
        for (tag, attribute), count in _COUNTS.items():
            text = element.get(attribute)
            if element.tag != tag or text is None:
                continue
            found = numbers(text, file, where)
            if len(found) != count or not all(map(math.isfinite, found)):
                numeral = f"{count} finite numbers" if count > 1 else "a finite number"
                raise DescriptionError(
                    f"<{tag} {attribute}>: expected {numeral}, got {text!r}",
                    file=file,
                    where=where,
                )


def _repair_joint(joint: ET.Element, file: Path, report: LoadReport) -> None:
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    where = f"joint {joint.get('name')!r}"

    def add(what: str, done: str) -> None:
        report.add("info", "repair", what, done, where=where, file=file)

    # Drake takes an effort limit of 0 literally, and no inf; both mean "unset".
    if limit is not None:
        for attribute in ("effort", "velocity"):
            text = limit.get(attribute)
            found = numbers(text or "", file, where)
            if text is not None and not any(map(_is_limit, found)):
                del limit.attrib[attribute]
                add(f"{attribute} limit {text}", "taken as unset")
        ends = {"lower", "upper"} & limit.attrib.keys()
        if ends and joint.get("type") == "continuous":
            for end in ends:
                del limit.attrib[end]
            add("limits of a continuous joint", "it turns without end")
    # Friction is modelled beside the plant; Drake would warn about it.
    if dynamics is not None:
        dynamics.attrib.pop("friction", None)


def _is_limit(number: float) -> bool:
    return math.isfinite(number) and number != 0.0
