"""Makes the meshes of Centauri, which are our own: `python make_meshes.py`.

Each link is put together from convex solids, hulls of circles with rounded edges. The
boxes around the links are about those of the published meshes, see ../README.md. All
lengths are in metres, in the axes of the link.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

Circle = tuple[float, float, float]  # Two coordinates of its centre, radius.
Solid = trimesh.Trimesh

FOLDER = Path(__file__).resolve().parent

# Angle about y of the shoulder's axis in link1, from x [rad].
SHOULDER_TURN = math.pi / 2 - 1.11019

# Upwards at zero in the plane of the right finger; the left one is its mirror image.
UPWARDS = np.array([-0.376, 0.927])


def hull_of(
    circles: Sequence[Circle],
    start: float,
    end: float,
    *,
    axis: str = "z",
    bevel: float = 0.002,
    n: int = 28,
) -> Solid:
    """Return the convex hull of cylinders with rounded edges.

    Args:
        circles: Their centres, by the two other coordinates in the order x, y, z, and
            their radii.
        start: Where they begin along the axis.
        end: Where they end.
        axis: "x", "y" or "z".
        bevel: Radius of the edges, 0 for sharp ones.
        n: Points of a circle.
    """
    turns = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    rims = [0.0, math.pi / 4, math.pi / 2] if bevel else [0.0]
    points = []
    for a, b, r in circles:
        for rim in rims:
            radius = r - bevel * (1.0 - math.cos(rim))
            inset = bevel * (1.0 - math.sin(rim))
            for along in (start + inset, end - inset):
                ring = [a + radius * np.cos(turns), b + radius * np.sin(turns)]
                points.append([*ring, np.full(n, along)])
    cloud = np.concatenate([np.transpose(ring) for ring in points])
    columns = {"x": [2, 0, 1], "y": [0, 2, 1], "z": [0, 1, 2]}[axis]
    return trimesh.convex.convex_hull(cloud[:, columns])


def block(
    low: Sequence[float], high: Sequence[float], *, corner: float, bevel: float = 0.002
) -> Solid:
    """Return a box with rounded corners, seen along z, and rounded edges."""
    corners = [
        (x, y, corner)
        for x in (low[0] + corner, high[0] - corner)
        for y in (low[1] + corner, high[1] - corner)
    ]
    return hull_of(corners, low[2], high[2], bevel=bevel, n=12)


def turned(solid: Solid, angle: float, axis: Sequence[float]) -> Solid:
    """Return the solid turned about an axis through the origin [rad]."""
    moved = solid.copy()
    moved.apply_transform(trimesh.transformations.rotation_matrix(angle, axis))
    return moved


def mirrored(solids: Sequence[Solid]) -> list[Solid]:
    """Return the solids with y the other way round."""
    copies = [solid.copy() for solid in solids]
    for copy in copies:
        copy.apply_transform(np.diag([1.0, -1.0, 1.0, 1.0]))
    return copies


def gear_wheel(radius: float, teeth: int, start: float, end: float) -> Solid:
    """Return a gear wheel about z, its radius up to the tips of the teeth."""
    steps = 6 * teeth
    turns = 2.0 * math.pi * np.arange(steps) / steps
    profile = np.resize([1.0, 1.0, 0.93, 0.85, 0.85, 0.93], steps)
    x, y = radius * profile * np.cos(turns), radius * profile * np.sin(turns)
    levels = [np.column_stack([x, y, np.full(steps, z)]) for z in (start, end)]
    vertices = np.concatenate([*levels, [[0.0, 0.0, start], [0.0, 0.0, end]]])
    faces = []
    for i in range(steps):
        j = (i + 1) % steps
        faces += [[i, j, steps + j], [i, steps + j, steps + i]]
        faces += [[j, i, 2 * steps], [steps + i, steps + j, 2 * steps + 1]]
    return trimesh.Trimesh(vertices, faces)


def make_table() -> list[Solid]:
    """Return the table: a thick top on four legs, with rails between them."""
    low, high = (-0.275, -0.3552), (0.275, 0.1948)
    legs = [
        hull_of([(x, y, 0.022)], -0.116, -0.02, n=20)
        for x in (low[0] + 0.03, high[0] - 0.03)
        for y in (low[1] + 0.03, high[1] - 0.03)
    ]
    rails = []
    for y in (low[1] + 0.03, high[1] - 0.03):
        rails.append(
            block((-0.24, y - 0.01, -0.07), (0.24, y + 0.01, -0.02), corner=0.005)
        )
    for x in (low[0] + 0.03, high[0] - 0.03):
        rails.append(
            block((x - 0.01, -0.32, -0.07), (x + 0.01, 0.16, -0.02), corner=0.005)
        )
    top = block((*low, -0.032), (*high, 0.0), corner=0.03, bevel=0.005)
    return [top, *legs, *rails]


def make_feet() -> list[Solid]:
    """Return what lifts the table off the ground, 9 mm below its legs."""
    return [
        hull_of([(x, y, 0.026)], -0.125, -0.113, n=24)
        for x in (-0.245, 0.245)
        for y in (-0.3252, 0.1648)
    ]


def make_link0() -> list[Solid]:
    """Return the housing of the base: round about joint1, a box behind it."""
    box = [(0.0, 0.0, 0.1), (0.21, 0.08, 0.02), (0.21, -0.08, 0.02)]
    ears = [
        hull_of([(x, y, 0.014), (x, 0.8 * y, 0.014)], 0.0, 0.012, n=20)
        for x in (0.03, 0.19)
        for y in (-0.115, 0.115)
    ]
    return [
        hull_of(box, 0.0, 0.05, bevel=0.006, n=32),
        hull_of([(0.0, 0.0, 0.094)], 0.045, 0.064, bevel=0.004, n=32),
        *ears,
    ]


def make_link0_trim() -> list[Solid]:
    """Return the bearing below joint1, bolts, vents and the plug."""
    bolts = [
        hull_of([(x, y, 0.006)], 0.01, 0.016, bevel=0.001, n=12)
        for x in (0.03, 0.19)
        for y in (-0.115, 0.115)
    ]
    vents = [
        block((x, -0.05, 0.048), (x + 0.006, 0.05, 0.0515), corner=0.002, bevel=0.0)
        for x in (0.125, 0.14, 0.155, 0.17)
    ]
    plug = block(
        (0.225, -0.025, 0.012), (0.235, 0.025, 0.034), corner=0.003, bevel=0.001
    )
    ring = hull_of([(0.0, 0.0, 0.086)], 0.06, 0.0665, bevel=0.0, n=32)
    return [ring, *bolts, *vents, plug]


def make_link1() -> list[Solid]:
    """Return the turntable with the two cheeks that carry the shoulder."""
    table = hull_of([(0.0, 0.0, 0.0975)], 0.0, 0.022, axis="y", bevel=0.004)
    deck = hull_of([(0.0, 0.0, 0.08)], 0.02, 0.045, axis="y", bevel=0.01)
    cheeks = []
    for side in (-1.0, 1.0):
        low, high = sorted((side * 0.071, side * 0.1))
        outline = [(0.1455, 0.0, 0.06), (0.02, 0.045, 0.012), (0.02, -0.045, 0.012)]
        cheeks.append(hull_of(outline, low, high, axis="x", bevel=0.004))
        low, high = sorted((side * 0.098, side * 0.1588))
        cheeks.append(hull_of([(0.1455, 0.0, 0.03)], low, high, axis="x", bevel=0.004))
    parts = [turned(solid, SHOULDER_TURN, [0, 1, 0]) for solid in cheeks]
    return [table, deck, *parts]


def make_link1_trim() -> list[Solid]:
    """Return the flanges between the cheeks and the drives outside."""
    flanges = []
    for side in (-1.0, 1.0):
        low, high = sorted((side * 0.098, side * 0.108))
        flanges.append(hull_of([(0.1455, 0.0, 0.042)], low, high, axis="x"))
        low, high = sorted((side * 0.148, side * 0.152))
        flanges.append(
            hull_of([(0.1455, 0.0, 0.031)], low, high, axis="x", bevel=0.001)
        )
    return [turned(solid, SHOULDER_TURN, [0, 1, 0]) for solid in flanges]


def make_link2() -> list[Solid]:
    """Return the upper arm: a barrel at the shoulder, a fork at the elbow."""
    barrel = hull_of([(0.0, 0.0, 0.06)], -0.068, 0.0665, bevel=0.006, n=32)
    body = hull_of(
        [(0.0, 0.02, 0.054), (0.0, 0.115, 0.042)], -0.0625, 0.0555, bevel=0.01
    )
    prongs = [
        hull_of([(0.0, 0.1, 0.045), (0.0007, 0.2211, 0.0475)], low, high, bevel=0.004)
        for low, high in ((-0.0635, -0.0435), (0.0365, 0.0565))
    ]
    return [barrel, body, *prongs]


def make_link2_trim() -> list[Solid]:
    """Return the caps over the elbow's axis, and a stripe in front and behind."""
    caps = [
        hull_of([(0.0007, 0.2211, 0.03)], low, high)
        for low, high in ((-0.0675, -0.0615), (0.0545, 0.0605))
    ]
    stripe = hull_of(
        [(0.045, -0.0035, 0.012), (0.13, -0.0035, 0.012)], -0.052, 0.052, axis="x"
    )
    return [*caps, stripe]


