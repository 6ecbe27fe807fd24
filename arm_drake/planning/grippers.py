"""Grippers: the fingers of a robot, how wide they open, and where they take hold.

All of it is read from the collision shapes. Fingers are what the gripper's joints move;
of a gripper with one such part the other finger is the link that carries it. The
closing axis is the direction in which two fingers come together, and the pads are
the largest areas of theirs that face each other at one distance when they are closed.
"""

import dataclasses as dc
import functools
import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    ProximityProperties,
    RoleAssign,
    SceneGraph,
    TriangleSurfaceMesh,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.description.joints import joints_above, last_master
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, quoted, suggest
from arm_drake.importing import dataclass
from arm_drake.planning.collisions import add_colliding_robot
from arm_drake.planning.groups import PlanningGroup, find_group, planning_groups
from arm_drake.planning.inverse_kinematics import complete_positions
from arm_drake.plant.contact import with_surfaces
from arm_drake.plant.joint_ranges import find_gripper_links, find_gripper_ranges

# How closely surfaces are looked at [m].
_CELL = 2e-3

# How uneven the gap between pads may be [m].
_PAD_DEPTH = 2e-3

# Positions between open and closed at which the gap is measured.
_OPENINGS = 41

# Into how many parts the side of a triangle is cut at most.
_MOST_PARTS = 60

# Pads are in this part of the fingers, from the tips on; they have so many cells.
_TIP, _FEWEST = 0.6, 6

# The last part of the way of a single finger, in which it moves as it will when closed.
_LAST = 0.9

# Slope of pads that is that of teeth, or a curve [1].
_EVEN = 0.1

# Angle between the approach and an axis of the palm's link below which they are the
# same [rad].
_SNAP = 0.35


class Opening(NamedTuple):
    """The pads at one position of the gripper, in the frame of the palm."""

    # 0 is open, 1 is closed.
    closed: float

    # Distance between the pads along the closing axis [m]; negative where they overlap.
    width: float

    # The middle between them [m], shape (3,).
    middle: np.ndarray


@dataclass(frozen=True)
class Gripper:
    """A gripper of a robot, and the arm that carries it."""

    # The joints of the arm, which are planned for.
    group: PlanningGroup

    # The link that carries the fingers.
    palm: str

    # Independent joints that move the fingers, where they are open and closed [rad, m].
    open: Mapping[str, float]
    closed: Mapping[str, float]

    # Links of the two fingers.
    fingers: tuple[tuple[str, ...], tuple[str, ...]]

    # Unit vectors in the frame of the palm, shape (3,): along which the fingers close,
    # and in which the gripper approaches what it grasps.
    closing_axis: np.ndarray
    approach_axis: np.ndarray

    # How far the pads reach from their middle along the approach and across [m].
    pad: tuple[float, float]

    # From open to closed.
    openings: tuple[Opening, ...] = dc.field(repr=False)

    robot: Robot = dc.field(repr=False)
    shapes: "_Shapes" = dc.field(repr=False)

    @property
    def stroke(self) -> tuple[float, float]:
        """The smallest and the largest width between the pads [m], at least 0."""
        widths = [max(0.0, opening.width) for opening in self.openings]
        return min(widths), max(widths)

    def at(self, width: float) -> Opening:
        """Return the pads where they are so far apart [m], or as far as they get."""
        rows = sorted(self.openings, key=lambda each: each.width)
        table = np.array([[o.width, o.closed, *o.middle] for o in rows]).T
        found = [float(np.interp(width, table[0], row)) for row in table]
        return Opening(found[1], found[0], np.array(found[2:]))

    def positions(self, closed: float) -> dict[str, float]:
        """Return positions of its joints [rad] or [m]; 0 is open, 1 is closed."""
        return {
            name: self.open[name] + closed * (self.closed[name] - self.open[name])
            for name in self.open
        }

    def width_at(self, positions: Mapping[str, float]) -> float:
        """Return the distance between the pads at measured positions [m]."""
        name = max(self.open, key=lambda n: abs(self.closed[n] - self.open[n]))
        part = (positions[name] - self.open[name]) / (
            self.closed[name] - self.open[name]
        )
        return float(
            np.interp(
                part,
                [each.closed for each in self.openings],
                [each.width for each in self.openings],
            )
        )

    def pose(self, width: float, clearance: float = 0.0) -> RigidTransform:
        """Return the grasp frame in the palm for things of a width [m].

        Its x axis is the closing axis, its z axis the approach; its origin is between
        the pads: along the closing axis where they are open by `clearance` [m] on
        either side, along the others where they touch.
        """
        x, z = self.closing_axis, self.approach_axis
        touching = self.at(width).middle
        around = self.at(width + 2.0 * clearance).middle
        middle = touching + x * float(x @ (around - touching))
        R = np.column_stack([x, np.cross(z, x), z])
        return RigidTransform(RotationMatrix(R), middle)

    def points(self, closed: float) -> np.ndarray:
        """Return points of its surface in the frame of the palm [m], shape (n, 3).

        Those that bound it are among them.
        """
        links = dict.fromkeys([self.palm, *self.fingers[0], *self.fingers[1]])
        return self.shapes.few_at(links, self.palm, self.positions(closed))


