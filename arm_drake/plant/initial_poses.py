"""Initial poses of free bases and loose links, and the log of how they move.

A base rests on the points that carry its centre of mass. Gazebo drops a robot, and by
the time its controllers are loaded it has settled. Here they drive off at t = 0: a base
whose caster is lower than its wheels would be driven by wheels in the air, and rock.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.solvers import MathematicalProgram, Solve
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import VectorLogSink

from arm_drake.arrays import Array
from arm_drake.description.joints import FREE_TYPES, WORLD, from_the_root
from arm_drake.description.robot import Robot
from arm_drake.plant.contact import box_corners, hull_vertices
from arm_drake.plant.plant import origin_transform, transform_of

# Name of the log, after the prefix of its robot.
_LOG = "log:state"


def log_free_poses(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    robot: Robot,
    *,
    prefix: str,
    period: float,
) -> None:
    """Record, each period [s], the state of a robot that has free links."""
    if any(_free_links(plant, robot)):
        state = plant.get_state_output_port(model)
        log = VectorLogSink(state.size(), period)
        builder.AddNamedSystem(f"{prefix}{_LOG}", log)
        builder.Connect(state, log.get_input_port())


def read_free_poses(
    diagram: Diagram,
    context: Context,
    robot: Robot,
    time: Array,
    *,
    prefix: str,
    period: float,
) -> dict[str, Array]:
    """Return the recorded poses of free links at times [s], shape (N,).

    They are x, y, z [m], quaternion w, x, y, z in the world by link, shape (N, 7), NaN
    where they weren't recorded.
    """
    if not diagram.HasSubsystemNamed(f"{prefix}{_LOG}"):
        return {}
    plant = diagram.GetSubsystemByName("plant")
    log = diagram.GetSubsystemByName(f"{prefix}{_LOG}").FindLog(context)
    ticks = np.round(log.sample_times() / period).astype(np.int64)
    # Where a tick was logged twice the latest counts.
    known, at = np.unique(ticks[::-1], return_index=True)
    requested = np.round(time / period).astype(np.int64)
    model = plant.GetModelInstanceByName(robot.name)
    order = plant.GetPositionsFromArray(model, np.arange(plant.num_positions()))
    poses = {}
    rows = np.minimum(np.searchsorted(known, requested), max(len(known) - 1, 0))
    for link in _free_links(plant, robot):
        # A quaternion, then the position.
        first = plant.GetBodyByName(link, model).floating_positions_start()
        columns = [int(np.flatnonzero(order == first + k)[0]) for k in range(7)]
        pose = np.full((len(time), 7), np.nan)
        if len(known):
            is_logged = known[rows] == requested
            columns = columns[4:] + columns[:4]
            logged = log.data()[columns][:, ::-1].T[at]
            pose[is_logged] = logged[rows[is_logged]]
            # Drake's state lets the length drift, and takes the direction alone.
            pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        poses[link] = pose
    return poses


def _free_links(plant: MultibodyPlant, robot: Robot) -> Iterator[str]:
    """Yield the links of a robot that may be anywhere."""
    description = robot.description
    names = [description.base] if robot.has_free_base else []
    names += [j.child for j in description.joints if j.type in FREE_TYPES]
    model = plant.GetModelInstanceByName(robot.name)
    for name in names:
        # A planar joint has no pose of its own in Drake's state.
        if plant.GetBodyByName(name, model).is_floating_base_body():
            yield name


# A base that would have to tilt by more than this slope isn't made to stand like this.
_LARGEST_SLOPE = 0.2

# Slopes that are rounding.
_LEVEL = 1e-6

# Rounds, and change of a slope, at which the search for the ground ends.
_ROUNDS = 20
_SAME = 1e-9


class RestingShape(NamedTuple):
    """A collision shape of a robot, in the frame of its base."""

    shape: Shape

    # Its pose.
    X_BG: RigidTransform

    # Corners of its hull in its own frame [m], shape (n, 3); of a mesh or box.
    corners: Array


def resting_shape(
    inspector: SceneGraphInspector, geometry: GeometryId, X_BG: RigidTransform
) -> RestingShape:
    """Return a collision shape of pose X_BG, ready to find its lowest points."""
    shape = inspector.GetShape(geometry)
    corners = np.empty((0, 3))
    if not isinstance(shape, Sphere | Capsule | Cylinder | Ellipsoid):
        hull = None if isinstance(shape, Box) else inspector.GetConvexHull(geometry)
        box = inspector.GetObbInGeometryFrame(geometry)
        if hull is not None:
            corners = hull_vertices(hull)
        elif box is not None:
            corners = box_corners(box)
        else:  # A half space, whose highest points its origin is one of.
            corners = np.zeros((1, 3))
    return RestingShape(shape, X_BG, corners)


def lowest_points(placed: RestingShape, up: Array) -> Array:
    """Return points of a shape, the lowest ones among them [m], shape (n, 3).

    `up` is the direction away from the ground, of length 1.
    """
    return np.array([placed.X_BG @ point for point in _points(placed, up)])


def _points(placed: RestingShape, up: Array) -> Iterator[Array]:
    shape, down = placed.shape, -(placed.X_BG.rotation().matrix().T @ up)
    if isinstance(shape, Sphere):
        yield shape.radius() * down
    elif isinstance(shape, Ellipsoid):
        axes = np.array([shape.a(), shape.b(), shape.c()])
        yield axes**2 * down / np.linalg.norm(axes * down)
    elif isinstance(shape, Capsule | Cylinder):
        axis = np.array([0.0, 0.0, shape.length() / 2.0])
        across = down * [1.0, 1.0, 0.0]
        length = np.linalg.norm(across)
        # Of a cylinder that stands, all points of the rim.
        rim = across / length if length > _LEVEL else np.array([1.0, 0.0, 0.0])
        turned = np.array([-rim[1], rim[0], 0.0])
        is_round = isinstance(shape, Capsule)
        directions = [down] if is_round else [rim, turned, -rim, -turned]
        for end in (-axis, axis):
            for direction in directions:
                yield end + shape.radius() * direction
    else:
        yield from placed.corners


def lowest_height(placed: RestingShape) -> float:
    """Return the height of a shape's lowest point [m]."""
    return float(lowest_points(placed, np.array([0.0, 0.0, 1.0]))[:, 2].min())


