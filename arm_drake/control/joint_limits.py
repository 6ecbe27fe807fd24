"""Limits of joints, to which commands are held: one joint, and all of a robot.

The rules are those of ros2_control's joint_limits (``joint_limits_helpers.cpp``,
``joint_saturation_limiter.cpp`` and, for joints with soft limits,
``joint_soft_limiter.cpp``; master of 2026-08). One joint is in plain numbers, for it
runs for each joint at every tick. Units are the joint's: [rad] or [m], [N·m] or [N],
and [s]. q and v are the measured position and velocity, None where they aren't
measured; a range is a lower and an upper end.

Quirks of upstream that are kept:

* Two ends that come out in the wrong order are swapped. So a joint that is slightly
  out of its range and is to move back does so within one period, if need be faster
  than its limit. And a first velocity command that is too fast slows down with the
  limit of the acceleration where no velocity is measured.
* `k_velocity` of 0 without a limit of the velocity takes the limit of the effort away.

All joints of a robot are held to their limits once in a cycle, as ros2_control's
resource manager does where `enforce_command_limits` is on, on the command interfaces
that are claimed. Upstream limits a command when it is written, and once more at the end
of the cycle; both give the same, so it is done at the end.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple

from arm_drake.arrays import Array
from arm_drake.description.joint_limits import JointLimits, Range, SoftJointLimits
from arm_drake.errors import InputError

UNLIMITED: Range = (-math.inf, math.inf)

# So far beyond its limits a joint may be measured, for sensors and motors aren't exact.
_TOLERANCE = 0.002

# With this speed a joint comes back that is outside its soft limits.
_SOFT_SPEED = math.radians(1.0)


def last_known(position: float | None, other: float | None) -> float | None:
    """Return the first of two positions that is a finite number."""
    if position is not None and math.isfinite(position):
        return position
    return other if other is not None and math.isfinite(other) else None


def position_range(
    limits: JointLimits,
    q: float | None,
    v: float | None,
    previous: float | None,
    dt: float,
) -> Range:
    """Return the range of a position command; `dt` [s]."""
    low, high = limits.position_range or UNLIMITED
    # Not where the joint is: it lags behind its commands, and would hardly move.
    start = q if previous is None else previous
    if limits.max_velocity is not None and start is not None:
        speed = limits.max_velocity
        if limits.max_acceleration is not None:
            reachable = (0.0 if v is None else abs(v)) + limits.max_acceleration * dt
            speed = min(speed, reachable)
        low = max(min(start - speed * dt, high), low)
        high = min(max(start + speed * dt, low), high)
    return (high, low) if low > high else (low, high)


def velocity_range(
    limits: JointLimits,
    q: float | None,
    velocity: float,
    previous: float | None,
    dt: float,
) -> Range:
    """Return the range of a velocity command; `dt` [s]."""
    if limits.max_velocity is None:
        return UNLIMITED
    low, high = -limits.max_velocity, limits.max_velocity
    if q is not None and limits.position_range is not None:
        bottom, top = limits.position_range
        low, high = max((bottom - q) / dt, low), min((top - q) / dt, high)
        if q > top or q < bottom:
            rises_on = bottom < q < top + _TOLERANCE and velocity >= 0.0
            falls_on = bottom - _TOLERANCE < q < top and velocity <= 0.0
            is_far = q > top + _TOLERANCE or q < bottom - _TOLERANCE
            if rises_on or falls_on or is_far:
                low = high = 0.0
    if limits.max_acceleration is not None and previous is not None:
        change = limits.max_acceleration * dt
        low, high = max(previous - change, low), min(previous + change, high)
    return (high, low) if low > high else (low, high)


def effort_range(
    limits: JointLimits, most: float, q: float | None, v: float | None
) -> Range:
    """Return the range of an effort command.

    A joint at the end of its range, or too fast, isn't pushed on.
    """
    low, high = -most, most
    if v is None:
        return low, high
    if q is not None and limits.position_range is not None:
        bottom, top = limits.position_range
        if q <= bottom and v <= 0.0:
            low = 0.0
        elif q >= top and v >= 0.0:
            high = 0.0
    if limits.max_velocity is not None:
        if v < -limits.max_velocity:
            low = 0.0
        elif v > limits.max_velocity:
            high = 0.0
    return low, high


def max_acceleration(
    limits: JointLimits, acceleration: float, v: float | None
) -> float | None:
    """Return the greatest amount of an acceleration command, None without a limit."""
    slows_down = v is not None and (acceleration < 0.0 < v or v < 0.0 < acceleration)
    if slows_down and limits.max_deceleration is not None:
        return limits.max_deceleration
    return limits.max_acceleration


def velocity_band(
    limits: JointLimits,
    soft: SoftJointLimits,
    q: float | None,
    previous: float | None,
) -> Range:
    """Return which velocities soft limits leave where the joint is."""
    most = limits.max_velocity
    if most is None:
        return UNLIMITED
    near = last_known(previous, q)
    bounds, soft_bounds, gain = limits.position_range, soft.position_range, soft.slope
    if bounds is None or soft_bounds is None or gain is None or near is None:
        return -most, most
    low = min(max(-gain * (near - soft_bounds[0]), -most), most)
    high = min(max(-gain * (near - soft_bounds[1]), -most), most)
    q = near if q is None else q
    if q < bounds[0] - _TOLERANCE or q > bounds[1] + _TOLERANCE:
        return 0.0, 0.0
    if q < soft_bounds[0] or q > soft_bounds[1]:
        return math.copysign(_SOFT_SPEED, low), math.copysign(_SOFT_SPEED, high)
    return low, high


def soft_position_range(
    limits: JointLimits,
    soft: SoftJointLimits,
    hard: Range,
    band: Range,
    near: float | None,
    dt: float,
) -> Range:
    """Return the range of a position command under soft limits; `dt` [s]."""
    low, high = soft.position_range or UNLIMITED
    if limits.max_velocity is not None and near is not None:
        low = min(max(near + band[0] * dt, low), high)
        high = min(max(near + band[1] * dt, low), high)
    both = max(low, hard[0]), min(high, hard[1])
    return (low, high) if both[0] > both[1] else both


def narrow_band(
    limits: JointLimits, band: Range, hard: Range, v: float | None, dt: float
) -> Range:
    """Return the range of a velocity command under soft limits; `dt` [s]."""
    low, high = band
    acceleration = limits.max_acceleration
    if limits.max_velocity is not None and acceleration is not None and v is not None:
        change = acceleration * dt
        low, high = max(v - change, low), min(v + change, high)
    return max(low, hard[0]), min(high, hard[1])


def soft_effort_range(
    soft: SoftJointLimits, most: float, hard: Range, band: Range, v: float
) -> Range:
    """Return the range of an effort command under soft limits."""
    gain = soft.k_velocity
    if gain is None or not math.isfinite(gain):
        return hard
    low, high = (min(max(-gain * (v - end), -most), most) for end in band)
    return max(low, hard[0]), min(high, hard[1])


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
    """Command of a joint after its limits."""

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
        """Create the error."""
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

    A NaN is no command: it passes and isn't remembered. `previous` is what the last
    call returned, NO_COMMAND at first; None is what isn't measured or commanded.
    """
    if dt <= 0.0:
        return LimitedCommand(desired, False, previous)
    if previous == NO_COMMAND:
        previous = _start(measured, desired)
    position, velocity, effort, acceleration, jerk = desired
    p0, v0, e0, a0, j0 = previous
    q, v, soft, is_limited = measured.position, measured.velocity, soft_limits, False
    band = UNLIMITED if soft is None else velocity_band(limits, soft, q, p0)

    if position is not None and position == position:
        _check_position(limits, q, previous)
        low, high = position_range(limits, q, v, p0, dt)
        if soft is not None:
            near, hard = last_known(p0, q), (low, high)
            low, high = soft_position_range(limits, soft, hard, band, near, dt)
        if position < low or position > high:
            is_limited, position = True, min(max(position, low), high)
        p0 = position

    if velocity is not None and velocity == velocity:
        low, high = velocity_range(limits, q, velocity, v0, dt)
        if soft is not None:
            band = low, high = narrow_band(limits, band, (low, high), v, dt)
        if velocity < low or velocity > high:
            is_limited, velocity = True, min(max(velocity, low), high)
        v0 = velocity

    if effort is not None and effort == effort:
        most = limits.max_effort
        if most is not None:
            low, high = effort_range(limits, most, q, v)
            if soft is not None and v is not None:
                low, high = soft_effort_range(soft, most, (low, high), band, v)
            if effort < low or effort > high:
                is_limited, effort = True, min(max(effort, low), high)
        e0 = effort

    if acceleration is not None and acceleration == acceleration:
        most = max_acceleration(limits, acceleration, v)
        a0 = acceleration = _bound(acceleration, most)
    if jerk is not None and jerk == jerk:
        j0 = jerk = _bound(jerk, limits.max_jerk)
    if acceleration is not desired.acceleration or jerk is not desired.jerk:
        is_limited = True  # What isn't limited is the same object.
    command = JointControlInterfacesData(position, velocity, effort, acceleration, jerk)
    last = JointControlInterfacesData(p0, v0, e0, a0, j0)
    return LimitedCommand(command, is_limited, last)


