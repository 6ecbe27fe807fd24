"""build_diagram: robots to one Drake Diagram, stage by stage.

Each stage is a call, and this module is the one that knows them all: controllers, the
plant with the world and the robots in it, hardware, what is seen and what is reported.
"""

import dataclasses as dc
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

from pydrake.geometry import Meshcat, Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from arm_drake import interfaces
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.generic_system import GenericSystem
from arm_drake.description.drive_gains import find_drive_gains, holds_joints
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot, list_robots
from arm_drake.description.srdf import find_disabled_collisions
from arm_drake.description.urdf import total_mass
from arm_drake.errors import InputError, suggest
from arm_drake.hardware.drive_report import (
    find_obstacles,
    find_world_obstacles,
    report_drive,
    report_fallback,
    report_friction,
    report_times,
)
from arm_drake.hardware.drives import (
    are_all_pushed,
    commanded_joints,
    effort_limits,
    find_effort_only_joints,
    make_drive_commands,
    make_robot_drive,
    may_let_go,
)
from arm_drake.hardware.hardware import (
    Hardware,
    add_hardware,
    add_sensors,
    add_up,
    connect_forces,
    report_blind,
)
from arm_drake.hardware.mobile_bases import RobotBases
from arm_drake.hardware.robot_systems import RobotSystems
from arm_drake.manager import MANAGER, ControllerManager
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.loaded_controllers import LoadedController, command_order
from arm_drake.manager.loading import load_controllers_of, report_motionless
from arm_drake.options import SimulationOptions
from arm_drake.plant.contact import Shape, carry_weight, separate, with_surfaces
from arm_drake.plant.initial_poses import log_free_poses, place_free_links
from arm_drake.plant.joint_ranges import (
    find_gripper_joints,
    find_gripper_links,
    find_gripper_ranges,
)
from arm_drake.plant.kinematics import BodyPoses, KinematicPlant
from arm_drake.plant.payloads import (
    Payload,
    Payloads,
    add_payloads,
    split_payloads,
)
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    add_visualizer,
    filter_pairs,
    filter_self_collision,
    link_bodies,
    set_initial_positions,
    trial_plant,
)
from arm_drake.simulation.recording import BuildInfo
from arm_drake.timing import choose_time_step, has_rate
from arm_drake.worlds.things import LoadedWorld, free_bodies, show_backdrop
from arm_drake.worlds.world import World, load_world

if TYPE_CHECKING:
    from arm_drake.scene import Scene


class Setting(NamedTuple):
    """Robots, world and options of a simulation, and its steps."""

    robots: Sequence[Robot]
    world: LoadedWorld

    # As they were given, and with the world's gravity if none was.
    requested: SimulationOptions
    options: SimulationOptions

    # Step of the plant, and periods of the robots' controller managers [s].
    step: float
    periods: Sequence[float]

    # As they were given, and by robot and link.
    payloads: Payloads
    payloads_by_robot: Mapping[str, Mapping[str, Payload]]

    @property
    def is_kinematic(self) -> bool:
        """Whether joints are where they should be, without physics."""
        return self.options.preset == "kinematic"


class RobotParts(NamedTuple):
    """A robot's controllers, which are in no builder yet, and what will add it all."""

    system: RobotSystems

    # What the robot offers them.
    hardware_interfaces: HardwareInterfaces

    controllers: tuple[LoadedController, ...]

    # Its load report, with what they lack.
    report: LoadReport

    base: RobotBases

    # Hardware that mirrors commands, if that is what it has.
    blocks: Sequence[GenericSystem] = ()

    # Of its bodies in the plant, as soon as they are there.
    model: ModelInstanceIndex = ModelInstanceIndex()

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.system.robot


