"""Mesh files of robot descriptions to what Drake draws and collides, once.

COLLADA is read as RViz and Gazebo read it: the unit counts, the up axis doesn't.
"""

import hashlib
import io
import re
from pathlib import Path, PureWindowsPath
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np

from arm_drake.description import mesh_cache
from arm_drake.description.mesh_cache import Array, Color, Surface
from arm_drake.description.mesh_cache import cache_directory as cache_directory
from arm_drake.description.mesh_cache import clear_cache as clear_cache
from arm_drake.description.report import Kind, LoadReport, ReportEntry, Severity

# Part of every cache key: raise it when the same input gives another output.
CONVERTER_VERSION = 2

MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".ply", ".stl")

Scale = tuple[float, float, float]

_DEFAULT_COLOR: Color = (0.7, 0.7, 0.7, 1.0)

# Drake's convex hull needs a volume: a flat mesh gets this thickness [m].
_FLAT_THICKNESS = 1e-4
_FLATNESS = 1e-5  # Thickness as a part of the size; less is flat.

_IMAGES = (".bmp", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff")

# How COLLADA, OBJ and MTL, PLY and glTF name the files that belong to them.
_REFERENCE = re.compile(
    rb"<image\b[^>]*>\s*<init_from>\s*(?:<ref>)?([^<]+)<"
    rb"|^\s*(?:mtllib|map_Kd|comment TextureFile)[ \t]+([^\r\n]+)"
    rb'|"uri"\s*:\s*"(?!data:)([^"]+)"',
    re.MULTILINE,
)


def convert_visual(
    source: Path,
    scale: Scale,
    report: LoadReport,
    *,
    where: str,
    file: Path | None = None,
    cache_dir: Path | None = None,
    color: Color | None = None,
) -> Path | None:
    """Return a glTF file that Drake draws with scale 1, or None and a report line.

    Args:
        source: The mesh file.
        scale: Factors for x, y and z; negative ones mirror.
        report: Receives what was not taken as written.
        where: Place in the description, such as "link 'link1', visual 0".
        file: The description.
        cache_dir: Folder of converted meshes, by default `cache_directory`.
        color: For a mesh that has no colour of its own.

    Raises:
        OutputError: Neither the cache nor a temporary folder can be written.
    """
    place = {"where": where, "file": file}
    return _convert("visual", source, scale, report, place, cache_dir, color)


def convert_collision(
    source: Path,
    scale: Scale,
    report: LoadReport,
    *,
    where: str,
    file: Path | None = None,
    cache_dir: Path | None = None,
) -> Path | None:
    """Return an OBJ file of the convex hull, or None and a report line.

    Arguments and errors are those of `convert_visual`.
    """
    place = {"where": where, "file": file}
    return _convert("collision", source, scale, report, place, cache_dir, None)


def _convert(
    role: Literal["visual", "collision"],
    source: Path,
    scale: Scale,
    report: LoadReport,
    place: dict[str, Any],
    cache_dir: Path | None,
    color: Color | None,
) -> Path | None:
    is_visual = role == "visual"
    severity: Severity = "warning" if is_visual else "error"
    done = "it isn't drawn" if is_visual else "nothing collides with it"
    mesh = f"mesh file {str(source)!r}"
    suffix = source.suffix.lower()

    def fail(kind: Kind, problem: str, severity: Severity = severity) -> Path | None:
        report.add(severity, kind, f"{mesh} {problem}", done, **place)
        return None

    if suffix not in MESH_SUFFIXES:
        known = ", ".join(MESH_SUFFIXES)
        return fail("unsupported", f"has an unknown type {suffix!r}, known: {known}")
    if not all(np.isfinite(s) and s != 0.0 for s in scale):
        return fail("invalid", f"has the scale {scale}, which has to be finite, not 0")
    try:
        content = source.read_bytes()
        references = {} if suffix == ".stl" else _references(source, content)
        contents = [path.read_bytes() for path in references.values() if path]
    except FileNotFoundError:
        return fail("missing", "doesn't exist")
    except OSError as error:
        return fail("invalid", f"can't be read ({error.strerror})")

    if is_visual:
        for lost in sorted(n for n, path in references.items() if path is None):
            what = f"{mesh}: its file {lost!r} doesn't exist"
            report.add("warning", "missing", what, "drawn without it", **place)
    sums = [hashlib.sha256(data).hexdigest() for data in (content, *contents)]
    key = (
        CONVERTER_VERSION,
        role,
        suffix,
        *map(float, scale),
        color,
        [*references],
        sums,
    )
    folder = (cache_directory() if cache_dir is None else cache_dir).absolute()
    name = hashlib.sha256(repr(key).encode()).hexdigest()
    name += ".gltf" if is_visual else ".obj"
    converted = mesh_cache.find(folder, name)

    if converted is None:
        notes: list[ReportEntry] = []
        try:
            with np.errstate(all="ignore"):
                surfaces = _read(source, content, scale)
                points = None if is_visual else _hull_points(surfaces, notes)
        # The parsers of other projects answer a bad file with any exception there is.
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            return fail("invalid", f"can't be read ({reason[:100]})")
        if not surfaces or (points is not None and not len(points)):
            return fail("invalid", "holds no triangles", "warning")
        images = [p for p in references.values() if p and p.suffix.lower() in _IMAGES]
        if images and points is None and all(s.texture is None for s in surfaces):
            what = f"its texture {images[0].name!r} can't be read"
            notes.append(ReportEntry("warning", "invalid", what, "drawn without it"))
        if points is None:
            output = mesh_cache.encode_gltf(surfaces, color or _DEFAULT_COLOR)
        else:
            output = mesh_cache.encode_hull(points)
        converted = mesh_cache.keep(folder, name, output, notes=notes, report=report)
    for note in converted.notes:
        what = f"{mesh}: {note.what}"
        report.add(note.severity, note.kind, what, note.done, **place)
    return converted.path


def _references(source: Path, content: bytes) -> dict[str, Path | None]:
    """Return where the files are that a mesh file names, None if they don't exist."""
    found: dict[str, Path | None] = {}
    for match in _REFERENCE.finditer(content):
        name = next(filter(None, match.groups())).decode(errors="replace").strip()
        found[name] = path = _beside(source, name)
        if path is not None and source.suffix.lower() == ".obj":
            found |= _references(path, path.read_bytes())
    return found


def _beside(source: Path, name: str) -> Path | None:
    """Return the file that a mesh file calls `name`, as RViz and Gazebo look for it."""
    relative = PureWindowsPath(unquote(name.removeprefix("file://"))).as_posix()
    base = PureWindowsPath(relative).name
    folders = (source.parent, source.parent / "../materials/textures")
    candidates = [source.parent / relative, *(folder / base for folder in folders)]
    return next((path for path in candidates if path.is_file()), None)


def _read(source: Path, content: bytes, scale: Scale) -> list[Surface]:
    """Return the surfaces of a mesh file, nodes flattened and z up."""
    # Not at the top: the imports take longer than all hits of the cache together.
    import trimesh

    class Files(trimesh.resolvers.FilePathResolver):
        def get(self, name: str) -> bytes:
            path = _beside(source, name.strip())
            if path is None:
                raise FileNotFoundError(f"its file {name!r} doesn't exist")
            return path.read_bytes()

    suffix = source.suffix.lower()
    if content.startswith(b"version https://git-lfs"):
        raise ValueError("a Git LFS pointer, fetch it with `git lfs pull`")
    if suffix == ".stl":  # Some exporters write bytes after the last triangle.
        size = 84 + 50 * int.from_bytes(content[80:84], "little")
        content = content[:size] if size > 84 else content
    stream, files = io.BytesIO(content), Files(str(source))
    scene = trimesh.load_scene(stream, suffix[1:], resolver=files, process=False)
    surfaces = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):  # Points or lines.
            continue
        matrix = np.array(transform)
        unit, is_scaled, _ = str(mesh.metadata.get("units", "")).partition("*")
        if suffix == ".dae" and is_scaled:
            matrix *= float(unit)
        if suffix in (".gltf", ".glb"):  # y up, by their specification.
            matrix = matrix[[0, 2, 1]] * [[1.0], [-1.0], [1.0]]
        surface = _surface(mesh, np.diag(scale) @ matrix[:3], suffix)
        if len(surface.faces):
            surfaces.append(surface)
    return surfaces


