"""Holds the commands of one joint to its limits.

The rules are those of ros2_control's joint_limits (``joint_saturation_limiter.cpp`` and
``joint_soft_limiter.cpp``, master of 2026-08). One joint in plain numbers, for it
runs for each joint at every tick. Units are the joint's: [rad] or [m], [N·m] or [N],
and [s].
"""

import math
from typing import Final, NamedTuple

from arm_drake.control.joint_limit_ranges import (
    UNLIMITED,
    effort_range,
    last_known,
    max_acceleration,
    narrow_band,
    position_range,
    soft_effort_range,
    soft_position_range,
    velocity_band,
    velocity_range,
)
from arm_drake.description.joint_limits import JointLimits, Range, SoftJointLimits
from arm_drake.errors import InputError

# So far beyond its limits no joint is commanded a position: half a degree, or 1 cm.
_OUT_OF_BOUNDS = 0.0087


class JointControlInterfacesData(NamedTuple):
    """One number for each interface of a joint, None for those it doesn't have."""

    position: float | None = None
    velocity: float | None = None
    effort: float | None = None
    acceleration: float | None = None
    jerk: float | None = None


# What is remembered before the first command, and after another mode was switched to.
NO_COMMAND: Final = JointControlInterfacesData()


class LimitedCommand(NamedTuple):
    """What a joint is commanded after its limits."""

    command: JointControlInterfacesData

    # Whether a number of the command was out of its range.
    is_limited: bool

    # What is to be remembered for the next command.
    previous: JointControlInterfacesData


class PositionOutOfBoundsError(InputError):
    """A joint is so far outside its limits that no position is commanded."""

    def __init__(
        self, position: float, limits: Range, previous: JointControlInterfacesData
    ) -> None:
        """Create the error.

        Args:
            position: Measured position.
            limits: Least and greatest position.
            previous: What is to be remembered for the next command.
        """
        self.previous = previous
        low, high = limits
        super().__init__(
            f"the joint is at {position}; expected it between {low} and {high}, or "
            f"less than {_OUT_OF_BOUNDS} beyond"
        )


def limit(
    limits: JointLimits,
    soft_limits: SoftJointLimits | None,
    previous: JointControlInterfacesData,
    measured: JointControlInterfacesData,
    desired: JointControlInterfacesData,
    dt: float,
) -> LimitedCommand:
    """Return a command that is within the limits of a joint.

    A NaN is no command: it passes and isn't remembered.

    Args:
        limits: What the joint can do.
        soft_limits: What slows it down before; None selects upstream's
            JointSaturationLimiter, anything else its JointSoftLimiter.
        previous: The limited commands before, as the last call returned them;
            NO_COMMAND at first.
        measured: Measured state; None where nothing is measured.
        desired: The command; None where the joint has no such command interface.
        dt: Time since the command before [s]; with 0 or less nothing is limited.

    Raises:
        PositionOutOfBoundsError: If a position is commanded and the joint is far
            outside its limits.
    """
    if dt <= 0.0:
        return LimitedCommand(desired, False, previous)
    if previous == NO_COMMAND:
        previous = _start(measured, desired)
    position, velocity, effort, acceleration, jerk = desired
    last_position, last_velocity, last_effort, last_acceleration, last_jerk = previous
    q, v = measured.position, measured.velocity
    is_limited = False

    band = UNLIMITED
    if soft_limits is not None:
        band = velocity_band(limits, soft_limits, q, last_position)

    if position is not None and position == position:
        _check_position(limits, q, previous)
        low, high = position_range(limits, q, v, last_position, dt)
        if soft_limits is not None:
            near, hard = last_known(last_position, q), (low, high)
            low, high = soft_position_range(limits, soft_limits, hard, band, near, dt)
        if position < low or position > high:
            is_limited, position = True, min(max(position, low), high)
        last_position = position

    if velocity is not None and velocity == velocity:
        low, high = velocity_range(limits, q, velocity, last_velocity, dt)
        if soft_limits is not None:
            band = low, high = narrow_band(limits, band, (low, high), v, dt)
        if velocity < low or velocity > high:
            is_limited, velocity = True, min(max(velocity, low), high)
        last_velocity = velocity

    if effort is not None and effort == effort:
        if limits.max_effort is not None:
            low, high = effort_range(limits, limits.max_effort, q, v)
            if soft_limits is not None and v is not None:
                hard = low, high
                low, high = soft_effort_range(
                    soft_limits, limits.max_effort, hard, band, v
                )
            if effort < low or effort > high:
                is_limited, effort = True, min(max(effort, low), high)
        last_effort = effort

    if acceleration is not None and acceleration == acceleration:
        most = max_acceleration(limits, acceleration, v)
        if most is not None and abs(acceleration) > most:
            is_limited, acceleration = True, math.copysign(most, acceleration)
        last_acceleration = acceleration

    if jerk is not None and jerk == jerk:
        most = limits.max_jerk
        if most is not None and abs(jerk) > most:
            is_limited, jerk = True, math.copysign(most, jerk)
        last_jerk = jerk

    return LimitedCommand(
        JointControlInterfacesData(position, velocity, effort, acceleration, jerk),
        is_limited,
        JointControlInterfacesData(
            last_position, last_velocity, last_effort, last_acceleration, last_jerk
        ),
    )


def _check_position(
    limits: JointLimits, q: float | None, previous: JointControlInterfacesData
) -> None:
    if q is not None and limits.position_range is not None:
        low, high = limits.position_range
        if q > high + _OUT_OF_BOUNDS or q < low - _OUT_OF_BOUNDS:
            raise PositionOutOfBoundsError(q, (low, high), previous)


def _start(
    measured: JointControlInterfacesData, desired: JointControlInterfacesData
) -> JointControlInterfacesData:
    """Return what is taken as the commands before the first one."""
    return JointControlInterfacesData(
        *(
            None if x_d is None else x if x is not None else _number(x_d)
            for x, x_d in zip(measured, desired, strict=True)
        )
    )


def _number(x: float) -> float | None:
    return x if x == x else None