def build_diagram(
    robots: "Robot | Sequence[Robot] | Scene",
    *,
    world: World = "empty",
    options: SimulationOptions | None = None,
    payloads: Payloads | None = None,
    meshcat: Meshcat | None = None,
) -> Diagram:
    """Return the Diagram of robots with their controllers.

    Its ports are named as in ROS: `<controller>.<topic>`, `joint_states`, `frames`;
    with several robots, `<robot>/` stands before each name. `state` is the plant's.

    Args:
        robots: One or several loaded robots; or a scene, of which the world, the
            options and the payloads are used that aren't given here.
        world: Name of a built-in world, an SDF file, or a function that adds things to
            the plant before the robots come and before it is finalized, see
            `arm_drake.worlds.world.load_world`.
        options: How to simulate.
        payloads: Things that are fixed to links, which controllers and servo know
            nothing of: `Payload` or mass [kg] by link; with several robots by
            `<robot>/<link>`. `Simulation.set_payload` changes them.
        meshcat: Where to draw, if anywhere.

    Raises:
        InputError: If the robots can't be put together, or the world can't be used.
    """
    setting = _choose_setting(robots, world, options, payloads)
    builder = DiagramBuilder()
    info = builder.AddSystem(BuildInfo(setting.options, setting.world.name))
    parts = _load_parts(builder, setting)

    plant, scene_graph = _add_empty_plant(builder, setting)
    setting.world.add_to(plant)
    obstacles = _find_obstacles(setting, parts, plant, scene_graph)
    if any(obstacles):
        return _build_accurate(setting, meshcat, obstacles)
    parts = _add_models(setting, parts, plant, scene_graph, meshcat)

    if setting.is_kinematic:
        _add_kinematic_robots(builder, parts, plant, scene_graph)
    else:
        _add_dynamic_robots(builder, parts, plant, scene_graph)
    has_sensors = any(part.robot.description.perception_sensors for part in parts)
    if has_sensors or setting.options.log_images:
        _add_perception(setting, builder, parts, plant, scene_graph)
    if meshcat is not None:
        _add_meshcat(setting, builder, scene_graph, meshcat)
    diagram = builder.Build()
    diagram.set_name("arm_drake")

    _report_world(setting, parts)
    if not setting.is_kinematic:
        info.parted = _part_overlaps(diagram, plant, scene_graph, parts)
    return diagram


def _choose_setting(
    robots: "Robot | Sequence[Robot] | Scene",
    world: World,
    options: SimulationOptions | None,
    payloads: Payloads | None,
) -> Setting:
    """Return robots and world with the steps that fit them; raises InputError."""
    scene = _as_scene(robots)
    if scene is not None:
        robots, options = scene.robots, options or scene.options
        world = scene.load_world() if world == "empty" else world
        payloads = {**scene.payloads, **(payloads or {})}
    else:
        robots = list_robots(cast("Robot | Sequence[Robot]", robots))
    payloads = payloads or {}
    options = SimulationOptions() if options is None else options
    if not isinstance(options, SimulationOptions):
        raise InputError(f"options: expected SimulationOptions, got {options!r}")
    loaded = load_world(world, [path for r in robots for path in r.package_paths])
    requested = options
    if options.gravity is None:
        options = dc.replace(options, gravity=loaded.gravity)
    rates = [robot.controllers.update_rate for robot in robots]
    step, periods = choose_time_step(options.largest_step, rates, options.log_rate)
    if options.time_step is None and not all(map(has_rate, periods, rates)):
        # Shorter steps than the preset's meet the ticks of robots at odd rates.
        shorter = dc.replace(options, preset="accurate").largest_step
        step, periods = choose_time_step(shorter, rates, options.log_rate)
    links = {robot.name: robot.description.links for robot in robots}
    if payloads and options.preset == "kinematic":
        raise InputError("payloads: the preset kinematic has no physics")
    by_robot = split_payloads(payloads, links)
    return Setting(
        robots, loaded, requested, options, step, periods, payloads, by_robot
    )


def _as_scene(robots: object) -> "Scene | None":
    """Return a scene, whose module robots alone don't need; None if it is none."""
    if isinstance(robots, Robot | Iterable):
        return None
    from arm_drake.scene import Scene

    return robots if isinstance(robots, Scene) else None


