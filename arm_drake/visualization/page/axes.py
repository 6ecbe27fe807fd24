"""Numbers that controllers are told: their ranges and units."""

import dataclasses as dc
import math

from arm_drake import interfaces
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.description.hardware_info import InterfaceInfo
from arm_drake.description.robot import Robot
from arm_drake.interfaces import ACCELERATION, EFFORT, POSITION, VELOCITY
from arm_drake.plant.joint_ranges import joint_ranges

# Largest speed of a joint without a limit [rad/s] and [m/s].
_TURN, _SLIDE = 1.0, 0.1

# Ends of the range of any other number without limits, in its unit.
_END = 1.0

# Limits further away stand for none, such as 1e16: a slider is no use.
_FAR = 1e4


@dc.dataclass(frozen=True)
class Axis:
    """A number that a controller is told about a joint, or about something else."""

    # Such as "joint1/position".
    name: str

    # Such as "joint1" and "position".
    joint: str
    interface: str

    # Where it can be put by a slider, and in which unit.
    lower: float
    upper: float
    unit: str

    # Whether it is the position of a joint that turns without end.
    wraps: bool = False

    # The joint's largest speed, or what stands for it [rad/s] or [m/s].
    speed: float = _TURN

    def show(self, value: float) -> float:
        """Return a value as a slider shows it."""
        return math.remainder(value, 2.0 * math.pi) if self.wraps else value

    def nearest(self, value: float, present: float) -> float:
        """Return what is the same as a value, and nearest to the present one.

        Args:
            value: What is wanted.
            present: What is the case.
        """
        if not self.wraps:
            return value
        return present + math.remainder(value - present, 2.0 * math.pi)


def find_axis(robot: Robot, params: ControllerInterfaceParams, name: str) -> Axis:
    """Return what is to be known of a command interface.

    Its range is that of the joint, within the limits that the hardware's description
    gives the interface. A joint without a velocity limit is taken to reach 1 rad/s or
    0.1 m/s; other limits that are missing are -1 and 1.

    Args:
        robot: The robot.
        params: What the controller knows of it.
        name: The interface; one of another controller stands for the joint that its
            name tells.
    """
    owner, _, interface = name.rpartition("/")
    joint = owner if owner in params.joint_types else owner.rpartition("/")[2]
    kind = params.joint_types.get(joint)
    limits = _find_interface(robot, f"{joint}/{interface}")
    if kind is None or interface not in interfaces.MOTIONS:
        ends = _narrow(-math.inf, math.inf, limits)
        lower, upper = ends if all(map(math.isfinite, ends)) else (-_END, _END)
        return Axis(name, joint, interface, lower, upper, "")
    is_slide = kind == "prismatic"
    speed = _known(params.velocity_limits.get(joint), _SLIDE if is_slide else _TURN)
    wraps = False
    if interface == POSITION:
        own = next(r for r in joint_ranges(robot.description) if r.name == joint)
        lower, upper, wraps = own.lower, own.upper, own.wraps
    else:
        largest = {
            VELOCITY: speed,
            ACCELERATION: _END,
            EFFORT: _known(params.effort_limits.get(joint), _END),
        }
        lower, upper = -largest[interface], largest[interface]
    inner = _narrow(lower, upper, limits)
    wraps = wraps and inner == (lower, upper)
    unit = ("m/s²" if is_slide else "rad/s²") if interface == ACCELERATION else ""
    unit = unit or interfaces.unit(interface, kind)
    return Axis(name, joint, interface, *inner, unit, wraps, speed)


def _known(limit: float | None, otherwise: float) -> float:
    """Return a limit if it is one."""
    return limit if limit is not None and limit <= _FAR else otherwise


def _find_interface(robot: Robot, name: str) -> InterfaceInfo | None:
    """Return a command interface of the hardware, if its limits hold."""
    for block in robot.description.hardware:
        for component in (*block.joints, *block.gpios):
            for interface in component.command_interfaces:
                if f"{component.name}/{interface.name}" == name:
                    holds = component.enable_limits and interface.enable_limits
                    return interface if holds else None
    return None


def _narrow(
    lower: float, upper: float, limits: InterfaceInfo | None
) -> tuple[float, float]:
    """Return a range within limits, unless they have nothing in common."""
    if limits is None:
        return lower, upper
    inner_lower = lower if limits.min is None else max(lower, limits.min)
    inner_upper = upper if limits.max is None else min(upper, limits.max)
    if not inner_lower <= inner_upper:
        return lower, upper
    return inner_lower, inner_upper
