import io
import json
import struct

import numpy as np
import pytest
from PIL import Image

from tests.description.meshes.samples import (
    BOX,
    BOX_FACES,
    Converter,
    accessor,
    ascii_stl,
    binary_stl,
    colors,
    dae,
    drawn_extents,
    embedded_image,
    gltf_volume,
    obj,
    obj_volume,
    ply,
    png,
    read_gltf,
    srgb,
)


@pytest.fixture
def converter(tmp_path):
    return Converter(tmp_path)


def binary_ply(order="<"):
    name = {"<": "little", ">": "big"}[order]
    head = f"ply\nformat binary_{name}_endian 1.0\ncomment by hand\n"
    head += "element vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    head += "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [struct.pack(f"{order}3f3B", *corner, 255, 0, 51) for corner in BOX]
    rows += [struct.pack(f"{order}B3i", 3, *face) for face in BOX_FACES.tolist()]
    return head.encode() + b"".join(rows)


# The box turned so that it lies as it should once y has become z.
GLTF_BOX = BOX[:, [0, 2, 1]] * [1, 1, -1]


def gltf_buffer():
    return GLTF_BOX.astype("<f4").tobytes() + BOX_FACES.astype("<u2").tobytes()


def gltf(buffer, *, color=(1, 1, 1, 1)):
    """Return a glTF document of the box, its buffer given as a JSON object."""
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": 96},
        {"buffer": 0, "byteOffset": 96, "byteLength": 72},
    ]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    look = {"pbrMetallicRoughness": {"baseColorFactor": color}, "alphaMode": "BLEND"}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [primitive]}],
            "materials": [look],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": 168} | buffer],
        }
    ).encode()


def glb(**options):
    document = gltf({}, **options)
    document += b" " * (-len(document) % 4)
    chunks = struct.pack("<I4s", len(document), b"JSON") + document
    chunks += struct.pack("<I4s", 168, b"BIN\0") + gltf_buffer()
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


UPPER_CASE = {
    "A.STL": binary_stl(),
    "A.DAE": dae(),
    "A.OBJ": obj(),
    "A.PLY": ply(),
    "A.GLTF": gltf({"uri": "a.bin"}),
    "A.GLB": glb(),
    "A.Stl": ascii_stl(),
}


@pytest.mark.parametrize("name", UPPER_CASE)
def test_suffixes_are_read_in_any_letter_case(converter, name):
    converter.write("a.bin", gltf_buffer())
    source = converter.write(name, UPPER_CASE[name])

    visual, collision = converter.visual(source), converter.collision(source)

    np.testing.assert_allclose(drawn_extents(visual), BOX[[0, -1]], atol=1e-6)
    np.testing.assert_allclose(drawn_extents(collision), BOX[[0, -1]], atol=1e-6)
    assert gltf_volume(visual) == pytest.approx(6.0)
    assert obj_volume(collision) == pytest.approx(6.0)
    assert converter.lines == []


ODD_STL = {
    "upper case": ascii_stl().upper(),
    "indented": b"  " + ascii_stl().replace(b"\n", b"\r\n   "),
    "no name": ascii_stl().replace(b"solid box", b"solid"),
    "solid with facets": binary_stl(header=b"solid facet normal made by a CAD program"),
    "solid with spaces": binary_stl(header=b"solid".ljust(80)),
}


@pytest.mark.parametrize("content", ODD_STL.values(), ids=ODD_STL)
def test_stl_files_are_told_apart_by_more_than_their_first_word(converter, content):
    source = converter.write("a.stl", content)

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)
    assert converter.lines == []


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_keeps_vertex_colours(converter, order):
    source = converter.write("a.ply", binary_ply(order))

    visual = converter.visual(source)

    document, data = read_gltf(visual)
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    rgba = accessor(document, data, attributes["COLOR_0"])
    assert gltf_volume(visual) == pytest.approx(6.0)
    np.testing.assert_allclose(
        np.unique(srgb(rgba), axis=0), [[1.0, 0.0, 0.2, 1.0]], atol=1e-6
    )


def test_obj_polygons_and_indices_from_the_end_are_read(converter):
    # The same box as six quadrilaterals, counted from the last vertex.
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5)]
    sides.append((2, 6, 8, 4))
    lines = [f"v {x} {y} {z}" for x, y, z in BOX]
    lines += ["f " + " ".join(str(i - 9) for i in side) for side in sides]
    source = converter.write("a.obj", "\n".join(lines).encode())

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)