def make_link3() -> list[Solid]:
    """Return the elbow: a barrel about joint3, and a neck up to joint4."""
    barrel = hull_of([(0.0, 0.0, 0.0475)], -0.03875, 0.03875, bevel=0.004, n=32)
    neck = hull_of([(0.0, 0.03, 0.04), (0.0, 0.085, 0.028)], -0.034, 0.034, bevel=0.01)
    return [
        barrel,
        neck,
        hull_of([(0.0, 0.0, 0.03)], 0.08, 0.12, axis="y"),
        hull_of([(0.0, 0.0, 0.0365)], 0.108, 0.1276, axis="y"),
    ]


def make_link3_trim() -> list[Solid]:
    """Return a ring below joint4."""
    return [hull_of([(0.0, 0.0, 0.0372)], 0.1145, 0.1205, axis="y", bevel=0.001)]


def make_link4() -> list[Solid]:
    """Return the fork of the wrist."""
    foot = hull_of([(0.0, 0.0, 0.036)], 0.0, 0.018, bevel=0.003)
    bridge = hull_of(
        [(0.02, 0.0, 0.022), (-0.02, 0.0, 0.022)], 0.01, 0.052, bevel=0.006
    )
    prongs = [
        hull_of([(0.0, 0.03, 0.027), (0.0, 0.095, 0.035)], low, high, axis="x")
        for low, high in ((-0.042, -0.0265), (0.0265, 0.042))
    ]
    return [foot, bridge, *prongs]


