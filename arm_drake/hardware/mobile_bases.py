"""What a diagram does for robots that stand on wheels."""

import dataclasses as dc
from collections.abc import Mapping, Sequence

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from arm_drake.description.axles import Axle, find_axles, report_axles, with_axles
from arm_drake.description.base_report import report_bases
from arm_drake.description.base_wheels import MobileBase, carried_inertia, find_bases
from arm_drake.description.contact_surfaces import find_friction, for_drake
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.roller_bodies import report_rollers, with_rollers
from arm_drake.description.rollers import Rollers, find_rollers
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.ground_check import report_ground
from arm_drake.hardware.wheel_slip import add_base_truths
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.plant.contact import set_friction


@dc.dataclass(frozen=True)
class RobotBases:
    """The bases of a robot, and what its plant has besides what is described."""

    robot: Robot
    bases: tuple[MobileBase, ...]
    axles: tuple[Axle, ...]
    rollers: tuple[Rollers, ...]

    # Friction coefficients that links state.
    friction: Mapping[str, float]

    @classmethod
    def of(cls, robot: Robot, *, has_physics: bool = True) -> "RobotBases":
        """Return the bases of a robot.

        Args:
            robot: The robot; one whose base is fixed has none.
            has_physics: Whether wheels roll; otherwise they need nothing for it.
        """
        description = robot.description
        bases: tuple[MobileBase, ...] = ()
        if robot.has_free_base:
            bases = find_bases(description, robot.controllers)
        rolling = bases if has_physics else ()
        axles = find_axles(description, rolling)
        rollers = find_rollers(description, robot.controllers, rolling)
        friction = find_friction(description)
        return cls(robot, bases, tuple(axles), tuple(rollers), friction)

    def describe(self) -> RobotDescription:
        """Return the robot's description with the wheels that its plant has."""
        return with_rollers(
            with_axles(self.robot.description, self.axles), self.rollers
        )

    @property
    def free_links(self) -> set[str]:
        """The bodies that nothing holds."""
        added = {axle.wheel for axle in self.axles}
        added.update(name for rim in self.rollers for name in rim.wheels)
        return self.robot.free_links | added

    @property
    def carried_inertia(self) -> dict[str, float]:
        """What wheels move on the ground [kg·m^2], by their joints."""
        return carried_inertia(self.robot.description, self.bases)

    def report(self, report: LoadReport) -> None:
        """Record what is the matter with the wheels, and what is done about it."""
        description = self.robot.description
        report_bases(description, self.bases, self.friction, report)
        report_axles(description, self.axles, report)
        report_rollers(description, self.rollers, report)

    def set_friction(
        self, plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex
    ) -> None:
        """Give the links in a finalized plant the friction that they state."""
        turning = {axle.link: [axle.wheel] for axle in self.axles}
        turning |= {rim.link: rim.wheels for rim in self.rollers}
        friction = {
            body: for_drake(mu)
            for link, mu in self.friction.items()
            for body in turning.get(link, [link])
        }
        set_friction(plant, scene_graph, model, friction)

    def add_truths(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        controllers: Sequence[LoadedController],
        report: LoadReport,
        prefix: str,
    ) -> None:
        """Add the outputs that tell odometry from the truth, see `wheel_slip`.

        Args:
            builder: Where the plant and the controllers are.
            plant: The finalized plant; the robot stands where it starts.
            scene_graph: Its scene graph.
            model: The robot's model instance.
            controllers: Its controllers.
            report: Where is recorded that it doesn't stand on the ground.
            prefix: Start of the names of systems and ports.
        """
        report_ground(
            plant,
            scene_graph,
            model,
            self.robot,
            report,
            bases=self.bases,
            axles=self.axles,
            rollers=self.rollers,
        )
        add_base_truths(
            builder,
            plant,
            scene_graph,
            model,
            self.robot.description,
            controllers,
            bases=self.bases,
            axles=self.axles,
            rollers=self.rollers,
            prefix=prefix,
        )