def _load_parts(builder: DiagramBuilder, setting: Setting) -> list[RobotParts]:
    """Return the controllers of each robot, which are to come into a builder."""
    robots, options = setting.robots, setting.options
    parts = []
    for robot, period in zip(robots, setting.periods, strict=True):
        prefix = f"{robot.name}/" if len(robots) > 1 else ""
        system = RobotSystems(
            builder, robot, prefix, period, options, setting.step, setting.world.name
        )
        blocks = None
        if setting.is_kinematic:
            from arm_drake.hardware.mock_hardware import make_blocks

            blocks = make_blocks(robot)
        hardware_interfaces = system.find_hardware_interfaces(
            blocks, find_gripper_ranges(robot)
        )
        controllers, report = load_controllers_of(
            robot, period, _options_of(robot, robots, options), hardware_interfaces
        )
        base = RobotBases.of(robot, has_physics=not setting.is_kinematic)
        own = system, hardware_interfaces, controllers, report, base
        parts.append(RobotParts(*own, blocks or ()))
    if options.state_noise:
        from arm_drake.hardware.noise_and_delay import check_noise

        check_noise(options.state_noise, [part.hardware_interfaces for part in parts])
    return parts


def _options_of(
    robot: Robot, robots: Sequence[Robot], options: SimulationOptions
) -> SimulationOptions:
    """Return options in which controllers are named as without the other robots.

    `<robot>/<controller>` is that of one robot, a bare name that of all that have it.
    """
    if len(robots) == 1:
        return options
    known = {
        each.name: [c.name for c in each.controllers.controllers] for each in robots
    }
    full = [f"{name}/{each}" for name, names in known.items() for each in names]
    chosen: dict[str, list[str]] = {"active": [], "inactive": []}
    for kind, found in chosen.items():
        for name in getattr(options, kind):
            if name not in full and not any(name in names for names in known.values()):
                raise InputError(f"no controller {name!r}; {suggest(name, full)}")
            own = name.removeprefix(f"{robot.name}/")
            if own in known[robot.name]:
                found.append(own)
    active, inactive = map(tuple, chosen.values())
    return dc.replace(options, active=active, inactive=inactive)


