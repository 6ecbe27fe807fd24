"""Links of a robot: what they weigh, what is drawn of them and what they collide with.

Drake stops at meshes it can't read and ends the process at a primitive of size 0. So
meshes are converted, and shapes that can't be taken are left out, which the load report
says. What links weigh is mended in `inertia`.
"""

import dataclasses as dc
import functools
import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.elements import numbers, quote_attribute
from arm_drake.description.meshes.conversion import (
    convert_collision,
    convert_visual,
    describe_loss,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import DescriptionError, PackageError
from arm_drake.importing import dataclass

Vector = tuple[float, float, float]

# x, y, z [m], roll, pitch, yaw [rad].
Pose = tuple[float, float, float, float, float, float]

# Red, green, blue, alpha, from 0 to 1.
Color = tuple[float, float, float, float]

# Attributes of an `<inertia>`.
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Name space of tags that URDF doesn't have.
_DRAKE = "http://drake.mit.edu"

# Squares and products of larger numbers are more than numbers can hold.
_LARGEST = 1e15


@dataclass(frozen=True, eq=False)
class Transform:
    """A pose that can be multiplied, which Drake isn't needed for."""

    # The rotation, shape (3, 3), and the position [m], shape (3,).
    rotation: Array = dc.field(default_factory=lambda: np.eye(3))
    position: Array = dc.field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: "Transform") -> "Transform":
        """Return X_AC of X_AB and X_BC."""
        place = self.position + self.rotation @ other.position
        return Transform(self.rotation @ other.rotation, place)

    def inverse(self) -> "Transform":
        """Return X_BA of X_AB."""
        return Transform(self.rotation.T, -self.rotation.T @ self.position)


@dataclass(frozen=True)
class Origin:
    """`<origin>` of a part in its link, or of a joint in its parent link."""

    # [m].
    xyz: Vector = (0.0, 0.0, 0.0)

    # Roll, pitch, yaw [rad].
    rpy: Vector = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Array:
        """The rotation, shape (3, 3)."""
        (sx, sy, sz), (cx, cy, cz) = np.sin(self.rpy), np.cos(self.rpy)
        return np.array(
            [
                [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz],
                [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz],
                [-sy, sx * cy, cx * cy],
            ]
        )

    @property
    def position(self) -> Array:
        """The position [m], shape (3,)."""
        return np.array(self.xyz)

    @property
    def transform(self) -> Transform:
        """Both, to be multiplied."""
        return Transform(self.rotation, self.position)


@dataclass(frozen=True)
class Geometry:
    """Content of a `<geometry>`; of its fields those that its type has."""

    # box, sphere, cylinder, capsule, mesh or ellipsoid, which only wheels here have.
    type: str

    # Of a box, or semi-axes of an ellipsoid [m].
    size: Vector = (0.0, 0.0, 0.0)

    # [m].
    radius: float = 0.0
    length: float = 0.0

    # URI of a mesh.
    filename: str = ""

    # File that a mesh to collide with is the whole hull of, and how it was scaled.
    source: str = ""
    source_scale: Vector = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class ShapeInfo:
    """A `<visual>` or a `<collision>` of a link."""

    geometry: Geometry

    origin: Origin = dc.field(default_factory=Origin)

    # "" without one.
    name: str = ""

    # Of what is drawn; None where a mesh has its own.
    color: Color | None = None

    @property
    def wheel_radius(self) -> float:
        """Radius of a cylinder or a sphere [m], 0 of other shapes."""
        is_round = self.geometry.type in ("cylinder", "sphere")
        return self.geometry.radius if is_round else 0.0


@dataclass(frozen=True)
class InertialInfo:
    """`<inertial>` of a link; as it is read, what it lacks is nan."""

    # [kg].
    mass: float

    # The centre of mass, and the axes of the moments.
    origin: Origin = dc.field(default_factory=Origin)

    # ixx, ixy, ixz, iyy, iyz, izz about the centre of mass [kg·m^2].
    moments: tuple[float, float, float, float, float, float] = (0.0,) * 6

    @property
    def tensor(self) -> Array:
        """The moments, shape (3, 3)."""
        ixx, ixy, ixz, iyy, iyz, izz = self.moments
        return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])

    def with_tensor(self, tensor: Array) -> "InertialInfo":
        """Return the same with other moments [kg·m^2], shape (3, 3)."""
        xx, xy, xz, _, yy, yz, _, _, zz = tensor.ravel().tolist()
        return dc.replace(self, moments=(xx, xy, xz, yy, yz, zz))


@dataclass(frozen=True)
class LinkInfo:
    """A link of a robot, as it is simulated."""

    name: str

    # None of a link without mass.
    inertial: InertialInfo | None = None

    visuals: tuple[ShapeInfo, ...] = ()
    collisions: tuple[ShapeInfo, ...] = ()

    @property
    def mass(self) -> float:
        """[kg]; 0 for a link without one."""
        return 0.0 if self.inertial is None else self.inertial.mass


