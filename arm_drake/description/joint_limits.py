"""Limits of a robot's joints, as ros2_control takes them from a description.

The rules are those of ros2_control's ``joint_limits_urdf.hpp`` and of
``component_parser.cpp`` in its hardware_interface. Two differ: a speed or effort of 0
in `<limit>` is no limit, as everywhere in this package (upstream would hold the joint),
and a negative maximum of a velocity or effort interface is meant as its amount.
"""

import dataclasses as dc
import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import ComponentInfo, InterfaceInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.importing import dataclass
from arm_drake.interfaces import ACCELERATION, EFFORT, POSITION, VELOCITY

_JERK = "jerk"
_LIMITED = (POSITION, VELOCITY, EFFORT, ACCELERATION, _JERK)

_MAXIMA = (
    "max_velocity",
    "max_effort",
    "max_acceleration",
    "max_deceleration",
    "max_jerk",
)

# Lower and upper end of positions.
Range = tuple[float, float]


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint that commands are held to; None where there is none.

    Units are those of the joint: [rad] and [N·m], or [m] and [N].
    """

    # The lower may be above the upper one: where two ranges that hold don't overlap.
    min_position: float | None = None
    max_position: float | None = None

    # Not negative, as all below.
    max_velocity: float | None = None

    max_effort: float | None = None

    # Of a command that speeds the joint up; of all if there is none for slowing down.
    max_acceleration: float | None = None

    # Of a command that slows the joint down.
    max_deceleration: float | None = None

    max_jerk: float | None = None

    # Both limits of the position, infinite where one is not given; None without any.
    position_range: Range | None = dc.field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers."""
        _refuse_nan(self)
        for name in _MAXIMA:
            value = getattr(self, name)
            if value is not None and value < 0.0:
                raise ValueError(f"{name}: expected a number from 0 on, got {value!r}")
        low, high = self.min_position, self.max_position
        found = -math.inf if low is None else low, math.inf if high is None else high
        has_range = low is not None or high is not None
        object.__setattr__(self, "position_range", found if has_range else None)


@dataclass(frozen=True)
class SoftJointLimits:
    """Soft limits of a joint before its hard ones; None where unset.

    The letters are those of `<safety_controller>` in a URDF.
    """

    # [rad] or [m].
    min_position: float | None = None
    max_position: float | None = None

    # How fast a joint may come near a soft limit, per distance [1/s].
    k_position: float | None = None

    # Effort per speed beyond what is allowed [N·m·s/rad] or [N·s/m].
    k_velocity: float | None = None

    # The limits of the position, None unless they count: both finite, and in order.
    position_range: Range | None = dc.field(init=False, repr=False, compare=False)

    # `k_position`, None unless it counts: finite, not 0, and with a range.
    slope: float | None = dc.field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers."""
        _refuse_nan(self)
        low, high, gain = self.min_position, self.max_position, self.k_position
        found = None
        if low is not None and high is not None:
            is_finite = math.isfinite(low) and math.isfinite(high)
            if is_finite and high - low > sys.float_info.epsilon:
                found = low, high
        if found is None or not gain or not math.isfinite(gain):
            gain = None
        object.__setattr__(self, "position_range", found)
        object.__setattr__(self, "slope", gain)


def _refuse_nan(limits: JointLimits | SoftJointLimits) -> None:
    for field in dc.fields(limits):
        value = getattr(limits, field.name) if field.init else None
        if value is not None and math.isnan(value):
            raise ValueError(f"{field.name}: expected a number, got nan")


def find_joint_limits(
    description: RobotDescription, report: LoadReport | None = None
) -> dict[str, tuple[JointLimits, SoftJointLimits | None]]:
    """Return the limits of every movable joint, in the order of the description.

    The hard ones are those of `<limit>`, narrowed by `min` and `max` of the joint's
    command interfaces; acceleration, deceleration and jerk have only these.
    `<limits enable="false"/>` of an interface takes the limits of its quantity away, of
    a joint all. The soft ones are those of `<safety_controller>`, None without it.
    """
    components: dict[str, list[ComponentInfo]] = {}
    for block in description.hardware:
        for component in block.joints:
            components.setdefault(component.name, []).append(component)
    found: dict[str, tuple[JointLimits, SoftJointLimits | None]] = {}
    for joint in description.movable_joints:
        parts = components.get(joint.name, [])
        if not all(part.enable_limits for part in parts):
            found[joint.name] = JointLimits(), None
            continue
        commands = [command for part in parts for command in part.command_interfaces]
        hard = _hard_limits(joint, commands)
        found[joint.name] = hard, _soft_limits(joint, hard)
        if report is not None:
            _report(joint.name, hard, commands, report, description.file)
    return found


def _hard_limits(joint: JointInfo, commands: Iterable[InterfaceInfo]) -> JointLimits:
    low, high = joint.limits.lower, joint.limits.upper
    velocity, effort = joint.limits.velocity, joint.limits.effort
    acceleration = deceleration = jerk = None
    for command in commands:
        name, is_on = command.name, command.enable_limits
        least, most = _amount(command.min), _amount(command.max)
        if name == POSITION:
            low = narrowest(max, low, command.min) if is_on else None
            high = narrowest(min, high, command.max) if is_on else None
        elif name == VELOCITY:
            velocity = narrowest(min, velocity, least, most) if is_on else None
        elif name == EFFORT:
            effort = narrowest(min, effort, least, most) if is_on else None
        elif name == ACCELERATION and is_on:
            acceleration, deceleration = most, least
        elif name == _JERK and is_on:
            jerk = most
    return JointLimits(
        min_position=low,
        max_position=high,
        max_velocity=velocity,
        max_effort=effort,
        max_acceleration=acceleration,
        max_deceleration=deceleration,
        max_jerk=jerk,
    )


def _soft_limits(joint: JointInfo, hard: JointLimits) -> SoftJointLimits | None:
    safety = joint.safety_controller
    if safety is None:
        return None
    return SoftJointLimits(
        min_position=narrowest(max, safety.soft_lower_limit, hard.min_position),
        max_position=narrowest(min, safety.soft_upper_limit, hard.max_position),
        k_position=safety.k_position,
        k_velocity=safety.k_velocity,
    )


def _amount(limit: float | None) -> float | None:
    return None if limit is None or math.isinf(limit) else abs(limit)


def narrowest(
    pick: Callable[[list[float]], float], *limits: float | None
) -> float | None:
    """Return the one that holds of several limits, None without a finite one."""
    known_limits = [x for x in limits if x is not None and math.isfinite(x)]
    return pick(known_limits) if known_limits else None


def _report(
    joint: str,
    hard: JointLimits,
    commands: Iterable[InterfaceInfo],
    report: LoadReport,
    file: Path,
) -> None:
    where = f"joint {joint!r}"
    if hard.position_range is not None:
        low, high = hard.position_range
        if low > high:
            what = f"its position is to be at least {low} and at most {high}"
            done = "every position is out of bounds"
            report.add("warning", "invalid", what, done, where=where, file=file)
    for command in commands:
        if command.name == _JERK and command.min is not None:
            what, done = "jerk, min: expected max alone", "it has no effect"
        elif command.name not in _LIMITED and (command.min, command.max) != (
            None,
            None,
        ):
            what = f"limits of {command.name!r}"
            done = f"not enforced; those of {', '.join(_LIMITED)} are"
        else:
            continue
        report.add("info", "ignored", what, done, where=where, file=file)
