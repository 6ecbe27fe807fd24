"""A robot in a pose, drawn without physics."""

from collections.abc import Mapping

from pydrake.geometry import Meshcat, QueryObject
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.options import SimulationOptions
from arm_drake.plant.initial_poses import place_free_links
from arm_drake.plant.plant import (
    add_plant,
    add_robot_model,
    add_visualizer,
    set_initial_positions,
)
from arm_drake.visualization.ghost import BLUE, Ghost
from arm_drake.visualization.meshcat import show_ground

# Nothing moves, but only discrete plants know joints that follow others.
_TIME_STEP = 0.001


class RobotScene:
    """A robot's plant, and what of it Meshcat shows."""

    def __init__(self, meshcat: Meshcat, robot: Robot) -> None:
        """Create it, in the robot's initial positions, with nothing drawn yet."""
        self.robot = robot
        self._meshcat = meshcat
        builder = DiagramBuilder()
        self.plant, self.scene_graph = add_plant(
            builder, _TIME_STEP, SimulationOptions()
        )
        self.model = add_robot_model(
            self.plant,
            robot.description,
            robot.name,
            robot.pose,
            has_free_base=robot.has_free_base,
        )
        set_initial_positions(self.plant, self.model, dict(robot.initial_positions))
        self.plant.Finalize()
        place_free_links(self.plant, self.scene_graph, self.model, robot)
        add_visualizer(builder, self.scene_graph, meshcat)
        show_ground(meshcat)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self._context)

    @property
    def query(self) -> QueryObject:
        """What there is, and where."""
        port = self.scene_graph.get_query_output_port()
        return port.Eval(self.scene_graph.GetMyContextFromRoot(self._context))

    def set_positions(self, positions: Mapping[str, float]) -> None:
        """Put joints somewhere [rad] or [m], those that follow among them."""
        q = self.plant.GetPositions(self.context)
        for name, position in positions.items():
            joint = self.plant.GetJointByName(name, self.model)
            q[joint.position_start()] = position
        self.plant.SetPositions(self.context, q)

    def link_poses(self) -> dict[str, RigidTransform]:
        """Return the pose of every link in the world, by the link's name."""
        return {
            link: self.plant.EvalBodyPoseInWorld(
                self.context, self.plant.GetBodyByName(link, self.model)
            )
            for link in self.robot.description.links
            if link != WORLD
        }

    def make_ghost(
        self, name: str | None = None, color: tuple[float, float, float] = BLUE
    ) -> Ghost:
        """Return a ghost of the robot, which stands where the robot does."""
        return Ghost(
            self._meshcat,
            self.plant,
            self.scene_graph,
            self.model,
            name or self.robot.name,
            self.robot.description,
            base_context=self.context,
            color=color,
        )

    def set_free_pose(self, link: str, X_WL: RigidTransform) -> None:
        """Put a link somewhere that no joint holds."""
        body = self.plant.GetBodyByName(link, self.model)
        self.plant.SetFloatingBaseBodyPoseInWorldFrame(self.context, body, X_WL)

    def publish(self, time: float = 0.0) -> None:
        """Draw visual shapes where they are now, at a recording's time [s]."""
        self._context.SetTime(time)
        self._diagram.ForcedPublish(self._context)
