"""Mesh files of every type as surfaces in the robot's link, z up.

COLLADA files as RViz and Gazebo read them.

The unit counts, the up axis doesn't; nodes are flattened; lights and cameras are left.
"""

import contextlib
import dataclasses as dc
import errno
import functools
import io
import json
import logging
import math
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote
from xml.parsers import expat

import numpy as np

from arm_drake.description.meshes.surfaces import (
    Array,
    Color,
    Surface,
    linear,
    to_linear,
    transformed,
)
from arm_drake.description.report import ReportEntry
from arm_drake.errors import quoted

# Nodes can be used in nodes that are used in nodes.
_MAX_NODES = 20_000

# Else Python prints the tracebacks that trimesh logs of files that it can read.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


class _PrologEnd(Exception):
    """The first element starts, all declarations are read."""


def read_collada(
    content: bytes,
    texture: Callable[[str], bytes | None],
    notes: list[ReportEntry],
) -> Iterator[tuple[Surface, Array]]:
    """Yield surfaces with the (4, 4) matrix that puts them into the robot's link."""
    # Not at the top: the import takes longer than all hits of the cache together.
    import zipfile

    import collada

    _check_prolog(content)
    if zipfile.is_zipfile(io.BytesIO(content)):
        raise ValueError("it is a ZIP archive")
    document = collada.Collada(io.BytesIO(content), ignore=[collada.DaeError])
    root = ET.fromstring(content) if document.errors else None  # noqa: S314  checked.
    if root is not None and (lost := _drop_materials(root, document)):
        what = f"its materials {quoted(lost)} can't be read ({document.errors[0]})"
        notes.append(ReportEntry("warning", "invalid", what, "drawn without them"))
        rest = io.BytesIO(ET.tostring(root))
        document = collada.Collada(rest, ignore=[collada.DaeError])
    if document.scene is None:
        reason = document.errors[0] if document.errors else "it has no <scene>"
        raise ValueError(str(reason))
    unit = document.assetInfo.unitmeter
    unit = 1.0 if unit is None else unit
    if not (math.isfinite(unit) and unit > 0.0):
        raise ValueError(f"its <unit> is {unit} m")
    is_empty = True
    for node, matrix in list(_instances(document.scene.nodes)):
        if isinstance(node, collada.scene.ControllerNode):
            what = "its skinned geometry isn't supported"
            notes.append(ReportEntry("warning", "unsupported", what, "left out"))
            continue
        materials = {material.symbol: material.target for material in node.materials}
        for primitive in node.geometry.primitives:
            if isinstance(primitive, collada.polylist.Polylist):
                primitive = primitive.triangleset()
            if not isinstance(primitive, collada.triangleset.TriangleSet):
                continue  # Lines.
            if primitive.vertex is None or not len(primitive):
                continue
            material = materials.get(primitive.material)
            effect = None if material is None else material.effect
            scaled = np.diag([unit, unit, unit, 1.0]) @ matrix
            is_empty = False
            yield _collada_surface(primitive, effect, texture), scaled
    if not document.errors:
        return
    first, *others = document.errors
    if is_empty:
        raise ValueError(str(first))
    more = f", and {len(others)} more" if others else ""
    what = f"a part of it can't be read ({first}{more})"
    notes.append(ReportEntry("warning", "invalid", what, "left out"))


def _drop_materials(root: ET.Element, document: Any) -> list[str]:
    """Remove what refers to materials that couldn't be read; return their names.

    RViz and Gazebo draw the shape without such a material, pycollada leaves it out.
    """
    read = {
        "effect": {effect.id for effect in document.effects},
        "material": {material.id for material in document.materials},
    }
    lost: dict[str, None] = {}
    for parent in list(root.iter()):
        for child in list(parent):
            kind = child.tag.rpartition("}")[2]
            target = child.get("target", "").removeprefix("#")
            if kind == "instance_material" and target not in read["material"]:
                lost[target] = None
                parent.remove(child)
            elif kind in read and child.get("id") not in read[kind]:
                parent.remove(child)
    return list(lost)


