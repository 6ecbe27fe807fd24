"""Pictures, depths and clouds of cameras, judged by projection and rays by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.ndimage import gaussian_filter

import arm_drake as ad
from arm_drake.perception.cameras import distort, undistort

_SIZE, _SQUARE, _TILES = (640, 480), 0.05, (8, 6)
_EYE = (0.0, 0.0, 0.5)
_BOARD = RigidTransform(RollPitchYaw(0.4, 0.3, 0.4), [0.6, 0.0, 0.5])
_BARREL = (-0.25, 0.07, 0.002, -0.001, 0.01)
_PINCUSHION = (0.2, 0.05, -0.003, 0.002, 0.0)


def load(visuals: str, lens: str = "", fov: float = 1.0) -> ad.Robot:
    """Return shapes in the frame of the board, and a camera that sees them."""
    rpy = " ".join(map(repr, RollPitchYaw(_BOARD.rotation()).vector().tolist()))
    xyz = " ".join(map(repr, _BOARD.translation().tolist()))
    return ad.load_robot(
        f"""<robot name="r"><link name="world"/><link name="seen">{visuals}</link>
<link name="eye"/><joint name="a" type="fixed"><parent link="world"/>
<child link="seen"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>
<joint name="b" type="fixed"><parent link="world"/><child link="eye"/>
<origin xyz="{_EYE[0]} {_EYE[1]} {_EYE[2]}"/></joint>
<gazebo reference="eye"><sensor name="front" type="rgbd_camera"><topic>cam</topic>
<camera><horizontal_fov>{fov}</horizontal_fov>
<image><width>{_SIZE[0]}</width><height>{_SIZE[1]}</height></image>
<clip><near>0.05</near><far>10</far></clip>{lens}</camera></sensor></gazebo></robot>"""
    )


def look(robot: ad.Robot) -> ad.CameraHandle:
    return ad.Simulation(ad.build_diagram(robot)).camera("front")


def tile(row: int, column: int) -> str:
    y, z = (
        _SQUARE * (index - (count - 1) / 2.0)
        for index, count in zip((column, row), _TILES, strict=True)
    )
    white = (row + column) % 2
    return (
        f'<visual><origin xyz="0.002 {y} {z}"/><geometry>'
        f'<box size="0.004 {_SQUARE} {_SQUARE}"/></geometry><material name="m{white}">'
        f'<color rgba="{white} {white} {white} 1"/></material></visual>'
    )


def corners_of_board() -> np.ndarray:
    """Return where four tiles meet, in the optical frame [m], shape (n, 3)."""
    y, z = (_SQUARE * (np.arange(1, count) - count / 2.0) for count in _TILES)
    points = [_BOARD @ [0.0, a, b] for a in y for b in z]
    ahead, left, up = (np.array(points) - _EYE).T
    return np.stack([-left, -up, ahead], axis=1)


def refine(gray: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the corner near a place: gradients around are across the way to it."""
    down, right = np.gradient(gray)
    for _ in range(10):
        u, v = np.rint(place).astype(int)
        window = np.s_[v - 9 : v + 10, u - 9 : u + 10]
        rows, columns = np.mgrid[window]
        g = np.stack([right[window], down[window]], axis=-1)
        outer = g[..., :, None] * g[..., None, :]
        where = np.stack([columns, rows], axis=-1)[..., None]
        place = np.linalg.solve(
            outer.sum(axis=(0, 1)), (outer @ where).sum(axis=(0, 1))[:, 0]
        )
    return place


def brown(x: float, y: float, d: tuple[float, ...]) -> tuple[float, float]:
    """Return a point as a lens shows it: OpenCV's formula, written out."""
    k1, k2, p1, p2, k3 = d
    r = math.hypot(x, y)
    radial = 1.0 + k1 * r**2 + k2 * r**4 + k3 * r**6
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r**2 + 2.0 * x**2),
        y * radial + p1 * (r**2 + 2.0 * y**2) + 2.0 * p2 * x * y,
    )


def in_sdf(d: tuple[float, ...], center: str = "0.5 0.5") -> str:
    names = ("k1", "k2", "p1", "p2", "k3")
    inside = "".join(f"<{n}>{v}</{n}>" for n, v in zip(names, d, strict=True))
    return f"<distortion>{inside}<center>{center}</center></distortion>"