# Of so many robots a gripper is remembered, as it remembers its robot.
_REMEMBERED = 8


def find_gripper(robot: Robot, group: str | None = None) -> Gripper:
    """Return the gripper of a robot, as its collision shapes show it.

    Args:
        robot: The robot.
        group: Planning group of the arm that carries it; None is the first one that
            carries one.

    Raises:
        InputError: If there is no gripper, or nothing that can touch on its fingers.
    """
    return _find_gripper(robot, group)


@functools.lru_cache(maxsize=_REMEMBERED)
def _find_gripper(robot: Robot, group: str | None) -> Gripper:
    ranges = find_gripper_ranges(robot)
    if not ranges:
        raise InputError(
            f"robot {robot.name!r} has no gripper: no joint with limits is moved by a "
            "gripper controller or called gripper, finger, jaw, knuckle or claw"
        )
    arm, names = _find_arm(robot, ranges, group)
    chosen = {name: ranges[name] for name in names}
    joints = {joint.name: joint for joint in robot.description.joints}
    palm = joints[names[0]].parent
    shapes = _Shapes(robot)
    start = {name: ends[0] for name, ends in chosen.items()}
    end = {name: ends[1] for name, ends in chosen.items()}
    moved = _moved_links(robot, names, palm)
    fingers, axis = _split(shapes, palm, moved, start, end)
    return _measure(
        Gripper(
            group=arm,
            palm=palm,
            open=start,
            closed=end,
            fingers=fingers,
            closing_axis=axis,
            approach_axis=axis,
            pad=(0.0, 0.0),
            openings=(),
            robot=robot,
            shapes=shapes,
        ),
        shapes,
    )


def _find_arm(
    robot: Robot, ranges: Mapping[str, object], group: str | None
) -> tuple[PlanningGroup, list[str]]:
    """Return the arm, and the joints of the gripper that it carries."""
    groups = planning_groups(robot)
    if group is not None and group not in groups:
        raise InputError(f"no planning group {group!r}; {suggest(group, groups)}")
    joints = {joint.name: joint for joint in robot.description.joints}
    chosen = groups.values() if group is None else [groups[group]]
    for each in chosen:
        if set(each.joints) & set(ranges):
            continue
        mounted = [
            name
            for name in ranges
            if set(each.joints)
            <= {
                j.name
                for j in joints_above(robot.description.joints, joints[name].parent)
            }
        ]
        if mounted:
            palm = joints[mounted[0]].parent
            return each, [n for n in mounted if joints[n].parent == palm]
    if group is not None:
        text = f"carries no gripper; the gripper's joints are {quoted(list(ranges))}"
        raise InputError(f"planning group {group!r} {text}")
    movable = {joint.name: joint for joint in robot.description.movable_joints}
    palm = joints[next(iter(ranges))].parent
    above = joints_above(robot.description.joints, palm)
    arm = {last_master(joint, movable)[0] for joint in above if joint.name in movable}
    if not arm:
        raise InputError(f"no joint carries the gripper with {quoted(list(ranges))}")
    names = [name for name in movable if name in arm]
    return find_group(robot, names), [n for n in ranges if joints[n].parent == palm]


def _moved_links(robot: Robot, names: Sequence[str], palm: str) -> dict[str, str]:
    """Return the links that the gripper moves, each with the first of its chain."""
    description = robot.description
    movable = {joint.name: joint for joint in description.movable_joints}
    found = {}
    for link in description.links:
        chain = joints_above(description.joints, link)
        at = next((k for k, joint in enumerate(chain) if joint.parent == palm), None)
        if at is None:
            continue
        own = [joint for joint in chain[: at + 1] if joint.name in movable]
        if {last_master(joint, movable)[0] for joint in own} & set(names):
            found[link] = chain[at].child
    return found


