"""Meshes in the form in which Drake takes them, and the cache that keeps them.

Visual meshes become glTF with everything embedded, collision meshes the convex hull
as OBJ. Beside each file lies a ``.json`` with its checksum and its report lines.
"""

import atexit
import base64
import dataclasses as dc
import functools
import hashlib
import json
import os
import re
import shutil
import tempfile
import uuid
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

from arm_drake.description.report import LoadReport, ReportEntry
from arm_drake.errors import OutputError

Array = NDArray[Any]
Color = tuple[float, float, float, float]

_MATTE = {"metallicFactor": 0.0, "roughnessFactor": 0.8}

# Names that this module writes, including what an interrupted write leaves.
_OURS = re.compile(r"[0-9a-f]{64}\.(gltf|obj)(\.json)?(\.\w+\.tmp)?")


@dc.dataclass(frozen=True)
class Surface:
    """Triangles with one look; n vertices, m triangles, z up."""

    # [m], shape (n, 3).
    vertices: Array

    # Rows of `vertices`, counter-clockwise seen from outside, shape (m, 3).
    faces: Array

    # Red, green, blue, alpha in [0, 1]; None without a colour of its own.
    color: Color | None = None

    # Unit normals, shape (n, 3); None for flat shading.
    normals: Array | None = None

    # Texture coordinates from the lower left corner, shape (n, 2).
    uv: Array | None = None

    # Colours in [0, 1], shape (n, 4).
    vertex_colors: Array | None = None

    # A PNG or JPEG file.
    texture: bytes | None = None


@dc.dataclass(frozen=True)
class ConvertedMesh:
    """A file that Drake takes with scale 1, and what was reported on the way."""

    # Absolute.
    path: Path

    # Without place and file, which belong to whoever asks.
    notes: tuple[ReportEntry, ...] = ()


def cache_directory() -> Path:
    """Return the folder of converted meshes; ``ARM_DRAKE_CACHE`` moves it."""
    root = os.environ.get("ARM_DRAKE_CACHE") or platformdirs.user_cache_dir("arm_drake")
    return Path(root).expanduser().absolute() / "meshes"


def clear_cache(cache_dir: Path | None = None) -> int:
    """Remove converted meshes, nothing else, and return how many files that were."""
    folder = cache_directory() if cache_dir is None else cache_dir
    ours = [path for path in folder.glob("*") if _OURS.fullmatch(path.name)]
    for path in ours:
        path.unlink(missing_ok=True)  # Another process may be clearing it too.
    return len(ours)


def find(folder: Path, name: str) -> ConvertedMesh | None:
    """Return what `keep` wrote, or None if it isn't there undamaged."""
    for place in (folder, None):
        try:
            path = (place or _substitute(folder)) / name
            record = json.loads(path.with_name(f"{name}.json").read_bytes())
            if hashlib.sha256(path.read_bytes()).hexdigest() == record["sha256"]:
                notes = tuple(ReportEntry(**note) for note in record["notes"])
                return ConvertedMesh(path, notes)
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return None


def keep(
    folder: Path,
    name: str,
    content: bytes,
    *,
    notes: list[ReportEntry],
    report: LoadReport,
) -> ConvertedMesh:
    """Write a converted mesh so that no reader ever sees half of it.

    A cache that can't be written is replaced by a temporary folder, with a report line.

    Raises:
        OutputError: The temporary folder can't be written either.
    """
    checksum = hashlib.sha256(content).hexdigest()
    record = {"sha256": checksum, "notes": [dc.asdict(note) for note in notes]}
    files = {name: content, f"{name}.json": json.dumps(record).encode()}
    try:
        _write(folder, files)
    except OSError as error:
        what = f"the mesh cache {str(folder)!r} can't be written ({error.strerror})"
        done = "converted meshes last as long as this process"
        report.add("info", "ignored", what, done)
        try:
            folder = _substitute(folder)
            _write(folder, files)
        except OSError as error:
            what = f"no converted mesh can be written ({error.strerror})"
            raise OutputError(what, file=folder) from error
    return ConvertedMesh(folder / name, tuple(notes))


