"""Change a URDF into what Drake takes, and record what is changed or lost.

Drake stops at meshes it can't read, at duplicate transmissions, at moving bodies
without mass; it takes an effort limit of 0 literally and ends the process at a
primitive of size 0. What robots' authors got away with under ROS is mended here.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from arm_drake.description.cleaning import clean
from arm_drake.description.inertia import repair_inertials
from arm_drake.description.meshes import convert_collision, convert_visual
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import DescriptionError, PackageError

# How many numbers the attributes of these elements hold.
_COUNTS = {
    ("origin", "xyz"): 3,
    ("origin", "rpy"): 3,
    ("axis", "xyz"): 3,
    ("mass", "value"): 1,
    **{("inertia", name): 1 for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")},
}

# Attributes of primitives, and how many numbers they hold together.
_SIZES = {
    "box": (("size",), 3),
    "sphere": (("radius",), 1),
    "cylinder": (("radius", "length"), 2),
    "capsule": (("radius", "length"), 2),
}

_Color = tuple[float, float, float, float]


def normalise(
    root: ET.Element, file: Path, packages: PackageFinder, report: LoadReport
) -> None:
    """Change a URDF in place into what Drake takes.

    Args:
        root: The `<robot>` element.
        file: File it came from; relative mesh paths start in its folder.
        packages: What resolves package URIs.
        report: Where every change is recorded.

    Raises:
        DescriptionError: If a number is malformed.
    """
    clean(root, file, report)
    for tag in ("link", "joint"):
        for element in root.iterfind(tag):
            _check_numbers(element, file, f"{tag} {element.get('name')!r}")
    for joint in root.iterfind("joint"):
        _repair_joint(joint, file, report)
    _repair_materials(root, file, report)
    for link in root.iterfind("link"):
        for tag in ("visual", "collision"):
            for index, element in enumerate(link.findall(tag)):
                where = f"link {link.get('name')!r}, {tag} {index}"
                shape = _GeometryRepair(element, file, where, packages, report)
                if not shape.repair():
                    link.remove(element)
    repair_inertials(root, report, file)


def _numbers(text: str, file: Path, where: str) -> list[float]:
    try:
        return [float(number) for number in text.split()]
    except ValueError:
        raise DescriptionError(
            f"expected numbers, got {text!r}", file=file, where=where
        ) from None


def _check_numbers(parent: ET.Element, file: Path, where: str) -> None:
    for element in parent.iter():
        for (tag, attribute), count in _COUNTS.items():
            text = element.get(attribute)
            if element.tag != tag or text is None:
                continue
            numbers = _numbers(text, file, where)
            if len(numbers) != count or not all(map(math.isfinite, numbers)):
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
            numbers = _numbers(text or "", file, where)
            if text is not None and not any(map(_is_limit, numbers)):
                del limit.attrib[attribute]
                add(f"{attribute} limit {text}", "taken as unset")
        ends = [limit.attrib.pop(end, None) for end in _useless_ends(joint)]
        if any(ends):
            add("limits of a continuous joint", "it turns without end")
    # Friction is modelled beside the plant; Drake would warn about it.
    if dynamics is not None:
        dynamics.attrib.pop("friction", None)


def _is_limit(number: float) -> bool:
    return math.isfinite(number) and number != 0.0


def _useless_ends(joint: ET.Element) -> tuple[str, ...]:
    return ("lower", "upper") if joint.get("type") == "continuous" else ()


def _repair_materials(root: ET.Element, file: Path, report: LoadReport) -> None:
    """Spell the colour of every visual out; remove materials that have none.

    Drake refuses two colours under one name, which ROS doesn't.
    """
    colors: dict[str, str] = {}
    for material in root.iter("material"):
        name = material.get("name", "")
        if (rgba := material.find("color")) is not None:
            text = rgba.get("rgba", "")
            numbers = _numbers(text, file, f"material {name!r}")
            if len(numbers) == 4 and all(0.0 <= number <= 1.0 for number in numbers):
                colors.setdefault(name, text)
            else:
                material.remove(rgba)
        for texture in material.findall("texture"):
            material.remove(texture)
            what = f"material {name!r} has a texture"
            done = "it is drawn without it, unless its mesh has one of its own"
            report.add("warning", "unsupported", what, done, file=file)
            colors.setdefault(name, "")
    for material in root.findall("material"):
        root.remove(material)
    for visual in root.iter("visual"):
        for material in visual.findall("material"):
            name = material.attrib.pop("name", "")
            color = colors.get(name)
            if material.find("color") is not None:
                continue
            if color:
                ET.SubElement(material, "color", rgba=color)
                continue
            visual.remove(material)
            if color is None:
                what = f"material {name!r} has no colour of 4 numbers from 0 to 1"
                done = "the default colour is used"
                report.add("warning", "missing", what, done, file=file)


class _GeometryRepair:
    """One `<visual>` or `<collision>` on its way to Drake."""

    def __init__(
        self,
        element: ET.Element,
        file: Path,
        where: str,
        packages: PackageFinder,
        report: LoadReport,
    ) -> None:
        self._element = element
        self._file = file
        self._where = where
        self._packages = packages
        self._report = report

    def repair(self) -> bool:
        """Make the geometry fit for Drake; return whether to keep it."""
        geometry = self._element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            return self._drop("no geometry")
        if shape.tag == "mesh":
            return self._convert_mesh(shape)
        if shape.tag not in _SIZES:
            return self._drop(f"<{shape.tag}>, which is no geometry of a URDF")
        names, count = _SIZES[shape.tag]
        text = " ".join(shape.get(name, "") for name in names).strip()
        sizes = _numbers(text, self._file, self._where)
        if len(sizes) != count or not all(0.0 < size < math.inf for size in sizes):
            return self._drop(f"<{shape.tag}> without a positive size")
        return True

    def _drop(self, problem: str) -> bool:
        self._report.add(
            "warning",
            "invalid",
            problem,
            "left out",
            where=self._where,
            file=self._file,
        )
        return False

    def _convert_mesh(self, shape: ET.Element) -> bool:
        if not shape.get("filename"):
            return self._drop("<mesh> without a filename")
        is_visual = self._element.tag == "visual"
        try:
            path = self._packages.resolve(shape.attrib["filename"], self._file.parent)
        except PackageError as error:
            self._report.add(
                "warning" if is_visual else "error",
                "missing",
                error.problem,
                "the mesh is left out",
                where=self._where,
                file=self._file,
            )
            return False
        scale = _numbers(shape.get("scale", "1 1 1"), self._file, self._where)
        if len(scale) == 1:
            scale *= 3
        if len(scale) != 3:
            return self._drop(f"mesh scale {shape.get('scale')!r}")
        x, y, z = scale
        if is_visual:
            converted = convert_visual(
                path,
                (x, y, z),
                self._report,
                where=self._where,
                file=self._file,
                color=self._color(),
            )
        else:
            hulls = convert_collision(
                path, (x, y, z), self._report, where=self._where, file=self._file
            )
            converted = hulls[0] if hulls else None
        if converted is None:
            return False
        shape.set("filename", converted.as_uri())
        shape.attrib.pop("scale", None)
        if is_visual:  # Drake refuses a material beside those of a glTF.
            for material in self._element.findall("material"):
                self._element.remove(material)
        return True

    def _color(self) -> _Color | None:
        color = self._element.find("material/color")
        if color is None:
            return None
        red, green, blue, alpha = map(float, color.attrib["rgba"].split())
        return (red, green, blue, alpha)