class _Shapes:
    """The collision shapes of a robot, as points on their surfaces."""

    def __init__(self, robot: Robot) -> None:
        plant, scene_graph = MultibodyPlant(1e-3), SceneGraph()
        plant.RegisterAsSourceForSceneGraph(scene_graph)
        # As in a world with things, where fingers aren't hulls.
        description = with_surfaces(robot.description, find_gripper_links(robot))
        robot = dc.replace(robot, description=description)
        model = add_colliding_robot(plant, robot)
        plant.Finalize()
        inspector, source = scene_graph.model_inspector(), plant.get_source_id()
        self._robot, self._plant, self._model = robot, plant, model
        self._context = plant.CreateDefaultContext()
        self._points: dict[str, np.ndarray] = {}
        self._few: dict[str, np.ndarray] = {}
        for link in robot.description.links:
            if not plant.HasBodyNamed(link, model):
                continue
            parts = [np.zeros((0, 3))]
            body = plant.GetBodyByName(link, model)
            for geometry in plant.GetCollisionGeometriesForBody(body):
                properties = ProximityProperties(
                    inspector.GetProximityProperties(geometry)
                )
                AddRigidHydroelasticProperties(_CELL, properties)
                scene_graph.AssignRole(
                    source, geometry, properties, RoleAssign.kReplace
                )
                mesh = inspector.maybe_get_hydroelastic_mesh(geometry)
                if isinstance(mesh, TriangleSurfaceMesh):
                    X_BG = RigidTransform(inspector.GetPoseInFrame(geometry))
                    parts.append(X_BG.multiply(spread(mesh).T).T)
            self._points[link] = np.vstack(parts)

    def at(
        self, links: Iterable[str], palm: str, positions: Mapping[str, float]
    ) -> np.ndarray:
        """Return points of links in the frame of the palm [m], shape (n, 3)."""
        return self._place(self._points, links, palm, positions)

    def few_at(
        self, links: Iterable[str], palm: str, positions: Mapping[str, float]
    ) -> np.ndarray:
        """Return as few as are still close to each other, with the hull's corners."""
        for link in links:
            points = self._points.get(link)
            if points is not None and len(points) and link not in self._few:
                self._few[link] = np.vstack([thin(points), hull_corners(points)])
        return self._place(self._few, links, palm, positions)

    def _place(
        self,
        points: Mapping[str, np.ndarray],
        links: Iterable[str],
        palm: str,
        positions: Mapping[str, float],
    ) -> np.ndarray:
        parts = [np.zeros((0, 3))]
        for link in links:
            if len(points.get(link, ())):
                X_PB = self.pose(link, palm, positions)
                parts.append(X_PB.multiply(points[link].T).T)
        return np.vstack(parts)

    def pose(
        self, link: str, palm: str, positions: Mapping[str, float]
    ) -> RigidTransform:
        """Return the pose of a link in the palm."""
        q = np.zeros(self._plant.num_positions())
        for name, value in complete_positions(self._robot, positions).items():
            q[self._plant.GetJointByName(name, self._model).position_start()] = value
        self._plant.SetPositions(self._context, q)
        body, frame = (
            self._plant.GetBodyByName(name, self._model).body_frame()
            for name in (link, palm)
        )
        return RigidTransform(body.CalcPose(self._context, frame))


# So many points are on a shape.
_MOST_POINTS = 1_000_000


def spread(mesh: TriangleSurfaceMesh) -> np.ndarray:
    """Return points on a surface that are at most a cell apart, shape (n, 3)."""
    corners = np.array(mesh.vertices())
    rows = np.array(
        [[triangle.vertex(k) for k in range(3)] for triangle in mesh.triangles()]
    )
    a, b, c = (corners[rows[:, k]] for k in range(3))
    longest = np.max(
        [np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))], axis=0
    )
    parts = [corners]
    counts = np.minimum(np.ceil(longest / _CELL).astype(int), _MOST_PARTS)
    excess = 0.5 * np.sum(counts**2) / _MOST_POINTS
    if excess > 1.0:  # It is as large as if millimetres were taken for metres.
        counts = (counts / math.sqrt(excess)).astype(int)
    for count in np.unique(counts[counts > 1]):
        some = counts == count
        steps = range(count + 1)
        grid = np.array([(i, j) for i in steps for j in steps if i + j <= count])
        u, v = (grid / count).T[:, :, None, None]
        points = (1 - u - v) * a[some] + u * b[some] + v * c[some]
        parts.append(points.reshape(-1, 3))
    return np.vstack(parts)