def _bound(value: float, most: float | None) -> float:
    """Return a value of at most an amount; itself if it is."""
    if most is not None and abs(value) > most:
        return math.copysign(most, value)
    return value


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


# What is remembered of a joint's commands, by its name.
Previous = Mapping[str, JointControlInterfacesData]


class LimitedCommands(NamedTuple):
    """Result of limiting the commands of a cycle."""

    previous: Previous

    # Joints that a command would have led beyond a limit.
    limited: tuple[str, ...]

    # Joints that are so far outside their limits that they can't be commanded, and what
    # is the matter with them, in words.
    out_of_bounds: Mapping[str, str]


class CommandLimits:
    """The limits of a robot's joints, for the vector of its command values."""

    def __init__(
        self,
        limits: Mapping[str, tuple[JointLimits, SoftJointLimits | None]],
        order: Sequence[str],
        measured: Sequence[str],
    ) -> None:
        """Create it; `order` names the command values, `measured` what is measured."""
        self._limits = limits
        self._order = {name: index for index, name in enumerate(order)}
        self._measured = {name: index for index, name in enumerate(measured)}

    def apply(
        self,
        claimed: Collection[str],
        values: Array,
        measured: Array,
        previous: Previous,
        dt: float,
    ) -> LimitedCommands:
        """Bring command values, shape (k,), within the limits, in place.

        `claimed` are full names of interfaces; `previous` is what the last cycle
        returned, {} at first, and for joints that are switched to another interface;
        `dt` is the time since then [s].
        """
        remembered = dict(previous)
        limited: list[str] = []
        lost: dict[str, str] = {}
        for joint, (limits, soft_limits) in self._limits.items():
            fields = {
                name: at
                for name in JointControlInterfacesData._fields
                if (full := f"{joint}/{name}") in claimed
                and (at := self._order.get(full)) is not None
            }
            if not fields:
                continue
            state = JointControlInterfacesData(
                *(
                    float(measured[at])
                    if (at := self._measured.get(f"{joint}/{name}")) is not None
                    else None
                    for name in ("position", "velocity")
                )
            )
            desired = JointControlInterfacesData(
                **{name: float(values[at]) for name, at in fields.items()}
            )
            before = previous.get(joint, NO_COMMAND)
            try:
                new = limit(limits, soft_limits, before, state, desired, dt)
            except PositionOutOfBoundsError as error:
                remembered[joint] = error.previous
                lost[joint] = f"joint {joint!r}: {error}"
                continue
            remembered[joint] = new.previous
            if new.is_limited:
                limited.append(joint)
            for name, at in fields.items():
                values[at] = getattr(new.command, name)
        return LimitedCommands(remembered, tuple(limited), lost)