def test_an_obj_file_takes_colour_alpha_and_texture_from_its_mtl_file(converter):
    converter.write("a.mtl", b"newmtl one\nKd 0.5 0.25 1\nd 0.5\nmap_Kd skins/a.png\n")
    converter.write("skins/a.png", png((10, 20, 30)))
    text = "mtllib a.mtl\nusemtl one\nv 0 0 0\nv 1 0 0\nv 0 1 0\n"
    text += "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    source = converter.write("a.obj", text.encode())

    visual = converter.visual(source)

    assert embedded_image(visual).getpixel((0, 0)) == (10, 20, 30, 255)
    # Half a step of an 8 bit colour.
    np.testing.assert_allclose(colors(visual), [[0.5, 0.25, 1, 0.5]], atol=0.5 / 255)
    assert read_gltf(visual)[0]["materials"][0]["alphaMode"] == "BLEND"
    assert converter.lines == []


@pytest.mark.parametrize(("line", "alpha"), [("d 0.5", 0.5), ("Tr 0.25", 0.75)])
def test_an_obj_file_without_texture_takes_its_alpha_too(converter, line, alpha):
    converter.write("a.mtl", f"newmtl one\nKd 1 0 0\n{line}\n".encode())
    source = converter.write("a.obj", b"mtllib a.mtl\nusemtl one\n" + obj())

    assert colors(converter.visual(source)) == [[1.0, 0.0, 0.0, alpha]]


def test_a_texture_that_the_mtl_file_names_and_nobody_has_is_reported(converter):
    converter.write("a.mtl", b"newmtl one\nKd 1 0 0\nmap_Kd gone.png\n")
    source = converter.write("a.obj", b"mtllib a.mtl\nusemtl one\n" + obj())

    assert converter.visual(source) is not None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}': its file 'gone.png' "
        "doesn't exist; drawn without it"
    ]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", obj(head="# mtllib gone.mtl\no the mtllib gone.mtl")),
        ("a.ply", ply().replace(b"end_h", b"comment no comment TextureFile x\nend_h")),
    ],
)
def test_a_file_is_only_named_at_the_beginning_of_a_line(converter, name, text):
    source = converter.write(name, text)

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)
    assert converter.lines == []


@pytest.mark.parametrize("blanks", ["", " ", "\t "])
def test_a_named_file_that_is_missing_is_reported(converter, blanks):
    source = converter.write("a.obj", obj(head=f"# a box\n{blanks}mtllib gone.mtl"))

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}': its file 'gone.mtl' "
        "doesn't exist; drawn without it"
    ]


@pytest.mark.parametrize("kind", ["gltf", "glb"])
def test_gltf_colours_are_linear_already(converter, kind):
    converter.write("a.bin", gltf_buffer())
    color = (0.2, 0.4, 0.6, 0.5)
    content = glb(color=color) if kind == "glb" else gltf({"uri": "a.bin"}, color=color)
    source = converter.write(f"a.{kind}", content)

    (material,) = read_gltf(converter.visual(source))[0]["materials"]

    found = material["pbrMetallicRoughness"]["baseColorFactor"]
    np.testing.assert_allclose(found, color, atol=0.5 / 255)
    assert material["alphaMode"] == "BLEND"


def test_a_gltf_buffer_that_does_not_exist_is_named(converter):
    source = converter.write("a.gltf", gltf({"uri": "gone.bin"}))

    assert converter.collision(source) is None
    assert converter.lines == [
        f"error: link 'a', collision 0: mesh file '{source}' can't be read "
        "(its file 'gone.bin' doesn't exist); nothing collides with it"
    ]


def test_a_changed_gltf_buffer_is_converted_again(converter):
    source = converter.write("a.gltf", gltf({"uri": "a.bin"}))
    converter.write("a.bin", gltf_buffer())
    first = converter.collision(source)
    doubled = (2 * GLTF_BOX).astype("<f4").tobytes() + gltf_buffer()[96:]
    converter.write("a.bin", doubled)

    assert obj_volume(converter.collision(source)) == pytest.approx(48.0)
    assert obj_volume(first) == pytest.approx(6.0)