# So many can be numbered.
_MOST_CUBES = 2.0**62


def thin(points: np.ndarray) -> np.ndarray:
    """Return one point of each cube with an edge of half a cell, shape (m, 3)."""
    cubes = np.floor((points - points.min(axis=0)) / (0.5 * _CELL))
    sizes = cubes.max(axis=0) + 1.0
    if np.prod(sizes) > _MOST_CUBES:  # They are kilometres apart.
        return points
    numbers = np.ravel_multi_index(tuple(cubes.T.astype(int)), tuple(sizes.astype(int)))
    return np.asarray(points[np.unique(numbers, return_index=True)[1]])


def hull_corners(points: np.ndarray) -> np.ndarray:
    """Return the points of a hull; all, if they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def _split(
    shapes: _Shapes,
    palm: str,
    moved: Mapping[str, str],
    start: Mapping[str, float],
    end: Mapping[str, float],
) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], np.ndarray]:
    """Return the links of the two fingers, and the axis from the second to the first.

    Parts that move together are one finger. What the fingers approach each other by
    decides; what they both move by doesn't count.
    """
    centers = {}
    for link in moved:
        points = [shapes.at([link], palm, q) for q in (start, end)]
        if len(points[0]):
            centers[link] = [each.mean(axis=0) for each in points]
    if not centers:
        raise InputError(
            f"the gripper on {palm!r} has no collision shapes on its fingers "
            f"{quoted(list(moved))}: nothing can be held with it"
        )
    motions = {link: after - before for link, (before, after) in centers.items()}
    pairs = [
        (float(np.linalg.norm(motions[a] - motions[b])), a, b)
        for a, b in itertools.combinations(motions, 2)
    ]
    most, one, other = max(pairs, default=(0.0, "", ""))
    largest = max(float(np.linalg.norm(motion)) for motion in motions.values())
    if most <= largest:  # All move to one side: the palm is the other finger.
        fingers = tuple(moved), (palm,)
        before, after = (
            shapes.at(moved, palm, q).mean(axis=0)
            for q in ({n: s + _LAST * (end[n] - s) for n, s in start.items()}, end)
        )
        axis = before - after
        return fingers, axis / np.linalg.norm(axis)
    axis = motions[other] - motions[one]
    axis /= np.linalg.norm(axis)
    middle = 0.5 * (motions[other] + motions[one])
    first = [n for n in moved if n in motions and axis @ (motions[n] - middle) < 0.0]
    second = [n for n in moved if n in motions and n not in first]
    return (tuple(first), tuple(second)), axis


class _Pad(NamedTuple):
    """The pad of a finger: a point of a link."""

    link: str
    point: np.ndarray


def _measure(gripper: Gripper, shapes: _Shapes) -> Gripper:
    """Return a gripper with its pads, as its fingers' shapes show them."""
    palm = gripper.palm
    axis = _straighten(_find_pads(gripper, shapes, gripper.closing_axis))
    found = _find_pads(gripper, shapes, axis)
    pads = []
    for face, sign in zip(found.faces, (1.0, -1.0), strict=True):
        link, point = _pad(face, found.cells, sign * axis, found.across)
        X_PL = shapes.pose(link, palm, gripper.positions(found.closed))
        pads.append(_Pad(link, X_PL.inverse() @ point))
    openings = []
    for closed in np.linspace(0.0, 1.0, _OPENINGS):
        q = gripper.positions(float(closed))
        high, low = (shapes.pose(p.link, palm, q) @ p.point for p in pads)
        width = float(axis @ (high - low))
        openings.append(Opening(float(closed), width, 0.5 * (high + low)))
    along, sideways = _CELL * np.array(found.cells).T
    return dc.replace(
        gripper,
        closing_axis=axis,
        approach_axis=found.across[:, 0],
        openings=tuple(openings),
        pad=(float(np.ptp(along)) / 2.0, float(np.ptp(sideways)) / 2.0),
    )


# The height of a face over each cell [m], and the link that has it.
_Face: TypeAlias = Mapping[tuple[int, int], tuple[float, str]]


class _Facing(NamedTuple):
    """Facing parts of two fingers, seen along an axis."""

    axis: np.ndarray

    # The approach and the axis across both, shape (3, 2): the axes of the cells.
    across: np.ndarray

    # How far the gripper is closed, its faces then, and the cells of the pads.
    closed: float
    faces: tuple[_Face, _Face]
    cells: list[tuple[int, int]]


