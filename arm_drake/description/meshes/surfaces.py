"""Triangle surfaces of one material, between mesh readers and writers.

Fewer triangles for what is drawn, its colours as they were.

The method is that of Garland and Heckbert, "Surface Simplification Using Quadric Error
Metrics", 1997, in the library fast-simplification. Where it comes to an end too early,
as at threads and springs, follows that of Rossignac and Borrel, "Multi-Resolution 3D
Approximations for Rendering Complex Scenes", 1993: vertices in one cell of a grid
become one.
"""

import base64
import dataclasses as dc
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.report import ReportEntry
from arm_drake.errors import InputError, MissingExtraError
from arm_drake.importing import dataclass

Array = NDArray[Any]
Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class Surface:
    """Triangles with one look; n vertices, m triangles."""

    # [m], shape (n, 3).
    vertices: Array

    # Rows of `vertices`, counter-clockwise seen from outside, shape (m, 3).
    faces: Array

    # Linear red, green, blue, and alpha in [0, 1]; None without a colour of its own.
    color: Color | None = None

    # Unit normals, shape (n, 3); None for flat shading.
    normals: Array | None = None

    # Texture coordinates from the lower left corner, shape (n, 2).
    uv: Array | None = None

    # Linear colours in [0, 1], shape (n, 4).
    vertex_colors: Array | None = None

    # A PNG or JPEG file.
    texture: bytes | None = None


def transformed(surface: Surface, matrix: Array) -> Surface:
    """Return a surface where a (3, 4) matrix puts it, without needless parts.

    Vertices that are alike become one. Triangles without an area are dropped. Normals
    that aren't usable are, too.
    """
    faces = surface.faces
    columns: dict[str, Any] = {
        "vertices": surface.vertices @ matrix[:, :3].T + matrix[:, 3]
    }
    volume = np.linalg.det(matrix[:, :3])
    if surface.normals is not None and volume != 0.0:
        normals = surface.normals @ np.linalg.inv(matrix[:, :3])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        if (length > 0.0).all():  # NaN isn't.
            columns["normals"] = normals / length
    for name in ("uv", "vertex_colors"):
        if (values := getattr(surface, name)) is not None:
            columns[name] = values

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
    return dc.replace(
        surface,
        faces=faces.reshape(-1, 3),
        normals=columns.pop("normals", None),
        **columns,
    )


def to_linear(color: Color) -> Color:
    """Return an sRGB colour, as robot descriptions give it, in glTF's linear space."""
    r, g, b = linear(np.array(color[:3])).tolist()
    return (r, g, b, color[3])