def make_link4_trim() -> list[Solid]:
    """Return the caps over the wrist's axis."""
    return [
        hull_of([(0.0, 0.095, r)], low, high, axis="x", bevel=0.001)
        for low, high, r in ((-0.045, -0.041, 0.022), (0.041, 0.045, 0.026))
    ]


def make_link5() -> list[Solid]:
    """Return the wrist: a barrel about joint5, and the seat of the hand."""
    return [
        hull_of([(0.0, 0.0, 0.035)], -0.024, 0.024, bevel=0.003),
        hull_of([(0.0, 0.0, 0.023)], 0.0, 0.04, axis="y", bevel=0.003),
        hull_of([(0.0, 0.0, 0.008)], 0.035, 0.049, axis="y", bevel=0.001, n=20),
    ]


def make_link6() -> list[Solid]:
    """Return the hand: a flange, two plates that hold the hinges, the drive."""
    outline = [(-0.0005, 0.01, 0.02), (-0.022, 0.03, 0.008), (0.021, 0.03, 0.008)]
    outline += [(-0.0065, 0.044, 0.005), (0.006, 0.044, 0.005)]
    plates = [
        hull_of(
            outline,
            low,
            high,
            axis="y",
            bevel=0.001,
            n=20,
        )
        for low, high in ((-0.0095, -0.0045), (0.0035, 0.007))
    ]
    drive = block((-0.02, -0.04, 0.006), (0.0115, -0.009, 0.0385), corner=0.003)
    lugs = block(
        (-0.0275, -0.018, 0.018), (0.019, -0.0155, 0.03), corner=0.001, bevel=0.0
    )
    flange = hull_of([(0.0, 0.0, 0.0245)], 0.0, 0.0065, bevel=0.0015)
    neck = hull_of([(0.0, 0.0, 0.011)], 0.005, 0.014, bevel=0.0, n=24)
    horn = hull_of(
        [(-0.0142, 0.024, 0.007)], -0.0499, -0.039, axis="y", bevel=0.001, n=20
    )
    return [flange, neck, *plates, drive, lugs, horn]


