"""What a robot offers its controllers."""

import dataclasses as dc
from collections.abc import Mapping

from arm_drake.description.urdf import RobotDescription


@dc.dataclass(frozen=True)
class Surroundings:
    """What a robot offers its controllers."""

    joint_types: Mapping[str, str]
    command_interfaces: frozenset[str]
    state_interfaces: frozenset[str]

    # Initial positions by joint [rad] or [m].
    initial_positions: Mapping[str, float]


def find_surroundings(
    description: RobotDescription, initial_positions: Mapping[str, float]
) -> Surroundings:
    """Return the joints and interfaces of a robot.

    Args:
        description: The robot.
        initial_positions: Initial positions by joint [rad] or [m].
    """
    movable = {joint.name: joint.type for joint in description.movable_joints}
    joints = [
        component
        for block in description.hardware
        for component in block.joints
        if component.name in movable
    ]
    commands = {
        f"{component.name}/{interface.name}"
        for component in joints
        for interface in component.command_interfaces
    }
    states = {
        f"{component.name}/{interface.name}"
        for component in joints
        for interface in component.state_interfaces
    }
    return Surroundings(
        movable, frozenset(commands), frozenset(states), initial_positions
    )