def _find_pads(gripper: Gripper, shapes: _Shapes, axis: np.ndarray) -> _Facing:
    """Return where the fingers face each other when they are as closed as can be."""
    palm = gripper.palm
    joints = {joint.child: joint for joint in gripper.robot.description.joints}
    inner = {joints[link].parent for links in gripper.fingers for link in links}
    tips = [
        [n for n in links if n not in inner or n == palm] for links in gripper.fingers
    ]
    moving = [links for links in tips if palm not in links]
    centers = [shapes.at(n, palm, gripper.closed).mean(axis=0) for n in moving]
    approach = _approach(np.mean(centers, axis=0), axis)
    across = np.column_stack([approach, np.cross(axis, approach)])
    for closed in np.linspace(1.0, 0.0, _OPENINGS):
        q = gripper.positions(float(closed))
        one = _face(shapes, tips[0], palm, q, axis, across)
        other = _face(shapes, tips[1], palm, q, -axis, across)
        if cells := _facing((one, other)):
            return _Facing(axis, across, float(closed), (one, other), cells)
    raise InputError(f"the fingers of the gripper on {palm!r} never face each other")


def _straighten(found: _Facing) -> np.ndarray:
    """Return the closing axis at right angles to the pads, if that is nearly so."""
    cells = np.array(found.cells, dtype=float) * _CELL
    table = np.column_stack([cells, np.ones(len(cells))])
    slopes = []
    for face, sign in zip(found.faces, (1.0, -1.0), strict=True):
        heights = [sign * face[cell][0] for cell in found.cells]
        slopes.append(np.linalg.lstsq(table, np.array(heights), rcond=None)[0][:2])
    tilt = np.mean(slopes, axis=0)
    if not _EVEN < np.linalg.norm(tilt) < math.tan(_SNAP):
        return found.axis
    axis = found.axis - found.across @ tilt
    return np.asarray(axis / np.linalg.norm(axis))


def _facing(
    faces: tuple[_Face, _Face],
) -> list[tuple[int, int]]:
    """Return the cells of the pads: the largest area of one gap, near the fingertips.

    Further back gears and bars may pass each other; there is nothing to hold.
    """
    one, other = faces
    gaps = {c: one[c][0] + other[c][0] for c in one.keys() & other.keys()}
    if not gaps:
        return []
    tip, back = max(i for i, _ in gaps), min(i for i, _ in min(faces, key=len))
    near = {
        c: gap
        for c, gap in gaps.items()
        if gap >= -_PAD_DEPTH and c[0] >= tip - _TIP * (tip - back)
    }
    found: list[tuple[int, int]] = []
    for least in sorted(set(near.values())):
        cells = [c for c, gap in near.items() if least <= gap <= least + _PAD_DEPTH]
        if len(cells) > len(found):
            found = cells
    return sorted(found) if len(found) >= _FEWEST else []


def _face(
    shapes: _Shapes,
    links: Sequence[str],
    palm: str,
    positions: Mapping[str, float],
    outward: np.ndarray,
    across: np.ndarray,
) -> dict[tuple[int, int], tuple[float, str]]:
    """Return the face of a finger: for each cell the smallest height, and the link."""
    face: dict[tuple[int, int], tuple[float, str]] = {}
    for link in links:
        points = shapes.at([link], palm, positions)
        cells = np.round(points @ across / _CELL).astype(int).tolist()
        for (i, j), height in zip(cells, (points @ outward).tolist(), strict=True):
            face[i, j] = min((height, link), face.get((i, j), (np.inf, "")))
    return face


def _pad(
    face: _Face,
    cells: Sequence[tuple[int, int]],
    outward: np.ndarray,
    across: np.ndarray,
) -> tuple[str, np.ndarray]:
    """Return the link of a finger's pad, and the pad's middle in the palm [m]."""
    link = Counter(face[cell][1] for cell in cells).most_common(1)[0][0]
    height = min(face[cell][0] for cell in cells)
    middle = _CELL * np.mean(cells, axis=0)
    return link, across @ middle + height * outward


def _approach(middle: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return where a gripper points: from the palm's origin to the pads.

    It is across the closing axis, and along an axis of the palm if it nearly is.
    """
    approach = middle - axis * (axis @ middle)
    approach /= np.linalg.norm(approach)
    for own in (*np.eye(3), *-np.eye(3)):
        flat = own - axis * (axis @ own)
        if (length := np.linalg.norm(flat)) > 0.5 and approach @ flat / length > np.cos(
            _SNAP
        ):
            return np.asarray(flat / length)
    return np.asarray(approach)
