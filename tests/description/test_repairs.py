"""Repairs of descriptions that Drake refuses, each with one line of the report."""

import os
import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np
import pytest
from PIL import Image
from pydrake.geometry import SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.errors import DescriptionError
from tests.description.patience import within
from tests.description.reading import read_and_write


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def repair(tmp_path):
    """Return a function: URDF body -> repaired root and lines of the report."""
    file = tmp_path / "arm.urdf"

    def repair_text(body: str) -> tuple[ET.Element, list[str]]:
        root, report = read_and_write(body, file)
        return root, [str(entry).replace(f"{file}: ", "") for entry in report]

    return repair_text


def hinge(body: str = "", *, parent="a", child="b", type="revolute") -> str:
    return (
        f'<joint name="{child}_joint" type="{type}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{body}</joint>'
    )


AB = '<link name="a"/><link name="b"/>'


def limits(root: ET.Element) -> dict[str, float]:
    return {name: float(end) for name, end in root.find("joint/limit").attrib.items()}


def visual(shape: str, more: str = "", *, tag="visual") -> str:
    return f'<link name="a"><{tag}><geometry>{shape}</geometry>{more}</{tag}></link>'


def colors(root: ET.Element) -> list[list[float]]:
    found = [
        color.get("rgba", "").split() for color in root.iterfind(".//visual//color")
    ]
    return [[float(number) for number in numbers] for numbers in found]


def write_tetrahedron(path: Path) -> Path:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    rows = [struct.pack("<12fH", 0, 0, 0, *corners[list(f)].ravel(), 0) for f in faces]
    path.write_bytes(bytes(80) + struct.pack("<I", 4) + b"".join(rows))
    return path


def test_tags_of_others_are_removed_and_transmissions_reported(repair):
    root, lines = repair(
        '<link name="a"/><transmission name="t"/><transmission name="t"/>'
        "<ros2_control/><gazebo/>"
    )

    assert [element.tag for element in root] == ["link"]
    assert lines == [
        "info: <transmission>, 2 times; actuators come from <ros2_control>"
    ]


@pytest.mark.parametrize("unset", ["0", "0.0", "inf"])
def test_an_unset_effort_or_speed_limit_is_removed(repair, unset):
    limit = f'<limit lower="-1" upper="1" effort="{unset}" velocity="{unset}"/>'

    root, _ = repair(f"{AB}{hinge(limit)}")

    assert limits(root) == {"lower": -1.0, "upper": 1.0}


def test_limits_of_a_fixed_joint_are_no_news(repair):
    limit = '<limit lower="0" upper="0" effort="0" velocity="0"/>'

    root, lines = repair(f"{AB}{hinge(limit, type='fixed')}")

    assert root.find("joint/limit") is None
    assert lines == []


def test_other_limits_stay(repair):
    limit = '<limit lower="-1" upper="1" effort="2" velocity="3"/>'

    root, _ = repair(f"{AB}{hinge(limit)}")

    expected = {"lower": -1.0, "upper": 1.0, "effort": 2.0, "velocity": 3.0}
    assert limits(root) == expected


def test_a_continuous_joint_loses_its_range(repair):
    limit = '<limit lower="-1" upper="1" effort="2" velocity="3"/>'

    root, _ = repair(f"{AB}{hinge(limit, type='continuous')}")

    assert limits(root) == {"effort": 2.0, "velocity": 3.0}


def test_friction_calibration_and_safety_are_removed_and_damping_stays(repair):
    root, _ = repair(
        AB
        + hinge(
            '<dynamics damping="1" friction="2"/><calibration/><safety_controller/>'
        )
    )

    joint = root.find("joint")
    assert joint.find("dynamics").attrib == {"damping": "1.0"}
    assert joint.find("calibration") is None
    assert joint.find("safety_controller") is None


def test_a_colour_defined_elsewhere_is_spelled_out(repair):
    root, lines = repair(
        '<material name="red"><color rgba="1 0 0 1"/></material>'
        + visual('<sphere radius="1"/>', '<material name="red"/>')
    )

    assert colors(root) == [[1.0, 0.0, 0.0, 1.0]]
    assert lines == []


def test_two_colours_under_one_name_are_each_drawn_and_drake_takes_them(repair):
    ball = '<visual><geometry><sphere radius="1"/></geometry>{}</visual>'
    red = '<material name="m"><color rgba="1 0 0 1"/></material>'
    blue = '<material name="m"><color rgba="0 0 1 1"/></material>'

    root, _ = repair(f'<link name="a">{ball.format(red)}{ball.format(blue)}</link>')

    assert colors(root) == [[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]]
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    Parser(plant).AddModelsFromString(ET.tostring(root, encoding="unicode"), "urdf")


