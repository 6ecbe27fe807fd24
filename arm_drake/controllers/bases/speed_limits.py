"""Limits of one component of a base's velocity, as control_toolbox's RateLimiter.

Source: control_toolbox 6.3.0, and the parameters of diff_drive_controller.
"""

import dataclasses as dc
import math
from typing import Annotated

from arm_drake.description.given import Given
from arm_drake.description.parameters import Rule

_SIGNS = {
    "max_velocity": 1,
    "min_velocity": -1,
    "max_acceleration": 1,
    "max_deceleration": -1,
    "max_acceleration_reverse": -1,
    "max_deceleration_reverse": 1,
    "max_jerk": 1,
    "min_jerk": -1,
}


@dc.dataclass(frozen=True)
class SpeedLimits:
    """Limits of a velocity along or about an axis [m/s] or [rad/s]; NaN is no limit."""

    # Largest velocity, at least 0, and smallest, at most 0; if that is NaN, it is the
    # opposite of the largest.
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Rate of change forwards: speeding up, at least 0, and slowing down, at most 0.
    max_acceleration: float = math.nan
    max_deceleration: Annotated[float, Rule(since="jazzy")] = math.nan

    # The same backwards: at most 0, and at least 0.
    max_acceleration_reverse: Annotated[float, Rule(since="jazzy")] = math.nan
    max_deceleration_reverse: Annotated[float, Rule(since="jazzy")] = math.nan

    # Rate of change of the acceleration, at least 0 and at most 0.
    max_jerk: float = math.nan
    min_jerk: float = math.nan

    @staticmethod
    def adapt(given: Given) -> None:
        """Take the older min_acceleration, and the deceleration's older sign."""
        names = ["min_acceleration"]
        if not given.is_before("jazzy"):
            names.append("max_deceleration")
        for name in names:
            value = given.get(name, float)
            if value is not None and value > 0.0:
                what = f"must be at most 0, got {value}"
                given.add(name, "warning", "repair", what, f"taken as {-value}")
                given.set(name, -value)
        for name in ("max_velocity", "max_acceleration", "max_jerk"):
            if given.get(name, float) == 0.0:
                what = "0 lets nothing move; .nan is no limit"
                given.add(name, "warning", "invalid", what, "it is taken as it is")
        value = given.get("min_acceleration", float)
        if value is not None:
            given.replace(
                "min_acceleration",
                {"max_deceleration": value, "max_acceleration_reverse": value},
            )

    def __post_init__(self) -> None:
        """Reject limits on the wrong side of 0."""
        for name, sign in _SIGNS.items():
            value = getattr(self, name)
            if sign * value < 0.0:
                allowed = "at least 0" if sign > 0 else "at most 0"
                raise ValueError(f"{name} must be {allowed}, got {value}")
