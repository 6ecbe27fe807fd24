"""Ports of a system that reads from the plant."""

from typing import Final

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
)

# Names of what can be read from the plant itself, and of its ports.
_PLANT: Final = {
    "body_poses": "body_poses",
    "spatial_velocities": "body_spatial_velocities",
    "spatial_accelerations": "body_spatial_accelerations",
    "reaction_forces": "reaction_forces",
    "generalized_acceleration": "generalized_acceleration",
    "contact_results": "contact_results",
}

_QUERY: Final = "geometry_query"


class PlantPorts:
    """Declares input ports of a system as they are needed, each once."""

    def __init__(
        self, system: LeafSystem, plant: MultibodyPlant, scene_graph: SceneGraph
    ) -> None:
        """Create it.

        Args:
            system: The system, under construction.
            plant: The finalized plant.
            scene_graph: Its scene graph.
        """
        self._system = system
        self._plant = plant
        self._scene_graph = scene_graph
        self._ports: dict[str, tuple[InputPort, OutputPort]] = {}

    def take(self, name: str) -> InputPort:
        """Return the input port for something that the plant tells.

        Args:
            name: "body_poses", "spatial_velocities", "spatial_accelerations",
                "reaction_forces", "generalized_acceleration", "contact_results" or
                "geometry_query".
        """
        if name not in self._ports:
            source = self._source(name)
            if source.size():
                target = self._system.DeclareVectorInputPort(name, source.size())
            else:
                target = self._system.DeclareAbstractInputPort(name, source.Allocate())
            self._ports[name] = (target, source)
        return self._ports[name][0]

    def connect(self, builder: DiagramBuilder) -> None:
        """Connect the system, which is in a builder with the plant."""
        for target, source in self._ports.values():
            builder.Connect(source, target)

    def _source(self, name: str) -> OutputPort:
        if name == _QUERY:
            return self._scene_graph.GetOutputPort("query")
        return self._plant.GetOutputPort(_PLANT[name])