NO_COLOR = "has no colour of 4 numbers from 0 to 1"


@pytest.mark.parametrize(
    ("definition", "problem"),
    [
        ("", "is defined nowhere"),
        ('<material name="m"/>', NO_COLOR),
        ('<material name="m"><color rgba="1 0 0"/></material>', NO_COLOR),
        ('<material name="m"><color rgba="1 0 0 nan"/></material>', NO_COLOR),
        ('<material name="m"><color rgba="255 0 0 1"/></material>', NO_COLOR),
    ],
)
def test_a_material_without_a_colour_is_removed_and_reported(
    repair, definition, problem
):
    root, lines = repair(
        definition + visual('<sphere radius="1"/>', '<material name="m"/>')
    )

    assert root.find(".//material") is None
    assert lines == [f"warning: material 'm' {problem}; the default colour is used"]


def test_a_visuals_own_colour_that_is_none_is_removed(repair):
    root, lines = repair(
        visual('<sphere radius="1"/>', '<material><color rgba="1 0 0"/></material>')
    )

    assert root.find(".//material") is None
    assert len(lines) == 1


@pytest.mark.slow
def test_a_texture_is_removed_and_reported_once(repair):
    texture = '<texture filename="package://nope/a.png"/>'
    root, lines = repair(
        f'<material name="m">{texture}</material>'
        + visual('<sphere radius="1"/>', '<material name="m"/>')
    )

    assert root.find(".//texture") is None
    assert root.find(".//material") is None
    assert lines == [
        "warning: material 'm': the texture 'package://nope/a.png' doesn't exist; "
        "drawn without it, unless its mesh has one of its own"
    ]


def test_a_texture_becomes_its_mean_colour(repair, tmp_path):
    image = Image.new("RGB", (4, 2), (255, 0, 0))
    image.paste((0, 51, 0), (0, 0, 2, 2))
    image.save(tmp_path / "a.png")

    root, lines = repair(
        visual(
            '<sphere radius="1"/>',
            '<material name="m"><texture filename="a.png"/></material>',
        )
    )

    # Half of it is (1, 0, 0), half (0, 0.2, 0); in steps of 1/255.
    text = root.find(".//material/color").get("rgba")
    assert [float(x) for x in text.split()] == pytest.approx([0.5, 0.1, 0, 1], abs=3e-3)
    assert lines == [
        "warning: material 'm': the texture 'a.png'; its mean colour is used, unless a "
        "mesh has a texture of its own"
    ]


@pytest.mark.parametrize("content", [b"", b"GIF89a", b"\x89PNG\r\n\x1a\n"])
def test_a_damaged_texture_is_reported(repair, tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)

    root, lines = repair(
        visual(
            '<sphere radius="1"/>',
            '<material name="m"><texture filename="a.png"/></material>',
        )
    )

    assert root.find(".//material") is None
    assert lines == [
        "warning: material 'm': the texture 'a.png' can't be read; drawn without it, "
        "unless its mesh has one of its own"
    ]


def test_a_texture_that_is_a_pipe_is_reported(repair, tmp_path):
    os.mkfifo(tmp_path / "a.png")

    with within(10.0):
        _, lines = repair(
            visual(
                '<sphere radius="1"/>',
                '<material name="m"><texture filename="a.png"/></material>',
            )
        )

    assert lines == [
        "warning: material 'm': the texture 'a.png' can't be read; drawn without it, "
        "unless its mesh has one of its own"
    ]


def test_a_colour_stays_when_its_texture_goes(repair):
    both = '<color rgba="1 0 0 1"/><texture filename="a.png"/>'

    root, _ = repair(
        visual('<sphere radius="1"/>', f'<material name="m">{both}</material>')
    )

    assert [element.tag for element in root.iterfind(".//material/*")] == ["color"]


