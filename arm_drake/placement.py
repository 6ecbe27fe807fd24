"""Where what nothing holds starts: free bases, links on floating joints."""

import xml.etree.ElementTree as ET

import numpy as np
from pydrake.geometry import (
    Capsule,
    Cylinder,
    GeometryId,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.description.tree import from_the_root
from arm_drake.plant import origin_of, transform_of


def place_free_links(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    robot: Robot,
) -> None:
    """Set where a free base starts, and links on floating joints.

    Without a pose, a free base starts so that the robot's lowest collision point is on
    the ground, z = 0. Floating links start where their joints' origins are; Drake makes
    them free bodies, at the world's origin.

    Args:
        plant: The finalized plant.
        scene_graph: Its scene graph.
        model: The robot's model instance.
        robot: The robot.
    """
    description, X_WB = robot.description, transform_of(robot.pose)
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    floating = {j.get("name", ""): j for j in root.iterfind("joint[@type='floating']")}

    def place(link: str, X_WL: RigidTransform) -> None:
        body = plant.GetBodyByName(link, model)
        plant.SetDefaultFloatingBaseBodyPose(body, X_WL)

    def place_floating() -> None:
        for info in from_the_root(description.joints):
            if info.name not in floating:
                continue
            X_WP = X_WB
            if info.parent != WORLD:
                context = plant.CreateDefaultContext()
                parent = plant.GetBodyByName(info.parent, model)
                X_WP = plant.EvalBodyPoseInWorld(context, parent)
            place(info.child, X_WP @ origin_of(floating[info.name]))

    if robot.has_free_base:
        place(description.base, X_WB)
    place_floating()
    if robot.has_free_base and robot.pose is None:
        lowest = _lowest_point(plant, scene_graph, model)
        place(description.base, RigidTransform([0.0, 0.0, -lowest]))
        place_floating()


def _lowest_point(
    plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex
) -> float:
    """Return the height of a robot's lowest collision point [m]; 0 if it has none."""
    context = plant.CreateDefaultContext()
    inspector = scene_graph.model_inspector()
    heights = []
    for index in plant.GetBodyIndices(model):
        body = plant.get_body(index)
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            X_WG = X_WB @ inspector.GetPoseInFrame(geometry)
            heights.append(_lowest_point_of(inspector, geometry, X_WG))
    return float(min(heights, default=0.0))


def _lowest_point_of(
    inspector: SceneGraphInspector, geometry: GeometryId, X_WG: RigidTransform
) -> float:
    """Return the height of a shape's lowest point [m]."""
    shape, z = inspector.GetShape(geometry), X_WG.translation()[2]
    along = abs(X_WG.rotation().matrix()[2, 2])  # Of the shape's axis, upwards.
    if isinstance(shape, Sphere):
        return float(z - shape.radius())
    if isinstance(shape, Capsule):
        return float(z - along * shape.length() / 2.0 - shape.radius())
    if isinstance(shape, Cylinder):
        across = np.sqrt(max(0.0, 1.0 - along**2))
        return float(z - along * shape.length() / 2.0 - across * shape.radius())
    hull = inspector.GetConvexHull(geometry)
    if hull is not None:
        corners = [X_WG @ hull.vertex(i) for i in range(hull.num_vertices())]
        return float(min(corner[2] for corner in corners))
    box = inspector.GetObbInGeometryFrame(geometry)
    X_WO = X_WG @ box.pose()
    reach = np.abs(X_WO.rotation().matrix()[2]) @ box.half_width()
    return float(X_WO.translation()[2] - reach)
