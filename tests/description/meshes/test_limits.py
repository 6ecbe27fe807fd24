import io
import json
import os
import socket
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from arm_drake.description.meshes.reading import MAX_FILE_BYTES
from tests.description.meshes.samples import (
    BOX,
    Converter,
    binary_stl,
    dae,
    drawn_extents,
    gltf_volume,
    obj,
    ply,
    png,
)


@pytest.fixture
def converter(tmp_path):
    return Converter(tmp_path)


MANY = 4_000_000_000


def gltf_with_count(count):
    accessors = [
        {"componentType": 5126, "count": count, "type": "VEC3"},
        {"componentType": 5125, "count": 3, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
    }
    return json.dumps(document).encode()


def stl_with_count(count, header=b""):
    return header.ljust(80, b" ") + struct.pack("<I", count) + binary_stl()[84:]


# The box has 8 vertices and 12 triangles.
LIES = {
    "many.stl": (
        stl_with_count(2**32 - 1),
        "its header tells of 4294967295 triangles, it has bytes for 12",
    ),
    "solid.stl": (
        stl_with_count(2**32 - 1, b"solid"),
        "its header tells of 4294967295 triangles, it has bytes for 12",
    ),
    "one.stl": (
        stl_with_count(13),
        "its header tells of 13 triangles, it has bytes for 12",
    ),
    "short.stl": (
        binary_stl()[:-1],
        "its header tells of 12 triangles, it has bytes for 11",
    ),
    "vertices.ply": (
        ply().replace(b"vertex 8", b"vertex 4000000000"),
        "its header tells of 4000000000 vertices, 20 are there",
    ),
    "a.gltf": (gltf_with_count(MANY), "it has more than 40000000 values"),
    "a.obj": (
        obj() + b"\nf 4000000000 1 2\n",
        "index 3999999999 is out of bounds for axis 0 with size 8",
    ),
    "corner.ply": (
        ply().replace(b"\n3 0 1 3\n", b"\n3 0 -1 3\n"),
        "a triangle has a vertex that doesn't exist",
    ),
}


@pytest.mark.parametrize("name", LIES)
def test_a_lie_about_the_size_is_refused(converter, name):
    content, reason = LIES[name]
    source = converter.write(name, content)

    assert converter.collision(source) is None
    assert converter.lines == [
        f"error: link 'a', collision 0: mesh file '{source}' can't be read ({reason}); "
        "nothing collides with it"
    ]


HUGE_COUNTS = [
    ("vertices.dae", dae().replace(b'count="8"', b'count="4000000000"')),
    ("triangles.dae", dae().replace(b'count="12"', b'count="4000000000"')),
    ("stride.dae", dae().replace(b'offset="1"', b'offset="4000000000"')),
    (
        "polygon.dae",
        dae()
        .replace(b"<triangles", b"<polylist")
        .replace(b"</triangles", b"</polylist")
        .replace(b"<p>", b"<vcount>4000000000</vcount><p>"),
    ),
    (
        "list.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 4000000000\n"
        b"property list uint int vertex_indices\nend_header\n" + b"\xff" * 90,
    ),
    ("chunk.glb", struct.pack("<4s4I", b"glTF", 2, *[2**32 - 1] * 2, 0x4E4F534A)),
    ("negative.gltf", gltf_with_count(-MANY)),
]


@pytest.mark.parametrize(("name", "content"), HUGE_COUNTS)
def test_huge_counts_need_no_memory(converter, name, content):
    import resource

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    source = converter.write(name, content)

    converter.visual(source)
    converter.collision(source)

    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    # A byte for each would be 4 GB; the parsers themselves are below 0.2 GB.
    unit = 1 if sys.platform == "darwin" else 1024
    assert grown * unit < 500e6


def test_triangles_that_the_header_leaves_out_are_reported(converter):
    source = converter.write("a.stl", stl_with_count(6))

    assert converter.visual(source) is not None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}': its header tells of 6 "
        "triangles, it has bytes for 12; the rest is left out"
    ]