@pytest.mark.parametrize(
    ("shape", "problem"),
    [
        ("", "no geometry"),
        ("<box/>", "<box> without a positive size"),
        ('<box size="1 1"/>', "<box> without a positive size"),
        ('<box size="1 0 0"/>', "<box> without a positive size"),
        ('<box size="1 0"/>', "<box> without a positive size"),
        ('<box size="1 0 -1"/>', "<box> without a positive size"),
        ('<box size="1 1 -1"/>', "<box> without a positive size"),
        ('<sphere radius="0"/>', "<sphere> without a positive size"),
        ('<sphere radius="nan"/>', "<sphere> without a positive size"),
        ('<sphere radius="inf"/>', "<sphere> without a positive size"),
        ('<cylinder radius="1"/>', "<cylinder> without a positive size"),
        ('<cylinder length="1"/>', "<cylinder> without a positive size"),
        ('<cone radius="1"/>', "<cone>, which is no geometry of a URDF"),
        ('<cylinder radius="1 1"/>', "<cylinder> without a positive size"),
        ('<capsule length="1 1"/>', "<capsule> without a positive size"),
        (
            '<box size="1 1 1e308"/>',
            "<box> with a size that isn't 1e-09 m to 1e+06 m",
        ),
        (
            '<sphere radius="1e200"/>',
            "<sphere> with a size that isn't 1e-09 m to 1e+06 m",
        ),
        (
            '<cylinder radius="1e-200" length="1"/>',
            "<cylinder> with a size that isn't 1e-09 m to 1e+06 m",
        ),
        ("<mesh/>", "<mesh> without a filename"),
        ('<mesh filename=""/>', "<mesh> without a filename"),
        ('<mesh filename="a.stl" scale="1 2"/>', "mesh scale '1 2'"),
    ],
)
@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_an_unusable_geometry_is_left_out(repair, shape, problem, tag):
    root, lines = repair(visual(shape, tag=tag))

    assert root.find(f"link/{tag}") is None
    severity = {"visual": "warning", "collision": "error"}[tag]
    assert lines == [f"{severity}: link 'a', {tag} 0: {problem}; left out"]


@pytest.mark.parametrize(
    ("shape", "part", "taken"),
    [
        ('<box size="5 5 0"/>', "<box size>", '<box size="5 5 0.001"/>'),
        (
            '<cylinder radius="1" length="0"/>',
            "<cylinder length>",
            '<cylinder radius="1" length="0.001"/>',
        ),
    ],
)
@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_a_shape_without_thickness_is_a_plate(repair, shape, part, taken, tag):
    root, lines = repair(visual(shape, tag=tag))

    expected, written = ET.XML(taken), root.find(f"link/{tag}/geometry")[0]
    assert written.tag == expected.tag
    for name, sizes in expected.attrib.items():
        found = [float(size) for size in written.attrib[name].split()]
        assert found == [float(size) for size in sizes.split()]
    assert lines == [f"info: link 'a', {tag} 0: {part} 0; a plate, taken 0.001 m thick"]


@pytest.mark.parametrize(
    "shape",
    [
        '<box size="1 2 3"/>',
        '<sphere radius="1"/>',
        '<cylinder radius="1" length="2"/>',
        '<capsule radius="1" length="2"/>',
    ],
)
def test_a_primitive_stays(repair, shape):
    root, lines = repair(visual(shape))

    expected, written = ET.XML(shape), root.find("link/visual/geometry")[0]
    assert written.tag == expected.tag
    for name, sizes in expected.attrib.items():
        found = [float(size) for size in written.attrib[name].split()]
        assert found == [float(size) for size in sizes.split()]
    assert lines == []


@pytest.mark.parametrize(
    "inside",
    ["", "<geometry/>", '<geometry/><geometry><sphere radius="1"/></geometry>'],
)
def test_a_visual_without_geometry_is_left_out(repair, inside):
    root, lines = repair(f'<link name="a"><visual>{inside}</visual></link>')

    assert root.find("link/visual") is None
    assert lines == ["warning: link 'a', visual 0: no geometry; left out"]


@pytest.mark.parametrize(
    ("tag", "suffix"), [("visual", ".gltf"), ("collision", ".obj")]
)
def test_a_mesh_becomes_what_drake_takes(repair, tmp_path, tag, suffix):
    write_tetrahedron(tmp_path / "a b.STL")

    root, lines = repair(
        visual('<mesh filename="a b.STL" scale="2"/>', "<material/>", tag=tag)
    )

    mesh = root.find(f"link/{tag}/geometry/mesh")
    converted = Path(unquote(urlparse(mesh.get("filename")).path))
    assert converted.suffix == suffix
    assert converted.is_file()
    assert mesh.get("scale") is None
    if tag == "collision":
        assert lines == ["info: <link/collision/material>; it has no effect"]
    if tag == "visual":
        assert root.find("link/visual/material") is None


