"""Surfaces as a glTF file, the form in which Drake draws them with their colours."""

import base64
import json
from typing import Any

import numpy as np

from arm_drake.description.meshes.surfaces import Array, Color, Surface, to_linear

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


def _y_up(vectors: Array) -> Array:
    return vectors[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