def linear(srgb: Array) -> Array:
    """Return sRGB values in [0, 1] as linear ones (IEC 61966-2-1), any shape."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


_GENERATOR = "arm_drake"

# Columns of a surface, with their names in glTF, and how many numbers each has.
_ATTRIBUTES = {
    "vertices": ("POSITION", 3),
    "normals": ("NORMAL", 3),
    "vertex_colors": ("COLOR_0", 4),
    "uv": ("TEXCOORD_0", 2),
}

_MATTE = {"metallicFactor": 0.0, "roughnessFactor": 0.8}


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
            uri = data_uri(f"image/{kind}", surface.texture)
            images += [] if uri in images else [uri]
            look["baseColorTexture"] = {"index": images.index(uri)}
        material = {"pbrMetallicRoughness": look, "doubleSided": True}
        if color[3] < 1.0:
            material["alphaMode"] = "BLEND"
        materials += [] if material in materials else [material]
        primitive: dict[str, Any] = {"attributes": attributes}
        primitive["indices"] = add(surface.faces, "SCALAR", is_index=True)
        primitives.append(primitive | {"material": materials.index(material)})

    uri = data_uri("application/octet-stream", bytes(buffer))
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": _GENERATOR}}
    document |= {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    document |= {"meshes": [{"primitives": primitives}], "materials": materials}
    document |= {"accessors": accessors, "bufferViews": views}
    document["buffers"] = [{"byteLength": len(buffer), "uri": uri}]
    if images:
        document["images"] = [{"uri": image} for image in images]
        document["textures"] = [{"source": i} for i in range(len(images))]
    return json.dumps(document, separators=(",", ":")).encode()


def decode_gltf(content: bytes) -> list[Surface]:
    """Return the surfaces of a file of `encode_gltf`, none of another's.

    Those that have a texture lack it, and have their texture coordinates.
    """
    try:
        document = json.loads(content)
    except ValueError:
        return []
    if document.get("asset", {}).get("generator") != _GENERATOR:
        return []
    data = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])

    def get(number: int, kind: str) -> Array:
        view = document["bufferViews"][document["accessors"][number]["bufferView"]]
        count = view["byteLength"] // 4
        return np.frombuffer(data, kind, count, view["byteOffset"])

    surfaces = []
    for primitive in document["meshes"][0]["primitives"]:
        look = document["materials"][primitive["material"]]["pbrMetallicRoughness"]
        columns: dict[str, Any] = {
            name: get(primitive["attributes"][key], "<f4").reshape(-1, size)
            for name, (key, size) in _ATTRIBUTES.items()
            if key in primitive["attributes"]
        }
        vertices = _z_up(columns.pop("vertices"))
        if "normals" in columns:
            columns["normals"] = _z_up(columns["normals"])
        faces = get(primitive["indices"], "<u4").reshape(-1, 3)
        color = tuple(look["baseColorFactor"])
        surfaces.append(Surface(vertices, faces, color, **columns))
    return surfaces


def move(surface: Surface, matrix: Array) -> Surface:
    """Return a surface where a (3, 4) matrix puts it, with normals."""
    faces, columns = surface.faces, dict[str, Any](vertices=surface.vertices)
    if surface.normals is None:
        corners = surface.vertices.astype(float)[faces]
        a, b, c = np.moveaxis(corners, 1, 0)
        columns["vertices"] = corners.reshape(-1, 3)
        columns["normals"] = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        if surface.vertex_colors is not None:
            columns["vertex_colors"] = surface.vertex_colors[faces.ravel()]
        faces = np.arange(faces.size).reshape(-1, 3)
    else:
        columns["normals"] = surface.normals
    normals = columns["normals"] @ np.linalg.inv(matrix[:, :3])
    columns["normals"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    columns["vertices"] = columns["vertices"] @ matrix[:, :3].T + matrix[:, 3]
    return dc.replace(surface, faces=faces, **columns)


def stack(surfaces: list[Surface]) -> tuple[Array, NDArray[np.int64]]:
    """Return the vertices of surfaces, shape (n, 3), and triangles, shape (m, 3)."""
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces)])
    faces = [s.faces + n for s, n in zip(surfaces, starts, strict=False)]
    return np.concatenate([s.vertices for s in surfaces]), np.concatenate(faces)


def join(surfaces: list[Surface]) -> Surface:
    """Return surfaces that have colours and normals as one, with colours by vertex."""
    colors = [
        np.tile(np.array(s.color), (len(s.vertices), 1))
        if s.vertex_colors is None
        else s.vertex_colors
        for s in surfaces
    ]
    return Surface(
        *stack(surfaces),
        normals=np.concatenate([np.asarray(s.normals) for s in surfaces]),
        vertex_colors=np.concatenate(colors),
    )


def _y_up(vectors: Array) -> Array:
    return vectors[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def _z_up(vectors: Array) -> Array:
    return vectors[:, [0, 2, 1]] * [1.0, -1.0, 1.0]


def data_uri(kind: str, data: bytes) -> str:
    """Return a URI that holds what it names, of a MIME type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def encode_surface(surfaces: list[Surface]) -> bytes:
    """Return an OBJ file of all triangles, of which there is at least one."""
    vertices, faces = stack(surfaces)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def decode_surface(content: bytes) -> list[Surface]:
    """Return the surface of a file of `encode_surface`, none of most others'."""
    try:
        rows = np.array(content.split()).reshape(-1, 4)
        is_vertex = rows[:, 0] == b"v"
        vertices = rows[is_vertex, 1:].astype(float)
        faces = rows[~is_vertex, 1:].astype(int) - 1
    except ValueError:
        return []
    is_known = (is_vertex | (rows[:, 0] == b"f")).all() and len(faces)
    if not is_known or not 0 <= faces.min() <= faces.max() < len(vertices):
        return []
    return [Surface(vertices, faces)]


