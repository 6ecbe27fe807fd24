"""The ranges that a joint's limits leave to its commands, one quantity each.

The rules are those of ros2_control's joint_limits (``joint_limits_helpers.cpp`` and
``joint_soft_limiter.cpp``, master of 2026-08). q and v are the measured position and
velocity, None where they aren't measured; a range is a lower and an upper end. Plain
numbers of one joint, in its units: [rad] or [m], [N·m] or [N], and [s].

Quirks of upstream that are kept:

* Two ends that come out in the wrong order are swapped. So a joint that is slightly
  out of its range and is to move back does so within one period, if need be faster
  than its limit. And a first velocity command that is too fast slows down with the
  limit of the acceleration where no velocity is measured.
* `k_velocity` of 0 without a limit of the velocity takes the limit of the effort away.
"""

import math

from arm_drake.description.joint_limits import JointLimits, Range, SoftJointLimits

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
    """Return the range of a position command.

    Args:
        limits: Limits of the joint.
        q: Measured position.
        v: Measured velocity.
        previous: The position commanded before, after limits.
        dt: Time since [s].
    """
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
    """Return the range of a velocity command.

    Args:
        limits: Limits of the joint.
        q: Measured position.
        velocity: The command.
        previous: The velocity commanded before, after limits.
        dt: Time since [s].
    """
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

    Args:
        limits: Limits of the joint.
        most: Its limit of the effort.
        q: Measured position.
        v: Measured velocity.
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
    """Return the greatest amount of an acceleration command, None without a limit.

    Args:
        limits: Limits of the joint.
        acceleration: The command.
        v: Measured velocity; a command against it slows the joint down.
    """
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
    """Return which velocities soft limits leave where the joint is.

    Args:
        limits: Limits of the joint.
        soft: Its soft limits.
        q: Measured position.
        previous: The position commanded before, after limits.
    """
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
    """Return the range of a position command under soft limits.

    Args:
        limits: Limits of the joint.
        soft: Soft limits of the joint.
        hard: The range without them; disregarded where it doesn't overlap with theirs.
        band: The joint's velocity band.
        near: The position commanded before, else the measured one, if any is known.
        dt: Time since [s].
    """
    low, high = soft.position_range or UNLIMITED
    if limits.max_velocity is not None and near is not None:
        low = min(max(near + band[0] * dt, low), high)
        high = min(max(near + band[1] * dt, low), high)
    both = max(low, hard[0]), min(high, hard[1])
    return (low, high) if both[0] > both[1] else both


def narrow_band(
    limits: JointLimits, band: Range, hard: Range, v: float | None, dt: float
) -> Range:
    """Return the range of a velocity command under soft limits.

    Args:
        limits: Limits of the joint.
        band: Its velocity band.
        hard: The range without soft limits.
        v: Measured velocity.
        dt: Time since the last command [s].
    """
    low, high = band
    acceleration = limits.max_acceleration
    if limits.max_velocity is not None and acceleration is not None and v is not None:
        change = acceleration * dt
        low, high = max(v - change, low), min(v + change, high)
    return max(low, hard[0]), min(high, hard[1])


def soft_effort_range(
    soft: SoftJointLimits, most: float, hard: Range, band: Range, v: float
) -> Range:
    """Return the range of an effort command under soft limits.

    Args:
        soft: Soft limits of the joint.
        most: Its limit of the effort.
        hard: The range without soft limits.
        band: The velocities that are allowed.
        v: Measured velocity.
    """
    gain = soft.k_velocity
    if gain is None or not math.isfinite(gain):
        return hard
    low, high = (min(max(-gain * (v - end), -most), most) for end in band)
    return max(low, hard[0]), min(high, hard[1])
