"""build_diagram: robots to one Drake Diagram. The table of contents of the program."""

import dataclasses as dc
from collections.abc import Sequence
from typing import NamedTuple

from pydrake.geometry import Meshcat, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.generic_system import GenericSystem
from arm_drake.description.contact_surfaces import with_surfaces
from arm_drake.description.drive_gains import find_drive_gains, holds_joints
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot, list_robots
from arm_drake.description.srdf import find_disabled_collisions
from arm_drake.errors import InputError
from arm_drake.hardware.drive_report import report_drive, report_friction, report_times
from arm_drake.hardware.drives import (
    commanded_joints,
    effort_limits,
    find_bare_joints,
    make_drive_commands,
    make_robot_drive,
    may_let_go,
)
from arm_drake.hardware.hardware import (
    add_hardware,
    add_sensors,
    connect_forces,
    report_blind,
)
from arm_drake.hardware.mobile_bases import RobotBases
from arm_drake.hardware.mock_hardware import add_mock_hardware
from arm_drake.hardware.presets import (
    find_obstacles,
    find_world_obstacles,
    report_fallback,
)
from arm_drake.hardware.robot_systems import RobotSystems
from arm_drake.manager import ControllerManager
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.loaded_controllers import LoadedController, command_order
from arm_drake.manager.loading import report_motionless
from arm_drake.manager.robot_controllers import load_controllers_of
from arm_drake.options import SimulationOptions
from arm_drake.plant.contact import separate
from arm_drake.plant.initial_poses import log_free_poses, place_free_links
from arm_drake.plant.joint_ranges import (
    find_gripper_joints,
    find_gripper_links,
    find_gripper_ranges,
)
from arm_drake.plant.kinematics import KinematicPlant
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    add_visualizer,
    filter_pairs,
    filter_self_collision,
    link_bodies,
    set_initial_positions,
)
from arm_drake.simulation.recording import BuildInfo, add_build_info
from arm_drake.timing import choose_time_step, has_rate
from arm_drake.worlds.sdf_world import LoadedWorld, show_backdrop
from arm_drake.worlds.world import World, load_world


class RobotParts(NamedTuple):
    """A robot's controllers, which are in no builder yet."""

    # What the robot offers them.
    there: Surroundings

    controllers: tuple[LoadedController, ...]

    # Its load report, with what they lack.
    report: LoadReport

    # Hardware that mirrors commands, if that is what it has.
    blocks: Sequence[GenericSystem] = ()


def load_parts(system: RobotSystems) -> RobotParts:
    """Return the controllers of a robot.

    Args:
        system: What will add them.
    """
    robot, options = system.robot, system.options
    blocks = None
    if options.preset == "kinematic":
        # Not at the top: most robots have physics.
        from arm_drake.hardware.mock_hardware import make_blocks

        blocks = make_blocks(robot)
    there = system.find_surroundings(blocks, find_gripper_ranges(robot))
    controllers, report = load_controllers_of(robot, system.period, options, there)
    return RobotParts(there, controllers, report, blocks or ())


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
            `arm_drake.worlds.world.load_world`.
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
    asked = options
    if options.gravity is None:
        options = dc.replace(options, gravity=loaded.gravity)
    rates = [robot.controllers.update_rate for robot in robots]
    step, periods = choose_time_step(options.largest_step, rates, options.log_rate)
    if options.time_step is None and not all(map(has_rate, periods, rates)):
        # Shorter steps than the preset's meet the ticks of robots at odd rates.
        shorter = dc.replace(options, preset="accurate").largest_step
        step, periods = choose_time_step(shorter, rates, options.log_rate)
    builder = DiagramBuilder()
    systems = [
        RobotSystems(
            builder,
            robot,
            f"{robot.name}/" if len(robots) > 1 else "",
            period,
            options,
            step,
            loaded.name,
        )
        for robot, period in zip(robots, periods, strict=True)
    ]
    add_build_info(builder, BuildInfo(options, loaded.name))
    is_kinematic = options.preset == "kinematic"
    parts = [load_parts(system) for system in systems]
    if is_kinematic:
        plant, scene_graph = MultibodyPlant(0.0), builder.AddSystem(SceneGraph())
        scene_graph.set_name("scene_graph")
        plant.RegisterAsSourceForSceneGraph(scene_graph)
    else:
        plant, scene_graph = add_plant(builder, step, options)
    loaded.add_to(plant)
    if options.preset == "fast":
        around = find_world_obstacles(plant, scene_graph)
        obstacles = [
            around + find_obstacles(robot, part.controllers, options)
            for robot, part in zip(robots, parts, strict=True)
        ]
        if any(obstacles):
            return _build_accurate(robots, loaded, asked, meshcat, obstacles)
    bases = [RobotBases.of(r, has_physics=not is_kinematic) for r in robots]
    models = [_add_model(plant, base, loaded, options) for base in bases]
    plant.Finalize()
    for base, model in zip(bases, models, strict=True):
        place_free_links(plant, scene_graph, model, base.robot)
        base.set_friction(plant, scene_graph, model)
    if is_kinematic:
        # Not at the top: most robots have physics.

        add_mirrored_robots(systems, parts, plant, scene_graph, models)
    else:
        _add_robots(systems, parts, plant, scene_graph, models, bases)
    if meshcat is not None:
        add_visualizer(builder, scene_graph, meshcat, frame_rate=options.frame_rate)
        show_backdrop(meshcat, has_grid=loaded.has_grid, background=loaded.background)
    diagram = builder.Build()
    diagram.set_name("arm_drake")
    for part in parts:
        _report_world(part.report, loaded)
    if not is_kinematic:
        free = [base.free_links for base in bases]
        links = dict(zip(models, free, strict=True))
        overlaps = separate(diagram, plant, scene_graph, links)
        for robot, part, model in zip(robots, parts, models, strict=True):
            _report_overlaps(part.report, robot, overlaps[model])
    return diagram