# The fewest triangles of a solid.
_FEWEST = 4

# Faces that meet at a smaller angle than this look like one curved face.
_CREASE = np.cos(np.deg2rad(40.0))

# How often the surfaces of a mesh are given other shares.
_ROUNDS = 3

# How soon the library gives up exactness for speed, the default first, and the size of
# a mesh for which it does so: its thresholds are lengths.
_AGGRESSIONS = (7, 5)
_SIZE = 1000.0

# By how much a mesh may grow or shrink, as a share of its size.
_TOLERANCE = 0.02

# The finest grid has so many cells along a mesh, the coarsest two.
_CELLS = 1024

# Where the points of a texture belong is lost with the vertices.
_TEXTURED = "its textured part stays as it is"


def require_decimation(max_faces: int) -> str:
    """Return the version of the library that decimates, a part of cache keys."""
    if max_faces < _FEWEST:
        raise InputError(f"max_faces: expected {_FEWEST} or more, got {max_faces}")
    try:
        import fast_simplification  # type: ignore[import-untyped]  # noqa: F401
    except ImportError:
        raise MissingExtraError("decimation of meshes", "decimate") from None
    from importlib.metadata import version  # It brings e-mail and more.

    return version("fast-simplification")


def decimate(
    surfaces: list[Surface], max_faces: int, notes: list[ReportEntry]
) -> list[Surface]:
    """Return surfaces with fewer triangles, all together within the maximum.

    Every surface keeps its share of them. Surfaces with a texture stay as they are.
    """
    count = _count(surfaces)
    if count <= max_faces:
        return surfaces
    plain = [s for s in surfaces if s.texture is None]
    plain_count = _count(plain)
    spare = max(max_faces - (count - plain_count) - _FEWEST * len(plain), 0)
    for _ in range(_ROUNDS):
        result = [
            s
            if s.texture is not None
            else _decimate(s, _FEWEST + len(s.faces) * spare // plain_count)
            for s in surfaces
        ]
        drawn = _count(result)
        if drawn <= max_faces:
            break
        # Some can't do with their share; the others must do with less.
        spare = max(spare - 2 * (drawn - max_faces), 0)
    done = f"drawn with {drawn}"
    if len(plain) < len(surfaces):
        done += f"; {_TEXTURED}"
    elif drawn > max_faces:
        done += "; with fewer, parts of it would be lost"
    what = f"it has {count} triangles, more than {max_faces}"
    notes.append(ReportEntry("info", "repair", what, done))
    return result


def _count(surfaces: list[Surface]) -> int:
    return sum(len(surface.faces) for surface in surfaces)


def _decimate(surface: Surface, max_faces: int) -> Surface:
    """Return a surface with at most so many triangles, or as few as are possible."""
    # Not at the top: most robots are loaded without it.
    from scipy.spatial import cKDTree

    if len(surface.faces) <= max_faces:
        return surface
    # Vertices are several where a colour or a normal changes: there it would tear.
    points, rows = np.unique(surface.vertices, axis=0, return_inverse=True)
    vertices, faces = points, rows.reshape(-1)[surface.faces]
    vertices, faces = _collapse(vertices, faces, max_faces)
    vertices, faces = _cluster(vertices, faces, max_faces)
    columns: dict[str, Any] = {"normals": None, "vertex_colors": None, "uv": None}
    if surface.vertex_colors is not None:
        nearest = cKDTree(surface.vertices).query(vertices)[1]
        columns["vertex_colors"] = surface.vertex_colors[nearest]
    if surface.normals is not None:
        columns["normals"] = _corner_normals(vertices, faces)
        if columns["vertex_colors"] is not None:
            columns["vertex_colors"] = columns["vertex_colors"][faces.ravel()]
        vertices = vertices[faces.ravel()]
        faces = np.arange(faces.size).reshape(-1, 3)
    fewer = dc.replace(surface, vertices=vertices, faces=faces, **columns)
    return transformed(fewer, np.eye(3, 4))


def _collapse(vertices: Array, faces: Array, max_faces: int) -> tuple[Array, Array]:
    """Return vertices and faces with fewer edges, as large as they were."""
    import fast_simplification

    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    scale = (upper - lower).max() / _SIZE
    for aggression in _AGGRESSIONS:
        points, triangles = fast_simplification.simplify(
            ((vertices - lower) / scale).astype("<f4"),
            faces.astype("<i4"),
            target_count=max_faces,
            agg=aggression,
        )
        if not len(triangles):
            continue
        points = lower + scale * points.astype(float)
        ends = np.stack([points.min(axis=0) - lower, points.max(axis=0) - upper])
        if np.abs(ends).max() <= _TOLERANCE * scale * _SIZE:
            return points, triangles.astype(np.int64)
    return vertices, faces


def _cluster(vertices: Array, faces: Array, max_faces: int) -> tuple[Array, Array]:
    """Return vertices and faces on the finest grid that has few enough of them."""
    if len(faces) <= max_faces:
        return vertices, faces
    too_coarse, too_fine = 2, _CELLS
    best = _snap(vertices, faces, too_coarse)
    while too_fine - too_coarse > 1:
        middle = (too_coarse + too_fine) // 2
        snapped = _snap(vertices, faces, middle)
        if len(snapped[1]) <= max_faces:
            best, too_coarse = snapped, middle
        else:
            too_fine = middle
    return best


def _snap(vertices: Array, faces: Array, cells: int) -> tuple[Array, Array]:
    """Return vertices and faces where all vertices in a cell are one of them."""
    lower = vertices.min(axis=0)
    cell = np.ptp(vertices, axis=0).max() / cells
    places = np.floor((vertices - lower) / cell)
    _, kept, rows = np.unique(places, axis=0, return_index=True, return_inverse=True)
    snapped = np.sort(rows.reshape(-1)[faces], axis=1)
    is_left = (np.diff(snapped, axis=1) > 0).all(axis=1)
    _, first = np.unique(snapped[is_left], axis=0, return_index=True)
    return vertices[kept], rows.reshape(-1)[faces[np.flatnonzero(is_left)[first]]]


def _corner_normals(vertices: Array, faces: Array) -> Array:
    """Return normals that are smooth but for creases, one for each corner."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    areas = np.cross(b - a, c - a)
    length = np.linalg.norm(areas, axis=1, keepdims=True)
    units = areas / np.where(length > 0.0, length, 1.0)
    # All pairs of corners at the same vertex.
    corners = np.argsort(faces.ravel(), kind="stable")
    at = faces.ravel()[corners]
    first = np.searchsorted(at, at)
    valence = np.searchsorted(at, at, side="right") - first
    one = np.repeat(np.arange(len(corners)), valence)
    start = np.repeat(np.cumsum(valence) - valence, valence)
    other = np.repeat(first, valence) + np.arange(len(one)) - start
    face, neighbour = corners[one] // 3, corners[other] // 3
    is_smooth = (units[face] * units[neighbour]).sum(axis=1) > _CREASE
    normals = np.zeros((faces.size, 3))
    np.add.at(normals, corners[one][is_smooth], areas[neighbour[is_smooth]])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    flat = np.where(length > 0.0, normals, [0.0, 0.0, 1.0])
    return flat / np.where(length > 0.0, length, 1.0)
