"""Repairs of a URDF: what Drake takes instead of what robots' authors got away with.

Drake stops at meshes it can't read, at duplicate transmissions, at moving bodies
without mass; it takes an effort limit of 0 literally and ends the process at a
primitive of size 0. It answers every unknown attribute and tag with a warning of its
own, per element. So only what it reads stays in a URDF, meshes are converted, and every
kind of change is recorded once. What bodies weigh is in `inertia`.
"""

import collections
import copy
import dataclasses as dc
import difflib
import functools
import itertools
import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from arm_drake.description.elements import numbers
from arm_drake.description.inertia import repair_inertials
from arm_drake.description.meshes.conversion import (
    Scale,
    convert_collision,
    convert_visual,
    describe_loss,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import DescriptionError, PackageError

# Elements by their path below <robot>, with the attributes that are read.
_READ: Mapping[str, tuple[str, ...]] = {
    "material": ("name",),
    "material/color": ("rgba",),
    "material/texture": ("filename",),
    "link": ("name",),
    "link/inertial": (),
    "link/inertial/origin": ("xyz", "rpy"),
    "link/inertial/mass": ("value",),
    "link/inertial/inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    **{
        f"link/{tag}{path}": attributes
        for tag in ("visual", "collision")
        for path, attributes in {
            "": ("name",),
            "/origin": ("xyz", "rpy"),
            "/geometry": (),
            "/geometry/box": ("size",),
            "/geometry/sphere": ("radius",),
            "/geometry/cylinder": ("radius", "length"),
            "/geometry/capsule": ("radius", "length"),
            "/geometry/mesh": ("filename", "scale"),
        }.items()
    },
    "link/visual/material": ("name",),
    "link/visual/material/color": ("rgba",),
    "link/visual/material/texture": ("filename",),
    "joint": ("name", "type"),
    "joint/origin": ("xyz", "rpy"),
    "joint/parent": ("link",),
    "joint/child": ("link",),
    "joint/axis": ("xyz",),
    "joint/limit": ("lower", "upper", "effort", "velocity"),
    "joint/dynamics": ("damping", "friction"),
    "joint/mimic": ("joint", "multiplier", "offset"),
}

# Read elsewhere, and reported there.
_OTHERS = ("ros2_control", "gazebo", "joint/safety_controller")

# What is done about tags that mean something to others.
_MEANINGS = {
    "transmission": "actuators come from <ros2_control>",
    "joint/calibration": "joints are calibrated",
    "link/collision_checking": "collisions come from <collision>",
}

_NOTHING = "it has no effect"

# So much alike are a word and the one that was meant: "val" and "value" just so.
_MISSPELT = 0.75


class _Ignored(NamedTuple):
    """A kind of thing that isn't read."""

    # Path of a tag, and an attribute or "".
    path: str
    attribute: str

    # What it seems to be meant for, and the link or joint that it is in; else "".
    meant: str = ""
    where: str = ""


def clean(root: ET.Element, file: Path, report: LoadReport) -> None:
    """Remove from a URDF what isn't read, and record each kind of thing once."""
    found: collections.Counter[_Ignored] = collections.Counter()
    for child in list(root):
        name = child.get("name")
        where = "" if name is None else f"{child.tag} {name!r}"
        for ignored in _clean(root, child, ""):
            found[ignored._replace(where=where) if ignored.meant else ignored] += 1
    for (path, attribute, meant, where), count in found.items():
        what = f"<{path} {attribute}=...>" if attribute else f"<{path}>"
        what += "" if count == 1 else f", {count} times"
        what += f"; did you mean {meant}?" if meant else ""
        severity: Severity = "warning" if meant else "info"
        done = (_MEANINGS.get(path) if not attribute else None) or _NOTHING
        report.add(severity, "ignored", what, done, where=where, file=file)


def _clean(parent: ET.Element, element: ET.Element, above: str) -> Iterator[_Ignored]:
    if not isinstance(element.tag, str):  # A comment.
        return
    path = f"{above}/{element.tag}" if above else element.tag
    is_shape = above.endswith("/geometry")  # One that is unknown is a repair.
    if path not in _READ and not is_shape:
        parent.remove(element)
        if path not in _OTHERS:
            yield _Ignored(path, "", _meant_tag(path))
        return
    if element.get("name") == "" and above == "link":
        del element.attrib["name"]  # Drake takes no empty one.
    for name in list(element.attrib):
        if path in _READ and name not in _READ[path]:
            del element.attrib[name]
            if not name.startswith("{"):  # Of another name space.
                lacking = [
                    other for other in _READ[path] if other not in element.attrib
                ]
                close = difflib.get_close_matches(name, lacking, 1, _MISSPELT)
                yield _Ignored(path, name, repr(close[0]) if close else "")
    for child in list(element):
        yield from _clean(element, child, path)