def with_library_node(text, transforms=""):
    """Return COLLADA whose scene uses the box by way of two nodes of a library."""
    before, geometry, after = text.partition(b'<instance_geometry url="#g">')
    inside, end, after = after.partition(b"</instance_geometry>")
    library = b'<library_nodes><node id="inner">' + geometry + inside + end
    library += b'</node><node id="outer">' + transforms.encode()
    library += b'<instance_node url="#inner"/></node></library_nodes>'
    marker = b"<library_visual_scenes>"
    before = before.replace(marker, library + marker)
    return before + b'<instance_node url="#outer"/>' + after


def test_collada_nodes_of_a_library_are_put_where_the_scene_uses_them(converter):
    transforms = "<translate>0 0 5</translate><scale>2 2 2</scale>"
    matrix = "1 0 0 10  0 1 0 0  0 0 1 0  0 0 0 1"
    text = with_library_node(dae(nodes=[(matrix, "1 1 1 1")]), transforms)
    source = converter.write("a.dae", text)

    np.testing.assert_allclose(
        drawn_extents(converter.visual(source)), [[10, 0, 5], [12, 4, 11]], atol=1e-5
    )


def test_collada_transforms_apply_from_the_last_to_the_first(converter):
    # The box becomes 2 x 4 x 6, turns about z so that y points to -x, then moves.
    transforms = "<translate>10 0 0</translate><rotate>0 0 1 90</rotate>"
    transforms += "<scale>2 2 2</scale>"
    text = dae().replace(b'<node id="n0">', f'<node id="n0">{transforms}'.encode())
    source = converter.write("a.dae", text)

    np.testing.assert_allclose(
        drawn_extents(converter.visual(source)), [[6, 0, 0], [10, 2, 6]], atol=1e-5
    )


def test_a_collada_unit_counts_for_transforms_too(converter):
    asset = '<unit meter="0.001" name="mm"/><up_axis>Y_UP</up_axis>'
    matrix = "1 0 0 1000  0 1 0 0  0 0 1 0  0 0 0 1"
    source = converter.write("a.dae", dae(asset=asset, nodes=[(matrix, "1 1 1 1")]))

    np.testing.assert_allclose(
        drawn_extents(converter.collision(source)),
        [[1.0, 0.0, 0.0], [1.001, 0.002, 0.003]],
        atol=1e-8,
    )


def test_two_materials_of_one_collada_geometry_stay_apart(converter):
    text = dae(nodes=[("", "1 0 0 1"), ("", "0 0 1 1")])
    # One node that binds both, each to half of the triangles.
    start, end = text.index(b'<node id="n1">'), text.index(b'<node id="light">')
    text = text[:start] + text[end:]
    bound = b'<instance_material symbol="s" target="#m0"/>'
    text = text.replace(
        bound, bound + bound.replace(b'"s"', b'"t"').replace(b"0", b"1")
    )
    halves = [
        " ".join(f"{i} {i}" for i in half.ravel()) for half in np.split(BOX_FACES, 2)
    ]
    start, end = text.index(b"<triangles"), text.index(b"</mesh>")
    inputs = text[text.index(b"<input", start) : text.index(b"<p>", start)]
    parts = b"".join(
        b'<triangles count="6" material="%s">%s<p>%s</p></triangles>'
        % (symbol, inputs, half.encode())
        for symbol, half in zip((b"s", b"t"), halves, strict=True)
    )
    source = converter.write("a.dae", text[:start] + parts + text[end:])

    visual = converter.visual(source)

    document, _ = read_gltf(visual)
    primitives = document["meshes"][0]["primitives"]
    assert colors(visual) == [[1, 0, 0, 1], [0, 0, 1, 1]]
    assert [primitive["material"] for primitive in primitives] == [0, 1]
    counts = [document["accessors"][p["indices"]]["count"] for p in primitives]
    assert counts == [18, 18]


