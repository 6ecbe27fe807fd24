"""Change a URDF into what Drake takes, and record what is changed or lost.

Drake stops at meshes it can't read, at duplicate transmissions, at moving bodies
without mass; it takes an effort limit of 0 literally and ends the process at a
primitive of size 0. What robots' authors got away with under ROS is mended here.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
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
    ("dynamics", "damping"): 1,
    ("dynamics", "friction"): 1,
    ("mimic", "multiplier"): 1,
    ("mimic", "offset"): 1,
    **{("inertia", name): 1 for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")},
}

# Squares and products of larger numbers are more than numbers can hold.
_LARGEST = 1e15


def normalise(
    root: ET.Element,
    file: Path,
    packages: PackageFinder,
    report: LoadReport,
    *,
    decompose: bool = False,
    max_faces: int | None = None,
) -> None:
    """Change a URDF in place into what Drake takes.

    Args:
        root: The `<robot>` element.
        file: File it came from; relative mesh paths start in its folder.
        packages: What resolves package URIs.
        report: Where every change is recorded.
        decompose: Whether a collision mesh becomes several convex parts, not one hull.
        max_faces: Triangles of each mesh that is drawn; by default all.

    Raises:
        DescriptionError: If a number is malformed.
        MissingExtraError: If ``decompose`` or ``max_faces`` needs what isn't installed.
    """
    clean(root, file, report)
    for tag in ("link", "joint"):
        for element in root.iterfind(tag):
            _check_numbers(element, file, f"{tag} {element.get('name')!r}")
    for joint in root.iterfind("joint"):
        _repair_joint(joint, file, report)
    repair_materials(root, file, packages, report)
    repair_geometry(
        root, file, packages, report, decompose=decompose, max_faces=max_faces
    )
    repair_inertials(root, report, file)


def _check_numbers(parent: ET.Element, file: Path, where: str) -> None:
    for element in parent.iter():
        for (tag, attribute), count in _COUNTS.items():
            text = element.get(attribute)
            if element.tag != tag or text is None:
                continue
            found = numbers(text, file, where)
            numeral = f"{count} finite numbers" if count > 1 else "a finite number"
            is_right = len(found) == count and all(map(math.isfinite, found))
            if is_right and max(map(abs, found)) > _LARGEST:
                is_right, numeral = False, f"{numeral} of at most {_LARGEST:g}"
            if not is_right:
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

    if limit is not None:
        _repair_limit(limit, joint.get("type") == "continuous", file, where, add)
    axis = joint.find("axis")
    xyz = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    turns = joint.get("type") not in ("fixed", "floating")
    if turns and not any(numbers(xyz, file, where)):
        problem = "<axis xyz>: expected a direction, got zeros"
        raise DescriptionError(problem, file=file, where=where)
    # Friction is modelled beside the plant; Drake would warn about it.
    if dynamics is not None:
        dynamics.attrib.pop("friction", None)
        if joint.get("type") == "planar" and "damping" in dynamics.attrib:
            # Drake wants one for each degree of freedom.
            dynamics.set("damping", " ".join([dynamics.attrib["damping"]] * 3))


def _repair_limit(
    limit: ET.Element,
    is_continuous: bool,
    file: Path,
    where: str,
    add: Callable[[str, str], None],
) -> None:
    """Remove what means "unset": Drake takes 0 literally, and no inf."""
    for attribute in ("effort", "velocity"):
        text = limit.get(attribute)
        found = numbers(text or "", file, where)
        if text is not None and not any(map(_is_limit, found)):
            del limit.attrib[attribute]
            add(f"{attribute} limit {text}", "taken as unset")
        elif text is not None and found[0] < 0.0:
            limit.set(attribute, repr(-found[0]))
            add(f"{attribute} limit {text}", "taken without its sign")
    ends = {"lower", "upper"} & limit.attrib.keys()
    if ends and is_continuous:
        add("limits of a continuous joint", "it turns without end")
    for end in ends:
        if is_continuous or not any(
            map(math.isfinite, numbers(limit.attrib[end], file, where))
        ):
            del limit.attrib[end]


def _is_limit(number: float) -> bool:
    return math.isfinite(number) and number != 0.0