def read_numbers(
    element: ET.Element | None,
    attribute: str,
    default: tuple[float, ...],
    file: Path,
    where: str,
) -> tuple[float, ...]:
    """Return as many finite numbers as the default has, which stands for none."""
    text = None if element is None else element.get(attribute)
    if element is None or text is None:
        return default
    place = f"<{element.tag} {attribute}>"
    expected = f"{len(default)} finite numbers" if default[1:] else "a finite number"
    found = numbers(text, file, where, place, expected)
    is_right = len(found) == len(default) and all(map(math.isfinite, found))
    if is_right and max(map(abs, found)) > _LARGEST:
        is_right, expected = False, f"{expected} of at most {_LARGEST:g}"
    if not is_right:
        problem = f"{place}: expected {expected}, got {text!r}"
        raise DescriptionError(problem, file=file, where=where)
    return tuple(found)


def read_vector(
    element: ET.Element | None,
    attribute: str,
    file: Path,
    where: str,
    default: Vector = (0.0, 0.0, 0.0),
) -> Vector:
    """Return three finite numbers."""
    x, y, z = read_numbers(element, attribute, default, file, where)
    return x, y, z


def read_origin(element: ET.Element, file: Path, where: str) -> Origin:
    """Return the `<origin>` of an element, the identity where it has none."""
    origin = element.find("origin")
    if origin is None:
        return Origin()
    return Origin(*(read_vector(origin, name, file, where) for name in ("xyz", "rpy")))


# Attributes of primitives, and how many numbers each holds.
SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}

# No size is beyond these [m]; moments of inertia take its fifth power.
_SMALLEST_SIZE, _LARGEST_SIZE = 1e-9, 1e6

# Boxes and cylinders without thickness, which Gazebo takes, get this one [m].
_THICKNESS = 1e-3


def read_links(
    root: ET.Element,
    file: Path,
    packages: PackageFinder,
    report: LoadReport,
    *,
    extent: float = 0.0,
    decompose: bool = False,
    max_faces: int | None = None,
) -> tuple[LinkInfo, ...]:
    """Return the links of a URDF, with shapes as Drake takes them.

    Args:
        root: The `<robot>`; it stays as it is.
        file: The file that it is of.
        packages: Where meshes are looked for.
        report: Learns what is taken otherwise than it is written.
        extent: How far from a root the farthest link is [m]; 0 if nobody knows.
        decompose: Whether a mesh to collide with becomes several convex parts.
        max_faces: Triangles of each mesh that is drawn, at most.
    """
    colors = _read_colors(root, file, packages, report)
    reader = _ShapeReader(file, packages, report, decompose, max_faces, extent, colors)
    return tuple(
        LinkInfo(
            link.get("name", ""),
            _read_inertial(link, file),
            reader.read(link, "visual"),
            reader.read(link, "collision"),
        )
        for link in root.iterfind("link")
    )


def _read_inertial(link: ET.Element, file: Path) -> InertialInfo | None:
    """Return the `<inertial>` of a `<link>`; moments that it lacks are nan."""
    element = link.find("inertial")
    if element is None:
        return None
    where = f"link {link.get('name')!r}"
    (mass,) = read_numbers(element.find("mass"), "value", (0.0,), file, where)
    inertia = element.find("inertia")
    ixx, ixy, ixz, iyy, iyz, izz = (
        read_numbers(inertia, name, (math.nan,), file, where)[0] for name in MOMENTS
    )
    moments = ixx, ixy, ixz, iyy, iyz, izz
    return InertialInfo(mass, read_origin(element, file, where), moments)


def _read_colors(
    root: ET.Element, file: Path, packages: PackageFinder, report: LoadReport
) -> Mapping[ET.Element, Color]:
    """Return the colour of each `<visual>` that has one.

    Two may have one name. A texture is replaced by its mean colour: most meshes of a
    URDF's textures have no texture coordinates.
    """
    named: dict[str, Color | None] = {}
    own: dict[ET.Element, Color | None] = {}
    for element in root:
        is_link = element.tag == "link"
        found = element.iterfind("visual/material") if is_link else [element]
        for material in (each for each in found if each.tag == "material"):
            name, color = material.get("name", ""), _own_color(material, file)
            if color is not None:
                named.setdefault(name, color)
            for texture in material.iterfind("texture"):
                uri = texture.get("filename", "")
                mean = _mean_color(uri, name, file, packages, report)
                color = color or mean
                named.setdefault(name, mean)
            own[material] = color
    defined = {each.get("name", "") for each in root.iterfind("material")}
    defined |= {each.get("name", "") for each in own if each.find("color") is not None}
    colors: dict[ET.Element, Color] = {}
    for visual in root.iterfind("link/visual"):
        for material in visual.iterfind("material"):
            name = material.get("name", "")
            color = own[material] or named.get(name)
            if color is not None:
                colors.setdefault(visual, color)
            elif name not in named:
                what = f"material {name!r} "
                what += (
                    "has no colour of 4 numbers from 0 to 1"
                    if name in defined
                    else "is defined nowhere"
                )
                done = "the default colour is used"
                report.add("warning", "missing", what, done, file=file)
    return colors


