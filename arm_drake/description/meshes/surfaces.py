"""Triangles with one look, as the readers of mesh files hand them to the writers."""

import dataclasses as dc
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Color = tuple[float, float, float, float]


@dc.dataclass(frozen=True)
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