def make_link(reach: float = -0.04) -> list[Solid]:
    """Return a bar between two hinges, with their pins."""
    bar = hull_of(
        [(0.0, 0.0, 0.004), (reach, 0.0, 0.004)], -0.006, 0.0, bevel=0.0008, n=20
    )
    return [bar]


def make_gear() -> list[Solid]:
    """Return a gear wheel with the bar that carries a finger."""
    bar = hull_of(
        [(0.0, 0.0, 0.0075), (-0.04, 0.0, 0.004)], -0.006, 0.0, bevel=0.0008, n=20
    )
    return [gear_wheel(0.015, 18, -0.0055, -0.0005), bar]


def make_finger() -> list[Solid]:
    """Return the right finger: a foot with two hinges, and an upright jaw."""
    hinge = np.array([-0.001, 0.0211])
    root, tip = hinge + 0.004 * UPWARDS, hinge + 0.041 * UPWARDS
    foot = hull_of(
        [(0.0, 0.0, 0.006), (*hinge, 0.006)], -0.0005, 0.0055, bevel=0.001, n=20
    )
    back = hull_of([(*hinge, 0.006), (*root, 0.006)], -0.011, 0.0055, bevel=0.001, n=20)
    jaw = hull_of(
        [(*root, 0.0055), (*tip, 0.0035)], -0.01225, 0.00575, bevel=0.001, n=20
    )
    return [foot, back, jaw]


def make_finger_trim() -> list[Solid]:
    """Return the pad of the right finger, on its inner side."""
    inwards = np.array([UPWARDS[1], -UPWARDS[0]])
    hinge = np.array([-0.001, 0.0211])
    low, high = (hinge + up * UPWARDS + 0.004 * inwards for up in (0.012, 0.039))
    pad = hull_of(
        [(*low, 0.0022), (*high, 0.0012)], -0.0108, 0.0043, bevel=0.0005, n=16
    )
    pins = [
        hull_of([(x, y, 0.0025)], -0.0075, 0.0065, bevel=0.0005, n=16)
        for x, y in ((0.0, 0.0), hinge)
    ]
    return [pad, *pins]


def make_all() -> dict[str, list[Solid]]:
    """Return the solids of each mesh by its file's name."""
    finger, trim = make_finger(), make_finger_trim()
    return {
        "base_footprint": make_table(),
        "base_footprint_trim": make_feet(),
        "link0": make_link0(),
        "link0_trim": make_link0_trim(),
        "link1": make_link1(),
        "link1_trim": make_link1_trim(),
        "link2": make_link2(),
        "link2_trim": make_link2_trim(),
        "link3": make_link3(),
        "link3_trim": make_link3_trim(),
        "link4": make_link4(),
        "link4_trim": make_link4_trim(),
        "link5": make_link5(),
        "link6": make_link6(),
        "right_gear": make_gear(),
        "right_pivot": make_link(),
        "right_finger": finger,
        "right_finger_trim": trim,
        "left_gear": mirrored(make_gear()),
        "left_pivot": mirrored(make_link()),
        "left_finger": mirrored(finger),
        "left_finger_trim": mirrored(trim),
    }


def main() -> None:
    """Write all meshes beside this file, and say how large they are."""
    for name, solids in make_all().items():
        mesh = trimesh.util.concatenate(solids)
        (FOLDER / f"{name}.STL").write_bytes(trimesh.exchange.stl.export_stl(mesh))
        low, high = np.round(mesh.bounds, 4).tolist()
        print(f"{name}: {len(mesh.faces)} triangles, {low} to {high}")


if __name__ == "__main__":
    main()