def _own_color(material: ET.Element, file: Path) -> Color | None:
    """Return the colour that a material states, if it is one."""
    rgba = material.find("color")
    if rgba is None:
        return None
    where = f"material {material.get('name', '')!r}"
    values = numbers(rgba.get("rgba", ""), file, where)
    if len(values) != 4 or not all(0.0 <= value <= 1.0 for value in values):
        return None
    red, green, blue, alpha = values
    return red, green, blue, alpha


def _mean_color(
    uri: str, material: str, file: Path, packages: PackageFinder, report: LoadReport
) -> Color | None:
    """Return the mean colour of a texture, or None and a report line."""
    # Not at the top: few robots have textures.
    from PIL import Image

    place = f"material {material!r}"
    try:
        path = packages.resolve(uri, file.parent)
        if os.path.exists(path) and not os.path.isfile(path):
            raise OSError("not a regular file")  # A pipe would be read for ever.
        with Image.open(path) as image:
            pixel = image.convert("RGB").resize((1, 1), Image.Resampling.BOX)
            red, green, blue = (channel / 255.0 for channel in pixel.tobytes())
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
    return red, green, blue, 1.0


@dataclass(frozen=True, eq=False)
class _ShapeReader:
    """Reads what is drawn and what collides."""

    file: Path
    packages: PackageFinder
    report: LoadReport
    decompose: bool
    max_faces: int | None

    # How far from a root the farthest link is at most [m].
    extent: float

    colors: Mapping[ET.Element, Color]

    def read(self, link: ET.Element, tag: str) -> tuple[ShapeInfo, ...]:
        """Return the shapes of a link by their tag, those that Drake takes."""
        where = f"link {link.get('name')!r}"
        return tuple(
            shape
            for index, element in enumerate(link.iterfind(tag))
            for shape in self._read(element, where, f"{where}, {tag} {index}")
        )

    def _read(self, element: ET.Element, link: str, where: str) -> Iterable[ShapeInfo]:
        """Return what an element becomes: one shape, parts of a mesh, or nothing."""
        origin, name = read_origin(element, self.file, link), element.get("name", "")
        color = self.colors.get(element)
        is_visual = element.tag == "visual"
        severity, _ = describe_loss(is_visual=is_visual)
        add = functools.partial(self.report.add, where=where, file=self.file)
        geometry = element.find("geometry")
        shape = None if geometry is None else geometry.find("*")
        try:
            if shape is None:
                raise _UnfitError("no geometry")
            if shape.tag != "mesh":
                solid = self._read_primitive(shape, where)
                return [ShapeInfo(solid, origin, name, color)]
            path, scale = self._find_mesh(shape, where)
        except PackageError as error:
            add(severity, "missing", error.problem, "the mesh is left out")
            return []
        except _UnfitError as error:
            add(severity, "invalid", str(error), "left out")
            return []
        if not is_visual:
            meshes = self._collide(path, scale, where)
            return [
                ShapeInfo(mesh, origin, name if not name or i == 1 else f"{name}_{i}")
                for i, mesh in enumerate(meshes, start=1)
            ]
        # Drake refuses a colour beside those of a glTF.
        drawn = self._draw(path, scale, color, where)
        return [ShapeInfo(mesh, origin, name) for mesh in drawn]

    def _read_primitive(self, shape: ET.Element, where: str) -> Geometry:
        if shape.tag not in SIZES:
            raise _UnfitError(f"<{shape.tag}>, which is no geometry of a URDF")
        found: dict[str, Any] = {}
        for name, count in SIZES[shape.tag].items():
            part = f"<{shape.tag} {name}>"
            sizes = numbers(shape.get(name, ""), self.file, where, part)
            is_flat = len(sizes) == count and sizes.count(0.0) == 1 and min(sizes) >= 0
            if is_flat and part in ("<box size>", "<cylinder length>"):
                sizes = [size or _THICKNESS for size in sizes]
                what, done = f"{part} 0", f"a plate, taken {_THICKNESS:g} m thick"
                self.report.add(
                    "info", "repair", what, done, where=where, file=self.file
                )
            if len(sizes) != count or not all(0.0 < size < math.inf for size in sizes):
                raise _UnfitError(f"<{shape.tag}> without a positive size")
            if not all(_SMALLEST_SIZE <= size <= _LARGEST_SIZE for size in sizes):
                bounds = f"{_SMALLEST_SIZE:g} m to {_LARGEST_SIZE:g} m"
                problem = f"<{shape.tag}> with a size that isn't {bounds}"
                raise _UnfitError(problem)
            found[name] = tuple(sizes) if count > 1 else sizes[0]
        return Geometry(shape.tag, **found)

    def _find_mesh(self, shape: ET.Element, where: str) -> tuple[Path, Vector]:
        """Return the path of a mesh, also if it lies elsewhere, and its scale."""
        uri = shape.get("filename")
        if not uri:
            raise _UnfitError("<mesh> without a filename")
        path, is_elsewhere = self.packages.locate(uri, self.file.parent)
        if is_elsewhere:
            what, done = f"no file {uri!r}", f"taken from {str(path)!r}"
            self.report.add(
                "warning", "repair", what, done, where=where, file=self.file
            )
        text = shape.get("scale", "1 1 1")
        scale = numbers(text, self.file, where, "<mesh scale>")
        if len(scale) not in (1, 3):
            raise _UnfitError(f"mesh scale {text!r}")
        x, y, z = scale * 3 if len(scale) == 1 else scale
        return path, (x, y, z)

    def _draw(
        self, path: Path, scale: Vector, color: Color | None, where: str
    ) -> list[Geometry]:
        """Return the mesh as it is drawn, if it can be."""
        converted = convert_visual(
            path,
            scale,
            self.report,
            where=where,
            file=self.file,
            color=color,
            max_faces=self.max_faces,
            extent=self.extent,
        )
        if converted is None:
            return []
        return [Geometry("mesh", filename=converted.as_uri())]

    def _collide(self, path: Path, scale: Vector, where: str) -> list[Geometry]:
        """Return what collides of a mesh: its hull, or parts."""
        parts = convert_collision(
            path,
            scale,
            self.report,
            where=where,
            file=self.file,
            decompose=self.decompose,
        )
        meshes = [Geometry("mesh", filename=part.as_uri()) for part in parts]
        if len(meshes) == 1:
            # For `with_surfaces`.
            meshes = [dc.replace(meshes[0], source=str(path), source_scale=scale)]
        return meshes


