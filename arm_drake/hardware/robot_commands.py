"""What the controllers of a robot may command, and what its hardware makes of it."""

from collections.abc import Iterable, Sequence

from arm_drake import interfaces
from arm_drake.control.command_limits import CommandLimits
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.description.joint_limits import find_joint_limits
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.hardware.drives import RobotDrive, commanded_joints
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.loaded_controllers import (
    LoadedController,
    command_order,
    enforces_limits,
)


def find_bare_joints(
    robot: Robot, controllers: Iterable[LoadedController]
) -> frozenset[str]:
    """Return the joints that follow efforts and nothing else.

    Args:
        robot: The robot.
        controllers: Its controllers, also those that are inactive.
    """
    claimed = claimed_interfaces(robot, controllers)
    moved = {name.rpartition("/")[0] for name in claimed if not _is_effort(name)}
    return frozenset(name.rpartition("/")[0] for name in claimed) - moved


def may_let_go(robot: Robot, controllers: Iterable[LoadedController]) -> bool:
    """Return whether a joint may be commanded nothing but an effort.

    Args:
        robot: The robot.
        controllers: Its controllers, also those that are inactive.
    """
    return any(find_bare_joints(robot, [controller]) for controller in controllers)


def make_drive_commands(
    robot: Robot,
    surroundings: Surroundings,
    controllers: Sequence[LoadedController],
    drive: RobotDrive,
    *,
    holds: bool = True,
) -> DriveCommands:
    """Return what turns commands of controllers into what the servo is told.

    Args:
        robot: The robot.
        surroundings: Its interfaces.
        controllers: Its controllers, also those that are inactive.
        drive: What drives its joints.
        holds: Whether joints that nobody commands hold their position.
    """
    positions = set(interfaces.interface_names(drive.names, [interfaces.POSITION]))
    return DriveCommands(
        drive.names,
        command_order(surroundings, controllers),
        velocity_lead=drive.rest_time,
        has_modes=not (
            holds
            and drive.pid is None
            and claimed_interfaces(robot, controllers) <= positions
        ),
        has_limits=any(c.system and c.system.limit_interfaces for c in controllers),
        holds=holds,
        stops=(drive.gains.lower, drive.gains.upper),
    )


def claimed_interfaces(
    robot: Robot, controllers: Iterable[LoadedController]
) -> set[str]:
    """Return the command interfaces by which controllers move driven joints.

    Args:
        robot: The robot.
        controllers: Controllers, whether they are active or not.
    """
    joints = {joint.name for joint in commanded_joints(robot.description)}
    return {
        name
        for controller in controllers
        if controller.system is not None
        for name in controller.system.command_interfaces
        if name.rpartition("/")[0] in joints
        and name not in controller.system.limit_interfaces
    }


def _is_effort(name: str) -> bool:
    return name.rpartition("/")[2] == interfaces.EFFORT


def make_command_limits(
    robot: Robot,
    surroundings: Surroundings,
    controllers: Iterable[LoadedController],
    report: LoadReport,
) -> CommandLimits | None:
    """Return what commands are held to, or None if they aren't.

    Args:
        robot: The robot.
        surroundings: Its interfaces.
        controllers: Its controllers, also those that are inactive.
        report: Where limits that can't be used are recorded.
    """
    if not enforces_limits(robot):
        return None
    return CommandLimits(
        find_joint_limits(robot.description, report),
        command_order(surroundings, controllers),
        surroundings.measured,
    )
