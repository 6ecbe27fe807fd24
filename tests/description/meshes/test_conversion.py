import base64
import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pydrake.geometry import Convex

import arm_drake.description.meshes.conversion as mut
from arm_drake.description.meshes import conversion as mesh_cache
from arm_drake.description.report import LoadReport
from arm_drake.errors import OutputError
from tests.description.meshes.samples import (
    BOX,
    BOX_FACES,
    ONE,
    Converter,
    accessor,
    ascii_stl,
    binary_stl,
    colors,
    dae,
    drawn_extents,
    gltf_volume,
    obj,
    obj_arrays,
    obj_volume,
    ply,
    png,
    read_gltf,
    srgb,
)
from tests.robots import real_robot

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def converter(tmp_path):
    return Converter(tmp_path)


FORMATS = {
    "box.stl": binary_stl(),
    "BOX.STL": binary_stl(),
    "solid.stl": binary_stl(header=b"solid made by an exporter that lies"),
    "trailing.stl": binary_stl(trailing=b"made by an exporter that adds"),
    "ascii.stl": ascii_stl(),
    "box.obj": obj(),
    "box.ply": ply(),
    "box.Dae": dae(),
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_drawn_and_collides_with_its_extents(converter, name):
    source = converter.write(name, FORMATS[name])

    visual = converter.visual(source, (0.1, 0.2, 0.3))
    collision = converter.collision(source, (0.1, 0.2, 0.3))

    expected = [[0.0, 0.0, 0.0], [0.1, 0.4, 0.9]]
    assert visual.suffix == ".gltf"
    assert visual.is_absolute()
    np.testing.assert_allclose(drawn_extents(visual), expected, atol=1e-6)
    np.testing.assert_allclose(drawn_extents(collision), expected, atol=1e-6)
    assert gltf_volume(visual) == pytest.approx(0.036)
    assert obj_volume(collision) == pytest.approx(0.036)
    assert converter.lines == []


@pytest.mark.parametrize("suffix", ["gltf", "glb"])
def test_gltf_is_read_y_up_as_drake_and_rviz_read_it(converter, suffix):
    import trimesh

    box = trimesh.Trimesh(BOX, BOX_FACES, process=False)
    source = converter.folder / f"box.{suffix}"
    if suffix == "glb":
        source.write_bytes(box.export(file_type="glb"))
    else:
        for name, content in box.export(file_type="gltf").items():
            converter.write("box.gltf" if name == "model.gltf" else name, content)

    visual = converter.visual(source)

    np.testing.assert_allclose(
        drawn_extents(visual), [[0, -3, 0], [1, 0, 2]], atol=1e-6
    )
    assert gltf_volume(visual) == pytest.approx(6.0)


def test_collada_unit_counts_and_up_axis_does_not(converter):
    asset = '<unit meter="0.001" name="mm"/><up_axis>Y_UP</up_axis>'
    source = converter.write("box.dae", dae(asset=asset))

    visual = converter.visual(source, (10.0, 10.0, 10.0))

    np.testing.assert_allclose(
        drawn_extents(visual), [[0, 0, 0], [0.01, 0.02, 0.03]], atol=1e-8
    )


def test_collada_node_transforms_are_flattened(converter):
    # Turned by 90° about z, doubled and moved by 10 along x.
    matrix = "0 -2 0 10  2 0 0 0  0 0 2 0  0 0 0 1"
    source = converter.write("box.dae", dae(nodes=[(matrix, "1 1 1 1")]))

    visual = converter.visual(source)

    expected = [[6.0, 0.0, 0.0], [10.0, 2.0, 6.0]]
    np.testing.assert_allclose(drawn_extents(visual), expected, atol=1e-5)


def test_a_mirrored_node_still_faces_outward(converter):
    matrix = "-1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"
    source = converter.write("box.dae", dae(nodes=[(matrix, "1 1 1 1")]))

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)


