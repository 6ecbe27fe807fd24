"""Shapes of links, as Drake takes them: meshes converted, bad ones left out."""

import copy
import math
import xml.etree.ElementTree as ET
from pathlib import Path

from arm_drake.description.elements import numbers
from arm_drake.description.meshes.conversion import (
    Scale,
    convert_collision,
    convert_visual,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import PackageError

# Attributes of primitives, and how many numbers each holds.
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}

# No size is beyond these [m]; moments of inertia take its fifth power.
_SMALLEST, _LARGEST = 1e-9, 1e6

# Attributes of a `<mesh>` that is the hull of a file: the file, and its scale.
SOURCE, SOURCE_SCALE = "source", "source_scale"

_Color = tuple[float, float, float, float]


def repair_geometry(
    root: ET.Element,
    file: Path,
    packages: PackageFinder,
    report: LoadReport,
    *,
    decompose: bool,
    max_faces: int | None = None,
) -> None:
    """Make every `<visual>` and `<collision>` fit for Drake, or remove it.

    Args:
        root: The `<robot>` element, changed in place.
        file: File it came from; relative mesh paths start in its folder.
        packages: What resolves package URIs.
        report: Where every change is recorded.
        decompose: Whether a collision mesh becomes several convex parts, not one hull.
        max_faces: Triangles of each mesh that is drawn; by default all.

    Raises:
        DescriptionError: If a number is malformed.
        MissingExtraError: If ``decompose`` or ``max_faces`` needs what isn't installed.
    """
    for link in root.iterfind("link"):
        for tag in ("visual", "collision"):
            for index, element in enumerate(link.findall(tag)):
                where = f"link {link.get('name')!r}, {tag} {index}"
                shape = _Shape(
                    element, file, where, packages, report, decompose, max_faces
                )
                at = list(link).index(element)
                link.remove(element)
                for part in reversed(shape.repair()):
                    link.insert(at, part)


class _Shape:
    """One `<visual>` or `<collision>` on its way to Drake."""

    def __init__(
        self,
        element: ET.Element,
        file: Path,
        where: str,
        packages: PackageFinder,
        report: LoadReport,
        decompose: bool,
        max_faces: int | None,
    ) -> None:
        self._element = element
        self._file = file
        self._where = where
        self._packages = packages
        self._report = report
        self._decompose = decompose
        self._max_faces = max_faces

    def repair(self) -> list[ET.Element]:
        """Return what takes its place: elements that Drake takes, or none."""
        geometry = self._element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            return self._drop("no geometry")
        if shape.tag == "mesh":
            return self._convert_mesh(shape)
        if shape.tag not in _SIZES:
            return self._drop(f"<{shape.tag}>, which is no geometry of a URDF")
        for name, count in _SIZES[shape.tag].items():
            sizes = numbers(shape.get(name, ""), self._file, self._where)
            if len(sizes) != count or not all(0.0 < size < math.inf for size in sizes):
                return self._drop(f"<{shape.tag}> without a positive size")
            if not all(_SMALLEST <= size <= _LARGEST for size in sizes):
                bounds = f"{_SMALLEST:g} m to {_LARGEST:g} m"
                return self._drop(f"<{shape.tag}> with a size that isn't {bounds}")
        return [self._element]

    def _drop(self, problem: str) -> list[ET.Element]:
        self._add("warning", "invalid", problem, "left out")
        return []

    def _add(self, severity: Severity, kind: Kind, what: str, done: str) -> None:
        where, file = self._where, self._file
        self._report.add(severity, kind, what, done, where=where, file=file)

    def _find(self, uri: str) -> Path:
        """Return the path of a mesh, also if it lies elsewhere in the package."""
        path, is_elsewhere = self._packages.locate(uri, self._file.parent)
        if is_elsewhere:
            done = f"taken from {str(path)!r}"
            self._add("warning", "repair", f"no file {uri!r}", done)
        return path

    def _convert_mesh(self, shape: ET.Element) -> list[ET.Element]:
        if not shape.get("filename"):
            return self._drop("<mesh> without a filename")
        is_visual = self._element.tag == "visual"
        try:
            path = self._find(shape.attrib["filename"])
        except PackageError as error:
            self._add(
                "warning" if is_visual else "error",
                "missing",
                error.problem,
                "the mesh is left out",
            )
            return []
        scale = numbers(shape.get("scale", "1 1 1"), self._file, self._where)
        if len(scale) == 1:
            scale *= 3
        if len(scale) != 3:
            return self._drop(f"mesh scale {shape.get('scale')!r}")
        shape.attrib.pop("scale", None)
        convert = self._draw if is_visual else self._collide
        return convert(shape, path, (scale[0], scale[1], scale[2]))

    def _draw(self, shape: ET.Element, path: Path, scale: Scale) -> list[ET.Element]:
        converted = convert_visual(
            path,
            scale,
            self._report,
            where=self._where,
            file=self._file,
            color=self._color(),
            max_faces=self._max_faces,
        )
        if converted is None:
            return []
        shape.set("filename", converted.as_uri())
        for material in self._element.findall("material"):
            self._element.remove(material)  # Drake refuses it beside those of a glTF.
        return [self._element]

    def _collide(self, shape: ET.Element, path: Path, scale: Scale) -> list[ET.Element]:
        parts = convert_collision(
            path,
            scale,
            self._report,
            where=self._where,
            file=self._file,
            decompose=self._decompose,
        )
        elements = []
        if len(parts) == 1:
            # For `with_surfaces`.
            shape.set(SOURCE, str(path))
            shape.set(SOURCE_SCALE, " ".join(map(repr, scale)))
        for part in parts:
            shape.set("filename", part.as_uri())
            elements.append(copy.deepcopy(self._element))
        for index, element in enumerate(elements[1:], start=2):
            if "name" in element.attrib:
                element.set("name", f"{element.get('name')}_{index}")
        return elements

    def _color(self) -> _Color | None:
        color = self._element.find("material/color")
        if color is None:
            return None
        red, green, blue, alpha = map(float, color.attrib["rgba"].split())
        return (red, green, blue, alpha)