def test_faces_that_a_ply_header_promises_are_missed(converter):
    source = converter.write("a.ply", ply().replace(b"face 12", b"face 4000000000"))

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}': its header tells of "
        "4000000000 faces, 12 are there; the rest is missing"
    ]


def test_a_file_that_is_too_large_is_refused_unread(converter):
    source = converter.write("a.stl", b"")
    os.truncate(source, MAX_FILE_BYTES + 2**20)

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read "
        "(it has 129 MiB, at most 128 are read); it isn't drawn"
    ]


def test_a_texture_file_that_is_too_large_is_left_out(converter):
    source = converter.write("a.dae", dae(texture="skin.png"))
    skin = converter.write("skin.png", png())
    os.truncate(skin, MAX_FILE_BYTES + 2**20)

    assert converter.visual(source) is not None
    first, *_ = converter.lines
    assert first == (
        f"warning: link 'a', visual 0: mesh file '{source}': its file 'skin.png' can't "
        "be read (it has 129 MiB, at most 128 are read); drawn without it"
    )


def test_a_pipe_is_no_mesh_file(converter):
    source = converter.folder / "a.stl"
    os.mkfifo(source)

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read "
        "(it is no file); it isn't drawn"
    ]


@pytest.mark.parametrize("name", ["a.obj", "/dev/zero", "x" * 5000])
def test_a_material_file_that_is_none_costs_nothing(converter, name):
    source = converter.write("a.obj", obj(head=f"mtllib {name}"))

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("width", "height", "reason"),
    [
        # Pillow refuses the first, and warns of the second.
        (50_000, 20_000, ""),
        (10_000, 10_000, " (it has more than 67108864 pixels)"),
        (8_193, 8_192, " (it has more than 67108864 pixels)"),
    ],
)
def test_an_image_with_too_many_pixels_is_left_out(converter, width, height, reason):
    # Only the header tells of them, as in a decompression bomb.
    head = png()[16:29]
    head = struct.pack(">II", width, height) + head[8:]
    checksum = struct.pack(">I", zlib.crc32(b"IHDR" + head))
    converter.write("skin.png", png()[:16] + head + checksum + png()[33:])
    source = converter.write("a.dae", dae(texture="skin.png"))

    assert converter.visual(source) is not None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}': its texture 'skin.png' "
        f"can't be read{reason}; drawn without it"
    ]


def with_entities(declarations, use):
    head = f'<?xml version="1.0"?><!DOCTYPE COLLADA [{declarations}]>'
    body = dae(asset=f"<title>{use}</title>").partition(b"?>")[2]
    return head.encode() + body


LAUGHS = '<!ENTITY a0 "ha">' + "".join(
    f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 13)
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_an_entity_bomb_is_refused(converter, encoding):
    text = with_entities(LAUGHS, "&a12;").decode()
    text = text.replace("?>", f' encoding="{encoding}"?>', 1)
    source = converter.write("a.dae", text.encode(encoding))

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read "
        "(it declares XML entities); it isn't drawn"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["entity", "parameter entity", "type"])
def test_nothing_that_a_file_names_is_fetched(converter, kind):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.2)
        url = f"http://127.0.0.1:{server.getsockname()[1]}/x"
        text = {
            "entity": with_entities(f'<!ENTITY a SYSTEM "{url}">', "&a;"),
            "parameter entity": with_entities(f'<!ENTITY % a SYSTEM "{url}"> %a;', ""),
            "type": with_entities("", "").replace(
                b"COLLADA []", f'COLLADA SYSTEM "{url}"'.encode()
            ),
        }[kind]
        source = converter.write("a.dae", text)

        is_drawn = converter.visual(source) is not None

        assert is_drawn == (kind == "type")
        with pytest.raises(TimeoutError):
            server.accept()


