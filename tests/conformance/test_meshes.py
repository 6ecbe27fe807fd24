"""Converted meshes of real robots against readers that share no code with them.

STL files are read by assimp, through coal. Assimp turns COLLADA by its up axis, which
RViz and Gazebo don't; a small reader here follows the COLLADA 1.4.1 specification.
"""

import base64
import dataclasses as dc
import io
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import coal
import numpy as np
import pytest
from PIL import Image
from scipy.spatial import ConvexHull

from arm_drake.description.meshes.conversion import (
    MESH_SUFFIXES,
    convert_collision,
    convert_visual,
)
from arm_drake.description.report import LoadReport
from tests.robots import real_robot, robots_folder

# Different factors, one of them a mirror, as robots rarely have.
SCALE = (0.5, -2.0, 3.0)

# Parts of the size: glTF holds 32-bit floats, with 24 bits; the OBJ file has 9 digits.
TOLERANCE = 2.0**-23

# A part of the diagonal of the box: what hulls lack for the sake of speed.
HULL_ERROR = 1e-3

PACKAGES = [
    "ar4",
    "create3",
    "denso_cobotta",
    "dobot_cr5",
    "doosan_a0912",
    "epick",
    "ifra_irb120",
    "interbotix_wx250s",
    "kuka_kr6_agilus",
    pytest.param("mycobot_280", marks=pytest.mark.slow),
    "open_manipulator_x",
    "pmb2",
    "robotiq_2f85",
    "so100_brukg",
    "xarm6",
]


def mesh_files(folder: Path) -> list[Path]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return sorted(path for path in files if path.suffix.lower() in MESH_SUFFIXES)


def test_no_robot_with_meshes_is_left_out():
    root = robots_folder()
    folders = {path.relative_to(root).parts[0] for path in mesh_files(root)}

    assert folders == {getattr(p, "values", (p,))[0] for p in PACKAGES}


@dc.dataclass(frozen=True)
class Triangles:
    """What one primitive element of a COLLADA file draws, once."""

    # Of all its triangles, in the units of the robot, shape (n, 3).
    points: np.ndarray

    # Diffuse, as the file has it: sRGB and alpha; None with a texture.
    color: tuple[float, ...] | None


class Collada:
    """The parts of COLLADA 1.4.1 that robots use."""

    def __init__(self, path: Path) -> None:
        self._root = ET.parse(path).getroot()  # noqa: S314
        for element in self._root.iter():
            element.tag = element.tag.rpartition("}")[2]
        self._by_id = {e.get("id"): e for e in self._root.iter() if e.get("id")}

    def triangles(self) -> Iterator[Triangles]:
        unit = self._root.find("asset/unit")
        meter = 1.0 if unit is None else float(unit.get("meter", "1"))
        scene = self._follow(self._root.find("scene/instance_visual_scene").get("url"))
        matrix = np.diag([meter, meter, meter, 1.0])
        for node in scene.findall("node"):
            yield from self._node(node, matrix)

    def _follow(self, url: str) -> ET.Element:
        return self._by_id[url.removeprefix("#")]

    def _node(self, node: ET.Element, matrix: np.ndarray) -> Iterator[Triangles]:
        for element in node:
            numbers = np.array((element.text or "").split() or [0], dtype=object)
            if element.tag == "matrix":
                matrix = matrix @ numbers.astype(float).reshape(4, 4)
            elif element.tag == "translate":
                move = np.eye(4)
                move[:3, 3] = numbers.astype(float)
                matrix = matrix @ move
            elif element.tag == "scale":
                matrix = matrix @ np.diag([*numbers.astype(float), 1.0])
            elif element.tag == "rotate":
                matrix = matrix @ rotation(*numbers.astype(float))
        for element in node:
            if element.tag == "node":
                yield from self._node(element, matrix)
            elif element.tag == "instance_node":
                yield from self._node(self._follow(element.get("url")), matrix)
            elif element.tag == "instance_geometry":
                yield from self._geometry(element, matrix)

    def _geometry(self, instance: ET.Element, matrix: np.ndarray):
        materials = {
            bound.get("symbol"): bound.get("target")
            for bound in instance.iter("instance_material")
        }
        for part in self._follow(instance.get("url")).find("mesh"):
            if part.tag not in ("triangles", "polylist", "polygons"):
                continue
            (vertices,) = (
                i for i in part.iter("input") if i.get("semantic") == "VERTEX"
            )
            stride = 1 + max(int(i.get("offset")) for i in part.iter("input"))
            indices = [int(i) for p in part.iter("p") for i in (p.text or "").split()]
            if not indices:
                continue
            used = np.array(indices)[int(vertices.get("offset")) :: stride]
            source = self._follow(vertices.get("source"))
            (position,) = (
                i for i in source.iter("input") if i.get("semantic") == "POSITION"
            )
            floats = self._follow(position.get("source")).find("float_array").text
            points = np.array(floats.split(), float).reshape(-1, 3)[np.unique(used)]
            points = points @ matrix[:3, :3].T + matrix[:3, 3]
            target = materials.get(part.get("material"))
            yield Triangles(points, None if target is None else self._color(target))

    def _color(self, url: str) -> tuple[float, ...] | None:
        effect = self._follow(self._follow(url).find("instance_effect").get("url"))
        color = effect.find("profile_COMMON/technique/*/diffuse/color")
        return None if color is None else tuple(map(float, color.text.split()))