def _surface(mesh: Any, matrix: Array, suffix: str) -> Surface:
    """Return a trimesh mesh, mapped by a (3, 4) matrix, without degenerate faces."""
    faces = np.asarray(mesh.faces)
    columns = {"vertices": mesh.vertices @ matrix[:, :3].T + matrix[:, 3]}
    volume = np.linalg.det(matrix[:, :3])
    # Only normals of the file: trimesh would round the edges of a box.
    if "vertex_normals" in mesh._cache and volume != 0.0:
        normals = mesh.vertex_normals @ np.linalg.inv(matrix[:, :3])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        if (length > 0.0).all():  # NaN isn't.
            columns["normals"] = normals / length
    color = texture = None
    if mesh.visual.kind == "texture":
        look = mesh.visual.material
        look = look if hasattr(look, "baseColorFactor") else look.to_pbr()
        if look.baseColorFactor is not None:
            color = tuple((np.asarray(look.baseColorFactor) / 255.0).tolist())
        if look.baseColorTexture is not None and mesh.visual.uv is not None:
            color, texture = color or (1.0, 1.0, 1.0, 1.0), _encode(look)
            columns["uv"] = mesh.visual.uv[:, :2]
    elif mesh.visual.kind == "vertex":
        columns["vertex_colors"] = mesh.visual.vertex_colors / 255.0
    elif mesh.visual.kind == "face":
        columns = {name: rows[faces.ravel()] for name, rows in columns.items()}
        columns["vertex_colors"] = np.repeat(mesh.visual.face_colors / 255.0, 3, axis=0)
        faces = np.arange(faces.size).reshape(-1, 3)

    if suffix not in (".gltf", ".glb"):  # All others have sRGB colours.
        color = None if color is None else mesh_cache.to_linear(color)
        if "vertex_colors" in columns:
            rgb = columns["vertex_colors"][:, :3]
            columns["vertex_colors"][:, :3] = mesh_cache.linear(rgb)

    # STL and COLLADA come with three vertices of its own for every triangle.
    table = np.hstack(list(columns.values())).astype("<f4", order="C")
    keys = table.view(f"V{4 * table.shape[1]}").ravel()
    _, kept, rows = np.unique(keys, return_index=True, return_inverse=True)
    faces = rows[faces] if volume > 0.0 else rows[faces][:, ::-1]
    a, b, c = np.moveaxis(table[kept, :3].astype(float)[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    is_good = np.isfinite(area) & (area > 0.0)
    used, faces = np.unique(faces[is_good], return_inverse=True)
    columns = {name: rows[kept[used]] for name, rows in columns.items()}
    return Surface(faces=faces.reshape(-1, 3), color=color, texture=texture, **columns)


def _encode(look: Any) -> bytes | None:
    """Return the texture of a material as a PNG or JPEG file, None if it's damaged."""
    image = look.baseColorTexture
    kind = "JPEG" if image.format == "JPEG" else "PNG"
    stream = io.BytesIO()
    try:
        rgb = image.convert("RGB" if kind == "JPEG" else "RGBA")
        rgb.save(stream, kind, quality=95)
    except (OSError, SyntaxError, ValueError):  # What Pillow raises.
        return None
    return stream.getvalue()


def _hull_points(surfaces: list[Surface], notes: list[ReportEntry]) -> Array:
    """Return points that span a volume, shape (n, 3); none if they are on a line."""
    if not surfaces:
        return np.empty((0, 3))
    points = np.unique(np.concatenate([s.vertices for s in surfaces]), axis=0)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    # Rows of `axes` are the principal axes, the thinnest last.
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    extents = np.ptp(centred @ axes.T, axis=0)
    if extents[1] <= _FLATNESS * size:
        return np.empty((0, 3))
    if extents[2] <= _FLATNESS * size:
        offset = axes[2] * max(_FLAT_THICKNESS, 2.0 * _FLATNESS * size) / 2.0
        points = np.concatenate([points - offset, points + offset])
        what = "the mesh is flat"
        notes.append(
            ReportEntry("info", "repair", what, "its hull is 0.1 mm thick or more")
        )
    return points
