"""What a robot offers its controllers, and which of them load."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial

from arm_drake import interfaces
from arm_drake.control.generic_system import GenericSystem
from arm_drake.description.controller_manager_parameters import MANAGER
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.sensors import SensorInfo, accelerating_joints, sensed_names
from arm_drake.description.urdf import RobotDescription
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.manager.loading import load_controllers
from arm_drake.options import SimulationOptions
from arm_drake.plant.kinematics import PlantKinematics


def load_controllers_of(
    robot: Robot,
    period: float | None = None,
    options: SimulationOptions | None = None,
    surroundings: Surroundings | None = None,
) -> tuple[tuple[LoadedController, ...], LoadReport]:
    """Return the controllers of a robot, and its report with what they lack.

    Args:
        robot: The robot; its own report stays as it is.
        period: Period of its controller manager in Drake's time [s].
        options: Which controllers to start or not.
        surroundings: What the robot offers them, if not what its description says.
    """
    options = SimulationOptions() if options is None else options
    report = LoadReport(robot.report)
    controllers = load_controllers(
        robot.controllers,
        surroundings
        or find_surroundings(
            robot.description, robot.initial_positions, robot_name=robot.name
        ),
        report,
        period=period,
        active=options.active,
        inactive=options.inactive,
        distro=robot.distro,
        controller_types=robot.controller_types,
    )
    if robot.controllers.enforce_command_limits and robot.distro == "humble":
        report.add(
            "warning",
            "ignored",
            "humble has no enforce_command_limits",
            "commands aren't limited",
            where=MANAGER,
            file=next(iter(robot.controllers.files), None),
        )
    return controllers, report


def find_surroundings(
    description: RobotDescription,
    initial_positions: Mapping[str, float],
    blocks: Sequence[GenericSystem] | None = None,
    *,
    sensors: Sequence[SensorInfo] = (),
    robot_name: str = "",
    world_name: str = "empty",
) -> Surroundings:
    """Return the joints and interfaces of a robot.

    Args:
        description: The robot.
        initial_positions: Initial positions by joint [rad] or [m].
        blocks: Hardware that mirrors commands, if that is what it has.
        sensors: Its sensors; hardware that mirrors commands has none.
        robot_name: Name of the robot.
        world_name: Name of the world that it is in.
    """
    movable = {joint.name: joint.type for joint in description.movable_joints}
    simulated = set(interfaces.interface_names(movable, interfaces.STATE_INTERFACES))
    commands: dict[str, None] = {}
    states: dict[str, float] = {}
    for mirror in blocks or ():
        commands |= dict.fromkeys(mirror.command_interfaces)
        initial = zip(mirror.state_interfaces, mirror.initial_states(), strict=True)
        states |= {name: float(value) for name, value in initial}
    for block in description.hardware if blocks is None else ():
        for component in (*block.joints, *block.sensors, *block.gpios):
            # As in GenericSystem, only joints start from 0.
            default = 0.0 if component in block.joints else math.nan
            for interface in component.command_interfaces:
                commands[f"{component.name}/{interface.name}"] = None
            for interface in component.state_interfaces:
                value = interface.initial_value
                states[f"{component.name}/{interface.name}"] = (
                    default if value is None else value
                )
    sensed: tuple[str, ...] = ()
    if blocks is None:
        sensed = sensed_names(sensors, accelerating_joints(description))
    known = simulated.union(sensed)
    return Surroundings(
        movable,
        tuple(commands),
        tuple(states),
        initial_positions,
        {name: value for name, value in states.items() if name not in known},
        _driven(description, commands) if blocks is None else frozenset(),
        {
            f"{component.name}/{interface.name}": block.name
            for block in description.hardware
            for component in (*block.joints, *block.sensors, *block.gpios)
            for interface in (
                *component.command_interfaces,
                *component.state_interfaces,
            )
        },
        components={
            component.name: kind
            for block in description.hardware
            for kind, components in (
                ("gpio", block.gpios),
                ("sensor", block.sensors),
                ("joint", block.joints),
            )
            for component in components
        },
        other_types=frozenset(
            f"{component.name}/{interface.name}"
            for block in description.hardware
            for component in (*block.joints, *block.sensors, *block.gpios)
            for interface in component.state_interfaces
            if interface.data_type != "double"
        ),
        sensed=sensed,
        has_physics=blocks is None,
        refuse=None if blocks is None else partial(_find_objections, blocks),
        velocity_limits={
            joint.name: joint.limits.velocity
            for joint in description.movable_joints
            if joint.limits.velocity is not None
        },
        effort_limits={
            joint.name: joint.limits.effort
            for joint in description.movable_joints
            if joint.limits.effort is not None
        },
        followed=_followed(description),
        links=tuple(description.links),
        robot_name=robot_name,
        world_name=world_name,
        make_kinematics=partial(PlantKinematics, description, initial_positions),
    )


def _followed(description: RobotDescription) -> dict[str, tuple[str, float]]:
    """Return what mimic joints follow in the end, and how far per unit of it."""
    mimics = {j.name: j.mimic for j in description.movable_joints if j.mimic}
    followed = {}
    for name in mimics:
        master, ratio = name, 1.0
        while (mimic := mimics.get(master)) is not None:
            master, ratio = mimic.joint, ratio * mimic.multiplier
        followed[name] = (master, ratio)
    return followed


def _driven(description: RobotDescription, commands: Iterable[str]) -> frozenset[str]:
    """Return the joints with a command interface that follow no other joint."""
    commanded = {name.rpartition("/")[0] for name in commands}
    joints = [j.name for j in description.movable_joints if j.mimic is None]
    return frozenset(commanded.intersection(joints))


def _find_objections(
    blocks: Sequence[GenericSystem], start: Collection[str], stop: Collection[str]
) -> str:
    """Return why blocks can't start and stop command interfaces, "" if they can."""
    objections = []
    for block in blocks:
        own = block.command_interfaces
        started = [name for name in start if name in own]
        stopped = [name for name in stop if name in own]
        objections.append(block.prepare_switch(started, stopped))
    return "; ".join(filter(None, objections))
