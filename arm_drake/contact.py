"""What touches what before anything moves."""

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram


def links_in_contact(
    diagram: Diagram, plant: MultibodyPlant, model: ModelInstanceIndex
) -> list[str]:
    """Return the links of a robot that touch the world or another robot at the start.

    Args:
        diagram: Diagram with the plant and its scene graph.
        plant: The finalized plant.
        model: The robot's model instance.
    """
    context: Context = diagram.CreateDefaultContext()
    port = plant.get_geometry_query_input_port()
    query = port.Eval(plant.GetMyContextFromRoot(context))
    inspector = query.inspector()
    links = set()
    for pair in query.ComputePointPairPenetration():
        for geometry in (pair.id_A, pair.id_B):
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            if body.model_instance() == model:
                links.add(body.name())
    return sorted(links)
