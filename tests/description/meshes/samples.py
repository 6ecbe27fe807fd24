"""Mesh files as tests write them, and the converted ones as tests read them."""

import base64
import io
import json
import struct

import numpy as np
from PIL import Image
from pydrake.geometry import Mesh

from arm_drake.description.meshes import conversion as meshes
from arm_drake.description.report import LoadReport

ONE = (1.0, 1.0, 1.0)

# A box of 1 x 2 x 3 with a corner at the origin, counter-clockwise seen from outside.
BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], float)
_SIDES = "013032467475045051237276026064157173"
BOX_FACES = np.array([int(corner) for corner in _SIDES]).reshape(-1, 3)


def binary_stl(vertices=BOX, faces=BOX_FACES, *, header=b"", trailing=b""):
    triangles = b"".join(
        struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel(), 0) for face in faces
    )
    count = struct.pack("<I", len(faces))
    return header.ljust(80, b"\0") + count + triangles + trailing


def ascii_stl(vertices=BOX, faces=BOX_FACES):
    lines = ["solid box"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in vertices[face]]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box"]).encode()


def obj(vertices=BOX, faces=BOX_FACES, *, head=""):
    lines = [head] + [f"v {x} {y} {z}" for x, y, z in vertices]
    return "\n".join(lines + [f"f {a} {b} {c}" for a, b, c in faces + 1]).encode()


def ply(vertices=BOX, faces=BOX_FACES, *, color=""):
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    if color:
        names = ("red", "green", "blue")
        properties += "".join(f"property uchar {name}\n" for name in names)
    head = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n{properties}"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    rows = [f"{x} {y} {z} {color}" for x, y, z in vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    return (head + "end_header\n" + "\n".join(rows) + "\n").encode()


def dae(*, asset="", nodes=(("", "0.8 0.1 0.2 1"),), texture=None):
    """Return COLLADA text: one box per node, with a matrix and a diffuse colour."""
    effects = materials = scene = images = params = ""
    if texture:
        images = (
            f'<library_images><image id="i"><init_from>{texture}</init_from></image>'
        )
        images += "</library_images>"
        params = (
            '<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface>'
        )
        params += (
            '</newparam><newparam sid="t"><sampler2D><source>s</source></sampler2D>'
        )
        params += "</newparam>"
    for i, (matrix, color) in enumerate(nodes):
        diffuse = f"<color>{color}</color>"
        if texture:
            diffuse = '<texture texture="t" texcoord="UV"/>'
        effects += (
            f'<effect id="e{i}"><profile_COMMON>{params}<technique sid="c"><phong>'
            f"<diffuse>{diffuse}</diffuse><shininess><float>50</float></shininess>"
            "</phong></technique></profile_COMMON></effect>"
        )
        materials += f'<material id="m{i}"><instance_effect url="#e{i}"/></material>'
        transform = f"<matrix>{matrix}</matrix>" if matrix else ""
        scene += (
            f'<node id="n{i}">{transform}<instance_geometry url="#g"><bind_material>'
            f'<technique_common><instance_material symbol="s" target="#m{i}"/>'
            "</technique_common></bind_material></instance_geometry></node>"
        )
    positions = " ".join(map(str, BOX.ravel()))
    indices = " ".join(f"{i} {i}" for i in BOX_FACES.ravel())
    uv = " ".join(["0 0.25"] * 8)
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{asset}</asset>{images}
<library_lights><light id="l"><technique_common><directional><color>1 1 1</color>
</directional></technique_common></light></library_lights>
<library_effects>{effects}</library_effects>
<library_materials>{materials}</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="24">{positions}</float_array>
<technique_common><accessor source="#pa" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/>
</accessor></technique_common></source>
<source id="u"><float_array id="ua" count="16">{uv}</float_array>
<technique_common><accessor source="#ua" count="8" stride="2">
<param name="S" type="float"/><param name="T" type="float"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12" material="s"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="1"/><p>{indices}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="vs">{scene}
<node id="light"><instance_light url="#l"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#vs"/></scene></COLLADA>""".encode()


def png(color=(255, 0, 0)):
    stream = io.BytesIO()
    Image.new("RGB", (2, 2), color).save(stream, "PNG")
    return stream.getvalue()


class Converter:
    """The two conversions with a cache and a report of their own."""

    def __init__(self, folder):
        self.folder = folder
        self.cache = folder / "cache"
        self.report = LoadReport()

    def write(self, name, content):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        return path

    def visual(self, source, scale=ONE, **options):
        options = {"where": "link 'a', visual 0", "cache_dir": self.cache} | options
        return meshes.convert_visual(source, scale, self.report, **options)

    def collision(self, source, scale=ONE, **options):
        options = {"where": "link 'a', collision 0", "cache_dir": self.cache} | options
        paths = meshes.convert_collision(source, scale, self.report, **options)
        assert len(paths) < 2
        return paths[0] if paths else None

    @property
    def lines(self):
        return [str(entry) for entry in self.report]


def drawn_extents(path, scale=1.0):
    """Return Drake's bounding box of a mesh, after its turn from y up to z up."""
    hull = Mesh(str(path), scale).GetConvexHull()
    corners = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def read_gltf(path):
    document = json.loads(path.read_bytes())
    uri = document["buffers"][0]["uri"]
    return document, base64.b64decode(uri.partition(",")[2])


def accessor(document, data, index):
    item = document["accessors"][index]
    offset = document["bufferViews"][item["bufferView"]]["byteOffset"]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[item["type"]]
    kind = "<u4" if item["componentType"] == 5125 else "<f4"
    return np.frombuffer(data, kind, item["count"] * width, offset).reshape(-1, width)


def srgb(rgba):
    """Return linear colours, as in glTF, as descriptions give them; to 9 digits."""
    linear = np.array(rgba, dtype=float)
    rgb = linear[..., :3]
    curve = 1.055 * np.maximum(rgb, 0.0031308) ** (1 / 2.4) - 0.055
    linear[..., :3] = np.where(rgb <= 0.0031308, 12.92 * rgb, curve)
    return np.round(linear, 9)


def colors(path):
    document, _ = read_gltf(path)
    looks = [m["pbrMetallicRoughness"] for m in document["materials"]]
    return [srgb(look["baseColorFactor"]).tolist() for look in looks]


def gltf_volume(path):
    """Return the signed volume: positive if the triangles face outward."""
    document, data = read_gltf(path)
    primitive = document["meshes"][0]["primitives"][0]
    points = accessor(document, data, primitive["attributes"]["POSITION"]).astype(float)
    a, b, c = points[accessor(document, data, primitive["indices"]).reshape(-1, 3).T]
    return (np.cross(a, b) * c).sum() / 6.0


def obj_arrays(path):
    rows = [line.split() for line in path.read_text().splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], float)
    return points, np.array([row[1:] for row in rows if row[0] == "f"], int) - 1


def obj_volume(path):
    points, faces = obj_arrays(path)
    a, b, c = points[faces.T]
    return (np.cross(a, b) * c).sum() / 6.0


def embedded_image(path):
    """Return the only texture of a glTF file, as red, green, blue and alpha."""
    (image,) = read_gltf(path)[0]["images"]
    data = base64.b64decode(image["uri"].partition("base64,")[2])
    return Image.open(io.BytesIO(data)).convert("RGBA")
