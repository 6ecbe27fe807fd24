"""Shapes of a scene as Meshcat draws them in a colour of our choice."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Convex,
    GeometryId,
    HalfSpace,
    Mesh,
    Meshcat,
    PolygonSurfaceMesh,
    Rgba,
    SceneGraphInspector,
    Shape,
    TriangleSurfaceMesh,
)

from arm_drake.description.meshes.reading import read_surfaces


class Triangles(NamedTuple):
    """Triangles of one colour; n vertices, m triangles, as Meshcat takes them."""

    # [m], shape (3, n).
    vertices: NDArray[np.float64]

    # Columns of `vertices`, counter-clockwise seen from outside, shape (3, m).
    faces: NDArray[np.int32]


Solid: TypeAlias = Shape | Triangles


# Properties of three.js of what is drawn beside visual shapes, by Meshcat's names.
#
# Often it coincides with them: it is drawn as if it were a little closer to the camera,
# by half a millimetre at a distance of 1 m, else both would be seen in patches.
_CLOSER: Mapping[str, bool | float] = {
    "material.polygonOffset": True,
    "material.polygonOffsetFactor": -1.0,
    "material.polygonOffsetUnits": -80.0,
}
# Or it is inside of them, and drawn last of all, whatever is before it.
_ON_TOP: Mapping[str, bool | float] = {"material.depthTest": False, "renderOrder": 1.0}

# What is on top has no depth; what is transparent, if only hardly, is drawn in its
# order from the back to the front.
_HARDLY_TRANSPARENT = 0.99


def draw_solid(
    meshcat: Meshcat, path: str, solid: Solid, rgba: Rgba, *, is_on_top: bool = False
) -> None:
    """Draw a solid; what was at its path is replaced.

    Args:
        meshcat: Where to draw it.
        path: Its path.
        solid: What to draw.
        rgba: Its colour.
        is_on_top: Whether it is seen through all that is before it; then the colour's
            alpha isn't used.
    """
    if is_on_top:
        rgba = Rgba(rgba.r(), rgba.g(), rgba.b(), _HARDLY_TRANSPARENT)
    if isinstance(solid, Triangles):
        meshcat.SetTriangleMesh(path, solid.vertices, solid.faces, rgba)
    else:
        meshcat.SetObject(path, solid, rgba)
    for name, value in (_ON_TOP if is_on_top else _CLOSER).items():
        meshcat.SetProperty(f"{path}/<object>", name, value)


def visual_solid(inspector: SceneGraphInspector, geometry: GeometryId) -> Solid | None:
    """Return a visual shape, such that its colour can be chosen.

    Meshcat draws a glTF file in the file's own colours, so here it becomes triangles.

    Args:
        inspector: The scene.
        geometry: The shape.

    Returns:
        What to draw, None if Meshcat can't: a half space.
    """
    shape = inspector.GetShape(geometry)
    if isinstance(shape, HalfSpace):
        return None
    if isinstance(shape, Mesh) and shape.source().is_path():
        path = Path(shape.source().path())
        if path.suffix == ".gltf":
            return _read_triangles(path, shape.scale3())
    return shape


def collision_solid(
    inspector: SceneGraphInspector, geometry: GeometryId
) -> Solid | None:
    """Return a collision shape as the physics sees it.

    Drake takes the convex hull of a mesh; its triangles only where they touch things
    over areas, as rigid hydroelastic surfaces.

    Args:
        inspector: The scene.
        geometry: The shape.

    Returns:
        What to draw, None if Meshcat can't: a half space.
    """
    shape = inspector.GetShape(geometry)
    if isinstance(shape, HalfSpace):
        return None
    if not isinstance(shape, Mesh | Convex):
        return shape
    surface = inspector.maybe_get_hydroelastic_mesh(geometry)
    if isinstance(surface, TriangleSurfaceMesh):
        return _from_triangles(surface)
    return _from_polygons(inspector.GetConvexHull(geometry))


def _read_triangles(path: Path, scale: NDArray[np.float64]) -> Triangles:
    surfaces = read_surfaces(path, path.read_bytes(), tuple(scale.tolist()), [])
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    return _pack(
        np.concatenate([surface.vertices for surface in surfaces]),
        np.concatenate([s.faces + at for s, at in zip(surfaces, starts, strict=False)]),
    )


def _from_triangles(mesh: TriangleSurfaceMesh) -> Triangles:
    corners = range(3)
    faces = [[face.vertex(i) for i in corners] for face in mesh.triangles()]
    return _pack(np.array(mesh.vertices()), np.array(faces))


def _from_polygons(mesh: PolygonSurfaceMesh) -> Triangles:
    vertices = [mesh.vertex(i) for i in range(mesh.num_vertices())]
    faces = []
    for index in range(mesh.num_faces()):
        polygon = mesh.element(index)
        corners = [polygon.vertex(i) for i in range(polygon.num_vertices())]
        # Faces of a hull are convex: a fan covers them.
        faces += [(corners[0], b, c) for b, c in itertools.pairwise(corners[1:])]
    return _pack(np.array(vertices), np.array(faces))


def _pack(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Triangles:
    return Triangles(
        np.asfortranarray(vertices.T, dtype=float),
        np.asfortranarray(faces.T, dtype=np.int32),
    )