TRANSPARENT = {
    # COLLADA 1.4.1, page 7-5: A_ONE is the default, alpha is the product.
    "a_one": ('opaque="A_ONE"', "1 1 1 1", "0.4", 0.4),
    "no mode": ("", "1 1 1 0.5", "0.5", 0.25),
    # The luminance of black is 0, which is opaque here; that of grey its value.
    "rgb_zero black": ('opaque="RGB_ZERO"', "0 0 0 1", "1", 1.0),
    "rgb_zero grey": ('opaque="RGB_ZERO"', "0.5 0.5 0.5 1", "1", 0.5),
    # Exporters that mean "not transparent at all".
    "nothing to see": ('opaque="A_ONE"', "1 1 1 1", "0", 1.0),
}


@pytest.mark.parametrize(
    ("mode", "color", "factor", "alpha"), TRANSPARENT.values(), ids=TRANSPARENT
)
def test_collada_transparency_becomes_alpha(converter, mode, color, factor, alpha):
    look = f"<transparent {mode}><color>{color}</color></transparent>"
    look += f"<transparency><float>{factor}</float></transparency></phong>"
    text = dae().replace(b"</phong>", look.encode())
    source = converter.write("a.dae", text)

    visual = converter.visual(source)

    np.testing.assert_allclose(colors(visual), [[0.8, 0.1, 0.2, alpha]], atol=1e-6)
    has_blend = "alphaMode" in read_gltf(visual)[0]["materials"][0]
    assert has_blend == (alpha < 1.0)


@pytest.mark.parametrize(
    "name", ["skins\\a%20b.png", "file://./skins/a b.png", "C:\\cad\\a b.png"]
)
def test_textures_are_found_under_the_names_that_exporters_write(converter, name):
    converter.write("skins/a b.png", png((1, 2, 3)))
    converter.write("a b.png", png((1, 2, 3)))
    source = converter.write("a.dae", dae(texture=name))

    assert embedded_image(converter.visual(source)).getpixel((0, 0)) == (1, 2, 3, 255)
    assert converter.lines == []


def test_a_jpeg_texture_stays_one(converter):
    stream = io.BytesIO()
    Image.new("RGB", (16, 16), (200, 100, 50)).save(stream, "JPEG", quality=95)
    converter.write("skin.jpg", stream.getvalue())
    source = converter.write("a.dae", dae(texture="skin.jpg"))

    image = embedded_image(converter.visual(source))

    # Twice through a JPEG.
    np.testing.assert_allclose(image.getpixel((8, 8)), (200, 100, 50, 255), atol=4)


@pytest.mark.parametrize("kind", ["polylist", "polygons"])
def test_collada_polygons_become_triangles(converter, kind):
    # The box as six quadrilaterals, each corner with its two indices.
    sides = ["0132", "4675", "0451", "2376", "0264", "1573"]
    rows = [" ".join(f"{i} {i}" for i in side) for side in sides]
    text = dae()
    start, end = text.index(b"<p>"), text.index(b"</triangles>")
    parts = "".join(f"<p>{row}</p>" for row in rows)
    if kind == "polylist":
        parts = f"<vcount>{'4 ' * 6}</vcount><p>{' '.join(rows)}</p>"
    text = text[:start] + parts.encode() + text[end:]
    text = text.replace(b"triangles", kind.encode()).replace(b'"12"', b'"6"')
    source = converter.write("a.dae", text)

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)


def test_collada_lines_are_left_out(converter):
    line = b'<lines count="1" material="s"><input semantic="VERTEX" source="#v" '
    line += b'offset="0"/><p>0 7</p></lines></mesh>'
    source = converter.write("a.dae", dae().replace(b"</mesh>", line))

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)


SKIN = b"""<library_controllers><controller id="k"><skin source="#g">
<source id="j"><Name_array id="ja" count="1">bone</Name_array><technique_common>
<accessor source="#ja" count="1" stride="1"><param name="JOINT" type="Name"/>
</accessor></technique_common></source>
<source id="b"><float_array id="ba" count="16">1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1
</float_array><technique_common><accessor source="#ba" count="1" stride="16">
<param name="T" type="float4x4"/></accessor></technique_common></source>
<source id="w"><float_array id="wa" count="1">1</float_array><technique_common>
<accessor source="#wa" count="1" stride="1"><param name="WEIGHT" type="float"/>
</accessor></technique_common></source>
<joints><input semantic="JOINT" source="#j"/>
<input semantic="INV_BIND_MATRIX" source="#b"/></joints>
<vertex_weights count="8"><input semantic="JOINT" source="#j" offset="0"/>
<input semantic="WEIGHT" source="#w" offset="1"/><vcount>1 1 1 1 1 1 1 1</vcount>
<v>0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0</v></vertex_weights></skin></controller>
</library_controllers><library_visual_scenes>"""


