"""build_diagram: robots to one Drake Diagram. The table of contents of the program."""

import dataclasses as dc
from collections.abc import Sequence

from pydrake.geometry import Meshcat, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
)
from pydrake.systems.primitives import VectorLogSink, ZeroOrderHold

from arm_drake import interfaces
from arm_drake.contact import separate
from arm_drake.controller_loading import load_controllers_of
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot, list_robots
from arm_drake.description.srdf import find_disabled_collisions
from arm_drake.drives import commanded_joints, effort_limits
from arm_drake.frames import LinkFrames
from arm_drake.hardware import (
    Hardware,
    add_hardware,
    connect_commands,
    connect_forces,
)
from arm_drake.manager import ControllerManager
from arm_drake.options import SimulationOptions
from arm_drake.placement import place_free_links
from arm_drake.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    filter_pairs,
    filter_self_collision,
    set_initial_positions,
)
from arm_drake.timing import choose_time_step
from arm_drake.visualization.meshcat import add_visualizer
from arm_drake.world import add_world


def build_diagram(
    robots: Robot | Sequence[Robot],
    *,
    world: str = "empty",
    options: SimulationOptions | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Return the Diagram of robots with their controllers.

    Its ports are named as in ROS: `<controller>.<topic>`, `joint_states`, `frames`;
    with several robots, `<robot>/` stands before each name. `state` is the plant's.

    Args:
        robots: One or several loaded robots.
        world: Name of a built-in world.
        options: How to simulate.
        meshcat: Where to draw, if anywhere.

    Raises:
        InputError: If the robots can't be put together.
    """
    options = SimulationOptions() if options is None else options
    robots = list_robots(robots)
    step, periods = choose_time_step(
        options.time_step, [robot.controllers.update_rate for robot in robots]
    )
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, step, options)
    add_world(plant, world)
    models = [_add_model(plant, robot) for robot in robots]
    plant.Finalize()
    forces = {}
    for robot, model, period in zip(robots, models, periods, strict=True):
        added = _RobotInDiagram(robot, model, period, len(robots) > 1, options)
        hardware = added.add(builder, plant, scene_graph)
        if hardware.friction is not None:
            forces[model] = hardware.friction
    connect_forces(builder, plant, forces)
    builder.ExportOutput(plant.get_state_output_port(), "state")
    if meshcat is not None:
        add_visualizer(builder, scene_graph, meshcat)
    diagram = builder.Build()
    diagram.set_name("arm_drake")
    free = [robot.free_links for robot in robots]
    overlaps = separate(
        diagram, plant, scene_graph, dict(zip(models, free, strict=True))
    )
    for robot, model in zip(robots, models, strict=True):
        _report_overlaps(diagram, robot, overlaps[model])
    return diagram


def _report_overlaps(diagram: Diagram, robot: Robot, overlaps: list[str]) -> None:
    if not overlaps:
        return
    for system in diagram.GetSystems():
        if isinstance(system, ControllerManager) and system.robot is robot:
            system.report.add(
                "warning",
                "repair",
                f"links overlap in the initial pose: {', '.join(overlaps)}",
                "they pass through each other",
                file=robot.description.file,
            )


def _add_model(plant: MultibodyPlant, robot: Robot) -> ModelInstanceIndex:
    model = add_robot_model(
        plant,
        robot.description,
        robot.name,
        robot.pose,
        has_free_base=robot.has_free_base,
    )
    joints = commanded_joints(robot.description)
    add_actuators(plant, model, [joint.name for joint in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(robot.initial_positions))
    return model


@dc.dataclass(frozen=True)
class _RobotInDiagram:
    """One robot on its way into a diagram."""

    robot: Robot
    model: ModelInstanceIndex

    # Period of its controller manager [s].
    period: float

    # Whether its names start with the robot's.
    has_prefix: bool

    options: SimulationOptions

    @property
    def prefix(self) -> str:
        return f"{self.robot.name}/" if self.has_prefix else ""

    @property
    def log_period(self) -> float:
        rate = self.options.log_rate
        return self.period if rate is None else 1.0 / rate

    def add(
        self, builder: DiagramBuilder, plant: MultibodyPlant, scene_graph: SceneGraph
    ) -> Hardware:
        """Add hardware and controllers, connect them, export their ports."""
        robot, prefix = self.robot, self.prefix
        place_free_links(plant, scene_graph, self.model, robot)
        controllers, report = load_controllers_of(robot, self.period, self.options)
        if self.options.self_collision:
            pairs = find_disabled_collisions(robot, report)
            filter_pairs(plant, scene_graph, self.model, pairs)
        else:
            filter_self_collision(plant, scene_graph, self.model)
        hardware = add_hardware(
            builder,
            plant,
            self.model,
            robot.description,
            prefix=prefix,
            pose=robot.pose,
            initial=robot.initial_positions,
            options=self.options,
        )
        builder.AddNamedSystem(
            f"{prefix}controller_manager",
            ControllerManager(
                robot,
                controllers,
                report,
                prefix=prefix,
                period=self.period,
                log_period=self.log_period,
                servo_plant=hardware.servo_plant,
            ),
        )
        self._record(builder, hardware.joint_states)
        frames = self._add_frames(builder, plant)
        commands = []
        for controller in controllers:
            if controller.state == "active" and controller.system is not None:
                self._add_controller(
                    builder, controller.name, controller.system, hardware
                )
                commands += _commands(controller.system)
        connect_commands(builder, hardware, commands, prefix)
        builder.ExportOutput(hardware.joint_states, f"{prefix}joint_states")
        builder.ExportOutput(frames, f"{prefix}frames")
        return hardware

    def _add_controller(
        self,
        builder: DiagramBuilder,
        name: str,
        system: ControllerInterface,
        hardware: Hardware,
    ) -> None:
        """Add an active controller, connect what it reads, export its topics."""
        full_name = f"{self.prefix}{name}"
        # Any name is legal in ROS, also that of one of our own systems.
        is_taken = builder.HasSubsystemNamed(full_name)
        builder.AddNamedSystem(f"{full_name}:" if is_taken else full_name, system)
        measured = (
            hardware.joint_states if system.reads_effort else hardware.joint_motions
        )
        if system.is_sampled:
            measured = self._sample(builder, measured, system.params.period)
        builder.Connect(measured, system.GetInputPort(interfaces.STATE_PORT))
        _export_topics(builder, system, full_name)
        if system.command_interfaces:
            # What a tick commands is the reference of the next one.
            command = system.GetOutputPort(interfaces.COMMAND_PORT)
            self._log(builder, command, f"{name}/reference", system.params.period)

    def _record(self, builder: DiagramBuilder, joint_states: OutputPort) -> None:
        """Record the state of the joints at every tick, with the efforts it causes."""
        period = self.log_period
        # Sampled after the tick and logged before the next one: a log of the vector
        # itself would compute the servo with the old command, once more.
        sample = self._sample(builder, joint_states, period)
        self._log(builder, sample, "joint_states", period)

    def _sample(
        self, builder: DiagramBuilder, joint_states: OutputPort, period: float
    ) -> OutputPort:
        """Return the state of the joints, sampled and held; one system per period."""
        name = f"{self.prefix}sample"
        if period != self.log_period:
            name += f":{period}"
        if builder.HasSubsystemNamed(name):
            return builder.GetSubsystemByName(name).get_output_port()
        sample = builder.AddNamedSystem(
            name, ZeroOrderHold(period, joint_states.size())
        )
        builder.Connect(joint_states, sample.get_input_port())
        return sample.get_output_port()

    def _log(
        self, builder: DiagramBuilder, port: OutputPort, name: str, period: float
    ) -> None:
        log = builder.AddNamedSystem(
            f"{self.prefix}log:{name}", VectorLogSink(port.size(), period)
        )
        builder.Connect(port, log.get_input_port())

    def _add_frames(self, builder: DiagramBuilder, plant: MultibodyPlant) -> OutputPort:
        """Add the poses of the links."""
        bodies = [
            plant.world_body()
            if link == WORLD
            else plant.GetBodyByName(link, self.model)
            for link in self.robot.description.links
        ]
        frames = builder.AddNamedSystem(
            f"{self.prefix}frames", LinkFrames([int(body.index()) for body in bodies])
        )
        builder.Connect(
            plant.get_body_poses_output_port(), frames.GetInputPort("body_poses")
        )
        return frames.GetOutputPort("frames")


def _commands(
    system: ControllerInterface,
) -> list[tuple[OutputPort, tuple[str, ...]]]:
    """Return the port of a controller's commands, and the joints they are for."""
    if not system.command_interfaces:
        return []
    joints = tuple(name.rpartition("/")[0] for name in system.command_interfaces)
    return [(system.GetOutputPort(interfaces.COMMAND_PORT), joints)]


def _export_topics(builder: DiagramBuilder, system: LeafSystem, name: str) -> None:
    """Export the ports of a controller that are topics: all but its interfaces."""
    for index in range(system.num_input_ports()):
        port = system.get_input_port(index)
        if port.get_name() != interfaces.STATE_PORT:
            builder.ExportInput(port, f"{name}.{port.get_name()}")
    for index in range(system.num_output_ports()):
        output = system.get_output_port(index)
        if output.get_name() != interfaces.COMMAND_PORT:
            builder.ExportOutput(output, f"{name}.{output.get_name()}")
