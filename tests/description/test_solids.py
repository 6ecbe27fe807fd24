"""Volume, centre and inertia of shapes, against integrals done by hand."""

import dataclasses as dc
import itertools
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from arm_drake.description.inertia import Inertial, link_solid, polyhedron
from arm_drake.description.links import (
    Geometry,
    LinkInfo,
    Origin,
    ShapeInfo,
    read_origin,
)
from arm_drake.description.meshes.conversion import convert_visual
from arm_drake.description.report import LoadReport

# A tetrahedron with its corners on the axes, volume 1 * 2 * 3 / 6.
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def link(*shapes: ShapeInfo, tag="collision") -> LinkInfo:
    return dc.replace(LinkInfo("a"), **{f"{tag}s": shapes})


def shape(type: str, origin: Origin | None = None, **sizes) -> ShapeInfo:
    return ShapeInfo(Geometry(type, **sizes), origin or Origin())


def box(*size: float, origin: Origin | None = None) -> ShapeInfo:
    return shape("box", origin, size=size)


def mesh(path: Path) -> ShapeInfo:
    return shape("mesh", filename=path.as_uri())


def read(*shapes: ShapeInfo, tag="collision") -> Inertial:
    found = link_solid(link(*shapes, tag=tag))
    assert found is not None
    return found[0]


# Shape, volume, moments about its centre.
PRIMITIVES = [
    (box(1, 2, 3), 6.0, [6.5, 5.0, 2.5]),
    (shape("sphere", radius=1), 4 / 3 * math.pi, [8 / 15 * math.pi] * 3),
    (
        shape("cylinder", radius=1, length=6),
        6 * math.pi,
        [19.5 * math.pi, 19.5 * math.pi, 3 * math.pi],
    ),
]


@pytest.mark.parametrize(("primitive", "volume", "moments"), PRIMITIVES)
def test_a_primitive_has_the_inertia_of_the_textbook(primitive, volume, moments):
    solid = read(primitive)

    assert solid.mass == pytest.approx(volume)
    np.testing.assert_allclose(solid.center, 0.0)
    np.testing.assert_allclose(solid.inertia, np.diag(moments), atol=1e-12)


def test_a_capsule_has_the_inertia_of_its_slices():
    radius, length = 0.3, 0.7
    n = 100_000
    z = (np.arange(n) + 0.5) / n * (length + 2 * radius) - length / 2 - radius
    beyond = np.maximum(np.abs(z) - length / 2, 0.0)
    square = radius**2 - beyond**2
    slices = math.pi * square * (length + 2 * radius) / n

    solid = read(shape("capsule", radius=radius, length=length))

    across = slices @ (square / 4 + z**2)
    expected = np.diag([across, across, slices @ square / 2])
    assert solid.mass == pytest.approx(slices.sum(), rel=1e-8)
    np.testing.assert_allclose(solid.inertia, expected, rtol=1e-8, atol=1e-15)


def test_origins_turn_and_move_a_shape():
    # x of the box, 3 long, points along y of the link.
    origin = Origin((4.0, 5.0, 6.0), (0.0, 0.0, math.pi / 2))

    solid = read(box(3, 2, 1, origin=origin))

    np.testing.assert_allclose(solid.center, [4.0, 5.0, 6.0])
    np.testing.assert_allclose(
        solid.inertia, np.diag([5.0, 2.5, 6.5]), rtol=1e-12, atol=1e-12
    )


