"""Loaded controllers of a robot, their states and their command interfaces."""

from collections.abc import Collection, Iterable
from typing import Literal, NamedTuple

from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.robot import Robot
from arm_drake.importing import dataclass
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.switching import ControllerInfo

ControllerStatus = Literal["active", "inactive", "unconfigured"]


class ControllerState(NamedTuple):
    """A row of `ros2 control list_controllers`."""

    name: str
    type: str

    # "unconfigured" is a controller that could not be loaded.
    state: ControllerStatus


@dataclass(frozen=True, eq=False)
class LoadedController:
    """A controller of a robot, with its system if it could be loaded."""

    name: str
    type: str
    state: ControllerStatus
    system: ControllerInterface | None

    # Why it can't be activated; empty if it can.
    missing: tuple[str, ...] = ()

    # Why it could not be loaded; empty if it was.
    problem: str = ""

    # Joints that it moves, of a drive that follows one controller at a time.
    joints: tuple[str, ...] = ()


def list_states(
    controllers: Iterable[LoadedController], active: Collection[str]
) -> tuple[ControllerState, ...]:
    """Return the states of controllers, in the YAML's order, when some are active."""
    return tuple(
        ControllerState(
            c.name,
            c.type,
            "unconfigured"
            if c.system is None
            else "active"
            if c.name in active
            else "inactive",
        )
        for c in controllers
    )


def controller_infos(
    controllers: Iterable[LoadedController],
) -> dict[str, ControllerInfo]:
    """Return what a switch has to know of controllers, by their name."""
    return {
        c.name: ControllerInfo(
            name=c.name,
            command_interfaces=c.system.command_interfaces if c.system else (),
            state_interfaces=c.system.state_interfaces if c.system else (),
            reference_interfaces=c.system.reference_interfaces if c.system else (),
            exported_state_interfaces=c.system.exported_interfaces if c.system else (),
            limit_interfaces=c.system.limit_interfaces if c.system else {},
            joints=c.joints,
            is_configured=c.system is not None,
            missing=c.missing,
        )
        for c in controllers
    }


def command_order(
    hardware_interfaces: HardwareInterfaces, controllers: Iterable[LoadedController]
) -> tuple[str, ...]:
    """Return the names of all command interfaces.

    Those of the hardware come first, then limits that the description doesn't mention,
    then references of controllers.
    """
    systems = [c.system for c in controllers if c.system is not None]
    limits = (name for system in systems for name in system.limit_interfaces)
    known = dict.fromkeys((*hardware_interfaces.command_interfaces, *limits))
    references = (name for system in systems for name in system.reference_interfaces)
    return (*known, *references)


def enforces_limits(robot: Robot) -> bool:
    """Return whether a robot's commands are held to the limits of its joints.

    Humble can't, and jazzy does it only if it is asked to.
    """
    if robot.distro == "humble":
        return False
    setting = robot.controllers.enforce_command_limits
    return robot.distro != "jazzy" if setting is None else setting
