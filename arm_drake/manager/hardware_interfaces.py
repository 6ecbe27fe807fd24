"""Command and state interfaces of a robot, and what else it offers its controllers."""

import dataclasses as dc
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial

from arm_drake import interfaces
from arm_drake.control.generic_system import GenericSystem
from arm_drake.controllers.controller_interface import RobotInfo
from arm_drake.description.ros2_control import ComponentInfo
from arm_drake.description.sensors import SensorInfo, accelerating_joints, sensed_names
from arm_drake.description.urdf import RobotDescription
from arm_drake.importing import dataclass
from arm_drake.plant.kinematics import PlantKinematics


@dataclass(frozen=True)
class HardwareInterfaces(RobotInfo):
    """Interfaces of a robot for its controllers."""

    # URDF type of every movable joint.
    joint_types: Mapping[str, str]

    # Names of all interfaces, such as "joint1/position", in the order of the file.
    command_interfaces: tuple[str, ...]
    state_interfaces: tuple[str, ...]

    # Initial positions by joint [rad] or [m].
    initial_positions: Mapping[str, float]

    # Initial values of the state interfaces that the physics doesn't know. They stay,
    # or follow the command interface of the same name.
    stored: Mapping[str, float] = dc.field(default_factory=dict)

    # Joints that the physics moves as they are commanded, by one controller at a time.
    driven: frozenset[str] = frozenset()

    # Name of the `<ros2_control>` block that an interface belongs to.
    blocks: Mapping[str, str] = dc.field(default_factory=dict)

    # What `<ros2_control>` blocks name: "joint", "sensor" or "gpio", by name.
    components: Mapping[str, str] = dc.field(default_factory=dict)

    # State interfaces that sensors measure, in the order of their readings.
    sensed: tuple[str, ...] = ()

    # Whether states come from physics, not from commands.
    has_physics: bool = True

    # Why the hardware can't start and stop these command interfaces, "" if it can; None
    # if it always can.
    refuse: Callable[[Collection[str], Collection[str]], str] | None = None

    @property
    def measured(self) -> tuple[str, ...]:
        """Order of the vector of everything that is measured."""
        joints = interfaces.interface_names(
            self.joint_types, interfaces.STATE_INTERFACES
        )
        return (*joints, *self.sensed, *self.stored)


def find_hardware_interfaces(
    description: RobotDescription,
    initial_positions: Mapping[str, float],
    blocks: Sequence[GenericSystem] | None = None,
    *,
    sensors: Sequence[SensorInfo] = (),
    robot_name: str = "",
    world_name: str = "empty",
) -> HardwareInterfaces:
    """Return the joints and interfaces of a robot.

    Initial positions are in [rad] or [m]. `blocks` is hardware that mirrors commands,
    if that is what it has; then it has no sensors.
    """
    joints = description.movable_joints
    movable = {joint.name: joint.type for joint in joints}
    known = set(interfaces.interface_names(movable, interfaces.STATE_INTERFACES))
    sensed: tuple[str, ...] = ()
    if blocks is None:
        commands, states = _described_interfaces(description)
        sensed = sensed_names(sensors, accelerating_joints(description))
        known.update(sensed)
    else:
        commands, states = _mirrored_interfaces(blocks)
    velocities = {joint.name: joint.limits.velocity for joint in joints}
    efforts = {joint.name: joint.limits.effort for joint in joints}
    return HardwareInterfaces(
        movable,
        commands,
        tuple(states),
        initial_positions,
        {name: value for name, value in states.items() if name not in known},
        _driven(description, commands) if blocks is None else frozenset(),
        _blocks(description),
        components=_kinds(description),
        other_types=frozenset(
            f"{component.name}/{interface.name}"
            for _, _, component in _components(description)
            for interface in component.state_interfaces
            if interface.data_type != "double"
        ),
        sensed=sensed,
        has_physics=blocks is None,
        refuse=None if blocks is None else partial(_find_objections, blocks),
        velocity_limits={n: v for n, v in velocities.items() if v is not None},
        effort_limits={n: e for n, e in efforts.items() if e is not None},
        followed=_followed(description),
        links=tuple(description.links),
        robot_name=robot_name,
        world_name=world_name,
        make_kinematics=partial(PlantKinematics, description, initial_positions),
    )


def _components(
    description: RobotDescription,
) -> Iterator[tuple[str, str, ComponentInfo]]:
    """Yield components of hardware with the name of their block, and their kind."""
    for block in description.hardware:
        for kind, components in (
            ("joint", block.joints),
            ("sensor", block.sensors),
            ("gpio", block.gpios),
        ):
            for component in components:
                yield block.name, kind, component


def _described_interfaces(
    description: RobotDescription,
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return command interfaces, and state interfaces with their initial values."""
    commands: dict[str, None] = {}
    states: dict[str, float] = {}
    for _, kind, component in _components(description):
        # As in GenericSystem, only joints start from 0.
        default = 0.0 if kind == "joint" else math.nan
        for interface in component.command_interfaces:
            commands[f"{component.name}/{interface.name}"] = None
        for interface in component.state_interfaces:
            value = interface.initial_value
            states[f"{component.name}/{interface.name}"] = (
                default if value is None else value
            )
    return tuple(commands), states


def _mirrored_interfaces(
    blocks: Sequence[GenericSystem],
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return the same of hardware that mirrors commands."""
    commands: dict[str, None] = {}
    states: dict[str, float] = {}
    for mirror in blocks:
        commands |= dict.fromkeys(mirror.command_interfaces)
        initial = zip(mirror.state_interfaces, mirror.initial_states(), strict=True)
        states |= {name: float(value) for name, value in initial}
    return tuple(commands), states


def _kinds(description: RobotDescription) -> dict[str, str]:
    """Return what components are by their names; of one name, a joint is first."""
    return {
        component.name: kind
        for block in description.hardware
        for kind, components in (
            ("gpio", block.gpios),
            ("sensor", block.sensors),
            ("joint", block.joints),
        )
        for component in components
    }


def _blocks(description: RobotDescription) -> dict[str, str]:
    """Return the names of the blocks that interfaces belong to."""
    return {
        f"{component.name}/{interface.name}": block
        for block, _, component in _components(description)
        for interface in (*component.command_interfaces, *component.state_interfaces)
    }


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
    joints = [joint.name for joint in description.independent_joints]
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
