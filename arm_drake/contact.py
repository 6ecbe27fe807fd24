"""What touches what before anything moves."""

from collections.abc import Collection, Mapping, Sequence

from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Diagram

# What overlaps less than this only touches [m].
_SMALLEST_OVERLAP = 1e-3


def separate(
    diagram: Diagram,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    free_links: Mapping[ModelInstanceIndex, Collection[str]],
) -> dict[ModelInstanceIndex, list[str]]:
    """Let bodies pass through each other that overlap in the initial pose.

    Contact would throw them apart: hulls are larger than meshes, and many robots are
    drawn with a part in the ground. Links that nothing holds keep their contact with
    the world, which carries them.

    Args:
        diagram: Diagram with the plant and its scene graph.
        plant: The finalized plant.
        scene_graph: Its scene graph.
        free_links: The robots' model instances, and their links that nothing holds.

    Returns:
        What overlaps, of each robot, such as "link1 and the world".
    """
    context = diagram.CreateDefaultContext()
    port = plant.get_geometry_query_input_port()
    query = port.Eval(plant.GetMyContextFromRoot(context))
    inspector = query.inspector()
    found: dict[ModelInstanceIndex, set[str]] = {model: set() for model in free_links}
    for pair in query.ComputePointPairPenetration():
        geometries = (pair.id_A, pair.id_B)
        bodies = [
            plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            for geometry in geometries
        ]
        if pair.depth < _SMALLEST_OVERLAP or _is_carried(bodies, free_links):
            continue
        declaration = CollisionFilterDeclaration()
        declaration.ExcludeBetween(*(GeometrySet([g]) for g in geometries))
        scene_graph.collision_filter_manager().Apply(declaration)
        for body, other in (bodies, bodies[::-1]):
            model = body.model_instance()
            if model in found:
                is_robot = other.model_instance() in found
                found[model].add(
                    f"{body.name()} and {other.name() if is_robot else 'the world'}"
                )
    return {model: sorted(texts) for model, texts in found.items()}


def _is_carried(
    bodies: Sequence[RigidBody],
    free_links: Mapping[ModelInstanceIndex, Collection[str]],
) -> bool:
    """Return whether the world carries a link that nothing else holds."""
    free = [b.name() in free_links.get(b.model_instance(), ()) for b in bodies]
    robots = [b.model_instance() in free_links for b in bodies]
    return any(free) and not all(robots)