def _build_accurate(
    robots: Sequence[Robot],
    world: LoadedWorld,
    options: SimulationOptions,
    meshcat: Meshcat | None,
    obstacles: Sequence[Sequence[str]],
) -> Diagram:
    """Return the diagram of robots for which another preset doesn't do."""
    options = dc.replace(options, preset="accurate")
    diagram = build_diagram(robots, world=world, options=options, meshcat=meshcat)
    for robot, why in zip(robots, obstacles, strict=True):
        report_fallback(why, _report_of(diagram, robot))
    return diagram


def _add_robots(
    systems: Sequence[RobotSystems],
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    models: Sequence[ModelInstanceIndex],
    bases: Sequence[RobotBases],
) -> None:
    """Add hardware and controllers of robots that move by their dynamics."""
    builder = systems[0].builder
    forces = {}
    for system, part, model, base in zip(systems, parts, models, bases, strict=True):
        robot, options = system.robot, system.options
        there, controllers, report, _ = part
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
        report_friction(robot, drive, controllers, options, report)
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
        system.add_frames(poses, link_bodies(plant, model, robot.description.links))
        log_free_poses(
            builder,
            plant,
            model,
            robot,
            prefix=system.prefix,
            period=system.log_period,
        )
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


def _report_of(diagram: Diagram, robot: Robot) -> LoadReport:
    """Return the load report of a robot in a diagram."""
    return next(
        system.report
        for system in diagram.GetSystems()
        if isinstance(system, ControllerManager) and system.robot is robot
    )


def _report_world(report: LoadReport, world: LoadedWorld) -> None:
    """Add what was not taken as written of a world to the report of a robot."""
    for entry in world.report:
        report.add(**dc.asdict(entry))


def _report_overlaps(report: LoadReport, robot: Robot, overlaps: list[str]) -> None:
    if overlaps:
        report.add(
            "warning",
            "repair",
            f"links overlap in the initial pose: {', '.join(overlaps)}",
            "they pass through each other",
            file=robot.description.file,
        )


def _add_model(
    plant: MultibodyPlant,
    base: RobotBases,
    world: LoadedWorld,
    options: SimulationOptions,
) -> ModelInstanceIndex:
    robot, description = base.robot, base.describe()
    if world.has_things:
        description = with_surfaces(description, find_gripper_links(robot))
    model = add_robot_model(
        plant,
        description,
        robot.name,
        robot.pose,
        has_free_base=robot.has_free_base,
        collides=options.preset != "fast",
    )
    joints = commanded_joints(robot.description)
    add_actuators(plant, model, [joint.name for joint in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(robot.initial_positions))
    return model


def add_mirrored_robots(
    systems: Sequence[RobotSystems],
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    models: Sequence[ModelInstanceIndex],
) -> None:
    """Add hardware and controllers of robots whose joints are where they should be.

    Args:
        systems: What adds the robots' systems.
        parts: Their controllers.
        plant: The finalized plant, which is in no builder.
        scene_graph: The scene graph that it is registered with.
        models: The robots' model instances.
    """
    builder = systems[0].builder
    joints = {
        system.robot.name: (
            model,
            [joint.name for joint in system.robot.description.movable_joints],
        )
        for system, model in zip(systems, models, strict=True)
    }
    kinematic = builder.AddNamedSystem("plant", KinematicPlant(plant, joints))
    for system, part, model in zip(systems, parts, models, strict=True):
        robot, (there, controllers, report, blocks) = system.robot, part
        moving: dict[str, tuple[str, ...]] = {}
        for info, block in zip(robot.description.hardware, blocks, strict=True):
            done, where = "as mock_components has it", f"ros2_control {info.name!r}"
            for text in block.warnings:
                report.add("warning", "ignored", text, done, where=where)
            moving |= dict.fromkeys((j.name for j in info.joints), block.calculated)
        report_motionless(controllers, moving, report)
        report_blind(robot, report)
        order = command_order(there, controllers)
        hardware = add_mock_hardware(
            builder, robot, blocks, order, there, system.prefix, system.period
        )
        builder.Connect(hardware.joint_motions, kinematic.GetInputPort(robot.name))
        drive = DriveCommands((), order, velocity_lead=0.0)
        poses = kinematic.GetOutputPort("body_poses")
        system.add_frames(poses, link_bodies(plant, model, robot.description.links))
        system.add(hardware, there, controllers, report, drive)
    kinematic.connect_geometry(builder, scene_graph)
    builder.ExportOutput(kinematic.GetOutputPort("state"), "state")