def rest_on_ground(
    shapes: Sequence[RestingShape], center_of_mass: Array
) -> RigidTransform:
    """Return the pose of a base that rests on the ground z = 0.

    Its joints stand still. Of all planes below the shapes, the ground is the one that
    is highest below the centre of mass; there the base has its least energy. If that
    asks for a large tilt, or the base falls over, it stays level on its lowest point.
    """
    if not shapes:
        return RigidTransform()
    lowest = min(lowest_height(placed) for placed in shapes)
    level = RigidTransform([0.0, 0.0, -lowest])
    plane, foot = np.array([0.0, 0.0, lowest]), center_of_mass[:2]
    points = np.empty((0, 3))
    for _ in range(_ROUNDS):
        up = _normal(plane)
        new = [lowest_points(placed, up) for placed in shapes]
        points = np.vstack([points, *new])
        found = _highest_plane_below(points, foot)
        if found is None:
            return level
        change, plane = np.abs(found - plane).max(), found
        up = _normal(plane)
        height = (center_of_mass - [0.0, 0.0, plane[2]]) @ up
        foot = (center_of_mass - height * up)[:2]
        if change < _SAME:
            break
    else:
        return level
    if np.abs(plane[:2]).max() < _LEVEL:
        return level
    forwards = np.array([1.0, 0.0, 0.0]) - up[0] * up
    forwards /= np.linalg.norm(forwards)
    R_BW = np.column_stack([forwards, np.cross(up, forwards), up])
    return RigidTransform(RotationMatrix(R_BW.T), [0.0, 0.0, -plane[2] * up[2]])


def _normal(plane: Array) -> Array:
    """Return the direction away from a plane z = a x + b y + c, (a, b, c)."""
    normal = np.array([-plane[0], -plane[1], 1.0])
    return normal / np.linalg.norm(normal)


def _highest_plane_below(points: Array, foot: Array) -> Array | None:
    """Return a, b, c of the highest plane z = a x + b y + c below points at `foot`."""
    program = MathematicalProgram()
    plane = program.NewContinuousVariables(3, "plane")
    below = np.column_stack([points[:, :2], np.ones(len(points))])
    program.AddLinearConstraint(
        below, np.full(len(points), -np.inf), points[:, 2], plane
    )
    limits = np.array([_LARGEST_SLOPE] * 2 + [np.inf])
    program.AddBoundingBoxConstraint(-limits, limits, plane)
    program.AddLinearCost(-np.array([*foot, 1.0]), 0.0, plane)
    result = Solve(program)
    found = np.asarray(result.GetSolution(plane))
    is_steep = np.abs(found[:2]).max() > 0.999 * _LARGEST_SLOPE
    return None if is_steep or not result.is_success() else found


def place_free_links(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    robot: Robot,
) -> None:
    """Set where a free base starts, and links on floating joints.

    Without a pose, a free base starts where it rests on the ground, z = 0. Floating
    links start where their joints' origins are; Drake makes
    them free bodies, at the world's origin.
    """
    description, X_WB = robot.description, transform_of(robot.pose)

    def place(link: str, X_WL: RigidTransform) -> None:
        body = plant.GetBodyByName(link, model)
        plant.SetDefaultFloatingBaseBodyPose(body, X_WL)

    def place_floating() -> None:
        for info in from_the_root(description.joints):
            if info.type != "floating":
                continue
            X_WP = X_WB
            if info.parent != WORLD:
                context = plant.CreateDefaultContext()
                parent = plant.GetBodyByName(info.parent, model)
                X_WP = plant.EvalBodyPoseInWorld(context, parent)
            place(info.child, X_WP @ origin_transform(info.origin))

    if robot.has_free_base:
        place(description.base, X_WB)
    place_floating()
    if robot.has_free_base and robot.pose is None:
        place(description.base, _resting_pose(plant, scene_graph, model))
        place_floating()


def find_shapes(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    bodies: Iterable[BodyIndex],
    name: str = "",
) -> list[RestingShape]:
    """Return the collision shapes of bodies as they stand, or those of one name."""
    context, inspector = plant.CreateDefaultContext(), scene_graph.model_inspector()
    shapes = []
    for index in bodies:
        body = plant.get_body(index)
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            if name in ("", inspector.GetName(geometry).rpartition("::")[2]):
                X_WG = X_WB @ inspector.GetPoseInFrame(geometry)
                shapes.append(resting_shape(inspector, geometry, X_WG))
    return shapes


def _resting_pose(
    plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex
) -> RigidTransform:
    """Return how a base at the world's origin comes to rest on the ground."""
    bodies = plant.GetBodyIndices(model)
    shapes = find_shapes(plant, scene_graph, bodies)
    context = plant.CreateDefaultContext()
    center = plant.CalcCenterOfMassPositionInWorld(context, [model])
    return rest_on_ground(shapes, center)