def _add_empty_plant(
    builder: DiagramBuilder, setting: Setting
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add a scene graph, and a plant if it has physics; without, it stays alone."""
    if not setting.is_kinematic:
        return add_plant(builder, setting.step, setting.options)
    plant, scene_graph = MultibodyPlant(0.0), builder.AddSystem(SceneGraph())
    scene_graph.set_name("scene_graph")
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    return plant, scene_graph


def _find_obstacles(
    setting: Setting,
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
) -> list[list[str]]:
    """Return why each robot can't be simulated with the preset that was chosen."""
    if setting.options.preset != "fast":
        return []
    around = find_world_obstacles(scene_graph)
    return [
        around + find_obstacles(part.robot, part.controllers, setting.options)
        for part in parts
    ]


def _build_accurate(
    setting: Setting, meshcat: Meshcat | None, obstacles: Sequence[Sequence[str]]
) -> Diagram:
    """Return the diagram of robots for which another preset doesn't do."""
    robots, options = setting.robots, dc.replace(setting.requested, preset="accurate")
    diagram = build_diagram(
        robots,
        world=setting.world,
        options=options,
        payloads=setting.payloads,
        meshcat=meshcat,
    )
    for robot, why in zip(robots, obstacles, strict=True):
        report_fallback(why, _report_of(diagram, robot))
    return diagram


def _report_of(diagram: Diagram, robot: Robot) -> LoadReport:
    """Return the load report of a robot in a diagram."""
    return next(
        system.report
        for system in diagram.GetSystems()
        if isinstance(system, ControllerManager) and system.robot is robot
    )


def _may_touch(setting: Setting, scene_graph: SceneGraph) -> bool:
    """Return whether robots may touch each other, themselves or the world around.

    Where nothing can, a step needs no shapes to ask for collisions; without physics
    nothing asks. A robot that stands on its shapes keeps them, and one whose sensors
    may look at its own.
    """
    inspector = scene_graph.model_inspector()
    return (
        setting.is_kinematic
        or len(setting.robots) > 1
        or setting.options.self_collision
        or bool(setting.payloads)
        or any(robot.has_free_base or _looks(robot) for robot in setting.robots)
        or inspector.NumGeometriesWithRole(Role.kProximity) > 0
    )


def _looks(robot: Robot) -> bool:
    """Return whether a robot has a camera, a lidar or a range sensor."""
    ranging = any(interfaces.RANGE in sensor.interfaces for sensor in robot.sensors)
    return ranging or bool(robot.description.perception_sensors)


def _add_models(
    setting: Setting,
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    meshcat: Meshcat | None,
) -> list[RobotParts]:
    """Return the parts of robots that are in the plant, which this finalizes.

    With them comes what collides or is drawn.
    """
    collides = meshcat is not None or _may_touch(setting, scene_graph)
    collides &= setting.options.preset != "fast"
    parts = [
        part._replace(
            model=_add_model(plant, part.base, setting.world, collides=collides)
        )
        for part in parts
    ]
    payloads = [setting.payloads_by_robot[part.robot.name] for part in parts]
    for part, own in zip(parts, payloads, strict=True):
        add_payloads(plant, part.model, own, collides=collides)
    plant.Finalize()
    for part, own in zip(parts, payloads, strict=True):
        if part.robot.has_free_base:
            loads = sum(payload.mass for payload in own.values())
            carry_weight(scene_graph, total_mass(part.robot.description) + loads)
        place_free_links(plant, scene_graph, part.model, part.robot)
        part.base.set_friction(plant, scene_graph, part.model)
    return parts


def _add_model(
    plant: MultibodyPlant,
    base: RobotBases,
    world: LoadedWorld,
    *,
    collides: bool,
) -> ModelInstanceIndex:
    """Add a robot with its actuators, and with the wheels that are rolled on."""
    robot, description = base.robot, base.describe()
    if world.has_things:
        description = with_surfaces(description, find_gripper_links(robot))
    model = add_robot_model(
        plant,
        description,
        robot.name,
        robot.pose,
        has_free_base=robot.has_free_base,
        collides=collides,
    )
    joints = commanded_joints(robot.description)
    add_actuators(plant, model, [joint.name for joint in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(robot.initial_positions))
    return model


def _add_dynamic_robots(
    builder: DiagramBuilder,
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
) -> None:
    """Add hardware and controllers of robots that move by their dynamics."""
    forces = {}
    for part in parts:
        system, model, base = part.system, part.model, part.base
        _filter_collisions(part, plant, scene_graph)
        hardware, commands = _add_drives(builder, part, plant)
        hardware = add_sensors(
            hardware, builder, plant, scene_graph, model, part.robot, system.prefix
        )
        hardware = _add_noise_and_delay(builder, part, hardware)
        _add_frames(part, plant, plant.get_body_poses_output_port())
        log_free_poses(
            builder,
            plant,
            model,
            part.robot,
            prefix=system.prefix,
            period=system.log_period,
        )
        system.add(
            hardware, part.hardware_interfaces, part.controllers, part.report, commands
        )
        base.add_truths(
            builder,
            plant,
            scene_graph,
            model,
            part.controllers,
            part.report,
            system.prefix,
        )
        own = (builder, plant, model, part.controllers, part.report, system.prefix)
        ports = [p for p in (hardware.friction, base.add_servo(*own)) if p is not None]
        if ports:
            forces[model] = add_up(builder, f"{system.prefix}forces", ports)
    connect_forces(builder, plant, forces)
    push = plant.get_applied_spatial_force_input_port()
    builder.ExportInput(push, "applied_spatial_force")
    builder.ExportOutput(plant.get_state_output_port(), "state")
    _export_things(builder, parts, plant, plant.get_body_poses_output_port())


def _filter_collisions(
    part: RobotParts, plant: MultibodyPlant, scene_graph: SceneGraph
) -> None:
    """Let the links of a robot touch each other as the options and its SRDF say."""
    if part.system.options.self_collision:
        pairs = find_disabled_collisions(part.robot, part.report)
        filter_pairs(plant, scene_graph, part.model, pairs)
    else:
        filter_self_collision(plant, scene_graph, part.model)


def _add_drives(
    builder: DiagramBuilder, part: RobotParts, plant: MultibodyPlant
) -> tuple[Hardware, DriveCommands]:
    """Add what drives a robot's joints; return it with what makes its commands."""
    system, controllers, report = part.system, part.controllers, part.report
    robot, options = system.robot, system.options
    effort_only = find_effort_only_joints(robot, controllers)
    holds = holds_joints(robot, report) and not are_all_pushed(robot, effort_only)
    drive = make_robot_drive(
        robot.description,
        robot.pose,
        options,
        plant.time_step(),
        declared_gains=find_drive_gains(robot, report),
        effort_only=effort_only,
        lets_go=may_let_go(robot, controllers) or not holds,
        grippers={joint.name for joint in find_gripper_joints(robot)},
        load_inertia=part.base.load_inertia,
        period=system.period,
        trial=trial_plant(robot),
    )
    commands = make_drive_commands(
        robot, part.hardware_interfaces, controllers, drive, holds=holds
    )
    report_times(plant.time_step(), system.period, options, report)
    report_drive(robot, drive, controllers, report, holds=holds)
    report_friction(robot, drive, controllers, options, report)
    hardware = add_hardware(
        builder,
        plant,
        part.model,
        robot.description,
        prefix=system.prefix,
        drive=drive,
        initial=robot.initial_positions,
        options=options,
        has_modes=commands.has_modes,
        has_limits=commands.has_limits,
        only_pushes=not (holds or commands.has_limits or drive.pid)
        and effort_only.issuperset(drive.names),
    )
    return hardware, commands


def _add_noise_and_delay(
    builder: DiagramBuilder, part: RobotParts, hardware: Hardware
) -> Hardware:
    """Add what is between a robot's hardware and its controllers, if anything is."""
    system, options = part.system, part.system.options
    if not (options.state_noise or options.state_delay or options.command_delay):
        return hardware
    # Robots that have neither pay for nothing.
    from arm_drake.hardware.noise_and_delay import add_noise_and_delay

    return add_noise_and_delay(
        hardware,
        builder,
        part.hardware_interfaces,
        options,
        system.prefix,
        system.period,
    )


def _add_frames(part: RobotParts, plant: MultibodyPlant, poses: OutputPort) -> None:
    """Add the poses of a robot's links, out of those of all bodies."""
    bodies = link_bodies(plant, part.model, part.robot.description.links)
    part.system.add_frames(poses, bodies)


def _add_kinematic_robots(
    builder: DiagramBuilder,
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
) -> None:
    """Add hardware and controllers of robots whose joints are where they should be."""
    from arm_drake.hardware.mock_hardware import add_mock_hardware, report_blocks

    joints = {
        part.robot.name: (
            part.model,
            [joint.name for joint in part.robot.description.movable_joints],
        )
        for part in parts
    }
    kinematic = builder.AddNamedSystem("plant", KinematicPlant(plant, joints))
    poses = kinematic.GetOutputPort("body_poses")
    for part in parts:
        system, hardware_interfaces, controllers, report, _, blocks, _ = part
        report_motionless(
            controllers, report_blocks(part.robot, blocks, report), report
        )
        report_blind(part.robot, report)
        order = command_order(hardware_interfaces, controllers)
        hardware = add_mock_hardware(
            builder,
            part.robot,
            blocks,
            order,
            hardware_interfaces,
            system.prefix,
            system.period,
        )
        motions = kinematic.GetInputPort(part.robot.name)
        builder.Connect(hardware.joint_motions, motions)
        hardware = _add_noise_and_delay(builder, part, hardware)
        drive = DriveCommands((), order, velocity_lead=0.0)
        _add_frames(part, plant, poses)
        system.add(hardware, hardware_interfaces, controllers, report, drive)
    kinematic.connect_geometry(builder, scene_graph)
    builder.ExportOutput(kinematic.GetOutputPort("state"), "state")
    _export_things(builder, parts, plant, poses)


def _export_things(
    builder: DiagramBuilder,
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    poses: OutputPort,
) -> None:
    """Add a pose port for each body of the world that moves freely."""
    bodies: dict[str, int] = {}
    for body in free_bodies(plant, [part.robot.name for part in parts]):
        bodies.setdefault(str(body.name()), int(body.index()))
    if not bodies:
        return
    things = builder.AddNamedSystem("things", BodyPoses(bodies))
    builder.Connect(poses, things.get_input_port())
    for name in bodies:
        builder.ExportOutput(things.GetOutputPort(name), f"things.{name}")


def _add_perception(
    setting: Setting,
    builder: DiagramBuilder,
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
) -> None:
    """Add the cameras and lidars of the robots."""
    # Robots that have none pay for nothing.
    from arm_drake.perception.scenery import Scenery
    from arm_drake.perception.sensors import Place, add_sensors, check_logged

    world, logged = setting.world, setting.options.log_images
    check_logged(logged, {part.system.prefix: part.robot for part in parts})
    scenery = Scenery(world.lights, world.background)
    for part in parts:
        name, prefix = part.robot.name, part.system.prefix
        seed = setting.options.seed
        manager = builder.GetSubsystemByName(f"{prefix}{MANAGER}")
        taken, model_name = _publishers(manager), plant.GetModelInstanceName(part.model)
        place = Place(name, model_name, world.name, seed, taken)
        manager.sensors = add_sensors(
            builder,
            scene_graph,
            part.robot,
            place,
            scenery,
            prefix,
            part.report,
            # Without physics joints move once in each cycle.
            part.system.period if setting.is_kinematic else plant.time_step(),
            logged,
            setting.options.log_image_format,
        )


def _publishers(manager: ControllerManager) -> dict[str, tuple[str, None]]:
    """Return which controllers publish on topics with a name of their own."""
    return {
        system.get_output_port(index).get_name(): (system.params.controller_name, None)
        for system in (controller.system for controller in manager.controllers)
        if system is not None
        for index in range(system.num_output_ports())
    }


def _add_meshcat(
    setting: Setting,
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
) -> None:
    """Add what draws the scene, and show the world's grid and background."""
    rate, world = setting.options.frame_rate, setting.world
    add_visualizer(builder, scene_graph, meshcat, frame_rate=rate)
    from arm_drake.visualization.meshcat import show_ground

    show_backdrop(meshcat, has_grid=world.has_grid, background=world.background)
    show_ground(meshcat, has_lines=world.has_grid, look=world.ground)


def _report_world(setting: Setting, parts: Sequence[RobotParts]) -> None:
    """Add what was not taken as written of the world to the robots' reports."""
    for part in parts:
        for entry in setting.world.report:
            part.report.add(**dc.asdict(entry))


def _part_overlaps(
    diagram: Diagram,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    parts: Sequence[RobotParts],
) -> Sequence[tuple[Shape, Shape]]:
    """Let links that overlap at the start pass through each other, and report them."""
    links = {part.model: part.base.free_links for part in parts}
    overlaps = separate(diagram, plant, scene_graph, links)
    if overlaps.things:
        what = f"things of the world are in one place: {', '.join(overlaps.things)}"
        done = "they pass through each other"
        for part in parts[:1]:
            part.report.add("warning", "repair", what, done)
    for part in parts:
        if overlaps.robots[part.model]:
            pairs = ", ".join(overlaps.robots[part.model])
            part.report.add(
                "warning",
                "repair",
                f"links overlap in the initial pose: {pairs}",
                "they pass through each other until they are apart; "
                "another pose (--pose) or other initial positions (--initial) avoid it",
                file=part.robot.description.file,
            )
    return overlaps.parted