class _UnfitError(Exception):
    """A shape that can't be taken."""


def write_link(link: LinkInfo) -> str:
    """Return a link as URDF."""
    text = f"<link name={quote_attribute(link.name)}>"
    if link.inertial is not None:
        text += _write_inertial(link.inertial)
    text += "".join(_write_shape("visual", shape) for shape in link.visuals)
    text += "".join(_write_shape("collision", shape) for shape in link.collisions)
    return f"{text}</link>"


def write_vector(numbers: Iterable[float]) -> str:
    """Return numbers as Drake reads them, to the bit."""
    return " ".join(map(repr, numbers))


def write_origin(origin: Origin) -> str:
    """Return an `<origin>`."""
    xyz, rpy = write_vector(origin.xyz), write_vector(origin.rpy)
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


def _write_inertial(inertial: InertialInfo) -> str:
    ixx, ixy, ixz, iyy, iyz, izz = inertial.moments
    return (
        f"<inertial>{write_origin(inertial.origin)}"
        f'<mass value="{inertial.mass!r}"/><inertia ixx="{ixx!r}" ixy="{ixy!r}" '
        f'ixz="{ixz!r}" iyy="{iyy!r}" iyz="{iyz!r}" izz="{izz!r}"/></inertial>'
    )


def _write_shape(tag: str, shape: ShapeInfo) -> str:
    # Drake takes no name of spaces.
    is_named = bool(shape.name.strip())
    name = f" name={quote_attribute(shape.name)}" if is_named else ""
    text = f"<{tag}{name}>{write_origin(shape.origin)}"
    text += f"<geometry>{_write_geometry(shape.geometry)}</geometry>"
    if shape.color is not None:
        rgba = write_vector(shape.color)
        text += f'<material><color rgba="{rgba}"/></material>'
    return f"{text}</{tag}>"


def _write_geometry(geometry: Geometry) -> str:
    radius, length = geometry.radius, geometry.length
    match geometry.type:
        case "mesh":
            return f"<mesh filename={quote_attribute(geometry.filename)}/>"
        case "box":
            return f'<box size="{write_vector(geometry.size)}"/>'
        case "sphere":
            return f'<sphere radius="{radius!r}"/>'
        case "ellipsoid":
            a, b, c = geometry.size
            sizes = f'a="{a!r}" b="{b!r}" c="{c!r}"'
            return f'<drake:ellipsoid xmlns:drake="{_DRAKE}" {sizes}/>'
    return f'<{geometry.type} radius="{radius!r}" length="{length!r}"/>'
