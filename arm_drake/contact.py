"""What touches what before anything moves."""

from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram

# What overlaps less than this only touches [m].
_SMALLEST_OVERLAP = 1e-3


def separate(
    diagram: Diagram,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    models: dict[ModelInstanceIndex, bool],
) -> dict[ModelInstanceIndex, list[str]]:
    """Let bodies pass through each other that overlap in the initial pose.

    Contact would throw them apart: hulls are larger than meshes, and many robots are
    drawn with a part in the ground. A robot with a free base keeps its contact with
    the world, which carries it.

    Args:
        diagram: Diagram with the plant and its scene graph.
        plant: The finalized plant.
        scene_graph: Its scene graph.
        models: The robots' model instances, and whether their base is free.

    Returns:
        The links of each robot that overlap something.
    """
    context = diagram.CreateDefaultContext()
    port = plant.get_geometry_query_input_port()
    query = port.Eval(plant.GetMyContextFromRoot(context))
    inspector = query.inspector()
    links: dict[ModelInstanceIndex, set[str]] = {model: set() for model in models}
    for pair in query.ComputePointPairPenetration():
        geometries = (pair.id_A, pair.id_B)
        bodies = [
            plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            for geometry in geometries
        ]
        instances = [body.model_instance() for body in bodies]
        is_carried = [models.get(instance) for instance in instances]
        if pair.depth < _SMALLEST_OVERLAP or (
            True in is_carried and None in is_carried
        ):
            continue
        declaration = CollisionFilterDeclaration()
        declaration.ExcludeBetween(*(GeometrySet([g]) for g in geometries))
        scene_graph.collision_filter_manager().Apply(declaration)
        for body, instance in zip(bodies, instances, strict=True):
            if instance in links:
                links[instance].add(body.name())
    return {model: sorted(names) for model, names in links.items()}
