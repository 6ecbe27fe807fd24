"""Where what nothing holds starts: free bases, links on floating joints."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex

from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.description.tree import from_the_root
from arm_drake.plant.plant import origin_of, transform_of
from arm_drake.plant.resting import PlacedShape, placed_shape, rest_on_ground


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
        place(description.base, _resting_pose(plant, scene_graph, model))
        place_floating()


def find_shapes(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    bodies: Iterable[BodyIndex],
    X_AW: RigidTransform,
) -> list[PlacedShape]:
    """Return the collision shapes of bodies as they stand by default.

    Args:
        plant: The finalized plant.
        scene_graph: Its scene graph.
        bodies: The bodies.
        X_AW: Pose of the world in the frame in which they are wanted.
    """
    context, inspector = plant.CreateDefaultContext(), scene_graph.model_inspector()
    shapes = []
    for index in bodies:
        body = plant.get_body(index)
        X_AB = X_AW @ plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            X_AG = X_AB @ inspector.GetPoseInFrame(geometry)
            shapes.append(placed_shape(inspector, geometry, X_AG))
    return shapes


def _resting_pose(
    plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex
) -> RigidTransform:
    """Return how a base at the world's origin comes to rest on the ground."""
    bodies = plant.GetBodyIndices(model)
    shapes = find_shapes(plant, scene_graph, bodies, RigidTransform())
    context = plant.CreateDefaultContext()
    center = plant.CalcCenterOfMassPositionInWorld(context, [model])
    return rest_on_ground(shapes, center)