def _check_prolog(content: bytes) -> None:
    """Refuse entities: no mesh needs them, and a few lines of them fill the memory."""

    def refuse(*_: Any) -> None:
        raise ValueError("it declares XML entities")

    def stop(*_: Any) -> None:
        raise _PrologEnd

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = stop
    try:
        # Expat goes on to the end of what it has when a handler raises.
        for start in range(0, len(content), 64):
            parser.Parse(content[start : start + 64], False)
        parser.Parse(b"", True)
    except _PrologEnd:
        pass
    except expat.ExpatError as error:
        raise ValueError(f"XML Parsing Error: {error}") from None


def _instances(nodes: list[Any]) -> Iterator[tuple[Any, Array]]:
    """Yield everything with a geometry below some nodes, and its (4, 4) matrix."""
    import collada

    waiting = [(node, np.eye(4)) for node in reversed(nodes)]
    count = 0
    while waiting:
        node, matrix = waiting.pop()
        count += 1
        if isinstance(node, collada.scene.Node):
            matrix = matrix @ node.matrix
            waiting += [(child, matrix) for child in reversed(node.children)]
        elif isinstance(
            node, collada.scene.GeometryNode | collada.scene.ControllerNode
        ):
            yield node, matrix
        if count + len(waiting) > _MAX_NODES:
            raise ValueError(f"it has more than {_MAX_NODES} nodes")


def _collada_surface(
    primitive: Any, effect: Any, texture: Callable[[str], bytes | None]
) -> Surface:
    """Return a set of triangles, three vertices of its own for each."""

    def corners(values: Array, index: Array) -> Array:
        return values[index].reshape(index.size, values.shape[1])

    columns: dict[str, Any] = {}
    if primitive.normal is not None:
        columns["normals"] = corners(primitive.normal, primitive.normal_index)
    if effect is not None:
        columns["color"] = _color(effect)
        image = _image(effect)
        if image and primitive.texcoordset:
            uv = corners(primitive.texcoordset[0], primitive.texcoord_indexset[0])
            columns["uv"] = uv[:, :2]
            columns["texture"] = texture(image)
    elif colors := primitive.sources.get("COLOR"):
        offset, source = colors[0][0], colors[0][4]
        rgba = corners(source.data, primitive.index[:, :, offset])
        rgba = np.hstack([rgba, np.ones((len(rgba), 4 - rgba.shape[1]))])
        columns["vertex_colors"] = np.hstack([linear(rgba[:, :3]), rgba[:, 3:]])
    vertices = corners(primitive.vertex, primitive.vertex_index)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Surface(vertices.astype(float), faces, **columns)


def _color(effect: Any) -> Color:
    """Return the diffuse colour of an effect, white below a texture."""
    red, green, blue, alpha = 1.0, 1.0, 1.0, 1.0
    if isinstance(effect.diffuse, tuple):
        red, green, blue, alpha = to_linear(effect.diffuse[:4])
    transparent, transparency = effect.transparent, effect.transparency
    if isinstance(transparent, tuple) and isinstance(transparency, float):
        alpha = transparent[3] * transparency
        if effect.opaque_mode == "RGB_ZERO":
            luminance = np.dot(transparent[:3], (0.212671, 0.715160, 0.072169))
            alpha = 1.0 - float(luminance) * transparency
    # Some exporters mean it the other way round, and nobody draws what can't be seen.
    return (red, green, blue, min(alpha, 1.0) if alpha > 0.0 else 1.0)


def _image(effect: Any) -> str | None:
    """Return the name of the image file that colours an effect."""
    import collada

    if not isinstance(effect.diffuse, collada.material.Map):
        return None
    return str(effect.diffuse.sampler.surface.image.path)


# Reading takes up to 20 times as much memory as a file is large.
MAX_FILE_BYTES = 128 * 2**20