_FOCAL = _SIZE[0] / (2.0 * math.tan(0.5))
_PINHOLE = (_FOCAL, _FOCAL, 319.5, 239.5)
_LENS = (
    "<lens><intrinsics><fx>610</fx><fy>590</fy><cx>331</cx><cy>230</cy><s>0</s>"
    "</intrinsics></lens>"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lens", "projection", "d", "center"),
    [
        ("", _PINHOLE, (0.0,) * 5, (319.5, 239.5)),
        (in_sdf(_BARREL) + _LENS, (610, 590, 331, 230), _BARREL, (331, 230)),
        (in_sdf(_PINCUSHION, "0.4 0.55"), _PINHOLE, _PINCUSHION, (255.5, 263.5)),
    ],
)
def test_corners_of_a_checkerboard_are_where_the_model_has_them(
    lens: str,
    projection: tuple[float, ...],
    d: tuple[float, ...],
    center: tuple[float, float],
) -> None:
    tiles = "".join(tile(r, c) for r in range(_TILES[1]) for c in range(_TILES[0]))
    camera = look(load(tiles, lens))
    # Edges have steps of a pixel.
    gray = gaussian_filter(camera.color().astype(float).mean(axis=2), 1.5)
    points = corners_of_board()

    focal, middle = np.array(projection[:2]), np.array(projection[2:])
    away = (np.array(center) - middle) / focal
    flat = points[:, :2] / points[:, 2:] - away
    expected = focal * (np.array([brown(x, y, d) for x, y in flat]) + away) + middle
    found = np.array([refine(gray, place + 1.0) for place in expected])

    assert len(found) == 35
    assert np.linalg.norm(found - expected, axis=1).max() < 0.5
    assert camera.info.d == d
    assert [camera.info.k[i] for i in (0, 4, 2, 5)] == pytest.approx(projection)
    # The cloud is that of the board all the same; the ground is far behind.
    cloud = (camera.points() - _BOARD.translation()) @ _BOARD.rotation().matrix()
    half = [0.5, *(_SQUARE * (np.array(_TILES) / 2.0 - 0.2))]
    on_board = (np.abs(cloud) < half).all(axis=1)
    assert on_board.sum() > 80_000
    np.testing.assert_allclose(cloud[on_board, 0], 0.0, atol=1e-3)


@pytest.mark.slow
def test_depths_and_points_are_those_of_rays_that_meet_a_mesh(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
    ball.export(tmp_path / "ball.stl")
    mesh = f'<mesh filename="file://{tmp_path}/ball.stl"/>'
    camera = look(load(f"<visual><geometry>{mesh}</geometry></visual>"))
    depth, points = camera.depth(), camera.points()

    # It is convex: a ray is inside from the last face that it enters to the first one
    # that it leaves.
    u, v = np.meshgrid(np.arange(_SIZE[0]), np.arange(_SIZE[1]))
    ways = np.stack(
        [np.ones(u.shape), (319.5 - u) / _FOCAL, (239.5 - v) / _FOCAL], axis=-1
    )
    R = _BOARD.rotation().matrix()
    normals = ball.face_normals
    offsets = np.einsum("ij,ij->i", normals, ball.triangles[:, 0])
    start = R.T @ (np.array(_EYE) - _BOARD.translation())
    closing = (ways @ R) @ normals.T
    at = (offsets - normals @ start) / closing
    enter = np.where(closing < 0.0, at, -np.inf).max(axis=-1)
    leave = np.where(closing > 0.0, at, np.inf).min(axis=-1)
    hits = leave - enter > 1e-2
    assert hits.sum() > 10_000
    np.testing.assert_allclose(depth[hits], enter[hits], atol=1e-3)

    near = (points - _BOARD.translation()) @ R
    near = near[np.linalg.norm(near, axis=1) < 0.25]
    above = (near @ normals.T - offsets).max(axis=1)
    assert len(above) > 10_000
    np.testing.assert_allclose(above, 0.0, atol=1e-3)


@pytest.mark.slow
def test_what_a_lens_folds_is_not_shown() -> None:
    # 1 - r² is a fold at r = 1 / sqrt(3), shown at 2 / (3 sqrt(3)) = 0.385.
    d = (-1.0, 0.0, 0.0, 0.0, 0.0)
    shown = np.array([0.0, 0.2, 0.38, 0.39, 2.0])

    x, y = undistort(shown, np.zeros(5), d)

    np.testing.assert_array_equal(np.isnan(x), [False, False, False, True, True])
    np.testing.assert_allclose(distort(x, y, d)[0][:3], shown[:3], atol=1e-6)
    assert (x[:3] < 1.0 / math.sqrt(3.0)).all()
    # The picture's corners are at 0.68.
    camera = look(load("", in_sdf(d)))
    assert (camera.color()[0, 0] == 0).all()
    assert np.isnan(camera.depth()[0, 0])
    assert camera.color()[240, 320].any()


@pytest.mark.parametrize(
    ("lens", "told"),
    [
        ("<distortion><k1>0.1</k1><center>1</center></distortion>",
         "distortion center: expected 2 numbers, got '1'"),
        ("<lens><intrinsics><fx>500</fx><fy>0</fy><cx>1</cx></intrinsics></lens>",
         "lens intrinsics: expected fx and fy more than 0, and cx and cy inside "
         "the picture, got 'fx 500, fy 0, cx 1, cy nothing'"),
        ("<lens><type>stereographic</type></lens>", "lens type 'stereographic'"),
    ],
)  # fmt: skip
def test_lenses_that_are_not_done_are_reported(lens: str, told: str) -> None:
    report = load("", lens).report

    assert [entry for entry in report if entry.what.startswith(told)]