def test_collada_colours_are_kept_matte_and_lights_dropped(converter):
    moved = "1 0 0 5  0 1 0 0  0 0 1 0  0 0 0 1"
    nodes = [("", "0.8 0.1 0.2 1"), (moved, "0 0.4 1 1")]
    source = converter.write("two.dae", dae(nodes=nodes))

    visual = converter.visual(source, color=(0.0, 1.0, 0.0, 1.0))

    document, _ = read_gltf(visual)
    looks = [m["pbrMetallicRoughness"] for m in document["materials"]]
    # Half a step of an 8 bit colour.
    np.testing.assert_allclose(
        colors(visual), [[0.8, 0.1, 0.2, 1], [0, 0.4, 1, 1]], atol=0.5 / 255
    )
    assert [(k["metallicFactor"], k["roughnessFactor"]) for k in looks] == [
        (0, 0.8)
    ] * 2
    assert set(document) & {"cameras", "extensions"} == set()


@pytest.mark.parametrize("place", ["skin.png", "../materials/textures/skin.png"])
def test_textures_are_found_and_embedded(converter, place):
    source = converter.write("meshes/box.dae", dae(texture="skin.png"))
    (source.parent / place).parent.mkdir(parents=True, exist_ok=True)
    (source.parent / place).write_bytes(png())

    visual = converter.visual(source)

    document, data = read_gltf(visual)
    image = base64.b64decode(document["images"][0]["uri"].partition("base64,")[2])
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    uv = accessor(document, data, attributes["TEXCOORD_0"])
    assert Image.open(io.BytesIO(image)).convert("RGB").getpixel((0, 0)) == (255, 0, 0)
    # COLLADA counts v from below, glTF from above.
    np.testing.assert_allclose(np.unique(uv, axis=0), [[0.0, 0.75]])
    assert converter.lines == []


def test_a_changed_texture_is_converted_again(converter):
    source = converter.write("box.dae", dae(texture="skin.png"))
    converter.write("skin.png", png((255, 0, 0)))
    first = converter.visual(source)
    converter.write("skin.png", png((0, 255, 0)))

    assert converter.visual(source) != first


@pytest.mark.parametrize(
    ("name", "content", "lost"),
    [
        ("a.dae", dae(texture="skin.png"), "skin.png"),
        ("a.obj", obj(head="mtllib a.mtl"), "a.mtl"),
    ],
)
def test_a_missing_texture_is_reported_at_every_load(converter, name, content, lost):
    source = converter.write(name, content)
    line = (
        f"warning: a.urdf: link 'a', visual 0: mesh file '{source}': its file {lost!r} "
        "doesn't exist; drawn without it"
    )

    for _ in range(2):
        converter.report = LoadReport()
        assert converter.visual(source, file=Path("a.urdf")) is not None
        assert converter.lines == [line]
        assert [entry.kind for entry in converter.report] == ["missing"]


def test_a_damaged_texture_is_reported_at_every_load(converter):
    source = converter.write("box.dae", dae(texture="skin.png"))
    converter.write("skin.png", png()[:40])

    for _ in range(2):
        converter.report = LoadReport()
        assert converter.visual(source) is not None
        assert converter.lines == [
            f"warning: link 'a', visual 0: mesh file '{source}': its texture "
            "'skin.png' can't be read; drawn without it"
        ]


def test_obj_materials_are_kept(converter):
    converter.write("a.mtl", b"newmtl red\nKd 1 0 0\n")
    text = obj().replace(b"f 1 2 4", b"usemtl red\nf 1 2 4", 1)
    source = converter.write("a.obj", b"mtllib a.mtl\n" + text)

    assert colors(converter.visual(source)) == [[1.0, 0.0, 0.0, 1.0]]


def test_ply_vertex_colours_are_kept(converter):
    source = converter.write("a.ply", ply(color="255 0 51"))

    document, data = read_gltf(converter.visual(source))

    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    rgba = accessor(document, data, attributes["COLOR_0"])
    np.testing.assert_allclose(
        np.unique(srgb(rgba), axis=0), [[1.0, 0.0, 0.2, 1.0]], atol=1e-6
    )