# How files name those that belong to them. Each pattern begins with a word: anything
# else takes far longer to search for in millions of numbers.
_URI = re.compile(rb'"uri"\s*:\s*"(?!data:)([^"]+)"')
_REFERENCES = {
    ".dae": re.compile(rb"<image\b[^<>]*>\s*<init_from>\s*(?:<ref>)?([^<]+)<"),
    ".glb": _URI,
    ".gltf": _URI,
    ".mtl": re.compile(rb"map_Kd[ \t]+([^\r\n]+)"),
    ".obj": re.compile(rb"mtllib[ \t]+([^\r\n]+)"),
    ".ply": re.compile(rb"comment TextureFile[ \t]+([^\r\n]+)"),
}

# Types in which a name stands on a line of its own; elsewhere is a comment.
_OF_LINES = (".mtl", ".obj", ".ply")


def read_bytes(path: Path) -> bytes:
    """Return the content of a file."""
    size = path.stat().st_size
    if path.exists() and not path.is_file():  # A pipe would never end.
        raise OSError(errno.EINVAL, "it is no file")
    if size > MAX_FILE_BYTES:
        known = f"it has {size / 2**20:.0f} MiB, at most {MAX_FILE_BYTES / 2**20:.0f}"
        raise OSError(errno.EFBIG, f"{known} are read")
    return path.read_bytes()


def references(source: Path, content: bytes) -> dict[str, Path | None]:
    """Return where the files are that a mesh file names, None if they don't exist."""
    found: dict[str, Path | None] = {}
    for name in _names(source, content):
        found[name] = path = beside(source, name)
        if path is not None and path.suffix.lower() == ".mtl":
            try:
                material = read_bytes(path)
            except OSError:  # Whoever wants it will hear.
                continue
            found |= {
                texture: beside(path, texture) for texture in _names(path, material)
            }
    return found


def _names(path: Path, content: bytes) -> list[str]:
    suffix = path.suffix.lower()
    pattern = _REFERENCES.get(suffix)
    matches = () if pattern is None else pattern.finditer(content)
    return [
        match[1].decode(errors="replace").strip()
        for match in matches
        if suffix not in _OF_LINES or _begins_line(match)
    ]


def _begins_line(match: re.Match[bytes]) -> bool:
    """Return whether nothing but blanks stands before a match in its line."""
    line = match.string.rfind(b"\n", 0, match.start()) + 1
    return not match.string[line : match.start()].strip(b" \t")


def beside(source: Path, name: str) -> Path | None:
    """Return the file that a mesh file calls `name`, None if it doesn't exist."""
    relative = PureWindowsPath(unquote(name.strip().removeprefix("file://"))).as_posix()
    base = PureWindowsPath(relative).name
    folders = (source.parent, source.parent / "../materials/textures")
    candidates = [source.parent / relative, *(folder / base for folder in folders)]
    try:
        return next((path for path in candidates if path.is_file()), None)
    except OSError:  # Such as a name that is too long.
        return None


# What reading takes stays below 3 GB of memory and half a minute.
MAX_TRIANGLES = 4_000_000
_MAX_PIXELS = 2**26

_STL_HEADER = 84  # Bytes before the triangles of a binary file.
_STL_TRIANGLE = 50
_MTL_LINE = re.compile(rb"^[ \t]*(newmtl|d|Tr)[ \t]+([^\r\n]+)", re.MULTILINE)
_PLY_ELEMENT = re.compile(rb"^element[ \t]+(vertex|face)[ \t]+(\d+)", re.MULTILINE)
_STL_TEXT = re.compile(rb"^\s*(facet|endsolid)\b", re.IGNORECASE | re.MULTILINE)


