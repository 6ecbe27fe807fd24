"""What is made of a robot before there is a plant."""

from collections.abc import Sequence
from typing import NamedTuple

from arm_drake.control.generic_system import GenericSystem
from arm_drake.description.report import LoadReport
from arm_drake.hardware.robot_systems import RobotSystems
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.manager.robot_controllers import load_controllers_of
from arm_drake.plant.gripper_ranges import find_gripper_ranges


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