def test_a_mesh_without_colour_is_grey_or_what_the_caller_says(converter):
    source = converter.write("box.stl", binary_stl())

    assert colors(converter.visual(source)) == [[0.7, 0.7, 0.7, 1.0]]
    blue = converter.visual(source, color=(0.0, 0.0, 1.0, 0.5))
    assert colors(blue) == [[0.0, 0.0, 1.0, 0.5]]
    assert read_gltf(blue)[0]["materials"][0]["alphaMode"] == "BLEND"


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -1, 1), (-1, -1, -1), (-1, -1, 1)])
def test_negative_scales_mirror_and_keep_the_triangles_outward(converter, scale):
    source = converter.write("box.stl", binary_stl())

    visual, collision = (
        converter.visual(source, scale),
        converter.collision(source, scale),
    )

    corners = np.sort([np.zeros(3), np.array([1, 2, 3]) * scale], axis=0)
    np.testing.assert_allclose(drawn_extents(visual), corners, atol=1e-6)
    np.testing.assert_allclose(drawn_extents(collision), corners, atol=1e-6)
    assert gltf_volume(visual) == pytest.approx(6.0)
    assert obj_volume(collision) == pytest.approx(6.0)


def test_normals_of_the_file_follow_scale_and_mirroring(converter):
    # One triangle in the plane x + y = 1: its normal leans when x is stretched.
    text = "v 1 0 0\nv 0 1 0\nv 0 0 1\n" + "vn 1 1 1\n" * 3 + "f 1//1 2//2 3//3\n"
    source = converter.write("a.obj", text.encode())

    document, data = read_gltf(converter.visual(source, (-2.0, 1.0, 1.0)))

    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    normals = accessor(document, data, attributes["NORMAL"])
    # Plane -x/2 + y + z = 1, in glTF's axes x, z, -y.
    expected = np.array([-0.5, 1.0, -1.0]) / 1.5
    np.testing.assert_allclose(normals, [expected] * 3, atol=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-1])
def test_hulls_are_closed_and_agree_with_drakes_own(converter, noise):
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    points = grid + rng.uniform(-noise, noise, grid.shape)
    faces = rng.permutation(len(points)).reshape(-1, 3)
    source = converter.write("cloud.obj", obj(points, faces))

    path = converter.collision(source)

    vertices, hull = obj_arrays(path)
    edges = hull[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    assert sorted(edges) == sorted([b, a] for a, b in edges)
    assert len(vertices) - len(hull) // 2 == 2  # Euler's formula, edges counted twice.
    complete = Convex(str(source)).GetConvexHull()
    ours = Convex(str(path)).GetConvexHull()
    size = np.sqrt(3.0)
    corners = np.array([complete.vertex(i) for i in range(complete.num_vertices())])
    for i in range(ours.num_faces()):
        normal = ours.face_normal(i)
        origin = ours.vertex(ours.element(i).vertex(0))
        # The tolerance of the hull, and Drake's own.
        assert ((corners - origin) @ normal).max() < 3e-5 * size


@pytest.mark.parametrize("height", [0.0, 1e-9])
def test_a_flat_collision_mesh_gets_a_thickness(converter, height):
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1 + height], [0, 1, 1]], float)
    source = converter.write(
        "a.stl", binary_stl(square, np.array([[0, 1, 2], [0, 2, 3]]))
    )

    path = converter.collision(source)

    extents = drawn_extents(path)
    np.testing.assert_allclose(extents[1] - extents[0], [1, 1, 1e-4], atol=1e-6)
    assert converter.lines == [
        f"info: link 'a', collision 0: mesh file '{source}': the mesh is flat; "
        "its hull is 0.1 mm thick or more"
    ]
    assert converter.visual(source) is not None


def test_degenerate_and_broken_triangles_are_left_out(converter):
    points = np.vstack([BOX, [[np.nan, 0.0, 0.0], [50.0, 50.0, 50.0]]])
    faces = np.vstack([BOX_FACES, [[0, 0, 1], [8, 1, 2], [9, 9, 9]]])
    source = converter.write("a.stl", binary_stl(points, faces))

    visual, collision = converter.visual(source), converter.collision(source)

    for path in (visual, collision):
        np.testing.assert_allclose(drawn_extents(path), BOX[[0, -1]], atol=1e-6)
    assert read_gltf(visual)[0]["accessors"][-1]["count"] == 36
    assert converter.lines == []