def test_a_mesh_takes_the_colour_of_its_material(repair, tmp_path):
    write_tetrahedron(tmp_path / "a.stl")
    shape = '<mesh filename="a.stl"/>'
    green = '<material name="g"><color rgba="0 1 0 1"/></material>'

    root, _ = repair(green + visual(shape, '<material name="g"/>'))

    uri = root.find("link/visual/geometry/mesh").get("filename")
    text = Path(unquote(urlparse(uri).path)).read_text(encoding="utf-8")
    assert '"baseColorFactor":[0.0,1.0,0.0,1.0]' in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tag", "severity"), [("visual", "warning"), ("collision", "error")]
)
def test_a_mesh_of_a_missing_package_is_left_out(repair, tag, severity):
    root, lines = repair(visual('<mesh filename="package://nope/a.stl"/>', tag=tag))

    assert root.find(f"link/{tag}") is None
    assert len(lines) == 1
    assert lines[0].startswith(
        f"{severity}: link 'a', {tag} 0: package 'nope' not found; "
    )
    assert lines[0].endswith("; the mesh is left out")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            visual('<box size="1 2 x"/>'),
            "link 'a', visual 0: <box size>: expected numbers, got '1 2 x'",
        ),
        (
            visual('<box size="1_0 1 1"/>'),
            "link 'a', visual 0: <box size>: expected numbers, got '1_0 1 1'",
        ),
        (
            '<link name="a"><inertial><inertia ixx="-1e308"/></inertial></link>',
            "link 'a': <inertia ixx>: expected a finite number of at most 1e+15, "
            "got '-1e308'",
        ),
        (
            hinge('<origin xyz="0 0 1e16"/>'),
            "joint 'b_joint': <origin xyz>: expected 3 finite numbers of at most "
            "1e+15, got '0 0 1e16'",
        ),
        (
            visual('<mesh filename="a.stl" scale="x"/>'),
            "link 'a', visual 0: <mesh scale>: expected numbers, got 'x'",
        ),
        (
            '<material name="m"><color rgba="red"/></material>',
            "material 'm': expected numbers, got 'red'",
        ),
        (
            '<link name="a"><inertial><mass value="1 kg"/></inertial></link>',
            "link 'a': <mass value>: expected a finite number, got '1 kg'",
        ),
        (
            '<link name="a"><inertial><mass value="nan"/></inertial></link>',
            "link 'a': <mass value>: expected a finite number, got 'nan'",
        ),
        (
            '<link name="a"><inertial><inertia ixx=""/></inertial></link>',
            "link 'a': <inertia ixx>: expected a finite number, got ''",
        ),
        (
            visual('<sphere radius="1"/>', '<origin rpy="0 0"/>'),
            "link 'a': <origin rpy>: expected 3 finite numbers, got '0 0'",
        ),
        (
            hinge('<origin xyz="0 0 inf"/>'),
            "joint 'b_joint': <origin xyz>: expected 3 finite numbers, got '0 0 inf'",
        ),
        (
            hinge('<axis xyz="1"/>'),
            "joint 'b_joint': <axis xyz>: expected 3 finite numbers, got '1'",
        ),
        (
            hinge('<limit effort="a lot"/>'),
            "joint 'b_joint': <limit effort>: expected a number, got 'a lot'",
        ),
    ],
)
def test_text_in_place_of_numbers_is_one_located_message(
    repair, tmp_path, body, message
):
    with pytest.raises(DescriptionError) as caught:
        repair(body)

    assert str(caught.value) == f"{tmp_path / 'arm.urdf'}: {message}"


@pytest.mark.parametrize(
    ("length", "scale", "lines"),
    [
        (
            0.67,
            "100 100 100",
            [
                "warning: link 'a', visual 0: the mesh is 300 m long, the robot "
                '0.67 m; in millimetres? scale="0.1 0.1 0.1"; drawn as written'
            ],
        ),
        # As long as the robot, a large robot, and one of which no length is known.
        (0.67, "0.3 0.3 0.3", []),
        (20.0, "100 100 100", []),
        (0.0, "100 100 100", []),
    ],
)
def test_a_mesh_in_millimetres_is_noticed(repair, tmp_path, length, scale, lines):
    write_tetrahedron(tmp_path / "a.stl")
    mesh = visual(f'<mesh filename="a.stl" scale="{scale}"/>')
    arm = hinge(f'<origin xyz="0 0 {length}"/>', type="fixed")
    arm += hinge(parent="b", child="c", type="fixed")

    for _ in range(2):  # Also where the mesh is in the cache.
        assert repair(mesh + '<link name="b"/><link name="c"/>' + arm)[1] == lines