@functools.cache
def _meant_tag(path: str) -> str:
    """Return the tag that one that isn't read seems to be meant for, or ""."""
    above, _, tag = path.rpartition("/")
    known = [each.rpartition("/") for each in (*_READ, *_OTHERS, *_MEANINGS)]
    tags = [other for parent, _, other in known if parent == above]
    close = difflib.get_close_matches(tag, tags, 1, _MISSPELT)
    return f"<{close[0]}>" if close and path not in _MEANINGS else ""


def repair_materials(
    root: ET.Element, file: Path, packages: PackageFinder, report: LoadReport
) -> None:
    """Spell the colour of every visual out; remove materials that have none.

    Drake refuses two colours under one name, which ROS doesn't. A texture is replaced
    by its mean colour: most meshes of a URDF's textures have no texture coordinates.
    """
    colors: dict[str, str] = {}
    for material in root.iter("material"):
        name = material.get("name", "")
        if (rgba := material.find("color")) is not None:
            text = rgba.get("rgba", "")
            values = numbers(text, file, f"material {name!r}")
            if len(values) == 4 and all(0.0 <= value <= 1.0 for value in values):
                colors.setdefault(name, text)
            else:
                material.remove(rgba)
        for texture in material.findall("texture"):
            material.remove(texture)
            uri = texture.get("filename", "")
            mean = _mean_color(uri, name, file, packages, report)
            if mean is not None and material.find("color") is None:
                ET.SubElement(material, "color", rgba=mean)
            colors.setdefault(name, mean or "")
    for material in root.findall("material"):
        root.remove(material)
    for visual in root.iter("visual"):
        for material in visual.findall("material"):
            _spell_out(visual, material, colors, file, report)


def _spell_out(
    visual: ET.Element,
    material: ET.Element,
    colors: dict[str, str],
    file: Path,
    report: LoadReport,
) -> None:
    name = material.attrib.pop("name", "")
    color = colors.get(name)
    if material.find("color") is not None:
        return
    if color:
        ET.SubElement(material, "color", rgba=color)
        return
    visual.remove(material)
    if color is None:
        what = f"material {name!r} has no colour of 4 numbers from 0 to 1"
        done = "the default colour is used"
        report.add("warning", "missing", what, done, file=file)


def _mean_color(
    uri: str, material: str, file: Path, packages: PackageFinder, report: LoadReport
) -> str | None:
    """Return the mean colour of a texture as a text, or None and a report line."""
    # Not at the top: few robots have textures.
    from PIL import Image

    place = f"material {material!r}"
    try:
        path = packages.resolve(uri, file.parent)
        if os.path.exists(path) and not os.path.isfile(path):
            raise OSError("not a regular file")  # A pipe would be read for ever.
        with Image.open(path) as image:
            pixel = image.convert("RGB").resize((1, 1), Image.Resampling.BOX)
            mean = [channel / 255.0 for channel in pixel.tobytes()]
    # What Pillow raises for a bad file is any of a dozen errors.
    except Exception as error:
        missing = isinstance(error, PackageError | FileNotFoundError)
        problem = "doesn't exist" if missing else "can't be read"
        what = f"the texture {uri!r} {problem}"
        done = "drawn without it, unless its mesh has one of its own"
        report.add("warning", "missing", what, done, where=place, file=file)
        return None
    what = f"the texture {uri!r}"
    done = "its mean colour is used, unless a mesh has a texture of its own"
    report.add("warning", "unsupported", what, done, where=place, file=file)
    return " ".join(f"{value:.4g}" for value in (*mean, 1.0))


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
    """Change a URDF in place into what Drake takes."""
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
            found = numbers(text, file, f"{where}: <{tag} {attribute}>")
            numeral = f"{count} finite numbers" if count > 1 else "a finite number"
            is_right = len(found) == count and all(map(math.isfinite, found))
            if is_right and max(map(abs, found)) > _LARGEST:
                is_right, numeral = False, f"{numeral} of at most {_LARGEST:g}"
            if not is_right:
                problem = f"<{tag} {attribute}>: expected {numeral}, got {text!r}"
                raise DescriptionError(problem, file=file, where=where)


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
        is_limit = any(math.isfinite(number) and number != 0.0 for number in found)
        if text is not None and not is_limit:
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


# Attributes of primitives, and how many numbers each holds.
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}

# No size is beyond these [m]; moments of inertia take its fifth power.
_SMALLEST_SIZE, _LARGEST_SIZE = 1e-9, 1e6

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
    """Make every `<visual>` and `<collision>` fit for Drake, or remove it."""
    extent = _extent(root, file)
    for link in root.iterfind("link"):
        for tag in ("visual", "collision"):
            for index, element in enumerate(link.findall(tag)):
                where = f"link {link.get('name')!r}, {tag} {index}"
                shape = _Shape(
                    element, file, where, packages, report, decompose, max_faces, extent
                )
                at = list(link).index(element)
                link.remove(element)
                for part in reversed(shape.repair()):
                    link.insert(at, part)


