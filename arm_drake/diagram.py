"""build_diagram: robots to one Drake Diagram. The table of contents of the program."""

import dataclasses as dc
from collections.abc import Sequence

from pydrake.geometry import Meshcat, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from arm_drake.contact import separate
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.controller_loading import load_controllers_of, report_motionless
from arm_drake.description.drive_gains import find_drive_gains, holds_joints
from arm_drake.description.finger_surfaces import with_surfaces
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot, list_robots
from arm_drake.description.srdf import find_disabled_collisions
from arm_drake.drive_report import report_drive, report_times
from arm_drake.drives import commanded_joints, effort_limits, make_robot_drive
from arm_drake.errors import InputError
from arm_drake.gripper_ranges import (
    find_gripper_joints,
    find_gripper_links,
    find_gripper_ranges,
)
from arm_drake.hardware import add_hardware, connect_forces
from arm_drake.kinematic import KinematicPlant
from arm_drake.loaded_controllers import command_order
from arm_drake.manager import ControllerManager
from arm_drake.mobile_bases import RobotBases
from arm_drake.mock_hardware import add_mock_hardware, make_blocks
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
from arm_drake.robot_commands import find_bare_joints, make_drive_commands, may_let_go
from arm_drake.robot_sensors import add_sensors, report_blind
from arm_drake.robot_systems import RobotSystems
from arm_drake.timing import choose_time_step
from arm_drake.visualization.meshcat import add_visualizer, show_backdrop
from arm_drake.world import World, load_world
from arm_drake.worlds.loaded_world import LoadedWorld