def _write(folder: Path, files: dict[str, bytes]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        handle, unfinished = tempfile.mkstemp(".tmp", f"{name}.", folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            Path(unfinished).replace(folder / name)
        except OSError:
            Path(unfinished).unlink(missing_ok=True)
            raise


def _substitute(folder: Path) -> Path:
    """Return where this process keeps what it can't write to a cache."""
    return _temporary_directory() / hashlib.sha256(bytes(folder)).hexdigest()


@functools.cache
def _temporary_directory() -> Path:
    path = Path(tempfile.gettempdir(), f"arm_drake_meshes_{uuid.uuid4().hex}")
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


def encode_gltf(surfaces: list[Surface], default_color: Color) -> bytes:
    """Return a glTF file with embedded buffers and textures.

    glTF is y-up and Drake turns it by +90° about x; here it is turned back. Surfaces
    without a colour of their own get `default_color`.
    """
    buffer = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    materials: list[dict[str, Any]] = []
    images: list[str] = []
    primitives: list[dict[str, Any]] = []

    def add(values: Array, kind: str, *, is_index: bool = False) -> int:
        data = np.ascontiguousarray(values, "<u4" if is_index else "<f4")
        accessor: dict[str, Any] = {"bufferView": len(views), "type": kind}
        accessor["componentType"] = 5125 if is_index else 5126  # unsigned int, float
        accessor["count"] = data.size if is_index else len(data)
        if kind == "VEC3":
            accessor |= {"min": data.min(0).tolist(), "max": data.max(0).tolist()}
        view = {"buffer": 0, "byteOffset": len(buffer), "byteLength": data.nbytes}
        views.append(view | {"target": 34963 if is_index else 34962})
        accessors.append(accessor)
        buffer.extend(data.tobytes())
        return len(accessors) - 1

    for surface in surfaces:
        attributes = {"POSITION": add(_y_up(surface.vertices), "VEC3")}
        if surface.normals is not None:
            attributes["NORMAL"] = add(_y_up(surface.normals), "VEC3")
        color = surface.color or to_linear(default_color)
        if surface.vertex_colors is not None:
            attributes["COLOR_0"] = add(surface.vertex_colors, "VEC4")
            color = (1.0, 1.0, 1.0, 1.0)
        look: dict[str, Any] = {"baseColorFactor": color} | _MATTE
        if surface.texture is not None and surface.uv is not None:
            attributes["TEXCOORD_0"] = add([0, 1] + surface.uv * [1, -1], "VEC2")
            kind = "png" if surface.texture.startswith(b"\x89PNG") else "jpeg"
            uri = _data_uri(f"image/{kind}", surface.texture)
            images += [] if uri in images else [uri]
            look["baseColorTexture"] = {"index": images.index(uri)}
        material = {"pbrMetallicRoughness": look, "doubleSided": True}
        if color[3] < 1.0:
            material["alphaMode"] = "BLEND"
        materials += [] if material in materials else [material]
        primitive: dict[str, Any] = {"attributes": attributes}
        primitive["indices"] = add(surface.faces, "SCALAR", is_index=True)
        primitives.append(primitive | {"material": materials.index(material)})

    uri = _data_uri("application/octet-stream", bytes(buffer))
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "arm_drake"}}
    document |= {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    document |= {"meshes": [{"primitives": primitives}], "materials": materials}
    document |= {"accessors": accessors, "bufferViews": views}
    document["buffers"] = [{"byteLength": len(buffer), "uri": uri}]
    if images:
        document["images"] = [{"uri": image} for image in images]
        document["textures"] = [{"source": i} for i in range(len(images))]
    return json.dumps(document, separators=(",", ":")).encode()


def to_linear(color: Color) -> Color:
    """Return an sRGB colour, as robot descriptions give it, in glTF's linear space."""
    r, g, b = linear(np.array(color[:3])).tolist()
    return (r, g, b, color[3])


def linear(srgb: Array) -> Array:
    """Return sRGB values in [0, 1] as linear ones (IEC 61966-2-1), any shape."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _y_up(vectors: Array) -> Array:
    return vectors[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def encode_hull(points: Array) -> bytes:
    """Return an OBJ file of the convex hull, faces outward.

    The points [m], shape (n, 3), must not lie in one plane.
    """
    # Not at the top: the import takes longer than all hits of the cache together.
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    faces = hull.simplices
    a, b, c = points[faces.T]
    is_inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces = np.where(is_inward[:, None], faces[:, ::-1], faces)
    used, rows = np.unique(faces, return_inverse=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points[used].tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (rows.reshape(-1, 3) + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()