LINE = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2]], float)
EMPTY = {
    "none.stl": binary_stl(BOX, BOX_FACES[:0]),
    "line.stl": binary_stl(LINE, np.array([[0, 1, 2]])),
    "point.stl": binary_stl(LINE, np.array([[0, 0, 0]])),
    "none.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "none.dae": dae(nodes=[]),
    "none.ply": ply(BOX, BOX_FACES[:0]),
}


@pytest.mark.parametrize("name", EMPTY)
def test_a_mesh_without_triangles_is_reported(converter, name):
    source = converter.write(name, EMPTY[name])

    assert converter.visual(source) is None
    assert converter.collision(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' holds no triangles; "
        "it isn't drawn",
        f"error: link 'a', collision 0: mesh file '{source}' holds no triangles; "
        "nothing collides with it",
    ]


def test_a_missing_file_is_reported(converter):
    source = converter.folder / "no.stl"

    assert converter.visual(source, file=Path("a.urdf")) is None
    assert converter.collision(source, file=Path("a.urdf")) is None
    assert converter.lines == [
        f"warning: a.urdf: link 'a', visual 0: mesh file '{source}' doesn't exist; "
        "it isn't drawn",
        f"error: a.urdf: link 'a', collision 0: mesh file '{source}' doesn't exist; "
        "nothing collides with it",
    ]
    assert [entry.kind for entry in converter.report] == ["missing", "missing"]


def test_missing_files_of_a_missing_folder_are_one_line(converter):
    folder = converter.folder / "none"

    for name in ("a.stl", "b.stl"):
        assert converter.collision(folder / name) is None

    (line,) = converter.report.grouped()
    assert str(line) == (
        f"error: link 'a', collision 0: mesh files are to lie in '{folder}', "
        "a folder that doesn't exist; nothing collides with it"
    )


BAD_FILES = [
    ("a.stl", b"version https://git-lfs.github.com/spec/v1\n",
     "can't be read (a Git LFS pointer, fetch it with `git lfs pull`)"),
    ("a.stl", b"", "is empty"),
    ("a.step", b"ISO-10303-21;",
     "has an unknown type '.step', known: .dae, .glb, .gltf, .obj, .ply, .stl"),
    ("a.dae", b"<COLLADA>", "can't be read (DaeMalformedError: XML Parsing Error: "
     "no element found: line 1, column 9)"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "problem"), BAD_FILES)
def test_a_bad_file_is_reported_with_the_reason(converter, name, content, problem):
    source = converter.write(name, content)

    assert converter.collision(source) is None
    assert converter.lines == [
        f"error: link 'a', collision 0: mesh file '{source}' {problem}; "
        "nothing collides with it"
    ]


def test_a_folder_is_not_a_mesh_file(converter):
    source = converter.folder / "a.stl"
    source.mkdir()

    assert converter.visual(source) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' can't be read "
        "(it is no file); it isn't drawn"
    ]


@pytest.mark.parametrize("scale", [(0.0, 1.0, 1.0), (1.0, float("nan"), 1.0)])
def test_an_impossible_scale_is_reported(converter, scale):
    source = converter.write("box.stl", binary_stl())

    assert converter.visual(source, scale) is None
    assert converter.lines == [
        f"warning: link 'a', visual 0: mesh file '{source}' has the scale {scale}, "
        "which has to be finite, not 0; it isn't drawn"
    ]


@pytest.mark.parametrize("suffix", mut.MESH_SUFFIXES)
@pytest.mark.parametrize(
    "content", [b"", b"garbage", bytes(range(256)) * 9, b"\0" * 200]
)
def test_garbage_never_raises(converter, suffix, content):
    source = converter.write(f"a{suffix}", content)

    assert converter.visual(source) is None
    assert converter.collision(source) is None
    assert {entry.kind for entry in converter.report} == {"invalid"}
    wheres = {entry.where for entry in converter.report}
    assert wheres == {"link 'a', visual 0", "link 'a', collision 0"}


