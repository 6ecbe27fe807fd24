"""COLLADA files as RViz and Gazebo read them.

The unit counts, the up axis doesn't; nodes are flattened; lights and cameras are left.
"""

import io
import math
import zipfile
from collections.abc import Callable, Iterator
from typing import Any
from xml.parsers import expat

import numpy as np

from arm_drake.description.meshes.surfaces import (
    Array,
    Color,
    Surface,
    linear,
    to_linear,
)
from arm_drake.description.report import ReportEntry

# Nodes can be used in nodes that are used in nodes.
_MAX_NODES = 20_000


class _PrologEnd(Exception):
    """The first element starts, all declarations are read."""


def read_collada(
    content: bytes,
    texture: Callable[[str], bytes | None],
    notes: list[ReportEntry],
) -> Iterator[tuple[Surface, Array]]:
    """Yield surfaces with the (4, 4) matrix that puts them into the robot's link.

    Args:
        content: The file.
        texture: Returns an image as a PNG or JPEG file, by the name in the file.
        notes: Receives what can't be used.

    Raises:
        ValueError: The file can't be used; pycollada raises many other exceptions.
    """
    # Not at the top: the import takes longer than all hits of the cache together.
    import collada

    _check_prolog(content)
    if zipfile.is_zipfile(io.BytesIO(content)):
        raise ValueError("it is a ZIP archive")
    document = collada.Collada(io.BytesIO(content), ignore=[collada.DaeError])
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
            yield _surface(primitive, effect, texture), scaled
    if not document.errors:
        return
    first, *others = document.errors
    if is_empty:
        raise ValueError(str(first))
    more = f", and {len(others)} more" if others else ""
    what = f"a part of it can't be read ({first}{more})"
    notes.append(ReportEntry("warning", "invalid", what, "left out"))


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


def _surface(
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