def build_diagram(
    robots: Robot | Sequence[Robot],
    *,
    world: World = "empty",
    options: SimulationOptions | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Return the Diagram of robots with their controllers.

    Its ports are named as in ROS: `<controller>.<topic>`, `joint_states`, `frames`;
    with several robots, `<robot>/` stands before each name. `state` is the plant's.

    Args:
        robots: One or several loaded robots.
        world: Name of a built-in world, an SDF file, or a function that adds things to
            the plant before the robots come and before it is finalized, see
            `arm_drake.world.load_world`.
        options: How to simulate.
        meshcat: Where to draw, if anywhere.

    Raises:
        InputError: If the robots can't be put together, or the world can't be used.
    """
    options = SimulationOptions() if options is None else options
    if not isinstance(options, SimulationOptions):
        raise InputError(f"options: expected SimulationOptions, got {options!r}")
    robots = list_robots(robots)
    loaded = load_world(world, [path for r in robots for path in r.package_paths])
    if options.gravity is None:
        options = dc.replace(options, gravity=loaded.gravity)
    step, periods = choose_time_step(
        options.time_step, [robot.controllers.update_rate for robot in robots]
    )
    builder = DiagramBuilder()
    systems = [
        RobotSystems(
            builder,
            robot,
            f"{robot.name}/" if len(robots) > 1 else "",
            period,
            options,
            loaded.name,
        )
        for robot, period in zip(robots, periods, strict=True)
    ]
    is_kinematic = options.preset == "kinematic"
    if is_kinematic:
        plant, scene_graph = MultibodyPlant(0.0), builder.AddSystem(SceneGraph())
        scene_graph.set_name("scene_graph")
        plant.RegisterAsSourceForSceneGraph(scene_graph)
    else:
        plant, scene_graph = add_plant(builder, step, options)
    loaded.add_to(plant)
    bases = [RobotBases.of(r, has_physics=not is_kinematic) for r in robots]
    models = [_add_model(plant, b, has_things=loaded.has_things) for b in bases]
    plant.Finalize()
    for base, model in zip(bases, models, strict=True):
        place_free_links(plant, scene_graph, model, base.robot)
        base.set_friction(plant, scene_graph, model)
    if is_kinematic:
        _add_mirrored_robots(systems, plant, scene_graph, models)
    else:
        _add_robots(systems, plant, scene_graph, models, bases)
    if meshcat is not None:
        add_visualizer(builder, scene_graph, meshcat, frame_rate=options.frame_rate)
        show_backdrop(meshcat, has_grid=loaded.has_grid, background=loaded.background)
    diagram = builder.Build()
    diagram.set_name("arm_drake")
    _report_world(diagram, loaded)
    if not is_kinematic:
        free = [base.free_links for base in bases]
        links = dict(zip(models, free, strict=True))
        overlaps = separate(diagram, plant, scene_graph, links)
        for robot, model in zip(robots, models, strict=True):
            _report_overlaps(diagram, robot, overlaps[model])
    return diagram


def _add_robots(
    systems: Sequence[RobotSystems],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    models: Sequence[ModelInstanceIndex],
    bases: Sequence[RobotBases],
) -> None:
    """Add hardware and controllers of robots that move by their dynamics."""
    builder = systems[0].builder
    forces = {}
    for system, model, base in zip(systems, models, bases, strict=True):
        robot, options = system.robot, system.options
        there = system.find_surroundings(gripper_ranges=find_gripper_ranges(robot))
        controllers, report = load_controllers_of(robot, system.period, options, there)
        if options.self_collision:
            pairs = find_disabled_collisions(robot, report)
            filter_pairs(plant, scene_graph, model, pairs)
        else:
            filter_self_collision(plant, scene_graph, model)
        holds = holds_joints(robot, report)
        drive = make_robot_drive(
            robot.description,
            robot.pose,
            options,
            plant.time_step(),
            stated=find_drive_gains(robot, report),
            bare=find_bare_joints(robot, controllers),
            lets_go=may_let_go(robot, controllers) or not holds,
            grippers={joint.name for joint in find_gripper_joints(robot)},
            carried=base.carried_inertia,
            period=system.period,
        )
        commands = make_drive_commands(robot, there, controllers, drive, holds=holds)
        report_times(plant.time_step(), system.period, options, report)
        report_drive(robot, drive, controllers, report, holds=holds)
        hardware = add_hardware(
            builder,
            plant,
            model,
            robot.description,
            prefix=system.prefix,
            drive=drive,
            initial=robot.initial_positions,
            options=options,
            has_modes=commands.has_modes,
            has_limits=commands.has_limits,
        )
        hardware = add_sensors(
            hardware, builder, plant, scene_graph, model, robot, system.prefix
        )
        poses = plant.get_body_poses_output_port()
        system.add_frames(poses, _bodies(plant, model, robot))
        system.add(hardware, there, controllers, report, commands)
        base.add_truths(
            builder, plant, scene_graph, model, controllers, report, system.prefix
        )
        if hardware.friction is not None:
            forces[model] = hardware.friction
    connect_forces(builder, plant, forces)
    push = plant.get_applied_spatial_force_input_port()
    builder.ExportInput(push, "applied_spatial_force")
    builder.ExportOutput(plant.get_state_output_port(), "state")


def _add_mirrored_robots(
    systems: Sequence[RobotSystems],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    models: Sequence[ModelInstanceIndex],
) -> None:
    """Add hardware and controllers of robots whose joints are where they should be."""
    builder = systems[0].builder
    joints = {
        system.robot.name: (
            model,
            [joint.name for joint in system.robot.description.movable_joints],
        )
        for system, model in zip(systems, models, strict=True)
    }
    kinematic = builder.AddNamedSystem("plant", KinematicPlant(plant, joints))
    for system, model in zip(systems, models, strict=True):
        robot, blocks = system.robot, make_blocks(system.robot)
        there = system.find_surroundings(blocks, find_gripper_ranges(robot))
        controllers, report = load_controllers_of(
            robot, system.period, system.options, there
        )
        for info, block in zip(robot.description.hardware, blocks, strict=True):
            done, where = "as mock_components has it", f"ros2_control {info.name!r}"
            for text in block.warnings:
                report.add("warning", "ignored", text, done, where=where)
        report_motionless(controllers, report)
        report_blind(robot, report)
        order = command_order(there, controllers)
        hardware = add_mock_hardware(
            builder, robot, blocks, order, there, system.prefix, system.period
        )
        builder.Connect(hardware.joint_motions, kinematic.GetInputPort(robot.name))
        drive = DriveCommands((), order, velocity_lead=0.0)
        poses = kinematic.GetOutputPort("body_poses")
        system.add_frames(poses, _bodies(plant, model, robot))
        system.add(hardware, there, controllers, report, drive)
    kinematic.connect_geometry(builder, scene_graph)
    builder.ExportOutput(kinematic.GetOutputPort("state"), "state")


def _bodies(
    plant: MultibodyPlant, model: ModelInstanceIndex, robot: Robot
) -> list[int]:
    """Return the indices of the bodies of a robot's links."""
    bodies = [
        plant.world_body() if link == WORLD else plant.GetBodyByName(link, model)
        for link in robot.description.links
    ]
    return [int(body.index()) for body in bodies]


def _report_world(diagram: Diagram, world: LoadedWorld) -> None:
    """Add what was not taken as written of a world to the report of each robot."""
    for system in diagram.GetSystems():
        if isinstance(system, ControllerManager):
            for entry in world.report:
                system.report.add(**dc.asdict(entry))


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


def _add_model(
    plant: MultibodyPlant, base: RobotBases, *, has_things: bool
) -> ModelInstanceIndex:
    robot, description = base.robot, base.describe()
    if has_things:
        description = with_surfaces(description, find_gripper_links(robot))
    model = add_robot_model(
        plant,
        description,
        robot.name,
        robot.pose,
        has_free_base=robot.has_free_base,
    )
    joints = commanded_joints(robot.description)
    add_actuators(plant, model, [joint.name for joint in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(robot.initial_positions))
    return model