@pytest.mark.parametrize("name", FORMATS)
def test_truncated_files_never_raise(converter, name):
    content = FORMATS[name]
    for i in range(1, 12):
        source = converter.write(name, content[: len(content) * i // 12])
        converter.visual(source)
        converter.collision(source)


@pytest.mark.slow
def test_a_second_call_needs_no_parser(converter):
    source = converter.write("box.dae", dae())
    first = converter.visual(source)
    code = f"""
import sys
from pathlib import Path
from arm_drake.description.meshes.conversion import convert_visual
from arm_drake.description.report import LoadReport
from tests.robots import real_robot

path = convert_visual(Path({str(source)!r}), (1.0, 1.0, 1.0), LoadReport(), where="",
                      cache_dir=Path({str(converter.cache)!r}))
print(path, *(name in sys.modules for name in ("trimesh", "collada", "pydrake")))
"""
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=REPOSITORY,
    )

    assert result.stdout == f"{first} False False False\n"


def test_the_same_input_gives_the_same_bytes(converter):
    source = converter.write("box.dae", dae(texture="skin.png"))
    converter.write("skin.png", png())
    paths = [converter.visual(source), converter.collision(source)]

    other = converter.folder / "other"
    again = [
        converter.visual(source, cache_dir=other),
        converter.collision(source, cache_dir=other),
    ]

    assert [p.name for p in again] == [p.name for p in paths]
    assert [p.read_bytes() for p in again] == [p.read_bytes() for p in paths]


def test_scale_colour_role_and_version_have_files_of_their_own(converter, monkeypatch):
    source = converter.write("box.stl", binary_stl())
    paths = {converter.visual(source), converter.collision(source)}
    paths.add(converter.visual(source, (1.0, 1.0, 2.0)))
    paths.add(converter.visual(source, color=(1.0, 0.0, 0.0, 1.0)))
    monkeypatch.setattr(mut, "CONVERTER_VERSION", mut.CONVERTER_VERSION + 1)
    paths.add(converter.visual(source))

    assert len(paths) == 5
    # Each has a record beside it, and no unfinished file is left.
    assert len(list(converter.cache.iterdir())) == 10


@pytest.mark.parametrize("damage", [b"", b"half", None])
@pytest.mark.parametrize("what", ["mesh", "record"])
def test_a_damaged_cache_is_rewritten(converter, damage, what):
    source = converter.write("box.stl", binary_stl())
    path = converter.visual(source)
    content = path.read_bytes()
    damaged = path
    if what == "record":
        damaged = path.with_name(path.name.partition("_")[0] + ".json")
    if damage is None:
        damaged.unlink()
    else:
        damaged.write_bytes(damage)

    assert converter.visual(source) == path
    assert path.read_bytes() == content


def test_a_cache_that_cannot_be_written_is_replaced_for_this_process(converter):
    source = converter.write("box.stl", binary_stl())
    cache = converter.write("cache", b"a file, no folder")

    path = converter.visual(source)

    np.testing.assert_allclose(drawn_extents(path), BOX[[0, -1]], atol=1e-6)
    assert mesh_cache._temporary_directory() in path.parents
    assert converter.lines == [
        f"info: the mesh cache '{cache}' can't be written (File exists); "
        "converted meshes last as long as this process"
    ]
    assert converter.visual(source) == path
    # A usable cache of the same process is used all the same.
    assert converter.visual(source, cache_dir=cache.parent).parent == cache.parent


def test_nowhere_to_write_is_an_error(converter, monkeypatch):
    source = converter.write("box.stl", binary_stl())
    cache = converter.write("cache", b"a file, no folder")
    monkeypatch.setattr(mesh_cache, "_substitute", lambda folder: cache)

    with pytest.raises(OutputError) as caught:
        converter.visual(source)

    assert str(caught.value) == (
        f"{cache}: no converted mesh can be written (File exists)"
    )


def test_the_environment_moves_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path))
    source = tmp_path / "box.stl"
    source.write_bytes(binary_stl())

    (path,) = mut.convert_collision(source, ONE, LoadReport(), where="")

    assert path.parent == mut.cache_directory() == tmp_path / "meshes"