def test_collada_skins_are_reported(converter):
    text = dae().replace(b"<library_visual_scenes>", SKIN)
    skinned = b'<node id="skin"><instance_controller url="#k"/></node>'
    text = text.replace(b'<node id="light">', skinned + b'<node id="light">')
    source = converter.write("a.dae", text)

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}': its skinned geometry "
        "isn't supported; left out"
    ]


def test_collada_without_a_bound_material_keeps_its_vertex_colours(converter):
    values = " ".join(["0.2 0.4 0.6"] * 8)
    source = f"""<source id="c"><float_array id="ca" count="24">{values}</float_array>
<technique_common><accessor source="#ca" count="8" stride="3">
<param name="R" type="float"/><param name="G" type="float"/>
<param name="B" type="float"/></accessor></technique_common></source><vertices """
    text = dae().replace(b"<vertices ", source.encode())
    text = text.replace(b'"TEXCOORD" source="#u"', b'"COLOR" source="#c"')
    text = text.replace(b'symbol="s"', b'symbol="other"')

    visual = converter.visual(converter.write("a.dae", text))

    document, data = read_gltf(visual)
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    rgba = srgb(accessor(document, data, attributes["COLOR_0"]))
    np.testing.assert_allclose(np.unique(rgba, axis=0), [[0.2, 0.4, 0.6, 1]], atol=1e-6)


BROKEN = {
    "no scene": (
        b'<scene><instance_visual_scene url="#vs"/></scene>', b"", "it has no <scene>"
    ),
    "no geometry": (
        b'instance_geometry url="#g"', b'instance_geometry url="#gone"',
        "DaeBrokenRefError: Geometry #gone not found in library",
    ),
    "unit 0": (b"<asset>", b'<asset><unit meter="0"/>', "its <unit> is 0.0 m"),
    "an index too large": (
        b"<p>0 0", b"<p>8 0",
        "DaeMalformedError: Indexes (maxindex=8) for source 'p' (len=8) go beyond the "
        "limits of the source",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "reason"), BROKEN.values(), ids=BROKEN)
def test_collada_that_cannot_be_read_is_a_warning_and_no_geometry(
    converter, old, new, reason
):
    assert old in dae()
    source = converter.write("a.dae", dae().replace(old, new))

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read ({reason}); "
        "it isn't drawn"
    ]


def test_a_broken_part_of_a_collada_file_is_reported_and_the_rest_drawn(converter):
    text = dae(nodes=[("", "1 0 0 1"), ("", "0 1 0 1")])
    before, _, after = text.rpartition(b'url="#g"')
    source = converter.write("a.dae", before + b'url="#gone"' + after)

    for _ in range(2):  # From the cache, too.
        converter.report = type(converter.report)()
        assert colors(converter.visual(source)) == [[1, 0, 0, 1]]
        assert converter.lines == [
            f"warning: link 'a', visual 0: mesh file '{source}': a part of it can't be "
            "read (DaeBrokenRefError: Geometry #gone not found in library); left out"
        ]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b'target="#m1"', b'target="#gone"', "Material #gone not found"),
        (b'url="#e1"', b'url="#gone"', "Effect not found: #gone"),
        (
            b'<technique sid="c"><phong><diffuse><color>0 1 0 1',
            b'<newparam sid="t"><sampler2D><source>gone</source></sampler2D></newparam>'
            b'<technique sid="c"><phong><diffuse><color>0 1 0 1',
            "Missing surface gone",
        ),
    ],
)
def test_what_has_a_broken_collada_material_is_drawn_without(
    converter, old, new, reason
):
    text = dae(nodes=[("", "1 0 0 1"), ("1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1", "0 1 0 1")])
    assert old in text
    source = converter.write("a.dae", text.replace(old, new))

    visual = converter.visual(source)

    assert drawn_extents(visual)[1, 0] > 4.0  # The second one is 5 m away.
    assert [1, 0, 0, 1] in colors(visual)
    (line,) = converter.lines
    assert f"can't be read (DaeBrokenRefError: {reason}" in line
    assert line.endswith("drawn without them")