def read_surfaces(
    source: Path, content: bytes, scale: tuple[float, ...], notes: list[ReportEntry]
) -> list[Surface]:
    """Return the surfaces of a mesh file."""
    if content.startswith(b"version https://git-lfs"):
        raise ValueError("a Git LFS pointer, fetch it with `git lfs pull`")

    @functools.cache
    def texture(name: str) -> bytes | None:
        # Not at the top: it takes longer than all hits of the cache together.
        from PIL import Image

        path = beside(source, name)
        if path is None:  # Reported with all files that don't exist.
            return None
        try:
            with warnings.catch_warnings():  # Of many pixels, which are refused.
                warnings.simplefilter("ignore", Image.DecompressionBombWarning)
                image = Image.open(io.BytesIO(read_bytes(path)))
            return _encode(image)
        except Exception as error:
            notes.append(_unusable(f"its texture {name!r}", error))
            return None

    if source.suffix.lower() == ".dae":
        found = read_collada(content, texture, notes)
    else:
        found = _read_others(source, content, notes)
    surfaces = []
    count = 0
    for surface, matrix in found:
        count += len(surface.faces)
        if count > MAX_TRIANGLES:
            raise ValueError(f"it has more than {MAX_TRIANGLES} triangles")
        indices = surface.faces
        if indices.size and not 0 <= indices.min() <= indices.max() < len(
            surface.vertices
        ):
            raise ValueError("a triangle has a vertex that doesn't exist")
        surface = transformed(surface, np.diag(scale) @ matrix[:3])
        if len(surface.faces):
            surfaces.append(surface)
    return surfaces


def _read_others(
    source: Path, content: bytes, notes: list[ReportEntry]
) -> Iterator[tuple[Surface, Array]]:
    """Yield surfaces of all but COLLADA files, with (4, 4) matrices."""
    # Not at the top, like Pillow above.
    import trimesh

    class Files(trimesh.resolvers.FilePathResolver):
        def get(self, name: str) -> bytes:
            path = beside(source, name)
            if path is None:
                raise FileNotFoundError(f"its file {name!r} doesn't exist")
            content = read_bytes(path)
            if path.suffix.lower() == ".mtl":
                opacities.update(_opacities(content))
            return content

    opacities: dict[str, float] = {}
    suffix = source.suffix.lower()
    is_gltf = suffix in (".gltf", ".glb")
    if suffix == ".stl":
        content = _honest_stl(content, notes)
    if is_gltf:
        _check_gltf(content)
    stream, files = io.BytesIO(content), Files(str(source))
    scene = trimesh.load_scene(stream, suffix[1:], resolver=files, process=False)
    if suffix == ".ply":
        _check_ply(content, list(scene.geometry.values()), notes)
    textures: dict[int, bytes | None] = {}
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):  # Points or lines.
            continue
        matrix = np.array(transform)
        if is_gltf:  # y up, by their specification.
            matrix = matrix[[0, 2, 1, 3]] * [[1.0], [-1.0], [1.0], [1.0]]
        surface = _surface(mesh, textures, notes, is_linear=is_gltf)
        look = getattr(mesh.visual, "material", None)
        if surface.color and (alpha := opacities.get(str(getattr(look, "name", "")))):
            surface = dc.replace(surface, color=(*surface.color[:3], alpha))
        yield surface, matrix


def _opacities(content: bytes) -> dict[str, float]:
    """Return what an MTL file says of its materials, which trimesh leaves out."""
    found: dict[str, float] = {}
    name = ""
    for key, value in _MTL_LINE.findall(content):
        text = value.decode(errors="replace").strip()
        if key == b"newmtl":
            name = " ".join(text.split())
        else:
            with contextlib.suppress(ValueError):
                alpha = float(text.split()[-1])  # It may be `d -halo 0.5`.
                found[name] = alpha if key == b"d" else 1.0 - alpha
    return found


def _honest_stl(content: bytes, notes: list[ReportEntry]) -> bytes:
    """Return a binary STL file with as many triangles as its header declares."""
    is_text = b"\0" not in content[:_STL_HEADER] and _STL_TEXT.search(content[:4096])
    if is_text or len(content) < _STL_HEADER:
        return content
    declared = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    actual = (len(content) - _STL_HEADER) // _STL_TRIANGLE
    lie = f"its header tells of {declared} triangles, it has bytes for {actual}"
    if declared > actual:
        raise ValueError(lie)
    if declared < actual:
        notes.append(ReportEntry("warning", "invalid", lie, "the rest is left out"))
    # Some exporters write bytes after the last triangle.
    return content[: _STL_HEADER + _STL_TRIANGLE * declared]