def test_the_default_cache_is_the_users(monkeypatch, tmp_path):
    monkeypatch.delenv("ARM_DRAKE_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    assert mut.cache_directory().parts[-2:] == ("arm_drake", "meshes")


@pytest.mark.skipif(sys.platform != "linux", reason="XDG's rule is Linux's")
@pytest.mark.parametrize("named", ["/var/elsewhere", "relative", "~/mine", " ", ""])
def test_a_relative_cache_of_the_user_does_not_count(monkeypatch, named):
    monkeypatch.delenv("ARM_DRAKE_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", named)
    monkeypatch.setenv("HOME", "/home/me")

    own = "/var/elsewhere" if named == "/var/elsewhere" else "/home/me/.cache"
    assert mut.cache_directory() == Path(own, "arm_drake", "meshes")


def test_clearing_removes_only_what_the_cache_wrote(converter):
    source = converter.write("box.stl", binary_stl())
    converter.visual(source)
    converter.collision(source)
    other = converter.write("cache/notes.gltf", b"somebody's own")

    assert mut.clear_cache(converter.cache) == 4
    assert list(converter.cache.iterdir()) == [other]
    assert mut.clear_cache(converter.folder / "no such folder") == 0


# The table "Meshes" of the Doosan A0912, in millimetres: smallest and largest corner.
A0912 = {
    "0_0": ((-90.99, -110.5, -1.913e-05), (90.99, 90.99, 114)),
    "1_0": ((-77.93, 83.5, -77.93), (77.92, 99.5, 77.93)),
    "1_1": ((-80.4, -79.5, -80), (80.4, 83.5, 137.5)),
    "1_2": ((-62.93, -69.6, 88.6), (62.92, 45.55, 134.8)),
    "2_0": ((-79.5, -80.4, 61.5), (83.5, 80.4, 279)),
    "2_1": ((83.5, -77.98, 63.51), (496, 77.98, 219.5)),
    "2_2": ((496, -61.09, 80.5), (620.7, 61.09, 250.9)),
    "3_0": ((-58.69, -58.68, 64.01), (58.67, 58.68, 79.5)),
    "3_1": ((-57.76, -57.78, -49.97), (57.76, 98.38, 64)),
    "4_0": ((-45.24, -45.2, -457.3), (45.24, 167.3, -51.1)),
    "4_1": ((-50.41, 64.03, -51), (50.41, 219.1, 50.26)),
    "5_0": ((-44.99, -44.99, 51.14), (44.99, 44.99, 63.04)),
    "5_1": ((-50.4, -58, -50.23), (50.4, 97.85, 51.03)),
    "6_0": ((-43.28, -43.24, -65), (43.27, 43.31, 0)),
}
GREY, DARK, LIGHT = (0.65,) * 3, (0.138, 0.188, 0.238), (0.8,) * 3
A0912_COLORS = {
    "0_0": [(0.4,) * 3], "1_0": [GREY], "1_1": [DARK], "1_2": [GREY], "2_0": [DARK],
    "2_1": [DARK, LIGHT], "2_2": [DARK], "3_0": [GREY], "3_1": [DARK], "4_0": [DARK],
    "4_1": [DARK], "5_0": [GREY], "5_1": [DARK], "6_0": [GREY],
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("part", A0912)
def test_the_doosan_arm_has_its_extents_and_colours(converter, part):
    meshes = "doosan_a0912/my_doosan_pkg/description/meshes/a0912_blue"
    source = real_robot(f"{meshes}/A0912_{part}.dae")

    visual = converter.visual(source, (0.001,) * 3)
    collision = converter.collision(source, (0.001,) * 3)

    # The table has four digits; the hull may be 1e-5 of its size smaller.
    expected = np.array(A0912[part]) * 0.001
    np.testing.assert_allclose(drawn_extents(visual), expected, atol=6e-5)
    np.testing.assert_allclose(drawn_extents(collision), expected, atol=6e-5)
    opaque = [(*rgb, 1.0) for rgb in A0912_COLORS[part]]
    np.testing.assert_allclose(colors(visual), opaque, atol=0.5 / 255)
    assert converter.lines == []