def test_roll_pitch_and_yaw_turn_about_fixed_axes():
    # Rolled, z points along -y; pitched, x along -z; yawed, y along -x.
    half = repr(math.pi / 2)
    element = ET.XML(f'<a><origin rpy="{half} {half} {half}"/></a>')

    origin = read_origin(element, Path("arm.urdf"), "a")

    R = origin.rotation
    np.testing.assert_allclose(R, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(origin.position, 0.0)


def test_two_halves_of_a_box_are_the_box():
    halves = [box(1, 2, 1.5, origin=Origin((1.0, 1.0, z))) for z in (1.0, 2.5)]

    solid = read(*halves)

    assert solid.mass == pytest.approx(6.0)
    np.testing.assert_allclose(solid.center, [1.0, 1.0, 1.75])
    np.testing.assert_allclose(solid.inertia, np.diag([6.5, 5.0, 2.5]), atol=1e-12)


def test_a_tetrahedron_has_the_integrals_of_its_corners():
    solid = polyhedron(CORNERS + np.array([5.0, 6.0, 7.0]), FACES)

    # Over the tetrahedron the mean of x^2 is 1/10 of a^2, of x y 1/20 of a b.
    a = np.array([1.0, 2.0, 3.0])
    mean = (np.outer(a, a) + np.diag(a**2)) / 20.0 - np.outer(a, a) / 16.0
    assert solid.mass == pytest.approx(1.0)
    np.testing.assert_allclose(solid.center, [5.25, 6.5, 7.75])
    expected = np.trace(mean) * np.eye(3) - mean
    np.testing.assert_allclose(solid.inertia, expected, atol=1e-10)


@pytest.mark.parametrize("distance", [1e2, 1e4])
def test_a_thin_body_far_from_the_origin_has_moments_of_a_body(distance):
    # Of such numbers the moments about the origin have no digit left.
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    size = np.array([0.05, 0.002, 0.0005])
    hull = ConvexHull(corners)
    faces = [
        face if np.linalg.det(corners[face] - 0.5) > 0.0 else face[::-1]
        for face in hull.simplices
    ]
    there = distance * np.array([0.6, 0.64, 0.48])

    solid = polyhedron(corners * size + there, np.array(faces))

    expected = np.prod(size) / 12.0 * (np.sum(size**2) - size**2)
    np.testing.assert_allclose(np.diag(solid.inertia), expected, rtol=1e-6)
    np.testing.assert_allclose(solid.center, there + size / 2.0, rtol=1e-12)


def write_obj(folder: Path) -> Path:
    path = folder / "a b.obj"
    lines = ["v {} {} {}".format(*corner) for corner in CORNERS.tolist()]
    lines += ["f {} {} {}".format(*face) for face in (FACES + 1).tolist()]
    path.write_text("\n".join(lines))
    return path


def test_a_converted_collision_mesh_counts_as_its_hull(tmp_path):
    solid = read(mesh(write_obj(tmp_path)))

    assert solid.mass == pytest.approx(1.0)
    np.testing.assert_allclose(solid.center, [0.25, 0.5, 0.75])


def test_a_converted_visual_mesh_counts_as_the_box_around_it(tmp_path):
    converted = convert_visual(
        write_obj(tmp_path),
        (1.0, 1.0, 1.0),
        LoadReport(),
        where="",
        cache_dir=tmp_path / "c d",
    )
    assert converted is not None

    solid = read(mesh(converted), tag="visual")

    assert solid.mass == pytest.approx(6.0)
    np.testing.assert_allclose(solid.center, [0.5, 1.0, 1.5])
    np.testing.assert_allclose(solid.inertia, np.diag([6.5, 5.0, 2.5]), atol=1e-12)


def test_collision_geometry_comes_before_visual():
    solid = link(shape("sphere", radius=1))
    seen = link(shape("sphere", radius=2), tag="visual")

    found = link_solid(dc.replace(solid, visuals=seen.visuals))

    assert found is not None
    assert found[1] == "its collision geometry"
    assert found[0].mass == pytest.approx(4 / 3 * math.pi)


BOX = box(1, 1, 1)
NOTHING = box(1e-20, 1e-20, 1e-20)


@pytest.mark.parametrize(
    ("tag", "others", "name"),
    [
        ("collision", (), "the convex hull of its collision mesh"),
        ("visual", (), "the box around its visual mesh"),
        ("collision", (None,), "the convex hulls or parts of its collision meshes"),
        ("visual", (None,), "the boxes around its visual meshes"),
        (
            "collision",
            (BOX,),
            "its collision geometry, with the convex hulls or parts of its meshes",
        ),
        ("visual", (BOX,), "its visual geometry, with the boxes around its meshes"),
        # What has no volume isn't estimated from.
        ("collision", (NOTHING,), "the convex hull of its collision mesh"),
    ],
)
def test_what_stands_for_a_mesh_is_named(tmp_path, tag, others, name):
    hull = mesh(write_obj(tmp_path))
    shapes = [other or hull for other in others]

    found = link_solid(link(hull, *shapes, tag=tag))

    assert found is not None
    assert found[1] == name


@pytest.mark.parametrize(
    "shapes",
    [(), (NOTHING,), (shape("mesh", filename="package://a/b.stl"),)],
)
def test_what_has_no_volume_is_no_solid(shapes):
    assert link_solid(link(*shapes)) is None