def _check_ply(content: bytes, meshes: list[Any], notes: list[ReportEntry]) -> None:
    """Compare a header with what was read: lines of text end where they end."""
    header = content.partition(b"end_header")[0]
    declared = {kind: int(count) for kind, count in _PLY_ELEMENT.findall(header)}
    vertices = sum(len(mesh.vertices) for mesh in meshes)
    if declared.get(b"vertex", 0) > vertices:
        lie = (
            f"its header tells of {declared[b'vertex']} vertices, {vertices} are there"
        )
        raise ValueError(lie)
    faces = sum(len(getattr(mesh, "faces", ())) for mesh in meshes)
    if (
        declared.get(b"face", 0) > faces
    ):  # Less is not a lie: polygons become triangles.
        what = f"its header tells of {declared[b'face']} faces, {faces} are there"
        notes.append(ReportEntry("warning", "invalid", what, "the rest is missing"))


def _check_gltf(content: bytes) -> None:
    """Refuse arrays that need no bytes in the file, but a lot of memory."""
    if content.startswith(b"glTF"):
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    accessors = json.loads(content).get("accessors", [])
    if sum(accessor["count"] for accessor in accessors) > 10 * MAX_TRIANGLES:
        raise ValueError(f"it has more than {10 * MAX_TRIANGLES} values")


def _surface(
    mesh: Any,
    textures: dict[int, bytes | None],
    notes: list[ReportEntry],
    *,
    is_linear: bool,
) -> Surface:
    """Return a trimesh mesh, its colours linear."""
    faces = np.asarray(mesh.faces)
    columns: dict[str, Any] = {"vertices": mesh.vertices}
    # Only normals of the file: trimesh would round the edges of a box.
    if "vertex_normals" in mesh._cache:
        columns["normals"] = mesh.vertex_normals
    color = texture = None
    if mesh.visual.kind == "texture":
        look = mesh.visual.material
        look = look if hasattr(look, "baseColorFactor") else look.to_pbr()
        if look.baseColorFactor is not None:
            color = tuple((np.asarray(look.baseColorFactor) / 255.0).tolist())
        image = look.baseColorTexture
        if image is not None and mesh.visual.uv is not None:
            color = color or (1.0, 1.0, 1.0, 1.0)
            columns["uv"] = mesh.visual.uv[:, :2]
            if id(image) not in textures:
                try:
                    textures[id(image)] = _encode(image)
                except Exception as error:
                    textures[id(image)] = None
                    notes.append(_unusable("a texture in it", error))
            texture = textures[id(image)]
    elif mesh.visual.kind == "vertex":
        columns["vertex_colors"] = mesh.visual.vertex_colors / 255.0
    elif mesh.visual.kind == "face":
        columns = {name: rows[faces.ravel()] for name, rows in columns.items()}
        columns["vertex_colors"] = np.repeat(mesh.visual.face_colors / 255.0, 3, axis=0)
        faces = np.arange(faces.size).reshape(-1, 3)
    if not is_linear:
        color = None if color is None else to_linear(color)
        if "vertex_colors" in columns:
            rgb = columns["vertex_colors"][:, :3]
            columns["vertex_colors"][:, :3] = linear(rgb)
    return Surface(faces=faces, color=color, texture=texture, **columns)


def _encode(image: Any) -> bytes:
    """Return an image of Pillow as a PNG or JPEG file."""
    if image.width * image.height > _MAX_PIXELS:
        raise ValueError(f"it has more than {_MAX_PIXELS} pixels")
    kind = "JPEG" if image.format == "JPEG" else "PNG"
    stream = io.BytesIO()
    rgb = image.convert("RGB" if kind == "JPEG" else "RGBA")
    rgb.save(stream, kind, quality=95)
    return stream.getvalue()


def _unusable(what: str, error: Exception) -> ReportEntry:
    # Other exceptions tell of Pillow's inside.
    reason = f" ({error})" if type(error) is ValueError else ""
    return ReportEntry(
        "warning", "invalid", f"{what} can't be read{reason}", "drawn without it"
    )