def _extent(root: ET.Element, file: Path) -> float:
    """Return how far from a root the farthest link is, joints between stretched [m]."""
    steps = {}
    for joint in root.iterfind("joint"):
        parent, child, origin = (joint.find(t) for t in ("parent", "child", "origin"))
        xyz = "" if origin is None else origin.get("xyz", "")
        length = math.hypot(*numbers(xyz, file, ""))
        if parent is not None and child is not None:
            steps[child.get("link")] = (parent.get("link"), length)
    distances: dict[str | None, float] = {}
    for link in steps:
        chain = [link]
        while chain[-1] in steps and chain[-1] not in distances:
            chain.append(steps[chain[-1]][0])
        for nearer, farther in itertools.pairwise(reversed(chain)):
            distances[farther] = distances.get(nearer, 0.0) + steps[farther][1]
    return max(distances.values(), default=0.0)


@dc.dataclass(frozen=True, eq=False)
class _Shape:
    """One `<visual>` or `<collision>` on its way to Drake."""

    element: ET.Element
    file: Path
    where: str
    packages: PackageFinder
    report: LoadReport
    decompose: bool
    max_faces: int | None

    # How far from a root the farthest link is at most [m].
    extent: float

    def repair(self) -> list[ET.Element]:
        """Return what takes its place: elements that Drake takes, or none."""
        geometry = self.element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            return self._drop("no geometry")
        if shape.tag == "mesh":
            return self._convert_mesh(shape)
        if shape.tag not in _SIZES:
            return self._drop(f"<{shape.tag}>, which is no geometry of a URDF")
        for name, count in _SIZES[shape.tag].items():
            sizes = numbers(
                shape.get(name, ""), self.file, f"{self.where}: <{shape.tag} {name}>"
            )
            if len(sizes) != count or not all(0.0 < size < math.inf for size in sizes):
                return self._drop(f"<{shape.tag}> without a positive size")
            if not all(_SMALLEST_SIZE <= size <= _LARGEST_SIZE for size in sizes):
                bounds = f"{_SMALLEST_SIZE:g} m to {_LARGEST_SIZE:g} m"
                return self._drop(f"<{shape.tag}> with a size that isn't {bounds}")
        return [self.element]

    def _drop(self, problem: str) -> list[ET.Element]:
        self._add(self._severity, "invalid", problem, "left out")
        return []

    @property
    def _severity(self) -> Severity:
        """How grave it is if it is lost."""
        return describe_loss(is_visual=self.element.tag == "visual")[0]

    def _add(self, severity: Severity, kind: Kind, what: str, done: str) -> None:
        where, file = self.where, self.file
        self.report.add(severity, kind, what, done, where=where, file=file)

    def _find(self, uri: str) -> Path:
        """Return the path of a mesh, also if it lies elsewhere in the package."""
        path, is_elsewhere = self.packages.locate(uri, self.file.parent)
        if is_elsewhere:
            done = f"taken from {str(path)!r}"
            self._add("warning", "repair", f"no file {uri!r}", done)
        return path

    def _convert_mesh(self, shape: ET.Element) -> list[ET.Element]:
        if not shape.get("filename"):
            return self._drop("<mesh> without a filename")
        is_visual = self.element.tag == "visual"
        try:
            path = self._find(shape.attrib["filename"])
        except PackageError as error:
            self._add(self._severity, "missing", error.problem, "the mesh is left out")
            return []
        scale = numbers(
            shape.get("scale", "1 1 1"), self.file, f"{self.where}: <mesh scale>"
        )
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
            self.report,
            where=self.where,
            file=self.file,
            color=self._color(),
            max_faces=self.max_faces,
            extent=self.extent,
        )
        if converted is None:
            return []
        shape.set("filename", converted.as_uri())
        for material in self.element.findall("material"):
            self.element.remove(material)  # Drake refuses it beside those of a glTF.
        return [self.element]

    def _collide(self, shape: ET.Element, path: Path, scale: Scale) -> list[ET.Element]:
        parts = convert_collision(
            path,
            scale,
            self.report,
            where=self.where,
            file=self.file,
            decompose=self.decompose,
        )
        elements = []
        if len(parts) == 1:
            # For `with_surfaces`.
            shape.set(SOURCE, str(path))
            shape.set(SOURCE_SCALE, " ".join(map(repr, scale)))
        for part in parts:
            shape.set("filename", part.as_uri())
            elements.append(copy.deepcopy(self.element))
        for index, element in enumerate(elements[1:], start=2):
            if "name" in element.attrib:
                element.set("name", f"{element.get('name')}_{index}")
        return elements

    def _color(self) -> _Color | None:
        color = self.element.find("material/color")
        if color is None:
            return None
        red, green, blue, alpha = map(float, color.attrib["rgba"].split())
        return (red, green, blue, alpha)