def test_nodes_in_nodes_in_nodes_are_refused(converter):
    # 10^9 boxes in two kilobytes.
    nodes = '<node id="k0"><instance_geometry url="#g"/></node>'
    for i in range(1, 10):
        uses = f'<instance_node url="#k{i - 1}"/>' * 10
        nodes += f'<node id="k{i}">{uses}</node>'
    marker = b"<library_visual_scenes>"
    text = dae().replace(
        marker, f"<library_nodes>{nodes}</library_nodes>".encode() + marker
    )
    text = text.replace(b'<node id="n0">', b'<node id="n0"><instance_node url="#k9"/>')
    source = converter.write("a.dae", text)

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read "
        "(it has more than 20000 nodes); it isn't drawn"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("depth", [2_000, 200_000])
def test_deep_nodes_do_not_crash(converter, depth):
    text = dae().replace(b'<node id="n0">', b"<node>" * depth + b'<node id="n0">')
    text = text.replace(b'<node id="light">', b"</node>" * depth + b"<node>")
    source = converter.write("a.dae", text)

    assert converter.visual(source) is None
    (line,) = converter.lines
    assert "recursion" in line


def test_a_zip_archive_is_no_collada_file(converter):
    stream = io.BytesIO(dae())
    with zipfile.ZipFile(stream, "a") as archive:
        archive.writestr("a.dae", dae())
    source = converter.write("a.dae", stream.getvalue())

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read "
        "(it is a ZIP archive); it isn't drawn"
    ]


@pytest.mark.parametrize("size", [1e-30, 1e25])
def test_very_small_and_very_large_meshes_are_survived(converter, size):
    source = converter.write("a.stl", binary_stl(BOX * size))

    converter.visual(source)
    converter.collision(source)


# Its memory and time are those of a process of its own.
MILLION = """
import resource, sys, time
from pathlib import Path
from arm_drake.description.meshes.conversion import convert_collision, convert_visual
from arm_drake.description.report import LoadReport

report, source, cache = LoadReport(), Path(sys.argv[1]), Path(sys.argv[2])
start = time.perf_counter()
print(convert_visual(source, (1.0, 1.0, 1.0), report, where="a", cache_dir=cache))
print(*convert_collision(source, (1.0, 1.0, 1.0), report, where="b", cache_dir=cache))
print(time.perf_counter() - start)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
print(report)
"""


@pytest.mark.slow
def test_a_million_triangles_are_converted_in_bounded_time_and_memory(tmp_path):
    n = 708  # Points on a side: 2 (n - 1)^2 triangles.
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(*[np.linspace(0.0, 1.0, n)] * 2, indexing="ij")
    points = np.stack([x, y, rng.uniform(size=(n, n))], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)
    kind = np.dtype([("normal", "<f4", 3), ("v", "<f4", (3, 3)), ("rest", "<u2")])
    rows = np.zeros(len(triangles), kind)
    rows["v"] = triangles
    source = tmp_path / "million.stl"
    count = np.uint32(len(rows)).tobytes()
    source.write_bytes(b"\0" * 80 + count + rows.tobytes())

    done = subprocess.run(
        [sys.executable, "-c", MILLION, str(source), str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=240,
        cwd=Path(__file__).parents[2],
    )

    visual, collision, seconds, memory, line = done.stdout.splitlines()
    expected = [points.min(axis=(0, 1)), points.max(axis=(0, 1))]
    np.testing.assert_allclose(drawn_extents(Path(collision)), expected, atol=1e-6)
    assert Path(visual).stat().st_size < 50e6
    # Five seconds and 0.7 GB on a machine with nothing else to do.
    assert float(seconds) < 120.0
    assert float(memory) * (1 if sys.platform == "darwin" else 1024) < 2e9
    assert line == (
        f"info: a: mesh file '{source}': it has 999698 triangles; drawn; more than "
        "200000 make a browser slow"
    )
