"""Mesh files of every type as surfaces in the robot's link, z up."""

import contextlib
import dataclasses as dc
import functools
import io
import json
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake.description.meshes.collada import read_collada
from arm_drake.description.meshes.files import beside, read_bytes
from arm_drake.description.meshes.surfaces import (
    Array,
    Surface,
    linear,
    to_linear,
    transformed,
)
from arm_drake.description.report import ReportEntry

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
    """Return the surfaces of a mesh file.

    Args:
        source: The file; its suffix tells the type.
        content: What is in it.
        scale: Factors for x, y and z.
        notes: Receives what can't be used.

    Raises:
        Exception: What the parsers of other projects answer a bad file with.
    """
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
    """Return a binary STL file with as many triangles as its header tells.

    Raises:
        ValueError: There are fewer.
    """
    is_text = b"\0" not in content[:_STL_HEADER] and _STL_TEXT.search(content[:4096])
    if is_text or len(content) < _STL_HEADER:
        return content
    told = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    there = (len(content) - _STL_HEADER) // _STL_TRIANGLE
    lie = f"its header tells of {told} triangles, it has bytes for {there}"
    if told > there:
        raise ValueError(lie)
    if told < there:
        notes.append(ReportEntry("warning", "invalid", lie, "the rest is left out"))
    # Some exporters write bytes after the last triangle.
    return content[: _STL_HEADER + _STL_TRIANGLE * told]


def _check_ply(content: bytes, meshes: list[Any], notes: list[ReportEntry]) -> None:
    """Compare a header with what was read: lines of text end where they end."""
    header = content.partition(b"end_header")[0]
    told = {kind: int(count) for kind, count in _PLY_ELEMENT.findall(header)}
    vertices = sum(len(mesh.vertices) for mesh in meshes)
    if told.get(b"vertex", 0) > vertices:
        lie = f"its header tells of {told[b'vertex']} vertices, {vertices} are there"
        raise ValueError(lie)
    faces = sum(len(getattr(mesh, "faces", ())) for mesh in meshes)
    if told.get(b"face", 0) > faces:  # Less is not a lie: polygons become triangles.
        what = f"its header tells of {told[b'face']} faces, {faces} are there"
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