def rotation(x: float, y: float, z: float, degrees: float) -> np.ndarray:
    """Return Rodrigues' formula as a (4, 4) matrix."""
    angle = np.deg2rad(degrees)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / np.linalg.norm([x, y, z])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k
    return matrix


def box(points: np.ndarray) -> np.ndarray:
    """Return the smallest and the largest corner of a bounding box."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def independent_points(path: Path) -> np.ndarray:
    if path.suffix.lower() == ".dae":
        return np.concatenate([t.points for t in Collada(path).triangles()])
    return coal.MeshLoader().load(str(path), np.ones(3)).vertices()


def gltf_parts(path: Path) -> list[tuple[tuple[float, ...], np.ndarray]]:
    """Return the linear colour and the points, turned z up, of all primitives."""
    document = json.loads(path.read_bytes())
    data = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    parts = []
    for primitive in document["meshes"][0]["primitives"]:
        accessor = document["accessors"][primitive["attributes"]["POSITION"]]
        start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
        x, y, z = (
            np.frombuffer(data, "<f4", 3 * accessor["count"], start).reshape(-1, 3).T
        )
        look = document["materials"][primitive["material"]]["pbrMetallicRoughness"]
        points = np.stack([x, -z, y], axis=1)
        parts.append((tuple(look["baseColorFactor"]), points))
    return parts


def gltf_box(path: Path) -> np.ndarray:
    return box(np.concatenate([points for _, points in gltf_parts(path)]))


def obj_points(path: Path) -> np.ndarray:
    rows = [line.split() for line in path.read_text().splitlines()]
    return np.array([row[1:] for row in rows if row[0] == "v"], float)


def lack(points: np.ndarray, corners: np.ndarray) -> float:
    """Return how far points stand out of the planes of a convex hull at most."""
    planes = ConvexHull(corners).equations
    outer = points[ConvexHull(points).vertices]
    parts = np.array_split(planes, len(planes) // 200 + 1)
    return max((outer @ part[:, :3].T + part[:, 3]).max() for part in parts)


@pytest.mark.parametrize("package", PACKAGES)
def test_meshes_keep_their_bounding_boxes_and_hulls(package, tmp_path):
    files = mesh_files(robots_folder() / package)
    assert files
    for path in files:
        report = LoadReport()
        place = {"where": "", "cache_dir": tmp_path}

        visual = convert_visual(path, SCALE, report, **place)
        (collision,) = convert_collision(path, SCALE, report, **place)

        points = independent_points(path) * SCALE
        expected = box(points)
        size = np.abs(expected).max()
        hull = obj_points(collision)
        for found in (gltf_box(visual), box(hull)):
            np.testing.assert_allclose(
                found, expected, rtol=0, atol=TOLERANCE * size, err_msg=path.name
            )
        # Inside the exact hull, and short of it by no more than is allowed.
        assert lack(hull, points) < TOLERANCE * size
        assert lack(points, hull) < HULL_ERROR * np.linalg.norm(np.ptp(points, axis=0))
        assert list(report) == []
        for used in tmp_path.iterdir():
            used.unlink()


def linear(srgb: float) -> float:
    """Return the closed formula of IEC 61966-2-1."""
    return srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4


# Two materials in a file, one; black in a linear part of the formula, coloured; with
# a unit and nodes of a library.
COLORED = [
    ("create3/irobot_create_description/meshes/body_visual.dae", 2),
    ("doosan_a0912/my_doosan_pkg/description/meshes/a0912_blue/A0912_2_1.dae", 2),
    ("kuka_kr6_agilus/kuka_agilus_support/meshes/kr6_r700_sixx/visual/link_1.dae", 1),
    ("mycobot_280/mycobot_description/meshes/mycobot_280/gripper_base.dae", 1),
    ("robotiq_2f85/robotiq_description/meshes/visual/2f_85/left_finger.dae", 2),
]


@pytest.mark.parametrize(
    ("name", "count"), COLORED, ids=[Path(name).stem for name, _ in COLORED]
)
def test_colours_are_those_of_the_file_each_on_its_part(name, count, tmp_path):
    path = real_robot(name)
    report = LoadReport()

    visual = convert_visual(path, (1.0, 1.0, 1.0), report, where="", cache_dir=tmp_path)

    expected = [
        [*map(linear, part.color[:3]), part.color[3], *box(part.points).ravel()]
        for part in Collada(path).triangles()
    ]
    found = [[*color, *box(points).ravel()] for color, points in gltf_parts(visual)]
    assert len({tuple(row[:4]) for row in expected}) == count
    # 32-bit floats, as above.
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_a_texture_has_the_pixels_of_the_file(tmp_path):
    folder = "mycobot_280/mycobot_description/meshes/mycobot_280"
    path = real_robot(f"{folder}/link2.dae")
    root = ET.parse(path).getroot()  # noqa: S314
    (image,) = root.iterfind(".//{*}image/{*}init_from")

    visual = convert_visual(
        path, (1.0, 1.0, 1.0), LoadReport(), where="", cache_dir=tmp_path
    )

    (embedded,) = json.loads(visual.read_bytes())["images"]
    data = base64.b64decode(embedded["uri"].partition("base64,")[2])
    with Image.open(path.parent / image.text) as there:
        expected = np.asarray(there.convert("RGBA"))
    with Image.open(io.BytesIO(data)) as here:
        np.testing.assert_array_equal(np.asarray(here.convert("RGBA")), expected)
