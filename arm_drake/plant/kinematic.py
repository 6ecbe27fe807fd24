"""Where links are, of joints that are where they are said to be: no physics."""

from collections.abc import Mapping, Sequence

from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    InputPort,
)
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from arm_drake.arrays import Array
from arm_drake.python_system import PythonSystem


class KinematicPlant(PythonSystem):
    """Tells where the links are, of joints that are where they are said to be.

    .. pydrake_system::

        name: KinematicPlant
        output_ports:
        - positions
        - state
        - body_poses

    ==========  =======  ====  ========================================================
    port        size     unit  meaning
    ==========  =======  ====  ========================================================
    positions   nq       rad   positions of the plant
    state       nq + nv  rad   positions and velocities of the plant
    body_poses  --       --    list of RigidTransform: pose of every body in the world
    ==========  =======  ====  ========================================================

    There is an input port for each robot, of its name: positions and velocities of its
    J joints, size 2J. Free bases stay where they start.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        robots: Mapping[str, tuple[ModelInstanceIndex, Sequence[str]]],
    ) -> None:
        """Create the system.

        Args:
            plant: The finalized plant; it is kept as long as the system.
            robots: Model instances and joints of the robots, by their names.
        """
        super().__init__()
        # What knows the robots; its own ports are not connected.
        self.plant = plant
        # Where positions are set and poses are read; nothing is kept there.
        self._scratch = plant.CreateDefaultContext()
        self._rest = plant.GetPositionsAndVelocities(self._scratch)
        nq = plant.num_positions()
        self._robots: list[tuple[InputPort, list[int]]] = []
        for name, (model, names) in robots.items():
            joints = [plant.GetJointByName(joint, model) for joint in names]
            at = [joint.position_start() for joint in joints]
            at += [nq + joint.velocity_start() for joint in joints]
            port = self.DeclareVectorInputPort(name, len(at))
            self._robots.append((port, at))
        inputs = {self.all_input_ports_ticket()}
        self.DeclareVectorOutputPort(
            "positions",
            nq,
            lambda context, output: output.SetFromVector(self._evaluate(context)[:nq]),
            inputs,
        )
        self.DeclareVectorOutputPort(
            "state",
            len(self._rest),
            lambda context, output: output.SetFromVector(self._evaluate(context)),
            inputs,
        )
        self.DeclareAbstractOutputPort(
            "body_poses",
            lambda: AbstractValue.Make([RigidTransform()]),
            self._calc_body_poses,
            inputs,
        )

    def _evaluate(self, context: Context) -> Array:
        state = self._rest.copy()
        for port, at in self._robots:
            state[at] = port.Eval(context)
        return state

    def _calc_body_poses(self, context: Context, output: AbstractValue) -> None:
        plant, scratch = self.plant, self._scratch
        plant.SetPositionsAndVelocities(scratch, self._evaluate(context))
        bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
        output.set_value([plant.EvalBodyPoseInWorld(scratch, body) for body in bodies])

    def connect_geometry(
        self, builder: DiagramBuilder, scene_graph: SceneGraph
    ) -> None:
        """Move the shapes of the plant along.

        Args:
            builder: Where this system is.
            scene_graph: The scene graph that the plant is registered with.
        """
        shapes = builder.AddSystem(MultibodyPositionToGeometryPose(self.plant))
        builder.Connect(self.GetOutputPort("positions"), shapes.get_input_port())
        source = self.plant.get_source_id()
        builder.Connect(
            shapes.get_output_port(), scene_graph.get_source_pose_port(source)
        )
